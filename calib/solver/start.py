"""Where the solution starts, without prior knowledge: a first camera, first poses, and poses of a known camera."""

from collections.abc import Iterable, Iterator
from contextlib import suppress
from dataclasses import dataclass, replace
from functools import lru_cache

import numpy as np

from calib.cameras import ABILITIES, MODELS, WIDE, neutral, rays
from calib.cameras.camera import Camera
from calib.cameras.parameters import slopes
from calib.cameras.refit import even_camera, fit_rays, image_grid, plain_camera
from calib.core.linear_algebra import symmetric_inverse
from calib.core.se3 import compose, invert, make_pose, rotation_between
from calib.core.types import LEAST_POINTS, Observations
from calib.solver.blocks import KNEE, RobustLoss, view_misfit
from calib.solver.levenberg import DescentSteps, minimise, minimise_poses
from calib.solver.linear_pose import focal_of, linear_views, poses_of, principal_frames, weak_perspective_poses
from calib.solver.outliers import MEDIAN_LENGTH, forgetful
from calib.solver.problem import MANY, Problem, few_per_view, pack, select, target_covariance, target_poses
from designer.base.arrays import Array, Flags, Rows
from designer.base.errors import InputError

FEW_VIEWS = 16
WIDE_GRID = 24
FIELDS_DEG = (80.0, 120.0, 180.0, 270.0, 400.0)
"""First guesses of a wide lens's field of view, from corner to corner, were there light all the way: where the image
is a circle within a wide frame, 200 degrees across are 400 from corner to corner."""
WIDEST_RAD = 2.4
"""Of the angle off the axis, for such a guess."""
FAR_COSINE = 0.5
"""Of the angle off the axis from which on a plane z = 1 is no place for rays."""
STEEPEST = 4.0
"""Slope of rays that linear equations are made of: farther out they would outweigh all others."""
FOCALS = (0.5, 0.8, 1.3, 2.2, 4.0, 8.0)
"""First guesses of the focal length where the views do not tell, in units of the image's longer side."""
GOOD_FIT = 5e-4
"""Root mean square residual, as a part of the image's longer side, of a start that needs no other tried."""
AT_BOUND = 0.02
"""So near to a bound a parameter is taken to have run into it."""
COARSE_STEPS = 25
POOR = 25.0
"""Mean square residual of a view, in units of the median view's, of which another start may find a better pose."""
SCARCE = 12
"""Points with which a first pose is unsure."""
HOPELESS = 300.0
"""A start this many times worse than what is known leads nowhere better."""
FAR_OFF = 0.1
"""Of the image's longer side: farther off than that is no worse."""
BETTER = 0.999
"""Of the cost of a view: a pose turned over that is better than this is another one, not rounding."""
STEPS = 15
MOST_STEPS = 50


@lru_cache(maxsize=64)
def wide_camera(model: str, image_size: tuple[int, int], field_rad: float) -> Camera:
    """The camera of a wide model whose angles are as even as can be, so far from corner to corner of the image.

    Nearly all wide lenses are made so that the distance from the centre grows in proportion to the angle. Cameras are
    kept, as halves and parts of the same photos begin with the same.
    """
    even = even_camera(image_size, field_rad)
    return even if model == WIDE else _in_words_of(even, model, image_grid(image_size, WIDE_GRID).reshape(-1, 2))


def _in_words_of(camera: Camera, model: str, pixel: Array) -> Camera:
    """The camera of another model with the same rays at pixels (N, 2), but for those from far behind."""
    ray = rays(camera, pixel)
    ray[~(ray[:, 2] > np.cos(WIDEST_RAD))] = np.nan
    return fit_rays(pixel, ray, camera.image_size, model).camera


def coarse_camera(
    problem: Problem, model: str, tie: Rows, fixed: Array, focal_px: float | None, *, is_robust: bool
) -> Camera:
    """A camera from a few observations of a few views, good enough to start all of them.

    Parameters follow their free ones (`tie`; -1: fixed) and have the values in `fixed` from the start (nan: any).
    Robust is what most observations of a view agree on.
    """
    few = select(problem, views := _spread_views(problem), few_per_view(len(views)))
    side = max(problem.image_size)
    tried: list[_Tried] = []
    for batch in _first_cameras(few, model, focal_px, is_robust=is_robust):
        for first in batch:
            tried += _solve_few(few, _with_fixed(first, tie, fixed), tie, is_robust=is_robust)
        if any(one.typical_px2(is_robust=is_robust) < (GOOD_FIT * side) ** 2 and not one.is_at_bound for one in tried):
            break
    if not tried:
        return _with_fixed(plain_camera(model, problem.image_size, focal_px or float(side)), tie, fixed)
    best = min(one.typical_px2(is_robust=is_robust) for one in tried)
    return min(tried, key=lambda one: one.cost_px2(best, is_robust=is_robust)).camera


@dataclass(frozen=True, eq=False)
class _Tried:
    """A camera, and how far off it shows the observations, in pixels whatever their weights."""

    camera: Camera
    square_px2: Array  # (M,) of all views, those without a pose far off

    @property
    def is_at_bound(self) -> bool:
        """Whether a parameter has run into one of its bounds: there may be a minimum elsewhere."""
        bounds = MODELS[self.camera.model].parameters
        return any(
            min(x - bound.lower, bound.upper - x) < AT_BOUND
            for bound, x in zip(bounds, self.camera.params.tolist(), strict=True)
        )

    def typical_px2(self, *, is_robust: bool) -> float:
        """Of an observation."""
        return float(np.median(self.square_px2) if is_robust else self.square_px2.mean())

    def cost_px2(self, best_px2: float, *, is_robust: bool) -> float:
        """To compare with others, of the best of which this is typical."""
        if not is_robust:
            return float(self.square_px2.mean())
        knee_px2 = (KNEE["cauchy"] / MEDIAN_LENGTH) ** 2 * max(best_px2, np.finfo(float).tiny)
        return float(np.log1p(self.square_px2 / knee_px2).mean())


def _spread_views(problem: Problem) -> Rows:
    """Views that are evenly spread over their order."""
    used = np.add.reduceat(problem.is_used.astype(np.int64), problem.view_start[:-1])
    views = np.flatnonzero(used >= LEAST_POINTS)
    if len(views) <= FEW_VIEWS:
        return views
    return views[((np.arange(FEW_VIEWS) + 0.5) * len(views) / FEW_VIEWS).astype(np.int64)]


def _first_cameras(few: Problem, model: str, focal_px: float | None, *, is_robust: bool) -> Iterator[Iterable[Camera]]:
    """First guesses, those together of which the best is to be known: of wide models first, then without distortion."""
    if ABILITIES[model].is_wide:
        if model != WIDE:
            yield _as_wide(few, model, is_robust=is_robust)
        yield _even_cameras(model, few.image_size)
    side = max(few.image_size)
    for focal in _focals(few, focal_px, side, is_robust=is_robust):
        yield (plain_camera(model, few.image_size, focal),)


def _even_cameras(model: str, image_size: tuple[int, int]) -> Iterator[Camera]:
    """Wide cameras of all fields of view that the model has."""
    for field in FIELDS_DEG:
        with suppress(InputError):
            yield wide_camera(model, image_size, np.radians(field))


def _as_wide(few: Problem, model: str, *, is_robust: bool) -> Iterator[Camera]:
    """The camera of the model that takes any lens, in the words of another, which has minima beside the best one."""
    free = np.arange(len(neutral(WIDE)))
    camera = coarse_camera(few, WIDE, free, np.full(len(free), np.nan), None, is_robust=is_robust)
    pixel = image_grid(few.image_size, WIDE_GRID).reshape(-1, 2)
    off_centre = [np.linalg.norm(u - camera.params[2:4], axis=1) for u in (pixel, few.measured_px.T)]
    with suppress(InputError):
        yield _in_words_of(camera, model, pixel[off_centre[0] <= off_centre[1].max()])  # farther out it is anything


def _focals(few: Problem, focal_px: float | None, side: int, *, is_robust: bool) -> list[float]:
    """First guesses, the most likely one first."""
    middle = 0.5 * (np.array(few.image_size) - 1)
    centred = (few.measured_px - middle[:, None]) / side
    found = focal_of(linear_views(few.view_start, few.position_mm, centred, is_robust=is_robust))
    likely = [] if focal_px is None else [focal_px]
    likely += [found * side] if 0.1 < found < 50 else []
    return [*likely, *(factor * side for factor in FOCALS)]


def _with_fixed(camera: Camera, tie: Rows, fixed: Array) -> Camera:
    """The camera with a person's values, and one value for parameters that are to share it."""
    params = np.where(np.isnan(fixed), camera.params, fixed)
    free = tie >= 0
    params[free] = (np.bincount(tie[free], params[free]) / np.bincount(tie[free]))[tie[free]]
    return replace(camera, params=params)


def _solve_few(few: Problem, camera: Camera, tie: Rows, *, is_robust: bool) -> list[_Tried]:
    """Poses from linear equations, then all unknowns together; nothing if that leads nowhere."""
    poses = linear_poses(few, camera, is_robust=is_robust)
    ok: Flags = np.asarray(np.isfinite(poses).all(axis=(1, 2)))
    if not ok.any():
        return []
    part = select(few, np.flatnonzero(ok), MANY)
    loss = RobustLoss()
    if is_robust:
        loss = forgetful(view_misfit(part, camera, poses[ok], loss).residual_px)
    found = minimise_poses(part, camera, poses[ok], loss, max_iterations=3, small_decrease=1e-2)
    seen = np.isfinite(found.blocks.cost)
    if not seen.any():
        return []
    part = select(part, np.flatnonzero(seen), MANY)
    found = minimise(
        part, camera, found.cam_from_target[seen], tie, loss, DescentSteps(COARSE_STEPS, small_decrease=1e-4)
    )
    if not np.isfinite(found.blocks.cost.sum()):
        return []
    square = np.full(len(few.is_used), (FAR_OFF * max(few.image_size)) ** 2)
    shown = (found.blocks.residual_px**2).sum(axis=0)
    square[: len(shown)] = np.where(shown < square[0], shown, square[0])  # also where nothing is shown
    return [_Tried(found.camera, square)]


def linear_poses(problem: Problem, camera: Camera, *, is_robust: bool, as_planes: bool = False) -> Array:
    """Poses (V, 4, 4) by linear equations on the rays of the measured pixels; nan where there is none.

    Of a solid, a projection and weak perspective are tried: the one is exact, the other stands few points, and a plane
    with a point or two beside it.
    """
    ray = rays(camera, problem.measured_px.T)
    view_from_cam = _facing(problem, ray)
    slope = slopes(ray if view_from_cam is None else np.einsum("mij,mj->mi", view_from_cam[problem.view], ray))
    used = problem.is_used & (slope[:, 0] ** 2 + slope[:, 1] ** 2 < STEEPEST**2)  # false of nan
    counts = np.add.reduceat(used.astype(np.int64), problem.view_start[:-1])
    poses = np.full((problem.view_count, 4, 4), np.nan)
    views = np.flatnonzero(counts >= LEAST_POINTS)
    if not len(views):
        return poses
    inside = np.flatnonzero(used & (counts >= LEAST_POINTS)[problem.view])
    start = np.concatenate([[0], np.cumsum(counts[views])])
    position, image = problem.position_mm.take(inside, axis=1), slope.take(inside, axis=0).T
    fitted = linear_views(start, position, image, as_planes=as_planes, is_robust=is_robust)
    cam_from_view = None if view_from_cam is None else make_pose(view_from_cam[views].transpose(0, 2, 1), np.zeros(3))
    poses[views] = _composed(cam_from_view, poses_of(fitted))
    if not as_planes and not fitted.is_planar.all():
        other = np.full_like(poses, np.nan)
        other[views] = _composed(cam_from_view, weak_perspective_poses(start, position, image))
        median = [_median_squares(problem, camera, one) for one in (poses, other)]
        poses = np.where((median[1] < median[0])[:, None, None], other, poses)
    return poses


def _composed(cam_from_view: Array | None, poses: Array) -> Array:
    return poses if cam_from_view is None else compose(cam_from_view, poses)


def _facing(problem: Problem, ray: Array) -> Array | None:
    """Rotations (V, 3, 3) after which the rays (M, 3) of views that lie far off the axis have it in their middle.

    None if there are no such views.
    """
    depth, first = np.where(np.isfinite(ray[:, 2]) & problem.is_used, ray[:, 2], 0.0), problem.view_start[:-1]
    is_far = np.minimum.reduceat(np.where(depth == 0, 1.0, depth), first) < FAR_COSINE
    if not is_far.any():
        return None
    middle = np.add.reduceat(np.where(np.isfinite(ray) & problem.is_used[:, None], ray, 0.0), first, axis=0)
    length = np.linalg.norm(middle, axis=1, keepdims=True)
    is_far &= length[:, 0] > 0
    ahead = np.array([0.0, 0.0, 1.0])
    towards = np.where(is_far[:, None], middle / np.where(length > 0, length, 1.0), ahead)
    return rotation_between(towards, np.broadcast_to(ahead, towards.shape))


def _median_squares(problem: Problem, camera: Camera, poses: Array) -> Array:
    """Median squared distance in each view (V,); infinite without a pose."""
    known: Flags = np.asarray(np.isfinite(poses).all(axis=(1, 2)))
    shown = np.where(known[:, None, None], poses, np.eye(4))
    square = (view_misfit(problem, camera, shown, RobustLoss()).residual_px ** 2).sum(axis=0)
    square = np.where(np.isfinite(square), square, np.inf)
    order = np.lexsort((square, problem.view))
    middle = (problem.view_start[:-1] + problem.view_start[1:]) // 2
    median: Array = np.where(known, square[order][middle], np.inf)
    return median


@dataclass(frozen=True, eq=False)
class FirstPoses:
    """Poses that were found."""

    cam_from_target: Array  # (V, 4, 4), nan where none was found
    found: Flags  # (V,)


@dataclass(frozen=True, eq=False)
class _Best:
    """The best poses so far and their costs; infinite: none."""

    poses: Array  # (V, 4, 4)
    cost: Array  # (V,)


def first_poses(problem: Problem, camera: Camera, *, is_robust: bool) -> FirstPoses:
    """A pose of every view, from a few of its observations."""
    few, loss = problem.few, RobustLoss()
    start = linear_poses(few, camera, is_robust=is_robust)
    if is_robust:
        ok: Flags = np.asarray(np.isfinite(start).all(axis=(1, 2)))
        loss = forgetful(view_misfit(few, camera, np.where(ok[:, None, None], start, np.eye(4)), loss).residual_px)
    views = few.view_count
    best = _Best(np.zeros((views, 4, 4)) + np.eye(4), np.full(views, np.inf))
    best = _improved(few, camera, best, start, np.arange(views), loss)
    unsure = _unsure(few, best)
    if len(unsure):
        flat = linear_poses(select(few, unsure, MANY), camera, is_robust=is_robust, as_planes=True)
        best = _improved(few, camera, best, flat, unsure, loss)
    best = _turned_over(few, camera, best, loss)
    found = np.isfinite(best.cost)
    return FirstPoses(np.where(found[:, None, None], best.poses, np.nan), found)


def _unsure(few: Problem, best: _Best) -> Rows:
    """Views that have no pose, one that fits badly, or few points."""
    count = np.diff(few.view_start)
    square = best.cost / count
    known = square[np.isfinite(square)]
    limit = POOR * float(np.median(known)) if len(known) else 0.0
    return np.flatnonzero(~(square <= limit) | (count < SCARCE))


def _improved(few: Problem, camera: Camera, best: _Best, start: Array, views: Rows, loss: RobustLoss) -> _Best:
    """The best poses after a descent of some views from other starts (len(views), 4, 4), nan: none."""
    ok = np.isfinite(start).all(axis=(1, 2))
    views, start = views[ok], start[ok]
    if not len(views):
        return best
    minimum = minimise_poses(select(few, views, MANY), camera, start, loss, max_iterations=STEPS, small_decrease=1e-4)
    better = minimum.blocks.cost < best.cost[views]
    poses, cost = np.array(best.poses), np.array(best.cost)
    poses[views[better]] = minimum.cam_from_target[better]
    cost[views[better]] = minimum.blocks.cost[better]
    return _Best(poses, cost)


def turned_over(problem: Problem, camera: Camera, cam_from_target: Array, *, is_robust: bool) -> Array | None:
    """The poses (V, 4, 4), those turned over that are better so; None if none is."""
    for part in (problem.few, problem):  # a few tell when all are hopeless
        loss, shown = RobustLoss(), view_misfit(part, camera, cam_from_target, RobustLoss())
        if is_robust:
            loss = forgetful(shown.residual_px)
            shown = view_misfit(part, camera, cam_from_target, loss)
        best = _Best(cam_from_target, shown.cost)
        found = _turned_over(part, camera, best, loss)
        if found is best:
            return None
    return found.poses if (found.cost < BETTER * best.cost).any() else None


def _turned_over(few: Problem, camera: Camera, best: _Best, loss: RobustLoss) -> _Best:
    """The best poses, those turned over that are better so."""
    known = np.flatnonzero(np.isfinite(best.cost))
    if not len(known):
        return best
    part = select(few, known, MANY)
    other = _flipped(part, best.poses[known])
    start = view_misfit(part, camera, other, loss).cost
    # Near a plane the other pose shows something else altogether; it need not be tried.
    tried = ~(start > HOPELESS * best.cost[known])
    return _improved(few, camera, best, other[tried], known[tried], loss)


def _flipped(problem: Problem, cam_from_target: Array) -> Array:
    """The poses that show the same to a camera far away: the points' plane mirrored in depth about its middle.

    In the plane's frame `R' = M R diag(1, 1, -1)`, with M the mirror across the line of sight to the middle
    (Schweighofer and Pinz 2006). For points that are not in a plane the pose is merely another start.
    """
    frame, _ = principal_frames(problem.view_start, problem.position_mm)
    pose = np.array(compose(cam_from_target, frame))
    sight = pose[:, :3, 3] / np.linalg.norm(pose[:, :3, 3], axis=1, keepdims=True)
    mirror = np.eye(3) - 2 * sight[:, :, None] * sight[:, None, :]
    pose[:, :3, :3] = mirror @ pose[:, :3, :3] @ np.diag([1.0, 1.0, -1.0])
    return compose(pose, invert(frame))


@dataclass(frozen=True, eq=False)
class Poses:
    """Where the target stands before the camera, view by view; nan where no pose was found."""

    cam_from_target: Array  # (V, 4, 4)
    covariance: Array  # (V, 6, 6) rotation vector (rad), translation (mm), in the camera's axes
    residual_px: Array  # (M, 2) predicted - measured
    scale: (
        float  # posterior standard deviation of an observation; px, or with weights in units of the stated covariance
    )


def solve_poses(camera: Camera, observations: Observations, *, weighted: bool = True) -> Poses:
    """The pose of each view, of four points or more, with the least squared distances in the image."""
    problem = pack(observations, weighted=weighted)
    first = first_poses(problem, camera, is_robust=False)
    start = np.where(first.found[:, None, None], first.cam_from_target, np.eye(4))
    minimum = minimise_poses(problem, camera, start, RobustLoss(), max_iterations=MOST_STEPS)
    found = first.found & np.isfinite(minimum.blocks.cost)
    redundancy = 2 * int(found[observations.view].sum()) - 6 * int(found.sum())
    squares = float(minimum.blocks.products[found, -1, -1].sum())
    scale = float(np.sqrt(squares / redundancy)) if redundancy > 0 else float("nan")
    normal = np.where(found[:, None, None], minimum.blocks.products[:, -7:-1, -7:-1], np.eye(6))
    lost = ~found
    poses = minimum.cam_from_target
    covariance = target_covariance(problem, poses, scale**2 * symmetric_inverse(normal).covariance)
    return Poses(
        np.where(lost[:, None, None], np.nan, target_poses(problem, poses)),
        np.where(lost[:, None, None], np.nan, covariance),
        np.where(lost[observations.view][:, None], np.nan, minimum.blocks.residual_px.T),
        scale,
    )
