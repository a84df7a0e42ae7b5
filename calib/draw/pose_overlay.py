"""A picture of a pose: the target's axes as the camera sees them, and how far its centres are off, enlarged."""

from pathlib import Path
from typing import TypeAlias

import numpy as np
from numpy.typing import NDArray

from calib.cameras import project
from calib.cameras.camera import Camera
from calib.core.se3 import transform
from calib.core.types import Detections
from calib.detector.canvas import Canvas, Colour, canvas_between
from calib.detector.overlay import pale, write_overlay
from calib.detector.overlay_frame import INK, cut_text, text_strip
from calib.observe.photos import OVERLAY_MARK, why_failed
from calib.observe.target_poses import PoseResult, TargetPose
from designer.base.files import distinct_stems
from designer.target import TargetGeometry, bounding_radius_mm

Array: TypeAlias = NDArray[np.float64]

# Of Okabe and Ito's colours, "Color Universal Design" (2008), those nearest to red, green and blue.
AXES: tuple[tuple[str, Colour], ...] = (("x", (213, 94, 0)), ("y", (0, 158, 115)), ("z", (0, 114, 178)))
RESIDUAL: Colour = (190, 0, 90)
CENTRE: Colour = (40, 44, 52)
_WHITE: Colour = (255, 255, 255)
_STEPS = 40
_ENLARGEMENTS = (1, 2, 5, 10, 20, 50, 100, 200, 500, 1000, 2000, 5000)


def draw_poses(found: PoseResult, folder: Path) -> tuple[dict[str, str], tuple[str, ...]]:
    """Draw the photos that have a pose into a folder.

    What goes wrong with one does not stop the others.

    Returns:
        The pictures' names, by name of the photo; and why others have none, a line each.
    """
    poses = {pose.image: pose for pose in found.poses}
    drawn, failures = dict[str, str](), []
    stems = distinct_stems([result.photo.name for result in found.search.results])
    for result, stem in zip(found.search.results, stems, strict=True):
        name, seen = result.photo.name, result.seen
        if seen is None or name not in poses:
            continue
        try:
            picture = draw_pose(result.photo.read().pixels, seen, found.target, found.camera, poses[name])
            drawn[name] = write_overlay(folder / f"{stem}.pose{OVERLAY_MARK}", picture).name
        except Exception as error:
            failures.append(f"no overlay for {name}: {why_failed(error)}")
    return drawn, tuple(failures)


def draw_pose(
    pixels: NDArray[np.uint8] | NDArray[np.uint16],
    seen: Detections,
    target: TargetGeometry,
    camera: Camera,
    pose: TargetPose,
) -> NDArray[np.uint8]:
    """The overlay of one photo.  # (H, W) -> (H', W', 3) red, green, blue"""
    radius = max(1.0, float(np.median(seen.ellipse_px[:, 2])))
    grey, scale = pale(pixels, radius)
    width = float(np.clip(radius * scale / 10, 1.5, 12))
    half_a_ring = 0.5 * radius / max(pose.rms_px, 1e-9)
    enlargement = max((factor for factor in _ENLARGEMENTS if factor <= half_a_ring), default=1)
    above = _header(pose, enlargement, grey.shape[1])
    sheet, canvas = canvas_between(above, grey, above[:0], scale)
    predicted = project(camera, transform(pose.cam_from_target, target.center_mm[seen.ring]))
    for measured, off in zip(seen.center_px, predicted - seen.center_px, strict=True):
        _draw_residual(canvas, measured, measured + enlargement * off, width, 0.3 * radius)
    _draw_axes(canvas, target, camera, pose, width)
    return sheet


def _draw_residual(canvas: Canvas, measured: Array, end: Array, width: float, arm: float) -> None:
    """A cross at the measured centre and a line towards the predicted one."""
    for step in (np.array([arm, 0.0]), np.array([0.0, arm])):
        canvas.line(np.stack([measured - step, measured + step]), CENTRE, 0.6 * width)
    canvas.line(np.stack([measured, end]), _WHITE, 1.3 * width)
    canvas.line(np.stack([measured, end]), RESIDUAL, 0.8 * width)


def _draw_axes(canvas: Canvas, target: TargetGeometry, camera: Camera, pose: TargetPose, width: float) -> None:
    """The axes of the target's frame, bent as the lens bends them, the farthest end first."""
    length = (0.5 if target.is_planar else 1.25) * bounding_radius_mm(target)
    along = np.linspace(0, 1, _STEPS)[:, None] * length
    depth = pose.cam_from_target[2, :3]
    for axis in np.argsort(-depth).tolist():
        name, colour = AXES[axis]
        line = project(camera, transform(pose.cam_from_target, along * np.eye(3)[axis]))
        line = line[: int(np.argmax(np.append(~np.isfinite(line).all(axis=1), True)))]  # up to where the lens ends
        if len(line) < 2:
            continue
        lines = [line]
        step = line[-1] - line[-2]
        reach = float(np.linalg.norm(line[-1] - line[0]))
        if reach > 4 * width:
            forward = step / max(float(np.linalg.norm(step)), 1e-9) * min(0.12 * reach, 8 * width)
            side = np.array([-forward[1], forward[0]])
            lines.append(np.stack([line[-1] - forward + 0.45 * side, line[-1], line[-1] - forward - 0.45 * side]))
        for shade, wide in ((_WHITE, 2.2 * width), (colour, 1.3 * width)):
            for part in lines:
                canvas.line(part, shade, wide)
        outwards = step / max(float(np.linalg.norm(step)), 1e-9)
        spot = line[-1] + 9 * width / canvas.scale * outwards
        canvas.text((float(spot[0]), float(spot[1])), name, max(9 * width, canvas.pixels.shape[1] / 60), colour)


def _header(pose: TargetPose, enlargement: int, width: int) -> NDArray[np.uint8]:
    """Name and figures, in as many lines as they need."""
    x, y, z = pose.camera_mm
    texts = (
        cut_text(pose.image, 60),
        f"{pose.rings} points, RMS {pose.rms_px:.4f} px",
        f"camera at {x:.3f} {y:.3f} {z:.3f} mm",
        f"{pose.distance_mm:.3f} mm away",
        f"lines: predicted - measured, x {enlargement}",
    )
    return text_strip([(text, INK) for text in texts], width, int(np.clip(width / 70, 14, 130)))
