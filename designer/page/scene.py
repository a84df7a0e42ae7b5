"""What a 3D view shows: layers of plain arrays in millimetres, which the page's viewer draws."""

import base64
import json
import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import TypeAlias

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class Surface:
    """Flat triangles of one colour, seen from both sides."""

    vertices_mm: Array  # (N, 3)
    triangles: NDArray[np.int64]  # (T, 3) rows of `vertices_mm`
    colour: str  # "#rrggbb"


@dataclass(frozen=True, eq=False)
class Rings:
    """Flat rings and discs, each in a plane of its own."""

    center_mm: Array  # (R, 3)
    normal: Array  # (R, 3) unit, outwards
    radius_outer_mm: Array  # (R,)
    radius_inner_mm: Array  # (R,) 0: a disc
    colours: tuple[str, ...]  # (R,) "#rrggbb", or one for all
    names: tuple[str, ...] = ()  # (R,) said when one is pointed at; (): nothing is said


@dataclass(frozen=True, eq=False)
class Segments:
    """Straight lines."""

    ends_mm: Array  # (L, 2, 3)
    colours: tuple[str, ...]  # (L,) or one for all


@dataclass(frozen=True, eq=False)
class Cameras:
    """Pyramids of camera views: the apex is the camera's centre, the base what it sees."""

    target_from_cam: Array  # (V, 4, 4)
    corner_rays: Array  # (4, 3) through the image's corners, clockwise from the top left, in the camera's frame, z = 1
    size_mm: float  # depth of the pyramids
    colours: tuple[str, ...]  # (V,) or one for all
    names: tuple[str, ...]  # (V,) said when one is pointed at


@dataclass(frozen=True, eq=False)
class Labels:
    """Words that face the viewer, hidden while their normal points away."""

    position_mm: Array  # (N, 3)
    normal: Array  # (N, 3) unit
    texts: tuple[str, ...]  # (N,)
    size_mm: float  # height of a letter


Shape: TypeAlias = Surface | Rings | Segments | Cameras | Labels


@dataclass(frozen=True, eq=False)
class Layer:
    """Shapes that are shown and hidden together."""

    name: str  # beside its switch
    shapes: tuple[Shape, ...]
    is_shown: bool = True
    has_switch: bool = True


@dataclass(frozen=True, eq=False)
class Scene:
    """All layers, in one frame."""

    layers: tuple[Layer, ...]
    up: tuple[float, float, float]  # drawn upwards at first
    from_direction: tuple[float, float, float]  # from the middle towards where the viewer stands at first
    legend: tuple[tuple[str, str], ...] = ()  # colour "#rrggbb" and what it means


JsonValue: TypeAlias = "str | int | float | bool | Sequence[JsonValue] | Mapping[str, JsonValue] | None"
JsonObject: TypeAlias = Mapping[str, JsonValue]

_COLOUR = re.compile(r"#[0-9a-fA-F]{6}")
_MARKUP = {character: f"\\u{ord(character):04x}" for character in "<>&"}
UNIT_TOLERANCE = 1e-3
"""A normal may be off its length of 1 by this: it only points."""


def scene_json(scene: Scene) -> str:
    """The scene as ASCII JSON without `<`, `>` and `&`, the same for the same scene.

    An array is an object of `type` (f4, u2 or u4, little-endian), `shape` and base64 `data`.

    Raises:
        ValueError: an array of the wrong shape, a number that is not finite in single precision, a colour that
            is not "#rrggbb", a normal that is no unit vector, or triangles and radii that make no sense.
    """
    document: JsonObject = {
        "up": _direction("up", scene.up),
        "from": _direction("from_direction", scene.from_direction),
        "legend": [[_colour("legend", colour), text] for colour, text in scene.legend],
        "layers": [_layer(layer) for layer in scene.layers],
    }
    text = json.dumps(document, separators=(",", ":"), ensure_ascii=True, allow_nan=False)
    return "".join(_MARKUP.get(character, character) for character in text)


def _layer(layer: Layer) -> JsonObject:
    where = f"layer {layer.name!r}"
    return {
        "name": layer.name,
        "shown": layer.is_shown,
        "switch": layer.has_switch,
        "shapes": [_shape(shape, where) for shape in layer.shapes],
    }


def _shape(shape: Shape, where: str) -> JsonObject:
    """A shape with its kind, checked."""
    if isinstance(shape, Surface):
        return _surface(shape, f"{where}, surface")
    if isinstance(shape, Rings):
        return _rings(shape, f"{where}, rings")
    if isinstance(shape, Segments):
        return _segments(shape, f"{where}, segments")
    if isinstance(shape, Cameras):
        return _cameras(shape, f"{where}, cameras")
    return _labels(shape, f"{where}, labels")


def _surface(shape: Surface, where: str) -> JsonObject:
    vertices = _floats(f"{where}: vertices_mm", shape.vertices_mm, (None, 3))
    triangles = np.asarray(shape.triangles)
    if triangles.ndim != 2 or triangles.shape[1] != 3 or triangles.dtype.kind not in "iu":
        raise ValueError(f"{where}: triangles must be whole numbers of shape (T, 3), not {_described(triangles)}")
    if triangles.size and not 0 <= triangles.min() <= triangles.max() < len(vertices):
        raise ValueError(f"{where}: triangles must name vertices 0..{len(vertices) - 1}")
    return {
        "kind": "surface",
        "vertices": _packed(vertices),
        "triangles": _packed(_smallest(triangles)),
        "colour": _colour(where, shape.colour),
    }


def _rings(shape: Rings, where: str) -> JsonObject:
    center = _floats(f"{where}: center_mm", shape.center_mm, (None, 3))
    count = len(center)
    outer = _floats(f"{where}: radius_outer_mm", shape.radius_outer_mm, (count,))
    inner = _floats(f"{where}: radius_inner_mm", shape.radius_inner_mm, (count,))
    if not ((inner >= 0) & (inner < outer)).all():
        raise ValueError(f"{where}: radius_inner_mm must be at least 0 and less than radius_outer_mm")
    if shape.names and len(shape.names) != count:
        raise ValueError(f"{where}: {len(shape.names)} names for {count} rings; give one each, or none")
    return {
        "kind": "rings",
        "center": _packed(center),
        "normal": _packed(_unit(f"{where}: normal", shape.normal, count)),
        "outer": _packed(outer),
        "inner": _packed(inner),
        "colours": _colours(where, shape.colours, count),
        "names": list(shape.names),
    }


def _segments(shape: Segments, where: str) -> JsonObject:
    ends = _floats(f"{where}: ends_mm", shape.ends_mm, (None, 2, 3))
    return {"kind": "segments", "ends": _packed(ends), "colours": _colours(where, shape.colours, len(ends))}


def _cameras(shape: Cameras, where: str) -> JsonObject:
    poses = _floats(f"{where}: target_from_cam", shape.target_from_cam, (None, 4, 4))
    if len(shape.names) != len(poses):
        raise ValueError(f"{where}: {len(shape.names)} names for {len(poses)} cameras; give one each")
    return {
        "kind": "cameras",
        "poses": _packed(poses),
        "rays": _packed(_floats(f"{where}: corner_rays", shape.corner_rays, (4, 3))),
        "size": _length(f"{where}: size_mm", shape.size_mm),
        "colours": _colours(where, shape.colours, len(poses)),
        "names": list(shape.names),
    }


def _labels(shape: Labels, where: str) -> JsonObject:
    position = _floats(f"{where}: position_mm", shape.position_mm, (None, 3))
    if len(shape.texts) != len(position):
        raise ValueError(f"{where}: {len(shape.texts)} texts for {len(position)} positions; give one each")
    return {
        "kind": "labels",
        "position": _packed(position),
        "normal": _packed(_unit(f"{where}: normal", shape.normal, len(position))),
        "texts": list(shape.texts),
        "size": _length(f"{where}: size_mm", shape.size_mm),
    }


def _described(array: NDArray[np.generic]) -> str:
    return f"{array.dtype} of shape {array.shape}"


def _floats(what: str, values: object, shape: tuple[int | None, ...]) -> NDArray[np.float32]:
    """Numbers in single precision; None in `shape` stands for any length."""
    array = np.asarray(values)
    fits = array.ndim == len(shape) and all(n in (None, m) for n, m in zip(shape, array.shape, strict=True))
    if not fits or array.dtype.kind not in "fiu":
        wanted = ", ".join("any" if n is None else str(n) for n in shape)
        raise ValueError(f"{what} must be numbers of shape ({wanted}), not {_described(array)}")
    with np.errstate(over="ignore", under="ignore", invalid="ignore"):
        single = array.astype("<f4")
    if not np.isfinite(single).all():
        raise ValueError(f"{what} holds a number that is not finite, or too large to draw")
    return single


def _unit(what: str, values: object, count: int) -> NDArray[np.float32]:
    """One unit vector each."""
    normals = _floats(what, values, (count, 3))
    if normals.size and np.abs(np.linalg.norm(normals.astype(np.float64), axis=1) - 1).max() > UNIT_TOLERANCE:
        raise ValueError(f"{what} must hold unit vectors")
    return normals


def _direction(what: str, values: tuple[float, float, float]) -> list[float]:
    """Any vector but zero, as plain numbers."""
    direction = _floats(what, values, (3,))
    if not direction.any():
        raise ValueError(f"{what} must be a direction, not (0, 0, 0)")
    return [float(x) for x in values]


def _length(what: str, value: float) -> float:
    """A length above 0."""
    if not _floats(what, value, ()) > 0:
        raise ValueError(f"{what} is {value:g}; it must be above 0")
    return float(value)


def _colour(where: str, colour: str) -> str:
    if not _COLOUR.fullmatch(colour):
        raise ValueError(f'{where}: the colour {colour!r} must be written "#rrggbb"')
    return colour.lower()


def _colours(where: str, colours: tuple[str, ...], count: int) -> JsonObject:
    """The different colours in order of appearance, and which one each thing has."""
    if len(colours) not in (1, count):
        raise ValueError(f"{where}: {len(colours)} colours for {count} things; give one each, or one for all")
    row: dict[str, int] = {}
    index = [row.setdefault(_colour(where, colour), len(row)) for colour in colours]
    each = np.asarray(index if len(index) == count else index * count, dtype=np.int64)
    return {"palette": list(row), "index": _packed(_smallest(each))}


def _smallest(whole: NDArray[np.integer]) -> NDArray[np.unsignedinteger]:
    """Whole numbers in 16 bits where they fit, in 32 otherwise."""
    return whole.astype("<u2" if not whole.size or int(whole.max()) < 2**16 else "<u4")


def _packed(array: NDArray[np.generic]) -> JsonObject:
    return {
        "type": array.dtype.str[1:],
        "shape": list(array.shape),
        "data": base64.b64encode(array.tobytes()).decode("ascii"),
    }
