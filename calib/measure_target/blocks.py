"""The descent over poses, rings' offsets, cameras and the target's shared unknowns: normal equations and steps.

An observation depends on its view's pose (6), its ring's offset (3), its camera's free parameters and 15 of the shared
unknowns. Blocks that stand on the diagonal are kept apart; all else is dense.
"""

import numpy as np

from calib.cameras import is_allowed, linearise
from calib.core.jit import jit
from calib.measure_target.problem import CameraSightings, Joint, State, chains_of, moved_poses, over_frames
from calib.measure_target.unknowns import RingPlaces, moved_shape, place_rings, shared_values
from calib.solver.eliminate import JointStep, Normal, damped_step
from calib.solver.levenberg import (
    PERFECT_PX,
    Descent,
    DescentSteps,
    levenberg_marquardt,
    move_poses,
    moved_camera,
    turn_of_centre,
)
from designer.base.arrays import Array, Flags, Rows

CHUNK = 4000
"""Observations at a time."""


@jit
def _to_camera(view: Rows, ring: Rows, pose: Array, position: Array, turned: Array, point: Array) -> None:
    """R x and R x + t of the sightings of rings."""
    for n in range(len(view)):
        r, x = pose[view[n]], position[ring[n]]
        for axis in range(3):
            value = r[axis, 0] * x[0] + r[axis, 1] * x[1] + r[axis, 2] * x[2]
            turned[axis, n] = value
            point[axis, n] = value + r[axis, 3]


@jit
def _derivatives(
    n: int,
    turn: Array,
    turned: Array,
    by_point: Array,
    by_params: Array,
    whiten: tuple[float, float, float],
    tie: Rows,
    column: Rows,
    moves: Array,
    index: Rows,
    g: Array,
    p: Array,
    by_ring: Array,
) -> int:
    """Whitened derivatives of one sighting by its pose (2, 6), ring (2, 3) and the others at `index`, ascending.

    Returns how many others there are. Parameters that share a value have one place.
    """
    a, b, c = whiten
    for k in range(3):
        p[0, 3 + k] = a * by_point[0, k, n]
        p[1, 3 + k] = b * by_point[0, k, n] + c * by_point[1, k, n]
    x, y, z = turned[0, n], turned[1, n], turned[2, n]
    for e in range(2):
        u, v, w = p[e, 3], p[e, 4], p[e, 5]
        p[e, 0], p[e, 1], p[e, 2] = y * w - z * v, z * u - x * w, x * v - y * u
        for k in range(3):
            by_ring[e, k] = u * turn[0, k] + v * turn[1, k] + w * turn[2, k]
    count = 0
    for k in range(len(tie)):
        if tie[k] < 0:
            continue
        same = 0
        while same < count and index[same] != tie[k]:
            same += 1
        if same == count:
            index[count], g[0, count], g[1, count] = tie[k], 0.0, 0.0
            count += 1
        g[0, same] += a * by_params[0, k, n]
        g[1, same] += b * by_params[0, k, n] + c * by_params[1, k, n]
    for k in range(len(column)):
        if column[k] < 0:
            continue
        index[count] = column[k]
        for e in range(2):
            g[e, count] = by_ring[e, 0] * moves[0, k] + by_ring[e, 1] * moves[1, k] + by_ring[e, 2] * moves[2, k]
        count += 1
    return count


@jit
def _add_row(left: Array, g: Array, index: Rows, count: int, r: Array, block: Array, row: Array, first: int) -> None:
    """Add the products of a block's derivatives with themselves, with the others and with the residuals."""
    size, last = left.shape[1], row.shape[1] - 1
    for i in range(size):
        a, b = left[0, i], left[1, i]
        for j in range(size):
            block[i, j] += a * left[0, j] + b * left[1, j]
        for j in range(count):
            row[i, first + index[j]] += a * g[0, j] + b * g[1, j]
        row[i, last] += a * r[0] + b * r[1]


@jit
def _add(
    view: Rows,
    ring: Rows,
    face: Rows,
    pose: Array,
    turned: Array,
    pixel: Array,
    by_point: Array,
    by_params: Array,
    measured: Array,
    whitener: Array,
    is_used: Flags,
    tie: Rows,
    first_view: int,
    column: Rows,
    by_shared: Array,
    by_offset: Array,
    residual: Array,
    pose_block: Array,
    pose_row: Array,
    ring_block: Array,
    ring_row: Array,
    other: Array,
) -> float:
    """Add sightings to the normal equations, of the others the lower triangle; returns their squares."""
    last = other.shape[0]
    poses = ring_row.shape[2] - last - 1
    index = np.empty(len(tie) + column.shape[1], dtype=np.int64)
    g, p, o = np.empty((2, len(index))), np.empty((2, 6)), np.empty((2, 3))
    by_ring, r = np.empty((2, 3)), np.empty(2)
    total = 0.0
    for n in range(len(view)):
        du, dv = pixel[0, n] - measured[0, n], pixel[1, n] - measured[1, n]
        residual[0, n], residual[1, n] = du, dv
        if not is_used[n]:
            continue
        a, b, c = whitener[0, n], whitener[1, n], whitener[2, n]
        r[0], r[1] = a * du, b * du + c * dv
        total += r[0] * r[0] + r[1] * r[1]
        place, here = ring[n], first_view + view[n]
        count = _derivatives(
            n, pose[view[n]], turned, by_point, by_params, (a, b, c), tie, column[face[place]], by_shared[place],
            index, g, p, by_ring,
        )  # fmt: skip
        for i in range(count):
            row, g0, g1 = other[index[i]], g[0, i], g[1, i]
            row[last] += g0 * r[0] + g1 * r[1]
            for j in range(i + 1):
                row[index[j]] += g0 * g[0, j] + g1 * g[1, j]
        _add_row(p, g, index, count, r, pose_block[here], pose_row[here], 0)
        if len(ring_block) == 0:
            continue
        for e in range(2):
            for k in range(3):
                o[e, k] = 0.0
                for axis in range(3):
                    o[e, k] += by_ring[e, axis] * by_offset[place, axis, k]
        _add_row(o, g, index, count, r, ring_block[place], ring_row[place], poses)
        for i in range(3):
            for j in range(6):
                ring_row[place, i, 6 * here + j] += o[0, i] * p[0, j] + o[1, i] * p[1, j]
    return total


def normal_equations(joint: Joint, state: State) -> Normal:
    """The normal equations at a state, with priors and gauge."""
    unknowns = joint.unknowns
    rings = place_rings(unknowns, state.shape)
    others = joint.param_count + unknowns.count
    free = len(rings.position_mm) if unknowns.ring_sigma_mm is not None else 0
    views = joint.view_count
    pose, pose_row = np.zeros((views, 6, 6)), np.zeros((views, 6, others + 1))
    ring, ring_row = np.zeros((free, 3, 3)), np.zeros((free, 3, 6 * views + others + 1))
    other = np.zeros((others, others + 1))
    column = np.where(unknowns.column >= 0, unknowns.column + joint.param_count, -1)
    residuals, squares = [], 0.0
    for number, one in enumerate(joint.sets):
        residual, square = _add_set(one, state, number, rings, joint, column, (pose, pose_row, ring, ring_row, other))
        residuals.append(residual)
        squares += square
    lower = np.tril(other[:, :-1], -1)
    other[:, :-1] = lower + lower.T + np.diag(np.diagonal(other))
    prior = _add_priors(joint, state, ring, ring_row, other)
    normal = Normal(pose, pose_row, ring, ring_row, other, squares + prior, squares, tuple(residuals))
    if joint.held is None or state.held is None:
        return normal
    return over_frames(normal, chains_of(joint.held, state.held), joint.held.frame_count)


def _add_set(
    one: CameraSightings,
    state: State,
    number: int,
    rings: RingPlaces,
    joint: Joint,
    column: Rows,
    into: tuple[Array, Array, Array, Array, Array],
) -> tuple[Array, float]:
    """Add one camera's sightings; returns residuals (2, M) in px and the sum of squares."""
    problem, camera = one.problem, state.cameras[number]
    pose = np.array(state.poses[number], order="C")  # a copy: kernels are compiled again for read-only arrays
    view, residual = problem.view, np.empty_like(problem.measured_px)
    tie = np.where(one.tie.row >= 0, one.tie.row + one.first_param, -1)
    whitener = problem.whitener / joint.scale
    squares = 0.0
    for first in range(0, len(view), CHUNK):
        part = slice(first, min(first + CHUNK, len(view)))
        width = part.stop - part.start
        turned, point = np.empty((3, width)), np.empty((3, width))
        _to_camera(view[part], one.ring[part], pose, rings.position_mm, turned, point)
        seen = linearise(camera, point)
        here = np.empty((2, width))
        squares += _add(
            view[part], one.ring[part], joint.unknowns.target.ring_face, pose, turned, seen.pixel, seen.by_point,
            seen.by_params, np.ascontiguousarray(problem.measured_px[:, part]),
            np.ascontiguousarray(whitener[:, part]), problem.is_used[part], tie, one.first_view, column,
            rings.by_shared, rings.by_offset, here, *into,
        )  # fmt: skip
        residual[:, part] = here
    return residual, squares


def _add_priors(joint: Joint, state: State, ring: Array, ring_row: Array, other: Array) -> float:
    """Add priors and gauge to the normal equations; returns their squares."""
    unknowns, first = joint.unknowns, joint.param_count
    value = shared_values(unknowns, state.shape)
    gauge = joint.gauge / joint.scale
    held = gauge @ value
    other[first:, first:-1] += gauge.T @ gauge + np.diag(unknowns.sigma**-2)
    other[first:, -1] += gauge.T @ held + value / unknowns.sigma**2
    cost = float((held**2).sum() + ((value / unknowns.sigma) ** 2).sum())
    if unknowns.ring_sigma_mm is not None:
        weight = unknowns.ring_sigma_mm**-2
        ring += np.diag(weight)
        ring_row[:, :, -1] += weight * state.shape.offset_mm
        cost += float((weight * state.shape.offset_mm**2).sum())
    return cost


TargetMinimum = Descent[State, Normal]


def minimise(joint: Joint, state: State, steps: DescentSteps) -> TargetMinimum:
    """Descend to the nearest minimum."""
    return levenberg_marquardt(_Printed(joint), state, steps)


class _Printed:
    """Cameras, poses and the printed target, for `levenberg_marquardt`."""

    def __init__(self, joint: Joint) -> None:
        self.joint = joint
        self.perfect = (PERFECT_PX / joint.scale) ** 2 * sum(len(one.ring) for one in joint.sets)

    def equations(self, state: State) -> Normal:
        return normal_equations(self.joint, state)

    def cost(self, equations: Normal) -> float:
        return equations.cost

    def step(self, state: State, equations: Normal, damping: float) -> JointStep | None:
        return damped_step(equations, damping)

    def trial(self, state: State, equations: Normal, step: JointStep) -> tuple[State, Normal] | None:
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
