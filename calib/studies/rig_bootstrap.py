"""Bootstrap samples of a rig: frames drawn with replacement, solved again, and how far the samples scatter.

How the sightings scatter is taken from the frames themselves, so that errors which the noise of single sightings does
not explain show in the spread, and not in what the solution states.
"""

import hashlib
import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import ClassVar

import numpy as np

from calib.cameras.rig import Rig
from calib.core.se3 import compose, invert, log_rotation
from calib.core.types import RigObservations
from calib.judge.joint_halves import without_outliers
from calib.rigs.problem import CameraChoice, RigOptions
from calib.rigs.relative import relative
from calib.rigs.result import RigCalibration
from calib.rigs.solve import solve_rig
from calib.solver.problem import SolveOptions
from calib.studies.bootstrap import expanded
from calib.studies.identity import StudyIdentity, digest_of, identity_of
from calib.studies.samples import SampleResult, Samples, failed_sample
from calib.studies.workers import ValuePool
from designer.base.arrays import Array, Rows
from designer.base.errors import InputError
from designer.base.marks import Gap

LEAST_SAMPLES = 2
KIND = "rig bootstrap"


@dataclass(frozen=True, eq=False)
class FramePool(ValuePool):
    """Frames of a rig, solved again as all of them were; the values of a sample are the poses of its cameras."""

    kind: ClassVar[str] = KIND
    seen: RigObservations  # without what the solution left out
    choices: tuple[CameraChoice, ...]
    options: RigOptions

    @property
    def view_count(self) -> int:
        """Frames."""
        return self.seen.frame_count

    @property
    def value_count(self) -> int:
        """Of each camera, the first three rows of `cam_from_rig`."""
        return 12 * len(self.choices)

    def sample(self, seed: int, number: int) -> SampleResult:
        """The rig of as many frames as there are, drawn with replacement."""
        drawn = np.sort(np.random.default_rng([seed, number]).integers(0, self.view_count, self.view_count))
        distinct = len(np.unique(drawn))
        try:
            found = solve_rig(drawn_frames(self.seen, drawn), self.choices, self.options)
        except (InputError, np.linalg.LinAlgError) as error:
            return failed_sample(number, distinct, self.value_count, str(error))
        message = "" if found.status == "converged" else " ".join(found.remarks[:1])
        return SampleResult(number, found.status, distinct, pose_values(found.rig), found.iterations, message)


def pose_values(rig: Rig) -> tuple[float, ...]:
    """The poses of a rig's cameras as the values of a sample, from which `poses_of` has them."""
    return tuple(rig.cam_from_rig[:, :3].ravel().tolist())


def poses_of(values: Array) -> Array:
    """`cam_from_rig` of samples (S, 12 C).  # (S, C, 4, 4)"""
    poses = np.tile(np.eye(4), (len(values), values.shape[1] // 12, 1, 1))
    poses[:, :, :3] = values.reshape(*poses.shape[:2], 3, 4)
    return poses


@dataclass(frozen=True)
class PairSpread:
    """Two cameras: how surely they are said to stand to each other, and how far samples scatter."""

    names: tuple[str, str]
    frames: int  # that both see
    baseline_mm: Gap
    baseline_sigma_mm: Gap  # as stated, by the noise
    baseline_spread_mm: Gap  # standard deviation of the samples
    place_sigma_mm: Gap  # of where the second is before the first, the length of its error
    place_spread_mm: Gap
    turn_sigma_rad: Gap  # of how it is turned, likewise
    turn_spread_rad: Gap
    place_all_mm: Gap  # stated by noise and by what the target may have done; nan: not known
    turn_all_rad: Gap


def spread_ratio(pairs: Sequence[PairSpread], *, of_all: bool = False) -> float:
    """Spread over sigma by the noise, or over all that is stated, root mean square over all pairs; nan: not known."""
    told = [(one.place_spread_mm, one.place_all_mm if of_all else one.place_sigma_mm) for one in pairs]
    told += [(one.turn_spread_rad, one.turn_all_rad if of_all else one.turn_sigma_rad) for one in pairs]
    ratios = [spread / sigma for spread, sigma in told if sigma > 0 and math.isfinite(spread)]
    return math.sqrt(float(np.mean(np.square(ratios)))) if ratios else math.nan


def drawn_frames(observations: RigObservations, drawn: Rows) -> RigObservations:
    """The sightings of frames (N,), one that is named twice as two that look alike."""
    sightings, frames, times = [], [], []
    for camera, (seen, own) in enumerate(zip(observations.sightings, observations.frame, strict=True)):
        view = np.full(observations.frame_count, -1)
        view[own] = np.arange(len(own))
        kept = np.flatnonzero(view[drawn] >= 0)
        frames.append(kept)
        sightings.append(expanded(seen, view[drawn[kept]]))
        if observations.time_s is not None:
            times.append(observations.time_s[camera][view[drawn[kept]]])
    names = tuple(f"{observations.frame_names[frame]} ({number})" for number, frame in enumerate(drawn.tolist()))
    return RigObservations(
        observations.camera_names, names, tuple(sightings), tuple(frames), tuple(times) if times else None
    )


def frame_pool(found: RigCalibration, options: SolveOptions) -> FramePool:
    """The frames of a rig without a carrier, to be solved with its loss; what it left out stays out."""
    bend = found.target_bend
    as_solved = RigOptions(
        max(found.reference, 0), found.weighted, options.loss, allows_offsets=found.slack is not None,
        minimise=options.minimise, free_bend=bend is not None, bend_sigma_mm=None if bend is None else bend.believed_mm,
    )  # fmt: skip
    return FramePool(without_outliers(found), found.choices, as_solved)


def identity(pool: FramePool, seed: int) -> StudyIdentity:
    """What makes it this study: what each camera saw in which frames, and how that is solved."""
    inputs: dict[str, Path | str] = {}
    for name, seen, frame, choice in zip(
        pool.seen.camera_names, pool.seen.sightings, pool.seen.frame, pool.choices, strict=True
    ):
        given = None if choice.given is None else choice.given.to_json()
        told = repr((digest_of(seen), frame.tolist(), given, choice.is_refined, choice.fixed, choice.priors))
        inputs[f"camera {name}"] = hashlib.sha256(told.encode()).hexdigest()
    return identity_of(seed, {"study": KIND, "options": repr(pool.options)}, inputs)


def rig_spread(found: RigCalibration, samples: Samples) -> tuple[PairSpread, ...]:
    """How far samples of a rig's frames scatter."""
    has_rig = samples.status != "failed"
    if has_rig.sum() < LEAST_SAMPLES:
        raise InputError(
            f"of {len(has_rig)} samples {(~has_rig).sum()} do not determine the rig: too few frames tie its cameras"
        )
    poses, shared = poses_of(samples.params[has_rig]), found.observations.shared
    count = len(found.cameras)
    return tuple(_pair(found, poses, a, b, int(shared[a, b])) for b in range(count) for a in range(b))


def _pair(found: RigCalibration, cam_from_rig: Array, a: int, b: int, frames: int) -> PairSpread:
    stated = relative(replace(found.rig, covariance=found.covariance), a, b)
    everything = None if found.target_covariance is None else relative(found.rig, a, b)
    poses = compose(cam_from_rig[:, b], invert(cam_from_rig[:, a]))
    center = invert(poses)[:, :3, 3]
    turn = log_rotation(poses[:, :3, :3] @ stated.b_from_a[:3, :3].T)
    return PairSpread(
        (found.observations.camera_names[a], found.observations.camera_names[b]), frames, stated.baseline_mm,
        stated.baseline_sigma_mm, float(np.linalg.norm(center, axis=1).std(ddof=1)),
        _size(stated.center_covariance_mm2), _size(np.cov(center.T)), _size(stated.covariance[:3, :3]),
        _size(np.cov(turn.T)),
        math.nan if everything is None else _size(everything.center_covariance_mm2),
        math.nan if everything is None else _size(everything.covariance[:3, :3]),
    )  # fmt: skip


def _size(covariance: Array) -> float:
    """Root mean square of an error's length."""
    return math.sqrt(max(float(np.trace(covariance)), 0.0))
