"""Frames of a target that moves while they are exposed, row after row: what a hand-held camera or target gives a video.

A row's light is the mean over its exposure, which begins later for each row by the readout of a rolling shutter. It is
summed from renderings of moments, so many that between two of them nothing moves by more than half a pixel.
"""

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from calib.cameras import project
from calib.cameras.camera import Camera
from calib.core.se3 import transform
from calib.renderer.options import RenderOptions
from calib.renderer.scene import RenderScene
from calib.renderer.view import render_view
from designer.base.arrays import Array, Flags

FINEST_PX = 0.5
MOST_MOMENTS = 16
"""What moves faster is blurred beyond use, whatever it is summed from."""


@dataclass(frozen=True)
class Shutter:
    """How a frame is exposed."""

    exposure_s: float = 0.01
    readout_s: float = 0.0  # from the first row to the last; 0: all rows at once
    gain: float = 1.0  # of the light before it is clipped


@dataclass(frozen=True, eq=False)
class MovingFrame:
    """A frame, and the truth of the moment in the middle of its middle row's exposure."""

    image: NDArray[np.uint8]  # (H, W)
    center_px: Array  # (R, 2) where each ring's centre is on average while its own rows are exposed; nan: not seen
    travel_px: Array  # (R,) how far it moves during its exposure


def moving_frame(
    scene: RenderScene, camera: Camera, pose_at: Callable[[float], Array], shutter: Shutter, options: RenderOptions,
    rng: np.random.Generator,
) -> MovingFrame:  # fmt: skip
    """A frame whose first row begins to be exposed at time 0; `pose_at` gives `cam_from_target` at a time in s."""
    rows, last_s = camera.image_size[1], shutter.readout_s + shutter.exposure_s
    ends = np.stack([transform(pose_at(time), scene.center_mm) for time in (0.0, last_s)])
    moved = np.linalg.norm(np.subtract(*project(camera, ends)), axis=-1)
    moments = int(np.clip(np.ceil(np.nanmax(moved, initial=0.0) / FINEST_PX), 1, MOST_MOMENTS))
    time = (np.arange(moments) + 0.5) / moments * last_s
    plain = replace(options, bits=32, contrast_to_noise=0.0, read_noise=0.0, full_well=0.0, gamma=1.0)
    begin = shutter.readout_s * np.arange(rows) / max(rows - 1, 1)
    share = _shares(time, last_s / moments, begin, shutter.exposure_s)  # (rows, moments)
    seed, light = int(rng.integers(2**31)), np.zeros((rows, camera.image_size[0]))
    shown, visible = np.zeros((moments, len(scene.center_mm), 2)), None
    for number in range(moments):
        view = render_view(scene, camera, pose_at(float(time[number])), plain, np.random.default_rng(seed))
        light += share[:, number, None] * view.image
        shown[number] = view.center_px
        visible = view.visible if visible is None else visible & view.visible
    return _sensed(light * shutter.gain, shown, share, visible, moved, shutter, last_s, options, rng)


def _shares(time: Array, step_s: float, begin: Array, exposure_s: float) -> Array:
    """How much of each row's exposure falls to each moment.  # (H, M)"""
    early, late = time - 0.5 * step_s, time + 0.5 * step_s
    overlap = np.minimum(late, begin[:, None] + exposure_s) - np.maximum(early, begin[:, None])
    overlap = np.maximum(overlap, 0.0)
    return overlap / overlap.sum(axis=1, keepdims=True)


def _sensed(
    light: Array, shown: Array, share: Array, visible: Flags | None, moved: Array, shutter: Shutter,
    last_s: float, options: RenderOptions, rng: np.random.Generator,
) -> MovingFrame:  # fmt: skip
    """With noise and clipping; each ring's centre over the moments of the row it is on."""
    if options.noise_sigma:
        light = light + rng.normal(0.0, options.noise_sigma, light.shape)
    image = np.clip(np.rint(255 * np.clip(light, 0, None) ** (1 / options.gamma)), 0, 255).astype(np.uint8)
    row = np.nan_to_num(shown[len(shown) // 2, :, 1]).round().clip(0, len(share) - 1).astype(np.int64)
    center = np.einsum("rm,mrx->rx", share[row], shown)
    seen = np.zeros(len(row), dtype=bool) if visible is None else visible
    return MovingFrame(image, np.where(seen[:, None], center, np.nan), moved * shutter.exposure_s / last_s)
