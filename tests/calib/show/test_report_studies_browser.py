"""Pages of study folders in a real browser."""

import re
from functools import cache
from pathlib import Path
from tempfile import TemporaryDirectory

import pytest
from playwright.sync_api import Browser

from designer.page.shell import page_html
from tests.support.browser import WIDTHS, open_page, overflow_px, unresolved
from tests.support.report_folders import FOLDERS, page_of, written


@cache
def page_bytes(kind: str) -> bytes:
    """The page of a folder with its figures, drawn once."""
    with TemporaryDirectory() as place:
        return page_html(page_of(kind, written(FOLDERS[kind](), Path(place, "study"))))


SHARE = re.compile("^share")
"""Heads of the columns that errors are ranked by, whatever they are of."""


@pytest.fixture
def page_file(kind: str, tmp_path: Path) -> Path:
    """The page of a folder, in it."""
    place = written(FOLDERS[kind](), tmp_path) / "index.html"
    place.write_bytes(page_bytes(kind))
    return place


@pytest.mark.parametrize("kind", FOLDERS)
def test_pages_open_without_trouble(page_file: Path, browser: Browser) -> None:
    """On a desk and on a phone: no complaint, no dead link, no picture missing, nothing beyond the window."""
    for width in WIDTHS:
        with open_page(browser, page_file, width=width) as page:
            assert unresolved(page, page_file) == []
            assert overflow_px(page) == 0


@pytest.mark.parametrize("kind", ["tolerance"])
def test_errors_sort_by_what_they_cost(page_file: Path, browser: Browser) -> None:
    """A click on a head of the table of costs puts the largest share last or first, whatever its text."""
    with open_page(browser, page_file) as page:
        table = page.locator("table", has=page.get_by_role("columnheader", name=SHARE)).first
        shares = []
        for _ in range(2):
            table.get_by_role("columnheader", name=SHARE).first.get_by_role("button").click()
            cells = table.locator("tbody tr td:nth-child(3)").all_inner_texts()
            known = [0.0 if "<" in cell else float(cell.removesuffix(" %")) for cell in cells if "%" in cell]
            shares.append(known)
        assert sorted(shares[0]) in (shares[0], shares[0][::-1])
        assert shares[1] == shares[0][::-1]
        assert len(set(shares[0])) > 1
