"""Drawings inside pages: pictures of their own that follow the scheme, and can do nothing."""

import io
import re

import numpy as np
import pytest

from designer.page.blocks import Figure, Page, Section
from designer.page.pictures import drawing_of_svg
from designer.page.shell import page_html
from tests.support.pages import PLOT

HEAD = '<svg xmlns="http://www.w3.org/2000/svg" width="72pt" height="36pt" viewBox="0 0 72 36">'


def drawn(inside: str) -> str:
    """What becomes of a drawing with something inside, without the style sheet."""
    return re.sub("<style>.*?</style>", "", drawing_of_svg(f"{HEAD}{inside}</svg>".encode()).content.decode())


def of_blocks(*blocks: Figure) -> Page:
    """A page of some blocks."""
    return Page("title", "kind", None, (Section("Section", blocks),))


def plot() -> bytes:
    """A figure with what studies draw: lines, markers, a legend, an image with words on it, hatches, mathematics."""
    import matplotlib as mpl
    from matplotlib.figure import Figure as Plot

    with mpl.rc_context({"svg.fonttype": "none", "svg.hashsalt": "x", "text.color": "#1a1a1a"}):
        figure = Plot(figsize=(6, 3))
        left, right = figure.subplots(1, 2)
        left.plot([0, 1, 2], [1, 3, 2], "o-", color="#0072B2", label="a <b> & c")
        left.bar([0, 1], [1, 2], hatch="//", color="#e4e4e4", edgecolor="#1a1a1a")
        left.set_title(r"$\sigma^2$")
        left.legend()
        right.imshow(np.linspace(0, 1, 12).reshape(3, 4), cmap="cividis")
        right.text(1.5, 1.0, "0.5", color="#0b1a33")
        stream = io.BytesIO()
        figure.savefig(stream, format="svg", metadata={"Date": None})
    return stream.getvalue()


def test_matplotlib_s_neutral_colours_become_variables() -> None:
    """None of ink, greys and white is left as a number; the colours of data, and those chosen for a picture, stay."""
    drawing = drawing_of_svg(plot())
    text = re.sub("<style>.*?</style>", "", drawing.content.decode(), count=1)
    assert not re.search('#(1a1a1a|000000|ffffff|e4e4e4)["; ]', text)
    assert {"var(--ink)", "var(--empty)", "var(--paper)"} <= set(re.findall(r"var\(--\w+\)", text))
    assert "#0072b2" in text
    assert "#0b1a33" in text
    assert (drawing.width_px, drawing.height_px) == (576, 288)
    assert drawing == drawing_of_svg(plot())


def test_colours_alone_change() -> None:
    """A word, an id or a reference that looks like a colour stays."""
    inside = '<g id="ink"/><use href="#1a1a1a"/><text style="fill: #D55E00">#1a1a1a</text>'
    assert drawn(inside) == f"{HEAD}{inside}</svg>"
    assert 'style="fill: var(--paper); stroke: var(--ink)"' in drawn('<path style="fill: #FFFFFF; stroke: #1a1a1a"/>')


def test_a_drawing_is_a_picture_of_its_own() -> None:
    """Its markup stands nowhere in the page: no id, style, script or event of it can be the page's."""
    hostile = f'{HEAD}<script>alert(1)</script><path onload="alert(2)" id="content" style="fill: red"/></svg>'
    html = page_html(of_blocks(Figure("t", drawing_of_svg(hostile.encode()), "alt"))).decode()
    assert 'src="data:image/svg+xml;base64,' in html
    assert "alert(" not in html
    assert html.count('id="content"') == page_html(of_blocks()).decode().count('id="content"')


@pytest.mark.parametrize("content", [
    b"", b"\x89PNG\r\n\x1a\n", b"<html/>", b"<svg/>", HEAD.encode(), b"<svg" * 100_000, PLOT[:-10], b"\xff</svg>",
    b'<svg viewBox="0 0 nan 3"></svg>',
])  # fmt: skip
def test_what_is_no_drawing_is_refused(content: bytes) -> None:
    """No SVG, no size, or cut off: a ValueError."""
    with pytest.raises(ValueError, match="drawing: no SVG"):
        drawing_of_svg(content)
