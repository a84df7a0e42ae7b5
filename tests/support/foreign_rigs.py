"""Rigs to convert, and how points are seen by them."""

from dataclasses import replace
from pathlib import Path

import numpy as np

from calib.cameras.camera import Camera
from calib.cameras.formats import RIG_FORMATS
from calib.cameras.formats.format import FileLens
from calib.cameras.formats.holding import fit_to_format
from calib.cameras.formats.rig_format import RigFiles, WrittenRig
from calib.cameras.rig import Rig
from calib.core.se3 import exp_rotation, look_at, make_pose, transform
from designer.base.arrays import Array
from tests.support.foreign_cameras import CAMERAS, MODELS, WIDE_SIZE

BROWN = Camera("opencv", np.array([620.0, 600, 508.2, 391.7, -0.3, 0.1, 0.002, -0.0004, 0]), (1024, 768))
FISHEYE = Camera("fisheye", np.array([*MODELS["fisheye"][:6], 0, 0]), WIDE_SIZE)
"""Each format holds it as it is, mrcal's too."""


def stereo(
    first: Camera = BROWN, second: Camera | None = None, shift_mm: tuple[float, float, float] = (-120, 4, 9)
) -> Rig:
    """A pair that looks ahead, its second camera turned by some degrees about each axis."""
    other = second or replace(
        first, params=first.params * np.array([1.01, 1.02, 1.005, 0.99, *[0.9] * (len(first.params) - 4)])
    )
    pose = make_pose(exp_rotation(np.array([0.03, -0.06, 0.02])), np.array(shift_mm, dtype=float))
    return Rig(("left", "right"), (first, other), np.stack([np.eye(4), pose]))


def ring(cameras: tuple[Camera, ...] = (BROWN, FISHEYE, CAMERAS["pinhole"])) -> Rig:
    """Cameras around the origin that look at it from all sides; the frame is none of theirs."""
    turn = np.linspace(0, 2 * np.pi, len(cameras), endpoint=False) + 0.2
    eye = np.stack([900 * np.cos(turn), 800 * np.sin(turn), 200 + 50 * turn], axis=1)
    names = tuple(f"cam {chr(ord('a') + row)}" for row in range(len(cameras)))
    return Rig(names, cameras, look_at(eye, np.zeros(3), 0.1 * turn), rig_frame="world")


def points_before(rig: Rig, count: int = 40) -> Array:
    """Points in the rig's frame that all its cameras see, some of them well aside.  # (N, 3)"""
    rng = np.random.default_rng(3)
    in_middle = rng.uniform(-150, 150, (4000, 3))
    if np.abs(rig.cam_from_rig[0] - np.eye(4)).max() == 0:
        in_middle += [0.0, 0.0, 700.0]
    seen = np.ones(len(in_middle), dtype=bool)
    for pixel, camera in zip(seen_by(rig, in_middle), rig.cameras, strict=True):
        seen &= ((pixel > 0) & (pixel < np.array(camera.image_size))).all(axis=1)
    found = in_middle[seen][:count]
    assert len(found) == count
    return found


def seen_by(rig: Rig, point: Array) -> list[Array]:
    """Pixels (N, 2) of points (N, 3) in each camera."""
    return [camera.project(transform(pose, point)) for camera, pose in zip(rig.cameras, rig.cam_from_rig, strict=True)]


def held_by(name: str, rig: Rig) -> tuple[Rig, tuple[FileLens, ...]]:
    """A rig with each camera as a format holds it."""
    held = [fit_to_format(camera, RIG_FORMATS[name].cameras) for camera in rig.cameras]
    return replace(rig, cameras=tuple(one.camera for one in held)), tuple(one.lens for one in held)


def rig_texts(name: str, rig: Rig, unit: str | None = None) -> dict[str, str]:
    """The files of a rig whose cameras a format holds as they are, or nearly."""
    same, lenses = held_by(name, rig)
    return dict(
        RIG_FORMATS[name].write(
            WrittenRig(same, lenses, unit or RIG_FORMATS[name].unit, RIG_FORMATS[name].words(rig.names))
        )
    )


def read_texts(name: str, texts: dict[str, str], unit: str | None = None) -> Rig:
    """The rig that a format reads in texts."""
    return RIG_FORMATS[name].read(RigFiles(texts, "f.x", unit or RIG_FORMATS[name].unit)).rig


def write_texts(texts: dict[str, str], folder: Path) -> Path:
    """The texts as files of a folder."""
    for name, text in texts.items():
        (folder / name).write_text(text)
    return folder
