"""Pages of study folders in a real browser."""

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
