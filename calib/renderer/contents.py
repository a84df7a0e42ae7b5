"""What rendered photos show of their target: how many rings, how large, from where; and what makes them hard to use."""

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np

from calib.cameras.camera import Camera
from calib.core.types import LEAST_RADIUS_PX
from calib.renderer.faces import ring_truth, target_fits
from calib.renderer.options import RenderOptions
from calib.renderer.scene import scene_from_target
from designer.base.arrays import Array, Flags
from designer.base.words import figure
from designer.target import TargetGeometry


@dataclass(frozen=True)
class PhotoContent:
    """What one photo shows."""

    distance_mm: float  # from the camera to the target's origin
    off_axis_deg: float  # of the target's origin
    faces: int  # with a ring that can be measured
    rings: int  # that can be measured, nothing hiding them
    radius_px: float  # median of their semi-minor axes
    largest_px: float  # of the semi-minor axes of all rings that face the camera; 0: none does
    is_found: bool  # with a ring that is whole and as large as the detector wants
    is_whole: bool  # the target lies within the image


def photo_contents(
    target: TargetGeometry, camera: Camera, cam_from_target: Array, least_px: float
) -> tuple[PhotoContent, ...]:
    """What photos from poses (V, 4, 4) show; rings with a semi-minor axis of `least_px` can be measured."""
    scene, contents = scene_from_target(target), []
    for pose in cam_from_target:
        rings, (x, y, z) = ring_truth(scene, camera, pose), pose[:3, 3].tolist()
        radius_px = rings.minor_radius_px
        clear = rings.whole & (radius_px >= least_px)
        contents.append(PhotoContent(
            math.hypot(x, y, z), math.degrees(math.atan2(math.hypot(x, y), z)),
            len(np.unique(scene.ring_face[clear])), int(clear.sum()),
            float(np.median(radius_px[clear])) if clear.any() else math.nan,
            float(radius_px[rings.visible].max(initial=0)),
            bool((rings.whole & (radius_px >= LEAST_RADIUS_PX)).any()), target_fits(target, camera, pose),
        ))  # fmt: skip
    return tuple(contents)


def photo_warnings(photos: Sequence[PhotoContent], options: RenderOptions, *, looks_aside: bool) -> Iterator[str]:
    """What will make detection hard, one line each; a target beyond the image is none where it was asked for."""
    if options.white * (1 + options.light_gradient / 2) > 1.001:
        yield "the light gradient takes the white beyond full scale; lower --white"
    cut_off = sum(not one.is_whole for one in photos)
    if cut_off and not looks_aside:
        yield (
            f"the target reaches beyond the image in {cut_off / len(photos):.0%} of the views; "
            "stand farther away to see all of it"
        )
    if small_px := [one.largest_px for one in photos if one.largest_px < LEAST_RADIUS_PX]:
        some = f" in {len(small_px)} of {len(photos)} photos" if len(small_px) < len(photos) else ""
        yield (
            f"the largest mark{some} has a radius of {figure(max(small_px), 2)} px; the detector wants "
            f"{LEAST_RADIUS_PX:g} px: come nearer, or use a longer lens"
            if max(small_px)
            else f"no mark faces the camera{some or ' in any view'}; check the poses"
        )


def rig_warnings(cameras: Sequence[str], sees: Flags) -> Iterator[str]:
    """What will make a rig's calibration hard, by the frames in which each camera sees the target.  # sees (C, V)"""
    if blind := [name for name, row in zip(cameras, sees, strict=True) if not row.any()]:
        yield (
            f"in no frame {', '.join(blind)} has a mark of {LEAST_RADIUS_PX:g} px, as the detector wants; "
            "take more --frames, hold the target nearer with --distance, or take one with larger marks"
        )
    joined, before = sees[0], -1
    while joined.sum() > before:  # cameras that a frame joins to the first, and theirs; frames that they see
        before = int(joined.sum())
        joined = sees[(sees & joined).any(axis=1)].any(axis=0) if before else joined
    if apart := [name for name, row in zip(cameras, sees, strict=True) if row.any() and not (row & joined).any()]:
        yield (
            f"no frame joins {', '.join(apart)} to the first camera, not by others either; take more --frames, or a "
            "solid instead of a board"
        )
