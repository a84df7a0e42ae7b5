"""Where photos were taken from, around a target or around the axes of its frame."""

from typing import TYPE_CHECKING

import numpy as np

from calib.cameras.camera import Camera
from designer.base.arrays import Array
from designer.base.words import counted, span
from designer.target import TargetGeometry

if TYPE_CHECKING:
    from designer.page.blocks import View3d
    from designer.page.scene import Layer


CAMERA = "#0072B2"
"""Okabe and Ito's blue, which is seen on light and dark."""
AXIS_SHARE, LETTER_SHARE = 0.2, 0.03
"""Of the cameras' usual distance, for a target that is not known: length of its axes, height of their letters."""
MOST_VIEWS = 3000
"""More pyramids make a page slow: then every second, third, ... is drawn."""


def place_view(
    target: TargetGeometry | None, camera: Camera, cam_from_target: Array, names: tuple[str, ...]
) -> "View3d":
    """The scene and what it shows in words."""
    from calib.draw.camera_scene import BODY, INK, first_look
    from calib.draw.rig_scene import body_words, view_of
    from calib.solver.metrics.errors import centers_mm
    from designer.page.blocks import View3d
    from designer.page.scene import Scene
    from designer.target_scene import camera_layer, camera_size_mm, target_layers

    every = -(-len(names) // MOST_VIEWS)
    poses = cam_from_target[::every]
    size_mm = camera_size_mm(poses)
    drawn = _axes(poses) if target is None else target_layers(target, body_colour=BODY, ink_colour=INK)
    sight = view_of(camera)
    cameras = camera_layer(poses, sight, names[::every], (CAMERA,), size_mm)
    is_flat = target is not None and target.is_plate
    up, from_direction = first_look(poses, centers_mm(poses), is_flat=is_flat)
    caption = f"Each {body_words(sight)} is a photo; point at one for its name."
    said = caption if every == 1 else f"{caption} One of {every} is drawn."
    return View3d(
        "Camera positions", Scene((*drawn, cameras), up, from_direction, ((CAMERA, "camera"),)),
        place_words(target, cam_from_target), said,
    )  # fmt: skip


def place_words(target: TargetGeometry | None, cam_from_target: Array) -> str:
    """From where photos were taken, as a sentence."""
    from calib.solver.metrics.errors import centers_mm

    centre = centers_mm(cam_from_target)
    photos = counted(len(centre), "photo")
    words = f"{photos} from {distance_words(cam_from_target)} away"
    if target is not None and target.is_plate:
        tilt = tilts_deg(target, cam_from_target)
        words += f", at {tilt.min():.0f} to {tilt.max():.0f}° from straight on"
    return f"{words}."


def distance_words(cam_from_target: Array) -> str:
    """How far cameras stand from the target's origin."""
    return f"{span(np.linalg.norm(cam_from_target[:, :3, 3], axis=1).tolist(), 3)} mm"


def tilts_deg(target: TargetGeometry, cam_from_target: Array) -> Array:
    """Between the normal of the side of a flat target that is seen and the line of sight to its origin.  # (V,)"""
    normal = cam_from_target[:, :3, :3] @ target.target_from_face[0, :3, 2]
    shift = cam_from_target[:, :3, 3]
    cosine = -np.einsum("vi,vi->v", normal, shift) / np.maximum(np.linalg.norm(shift, axis=1), 1e-9)
    tilt: Array = np.degrees(np.arccos(np.clip(cosine, -1.0, 1.0)))
    return tilt if target.is_planar else np.minimum(tilt, 180.0 - tilt)


def _axes(poses: Array) -> "tuple[Layer, ...]":
    """The axes of the target's frame with their letters."""
    from calib.draw.rig_scene import seen_from_both_sides
    from designer.page.scene import Layer, Segments
    from designer.target_scene import AXES

    usual = float(np.median(np.linalg.norm(poses[:, :3, 3], axis=1)))
    length = max(AXIS_SHARE * usual, 1e-3)
    ends = np.zeros((3, 2, 3))
    ends[:, 1] = length * np.eye(3)
    letters = tuple(letter for letter, _ in AXES)
    labels = seen_from_both_sides(1.1 * length * np.eye(3), np.eye(3), letters, LETTER_SHARE * usual)
    return (Layer("axes of the target", (Segments(ends, tuple(colour for _, colour in AXES)), labels)),)
