"""Learning the map from all views of any target, map and pinhole in turn; and the pinhole behind a map.

With poses and pinhole given, every sighting says where on the sensor its pixel lies: the pinhole projection of its
point. Thousands of them are too many for a Gaussian process, so they are averaged in cells of the image; what is
averaged is how far they lie from the map so far, which is nearly constant in a cell. With the map given, the pinhole
and the poses are solved. The alternation is a fixed-point iteration on the cells' points; it is sped up by Anderson's
method (J. ACM 12, 1965), which combines the last steps so that they all but cancel.
"""

import time
from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np

from calib.cameras import LINEAR, rays
from calib.cameras.camera import Camera, LearnedMap
from calib.cameras.learn_map import Cells, Learned, MapSamples, Process, cells_of, learn_map
from calib.cameras.learned import known_at, to_image, to_sensor
from calib.cameras.parameters import slopes
from calib.cameras.virtual import VIRTUAL
from calib.core.linear_algebra import least_squares, solve_square
from calib.core.se3 import transform
from calib.core.types import Observations, keep_sightings, without_empty_views
from calib.solver.calibration import Calibration
from calib.solver.problem import SolveOptions
from calib.solver.solve import solve
from designer.base.arrays import Array, Flags
from designer.base.errors import InputError

MARGIN_PX = 1.0
"""The map is known so far around a sighting that is used, so that its prediction is known too."""
MIN_OBSERVATIONS = 6
"""Of a view that is used: its pose has six unknowns."""
SensorMap = Callable[[Array], Array]
MIN_VIEWS = 3
MAX_ROUNDS = 30
SMALL_CHANGE_PX = 1e-3
LEARN_IN_ROUNDS = 1, 4
"""When the process is learned too. The first takes for noise what the poses bear of the lens model's errors; by the
last these are gone."""
HISTORY = 5
"""Steps that are combined."""


@dataclass(frozen=True, eq=False)
class OnSensor:
    """Observations whose pixels are points of the sensor."""

    observations: Observations  # covariances: those that a measured pixel with the covariance 1, or its own, has there
    jacobian: Array  # (M, 2, 2) derivative of the sensor's point by the pixel


def move_to_sensor(observations: Observations, learned: LearnedMap, *, weighted: bool) -> OnSensor:
    """Take observations to the sensor; weighted by the covariances there, they count as in the image."""
    there = to_sensor(learned, observations.image_size, observations.center_px)
    cov = np.broadcast_to(np.eye(2), there.jacobian.shape)
    if weighted and observations.cov_px2 is not None:
        cov = observations.cov_px2
    cov = there.jacobian @ cov @ there.jacobian.transpose(0, 2, 1)
    return OnSensor(replace(observations, center_px=there.point, cov_px2=cov), there.jacobian)


def solve_on_sensor(observations: Observations, learned: LearnedMap, options: SolveOptions) -> Calibration:
    """Solve the pinhole of a virtual camera whose map is known; the map's own uncertainty is not in the covariances.

    Sightings where the map is not known are left out, and the remarks say so.
    """
    begin = time.perf_counter()
    kept, remarks = _known_part(observations, learned)
    moved = move_to_sensor(kept, learned, weighted=options.weighted)
    noise = moved.observations.cov_px2
    if kept.cov_px2 is not None:  # what is far off is told by what the detector states, not by the weights
        noise = moved.jacobian @ kept.cov_px2 @ moved.jacobian.transpose(0, 2, 1)
    solved = solve(moved.observations, LINEAR, replace(options, weighted=True), noise_px2=noise)
    rows = rows_of_views(kept, solved.observations.view_names)
    kept = without_empty_views(keep_sightings(kept, rows))
    return replace(
        solved,
        camera=Camera(VIRTUAL, solved.camera.params, kept.image_size, learned),
        observations=kept,
        residual_px=_in_image(learned, kept, solved, moved.jacobian[rows]),
        weighted=options.weighted and kept.cov_px2 is not None,
        remarks=(*solved.remarks, *remarks),
        seconds=time.perf_counter() - begin,
    )


def _in_image(learned: LearnedMap, observations: Observations, solved: Calibration, jacobian: Array) -> Array:
    """Residuals in measured pixels, by inverting the map where a point is predicted.  # (M, 2)"""
    predicted = solved.observations.center_px + solved.residual_px
    residual = to_image(learned, observations.image_size, predicted) - observations.center_px
    # Far outside the map, as the prediction of a grossly wrong sighting may be, there is only its tangent.
    tangent = solve_square(jacobian, solved.residual_px[:, :, None])[:, :, 0]
    return np.where(np.isfinite(residual), residual, tangent)


def _known_part(observations: Observations, learned: LearnedMap) -> tuple[Observations, tuple[str, ...]]:
    """The sightings where the map is known, in views that keep enough of them, and what is left out."""
    known = np.ones(len(observations.view), dtype=bool)
    for step in ((-1, -1), (-1, 1), (1, -1), (1, 1)):
        known &= known_at(learned, observations.image_size, observations.center_px + MARGIN_PX * np.array(step))
    counts = np.bincount(observations.view[known], minlength=observations.view_count)
    enough = counts >= MIN_OBSERVATIONS
    if not enough.any():
        raise InputError(
            f"no view has {MIN_OBSERVATIONS} observations where the learned map is known; "
            "learn it from a photo whose board fills the image"
        )
    kept = known & enough[observations.view]
    remarks = []
    if not kept.all():
        remarks.append(f"{(~kept).sum()} of {len(kept)} observations left out: the learned map is not known there")
    if not enough.all():
        few = f"with fewer than {MIN_OBSERVATIONS} observations on the known map"
        remarks.append(f"{(~enough).sum()} of {len(enough)} views left out, {few}")
    return without_empty_views(keep_sightings(observations, kept)), tuple(remarks)


def rows_of_views(observations: Observations, view_names: tuple[str, ...]) -> Flags:
    """Which observations are of the views named.  # (M,)"""
    kept = np.array([name in set(view_names) for name in observations.view_names], dtype=bool)
    rows: Flags = kept[observations.view]
    return rows


@dataclass(frozen=True, eq=False)
class FromViews:
    """A map learned from all views."""

    learned: Learned
    rounds: int
    change_px: float  # of the last round


def learn_from_views(start: Calibration, options: SolveOptions) -> FromViews:
    """Learn the map that fits all views, from a solution with a lens model: the first poses and the first map."""
    seen = start.observations
    if seen.view_count < MIN_VIEWS:
        raise InputError(
            f"{seen.view_count} views to learn a map of the lens from: at least {MIN_VIEWS} are needed to tell it "
            "from the poses; take more photos, or give a photo of a board that fills the image (--reference)"
        )
    weights = seen.cov_px2 if options.weighted else None
    variance = np.ones(len(seen.view)) if weights is None else 0.5 * np.trace(weights, axis1=1, axis2=2)
    cells = cells_of(seen.center_px, variance)
    point = _updated(_map_of_camera(start.camera), seen, start, cells)
    points: list[Array] = []
    steps: list[Array] = []
    process: Process | None = None
    for count in range(1, MAX_ROUNDS + 1):
        samples = MapSamples(cells.pixel, point, cells.variance, cells.measurements)
        learned = learn_map(samples, seen.image_size, process, improve=count in LEARN_IN_ROUNDS)
        process = learned.process
        moved = move_to_sensor(seen, learned.map, weighted=options.weighted)
        solved = solve(moved.observations, LINEAR, replace(options, weighted=True))
        step = _updated(_map_of(learned, seen.image_size), seen, solved, cells) - point
        step = _without_gauge(step, point, solved.camera.params, cells.variance)
        change = _largest_px(step, learned, cells.pixel, seen.image_size)
        if change < SMALL_CHANGE_PX and count > LEARN_IN_ROUNDS[-1]:
            break
        points, steps = [*points, point][-HISTORY - 1 :], [*steps, step][-HISTORY - 1 :]
        point = _combined(points, steps, cells.variance)
    return FromViews(learned, count, change)


def _without_gauge(step: Array, point: Array, params: Array, variance: Array) -> Array:
    """A step (N, 2) without what pinhole and poses would make good.

    Turning the camera in all views, or changing its focal lengths and centre, moves the points of the sensor, and no
    sighting objects. Those seven motions would add up from round to round.
    """
    focal, centre = params[:2], params[2:4]
    x, y = ((point - centre) / focal).T
    zero, one = np.zeros_like(x), np.ones_like(x)
    motions = [(x, zero), (zero, y), (one, zero), (zero, one), (x * y, 1 + y * y), (1 + x * x, x * y), (-y, x)]
    basis = np.stack([np.stack(motion, axis=1) * focal for motion in motions], axis=-1).reshape(-1, len(motions))
    weight = np.repeat(1 / np.sqrt(variance), 2)
    share = least_squares(basis * weight[:, None], step.ravel() * weight)
    rest: Array = step - (basis @ share).reshape(-1, 2)
    return rest


def _largest_px(step: Array, learned: Learned, pixel: Array, image_size: tuple[int, int]) -> float:
    """The largest of some steps (N, 2) on the sensor, in pixels of the image."""
    jacobian = to_sensor(learned.map, image_size, pixel).jacobian
    return float(np.abs(solve_square(jacobian, step[:, :, None])).max())


def _map_of_camera(camera: Camera) -> SensorMap:
    """The map of a lens model: its rays on its own pinhole's image, or the pixel itself where it has no ray."""

    def sensor_map(pixel: Array) -> Array:
        point = slopes(rays(camera, pixel)) * camera.params[:2] + camera.params[2:4]
        return np.where(np.isfinite(point), point, pixel)

    return sensor_map


def _map_of(learned: Learned, image_size: tuple[int, int]) -> SensorMap:
    return lambda pixel: to_sensor(learned.map, image_size, pixel).point


def _updated(sensor_map: SensorMap, seen: Observations, solved: Calibration, cells: Cells) -> Array:
    """Where the pinhole projections of a solution put the cells' pixels, by way of the map so far.  # (N, 2)"""
    inside, params = solved.observations, solved.camera.params
    there = transform(solved.cam_from_target[inside.view], inside.points.position_mm[inside.point])
    projected = there[:, :2] / there[:, 2:] * params[:2] + params[2:4]
    rows = rows_of_views(seen, inside.view_names)
    off, used = np.zeros((len(rows), 2)), np.zeros(len(rows), dtype=bool)
    off[rows] = projected - sensor_map(seen.center_px[rows])
    used[rows] = ~solved.is_outlier
    return sensor_map(cells.pixel) + cells.mean(off, used)


def _combined(points: list[Array], steps: list[Array], variance: Array) -> Array:
    """The next point of a fixed-point iteration, from the last points and the steps taken there (Anderson, type II)."""
    point, step = points[-1], steps[-1]
    if len(points) < 2:
        return point + step
    weight = np.repeat(1 / np.sqrt(variance), 2)
    by_step = np.diff(np.stack([one.ravel() for one in steps]), axis=0).T
    by_point = np.diff(np.stack([one.ravel() for one in points]), axis=0).T
    share = np.linalg.lstsq(by_step * weight[:, None], step.ravel() * weight, rcond=1e-6)[0]
    combined: Array = point + step - ((by_point + by_step) @ share).reshape(-1, 2)
    return combined
