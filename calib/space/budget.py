"""What a rig can be expected to measure: errors in space over its working volume, and what they come from.

Positions are told in the rig's frame. What of the rig's errors moves all points like a rigid body is no error of a
shape: the same is told with the best rigid motion over the volume taken off, and as the error of a length.

What a part of the rig costs is told by a condition: if it were known exactly, and the rest as well as it then were, how
large would the errors be? Parts go together, so what they cost does not add up.

A rig as it might be: with more frames, other baselines, another camera. Budgets of it tell what that would buy.
"""

from collections.abc import Mapping
from dataclasses import dataclass, replace

import numpy as np

from calib.cameras.rig import Rig
from calib.core.csv_table import csv_bytes
from calib.core.linear_algebra import least_squares, symmetric_inverse
from calib.core.se3 import make_pose, rotation_between, skew
from calib.core.types import freeze
from calib.space.propagate import (
    NOT_KNOWN,
    PointErrors,
    PointSpread,
    Rays,
    calibration_factor,
    errors_of,
    propagate,
    rms_error_mm,
)
from calib.space.triangulate import UNSURE
from calib.space.volume import WorkingVolume, seen_by_cameras
from designer.base.arrays import Array, Flags, Rows
from designer.base.errors import InputError

CELLS = (21, 21, 21)
FINER, LEAST_POINTS = (41, 41, 41), 300
MOST_POINTS, MOST_NUMBERS = 4000, 20_000_000
"""Of the lattice, and of what independent errors of the rig do to its points."""
_AXES = ("XX", "XY", "XZ", "YY", "YZ", "ZZ")
COLUMNS = (
    "X", "Y", "Z", "cameras", "sigma_mm", "noise_mm", "calibration_mm", "shape_mm",
    *(f"{part}_{axes}" for part in ("c", "noise", "calibration") for axes in _AXES),
)  # fmt: skip
EXPLAINED = (
    "# ringsolid budget, version 1",
    "# X Y Z: in the rig's frame, mm; sigma_mm: root mean square of the error's length in space; noise_mm, "
    "calibration_mm: its parts",
    "# shape_mm: the same with the best rigid motion of all points taken off",
    "# c_: covariance in mm^2; noise_: its part by the pixels; calibration_: by the rig's errors; empty: not known",
)
AS_NOTHING = 1e-7
"""Of a part's largest independent error, what is rounding."""


@dataclass(frozen=True, eq=False)
class Expected(PointSpread):
    """Errors that are to be expected at N points of a rig's frame."""

    point_mm: Array  # (N, 3)
    cameras: Rows  # (N,) how many see it

    def __post_init__(self) -> None:
        freeze(self, "point_mm", "noise_mm2", "by_calibration")
        freeze(self, "cameras", dtype=np.int64)


@dataclass(frozen=True)
class KnownExactly:
    """How large errors would be if a part of what causes them were none."""

    part: str  # "the positions", "the lens of left", "the noise of the pixels"
    position: PointErrors
    shape: PointErrors


def expected_errors(rig: Rig, point_mm: Array, noise_px: Array, seen_by: int = 2) -> Expected:
    """What is to be expected at points (N, 3) of the rig's frame, by noise (C,) of cameras; nan where fewer see it."""
    seen = seen_by_cameras(rig, point_mm)
    use = seen.sum(axis=1) >= seen_by
    spread = _propagated(rig, point_mm[use], seen[use], noise_px)
    count = len(point_mm)
    noise = np.full((count, 3, 3), np.nan)
    noise[use] = spread.noise_mm2
    moved = None
    if spread.by_calibration is not None:
        moved = np.full((count, *spread.by_calibration.shape[1:]), np.nan)
        moved[use] = spread.by_calibration
    return Expected(noise, moved, point_mm, seen.sum(axis=1))


def _propagated(rig: Rig, point_mm: Array, seen: Flags, noise_px: Array) -> PointSpread:
    """Errors of points (N, 3) from the cameras that see them (N, C)."""
    place, camera = np.nonzero(seen)
    rays = Rays(len(point_mm), camera, place, np.eye(2) / noise_px[camera, None, None])
    return propagate(rig, calibration_factor(rig), point_mm, rays)


def over_volume(
    rig: Rig, volume: WorkingVolume, noise_px: Array, seen_by: int, other: Rig | None = None
) -> tuple[Expected, float]:
    """What is to be expected where enough cameras see, evenly over a volume; and what share of it that is.

    With another rig, to compare with, only where enough of its cameras see, too, if there is such a place.

    Raises:
        InputError: they see nothing of it.
    """
    for counts in (CELLS, FINER):
        every = volume.lattice(counts)
        every = every[volume.holds(every)]
        seen = seen_by_cameras(rig, every).sum(axis=1) >= seen_by
        if seen.sum() >= LEAST_POINTS:
            break
    if not seen.any():
        raise InputError(
            f"no point of the volume ({volume.words}) is seen by {seen_by} cameras; give another --volume, --distance "
            "or --seen-by"
        )
    both = seen if other is None else seen & (seen_by_cameras(other, every).sum(axis=1) >= seen_by)
    points, factor = every[both if both.any() else seen], calibration_factor(rig)
    most = MOST_POINTS if factor is None else min(MOST_POINTS, MOST_NUMBERS // (3 * max(factor.shape[1], 1)))
    expected = expected_errors(rig, points[:: -(-len(points) // most)], noise_px, seen_by)
    known, moved = np.isfinite(expected.noise_mm2).all(axis=(1, 2)), expected.by_calibration
    moved = None if moved is None else moved[known]
    kept = Expected(expected.noise_mm2[known], moved, expected.point_mm[known], expected.cameras[known])
    return kept, float(seen.mean())


def without_rigid_motion(point_mm: Array, by_calibration: Array, sigma_mm: Array) -> Array:
    """What errors (N, 3, R) do to the shape of points (N, 3): the rigid motion of all that fits best taken off.

    Best is most likely: points count by their standard deviations (N,), else those far away would own the motion.
    """
    off = point_mm - point_mm.mean(axis=0)
    design = np.concatenate([-skew(off), np.broadcast_to(np.eye(3), (len(off), 3, 3))], axis=2).reshape(-1, 6)
    flat, weight = by_calibration.reshape(len(design), -1), np.repeat(1 / sigma_mm, 3)[:, None]
    motion = least_squares(design * weight, flat * weight)
    shape: Array = (flat - design @ motion).reshape(by_calibration.shape)
    return shape


def shape_changes(expected: Expected) -> Array | None:
    """What each of the rig's independent errors does to the shape of all points; None: not known.  # (N, 3, R)"""
    if expected.by_calibration is None:
        return None
    return without_rigid_motion(expected.point_mm, expected.by_calibration, rms_error_mm(expected.covariance_mm2))


def length_errors(rig: Rig, point_mm: Array, axes: Array, length_mm: float, noise_px: Array) -> tuple[Array, Array]:
    """Variances of a length at points (N, 3) along each of three directions (3, 3): by noise, by calibration.

    The length lies with its middle at the point, and both its ends are seen by the cameras that see the point.
    """
    seen = seen_by_cameras(rig, point_mm)
    noise, shared = np.full((len(point_mm), 3), np.nan), np.full((len(point_mm), 3), np.nan)
    for column, direction in enumerate(axes.T):
        ends = [_propagated(rig, point_mm + sign * length_mm / 2 * direction, seen, noise_px) for sign in (1, -1)]
        noise[:, column] = sum(np.einsum("i,nij,j->n", direction, end.noise_mm2, direction) for end in ends)
        first, second = (end.by_calibration for end in ends)
        if first is not None and second is not None:
            shared[:, column] = (np.einsum("i,nir->nr", direction, first - second) ** 2).sum(axis=1)
    return noise, shared


def parts_of(rig: Rig) -> Mapping[str, Rows]:
    """The rows of the covariance by what they are of: kinds first, then camera by camera; without what is fixed."""
    groups: dict[str, list[int]] = {"the lenses": [], "the rotations": [], "the positions": []}
    single: dict[str, list[int]] = {}
    for row, name in enumerate(rig.names):
        pose = rig.pose_rows(row)
        for kind, part, rows in (
            ("the lenses", "the lens", range(*rig.params_rows(row).indices(rig.first_row[-1]))),
            ("the rotations", "the rotation", range(pose.start, pose.start + 3)),
            ("the positions", "the position", range(pose.start + 3, pose.stop)),
        ):
            groups[kind].extend(rows)
            single[f"{part} of {name}"] = list(rows)
    variance = np.zeros(rig.first_row[-1]) if rig.covariance is None else np.diagonal(rig.covariance)
    return {
        name: kept
        for name, rows in (groups | single).items()
        if len(kept := np.array([row for row in rows if variance[row] > 0], dtype=np.int64))
    }


def if_known_exactly(rig: Rig, expected: Expected) -> tuple[KnownExactly, ...]:
    """How large errors would be, were parts of what causes them none: the noise, the whole rig, and each part."""
    factor, moved, shape = calibration_factor(rig), expected.by_calibration, shape_changes(expected)
    noise = np.trace(expected.noise_mm2, axis1=1, axis2=2)
    if factor is None or moved is None or shape is None:
        return ()
    both = moved, shape
    square, shape_square = ((one**2).sum(axis=(1, 2)) for one in both)
    rows = [
        KnownExactly("the noise of the pixels", errors_of(np.sqrt(square)), errors_of(np.sqrt(shape_square))),
        KnownExactly("the whole rig", errors_of(np.sqrt(noise)), errors_of(np.sqrt(noise))),
    ]
    for name, of_part in parts_of(rig).items():
        span = _span(factor[of_part])
        position, form = (np.sqrt(noise + ((one - (one @ span) @ span.T) ** 2).sum(axis=(1, 2))) for one in both)
        rows.append(KnownExactly(name, errors_of(position), errors_of(form)))
    return tuple(rows)


def _span(factor: Array) -> Array:
    """An orthonormal basis (R, K) of the independent errors that some unknowns, rows of a factor (U, R), tell of."""
    unit = factor / np.linalg.norm(factor, axis=1, keepdims=True)
    _, size, across = np.linalg.svd(unit, full_matrices=False)
    basis: Array = across[size > AS_NOTHING * size[0]].T
    return basis


def shape_error_mm(expected: Expected) -> Array:
    """What the rig's errors do to the shape of all points, root mean square (N,); nan: not known."""
    changes = shape_changes(expected)
    size: Array = np.full(len(expected.point_mm), np.nan) if changes is None else np.sqrt((changes**2).sum(axis=(1, 2)))
    return size


def share_not_measured(rig: Rig, expected: Expected) -> float:
    """Of the points, those whose error reaches a third of their distance."""
    away = np.linalg.norm(expected.point_mm[:, None] - rig.center_mm, axis=2).min(axis=1)
    return float((rms_error_mm(expected.covariance_mm2) > UNSURE * away).mean())


def grid_csv(expected: Expected, shape_mm: Array) -> bytes:
    """The lattice of the volume as a table, a line a point; what is not known is empty."""
    shared = expected.calibration_mm2
    shared = np.full_like(expected.noise_mm2, np.nan) if shared is None else shared
    parts = (expected.covariance_mm2, expected.noise_mm2, shared)
    upper = np.triu_indices(3)
    shape = np.sqrt(np.trace(expected.noise_mm2, axis1=1, axis2=2) + shape_mm**2)
    numbers = np.column_stack([
        expected.point_mm, expected.cameras, *(rms_error_mm(part) for part in parts), shape,
        *(part[:, upper[0], upper[1]] for part in parts),
    ])  # fmt: skip
    rows = ([f"{value:.9g}" if np.isfinite(value) else "" for value in row] for row in numbers.tolist())
    return csv_bytes(EXPLAINED, COLUMNS, rows)


def shape_errors(expected: Expected) -> PointErrors:
    """With the best rigid motion of all points taken off."""
    shape = shape_changes(expected)
    if shape is None:
        return NOT_KNOWN
    return errors_of(np.sqrt(np.trace(expected.noise_mm2, axis1=1, axis2=2) + (shape**2).sum(axis=(1, 2))))


def position_errors(expected: Expected) -> PointErrors:
    """In the rig's frame."""
    return errors_of(rms_error_mm(expected.covariance_mm2))


@dataclass(frozen=True)
class ChangedRig:
    """What a change of a rig would do."""

    change: str
    assumes: str
    position: PointErrors
    shape: PointErrors
    share: float  # of the volume that enough cameras see


def with_frames(rig: Rig, times: float) -> Rig:
    """Calibrated from so many times as many frames of the same kind: `with_frames(rig, 4)`."""
    return rig if rig.covariance is None else replace(rig, covariance=rig.covariance / times)


def with_baseline(rig: Rig, times: float) -> Rig:
    """All cameras so many times as far from their middle, looking where they look, as surely known."""
    middle = rig.center_mm.mean(axis=0)
    rotation = rig.cam_from_rig[:, :3, :3]
    shift = -np.einsum("cij,cj->ci", rotation, middle + times * (rig.center_mm - middle))
    return replace(rig, cam_from_rig=make_pose(rotation, shift))


def with_camera(rig: Rig, like: int, eye_mm: Array, aim_mm: Array, name: str = "another") -> Rig:
    """One more camera like one of the rig's, calibrated with the others as that one is.

    `like` is the row of the camera that it is like, whose own axes it has but for the smallest turn.
    """
    frame = rig.rig_from_cam[like, :3, :3]
    ahead = (aim_mm - eye_mm) / np.linalg.norm(aim_mm - eye_mm)
    rotation = (rotation_between(frame[:, 2], ahead) @ frame).T
    covariance = rig.covariance
    if covariance is not None:
        covariance = _with_one_like(covariance, np.arange(rig.first_row[like], rig.first_row[like + 1]))
    while name in rig.names:
        name += "'"
    return replace(
        rig, names=(*rig.names, name), cameras=(*rig.cameras, rig.cameras[like]),
        cam_from_rig=np.concatenate([rig.cam_from_rig, make_pose(rotation, -rotation @ eye_mm)[None]]),
        covariance=covariance, noise_px=None if rig.noise_px is None else np.append(rig.noise_px, rig.noise_px[like]),
        delay_s=None,
    )  # fmt: skip


def _with_one_like(covariance: Array, own: Rows) -> Array:
    """The covariance with unknowns more, which go with all others as those of the rows `own` do.

    A camera is calibrated together with the others: what its pose owes to their lenses it shares with them. So the new
    errors are those that the others' let expect of `own`, and as much that is theirs alone.
    """
    others = np.setdiff1d(np.arange(len(covariance)), own)
    expected: Array = covariance[np.ix_(own, others)] @ symmetric_inverse(covariance[np.ix_(others, others)]).inverse
    across = np.empty((len(own), len(covariance)))
    across[:, others] = covariance[np.ix_(own, others)]
    across[:, own] = expected @ covariance[np.ix_(others, own)]
    return np.block([[covariance, across.T], [across, covariance[np.ix_(own, own)]]])


def _one_above(rig: Rig, volume: WorkingVolume) -> Rig | None:
    """The rig with a camera more, as far above its middle as its cameras are apart, that looks into the volume."""
    center = rig.center_mm
    middle, aim = center.mean(axis=0), np.asarray(volume.rig_from_volume[:3, 3])
    if volume.near_mm == 0 or volume.is_ahead:
        local = (volume.low_mm + volume.high_mm) / 2
        aim = volume.rig_from_volume[:3, :3] @ local + volume.rig_from_volume[:3, 3]
    apart = float(np.linalg.norm(center[:, None] - center, axis=2).max())
    up = -volume.rig_from_volume[:3, 1] if volume.is_ahead else _across(center, rig)
    eye = middle + apart * up
    if not apart > 0 or np.linalg.norm(aim - eye) < 1e-6:
        return None
    return with_camera(rig, len(center) - 1, eye, aim)


def _across(center: Array, rig: Rig) -> Array:
    """The direction in which cameras stand least, upwards as they have it."""
    axis = np.linalg.svd(center - center.mean(axis=0))[2][2]
    up: Array = axis * (-1.0 if axis @ rig.rig_from_cam[:, :3, 1].mean(axis=0) > 0 else 1.0)
    return up


def what_ifs(rig: Rig, volume: WorkingVolume, noise_px: Array, seen_by: int) -> tuple[ChangedRig, ...]:
    """What changes of a rig would buy, where it sees the volume as it is and changed."""
    changes: dict[str, tuple[str, Rig | None, Array]] = {
        "four times as many frames": (
            "the covariance is a quarter: true of noise, not of errors of the target, which more frames leave",
            with_frames(rig, 4), noise_px,
        ),
        "centres twice as sure": ("half the noise when measuring; the rig as it is", rig, noise_px / 2),
        "one and a half times the baseline": (
            "each camera's position and rotation are as sure as now", with_baseline(rig, 1.5), noise_px,
        ),
        "one camera more": (
            f"like {rig.names[-1]}, as well calibrated, above the others, looking into the volume",
            _one_above(rig, volume), np.append(noise_px, noise_px[-1]),
        ),
    }  # fmt: skip
    return tuple(
        told
        for change, (assumes, changed, noise) in changes.items()
        if changed is not None and (told := _told(change, assumes, changed, rig, volume, noise, seen_by)) is not None
    )


def _told(
    change: str, assumes: str, rig: Rig, unchanged: Rig, volume: WorkingVolume, noise_px: Array, seen_by: int
) -> ChangedRig | None:
    try:
        expected, share = over_volume(rig, volume, noise_px, seen_by, unchanged)
    except InputError:  # it would see nothing of the volume
        return None
    return ChangedRig(change, assumes, position_errors(expected), shape_errors(expected), share)
