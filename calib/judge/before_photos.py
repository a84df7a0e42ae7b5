"""What is known of a camera before any photo: `calibration_before(camera, points, 0.05)`.

It is told as a calibration from no photos, so that what chooses photos after photos chooses the first ones, too.
"""

import math
from dataclasses import replace

import numpy as np

from calib.cameras import COMMON, WIDE, fitted_models, project
from calib.cameras.camera import Camera
from calib.cameras.refit import refit
from calib.cameras.surface import surface_model
from calib.core.se3 import make_pose, transform
from calib.core.types import KnownPoints, Observations
from calib.judge.information import LENS_UNSURE
from calib.judge.lit_part import lit_part
from calib.judge.views import READABLE_PITCH_PX, Habits, TargetShape
from calib.solver.calibration import Calibration
from designer.base.arrays import Array
from designer.base.number_text import figure
from designer.target import TargetGeometry

FOCAL_UNSURE = 0.3
CENTRE_UNSURE = 0.05
"""Of the focal length, and of the image's longer side: what a person knows of a camera beforehand."""
FACE_SHARE = 0.5
FEWEST_RINGS = 12
FINE_PITCH_PX = 24.0
"""Between rings of 8 px radius or so."""
FILLS = (0.3, 0.9)
"""Of the image's width or height, in the direction that the target fills more of: farthest and nearest."""
SIZING_STEPS = 12


def planned_camera(camera: Camera, goal_px: float) -> tuple[Camera, str]:
    """The camera in a model that few photos determine, and what is to be said of the lens."""
    if camera.model in fitted_models():
        return camera, "the lens is taken to be one that its model follows, and photos to be sharp; calib run tells"
    surface = surface_model(camera.model)
    plain = {COMMON, WIDE} if surface is None else {COMMON, WIDE, surface.base.name}
    found = min((refit(camera, model) for model in sorted(plain)), key=lambda one: one.max_px)
    near, model = figure(found.max_px, 2), found.camera.model
    said = f"planned for a camera of the model {model}, from which this one, {camera.model}, differs by up to {near} px"
    if found.max_px > goal_px:
        said += ", more than is wanted: what is promised is of that model, not of this camera"
    return found.camera, said


def front_of(target: TargetGeometry, points: KnownPoints) -> KnownPoints:
    """The points of what is photographed: of a board with two sides those of the front; the others lie on no face."""
    if not target.is_plate or target.is_planar:
        return points
    return replace(points, face=np.where(points.face == 0, 0, -1))


def calibration_before(camera: Camera, points: KnownPoints, noise_px: float) -> Calibration:
    """A calibration from no photos: the camera as a person takes it to be.

    Args:
        camera: about as it is.
        points: of the target.
        noise_px: standard deviation of a coordinate of an observation to come.
    """
    none = np.zeros(0, dtype=np.int64)
    deviation = np.full(len(camera.params), LENS_UNSURE)
    deviation[:2] = FOCAL_UNSURE * camera.params[:2]
    deviation[2:4] = CENTRE_UNSURE * max(camera.image_size)
    return Calibration(
        camera, Observations(camera.image_size, (), none, none, np.zeros((0, 2)), None, points), np.zeros((0, 4, 4)),
        np.zeros((0, 2)), np.zeros(0, dtype=np.bool_), noise_px, np.diag(deviation**2), np.zeros((0, 6, 6)), (),
        weighted=False, status="converged", remarks=(), iterations=0, seconds=0.0,
    )  # fmt: skip


def usual_hold(before: Calibration, shape: TargetShape, distance_mm: tuple[float, float] | None = None) -> Habits:
    """How a target may be held: so that it fills a good part of the lit image, or between two distances.

    Args:
        before: of `calibration_before`.
        shape: of the target.
        distance_mm: nearest and farthest; None: by what it fills.
    """
    first, last = lit_part(before).box_px
    size_px = last - first + 1
    fills = (_distance_mm(before.camera, shape, fill, size_px) for fill in FILLS[::-1])
    near, far = fills if distance_mm is None else distance_mm
    return Habits((near, far), FACE_SHARE, READABLE_PITCH_PX, FEWEST_RINGS, FINE_PITCH_PX)


def _distance_mm(camera: Camera, shape: TargetShape, fill: float, size_px: Array) -> float:
    """From where a target that faces the camera fills so much of the image."""
    turn = np.stack([shape.axes[0], shape.axes[1], -shape.axes[2]]) if shape.is_flat else np.eye(3)
    extent = float(np.ptp(shape.position_mm, axis=0).max())
    near, far = 0.6 * extent, 1000.0 * extent
    for _ in range(SIZING_STEPS):
        middle = math.sqrt(near * far)
        pose = make_pose(turn, np.array([0.0, 0.0, middle]) - turn @ shape.center_mm)
        pixel = project(camera, transform(pose, shape.position_mm))
        is_all = bool(np.isfinite(pixel).all())
        if is_all and float((np.ptp(pixel, axis=0) / size_px).max()) < fill:
            far = middle
        else:
            near = middle
    return far
