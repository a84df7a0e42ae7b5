"""A rig and points in 3D: each camera with what it sees, and each point with the axes of its error, enlarged.

Errors in space: on planes through a volume, and by distance.
"""

from typing import TYPE_CHECKING

import numpy as np

from calib.cameras import ABILITIES, rays
from calib.cameras.camera import Camera
from calib.cameras.field_of_view import spokes
from calib.cameras.parameters import slopes
from calib.cameras.rig import Rig
from calib.draw.fields import draw_map
from calib.draw.style import BLUE, GREY, INK, VERMILION, AxesDrawing, nothing, open_axes, round_length
from calib.space.budget_views import DepthCurve, ErrorSlice
from designer.base.arrays import Array
from designer.base.words import figure as digits
from designer.base.words import printable
from designer.page.blocks import View3d
from designer.page.scene import Cameras, Labels, Layer, Scene, Segments

if TYPE_CHECKING:
    from matplotlib.axes import Axes

CAMERA, POINT = "#0072B2", "#D55E00"
"""Okabe and Ito's blue and vermilion, seen on light and dark."""
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


def slice_drawing(told: ErrorSlice) -> AxesDrawing:
    """The error of a point over a plane; grey where too few cameras see."""
    known = told.total_mm[np.isfinite(told.total_mm)]
    if not len(known):
        return AxesDrawing(told.title, "Nothing of it is seen", nothing)
    words = f"From {digits(float(known.min()), 2)} to {digits(float(known.max()), 2)} mm"
    width, height = np.ptp(told.x_mm), np.ptp(told.y_mm)
    shape = (
        max(round(1000 * float(width / max(width, height))), 1),
        max(round(1000 * float(height / max(width, height))), 1),
    )
    return AxesDrawing(told.title, words, lambda axes: _draw_slice(axes, told), shape, has_bar=True)


def _draw_slice(axes: "Axes", told: ErrorSlice) -> None:
    x, y = np.meshgrid(told.x_mm, told.y_mm)
    draw_map(axes, np.stack([x, y], axis=-1), told.total_mm, "mm", may_be_wide=True)
    axes.set_xlabel(told.x_name)
    axes.set_ylabel(told.y_name)
    axes.set_aspect("equal")
    if "down" in told.y_name:
        axes.invert_yaxis()


def depth_drawing(told: DepthCurve) -> AxesDrawing:
    """How surely depth is measured, by distance, and by what."""
    known = np.flatnonzero(np.isfinite(told.depth_mm))
    words = "No point of the line of sight is seen by enough cameras"
    if len(known):
        ends = [
            f"{digits(float(told.depth_mm[row]), 2)} mm at {told.distance_mm[row]:.0f} mm" for row in known[[0, -1]]
        ]
        words = f"Depth has a standard deviation of {ends[0]}, and of {ends[1]}"
    return AxesDrawing("Depth error over distance", words, lambda axes: _draw_depth(axes, told))


def _draw_depth(axes: "Axes", told: DepthCurve) -> None:
    lines = (
        (told.depth_mm, "depth, all that is known", INK, "-"), (told.depth_noise_mm, "by pixel noise", BLUE, "--"),
        (told.depth_calibration_mm, "by the rig's errors", VERMILION, "-."), (told.across_mm, "across", GREY, ":"),
    )  # fmt: skip
    for values, name, colour, style in lines:
        if np.isfinite(values).any():
            axes.plot(told.distance_mm, values, style, color=colour, label=name, linewidth=2)
    axes.set_ylim(bottom=0)
    axes.legend(loc="upper left")
    open_axes(axes, "distance from the rig's middle in mm", "standard deviation in mm")
