"""OpenCV's rational camera with a thin prism and a tilted sensor: fourteen coefficients, as Scheimpflug cameras need.

`u = fx x' + cx`, `v = fy y' + cy` with `(x', y')` the image through the centre of `D` of `calib.cameras.displaced` on a
plane that is turned by `R = R_y(tau_y) R_x(tau_x)`, brought back onto the axis (OpenCV's documentation of calib3d):

    s (x', y', 1) = [[R33, 0, -R13], [0, R33, -R23], [0, 0, 1]] R (a, b, 1),   (a, b) = D(X / Z, Y / Z)
"""

from dataclasses import dataclass
from functools import lru_cache

import numpy as np

from calib.cameras.camera import Camera
from calib.cameras.opencv12 import MODEL as UPRIGHT
from calib.cameras.parameters import LensParameter, Linearised
from calib.core.linear_algebra import solve_square
from designer.base.arrays import Array

LENS = slice(4, 16)
LARGEST_RAD = 1.2
"""Of a tilt; beyond, hardly any light of a picture reaches the sensor."""


@dataclass(frozen=True)
class TiltedModel:
    """`opencv12` on a tilted sensor."""

    name: str = "opencv14"
    remedy: str = UPRIGHT.remedy
    parameters: tuple[LensParameter, ...] = (
        *UPRIGHT.parameters,
        *(LensParameter(name, "rad", lower=-LARGEST_RAD, upper=LARGEST_RAD) for name in ("tau_x", "tau_y")),
    )
    opencv_lens: tuple[str, ...] | None = (*(UPRIGHT.opencv_lens or ()), "tau_x", "tau_y")

    def rays(self, camera: Camera, pixel: Array) -> Array:
        """Unit directions (..., 3) at pixels (..., 2); nan where there is none."""
        tilt, _ = _tilt(*camera.params[16:])
        place = (np.asarray(pixel, dtype=np.float64) - camera.params[2:4]) / camera.params[:2]
        return UPRIGHT.rays(_upright(camera), _imaged(solve_square(tilt, np.eye(3)), place))

    def project(self, camera: Camera, point: Array) -> Array:
        """Pixels (..., 2); nan behind the camera and where there is none."""
        tilt, _ = _tilt(*camera.params[16:])
        pixel: Array = camera.params[:2] * _imaged(tilt, UPRIGHT.project(_upright(camera), point)) + camera.params[2:4]
        return pixel

    def linearise(self, camera: Camera, point: Array) -> Linearised:
        """Pixels of points (3, N) with their derivatives."""
        upright = UPRIGHT.linearise(_upright(camera), point)
        tilt, by_tilt = _tilt(*camera.params[16:])
        flat = np.concatenate([upright.pixel, np.ones((1, point.shape[1]))])
        moved = tilt @ flat
        depth = np.where(moved[2] > 0, moved[2], np.nan)
        place = moved[:2] / depth
        # Of a quotient: (d moved - place d depth) / depth.
        slope = (tilt[:2, :2, None] - place[:, None] * tilt[2, :2, None]) / depth
        by_angle = by_tilt @ flat
        by_angle = (by_angle[:, :2] - place * by_angle[:, 2:]) / depth
        focal = camera.params[:2, None]
        by_params = np.zeros((2, 18, point.shape[1]))
        by_params[0, 0], by_params[1, 1] = place
        by_params[0, 2] = by_params[1, 3] = 1.0 + 0.0 * depth
        by_params[:, LENS] = focal[:, None] * np.einsum("ijn,jkn->ikn", slope, upright.by_params[:, LENS])
        by_params[:, 16:] = focal[:, None] * by_angle.transpose(1, 0, 2)
        by_point = focal[:, None] * np.einsum("ijn,jkn->ikn", slope, upright.by_point)
        return Linearised.of(focal * place + camera.params[2:4, None], by_point, by_params)


@lru_cache(maxsize=4)
def _upright(camera: Camera) -> Camera:
    """The lens alone, with a focal length of 1 on a sensor that is not tilted."""
    return Camera(UPRIGHT.name, np.concatenate([[1.0, 1.0, 0.0, 0.0], camera.params[LENS]]), camera.image_size)


def _tilt(tau_x: float, tau_y: float) -> tuple[Array, Array]:
    """What takes (a, b, 1) to the tilted sensor (3, 3), and its derivatives by the two angles (2, 3, 3)."""
    (cx, sx), (cy, sy) = ((np.cos(one), np.sin(one)) for one in (tau_x, tau_y))
    about_x, by_x = np.array([[1, 0, 0], [0, cx, sx], [0, -sx, cx]]), np.array([[0, 0, 0], [0, -sx, cx], [0, -cx, -sx]])
    about_y, by_y = np.array([[cy, 0, -sy], [0, 1, 0], [sy, 0, cy]]), np.array([[-sy, 0, -cy], [0, 0, 0], [cy, 0, -sy]])
    turn, turns = about_y @ about_x, np.stack([about_y @ by_x, by_y @ about_x])

    def back(one: Array, last: float) -> Array:
        return np.array([[one[2, 2], 0, -one[0, 2]], [0, one[2, 2], -one[1, 2]], [0, 0, last]])

    return back(turn, 1.0) @ turn, np.stack([back(each, 0.0) @ turn + back(turn, 1.0) @ each for each in turns])


def _imaged(matrix: Array, place: Array) -> Array:
    """Points (..., 2) moved by a homography; nan beyond its horizon."""
    x, y = place[..., 0], place[..., 1]
    a, b, depth = (row[0] * x + row[1] * y + row[2] for row in matrix)
    return np.stack([a, b], axis=-1) / np.where(depth > 0, depth, np.nan)[..., None]


MODEL = TiltedModel()
