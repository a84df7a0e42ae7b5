"""What observations, a carrier and single photos are worth, by what they themselves leave over, and the minimum there.

Each camera's noise, a carrier's own errors and the slack of photos weigh the adjustment, which in turn tells how large
they are: it is judged and solved again until both agree (variance components; Foerstner 1979). One that is next to
nothing falls by a part a round: so each round goes on by the last two (Aitken's rule for vectors; Irons and Tuck 1969).
"""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from calib.core.types import RigObservations
from calib.rigs.accuracy import Found, camera_redundancy, mechanism_sigmas, offset_size
from calib.rigs.descend import descend_rig, rig_equations
from calib.rigs.problem import OffsetPrior, RigOptions, RigProblem, RigState, seen_poses, with_scale
from calib.rigs.start import Alone
from calib.solver.blocks import RobustLoss, view_misfit
from calib.solver.levenberg import SMALL_DECREASE, DescentSteps
from calib.solver.outliers import deviations, robust_sigma, whitened
from calib.solver.problem import Loss
from designer.base.arrays import Array

ROUNDS = 25
"""Of judging what observations are worth, and solving again."""
SAME, SURELY_SAME = 3e-3, 1e-4
"""What a size may still change by, as a part of it: where slacks or a carrier follow, and where only the cameras' noise
does, so that what comes out does not hang on the order of cameras and frames."""
FARTHEST_STEP = 1.0
"""That a round may go beyond what it found, of logarithms of sizes."""
NEARLY_SMALL_DECREASE = 1e-8
"""Of the cost: a step that promises less is not taken before the last round."""
NEAR = 1e-9
LEAST_SCALE = 1e-9
LEAST_SIGMA = (1e-9, 1e-6)
"""Of a carrier's errors, rad and mm."""
DISAGREES = 2.0
"""Times the noise of a camera alone, from which on the rig is said not to explain its photos."""
FIRST_OFFSET = 30.0
LEAST_OFFSET, MOST_OFFSET = 1e-3, 1e6


def settled(
    problem: RigProblem, found: Found, observations: RigObservations, alone: Sequence[Alone], options: RigOptions
) -> tuple[Found, RigProblem]:
    """From near the minimum to that at which the observations are worth what their residuals say."""
    taken = found.iterations
    before: tuple[Array, Array] | None = None  # what was judged, and by how much it was another
    for left in reversed(range(ROUNDS)):
        judged = _judged(problem, found, observations, alone, options)
        is_same = _is_same(judged, problem)
        is_last = is_same or not left
        next_problem = problem if is_same else judged
        if len(judged.slack) != len(problem.slack):
            before = None
        elif not is_last:
            sizes = _sizes(judged)
            step = sizes - _sizes(problem)
            if before is not None and (bent := step - before[1]).any():
                further = -(step @ bent) / (bent @ bent) * (sizes - before[0])
                if further @ step > 0:  # backwards it is no rule
                    next_problem = _of_sizes(judged, sizes + np.clip(further, -FARTHEST_STEP, FARTHEST_STEP))
            before = sizes, step
        small = SMALL_DECREASE if is_last else NEARLY_SMALL_DECREASE
        steps = DescentSteps(options.max_iterations, small_decrease=small, damping=NEAR)
        there = descend_rig(next_problem, _with_offsets(next_problem, found.state), steps)
        taken += there.iterations
        if not np.isfinite(there.equations.normal.cost):
            found = replace(found, converged=False)
            break
        found, problem = there, next_problem
        if is_last:
            break
    return replace(found, iterations=taken), problem


def _sizes(problem: RigProblem) -> Array:
    """Logarithms of all that is judged: of noises, a carrier's errors, and one and the slack."""
    prior = () if problem.prior is None else np.log(problem.prior.sigma)
    slack = [np.log1p(one.size) for one in problem.slack[:1]]
    return np.concatenate([np.log(problem.scale), prior, slack])


def _of_sizes(problem: RigProblem, sizes: Array) -> RigProblem:
    """The problem with others."""
    scale, rest = np.split(sizes, [len(problem.scale)])
    prior = problem.prior and replace(problem.prior, sigma=np.maximum(np.exp(rest[:2]), LEAST_SIGMA))
    slack = float(np.clip(np.expm1(sizes[-1]), LEAST_OFFSET, MOST_OFFSET))
    return replace(
        problem, scale=np.maximum(np.exp(scale), LEAST_SCALE), prior=prior,
        slack=tuple(replace(one, size=slack) for one in problem.slack),
    )  # fmt: skip


def _judged(
    problem: RigProblem, found: Found, observations: RigObservations, alone: Sequence[Alone], options: RigOptions
) -> RigProblem:
    """The problem with what each camera's observations, and the carrier, are worth by what they left over."""
    seen = list(problem.seen)
    if options.reject_sigma is not None:
        for number, (one, blocks) in enumerate(zip(problem.seen, found.equations.blocks, strict=True)):
            keep = deviations(blocks.residual_px, observations.sightings[number].cov_px2) <= options.reject_sigma
            seen[number] = replace(one, problem=replace(one.problem, is_used=keep))
    prior = problem.prior
    if prior is not None:
        given = np.array([prior.carrier.sigma_rad or np.nan, prior.carrier.sigma_mm or np.nan])
        own = np.maximum(mechanism_sigmas(problem, found), LEAST_SIGMA)
        prior = replace(prior, sigma=np.where(np.isfinite(given), given, own))
    slack = _offset_priors(problem, found, options, alone)
    return replace(
        problem, slack=slack, seen=tuple(seen), scale=camera_scales(problem, found, options.loss), prior=prior
    )


def camera_scales(problem: RigProblem, found: Found, loss: Loss) -> Array:
    """Standard deviation of an observation of each camera, by what is left over.  # (C,)"""
    redundancy = camera_redundancy(problem, found)
    scale = problem.scale.copy()
    for number, (one, blocks) in enumerate(zip(problem.seen, found.equations.blocks, strict=True)):
        used = one.problem.is_used
        standard = whitened(one.problem.whitener, blocks.residual_px)[:, used]
        if loss != "squares":
            scale[number] = robust_sigma(standard)
        elif redundancy[number] > 0:
            scale[number] = np.sqrt((standard**2).sum() / redundancy[number])
    return np.maximum(scale, LEAST_SCALE)


def _offset_priors(
    problem: RigProblem, found: Found, options: RigOptions, alone: Sequence[Alone]
) -> tuple[OffsetPrior, ...]:
    """What is expected of the views' slacks: there are some with a carrier, and where photos do not fit together."""
    if not options.allows_offsets:
        return ()
    if problem.slack:
        size = float(np.clip(offset_size(problem, found), LEAST_OFFSET, MOST_OFFSET))
    elif options.carrier is None and not (disagreement(problem, found.state, alone) > DISAGREES).any():
        return ()
    else:
        size = FIRST_OFFSET
    blocks = rig_equations(problem, found.state, "squares").blocks
    return tuple(OffsetPrior(one.products[:, -7:-1, -7:-1].copy(), size) for one in blocks)


def _with_offsets(problem: RigProblem, state: RigState) -> RigState:
    """The state with slacks of views, if there are to be any."""
    if state.slack or not problem.slack:
        return state
    return replace(state, slack=tuple(np.zeros((len(prior.weight), 6)) for prior in problem.slack))


def _is_same(judged: RigProblem, problem: RigProblem) -> bool:
    """Whether the problem is as it was."""
    near = SAME if judged.slack or judged.prior is not None or judged.motion is not None else SURELY_SAME
    if len(judged.slack) != len(problem.slack) or (np.abs(_sizes(judged) - _sizes(problem)) >= near).any():
        return False
    return all(
        np.array_equal(one.problem.is_used, other.problem.is_used)
        for one, other in zip(judged.seen, problem.seen, strict=True)
    )


def scales_left(problem: RigProblem, state: RigState) -> Array:
    """What most observations of each camera are off by.  # (C,)"""
    scale = np.empty(len(problem.seen))
    for number, one in enumerate(problem.seen):
        poses = seen_poses(problem, state, number)[1]
        packed = one.problem.at(state.amount)
        residual = view_misfit(packed, state.cameras[number], poses, RobustLoss()).residual_px
        scale[number] = robust_sigma(whitened(packed.whitener, residual))
    return np.where(np.isfinite(scale), scale, LEAST_SCALE)


def disagreement(problem: RigProblem, state: RigState, alone: Sequence[Alone]) -> Array:
    """How many times farther off each camera's sightings are by the rig than by the camera alone.  # (C,)"""
    ratio = np.ones(len(alone))
    for number, residual in enumerate(residuals(problem, state)):
        packed = problem.seen[number].problem
        off = robust_sigma(whitened(packed.whitener, residual)[:, packed.is_used])
        ratio[number] = off / max(alone[number].scale, LEAST_SCALE)
    return ratio


def residuals(problem: RigProblem, state: RigState) -> list[Array]:
    """Of each camera's sightings by the rig as it is, without slack.  # (C,) of (2, M_c)"""
    rigid = replace(problem, slack=())
    return [
        view_misfit(
            with_scale(problem, number, state.amount), camera, seen_poses(rigid, state, number)[1], RobustLoss()
        ).residual_px
        for number, camera in enumerate(state.cameras)
    ]
