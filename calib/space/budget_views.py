"""Where in its working volume a rig measures how well: along its line of sight, and on planes through the volume."""

from dataclasses import dataclass
from typing import Annotated

import numpy as np

from calib.cameras.rig import Rig
from calib.core.se3 import transform
from calib.core.types import freeze
from calib.space.budget import expected_errors
from calib.space.propagate import rms_error_mm
from calib.space.volume import WorkingVolume
from designer.base.arrays import Array
from designer.base.errors import InputError
from designer.base.marks import OR_NULL, AtLeast, AtMost, Length, Line, Shape

STEPS = 33
CELLS = 45
MOST_CELLS = 200
LARGEST_MM = 1e9
_Axis = Annotated[Array, AtLeast(-LARGEST_MM), AtMost(LARGEST_MM)]
_Curve = Annotated[Array, Shape("D"), OR_NULL, AtLeast(0), AtMost(LARGEST_MM)]
_Map = Annotated[Array, Shape("R", "C"), OR_NULL, Length(2, MOST_CELLS), AtLeast(0), AtMost(LARGEST_MM)]


@dataclass(frozen=True, eq=False)
class DepthCurve:
    """Standard deviations along the bisector, by distance from the rig's middle; nan where too few cameras see."""

    distance_mm: Annotated[_Axis, Shape("D"), Length(2, 1000)]
    depth_mm: _Curve  # of the depth, by all that is known
    depth_noise_mm: _Curve
    depth_calibration_mm: _Curve
    across_mm: _Curve  # root mean square of both directions across

    def __post_init__(self) -> None:
        freeze(self, "distance_mm", "depth_mm", "depth_noise_mm", "depth_calibration_mm", "across_mm")


@dataclass(frozen=True, eq=False)
class ErrorSlice:
    """Errors on a plane through the volume; nan where too few cameras see."""

    title: Line
    x_name: Line
    y_name: Line
    x_mm: Annotated[_Axis, Shape("C"), Length(2, MOST_CELLS)]
    y_mm: Annotated[_Axis, Shape("R"), Length(2, MOST_CELLS)]
    total_mm: _Map
    noise_mm: _Map
    calibration_mm: _Map

    def __post_init__(self) -> None:
        freeze(self, "x_mm", "y_mm", "total_mm", "noise_mm", "calibration_mm")
        if not ((np.diff(self.x_mm) > 0).all() and (np.diff(self.y_mm) > 0).all()):
            raise InputError("x_mm and y_mm of a slice must increase")


def depth_curve(rig: Rig, volume: WorkingVolume, noise_px: Array, seen_by: int) -> DepthCurve | None:
    """How surely depth is measured ahead of the rig; None of cameras that look all ways, and of a box."""
    if not volume.is_ahead:
        return None
    origin, ahead = volume.rig_from_volume[:3, 3], volume.rig_from_volume[:3, 2]
    distance = np.linspace(volume.near_mm, volume.far_mm, STEPS)
    expected = expected_errors(rig, origin + distance[:, None] * ahead, noise_px, seen_by)
    shared = expected.calibration_mm2
    total = expected.covariance_mm2
    along = _variance(total, ahead)
    across = np.trace(total, axis1=1, axis2=2) - along
    return DepthCurve(
        distance, np.sqrt(along), np.sqrt(_variance(expected.noise_mm2, ahead)),
        np.full(STEPS, np.nan) if shared is None else np.sqrt(_variance(shared, ahead)), np.sqrt(across / 2),
    )  # fmt: skip


def _variance(covariance_mm2: Array, direction: Array) -> Array:
    variance: Array = np.einsum("i,nij,j->n", direction, covariance_mm2, direction)
    return variance


def slices(rig: Rig, volume: WorkingVolume, noise_px: Array, seen_by: int) -> tuple[ErrorSlice, ...]:
    """Planes through the volume: seen from above and across, or along the axes; those on which something is seen.

    They go through the volume's middle; seen from above through the rig's.
    """
    middle = (volume.low_mm + volume.high_mm) / 2
    if volume.is_ahead:
        middle[1] = np.clip(0.0, volume.low_mm[1], volume.high_mm[1])
    names = ("to the right", "down", "ahead") if volume.is_ahead else ("x", "y", "z")
    planes = ((0, 2), (0, 1)) if volume.is_ahead else ((0, 1), (0, 2), (1, 2))
    found = []
    for first, second in planes:
        (third,) = {0, 1, 2} - {first, second}
        x, y = (_middles(volume, axis) for axis in (first, second))
        local = np.tile(middle, (len(y), len(x), 1))
        local[..., first], local[..., second] = x, y[:, None]
        points = transform(volume.rig_from_volume, local.reshape(-1, 3))
        inside = volume.holds(points)
        expected = expected_errors(rig, np.where(inside[:, None], points, np.nan), noise_px, seen_by)
        if np.isfinite(expected.noise_mm2).any():
            at = f"{middle[third]:.0f} mm"
            where = {"down": "seen from above, at the cameras' height", "ahead": f"{at} ahead"}
            title = f"Error of a point, {where.get(names[third], f'at {names[third]} = {at}')}"
            shape, shared = (len(y), len(x)), expected.calibration_mm2
            found.append(
                ErrorSlice(
                    title, f"{names[first]}, mm", f"{names[second]}, mm", x, y,
                    rms_error_mm(expected.covariance_mm2).reshape(shape),
                    rms_error_mm(expected.noise_mm2).reshape(shape),
                    np.full(shape, np.nan) if shared is None else rms_error_mm(shared).reshape(shape),
                )
            )  # fmt: skip
    return tuple(found)


def _middles(volume: WorkingVolume, axis: int) -> Array:
    low, high = volume.low_mm[axis], volume.high_mm[axis]
    middles: Array = low + (np.arange(CELLS) + 0.5) * (high - low) / CELLS
    return middles
