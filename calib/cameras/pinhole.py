"""The linear pinhole: `u = fx X/Z + cx`, `v = fy Y/Z + cy`."""

from dataclasses import dataclass

import numpy as np

from calib.cameras.camera import Camera
from calib.cameras.parameters import AT_ONCE, FOCAL_AND_CENTRE, LensParameter, Linearised, keep_rows, to_unit
from calib.core.jit import jit, jit_sums
from designer.base.arrays import Array


@jit
def _linearise(params: Array, point: Array, kept: Array) -> None:
    rows = np.zeros(len(kept) * AT_ONCE)
    rows[10 * AT_ONCE : 11 * AT_ONCE] = 1.0  # u by cx
    rows[15 * AT_ONCE : 16 * AT_ONCE] = 1.0  # v by cy
    p = params[0], params[1], params[2], params[3]
    for begin in range(0, point.shape[1], AT_ONCE):
        count = min(AT_ONCE, point.shape[1] - begin)
        for axis in range(3):
            rows[axis * AT_ONCE : axis * AT_ONCE + count] = point[axis, begin : begin + count]
        _fill(p, count, rows)
        keep_rows(rows, begin, count, kept)


@jit_sums
def _fill(p: tuple[float, float, float, float], count: int, rows: Array) -> None:
    """Replace points, the first three rows, by pixels and derivatives, row by row as in `Linearised`."""
    fx, fy, cx, cy = p
    for n in range(count):
        depth = rows[2 * AT_ONCE + n]
        inverse_depth = 1.0 / depth if depth > 0 else np.nan
        x, y = rows[n] * inverse_depth, rows[AT_ONCE + n] * inverse_depth
        rows[n], rows[AT_ONCE + n] = fx * x + cx, fy * y + cy
        rows[2 * AT_ONCE + n], rows[4 * AT_ONCE + n] = fx * inverse_depth, -fx * x * inverse_depth
        rows[6 * AT_ONCE + n], rows[7 * AT_ONCE + n] = fy * inverse_depth, -fy * y * inverse_depth
        rows[8 * AT_ONCE + n], rows[13 * AT_ONCE + n] = x, y


@dataclass(frozen=True)
class Pinhole:
    """A camera without distortion."""

    name: str = "pinhole"
    remedy: str = "models with a lens may reach them"
    opencv_lens: tuple[str, ...] | None = ()
    parameters: tuple[LensParameter, ...] = FOCAL_AND_CENTRE

    def rays(self, camera: Camera, pixel: Array) -> Array:
        """Unit directions (..., 3)."""
        pixel = np.asarray(pixel, dtype=np.float64)
        slope = (pixel - camera.params[2:]) / camera.params[:2]
        ray = np.concatenate([slope, np.ones((*pixel.shape[:-1], 1))], axis=-1)
        to_unit(ray.reshape(-1, 3))
        return ray

    def project(self, camera: Camera, point: Array) -> Array:
        """Pixels (..., 2); nan behind the camera."""
        point = np.asarray(point, dtype=np.float64)
        depth = np.where(point[..., 2:] > 0, point[..., 2:], np.nan)
        pixel: Array = camera.params[:2] * point[..., :2] / depth + camera.params[2:]
        return pixel

    def linearise(self, camera: Camera, point: Array) -> Linearised:
        """Pixels of points (3, N) with their derivatives."""
        rows = np.empty((16, point.shape[1]))
        _linearise(camera.params, point, rows)
        return Linearised(rows)


MODEL = Pinhole()
