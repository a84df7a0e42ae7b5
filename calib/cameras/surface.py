"""A camera whose image is displaced by a smooth surface: another model, and what it does not follow.

`u = p + sum_rc B_r(p_v) B_c(p_u) d_rc` with the pixel `p` that the base, a model of few parameters, shows a point at,
and displacements `d_rc` in px at rows x columns of control points of uniform cubic B-splines (de Boor, A Practical
Guide to Splines, 1978), whose domain is the image and a margin around it. Each pixel depends on 16 control points.
"""

from dataclasses import dataclass

import numpy as np

from calib.cameras import MODELS, CameraModel, linearise
from calib.cameras.camera import Camera
from calib.cameras.parameters import LensParameter, Linearised
from calib.core.jit import jit
from designer.base.arrays import Array, Rows

DEGREE = 3
MARGIN = 0.1
"""Of a side of the image, on both ends: the domain of the splines beyond it."""
MAX_STEPS = 60
TOLERANCE_PX = 1e-11
ACCEPTED_PX = 1e-6
"""A larger residual of the inverse means that there is none."""


@jit
def _basis(place: float, count: int, weight: Array, slope: Array) -> int:
    """The first of the four control points of `count` that count at a place, their weights and the slopes of these.

    -1 outside of the domain [0, count - 3].
    """
    spans = count - DEGREE
    if not 0 <= place <= spans:
        return -1
    first = min(int(place), spans - 1)
    t = place - first
    s = 1 - t
    weight[0], weight[1] = s * s * s / 6, (3 * t * t * t - 6 * t * t + 4) / 6
    weight[2], weight[3] = (3 * s * s * s - 6 * s * s + 4) / 6, t * t * t / 6
    slope[0], slope[1] = -0.5 * s * s, 1.5 * t * t - 2 * t
    slope[2], slope[3] = 2 * s - 1.5 * s * s, 0.5 * t * t
    return first


@jit
def _displaced(control: Array, scale: Array, a: float, b: float, work: Array, out: Array) -> tuple[int, int]:
    """Where the base's pixel (a, b) is seen, and the derivatives: `out` = u, v, u by a, u by b, v by a, v by b.

    `work` (4, 4) holds afterwards weights and slopes of columns and of rows. (-1, -1), and nan, outside of the domain.
    """
    column = _basis((a - scale[0, 0]) * scale[0, 1], control.shape[2], work[0], work[1])
    row = _basis((b - scale[1, 0]) * scale[1, 1], control.shape[1], work[2], work[3])
    if column < 0 or row < 0:
        out[:] = np.nan
        return -1, -1
    out[0], out[1], out[2], out[3], out[4], out[5] = a, b, 1.0, 0.0, 0.0, 1.0
    for j in range(4):
        for i in range(4):
            du, dv = control[0, row + j, column + i], control[1, row + j, column + i]
            both = work[0, i] * work[2, j]
            by_a, by_b = work[1, i] * work[2, j] * scale[0, 1], work[0, i] * work[3, j] * scale[1, 1]
            out[0] += both * du
            out[1] += both * dv
            out[2] += by_a * du
            out[3] += by_b * du
            out[4] += by_a * dv
            out[5] += by_b * dv
    return column, row


@jit
def _displace(control: Array, scale: Array, pixel: Array) -> None:
    """Take pixels (N, 2) of the base to where they are seen."""
    work, out = np.empty((4, 4)), np.empty(6)
    for n in range(len(pixel)):
        _displaced(control, scale, pixel[n, 0], pixel[n, 1], work, out)
        pixel[n, 0], pixel[n, 1] = out[0], out[1]


@jit
def _take_back(control: Array, scale: Array, pixel: Array) -> None:
    """Take pixels (N, 2) to those of the base: Newton's method from the pixel itself."""
    work, out = np.empty((4, 4)), np.empty(6)
    for n in range(len(pixel)):
        a, b, left = pixel[n, 0], pixel[n, 1], np.inf
        for _ in range(MAX_STEPS):
            _displaced(control, scale, a, b, work, out)
            e, f = out[0] - pixel[n, 0], out[1] - pixel[n, 1]
            last, left = left, abs(e) + abs(f)
            if not left > TOLERANCE_PX or (last <= left < ACCEPTED_PX):
                break
            determinant = out[2] * out[5] - out[3] * out[4]
            a -= (out[5] * e - out[3] * f) / determinant
            b -= (out[2] * f - out[4] * e) / determinant
        pixel[n, 0], pixel[n, 1] = (a, b) if left < ACCEPTED_PX else (np.nan, np.nan)


@jit
def _chain(control: Array, scale: Array, rows: Array, first: Rows, weight: Array) -> None:
    """Turn the base's rows of `Linearised` into those of the displaced image; where and how control points count."""
    work, out = np.empty((4, 4)), np.empty(6)
    others = rows.shape[0] // 2 - 4
    for n in range(rows.shape[1]):
        column, row = _displaced(control, scale, rows[0, n], rows[1, n], work, out)
        first[0, n], first[1, n] = row, column
        weight[:4, n], weight[4:, n] = work[2], work[0]
        rows[0, n], rows[1, n] = out[0], out[1]
        for k in range(3 + others):
            u, v = (2 + k, 5 + k) if k < 3 else (5 + k, 5 + k + others)
            a, b = rows[u, n], rows[v, n]
            rows[u, n], rows[v, n] = out[2] * a + out[3] * b, out[4] * a + out[5] * b


@jit
def _scatter(first: Rows, weight: Array, by_control: Array) -> None:
    """Derivatives by all control points (2, 2, R, C, N), zero before."""
    for n in range(first.shape[1]):
        row, column = first[0, n], first[1, n]
        if row >= 0:
            for j in range(4):
                for i in range(4):
                    both = weight[j, n] * weight[4 + i, n]
                    by_control[0, 0, row + j, column + i, n] = both
                    by_control[1, 1, row + j, column + i, n] = both


@dataclass(frozen=True, eq=False)
class LocalLinearised:
    """Pixels of points and their derivatives, without the zeros of the control points that do not count."""

    rows: Array  # (2 + 6 + 2 B, N) see `Linearised`, by the B parameters of the base alone
    first: Rows  # (2, N) row and column of the first of 4 x 4 control points; -1: no image
    weight: Array  # (8, N) of four rows, then of four columns; the products are the derivatives of u by u's, v by v's


@dataclass(frozen=True)
class SurfaceModel:
    """A model (see `calib.cameras.CameraModel`) of a base and a surface over its image."""

    name: str
    remedy: str
    base: CameraModel
    control_rows: int
    control_columns: int
    parameters: tuple[LensParameter, ...]
    opencv_lens: tuple[str, ...] | None = None

    @classmethod
    def over(cls, base: CameraModel, name: str, *, rows: int, columns: int) -> "SurfaceModel":
        """The model with so many control points over a base."""
        control = (
            LensParameter(f"d{axis}_row{row}_column{column}_px", "px", is_control=True)
            for axis in "uv"
            for row in range(rows)
            for column in range(columns)
        )
        return cls(name, "show the target there too", base, rows, columns, (*base.parameters, *control))

    @property
    def first_control(self) -> int:
        """The first control point among the parameters; those before it are the base's."""
        return len(self.base.parameters)

    def base_camera(self, camera: Camera) -> Camera:
        """The camera without its surface."""
        return Camera(self.base.name, camera.params[: self.first_control], camera.image_size)

    def control_px(self, camera: Camera) -> Array:
        """The displacements (2, R, C)."""
        return camera.params[self.first_control :].reshape(2, self.control_rows, self.control_columns)

    def scale(self, image_size: tuple[int, int]) -> Array:
        """First pixel of the domain and spans per pixel, across and down.  # (2, 2)"""
        counts = self.control_columns, self.control_rows
        return np.array([
            (-0.5 - MARGIN * side, (count - DEGREE) / (side * (1 + 2 * MARGIN)))
            for side, count in zip(image_size, counts, strict=True)
        ])  # fmt: skip

    def rays(self, camera: Camera, pixel: Array) -> Array:
        """Unit directions (..., 3) at pixels (..., 2); nan where there is none."""
        there = np.array(pixel, dtype=np.float64, order="C")
        _take_back(self.control_px(camera), self.scale(camera.image_size), there.reshape(-1, 2))
        return self.base.rays(self.base_camera(camera), there)

    def project(self, camera: Camera, point: Array) -> Array:
        """Pixels (..., 2) of points (..., 3); nan where there is none."""
        pixel = np.ascontiguousarray(self.base.project(self.base_camera(camera), point))
        _displace(self.control_px(camera), self.scale(camera.image_size), pixel.reshape(-1, 2))
        return pixel

    def linearise(self, camera: Camera, point: Array) -> Linearised:
        """Pixels of points (3, N) with their derivatives."""
        local, first = self.linearise_locally(camera, point), self.first_control
        count, control = point.shape[1], len(self.parameters) - first
        rows = np.zeros((8 + 2 * len(self.parameters), count))
        rows[:8] = local.rows[:8]
        by_params = rows[8:].reshape(2, len(self.parameters), count)
        by_params[:, :first] = local.rows[8:].reshape(2, first, count)
        by_control = np.zeros((2, 2, self.control_rows, self.control_columns, count))
        _scatter(local.first, local.weight, by_control)
        by_params[:, first:] = by_control.reshape(2, control, count)
        return Linearised(rows)

    def linearise_points(self, camera: Camera, point: Array) -> Linearised:
        """The same by the points (3, N) alone, as of a camera without parameters."""
        return Linearised(self.linearise_locally(camera, point).rows[:8])

    def linearise_locally(self, camera: Camera, point: Array) -> LocalLinearised:
        """The same without the zeros."""
        rows = self.base.linearise(self.base_camera(camera), point).rows
        first, weight = np.empty((2, point.shape[1]), dtype=np.int64), np.empty((8, point.shape[1]))
        _chain(self.control_px(camera), self.scale(camera.image_size), rows, first, weight)
        return LocalLinearised(rows, first, weight)


def surface_model(name: str) -> SurfaceModel | None:
    """The model of a name, if it has a surface."""
    model = MODELS[name]
    return model if isinstance(model, SurfaceModel) else None


def linearise_points(camera: Camera, point: Array) -> Linearised:
    """Pixels of points (3, N) with their derivatives by the points; by hundreds of parameters they would take long."""
    model = surface_model(camera.model)
    return linearise(camera, point) if model is None else model.linearise_points(camera, point)
