"""A rig and points in 3D: each camera with what it sees, and each point with the axes of its error, enlarged."""

import numpy as np

from calib.cameras import ABILITIES, rays
from calib.cameras.camera import Camera
from calib.cameras.field_of_view import spokes
from calib.cameras.parameters import slopes
from calib.cameras.rig import Rig
from calib.draw.style import round_length
from designer.base.arrays import Array
from designer.base.words import printable
from designer.page.blocks import View3d
from designer.page.scene import Cameras, Labels, Layer, Scene, Segments

CAMERA, POINT, EDGE = "#0072B2", "#D55E00", "#8a9099"
"""Okabe and Ito's blue and vermilion, and a grey, seen on light and dark."""
SHARE, AXIS_SHARE = 0.12, 0.05
"""Of the scene's size: a camera's pyramid, the usual point's longest axis."""

DOME_SPOKES, DOME_ROWS = 24, 4
"""Directions around a dome, and rows from its middle to its border."""
STEEPEST = 2.5
"""A side of the image whose light comes from farther off the axis, as a tangent, makes no pyramid."""


def scene_size_mm(rig: Rig, points_mm: Array) -> float:
    """How large a scene is: what half of it spans."""
    every = np.concatenate([rig.center_mm, points_mm])
    return max(float(np.linalg.norm(np.ptp(every, axis=0))) / 2, 1.0)


def rig_layer(rig: Rig, body_mm: float) -> Layer:
    """The cameras of a rig with what they see: a body each."""
    frames = rig.rig_from_cam
    cameras = tuple(
        Cameras(frames[row : row + 1], view_of(camera), body_mm, (CAMERA,), (printable(name),))
        for row, (name, camera) in enumerate(zip(rig.names, rig.cameras, strict=True))
    )
    return Layer("cameras", cameras)


def error_axes(points_mm: Array, covariance_mm2: Array, size_mm: float) -> tuple[Layer, float]:
    """Points drawn as the principal axes of their errors, and how much these are enlarged."""
    value, axis = np.linalg.eigh(covariance_mm2)
    sigma = np.sqrt(value.clip(min=0.0))
    usual = float(np.median(sigma[:, 2])) if len(sigma) else 0.0
    enlarged = round_length(AXIS_SHARE * size_mm / usual) if usual > 0 else 1.0
    reach = np.minimum(enlarged * sigma, 3 * AXIS_SHARE * size_mm).clip(min=1e-3 * size_mm)
    half = (axis * reach[:, None, :]).transpose(0, 2, 1)  # (N, 3, 3) a row an axis
    ends = np.stack([points_mm[:, None] - half, points_mm[:, None] + half], axis=2).reshape(-1, 2, 3)
    return Layer("points", (Segments(ends, (POINT,)),)), enlarged


def rig_and_errors(
    rig: Rig, points_mm: Array, covariance_mm2: Array, title: str, alt: str, caption: str, named: str = "expected error"
) -> View3d:
    """The cameras, and points (N, 3) as the axes of their errors, of covariances (N, 3, 3)."""
    size_mm = scene_size_mm(rig, points_mm)
    points, enlarged = error_axes(points_mm, covariance_mm2, size_mm)
    legend = (CAMERA, "camera"), (POINT, named)
    scene = looked_at(rig, (rig_layer(rig, SHARE * size_mm), points), legend)
    return View3d(title, scene, alt, f"{caption}, {enlarged:g} times enlarged. Point at a camera for its name.")


def looked_at(rig: Rig, layers: tuple[Layer, ...], legend: tuple[tuple[str, str], ...]) -> Scene:
    """The scene from behind the cameras and from above, as they have it."""
    frames = rig.rig_from_cam
    up, back = -frames[:, :3, 1].mean(axis=0), -frames[:, :3, 2].mean(axis=0)
    up = up if np.linalg.norm(up) > 0.3 else np.array([0.0, -1.0, 0.0])
    side = np.cross(up, back)
    from_direction = back + 0.6 * up + 0.7 * side if np.linalg.norm(side) > 0.3 else np.array([0.6, -0.7, -1.0])
    return Scene(layers, unit(up), unit(from_direction), legend)


def seen_from_both_sides(place_mm: Array, normal: Array, texts: tuple[str, ...], height_mm: float) -> Labels:
    """Labels (N, 3), each twice: one hides where its normal points away."""
    both = np.repeat(normal, 2, axis=0)
    both[1::2] *= -1
    return Labels(np.repeat(place_mm, 2, axis=0), both, tuple(text for text in texts for _ in range(2)), height_mm)


def unit(vector: Array) -> tuple[float, float, float]:
    """A direction as scenes have it."""
    x, y, z = (vector / np.linalg.norm(vector)).tolist()
    return round(x, 6), round(y, 6), round(z, 6)


def view_of(camera: Camera) -> Array:
    """What a camera sees as `designer.page.scene.Cameras` draws it: a pyramid, or the dome of a wide lens."""
    corners = _corner_rays(camera)
    if not ABILITIES[camera.model].is_wide:
        return corners[None]
    dome = spokes(camera, DOME_SPOKES, DOME_ROWS)
    reaches_far = np.hypot(dome[-1, :, 0], dome[-1, :, 1]) > STEEPEST * dome[-1, :, 2]
    return dome if np.isfinite(dome).all() and reaches_far.any() else corners[None]


def body_words(view: Array) -> str:
    """What is drawn for a camera."""
    return "pyramid" if len(view) == 1 else "dome"


def _corner_rays(camera: Camera) -> Array:
    """Through the image's corners, clockwise from the top left, with z = 1; without a lens where that has none."""
    width, height = camera.image_size
    corner = np.array([[0, 0], [width - 1, 0], [width - 1, height - 1], [0, height - 1]], dtype=np.float64)
    through = np.column_stack([slopes(rays(camera, corner)), np.ones(4)])
    straight = np.column_stack([(corner - camera.params[2:4]) / camera.params[:2], np.ones(4)])
    known = np.isfinite(through).all(axis=1) & (np.abs(through).max(axis=1) < 10)
    return np.where(known[:, None], through, straight)
