"""Pages in a real browser: Debian's Chromium without a window, and whatever it complains about."""

import shutil
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Literal
from urllib.parse import unquote, urlsplit

import pytest
from playwright.sync_api import Browser, ConsoleMessage, Page, expect, sync_playwright

from tests.support.waiting import WITHIN_S, wait_until

WIDTHS = (1280, 390)
_ARGUMENTS = ["--no-sandbox", "--use-angle=swiftshader", "--enable-unsafe-swiftshader"]  # WebGL 2 without a card
_LINKS = """() => Array.from(document.querySelectorAll("a[href]"), (a) => [a.getAttribute("href"), a.href])"""
_BROKEN_IMAGES = """async () => {
  const shown = Array.from(document.images).filter((image) => image.hasAttribute("src"));
  await Promise.allSettled(shown.map((image) => image.decode()));
  return shown.filter((image) => image.naturalWidth === 0).map((image) => `image ${image.src.slice(0, 60)}`);
}"""
_WIDE = """() => Math.max(document.documentElement.scrollWidth, document.body.scrollWidth) - window.innerWidth"""


@contextmanager
def started_browser(*arguments: str) -> Iterator[Browser]:
    """Chromium, with more arguments if told; the test is skipped where there is none."""
    program = next(
        (path for name in ("chromium", "chromium-browser", "google-chrome") if (path := shutil.which(name))), ""
    )
    if not program:
        pytest.skip("no chromium: install the Debian package chromium")
    with sync_playwright() as playwright:
        expect.set_options(timeout=1000 * WITHIN_S)
        browser = playwright.chromium.launch(executable_path=program, args=[*_ARGUMENTS, *arguments])
        try:
            yield browser
        finally:
            browser.close()


def new_page(
    browser: Browser,
    width: int = 1280,
    height: int = 800,
    *,
    scheme: Literal["light", "dark"] = "light",
    reduced_motion: bool = True,
) -> Page:
    """A page in a context of its own, which is waited for as long as for anything."""
    context = browser.new_context(
        viewport={"width": width, "height": height},
        color_scheme=scheme,
        reduced_motion="reduce" if reduced_motion else "no-preference",
    )
    context.set_default_timeout(1000 * WITHIN_S)
    return context.new_page()


@contextmanager
def open_page(
    browser: Browser,
    file: Path,
    *,
    width: int = 1280,
    height: int = 900,
    scheme: Literal["light", "dark"] = "light",
    reduced_motion: bool = True,
) -> Iterator[Page]:
    """The page of a file, which at the end must have caused no trouble.

    Trouble is: an error or warning on the console (violations of the Content-Security-Policy are such), an exception, a
    request for anything but the file itself.
    """
    page = new_page(browser, width, height, scheme=scheme, reduced_motion=reduced_motion)
    troubles: list[str] = []
    try:
        address = file.resolve().as_uri()
        page.on("console", lambda said: troubles.extend(_complaint(said)))
        page.on("pageerror", lambda error: troubles.append(str(error)))
        page.on("request", lambda request: troubles.extend(_foreign(request.url, address)))
        page.goto(address)
        yield page
        # What scripts still do is waited for.
        page.evaluate("() => new Promise((done) => requestAnimationFrame(() => requestAnimationFrame(done)))")
    finally:
        page.context.close()
    assert troubles == []


@contextmanager
def complaints(page: Page) -> Iterator[list[str]]:
    """What a page of a server complains of: errors and warnings on its console, exceptions."""
    troubles: list[str] = []
    page.on("console", lambda said: troubles.extend(_complaint(said)))
    page.on("pageerror", lambda error: troubles.append(str(error)))
    yield troubles


def wait_for(page: Page, is_so: Callable[[], bool]) -> None:
    """Wait for something that a page does; a page's policy allows no test to wait inside it."""
    wait_until(is_so, pause=lambda: page.wait_for_timeout(25))


def _complaint(said: ConsoleMessage) -> list[str]:
    """An error or warning, but for the software renderer's about its own speed."""
    is_speed = "GL Driver Message" in said.text
    return [said.text] if said.type in {"error", "warning"} and not is_speed else []


def _foreign(url: str, address: str) -> list[str]:
    """The request, if it is for anything but the page or what is inside it."""
    return [] if url.partition("#")[0] == address or url.startswith("data:") else [f"request of {url[:200]}"]


def unresolved(page: Page, file: Path) -> list[str]:
    """Links that lead nowhere or out of the page's folder, and images that show nothing."""
    folder = file.resolve().parent
    wrong: list[str] = list(page.evaluate(_BROKEN_IMAGES))
    for written, full in page.evaluate(_LINKS):
        parts = urlsplit(full)
        path = Path(unquote(parts.path, errors="surrogateescape")).resolve()
        if written.startswith("#"):
            found = page.evaluate("(name) => document.getElementById(name) !== null", unquote(parts.fragment))
        else:
            found = parts.scheme == "file" and path.is_relative_to(folder) and path.exists()
        if not found:
            wrong.append(f"link {written[:200]}")
    return wrong


def overflow_px(page: Page) -> int:
    """By how many pixels the page is wider than its window."""
    return max(0, int(page.evaluate(_WIDE)))
