"""The live page with the browser's camera, in a real browser that has no WebGL: frames, faults, tabs."""

from collections.abc import Iterator
from contextlib import AbstractContextManager, contextmanager
from dataclasses import replace
from pathlib import Path

import cv2
import numpy as np
import pytest
from playwright.sync_api import Page

from tests.support import live_messages as told
from tests.support.browser import complaints, new_page, started_browser
from tests.support.live_server import ScriptedServer, scripted_server
from tests.support.waiting import wait_until

WIDTH, HEIGHT = 640, 480
CAMERA = ("--use-fake-device-for-media-stream", "--use-fake-ui-for-media-stream")
CAMERA_SCRIPT = """() => {
  HTMLCanvasElement.prototype.getContext = ((real) => function (kind, ...more) {
    return kind.startsWith("webgl") ? null : real.call(this, kind, ...more);
  })(HTMLCanvasElement.prototype.getContext);
  const real = navigator.mediaDevices?.getUserMedia.bind(navigator.mediaDevices);
  if (real) navigator.mediaDevices.getUserMedia = async (wish) => {
    const why = window.name;  // kept when the page is loaded
    if (why) throw new DOMException("refused", why);
    return real(wish);
  };
}"""


def colours() -> np.ndarray:
    """Four fields of strong colours, which no mean of red, green and blue tells right.  # (H, W, 3) blue first"""
    image = np.zeros((HEIGHT, WIDTH, 3), np.uint8)
    image[: HEIGHT // 2, : WIDTH // 2] = (0, 0, 220)
    image[: HEIGHT // 2, WIDTH // 2 :] = (0, 220, 0)
    image[HEIGHT // 2 :, : WIDTH // 2] = (220, 0, 0)
    image[HEIGHT // 2 :, WIDTH // 2 :] = (200, 200, 200)
    return image


@pytest.fixture(scope="module")
def page(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Page]:
    """With a camera that shows the fields."""
    movie: Path = tmp_path_factory.mktemp("camera") / "fields.mjpeg"
    jpeg = cv2.imencode(".jpg", colours(), [cv2.IMWRITE_JPEG_QUALITY, 95])[1].tobytes()
    movie.write_bytes(4 * jpeg)
    with started_browser(*CAMERA, f"--use-file-for-fake-video-capture={movie}") as started:
        page = new_page(started)
        page.add_init_script(f"({CAMERA_SCRIPT})()")
        yield page


@contextmanager
def opened(page: Page, server: ScriptedServer) -> Iterator[Page]:
    """The page, which must complain of nothing."""
    with complaints(page) as troubles:
        page.goto(server.address)
        yield page
        page.goto("about:blank")
    assert troubles == []


def live() -> AbstractContextManager[ScriptedServer]:
    """A server that answers every frame."""
    return scripted_server(told.state(), told.guidance(0), answer=lambda header: told.look(header.number))


def frames(server: ScriptedServer, count: int) -> None:
    """Wait for so many frames."""
    wait_until(lambda: len(server.frames) >= count)


def test_frames_are_the_cameras_pixels_in_grey(page: Page) -> None:
    """A frame has the camera's size, OpenCV's grey levels, and numbers and times that grow; one is sent an answer."""
    with scripted_server(told.state(), told.guidance(0), answer=lambda h: told.nothing_seen(h.number)) as server:
        with opened(page, server):
            frames(server, 3)
        grey = cv2.cvtColor(colours(), cv2.COLOR_BGR2GRAY)
        header, sent = server.frames[-1]
        assert sent.shape == grey.shape
        inside = np.abs(sent.astype(int) - grey)
        middle = np.s_[40:200, 40:280], np.s_[40:200, 360:600], np.s_[280:440, 40:280], np.s_[280:440, 360:600]
        assert all(inside[part].max() <= 2 for part in middle)
        numbers, times = zip(*((one.number, one.time_s) for one, _ in server.frames), strict=True)
        assert list(numbers) == list(range(len(numbers)))
        assert all(np.diff(times) > 0)
        assert header.source == 0


def test_next_frame_waits_for_the_look_at_the_last(page: Page) -> None:
    """A server that is slow is not sent frames that it cannot look at: no more than one a second without answer."""
    with scripted_server(told.state(), told.guidance(0)) as server, opened(page, server):
        frames(server, 1)
        page.wait_for_timeout(700)
        assert len(server.frames) == 1


def test_keys_are_the_pages_again_after_a_size_was_chosen(page: Page) -> None:
    """The list gives the focus back."""
    with live() as server, opened(page, server):
        frames(server, 1)
        page.locator("#size").focus()
        page.locator("#size").dispatch_event("change")  # this camera has one size
        page.keyboard.press("n")
        server.heard("skip")


def test_camera_that_may_not_be_used_is_said_and_tried_again(page: Page) -> None:
    """Refused, the page says the remedy and tells the server why; a button tries again, which is told too."""
    page.evaluate("() => { window.name = 'NotAllowedError'; }")
    with scripted_server(told.state(), told.guidance(0)) as server, opened(page, server):
        assert "may not use the camera" in server.heard("source").name
        page.get_by_text("Allow it at the camera sign", exact=False).first.wait_for()
        page.evaluate("() => { window.name = 'NotReadableError'; }")
        page.get_by_role("button", name="Try again").click()
        assert "another program" in server.heard("source").name
        page.evaluate("() => { window.name = ''; }")
        page.get_by_role("button", name="Try again").click()
        assert server.heard("source").name == ""
        frames(server, 1)
        page.get_by_role("button", name="Try again").wait_for(state="detached")


def test_unplugged_camera_is_said_at_once_and_taken_up_again(page: Page) -> None:
    """A track that ends is a fault; when devices change, the camera is opened again."""
    with live() as server, opened(page, server):
        frames(server, 1)
        page.evaluate(
            "() => document.querySelector('video').srcObject.getTracks()[0].dispatchEvent(new Event('ended'))"
        )
        assert "unplugged" in server.heard("source").name
        assert "unplugged" in page.locator("#big").inner_text()
        page.evaluate("() => navigator.mediaDevices.dispatchEvent(new Event('devicechange'))")
        assert server.heard("source").name == ""


def test_camera_is_closed_while_it_is_solved_and_opened_for_more_photos(page: Page) -> None:
    """Neither a page that is loaded then opens it, nor one that is still asked for is used; more photos need it."""
    light = "() => document.querySelector('video').srcObject !== null"
    failed = replace(told.state(), phase="failed", said="no camera is determined")
    with scripted_server(failed, told.guidance(2)) as server, opened(page, server):
        page.get_by_role("button", name="Take more photos").wait_for()
        page.wait_for_timeout(600)
        assert not page.evaluate(light)
        server.say(told.state())
        server.say(failed)
        page.wait_for_timeout(600)
        assert not page.evaluate(light)
        server.say(told.state())
        frames(server, 1)


def test_tab_that_lost_the_session_stops_and_can_take_it_back(page: Page) -> None:
    """Told that it is not here any more, a page sends nothing and does not come back by itself; a button reloads it."""
    away = replace(told.state(), is_here=False)
    with live() as server, opened(page, server):
        frames(server, 1)
        server.say(away)
        page.get_by_text("Another tab has the session").first.wait_for()
        server.hang_up()
        page.wait_for_timeout(1300)
        assert len(server.sockets) == 1
        count = len(server.frames)
        page.wait_for_timeout(200)
        assert len(server.frames) == count
        page.get_by_role("button", name="Take it back here").click()
        wait_until(lambda: len(server.sockets) == 2)


def test_lost_connection_says_how_to_go_on_and_comes_back(page: Page) -> None:
    """Without the server the page says that photos are kept; it comes back to a server that answers again."""
    with scripted_server(told.state(), told.guidance(2)) as server, opened(page, server):
        wait_until(lambda: server.sockets)
        server.hang_up()
        page.get_by_text("--resume").first.wait_for()
        wait_until(lambda: len(server.sockets) == 2)
        page.wait_for_function("() => document.body.dataset.tone !== 'fault'")
