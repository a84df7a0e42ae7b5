"""The 3D view in a real browser: it draws, it turns, it never stands in the way of the page."""

import base64
import io
import re
import shutil
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Literal

import numpy as np
import pytest
from numpy.typing import NDArray
from PIL import Image
from playwright.sync_api import Browser
from playwright.sync_api import Page as BrowserPage

from designer.kinds.board import BoardSpec
from designer.kinds.ico import IcoSpec
from designer.kinds.layout import lay_out
from designer.page import shell
from designer.page.blocks import Page, Paragraph, Raster, Section, View3d
from designer.page.pictures import raster_of
from designer.page.scene import Layer, Scene
from designer.page.shell import page_html
from designer.target_scene import camera_layer, target_scene
from tests.support.browser import open_page, wait_for
from tests.support.pages import png

Pixels = NDArray[np.uint8]
ICO = lay_out(IcoSpec(60.0, 5, 7.0, 0.45, 10.0, 1.0, 0.5))
BOARD = lay_out(BoardSpec((90.0, 60.0), 5.0, 7, 5, "square", 7.0, 0.45, 10.0, 0.0, 4.0, dots=True))
ICO_SCENE = target_scene(ICO, body_colour="#ffffff", ink_colour="#101010")
BOARD_SCENE = target_scene(BOARD, body_colour="#ffffff", ink_colour="#101010")
HOSTILE = "<img src=x onerror=alert(1)></script><script>alert(2)</script>"
PARTS = Path(shell.__file__).parent / "parts"
CORNERS = np.array([[[-0.5, -0.4, 1.0], [0.5, -0.4, 1.0], [0.5, 0.4, 1.0], [-0.5, 0.4, 1.0]]])
BUTTONS: tuple[Literal["left"], Literal["right"]] = ("left", "right")


def write_page(folder: Path, *scenes: Scene, poster: Raster | None = None) -> Path:
    """A page of 3D views with text below, so that it can scroll."""
    views = tuple(View3d(f"View {n}", scene, "A target", poster=poster) for n, scene in enumerate(scenes))
    text = tuple(Paragraph("A line of the report.") for _ in range(60))
    file = folder / "index.html"
    file.write_bytes(page_html(Page("Test", "Target", None, (Section("Views", (*views, *text)),))))
    return file


class View:
    """The view of a page that has but one."""

    def __init__(self, page: BrowserPage) -> None:
        self.page = page
        self.element = page.locator(".viewer")
        page.wait_for_selector(".viewer[data-state=ready]")
        self.element.scroll_into_view_if_needed()
        self.settle()

    def settle(self) -> None:
        """Wait until all is drawn and stands still."""
        self.page.wait_for_selector(".viewer[data-rest=yes]")

    def number(self, name: str) -> float:
        """A number that the view tells about itself."""
        return float(self.element.get_attribute(f"data-{name}") or "nan")

    def numbers(self) -> tuple[float, float, float]:
        """Where the viewer stands."""
        return self.number("azimuth"), self.number("polar"), self.number("distance")

    def press(self, *keys: str) -> None:
        """Type into the view, which then comes to rest."""
        for key in keys:
            self.element.press(key)
        self.settle()

    def drawn(self) -> Pixels:
        """What is drawn.  # (H, W, 4)"""
        data = self.element.locator("canvas").evaluate("e => e.toDataURL()")
        return np.asarray(Image.open(io.BytesIO(base64.b64decode(data.partition(",")[2]))))

    def seen(self) -> Pixels:
        """What one sees.  # (H, W, 3)"""
        return np.asarray(Image.open(io.BytesIO(self.element.screenshot())).convert("RGB"))

    def middle(self) -> tuple[float, float]:
        """Where the view's middle is in the window."""
        box = self.element.bounding_box()
        assert box is not None
        return box["x"] + box["width"] / 2, box["y"] + box["height"] / 2


@contextmanager
def open_view(browser: Browser, folder: Path, scene: Scene) -> Iterator[View]:
    """A page with one view, drawn and at rest."""
    with open_page(browser, write_page(folder, scene), width=600, height=560) as page:
        yield View(page)


@pytest.fixture(scope="module")
def shared(browser: Browser, tmp_path_factory: pytest.TempPathFactory) -> Iterator[View]:
    """An icosahedron that several tests turn."""
    with open_view(browser, tmp_path_factory.mktemp("ico"), ICO_SCENE) as view:
        yield view


@pytest.fixture
def ico(shared: View) -> View:
    """The icosahedron as a new page shows it."""
    shared.page.mouse.move(1, 1)
    shared.page.evaluate("scrollTo(0, 0)")
    shared.press("0")
    shared.element.evaluate("e => e.blur()")
    return shared


def scrolled_px(view: View) -> float:
    return float(view.page.evaluate("scrollY"))


def changed_share(a: Pixels, b: Pixels) -> float:
    """The share of pixels that differ visibly."""
    return float((np.abs(a.astype(int) - b).max(axis=2) > 24).mean())


def test_target_is_drawn(ico: View) -> None:
    """The view shows ink, body and shaded faces in the middle, and background in its corners."""
    seen = ico.seen()
    height, width = seen.shape[:2]
    inner = seen[height // 3 : -height // 3, width // 3 : -width // 3].reshape(-1, 3)
    assert len(np.unique(inner, axis=0)) > 50
    assert 0.1 < (inner.max(axis=1) < 60).mean() < 0.6
    assert (inner.min(axis=1) > 190).mean() > 0.2
    assert (seen[10:30, 10:30].min(axis=2) > 190).all()


def test_arrow_keys_turn(ico: View) -> None:
    """An arrow key turns by ten degrees, its opposite back to the very same picture."""
    start, before = ico.number("azimuth"), ico.drawn()
    ico.press("ArrowLeft")
    assert ico.number("azimuth") - start == pytest.approx(-10, abs=0.1)
    assert changed_share(before, ico.drawn()) > 0.05
    ico.press("ArrowRight")
    assert changed_share(before, ico.drawn()) < 0.001


def test_keys_tilt_zoom_and_reset(ico: View) -> None:
    """Up and down tilt, plus and minus zoom, 0 brings the first view back; other keys are the page's."""
    start = ico.numbers()
    ico.press("ArrowUp", "ArrowUp", "ArrowLeft", "+", "+", "-")
    assert ico.number("polar") == pytest.approx(start[1] - 20, abs=0.1)
    assert ico.number("distance") == pytest.approx(0.85 * start[2], rel=1e-3)
    ico.press("0")
    assert ico.numbers() == pytest.approx(start, abs=0.02)
    # Dispatched, not pressed: a real End scrolls the view out of sight, whenever the browser finds time for it.
    taken = ico.element.evaluate(
        "e => ['End', '+'].map(key =>"
        " !e.dispatchEvent(new KeyboardEvent('keydown', {key, bubbles: true, cancelable: true})))"
    )
    assert taken == [False, True]


def test_buttons_zoom_and_reset(ico: View) -> None:
    """What keys do, buttons with names do too: not everybody has keys."""
    start = ico.numbers()
    ico.page.get_by_role("button", name="zoom in").click()
    ico.settle()
    assert ico.number("distance") == pytest.approx(0.85 * start[2], rel=1e-3)
    ico.page.get_by_role("button", name="back to the first view").click()
    ico.settle()
    assert ico.numbers() == pytest.approx(start, abs=0.02)


def test_drag_turns_and_double_click_resets(ico: View) -> None:
    """A drag turns the target with the mouse, a right drag moves it, a double click brings the first view back."""
    start, before = ico.numbers(), ico.drawn()
    (x, y), mouse = ico.middle(), ico.page.mouse
    for button in BUTTONS:
        mouse.move(x, y)
        mouse.down(button=button)
        mouse.move(x + 90, y, steps=4)
        mouse.up(button=button)
        ico.settle()
        assert ico.number("azimuth") < start[0] - 20
        changed, before = changed_share(before, ico.drawn()), ico.drawn()
        assert changed > 0.05
    mouse.dblclick(x, y)
    mouse.move(1, 1)
    wait_for(ico.page, lambda: ico.numbers() == pytest.approx(start, abs=0.02))


def test_wheel_scrolls_the_page(ico: View) -> None:
    """The wheel scrolls the page, and says how to zoom; it zooms with Ctrl, or when the view has the focus."""
    page, distance = ico.page, ico.number("distance")
    page.wait_for_timeout(500)  # until the page counts as not being scrolled
    page.evaluate("""() => {
      const hint = document.querySelector(".viewer-hint");
      new MutationObserver(() => { window.wasHinted ||= !hint.hidden; }).observe(hint, {attributes: true});
    }""")
    page.mouse.move(*ico.middle())
    for _ in range(10):  # a busy browser may drop a turn of the wheel
        page.mouse.wheel(0, 20)
        page.wait_for_timeout(300)
        if scrolled_px(ico):
            break
    assert scrolled_px(ico) > 0
    assert page.evaluate("() => window.wasHinted")  # it goes after a while
    assert ico.number("distance") == distance
    page.keyboard.down("Control")
    page.mouse.wheel(0, -100)
    page.keyboard.up("Control")
    wait_for(page, lambda: ico.number("distance") < 0.99 * distance)
    ico.press("0")
    page.wait_for_timeout(500)
    scrolled = scrolled_px(ico)
    page.mouse.wheel(0, -20)
    wait_for(page, lambda: ico.number("distance") < 0.99 * distance)
    assert scrolled_px(ico) == scrolled


def test_fingers_scroll_the_page(ico: View) -> None:
    """A finger that moves up over the view scrolls the page; the browser must be told so in advance."""
    assert ico.element.locator("canvas").evaluate("e => getComputedStyle(e).touchAction") == "pan-y"


def test_switch_shows_face_numbers(ico: View) -> None:
    """Face numbers come and go with their switch; the target itself has none."""
    switches = ico.page.locator(".viewer-switch")
    assert switches.all_text_contents() == ["face numbers", "axes", "turn"]
    before = ico.drawn()
    switches.nth(0).click()
    ico.settle()
    assert changed_share(before, ico.drawn()) > 0.005
    switches.nth(0).click()
    ico.settle()
    assert changed_share(before, ico.drawn()) < 0.001


def test_stands_still_if_asked(ico: View) -> None:
    """Who has asked for less motion gets a still view."""
    assert not ico.page.get_by_label("turn", exact=True).is_checked()
    start = ico.number("azimuth")
    ico.page.wait_for_timeout(300)
    assert ico.number("azimuth") == start


def test_dark(ico: View) -> None:
    """The background follows the system's colours at once; the target keeps its own."""
    light = ico.seen()
    ico.page.emulate_media(color_scheme="dark")
    wait_for(ico.page, lambda: ico.seen()[20, 20].max() < 90)
    dark = ico.seen()
    ico.page.emulate_media(color_scheme="light")
    assert light[20, 20].min() > 190
    rows, columns = (slice(n // 2 - 40, n // 2 + 40) for n in light.shape[:2])
    assert changed_share(light[rows, columns], dark[rows, columns]) < 0.001


def test_names_stay_text(browser: Browser, tmp_path: Path) -> None:
    """Names of photos, layers and legends show as they are, whatever they hold."""
    pose = np.diag([1.0, -1.0, -1.0, 1.0])
    pose[2, 3] = 100.0
    cameras = camera_layer(pose[None], CORNERS, (HOSTILE,), ("#0072b2",), 40.0)
    layers = (*BOARD_SCENE.layers, cameras, Layer(HOSTILE, ()))
    scene = Scene(layers, BOARD_SCENE.up, (0.0, 0.0, 1.0), (("#0072b2", HOSTILE),))
    with open_view(browser, tmp_path, scene) as view:
        view.page.mouse.move(*view.middle())
        tip = view.page.locator(".viewer-tip")
        tip.wait_for(state="visible")
        assert tip.text_content() == HOSTILE
        assert view.page.locator(".viewer-legend li").all_text_contents() == [HOSTILE]
        assert HOSTILE in view.page.locator(".viewer-switch").all_text_contents()
        assert view.page.locator("figure img, img[src=x]").count() == 0
        view.page.mouse.move(1, 1)
        tip.wait_for(state="hidden")


def test_rings_are_named(browser: Browser, tmp_path: Path) -> None:
    """Pointing at the ring in the middle of a board, or at its white inside, says which one it is."""
    facing = Scene(BOARD_SCENE.layers, BOARD_SCENE.up, (0.0, 0.0, 1.0))
    with open_view(browser, tmp_path, facing) as view:
        view.page.mouse.move(*view.middle())
        tip = view.page.locator(".viewer-tip")
        tip.wait_for(state="visible")
        nearest = int(np.argmin(np.linalg.norm(BOARD.center_mm, axis=1)))
        i, j = BOARD.ring_index[nearest]
        assert tip.text_content() == f"{'dot' if BOARD.is_dot[nearest] else 'ring'} ({i}, {j})"


def test_turns_by_itself_until_touched(browser: Browser, tmp_path: Path) -> None:
    """The target turns slowly; the first key stops it, and its switch says so and starts it again."""
    with open_page(browser, write_page(tmp_path, BOARD_SCENE), reduced_motion=False, width=390, height=400) as page:
        view = page.locator(".viewer")
        start = view.get_attribute("data-azimuth")
        wait_for(page, lambda: view.get_attribute("data-azimuth") != start)
        turn = page.get_by_label("turn", exact=True)
        assert turn.is_checked()
        view.press("ArrowLeft")
        page.wait_for_selector(".viewer[data-rest=yes]")
        assert not turn.is_checked()
        stopped = view.get_attribute("data-azimuth")
        turn.check()
        wait_for(page, lambda: view.get_attribute("data-azimuth") != stopped)


def test_unseen_views_are_drawn_too(browser: Browser, tmp_path: Path) -> None:
    """Several views stand on one page, and one that was never scrolled to is drawn: it may be printed."""
    with open_page(browser, write_page(tmp_path, BOARD_SCENE, BOARD_SCENE), width=390, height=400) as page:
        page.wait_for_selector(".viewer[data-state=ready] >> nth=1", state="attached")
        data = page.evaluate("document.querySelectorAll('.viewer canvas')[1].toDataURL()")
        with Image.open(io.BytesIO(base64.b64decode(data.partition(",")[2]))) as image:
            drawn = np.asarray(image).reshape(-1, 4)
        solid = drawn[drawn[:, 3] == 255, :3]
        assert len(solid) > 0.1 * len(drawn)
        assert 0.02 < (solid.max(axis=1) < 60).mean() < 0.8


@pytest.mark.parametrize("has_poster", [True, False])
def test_without_webgl(browser: Browser, tmp_path: Path, has_poster: bool) -> None:
    """Without WebGL the page shows the picture, if there is one, and says why; nothing complains."""
    poster = raster_of(png(80, 60)) if has_poster else None
    program = shutil.which("chromium") or shutil.which("chromium-browser") or shutil.which("google-chrome")
    plain = browser.browser_type.launch(
        executable_path=program, args=["--no-sandbox", "--disable-gpu", "--disable-3d-apis"]
    )
    try:
        with open_page(plain, write_page(tmp_path, BOARD_SCENE, poster=poster)) as page:
            view = page.wait_for_selector(".viewer[data-state=unavailable]")
            assert view is not None
            assert "WebGL" in view.inner_text()
            assert page.locator(".poster").count() == int(has_poster)
            assert all(poster.is_visible() for poster in page.locator(".poster").all())
            assert ("picture" in view.inner_text()) == has_poster
            assert page.locator("canvas, .viewer-switch").count() == 0
    finally:
        plain.close()


def test_damaged_scene(browser: Browser, tmp_path: Path) -> None:
    """A scene that cannot be read is said in words; the other views and the page work."""
    file = write_page(tmp_path, BOARD_SCENE, BOARD_SCENE)
    html = file.read_text(encoding="utf-8")
    file.write_text(html.replace('{"up":', '{"up" damaged', 1), encoding="utf-8")
    with open_page(browser, file, width=390, height=400) as page:
        page.wait_for_selector(".viewer[data-state=ready]")
        broken = page.locator(".viewer[data-state=unavailable]")
        assert "could not be drawn" in broken.inner_text()


def test_library_can_stand_in_a_page() -> None:
    """The library and the viewer hold nothing that ends their element, fetches or evaluates, and name their licence."""
    library = (PARTS / "three.min.js").read_text(encoding="utf-8")
    shapes, viewer = ((PARTS / name).read_text(encoding="utf-8") for name in ("viewer_shapes.js", "viewer.js"))
    assert len(library.encode()) < 600_000
    assert "The MIT License" in library[:300]
    version = re.search(r"three\.js (\d+\.\d+\.\d+)", library)
    assert version is not None
    assert f"three@{version[1]}" in (PARTS / "three_entry.js").read_text(encoding="utf-8")
    for text in (library, shapes, viewer):
        assert not re.search(r"</script|<!--|sourceMappingURL|\beval\(|new Function\(", text, re.IGNORECASE)
        assert set(re.findall(r"https?://[^\"'` )]*", text)) <= {"http://www.w3.org/1999/xhtml"}
    for text in (shapes, viewer):
        assert "innerHTML" not in text
        assert "use strict" in text[:600]
