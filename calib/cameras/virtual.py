"""The virtual camera: a learned map from measured pixels to a distortion-free sensor, then a linear pinhole.

`x = (s(u)_x - cx) / fx`, `y = (s(u)_y - cy) / fy` with the map s of `calib.cameras.learned` (De Boi et al. 2023).
Where the map is not known there are neither rays nor images.
"""

import numpy as np

from calib.cameras.camera import Camera
from calib.cameras.learned import MapTable, is_known, read, search, table_of
from calib.cameras.parameters import FOCAL_AND_CENTRE, CompiledModel
from calib.core.jit import jit
from designer.base.arrays import Array

VIRTUAL = "virtual"


@jit
def _rays(params: Array, table: MapTable, pixel: Array, ray: Array) -> None:
    for n in range(len(pixel)):
        u, v = pixel[n, 0], pixel[n, 1]
        if is_known(table.region, u, v):
            x, y, _, _, _, _ = read(table.spline, u, v)
            ray[n, 0], ray[n, 1], ray[n, 2] = (x - params[2]) / params[0], (y - params[3]) / params[1], 1.0
        else:
            ray[n, 0], ray[n, 1], ray[n, 2] = np.nan, np.nan, np.nan


@jit
def _project(params: Array, table: MapTable, point: Array, pixel: Array) -> None:
    for n in range(len(point)):
        pixel[n, 0], pixel[n, 1] = np.nan, np.nan
        if point[n, 2] > 0:
            x, y = point[n, 0] / point[n, 2], point[n, 1] / point[n, 2]
            u, v = search(table, params[0] * x + params[2], params[1] * y + params[3])
            if is_known(table.region, u, v):
                pixel[n, 0], pixel[n, 1] = u, v


@jit
def _linearise(params: Array, table: MapTable, point: Array, rows: Array) -> None:
    pixel, by_point, by_params = rows[:2], rows[2:8].reshape(2, 3, -1), rows[8:].reshape(2, 4, -1)
    fx, fy, cx, cy = params
    for n in range(point.shape[1]):
        inverse_depth = 1.0 / point[2, n] if point[2, n] > 0 else np.nan
        x, y = point[0, n] * inverse_depth, point[1, n] * inverse_depth
        u, v = search(table, fx * x + cx, fy * y + cy)
        if not is_known(table.region, u, v):
            u, v = np.nan, np.nan
        pixel[0, n], pixel[1, n] = u, v
        # The map holds s(u) = (fx x + cx, fy y + cy), so du = (ds/du)^-1 d(fx x + cx, fy y + cy).
        a, b, c, d = np.nan, np.nan, np.nan, np.nan
        if not np.isnan(u):
            _, _, xu, xv, yu, yv = read(table.spline, u, v)
            determinant = xu * yv - xv * yu
            a, b, c, d = yv / determinant, -xv / determinant, -yu / determinant, xu / determinant
        for k, along_x, along_y in ((0, a, b), (1, c, d)):
            by_params[k, 0, n], by_params[k, 1, n] = along_x * x, along_y * y
            by_params[k, 2, n], by_params[k, 3, n] = along_x, along_y
            gx, gy = along_x * fx * inverse_depth, along_y * fy * inverse_depth
            by_point[k, 0, n], by_point[k, 1, n], by_point[k, 2, n] = gx, gy, -(gx * x + gy * y)


def _table(camera: Camera) -> tuple[MapTable]:
    """The table of a virtual camera's map."""
    if camera.learned is None:
        raise ValueError(f"a camera of model {camera.model!r} needs a learned map")
    return (table_of(camera.learned, camera.image_size),)


MODEL = CompiledModel(
    name=VIRTUAL,
    remedy="show the target there too",
    parameters=FOCAL_AND_CENTRE,  # in pixels of the virtual sensor
    lens=_table,
    fill_rays=_rays,
    fill_pixels=_project,
    fill_linear=_linearise,
)
