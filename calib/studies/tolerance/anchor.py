"""The minimum without errors, factorised once, and the minimum of any other pixels of the same views from there."""

from dataclasses import dataclass, replace

import numpy as np

from calib.cameras import is_allowed
from calib.cameras.camera import Camera
from calib.solver.blocks import RobustLoss, view_blocks
from calib.solver.levenberg import DescentSteps, minimise, move_poses, turn_of_centre
from calib.solver.problem import Problem, Tie
from calib.solver.schur import reduced_normal
from calib.studies.gradients import CameraFit, gradients_of, reduced_gradient, step_length
from designer.base.arrays import Array

CLOSE = 1e-5
"""Distance from the minimum, in standard deviations of all unknowns together, that is none."""
WORST = 2.0
"""A step that is longer than the one before by more than this leads nowhere."""
MEMORY = 5
"""Steps that the next one is corrected by."""
RANK = 1e-10
"""Combinations of steps that are smaller than this share of the largest are lost in rounding."""
PATIENCE, MANY = 4, 20
"""After so many steps, new second derivatives are worth their looks if it seems to take so many more without."""
MOST_LOOKS = 20
MOST_RENEWALS = 4
DIFFERENCE = 10.0
"""Of the differences for second derivatives, in standard deviations."""
MOST_STEPS = 200


@dataclass(frozen=True, eq=False)
class Anchor:
    """A minimum of V views, and the normal equations there with the poses eliminated, solved."""

    problem: Problem  # of the nominal target, with noise-free pixels
    tie: Tie
    camera: Camera
    cam_from_target: Array  # (V, 4, 4) from the problem's origin
    spread: Array  # (P, Q) parameters of the free ones
    free_inverse: Array  # (Q, Q) inverse of the reduced normal matrix
    pose_inverse: Array  # (V, 6, 6)
    free_root: Array  # (Q, Q) root of the reduced normal matrix: R' R
    pose_root: Array  # (V, 6, 6) likewise of the poses'
    follow: Array  # (V, 6, Q) steps of the poses by those of the free parameters
    deviation: float  # of a whitened residual, by the noise


def factorise(problem: Problem, tie: Tie, camera: Camera, cam_from_target: Array, deviation: float) -> Anchor:
    """The anchor at a minimum.

    Raises:
        np.linalg.LinAlgError: camera or poses are not determined.
    """
    products = view_blocks(problem, camera, cam_from_target, RobustLoss()).products
    normal, inverse_times = reduced_normal(products, tie.row)
    spread: Array = (tie.row[:, None] == np.arange(len(normal))).astype(np.float64)
    pose_normal = products[:, -7:-1, -7:-1]
    root, inverse = _root_and_inverse(normal)
    return Anchor(
        problem, tie, camera, np.ascontiguousarray(cam_from_target), spread, inverse,
        np.ascontiguousarray(np.linalg.inv(pose_normal)), root,
        _roots(pose_normal), np.ascontiguousarray(-inverse_times), deviation,
    )  # fmt: skip


def minimum_of(anchor: Anchor, measured_px: Array, start: CameraFit | None = None) -> CameraFit | None:
    """The camera and poses that fit other pixels of the anchor's observations best; None if there are none.

    Steps with the anchor's normal matrix, whose fixed point is where the true gradient is zero, each corrected by what
    the last ones left (Anderson 1965). The matrix lacks the residuals' curvature; where errors are so large that this
    makes the steps slow, true second derivatives take its place, and where even these lead away, Levenberg-Marquardt.
    Residuals of several pixels may have more than one minimum; this one is next to the truth.

    Args:
        anchor: where to start.
        measured_px: pixels (2, M).
        start: a nearer start.
    """
    problem = replace(anchor.problem, measured_px=measured_px)
    here = CameraFit(anchor.camera, anchor.cam_from_target, np.nan, 0) if start is None else replace(start, looks=0)
    matrix = anchor
    for _ in range(MOST_RENEWALS + 1):
        here, arrived = _approach(matrix, problem, here)
        if arrived:
            return here
        new = renewed(anchor, problem, here) if np.isfinite(here.cost) else None
        if new is None:
            return _descended(anchor, problem, here.looks)
        matrix, here = new, replace(here, looks=here.looks + 6 + len(new.free_inverse))
    return _descended(anchor, problem, here.looks)


def _approach(anchor: Anchor, problem: Problem, here: CameraFit) -> tuple[CameraFit, bool]:
    """Steps with one matrix, to the minimum or until they are slow; a cost of nan where they lead away."""
    views, once = np.arange(problem.view_count), np.ones(problem.view_count, dtype=np.int64)
    camera, poses = here.camera, here.cam_from_target
    history = _History([], [])
    lengths: list[float] = []
    for look in range(here.looks + 1, here.looks + MOST_LOOKS + 1):
        there = gradients_of(problem, views, camera, poses)
        reduced, rest, promised = reduced_gradient(
            anchor.spread, anchor.pose_inverse, views, once, there.gradient, anchor.follow
        )
        step = -anchor.free_inverse @ reduced
        promised -= float(reduced @ step)
        cost = float(there.cost.sum())
        length = step_length(promised, anchor.deviation)
        lost = CameraFit(camera, poses, np.nan, look)
        if not (np.isfinite(cost) and length <= WORST * min(lengths, default=np.inf)):
            return lost, False
        if len(lengths) >= PATIENCE:
            rate = min(np.sqrt(length / lengths[-2]), 1 - 1e-3)
            if np.log(CLOSE / length) / np.log(rate) > MANY:
                return CameraFit(camera, poses, cost, look), False
        taken = history.corrected(anchor, np.concatenate([step, rest.reshape(-1)]))
        step, rest = taken[: len(step)], taken[len(step) :].reshape(rest.shape)
        trial = replace(camera, params=camera.params + anchor.spread @ step)
        if not is_allowed(trial):
            return lost, False
        poses = move_poses(poses, rest + anchor.follow @ step, turn_of_centre(camera, trial))
        camera = trial
        # Each step is shorter than the last by about the same factor; the first tells none.
        left = length / lengths[-1] if lengths else 1.0
        if length * left <= CLOSE:
            return CameraFit(camera, poses, max(cost - promised, 0.0), look), True
        lengths.append(length)
    return CameraFit(camera, poses, cost, look), False


def renewed(anchor: Anchor, problem: Problem, here: CameraFit) -> Anchor | None:
    """The anchor with true second derivatives near another minimum, by differences; None if they are not positive.

    In coordinates in which poses follow the camera as they did, so that what is left of that is small.
    """
    camera, cam_from_target = here.camera, here.cam_from_target
    views = np.arange(problem.view_count)
    middle = gradients_of(problem, views, camera, cam_from_target).gradient
    parameters, free = anchor.spread.shape
    size = DIFFERENCE * anchor.deviation
    of_pose = size * np.sqrt(np.einsum("vkk->vk", anchor.pose_inverse))  # (V, 6)
    second = np.empty((len(views), 6, 6))
    for k in range(6):
        step = np.zeros((len(views), 6))
        step[:, k] = of_pose[:, k]
        there = gradients_of(problem, views, camera, move_poses(cam_from_target, step)).gradient
        second[:, :, k] = (there - middle)[:, parameters:] / of_pose[:, k : k + 1]
    second = 0.5 * (second + second.transpose(0, 2, 1))
    of_free = size * np.sqrt(np.diagonal(anchor.free_inverse))
    normal, coupling = np.empty((free, free)), np.empty((len(views), 6, free))
    for q in range(free):
        trial = replace(camera, params=camera.params + anchor.spread[:, q] * of_free[q])
        poses = move_poses(cam_from_target, anchor.follow[:, :, q] * of_free[q], turn_of_centre(camera, trial))
        change = (gradients_of(problem, views, trial, poses).gradient - middle) / of_free[q]
        coupling[:, :, q] = change[:, parameters:]
        normal[:, q] = anchor.spread.T @ change[:, :parameters].sum(axis=0)
        normal[:, q] += np.einsum("viq,vi->q", anchor.follow, change[:, parameters:])
    try:
        return _with_second(anchor, normal, coupling, second)
    except np.linalg.LinAlgError:
        return None


def _with_second(anchor: Anchor, normal: Array, coupling: Array, second: Array) -> Anchor:
    """The anchor with other second derivatives by free parameters, by these and poses, and by poses."""
    pose_inverse = np.linalg.inv(second)
    follow = -pose_inverse @ coupling
    normal = normal + np.einsum("viq,vir->qr", coupling, follow)
    root, inverse = _root_and_inverse(0.5 * (normal + normal.T))
    return replace(
        anchor,
        free_inverse=inverse,
        free_root=root,
        pose_inverse=np.ascontiguousarray(pose_inverse),
        pose_root=_roots(second),
        follow=np.ascontiguousarray(anchor.follow + follow),
    )


def _roots(normal: Array) -> Array:
    """R of each of normal matrices R' R."""
    return np.asarray(np.linalg.cholesky(normal).transpose(0, 2, 1))


def _root_and_inverse(normal: Array) -> tuple[Array, Array]:
    """R of a normal matrix R' R, and its inverse, after scaling the diagonal to one."""
    diagonal = np.diagonal(normal)
    if not (diagonal > 0).all():
        raise np.linalg.LinAlgError("not positive definite")
    scale = np.sqrt(diagonal)
    scaled = normal / (scale[:, None] * scale)
    inverse = np.linalg.inv(scaled) / (scale[:, None] * scale)
    return np.linalg.cholesky(scaled).T * scale, 0.5 * (inverse + inverse.T)


@dataclass(frozen=True, eq=False)
class _History:
    """Steps that were asked for and those that were taken, the last ones."""

    asked: list[Array]
    taken: list[Array]

    def corrected(self, anchor: Anchor, asked: Array) -> Array:
        """The step to take where another is asked for.

        The steps taken changed what was asked for; their combination that would have left least of it is taken too.
        """
        step = asked
        if self.taken:
            now = [*self.asked[1:], asked]
            change = np.stack([new - old for new, old in zip(now, self.asked, strict=True)], axis=1)
            weighted = _in_deviations(anchor, np.column_stack([change, asked]))
            share = np.linalg.lstsq(weighted[:, :-1], weighted[:, -1], rcond=RANK)[0]
            step = asked - (np.stack(self.taken, axis=1) + change) @ share
        self.asked.append(asked)
        self.taken.append(step)
        if len(self.taken) > MEMORY:
            del self.asked[0], self.taken[0]
        return step


def _in_deviations(anchor: Anchor, steps: Array) -> Array:
    """Steps (Q + 6 V, N) of free parameters and poses in coordinates in which lengths are standard deviations."""
    free = len(anchor.free_root)
    pose = steps[free:].reshape(-1, 6, steps.shape[1])
    return np.concatenate([anchor.free_root @ steps[:free], (anchor.pose_root @ pose).reshape(-1, steps.shape[1])])


def _descended(anchor: Anchor, problem: Problem, looks: int) -> CameraFit | None:
    """The minimum by Levenberg-Marquardt from the anchor; None if it is not found."""
    found = minimise(
        problem, anchor.camera, anchor.cam_from_target, anchor.tie.row, RobustLoss(), DescentSteps(MOST_STEPS)
    )
    cost = float(found.blocks.cost.sum())
    if not (found.converged and np.isfinite(cost)):
        return None
    return CameraFit(found.camera, found.cam_from_target, cost, looks + 3 * found.iterations)
