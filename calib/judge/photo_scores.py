"""What photos of a target tell of cameras, to first order about what these are said to be: scores and information.

Poses are solved, and projected off; outliers are left out; the noise is measured by what is left over. The equations
stand in `calib.judge.drift`, which tests by them whether cameras changed.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from calib.cameras.camera import Camera
from calib.cameras.rig import POSE, Rig
from calib.core.linear_algebra import symmetric_inverse
from calib.core.se3 import exp_rotation, invert, make_pose, skew
from calib.core.types import LEAST_POINTS, KnownPoints, RigObservations, keep_views, sightings_per_view
from calib.judge.reference import Reference
from calib.solver.calibration import is_flat, plane_bend
from calib.solver.free_bend import bend_sigma_mm
from calib.solver.outliers import LEAST_SIGMA, MEDIAN_LENGTH
from calib.solver.start import solve_poses
from calib.space.propagate import covariance_factor, linear_sight, whitening
from designer.base.arrays import Array, Flags, Rows
from designer.tolerance.prior import ShapePrior

DEGREE, LEAST_FREEDOM = 5, 30
"""Of polynomials over a photo; and degrees of freedom of the noise by them, with fewer it is that of all residuals."""
STEPS, HALVINGS, SETTLED = 30, 8, 1e-8
OUTLIER = 6.0
"""Robust standard deviations."""
MORE = 1.25
"""Times the noise of these photos, from which on that of the calibration is taken, which is of more of the image."""
ROUNDING = 1e-10
ODD, BLURRED = 1e-5, 3.0
"""Probability of a photo, given the others, below which it is left out; and its residuals in theirs."""
LOOSE = (0.2, 0.2, 1.0, 0.3, 0.3)
"""What is thought of at most: focal length, principal point (of the width), lens, turn (rad), shift (of distance)."""
LOOSE_SIZE, LOOSE_BEND = 0.1, 0.05
FIELD_DEGREE = 7
FIELD = tuple((i, j) for i in range(FIELD_DEGREE + 1) for j in range(FIELD_DEGREE + 1 - i) if i + j > 1)
"""Of polynomials over the image, for what a lens's model does not follow."""


def error_modes(points: KnownPoints, prior: ShapePrior | None, *, is_exact: bool) -> tuple[Array, Array]:
    """What standard normal numbers do to the points together (S, K, 3), and to each alone (K, 3, C)."""
    count = len(points.position_mm)
    if prior is not None and prior.modes_mm.shape[1] == count:
        return prior.modes_mm, prior.ring_modes_mm
    none = np.zeros((0, count, 3)), np.zeros((count, 3, 0))
    if is_exact or not is_flat(points):
        return none
    modes = plane_bend(points).modes_mm(points.position_mm)
    return bend_sigma_mm(points, None)[:, None, None] * modes, none[1]


@dataclass(frozen=True, eq=False)
class _Given:
    """M sightings by one camera in a frame."""

    camera: int
    point: Rows  # (M,)
    center_px: Array  # (M, 2)
    whiten: Array  # (M, 2, 2) by what is stated

    def keep(self, rows: Flags) -> "_Given":
        """Some of them."""
        return _Given(self.camera, self.point[rows], self.center_px[rows], self.whiten[rows])


@dataclass(frozen=True, eq=False)
class _Sight:
    """The same to first order, whitened."""

    given: _Given
    residual: Array  # (M, 2) measured - predicted
    by_pose: Array  # (M, 2, 6)
    by_camera: Array  # (M, 2, P + 6) of the camera's own unknowns
    by_place: Array  # (M, 2, 3) by the point in the target's frame
    off_px: Array  # (M, 2) predicted - measured
    distance_mm: float


@dataclass(frozen=True, eq=False)
class _FrameScores:
    """What a frame tells of all N unknowns, its pose projected off; R rows."""

    camera: Rows  # (R,) of each row
    point: Rows  # (R,)
    residual: Array  # (R,)
    by_all: Array  # (R, N)
    by_place: Array  # (R, 3)
    pose: Array  # (R, 6) an orthonormal basis of what was projected off
    sights: tuple[_Sight, ...]  # whose rows these are

    @cached_property
    def normal(self) -> Array:
        """Information.  # (N, N)"""
        normal: Array = self.by_all.T @ self.by_all
        return normal

    @cached_property
    def gradient(self) -> Array:
        """Scores.  # (N,)"""
        gradient: Array = self.by_all.T @ self.residual
        return gradient

    @cached_property
    def smooth(self) -> tuple[tuple[_Sight, slice, Array], ...]:
        """Of each sight its rows, and directions in them that are smooth over the photo."""
        last = np.cumsum([one.residual.size for one in self.sights]).tolist()
        every = [(one, slice(end - one.residual.size, end)) for one, end in zip(self.sights, last, strict=True)]
        return tuple((one, rows, _smooth(one, self, rows)) for one, rows in every)

    def left(self, found: Array) -> Array:
        """What unknowns (N,) leave over.  # (R,)"""
        left: Array = self.residual - self.by_all @ found
        return left


@dataclass(frozen=True, eq=False)
class PhotoScores:
    """All that counts, to first order about the file's cameras, in standard deviations of the noise."""

    reference: Reference
    points: KnownPoints
    number: tuple[int, ...]  # (V,) of the frames that have a pose
    frames: tuple[_FrameScores, ...]
    extra: int  # unknowns that are behind the cameras': the target's size and bend; then those of a variance of one
    own_mm: Array  # (K, 3, C) of each point's own
    scale: Array  # (C,)
    freedom: int
    loose: Array  # (N,) standard deviations of what is thought of at most
    free: Array  # (N,) unknowns that leave the least, if all may be anything

    @property
    def rig(self) -> Rig:
        """The cameras."""
        return self.reference.rig

    @property
    def count(self) -> int:
        """Of the cameras' unknowns."""
        return self.rig.first_row[-1]

    @property
    def sights(self) -> list[_Sight]:
        """Of all frames."""
        return [one for frame in self.frames for one in frame.sights]

    @property
    def shown(self) -> list[int]:
        """Rows of the cameras that see anything."""
        return sorted({one.given.camera for one in self.sights})

    @property
    def distance_mm(self) -> float:
        """From a camera to the target, the median."""
        return float(np.median([one.distance_mm for one in self.sights]))

    @cached_property
    def normal(self) -> Array:
        """Of all frames.  # (N, N)"""
        return np.asarray(np.sum([one.normal for one in self.frames], axis=0))

    @cached_property
    def gradient(self) -> Array:
        """Of all frames.  # (N,)"""
        return np.asarray(np.sum([one.gradient for one in self.frames], axis=0))

    @property
    def times_free(self) -> float:
        """What the file's cameras leave over, beside what is left over if all may be anything."""
        by_file, free = (sum(float(one @ one) for one in each) for each in (
            [frame.residual for frame in self.frames], [frame.left(self.free) for frame in self.frames]
        ))  # fmt: skip
        return float(np.sqrt(by_file / max(free, 1e-300)))

    @property
    def own_noise(self) -> float:
        """The noise by some of the photos alone, in that of all, as it would have been found."""
        free = symmetric_inverse(self.normal + np.diag(self.loose**-2.0)).inverse @ self.gradient
        noise = _noise(self.frames, free, self.loose, len(self.scale))[0]
        known = self.reference.scale
        noise = noise if known is None else np.where(known > MORE * noise * self.scale, known / self.scale, noise)
        return float(np.sqrt((noise[self.shown] ** 2).mean()))

    @property
    def covariance_factor(self) -> Array:
        """Of all unknowns if nothing changed.  # (N, R)"""
        parts, covariance = [np.zeros((self.count, 0))], self.rig.covariance
        if covariance is not None:
            is_known = np.asarray(np.isfinite(covariance).all(axis=1))
            own = np.where(is_known[:, None] & is_known, covariance, np.diag(self.loose[: self.count] ** 2))
            parts.append(covariance_factor(own))
        if self.reference.photo_covariance is not None:
            parts.append(covariance_factor(self.reference.photo_covariance / len(self.frames)))
        cameras, alone = np.concatenate(parts, axis=1), len(self.gradient) - self.count - self.extra
        factor = np.zeros((len(self.gradient), cameras.shape[1] + alone))
        factor[: self.count, : cameras.shape[1]] = cameras
        factor[self.count + self.extra :, cameras.shape[1] :] = np.eye(alone)
        return factor

    @property
    def by_rings(self) -> Array:
        """Scores by standard normal numbers of each ring alone, which all photos share.  # (N, Q)"""
        if not self.own_mm.shape[2]:
            return np.zeros((len(self.gradient), 0))
        every = np.zeros((len(self.own_mm), len(self.gradient), self.own_mm.shape[2]))
        for frame in self.frames:
            own = np.einsum("rj,rjc->rc", frame.by_place, self.own_mm[frame.point])
            np.add.at(every, frame.point, frame.by_all[:, :, None] * own[:, None, :])
        seen = np.abs(every).max(axis=(1, 2)) > 0
        return np.concatenate([every[0, :, :0], *every[seen]], axis=1)

    def odd_frame(self) -> tuple[int, str] | None:
        """The frame that does not fit to the others, if one does not, and why."""
        from scipy.special import fdtrc

        count = len(self.frames)
        if count < 2:
            return None
        size = np.array([np.sqrt(np.mean(one.left(self.free) ** 2)) for one in self.frames])
        worst = int(size.argmax())
        if count > 2 and (times := size[worst] / np.median(size)) > BLURRED:
            return worst, f"its residuals are {times:.1f} times those of the others: blurred, moved, or another target"
        loose, p = np.diag(self.loose**-2.0), np.ones(count)
        for k, one in enumerate(self.frames):
            others = symmetric_inverse(self.normal - one.normal + loose).inverse
            basis = standard_directions(one.normal)
            by_all = basis.T @ one.normal
            off = basis.T @ one.gradient - by_all @ others @ (self.gradient - one.gradient)
            spread = np.eye(len(off)) + by_all @ others @ by_all.T
            p[k] = fdtrc(len(off), self.freedom, float(off @ np.linalg.solve(spread, off)) / len(off))
        worst = int(p.argmin())
        if p[worst] * count > ODD:
            return None
        return worst, "it contradicts the others: another camera, zoom or focus, or something moved meanwhile"


def standard_directions(normal: Array) -> Array:
    """Directions (N, Q) in which scores of this covariance are independent and of size one; rounding left out."""
    scale = np.sqrt(np.diagonal(normal).clip(min=0.0))
    unit = np.where(scale > 0, 1 / np.where(scale > 0, scale, 1.0), 0.0)
    value, vector = np.linalg.eigh(normal * unit[:, None] * unit)
    keep = value > ROUNDING * value[-1:]
    basis: Array = unit[:, None] * vector[:, keep] / np.sqrt(value[keep])
    return basis


def photo_scores(reference: Reference, seen: RigObservations, modes_mm: Array, own_mm: Array) -> PhotoScores | None:
    """Poses, then noise and outliers by what is left over when all cameras are free; None where no frame has a pose."""
    rig = reference.rig
    points, given, poses = seen.points, _given(rig, seen), _first_poses(rig, seen)
    bend = plane_bend(points).modes_mm(points.position_mm) if is_flat(points) else modes_mm[:0]
    modes = np.concatenate([(points.position_mm - points.middle_mm)[None], bend, modes_mm])
    field_px = np.zeros(len(rig.cameras)) if reference.field_px is None else reference.field_px
    scale = np.ones(len(rig.cameras))
    for turn in range(3):
        kept = {k: pose for k, pose in poses.items() if sum(len(one.point) for one in given[k]) >= LEAST_POINTS}
        settled = {k: _settled(rig, given[k], pose, points, scale) for k, pose in kept.items()}
        found = {k: one for k, one in settled.items() if one is not None}
        if not found:
            return None
        poses, sights = {k: pose for k, (pose, _) in found.items()}, tuple(one for _, one in found.values())
        loose = _loose(rig, points, sights, len(bend), len(modes_mm) + 2 * len(FIELD) * int((field_px > 0).sum()))
        frames, free = _free(rig, sights, modes, field_px, scale, loose)
        if turn == 2:
            break
        length = [np.hypot(*one.left(free).reshape(-1, 2).T) for one in frames]
        camera, every = np.concatenate([one.camera[::2] for one in frames]), np.concatenate(length)
        robust = np.ones(len(scale))
        for one in np.unique(camera).tolist():
            robust[one] = max(float(np.median(every[camera == one])) / MEDIAN_LENGTH, LEAST_SIGMA)
        for k, frame, off in zip(found, frames, length, strict=True):
            sound, first = (
                off <= OUTLIER * robust[frame.camera[::2]],
                np.cumsum([0, *(len(one.point) for one in given[k])]),
            )
            given[k] = [one.keep(sound[i:j]) for one, i, j in zip(given[k], first, first[1:], strict=False)]
        scale = scale * robust
    noise, freedom = _noise(frames, free, loose, len(scale))
    is_stated = any(one.cov_px2 is not None for one in seen.sightings)
    if reference.scale is not None and reference.is_stated == is_stated:  # what other photos leave over of this lens
        noise = np.where(reference.scale > MORE * noise * scale, reference.scale / scale, noise)
    frames, free = _free(rig, sights, modes, field_px, scale * noise, loose)
    return PhotoScores(
        reference, points, tuple(found), frames, 1 + len(bend), own_mm, scale * noise, freedom, loose, free
    )  # fmt: skip


def _given(rig: Rig, seen: RigObservations) -> list[list[_Given]]:
    """The sightings of each frame that a camera's model can show."""
    found: list[list[_Given]] = [[] for _ in range(seen.frame_count)]
    for name, one, frames in zip(seen.camera_names, seen.sightings, seen.frame, strict=True):
        camera = rig.row(name)
        whiten = np.tile(np.eye(2), (len(one.view), 1, 1)) if one.cov_px2 is None else whitening(one.cov_px2)
        sound = np.isfinite(rig.cameras[camera].rays(one.center_px)).all(axis=1) & np.isfinite(whiten).all(axis=(1, 2))
        for view, frame in enumerate(frames.tolist()):
            rows = np.flatnonzero((one.view == view) & sound)
            if len(rows):
                found[frame].append(_Given(camera, one.point[rows], one.center_px[rows], whiten[rows]))
    return found


def _first_poses(rig: Rig, seen: RigObservations) -> dict[int, Array]:
    """The target in the rig's frame (4, 4) in frames, by the camera that sees most of it."""
    poses, most = dict[int, Array](), dict[int, int]()
    for name, one, frames in zip(seen.camera_names, seen.sightings, seen.frame, strict=True):
        count, camera = sightings_per_view(one), rig.row(name)
        enough = count >= LEAST_POINTS
        if not enough.any():
            continue
        found = solve_poses(rig.cameras[camera], keep_views(one, enough))
        for pose, frame, points in zip(
            found.cam_from_target, frames[enough].tolist(), count[enough].tolist(), strict=True
        ):
            if np.isfinite(pose).all() and points > most.get(frame, 0):
                poses[frame], most[frame] = invert(rig.cam_from_rig[camera]) @ pose, points
    return dict(sorted(poses.items()))


def _linear(rig: Rig, given: _Given, pose: Array, points: KnownPoints) -> _Sight:
    turned = points.position_mm[given.point] @ pose[:3, :3].T
    seen = linear_sight(rig, given.camera, turned + pose[:3, 3])
    by_point = given.whiten @ seen.by_point
    off = seen.pixel - given.center_px
    return _Sight(
        given, -(given.whiten @ off[..., None])[..., 0],
        np.concatenate([-by_point @ skew(turned), by_point], axis=2), given.whiten @ seen.by_unknowns,
        by_point @ pose[:3, :3], off,
        float(np.linalg.norm(seen.turned + rig.cam_from_rig[given.camera, :3, 3], axis=1).mean()),
    )  # fmt: skip


def _settled(
    rig: Rig, given: Sequence[_Given], pose: Array, points: KnownPoints, scale: Array
) -> tuple[Array, tuple[_Sight, ...]] | None:
    """The pose of a frame, by Gauss and Newton's steps, halved until they help; None where there is none."""
    given = [one for one in given if len(one.point)]

    def at(pose: Array) -> tuple[float, tuple[_Sight, ...]]:
        sights = tuple(_linear(rig, one, pose, points) for one in given)
        cost = sum(float((one.residual**2).sum()) / scale[one.given.camera] ** 2 for one in sights)
        return (cost if np.isfinite(cost) else np.inf), sights

    cost, sights = at(pose)
    for _ in range(STEPS):
        weight = [1 / scale[one.given.camera] for one in sights]
        by_pose = np.concatenate([w * one.by_pose.reshape(-1, POSE) for one, w in zip(sights, weight, strict=True)])
        residual = np.concatenate([w * one.residual.ravel() for one, w in zip(sights, weight, strict=True)])
        solved = symmetric_inverse(by_pose.T @ by_pose)
        if not (np.isfinite(cost) and solved.is_determined.all()):
            return None
        step = solved.inverse @ (by_pose.T @ residual)
        gain = float(step @ by_pose.T @ residual)
        for _ in range(HALVINGS):
            moved = make_pose(exp_rotation(step[:3]) @ pose[:3, :3], pose[:3, 3] + step[3:])
            if (there := at(moved))[0] <= cost:
                pose, (cost, sights) = moved, there
                break
            step = 0.5 * step
        else:
            break
        if gain < SETTLED:
            break
    return pose, sights


def _loose(rig: Rig, points: KnownPoints, sights: Sequence[Sequence[_Sight]], bends: int, alone: int) -> Array:
    """Standard deviations (N,) of changes that are thought of at most."""
    focal, centre, lens, turn, shift = LOOSE
    distance = float(np.median([one.distance_mm for frame in sights for one in frame]))
    parts = list[float]()
    for camera in rig.cameras:
        fx, fy, *more = camera.params.tolist()
        parts += [focal * fx, focal * fy, *[centre * camera.image_size[0]] * 2, *[lens] * (len(more) - 2)]
        parts += [turn] * 3 + [shift * distance] * 3
    size = float(np.ptp(points.position_mm, axis=0).max())
    return np.array([*parts, LOOSE_SIZE, *[LOOSE_BEND * size] * bends, *[1.0] * alone])


def _field(one: _Sight, camera: Camera, field_px: float) -> Array:
    """Of standard normal numbers that make a field over the image of this root mean square.  # (M, 2, 2 K)"""
    side = 0.5 * (np.array(camera.image_size) - 1)
    x, y = np.clip((one.given.center_px + one.off_px) / side - 1, -1, 1).T
    px, py = (np.polynomial.legendre.legvander(value, FIELD_DEGREE) for value in (x, y))
    size = field_px / np.sqrt(len(FIELD))
    every = np.column_stack([size * np.sqrt((2 * i + 1) * (2 * j + 1)) * px[:, i] * py[:, j] for i, j in FIELD])
    moved: Array = (one.given.whiten[:, :, :, None] * every[:, None, None, :]).reshape(len(x), 2, -1)
    return moved


def _free(
    rig: Rig, sights: Sequence[Sequence[_Sight]], modes_mm: Array, field_px: Array, scale: Array, loose: Array
) -> tuple[tuple[_FrameScores, ...], Array]:
    """What frames tell, their poses projected off, and the unknowns (N,) that fit best if all may be anything."""
    frames = []
    for frame in sights:
        camera = np.concatenate([np.repeat(one.given.camera, 2 * len(one.given.point)) for one in frame])
        weight = 1 / scale[camera]
        by_all, first = np.zeros((len(weight), len(loose))), 0
        for one in frame:
            last = first + 2 * len(one.given.point)
            start, end = rig.first_row[one.given.camera], rig.first_row[one.given.camera + 1]
            by_all[first:last, start:end] = one.by_camera.reshape(last - first, -1)
            by_modes = np.einsum("mij,smj->mis", one.by_place, modes_mm[:, one.given.point])
            by_all[first:last, rig.first_row[-1] : rig.first_row[-1] + len(modes_mm)] = by_modes.reshape(
                last - first, -1
            )
            if field_px[one.given.camera] > 0:
                before = 2 * len(FIELD) * int((field_px[: one.given.camera] > 0).sum())
                start = rig.first_row[-1] + len(modes_mm) + before
                moved = _field(one, rig.cameras[one.given.camera], float(field_px[one.given.camera]))
                by_all[first:last, start : start + 2 * len(FIELD)] = moved.reshape(last - first, -1)
            first = last
        by_pose = weight[:, None] * np.concatenate([one.by_pose.reshape(-1, POSE) for one in frame])
        pose = np.linalg.qr(by_pose / np.linalg.norm(by_pose, axis=0))[0]
        residual = weight * np.concatenate([one.residual.ravel() for one in frame])
        by_all *= weight[:, None]
        frames.append(_FrameScores(
            camera, np.repeat(np.concatenate([one.given.point for one in frame]), 2),
            residual - pose @ (pose.T @ residual), by_all - pose @ (pose.T @ by_all),
            weight[:, None] * np.concatenate([one.by_place.reshape(-1, 3) for one in frame]), pose, tuple(frame),
        ))  # fmt: skip
    normal = np.sum([one.normal for one in frames], axis=0) + np.diag(loose**-2.0)
    gradient = np.sum([one.gradient for one in frames], axis=0)
    return tuple(frames), symmetric_inverse(normal).inverse @ gradient


def _noise(frames: Sequence[_FrameScores], free: Array, loose: Array, cameras: int) -> tuple[Array, int]:
    """The noise of each camera's residuals over photos' smooth directions (C,), and the least degrees of freedom."""
    normal = np.sum([one.normal for one in frames], axis=0) + np.diag(loose**-2.0)
    inverse = symmetric_inverse(normal).inverse
    square, freedom = np.zeros((2, cameras)), np.zeros((2, cameras))  # of smooth directions, and of all
    for frame in frames:
        left = frame.left(free)
        for one, rows, basis in frame.smooth:
            taken = (frame.by_all[rows] @ inverse * frame.by_all[rows]).sum() + (frame.pose[rows] ** 2).sum()
            for k, part in enumerate((basis.T @ left[rows], left[rows])):
                square[k, one.given.camera] += float(part @ part)
                freedom[k, one.given.camera] += len(part) - taken
    seen_by = freedom[1] > 0
    use = 0 if (freedom[0][seen_by] >= LEAST_FREEDOM).all() else 1
    least = max(int(freedom[use][seen_by].min(initial=np.inf)), 1) if seen_by.any() else 1
    noise = np.sqrt(square[use] / np.maximum(freedom[use], 1.0))
    return np.where(seen_by, np.maximum(noise, LEAST_SIGMA), 1.0), least


def _smooth(one: _Sight, frame: _FrameScores, rows: slice) -> Array:
    """An orthonormal basis of polynomials over a photo, and of all that poses and cameras do.  # (2 M, Q)"""
    place = one.given.center_px + one.off_px  # predicted: what is measured has the noise in it
    place = place - place.mean(axis=0)
    x, y = (place / np.maximum(np.abs(place).max(axis=0), 1e-9)).T
    degree = next((d for d in range(DEGREE, 0, -1) if (d + 1) * (d + 2) <= len(x)), 0)
    powers = np.column_stack([x**i * y**j for i in range(degree + 1) for j in range(degree + 1 - i)])
    columns = (one.given.whiten[:, :, None, :] * powers[:, None, :, None]).reshape(len(x) * 2, -1)
    every = np.column_stack([columns, frame.pose[rows], frame.by_all[rows]])
    length = np.linalg.norm(every, axis=0)
    moves = length > ROUNDING * length.max()
    left, value, _ = np.linalg.svd(every[:, moves] / length[moves], full_matrices=False)
    basis: Array = left[:, value > 1e-6 * value[0]]
    return basis
