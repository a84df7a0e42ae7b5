"""The virtual camera: the map learned from one photo of a board, or from all views; then the pinhole behind it.

A camera's rays meet a plane in a homography of its pinhole image, so the plane is the image of a pinhole that stands
where the camera stands and looks along the plane's normal: a sensor without distortion (De Boi et al. 2023).

After De Boi, Pathak, Oliveira and Penne, "How to turn your camera into a perfect pinhole model", 2023: a single photo
of a planar grid spans the sensor. A target that is no plane takes a photo of a board, or the map of all views.
"""

import math
import time
from dataclasses import replace
from typing import TypeAlias

import numpy as np

from calib.cameras import DEFAULT
from calib.cameras.camera import LearnedMap
from calib.cameras.learn_map import MIN_SAMPLES, MapSamples, learn_from_many
from calib.cameras.learned import exact_point, known_at
from calib.core.homography import apply, direct
from calib.core.parallel import one_thread
from calib.core.types import KnownPoints, Observations
from calib.solver.calibration import Calibration
from calib.solver.learn_views import SMALL_CHANGE_PX, learn_from_views, solve_on_sensor
from calib.solver.outliers import MEDIAN_LENGTH
from calib.solver.problem import SolveOptions
from calib.solver.solve import solve
from designer.base.arrays import Array, Rows
from designer.base.errors import InputError

FLAT = 1e-6
"""Points that lie so near a plane, as a part of their extent, are on it."""
ENOUGH_COVERAGE = 0.9
"""Of the largest coverage of the image; among the views that have it, the most frontal is taken."""
LEAST_FRONTAL = 0.4
"""Shortening of a plane, at most that of a tilt of 66 degrees."""
Reference: TypeAlias = str | Observations
"""The photo that the map is learned from: the name of a view, or the sightings of a board in a photo of its own."""
MAP_TAKEN_AS_EXACT = "the standard deviations take the learned map as exact"
COVERAGE_GRID = 60
OUTLIER_ROUNDS = 5


def on_plane_mm(points: KnownPoints, rows: Rows) -> Array | None:
    """Coordinates (K, 2) of points in the plane of those rows that are used, or None if these are not on one."""
    used = points.position_mm[np.unique(rows)]
    middle = used.mean(axis=0)
    _, extent, axes = np.linalg.svd(used - middle, full_matrices=False)
    if len(used) < MIN_SAMPLES or not extent[2] <= FLAT * extent[1]:
        return None
    # The axes follow the target's own, so that the sensor does not depend on which points were seen.
    normal = np.cross(axes[0], axes[1])
    along = np.eye(3)[int(np.argmin(np.abs(normal)))]
    first = along - (along @ normal) * normal
    first /= np.linalg.norm(first)
    plane: Array = (points.position_mm - middle) @ np.column_stack([first, np.cross(normal, first)])
    return plane


def choose_view(observations: Observations, plane_mm: Array) -> int:
    """The view that covers most of the image, from the front if there are several."""
    coverage = np.zeros(observations.view_count)
    frontal = np.zeros(observations.view_count)
    for view in range(observations.view_count):
        rows = np.flatnonzero(observations.view == view)
        if len(rows) < MIN_SAMPLES:
            continue
        pixel = observations.center_px[rows]
        stretch = np.linalg.svd(_stretch(pixel, plane_mm[observations.point[rows]]), compute_uv=False)
        coverage[view], frontal[view] = _hull_area(pixel), stretch[1] / stretch[0]
    able = (coverage > 0) & (frontal >= LEAST_FRONTAL)
    if not able.any():
        raise InputError(
            "no photo shows the board from the front with enough of its rings, to learn the map of the lens from; "
            "take one that fills the image"
        )
    wide = able & (coverage >= ENOUGH_COVERAGE * coverage[able].max())
    return int(np.argmax(np.where(wide, frontal, -1.0)))


def _hull_area(pixel: Array) -> float:
    """Area of the convex hull of pixels (N, 2)."""
    import cv2

    return float(cv2.contourArea(cv2.convexHull(pixel.astype(np.float32))))


def _stretch(pixel: Array, plane: Array) -> Array:
    """Derivative of the homography from pixels to a plane, in the middle of the pixels.  # (2, 2)"""
    middle = pixel.mean(axis=0)
    homography = direct(pixel - middle, plane)
    point = apply(homography, np.zeros(2))
    jacobian: Array = (homography[:2, :2] - np.outer(point, homography[2, :2])) / homography[2, 2]
    return jacobian


def sensor_points(pixel: Array, plane_mm: Array) -> Array:
    """Points (N, 2) of a plane seen at pixels (N, 2), on a sensor of the image's scale and orientation, in pixels."""
    stretch = _stretch(pixel, plane_mm)
    if np.linalg.det(stretch) < 0:
        plane_mm, stretch = plane_mm * [1, -1], np.diag([1.0, -1.0]) @ stretch
    left, extent, right = np.linalg.svd(stretch)
    turn = (left @ right).T / np.sqrt(extent.prod())
    middle = pixel.mean(axis=0)
    homography = direct(pixel - middle, plane_mm)
    point: Array = (plane_mm - apply(homography, np.zeros(2))) @ turn.T + middle
    return point


def samples_of_plane(pixel: Array, plane_mm: Array, cov_px2: Array | None) -> MapSamples:
    """What a map is learned from: points of a plane (N, 2), where they were seen, with covariances if known."""
    variance = np.ones(len(pixel)) if cov_px2 is None else 0.5 * np.trace(cov_px2, axis1=1, axis2=2)
    return MapSamples(pixel, sensor_points(pixel, plane_mm), variance, np.ones(len(pixel), dtype=np.int64))


@one_thread
def solve_virtual(
    observations: Observations,
    options: SolveOptions | None = None,
    reference: Reference | None = None,
    *,
    all_views: bool = False,
) -> Calibration:
    """Solve a virtual camera.

    Args:
        observations: what was seen.
        options: of the pinhole's solution.
        reference: the photo to learn the map from; None: of a board the view that covers the image best, of other
            targets all views.
        all_views: learn the map from all views, of a board too.

    Raises:
        InputError: no such view, a reference that does not do, or too few sightings.
    """
    begin = time.perf_counter()
    options = options or SolveOptions()
    if reference is not None and all_views:
        raise InputError("the map is learned either from a reference photo or from all views; ask for one of them")
    plane = on_plane_mm(observations.points, observations.point)
    if all_views or (reference is None and plane is None):
        solved = _from_all_views(observations, options)
    else:
        solved = _from_photo(observations, plane, reference, options)
    remarks = (*solved.remarks, MAP_TAKEN_AS_EXACT)
    return replace(solved, remarks=remarks, seconds=time.perf_counter() - begin)


def _from_photo(
    observations: Observations, plane_mm: Array | None, reference: Reference | None, options: SolveOptions
) -> Calibration:
    """The pinhole behind a map learned from one photo of a plane."""
    if isinstance(reference, Observations):
        photo, view, plane_mm = _board_photo(reference, observations.image_size)
    elif plane_mm is None:
        raise InputError(
            f"{reference}: the points of this target lie on no plane, so none of its photos spans a sensor; "
            "give a photo of a board, or learn the map from all views"
        )
    else:
        photo, view = observations, _named_view(observations, plane_mm, reference)
    learned, remarks = _learned_from(photo, view, plane_mm, options.reject_sigma)
    solved = solve_on_sensor(observations, learned, options)
    return replace(solved, remarks=(*remarks, *solved.remarks))


def _board_photo(board: Observations, image_size: tuple[int, int]) -> tuple[Observations, int, Array]:
    """A photo of a board beside the observations, its view, and its points in the plane (K, 2)."""
    if board.image_size != image_size:
        raise InputError(
            f"{board.view_names[0]}: {board.image_size[0]} x {board.image_size[1]} px, but the photos have "
            f"{image_size[0]} x {image_size[1]}; take the reference with the same camera and settings"
        )
    plane_mm = on_plane_mm(board.points, board.point)
    if plane_mm is None:
        raise InputError(f"{board.view_names[0]}: too few points on a plane to learn a map from; show more of a board")
    return board, choose_view(board, plane_mm), plane_mm


def _named_view(observations: Observations, plane_mm: Array, name: str | None) -> int:
    """The view of a name, or the best one."""
    if name is None:
        return choose_view(observations, plane_mm)
    if name not in observations.view_names:
        raise InputError(f"{name}: no such view; name one of the photos that are solved")
    return observations.view_names.index(name)


def _learned_from(
    photo: Observations, view: int, plane_mm: Array, reject_sigma: float | None
) -> tuple[LearnedMap, list[str]]:
    """The map learned from one view, and what to say of it."""
    rows = np.flatnonzero(photo.view == view)
    cov = None if photo.cov_px2 is None else photo.cov_px2[rows]
    samples = samples_of_plane(photo.center_px[rows], plane_mm[photo.point[rows]], cov)
    learned = learn_from_many(samples, photo.image_size).map
    off, kept = _misfit(samples, learned), np.ones(len(rows), dtype=bool)
    for _ in range(OUTLIER_ROUNDS if reject_sigma is not None else 0):
        near = off <= (reject_sigma or math.inf) * np.median(off[kept]) / MEDIAN_LENGTH
        if np.array_equal(near, kept):
            break
        # Outliers bend the map so that their neighbours seem off too; without them these come back.
        kept = near
        learned = learn_from_many(samples.part(kept), photo.image_size).map
        off = _misfit(samples, learned)
    size = float(np.sqrt((off[kept] ** 2).mean()))
    origin = f"map learned from {photo.view_names[view]}: {kept.sum()} points, {size:.3f} px left of them"
    remarks = [f"{origin}; {_known_text(learned, photo.image_size)}"]
    if not kept.all():
        far = f"{(~kept).sum()} of {len(kept)} points of {photo.view_names[view]}"
        remarks.append(f"{far} left out of the map: off by more than {reject_sigma:g} robust standard deviations")
    return learned, remarks


def _misfit(samples: MapSamples, learned: LearnedMap) -> Array:
    """How far the map takes samples from their points, in units of the sensor.  # (N,)"""
    off = exact_point(learned, samples.pixel) - samples.point
    distance: Array = np.linalg.norm(off, axis=1)
    return distance


def _known_text(learned: LearnedMap, image_size: tuple[int, int]) -> str:
    """How much of the image the map is known in."""
    axes = (np.linspace(0, side - 1, COVERAGE_GRID) for side in image_size)
    pixel = np.stack(np.meshgrid(*axes), axis=-1).reshape(-1, 2)
    return f"known in {100 * known_at(learned, image_size, pixel).mean():.0f} % of the image"


def _from_all_views(observations: Observations, options: SolveOptions) -> Calibration:
    """The pinhole behind a map learned from all views."""
    start = solve(observations, DEFAULT, options)
    found = learn_from_views(start, options)
    learned = found.learned.map
    solved = solve_on_sensor(start.observations, learned, options)
    origin = f"map learned from all {start.observations.view_count} views in {found.rounds} rounds"
    remarks = [f"{origin}; {_known_text(learned, observations.image_size)}"]
    remarks += [remark for remark in start.remarks if ": left out:" in remark]
    if found.change_px >= SMALL_CHANGE_PX and solved.status == "converged":
        remarks.append(f"the map still changed by {found.change_px:.1g} px in the last round")
        solved = replace(solved, status="stopped")
    if start.status == "degenerate":
        remarks += [f"{DEFAULT}, the start: {remark}" for remark in start.remarks]
        solved = replace(solved, status="degenerate")
    return replace(solved, remarks=(*remarks, *solved.remarks))
