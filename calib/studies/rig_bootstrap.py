"""Bootstrap samples of a rig: frames drawn with replacement, solved again, and how far the samples scatter.

How the sightings scatter is taken from the frames themselves, so that errors which the noise of single sightings does
not explain show in the spread, and not in what the solution states.
"""

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np

from calib.cameras import parameter_names
from calib.cameras.rig import Rig
from calib.core.se3 import invert, log_rotation
from calib.core.types import RigObservations
from calib.rigs.halves import without_outliers
from calib.rigs.problem import CameraChoice, RigOptions
from calib.rigs.relative import relative
from calib.rigs.result import RigCalibration
from calib.rigs.solve import solve_rig
from calib.solver.problem import SolveOptions
from calib.studies.bootstrap import expanded
from designer.base.arrays import Array, Rows
from designer.base.errors import InputError
from designer.base.marks import Gap

LEAST_SAMPLES = 2


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


@dataclass(frozen=True, eq=False)
class RigSpread:
    """What came of all samples."""

    pairs: tuple[PairSpread, ...]
    samples: int  # that were solved
    failed: int  # that do not determine the rig, as frames that tie cameras were not drawn

    @property
    def ratio(self) -> float:
        """Spread over sigma by the noise, root mean square over places and turns of all pairs; nan: not known."""
        return _ratio([(one.place_spread_mm, one.place_sigma_mm) for one in self.pairs]
                      + [(one.turn_spread_rad, one.turn_sigma_rad) for one in self.pairs])  # fmt: skip

    @property
    def ratio_of_all(self) -> float:
        """The same over all that is stated."""
        return _ratio([(one.place_spread_mm, one.place_all_mm) for one in self.pairs]
                      + [(one.turn_spread_rad, one.turn_all_rad) for one in self.pairs])  # fmt: skip


def _ratio(pairs: Sequence[tuple[float, float]]) -> float:
    ratios = [spread / sigma for spread, sigma in pairs if sigma > 0 and math.isfinite(spread)]
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


def rig_spread(
    found: RigCalibration,
    samples: int,
    seed: int,
    options: SolveOptions,
    tell: Callable[[int], None] = lambda done: None,
) -> RigSpread:
    """Solve samples of a rig's frames, as many as there are, as all of them were solved.

    Args:
        found: the rig, without a carrier; what it left out stays out.
        samples: how many.
        seed: of what is drawn.
        options: its loss, and what it minimises.
        tell: told how many are done.

    Raises:
        InputError: hardly any sample determines the rig.
    """
    seen = without_outliers(found)
    as_solved = RigOptions(
        max(found.reference, 0), found.weighted, options.loss, allows_slack=found.slack is not None,
        minimise=options.minimise,
    )  # fmt: skip
    choices = [_choice(found, camera) for camera in range(len(found.cameras))]
    rigs, failed = [], 0
    for number in range(samples):
        drawn = np.sort(np.random.default_rng([seed, number]).integers(0, seen.frame_count, seen.frame_count))
        try:
            one = solve_rig(drawn_frames(seen, drawn), choices, as_solved)
            rigs.append(one.rig)
            failed += one.status == "degenerate"
        except (InputError, np.linalg.LinAlgError):
            failed += 1
        tell(number + 1)
    if len(rigs) < LEAST_SAMPLES:
        raise InputError(f"of {samples} samples {failed} do not determine the rig: too few frames tie its cameras")
    count, shared = len(found.cameras), found.observations.shared
    pairs = [_pair(found, rigs, a, b, int(shared[a, b])) for b in range(count) for a in range(b)]
    return RigSpread(tuple(pairs), len(rigs), failed)


def _choice(found: RigCalibration, camera: int) -> CameraChoice:
    """How a camera was solved: what has no deviation was fixed."""
    one, rows = found.cameras[camera], found.rig.params_rows(camera)
    sigma = np.diagonal(found.covariance)[rows]
    named = zip(parameter_names(one.model), one.params.tolist(), sigma.tolist(), strict=False)
    fixed = tuple((name, value) for name, value, variance in named if variance == 0)
    is_refined = found.is_refined[camera]
    return CameraChoice(one.model, one, is_refined, fixed if is_refined else ())


def _pair(found: RigCalibration, rigs: list[Rig], a: int, b: int, frames: int) -> PairSpread:
    stated = relative(replace(found, target_covariance=None).rig, a, b)
    everything = None if found.target_covariance is None else relative(found.rig, a, b)
    poses = np.stack([relative(one, a, b).b_from_a for one in rigs])
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
