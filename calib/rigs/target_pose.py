"""Where a target is in the frame of a known rig, from what its cameras saw at once, and how surely.

Least squares of the whitened residuals of all cameras, by Gauss-Newton. The pose is turned by w and shifted by s in the
rig's axes, `x_rig' = exp(w) R x + t + s`. With derivatives J of the whitened pixels by (w, s) and B by the rig's own
unknowns, noise of size one makes the covariance `N^-1`, `N = J'J`, and errors d of the rig move the pose by
`-N^-1 J'B d`: all sightings share them, so that no number of rings averages them out.
"""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np

from calib.cameras.rig import Rig
from calib.core.linear_algebra import symmetric_inverse
from calib.core.parallel import one_thread
from calib.core.se3 import exp_rotation, invert, make_pose, skew, transform
from calib.core.types import Detections, freeze
from calib.space.propagate import LinearSight, calibration_factor, linear_sight, whitening
from designer.base.arrays import Array, Flags

POSE = 6
MOST_STEPS, MOST_HALVINGS = 30, 12
SETTLED = 1e-10
"""Square of a step, in units of the pose's standard deviation, that is none any more."""
CAPPED = 50.0**2
"""Square of a whitened residual beyond which it tells nothing of which start is the best."""
BEYOND_CHANCE = 3.0
"""Standard deviations of a sum of squares, by which it exceeds what is expected, that are no chance."""


@dataclass(frozen=True, eq=False)
class CameraSight:
    """What one camera of a rig saw of a target in a frame."""

    camera: int  # row of the rig
    seen: Detections
    cam_from_target: Array | None  # (4, 4) by this camera alone; None: it tells none


@dataclass(frozen=True, eq=False)
class RigPose:
    """A target's pose in the frame of a rig; covariances are of a rotation vector (rad) and a shift (mm) there."""

    rig_from_target: Array  # (4, 4)
    noise: Array  # (6, 6) by the noise of the centres
    calibration: Array | None  # (6, 6) by the rig's own errors; None: not known
    residual_px: tuple[Array, ...]  # of each sight (M, 2): predicted - measured; nan of rings that count for nothing
    excess: float  # residuals in what noise and rig let expect, where that is more than chance makes; else 1

    def __post_init__(self) -> None:
        freeze(self, "rig_from_target", "noise", "calibration")

    @property
    def covariance(self) -> Array:
        """By all that is known, as much larger as residuals are than expected.  # (6, 6)"""
        known = self.noise if self.calibration is None else self.noise + self.calibration
        return self.excess**2 * known


@one_thread
def pose_in_rig(
    rig: Rig, sights: Sequence[CameraSight], position_mm: Array, *, weighted: bool = True
) -> RigPose | None:
    """The pose of a target that some cameras of a rig saw at once; None if they do not tell one.

    Args:
        rig: is taken as it is.
        sights: of one frame.
        position_mm: of the target's points.  # (R, 3)
        weighted: by the covariances of the centres; else all alike, and their noise is what is left over.
    """
    parts = [_part(rig, sight, position_mm, weighted=weighted) for sight in sights]
    starts = [
        invert(rig.cam_from_rig[one.camera]) @ one.cam_from_target for one in sights if one.cam_from_target is not None
    ]
    if not starts:
        return None
    start = min(starts, key=lambda pose: _capped(rig, parts, pose))
    parts = [one.seen_from(rig, start) for one in parts]
    pose = _descended(rig, parts, start)
    return None if pose is None else _told(rig, parts, pose, weighted=weighted)


@dataclass(frozen=True, eq=False)
class _Part:
    """One camera's M sightings, and which of them count."""

    camera: int
    point_mm: Array  # (M, 3) in the target's frame
    center_px: Array  # (M, 2)
    whiten: Array  # (M, 2, 2)
    counts: Flags  # (M,)

    def seen_from(self, rig: Rig, pose: Array) -> "_Part":
        """Without what the camera's model does not show from there."""
        pixel = rig.cameras[self.camera].project(transform(rig.cam_from_rig[self.camera] @ pose, self.point_mm))
        counts = self.counts & np.isfinite(pixel).all(axis=1)
        return _Part(self.camera, self.point_mm, self.center_px, self.whiten, counts)


@dataclass(frozen=True, eq=False)
class _Linear:
    """The whitened sightings of one camera that count, linearised."""

    camera: int
    residual: Array  # (2 M,)
    by_pose: Array  # (2 M, 6)
    sight: LinearSight
    whiten: Array  # (M, 2, 2)

    @property
    def by_rig(self) -> Array:
        """By the camera's own K unknowns.  # (2 M, K)"""
        return (self.whiten @ self.sight.by_unknowns).reshape(len(self.residual), -1)


def _part(rig: Rig, sight: CameraSight, position_mm: Array, *, weighted: bool) -> _Part:
    seen = sight.seen
    whiten = whitening(seen.cov_px2) if weighted else np.tile(np.eye(2), (len(seen.ring), 1, 1))
    rays = rig.cameras[sight.camera].rays(seen.center_px)
    counts = np.asarray(np.isfinite(rays).all(axis=1) & np.isfinite(whiten).all(axis=(1, 2)))
    return _Part(sight.camera, position_mm[seen.ring], seen.center_px, whiten, counts)


def _residual_px(rig: Rig, part: _Part, pose: Array) -> Array:
    """Predicted - measured.  # (M, 2)"""
    place = transform(rig.cam_from_rig[part.camera] @ pose, part.point_mm)
    pixel: Array = rig.cameras[part.camera].project(place)
    return pixel - part.center_px


def _capped(rig: Rig, parts: Sequence[_Part], pose: Array) -> float:
    """The sum of squares, of which no sighting has more than its part; of those that are not seen all of it."""
    total = 0.0
    for part in parts:
        white = (part.whiten[part.counts] @ _residual_px(rig, part, pose)[part.counts, :, None])[..., 0]
        total += float(np.fmin((white**2).sum(axis=1), CAPPED).sum())
    return total


def _linear(rig: Rig, parts: Sequence[_Part], pose: Array) -> Iterator[_Linear]:
    """Each camera's sightings as they are seen from a pose."""
    for part in parts:
        if not part.counts.any():
            continue
        turned = part.point_mm[part.counts] @ pose[:3, :3].T
        sight = linear_sight(rig, part.camera, turned + pose[:3, 3])
        white = part.whiten[part.counts]
        by_point = white @ sight.by_point
        by_pose = np.concatenate([-by_point @ skew(turned), by_point], axis=2).reshape(-1, POSE)
        residual = (white @ (sight.pixel - part.center_px[part.counts])[..., None]).ravel()
        yield _Linear(part.camera, residual, by_pose, sight, white)


def _sums(rig: Rig, parts: Sequence[_Part], pose: Array) -> tuple[float, Array, Array]:
    """Sum of squares, `J'J` (6, 6) and `J'r` (6,); infinite where a sighting is lost."""
    squares, normal, slope = 0.0, np.zeros((POSE, POSE)), np.zeros(POSE)
    for one in _linear(rig, parts, pose):
        squares += float(one.residual @ one.residual)
        normal += one.by_pose.T @ one.by_pose
        slope += one.by_pose.T @ one.residual
    return (squares if np.isfinite(squares) else np.inf), normal, slope


def _descended(rig: Rig, parts: Sequence[_Part], pose: Array) -> Array | None:
    """Gauss-Newton with steps that are halved until they help; None where the pose is not determined."""
    best, normal, slope = _sums(rig, parts, pose)
    for _ in range(MOST_STEPS):
        solved = symmetric_inverse(normal)
        if not (np.isfinite(best) and solved.is_determined.all()):
            return None
        step = -solved.inverse @ slope
        if -(step @ slope) < SETTLED:
            return pose
        for _ in range(MOST_HALVINGS):
            trial = _moved(pose, step)
            sums = _sums(rig, parts, trial)
            if sums[0] <= best:
                break
            step = 0.5 * step
        else:
            return pose
        pose, (best, normal, slope) = trial, sums
    return pose


def _moved(pose: Array, step: Array) -> Array:
    return make_pose(exp_rotation(step[:3]) @ pose[:3, :3], pose[:3, 3] + step[3:])


def _told(rig: Rig, parts: Sequence[_Part], pose: Array, *, weighted: bool) -> RigPose | None:
    """The pose with how surely it is known."""
    squares, normal, _ = _sums(rig, parts, pose)
    count = 2 * sum(int(part.counts.sum()) for part in parts)
    inverse = symmetric_inverse(normal)
    if not inverse.is_determined.all() or count <= POSE:
        return None
    factor = calibration_factor(rig)
    moved, gram = (None, np.zeros((0, 0))) if factor is None else _by_rig(rig, parts, pose, inverse.inverse, factor)
    noise, excess = inverse.inverse, 1.0
    if weighted:
        excess = _excess(squares, count - POSE, gram)
    else:
        noise = squares / (count - POSE) * noise
    residual = [np.where(part.counts[:, None], _residual_px(rig, part, pose), np.nan) for part in parts]
    return RigPose(pose, noise, None if moved is None else moved @ moved.T, tuple(residual), excess)


def _by_rig(rig: Rig, parts: Sequence[_Part], pose: Array, inverse: Array, factor: Array) -> tuple[Array, Array]:
    """How far independent errors of the rig move the pose (6, R), and products (R, R) of what they leave over."""
    pulled, gram = np.zeros((POSE, factor.shape[1])), np.zeros((factor.shape[1],) * 2)
    for one in _linear(rig, parts, pose):
        shift = one.by_rig @ factor[rig.first_row[one.camera] : rig.first_row[one.camera + 1]]
        pulled += one.by_pose.T @ shift
        gram += shift.T @ shift
    moved = -inverse @ pulled
    return moved, gram + pulled.T @ moved


def _excess(squares: float, redundancy: int, gram: Array) -> float:
    """The root of squares over their mean, if that is no chance.

    With noise of size one and what the rig's errors leave over, of products G, their mean is `n + tr G` and their
    variance `2 (n + 2 tr G + tr G^2)`.
    """
    mean = redundancy + float(np.trace(gram))
    variance = 2 * (redundancy + 2 * float(np.trace(gram)) + float((gram**2).sum()))
    return float(np.sqrt(squares / mean)) if squares > mean + BEYOND_CHANCE * np.sqrt(variance) else 1.0
