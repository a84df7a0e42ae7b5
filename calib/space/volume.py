"""The volume that a rig works in: a box of its frame, or what enough of its cameras see between two distances."""

from dataclasses import dataclass
from typing import Annotated

import numpy as np

from calib.cameras.rig import Rig
from calib.core.linear_algebra import symmetric_inverse
from calib.core.se3 import invert, make_pose, transform
from calib.core.types import freeze
from calib.space.propagate import is_in_image, rays_in_rig
from designer.base.arrays import Array, Flags
from designer.base.errors import InputError
from designer.base.marks import Line, NullIs, Shape

TOGETHER = 0.5
"""Length of the mean of the optical axes from which cameras look the same way."""
CONVERGE = 0.02
"""Of the sum over the cameras of `sin^2` of their axes' angles; below, the axes meet nowhere that is well defined."""
AROUND, BALL = (0.5, 1.5), 0.25
"""Of the distance to where the axes meet: the distances of cameras that look the same way, the radius of others."""
BASELINES = (5.0, 25.0)
"""Distances of cameras whose axes do not meet, in mean distances between cameras."""
BORDER = (25, 19)
"""Columns and rows of pixels that tell how far a field reaches."""


@dataclass(frozen=True, eq=False)
class WorkingVolume:
    """A box in axes of its own, and within it distances from their origin."""

    rig_from_volume: Annotated[Array, Shape(4, 4)]
    low_mm: Annotated[Array, Shape(3)]
    high_mm: Annotated[Array, Shape(3)]
    near_mm: float  # 0: a box
    far_mm: Annotated[float, NullIs(np.inf)]
    is_ahead: bool  # z points where the cameras look
    words: Line

    def __post_init__(self) -> None:
        freeze(self, "rig_from_volume", "low_mm", "high_mm")

    def lattice(self, counts: tuple[int, int, int]) -> Array:
        """An even lattice in the middles of as many cells of the box, in the rig's frame.  # (N, 3)"""
        axes = [
            low + (np.arange(count) + 0.5) * (high - low) / count
            for low, high, count in zip(self.low_mm, self.high_mm, counts, strict=True)
        ]
        local = np.stack(np.meshgrid(*axes, indexing="ij"), axis=-1).reshape(-1, 3)
        return transform(self.rig_from_volume, local)

    def holds(self, point_mm: Array) -> Flags:
        """Which points (N, 3) of the rig's frame are at the right distance.  # (N,)"""
        away = np.linalg.norm(point_mm - self.rig_from_volume[:3, 3], axis=1)
        return np.asarray((away >= self.near_mm) & (away <= self.far_mm))


@dataclass(frozen=True, eq=False)
class _Outlook:
    """Where a rig looks."""

    middle_mm: Array  # (3,) of its cameras
    forward: Array | None  # (3,) unit; None: they look all ways
    meeting_mm: Array | None  # (3,) nearest to all optical axes; None: they are all but parallel
    spread_mm: float  # mean distance between cameras


def seen_by_cameras(rig: Rig, point_mm: Array) -> Flags:
    """Which cameras show which points of the rig's frame.  # (N, C)"""
    return np.stack([is_in_image(rig, row, point_mm) for row in range(len(rig.cameras))], axis=1)


def box_volume(low_mm: Array, high_mm: Array) -> WorkingVolume:
    """A box along the axes of the rig's frame.

    Raises:
        InputError: it has no inside.
    """
    low, high = np.asarray(low_mm, dtype=np.float64), np.asarray(high_mm, dtype=np.float64)
    if low.shape != (3,) or high.shape != (3,) or not (np.isfinite(low) & np.isfinite(high) & (low < high)).all():
        raise InputError(
            f"--volume from {low.tolist()} to {high.tolist()} mm: three ranges x, y, z are needed, the smaller first"
        )
    spans = ", ".join(f"{axis} {a:g} to {b:g}" for axis, a, b in zip("xyz", low.tolist(), high.tolist(), strict=True))
    return WorkingVolume(np.eye(4), low, high, 0.0, np.inf, is_ahead=False, words=f"{spans} mm in the rig's frame")


def volume_between(rig: Rig, near_mm: float, far_mm: float, seen_by: int) -> WorkingVolume:
    """What as many cameras see between two distances.

    These are from the rig's middle where its cameras look the same way, else from where their optical axes meet.

    Raises:
        InputError: nothing is.
    """
    outlook = _outlook(rig)
    is_ahead = outlook.forward is not None
    origin = outlook.middle_mm if is_ahead or outlook.meeting_mm is None else outlook.meeting_mm
    frame = make_pose(_axes(rig, outlook), origin)
    reached = _reached(rig, origin, (near_mm, 0.5 * (near_mm + far_mm), far_mm))
    reached = reached[seen_by_cameras(rig, reached).sum(axis=1) >= seen_by]
    if not len(reached):
        raise InputError(
            f"{near_mm:g} to {far_mm:g} mm from the rig nothing is seen by {seen_by} cameras; give another --distance, "
            "--volume or --seen-by"
        )
    local = transform(invert(frame), reached)
    low, high = local.min(axis=0), local.max(axis=0)
    if not is_ahead:
        low, high = np.full(3, -far_mm), np.full(3, far_mm)
    low = np.minimum(low, high - 1e-3)
    where = "the middle of the cameras" if is_ahead or outlook.meeting_mm is None else "where the optical axes meet"
    words = f"what {seen_by} or more cameras see {near_mm:g} to {far_mm:g} mm from {where}"
    return WorkingVolume(frame, low, high, near_mm, far_mm, is_ahead, words)


def default_volume(rig: Rig, seen_by: int) -> WorkingVolume:
    """Around where the optical axes meet; of cameras whose axes do not, as many baselines away as is usual.

    Raises:
        InputError: nothing is seen by as many cameras there.
    """
    outlook = _outlook(rig)
    if outlook.meeting_mm is None:
        near, far = (round_mm(times * max(outlook.spread_mm, 1.0)) for times in BASELINES)
        return volume_between(rig, near, far, seen_by)
    if outlook.forward is None:
        away = float(np.linalg.norm(rig.center_mm - outlook.meeting_mm, axis=1).mean())
        return volume_between(rig, 0.0, round_mm(BALL * away), seen_by)
    away = float(np.linalg.norm(outlook.meeting_mm - outlook.middle_mm))
    near, far = (round_mm(share * away) for share in AROUND)
    return volume_between(rig, near, far, seen_by)


def round_mm(length_mm: float) -> float:
    """A length to two digits."""
    return float(f"{length_mm:.1e}")


def _outlook(rig: Rig) -> _Outlook:
    center, axis = rig.center_mm, rig.rig_from_cam[:, :3, 2]
    mean = axis.mean(axis=0)
    length = float(np.linalg.norm(mean))
    projector = (np.eye(3) - axis[:, :, None] * axis[:, None, :]).sum(axis=0)
    meeting = None
    if np.linalg.eigvalsh(projector)[0] > CONVERGE:
        beside = np.einsum("cij,cj->ci", np.eye(3) - axis[:, :, None] * axis[:, None, :], center).sum(axis=0)
        meeting = symmetric_inverse(projector).inverse @ beside
        if ((meeting - center) * axis).sum(axis=1).min() <= 0:
            meeting = None  # behind a camera
    count = len(center)
    apart = np.linalg.norm(center[:, None] - center, axis=2).sum() / max(count * (count - 1), 1)
    return _Outlook(center.mean(axis=0), mean / length if length > TOGETHER else None, meeting, float(apart))


def _axes(rig: Rig, outlook: _Outlook) -> Array:
    """The volume's axes in the rig's frame: z ahead, x along the cameras, y down.  # (3, 3)

    Of cameras that look all ways they are the rig's own.
    """
    if outlook.forward is None:
        return np.eye(3)
    off = rig.center_mm - outlook.middle_mm
    along = np.linalg.svd(off - (off @ outlook.forward)[:, None] * outlook.forward)[2][0]
    right = rig.rig_from_cam[:, :3, 0].mean(axis=0)
    if np.linalg.norm(off) < 1e-9 or abs(along @ outlook.forward) > TOGETHER:
        along = right
    along = along - (along @ outlook.forward) * outlook.forward
    along = along / np.linalg.norm(along) * (1.0 if along @ right >= 0 else -1.0)
    return np.stack([along, np.cross(outlook.forward, along), outlook.forward], axis=1)


def _reached(rig: Rig, origin: Array, distances_mm: tuple[float, ...]) -> Array:
    """Where the lines of sight of all cameras are at some distances from a point.  # (N, 3)"""
    found = [np.broadcast_to(origin, (1, 3))]
    for row, camera in enumerate(rig.cameras):
        width, height = camera.image_size
        u, v = np.meshgrid(np.linspace(0, width - 1, BORDER[0]), np.linspace(0, height - 1, BORDER[1]))
        ray = rays_in_rig(rig, row, np.stack([u, v], axis=-1).reshape(-1, 2))
        start = rig.center_mm[row] - origin
        along = ray @ start
        for distance in distances_mm:
            with np.errstate(invalid="ignore"):  # nan where the ray stays farther away
                root = np.sqrt(along**2 - start @ start + distance**2)
            for step in (-along + root, -along - root):
                ahead = step > 0
                found.append(rig.center_mm[row] + step[ahead, None] * ray[ahead])
    return np.concatenate(found)
