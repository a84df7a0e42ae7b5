"""Which target to make: what is recommended can be made, and every kind takes part."""

import math
import shlex

import numpy as np
import pytest

import calib
from calib.app.choose import TargetChoice
from designer.base.errors import InputError
from designer.kinds.sizing import size_job
from designer.kinds.spec_file import parse_spec
from designer.spec.build import builds_of
from designer.spec.kind import kinds
from designer.spec.options import is_required, options_of

SMALL = {"field_rad": math.radians(60), "volume_mm": (120.0, 120.0, 60.0), "image_size": (640, 400)}


@pytest.fixture(scope="module")
def found() -> TargetChoice:
    """Without a goal."""
    return calib.choose(**SMALL)  # type: ignore[arg-type]


def test_the_command_makes_what_was_looked_at(found: TargetChoice) -> None:
    """The line is one of `design`, and its target that of the prediction, whose build it names if that is not usual."""
    _, kind, *words = shlex.split(found.shortlist[0].command)
    values = {name[2:].replace("-", "_"): text for name, text in zip(words[::2], words[1::2], strict=True)}
    job = size_job(parse_spec({"kind": kind, **values}, "")).job
    assert job.target.lay_out().geometry_id == found.geometry.geometry_id
    assert job.printing.build == found.shortlist[0].build


def test_each_kind_that_is_made_of_a_size_takes_part(found: TargetChoice) -> None:
    """With one of its builds at least; only what tells the printer, or needs more than a size, does not."""
    looked_at = {one.kind for one in (*found.shortlist, *found.others)}
    for kind in kinds():
        options, (size, *_) = options_of(kind.asked), (*kind.spec.extent, "")
        needed = {name for name in options if is_required(kind.asked, name)}
        is_length = size in options and options[size].value in ("length above 0", "size")
        is_of_a_size = not kind.spec.is_graded and is_length and needed <= {size}
        assert (kind.name in looked_at) == is_of_a_size, kind.name
    pairs = {(one.kind, one.build) for one in found.shortlist}
    assert len(pairs) == len(found.shortlist)
    assert all(build in builds_of(kind.spec.form) for kind in kinds() for name, build in pairs if name == kind.name)


def test_the_recommended_one_is_as_sure_as_any_and_the_cheapest_of_these(found: TargetChoice) -> None:
    """Within what predictions are good for; the others follow by their error."""
    first, *rest = found.shortlist
    near = [one for one in rest if one.error <= 1.25 * min(each.error for each in found.shortlist) and not one.faults]
    assert all(first.price_eur <= one.price_eur for one in near)
    assert np.all(np.diff([one.error for one in rest]) >= 0)
    assert all(one.made.image_px > one.optics.image_px for one in found.shortlist)


def test_a_goal_takes_the_cheapest_that_reaches_it_and_a_budget_what_it_pays(found: TargetChoice) -> None:
    """And says how many photos do; a budget that pays nothing is refused with the least price."""
    goal_px = 2 * sorted(one.made.image_px for one in found.shortlist)[1]
    wanted = calib.choose(**SMALL, goal_px=goal_px)  # type: ignore[arg-type]
    reach = [one for one in wanted.shortlist if one.made.image_px <= goal_px and not one.faults]
    assert wanted.is_reached
    assert wanted.shortlist[0].price_eur == min(one.price_eur for one in reach)
    assert wanted.shortlist[0].photos <= wanted.photos
    with pytest.raises(InputError, match=r"^budget_eur 0\.01EUR: a target that would do costs "):
        calib.choose(**SMALL, budget_eur=0.01)  # type: ignore[arg-type]


def test_a_volume_in_which_nothing_can_be_turned_says_which_would_do() -> None:
    """In one line."""
    tiny = {**SMALL, "volume_mm": (20.0, 20.0, 10.0)}
    with pytest.raises(InputError, match=r"^volume_mm 20x20x10mm: no target .*; volume_mm 40x40x20mm would do$"):
        calib.choose(**tiny)  # type: ignore[arg-type]
