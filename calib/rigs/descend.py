"""The descent over cameras, their places, and all frames; see `calib.solver.eliminate` for the equations."""

from dataclasses import dataclass, replace

import numpy as np

from calib.cameras import is_allowed, parameter_names
from calib.core.se3 import exp_rotation
from calib.rigs.carrier import add_prior
from calib.rigs.problem import (
    RigProblem,
    RigState,
    SeenByOne,
    WithoutOffsets,
    eliminated,
    offset_step,
    seen_poses,
    speeds,
    with_scale,
)
from calib.solver.blocks import Blocks, RobustLoss, view_blocks
from calib.solver.eliminate import Chain, JointStep, Normal, add_chained, damped_step, no_equations, through_camera
from calib.solver.levenberg import (
    PERFECT_PX,
    SHORT,
    Descent,
    DescentSteps,
    levenberg_marquardt,
    move_poses,
    moved_camera,
    turn_of_centre,
)
from calib.solver.problem import Loss
from designer.base.arrays import Array, Rows

EXPECTED_DELAY_S = 10.0
PATIENCE = 16
"""Steps refused because a camera does not show a point there."""


@dataclass(frozen=True, eq=False)
class RigEquations:
    """The normal equations of a rig, and of what they were made."""

    normal: Normal
    blocks: tuple[Blocks, ...]  # (C,) of each camera's views
    chains: tuple[Chain, ...]  # (C,)
    slack: tuple[WithoutOffsets, ...] = ()  # (C,) if views' poses are not quite the rig's


def rig_equations(
    problem: RigProblem, state: RigState, loss: Loss, near: tuple[Blocks, ...] | None = None
) -> RigEquations:
    """The normal equations at a state.

    Of blocks that are `near` only the gradients are renewed.
    """
    blocks, chains = [], []
    for number, one in enumerate(problem.seen):
        frames, poses = seen_poses(problem, state, number)
        has_unknowns = (one.params >= 0).any() or len(problem.amount)
        found = view_blocks(
            with_scale(problem, number, state.amount), state.cameras[number], poses, RobustLoss(loss),
            of_poses=not has_unknowns, near=None if near is None else near[number].products,
        )  # fmt: skip
        blocks.append(found)
        chains.append(chain_of(problem, state, number, frames))
    return assembled(problem, state, tuple(blocks), tuple(chains))


def assembled(
    problem: RigProblem, state: RigState, blocks: tuple[Blocks, ...], chains: tuple[Chain, ...], damping: float = 0.0
) -> RigEquations:
    """The normal equations of all cameras' views together, with what is expected of the unknowns.

    The damping is of the views' slacks, which are eliminated here; that of all else is for later.
    """
    into = no_equations(problem.frame_count, problem.shared_count)
    views: list[WithoutOffsets] = []
    for number, (one, chain) in enumerate(zip(blocks, chains, strict=True)):
        products = one.products
        if problem.slack:
            views.append(eliminated(products, problem.slack[number], state.slack[number], damping))
            products = views[-1].products
        add_chained(into, products, params_of(problem, number), chain)
    prior = sum(one.prior for one in views) + _add_delays(into, problem, state) + _add_amounts(into, problem, state)
    prior += _add_known(into, problem, state)
    if problem.prior is not None:
        prior += add_prior(into, problem.prior, state, problem.seen[0].pose)
    cost = sum(float(one.cost.sum()) for one in blocks)
    residual = tuple(one.residual_px for one in blocks)
    normal = replace(into, cost=cost + prior, squares=cost, residual_px=residual)
    return RigEquations(normal, blocks, chains, tuple(views))


def params_of(problem: RigProblem, camera: int) -> Rows:
    """The shared unknowns that a camera's blocks have before the pose: the target's, then its parameters."""
    own = problem.seen[camera].params
    return np.concatenate([problem.amount, own]) if len(problem.amount) or (own >= 0).any() else own[:0]


def _add_amounts(into: Normal, problem: RigProblem, state: RigState) -> float:
    """Add what is expected of the target's size and bend."""
    free = problem.amount >= 0
    column, sigma = problem.amount[free], problem.amount_sigma[free]
    off = (state.amount - np.eye(1, len(free))[0])[free] / sigma if len(free) else sigma
    into.other[column, column] += sigma**-2
    into.other[column, -1] += off / sigma
    return float(off @ off)


def _add_known(into: Normal, problem: RigProblem, state: RigState) -> float:
    """Add what is known of the cameras' parameters."""
    total = 0.0
    for priors, one, camera in zip(problem.known, problem.seen, state.cameras, strict=bool(problem.known)):
        for prior in priors:
            row = parameter_names(camera.model).index(prior.name)
            column, off = int(one.params[row]), (float(camera.params[row]) - prior.value) / prior.sigma
            if column >= 0:
                into.other[column, column] += prior.sigma**-2
                into.other[column, -1] += off / prior.sigma
                total += off**2
    return total


def _add_delays(into: Normal, problem: RigProblem, state: RigState) -> float:
    """Add what is expected of delays, so that those which a target at rest does not tell stay finite."""
    total = 0.0
    for one, delay in zip(problem.seen, state.delay_s.tolist(), strict=True):
        if one.delay[0] >= 0:
            into.other[one.delay[0], one.delay[0]] += EXPECTED_DELAY_S**-2
            into.other[one.delay[0], -1] += delay / EXPECTED_DELAY_S**2
            total += (delay / EXPECTED_DELAY_S) ** 2
    return total


def chain_of(problem: RigProblem, state: RigState, camera: int, frames: Array) -> Chain:
    """How a camera's poses hang on frames, on where it stands, and on when it takes its photos.

    `frames` is rig_from_target at the times of its photos (V_c, 4, 4).
    """
    one: SeenByOne = problem.seen[camera]
    by_frame, by_camera = through_camera(state.cam_from_rig[camera], frames)
    if problem.slack:
        turn = exp_rotation(state.slack[camera][:, :3])  # slack turns the pose last
        by_frame[:, :3], by_camera[:, :3] = turn @ by_frame[:, :3], turn @ by_camera[:, :3]
    if problem.motion is not None:
        there = state.rig_from_target[one.frame, :3, :3]
        by_frame[:, :3, :3] = by_frame[:, :3, :3] @ frames[:, :3, :3] @ there.transpose(0, 2, 1)
    if one.delay[0] < 0:
        return Chain(one.frame, by_frame, by_camera, one.pose)
    turned, _ = through_camera(state.cam_from_rig[camera], frames)
    by_delay = -(turned @ speeds(problem, state, camera)[:, :, None])
    return Chain(
        one.frame, by_frame, np.concatenate([by_camera, by_delay], axis=2), np.concatenate([one.pose, one.delay])
    )


def descend_rig(
    problem: RigProblem, state: RigState, steps: DescentSteps, loss: Loss | None = None
) -> Descent[RigState, RigEquations]:
    """Descend to the nearest minimum, by another loss than the problem's if one is given."""
    return levenberg_marquardt(_Rig(problem, loss or problem.loss), state, steps)


@dataclass(frozen=True, eq=False)
class RigStep:
    """A step of all unknowns, those of views by the equations that they were eliminated from."""

    joint: JointStep
    equations: RigEquations
    predicted: float  # decrease of the cost


class _Rig:
    """Cameras, their places and frames, for `levenberg_marquardt`."""

    def __init__(self, problem: RigProblem, loss: Loss) -> None:
        self.problem, self.loss = problem, loss
        counts = [int(one.problem.is_used.sum()) for one in problem.seen]
        self.perfect = float((np.array(counts) * (PERFECT_PX / problem.scale) ** 2).sum())
        self.refused = 0

    def equations(self, state: RigState) -> RigEquations:
        return rig_equations(self.problem, state, self.loss)

    def cost(self, equations: RigEquations) -> float:
        return equations.normal.cost

    def step(self, state: RigState, equations: RigEquations, damping: float) -> RigStep | None:
        if not self.problem.slack:
            step = damped_step(equations.normal, damping)
            return None if step is None else RigStep(step, equations, step.predicted)
        damped = assembled(self.problem, state, equations.blocks, equations.chains, damping)
        step = damped_step(damped.normal, damping)
        if step is None:
            return None
        return RigStep(step, damped, step.predicted + sum(one.promised for one in damped.slack))

    def trial(self, state: RigState, equations: RigEquations, step: RigStep) -> tuple[RigState, RigEquations] | None:
        moved = moved_state(self.problem, state, step.equations, step.joint)
        if not all(is_allowed(camera) for camera in moved.cameras):
            return None
        near = equations.blocks if step.predicted <= SHORT**2 * equations.normal.cost else None
        return moved, rig_equations(self.problem, moved, self.loss, near)

    def gives_up(self, there: RigEquations) -> bool:
        self.refused += 1
        return self.refused > PATIENCE


def moved_state(problem: RigProblem, state: RigState, equations: RigEquations, step: JointStep) -> RigState:
    """The state after a step."""
    shared = np.append(step.other, 0.0)  # what is fixed, with a place of -1, takes the last
    cameras = tuple(
        moved_camera(camera, np.arange(len(one.params)), shared[one.params]) if (one.params >= 0).any() else camera
        for one, camera in zip(problem.seen, state.cameras, strict=True)
    )
    own = [
        move_poses(
            state.cam_from_rig[number : number + 1],
            shared[one.pose][None],
            turn_of_centre(state.cameras[number], cameras[number]) if one.pose[0] >= 0 else None,
        )
        for number, one in enumerate(problem.seen)
    ]
    frames = move_poses(state.rig_from_target, step.pose)
    delay = state.delay_s + np.array([shared[one.delay[0]] for one in problem.seen])
    target = state.carrier_from_target
    if problem.prior is not None:
        target = move_poses(target[None], shared[problem.prior.column][None])[0]
    views = [
        one + offset_step(equations.slack[number], shared[params_of(problem, number)], _pose_steps(chain, step))
        for number, (one, chain) in enumerate(zip(state.slack, equations.chains, strict=bool(problem.slack)))
    ]
    amount = state.amount + shared[problem.amount]
    return RigState(cameras, np.concatenate(own), frames, delay, target, slack=tuple(views), amount=amount)


def _pose_steps(chain: Chain, step: JointStep) -> Array:
    """What a step does to one camera's poses.  # (V_c, 6)"""
    shared = np.append(step.other, 0.0)[chain.column]
    return np.asarray(np.einsum("vij,vj->vi", chain.by_frame, step.pose[chain.frame]) + chain.by_shared @ shared)
