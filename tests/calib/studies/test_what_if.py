"""What errors of other sizes would do, against the prediction of that very model and against exact calibrations."""

import time
from functools import cache

import numpy as np
import pytest

from calib.studies.tolerance.draw import bare_draw, drawn_values, with_errors
from calib.studies.tolerance.first_order import first_order
from calib.studies.tolerance.predict import control_of, linear_table
from calib.studies.tolerance.quantities import NAMES
from calib.studies.tolerance.sizes import what_if_table
from calib.studies.tolerance.what_if import WhatIf, WhatIfTable
from designer.base.errors import InputError
from designer.tolerance.error_file import error_model, parse_amount
from designer.tolerance.model import ErrorModel
from designer.tolerance.sources import SOURCES
from tests.support.tolerance_settings import ico_setting, still, tolerance_study

WAYS = ("fdm-dual", "resin", "machined")


@cache
def table() -> WhatIfTable:
    """An icosahedron that is printed in two filaments, or made in other ways."""
    ways = {name: error_model(name) for name in WAYS}
    return what_if_table(ico_setting(), ways["fdm-dual"], "fdm-dual", ways, seed=1)


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
    asked = table().ask(way, sizes)
    errors = error_model(way, [f"{name}={text}" for name, text in sizes.items()])
    assert [asked.total(name) for name in NAMES] == pytest.approx(predicted(errors).tolist(), rel=1e-6)
    alone = linear_table(ico_setting(), errors)
    for name in (one.error for one in asked.errors if one.error in errors.sources):
        cost = alone.cost.value[errors.sources.index(name)]
        assert [asked.cost(name, quantity) for quantity in NAMES] == pytest.approx(cost.tolist(), rel=1e-6, abs=1e-12)


def test_the_command_line_of_what_is_set_says_the_same() -> None:
    """`arguments` are those with which `design tolerance` assumes what was set."""
    asked = table().ask("resin", {"skew": "uniform 0.2deg", "scale": "0.12345%"})
    assert asked.arguments[:2] == ("--errors", "resin")
    errors = error_model("resin", asked.arguments[3::2])
    assert [asked.total(name) for name in NAMES] == pytest.approx(predicted(errors).tolist(), rel=1e-6)
    assert table().ask("resin", {}).arguments == ("--errors", "resin")


@pytest.mark.parametrize("text", ["0.3mm", "uniform 0.3mm", "fixed 0.05mm"])
@pytest.mark.parametrize("alone", [False, True])
def test_the_largest_size_fills_the_limit(text: str, *, alone: bool) -> None:
    """A study of the largest size that is told has the limit as its error, with the others as they are or none."""
    changes = {"face_offset": text, "scale": "fixed 0.2%", "face_shift": "fixed 0.02mm"}
    asked, limit = table().ask("fdm-dual", changes), 0.4
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
    factor = table().ask("fdm-dual", {}).together("pose", 3.0)
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
    nothing, row = {one.error: "0" for one in table().start.errors}, NAMES.index(quantity)
    unit, per = {"rad": ("rad", 1), "mm": ("mm", 1), "1": ("%", 100)}[SOURCES[error].unit]
    reach = per * table().ask("fdm-dual", nothing).reach(error, quantity)
    for factor, is_off in ((1 / 3, False), (3.0, True)):
        asked = table().ask("fdm-dual", {**nothing, error: f"{factor * reach:.9g}{unit}"})
        off = abs(asked.total(quantity) / by_draws(asked, 24)[row] - 1)
        assert (quantity in asked.beyond) == is_off
        assert (off > 0.1) if is_off else (off < 0.1), (factor, off)


def test_a_study_answers_in_less_than_a_millisecond() -> None:
    """All quantities of a changed size, on a study with its table, in far less time than a page takes to draw."""
    study = tolerance_study(linear=True)
    study.what_if(face_tilt="0.2deg")
    begin = time.thread_time()
    for number in range(100):
        assert study.what_if(face_tilt=f"{0.001 * (number + 1)}deg").totals
    assert (time.thread_time() - begin) / 100 < 3e-3


def test_a_study_starts_from_what_it_assumed() -> None:
    """Asked nothing, both targets of a study are what its tables say of the prediction."""
    study = tolerance_study(linear=True)
    asked = study.what_if()
    assert asked.totals == pytest.approx({name: study.total(name) for name in NAMES}, rel=1e-6)
    assert asked.ranking("intersection")[0] == study.ranking[0].error
    assert asked.share("face_tilt", "pose") == pytest.approx(study.cost("face_tilt", "pose").share, rel=1e-6)
    other = study.crossovers
    assert other is not None
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
        table().ask(errors, sizes)


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
