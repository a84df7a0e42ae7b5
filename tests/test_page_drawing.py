"""Drawings inside pages: what matplotlib draws is kept, what could act or refer outside is not."""

import base64
import io
import re
import xml.etree.ElementTree as ET

import numpy as np
import pytest

from designer.page.drawing import drawing_of_svg
from designer.page.drawing_tree import MAX_BYTES, MAX_DEPTH
from tests.pages import PLOT, png

SVG = "{http://www.w3.org/2000/svg}"
HEAD = (
    '<svg xmlns="http://www.w3.org/2000/svg" xmlns:xlink="http://www.w3.org/1999/xlink" width="72pt" height="36pt"'
    ' viewBox="0 0 72 36">'
)
PIXEL = base64.b64encode(png(1, 1)).decode()


def drawn(inside: str) -> str:
    """The safe markup of a drawing with something inside."""
    return drawing_of_svg(f"{HEAD}{inside}</svg>".encode()).svg


def elements(svg: str) -> list[ET.Element]:
    """All elements of safe markup, which is XML too."""
    return list(ET.fromstring(svg).iter())


def plot(*, as_text: bool) -> bytes:
    """A figure with what studies draw: lines, markers, a legend, an image with words on it, hatches, mathematics."""
    import matplotlib as mpl
    from matplotlib.figure import Figure

    with mpl.rc_context({"svg.fonttype": "none" if as_text else "path", "svg.hashsalt": "x", "text.color": "#1a1a1a"}):
        figure = Figure(figsize=(6, 3))
        left, right = figure.subplots(1, 2)
        left.plot([0, 1, 2], [1, 3, 2], "o-", color="#0072B2", label="a <b> & c")
        left.bar([0, 1], [1, 2], hatch="//", color="#e4e4e4", edgecolor="#1a1a1a")
        left.set_title(r"$\sigma^2$")
        left.legend()
        right.imshow(np.linspace(0, 1, 12).reshape(3, 4), cmap="cividis")
        right.text(1.5, 1.0, "0.5", color="#1a1a1a")
        right.text(1.5, -1.0, "outside", color="#1a1a1a")
        stream = io.BytesIO()
        figure.savefig(stream, format="svg", metadata={"Date": None})
    return stream.getvalue()


@pytest.mark.parametrize("as_text", [True, False])
def test_all_that_matplotlib_draws_is_kept(as_text: bool) -> None:
    """Of a figure, every drawn element but the white backdrop is kept, and every word."""
    content = plot(as_text=as_text)
    before = list(ET.fromstring(content).iter())
    after = elements(drawing_of_svg(content).svg)
    for name in ("path", "use", "image", "text", "tspan", "clipPath", "pattern", "rect"):
        count = sum(element.tag == SVG + name for element in before) - (name == "path")
        assert sum(element.tag == name for element in after) == count, name
    words = [element.text for element in before if element.tag == SVG + "text"]
    assert [element.text for element in after if element.tag == "text"] == words
    assert ("a <b> & c" in words) == as_text


@pytest.mark.parametrize("as_text", [True, False])
def test_references_resolve_within_the_drawing(as_text: bool) -> None:
    """Every reference has its element, and nothing that is referred to refers on, so references cannot multiply."""
    root = ET.fromstring(drawing_of_svg(plot(as_text=as_text)).svg)
    ids = {element.get("id"): element for element in root.iter() if element.get("id")}
    used = [element.get("href", "")[1:] for element in root.iter("use")]
    used += re.findall(r"url\(#([^)]+)\)", ET.tostring(root, encoding="unicode"))
    assert used
    for name in used:
        inside = ET.tostring(ids[name], encoding="unicode")
        assert "url(" not in inside
        assert "<use" not in inside


def test_no_style_and_the_style_s_place_taken() -> None:
    """Style attributes and sheets become presentation attributes, a style before an attribute of the same name."""
    path = '<path d="M 0 0 L 1 1" fill="red" style="fill: #0072b2; stroke-width: 2; behavior: x"/>'
    svg = drawn(f"<defs><style>*{{stroke-linejoin: round}}</style></defs>{path}")
    assert "style" not in svg
    root, kept = elements(svg)
    assert root.get("stroke-linejoin") == "round"
    assert dict(kept.attrib) == {"d": "M 0 0 L 1 1", "fill": "#0072b2", "stroke-width": "2"}


def test_sizes_in_pixels() -> None:
    """Lengths in points become CSS pixels, 96 to 72; without lengths the view box counts."""
    drawing = drawing_of_svg(f"{HEAD}</svg>".encode())
    assert (drawing.width_px, drawing.height_px) == (96, 48)
    drawing = drawing_of_svg(b'<svg xmlns="http://www.w3.org/2000/svg" width="100%" viewBox="0 0 30 20"/>')
    assert (drawing.width_px, drawing.height_px) == (30, 20)


def test_ids_are_each_drawing_s_own() -> None:
    """Two drawings with the same ids share none; the same drawing has the same bytes each time."""
    one, two = plot(as_text=False), plot(as_text=False).replace(b"#0072b2", b"#0072b3")
    ids = [{element.get("id") for element in elements(drawing_of_svg(svg).svg)} - {None} for svg in (one, two)]
    assert ids[0]
    assert not ids[0] & ids[1]
    assert drawing_of_svg(one) == drawing_of_svg(one)


def test_colours_without_meaning_become_classes() -> None:
    """Ink, greys and white become classes that follow the page's scheme; the colours of data stay."""
    svg = drawn(
        '<path d="M 0 0" style="fill: #FFFFFF; stroke: #1a1a1a"/><path d="M 0 0" fill="#d55e00" stroke="#e4e4e4"/>'
    )
    _, first, second = elements(svg)
    assert dict(first.attrib) == {"d": "M 0 0", "class": "fill-paper stroke-ink"}
    assert dict(second.attrib) == {"d": "M 0 0", "class": "stroke-empty", "fill": "#d55e00"}


def test_white_behind_everything_goes() -> None:
    """The figure's white ground is left out, so that the page shows through; a smaller white patch is not."""
    ground = '<path d="M 0 36 L 72 36 L 72 0 L 0 0 z" style="fill: #ffffff"/>'
    assert len(elements(drawn(ground))) == 1
    assert len(elements(drawn(ground.replace("72", "50")))) == 2


def test_words_on_a_picture_keep_their_colour() -> None:
    """What lies on an embedded picture keeps the colour chosen for that picture; what lies beside it does not."""
    texts = {
        element.text: element for element in elements(drawing_of_svg(plot(as_text=True)).svg) if element.tag == "text"
    }
    assert texts["0.5"].get("fill") == "#1a1a1a"
    assert texts["outside"].get("fill") is None
    assert texts["outside"].get("class") == "fill-ink"


@pytest.mark.parametrize("inside", [
    "<script>alert(1)</script>",
    "<g><script xlink:href='https://example.org/x.js'/></g>",
    "<foreignObject><p xmlns='http://www.w3.org/1999/xhtml' onclick='alert(1)'>x</p></foreignObject>",
    "<a xlink:href='javascript:alert(1)'><text>x</text></a>",
    "<animate attributeName='href' to='javascript:alert(1)'/>",
    "<set attributeName='onload' to='alert(1)'/>",
    "<image href='https://example.org/x.png'/>",
    "<image xlink:href='data:image/svg+xml;base64,PHN2Zy8+'/>",
    "<image xlink:href='data:image/png;base64,PHN2Zy8+'/>",
    "<image xlink:href='file:///etc/passwd'/>",
    "<use xlink:href='https://example.org/x.svg#a'/>",
    "<use href='#missing'/>",
    "<use href='data:image/svg+xml,x#a'/>",
    "<style>@import url(https://example.org/x.css);</style>",
    "<style>*{fill: url(https://example.org/x)}</style>",
    "<iframe xmlns='http://www.w3.org/1999/xhtml' src='https://example.org'/>",
    "<script xmlns='http://www.w3.org/1999/xhtml'>alert(1)</script>",
    "<path xmlns='urn:other' d='M 0 0'/>",
    "<svg onload='alert(1)'/>",
    "<title>x</title><desc>x</desc><metadata>x</metadata>",
    "<filter id='f'><feImage href='https://example.org/x'/></filter>",
    "<handler>alert(1)</handler><?xml-stylesheet href='https://example.org/x.css'?>",
])  # fmt: skip
def test_what_could_act_or_refer_outside_goes(inside: str) -> None:
    """Elements that are not on the list, and pictures and references from elsewhere, leave nothing behind."""
    assert drawn(inside) == drawn("")


@pytest.mark.parametrize(("attributes", "kept"), [
    ("onclick='alert(1)' onload='x'", {}),
    ("style='fill: url(https://example.org/x)'", {"fill": "none"}),
    ("fill='url(https://example.org/x#a)'", {"fill": "none"}),
    ("fill='URL( https://example.org/x#a )'", {"fill": "none"}),
    ("stroke='url(#missing)'", {"stroke": "none"}),
    ("clip-path='url(#missing)'", {}),
    ("style='background: url(x); fill: red; -moz-binding: url(x)'", {"fill": "red"}),
    ("style='stroke-width: expression(alert(1))'", {}),
    ("stroke-width='&quot; onload=&quot;x'", {}),
    ("stroke-width='1&lt;script'", {}),
    ("class='headline' id='content' href='#x' xlink:href='javascript:x' tabindex='1' filter='url(#f)'", {}),
])  # fmt: skip
def test_attributes_are_on_the_list_or_gone(attributes: str, kept: dict[str, str]) -> None:
    """Event handlers, foreign references, classes and ids that could be the page's, and strange values fall away."""
    (_, path) = elements(drawn(f"<path {attributes}/>"))
    assert dict(path.attrib) == kept


def test_words_stay_words() -> None:
    """Markup in a text is text."""
    svg = drawn("<text>&lt;script&gt;alert(1)&lt;/script&gt;<tspan>&amp;</tspan> end</text>")
    assert "&lt;script&gt;" in svg
    assert "".join(ET.fromstring(svg).itertext()) == "<script>alert(1)</script>& end"


def test_definitions_refer_no_further() -> None:
    """A chain of `use` within `use`, each twice the one before, is not kept: it would be drawn 2^n times."""
    chain = "".join(f'<g id="g{n}"><use href="#g{n - 1}"/><use href="#g{n - 1}"/></g>' for n in range(1, 30))
    svg = drawn(f'<defs><g id="g0"><path d="M 0 0"/></g>{chain}</defs><use href="#g29"/>')
    assert sum(element.tag == "use" for element in elements(svg)) <= 1


@pytest.mark.parametrize(("content", "reason"), [
    (b"", "no SVG"),
    (b"\x89PNG\r\n\x1a\n", "no SVG"),
    (b"<html/>", "outermost"),
    (b"<svg/>", "outermost"),
    (f"{HEAD}<g>".encode(), "no SVG"),
    (b'<svg xmlns="http://www.w3.org/2000/svg"/>', "no size"),
    (b'<svg xmlns="http://www.w3.org/2000/svg" viewBox="0 0 nan 3"/>', "no size"),
    (b'<svg xmlns="http://www.w3.org/2000/svg" viewBox="0 0 1e300 3"/>', "no size"),
    (b'<!DOCTYPE svg [<!ENTITY a "b">]><svg xmlns="http://www.w3.org/2000/svg">&a;</svg>', "declares"),
    (b'<!DOCTYPE svg SYSTEM "x" [<!ENTITY % a SYSTEM "file:///etc/passwd"> %a;]><svg/>', "declares"),
    ((HEAD + "<g>" * (MAX_DEPTH + 1)).encode(), "deeper"),
    (b" " * (MAX_BYTES + 1), "more than"),
])  # fmt: skip
def test_what_is_no_drawing_is_refused(content: bytes, reason: str) -> None:
    """No SVG, no size, entities, too deep or too large: a ValueError that says which."""
    with pytest.raises(ValueError, match=reason):
        drawing_of_svg(content)


def test_pictures_inside_are_pixels() -> None:
    """An embedded PNG is kept byte for byte, line ends in its base64 or not."""
    broken = "\n".join(PIXEL[n : n + 20] for n in range(0, len(PIXEL), 20))
    svg = drawn(f'<image xlink:href="data:image/png;base64,{broken}" width="3" height="3"/>')
    assert f'href="data:image/png;base64,{PIXEL}"' in svg


def test_plot_of_the_tests_is_drawn() -> None:
    """The plot that other tests put in pages has its line and its words."""
    assert [element.tag for element in elements(drawing_of_svg(PLOT).svg)] == ["svg", "text", "path"]
