"""The sliders of a tolerance study in a real browser, held to the Python that they are the second of."""

import math
import re
import shlex
from collections.abc import Iterator, Mapping
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from playwright.sync_api import Browser, Page

from calib.studies.tolerance.quantities import MAIN, quantity_named
from calib.studies.tolerance.record import ToleranceStudy
from calib.studies.tolerance.what_if import WhatIf, WhatIfTable
from designer.page.shell import page_html
from designer.tolerance.source import format_quantity
from designer.tolerance.sources import SOURCES
from tests.support.browser import WIDTHS, open_page, overflow_px
from tests.support.tolerance_settings import told, tolerance_study, what_ifs

MADE_BY = (
    "design tolerance 'my ico.target.json' --errors fdm-dual --linear --set skew=1deg -o out --against b.target.json"
)
READ = """(side) => ({
  totals: Array.from(document.querySelectorAll(".what-if-measures tbody tr"), (row) => (
    Number(row.cells[1 + side].dataset.value))),
  beyond: Array.from(document.querySelectorAll(".what-if-measures tbody tr"), (row) => (
    row.cells[1 + side].dataset.beyond)),
  rows: Array.from(document.querySelectorAll(".what-if-side")[side].querySelectorAll("tbody tr"), (row) => ({
    error: row.querySelector("code").textContent,
    reach: Number(row.dataset.reach),
    cells: Array.from(row.cells).slice(2).map((cell) => Number(cell.dataset.value)),
  })),
  factor: Number(document.querySelectorAll(".what-if-total")[side].dataset.value),
  ranking: document.querySelector(".what-if").dataset.ranking.split("; ")[side].split(" "),
})"""


def study() -> ToleranceStudy:
    """An icosahedron that may be made in three ways, against a board."""
    return replace(tolerance_study(linear=True), what_ifs=what_ifs())


@pytest.fixture(scope="module")
def page_file(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The study's page."""
    file = tmp_path_factory.mktemp("page") / "index.html"
    file.write_bytes(page_html(told(study(), made_by=MADE_BY).page()))
    return file


@pytest.fixture
def page(page_file: Path, browser: Browser) -> Iterator[Page]:
    """The page, which must cause no trouble."""
    with open_page(browser, page_file) as opened:
        yield opened


def shown_unit(error: str) -> tuple[str, float]:
    """How the page calls an error's unit, and how many are in one of ours."""
    return {"mm": ("mm", 1.0), "rad": ("deg", math.degrees(1)), "1": ("%", 100.0), "K": ("K", 1.0)}[SOURCES[error].unit]


def choose(page: Page, side: int, way: str, sizes: Mapping[str, str]) -> None:
    """Set a way of making and sizes, as a person types them."""
    place = page.locator(".what-if-side").nth(side)
    place.locator("select").select_option(way)
    for error, text in sizes.items():
        box = place.locator("tbody tr", has=page.locator("code", has_text=re.compile(f"^{error}$"))).locator(
            "input.size"
        )
        box.fill(text)
        box.press("Tab")


def close(value: float) -> object:
    return value if math.isinf(value) else pytest.approx(value, rel=1e-6, abs=1e-12)


def check(page: Page, side: int, asked: WhatIf, by: str, limit: float) -> None:
    """All that the page shows of a side is what Python says."""
    shown = page.evaluate(READ, side)
    assert shown["totals"] == pytest.approx([asked.total(name) for name in MAIN], rel=1e-6)
    assert shown["beyond"] == ["yes" if name in asked.beyond else "no" for name in MAIN]
    for row in shown["rows"]:
        error, per = row["error"], shown_unit(row["error"])[1]
        beside, alone = (asked.largest(error, by, limit, alone=one) * per for one in (False, True))
        wanted = (asked.cost(error, by), asked.share(error, by), beside, alone)
        assert row["cells"] == [close(one) for one in wanted], error
        assert row["reach"] == close(asked.reach(error, by) * per), error
    assert shown["factor"] == close(asked.together(by, limit))
    assert shown["ranking"] == [error for error in asked.ranking(by) if asked.cost(error, by) > 0]


def random_sizes(rng: np.random.Generator, one: WhatIfTable, way: str) -> dict[str, str]:
    """Some errors with sizes from nothing to sixteen times what the way has, of all distributions."""
    sizes = {}
    for error in one.way(way).errors:
        if error.gain and rng.random() < 0.7:
            kind = ("", "uniform ", "fixed ")[rng.integers(3)]
            size = float(f"{(error.size or 1e-3) * np.exp(rng.uniform(np.log(1 / 16), np.log(16))):.6g}")
            sizes[error.error] = kind + format_quantity(size, SOURCES[error.error].unit)
    return sizes


@pytest.mark.parametrize("seed", range(4))
def test_what_is_shown_is_what_python_says(page: Page, seed: int) -> None:
    """For any way, sizes, distributions, measure and limit, on both sides, all numbers and marks are the same."""
    rng, told = np.random.default_rng(seed), study()
    assert told.crossovers is not None
    tables = (what_ifs(), told.crossovers.what_ifs)
    by = MAIN[rng.integers(len(MAIN))]
    limit = float(f"{told.what_if().total(by) * rng.uniform(0.3, 2):.4g}")
    page.get_by_label("Look at").select_option(label=quantity_named(by).title)
    page.get_by_label("wanted at most").fill(f"{limit!r}{quantity_named(by).unit}")
    page.get_by_label("wanted at most").press("Tab")
    for side, one in enumerate(tables):
        way = one.ways[rng.integers(len(one.ways))].name
        sizes = random_sizes(rng, one, way)
        choose(page, side, way, sizes)
        check(page, side, one.ask(way, sizes), by, limit)


def test_the_command_line_is_that_of_what_is_set(page: Page) -> None:
    """Its words are the study's own, without what is set anew, then ways, sizes and limits as the options take them."""
    first = shlex.split(page.locator(".what-if .command code").inner_text())
    assert first[:6] == ["design", "tolerance", "my ico.target.json", "--against", "b.target.json", "-o"]
    assert "--linear" not in first
    choose(page, 0, "resin", {"skew": "uniform 2mrad", "scale": "0.25%"})
    words = shlex.split(page.locator(".what-if .command code").inner_text())
    place = words.index("--errors")
    asked = what_ifs().ask("resin", {"skew": "uniform 2mrad", "scale": "0.25%"})
    assert tuple(words[place : words.index("--against-errors")]) == asked.arguments
    assert words[words.index("--by") :][:2] == ["--by", "intersection"]
    assert [one for one in words if "=" in one][-2:] == ["reprojection=50px", "intersection=0.01mm"]


def test_sliders_follow_keys_and_boxes(page: Page) -> None:
    """An arrow key changes box and numbers; a wrong size is told and changes nothing; a click puts all back."""
    side = page.locator(".what-if-side").first
    row = side.locator("tbody tr", has=page.locator("code", has_text=re.compile("^face_tilt$")))
    slider, box = row.get_by_role("slider"), row.get_by_role("textbox")
    before, total = box.input_value(), page.evaluate(READ, 0)["totals"]
    place = int(slider.input_value())
    slider.press("ArrowRight")
    assert float(box.input_value().removesuffix("deg")) > float(before.removesuffix("deg"))
    assert page.evaluate(READ, 0)["totals"] != total
    assert slider.get_attribute("aria-valuetext") == box.input_value()
    box.fill("a lot")
    box.press("Tab")
    assert box.get_attribute("aria-invalid") == "true"
    assert "write a size such as 0.1deg" in row.inner_text()
    side.get_by_role("button", name="Reset").click()
    assert (box.input_value(), int(slider.input_value())) == (before, place)
    assert page.evaluate(READ, 0)["totals"] == total
    slider.press("Home")
    assert box.input_value() == "0deg"


def test_what_a_way_does_not_tell_cannot_be_set(page: Page) -> None:
    """Without layers there are no steps of layers to set."""
    choose(page, 0, "machined", {})
    row = page.locator("tbody tr", has=page.locator("code", has_text="stair_steps")).first
    assert row.get_by_role("slider").is_disabled()
    assert row.get_by_role("textbox").is_disabled()


def test_it_fits_and_prints(page_file: Path, browser: Browser) -> None:
    """On a desk and on a phone nothing goes beyond the window; in print the sizes are text and there is no slider."""
    for width in WIDTHS:
        with open_page(browser, page_file, width=width, scheme="dark") as page:
            assert overflow_px(page) == 0
            page.emulate_media(media="print")
            assert not page.get_by_role("slider").first.is_visible()
            assert page.locator(".what-if-side input.size").first.is_visible()


def test_without_sliders_a_table_says_the_same(page_file: Path) -> None:
    """The page's own HTML, and Markdown, have the totals at what is assumed."""
    text = page_file.read_text(encoding="utf-8")
    assert "Predicted with errors as assumed" in text
    value = f'data-value="{study().what_if().total("intersection")!r}"'
    assert value in text
