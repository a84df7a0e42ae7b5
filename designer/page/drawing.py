"""Drawings for a page: SVG files of matplotlib, shown as pictures that follow the page's scheme.

As a picture (`<img>`) an SVG is a document of its own: a browser runs no script in it and fetches nothing for it, its
ids meet no others, and its style attributes are not the page's (SVG 2, section 2.2.6, secure static mode). So nothing
is taken from it; colours without meaning become variables, which its own style sheet sets for light and dark.
"""

import re

from designer.page.blocks import Svg

# Colours without meaning, those of `calib.figures.style` and of matplotlib itself: on light, on dark, and what is so.
_NEUTRAL = {
    "ink": ("#1a1a1a", "#e6e9ec", ("#1a1a1a", "#262626", "#000000")),
    "grey": ("#6b6b6b", "#a3abb3", ("#6b6b6b", "#7f7f7f", "#808080")),
    "faint": ("#bdbdbd", "#59616a", ("#bdbdbd", "#b0b0b0", "#cccccc")),
    "empty": ("#e4e4e4", "#343a41", ("#e4e4e4",)),
    "paper": ("#ffffff", "#1a1d21", ("#ffffff",)),
}
_NAME = {colour: name for name, (_, _, colours) in _NEUTRAL.items() for colour in colours}
_LIGHT, _DARK = (";".join(f"--{name}:{colours[n]}" for name, colours in _NEUTRAL.items()) for n in (0, 1))
_STYLE = (
    f"<style>:root{{{_LIGHT};fill:var(--ink)}}@media screen and (prefers-color-scheme:dark){{:root{{{_DARK}}}}}"
    'text{font-family:"DejaVu Sans",Verdana,"Bitstream Vera Sans",sans-serif!important}</style>'
)
_COLOUR = re.compile(rf"\b((?:fill|stroke)(?:: |=\"))({'|'.join(_NAME)})\b", re.IGNORECASE)
_SIZE = re.compile(r'\bviewBox="0 0 ([0-9]+(?:\.[0-9]+)?) ([0-9]+(?:\.[0-9]+)?)"')
_PX_PER_POINT = 96 / 72


def drawing_of_svg(svg: bytes) -> Svg:
    """A drawing of matplotlib for a page.

    Raises:
        ValueError: no whole SVG as matplotlib writes it.
    """
    text = svg.decode("utf-8", "replace")
    start = text.find("<svg")
    end = text.find(">", start)
    size = _SIZE.search(text, start, end) if 0 <= start < end else None
    if size is None or "</svg>" not in text:
        raise ValueError("drawing: no SVG, or not all of it")
    coloured = _COLOUR.sub(lambda found: f"{found[1]}var(--{_NAME[found[2].lower()]})", text[end + 1 :])
    width_px, height_px = (round(float(side) * _PX_PER_POINT, 2) for side in size.groups())
    return Svg(f"{text[start : end + 1]}{_STYLE}{coloured}".encode(), width_px, height_px)
