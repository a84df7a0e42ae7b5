"""Where the rings of a target truly are in an image, and how they are seen."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from calib.cameras import project
from calib.cameras.camera import Camera
from calib.core.se3 import transform
from calib.renderer.scene import RenderScene
from designer.target import TargetGeometry

Array = NDArray[np.float64]
Flags = NDArray[np.bool_]

RIM_POINTS = 32
CLEAN_MARGIN_PX = 2.0


@dataclass(frozen=True, eq=False)
class RingTruth:
    """R rings in one image. What a camera cannot see at all is nan."""

    center_px: Array  # (R, 2) projected centres
    rim_px: Array  # (R, N, 2) points of the outer circle
    incidence_rad: Array  # (R,) between the face's normal and the way to the camera
    minor_radius_px: Array  # (R,) semi-minor axis of the outer circle's image
    visible: Flags  # (R,) turned to the camera, centre inside the image
    whole: Flags  # (R,) visible, with all of its rim 2 px inside the image


def ring_truth(scene: RenderScene, camera: Camera, cam_from_target: Array) -> RingTruth:
    """Project the rings of a scene."""
    center = transform(cam_from_target, scene.center_mm)
    rotation = cam_from_target[:3, :3]
    normal = scene.normal @ rotation.T
    cosine = -(normal * center).sum(axis=1) / np.linalg.norm(center, axis=1)
    first, second = _tangents(scene, rotation)
    angle = 2 * np.pi * np.arange(RIM_POINTS) / RIM_POINTS
    radius = scene.ring[:, 3, None]
    circle = np.cos(angle)[None, :, None] * first[:, None] + np.sin(angle)[None, :, None] * second[:, None]
    center_px = project(camera, center)
    rim_px = project(camera, center[:, None] + radius[:, :, None] * circle)
    # The local affine map from the face to the image, by central differences over the ring.
    quarter = RIM_POINTS // 4
    axes = np.stack([rim_px[:, 0] - rim_px[:, 2 * quarter], rim_px[:, quarter] - rim_px[:, 3 * quarter]], axis=2) / 2
    minor = np.full(len(center), np.nan)
    finite = np.isfinite(axes).all(axis=(1, 2))
    minor[finite] = np.linalg.svd(axes[finite], compute_uv=False)[:, 1]
    visible = (cosine > 0) & _inside(center_px, camera.image_size, -0.5)
    whole = visible & _inside(rim_px, camera.image_size, CLEAN_MARGIN_PX).all(axis=1)
    return RingTruth(center_px, rim_px, np.arccos(np.clip(cosine, -1, 1)), minor, visible, whole)


def target_fits(target: TargetGeometry, camera: Camera, cam_from_target: Array) -> bool:
    """Whether all corners of the target are in the image."""
    corners = np.concatenate([target.outline_mm, np.zeros((*target.outline_mm.shape[:2], 1))], axis=2)
    in_camera = transform((cam_from_target @ target.target_from_face)[:, None], corners)
    return bool(_inside(project(camera, in_camera), camera.image_size, -0.5).all())


def _tangents(scene: RenderScene, rotation: Array) -> tuple[Array, Array]:
    """Two unit vectors (R, 3) along each ring's face, in the camera frame."""
    frames = np.stack([face.target_from_face for face in scene.faces])[scene.ring_face]
    return frames[:, :3, 0] @ rotation.T, frames[:, :3, 1] @ rotation.T


def _inside(point_px: Array, image_size: tuple[int, int], margin_px: float) -> Flags:
    """Whether points (..., 2) lie at least a margin inside the centres of the outermost pixels."""
    last = np.array(image_size, dtype=np.float64) - 1 - margin_px
    return np.asarray(((point_px >= margin_px) & (point_px <= last)).all(axis=-1), dtype=np.bool_)
