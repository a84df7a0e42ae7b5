"""Fixtures of more than one module."""

from collections.abc import Iterator
from typing import TYPE_CHECKING

import pytest

if TYPE_CHECKING:
    from playwright.sync_api import Browser


@pytest.fixture(scope="module")
def browser() -> Iterator["Browser"]:
    """Chromium, started once for a module's tests; skipped where there is none."""
    from tests.browser import started_browser

    with started_browser() as started:
        yield started
