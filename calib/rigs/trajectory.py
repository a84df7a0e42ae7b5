"""How a target moves past a camera: splines through its poses, and how far one clock runs behind another.

Two cameras that are held together see one motion. Whatever stands between them, `T_first(t) T_second(t - d)^-1` is the
same at all times t only for the right delay d, so that it is told by how little this pose scatters.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from calib.core.linear_algebra import least_squares
from calib.core.se3 import invert, log_rotation, make_pose

Array = NDArray[np.float64]

LEAST_FRAMES = 4
"""That a spline needs."""
GRID = 81
"""Delays that are tried."""
FARTHEST = 2.0
"""Steps from frame to frame that a delay may be long."""
NEIGHBOURS, DEGREES = 4, (4, 6)
"""Frames before and after, which tell how it moves in one, and what is fitted to them."""
TOO_CURVED = 2.0
"""Times as much variance left over by the lower degree as by the higher."""
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


def motion_of(pose: Array, time_s: Array) -> Array:
    """How a target moves at each time, by polynomials through the poses nearest in time.  # (2, N, 6)

    Turns as rotation vectors from each pose, whose derivatives there are angular velocity and acceleration. The
    polynomials are of a low degree, which noise disturbs less, unless they leave more over than those of a higher one:
    then the target turns about between two poses.

    Args:
        pose: (N, 4, 4) at each time.
        time_s: (N,)

    Returns:
        Rotation vector (rad) and shift (mm), per s and per s^2, in the axes that the poses end in.
    """
    low, high = (_fitted(pose, time_s, degree) for degree in DEGREES)
    known = low.variance > 0  # not so along axes without motion
    is_curved = (low.variance > TOO_CURVED * high.variance)[known]
    return high.motion if 2 * is_curved.sum() > len(is_curved) else low.motion


@dataclass(frozen=True, eq=False)
class _Fitted:
    motion: Array  # (2, N, 6)
    variance: Array  # (6,) of what the polynomials leave over, redundancy regarded; nan: there is none


def _fitted(pose: Array, time_s: Array, degree: int) -> _Fitted:
    """Polynomials of a degree about each time."""
    motion, squares, redundancy = np.zeros((2, len(time_s), 6)), np.zeros(6), 0
    order = np.argsort(time_s, kind="stable")
    time = time_s[order]
    steps = np.diff(time)
    if not (steps > 0).sum() >= LEAST_FRAMES - 1:
        return _Fitted(motion, np.full(6, np.nan))
    reach = FOLLOWED * float(np.median(steps[steps > 0]))
    for place, row in enumerate(order):
        first = min(max(place - NEIGHBOURS, 0), max(len(time) - 2 * NEIGHBOURS - 1, 0))  # at the ends from one side
        near = np.arange(first, min(first + 2 * NEIGHBOURS + 1, len(time)))
        gap = time[near] - time[place]
        gap, apart = np.unique(np.round(gap, 9), return_index=True)
        rows = order[near[apart]][np.abs(gap) <= 2 * reach]
        gap = gap[np.abs(gap) <= 2 * reach]
        if len(gap) < LEAST_FRAMES - 1:
            continue
        turn = log_rotation(pose[rows, :3, :3] @ pose[row, :3, :3].T)
        six = np.concatenate([turn, pose[rows, :3, 3] - pose[row, :3, 3]], axis=1)
        unit = np.abs(gap).max()
        power = np.vander(gap / unit, min(degree + 1, len(gap)), increasing=True)
        part = least_squares(power, six)
        motion[0, row], motion[1, row] = part[1] / unit, 2 * part[2] / unit**2
        squares += ((power @ part - six) ** 2).sum(axis=0)
        redundancy += len(gap) - power.shape[1]
    return _Fitted(motion, squares / redundancy if redundancy else np.full(6, np.nan))


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
