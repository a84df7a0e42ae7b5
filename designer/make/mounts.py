"""What a solid in tiles is held by: a post that is glued into a pit at one of the core's corners.

Only the tiles' tips are cut away for it, within border and white, so no ring is lost. A post for a screw holds a
captive nut: it bears a tripod's torque for years, where a thread in plastic wears, and prints in any direction.
A post's frame has z outwards along the corner's axis and its origin at the solid's centroid.
"""

import math
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from manifold3d import CrossSection, Manifold

from designer.base.errors import InputError
from designer.base.solid import Solid
from designer.kinds.layout import corner_room_mm
from designer.make.core import SOCKET_WALL_MM, Socket, mount_vertex
from designer.make.mesh import cone, cylinder, union
from designer.make.tile import TileSizes, key_places, pad_places
from designer.spec.build import STEM_MM, mount_room_mm
from designer.target import TargetGeometry

DEFAULT_MOUNT = "1/4-20"
HEAD_ABOVE_MM = 1.0
"""Of a post above the corner of the solid: a tripod's plate then touches the post alone."""
NUT_WALL_MM = 1.6
"""Between nut and head: a tripod's screw reaches 5.5 mm at most (ISO 1222), and two lines each way hold the nut."""
POST_WALL_MM = 1.2
FIT_MM = 0.2
"""Added to a bought part's size, over both sides."""
LEAST_ENGAGED_MM, USUAL_ENGAGED_MM = 10.0, 12.0
"""Of a stem in its pit."""
PIT_SHARE = 0.65
"""Of the way from the core's surface to its middle, how much a pit and its wall may take."""
ROD_MM, ROD_DEPTH_MM = 8.0, 20.0
FLANGE_NECK_MM = 20.0
FLANGE_MM = 8.0
CENTRING_MM = 3.0
SCREW_HEAD_MM = 11.0
"""Of an M6 cap screw (10 mm, ISO 4762), and room around it."""


@dataclass(frozen=True)
class Mount:
    """A way to hold a target."""

    name: str
    title: str
    build: Callable[["PostSizes"], Manifold]
    needs: str  # what to buy
    up_is_in: bool  # printed with the end that goes into the pit up
    source: str  # sizes of what is bought, and the standard that has them
    how: str  # to put it in, or on

    @property
    def stem_mm(self) -> float:
        """Diameter of the post in its pit."""
        return STEM_MM[self.name]


@dataclass(frozen=True)
class PostSizes:
    """Lengths along the axis, from the centroid."""

    radius_mm: float
    bottom_mm: float
    head_mm: float


def _with_nut(across_mm: float, bore_mm: float) -> Callable[[PostSizes], Manifold]:
    """A stem with a hexagonal pocket from the inner end to the wall below the head."""

    def build(post: PostSizes) -> Manifold:
        radius = (across_mm + FIT_MM) / math.sqrt(3)
        turn = np.pi / 3 * np.arange(6)
        hexagon = CrossSection([radius * np.stack([np.cos(turn), np.sin(turn)], axis=1)])
        pocket = Manifold.extrude(hexagon, post.head_mm - NUT_WALL_MM - post.bottom_mm + 1.0)
        stem = cylinder(post.radius_mm, post.bottom_mm, post.head_mm)
        bore = cylinder((bore_mm + 2 * FIT_MM) / 2, post.bottom_mm, post.head_mm + 1.0)
        return stem - pocket.translate((0.0, 0.0, post.bottom_mm - 1.0)) - bore

    return build


def _for_rod(post: PostSizes) -> Manifold:
    """A stem with a bore from outside."""
    low = max(post.head_mm - ROD_DEPTH_MM, post.bottom_mm + POST_WALL_MM)
    bore = cylinder((ROD_MM + FIT_MM) / 2, low, post.head_mm + 1.0)
    return cylinder(post.radius_mm, post.bottom_mm, post.head_mm) - bore


def _flange(post: PostSizes) -> Manifold:
    """A flange for ISO 9409-1-50-4-M6: 63 mm across, four screws on 50 mm, a centring boss for the 31.5 mm recess."""
    outer, start = 31.5, post.head_mm + FLANGE_NECK_MM
    flare = outer - post.radius_mm
    top = start + flare + FLANGE_MM
    body = [
        cylinder(post.radius_mm, post.bottom_mm, start),
        cone(post.radius_mm, outer, flare).translate((0.0, 0.0, start)),
        cylinder(outer, start + flare, top),
        cylinder((31.5 - FIT_MM) / 2, top, top + CENTRING_MM),
    ]
    cuts = []
    for turn in np.radians([45, 135, 225, 315]).tolist():
        at = (25 * math.cos(turn), 25 * math.sin(turn))
        cuts.append(cylinder((6 + 3 * FIT_MM) / 2, start, top + 1.0, at))
        cuts.append(cylinder(SCREW_HEAD_MM / 2, start - 1.0, top - FLANGE_MM, at))
    return union(body) - union(cuts)


_NUT = (
    "Push the nut into the hexagonal pocket from the post's inner end, draw it in with a screw through the head until "
    "it lies flat on the wall there, and hold it by a drop of glue beside the thread."
)
MOUNTS: dict[str, Mount] = {
    mount.name: mount
    for mount in (
        Mount(
            "1/4-20", "a camera tripod's screw, 1/4-20 UNC", _with_nut(11.11, 6.35), "a hexagon nut 1/4-20 UNC",
            True, "7/16 inch (11.11 mm) across flats, 7/32 inch (5.56 mm) high by ASME B18.2.2; a tripod's screw, at "
            "most 5.5 mm long by ISO 1222, reaches it", _NUT,
        ),
        Mount(
            "m5", "an M5 screw", _with_nut(8.0, 5.0), "a hexagon nut M5", True,
            "8 mm across flats, 4.7 mm high by ISO 4032; the screw must reach 7 mm or more into the post", _NUT,
        ),
        Mount(
            "rod 8mm", "a rod of 8 mm, glued in", _for_rod, "a rod of 8 mm", False,
            "no standard: as its name says, with .2 mm of room",
            "Roughen the rod's end and glue it in as deep as it goes.",
        ),
        Mount(
            "iso9409-50", "a robot flange, ISO 9409-1-50-4-M6", _flange, "four screws M6 x 16", False,
            "cap screws by ISO 4762; 63 mm across, 4 x M6 on 50 mm, centring 31.5 mm by ISO 9409-1",
            "Its collar goes into the flange's recess; the screws' heads lie on the side of the target.",
        ),
    )
}  # fmt: skip
"""The ways to hold a target, by what `--mount` calls them."""


@dataclass(frozen=True)
class Mounted:
    """A mount in its place."""

    mount: Mount
    socket: Socket
    post: PostSizes
    cut_mm: float  # radius of what is cut off the tiles' tips

    def solid(self) -> Manifold:
        """The post, in its frame."""
        return self.mount.build(self.post)


def room_mm(target: TargetGeometry, solid: Solid) -> float:
    """How far from the axis of the mount's corner the first ring begins."""
    return corner_room_mm(target, solid.polyhedron.vertices[mount_vertex(solid.polyhedron)])


def seat_room_mm(target: TargetGeometry, solid: Solid, sizes: TileSizes) -> float:
    """How far from that axis the first pad or key of a seat begins."""
    vertex = mount_vertex(solid.polyhedron)
    axis = solid.polyhedron.vertices[vertex] / np.linalg.norm(solid.polyhedron.vertices[vertex])
    rooms = []
    for face in np.flatnonzero((solid.polyhedron.faces == vertex).any(axis=1)).tolist():
        frame, code = target.target_from_face[face], int(target.face_code[face])
        for places, radius in (
            (pad_places(sizes), sizes.pad_radius_mm),
            (key_places(sizes, code), sizes.key_hole_mm / 2),
        ):
            at = places @ frame[:3, :2].T + frame[:3, 3] - sizes.seat_depth_mm * frame[:3, 2]
            aside = np.linalg.norm(at - (at @ axis)[:, None] * axis, axis=1)
            rooms.append(float((aside - radius)[at @ axis > 0].min(initial=math.inf)))
    return min(rooms)


def mounted(name: str, target: TargetGeometry, solid: Solid, sizes: TileSizes) -> Mounted:
    """A mount on a solid.

    Raises:
        InputError: it needs more room than the rings or the core leave.
    """
    mount = MOUNTS[name]
    cut = mount.stem_mm / 2 + sizes.clearance_mm
    vertex = mount_vertex(solid.polyhedron)
    corner_mm = float(np.linalg.norm(solid.polyhedron.vertices[vertex])) * solid.edge_mm
    # The core's surface at the pit's rim lies below its corner.
    rise = solid.inradius_mm / corner_mm
    core_inradius = solid.inradius_mm - sizes.seat_depth_mm
    rim = (core_inradius - math.sqrt(1 - rise**2) * cut) / rise
    deepest = PIT_SHARE * rim - SOCKET_WALL_MM
    needs = (
        ("about a corner's axis, where rings leave", mount_room_mm(name, sizes.clearance_mm, sizes.line_mm),
         room_mm(target, solid)),
        ("about a corner's axis, where pads and keys of seats leave", cut, seat_room_mm(target, solid, sizes)),
        ("of depth in the core, which has room for", LEAST_ENGAGED_MM, deepest),
    )  # fmt: skip
    if any(needed > room for _, needed, room in needs):
        raise _too_large(mount, needs, target, solid, sizes)
    bottom = rim - min(max(USUAL_ENGAGED_MM, 0.9 * mount.stem_mm), deepest)
    return Mounted(
        mount,
        Socket(vertex, cut, bottom - sizes.layer_mm),
        PostSizes(mount.stem_mm / 2, bottom, corner_mm + HEAD_ABOVE_MM),
        cut,
    )


def _too_large(
    mount: Mount, needs: tuple[tuple[str, float, float], ...], target: TargetGeometry, solid: Solid, sizes: TileSizes
) -> InputError:
    """What a mount lacks most, and what to do: all rooms grow with the edge, some faster."""
    where, needed, room = max(needs, key=lambda need: need[1] / max(need[2], 0.1))
    edge = math.ceil(solid.edge_mm * min(needed / max(room, 0.1), 10.0) * 1.02)
    fitting = [one for one in MOUNTS if STEM_MM[one] < mount.stem_mm and fits(one, target, solid, sizes)]
    others = "".join(f"--mount {one!r}, " for one in fitting)
    margin = "a wider --margin, " if needs[0][1] > needs[0][2] else ""
    return InputError(
        f"mount {mount.name}: needs {needed:.1f}mm {where} {max(room, 0.0):.1f}mm; use {others}an edge of about "
        f"{edge}mm, {margin}or --mount none"
    )


def fits(name: str, target: TargetGeometry, solid: Solid, sizes: TileSizes) -> bool:
    """Whether a mount can be had."""
    try:
        mounted(name, target, solid, sizes)
    except InputError:
        return False
    return True
