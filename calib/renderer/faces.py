"""The faces that one view shows, ready to be traced."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from calib.cameras import project
from calib.cameras.camera import Camera
from calib.core.se3 import invert, transform
from calib.renderer.options import RenderOptions
from calib.renderer.scene import Face, RenderScene
from calib.renderer.trace import FaceArrays

Array = NDArray[np.float64]

EDGE_POINTS = 33
MARGIN_PX = 3
MARGIN_SHARE = 0.01
"""Of the box, for what a distorted edge bulges between the points along it."""


@dataclass(frozen=True)
class Box:
    """Rows top to bottom and columns left to right of an image, the last ones excluded."""

    top: int
    bottom: int
    left: int
    right: int


@dataclass(frozen=True, eq=False)
class SeenFace:
    """A face that is turned to the camera, or the plain back of one."""

    number: int  # in the target
    arrays: FaceArrays
    face_from_cam: Array  # (4, 4)
    edge_px: Array  # (N, 2) points along the outline's image
    box: Box  # pixels that it may touch
    middle_mm: Array  # (3,) in the camera frame
    normal: Array  # (3,) towards the camera's side, in the camera frame


def seen_faces(scene: RenderScene, camera: Camera, cam_from_target: Array, options: RenderOptions) -> list[SeenFace]:
    """The faces in the image, nearest first."""
    seen = [_seen_face(face, scene, camera, cam_from_target, options) for face in scene.faces]
    return sorted((face for face in seen if face is not None), key=lambda face: float(np.linalg.norm(face.middle_mm)))


def _seen_face(
    face: Face, scene: RenderScene, camera: Camera, cam_from_target: Array, options: RenderOptions
) -> SeenFace | None:
    cam_from_face = cam_from_target @ face.target_from_face
    face_from_cam = invert(cam_from_face)
    height = float(face_from_cam[2, 3])
    if height == 0 or (height < 0 and scene.is_convex):
        return None
    edge_px = _edge_px(face, camera, cam_from_face)
    box = _box(edge_px, camera.image_size)
    if box is None:
        return None
    is_binary = options.sampling == "binary"
    arrays = FaceArrays(
        outline=face.outline,
        window=face.window,
        has_border=face.has_border,
        is_plain=height < 0,
        ring=scene.ring,
        raster=face.raster,
        raster_origin=face.raster_origin_mm,
        cell_mm=face.cell_mm,
        lone_mm=face.lone_mm,
        black=0.0 if is_binary else options.black,
        white=1.0 if is_binary else options.white,
    )
    middle = transform(cam_from_face, np.append(face.corner_mm.mean(axis=0), 0.0))
    return SeenFace(
        number=face.number,
        arrays=arrays,
        face_from_cam=face_from_cam,
        edge_px=edge_px[np.isfinite(edge_px).all(axis=1)],
        box=box,
        middle_mm=middle,
        normal=cam_from_face[:3, 2] * np.sign(height),
    )


def _edge_px(face: Face, camera: Camera, cam_from_face: Array) -> Array:
    """Points (N, 2) along the outline's image; nan behind the camera and where the lens's image ends."""
    share = np.linspace(0, 1, EDGE_POINTS, endpoint=False)[:, None]
    corner = face.corner_mm[:, None]
    edge = (1 - share) * corner + share * np.roll(corner, -1, axis=0)
    flat = edge.reshape(-1, 2)
    return project(camera, transform(cam_from_face, np.column_stack([flat, np.zeros(len(flat))])))


def _box(edge_px: Array, image_size: tuple[int, int]) -> Box | None:
    """The pixels that a face may touch: the whole image if the lens's image ends on the face."""
    finite = np.isfinite(edge_px).all(axis=1)
    if not finite.any():
        return None
    if not finite.all():
        return Box(0, image_size[1], 0, image_size[0])
    low, high = edge_px.min(axis=0), edge_px.max(axis=0)
    margin = MARGIN_PX + MARGIN_SHARE * (high - low)
    low, high = np.clip(np.floor([low - margin, high + margin + 1]), 0, image_size).astype(int)
    box = Box(int(low[1]), int(high[1]), int(low[0]), int(high[0]))
    return box if box.top < box.bottom and box.left < box.right else None


def union(boxes: list[Box]) -> Box:
    """The smallest box around boxes; without any, an empty one."""
    if not boxes:
        return Box(0, 0, 0, 0)
    return Box(
        min(box.top for box in boxes),
        max(box.bottom for box in boxes),
        min(box.left for box in boxes),
        max(box.right for box in boxes),
    )
