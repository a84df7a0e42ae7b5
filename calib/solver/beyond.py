"""The descent of models that do not show every point: beyond the fold of a lens polynomial, or behind the camera.

A model that is kept where it is one-to-one has no image of some points, and no sum of squares is defined once one of
those counts. So the points that stand in the way of the descent are left out, it goes on with the others to their
minimum, and what the camera then shows is taken back. A point that was left out twice stays out: the model cannot show
it together with the others. What comes out is a minimum of the points that count, all of them shown.
"""

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from calib.cameras.camera import Camera
from calib.solver.blocks import RobustLoss
from calib.solver.levenberg import FIRST_DAMPING, Minimum, minimise
from calib.solver.problem import Problem

Array = NDArray[np.float64]
Flags = NDArray[np.bool_]

MOST_ROUNDS = 60
"""Of leaving out and taking back."""
WIDER = 0.004
"""Part of the angle off the axis by which more is left out each time that leaving out was not enough."""
TWICE = 2
LEAST_POINTS = 4
"""Of a view, for a pose."""


@dataclass(frozen=True, eq=False)
class Shown:
    """A minimum of the points that the model shows there."""

    minimum: Minimum
    is_beyond: Flags  # (M,) points that were to count and do not, because the model does not show them

    @property
    def mean_cost(self) -> float:
        """Of a point that counts; infinite without any."""
        count = int((~self.is_beyond).sum())
        return float(self.minimum.blocks.cost.sum()) / count if count else np.inf


def minimise_shown(
    problem: Problem,
    camera: Camera,
    cam_from_target: Array,
    tie: NDArray[np.int64],
    loss: RobustLoss,
    *,
    max_iterations: int,
    damping: float = FIRST_DAMPING,
) -> Shown:
    """Descend to a minimum of the points that the model shows there; arguments as those of `minimise`."""
    is_beyond = np.zeros_like(problem.is_used)
    times = np.zeros(len(is_beyond), dtype=np.int64)  # that each was left out
    iterations, rounds, in_a_row = 0, 0, 0
    while True:
        part = replace(problem, is_used=problem.is_used & ~is_beyond)
        found = minimise(part, camera, cam_from_target, tie, loss, max_iterations=max_iterations, damping=damping)
        camera, cam_from_target = found.camera, found.cam_from_target
        iterations, rounds = iterations + found.iterations, rounds + 1
        in_a_row = 0 if found.converged else in_a_row + 1
        change = _taken_back(found, is_beyond, times) if found.converged else _in_the_way(part, found, in_a_row)
        if rounds == MOST_ROUNDS or not change.any():
            break
        is_beyond = is_beyond ^ change
        times += is_beyond & change
        if lost_views(problem, problem.is_used & ~is_beyond).any():
            break
    return Shown(replace(found, iterations=iterations), is_beyond)


def _in_the_way(problem: Problem, found: Minimum, in_a_row: int) -> Flags:
    """Points to go on without: those that stood in the way, and where that was not enough, ever more next to them."""
    if found.in_the_way is None:
        return np.zeros_like(problem.is_used)
    pose = found.cam_from_target[problem.view]
    x, y, z = ((pose[:, :3, :3] @ problem.position_mm.T[:, :, None])[:, :, 0] + pose[:, :3, 3]).T
    off_axis = np.arctan2(np.hypot(x, y), z)
    limit = (1 - WIDER * (in_a_row - 1)) * off_axis[found.in_the_way].min(initial=np.inf)
    wider: Flags = problem.is_used & (found.in_the_way | (off_axis > limit))
    return wider


def _taken_back(found: Minimum, is_beyond: Flags, times: NDArray[np.int64]) -> Flags:
    """Points that were left out, but not twice, and that the camera shows after all."""
    if not is_beyond.any():
        return is_beyond
    shown: Flags = is_beyond & np.isfinite(found.blocks.residual_px).all(axis=0) & (times < TWICE)
    return shown


def lost_views(problem: Problem, is_used: Flags) -> Flags:
    """Views of which fewer observations count than a pose needs.  # (V,)"""
    lost: Flags = np.add.reduceat(is_used.astype(np.int64), problem.view_start[:-1]) < LEAST_POINTS
    return lost
