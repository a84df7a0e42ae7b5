"""What a tolerance study says of the numbers behind it, and what errors of other sizes would do."""

import math
import re
from dataclasses import replace

import numpy as np
import pytest

import calib
from calib.core.types import LEAST_RADIUS_PX
from calib.renderer.faces import target_fits
from calib.renderer.poses import PoseGrid, grid_poses
from calib.studies.tolerance.budget import checked, largest_allowed, searched
from calib.studies.tolerance.draw import BARE, TOGETHER, bare_draw, drawn_values, run_draws, with_errors
from calib.studies.tolerance.explore import default_vary
from calib.studies.tolerance.first_order import first_order
from calib.studies.tolerance.predict import control_of, linear_table, table_of_draws
from calib.studies.tolerance.quantities import NAMES, Requirement, parse_requirements, quantity_row
from calib.studies.tolerance.seen import CAP_RAD, view_fit, views_from
from calib.studies.tolerance.sizes import Reach, what_if_table
from calib.studies.tolerance.what_if import WhatIf
from designer.app.measuring import simulated_line
from designer.base.errors import InputError
from designer.kinds.layout import advised_photos
from designer.target import TargetGeometry, bounding_radius_mm
from designer.tolerance.error_file import error_model, parse_amount
from designer.tolerance.model import ErrorModel
from designer.tolerance.sources import SOURCES
from tests.support.designs import small
from tests.support.perturbed_targets import board, ico
from tests.support.solver_scenes import CAMERAS
from tests.support.tolerance_settings import (
    DRAWS,
    few_errors,
    ico_setting,
    still,
    tolerance_study,
    tolerance_table,
    what_ifs,
)


def test_the_record_holds_the_numbers_of_the_table() -> None:
    """Every cost of every quantity to nine digits."""
    study, table = tolerance_study(), tolerance_table()
    assert len(study.costs) == len(NAMES) * (len(table.sources) + 2)
    for row, name in enumerate(NAMES):
        assert study.cost(BARE, name).cost == pytest.approx(table.baseline.value[row], rel=1e-8)
        assert study.cost(TOGETHER, name).cost == pytest.approx(table.together.value[row], rel=1e-8)
        assert study.total(name) == pytest.approx(table.total[row], rel=1e-8)
        for place, source in enumerate(table.sources):
            one = study.cost(source, name)
            assert one.cost == pytest.approx(table.cost.value[place, row], rel=1e-8)
            assert one.by_unit * one.rms == pytest.approx(one.cost, rel=1e-8)
            assert one.share == pytest.approx(table.share[place, row], rel=1e-8)
    assert {"face_tilt", "ring_jitter"} <= study.sources_of_amounts.keys()


def test_errors_are_ranked_by_their_shares() -> None:
    """The largest share first; then what matters elsewhere; what does nothing is left out."""
    study = tolerance_study()
    assert [one.error for one in study.ranking] == ["ring_jitter", "face_tilt", "scale"]
    assert study.ranked("intersection_true")[0].error == "scale"
    assert set(study.idle) == {"ink_bleed", "warp"}


def test_sweeps_come_from_draws_of_all_errors() -> None:
    """A source's points are those of draws of it alone; what does nothing has no sweep."""
    study, setting, only = tolerance_study(), ico_setting(), few_errors().only("ring_jitter")
    assert [one.error for one in study.sweeps] == ["scale", "face_tilt", "ring_jitter"]
    found = study.sweeps[2]
    linear, first = linear_table(setting, only), first_order(setting)
    for place, factor in ((0, 0.25), (4, 4.0)):
        draws = run_draws(setting, only.scaled(factor), 1, range(DRAWS))
        table = table_of_draws(only.scaled(factor), draws, control_of(first, linear, 1, range(DRAWS), factor=factor))
        assert found.rms[place] == pytest.approx(table.sigma[0])
        for name in NAMES:
            value, low, high = table.cost[0, quantity_row(name)].bounds
            costs = found.of(name)
            assert costs.cost[place] == pytest.approx(value, rel=1e-8)
            assert (costs.cost_low[place], costs.cost_high[place]) == pytest.approx((low, high), rel=1e-8)


def test_budgets_beyond_the_prediction_are_searched_with_draws() -> None:
    """A limit beyond where the square law was checked is searched again, and the answer keeps the limit by draws."""
    setting, model, required = ico_setting(), few_errors(), Requirement("intersection", 0.05)
    linear, first = linear_table(setting, model), first_order(setting)
    shy = [
        Reach(name, np.full(len(NAMES), 0.5), np.zeros(0), np.zeros((0, 0))) for name in ("face_tilt", "ring_jitter")
    ]
    budget = checked(largest_allowed(tolerance_table(), required), tolerance_table(), linear, shy)
    assert set(budget.unchecked) == {"face_tilt", "ring_jitter", TOGETHER}
    again = searched(budget, first, model, 1, DRAWS, lambda done: None)
    assert again.unchecked == ()
    assert {name for name, one in again.allowed.items() if one.by == "draws"} == set(budget.unchecked)
    factor = again.allowed["face_tilt"].factor
    tilt = model.only("face_tilt")
    drawn = run_draws(setting, tilt.scaled(factor), 1, range(DRAWS))
    control = control_of(first, linear_table(setting, tilt), 1, range(DRAWS), factor=factor)
    total = table_of_draws(tilt.scaled(factor), drawn, control).total[quantity_row("intersection")]
    assert total == pytest.approx(0.05, rel=5e-3)


def test_wrong_predictions_are_found() -> None:
    """A prediction that is 30 % off is named; one that is right is not; few draws call none wrong."""
    study = tolerance_study()
    costs = tuple(
        replace(one, predicted=1.3 * one.predicted)
        if (one.error, one.quantity) == ("ring_jitter", "reprojection")
        else one
        for one in study.costs
    )
    planted = replace(study, costs=costs)
    assert ("ring_jitter", "reprojection") in {(one.error, one.quantity) for one in planted.deviations()}
    assert ("ring_jitter", "reprojection") not in {(one.error, one.quantity) for one in study.deviations()}
    assert not list(replace(planted, draws=3).deviations())


def test_another_target_is_compared_by_an_error_of_faces() -> None:
    """The varied error is the one of faces that costs most."""
    assert default_vary(tolerance_table(), "intersection") == "face_tilt"


@pytest.mark.parametrize(
    ("texts", "message"),
    [
        (["intersection"], "write QUANTITY=LIMIT"),
        (["intersectoin=1mm"], "did you mean 'intersection'"),
        (["intersection=1px"], "unknown unit of length"),
        (["reprojection=0.1mm"], "expected pixels"),
        (["intersection=-1mm"], "must be more than 0"),
        (["intersection=nan"], "--require 'intersection=nan'"),
        (["pose=1mm", "pose=2mm"], "is given twice"),
    ],
)
def test_limits_that_break_a_rule(texts: list[str], message: str) -> None:
    """A limit without '=', of an unknown quantity, another dimension, or not above zero ends in one line."""
    with pytest.raises(InputError, match=message.replace("(", "\\(")) as error:
        parse_requirements(texts)
    assert "\n" not in str(error.value)


def test_limits_carry_units() -> None:
    """Limits are read in any unit of their dimension."""
    assert parse_requirements(["intersection=0.005cm", "rotation=0.1deg", "reprojection=0.2px"]) == (
        Requirement("intersection", 0.05), Requirement("rotation", 0.1), Requirement("reprojection", 0.2),
    )  # fmt: skip


@pytest.mark.parametrize("chosen", [ico(), board()], ids=["ico", "board"])
def test_the_distance_told_shows_all_of_the_target(chosen: TargetGeometry) -> None:
    """From the distance told on, the renderer's rule finds all views whole; a little nearer it does not."""
    camera = CAMERAS["opencv"]
    near = view_fit(chosen, camera, 1.05 * bounding_radius_mm(chosen))
    half_angle = CAP_RAD if chosen.face_count == 1 else math.pi
    for factor, fits in ((1.0, True), (0.97, False)):
        distance = factor * near.fits_from_mm
        grid = PoseGrid(60, half_angle, (distance, distance), random_roll=True, aim_offset_mm=0.0)
        poses = grid_poses(grid, np.random.default_rng(0))
        assert all(target_fits(chosen, camera, pose) for pose in poses) == fits
    assert "beyond the image" in near.remark
    far = view_fit(chosen, camera, 1.1 * near.large_to_mm)
    assert far.radius_px < LEAST_RADIUS_PX
    assert f"up to --distance {math.floor(near.large_to_mm)}mm" in far.remark
    assert view_fit(chosen, camera, math.sqrt(near.fits_from_mm * near.large_to_mm)).remark == ""


@pytest.mark.parametrize("kind", ["ico", "board"])
def test_photos_are_those_that_the_page_of_a_design_advises(kind: str) -> None:
    """A study's usual views are the poses that `calib render` takes with the options of the line on the page."""
    design = small(kind)
    line = re.sub(r"--(\S+) ([^-\s]\S*)", r"--\1=\2", simulated_line(design)).split()
    given = dict(one.removeprefix("--").split("=") for one in line if "=" in one)
    assert "--random-roll" in line
    near, far = (float(one.removesuffix("mm")) for one in given["distance"].split(".."))
    job = calib.render(
        design.target, views=7, distance_mm=(near, far), aim_offset_mm=float(given["aim-offset"].removesuffix("mm")),
        cap_rad=math.radians(float(given["cap-angle"].removesuffix("deg"))) if "cap-angle" in given else None,
        random_roll=True, seed=1,
    ).job  # fmt: skip
    photos = advised_photos(design.target)
    np.testing.assert_array_equal(views_from(design.target, job.camera, photos, 7, 1), job.cam_from_target)
    study = calib.tolerance(design.target, "fdm-dual" if kind == "ico" else "fdm-board", views=7, linear=True).study
    assert f"from {near:g}mm..{far:g}mm, looking up to {photos.aim_offset_mm:g}mm past" in study.setting.photos
    assert "as its design's page advises" in study.setting.photos


def predicted(errors: ErrorModel) -> np.ndarray:
    """All quantities by a prediction of nothing but these errors."""
    return np.asarray(linear_table(ico_setting(), errors).total)


@pytest.mark.parametrize(
    ("way", "sizes"),
    [
        ("fdm-dual", {}),
        ("resin", {}),
        ("machined", {"thermal": "9K"}),
        ("fdm-dual", {"skew": "0.02deg", "face_tilt": "uniform 0.3deg", "stair_steps": "80%"}),
        ("fdm-dual", {"scale": "fixed -0.5%", "axis_scale": "fixed 0.2%", "face_offset": "fixed 0.1mm"}),
    ],
)
def test_any_sizes_are_those_of_a_study_of_them(way: str, sizes: dict[str, str]) -> None:
    """Whatever is set, drawn or known, in any way of making, is what a study with `--errors` and `--set` predicts."""
    asked = what_ifs().ask(way, sizes)
    errors = error_model(way, [f"{name}={text}" for name, text in sizes.items()])
    assert [asked.total(name) for name in NAMES] == pytest.approx(predicted(errors).tolist(), rel=1e-6)
    alone = linear_table(ico_setting(), errors)
    for name in (one.error for one in asked.errors if one.error in errors.sources):
        cost = alone.cost.value[errors.sources.index(name)]
        assert [asked.cost(name, quantity) for quantity in NAMES] == pytest.approx(cost.tolist(), rel=1e-6, abs=1e-12)


def test_the_command_line_of_what_is_set_says_the_same() -> None:
    """`arguments` are those with which `design tolerance` assumes what was set."""
    asked = what_ifs().ask("resin", {"skew": "uniform 0.2deg", "scale": "0.12345%"})
    assert asked.arguments[:2] == ("--errors", "resin")
    errors = error_model("resin", asked.arguments[3::2])
    assert [asked.total(name) for name in NAMES] == pytest.approx(predicted(errors).tolist(), rel=1e-6)
    assert what_ifs().ask("resin", {}).arguments == ("--errors", "resin")


@pytest.mark.parametrize("text", ["0.3mm", "uniform 0.3mm", "fixed 0.05mm"])
@pytest.mark.parametrize("alone", [False, True])
def test_the_largest_size_fills_the_limit(text: str, *, alone: bool) -> None:
    """A study of the largest size that is told has the limit as its error, with the others as they are or none."""
    changes = {"face_offset": text, "scale": "fixed 0.2%", "face_shift": "fixed 0.02mm"}
    asked, limit = what_ifs().ask("fdm-dual", changes), 0.4
    size = asked.largest("face_offset", "intersection", limit, alone=alone)
    errors = error_model("fdm-dual", [f"{name}={value}" for name, value in changes.items()])
    amount = parse_amount(text, SOURCES["face_offset"])
    errors = (errors.only("face_offset") if alone else errors).with_amount(
        "face_offset", amount.scaled(size / amount.size)
    )
    assert predicted(errors)[NAMES.index("intersection")] == pytest.approx(limit, rel=1e-6)
    assert asked.largest("face_offset", "intersection", 1e-6) == 0
    assert asked.largest("scale", "rotation", 10, alone=True) > 1


def test_all_together_fill_the_limit() -> None:
    """All sizes times the factor that is told have the limit as their error."""
    factor = what_ifs().ask("fdm-dual", {}).together("pose", 3.0)
    assert predicted(error_model("fdm-dual").scaled(factor))[NAMES.index("pose")] == pytest.approx(3.0, rel=1e-6)


def by_draws(asked: WhatIf, draws: int) -> np.ndarray:
    """All quantities by exact calibrations without noise, held against what is predicted of the same numbers."""
    setting, errors = ico_setting(), error_model(asked.way)
    for one in asked.errors:
        errors = errors.with_amount(one.error, one.amount)
    bare, linear = bare_draw(setting, still(setting)), linear_table(setting, errors)
    exact = [with_errors(setting, errors, drawn_values(setting, errors, 99, number), bare) for number in range(draws)]
    control = control_of(first_order(setting), linear, 99, range(draws), has_noise=False)
    missed = (np.square(exact) - control.square[:, -1]).mean(axis=0)
    return np.asarray(np.sqrt(linear.total**2 + missed))


@pytest.mark.parametrize(
    ("error", "quantity"),
    [
        ("skew", "principal_point"),
        ("axis_scale", "principal_point"),
        ("face_shift", "principal_point"),
        ("face_offset", "pose"),
    ],
)
def test_what_is_beyond_reach_is_off_and_the_rest_is_not(error: str, quantity: str) -> None:
    """A third of the size at which an error is told to put a quantity beyond reach is within 10 %; thrice it is not."""
    nothing, row = {one.error: "0" for one in what_ifs().start.errors}, NAMES.index(quantity)
    unit, per = {"rad": ("rad", 1), "mm": ("mm", 1), "1": ("%", 100)}[SOURCES[error].unit]
    reach = per * what_ifs().ask("fdm-dual", nothing).reach(error, quantity)
    for factor, is_off in ((1 / 3, False), (3.0, True)):
        asked = what_ifs().ask("fdm-dual", {**nothing, error: f"{factor * reach:.9g}{unit}"})
        off = abs(asked.total(quantity) / by_draws(asked, 24)[row] - 1)
        assert (quantity in asked.beyond) == is_off
        assert (off > 0.1) if is_off else (off < 0.1), (factor, off)


def test_a_study_starts_from_what_it_assumed() -> None:
    """Asked nothing, both targets of a study are what its tables say of the prediction."""
    study = tolerance_study(linear=True)
    asked = study.what_if()
    assert asked.totals == pytest.approx({name: study.total(name) for name in NAMES}, rel=1e-6)
    assert asked.ranking("intersection")[0] == study.ranking[0].error
    assert asked.share("face_tilt", "pose") == pytest.approx(study.cost("face_tilt", "pose").share, rel=1e-6)
    other = study.crossovers
    totals = other.what_ifs.ask(None, {}).totals
    assert totals == pytest.approx(dict(other.totals), rel=1e-6)


@pytest.mark.parametrize(
    ("errors", "sizes", "told"),
    [
        (None, {"skw": "1deg"}, "unknown error source 'skw'; did you mean 'skew'"),
        (None, {"skew": "1mm"}, "skew '1mm': "),
        ("rezin", {}, "unknown way of making 'rezin'; did you mean 'resin'"),
        ("machined", {"stair_steps": "10%"}, "stair_steps '10%': needs the layer_height, which machined does not tell"),
    ],
)
def test_what_cannot_be_asked_is_told(errors: str | None, sizes: dict[str, str], told: str) -> None:
    """A wrong name, size or way is refused by value and rule."""
    with pytest.raises(InputError, match=told):
        what_ifs().ask(errors, sizes)


def test_numbers_that_recur_are_calibrated_once(monkeypatch: pytest.MonkeyPatch) -> None:
    """No numbers of an error are calibrated twice; one that is a single number has one size drawn, and one known."""
    calibrated: list[tuple[str, bytes]] = []

    def counted(_setting: object, _errors: object, values: dict[str, np.ndarray], _bare: object) -> np.ndarray:
        calibrated.extend((name, numbers.tobytes()) for name, numbers in values.items())
        return np.ones(len(NAMES))

    monkeypatch.setattr("calib.studies.tolerance.sizes.with_errors", counted)
    what_if_table(ico_setting(), error_model("fdm-dual"), "fdm-dual", {}, seed=1)
    assert len(calibrated) == len(set(calibrated))
    assert [name for name, _ in calibrated].count("scale") == 2 * 2
