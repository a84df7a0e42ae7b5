"""A picture of what was found in a photo, and what was not: for a person to see at a glance.

The photo is shown pale, larger if it is small. Each named ring has its outer contour in its face's colour and a cross
at its centre whose colour is the centre's standard deviation. Features of a seen face that were not found are dashed.
"""

from dataclasses import dataclass, replace
from pathlib import Path

import cv2
import numpy as np
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from calib.core.types import Detections
from calib.detector.canvas import Box, Canvas, Colour, Point, canvas_between
from calib.detector.overlay_frame import MISSING, REJECTED, face_colours, frame, sigma_colour
from calib.detector.where_expected import ImagedFace, imaged_face
from designer.base.arrays import Array
from designer.base.errors import InputError
from designer.base.files import write_files
from designer.target import TargetGeometry

MAX_JPEG_SIDE_PX = 65_500
"""Longer strips are written as PNG; of others that would be larger than the photo, and take ten times as long."""
_JPEG_QUALITY = 90

_PALE = (70, 235)
"""Grey levels that the photo's black and white become, so that the marks stand out."""
_READABLE_RADIUS_PX = 22.0
_READABLE_SIDE_PX = 1000
_MAX_ENLARGED_PIXELS = 9_000_000
_MAX_SIDE_PX = 64_000
"""Of an enlarged picture, which header and legend make higher."""
_MIN_TEXT_PX = 9.0
_AXES_START = (-0.5, -0.5)
"""Lattice index where the axes begin: in the gap before the feature (0, 0)."""
_AXES_LENGTH = 2.0
_AXES: Colour = (20, 20, 20)
_WHITE: Colour = (255, 255, 255)
_NEARLY_ALL = 0.9
_LABELLED_SHARE = 0.6
"""If fewer features of a face have room for their indices, only its corners get them."""


@dataclass(frozen=True)
class _Pen:
    """Sizes on the canvas, px."""

    width: float
    arrow: float
    text: float


@dataclass(frozen=True)
class _Label:
    """A text with a place, and the cells it takes."""

    middle: Point
    text: str
    box: Box


def draw_overlay(
    pixels: NDArray[np.uint8] | NDArray[np.uint16], seen: Detections, target: TargetGeometry
) -> NDArray[np.uint8]:
    """The overlay of one photo.  # (H, W) -> (H', W', 3) red, green, blue"""
    radii = seen.ellipse_px[:, 2][np.isfinite(seen.ellipse_px[:, 2])]
    radius = max(1.0, float(np.median(radii)) if len(radii) else min(pixels.shape) / 40)
    grey, scale = pale(pixels, radius)
    above, below = frame(seen, target, grey.shape[1])
    sheet, canvas = canvas_between(above, grey, below, scale)
    minor = seen.ellipse_px[:, 3][np.isfinite(seen.ellipse_px[:, 3])]
    pen = _Pen(
        width=float(np.clip(radius * canvas.scale / 11, 1.4, 12)),
        arrow=float(np.clip(np.median(minor) * canvas.scale / 10 if len(minor) else 1.4, 1.4, 10)),
        text=float(np.clip(radius * canvas.scale / 1.9, _MIN_TEXT_PX, 60)),
    )
    faces = [imaged_face(seen, target, int(face)) for face in np.unique(target.ring_face[seen.ring])]
    colours = face_colours(target)
    for ellipse in (seen.ellipse_px, *(face.missing_ellipse_px for face in faces)):
        canvas.take(_grown(ellipse, 1.12))  # text must not cover a ring
    for face in faces if not target.is_planar else ():  # large and transparent, behind all marks
        if np.isfinite(face.size_px):
            height_px = 0.55 * face.size_px * canvas.scale
            canvas.text(_point(face.middle_px), str(face.face), height_px, colours[face.face], opacity=0.38)
    for face in faces:
        _draw_features(canvas, face, seen, target, colours[face.face], pen)
    rejected = np.zeros((0, 2)) if seen.rejected_px is None else seen.rejected_px
    for point, reach in zip(rejected, np.minimum(0.75 * radius, 0.3 * _nearest_px(rejected)), strict=True):
        _draw_rejected(canvas, point, float(reach), pen)
    for face in faces:
        _draw_axes(canvas, face, target, pen)
    for face in faces:
        _draw_labels(canvas, face, target, colours[face.face], pen)
    return sheet


def write_overlay(stem: Path, overlay: NDArray[np.uint8]) -> Path:
    """Write STEM.jpg, its colours as fine as its lightness; or STEM.png if it is longer than a JPEG can be.

    Raises:
        InputError: it cannot be encoded or written.
    """
    suffix, options = ".png", [cv2.IMWRITE_PNG_COMPRESSION, 1]
    if max(overlay.shape) <= MAX_JPEG_SIDE_PX:
        fine = [cv2.IMWRITE_JPEG_SAMPLING_FACTOR, cv2.IMWRITE_JPEG_SAMPLING_FACTOR_444]
        suffix, options = ".jpg", [cv2.IMWRITE_JPEG_QUALITY, _JPEG_QUALITY, *fine]
    done, data = cv2.imencode(suffix, cv2.cvtColor(overlay, cv2.COLOR_RGB2BGR), options)
    if not done:
        raise InputError(f"{overlay.shape[1]} x {overlay.shape[0]} px are more than an image file holds")
    path = stem.with_name(stem.name + suffix)
    write_files({path: data.tobytes()})
    return path


def pale(pixels: NDArray[np.uint8] | NDArray[np.uint16], radius: float) -> tuple[NDArray[np.uint8], float]:
    """The photo in pale grey, enlarged by a whole number if its rings are small, and that number."""
    sample = pixels[:: max(1, pixels.shape[0] // 500), :: max(1, pixels.shape[1] // 500)]
    low, high = np.percentile(sample, [0.5, 99.5])
    gain = (_PALE[1] - _PALE[0]) / max(float(high - low), 1.0)
    levels = np.arange(np.iinfo(pixels.dtype).max + 1, dtype=np.float64)
    shade = np.clip(_PALE[0] + gain * (levels - float(low)), _PALE[0] - 30, _PALE[1]).astype(np.uint8)
    grey = np.asarray(cv2.LUT(pixels, shade) if pixels.dtype == np.uint8 else shade[pixels], np.uint8)
    largest = max(1.0, min(np.sqrt(_MAX_ENLARGED_PIXELS / pixels.size), _MAX_SIDE_PX / max(pixels.shape)))
    wanted = max(_READABLE_RADIUS_PX / radius, _READABLE_SIDE_PX / max(pixels.shape))
    scale = int(np.clip(np.ceil(wanted), 1, min(4, largest)))
    if scale > 1:
        enlarged = cv2.resize(grey, None, fx=scale, fy=scale, interpolation=cv2.INTER_CUBIC)
        grey = np.minimum(enlarged, _PALE[1]).astype(np.uint8)
    return grey, float(scale)


def _grown(ellipse: Array, factor: float) -> Array:
    grown: Array = ellipse * np.array([1.0, 1.0, factor, factor, 1.0])
    return grown


def _draw_features(
    canvas: Canvas, face: ImagedFace, seen: Detections, target: TargetGeometry, colour: Colour, pen: _Pen
) -> None:
    """Contours and centres of what was found, dashes for what was expected."""
    ring, ellipse = seen.ring[face.rows], seen.ellipse_px[face.rows]
    is_dot, is_corner = target.is_dot[ring], target.radius_outer_mm[ring] == 0
    canvas.ellipse(ellipse[~is_corner], colour, pen.width)
    if target.marks is None:
        canvas.ellipse(_grown(ellipse[is_dot], 0.68), _WHITE, 0.8 * pen.width)
    arm = np.where(is_corner, 0.8, 0.3)[:, None, None] * ellipse[:, 3, None, None] * np.eye(2)  # along u, along v
    center = seen.center_px[face.rows, None]
    crosses = np.stack([center - arm, center + arm], axis=2)  # (N, 2 lines, 2 ends, 2)
    canvas.line(crosses[is_dot].reshape(-1, 2, 2), _WHITE, pen.width + 2)
    sigma = np.sqrt(np.linalg.eigvalsh(seen.cov_px2[face.rows])[:, 1])
    colours = [sigma_colour(one) for one in sigma.tolist()]
    for shade in dict.fromkeys(colours):
        mine = crosses[[one == shade for one in colours]]
        canvas.line(mine.reshape(-1, 2, 2), shade, pen.width)
    canvas.ellipse(face.missing_ellipse_px, MISSING, pen.width, dashes=9)


def _nearest_px(points: Array) -> Array:
    """Distance of each point to its nearest other one; infinite for a lone one.  # (K, 2) -> (K,)"""
    places = np.nan_to_num(points, nan=0, posinf=1e9, neginf=-1e9)  # absurd ones are drawn nowhere
    nearest: Array = cKDTree(places).query(places, k=2)[0][:, 1]
    return nearest


def _draw_rejected(canvas: Canvas, point: Array, reach: float, pen: _Pen) -> None:
    """A slanting cross over what looked like a ring and got no name."""
    width = min(1.4 * pen.width, max(1.0, 0.3 * reach * canvas.scale))
    for step in (np.array([1.0, 1.0]), np.array([1.0, -1.0])):
        ends = np.stack([point - reach * step, point + reach * step])
        canvas.line(ends, _WHITE, 1.8 * width)
        canvas.line(ends, REJECTED, width)
        canvas.take_line(ends, 2 * width)


def _draw_axes(canvas: Canvas, face: ImagedFace, target: TargetGeometry, pen: _Pen) -> None:
    """Arrows along i and j beside the feature (0, 0), in the gaps, so that they cover no ring."""
    start = face.at_index(target, *_AXES_START)
    for name, (i, j) in (("i", (_AXES_LENGTH, 0.0)), ("j", (0.0, _AXES_LENGTH))):
        end = face.at_index(target, _AXES_START[0] + i, _AXES_START[1] + j)
        if start is None or end is None:
            continue
        along = end - start
        side = np.array([-along[1], along[0]])
        head = np.stack([end - 0.13 * along + 0.06 * side, end, end - 0.13 * along - 0.06 * side])
        for shade, width in ((_WHITE, 2.2 * pen.arrow), (_AXES, pen.arrow)):
            canvas.line(np.stack([start, end]), shade, width)
            canvas.line(head, shade, width)
        canvas.take_line(np.stack([start, end + 0.2 * along]), 4 * pen.arrow)
        canvas.text(_point(end + 0.11 * along), name, 1.3 * pen.text, _AXES)


def _draw_labels(canvas: Canvas, face: ImagedFace, target: TargetGeometry, colour: Colour, pen: _Pen) -> None:
    """The indices of all features where there is room, else of the corners."""
    dark = tuple(round(0.55 * level) for level in colour)
    ink: Colour = (dark[0], dark[1], dark[2])
    for height in (pen.text, max(_MIN_TEXT_PX, 0.75 * pen.text)):
        labels = _labels_in_gaps(canvas, face, target, height)
        if len(labels) >= _LABELLED_SHARE * len(face.ring):
            break
    else:
        height = 1.25 * pen.text
        labels = _labels_of_corners(canvas, face, target, height)
    for label in labels:
        canvas.take_box(label.box)
        canvas.text(label.middle, label.text, height, ink)


def _labels_in_gaps(canvas: Canvas, face: ImagedFace, target: TargetGeometry, height: float) -> list[_Label]:
    """The features' indices, all on the same side: below and to the right, unless another has room for many more."""
    texts = [_index_text(target, ring) for ring in face.ring.tolist()]
    gaps = face.gaps_px(target)
    order = np.argsort(-(gaps - face.center_px).mean(axis=1) @ np.array([0.35, 1.0]), kind="stable")
    trials: list[list[_Label]] = []
    for k in order:
        trials.append(_free_labels(canvas, gaps[k], texts, height))
        if len(trials[-1]) >= _NEARLY_ALL * len(texts):
            break
    most = max(map(len, trials))
    return next(labels for labels in trials if len(labels) >= _NEARLY_ALL * most)


def _free_labels(canvas: Canvas, spots: Array, texts: list[str], height: float) -> list[_Label]:
    """The texts that have room at their spots.  # (N, 2)"""
    trial = replace(canvas, taken=canvas.taken.copy())
    labels = []
    for spot, text in zip(map(_point, spots), texts, strict=True):
        box = trial.free_box(spot, text, height)
        if box is not None:
            trial.take_box(box)
            labels.append(_Label(spot, text, box))
    return labels


def _labels_of_corners(canvas: Canvas, face: ImagedFace, target: TargetGeometry, height: float) -> list[_Label]:
    """The indices of the corner features, on the side that is away from the face's middle."""
    labels = []
    middle = face.center_px.mean(axis=0)
    for row in face.corner_rows(target):
        text, ellipse = _index_text(target, int(face.ring[row])), face.ellipse_px[row]
        far = ellipse[:2] + 100 * (ellipse[:2] - middle)
        spot = _point(_beside(ellipse, far, canvas.size(text, height)))
        box = canvas.free_box(spot, text, height)
        if box is not None:
            labels.append(_Label(spot, text, box))
    return labels


def _beside(ellipse: Array, towards: Array, size_px: Point) -> Array:
    """A place for a text on the way to another place, as near to the ellipse as the text's size lets it be.

    A line at right angles to the way parts the two; the distance is the sum of their support functions.  # (2,)
    """
    way = towards - ellipse[:2]
    length = float(np.linalg.norm(way))
    if not length > 0:
        return towards
    direction = way / length
    cosine, sine = np.cos(ellipse[4]), np.sin(ellipse[4])
    along, across = direction[0] * cosine + direction[1] * sine, direction[1] * cosine - direction[0] * sine
    reach = 1.4 * float(np.hypot(along * ellipse[2], across * ellipse[3]))
    text = 0.5 * float(np.abs(direction) @ np.array(size_px))
    place: Array = ellipse[:2] + min(length, reach + text) * direction
    return place


def _index_text(target: TargetGeometry, ring: int) -> str:
    return f"{target.ring_index[ring, 0]},{target.ring_index[ring, 1]}"


def _point(place: Array) -> Point:
    return float(place[0]), float(place[1])
