"""Pages in a browser: what people and screen readers meet."""

import io
import re
import shutil
from collections.abc import Iterator
from pathlib import Path
from typing import Literal

import pytest

from tests.support.programs import run

pytest.importorskip("playwright")

from PIL import Image
from playwright.sync_api import Browser, Locator, Page, expect

from designer.page.blocks import Cell, Column, Gallery, Picture, Section, Table
from designer.page.blocks import Page as Report
from tests.support.browser import WIDTHS, open_page, overflow_px, unresolved
from tests.support.pages import HOSTILE, hostile_page, picture, values_table, whole_page, written

SCHEMES: tuple[Literal["light", "dark"], ...] = ("light", "dark")
# The contrast of every text with what is behind it (WCAG 2.2, "contrast ratio"), the least first.
CONTRASTS = r"""() => {
  const parse = (text) => (text.match(/[\d.]+/g) || []).map(Number);
  const light = ([r, g, b]) => [r, g, b].map((value) => value / 255)
    .map((value) => (value <= 0.04045 ? value / 12.92 : ((value + 0.055) / 1.055) ** 2.4))
    .reduce((sum, value, n) => sum + value * [0.2126, 0.7152, 0.0722][n], 0);
  const ground = (element) => {
    for (let one = element; one; one = one.parentElement) {
      const colour = parse(getComputedStyle(one).backgroundColor);
      if (colour.length === 3 || colour[3] === 1) return colour;
    }
    return [255, 255, 255];
  };
  const found = [];
  const walker = document.createTreeWalker(document.body, NodeFilter.SHOW_TEXT);
  while (walker.nextNode()) {
    const element = walker.currentNode.parentElement;
    if (!walker.currentNode.data.trim() || element.closest("script, style, svg, .hidden, dialog, .viewer")) continue;
    const [a, b] = [light(parse(getComputedStyle(element).color)), light(ground(element))].sort((x, y) => y - x);
    found.push([(a + 0.05) / (b + 0.05), walker.currentNode.data.trim().slice(0, 40)]);
  }
  return found.sort((x, y) => x[0] - y[0]);
}"""


@pytest.fixture(scope="module")
def file(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A page with every kind of block but scenes."""
    return written(whole_page(), tmp_path_factory.mktemp("page"))


@pytest.fixture
def page(browser: Browser, file: Path) -> Iterator[Page]:
    """That page, open."""
    with open_page(browser, file) as opened:
        yield opened


def column(table: Locator, place: int) -> list[str]:
    """The texts of a column, without the words for screen readers."""
    cells = table.locator(f"tbody tr > :nth-child({place})").all_text_contents()
    return [re.sub(r"^(good|with care|bad|note): ", "", cell.strip()).strip() for cell in cells]


each_window = pytest.mark.parametrize(("width", "scheme"), [(WIDTHS[0], SCHEMES[0]), (WIDTHS[-1], SCHEMES[-1])])


@each_window
def test_every_block_without_trouble(
    browser: Browser, tmp_path: Path, width: int, scheme: Literal["light", "dark"]
) -> None:
    """A page of all blocks, a scene too, causes no error or request, and all its links and images are there."""
    file = written(whole_page(has_scene=True), tmp_path)
    with open_page(browser, file, width=width, scheme=scheme) as page:
        assert unresolved(page, file) == []
        assert overflow_px(page) == 0


def test_trouble_is_noticed(browser: Browser, tmp_path: Path) -> None:
    """The checks themselves notice errors, violations of the policy, requests, dead links and images, and overflow."""
    bad = tmp_path / "bad.html"
    policy = '<meta http-equiv="Content-Security-Policy" content="script-src \'none\'">'
    for markup in ("<script>console.error('x')</script>", "<script>throw 1</script>", "<img src='missing.png'>",
                   f"{policy}<script>1</script>", "<img src='https://localhost:1/x.png'>"):  # fmt: skip
        bad.write_text(f"<!doctype html><title>t</title>{markup}")
        with pytest.raises(AssertionError), open_page(browser, bad):
            pass
    links = "<a href='missing.txt'>a</a><a href='../'>b</a><a href='https://localhost'>c</a><a href='#none'>d</a>"
    image = "<img src='data:image/png;base64,AAAA'>"
    bad.write_text(f"<!doctype html><title>t</title>{links}{image}<pre>{'x' * 999}</pre>")
    with open_page(browser, bad) as page:
        assert len(unresolved(page, bad)) == 5
        assert overflow_px(page) > 1000


def test_numbers_sort_by_value(page: Page) -> None:
    """A click sorts numbers by value, a second one the other way round; what is missing stays last.

    A head is reached with the tab key, and sorts on Enter and on Space.
    """
    table = page.get_by_role("table", name="Views").first
    head = table.get_by_role("button", name="RMS in px")
    head.click()
    assert column(table, 2)[:2] == ["-2", "1e-07"]
    assert column(table, 2)[-3:] == ["9", "10", "–"]
    expect(table.get_by_role("columnheader").nth(1)).to_have_attribute("aria-sort", "ascending")
    head.click()
    assert column(table, 2)[:3] == ["10", "9", "0.5"]
    assert column(table, 2)[-2:] == ["-2", "–"]
    expect(table.get_by_role("columnheader").nth(1)).to_have_attribute("aria-sort", "descending")
    table.get_by_role("button", name="Photo").focus()
    page.keyboard.press("Tab")
    for key, first in (("Enter", "-2"), ("Space", "10")):
        page.keyboard.press(key)
        assert column(table, 2)[0] == first


def test_a_table_that_goes_on_beyond_its_edge_says_so(browser: Browser, tmp_path: Path) -> None:
    """Where columns are hidden at the right, or at the left after scrolling, that edge fades; where none are, none."""
    columns = tuple(Column(f"quantity {n} [mm]") for n in range(20))
    cells = tuple(Cell("0.1234 ± 0.0056", float(n)) for n in range(20))
    tables = (Table("Wide", columns, (cells,)), Table("Narrow", columns[:2], (cells[:2],)))
    report = Report("t", "Test", None, (Section("Tables", tables),))
    with open_page(browser, written(report, tmp_path)) as page:
        wide, narrow = (page.get_by_role("region", name=name) for name in ("Wide", "Narrow"))
        expect(wide).to_have_class("scroll more-right")
        expect(narrow).to_have_class("scroll")
        wide.evaluate("(one) => { one.scrollLeft = 1e6; }")
        expect(wide).to_have_class("scroll more-left")


def test_texts_sort_with_their_numbers(page: Page) -> None:
    """Texts sort as people do, 2 before 10, rows stay whole, and only one head says that it sorts."""
    table = page.get_by_role("table", name="Views").first
    rows = set(zip(column(table, 1), column(table, 2), column(table, 3), strict=True))
    table.get_by_role("button", name="Rings").click()
    table.get_by_role("button", name="Photo").click()
    assert column(table, 1)[:3] == ["more_0.png", "more_1.png", "more_2.png"]
    assert column(table, 1).index("more_9.png") < column(table, 1).index("more_10.png")
    assert set(zip(column(table, 1), column(table, 2), column(table, 3), strict=True)) == rows
    assert table.locator("th[aria-sort]").count() == 1


def test_long_tables_scroll_and_keep_their_head(page: Page) -> None:
    """A long table shows as many rows as it says, and its head stays while the rows scroll."""
    box = page.locator(".scroll").first
    shown = box.evaluate("(box) => box.clientHeight")
    row = box.locator("tbody tr").nth(4).bounding_box()
    top = box.bounding_box()
    assert row is not None
    assert top is not None
    assert row["y"] + row["height"] <= top["y"] + shown < row["y"] + 3 * row["height"]
    box.evaluate("(box) => { box.scrollTop = 900; }")
    head = box.locator("thead th").first.bounding_box()
    assert head is not None
    assert head["y"] == pytest.approx(top["y"], abs=1)


def test_lightbox(page: Page) -> None:
    """A picture opens large with its name and its file; arrow keys go on and round, Escape leads back to it.

    Its button closes it too, and so does a click beside it.
    """
    page.get_by_role("button", name="photo 1.png").click()
    box = page.get_by_role("dialog")
    expect(box).to_be_visible()
    expect(box.locator("#lightbox-name")).to_have_text(re.compile(r"photo 1\.png"))
    expect(box.get_by_role("link")).to_have_attribute("href", "photos/a%20b.png")
    expect(box.locator("#lightbox-place")).to_have_text("2 of 3")
    page.keyboard.press("ArrowRight")
    expect(box.locator("#lightbox-caption")).to_have_text("2 rings")
    page.keyboard.press("ArrowRight")
    expect(box.locator("#lightbox-name")).to_have_text(re.compile(r"photo 0\.png"))
    expect(box.get_by_role("link")).to_have_count(0)
    page.keyboard.press("ArrowLeft")
    box.get_by_role("button", name="Previous picture").click()
    expect(box.locator("#lightbox-place")).to_have_text("2 of 3")
    assert box.locator("img").evaluate("(image) => image.naturalWidth") == 60
    page.keyboard.press("Escape")
    expect(box).to_be_hidden()
    expect(page.get_by_role("button", name="photo 1.png")).to_be_focused()
    page.get_by_role("button", name="photo 0.png").click()
    box.get_by_role("button", name="Close").click()
    expect(box).to_be_hidden()
    page.get_by_role("button", name="photo 0.png").click()
    page.mouse.click(3, 3)
    expect(box).to_be_hidden()


def test_commands_are_copied(page: Page) -> None:
    """The button copies the line; where the browser refuses, the line is selected and the button says so."""
    line = page.locator(".command", has_text="calib undistort").locator(".line")
    page.context.grant_permissions(["clipboard-read", "clipboard-write"])
    line.get_by_role("button").click()
    expect(line.get_by_role("button")).to_have_text("Copied")
    assert page.evaluate("() => navigator.clipboard.readText()") == "calib undistort photos/*.png"
    page.evaluate("() => { navigator.clipboard.writeText = () => Promise.reject(new Error()); }")
    other = page.locator(".command", has_text="calib report run").locator(".line")
    other.get_by_role("button").click()
    expect(other.get_by_role("button")).to_have_text("Selected")
    assert page.evaluate("() => getSelection().toString().trim()") == "calib report run"
    expect(page.get_by_role("status")).to_contain_text("Selected")


def test_first_tab_skips_to_the_results(page: Page) -> None:
    """The first stop of the tab key is a visible link past the head."""
    page.keyboard.press("Tab")
    link = page.get_by_role("link", name="Skip to the results")
    expect(link).to_be_focused()
    expect(link).to_be_in_viewport()


def test_focus_is_seen(page: Page) -> None:
    """Every stop of the tab key has an outline, and every button and link a name."""
    stops = set()
    for _ in range(60):
        page.keyboard.press("Tab")
        place, name, outline = page.evaluate("""() => {
          const at = document.activeElement;
          const name = at.ariaLabel || at.textContent.trim() || at.getAttribute("aria-labelledby") || "";
          return [Array.from(document.querySelectorAll("*")).indexOf(at), name, getComputedStyle(at).outlineStyle];
        }""")
        if place in stops or page.evaluate("() => document.activeElement === document.body"):
            break
        stops.add(place)
        assert name
        assert outline == "solid"
    assert len(stops) > 15


def test_contents_lead_to_sections(page: Page) -> None:
    """A click in the contents shows the section, and the contents mark where one is."""
    page.get_by_role("navigation").get_by_role("link", name="More").click()
    expect(page.get_by_role("heading", name="More")).to_be_in_viewport()
    expect(page.locator(".contents a[aria-current]")).to_have_text("More")


@pytest.mark.parametrize("width", WIDTHS)
def test_hostile_names_stay_text(browser: Browser, tmp_path: Path, width: int) -> None:
    """Names like markup, that turn the writing or never end stay words, and the page stays as wide as the window."""
    file = written(hostile_page(), tmp_path)
    with open_page(browser, file, width=width) as page:
        assert page.title() == f"{HOSTILE[0]} – {HOSTILE[1]}"
        assert page.locator("main .paragraph").nth(1).text_content() == HOSTILE[1]
        assert page.locator("[onerror], [onmouseover], script[src], img[src='x']").count() == 0
        assert page.locator("script").count() == 1
        assert overflow_px(page) == 0
        page.get_by_role("button", name=HOSTILE[0]).last.click()
        expect(page.locator("#lightbox-name")).to_have_text(HOSTILE[0])
        targets = page.locator(".file-list a").evaluate_all("(links) => links.map((link) => link.href)")
        assert len(targets) == 5
        assert all(target.startswith(f"{tmp_path.as_uri()}/odd/") for target in targets)


@each_window
def test_contrast(browser: Browser, file: Path, width: int, scheme: Literal["light", "dark"]) -> None:
    """Every text has a contrast of at least 4.5 with its ground (WCAG 2.2, criterion 1.4.3)."""
    with open_page(browser, file, width=width, scheme=scheme) as page:
        found = page.evaluate(CONTRASTS)
        assert len(found) > 100
        assert found[0][0] >= 4.5, found[:5]


@pytest.mark.parametrize("scheme", SCHEMES)
def test_drawings_follow_the_scheme(browser: Browser, file: Path, scheme: Literal["light", "dark"]) -> None:
    """The words of a drawing are dark on light and light on dark; the colours of its data are the same."""
    with open_page(browser, file, scheme=scheme) as page:
        shown = page.get_by_role("img", name="Sigma grows to the right").screenshot()
        colours = set(Image.open(io.BytesIO(shown)).convert("RGB").get_flattened_data())
        ink, ground = {"light": ((26, 26, 26), (255, 255, 255)), "dark": ((230, 233, 236), (26, 29, 33))}[scheme]
        empty = {"light": (228, 228, 228), "dark": (52, 58, 65)}[scheme]
        assert {ground, empty, (0, 114, 178)} <= colours
        assert min(sum(abs(a - b) for a, b in zip(ink, colour, strict=True)) for colour in colours) < 60


def test_print_shows_everything(browser: Browser, file: Path, tmp_path: Path) -> None:
    """In print folds are open, all rows are there, buttons and contents are not; afterwards all is as before."""
    if not shutil.which("pdftotext"):
        pytest.skip("no pdftotext: install the Debian package poppler-utils")
    with open_page(browser, file) as page:
        page.pdf(path=tmp_path / "page.pdf")
        assert page.locator("details[open]").count() == 0
    printed = run("pdftotext", tmp_path / "page.pdf", "-").stdout
    assert "Words within a fold." in printed
    assert all(f"more_{n}.png" in printed for n in range(40))
    assert "Copy" not in printed
    assert "Skip to" not in printed


def test_figures_two_abreast_where_there_is_room(browser: Browser, file: Path) -> None:
    """Two figures stand side by side on a wide screen and below each other on a phone; a wide one has its own line."""
    tops: dict[int, list[float]] = {}
    for width in WIDTHS:
        with open_page(browser, file, width=width) as page:
            boxes = [figure.bounding_box() for figure in page.locator("section figure").all()]
            tops[width] = [box["y"] for box in boxes if box]
    plot, pixels, wide = tops[1280]
    assert plot == pixels < wide
    plot, pixels, wide = tops[390]
    assert plot < pixels < wide


def test_a_thousand_photos_and_five_thousand_rows(browser: Browser, tmp_path: Path) -> None:
    """A page of 1000 photos and 5000 rows opens, shows its last picture and sorts, with no wait beyond a test's."""
    photos = Gallery(tuple(Picture(picture(n % 250), f"photo {n:04d}.png", f"{n} rings") for n in range(1000)))
    table = values_table(5000)
    file = written(Report("many", "Calibration", None, (Section("All", (photos, table)),)), tmp_path)
    with open_page(browser, file) as page:
        page.locator(".gallery button").last.press("Enter")
        expect(page.locator("#lightbox-place")).to_have_text("1000 of 1000")
        page.keyboard.press("Escape")
        page.locator("thead button").nth(1).click()
        assert page.evaluate("() => document.querySelector('tbody').lastElementChild.cells[1].innerText.endsWith('–')")


def test_a_page_without_anything(browser: Browser, tmp_path: Path) -> None:
    """A page without headline, sections or rows is a page all the same."""
    empty = Table("Nothing", (Column("a"),), ())
    file = written(Report("empty", "Target", None, (Section("Empty", (empty, Gallery(()))),)), tmp_path)
    with open_page(browser, file, width=390) as page:
        expect(page.get_by_role("heading", level=1)).to_have_text("empty")
        page.get_by_role("button", name="a", exact=True).click()
