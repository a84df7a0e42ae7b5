"""Pages as HTML: nothing of the data becomes markup, nothing is fetched, nothing leads out of the folder."""

import base64
import hashlib
import re
from html.parser import HTMLParser
from urllib.parse import unquote

import pytest
from hypothesis import given
from hypothesis import strategies as st

from designer.page.blocks import (
    Cell,
    Column,
    Figure,
    Fold,
    Link,
    Page,
    Paragraph,
    Raster,
    Section,
    Table,
    View3d,
    href,
    is_linkable,
)
from designer.page.shell import file_size, page_html
from tests.support.pages import hostile_page, picture, scene, whole_page

VOID = {"meta", "img", "br", "link", "input"}


class Reader(HTMLParser):
    """Elements with their attributes, and the text within style and script elements."""

    def __init__(self, html: str) -> None:
        super().__init__()
        self.elements: list[tuple[str, dict[str, str | None]]] = []
        self.inline: list[tuple[dict[str, str | None], str]] = []
        self.open: list[str] = []
        self.feed(html)

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        """An element begins."""
        self.elements.append((tag, dict(attrs)))
        if tag not in VOID:
            self.open.append(tag)
        if tag in {"script", "style"}:
            self.inline.append((dict(attrs), ""))

    def handle_startendtag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        """An element without content."""
        self.elements.append((tag, dict(attrs)))

    def handle_endtag(self, tag: str) -> None:
        """An element ends, the innermost."""
        assert self.open.pop() == tag

    def handle_data(self, data: str) -> None:
        """A text."""
        if self.open and self.open[-1] in {"script", "style"}:
            attributes, text = self.inline[-1]
            self.inline[-1] = (attributes, text + data)


def read(page: Page) -> Reader:
    """The page's elements."""
    reader = Reader(page_html(page).decode())
    assert reader.open == []
    return reader


def policy_of(reader: Reader) -> str:
    """The Content-Security-Policy of a page."""
    (policy,) = (a["content"] for _, a in reader.elements if a.get("http-equiv") == "Content-Security-Policy")
    return str(policy)


def of_blocks(*blocks: Table | Figure | Paragraph | View3d | Fold) -> Page:
    """A page of some blocks."""
    return Page("title", "kind", None, (Section("Section", tuple(blocks)),))


@pytest.mark.parametrize("page", [whole_page(), whole_page(has_scene=True)], ids=["plain", "scene"])
def test_policy_allows_just_what_is_inline(page: Page) -> None:
    """The policy names the SHA-256 of each script and style, and allows nothing else but data: images."""
    reader = read(page)
    code = [text for attributes, text in reader.inline if attributes.get("type") != "application/json"]
    hashes = {f"'sha256-{base64.b64encode(hashlib.sha256(text.encode()).digest()).decode()}'" for text in code}
    policy = policy_of(reader)
    assert set(re.findall(r"'sha256-[^']+'", policy)) == hashes
    assert re.sub(r"( ?'sha256-[^']+')+", " #", policy) == (
        "default-src 'none'; img-src data:; style-src #; script-src #; base-uri 'none'; form-action 'none'"
    )


def test_viewer_only_with_a_scene() -> None:
    """The 3D library is in a page only if the page has a scene, be it within a fold."""
    bare = len(page_html(of_blocks(Paragraph("words"))))
    view = View3d("title", scene(), "alt")
    assert len(page_html(of_blocks(view))) - bare > 300_000
    assert len(page_html(of_blocks(Fold("fold", (view,))))) - bare > 300_000
    assert bare < 60_000


def test_nothing_is_fetched_and_no_attribute_acts() -> None:
    """No element refers to the network, and none has a style or an event handler."""
    for tag, attributes in read(whole_page(has_scene=True)).elements:
        assert tag not in {"link", "iframe", "object", "embed", "base", "form"}
        for name, value in attributes.items():
            assert not name.startswith("on")
            assert name != "style"
            if name in {"src", "href", "xlink:href", "srcset", "action"}:
                assert value is not None
                assert re.match(r"data:image/|#|[A-Za-z0-9%]+(/|\.)", value)
                assert ":" not in value or value.startswith("data:image/")


def test_every_text_stays_text() -> None:
    """Hostile texts in every place give the elements and attributes that tame ones of the same number give."""
    page = hostile_page()
    reader = read(page)
    tags = {tag for tag, _ in reader.elements}
    assert sum(tag == "script" for tag, _ in reader.elements) == 1
    assert not any(name.startswith("on") for _, attributes in reader.elements for name in attributes)
    assert all(attributes.get("src", "data:")[:5] == "data:" for _, attributes in reader.elements)  # type: ignore[index]
    assert tags <= {tag for tag, _ in read(whole_page()).elements}
    html = page_html(page).decode()
    assert "&lt;img src=x onerror=alert(1)&gt;" in html
    assert "{{ 7 * 7 }}{% raw %}" in html


def test_bytes_that_are_no_text() -> None:
    """A file name of undecodable bytes and control characters still gives UTF-8 without them."""
    html = page_html(of_blocks(Paragraph("a\udcff\x00\x1bb"))).decode("utf-8")
    assert "a\ufffd\ufffd\ufffdb" in html


def test_ids_are_unique_and_references_resolve() -> None:
    """No two elements share an id, and every reference within the page has one to find."""
    reader = read(whole_page(has_scene=True))
    ids = [attributes["id"] for _, attributes in reader.elements if "id" in attributes]
    assert len(ids) == len(set(ids))
    for _, attributes in reader.elements:
        for name in ("href", "aria-labelledby", "data-scene"):
            value = attributes.get(name) or ""
            if name != "href" or value.startswith("#"):
                assert not value or value.removeprefix("#") in ids


def test_sections_of_the_same_title_have_their_own_anchors() -> None:
    """Two sections of one title, and titles without a letter, are all led to."""
    page = Page("t", "k", None, tuple(Section(title, ()) for title in ("Views", "Views", "µ", "", "Content")))
    anchors = [attributes["href"] for _, attributes in read(page).elements if "href" in attributes]
    assert len(set(anchors)) == 6  # the link past the head is one


@pytest.mark.parametrize("path", [
    "", "/etc/passwd", "..", "../secret", "a/../../b", "a//b", "./a", "a/.", "https://example.org/x", "javascript://x",
    "C:/windows", "c:x", "a\\..\\b", "\\\\host\\x", "a\nb", "//host/x", "a\x00b",
])  # fmt: skip
def test_links_out_of_the_folder_are_refused(path: str) -> None:
    """Absolute paths, upward paths, schemes, drives, backslashes and control characters are refused everywhere."""
    assert not is_linkable(path)
    with pytest.raises(ValueError, match="inside the page's folder"):
        href(path)
    figure = Figure("t", picture(), "alt", files=(Link("file", path),))
    table = Table("t", (Column("c"),), ((Cell("cell", path=path),),))
    with pytest.raises(ValueError, match="inside the page's folder"):
        page_html(of_blocks(figure))
    if path:  # an empty path of a cell is no link
        with pytest.raises(ValueError, match="inside the page's folder"):
            page_html(of_blocks(table))


@given(st.text(st.characters(codec="utf-8"), min_size=1, max_size=40))
def test_links_read_back(path: str) -> None:
    """A link's path, decoded, is the file's; encoded it holds neither a colon nor anything that ends a path."""
    if is_linkable(path):
        assert unquote(href(path)) == path
        assert not re.search(r"[:?#<>\"'&\\\s]", href(path))


def test_numbers_sort_by_value_not_by_text() -> None:
    """A cell carries its exact value; NaN and a missing value carry none, infinities are beyond all."""
    values = (0.1, 1e-7, float("nan"), None, float("inf"), -3.0)
    table = Table("t", (Column("c"),), tuple((Cell("text", value),) for value in values))
    cells = [attributes for tag, attributes in read(of_blocks(table)).elements if attributes.get("scope") == "row"]
    assert [cell.get("data-value") for cell in cells] == ["0.1", "1e-07", None, None, "1e+300", "-3.0"]


def test_levels_are_said_not_only_coloured() -> None:
    """Each level beside a text has an icon and a word that screen readers say."""
    html = page_html(whole_page()).decode()
    for word in ("good", "with care", "bad", "note"):
        assert f'<span class="hidden">{word}: </span>' in html


def test_pictures_must_be_pictures() -> None:
    """A raster that is neither PNG nor JPEG is refused: its media type would be a guess."""
    with pytest.raises(ValueError, match="neither PNG nor JPEG"):
        page_html(of_blocks(Figure("t", Raster(b"<svg/>", 1, 1), "alt")))


@pytest.mark.parametrize(("size", "words"), [
    (0, "0 bytes"), (999, "999 bytes"), (1000, "1.0 kB"), (12_345, "12 kB"), (9_960, "10 kB"), (999_999, "1.0 MB"),
    (1_234_567, "1.2 MB"), (3_000_000_000, "3.0 GB"),
])  # fmt: skip
def test_sizes_in_words(size: int, words: str) -> None:
    """Sizes have two or three digits in powers of 1000."""
    assert file_size(size) == words
