"""Levenberg-Marquardt over cameras, poses and the printed target, as `calib.solver.levenberg` does without the last."""

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from calib.as_built.blocks import Normal, normal_equations
from calib.as_built.eliminate import TargetStep, damped_step
from calib.as_built.problem import Joint, State
from calib.as_built.unknowns import moved_shape
from calib.cameras import is_allowed
from calib.solver.levenberg import (
    FIRST_DAMPING,
    LARGEST_DAMPING,
    PERFECT_PX,
    ROUNDING,
    SMALL_DECREASE,
    SMALLEST_DAMPING,
    move_poses,
    turn_of_centre,
)

Array = NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class TargetMinimum:
    """Where the descent ended."""

    state: State
    normal: Normal  # there
    iterations: int
    converged: bool


def minimise(
    joint: Joint,
    state: State,
    *,
    max_iterations: int,
    damping: float = FIRST_DAMPING,
    small_decrease: float = SMALL_DECREASE,
) -> TargetMinimum:
    """Descend to the nearest minimum.

    Args:
        joint: what was seen, and priors.
        state: where to start.
        max_iterations: of trial steps.
        damping: to begin with; little where the start is near the minimum.
        small_decrease: ends the descent when a step promises less, as a part of the cost.
    """
    normal = normal_equations(joint, state)
    perfect = (PERFECT_PX / joint.scale) ** 2 * sum(len(one.ring) for one in joint.sets)
    growth = 2.0
    for iteration in range(1, max_iterations + 1):
        step = damped_step(normal, damping)
        if step is not None:
            if step.predicted <= small_decrease * normal.cost + perfect:
                return TargetMinimum(state, normal, iteration, converged=True)
            trial = moved_state(joint, state, step)
            if all(is_allowed(camera) for camera in trial.cameras):
                there = normal_equations(joint, trial)
                if there.cost < normal.cost:
                    gain = (normal.cost - there.cost) / step.predicted
                    damping, growth = max(damping * _shrinkage(gain), SMALLEST_DAMPING), 2.0
                    state, normal = trial, there
                    continue
                if step.predicted <= ROUNDING * normal.cost:
                    return TargetMinimum(state, normal, iteration, converged=True)
        damping, growth = damping * growth, growth * 2
        if damping > LARGEST_DAMPING:
            return TargetMinimum(state, normal, iteration, converged=False)
    return TargetMinimum(state, normal, max_iterations, converged=False)


def _shrinkage(gain: float) -> float:
    """Factor of the damping after a step that gained this part of what it promised; bolder than Nielsen 1999."""
    return 1e-3 if gain > 0.9 else max(1 / 3, 1 - (2 * gain - 1) ** 3)


def moved_state(joint: Joint, state: State, step: TargetStep) -> State:
    """The state after a step."""
    cameras, poses = [], []
    for one, camera, pose in zip(joint.sets, state.cameras, state.poses, strict=True):
        free = np.append(step.other[one.first_param :], 0.0)
        change = np.where(one.tie.row >= 0, free[np.where(one.tie.row >= 0, one.tie.row, -1)], 0.0)
        moved = replace(camera, params=camera.params + change)
        cameras.append(moved)
        part = step.pose[one.first_view : one.first_view + len(pose)]
        poses.append(move_poses(pose, part, turn_of_centre(camera, moved)))
    offset = step.ring if len(step.ring) else np.zeros_like(state.shape.offset_mm)
    shape = moved_shape(joint.unknowns, state.shape, step.other[joint.param_count :], offset)
    return State(tuple(cameras), tuple(poses), shape)
