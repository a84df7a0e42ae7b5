"""What camera models are made of: their parameters, their derivatives, and compiled kernels called alike."""

from collections.abc import Callable
from dataclasses import dataclass
from functools import lru_cache
from math import inf, prod

import numpy as np

from calib.cameras.camera import Camera
from calib.core.jit import jit, jit_sums
from designer.base.arrays import Array

AT_ONCE = 128
"""Points whose pixels and derivatives are worked out together, in one flat array of rows of this length: the compiler
can tell that its rows do not overlap, and then takes several points at once."""


@dataclass(frozen=True)
class LensParameter:
    """One number of a camera model."""

    name: str
    unit: str  # "px", "rad", or "1" for a plain number
    lower: float = -inf  # not allowed below, nor at a lower bound of 0
    upper: float = inf
    neutral: float = 0.0  # of a lens that does nothing
    is_control: bool = False  # one of the hundreds of a surface, which mean nothing one by one


FOCAL_AND_CENTRE = (
    LensParameter("fx_px", "px", lower=0.0),
    LensParameter("fy_px", "px", lower=0.0),
    LensParameter("cx_px", "px"),
    LensParameter("cy_px", "px"),
)
"""What every model begins with."""


@dataclass(frozen=True, eq=False)
class Linearised:
    """Pixels and their derivatives, stored coordinate by coordinate so that a processor takes many points at once."""

    rows: Array  # (2 + 6 + 2 P, N) the three below, one after the other

    @staticmethod
    def of(pixel: Array, by_point: Array, by_params: Array) -> "Linearised":
        """From the three.  # (2, N), (2, 3, N), (2, P, N)"""
        count = pixel.shape[-1]
        return Linearised(
            np.concatenate([part.reshape(prod(part.shape[:-1]), count) for part in (pixel, by_point, by_params)])
        )

    @property
    def pixel(self) -> Array:
        """The pixels.  # (2, N)"""
        return self.rows[:2]

    @property
    def by_point(self) -> Array:
        """Derivative by the point in the camera frame.  # (2, 3, N)"""
        return self.rows[2:8].reshape(2, 3, -1)

    @property
    def by_params(self) -> Array:
        """Derivative by the parameters.  # (2, P, N)"""
        return self.rows[8:].reshape(2, len(self.rows) // 2 - 4, -1)


@dataclass(frozen=True)
class CompiledModel:
    """A model (see `calib.cameras.CameraModel`) of compiled kernels.

    A kernel takes the parameters, what `lens` makes of the camera, what comes in and what is to be filled: flat arrays,
    points and directions of any length (N, 3) and pixels (N, 2); for derivatives points (3, N) and the rows of
    `Linearised`.
    """

    name: str
    remedy: str
    parameters: tuple[LensParameter, ...]
    fill_rays: Callable[..., None]
    fill_pixels: Callable[..., None]
    fill_linear: Callable[..., None]
    lens: Callable[[Camera], tuple[object, ...]]
    opencv_lens: tuple[str, ...] | None = None

    def rays(self, camera: Camera, pixel: Array) -> Array:
        """Unit directions (..., 3) at pixels (..., 2); nan where there is none."""
        flat = _read_only(np.ascontiguousarray(pixel, dtype=np.float64).reshape(-1, 2))
        ray = np.empty((len(flat), 3))
        self.fill_rays(camera.params, *_seen_through(self.lens, camera), flat, ray)
        to_unit(ray)
        return ray.reshape(*np.shape(pixel)[:-1], 3)

    def project(self, camera: Camera, point: Array) -> Array:
        """Pixels (..., 2) of points (..., 3); nan behind the camera and where there is none."""
        flat = _read_only(np.ascontiguousarray(point, dtype=np.float64).reshape(-1, 3))
        pixel = np.empty((len(flat), 2))
        self.fill_pixels(camera.params, *_seen_through(self.lens, camera), flat, pixel)
        return pixel.reshape(*np.shape(point)[:-1], 2)

    def linearise(self, camera: Camera, point: Array) -> Linearised:
        """Pixels of points (3, N) with their derivatives."""
        rows = np.empty((8 + 2 * len(self.parameters), point.shape[1]))
        self.fill_linear(
            camera.params, *_seen_through(self.lens, camera), np.ascontiguousarray(point, dtype=np.float64), rows
        )
        return Linearised(rows)


@lru_cache(maxsize=4)
def _seen_through(lens: Callable[[Camera], tuple[object, ...]], camera: Camera) -> tuple[object, ...]:
    """What a model makes of a camera: a solver asks for it chunk by chunk, and finding a fold takes as long as one."""
    return lens(camera)


def _read_only(array: Array) -> Array:
    """A view that is read-only, whatever the array is: kernels are compiled again for the other kind."""
    view = array.view()
    view.flags.writeable = False
    return view


@jit
def to_unit(ray: Array) -> None:
    """Bring directions (N, 3) to a length of one."""
    for n in range(len(ray)):
        x, y, z = ray[n, 0], ray[n, 1], ray[n, 2]
        inverse = 1.0 / np.sqrt(x * x + y * y + z * z)
        ray[n, 0], ray[n, 1], ray[n, 2] = x * inverse, y * inverse, z * inverse


def slopes(ray: Array) -> Array:
    """Where directions (..., 3) meet the plane z = 1 (..., 2); nan of those that do not, or are not known."""
    depth = ray[..., 2:]
    slope: Array = ray[..., :2] / np.where(depth > 0, depth, np.nan)
    return slope


@jit_sums
def keep_rows(rows: Array, begin: int, count: int, kept: Array) -> None:
    """Put the first numbers of each row of `AT_ONCE` where they belong.  # (R AT_ONCE,) into (R, N)"""
    for row in range(len(kept)):
        source, target = rows[row * AT_ONCE : row * AT_ONCE + count], kept[row, begin : begin + count]
        for k in range(count):
            target[k] = source[k]
