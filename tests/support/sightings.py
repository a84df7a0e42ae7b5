"""Photos of targets with detections made from the truth, for tests of what comes after the detector."""

import cv2
import numpy as np
from numpy.typing import NDArray

from calib.cameras.camera import Camera
from calib.core.se3 import look_at
from calib.core.types import Detections, FaceRecord
from calib.renderer import RenderOptions, render_view
from calib.renderer.faces import ring_truth
from calib.renderer.scene import scene_from_target
from designer.base.arrays import Array
from designer.target import TargetGeometry


def pinhole(width: int, height: int, focal_px: float) -> Camera:
    """A camera without distortion."""
    return Camera(
        "opencv", np.array([focal_px, focal_px, (width - 1) / 2, (height - 1) / 2, 0, 0, 0, 0, 0]), (width, height)
    )


def view_from(eye_mm: tuple[float, float, float], aim_mm: tuple[float, float, float] = (0, 0, 0)) -> Array:
    """A camera's pose that looks from one point to another.  # (4, 4)"""
    return look_at(np.array([eye_mm], dtype=float), np.array([aim_mm], dtype=float), np.zeros(1))[0]


def sighting(
    target: TargetGeometry,
    camera: Camera,
    cam_from_target: Array,
    rng: np.random.Generator,
    *,
    found_share: float = 1.0,
    options: RenderOptions | None = None,
    name: str = "photo.png",
) -> tuple[NDArray[np.uint8], Detections]:
    """A rendered photo, and what a detector could say of it that finds a share of the rings up to 75 degrees."""
    if options is None:
        options = RenderOptions(blur_px=0.7, contrast_to_noise=50)
    view = render_view(target, camera, cam_from_target, options, rng)
    truth = ring_truth(scene_from_target(target), camera, cam_from_target)
    able = truth.whole & (truth.incidence_rad < np.radians(75))
    ring = np.flatnonzero(able & (rng.random(target.ring_count) < found_share))
    ellipses = []
    for rim in truth.rim_px[ring]:
        middle = rim.mean(axis=0)
        (u, v), (first, second), degrees = cv2.fitEllipse((64 * (rim - middle)).astype(np.float32))
        turn = np.radians(degrees) + (0 if first >= second else np.pi / 2)
        ellipses.append(
            [u / 64 + middle[0], v / 64 + middle[1], max(first, second) / 128, min(first, second) / 128, turn]
        )
    sigma = 0.004 / np.cos(truth.incidence_rad[ring]) ** 2 * np.exp(rng.normal(0, 0.3, len(ring)))
    faces = []
    for face in np.unique(target.ring_face[ring]):
        of_face = target.ring_face == face
        found, expected = int((target.ring_face[ring] == face).sum()), int(of_face.sum())
        faces.append(FaceRecord(int(face), (), 4, found, expected, (("not seen", expected - found),)))
    seen = Detections(
        image=name,
        image_size=camera.image_size,
        layout_id=target.layout_id,
        geometry_id=target.geometry_id,
        ring=ring,
        position_mm=target.center_mm[ring],
        center_px=truth.center_px[ring] + rng.normal(0, 1, (len(ring), 2)) * sigma[:, None],
        cov_px2=sigma[:, None, None] ** 2 * np.eye(2),
        ellipse_px=np.array(ellipses).reshape(-1, 5),
        faces=tuple(faces),
    )
    return view.image.astype(np.uint8), seen
