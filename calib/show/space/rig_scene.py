"""A rig and points in 3D: each camera with what it sees, and each point with the axes of its error, enlarged."""

import numpy as np
from numpy.typing import NDArray

from calib.cameras.rig import Rig
from calib.figures.style import round_length
from calib.show.run.camera_scene import view_of
from designer.base.words import printable
from designer.page.scene import Cameras, Layer, Scene, Segments

Array = NDArray[np.float64]

CAMERA, POINT, EDGE = "#0072B2", "#D55E00", "#8a9099"
"""Okabe and Ito's blue and vermilion, and a grey, seen on light and dark."""
SHARE, AXIS_SHARE = 0.12, 0.05
"""Of the scene's size: a camera's pyramid, the usual point's longest axis."""


def scene_size_mm(rig: Rig, points_mm: Array) -> float:
    """How large a scene is: what half of it spans."""
    every = np.concatenate([rig.center_mm, points_mm])
    return max(float(np.linalg.norm(np.ptp(every, axis=0))) / 2, 1.0)


def rig_layer(rig: Rig, size_mm: float) -> Layer:
    """The cameras of a rig with what they see."""
    frames = rig.rig_from_cam
    cameras = tuple(
        Cameras(frames[row : row + 1], view_of(camera), SHARE * size_mm, (CAMERA,), (printable(name),))
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


def looked_at(rig: Rig, layers: tuple[Layer, ...], legend: tuple[tuple[str, str], ...]) -> Scene:
    """The scene from behind the cameras and from above, as they have it."""
    frames = rig.rig_from_cam
    up, back = -frames[:, :3, 1].mean(axis=0), -frames[:, :3, 2].mean(axis=0)
    up = up if np.linalg.norm(up) > 0.3 else np.array([0.0, -1.0, 0.0])
    side = np.cross(up, back)
    from_direction = back + 0.6 * up + 0.7 * side if np.linalg.norm(side) > 0.3 else np.array([0.6, -0.7, -1.0])
    return Scene(layers, _unit(up), _unit(from_direction), legend)


def _unit(vector: Array) -> tuple[float, float, float]:
    x, y, z = (vector / np.linalg.norm(vector)).tolist()
    return round(x, 6), round(y, 6), round(z, 6)
