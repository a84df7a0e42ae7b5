"""The skew compensation that `calib measure` tells for the next print."""

from dataclasses import replace

import numpy as np
import pytest

from calib.draw.print_errors import degrees, next_options, next_print, skew_words
from calib.measure_target.deviations import Compensation, Estimate, WholePrint, next_skew_rad, whole_of_strain
from designer.base.arrays import Array
from designer.base.errors import InputError
from designer.base.units import NO_SKEW, Skew, parse_skew_rad, skew_matrix
from designer.kinds.sizing import size_printing
from designer.make.bed import bed_from_target, printed_corners_mm
from designer.page.blocks import Command
from designer.spec.options import AskedPrinting
from designer.tolerance.shape import shape_of
from designer.tolerance.sources import SOURCES
from tests.support.as_built_scenes import solid

LEAN: Skew = (3e-3, -5e-3, 4e-3)


@pytest.mark.parametrize("made_with", [NO_SKEW, (2.9e-3, -5.1e-3, 4.2e-3), (-2e-3, 1e-3, 7e-3)])
@pytest.mark.parametrize("scales", [(0.0, 0.0, 0.0), (-4e-3, -4e-3, -4e-3), (2e-3, -1e-3, 3e-3)])
@pytest.mark.parametrize("bed_mm", [(250.0, 210.0, 220.0), (210.0, 250.0, 220.0)])
def test_the_skew_compensation_makes_the_next_print_right(
    made_with: Skew, scales: tuple[float, ...], bed_mm: tuple[float, float, float]
) -> None:
    """A print of the same printer, designed with the told angles, has the nominal shape, its axes scaled aright."""
    target = solid()
    printing = size_printing(AskedPrinting(), target)
    printing = replace(printing, printer=replace(printing.printer, bed_mm=bed_mm))
    lay = bed_from_target(target, printing)
    printer = SOURCES["skew"].apply(shape_of(target, lay), np.array([LEAN]))
    printer = SOURCES["axis_scale"].apply(printer, np.array([scales]))

    def print_with(skew_rad: Skew, factors: Array) -> Array:
        """Corners that come out along the bed's axes, of a design with a compensation, scaled in the slicer."""
        asked = printed_corners_mm(target, replace(printing, skew_compensation_rad=skew_rad)) @ lay[:3, :3].T
        return np.asarray(asked * factors @ printer.bed_affine.T)

    drawn = printed_corners_mm(target, printing) @ lay[:3, :3].T
    came_out = print_with(made_with, np.ones(3))
    affine = np.asarray(np.linalg.lstsq(drawn, came_out, rcond=None)[0].T, dtype=np.float64)
    told = next_skew_rad(told_of(affine), made_with)
    leans = np.arctan(printer.bed_affine / np.diagonal(printer.bed_affine))[[0, 0, 1], [1, 2, 2]]
    np.testing.assert_allclose(told, leans, rtol=0, atol=1e-12)
    factors = 1 / np.diagonal(printer.bed_affine)  # with the right scales of size and axes
    np.testing.assert_allclose(print_with(told, factors), drawn, rtol=0, atol=1e-9)


def told_of(affine: Array) -> WholePrint:
    """What is told of a print without noise: its stretch, a rotation aside (polar decomposition)."""
    _, stretches, turn = np.linalg.svd(affine)
    strain = (turn.T * stretches) @ turn - np.eye(3)
    mean = float(strain.trace()) / 3
    axes = {"xyz"[k]: Estimate(float(strain[k, k]) - mean, 1e-12) for k in range(3)}
    pairs = {"xy": (0, 1), "xz": (0, 2), "yz": (1, 2)}
    shears = {name: Estimate(2 * float(strain[pair]), 1e-12) for name, pair in pairs.items()}
    return whole_of_strain(Estimate(mean, 1e-12), axes, shears)


def test_an_angle_and_the_option_that_takes_it_back_are_one_number() -> None:
    """Of a print made without compensation, at large strains too: in words digit by digit."""
    affine = skew_matrix((8e-3, -2e-2, 1.5e-2)) @ np.diag([1.01, 0.99, 0.98])
    whole = told_of(np.asarray(affine))
    next_rad = next_skew_rad(whole)
    np.testing.assert_allclose([one.value for one in whole.skews_rad.values()], next_rad, rtol=0, atol=1e-12)
    said = {name: degrees(one).split()[0].lstrip("+") for name, one in whole.skews_rad.items()}
    assert skew_words(next_rad) == ", ".join(f"{name} {angle}deg" for name, angle in said.items())


def told_text(whole: WholePrint, made_with: Compensation) -> str:
    """All that is told of the next print."""
    return "\n".join(
        f"{one.line}   # {one.purpose}" if isinstance(one, Command) else one.text
        for one in next_print(whole, made_with, plastic=True)
    )


def test_the_next_print_is_told_with_both_compensations() -> None:
    """One command with the options that are not zero; the firmware is named beside it, and what this was made with."""
    lean, size, noise = Estimate(2e-3, 1e-4), Estimate(-4e-3, 1e-4), Estimate(1e-4, 1e-4)
    skews = {"xy": lean, "xz": Estimate(-3e-3, 1e-4), "yz": noise}
    shrink, skew = next_options(WholePrint(size, {}, skews), Compensation())
    assert (shrink.typed, shrink.made_with, shrink.sigma) == ("--shrink-compensation 0.402%", "0", "0.01 %")
    assert parse_skew_rad(skew.value) == pytest.approx((2e-3, -3e-3, 0.0), abs=2e-5)
    text = told_text(WholePrint(size, {}, skews), Compensation())
    assert f"design ... {shrink.typed} {skew.typed}   # the next print" in text
    assert "M852" in text
    assert "xy by +0.115" in text
    unknown, made_with = WholePrint(None, {}, skews), Compensation(0.3, (1e-3, 0.0, 0.01))
    shrink, skew = next_options(unknown, made_with)
    assert (shrink.typed, shrink.sigma) == ("--shrink-compensation 0.3%", "")
    assert parse_skew_rad(skew.value) == pytest.approx((3e-3, -3e-3, 0.01), abs=5e-5)
    text = told_text(unknown, made_with)
    assert "this one was made with 0.3% and xy 0.057deg, yz 0.573deg" in text
    assert "--length" in text


def test_a_compensation_that_did_its_work_is_kept() -> None:
    """Without a significant angle the compensation stays; beyond what `design` takes, the axes are to be mended."""
    noise, much = Estimate(1e-4, 1e-4), Estimate(0.05, 1e-4)
    kept = told_text(WholePrint(noise, {"x": noise}, {"xy": noise}), Compensation(0.0, (1e-3, 0.0, 0.0)))
    assert "design ..." not in kept
    assert 'no correction beyond --skew-compensation "xy 0.057deg"' in kept
    far = told_text(WholePrint(noise, {}, {"xy": much}), Compensation())
    assert "design ..." not in far
    assert "no more than 2 deg of skew" in far


@pytest.mark.parametrize(
    ("percent", "skew_rad", "said"),
    [(float("nan"), NO_SKEW, "between -50% and 50%"), (50.0, NO_SKEW, "between -50% and 50%"),
     (0.0, (0.0, float("nan"), 0.0), "between -2deg and 2deg"), (0.0, (0.04, 0.0, 0.0), "between -2deg and 2deg")],
)  # fmt: skip
def test_a_compensation_is_one_that_design_takes(percent: float, skew_rad: Skew, said: str) -> None:
    """What is no number, or more than `design` takes, is refused with value, rule and remedy."""
    with pytest.raises(InputError, match=said):
        Compensation(percent, skew_rad)
