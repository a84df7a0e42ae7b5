"""Ways of making side by side: what is ranked, against predictions of each way alone, and what is said of it."""

import math
from functools import cache

import pytest

import calib
from calib.app.ways import Ways
from calib.draw.tolerance_tables import WAYS, ways_table
from calib.studies.tolerance.quantities import NAMES
from designer.base.errors import InputError
from designer.kinds.presets import preset_names
from designer.tolerance.effort import size_of
from designer.tolerance.error_file import error_model
from tests.support.perturbed_targets import board, ico
from tests.support.tolerance_settings import told

BY = "distortion_map"
TARGETS = {"ico": ico, "board": board}
VIEWS, DISTANCE_MM = 8, 260.0


@cache
def ranked(target: str) -> Ways:
    """All ways of a small target."""
    return calib.ways(TARGETS[target](), views=VIEWS, distance_mm=DISTANCE_MM, aim_offset_mm=0.0)


@pytest.mark.parametrize("target", TARGETS)
def test_what_suits_is_ranked_and_nothing_else(target: str) -> None:
    """Each template that suits the target stands there once, the best first."""
    ways = ranked(target).study.ways()
    suiting = {name for name in preset_names("errors") if error_model(name).suits_target(TARGETS[target]())}
    assert {one.way.name for one in ways} == suiting
    assert len(ways) == len(suiting)
    totals = [one.total() for one in ways]
    assert totals == sorted(totals)
    assert all(one.ranked_by == BY for one in ways)
    assert all(math.isfinite(one.way.price_eur) and math.isfinite(one.way.hours) for one in ways)


@pytest.mark.parametrize(("target", "way"), [("ico", "sls"), ("ico", "waterslide"), ("board", "pcb")])
def test_a_way_is_what_a_study_of_it_alone_predicts(target: str, way: str) -> None:
    """The errors, and the one that costs most, are those of `tolerance(..., linear=True)` with that template."""
    one = next(one for one in ranked(target).study.ways() if one.way.name == way)
    alone = calib.tolerance(
        TARGETS[target](), way, views=VIEWS, distance_mm=DISTANCE_MM, aim_offset_mm=0.0, linear=True, by=BY
    ).study
    assert [one.total(name) for name in NAMES] == pytest.approx([alone.total(name) for name in NAMES], rel=1e-6)
    assert one.worst == alone.ranking[0].error


@pytest.mark.parametrize("target", TARGETS)
def test_price_and_hours_are_those_of_the_template(target: str) -> None:
    """Of this target's size."""
    size = size_of(TARGETS[target]())
    for one in ranked(target).study.ways():
        model = error_model(one.way.name)
        assert model.price is not None
        assert model.hours is not None
        assert one.way.price_eur == pytest.approx(model.price.of(size))
        assert one.way.hours == pytest.approx(model.hours.of(size))


@pytest.mark.parametrize("target", TARGETS)
def test_what_is_named_is_beaten_by_nothing(target: str) -> None:
    """The headline names the ways that no other beats in error and price, and all others are beaten by one of them."""
    study, headline = ranked(target).study, ranked(target).page().headline
    assert headline is not None
    said = headline.sentence.partition("Better ones cost more: ")[2]
    ways = study.ways(BY)
    named = [one for one in ways if f"{one.way.name} (" in said]
    assert ways[0] in named
    for one in ways:
        better = [other for other in ways if other.total() < one.total() and other.way.price_eur <= one.way.price_eur]
        assert bool(better) == (one not in named)
        assert not better or set(better) & set(named)


def test_the_table_has_a_row_a_way_and_marks_what_is_beyond() -> None:
    """Numbers that the prediction may miss by a tenth begin with ~; ranked by another quantity, that leads."""
    study = ranked("ico").study
    table = ways_table(study, "pose")
    assert table.columns[2].title == "camera's centre [mm]"
    for row, one in zip(table.rows, study.ways("pose"), strict=True):
        assert row[0].text == one.way.name
        assert row[2].text.startswith("~") == ("pose" in one.asked.beyond)
        assert row[2].value == one.total("pose")
    assert any(row[2].text.startswith("~") for row in table.rows)
    assert not all(row[2].text.startswith("~") for row in table.rows)


def test_the_page_of_a_study_has_the_ways() -> None:
    """Every study of errors tells them; `design ways` before all else."""
    found = ranked("board")
    titles = [section.title for section in told(found.study).page().sections]
    assert titles.count(WAYS) == 1
    shown = [section.title for section in found.page().sections]
    assert (shown[0], set(shown) - set(titles)) == (WAYS, set())


def test_an_unknown_quantity_is_refused() -> None:
    """With those that there are."""
    with pytest.raises(InputError, match="unknown quantity 'beauty'"):
        calib.ways(board(), by="beauty")
