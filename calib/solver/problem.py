"""Observations packed for the kernels: coordinate by coordinate, view after view."""

from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from calib.core.jit import jit
from calib.core.se3 import skew
from calib.core.types import Observations
from calib.solver.distance import InSpace
from designer.base.arrays import Array

GOLDEN = 0.6180339887498949
MANY = 2**62
ENOUGH = 800
FEWEST = 24
"""Of a view: six times what a homography needs."""


@dataclass(frozen=True, eq=False)
class Problem:
    """M observations in V views; the observations of view v are those from `view_start[v]` to `view_start[v + 1]`."""

    image_size: tuple[int, int]
    view_start: NDArray[np.int64]  # (V + 1,)
    position_mm: Array  # (3, M) in the target's axes, from `origin_mm`
    measured_px: Array  # (2, M)
    whitener: Array  # (3, M) a, b, c of [[a, 0], [b, c]], which makes the covariance of an observation unity
    is_used: NDArray[np.bool_]  # (M,)
    origin_mm: Array = field(default_factory=lambda: np.zeros(3))  # (3,) the points' middle: a far one costs digits
    space: InSpace | None = None  # distances in space are minimised; None: those in the image

    @property
    def view_count(self) -> int:
        """V."""
        return len(self.view_start) - 1

    @property
    def view(self) -> NDArray[np.int64]:
        """The view of each observation.  # (M,)"""
        return np.repeat(np.arange(self.view_count), np.diff(self.view_start))


def pack(observations: Observations, *, weighted: bool) -> Problem:
    """The problem of all views, each of which has observations, weighted by their covariances if these are known."""
    count = len(observations.view)
    start = np.searchsorted(observations.view, np.arange(observations.view_count + 1))
    if (np.diff(start) == 0).any():
        raise ValueError("a view without observations; leave it out")
    whitener = np.repeat(np.array([[1.0], [0.0], [1.0]]), count, axis=1)
    if weighted and observations.cov_px2 is not None:
        whitener = whiteners(observations.cov_px2)
        if not np.isfinite(whitener).all():
            raise ValueError("a covariance that is not positive definite")
    position = observations.points.position_mm
    origin = observations.points.middle_mm
    moved = np.ascontiguousarray((position - origin).T)
    return Problem(
        observations.image_size,
        start,
        moved.take(observations.point, axis=1),
        np.ascontiguousarray(observations.center_px.T),
        whitener,
        np.ones(count, dtype=bool),
        origin,
    )


def target_poses(problem: Problem, poses: Array) -> Array:
    """Poses `cam_from_target` (V, 4, 4) of those that the problem has from its own origin."""
    moved = np.array(poses)
    moved[:, :3, 3] -= moved[:, :3, :3] @ problem.origin_mm
    return moved


def origin_poses(problem: Problem, cam_from_target: Array) -> Array:
    """The poses (V, 4, 4) from the problem's own origin, of those of the target."""
    moved = np.array(cam_from_target)
    moved[:, :3, 3] += moved[:, :3, :3] @ problem.origin_mm
    return moved


def target_covariance(problem: Problem, poses: Array, covariance: Array) -> Array:
    """Covariances (V, 6, 6) of `target_poses`, of the poses' own.

    A turn by w about the problem's origin o moves the target's by `w x (-R o) = (R o) x w`.
    """
    jacobian = np.tile(np.eye(6), (len(poses), 1, 1))
    jacobian[:, 3:, :3] = skew(poses[:, :3, :3] @ problem.origin_mm)
    moved: Array = jacobian @ covariance @ jacobian.transpose(0, 2, 1)
    return moved


def whiteners(cov_px2: Array) -> Array:
    """The inverses of the Cholesky factors of covariances (M, 2, 2): a, b, c of [[a, 0], [b, c]].  # (3, M)

    Not finite where a covariance is not positive definite.
    """
    with np.errstate(divide="ignore", invalid="ignore"):
        a = np.sqrt(cov_px2[:, 0, 0])
        b = cov_px2[:, 1, 0] / a
        c = np.sqrt(cov_px2[:, 1, 1] - b**2)
        return np.stack([1 / a, -b / (a * c), 1 / c])


def few_per_view(view_count: int) -> int:
    """How many observations of each view are enough for a rough solution: few where there are many views."""
    return max(ENOUGH // max(view_count, 1), FEWEST)


def select(problem: Problem, views: NDArray[np.int64], per_view: int) -> Problem:
    """Some views, with at most so many used observations of each, evenly spread over their order."""
    if len(views) == problem.view_count and per_view >= len(problem.is_used) and problem.is_used.all():
        return problem
    start, rows = select_rows(problem, views, per_view)
    return Problem(
        problem.image_size, start, problem.position_mm.take(rows, axis=1), problem.measured_px.take(rows, axis=1),
        problem.whitener.take(rows, axis=1), np.ones(len(rows), dtype=bool), problem.origin_mm,
        None if problem.space is None else problem.space.take(rows),
    )  # fmt: skip


def select_rows(
    problem: Problem, views: NDArray[np.int64], per_view: int
) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
    """Where each view's begin among the observations of `select`, and which these are."""
    start = np.zeros(len(views) + 1, dtype=np.int64)
    rows = np.empty(min(len(problem.is_used), per_view * len(views)), dtype=np.int64)
    _spread_rows(problem.view_start, problem.is_used, views, per_view, start, rows)
    return start, rows[: start[-1]]


@jit
def _spread_rows(
    view_start: NDArray[np.int64],
    is_used: NDArray[np.bool_],
    views: NDArray[np.int64],
    per_view: int,
    start: NDArray[np.int64],
    rows: NDArray[np.int64],
) -> None:
    """Of each view's used observations at most so many: where each view's begin among the rows, and the rows."""
    longest = 0
    for view in views:
        longest = max(longest, view_start[view + 1] - view_start[view])
    used = np.empty(longest, dtype=np.int64)
    for slot, view in enumerate(views):
        count = 0
        for m in range(view_start[view], view_start[view + 1]):
            if is_used[m]:
                used[count] = m
                count += 1
        taken = min(count, per_view)
        step = count / max(taken, 1)
        for place in range(taken):
            # Not in even steps: those would follow a column of a grid whose rows are as long.
            cell = np.int64(place * step)
            width = np.int64((place + 1) * step) - cell
            rows[start[slot] + place] = used[cell + np.int64((GOLDEN * place) % 1.0 * width)]
        start[slot + 1] = start[slot] + taken
