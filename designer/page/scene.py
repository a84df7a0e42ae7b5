"""What a 3D view shows: layers of plain arrays in millimetres, and their text for the page's viewer."""

import base64
import json
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, fields
from typing import Annotated, TypeAlias

import numpy as np
from numpy.typing import NDArray

from designer.base.arrays import Array, Rows
from designer.base.marks import Shape, Tagged

JsonValue: TypeAlias = "str | int | float | bool | Sequence[JsonValue] | Mapping[str, JsonValue] | None"
JsonObject: TypeAlias = Mapping[str, JsonValue]

MARKUP = {character: f"\\u{ord(character):04x}" for character in "<>&"}


@dataclass(frozen=True, eq=False)
class Surface(Tagged):
    """Flat triangles of one colour, seen from both sides."""

    vertices_mm: Annotated[Array, Shape("N", 3)]
    triangles: Annotated[Rows, Shape("T", 3)]  # rows of `vertices_mm`
    colour: str  # "#rrggbb"


@dataclass(frozen=True, eq=False)
class Rings(Tagged):
    """Flat rings and discs, each in a plane of its own."""

    center_mm: Annotated[Array, Shape("R", 3)]
    normal: Annotated[Array, Shape("R", 3)]  # unit, outwards
    radius_outer_mm: Annotated[Array, Shape("R")]
    radius_inner_mm: Annotated[Array, Shape("R")]  # 0: a disc
    colours: tuple[str, ...]  # (R,) "#rrggbb", or one for all
    names: tuple[str, ...] = ()  # (R,) said when one is pointed at; (): nothing is said


@dataclass(frozen=True, eq=False)
class Segments(Tagged):
    """Straight lines."""

    ends_mm: Annotated[Array, Shape("L", 2, 3)]
    colours: tuple[str, ...]  # (L,) or one for all


@dataclass(frozen=True, eq=False)
class Cameras(Tagged):
    """Pyramids and domes of camera views: the apex is the camera's centre, the base what it sees.

    A view is rows of points in the camera's frame, from the middle of the image to its border, each clockwise from the
    top left. A pyramid is one row, its four corners; a dome has several, of a multiple of four.
    """

    target_from_cam: Annotated[Array, Shape("V", 4, 4)]
    view: Annotated[Array, Shape("R", "S", 3)]  # in units of `size_mm`
    size_mm: float  # depth of the pyramids, radius of the domes
    colours: tuple[str, ...]  # (V,) or one for all
    names: tuple[str, ...]  # (V,) said when one is pointed at


@dataclass(frozen=True, eq=False)
class Labels(Tagged):
    """Words that face the viewer, hidden while their normal points away."""

    position_mm: Annotated[Array, Shape("N", 3)]
    normal: Annotated[Array, Shape("N", 3)]  # unit
    texts: tuple[str, ...]  # (N,)
    size_mm: float  # height of a letter


Drawn: TypeAlias = Surface | Rings | Segments | Cameras | Labels


@dataclass(frozen=True, eq=False)
class Layer:
    """Shapes that are shown and hidden together."""

    name: str  # beside its switch
    shapes: tuple[Drawn, ...]
    is_shown: bool = True
    has_switch: bool = True


@dataclass(frozen=True, eq=False)
class Scene:
    """All layers, in one frame."""

    layers: tuple[Layer, ...]
    up: tuple[float, float, float]  # drawn upwards at first
    from_direction: tuple[float, float, float]  # from the middle towards where the viewer stands at first
    legend: tuple[tuple[str, str], ...] = ()  # colour "#rrggbb" and what it means


def scene_json(scene: Scene) -> str:
    """The scene as ASCII JSON without `<`, `>` and `&`, the same for the same scene.

    A shape is an object with its fields; an array is one of `type` (f4, u2 or u4, little-endian), `shape` and base64
    `data`; colours are a palette and the row of each thing in it.

    Raises:
        ValueError: a number that is not finite in single precision, or neither one colour for all nor one each.
    """
    document: JsonObject = {
        "up": scene.up,
        "from": scene.from_direction,
        "legend": scene.legend,
        "layers": [
            {"name": one.name, "shown": one.is_shown, "switch": one.has_switch, "shapes": [*map(_shape, one.shapes)]}
            for one in scene.layers
        ],
    }
    text = json.dumps(document, separators=(",", ":"), ensure_ascii=True, allow_nan=False)
    return "".join(MARKUP.get(character, character) for character in text)


def _shape(shape: Drawn) -> JsonObject:
    """A shape's kind and fields."""
    values = {field.name: getattr(shape, field.name) for field in fields(shape)}
    count = len(next(iter(values.values())))
    return {
        "kind": type(shape).__name__.lower(),
        **{name: _colours(value, count) if name == "colours" else _plain(value) for name, value in values.items()},
    }


def _plain(value: "Array | JsonValue") -> JsonValue:
    return _packed(value) if isinstance(value, np.ndarray) else value


def _colours(colours: Sequence[str], count: int) -> JsonObject:
    """The different colours in order of appearance, and which one each thing has."""
    if len(colours) not in (1, count):
        raise ValueError(f"{len(colours)} colours for {count} things; give one each, or one for all")
    row = {colour: number for number, colour in enumerate(dict.fromkeys(colours))}
    index = [row[colour] for colour in colours]
    return {"palette": list(row), "index": _packed(np.asarray(index if len(index) == count else index * count, int))}


def _packed(array: NDArray[np.generic]) -> JsonObject:
    """Whole numbers in 16 bits where they fit, in 32 otherwise; others in single precision."""
    if array.dtype.kind in "iu":
        packed = array.astype("<u2" if not array.size or array.max() < 2**16 else "<u4")
    else:
        with np.errstate(over="ignore"):
            packed = array.astype("<f4")
        if not np.isfinite(packed).all():
            raise ValueError("a scene holds a number that is not finite, or too large to draw")
    data = base64.b64encode(packed.tobytes()).decode("ascii")
    return {"type": packed.dtype.str[1:], "shape": list(packed.shape), "data": data}
