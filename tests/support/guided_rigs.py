"""Rigs for the tests of guidance: cameras that stand somewhere, and what they see of a target that a person holds."""

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from calib.cameras.camera import Camera
from calib.core.se3 import exp_rotation, invert, look_at, make_pose
from calib.core.types import LEAST_POINTS, Detections
from calib.judge.rig_guide import RigGuide
from designer.base.arrays import Array
from designer.target import TargetGeometry
from tests.support.guided_scenes import WEBCAM, found_at, held_by_person


@dataclass(frozen=True, eq=False)
class TrueRig:
    """Cameras by name, and where each truly stands."""

    cameras: Mapping[str, Camera]
    cam_from_rig: Mapping[str, Array]  # (4, 4)

    def seen(
        self,
        rig_from_target: Array,
        target: TargetGeometry,
        rng: np.random.Generator,
        name: str,
        noise_px: float = 0.05,
    ) -> dict[str, Detections]:
        """What each camera sees of a target; those that see nothing are left out."""
        found = {
            camera: found_at(pose @ rig_from_target, target, rng, name, camera=self.cameras[camera], noise_px=noise_px)
            for camera, pose in self.cam_from_rig.items()
        }
        return {camera: one for camera, one in found.items() if len(one.ring) >= LEAST_POINTS}


def side_by_side(
    names: tuple[str, ...] = ("left", "right"),
    baseline_mm: float = 120.0,
    away_mm: float = 600.0,
    camera: Camera = WEBCAM,
) -> TrueRig:
    """Cameras in a row, toed in on a place before them."""
    across = (np.arange(len(names)) - (len(names) - 1) / 2) * baseline_mm
    eye = np.c_[across, np.zeros((len(names), 2))]
    poses = look_at(eye, np.tile([0.0, away_mm, 0.0], (len(names), 1)))
    return TrueRig(dict.fromkeys(names, camera), {n: p @ invert(poses[0]) for n, p in zip(names, poses, strict=True)})


def held_at_ghost(guide: RigGuide, rig: TrueRig, target: TargetGeometry, rng: np.random.Generator) -> Array:
    """Where a person holds the target who follows the ghost, in the true rig.  # (4, 4)"""
    told = guide.told
    camera = next(one.name for one in told.cameras if one.ghost_px)
    return np.asarray(invert(rig.cam_from_rig[camera]) @ held_by_person(told.ghost.cam_from_target, target, rng))


def anywhere(rig: TrueRig, rng: np.random.Generator) -> Array:
    """Somewhere before one of the cameras, turned somehow.  # (4, 4)"""
    name = list(rig.cameras)[int(rng.integers(len(rig.cameras)))]
    size = np.array(rig.cameras[name].image_size)
    away = rng.uniform(300.0, 800.0)
    ray = rig.cameras[name].rays((size * rng.uniform(0.15, 0.85, 2))[None])[0]
    turn = exp_rotation(rng.normal(0, 0.45, 3)) @ np.diag([1.0, -1.0, -1.0])
    return np.asarray(invert(rig.cam_from_rig[name]) @ make_pose(turn, away * ray))
