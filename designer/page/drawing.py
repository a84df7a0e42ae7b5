"""Drawings for a page: an SVG file, of matplotlib or of anyone, made safe and given the page's colours.

What is kept is on a list; scripts, links, fonts, events and whatever refers outside the drawing fall away. Style
attributes become presentation attributes, which a strict Content-Security-Policy allows (SVG 2, section 6.6).
"""

import base64
import binascii
import hashlib
import re
from collections.abc import Iterator
from dataclasses import dataclass, replace
from html import escape

from designer.page.blocks import Drawing
from designer.page.drawing_place import IDENTITY, Matrix, Pictures, path_points, pictures_in, product, transform_of
from designer.page.drawing_place import numbers as numbers_in
from designer.page.drawing_tree import XLINK_HREF, Element, parse_svg
from designer.page.raster import media_type

_CONTAINERS = frozenset(("g", "defs", "clipPath", "pattern", "linearGradient", "radialGradient", "text", "tspan"))
_ELEMENTS = _CONTAINERS | {
    "path", "rect", "circle", "ellipse", "line", "polyline", "polygon", "use", "image", "stop",
}  # fmt: skip
_DEFINING = frozenset(("defs", "clipPath", "pattern", "linearGradient", "radialGradient"))
_GEOMETRY = frozenset((
    "d", "x", "y", "x1", "y1", "x2", "y2", "dx", "dy", "width", "height", "cx", "cy", "r", "rx", "ry", "fx", "fy",
    "points", "transform", "rotate", "offset", "preserveAspectRatio", "patternUnits", "patternContentUnits",
    "patternTransform", "clipPathUnits", "gradientUnits", "gradientTransform", "spreadMethod",
))  # fmt: skip
_LOOKS = frozenset((
    "fill", "fill-opacity", "fill-rule", "stroke", "stroke-width", "stroke-linecap", "stroke-linejoin",
    "stroke-miterlimit", "stroke-dasharray", "stroke-dashoffset", "stroke-opacity", "opacity", "clip-path", "clip-rule",
    "font-size", "font-weight", "font-style", "text-anchor", "dominant-baseline", "baseline-shift", "visibility",
    "stop-color", "stop-opacity", "image-rendering", "shape-rendering", "vector-effect", "letter-spacing",
))  # fmt: skip
_REFERRING = frozenset(("fill", "stroke", "clip-path"))
_PLACES = re.compile(r"[A-Za-z0-9 .,+()%-]*")
_WORDS = re.compile(r"[A-Za-z0-9 .,+%#-]*|rgba?\([0-9 .,%/]*\)")
_URL = re.compile(r"url\(\s*['\"]?#([^'\"()]+)['\"]?\s*\)")
_STYLE_OF_ALL = re.compile(r"\s*\*\s*\{([^{}]*)\}\s*")
_DATA_URL = re.compile(r"data:image/(?:png|jpe?g);base64,([A-Za-z0-9+/=\s]*)")
_LENGTH = re.compile(r"\s*([0-9.]+(?:[eE][-+]?[0-9]+)?)\s*(px|pt|pc|in|cm|mm)?\s*")
_PX_PER = {"px": 1.0, "pt": 96 / 72, "pc": 16.0, "in": 96.0, "cm": 96 / 2.54, "mm": 96 / 25.4, "": 1.0}
_MAX_SIDE_PX = 100_000.0

# Colours without meaning, which follow the page into the dark: those of `calib.figures.style` and of matplotlib itself.
_NEUTRAL = {
    "#1a1a1a": "ink", "#262626": "ink", "#000000": "ink", "#000": "ink", "black": "ink",
    "#6b6b6b": "grey", "#7f7f7f": "grey", "#808080": "grey", "grey": "grey", "gray": "grey",
    "#b0b0b0": "faint", "#bdbdbd": "faint", "#cccccc": "faint",
    "#e4e4e4": "empty", "#ffffff": "paper", "#fff": "paper", "white": "paper",
}  # fmt: skip


@dataclass(frozen=True)
class _Place:
    """What an element must know of those around it."""

    matrix: Matrix = IDENTITY
    is_defining: bool = False
    has_fill: bool = False  # of an element around it


@dataclass(frozen=True)
class _Kept:
    """What of the whole drawing its elements are judged by."""

    names: dict[str, str]  # new ids of what may be referred to, by the old
    pictures: Pictures
    view: tuple[float, float, float, float]  # x, y, width, height


def drawing_of_svg(svg: bytes) -> Drawing:
    """A drawing that is safe inside a page, wherever the SVG comes from.

    Only what stands in definitions may be referred to, and nothing in there refers on: no chain of references grows.
    What lies on an embedded picture keeps its colours, as they were chosen for that picture.

    Raises:
        ValueError: no SVG, without a size, or beyond bounds.
    """
    root = parse_svg(svg)
    view, width_px, height_px = _size(root)
    prefix = f"d{hashlib.sha256(svg).hexdigest()[:12]}-"
    names = {name: f"{prefix}{count}" for count, name in enumerate(_definitions(root))}
    kept = _Kept(names, pictures_in(root), view)
    inside = "".join(_markup(child, _Place(), kept) for child in root.children)
    looks = _attributes({name: value for name, value in _root_looks(root).items() if name not in _REFERRING})
    box = " ".join(f"{value:g}" for value in view)
    head = f'<svg class="drawing" viewBox="{box}" width="{width_px:g}" height="{height_px:g}" focusable="false"{looks}>'
    return Drawing(f"{head}{inside}</svg>", width_px, height_px)


def _size(root: Element) -> tuple[tuple[float, float, float, float], float, float]:
    """The view box, and width and height in CSS pixels."""
    sides = [_length_px(root.attributes.get(name, "")) for name in ("width", "height")]
    values = numbers_in(root.attributes.get("viewBox", ""))
    view = (values[0], values[1], values[2], values[3]) if len(values) == 4 else (0.0, 0.0, sides[0], sides[1])
    width_px, height_px = (round(side or length, 2) for side, length in zip(sides, view[2:], strict=True))
    if not all(0 < side <= _MAX_SIDE_PX for side in (*view[2:], width_px, height_px)):
        raise ValueError(f"drawing: no size, or one beyond {_MAX_SIDE_PX:g} px")
    return view, width_px, height_px


def _length_px(text: str) -> float:
    """A length in CSS pixels; 0 where it is none, as of percent."""
    found = _LENGTH.fullmatch(text)
    return float(found[1]) * _PX_PER[found[2] or ""] if found else 0.0


def _definitions(root: Element) -> Iterator[str]:
    """The ids within definitions, each once."""
    seen: set[str] = set()
    waiting = [(root, False)]
    while waiting:
        element, is_defining = waiting.pop()
        inner = is_defining or element.name in _DEFINING
        name = element.attributes.get("id", "")
        if inner and name and name not in seen and element.name in _ELEMENTS:
            seen.add(name)
            yield name
        waiting.extend((child, inner) for child in reversed(element.children))


def _root_looks(root: Element) -> dict[str, str]:
    """What holds for all: the root's own looks, and matplotlib's one style sheet, `* {...}`."""
    looks = _looks(root)
    waiting = list(root.children)
    while waiting:
        element = waiting.pop()
        if element.name == "style" and (rule := _STYLE_OF_ALL.fullmatch(element.text)):
            looks |= _declarations(rule[1])
        elif element.name in _CONTAINERS:
            waiting.extend(element.children)
    return looks


def _markup(element: Element, around: _Place, kept: _Kept) -> str:
    """An element with all inside it, or nothing where it is not on the list."""
    if element.name not in _ELEMENTS or _is_backdrop(element, kept.view):
        return ""
    looks = _looks(element)
    place = replace(
        around,
        matrix=product(around.matrix, transform_of(element)),
        is_defining=around.is_defining or element.name in _DEFINING,
        has_fill=around.has_fill or "fill" in looks,
    )
    given = sorted(_GEOMETRY & element.attributes.keys())
    own = {name: value for name in given if (value := _safe(element.attributes[name], _PLACES))}
    if (name := kept.names.get(element.attributes.get("id", ""))) and place.is_defining:
        own["id"] = name
    if element.name in {"use", "image"}:
        target = _target(element, place, kept)
        if not target:
            return ""
        own["href"] = target
    own |= _coloured(_resolved(looks, place, kept), element, place, kept)
    inside = _inside(element, place, kept) if element.name in _CONTAINERS else ""
    if element.name in {"g", "defs"} and not inside:
        return ""
    return f"<{element.name}{_attributes(own)}>{inside}</{element.name}>"


def _inside(element: Element, place: _Place, kept: _Kept) -> str:
    """The children, and the words of texts."""
    children = [_markup(child, place, kept) for child in element.children]
    if element.name not in {"text", "tspan"}:
        return "".join(children)
    words = [escape(text) for text in element.texts]
    return "".join(part for pair in zip(words, [*children, ""], strict=False) for part in pair)


def _is_backdrop(element: Element, view: tuple[float, float, float, float]) -> bool:
    """Whether an element is the white behind everything, which the page has already."""
    if element.name != "path" or _NEUTRAL.get(_looks(element).get("fill", "").lower()) != "paper":
        return False
    points = path_points(element)
    if not points:
        return False
    xs, ys = zip(*points, strict=True)
    found = (min(xs), min(ys), max(xs) - min(xs), max(ys) - min(ys))
    return all(abs(a - b) < 1 for a, b in zip(found, view, strict=True))


def _looks(element: Element) -> dict[str, str]:
    """Presentation attributes, those in a style attribute before the others (CSS Cascade 4, section 6.1)."""
    plain = {name: element.attributes[name].strip() for name in _LOOKS if name in element.attributes}
    return plain | _declarations(element.attributes.get("style", ""))


def _declarations(style: str) -> dict[str, str]:
    """The declarations of a style that are on the list."""
    pairs = (declaration.partition(":") for declaration in style.split(";"))
    return {name.strip(): value.strip() for name, _, value in pairs if name.strip() in _LOOKS}


def _safe(value: str, pattern: re.Pattern[str]) -> str:
    """A value of plain words and numbers, or nothing."""
    plain = " ".join(value.split())
    return plain if pattern.fullmatch(plain) else ""


def _resolved(looks: dict[str, str], place: _Place, kept: _Kept) -> dict[str, str]:
    """The looks with references into this drawing alone; a colour that refers elsewhere becomes none."""
    resolved: dict[str, str] = {}
    for name, value in sorted(looks.items()):
        if name in _REFERRING and "url" in value.lower():
            found = _URL.fullmatch(value)
            target = kept.names.get(found[1]) if found and not place.is_defining else None
            if target:
                resolved[name] = f"url(#{target})"
            elif name != "clip-path":
                resolved[name] = "none"
        elif plain := _safe(value, _WORDS):
            resolved[name] = plain
    return resolved


def _coloured(looks: dict[str, str], element: Element, place: _Place, kept: _Kept) -> dict[str, str]:
    """The looks with classes in place of colours that mean nothing, unless they lie on a picture."""
    if kept.pictures.carry(element, place.matrix):
        return looks if place.has_fill or element.name != "text" else looks | {"fill": "#000000"}
    classes = [
        f"{name}-{_NEUTRAL[looks[name].lower()]}"
        for name in ("fill", "stroke")
        if looks.get(name, "").lower() in _NEUTRAL
    ]
    if not classes:
        return looks
    rest = {
        name: value for name, value in looks.items() if name not in {"fill", "stroke"} or value.lower() not in _NEUTRAL
    }
    return {"class": " ".join(classes)} | rest


def _target(element: Element, place: _Place, kept: _Kept) -> str | None:
    """What a `use` or `image` may show: a definition of the drawing, or pixels inside it."""
    reference = element.attributes.get("href") or element.attributes.get(XLINK_HREF, "")
    if element.name == "use":
        name = kept.names.get(reference[1:]) if reference.startswith("#") and not place.is_defining else None
        return f"#{name}" if name else None
    found = _DATA_URL.fullmatch(reference.strip())
    if not found:
        return None
    try:
        content = base64.b64decode("".join(found[1].split()), validate=True)
        return f"data:{media_type(content)};base64,{base64.b64encode(content).decode()}"
    except (binascii.Error, ValueError):
        return None


def _attributes(values: dict[str, str]) -> str:
    """Attributes as markup."""
    return "".join(f' {name}="{escape(value)}"' for name, value in values.items())
