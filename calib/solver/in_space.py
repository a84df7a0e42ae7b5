"""From the solution that minimises distances in the image to one that minimises distances in space; how sure it is."""

from dataclasses import replace

import numpy as np

from calib.cameras.camera import Camera
from calib.core.linear_algebra import worse_sigma
from calib.core.se3 import steps_between
from calib.core.types import KnownPoints
from calib.solver.accuracy import Accuracy, accuracy_of, projected_change, share_px
from calib.solver.blocks import RobustLoss, view_blocks, view_misfit
from calib.solver.costs import COSTS, DISTANCES, IMAGE
from calib.solver.descend import ROUNDS, Descended, ShownMinimum, descended_at, minimise_shown
from calib.solver.distance import InSpace
from calib.solver.levenberg import DescentSteps
from calib.solver.outliers import robust_sigma, whitened
from calib.solver.problem import Problem, SolveOptions, Tie
from designer.base.arrays import Array, Rows
from designer.base.errors import InputError
from designer.base.words import shown

ENOUGH = 1000
"""Pixels to tell from where cameras differ."""


def require_planes(minimise: str, points: KnownPoints, seen: Rows) -> None:
    """Refuse what is no cost, and to measure in planes that are not known, of the points that were seen.

    Raises:
        InputError: there is no such cost, or a point lies on no plane.
    """
    if minimise not in COSTS:
        raise InputError(f"minimise {shown(minimise)}: there are {', '.join(COSTS)}")
    name = COSTS[minimise].distance
    alone = int((points.face[np.unique(seen)] < 0).sum()) if name and DISTANCES[name].needs_planes else 0
    if alone:
        raise InputError(
            f"--minimise {minimise}: {alone} of the points lie on no known plane; take ray, or give a target file"
        )


def in_space(problem: Problem, minimise: str, points: KnownPoints, seen: Rows) -> Problem:
    """The problem of distances in space, by a cost of `COSTS`; `seen` are rows of the points (M,)."""
    cost = COSTS[minimise]
    distance, axes = DISTANCES[cost.distance], None
    if distance.needs_planes:
        normal = points.plane[points.face[seen], :3].T
        other = np.eye(3)[np.abs(normal).argmin(axis=0)].T  # the axis of space that is least along it
        first = np.cross(normal, other, axis=0)
        first /= np.linalg.norm(first, axis=0)
        axes = np.stack([first, np.cross(normal, first, axis=0)])
    space = InSpace(distance, cost.over_range, problem.measured_px, axes)
    if cost.unit == "px":
        return replace(problem, space=space)
    plain = np.repeat(np.array([[1.0], [0.0], [1.0]]), len(seen), axis=1)
    return replace(problem, space=space, whitener=plain)


def minimise_in_space(problem: Problem, camera: Camera, poses: Array, tie: Tie, options: SolveOptions) -> ShownMinimum:
    """Descend in a problem of distances in space; the loss bends where most distances are small against it."""
    taken = 0
    for _ in range(1 if options.loss == "squares" else ROUNDS):
        loss = RobustLoss()
        if options.loss != "squares":
            off = view_misfit(problem, camera, poses, loss).residual_px
            loss = RobustLoss(options.loss, robust_sigma(whitened(problem.whitener, off)))
        shown = minimise_shown(problem, camera, poses, tie.row, loss, DescentSteps(options.max_iterations))
        camera, poses = shown.minimum.camera, shown.minimum.cam_from_target
        taken += shown.minimum.iterations
    return replace(shown, minimum=replace(shown.minimum, iterations=taken))


def descend_in_space(
    problem: Problem, points: KnownPoints, seen: Rows, start: Descended, tie: Tie, options: SolveOptions,
    cov_px2: Array | None,
) -> tuple[Descended, Accuracy, str] | None:  # fmt: skip
    """From the solution in the image to that in space, without what the first left out; None if that is the solution.

    With the accuracy, and a word on what it changed.

    It is told in the image as all solutions are: its residuals and blocks are those of the image there. The estimate in
    the image is the surest one, so its error has nothing to do with how far another estimate is from it (Hausman 1978,
    Specification tests in econometrics, lemma 2.1): with the one's covariance V and the step D to the other, this one's
    mean square error is `V + D D'`. What the other cost does to the solution beyond chance, as distances in space
    are shorter nearer to the camera, is thereby in what is stated.
    """
    if options.minimise == IMAGE or start.is_lost.any():
        return None
    minimum = start.minimum
    space = in_space(replace(problem, is_used=start.is_used), options.minimise, points, seen)
    found = minimise_in_space(space, minimum.camera, minimum.cam_from_target, tie, options)
    there, is_used = found.minimum, start.is_used & ~found.is_beyond
    blocks = view_blocks(replace(problem, is_used=is_used), there.camera, there.cam_from_target, RobustLoss())
    told = replace(there, blocks=blocks, iterations=minimum.iterations + there.iterations)
    is_beyond = start.is_beyond | found.is_beyond
    descended = descended_at(problem, told, is_used, is_beyond, start.robust, cov_px2)
    sure = accuracy_of(minimum.blocks.products, tie.row, int(start.is_used.sum()), start.robust)
    step = there.camera.params - minimum.camera.params
    moved = steps_between(minimum.cam_from_target, there.cam_from_target)
    accuracy = replace(
        sure,
        scale=accuracy_of(blocks.products, tie.row, int(is_used.sum()), start.robust).scale,
        param_covariance=sure.param_covariance + np.outer(step, step),
        pose_covariance=sure.pose_covariance + moved[:, :, None] * moved[:, None, :],
    )
    pixel = problem.measured_px.T[is_used]
    off_px, sigma_px = camera_change(minimum.camera, step, sure.param_covariance, pixel)
    remark = (
        f"minimised: {COSTS[options.minimise].title}; where points were seen, 95 % are within {off_px:.2g} px of the "
        f"camera that the distances in the image give, itself sure to {sigma_px:.2g} px there; what is stated has the "
        "difference in it"
    )
    return descended, accuracy, remark


def camera_change(camera: Camera, step: Array, covariance: Array, pixel: Array) -> tuple[float, float]:
    """By how much a step of the parameters moves 95 % of the pixels (M, 2) where something was seen; their sigma."""
    some = pixel[:: max(len(pixel) // ENOUGH, 1)]
    change = projected_change(camera, some, some)
    off_px = share_px(np.hypot(*(change @ step).T))
    return off_px, share_px(worse_sigma(change @ np.nan_to_num(covariance) @ change.transpose(0, 2, 1)))
