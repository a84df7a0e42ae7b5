"""Photos for the tests of guidance: targets, what is found of them, and a person who holds them about as told."""

import numpy as np

from calib.cameras import project
from calib.cameras.camera import Camera
from calib.core.se3 import exp_rotation, transform
from calib.core.types import Detections
from designer.base.arrays import Array
from designer.kinds.board import BoardSpec
from designer.kinds.ico import IcoSpec
from designer.kinds.layout import lay_out
from designer.target import TargetGeometry

WEBCAM = Camera("opencv", np.array([1000.0, 1002, 650, 350, -0.25, 0.08, 3e-4, -2e-4, 0.01]), (1280, 720))
MARGIN_PX, INCIDENCE_DEG, FEW = 8.0, 72.0, 2.0
TREMOR_DEG, TREMOR_MM = 5.0, 20.0


def board_target(columns: int = 14, rows: int = 10, pitch_mm: float = 14.0) -> TargetGeometry:
    """A board."""
    size = ((columns + 1) * pitch_mm, (rows + 1) * pitch_mm)
    return lay_out(BoardSpec(size, 3.0, columns, rows, "square", 0.7 * pitch_mm, 0.45, pitch_mm, 0.0, 1.0, dots=False))


def ico_target(edge_mm: float = 60.0, rings_per_side: int = 6) -> TargetGeometry:
    """An icosahedron."""
    pitch = 0.8 * edge_mm / rings_per_side
    return lay_out(IcoSpec(edge_mm, rings_per_side, 0.7 * pitch, 0.45, pitch, 0.02 * edge_mm, 1.0))


def found_at(
    cam_from_target: Array, target: TargetGeometry, rng: np.random.Generator, name: str = "a.png",
    *, camera: Camera = WEBCAM, noise_px: float = 0.05,
) -> Detections:  # fmt: skip
    """What a detector finds of a target at a pose."""
    normal = target.target_from_face[target.ring_face, :3, 2] @ cam_from_target[:3, :3].T
    place = transform(cam_from_target, target.center_mm)
    cosine = -(place * normal).sum(axis=1) / np.linalg.norm(place, axis=1)
    pixel = project(camera, place)
    with np.errstate(invalid="ignore"):
        inside = (pixel > MARGIN_PX).all(axis=1) & (pixel < np.array(camera.image_size) - 1 - MARGIN_PX).all(axis=1)
    ring = np.flatnonzero(inside & (cosine > np.cos(np.radians(INCIDENCE_DEG))) & (place[:, 2] > 0))
    center = pixel[ring] + noise_px * rng.standard_normal((len(ring), 2))
    ellipse = np.column_stack([center, np.full((len(ring), 2), 8.0), np.zeros(len(ring))])
    return Detections(
        name, camera.image_size, target.layout_id, target.geometry_id, ring, target.center_mm[ring], center,
        np.tile(noise_px**2 * np.eye(2), (len(ring), 1, 1)), ellipse, (),
    )  # fmt: skip


def held_by_person(
    cam_from_target: Array, target: TargetGeometry, rng: np.random.Generator, steady: float = 1.0
) -> Array:
    """About that pose, as well as a person holds a target; one who is steady is off by less (mm times that)."""
    middle = target.center_mm.mean(axis=0)
    tremor = np.clip(rng.standard_normal((2, 3)), -FEW, FEW)
    pose = np.array(cam_from_target)
    pose[:3, :3] = exp_rotation(np.radians(TREMOR_DEG) * tremor[0]) @ pose[:3, :3]
    pose[:3, 3] = transform(cam_from_target, middle) + steady * TREMOR_MM * tremor[1] - pose[:3, :3] @ middle
    return pose
