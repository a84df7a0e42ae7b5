"""The report of a tolerance study: what its tables, files and figures say of the numbers behind them."""

import csv
import io
import json
import math
import re
from collections.abc import Mapping
from dataclasses import replace
from functools import cache
from pathlib import Path

import numpy as np
import pytest
from numpy.typing import NDArray
from PIL import Image

from calib.core.types import LEAST_RADIUS_PX
from calib.renderer.faces import target_fits
from calib.renderer.poses import PoseGrid, grid_poses
from calib.studies.table_files import rows_to_csv
from calib.studies.tolerance.budget import Allowed
from calib.studies.tolerance.control import control_of
from calib.studies.tolerance.draw import TOGETHER, run_draws
from calib.studies.tolerance.explore import budgets_of, reaches, searched
from calib.studies.tolerance.files import number, report_files, tolerance_file
from calib.studies.tolerance.first_order import first_order
from calib.studies.tolerance.linear import linear_table
from calib.studies.tolerance.notes import budget_notes, crossover_notes, notes
from calib.studies.tolerance.quantities import NAMES, quantity_row
from calib.studies.tolerance.report import (
    MAIN,
    Against,
    Requirement,
    ToleranceReport,
    all_crossovers,
    default_vary,
    deviations,
    sweeps_from,
    with_drawn,
)
from calib.studies.tolerance.requirement import parse_requirements
from calib.studies.tolerance.result import Cost, table_of_draws
from calib.studies.tolerance.setting import CAP_RAD
from calib.studies.tolerance.sweep import FACTORS, sweep
from calib.studies.tolerance.table_file import TOLERANCE_TABLE, CostRow
from calib.studies.tolerance.tables import budget_table, cost_cell, cost_table, crossover_table, size_in_words
from calib.studies.tolerance.view_fit import view_fit
from designer.base.errors import InputError
from designer.target import TargetGeometry, bounding_radius_mm
from designer.tolerance.error_file import error_model, parse_amount
from designer.tolerance.model import ErrorModel
from designer.tolerance.registry import SOURCES
from designer.tolerance.source import Amount
from tests.support.perturbed_targets import board, ico
from tests.support.solver_scenes import CAMERAS
from tests.support.tolerance_settings import board_setting, ico_setting

Array = NDArray[np.float64]
DRAWS = 12


@cache
def model() -> ErrorModel:
    """Five kinds of sources: of faces, of rings, of the print, one that does nothing, and one for boards."""
    few = error_model("fdm-dual").only("face_tilt", "ring_jitter", "scale", "ink_bleed")
    return few.with_amount("warp", Amount("uniform", 0.2))


@cache
def draws() -> Mapping[float, Array]:
    return {factor: run_draws(ico_setting(), model().scaled(factor), 1, range(DRAWS)) for factor in FACTORS}


@cache
def report() -> ToleranceReport:
    """An icosahedron, by draws, with two limits and against a board."""
    setting = ico_setting()
    linear, table = linear_table(setting, model()), table_of_draws(model(), draws()[1.0])
    found = ToleranceReport(
        "ico", ("an icosahedron",), 20, table, linear, "intersection", sweeps_from(table, linear, draws())
    )
    found = replace(
        found,
        reaches=reaches(first_order(setting), model(), found.ranking, linear.baseline.value, 1, lambda done: None),
    )
    limits = (Requirement("intersection", 0.01), Requirement("reprojection", 1e-4))
    found = replace(found, budgets=budgets_of(found, limits))
    other = linear_table(board_setting(), error_model("fdm-board"))
    return replace(found, against=Against("board", other, ("a board",), "face_tilt", all_crossovers(table, other)))


@pytest.mark.parametrize(
    ("value", "low", "high", "text"),
    [
        (0.0, 0.0, 0.0, "0"),
        (0.004, 0.0039, 0.0041, "< 0.010"),  # a tenth of the noise bounds what is far below it
        (0.0, 0.0, 0.03, "< 0.030"),  # draws that do not tell it from the noise bound it by their interval
        (0.5, 0.4804, 0.5196, "0.500\n± 0.010"),
        (0.5, 0.5, 0.5, "0.500"),
        (math.nan, math.nan, math.nan, "no solution"),
    ],
)
def test_costs_are_told_as_far_as_they_are_known(value: float, low: float, high: float, text: str) -> None:
    """A cost has its standard error; far below the noise, or not told from it, there is a bound and no tiny number."""
    cost = Cost(*(np.array([bound]) for bound in (value, low, high)))
    assert cost_cell(cost, (0,), noise=0.1) == text


def test_the_table_has_a_row_for_each_error_that_matters() -> None:
    """Errors in the order of their shares, all together, noise alone; what does nothing is told with the reason."""
    rows = cost_table(report()).body
    names = [row[0].split("\n")[-1].split(" ")[0] for row in rows]
    share = report().table.share[:, quantity_row("intersection")]
    by_share = [name for name in report().table.ranking("intersection") if name in ("face_tilt", "ring_jitter")]
    assert names[:2] == by_share
    assert names[2:] == ["scale", "all", "no"]
    assert rows[0][1] == f"{100 * share.max():.1f} %"
    assert rows[-1][2 + MAIN.index("pose")] == f"{report().table.baseline.value[quantity_row('pose')]:.3g}"
    lines = "\n".join(notes(report()))
    assert "ink_bleed: does nothing to this target: it changes the rings' diameters" in lines
    assert "warp: does nothing to this target: it is for boards" in lines


@pytest.mark.parametrize("name", ["face_tilt", "ring_jitter", "scale", "warp", "thermal", "stair_steps"])
def test_sizes_are_read_back_as_they_were_shown(name: str) -> None:
    """A size in a table, typed in as it stands there, is that size to three digits."""
    errors = error_model("fdm-dual").with_amount("warp", Amount("uniform", 0.2))
    text = size_in_words(errors, name, 0.12345)
    assert parse_amount(text, SOURCES[name]).size == pytest.approx(0.12345 * errors.amount(name).size, rel=6e-3)
    assert len(re.sub("[^0-9]", "", text).lstrip("0")) <= 3


def test_sweeps_come_from_draws_of_all_errors() -> None:
    """A source's points are those of a sweep of it alone, bit for bit; what does nothing has no sweep."""
    assert [one.source for one in report().sweeps] == ["scale", "face_tilt", "ring_jitter"]
    own = sweep(ico_setting(), model(), "ring_jitter", report().linear, seed=1, numbers=range(DRAWS))
    found = report().sweeps[2]
    for name in ("value", "low", "high"):
        np.testing.assert_array_equal(getattr(found.cost, name), getattr(own.cost, name))
    np.testing.assert_array_equal(found.amount, own.amount)


def test_budget_table_keeps_the_limit() -> None:
    """The stated size of one error, put into the prediction, just meets the limit; the scale never matters to it."""
    checked = report().budgets[0]
    rows = {row[0]: row for row in budget_table(report(), checked).body}
    text = rows["tilt of faces (face_tilt)"][2]
    errors = model().only("face_tilt").with_amount("face_tilt", parse_amount(text, SOURCES["face_tilt"]))
    predicted = linear_table(ico_setting(), errors)
    assert predicted.total[quantity_row("intersection")] == pytest.approx(0.01, rel=0.15)
    assert rows["scale of the print (scale)"][2] == "does not matter"
    assert "not met" in budget_notes(report(), checked)[0]


def test_a_limit_below_the_noise_is_told() -> None:
    """Where noise alone is more than the limit, no print is said to be good enough."""
    checked = report().budgets[1]
    assert not checked.budget.is_met_without
    assert "noise alone gives" in budget_notes(report(), checked)[0]


def test_budgets_beyond_the_prediction_are_searched_with_draws() -> None:
    """A limit beyond where the square law was checked is searched again, and the answer keeps the limit by draws."""
    held = tuple(replace(one, factor=np.full(len(NAMES), 0.5)) for one in report().reaches)
    shy = replace(report(), reaches=held)
    (checked,) = budgets_of(shy, (Requirement("intersection", 0.05),))
    assert {"face_tilt", "ring_jitter", TOGETHER} == set(checked.beyond)
    found = dict(searched(first_order(ico_setting()), checked, model(), 1, DRAWS, lambda done: None))
    again = with_drawn(checked, tuple(found.items()))
    assert set(again.by_draws) == set(checked.beyond)
    assert again.beyond == ()
    factor = found["face_tilt"].factor
    tilt = model().only("face_tilt")
    drawn = run_draws(ico_setting(), tilt.scaled(factor), 1, range(DRAWS))
    linear = linear_table(ico_setting(), tilt)
    control = control_of(first_order(ico_setting()), linear, 1, range(DRAWS), factor=factor)
    total = table_of_draws(tilt.scaled(factor), drawn, control).total[quantity_row("intersection")]
    assert total == pytest.approx(0.05, rel=5e-3)
    assert with_drawn(checked, [(TOGETHER, Allowed(2.0, 1.0, 3.0))]).budget.together.factor == 2.0


def test_wrong_predictions_are_told() -> None:
    """A prediction that is 30 % off is named; one that is right is not."""
    row = quantity_row("reprojection")
    place = model().sources.index("ring_jitter")
    wrong = report().linear.cost.value.copy()
    wrong[place, row] *= 1.3
    planted = replace(report(), linear=replace(report().linear, cost=Cost(wrong, wrong, wrong)))
    told = [(one.source, one.quantity) for one in deviations(planted)]
    assert ("ring_jitter", "reprojection") in told
    assert ("ring_jitter", "reprojection") not in [(one.source, one.quantity) for one in deviations(report())]
    assert any(line.startswith("prediction off: ring_jitter, reprojection error") for line in notes(planted))


def test_few_draws_say_nothing_of_a_prediction() -> None:
    """Draws whose spread is not known do not call a prediction wrong, nor right."""
    few = replace(report(), table=replace(report().table, draws=3))
    assert deviations(few) == ()
    assert "3 draws are too few to check the prediction with; 10 do" in notes(few)


def test_crossover_in_words_agrees_with_the_table() -> None:
    """A line for each main quantity; it loses now exactly where its error is the larger one."""
    against = report().against
    assert against is not None
    assert default_vary(report().table, "intersection") == "face_tilt"
    lines = crossover_notes(report(), against)
    assert len(lines) == len(MAIN)
    for name, line in zip(MAIN, lines, strict=True):
        row = quantity_row(name)
        alone = [math.hypot(*report().table.cost.value[:, row]), report().table.baseline.value[row]]
        loses = math.hypot(*alone) > against.table.total[row]
        assert loses == ("loses already" in line or "; loses at 0.1deg" in line), line
    cells = {row[0].split("\n")[0]: row for row in crossover_table(report(), against).body}
    assert cells["face_tilt"][1 + MAIN.index("pose")] in lines[MAIN.index("pose")] + " 0"


def test_files_hold_the_numbers_of_the_tables() -> None:
    """CSV and JSON have every cost of every quantity to nine digits; a sensitivity times the size is the cost."""
    lines = list(csv.DictReader(io.StringIO(rows_to_csv(CostRow, tolerance_file(report()).costs).decode())))
    assert len(lines) == len(NAMES) * (len(model().sources) + 2)
    table = report().table
    for line in lines:
        row = quantity_row(line["quantity"])
        if line["error"] in model().sources:
            cost = table.cost.value[model().sources.index(line["error"]), row]
            assert float(line["by_unit"]) * float(line["rms"]) == pytest.approx(cost, rel=1e-8)
        else:
            cost = (table.baseline if line["error"] == "none" else table.together).value[row]
        assert float(line["cost"]) == pytest.approx(cost, rel=1e-8)
    document = json.loads(TOLERANCE_TABLE.text(tolerance_file(report())))
    assert len(document["costs"]) == len(lines)
    assert [one["error"] for one in document["sweeps"]] == ["scale", "face_tilt", "ring_jitter"]
    assert document["budgets"][0]["together"]["factor"] == number(report().budgets[0].budget.together.factor)
    assert len(document["crossovers"]["found"]) == len(NAMES) * len(model().sources)
    assert {"face_tilt", "ring_jitter"} <= document["sources_of_amounts"].keys()


def test_figures_are_readable_pictures(tmp_path: Path) -> None:
    """All figures of a study are drawn as PNG, 1600 pixels wide and not empty; in other formats, those asked for."""
    predicted = replace(report(), table=report().linear, sweeps=(), reaches=(), against=None, budgets=())
    files = report_files(predicted, tmp_path, ("pdf", "svg"))
    assert {path.name for path in files if path.parent != tmp_path} == {"ranking.png", "ranking.pdf", "ranking.svg"}
    drawn = report_files(replace(report(), budgets=report().budgets[:1]), tmp_path)
    names = {"ranking", "budget", "crossover", "sweep_intersection"}
    assert {path.name for path in drawn if path.parent != tmp_path} == {f"{name}.png" for name in names}
    for path, content in drawn.items():
        if path.suffix == ".png":
            with Image.open(io.BytesIO(content)) as picture:
                assert picture.size[0] == 1600
                assert np.asarray(picture.convert("L")).std() > 10


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
