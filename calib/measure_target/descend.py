"""The descent over cameras, poses and the printed target."""

from dataclasses import dataclass

import numpy as np

from calib.cameras import is_allowed
from calib.measure_target.blocks import normal_equations
from calib.measure_target.problem import Joint, State, moved_poses
from calib.measure_target.unknowns import moved_shape
from calib.solver.descent import FIRST_DAMPING, PERFECT_PX, SMALL_DECREASE, levenberg_marquardt
from calib.solver.eliminate import JointStep, Normal, damped_step
from calib.solver.levenberg import move_poses, moved_camera, turn_of_centre


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
    found = levenberg_marquardt(
        _Printed(joint), state, max_iterations=max_iterations, small_decrease=small_decrease, damping=damping
    )
    return TargetMinimum(found.state, found.equations, found.iterations, found.converged)


class _Printed:
    """Cameras, poses and the printed target, for `levenberg_marquardt`."""

    def __init__(self, joint: Joint) -> None:
        self.joint = joint
        self.perfect = (PERFECT_PX / joint.scale) ** 2 * sum(len(one.ring) for one in joint.sets)

    def equations(self, state: State) -> Normal:
        """As `Solvable`."""
        return normal_equations(self.joint, state)

    def cost(self, equations: Normal) -> float:
        """As `Solvable`."""
        return equations.cost

    def step(self, state: State, equations: Normal, damping: float) -> JointStep | None:
        """As `Solvable`."""
        return damped_step(equations, damping)

    def trial(self, state: State, equations: Normal, step: JointStep) -> tuple[State, Normal] | None:
        """As `Solvable`."""
        moved = moved_state(self.joint, state, step)
        if not all(is_allowed(camera) for camera in moved.cameras):
            return None
        return moved, normal_equations(self.joint, moved)

    def gives_up(self, there: Normal) -> bool:
        """As `Solvable`: smaller steps may have an image."""
        return False


def moved_state(joint: Joint, state: State, step: JointStep) -> State:
    """The state after a step."""
    cameras = tuple(
        moved_camera(camera, one.tie.row, step.other[one.first_param :])
        for one, camera in zip(joint.sets, state.cameras, strict=True)
    )
    offset = step.ring if len(step.ring) else np.zeros_like(state.shape.offset_mm)
    shape = moved_shape(joint.unknowns, state.shape, step.other[joint.param_count :], offset)
    if joint.held is not None and state.held is not None:
        held = moved_poses(joint.held, state.held, step.pose, step.other)
        return State(cameras, held.seen(joint.held), shape, held)
    poses = []
    for one, camera, moved, pose in zip(joint.sets, state.cameras, cameras, state.poses, strict=True):
        part = step.pose[one.first_view : one.first_view + len(pose)]
        poses.append(move_poses(pose, part, turn_of_centre(camera, moved)))
    return State(cameras, tuple(poses), shape)
