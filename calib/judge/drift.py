"""Whether cameras are still as their file says, by a few photos of a target: a test with a stated false-alarm rate.

    test = drift_test(rig, observations, prior)
    test.p, test.is_changed, test.visible["left"].turn_rad

With the whitened residuals r = measured - predicted of the file's cameras, poses solved, to first order

    r = J d + P p + T t + e,

d being what the cameras (parameters and places) are off, p the poses, t the errors of the target as its making lets
expect them (standard normal numbers, see `ShapePrior`), e noise. Poses are projected off, which leaves scores g and
information F of w = (d, t). If nothing changed, d has the covariance S that the file states, and g the covariance
`V = s^2 F + F diag(S, 1) F`; a change A x moves g by `F A x`. In coordinates z in which V is one and the change D x,
the squared length W of what a hypothesis explains of z is chi-squared if nothing changed (the score test: Rao 1948).

*Noise.* s is no statement of the detector: what errs smoothly over the image (a bend, a blur, a lens that its model
does not quite follow) counts for more in z than in single residuals. So s^2 is the mean square of what is left over,
all of d and p fitted, of polynomials over each photo: directions as smooth as a lens, in which no lens nor pose goes.
For independent noise that is the usual estimate with fewer degrees of freedom n, and W / s^2 has an F distribution.

*Which test.* A change may be of a focal length alone, or of anything. So each hypothesis has its W and its p by n, and
the least p of all is held against its own distribution, drawn from the same normal and chi-squared numbers: the rate of
false alarms is that which was asked for, however many hypotheses overlap.

*Causes.* A hypothesis explains what is seen if nothing of z is left over beyond chance. It is named if none of the
others, that do not contain it, explains the same.
"""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Literal

import numpy as np

from calib.cameras.camera import Camera
from calib.cameras.rig import POSE, Rig
from calib.core.linear_algebra import symmetric_inverse
from calib.core.parallel import one_thread
from calib.core.se3 import exp_rotation, invert, make_pose, skew
from calib.core.types import LEAST_POINTS, KnownPoints, RigObservations, keep_frames, keep_views, sightings_per_view
from calib.solver.calibration import is_flat, plane_bend
from calib.solver.free_bend import bend_sigma_mm
from calib.solver.outliers import LEAST_SIGMA, MEDIAN_LENGTH
from calib.solver.start import solve_poses
from calib.space.propagate import covariance_factor, linear_sight, whitening
from designer.base.arrays import Array, Flags, Rows
from designer.tolerance.prior import ShapePrior

DRAWS = 20_000
POWER = 0.95
MOST_PARAMETERS = 20
"""Of a camera that are tested one by one; of one with more, as a spline, the linear part is."""
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
EXPLAINS, RULED_OUT = 0.01, 0.001
"""Probability of what a hypothesis leaves over, from which on it explains all, and below which it is no explanation."""
LOOSE = (0.2, 0.2, 1.0, 0.3, 0.3)
"""What is thought of at most: focal length, principal point (of the width), lens, turn (rad), shift (of distance)."""
LOOSE_SIZE, LOOSE_BEND = 0.1, 0.05
FIELD_DEGREE = 7
FIELD = tuple((i, j) for i in range(FIELD_DEGREE + 1) for j in range(FIELD_DEGREE + 1 - i) if i + j > 1)
"""Of polynomials over the image, for what a lens's model does not follow."""
LEAST_GROUPS, MOST_GROUPS, SURELY_MORE = 3, 8, 1.3
"""Of the calibration's own photos, tested as these are; and the variance from which on they surely deviate by more."""
AS_MANY = 20
"""Photos such as these, that a camera of which nobody states how sure it is is taken to be solved from."""

What = Literal["focal length", "principal point", "lens", "turn", "shift", "place", "anything", "size", "bend"]
"""That may have changed: of a camera, or of the target."""


@dataclass(frozen=True, eq=False)
class DriftHypothesis:
    """Something that may have changed, and what the photos say of it."""

    camera: str  # "": all, or the target
    what: What
    p: float  # probability of so much if nothing changed
    left_p: float  # of so much as it leaves over
    amount: Array  # (K,) px, rad, mm, or a part of the focal length or the target's size
    sigma: Array  # (K,)
    visible: float  # the least change of its kind that would be found, in the direction in which it is seen least
    rows: frozenset[int]  # of the unknowns that change

    @property
    def explains(self) -> bool:
        """Whether nothing is left over beyond chance."""
        return self.left_p >= EXPLAINS


@dataclass(frozen=True)
class LeftOut:
    """A photo, or a frame, that was not counted."""

    frame: str
    reason: str


@dataclass(frozen=True, eq=False)
class DriftTest:
    """What photos say of cameras: `test.is_changed`."""

    p: float  # probability of photos like these if nothing changed
    false_alarms: float  # the rate that was asked for
    explanations: tuple[DriftHypothesis, ...]  # of each hypothesis
    causes: tuple[DriftHypothesis, ...]  # that cannot be told apart; one: it is that; (): none explains what is seen
    frames: tuple[str, ...]  # that counted
    left_out: tuple[LeftOut, ...]
    contradict: bool  # the photos say different things of the cameras
    noise: Array  # (C,) standard deviations, in those that are stated, or px
    freedom: int  # degrees of freedom of the noise
    distance_mm: float  # from a camera to the target, the median
    center_px: tuple[Array, ...]  # (C,) of (M, 2)
    residual_px: tuple[Array, ...]  # (C,) of (M, 2) predicted - measured by the file's cameras

    @property
    def is_changed(self) -> bool:
        """Whether something changed beyond chance."""
        return self.p <= self.false_alarms

    def of(self, camera: str, what: What) -> DriftHypothesis | None:
        """One explanation; None: there is no such hypothesis."""
        return next((one for one in self.explanations if (one.camera, one.what) == (camera, what)), None)


@dataclass(frozen=True, eq=False)
class Reference:
    """What cameras are said to be, and what else their calibration knows of their photos."""

    rig: Rig  # with the covariance that its file states, if it does
    photo_covariance: Array | None = None  # (N, N) of what errors do that a single photo's centres share
    field_px: Array | None = None  # (C,) of what is fixed in the image and no lens of the model follows
    scale: Array | None = None  # (C,) noise of its photos, in standard deviations that are stated
    photos: RigObservations | None = None  # that it was solved from


@one_thread
def drift_test(
    reference: Reference, observations: RigObservations, prior: ShapePrior | None = None, *,
    false_alarms: float = 0.01, is_exact: bool = False, seed: int = 0,
) -> DriftTest | None:  # fmt: skip
    """Test whether cameras are as their file says; None where no frame has a pose.

    Args:
        reference: the cameras, one or more.
        observations: of the rig's cameras, by their names.
        prior: of the target's points; None: nobody knows, and a flat one may be bent as others' boards are.
        false_alarms: how often the test says "changed" of cameras that are as their file says.
        is_exact: the target is as its file says.
        seed: of the numbers that the distribution is drawn from.
    """
    modes = _modes(observations.points, prior, is_exact=is_exact)
    names, left = list(observations.frame_names), list[LeftOut]()
    while True:
        seen = _photos(reference, observations, *modes)
        if seen is None:
            return None
        lost = set(range(len(names))) - set(seen.number)
        odd = seen.odd_frame()
        if odd is not None and len(seen.frames) > 2:
            lost.add(seen.number[odd[0]])
            left.append(LeftOut(names[seen.number[odd[0]]], odd[1]))
        elif not lost:
            more = _dispersion(reference, len(names), is_exact=is_exact)
            return _tested(seen, more, names, left, false_alarms, seed, contradict=odd is not None)
        left += [
            LeftOut(names[k], "too little of the target is seen")
            for k in sorted(lost - {seen.number[odd[0]] if odd else -1})
        ]
        observations = keep_frames(observations, ~np.isin(np.arange(len(names)), list(lost)))
        names = list(observations.frame_names)


def _modes(points: KnownPoints, prior: ShapePrior | None, *, is_exact: bool) -> tuple[Array, Array]:
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

    def left(self, found: Array) -> Array:
        """What unknowns (N,) leave over.  # (R,)"""
        left: Array = self.residual - self.by_all @ found
        return left


@dataclass(frozen=True, eq=False)
class _Photos:
    """All that counts, to first order about the file's cameras, in standard deviations of the noise."""

    reference: Reference
    points: KnownPoints
    number: tuple[int, ...]  # (V,) of the frames that have a pose
    sights: tuple[tuple[_Sight, ...], ...]  # of each frame
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
    def distance_mm(self) -> float:
        """From a camera to the target, the median."""
        return float(np.median([one.distance_mm for frame in self.sights for one in frame]))

    @cached_property
    def normal(self) -> Array:
        """Of all frames.  # (N, N)"""
        return np.asarray(np.sum([one.normal for one in self.frames], axis=0))

    @cached_property
    def gradient(self) -> Array:
        """Of all frames.  # (N,)"""
        return np.asarray(np.sum([one.gradient for one in self.frames], axis=0))

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
            basis = _standard(one.normal)
            by_all = basis.T @ one.normal
            off = basis.T @ one.gradient - by_all @ others @ (self.gradient - one.gradient)
            spread = np.eye(len(off)) + by_all @ others @ by_all.T
            p[k] = fdtrc(len(off), self.freedom, float(off @ np.linalg.solve(spread, off)) / len(off))
        worst = int(p.argmin())
        if p[worst] * count > ODD:
            return None
        return worst, "it contradicts the others: another camera, zoom or focus, or something moved meanwhile"


def _standard(normal: Array) -> Array:
    """Directions (N, Q) in which scores of this covariance are independent and of size one; rounding left out."""
    scale = np.sqrt(np.diagonal(normal).clip(min=0.0))
    unit = np.where(scale > 0, 1 / np.where(scale > 0, scale, 1.0), 0.0)
    value, vector = np.linalg.eigh(normal * unit[:, None] * unit)
    keep = value > ROUNDING * value[-1:]
    basis: Array = unit[:, None] * vector[:, keep] / np.sqrt(value[keep])
    return basis


def _photos(reference: Reference, seen: RigObservations, modes_mm: Array, own_mm: Array) -> _Photos | None:
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
    noise, freedom = _noise(frames, free, sights, loose, len(scale))
    if reference.scale is not None:  # which says what other photos leave over of this lens
        noise = np.where(reference.scale > MORE * noise * scale, reference.scale / scale, noise)
    frames, free = _free(rig, sights, modes, field_px, scale * noise, loose)
    return _Photos(
        reference, points, tuple(found), sights, frames, 1 + len(bend), own_mm, scale * noise, freedom, loose, free
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
        rows = [np.repeat(value, 2 * len(one.given.point)) for one in frame for value in [one.given.camera]]
        weight = 1 / scale[np.concatenate(rows)]
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
            np.concatenate(rows), np.repeat(np.concatenate([one.given.point for one in frame]), 2),
            residual - pose @ (pose.T @ residual), by_all - pose @ (pose.T @ by_all),
            weight[:, None] * np.concatenate([one.by_place.reshape(-1, 3) for one in frame]), pose,
        ))  # fmt: skip
    normal = np.sum([one.normal for one in frames], axis=0) + np.diag(loose**-2.0)
    gradient = np.sum([one.gradient for one in frames], axis=0)
    return tuple(frames), symmetric_inverse(normal).inverse @ gradient


def _noise(
    frames: Sequence[_FrameScores], free: Array, sights: Sequence[Sequence[_Sight]], loose: Array, cameras: int
) -> tuple[Array, int]:
    """The noise of each camera's residuals over photos' smooth directions (C,), and the least degrees of freedom."""
    normal = np.sum([one.normal for one in frames], axis=0) + np.diag(loose**-2.0)
    inverse = symmetric_inverse(normal).inverse
    square, freedom = np.zeros((2, cameras)), np.zeros((2, cameras))  # of smooth directions, and of all
    for frame, seen in zip(frames, sights, strict=True):
        left, first = frame.left(free), 0
        for one in seen:
            rows = slice(first, first := first + 2 * len(one.given.point))
            taken = (frame.by_all[rows] @ inverse * frame.by_all[rows]).sum() + (frame.pose[rows] ** 2).sum()
            smooth = _smooth(one, frame, rows)
            for k, part in enumerate((smooth.T @ left[rows], left[rows])):
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


def _hypotheses(seen: _Photos) -> Iterator[tuple[str, What, Array]]:
    """What may have changed: of which camera, what, and the unknowns (N, K) by its K numbers."""
    rig, total = seen.rig, len(seen.gradient)
    shown = sorted({one.given.camera for frame in seen.sights for one in frame})
    columns = np.eye(total)
    every = list[int]()
    for camera in shown:
        name, params, pose = rig.names[camera], rig.params_rows(camera), rig.pose_rows(camera)
        focal = np.zeros((total, 1))
        focal[params.start : params.start + 2, 0] = rig.cameras[camera].params[:2]
        tested = [*range(params.start, min(params.stop, params.start + MOST_PARAMETERS))]
        if params.stop - params.start > MOST_PARAMETERS:
            tested = tested[:4]
        yield name, "focal length", focal
        yield name, "principal point", columns[:, params.start + 2 : params.start + 4]
        yield name, "lens", columns[:, tested]
        every += tested
        if len(shown) > 1:
            yield name, "turn", columns[:, pose][:, :3]
            yield name, "shift", columns[:, pose][:, 3:]
            yield name, "place", columns[:, pose]
            every += range(pose.start, pose.stop)
    yield "", "anything", columns[:, every]
    first = seen.count
    if len(shown) > 1:
        yield "", "size", columns[:, first : first + 1]
    if seen.extra > 1:
        yield "", "bend", columns[:, first + 1 : first + seen.extra]


@dataclass(frozen=True, eq=False)
class _Weighed:
    """A hypothesis in coordinates in which what is seen has a covariance of one if nothing changed."""

    camera: str
    what: What
    rows: frozenset[int]
    basis: Array  # (Q, K) orthonormal, of where it moves what is seen
    moved: Array  # (Q, n) by its own numbers


def _dispersion(reference: Reference, count: int, *, is_exact: bool) -> tuple[float, int | None]:
    """By how much groups of so many of the calibration's own photos deviate more than is expected; how many groups.

    That is what no statement of a calibration knows of, as a lens that is of another kind in the corners.
    """
    photos = reference.photos
    if photos is None or photos.frame_count < LEAST_GROUPS * count:
        return 1.0, None
    groups = min(photos.frame_count // count, MOST_GROUPS)
    own = np.arange(photos.frame_count)
    square, size = 0.0, 0
    alone = replace(reference, rig=replace(reference.rig, covariance=None))
    for group in range(groups):
        some = keep_frames(
            photos, (own % (photos.frame_count // count) == group) & (own < photos.frame_count // count * count)
        )
        seen = _photos(alone, some, *_modes(photos.points, None, is_exact=is_exact))
        if seen is not None:
            z = _in_standard(seen, 1.0)[0]
            square, size = square + float(z @ z), size + len(z)
    # Photos that a camera was solved from deviate less from it than new ones, by the share that they are of all.
    found = square / max(size * (1 - count / photos.frame_count), 1.0)
    return (float(np.sqrt(found)), groups) if found > SURELY_MORE else (1.0, None)


def _in_standard(seen: _Photos, own: float) -> tuple[Array, list["_Weighed"]]:
    """What is seen where it has a covariance of one if nothing changed, z and by all hypotheses.

    Args:
        seen: the photos.
        own: variance of scores by noise and by a camera of which nobody states how sure it is.
    """
    standard = _standard(seen.normal)
    by_all = standard.T @ seen.normal
    moved, alone = by_all @ seen.covariance_factor, standard.T @ seen.by_rings
    white = np.linalg.inv(np.linalg.cholesky(own * np.eye(len(by_all)) + moved @ moved.T + alone @ alone.T))
    z = white @ (standard.T @ seen.gradient)
    every = [_weighed(white @ by_all, *one) for one in _hypotheses(seen)]
    left, value, _ = np.linalg.svd(np.column_stack([one.basis for one in every]), full_matrices=False)
    space = left[:, value > 1e-8]
    every = [replace(one, basis=space.T @ one.basis, moved=space.T @ one.moved) for one in every]
    return space.T @ z, every


def _tested(
    seen: _Photos, dispersion: tuple[float, int | None], names: Sequence[str], left: Sequence[LeftOut],
    false_alarms: float, seed: int, *, contradict: bool,
) -> DriftTest:  # fmt: skip
    """The test itself."""
    known = seen.rig.covariance is not None
    z, every = _in_standard(seen, 1.0 if known else 1.0 + len(seen.frames) / AS_MANY)
    more, groups = dispersion
    seen = seen if groups is None else replace(seen, freedom=groups)
    z, every = z / more, [replace(one, moved=one.moved / more) for one in every]
    told = [one for one in every if one.what not in ("size", "bend")]  # errors of the target are no change of a camera

    rng = np.random.default_rng(seed)
    drawn = rng.standard_normal((DRAWS, len(z)))
    spread = rng.chisquare(seen.freedom, DRAWS) / seen.freedom
    size = np.array([one.basis.shape[1] for one in told])
    square = np.stack([((drawn @ one.basis) ** 2).sum(axis=1) / spread for one in told], axis=1)
    smallest = np.sort(_by_chance(size, seen.freedom, square).min(axis=1))
    found = np.array([((z @ one.basis) ** 2).sum() for one in told])
    least = float(_by_chance(size, seen.freedom, found).min())
    p = min(float(1 + np.searchsorted(smallest, least, side="right")) / (DRAWS + 1), len(told) * least)
    limit = float(np.quantile(smallest, false_alarms))
    explanations = tuple(_explained(one, z, seen.freedom, limit) for one in every)
    changed = p <= false_alarms and not contradict
    sights = [one for frame in seen.sights for one in frame]
    own = [[one for one in sights if one.given.camera == c] for c in range(len(seen.rig.cameras))]
    return DriftTest(
        p, false_alarms, explanations, _causes(explanations) if changed else (), tuple(names), tuple(left), contradict,
        seen.scale, seen.freedom, seen.distance_mm,
        tuple(np.concatenate([np.zeros((0, 2)), *(one.given.center_px for one in each)]) for each in own),
        tuple(np.concatenate([np.zeros((0, 2)), *(one.off_px for one in each)]) for each in own),
    )  # fmt: skip


def _by_chance(size: Array, freedom: int, square: Array) -> Array:
    """Probabilities of squares that are as large (..., H), sums of so many of independent normal numbers (H,)."""
    from scipy.special import fdtrc

    most = np.maximum(size, 1)
    return np.where(size > 0, np.asarray(fdtrc(most, freedom, square / most)), 1.0)


def _weighed(white: Array, camera: str, what: What, change: Array) -> _Weighed:
    moved = white @ change
    left, value, _ = np.linalg.svd(moved / np.maximum(np.linalg.norm(moved, axis=0), 1e-300), full_matrices=False)
    rows = frozenset(np.flatnonzero(np.abs(change).sum(axis=1)).tolist())
    return _Weighed(camera, what, rows, left[:, value > 1e-6], moved)


def _explained(one: _Weighed, z: Array, freedom: int, limit: float) -> DriftHypothesis:
    """What is said of a hypothesis, and what of its kind would be seen."""
    from scipy.special import fdtri, ncfdtrinc

    size = np.array([one.basis.shape[1], len(z) - one.basis.shape[1]])
    explained = float(((z @ one.basis) ** 2).sum())
    p, left_p = _by_chance(size, freedom, np.array([explained, max(float(z @ z) - explained, 0.0)])).tolist()
    most = max(size[0], 1)
    critical = float(fdtri(most, freedom, 1 - limit))
    apart = np.sqrt(ncfdtrinc(most, freedom, 1 - POWER, critical))  # found with the power asked for
    values = np.linalg.svd(one.moved, compute_uv=False)
    solved = symmetric_inverse(one.moved.T @ one.moved)
    weakest = float(values[-1]) if one.basis.shape[1] == one.moved.shape[1] else 0.0
    return DriftHypothesis(
        one.camera, one.what, p, left_p,
        solved.inverse @ (one.moved.T @ z), np.sqrt(np.diagonal(solved.covariance)),
        float(apart) / weakest if weakest > 0 else np.inf, one.rows,
    )  # fmt: skip


def _causes(explanations: Sequence[DriftHypothesis]) -> tuple[DriftHypothesis, ...]:
    """The simplest explanations that leave nothing over; and with them those that are not ruled out.

    What contains another one that explains all is no cause of its own.
    """
    able = [one for one in explanations if one.left_p > RULED_OUT and one.what != "anything"]
    if not any(one.explains for one in able):
        return ()
    return tuple(one for one in able if not any(other.rows < one.rows and other.explains for other in able))
