"""What a 3D view shows: layers of plain arrays in millimetres, which the page's viewer draws."""

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
