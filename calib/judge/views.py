"""How a target was shown in the photos, and what of it can be shown: its faces, tilts, distances and sizes."""

from collections.abc import Iterable
from dataclasses import dataclass

import numpy as np

from calib.cameras import linearise
from calib.cameras.camera import Camera
from calib.core.linear_algebra import sums_by
from calib.core.se3 import invert, transform
from calib.core.types import KnownPoints
from calib.judge.coverage import convex_hull
from calib.solver.calibration import Calibration
from calib.solver.linear_pose import FLAT
from designer.base.arrays import Array, Rows

USUAL_SHARE = 0.1
"""Of the faces in the used photos, so many were seen less completely than counts as readable."""
READABLE_PITCH_PX = 8.0
"""Rings so far apart in the image are read at all times; finer ones if the photos showed them so."""
MOST_FOR_PITCH = 400
"""Points of a face among which neighbours are looked for."""


@dataclass(frozen=True, eq=False)
class TargetShape:
    """The K points of a target that lie on its F planes."""

    position_mm: Array  # (K, 3)
    face: Rows  # (K,)
    normal: Array  # (F, 3) unit, to the side that is photographed
    middle_mm: Array  # (F, 3) of each face's points; nan without points
    corner: tuple[Rows, ...]  # per face the rows of its outermost points, in order around it
    center_mm: Array  # (3,) the middle of the points' box
    axes: Array  # (3, 3) rows: of a flat target the long side, the other side, and the normal to the camera
    aspect: float  # long side over the other
    is_flat: bool
    pitch_mm: float  # usual distance between neighbours

    @property
    def level(self) -> Array:
        """How a flat target that faces the camera is turned with its long side level.  # (3, 3)"""
        return np.stack([self.axes[0], self.axes[1], -self.axes[2]])


@dataclass(frozen=True)
class Habits:
    """How the target was shown in the photos that were used, so that the next ones can be taken alike."""

    distance_mm: tuple[float, float]  # nearest and farthest, from the camera to the target's middle
    face_share: float  # a face of which less was seen was not read
    pitch_px: float  # neighbours closer than this were not read, or nobody tried
    rings: int  # fewest in a photo
    fine_pitch_px: float = 0.0  # neighbours farther apart are seen no more surely, closer ones less; 0: all alike


def shape_of(calibration: Calibration) -> TargetShape | None:
    """The shape of a calibration's target; None if no three of its points lie on known planes."""
    points = calibration.observations.points
    position = points.position_mm[points.face >= 0]
    if len(position) < 3:
        return None
    sign = photographed_sides(points, [calibration])
    return shape_of_points(points, sign[:, None] * points.plane[:, :3])


def shape_of_points(points: KnownPoints, normal: Array) -> TargetShape:
    """The shape of three points or more on known planes, whose normals (F, 3) point to the side that is seen."""
    rows = np.flatnonzero(points.face >= 0)
    position, face = points.position_mm[rows], points.face[rows]
    center = 0.5 * (position.min(axis=0) + position.max(axis=0))
    count = np.bincount(face, minlength=len(points.plane))
    total = sums_by(face, position, len(points.plane))
    middle = np.where(count[:, None] > 0, total / np.maximum(count, 1)[:, None], np.nan)
    _, extent, spread = np.linalg.svd(position - position.mean(axis=0), full_matrices=False)
    is_flat = bool(extent[2] < FLAT * extent[0])
    towards = (normal * count[:, None]).sum(axis=0)
    axes, aspect = _axes(position, spread[2], towards)
    corner = tuple(_outermost(position, face, number, normal[number]) for number in range(len(points.plane)))
    return TargetShape(position, face, normal, middle, corner, center, axes, aspect, is_flat, _pitch_mm(position, face))


def photographed_sides(points: KnownPoints, cameras: Iterable[Calibration]) -> Array:
    """1 where a plane's normal points to where photos were taken from, or out of the target if it is in none; -1: not.

    A plane from elsewhere does not say which of its sides carries the rings.  # (F,)
    """
    plane, on_face = points.plane, points.face >= 0
    position = points.position_mm[on_face] if on_face.any() else points.position_mm
    votes, center = np.zeros(len(plane)), 0.5 * (position.min(axis=0) + position.max(axis=0))
    for one in cameras:
        seen = one.observations
        face, eye = points.face[seen.point], invert(one.cam_from_target)[:, :3, 3][seen.view]
        face, eye = face[face >= 0], eye[face >= 0]
        side = np.sign((plane[face, :3] * eye).sum(axis=1) - plane[face, 3])
        votes += np.bincount(face, side, len(plane))
    outward = np.sign(plane[:, 3] - plane[:, :3] @ center)
    return np.where(votes != 0, np.sign(votes), np.where(outward != 0, outward, 1.0))


def _axes(position: Array, normal: Array, towards: Array) -> tuple[Array, float]:
    """The long side, the other side and the normal of the smallest box around a flat target's points, as rows.

    The normal points to the camera; for a camera that sees the long side point to the right, the other one points down.
    Also how long the box is for its width.
    """
    normal = normal if normal @ towards >= 0 else -normal
    forward = -normal  # as the camera looks at a target that faces it
    start = np.eye(3)[int(np.argmin(np.abs(forward)))]
    first = start - forward * (forward @ start)
    first /= np.linalg.norm(first)
    second = np.cross(forward, first)
    flat = (position - position.mean(axis=0)) @ np.stack([first, second], axis=1)
    angle = np.linspace(0, np.pi / 2, 91)[:-1]
    along = flat @ np.stack([np.cos(angle), np.sin(angle)])
    across = flat @ np.stack([-np.sin(angle), np.cos(angle)])
    width, height = np.ptp(along, axis=0), np.ptp(across, axis=0)
    best = int(np.argmin(width * height))
    turn = float(angle[best])
    right = np.cos(turn) * first + np.sin(turn) * second
    down = np.cross(forward, right)
    if height[best] > width[best]:
        right, down = down, -right
    longer, shorter = max(width[best], height[best]), min(width[best], height[best])
    return np.stack([right, down, normal]), float(longer / max(shorter, 1e-9))


def _outermost(position: Array, face: Rows, number: int, normal: Array) -> Rows:
    """Rows of a face's points on its convex hull, in order around it; all rows of fewer than three points."""
    rows = np.flatnonzero(face == number)
    if len(rows) < 3:
        return rows
    flat = position[rows] @ in_plane(normal).T
    return rows[convex_hull(flat - flat.mean(axis=0))]


def in_plane(normal: Array) -> Array:
    """Two directions across a unit normal and each other, as rows: right-handed with it.  # (2, 3)"""
    first = np.cross(normal, np.eye(3)[int(np.argmin(np.abs(normal)))])
    first /= np.linalg.norm(first)
    return np.stack([first, np.cross(normal, first)])


def _pitch_mm(position: Array, face: Rows) -> float:
    """The median distance from a point to its nearest neighbour on the same face."""
    nearest = []
    for number in np.unique(face).tolist():
        mine = position[face == number][:MOST_FOR_PITCH]
        if len(mine) > 1:
            square = ((mine.T[:, :, None] - mine.T[:, None]) ** 2).sum(axis=0)
            np.fill_diagonal(square, np.inf)
            nearest.append(np.sqrt(square.min(axis=1)))
    return float(np.median(np.concatenate(nearest))) if nearest else 0.0


def habits_of(calibration: Calibration, shape: TargetShape) -> Habits:
    """What the photos show to be possible: distances, how much of a face must be seen, how fine rings may be."""
    seen, points = calibration.observations, calibration.observations.points
    faces = len(points.plane)
    pose = calibration.cam_from_target
    distance = np.linalg.norm(transform(pose, shape.center_mm), axis=1)
    face = points.face[seen.point]
    met, number = np.unique((seen.view * faces + face)[face >= 0], return_counts=True)
    view, met_face = met // faces, met % faces
    share = number / np.bincount(shape.face, minlength=faces)[met_face]
    place = transform(pose[view], shape.middle_mm[met_face])
    normal = (pose[view, :3, :3] @ shape.normal[met_face][:, :, None])[:, :, 0]
    pitch = pitch_px(calibration.camera, shape, place, normal)
    per_view = np.bincount(seen.view, minlength=seen.view_count)
    return Habits(
        (float(distance.min()), float(distance.max())),
        float(np.quantile(share, USUAL_SHARE)),
        min(READABLE_PITCH_PX, float(np.quantile(pitch, USUAL_SHARE))),
        int(per_view[per_view > 0].min()),
    )


def px_per_mm(camera: Camera, place: Array) -> Array:
    """How large a millimetre across the line of sight is shown at places (..., 3), the way it is least; nan unseen.

    The smaller singular value of a pixel's derivative by the place, f/z of a pinhole anywhere.
    """
    flat = np.ascontiguousarray(place.reshape(-1, 3).T)
    by_place = linearise(camera, flat).by_point.transpose(2, 0, 1)  # (N, 2, 3)
    square = by_place @ by_place.transpose(0, 2, 1)
    trace, apart = square[:, 0, 0] + square[:, 1, 1], square[:, 0, 0] - square[:, 1, 1]
    least = 0.5 * (trace - np.hypot(apart, 2 * square[:, 0, 1]))
    return np.sqrt(np.maximum(least, 0.0)).reshape(place.shape[:-1])


def pitch_px(camera: Camera, shape: TargetShape, place: Array, normal: Array) -> Array:
    """Distances in the image of neighbours on faces, the way they are foreshortened.

    Args:
        camera: that shows them.
        shape: with the distance on the face.
        place: of faces in the camera frame (..., 3).
        normal: of the faces in the camera frame (..., 3).
    """
    shown: Array = shape.pitch_mm * px_per_mm(camera, place) * facing(place, normal)
    return shown


def facing(place: Array, normal: Array) -> Array:
    """Cosines of the angles between normals and the directions from places (..., 3) to the camera."""
    cosine: Array = -(place * normal).sum(axis=-1) / np.linalg.norm(place, axis=-1)
    return cosine


@dataclass(frozen=True, eq=False)
class ViewFacts:
    """Facts of V views; nan where a view tells none."""

    name: tuple[str, ...]  # (V,)
    rings: Rows  # (V,) sightings that count
    left_out: Rows  # (V,) sightings left out as outliers
    tilt_deg: Array  # (V, 3) of the seen faces against the image plane: least, median by rings, largest
    distance_mm: Array  # (V,) from the camera to the target's middle
    place_px: Array  # (V, 2) mean of the sightings
    size: Array  # (V,) of the sightings' box: of the image's width or height, whichever it fills more of
    rms_px: Array  # (V,) root mean square length of the residuals that count
    is_flat: bool  # all rings in one plane, so that the three tilts are one

    @property
    def distance_ratio(self) -> float:
        """The largest distance over the least."""
        return float(self.distance_mm.max() / self.distance_mm.min())

    @property
    def largest_tilt_deg(self) -> float:
        """The largest tilt of all faces in all views; nan without planes."""
        known = self.tilt_deg[np.isfinite(self.tilt_deg[:, 2]), 2]
        return float(known.max()) if len(known) else float("nan")

    def tilted_by(self, least_deg: float) -> int:
        """How many views show a face tilted by so much or more."""
        return int((self.tilt_deg[:, 2] >= least_deg).sum())


def view_facts(calibration: Calibration) -> ViewFacts:
    """The facts of all views of a calibration."""
    seen, counted = calibration.observations, ~calibration.is_outlier
    views = seen.view_count
    shape = shape_of(calibration)
    middle = seen.points.middle_mm if shape is None else shape.center_mm
    view, pixel = seen.view[counted], seen.center_px[counted]
    rings = np.bincount(view, minlength=views)
    low, high = np.full((views, 2), np.inf), np.full((views, 2), -np.inf)
    np.minimum.at(low, view, pixel)
    np.maximum.at(high, view, pixel)
    square = (calibration.residual_px[counted] ** 2).sum(axis=1)
    some = np.where(rings > 0, rings, np.nan)
    return ViewFacts(
        seen.view_names,
        rings,
        np.bincount(seen.view[~counted], minlength=views),
        _tilts_deg(calibration, shape),
        np.linalg.norm(transform(calibration.cam_from_target, middle), axis=1),
        sums_by(view, pixel, views) / some[:, None],
        np.where(rings > 0, ((high - low) / seen.image_size).max(axis=1), np.nan),
        np.sqrt(np.bincount(view, square, views) / some),
        shape is not None and shape.is_flat,
    )


def _tilts_deg(calibration: Calibration, shape: TargetShape | None) -> Array:
    """Angles (V, 3) between the normals of the faces that were seen and the optical axis: least, median, largest."""
    seen, counted = calibration.observations, ~calibration.is_outlier
    result = np.full((seen.view_count, 3), np.nan)
    if shape is None:
        return result
    face = seen.points.face[seen.point]
    counted = counted & (face >= 0)
    cosine = -(calibration.cam_from_target[:, None, 2, :3] * shape.normal).sum(axis=-1)  # (V, F)
    tilt = np.degrees(np.arccos(np.clip(cosine, -1.0, 1.0)))[seen.view[counted], face[counted]]
    view = seen.view[counted]
    for one in np.unique(view).tolist():
        mine = tilt[view == one]
        result[one] = mine.min(), np.median(mine), mine.max()
    return result
