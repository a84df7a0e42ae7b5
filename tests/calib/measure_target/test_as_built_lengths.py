"""Lengths of targets, and the scale that measured ones give; how the next print comes out right."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from calib.draw.print_errors import degrees, next_options, next_print, skew_words
from calib.measure_target.deviations import Compensation, Estimate, WholePrint, next_skew_rad, whole_of_strain
from calib.measure_target.lengths import CaliperLength, length_in, rescaled, scale_from, scaled
from designer.base.arrays import Array
from designer.base.errors import InputError
from designer.base.units import NO_SKEW, Skew, parse_skew_rad, skew_matrix
from designer.kinds.ico import icosahedron
from designer.kinds.sizing import size_printing
from designer.make.bed import bed_from_target, printed_corners_mm
from designer.page.blocks import Command
from designer.spec.options import AskedPrinting
from designer.target import TargetGeometry, load_target, target_to_json
from designer.tolerance.shape import shape_of
from designer.tolerance.sources import SOURCES
from tests.support.as_built_scenes import plate, solid
from tests.support.command_line import Answer, calib, refused, summary_of
from tests.support.perturbed_targets import board


def test_lengths_of_an_icosahedron() -> None:
    """Opposite faces are two inradii apart and an edge is an edge."""
    assert length_in(solid(), "face-to-face") == pytest.approx(200 * icosahedron().inradius)
    assert length_in(solid(), "edge") == pytest.approx(100.0)
    normal = solid().target_from_face[:, :3, 2]
    opposite = int(np.argmin(normal @ normal[0]))
    assert length_in(solid(), f"face 0 to face {opposite}") == pytest.approx(200 * icosahedron().inradius)


def test_lengths_between_rings() -> None:
    """The distance of their centres, of boards too."""
    assert length_in(plate(), "ring 0 to ring 10") == pytest.approx(200.0)


def test_a_face_that_moved_out_makes_the_caliper_wider() -> None:
    """The distance over two faces is along their normals."""
    normal = solid().target_from_face[:, :3, 2]
    opposite = int(np.argmin(normal @ normal[0]))
    frame = np.array(solid().target_from_face)
    frame[opposite, :3, 3] += 0.3 * normal[opposite] + 0.5 * frame[opposite, :3, 0]
    moved = replace(solid(), target_from_face=frame)
    assert length_in(moved, f"face {opposite} to face 0") == pytest.approx(200 * icosahedron().inradius + 0.3)


@pytest.mark.parametrize(
    ("target", "name", "message"),
    [
        (solid(), "ring 1 to ring 1", "two different rings"),
        (solid(), "ring 1 to face 2", "none that a target has"),
        (plate(), "face-to-face", "face-to-face"),
        (plate(), "edge", "edge"),
    ],
)
def test_lengths_that_a_target_does_not_have(target: TargetGeometry, name: str, message: str) -> None:
    """They are refused with what to give instead; a board has neither opposite faces nor edges."""
    with pytest.raises(InputError, match=message):
        length_in(target, name)


def test_scale_is_the_weighted_mean() -> None:
    """Two lengths count by the squares of their relative accuracies."""
    first = CaliperLength("ring 0 to ring 10", 202.0, 0.5)
    second = CaliperLength("ring 0 to ring 88", length_in(plate(), "ring 0 to ring 88") * 1.006, 1.0)
    weight = np.array([(200 / 0.5) ** 2, (second.value_mm / 1.006 / 1.0) ** 2])
    found = scale_from(plate(), [first, second])
    assert found.value == pytest.approx(weight @ [1.01, 1.006] / weight.sum())
    assert found.sigma == pytest.approx(weight.sum() ** -0.5)
    assert np.sum(np.array([one.residual_sigma for one in found.lengths]) ** 2) > 0


def test_lengths_that_contradict_each_other_are_refused() -> None:
    """The worst one is named, with what the others make it."""
    lengths = [
        CaliperLength("ring 0 to ring 10", 200.0, 0.02),
        CaliperLength("ring 0 to ring 88", length_in(plate(), "ring 0 to ring 88"), 0.02),
        CaliperLength("ring 11 to ring 21", 200.5, 0.02),
    ]
    with pytest.raises(InputError, match=r"ring 11 to ring 21 of 200\.500 mm contradicts .* 200\.000 mm"):
        scale_from(plate(), lengths)
    scale_from(plate(), [*lengths[:2], CaliperLength("ring 11 to ring 21", 200.03, 0.02)])


def test_one_length_rescales_a_target() -> None:
    """All its numbers grow alike, and it is a measured one then."""
    large = rescaled(solid(), CaliperLength("edge", 101.0, 0.02))
    assert large.source == "measured"
    assert length_in(large, "edge") == pytest.approx(101.0)
    assert length_in(large, "face-to-face") == pytest.approx(202 * icosahedron().inradius)
    assert large.radius_outer_mm == pytest.approx(1.01 * solid().radius_outer_mm)
    assert large.center_mm == pytest.approx(1.01 * solid().center_mm)
    assert large.lattice_mm == pytest.approx(1.01 * solid().lattice_mm)
    assert large.layout_id == solid().layout_id
    assert scaled(large, 1 / 1.01).center_mm == pytest.approx(solid().center_mm)


@pytest.fixture(autouse=True)
def target(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> TargetGeometry:
    """A target to measure, in the current folder."""
    monkeypatch.chdir(tmp_path)
    Path("ico.target.json").write_text(target_to_json(solid()))
    return solid()


def answer_of(length: str, *more: str) -> Answer:
    """Rescale the target to a length."""
    return calib("measure", "ico.target.json", "--measured-length", length, "-o", "out/ico.target.json", *more)


def test_the_next_print_comes_out_as_designed(target: TargetGeometry) -> None:
    """Made with the compensation that is told, the same printer's length is the design's: (1 + c) (1 + m) = 1."""
    design_mm, made_with, printer = length_in(target, "edge"), 0.2, 0.995
    reading = design_mm * (1 + made_with / 100) * printer
    summary = summary_of(answer_of(f"edge:{reading!r}mm", f"--shrink-compensation={made_with}%", "--json"))
    percent = summary["answer"]["next_shrink_compensation_percent"]
    assert (1 + percent / 100) * printer == pytest.approx(1)
    answer = answer_of(f"edge:{reading!r}mm", f"--shrink-compensation={made_with}%")
    assert f"design ... --shrink-compensation {percent:.3f}%" in answer.out
    assert "made with 0.2%" in answer.out


def test_a_size_within_the_reading_needs_no_correction(target: TargetGeometry) -> None:
    """A deviation below what the caliper tells gives no new compensation, and keeps the one that there was."""
    length = f"edge:{length_in(target, 'edge') + 0.02}mm+-0.02mm"
    assert "The size needs no correction." in answer_of(length).out
    said = answer_of(length, "--shrink-compensation", "0.3%").out
    assert "The size needs no correction: keep --shrink-compensation 0.3%." in said


def test_the_next_step_is_a_line_to_type() -> None:
    """The next command names the file that was written, which is a target of the size that was given."""
    summary = summary_of(answer_of("edge:100.3mm", "--json"))
    assert summary["next"][0].startswith("calib run out/ico.target.json photos -o camera ")
    assert length_in(load_target(Path("out/ico.target.json")), "edge") == pytest.approx(100.3)


@pytest.mark.parametrize(("off_mm", "is_doubted"), [(0.0, True), (0.004, True), (-0.004, True), (0.006, False)])
def test_a_length_that_is_the_designs_is_doubted(target: TargetGeometry, off_mm: float, *, is_doubted: bool) -> None:
    """To 0.005 mm the design's value: that is said, for people and programs, and refuses nothing."""
    length = f"face-to-face:{length_in(target, 'face-to-face') + off_mm}mm"
    answer = answer_of(length, "--json")
    doubts = [one for one in summary_of(answer)["remarks"] if "is it a reading?" in one]
    assert (answer.code, len(doubts)) == (0, is_doubted)
    assert ("is the design's value to 0.005 mm: is it a reading?" in answer.err) == is_doubted


@pytest.mark.parametrize(
    ("made", "factor", "said"),
    [("fdm-dual", 1.005, ""), ("fdm-dual", 1.03, "check the reading"), ("sheet-print", 1.005, "check the reading"),
     ("fdm-dual", 1.19, "no print is off by more than 10 %")],
)  # fmt: skip
def test_a_length_that_no_print_has_is_not_taken_unasked(
    target: TargetGeometry, made: str, factor: float, said: str
) -> None:
    """Beyond four standard deviations of its way of making a length is asked about, beyond a tenth it is refused."""
    answer = answer_of(f"edge:{factor * length_in(target, 'edge')}mm", "--made", made)
    assert answer.code == (2 if "no print" in said else 0)
    assert ("check" in answer.out + answer.err) == bool(said)
    assert said in answer.out + answer.err


def test_a_sheet_is_corrected_in_the_printers_dialog() -> None:
    """Paper has no shrinkage compensation, slicer or bed: what is advised is the size to print at."""
    sheet = replace(board(), build="sheet")
    Path("sheet.target.json").write_text(target_to_json(sheet))
    name = "ring 0 to ring 5"
    length = f"{name}:{1.004 * length_in(sheet, name)}mm+-0.01mm"
    said = calib("measure", "sheet.target.json", "--measured-length", length, "-o", "out/sheet.target.json").out
    assert "Print it at 99.602 % of its size." in said
    assert "design ..." not in said


def test_a_place_for_a_reading_is_refused() -> None:
    """A command copied from the page as it stands certifies nothing."""
    said = refused("measure", "ico.target.json", "--measured-length", "edge:READINGmm+-0.02mm", "-o", "m.target.json")
    assert "put your reading in place of 'READINGmm'" in said
    assert not Path("m.target.json").exists()


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
