"""How a target moves in each frame, by its poses in the frames around, and how surely they tell.

Each coordinate of a pose, about that of one frame, is taken for a Gaussian process of time: a squared exponential
covariance, whose length and size, and the noise of the poses, are those that make the poses most likely (Rasmussen and
Williams 2006, chapters 2 and 5). Speed is then what is to be expected of the process, so that it is not too small or
too large on average where frames are few, and what it may be off by follows from the same three numbers.

How a target moves past a camera: splines through its poses, and how far one clock runs behind another.

Two cameras that are held together see one motion. Whatever stands between them, `T_first(t) T_second(t - d)^-1` is the
same at all times t only for the right delay d, so that it is told by how little this pose scatters.
"""

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from calib.core.se3 import invert, log_rotation, make_pose
from calib.core.types import freeze
from designer.base.arrays import Array, Flags, Rows

LEAST_FRAMES = 4
"""From which a motion is told."""
NEIGHBOURS = 16
"""Frames before and after, which tell how it moves in one: twice as far as the longest covariance reaches."""
FARTHEST_RAD = 2.5
"""Turned by more, a pose says nothing of the motion here: rotation vectors end at half a turn."""
DERIVATIVES = 4
LENGTHS = np.geomspace(0.5, 8, 13)
"""Of the covariance in time, in steps from frame to frame."""
NOISES = 10.0 ** np.arange(-10, 1)
"""Variances of the poses' noise, as parts of the process's."""
ANYWHERE = 10.0
"""Variance of a coordinate's mean, likewise: it is not known."""
UNKNOWN = 1e9
"""Noise of a pose that is to say nothing, likewise."""
MOST_WINDOWS = 16
"""From which length, size and noise are told."""
AT_ONCE = 200
"""Frames whose errors are told together."""


@dataclass(frozen=True, eq=False)
class Motion:
    """A target's motion in V frames, each as a series about the frame's pose: `R(t) = exp(way) R, x(t) = x + way`."""

    time_s: Array  # (V,)
    derivative: Array  # (D, V, 6) of the way by time, first to D-th: rotation vector (rad), shift (mm), rig's axes
    length_s: Array  # (6,) over which a coordinate changes
    variance: Array  # (6,) of its process
    noise: Array  # (6,) of the poses, as a part of that

    def __post_init__(self) -> None:
        freeze(self, "time_s", "derivative", "length_s", "variance", "noise")

    def way(self, frame: Rows, gap_s: Array) -> Array:
        """From the poses of frames to those at times from theirs.  # (N, 6)"""
        return self._series(frame, gap_s, 0)

    def speed(self, frame: Rows, gap_s: Array) -> Array:
        """Of the way.  # (N, 6) per s"""
        return self._series(frame, gap_s, 1)

    def _series(self, frame: Rows, gap_s: Array, order: int) -> Array:
        total, part = np.zeros((len(frame), 6)), np.ones(len(frame))
        for power in range(1 - order, len(self.derivative) + 1 - order):
            if power:
                part = part * gap_s / power
            total += part[:, None] * self.derivative[power + order - 1, frame]
        return total

    def speed_covariance(self) -> Iterator[tuple[Rows, Array]]:
        """Covariances (6, B, B) of the speeds' errors in B frames (B,) each, such as stand near each other in time."""
        order = np.argsort(self.time_s, kind="stable")
        for rows in np.array_split(order, -(-len(order) // AT_ONCE)):
            apart = self.time_s[rows, None] - self.time_s[rows]
            blocks = []
            for length, variance, noise in zip(self.length_s, self.variance, self.noise, strict=True):
                own = _covariance(apart, length) + ANYWHERE + noise * np.eye(len(rows))
                cross = _covariance(apart, length, 1)
                blocks.append(variance * (-_covariance(apart, length, 2) - cross @ np.linalg.solve(own, cross.T)))
            yield rows, np.stack(blocks)


def motion_of(pose: Array, time_s: Array) -> Motion:
    """How a target moves, from poses (V, 4, 4) at times (V,); not at all where fewer than four are known."""
    count = len(time_s)
    still = Motion(time_s, np.zeros((DERIVATIVES, count, 6)), np.ones(6), np.zeros(6), np.ones(6))
    order = np.argsort(time_s, kind="stable")
    steps = np.diff(time_s[order])
    if not (steps > 0).sum() >= LEAST_FRAMES - 1:
        return still
    step_s = float(np.median(steps[steps > 0]))
    width = min(2 * NEIGHBOURS + 1, count)
    first = np.clip(np.arange(count) - NEIGHBOURS, 0, count - width)
    near = order[first[:, None] + np.arange(width)]  # (V, width) about order
    time = (time_s[near] - time_s[order][:, None]) / step_s
    turn = log_rotation(pose[near, :3, :3] @ pose[order, :3, :3].swapaxes(-1, -2)[:, None])
    six = np.concatenate([turn, pose[near, :3, 3] - pose[order, :3, 3][:, None]], axis=2)
    lost = np.linalg.norm(turn, axis=2) > FARTHEST_RAD
    six[lost] = 0.0
    some = np.unique(np.linspace(0, count - 1, min(count, MOST_WINDOWS)).astype(int))
    length, noise, variance = _most_likely(time[some], six[some], lost[some])
    derivative = np.zeros((DERIVATIVES, count, 6))
    for axis in range(6):
        own = _covariance(time[:, :, None] - time[:, None], length[axis]) + ANYWHERE + _diagonal(lost, noise[axis])
        weight = np.linalg.solve(own, six[:, :, axis, None])[:, :, 0]
        for power in range(DERIVATIVES):
            value = (_covariance(-time, length[axis], power + 1) * weight).sum(axis=1)
            derivative[power, order, axis] = value / step_s ** (power + 1)
    return Motion(time_s, derivative, length * step_s, variance, noise)


def _most_likely(time: Array, six: Array, lost: Flags) -> tuple[Array, Array, Array]:
    """Lengths in steps, noises and variances of the process, those that make poses (W, N, 6) most likely: (6,) each."""
    best, chosen = np.full(6, np.inf), np.zeros((3, 6))
    count = (~lost).sum()
    for length in LENGTHS:
        covariance = _covariance(time[:, :, None] - time[:, None], length) + ANYWHERE
        for noise in NOISES:
            own = covariance + _diagonal(lost, noise)
            variance = (six * np.linalg.solve(own, six)).sum(axis=(0, 1)) / count
            cost = count * np.log(np.maximum(variance, np.finfo(float).tiny)) + np.linalg.slogdet(own)[1].sum()
            better = cost < best
            best[better] = cost[better]
            chosen[:, better] = np.stack([np.full(6, length), np.full(6, noise), variance])[:, better]
    return chosen[0], chosen[1], chosen[2]


def _diagonal(lost: Flags, noise: float) -> Array:
    """Covariances of the noise.  # (W, N, N)"""
    return np.asarray(np.where(lost, UNKNOWN, noise)[:, :, None] * np.eye(lost.shape[1]))


def _covariance(apart: Array, length: float, power: int = 0) -> Array:
    """`exp(-(t / l)^2 / 2)`, or a derivative of it by t: Hermite's polynomials times it."""
    unit = apart / length
    before, value = np.zeros_like(unit), np.ones_like(unit)
    for number in range(power):
        before, value = value, unit * value - number * before
    return np.asarray((-1 / length) ** power * value * np.exp(-0.5 * unit**2))


LEAST_BETWEEN = 4
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
    """By how much the first camera's stamps run behind the second's; 0 where the target did not move."""
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
    if len(between) < LEAST_BETWEEN:
        return np.inf
    far = float(np.median(np.linalg.norm(first[:, :3, 3], axis=1)))
    middle = between[len(between) // 2]
    turn = log_rotation(between[:, :3, :3] @ middle[:3, :3].T)
    six = np.concatenate([turn, (between[:, :3, 3] - middle[:3, 3]) / far], axis=1)
    return float(np.median(np.linalg.norm(six - np.median(six, axis=0), axis=1)))
