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

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Literal

import numpy as np

from calib.cameras.rig import rig_of_one
from calib.core.linear_algebra import symmetric_inverse
from calib.core.parallel import one_thread
from calib.core.se3 import skew
from calib.core.types import RigObservations, keep_frames
from calib.judge.photo_scores import PhotoScores, error_modes, photo_scores, standard_directions
from calib.judge.reference import Reference, of_one_camera
from calib.rigs.variance_components import DISAGREES
from designer.base.arrays import Array
from designer.tolerance.prior import ShapePrior

DRAWS = 20_000
POWER = 0.95
MOST_PARAMETERS = 20
"""Of a camera that are tested one by one; of one with more, as a spline, the linear part is."""
EXPLAINS, RULED_OUT = 0.01, 0.001
"""Probability of what a hypothesis leaves over, from which on it explains all, and below which it is no explanation."""
LEAST_GROUPS, GROUPS, SURELY, LEAST_LEFT = 3, 32, 0.05, 0.1
"""Of the calibration's own photos, tested as these are; the probability below which they surely deviate by more; and
how many directions have to be left for that which the camera did not take.
"""
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
    misfit: float  # by how much the calibration's own photos deviate more than it lets expect, in standard deviations
    times_free: float  # how much more the file's cameras leave over than such as may be anything
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
    modes = error_modes(observations.points, prior, is_exact=is_exact)
    reference, misfit = _apart(reference)
    names, left = list(observations.frame_names), list[LeftOut]()
    while True:
        seen = photo_scores(reference, observations, *modes)
        if seen is None:
            return None
        lost = set(range(len(names))) - set(seen.number)
        odd = seen.odd_frame()
        if odd is not None and len(seen.frames) > 2:
            lost.add(seen.number[odd[0]])
            left.append(LeftOut(names[seen.number[odd[0]]], odd[1]))
        elif not lost:
            own = _own_photos(reference, len(names), seed, is_exact=is_exact)
            return _tested(seen, own, misfit, names, left, false_alarms, seed, contradict=odd is not None)
        left += [
            LeftOut(names[k], "too little of the target is seen")
            for k in sorted(lost - {seen.number[odd[0]] if odd else -1})
        ]
        observations = keep_frames(observations, ~np.isin(np.arange(len(names)), list(lost)))
        names = list(observations.frame_names)


def _about_centres(seen: PhotoScores) -> Array:
    """All unknowns by the same, with turns of cameras about their own centres, not the rig's origin.  # (N, N)"""
    unknowns = np.eye(len(seen.gradient))
    for camera, cam_from_rig in enumerate(seen.rig.cam_from_rig):
        first = seen.rig.pose_rows(camera).start
        unknowns[first + 3 : first + 6, first : first + 3] = -skew(cam_from_rig[:3, 3])
    return unknowns


def _hypotheses(seen: PhotoScores) -> Iterator[tuple[str, What, Array]]:
    """What may have changed: of which camera, what, and the unknowns, in `_about_centres`, (N, K) by its K numbers."""
    rig, total = seen.rig, len(seen.gradient)
    shown = seen.shown
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
    more: float = 1.0  # variance in its direction, as a calibration's own photos have it


@dataclass(frozen=True)
class _OwnPhotos:
    """By how much groups of a calibration's own photos deviate more than it lets expect: a variance by hypothesis."""

    variance: Mapping[tuple[str, What], float]  # of hypotheses beyond it, each with a chance of SURELY
    surely: float  # the largest that all of them together would have with that chance; 1: none
    count: int

    def beyond(self, one: "_Weighed") -> float:
        """What the variance in the direction of a hypothesis is to be multiplied by."""
        return max(self.variance.get((one.camera, one.what), 1.0), 1.0)


def _apart(reference: Reference) -> tuple[Reference, float]:
    """A rig whose cameras' photos fit each alone, but not together, with noise that has it; and how many times more.

    What cameras do not have in common, as moments, is in all of them, whichever the adjustment laid it upon.
    """
    photos, rig = reference.photos, reference.own.rig
    if photos is None or len(photos.sightings) < 2 or reference.scale is None:
        return reference, 1.0
    none = error_modes(photos.points, None, is_exact=True)
    joint, alone = photo_scores(Reference(rig), photos, *none), np.full(len(rig.cameras), np.nan)
    for name, seen in zip(photos.camera_names, photos.sightings, strict=True):
        row = rig.row(name)
        own = photo_scores(Reference(rig_of_one(rig.cameras[row])), of_one_camera(seen), *none)
        alone[row] = np.nan if own is None else own.scale[0]
    if joint is None or not (times := float(np.nan_to_num(joint.scale / alone).max())) > DISAGREES:
        return reference, 1.0
    return replace(reference, scale=np.fmax(reference.scale, times * alone)), times


def _own_photos(reference: Reference, count: int, seed: int, *, is_exact: bool) -> _OwnPhotos | None:
    """What no statement of a calibration knows of, as a lens that is of another kind in the corners.

    It is the mean square of what each hypothesis explains of groups of so many of its own photos; None: it has too few.
    """
    from scipy.special import chdtrc

    photos = reference.photos
    modes = None if photos is None else error_modes(photos.points, None, is_exact=is_exact)
    seen = None if photos is None or modes is None else photo_scores(reference.own, photos, *modes)
    size = 0 if seen is None else min(count, len(seen.frames) // LEAST_GROUPS)
    if seen is None or not size:
        return None
    rng, total = np.random.default_rng(seed), len(seen.frames)
    own_turns = np.linalg.inv(_about_centres(seen)[: seen.count, : seen.count])
    inverse = (
        own_turns
        @ symmetric_inverse(seen.normal[: seen.count, : seen.count] + np.diag(seen.loose[: seen.count] ** -2.0)).inverse
        @ own_turns.T
    )
    square, expected, width = (dict[tuple[str, What], float]() for _ in range(3))
    for _ in range(-(-GROUPS * size // total)):
        order = rng.permutation(total)
        for first in range(0, total - size + 1, size):
            own = order[first : first + size].tolist()
            group = replace(seen, frames=tuple(seen.frames[k] for k in own))
            z, every, by_cameras = _in_standard(group, 1.0)
            z = z / group.own_noise
            for one in every:
                key, moved = (one.camera, one.what), one.basis.T @ by_cameras
                square[key] = square.get(key, 0.0) + float(((z @ one.basis) ** 2).sum())
                # Photos that a camera was solved from deviate less from it than new ones, by what it took of them.
                taken = float(np.sum((moved @ inverse) * moved))
                expected[key] = expected.get(key, 0.0) + one.basis.shape[1] - taken
                width[key] = max(width.get(key, 1), one.basis.shape[1])
    found = {key: square[key] / value for key, value in expected.items() if value > LEAST_LEFT * width[key]}
    freedom = {key: width[key] * (total // size) for key in found}
    chance = {key: float(chdtrc(freedom[key], value * freedom[key])) for key, value in found.items()}
    beyond = {key: value for key, value in found.items() if chance[key] < SURELY}
    surely = max((value for key, value in beyond.items() if chance[key] < SURELY / len(found)), default=1.0)
    return _OwnPhotos(beyond, surely, total)


def _in_standard(seen: PhotoScores, own: float) -> tuple[Array, list["_Weighed"], Array]:
    """What is seen where it has a covariance of one if nothing changed: z, by all hypotheses, and by the cameras.

    Args:
        seen: the photos.
        own: variance of scores by noise and by a camera of which nobody states how sure it is.
    """
    standard = standard_directions(seen.normal)
    by_all = standard.T @ seen.normal
    moved, alone = by_all @ seen.covariance_factor, standard.T @ seen.by_rings
    white = np.linalg.inv(np.linalg.cholesky(own * np.eye(len(by_all)) + moved @ moved.T + alone @ alone.T))
    z = white @ (standard.T @ seen.gradient)
    by_all = white @ by_all @ _about_centres(seen)
    every = [_weighed(by_all, *one) for one in _hypotheses(seen)]
    left, value, _ = np.linalg.svd(np.column_stack([one.basis for one in every]), full_matrices=False)
    space = left[:, value > 1e-8]
    every = [replace(one, basis=space.T @ one.basis, moved=space.T @ one.moved) for one in every]
    return space.T @ z, every, space.T @ white @ by_all[:, : seen.count]


def _tested(
    seen: PhotoScores, own: _OwnPhotos | None, misfit: float, names: Sequence[str], left: Sequence[LeftOut],
    false_alarms: float, seed: int, *, contradict: bool,
) -> DriftTest:  # fmt: skip
    """The test itself."""
    known = seen.rig.covariance is not None
    z, every, _ = _in_standard(seen, 1.0 if known else 1.0 + len(seen.frames) / AS_MANY)
    if own is not None:
        more = [own.beyond(one) for one in every]
        every = [replace(one, more=beyond) for one, beyond in zip(every, more, strict=True)]
        seen = seen if max(more) == 1 else replace(seen, freedom=min(seen.freedom, own.count))
    told = [one for one in every if one.what not in ("size", "bend")]  # errors of the target are no change of a camera

    rng = np.random.default_rng(seed)
    drawn = rng.standard_normal((DRAWS, len(z)))
    spread = rng.chisquare(seen.freedom, DRAWS) / seen.freedom
    size = np.array([one.basis.shape[1] for one in told])
    square = np.stack([((drawn @ one.basis) ** 2).sum(axis=1) / spread for one in told], axis=1)
    smallest = np.sort(_by_chance(size, seen.freedom, square).min(axis=1))
    found = np.array([((z @ one.basis) ** 2).sum() / one.more for one in told])
    least = float(_by_chance(size, seen.freedom, found).min())
    p = min(float(1 + np.searchsorted(smallest, least, side="right")) / (DRAWS + 1), len(told) * least)
    limit = float(np.quantile(smallest, false_alarms))
    beyond = max((one.more for one in every if one.what == "anything"), default=1.0)
    explanations = tuple(_explained(one, z, seen.freedom, limit, beyond) for one in every)
    changed = p <= false_alarms and not contradict
    of = [[one for one in seen.sights if one.given.camera == c] for c in range(len(seen.rig.cameras))]
    return DriftTest(
        p, false_alarms, explanations, _causes(explanations) if changed else (), tuple(names), tuple(left),
        misfit * (1.0 if own is None else float(np.sqrt(own.surely))), seen.times_free, contradict,
        seen.scale, seen.freedom, seen.distance_mm,
        tuple(np.concatenate([np.zeros((0, 2)), *(one.given.center_px for one in each)]) for each in of),
        tuple(np.concatenate([np.zeros((0, 2)), *(one.off_px for one in each)]) for each in of),
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


def _explained(one: _Weighed, z: Array, freedom: int, limit: float, beyond: float) -> DriftHypothesis:
    """What is said of a hypothesis, and what of its kind would be seen."""
    from scipy.special import fdtri, ncfdtrinc

    size = np.array([one.basis.shape[1], len(z) - one.basis.shape[1]])
    explained = float(((z @ one.basis) ** 2).sum())
    left = max(float(z @ z) - explained, 0.0) / beyond
    p, left_p = _by_chance(size, freedom, np.array([explained / one.more, left])).tolist()
    most = max(size[0], 1)
    critical = float(fdtri(most, freedom, 1 - limit))
    apart = np.sqrt(ncfdtrinc(most, freedom, 1 - POWER, critical))  # found with the power asked for
    values = np.linalg.svd(one.moved, compute_uv=False)
    solved = symmetric_inverse(one.moved.T @ one.moved)
    weakest = float(values[-1]) if one.basis.shape[1] == one.moved.shape[1] else 0.0
    return DriftHypothesis(
        one.camera, one.what, p, left_p,
        solved.inverse @ (one.moved.T @ z), np.sqrt(one.more * np.diagonal(solved.covariance)),
        float(apart) * np.sqrt(one.more) / weakest if weakest > 0 else np.inf, one.rows,
    )  # fmt: skip


def _causes(explanations: Sequence[DriftHypothesis]) -> tuple[DriftHypothesis, ...]:
    """The simplest explanations that leave nothing over; and with them those that are not ruled out.

    What contains another one that explains all is no cause of its own.
    """
    able = [one for one in explanations if one.left_p > RULED_OUT and one.what != "anything"]
    if not any(one.explains for one in able):
        return ()
    return tuple(one for one in able if not any(other.rows < one.rows and other.explains for other in able))
