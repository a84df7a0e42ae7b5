"""What the live page shows and says back, in a real browser: words, ghost, keys, photos, the end."""

import io
import re
from collections.abc import Iterator
from dataclasses import replace
from typing import Literal

import cv2
import numpy as np
import pytest
from PIL import Image
from playwright.sync_api import Page

from calib.capture.messages import FrameHeader, GuidanceMessage, LookMessage, NoticeMessage, TakenMessage
from calib.judge.guidance import FrameNote
from tests.support import live_messages as told
from tests.support.browser import complaints, new_page, overflow_px, started_browser, wait_for
from tests.support.live_server import ScriptedServer, scripted_server

HOSTILE = "<img src=x onerror=alert(1)></script><script>alert(2)</script>"

CUT = """() => {
  const big = document.getElementById("big");
  const range = new Range();
  range.selectNodeContents(big);
  const lines = new Set(Array.from(range.getClientRects(), (box) => Math.round(box.top))).size;
  return lines * 1.14 * parseFloat(getComputedStyle(big).fontSize) - big.clientHeight;
}"""
Shown = tuple[ScriptedServer, Page]


@pytest.fixture(scope="module")
def opened() -> Iterator[tuple[ScriptedServer, Page, list[str]]]:
    """One page for all tests, and what it complains of."""
    with started_browser() as browser, scripted_server(told.state("camera"), told.guidance()) as server:
        page = new_page(browser)
        with complaints(page) as troubles:
            yield server, page, troubles


@pytest.fixture
def shown(opened: tuple[ScriptedServer, Page, list[str]]) -> Iterator[Shown]:
    """A page that a camera at the server's side guides, after four photos."""
    server, page, troubles = opened
    page.set_viewport_size({"width": 1280, "height": 800})
    if not server.sockets or page.evaluate("() => document.body.dataset.phase !== 'taking'"):
        page.goto(server.address)
    page.locator("#photos li").nth(3).wait_for()
    server.say(told.state("camera"), told.guidance(), told.nothing_seen())
    server.commands.clear()
    jpeg = cv2.imencode(".jpg", np.full((720, 1280, 3), 90, np.uint8))[1].tobytes()
    server.show(FrameHeader(0, 0, 0.0, 1280, 720), jpeg)
    yield server, page
    assert troubles == []


def drawn(page: Page, *, is_ghost: bool) -> tuple[int, float]:
    """How many pixels have the ghost's yellow, or the match's green, and how far right they are, of the picture."""
    page.evaluate("() => new Promise((done) => requestAnimationFrame(() => requestAnimationFrame(done)))")
    image = np.asarray(Image.open(io.BytesIO(page.locator(".overlay").screenshot())).convert("RGB")).astype(int)
    red, green, blue = image[..., 0], image[..., 1], image[..., 2]
    found = (red > 200) & (green > 150) & (blue < 120) if is_ghost else (red < 120) & (green > 180) & (blue > 120)
    return int(found.sum()), float(np.flatnonzero(found.any(axis=0)).mean() / found.shape[1]) if found.any() else 0.0


def is_green(server: ScriptedServer, page: Page) -> bool:
    """Whether the ghost of a target that is there is drawn in the match's colour alone."""
    server.say(told.look(2, worth=1.0, still=0.5))
    return drawn(page, is_ghost=False)[0] > 500 and drawn(page, is_ghost=True)[0] == 0


def big(page: Page, words: str) -> None:
    """Wait until these are the large words."""
    page.wait_for_function("(words) => document.getElementById('big').textContent === words", arg=words)


def sees(server: ScriptedServer, page: Page, look: LookMessage, words: str) -> None:
    """Tell the page of a look, again and again as it soon forgets it, until these are the large words."""

    def is_said() -> bool:
        server.say(look)
        return page.locator("#big").inner_text() == words

    wait_for(page, is_said)


def test_words_and_ghost_follow_the_target(shown: Shown) -> None:
    """Unseen: where to hold it; seen: how to come there; there: to hold still, and the ghost is another colour."""
    server, page = shown
    big(page, "Bottom left, right side back, 0.45 m")
    wait_for(page, lambda: 0 < drawn(page, is_ghost=True)[1] < 0.45)
    assert drawn(page, is_ghost=True)[0] > 500
    sees(server, page, told.look(1, told.pose(-20, 10, 500, 10)), "Closer, and tilt the right side away")
    assert "0.50 m → 0.43 m" in page.locator("#small").inner_text()
    assert "tilt 10° → 30°" in page.locator("#small").inner_text()
    server.say(told.look(1, told.pose(0, 0, 158, 10)))
    page.get_by_text("158 mm → 0.43 m").wait_for()  # as the server's own words have it
    sees(server, page, told.look(2, worth=1.0, still=0.5), "Hold still")
    wait_for(page, lambda: is_green(server, page))  # what was found is not shown for long
    server.say(told.nothing_seen(3))
    big(page, "Bottom left, right side back, 0.45 m")


def test_warning_is_the_large_line(shown: Shown) -> None:
    """What forbids a frame is said large; motion on the way to the ghost is no reason to stop."""
    dark = FrameNote("exposure", "too dark", forbids=True)
    moving = FrameNote("motion", "hold still: blurred by 4 px", forbids=True)
    away, there = told.look(1, told.pose(-20, 10, 500, 10)), told.look(2, worth=1.0)
    server, page = shown
    sees(server, page, replace(away, look=replace(away.look, notes=(dark,))), "Too dark")
    blurred = replace(away, look=replace(away.look, notes=(moving,)))
    sees(server, page, blurred, "Closer, and tilt the right side away")
    assert page.locator("#notes").inner_text() == moving.sentence
    blurred = replace(there, look=replace(there.look, notes=(moving,), is_wanted=False))
    sees(server, page, blurred, "Hold still: blurred by 4 px")


def test_mirror_turns_picture_and_words_alike(shown: Shown) -> None:
    """In a mirror the ghost is on the other side, and so are left and right in the words; the rest stays."""
    server, page = shown
    away = told.look(1, told.pose(-20, 10, 500, 10))
    sees(server, page, away, "Closer, and tilt the right side away")
    page.keyboard.press("i")
    sees(server, page, away, "Closer, and tilt the left side away")
    server.say(told.nothing_seen(2))
    big(page, "Bottom right, left side back, 0.45 m")
    wait_for(page, lambda: drawn(page, is_ghost=True)[1] > 0.55)
    words = page.evaluate(
        "async (text) => (await import('./words.js')).mirrored(text)", "Left, turned clockwise; 3 copyrights"
    )
    assert words == "Right, turned counterclockwise; 3 copyrights"
    page.keyboard.press("i")


def test_keys_say_what_the_buttons_say(shown: Shown) -> None:
    """Each key is a command, once however long it is held; with the focus on a button, space is the button's."""
    server, page = shown
    for key, kind in ((" ", "take"), ("n", "skip"), ("a", "by_hand")):
        page.keyboard.press(key)
        assert server.heard(kind).name == ""
    page.keyboard.press("Delete")
    assert server.heard("delete").name == "0004.png"
    page.keyboard.down("n")
    page.keyboard.down("n")
    page.keyboard.press("a")
    server.heard("by_hand")
    page.keyboard.up("n")
    page.locator("#skip").click()
    page.keyboard.press(" ")
    server.heard("take")
    assert [said.kind for said in server.commands] == []
    page.keyboard.press("f")  # it is not good yet
    page.get_by_role("button", name="Take more photos").click()
    page.locator("#finish").focus()
    page.keyboard.press(" ")
    page.get_by_role("button", name="Finish now").wait_for()
    assert [said.kind for said in server.commands] == []
    page.keyboard.press("f")
    server.heard("finish")
    server.say(told.guidance(stage="exhausted"))
    page.get_by_role("button", name="Take more photos").click()
    page.keyboard.press("f")
    server.heard("finish")


def test_deleted_photo_can_be_restored(shown: Shown) -> None:
    """A photo has a button that deletes it; one that is gone, now or before, has one that restores it."""
    server, page = shown
    page.get_by_role("button", name="Delete 0002.png").click()
    assert server.heard("delete").name == "0002.png"
    four = told.guidance()
    three = tuple(photo for photo in four.guidance.photos if photo.name != "0002.png")
    gone = tuple(replace(four.guidance.photos[0], name=name) for name in ("0000.png", "0002.png"))
    server.say(GuidanceMessage(replace(four.guidance, photos=three), "", gone))
    page.get_by_role("button", name="Restore 0000.png").click()
    assert server.heard("restore").name == "0000.png"
    page.get_by_role("button", name="Restore 0002.png").click()
    assert server.heard("restore").name == "0002.png"


def test_end_is_announced_and_the_report_outlives_the_server(shown: Shown) -> None:
    """Ending can be put off; done, the report is shown, `bye` said, and no connection is missed afterwards."""
    server, page = shown
    server.say(replace(told.state("camera"), phase="ending", ends_in_s=9.0))
    big(page, "Enough photos")
    assert re.search(r"in \d s", page.locator("#small").inner_text())
    page.get_by_role("button", name="Take more photos").click()
    server.heard("more")
    server.say(replace(told.state("camera"), phase="ending", ends_in_s=9.0), told.guidance(stage="exhausted"))
    big(page, "More photos would not help")
    server.say(replace(told.state("camera"), phase="solving", said="detecting photo 3 of 11"))
    big(page, "Computing the calibration")
    assert page.locator("#small").inner_text() == "detecting photo 3 of 11"
    server.say(replace(told.state("camera"), phase="done", said="good: 0.04 px"))
    server.heard("bye")
    server.hang_up()
    page.wait_for_timeout(100)
    big(page, "Done")
    report = page.frame_locator("#report")
    assert report.get_by_text("The report").is_visible()
    assert report.locator("a[href]").all_inner_texts() == ["part"]  # a link to a file would leave the report


def test_failure_and_notices_are_said(shown: Shown) -> None:
    """A source's fault, a notice, a photo taken, and why there is no calibration; texts are texts."""
    server, page = shown
    server.say(NoticeMessage(HOSTILE, is_fault=True), TakenMessage("0005.png", by_itself=True))
    page.get_by_text(HOSTILE).wait_for()
    page.get_by_text("0005.png taken").wait_for()
    source = replace(told.state("camera").sources[0], fault="camera 0: sends nothing any more")
    server.say(replace(told.state("camera"), sources=(source,)))
    big(page, "Camera 0: sends nothing any more")
    server.say(replace(told.state("camera"), phase="failed", said=HOSTILE))
    big(page, "No calibration")
    assert page.locator("#small").inner_text() == HOSTILE
    page.get_by_role("button", name="Compute again").click()
    server.heard("finish")
    page.get_by_role("button", name="Take more photos").click()
    server.heard("more")


def test_space_takes_a_photo_whatever_was_clicked(shown: Shown) -> None:
    """Neither a deleted photo is restored by it, nor one deleted or opened again; under a dialog no key is heeded."""
    server, page = shown
    page.get_by_role("button", name="Delete 0002.png").click()
    server.heard("delete")
    page.keyboard.press(" ")
    server.heard("take")
    page.get_by_role("button", name="0003.png: 63 rings").click()
    page.locator("#photo-words").click()
    page.keyboard.press("f")
    page.locator("#photo-box [data-close]").focus()
    page.keyboard.press(" ")
    page.wait_for_function("() => document.activeElement === document.body")
    page.keyboard.press(" ")
    server.heard("take")
    page.get_by_role("button", name="0003.png: 63 rings").click()
    page.keyboard.press(" ")
    page.wait_for_function("() => document.activeElement === document.body")
    page.keyboard.press("n")
    server.heard("skip")
    assert server.commands == []


@pytest.mark.parametrize(("width", "scheme"), [(390, "dark"), (2560, "light")])
def test_page_fits_a_phone_and_a_wall(shown: Shown, width: int, scheme: Literal["light", "dark"]) -> None:
    """Nothing is wider than the window, buttons are large enough for fingers, and words fit into their band."""
    server, page = shown
    page.set_viewport_size({"width": width, "height": 844 if width < 1000 else 1440})
    page.emulate_media(color_scheme=scheme)
    sees(server, page, told.look(1, told.pose(-20, 10, 500, 10)), "Closer, and tilt the right side away")
    assert overflow_px(page) == 0
    boxes = [one.bounding_box() for one in page.locator("#tools button:visible, .photo-remove").all()]
    assert all(box is not None and min(box["width"], box["height"]) >= 43.9 for box in boxes)
    server.say(replace(told.state("camera"), phase="ending", ends_in_s=9.0))
    big(page, "Enough photos")
    assert page.evaluate(CUT) <= 0
    assert overflow_px(page) == 0
