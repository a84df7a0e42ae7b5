"""Pages of study folders in a real browser."""

from pathlib import Path

import pytest
from playwright.sync_api import Browser

from tests.support.browser import WIDTHS, open_page, overflow_px, unresolved
from tests.support.report_folders import RESULTS


@pytest.fixture
def page_file(kind: str, tmp_path: Path) -> Path:
    """The page of a study, in its folder."""
    RESULTS[kind]().save(tmp_path)
    return tmp_path / "index.html"


@pytest.mark.parametrize("kind", RESULTS)
def test_pages_open_without_trouble(page_file: Path, browser: Browser) -> None:
    """On a desk and on a phone: no complaint, no dead link, no picture missing, nothing beyond the window."""
    for width in WIDTHS:
        with open_page(browser, page_file, width=width) as page:
            assert unresolved(page, page_file) == []
            assert overflow_px(page) == 0
