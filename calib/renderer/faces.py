"""What one view shows of the target: its faces, ready to be traced, and where its rings truly are."""

from dataclasses import dataclass, replace

import numpy as np

from calib.cameras import project, rays
from calib.cameras.camera import Camera
from calib.core.se3 import invert, transform
from calib.renderer.light import in_full_light
from calib.renderer.options import RenderOptions
from calib.renderer.polygons import Patches, patches_of
from calib.renderer.scene import Face, RenderScene
from calib.renderer.trace import FaceArrays
from designer.base.arrays import Array, Flags
from designer.target import TargetGeometry

RIM_POINTS = 32
CLEAN_MARGIN_PX = 2.0
EDGE_POINTS = 33
PROBES = 33
"""Along either side of the image, pixels that are asked whether they see a face whose edges they do not."""
MARGIN_PX = 3
MARGIN_SHARE = 0.01
"""Of the box, for what a distorted edge bulges between the points along it."""


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
    radius = scene.reach_mm[:, None]
    circle = np.cos(angle)[None, :, None] * first[:, None] + np.sin(angle)[None, :, None] * second[:, None]
    center_px = project(camera, center)
    rim = center[:, None] + radius[:, :, None] * circle
    rim_px = project(camera, rim)
    # The local affine map from the face to the image, by central differences over the ring.
    quarter = RIM_POINTS // 4
    axes = np.stack([rim_px[:, 0] - rim_px[:, 2 * quarter], rim_px[:, quarter] - rim_px[:, 3 * quarter]], axis=2) / 2
    minor = np.full(len(center), np.nan)
    finite = np.isfinite(axes).all(axis=(1, 2))
    minor[finite] = np.linalg.svd(axes[finite], compute_uv=False)[:, 1]
    visible = (cosine > 0) & _inside(center_px, camera.image_size, -0.5)
    whole = visible & _inside(project(in_full_light(camera), rim), camera.image_size, CLEAN_MARGIN_PX).all(axis=1)
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
    patches: Patches | None
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
    box = _box_of(face, camera, face_from_cam, edge_px)
    if box is None:
        return None
    arrays = face.arrays._replace(is_plain=height < 0)
    if options.sampling != "binary":
        arrays = arrays._replace(black=options.black, white=options.white)
    if face.is_light:
        arrays = arrays._replace(black=arrays.white, white=arrays.black)
    middle = transform(cam_from_face, np.append(face.corner_mm.mean(axis=0), 0.0))
    return SeenFace(
        number=face.number,
        arrays=arrays,
        patches=_patches_from(face, face_from_cam[:3, 3]) if height > 0 else None,
        face_from_cam=face_from_cam,
        edge_px=edge_px[np.isfinite(edge_px).all(axis=1)],
        box=box,
        middle_mm=middle,
        normal=cam_from_face[:3, 2] * np.sign(height),
    )


def _patches_from(face: Face, eye_mm: Array) -> Patches | None:
    """The polygons where they are seen on the face's plane, if some stand above or below it."""
    if face.patches is not None:
        return face.patches
    eye = eye_mm[:2]
    return patches_of([eye + (p[:, :2] - eye) / (1 - p[:, 2:] / eye_mm[2]) for p in face.polygons_mm])


def _edge_px(face: Face, camera: Camera, cam_from_face: Array) -> Array:
    """Points (N, 2) along the outline's image, dark ones too; nan behind the camera and where the model ends."""
    share = np.linspace(0, 1, EDGE_POINTS, endpoint=False)[:, None]
    corner = face.corner_mm[:, None]
    edge = (1 - share) * corner + share * np.roll(corner, -1, axis=0)
    flat = edge.reshape(-1, 2)
    edge_mm = transform(cam_from_face, np.column_stack([flat, np.zeros(len(flat))]))
    return project(replace(camera, field_rad=None), edge_mm)


def _box_of(face: Face, camera: Camera, face_from_cam: Array, edge_px: Array) -> Box | None:
    """The pixels that a face may touch: all of them if it lies straight behind, or fills the image beyond its edges."""
    width, height = camera.image_size
    box = _box(edge_px, camera.image_size)
    if _is_met(face, face_from_cam, np.array([[0.0, 0.0, -1.0]])):
        return Box(0, height, 0, width)
    if box is None:
        u, v = np.meshgrid(np.linspace(0, width - 1, PROBES), np.linspace(0, height - 1, PROBES))
        if _is_met(face, face_from_cam, rays(camera, np.stack([u.ravel(), v.ravel()], axis=1))):
            return Box(0, height, 0, width)
    return box


def _is_met(face: Face, face_from_cam: Array, ray: Array) -> bool:
    """Whether one of the rays (N, 3) meets a face."""
    eye, ray, plane = face_from_cam[:3, 3], ray @ face_from_cam[:3, :3].T, face.arrays.outline
    with np.errstate(divide="ignore", invalid="ignore"):
        length = -eye[2] / ray[:, 2]
        point = eye[:2] + length[:, None] * ray[:, :2]
        return bool(((point @ plane[:, :2].T < plane[:, 2]).all(axis=1) & (length > 0)).any())


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
