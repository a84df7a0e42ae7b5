"""Two solutions of one rig compared: how cameras stand to each other, and where the two place the same points.

Points all over the volume that the first rig works in are seen by it; the second places them by the same pixels. Then
the two frames are laid over each other, so that what differs is of the rigs and not of whose frame they have.
"""

from dataclasses import dataclass
from itertools import combinations

import numpy as np

from calib.cameras.rig import Rig, keep_cameras
from calib.core.se3 import compose, invert, log_rotation, make_pose, transform
from calib.rigs.relative import relative
from calib.space.sightings import PointSightings
from calib.space.triangulate import triangulate_points
from calib.space.volume import default_volume, seen_by_cameras
from designer.base.arrays import Array, Flags
from designer.base.errors import InputError
from designer.base.marks import Gap

LATTICE = (16, 12, 12)
FEWEST = 10
"""Points from which something can be told."""


@dataclass(frozen=True)
class PairDifference:
    """What differs between two rigs of how camera b stands to camera a."""

    a: str
    b: str
    baseline_mm: tuple[float, float]  # in the first rig, and in the second
    baseline_sigma_mm: Gap  # of the difference, if the two are independent; nan: one of them does not know
    place_mm: float  # of b's centre in a's frame
    turn_rad: float  # of b's rotation against a's


@dataclass(frozen=True)
class CameraApart:
    """How far apart the two rigs see the same points in one camera; nan where they show none."""

    name: str
    rms_px: Gap
    max_px: Gap


@dataclass(frozen=True)
class PlacedApart:
    """How far apart two rigs place the points of a volume, their frames laid over each other."""

    volume: str  # in words
    points: int
    rms_mm: float
    max_mm: float
    scale: float  # by which lengths of the second are longer, less 1
    cameras: tuple[CameraApart, ...]


@dataclass(frozen=True)
class RigDifference:
    """What differs between two rigs of the same cameras, which are known by their names."""

    cameras: tuple[str, ...]  # of both
    only: tuple[tuple[str, ...], tuple[str, ...]]  # cameras of the first alone, and of the second
    pairs: tuple[PairDifference, ...]
    placed: PlacedApart | None  # None: no two cameras see the same points


def compare_rigs(first: Rig, second: Rig) -> RigDifference:
    """What differs from one rig to another.

    Raises:
        InputError: they share no two cameras, or one that has another image size.
    """
    names = tuple(name for name in first.names if name in second.names)
    if len(names) < 2:
        raise InputError(
            f"of cameras {', '.join(first.names)} and {', '.join(second.names)} not two have the same names; "
            "give two rigs of the same cameras"
        )
    both = (
        keep_cameras(first, [first.row(name) for name in names]),
        keep_cameras(second, [second.row(n) for n in names]),
    )
    for name, a, b in zip(names, both[0].cameras, both[1].cameras, strict=True):
        if a.image_size != b.image_size:
            sizes = " and ".join(f"{one.image_size[0]} x {one.image_size[1]} px" for one in (a, b))
            raise InputError(f"camera {name}: has images of {sizes}; give two rigs of the same cameras")
    only = tuple(tuple(name for name in rig.names if name not in names) for rig in (first, second))
    pairs = tuple(_pair(*both, a, b) for a, b in combinations(range(len(names)), 2))
    return RigDifference(names, (only[0], only[1]), pairs, _placed(*both))


def _pair(first: Rig, second: Rig, a: int, b: int) -> PairDifference:
    one, other = relative(first, a, b), relative(second, a, b)
    centers = [invert(pair.b_from_a)[:3, 3] for pair in (one, other)]
    turn = log_rotation(other.b_from_a[:3, :3] @ one.b_from_a[:3, :3].T)
    return PairDifference(
        first.names[a], first.names[b], (one.baseline_mm, other.baseline_mm),
        float(np.hypot(one.baseline_sigma_mm, other.baseline_sigma_mm)),
        float(np.linalg.norm(centers[1] - centers[0])), float(np.linalg.norm(turn)),
    )  # fmt: skip


def _placed(first: Rig, second: Rig) -> PlacedApart | None:
    """Where the second rig places what the first sees."""
    try:
        volume = default_volume(first, 2)
    except InputError:
        return None
    point = volume.lattice(LATTICE)
    point = point[volume.holds(point)]
    seen = seen_by_cameras(first, point)
    point, seen = point[seen.sum(axis=1) >= 2], seen[seen.sum(axis=1) >= 2]
    found = _placed_by(first, second, point, seen)
    is_placed = np.isfinite(found).all(axis=1)
    point, found, seen = point[is_placed], found[is_placed], seen[is_placed]
    if len(point) < FEWEST:
        return None
    second_from_first = _laid_over(point, found)
    off = found - transform(second_from_first, point)
    spread = [np.linalg.norm(one - one.mean(axis=0)) for one in (point, found)]
    distance = np.linalg.norm(off, axis=1)
    return PlacedApart(
        volume.words, len(point), float(np.sqrt(np.mean(distance**2))), float(distance.max()),
        float(spread[1] / spread[0] - 1), _apart_px(first, second, second_from_first, point, seen),
    )  # fmt: skip


def _placed_by(first: Rig, second: Rig, point: Array, seen: Flags) -> Array:
    """Where the second rig sees points (N, 3) in the pixels of the first; nan where it does not.  # (N, 3)"""
    place, camera = np.nonzero(seen)
    pixel = np.empty((len(place), 2))
    for row, (one, pose) in enumerate(zip(first.cameras, first.cam_from_rig, strict=True)):
        pixel[camera == row] = one.project(transform(pose, point[place[camera == row]]))
    rows = np.arange(len(point))
    sightings = PointSightings(
        ("lattice",), tuple(map(str, rows.tolist())), np.zeros_like(rows), rows, camera, place, pixel
    )
    return triangulate_points(second, sightings, np.ones(len(second.names))).position_mm


def _laid_over(point: Array, found: Array) -> Array:
    """The rigid motion (4, 4) that takes points (N, 3) nearest to others (Kabsch 1976)."""
    middle, other = point.mean(axis=0), found.mean(axis=0)
    left, _, right = np.linalg.svd((found - other).T @ (point - middle))
    turn = left @ np.diag([1.0, 1.0, np.linalg.det(left @ right)]) @ right
    return make_pose(turn, other - turn @ middle)


def _apart_px(first: Rig, second: Rig, second_from_first: Array, point: Array, seen: Flags) -> tuple[CameraApart, ...]:
    """How far apart the rigs see points (N, 3) of the first's frame, camera by camera."""
    result = []
    for row, name in enumerate(first.names):
        shown = point[seen[:, row]]
        one = first.cameras[row].project(transform(first.cam_from_rig[row], shown))
        pose = compose(second.cam_from_rig[row], second_from_first)
        off = np.linalg.norm(second.cameras[row].project(transform(pose, shown)) - one, axis=1)
        off = off[np.isfinite(off)]
        rms, most = (float(np.sqrt(np.mean(off**2))), float(off.max())) if len(off) else (np.nan, np.nan)
        result.append(CameraApart(name, rms, most))
    return tuple(result)
