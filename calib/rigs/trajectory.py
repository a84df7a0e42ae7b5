"""How a target moves past a camera: splines through its poses, and how far one clock runs behind another.

Two cameras that are held together see one motion. Whatever stands between them, `T_first(t) T_second(t - d)^-1` is the
same at all times t only for the right delay d, so that it is told by how little this pose scatters.
"""

import numpy as np
from numpy.typing import NDArray

from calib.core.se3 import invert, log_rotation, make_pose

Array = NDArray[np.float64]

LEAST_FRAMES = 4
"""That a spline needs."""
GRID = 81
"""Delays that are tried."""
FARTHEST = 2.0
"""Steps from frame to frame that a delay may be long."""
FOLLOWED = 3.0
"""Steps without a pose after which a motion is not known in between."""


class Trajectory:
    """Poses at times, and in between."""

    def __init__(self, time_s: Array, pose: Array) -> None:
        """Through poses (N, 4, 4) at times (N,), each another."""
        from scipy.interpolate import CubicSpline
        from scipy.spatial.transform import Rotation, RotationSpline

        order = np.argsort(time_s)
        self.time_s = time_s[order]
        self.step_s = float(np.median(np.diff(self.time_s)))
        self._way = CubicSpline(self.time_s, pose[order, :3, 3])
        self._turn = RotationSpline(self.time_s, Rotation.from_matrix(pose[order, :3, :3]))

    def at(self, time_s: Array) -> Array:
        """Poses (N, 4, 4) at times; nan far from all known ones."""
        pose = make_pose(self._turn(time_s).as_matrix(), self._way(time_s))
        after = np.clip(np.searchsorted(self.time_s, time_s), 1, len(self.time_s) - 1)
        begin, end = self.time_s[after - 1], self.time_s[after]
        outside = np.maximum(np.maximum(self.time_s[0] - time_s, time_s - self.time_s[-1]), 0)
        lost = (end - begin > FOLLOWED * self.step_s) | (outside > FARTHEST * self.step_s)
        pose[lost] = np.nan
        return pose


def delay_between(first_time_s: Array, first: Array, second: Trajectory) -> float:
    """By how much the first camera's stamps run behind the second's; 0 where the target did not move.

    Args:
        first_time_s: of the first camera's poses, ascending (N,).
        first: these (N, 4, 4).
        second: the second camera's.
    """
    width = FARTHEST * second.step_s
    best = 0.0
    for _ in range(3):
        tried = best + np.linspace(-width, width, GRID)
        best = float(tried[int(np.argmin([_scatter(first_time_s, first, second, delay) for delay in tried]))])
        width *= 4 / GRID
    return best


def _scatter(time_s: Array, first: Array, second: Trajectory, delay_s: float) -> float:
    """How much the pose between two cameras differs from time to time, at a delay."""
    between = first @ invert(second.at(time_s - delay_s))
    between = between[np.isfinite(between[:, 0, 0])]
    if len(between) < LEAST_FRAMES:
        return np.inf
    far = float(np.median(np.linalg.norm(first[:, :3, 3], axis=1)))
    middle = between[len(between) // 2]
    turn = log_rotation(between[:, :3, :3] @ middle[:3, :3].T)
    six = np.concatenate([turn, (between[:, :3, 3] - middle[:3, 3]) / far], axis=1)
    return float(np.median(np.linalg.norm(six - np.median(six, axis=0), axis=1)))
