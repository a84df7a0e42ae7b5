"""The first guess of a rig: each camera alone, joined by the frames that two of them saw.

Two cameras that saw the target in the same frame know where they stand to each other; of many such frames the guess is
the one most others agree with. A tree of the pairs that agree in most frames then places all cameras: those that share
no frame are chained by others.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from calib.cameras import parameter_names
from calib.cameras.camera import Camera
from calib.core.se3 import invert, log_rotation
from calib.core.types import LEAST_POINTS, Observations, RigObservations, keep_views, sightings_per_view
from calib.rigs.motion import LEAST_BETWEEN, Trajectory, delay_between
from calib.rigs.problem import CameraChoice, RigOptions, RigProblem, RigState, frame_times, seen_poses, with_scale
from calib.solver.accuracy import UndeterminedError
from calib.solver.blocks import RobustLoss, view_misfit
from calib.solver.calibration import Calibration
from calib.solver.outliers import deviations
from calib.solver.priors import ParameterPrior
from calib.solver.problem import SolveOptions, Tie, tie_parameters
from calib.solver.solve import solve
from calib.solver.start import solve_poses
from designer.base.arrays import Array, Flags
from designer.base.errors import InputError

MOST_GUESSES = 200
"""Of the place of one camera against another's, that are compared."""
AGREES = 3.0
"""Times the median difference from the chosen guess."""
LEAST_DIFFERENCE = 1e-3
"""In radians, or parts of the target's distance."""


@dataclass(frozen=True, eq=False)
class Alone:
    """One camera by itself."""

    camera: Camera
    tie: Tie
    cam_from_target: Array  # (V_c, 4, 4) nan where it has no pose of its own
    scale: float  # standard deviation of an observation: px, or in units of the stated covariance
    solved: Calibration | None = None  # None: its lens was given
    view_rms: Array | None = None  # (V_c, 2) of `view_rms`; nan: it has no pose
    priors: tuple[ParameterPrior, ...] = ()


def solve_alone(seen: Observations, name: str, choice: CameraChoice, options: RigOptions) -> Alone:
    """A camera's parameters and its own poses, from its sightings alone, or with the parameters that are given.

    Raises:
        InputError: its photos are too few for it to be solved.
    """
    poses = np.full((seen.view_count, 4, 4), np.nan)
    many = sightings_per_view(seen) >= LEAST_POINTS
    part = keep_views(seen, many)
    if choice.given is not None:
        camera = choice.given
        if camera.image_size != seen.image_size:
            raise InputError(
                f"camera {name}: photos of {seen.image_size[0]} x {seen.image_size[1]} px, but its parameters are "
                f"for {camera.image_size[0]} x {camera.image_size[1]} px; give those of these photos"
            )
        found = solve_poses(camera, part, weighted=options.weighted)
        poses[many] = found.cam_from_target
        rms = np.full((seen.view_count, 2), np.nan)
        rms[many] = view_rms(part, found.residual_px)
        return Alone(camera, _tie(camera.model, choice), poses, found.scale, None, rms, choice.priors)
    fixed = SolveOptions(weighted=options.weighted, fixed=choice.fixed, priors=choice.priors)
    wanted = replace(
        fixed, loss=options.loss, reject_sigma=options.reject_sigma, free_bend=options.free_bend,
        bend_sigma_mm=options.bend_sigma_mm,
    )  # fmt: skip
    try:
        solved = solve(part, choice.model, wanted)
    except UndeterminedError as error:
        raise UndeterminedError(f"camera {name}: {error}, or give its parameters from an earlier run") from None
    except InputError as error:
        raise InputError(f"camera {name}: {error}") from None
    number = {view: row for row, view in enumerate(seen.view_names)}
    rows = [number[view] for view in solved.observations.view_names]
    poses[rows] = solved.cam_from_target
    rms = np.full((seen.view_count, 2), np.nan)
    rms[rows] = view_rms(solved.observations, solved.residual_px)
    return Alone(solved.camera, tie_parameters(choice.model, fixed), poses, solved.scale, solved, rms, choice.priors)


def view_rms(seen: Observations, residual_px: Array) -> Array:
    """Root mean square length of each view's residuals (M, 2): in robust deviations, and in px.  # (V, 2)"""
    length = np.stack([deviations(residual_px.T, seen.cov_px2), np.hypot(*residual_px.T)])
    count = np.maximum(np.bincount(seen.view, minlength=seen.view_count), 1)
    return np.sqrt([np.bincount(seen.view, one**2, seen.view_count) / count for one in length]).T


def _tie(model: str, choice: CameraChoice) -> Tie:
    """Of a given camera."""
    if choice.is_refined:
        return tie_parameters(model, SolveOptions(fixed=choice.fixed, priors=choice.priors))
    names = parameter_names(model)
    return Tie(np.full(len(names), -1), np.full(len(names), np.nan), names)


def synchronised(observations: RigObservations, alone: Sequence[Alone]) -> tuple[list[Alone], Array]:
    """The cameras with their own poses at the frames' times, and each clock against the first camera's.  # (C,)

    A camera that shares too few frames with others, or whose target did not move, keeps a delay of zero.
    """
    time = frame_times(observations)
    known = [np.isfinite(one.cam_from_target[:, 0, 0]) for one in alone]
    stamp = [times[ok] for times, ok in zip(observations.time_s or (), known, strict=True)]
    pose = [one.cam_from_target[ok] for one, ok in zip(alone, known, strict=True)]
    moves = [len(np.unique(times)) == len(times) >= 2 * LEAST_BETWEEN for times in stamp]
    path = [Trajectory(stamp[c], pose[c]) if moves[c] else None for c in range(len(alone))]
    delay, shared = np.zeros(len(alone)), observations.shared
    placed = {0}
    while len(placed) < len(alone):
        left = [c for c in range(len(alone)) if c not in placed]
        new, known_one = max(((c, d) for c in left for d in sorted(placed)), key=lambda pair: shared[pair])
        other = path[known_one]
        if moves[new] and other is not None:
            order = np.argsort(stamp[new])
            delay[new] = delay[known_one] + delay_between(stamp[new][order], pose[new][order], other)
        placed.add(new)
    moved = []
    for c, one in enumerate(alone):
        own, track = one.cam_from_target.copy(), path[c]
        if track is not None:
            there = track.at(time[observations.frame[c]] + delay[c])
            use = np.isfinite(there[:, 0, 0]) & known[c]
            own[use] = there[use]
        moved.append(replace(one, cam_from_target=own))
    return moved, delay


def joined(observations: RigObservations, alone: Sequence[Alone], reference: int) -> Array:
    """Where the cameras stand against one of them.  # (C, 4, 4) cam_from_reference

    Raises:
        InputError: no frames join some cameras to the others.
    """
    count = observations.camera_count
    votes = np.zeros((count, count))
    between = np.tile(np.eye(4), (count, count, 1, 1))
    for first in range(count):
        for second in range(first + 1, count):
            guess, support = _between(observations, alone, first, second)
            if guess is not None:
                between[first, second], between[second, first] = guess, invert(guess)
                votes[first, second] = votes[second, first] = support
    placed, pose = {reference}, np.tile(np.eye(4), (count, 1, 1))
    while len(placed) < count:
        inside = sorted(placed)
        outside = [number for number in range(count) if number not in placed]
        edges = votes[np.ix_(outside, inside)]
        if not edges.any():
            raise InputError(_parts(observations, votes))
        new, known = np.unravel_index(int(edges.argmax()), edges.shape)
        pose[outside[new]] = between[outside[new], inside[known]] @ pose[inside[known]]
        placed.add(outside[new])
    return pose


def _between(
    observations: RigObservations, alone: Sequence[Alone], first: int, second: int
) -> tuple[Array | None, float]:
    """The first camera's pose against the second's, and how many frames agree on it."""
    _, at_first, at_second = np.intersect1d(observations.frame[first], observations.frame[second], return_indices=True)
    one, other = alone[first].cam_from_target[at_first], alone[second].cam_from_target[at_second]
    known = np.isfinite(one[:, 0, 0]) & np.isfinite(other[:, 0, 0])
    rows = np.flatnonzero(known)
    rows = rows[np.linspace(0, len(rows) - 1, min(len(rows), MOST_GUESSES)).astype(int)] if len(rows) else rows
    if not len(rows):
        return None, 0.0
    guess, apart = relative_poses(one[rows], other[rows])
    best = int(np.median(apart, axis=1).argmin())
    agree = apart[best] <= AGREES * np.median(apart[best])
    return guess[best], float((1 / (1 + (apart[best, agree] / 0.1) ** 2)).sum())


def relative_poses(one: Array, other: Array) -> tuple[Array, Array]:
    """Poses (N, 4, 4) against others, and how far these lie apart (N, N): radians and parts of the distance, summed."""
    guess = one @ invert(other)
    far = np.median(np.linalg.norm(np.concatenate([one[:, :3, 3], other[:, :3, 3]]), axis=1))
    turn = np.linalg.norm(log_rotation(guess[:, None, :3, :3] @ guess[None, :, :3, :3].swapaxes(-1, -2)), axis=-1)
    way = np.linalg.norm(guess[:, None, :3, 3] - guess[None, :, :3, 3], axis=-1) / far
    return guess, turn + way + LEAST_DIFFERENCE


def _parts(observations: RigObservations, votes: Array) -> str:
    """What to say of a rig that falls in parts, and which photos would join them."""
    names, left, parts = observations.camera_names, set(range(len(votes))), []
    while left:
        part, new = set[int](), {min(left)}
        while new:
            part |= new
            new = {other for one in new for other in np.flatnonzero(votes[one]).tolist()} - part
        parts.append(sorted(part))
        left -= part
    told = " | ".join(", ".join(names[number] for number in part) for part in parts)
    counts = [[len(observations.frame[number]) for number in part] for part in parts]
    busiest = [names[part[int(np.argmax(count))]] for part, count in zip(parts, counts, strict=True)]
    return (
        f"the rig falls in {len(parts)} parts: {told}: no frame shows the target to cameras of two of them; take "
        f"frames in which, for example, {busiest[0]} and {busiest[1]} both see it, or a camera between them"
    )


def frame_candidates(
    problem: RigProblem, observations: RigObservations, alone: Sequence[Alone], cam_from_rig: Array, origin_mm: Array
) -> tuple[Array, Flags]:
    """Each frame's pose by the camera whose own pose suits all cameras best, and which frames have one.

    The problem is thinned; `origin_mm` is its own origin.
    """
    count = observations.frame_count
    best, least = np.tile(np.eye(4), (count, 1, 1)), np.full(count, np.inf)
    cameras = tuple(one.camera for one in alone)
    for number, one in enumerate(alone):
        guess = np.full((count, 4, 4), np.nan)
        guess[observations.frame[number]] = invert(cam_from_rig[number]) @ one.cam_from_target
        known = np.isfinite(guess[:, 0, 0])
        guess[:, :3, 3] += guess[:, :3, :3] @ origin_mm
        guess[~known] = np.eye(4)
        state = RigState(cameras, cam_from_rig, guess, np.zeros(len(cameras)), np.eye(4))
        cost = np.zeros(count)
        for camera in range(len(cameras)):
            poses = seen_poses(problem, state, camera)[1]
            misfit = view_misfit(
                with_scale(problem, camera, state.amount), cameras[camera], poses, RobustLoss("cauchy")
            )
            cost[problem.seen[camera].frame] += misfit.cost
        better = known & (cost < least)
        best[better], least[better] = guess[better], cost[better]
    return best, np.isfinite(least)
