"""Centres of circles: what blob and circle-grid detectors give is the centre of a circle's image.

    calibration = with_circles(observations, solve)  # of known diameters: taken to the images of the circles' centres
    calibration = with_circle_doubt(calibration)  # with what the camera may be off by circles that nobody spoke of

The centre of a tilted circle's image lies beside the image of the circle's centre, the more so the larger and the more
tilted the circle is (Heikkila 2000, Geometric camera calibration using circular control points, PAMI 22). It is the
centroid of the image's area, also that of a moment-based detector, which is integrated along the rim through the lens:

    A = 1/2 int x y' - y x',   centroid = 1/(3 A) int (x, y) (x y' - y x').

The shift depends on the camera so little that it is taken from the last solution, until it does not change.
"""

import math
from collections.abc import Callable, Sequence
from dataclasses import replace
from typing import TypeVar

import numpy as np

from calib.cameras import project
from calib.cameras.camera import Camera
from calib.core.types import Observations
from calib.solver.calibration import Calibration, CircleDoubt, without_surface
from calib.solver.free_shape import ExtraParameters, extra_parameters
from designer.base.arrays import Array, Rows
from designer.base.errors import InputError

T = TypeVar("T")

ROUNDS, SETTLED_PX = 10, 1e-4
"""Of solving with the shifts of the last camera, until none changes by more."""
ON_RIM = 16
"""Points of a rim; their derivatives along it are those of the trigonometric polynomial through them."""
USUAL = 0.6
"""Of the distance of neighbours: a diameter whose square is the standard deviation of that of circles nobody spoke of;
those of printed grids are about half as wide as they are apart."""


def with_circles(observations: Observations, solve: Callable[[Observations], Calibration]) -> Calibration:
    """Solve from the images of points; where centres of circles were measured, they are taken to those first.

    What comes out has the points' images as its observations.

    Raises:
        InputError: circles on no known plane, and as `solve` does.
    """
    found, said = through_circles((observations,), lambda seen: solve(*seen), lambda solved: (solved,))
    return replace(found, remarks=(*found.remarks, *said)) if said else found


def through_circles(
    seen: Sequence[Observations],
    solve: Callable[[Sequence[Observations]], T],
    cameras: Callable[[T], Sequence[Calibration]],
) -> tuple[T, tuple[str, ...]]:
    """The same of several cameras that are solved together, and a word on what was done.

    Args:
        seen: by each camera, of the same points.
        solve: from the images of points.
        cameras: of what comes out, each with the views that were solved.
    """
    points = seen[0].points
    if points.circle_mm is None or not (points.circle_mm > 0).any():
        return solve(seen), ()
    circle_mm = np.nan_to_num(points.circle_mm)
    if (points.face[circle_mm > 0] < 0).any():
        raise InputError(
            "centres of circles need the planes that the circles lie in, and some points are on none; give the points "
            "a column face, or the target a column plane"
        )
    rest = replace(points, circle_mm=np.where(points.circle_mm > 0, 0.0, points.circle_mm))
    plain = [replace(one, points=rest) for one in seen]
    found, last = solve(plain), [np.zeros_like(one.center_px) for one in seen]
    for _ in range(ROUNDS):
        shift = [_shift_of_rows(*pair, circle_mm) for pair in zip(seen, cameras(found), strict=True)]
        if all((np.abs(new - old) <= SETTLED_PX).all() for new, old in zip(shift, last, strict=True)):
            break
        moved = [replace(one, center_px=one.center_px - by) for one, by in zip(plain, shift, strict=True)]
        found, last = solve(moved), shift
    sizes = sorted({f"{size:.6g}" for size in circle_mm[circle_mm > 0].tolist()}, key=float)
    most_px = max(float(np.hypot(*one.T).max(initial=0.0)) for one in last)
    return found, (
        f"centres of circles of {' to '.join(dict.fromkeys((sizes[0], sizes[-1])))} mm were taken to the images of the "
        f"circles' centres, by up to {most_px:.2g} px",
    )


def _shift_of_rows(observations: Observations, found: Calibration, circle_mm: Array) -> Array:
    """The shifts (M, 2) by a calibration of circles of K points; zero in views that it left out."""
    number = {name: view for view, name in enumerate(found.observations.view_names)}
    is_kept = np.array([name in number for name in observations.view_names])[observations.view]
    shift = np.zeros_like(observations.center_px)
    shift[is_kept] = circle_shift_px(found, circle_mm[found.observations.point])
    return shift


def with_circle_doubt(calibration: Calibration) -> Calibration:
    """The calibration with what its parameters may be off if points of which nobody spoke are centres of circles.

    The square of their diameter, in units of a usual one, is standard normal beforehand, and told by the residuals
    (`calib.solver.free_shape`). The mean square of what is then known of it, times what the parameters are off
    for a unit, is added: little where the photos show points, the error itself where they show circles.
    """
    unit_mm = unsaid_mm(calibration.observations)
    if unit_mm is None:
        return calibration
    found = extra_parameters(without_surface(calibration), circle_shift_px(calibration, unit_mm)[:, :, None])
    if found is None:
        return calibration
    return replace(calibration, circle_doubt=doubt_of(found, float(unit_mm.max()), len(calibration.camera.params)))


def unsaid_mm(seen: Observations) -> Array | None:
    """A usual diameter of each observation of which nobody said what it is, 0 of others; None: no such.  # (M,)"""
    if seen.points.circle_mm is None:
        return None
    unsaid = np.isnan(seen.points.circle_mm[seen.point])
    spacing_mm = _spacing_mm(seen, seen.point[unsaid]) if unsaid.any() else 0.0
    return np.where(unsaid, USUAL * spacing_mm, 0.0) if spacing_mm > 0 else None


def doubt_of(found: ExtraParameters, unit_mm: float, size: int) -> CircleDoubt:
    """What the first of `size` parameters may be off, by the square of a diameter in units of one.

    Args:
        found: of that square.
        unit_mm: the diameter.
        size: rows of the covariance; the parameters that `found` tells of are the first.
    """
    estimate, variance = _estimated(found)
    square = 1.0 if math.isinf(variance) else (estimate / (1 + variance)) ** 2 + variance / (1 + variance)
    covariance = np.zeros((size, size))
    covariance[: len(found.taken), : len(found.taken)] = square * found.taken @ found.taken.T
    diameter_mm = unit_mm * math.sqrt(max(estimate, 0.0))
    return CircleDoubt(diameter_mm, estimate / math.sqrt(variance), unit_mm / USUAL, covariance)


def _estimated(found: ExtraParameters) -> tuple[float, float]:
    """One parameter and its variance, by noise or by the scatter of photos, with the parameter itself free."""
    whole = float(found.information[0, 0])
    if not whole > 0:
        return 0.0, math.inf
    estimate, part = float(found.amplitude[0]), found.block[:, 0, 0]
    score = found.block[:, 0, -1] - part * estimate
    by_photos = float((score**2).sum()) / max(float((part - part**2 / whole).sum()), 1e-300)
    return estimate, max(found.beside([0]).variance, by_photos) / whole


def _spacing_mm(seen: Observations, point: Rows) -> float:
    """The usual distance of neighbours among points on known planes; 0 if there are none."""
    from scipy.spatial import cKDTree

    used = np.unique(point[seen.points.face[point] >= 0])
    if len(used) < 2:
        return 0.0
    place = seen.points.position_mm[used]
    return float(np.median(cKDTree(place).query(place, k=2)[0][:, 1]))


def circle_shift_px(calibration: Calibration, diameter_mm: Array) -> Array:
    """By what the centre of a circle's image lies beside the image of its centre, of each observation.  # (M, 2)

    Zero where the model shows no whole circle, and for points on no known plane.

    Args:
        calibration: camera, poses and points.
        diameter_mm: of the circle about the point of each observation (M,).
    """
    seen = calibration.observations
    points, pose = seen.points, calibration.cam_from_target[seen.view]
    row = np.flatnonzero((diameter_mm > 0) & (points.face[seen.point] >= 0))
    shift = np.zeros_like(seen.center_px)
    if not len(row):
        return shift
    point, pose = seen.point[row], pose[row]
    normal = points.plane[points.face[point], :3]
    first = np.cross(normal, np.eye(3)[np.argmin(np.abs(normal), axis=1)])
    first /= np.linalg.norm(first, axis=1, keepdims=True)
    axes = np.stack([first, np.cross(normal, first)], axis=1) @ pose[:, :3, :3].transpose(0, 2, 1)  # (N, 2, 3)
    center = (pose[:, :3, :3] @ points.position_mm[point][:, :, None])[:, :, 0] + pose[:, :3, 3]
    shift[row] = _centroid_shift_px(calibration.camera, center, 0.5 * diameter_mm[row, None, None] * axes)
    return shift


def _centroid_shift_px(camera: Camera, center_mm: Array, axes_mm: Array) -> Array:
    """The same of circles about places (N, 3) in the camera's frame, with two radii (N, 2, 3).  # (N, 2)"""
    angle = 2 * np.pi / ON_RIM * np.arange(ON_RIM)
    rim = center_mm[:, None] + np.column_stack([np.cos(angle), np.sin(angle)]) @ axes_mm
    off = project(camera, rim) - project(camera, center_mm)[:, None]  # (N, R, 2)
    apart = np.subtract.outer(np.arange(ON_RIM), np.arange(ON_RIM))
    with np.errstate(divide="ignore"):
        along = np.where(apart == 0, 0.0, 0.5 * (-1.0) ** apart / np.tan(np.pi / ON_RIM * apart))
    step = along @ off
    area = off[:, :, 0] * step[:, :, 1] - off[:, :, 1] * step[:, :, 0]
    with np.errstate(divide="ignore", invalid="ignore"):
        shift: Array = 2 / 3 * (off * area[:, :, None]).sum(axis=1) / area.sum(axis=1)[:, None]
    return np.where(np.isfinite(shift).all(axis=1, keepdims=True), shift, 0.0)
