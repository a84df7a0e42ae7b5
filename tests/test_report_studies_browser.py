"""Pages of study folders in a real browser."""

from collections.abc import Iterator
from pathlib import Path

import pytest
from playwright.sync_api import Browser

from designer.page.shell import page_html
from tests.browser import WIDTHS, open_page, overflow_px, started_browser, unresolved
from tests.report_folders import FOLDERS, page_of, written


@pytest.fixture(scope="module")
def browser() -> Iterator[Browser]:
    """One browser for all pages."""
    with started_browser() as started:
        yield started


@pytest.mark.parametrize("kind", FOLDERS)
def test_pages_open_without_trouble(kind: str, browser: Browser, tmp_path: Path) -> None:
    """On a desk and on a phone: no complaint, no dead link, no picture missing, nothing beyond the window."""
    folder = written(FOLDERS[kind](), tmp_path)
    place = folder / "index.html"
    place.write_bytes(page_html(page_of(kind, folder)))
    for width in WIDTHS:
        with open_page(browser, place, width=width) as page:
            assert unresolved(page, place) == []
            assert overflow_px(page) == 0


def test_errors_sort_by_what_they_cost(browser: Browser, tmp_path: Path) -> None:
    """A click on a head of the table of costs puts the largest share last or first, whatever its text."""
    folder = written(FOLDERS["tolerance"](), tmp_path)
    place = folder / "index.html"
    place.write_bytes(page_html(page_of("tolerance", folder)))
    with open_page(browser, place) as page:
        table = page.locator("table", has=page.get_by_role("columnheader", name="share of intersection"))
        shares = []
        for _ in range(2):
            table.get_by_role("columnheader", name="share of intersection").get_by_role("button").click()
            cells = table.locator("tbody tr td:nth-child(3)").all_inner_texts()
            known = [0.0 if "<" in cell else float(cell.removesuffix(" %")) for cell in cells if "%" in cell]
            shares.append(known)
        assert sorted(shares[0]) in (shares[0], shares[0][::-1])
        assert shares[1] == shares[0][::-1]
        assert len(set(shares[0])) > 1
