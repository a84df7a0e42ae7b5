"""The part of the image that a camera is judged over: all of it, or what a wide lens shows: `lit_part(calibration)`.

The image circle of a wide lens may end inside the frame, while its model runs on over the dark. Where the light ends
photos tell (`field_rad` of the camera). Without them the sightings say how far it reaches at least: beyond the farthest
one nothing is asked, and that is said. Nor is anything asked where a wide model has no ray.
"""

import math
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from calib.cameras import rays
from calib.cameras.camera import Camera
from calib.cameras.refit import image_grid
from calib.core.se3 import transform
from calib.solver.accuracy import projected_sigma_px, share_px
from calib.solver.calibration import Calibration

Array = NDArray[np.float64]

UNSEEN_RAD = math.radians(5)
"""Where the light ends so far beyond the farthest sighting, the angle is a guess of the lens model."""


@dataclass(frozen=True, eq=False)
class LitPart:
    """What is asked of a camera."""

    camera: Camera  # without rays beyond
    off_axis_rad: float | None  # where it ends; None: all of the image is asked for
    is_measured: bool = True  # where the light ends; else that is where the farthest sighting is
    farthest_rad: float = 0.0  # sighting off the axis

    def is_lit(self, pixel: Array) -> NDArray[np.bool_]:
        """Whether pixels (..., 2) are in it."""
        if self.off_axis_rad is None:
            return np.ones(pixel.shape[:-1], dtype=np.bool_)
        return np.asarray(np.isfinite(rays(self.camera, pixel)).all(axis=-1))

    @property
    def name(self) -> str:
        """What it is called: "95 % of the image circle"."""
        if self.off_axis_rad is None:
            return "image"
        return "image circle" if self.is_measured else f"image up to {self.end_words}"

    @property
    def end_words(self) -> str:
        """Where it ends, "97° off the axis"; "" if that is the image's border."""
        return "" if self.off_axis_rad is None else f"{math.degrees(self.off_axis_rad):.0f}° off the axis"

    @property
    def remark(self) -> str:
        """Why it ends there, as a sentence; "" if it is all of the image."""
        if self.off_axis_rad is None:
            return ""
        if self.is_measured:
            known = ""
            if self.farthest_rad < self.off_axis_rad - UNSEEN_RAD:
                known = (
                    f" by the lens model, which no observation beyond {math.degrees(self.farthest_rad):.0f}° confirms"
                )
            return f"The light ends {self.end_words}{known}; nothing is asked of the camera beyond."
        return (
            f"The farthest observation is {self.end_words}; nothing is asked of the camera beyond, as only photos tell "
            "whether light arrives there."
        )

    @property
    def box_px(self) -> tuple[Array, Array]:
        """First and last pixel of the box around it (2,), (2,)."""
        last = np.array(self.camera.image_size, dtype=np.float64) - 1
        if self.off_axis_rad is None:
            return np.zeros(2), last
        pixel = image_grid(self.camera.image_size).reshape(-1, 2)
        lit = pixel[self.is_lit(pixel)]
        return (lit.min(axis=0), lit.max(axis=0)) if len(lit) else (np.zeros(2), last)


def lit_part(calibration: Calibration) -> LitPart:
    """The part of the image that a calibration is judged over."""
    camera = calibration.camera
    if not camera.has_dark_corners:
        return LitPart(camera, None)
    seen, counted = calibration.observations, ~calibration.is_outlier
    is_measured = camera.field_rad is not None
    pose = calibration.cam_from_target[seen.view[counted]]
    point = transform(pose, seen.points.position_mm[seen.point[counted]])
    farthest = float(np.arctan2(np.hypot(point[:, 0], point[:, 1]), point[:, 2]).max(initial=0.0))
    reach = farthest if camera.field_rad is None else camera.field_rad / 2
    if not 0 < reach <= math.pi:  # nothing was seen, or nothing is known of poses
        return LitPart(camera, None)
    limited = replace(camera, field_rad=2 * reach)
    pixel = image_grid(camera.image_size)
    has_ray = np.isfinite(rays(limited, pixel)).all(axis=-1)
    return (
        LitPart(camera, None) if has_ray.all() or not has_ray.any() else LitPart(limited, reach, is_measured, farthest)
    )


def sigma_over_lit_px(lit: LitPart, param_covariance: Array) -> float:
    """What 95 % of it stays within (1 sigma); infinite if less is known."""
    pixel = image_grid(lit.camera.image_size).reshape(-1, 2)
    return share_px(projected_sigma_px(lit.camera, param_covariance, pixel[lit.is_lit(pixel)]))
