"""mrcal's splined stereographic lens: a B-spline surface over the field of view.

A direction at the angle theta off the axis has `u = 2 tan(theta / 2) (x, y) / |(x, y)|`, and is seen at
`q = f (u + D(u)) + c`. D is a uniform B-spline surface of degree `order`, 2 or 3, with Nx x Ny control points (x, y),
row by row, symmetric about u = 0; along x all but `order` of their distances cover `fov_x_deg`, along y they are as
long (mrcal's documentation, Splined stereographic lens models).

Any camera whose rays meet in a point is held by control points of least squares, which are linear equations.

CAHVOR and CAHVORE as mrcal has them.

A direction at the angle theta off the optical axis o, `o = (sin a cos b, sin b, cos a cos b)`, is shown at
`chi (1 + r0 + r1 chi^2 + r2 chi^4)` from where o is, in a plane across o at a distance of one, with the linearity L and
`chi = tan(L theta) / L`, theta for L = 0, `sin(L theta) / L` for L < 0; CAHVOR has L = 1. From there it goes by a
pinhole's fx fy cx cy to the image (mrcal's documentation, Camera models, and its cahvore.cc). With e0, e1 or e2 the
rays of CAHVORE do not meet in a point.
"""

import math
import re
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from calib.cameras import rays
from calib.cameras.camera import Camera
from calib.cameras.formats.format import FileLens, ReadCamera
from calib.cameras.formats.lens import Complex, fit_foreign, inverse_of, lens_camera, slopes_of
from calib.cameras.formats.parsing import number, numbers
from calib.cameras.refit import Refit, image_grid
from calib.core.linear_algebra import least_squares
from calib.core.se3 import rotation_between
from designer.base.arrays import Array, Flags, Rows
from designer.base.errors import InputError
from designer.base.words import shown

SPLINED = "LENSMODEL_SPLINED_STEREOGRAPHIC"
_NAME = re.compile(rf"{SPLINED}_order=([23])_Nx=(\d{{1,4}})_Ny=(\d{{1,4}})_fov_x_deg=(\d{{1,3}}(?:\.\d+)?)")

ORDER, COLUMNS = 3, 30
"""Of what is written: the degree, and the control points along the longer side, as in mrcal's documentation."""
CHECKED_COLUMNS = 71
"""Of pixels at which what is left over is looked at, which are others than those of the fit."""
NOT_BEHIND, MIN_PIXELS = -0.9999, 20
"""Depth of a ray of length one from which u runs away; and how many pixels need to have light."""
MOST_CONTROL_POINTS = 10_000
SMOOTH = 1e-4
"""Weight of second differences, which carry the surface on to where the image shows nothing."""
PER_CELL = 3
"""Pixels looked at from one control point to the next."""


@dataclass(frozen=True, eq=False)
class StereographicSurface:
    """A lens of mrcal."""

    order: int
    fov_x_deg: float
    linear: tuple[float, float, float, float]  # fx fy cx cy
    control: Array  # (Ny, Nx, 2)

    @property
    def spacing(self) -> float:
        """Of the control points, in u."""
        return spacing_of(self.control.shape[1], self.order, self.fov_x_deg)

    @property
    def numbers(self) -> tuple[str, list[float]]:
        """What the file calls it, and its numbers."""
        rows, columns = self.control.shape[:2]
        name = f"{SPLINED}_order={self.order}_Nx={columns}_Ny={rows}_fov_x_deg={self.fov_x_deg:g}"
        return name, [*self.linear, *self.control.ravel().tolist()]

    def shifted(self, x: Complex, y: Complex) -> tuple[Complex, Complex]:
        """Where u is shown, u + D(u)."""
        rows, columns = self.control.shape[:2]
        flat = self.control.reshape(-1, 2)
        (i, along_x), (j, along_y) = self._cell(x, columns), self._cell(y, rows)
        a, b = x.copy(), y.copy()
        for m, by_y in enumerate(along_y):
            for n, by_x in enumerate(along_x):
                point = flat[(j + m) * columns + i + n]
                a, b = a + by_y * by_x * point[:, 0], b + by_y * by_x * point[:, 1]
        return a, b

    def rays(self, pixel: Array) -> Array:
        """Directions (N, 3) at pixels (N, 2), of any length; nan where the surface shows none."""
        x, y = inverse_of(self.shifted, *slopes_of(pixel, self.linear))
        x = np.where(self.is_inside(x, y), x, np.nan)
        return np.column_stack([x, y, 1 - 0.25 * (x * x + y * y)])

    def is_inside(self, x: Array, y: Array) -> Flags:
        """Whether the surface is defined there."""
        margin = 0.5 * (self.order - 1)
        limits = [(0.5 * (count - 1) - margin) * self.spacing for count in self.control.shape[1::-1]]
        inside: Flags = (np.abs(x) <= limits[0]) & (np.abs(y) <= limits[1])
        return inside

    def _cell(self, u: Complex, count: int) -> tuple[Rows, list[Complex]]:
        """The first control point that counts, and the weights of it and of those that follow."""
        place = u / self.spacing + 0.5 * (count - 1)
        return _weights(place, count, self.order)


def spacing_of(columns: int, order: int, fov_x_deg: float) -> float:
    """The distance of the control points, in u."""
    return 4 * math.tan(math.radians(fov_x_deg) / 4) / (columns - order)


def _weights(place: Complex, count: int, order: int) -> tuple[Rows, list[Complex]]:
    """The first of the control points that count at a place among them, and the weights of it and of those after it."""
    if order == 2:
        middle = np.clip(np.rint(place.real), 1, count - 2).astype(np.int64)
        t = place - middle
        return middle - 1, [0.5 * (0.5 - t) * (0.5 - t), 0.75 - t * t, 0.5 * (0.5 + t) * (0.5 + t)]
    before = np.clip(np.floor(place.real), 1, count - 3).astype(np.int64)
    t = place - before
    s = 1 - t
    inner = [(4 - 3 * a * a * (1 + b)) / 6 for a, b in ((t, s), (s, t))]
    return before - 1, [s * s * s / 6, *inner, t * t * t / 6]


def surface_of(camera: Camera) -> StereographicSurface:
    """The surface that comes nearest to a camera.

    Raises:
        InputError: the camera has hardly any rays.
    """
    pixel, u = _seen(camera, PER_CELL * COLUMNS)
    least = np.ones(len(u))
    (fx, cx), (fy, cy) = (least_squares(np.column_stack([u[:, axis], least]), pixel[:, axis]) for axis in range(2))
    reach = np.abs(u).max(axis=0)
    if camera.field_rad is not None:  # beyond an image circle, as far as the surface reaches, its model goes on
        pixel, u = _seen(replace(camera, field_rad=None), PER_CELL * COLUMNS)
        is_near = (np.abs(u) <= reach).all(axis=1)
        pixel, u = pixel[is_near], u[is_near]
    columns = _count(reach[0], 2 * reach.max() / (COLUMNS - ORDER))
    fov_x_deg = math.ceil(math.degrees(4 * math.atan(reach[0] / 2)))  # a whole number: mrcal takes no other
    spacing = spacing_of(columns, ORDER, fov_x_deg)
    rows = _count(reach[1], spacing)
    off = (pixel - [cx, cy]) / [fx, fy] - u
    design = _design(u / spacing + 0.5 * np.array([columns - 1, rows - 1]), columns, rows)
    bend = SMOOTH * _second_differences(columns, rows)
    control = np.linalg.solve(design.T @ design + bend.T @ bend, design.T @ off)
    linear = (float(fx), float(fy), float(cx), float(cy))
    return StereographicSurface(ORDER, fov_x_deg, linear, control.reshape(rows, columns, 2))


def nearest_surface(camera: Camera) -> Refit:
    """What that surface leaves over."""
    surface = surface_of(camera)
    pixel, u = _seen(camera, CHECKED_COLUMNS)
    fx, fy, cx, cy = surface.linear
    x, y = surface.shifted(u[:, 0].astype(np.complex128), u[:, 1].astype(np.complex128))
    off = np.hypot(fx * x.real + cx - pixel[:, 0], fy * y.real + cy - pixel[:, 1])
    known = len(pixel) / image_grid(camera.image_size, CHECKED_COLUMNS)[..., 0].size
    return Refit(camera, np.eye(3), float(np.sqrt(np.mean(off**2))), float(off.max()), known)


def read_surface(name: str, given: object, image_size: tuple[int, int], origin: str) -> ReadCamera:
    """The camera nearest to one of a file's name and numbers."""
    surface = surface_named(name, given, origin)
    return fit_foreign(surface.rays, surface.linear, image_size, "its splined lens", origin)


def surface_named(name: str, given: object, origin: str) -> StereographicSurface:
    """The surface of a file's name and numbers, which are fx fy cx cy and the control points.

    Raises:
        InputError: a name that is none, or another count of numbers.
    """
    found = _NAME.fullmatch(name)
    if found is None:
        raise InputError(f"{origin}: lens model {shown(name)}: must be {SPLINED}_order=3_Nx=30_Ny=20_fov_x_deg=170")
    order, columns, rows = (int(found[part]) for part in (1, 2, 3))
    fov_x_deg = float(found[4])
    if min(columns, rows) <= order or columns * rows > MOST_CONTROL_POINTS or not 0 < fov_x_deg < 360:
        raise InputError(
            f"{origin}: lens model {shown(name)}: Nx and Ny must be more than {order}, their product at most "
            f"{MOST_CONTROL_POINTS}, and fov_x_deg more than 0 and less than 360"
        )
    fx, fy, cx, cy, *rest = numbers(given, "intrinsics", origin, (4 + 2 * columns * rows,))
    return StereographicSurface(order, fov_x_deg, (fx, fy, cx, cy), np.reshape(rest, (rows, columns, 2)))


def _seen(camera: Camera, columns: int) -> tuple[Array, Array]:
    """Pixels (N, 2) with light, and where it comes from, as u (N, 2)."""
    pixel = image_grid(camera.image_size, columns).reshape(-1, 2)
    ray = rays(camera, pixel)
    known = ray[:, 2] > NOT_BEHIND
    if known.sum() < MIN_PIXELS:
        raise InputError(f"the camera has rays at {known.sum()} of {len(ray)} pixels looked at; check its parameters")
    return pixel[known], 2 * ray[known, :2] / (1 + ray[known, 2:])


def _count(reach: float, spacing: float) -> int:
    """How many control points cover u from -reach to reach."""
    return ORDER + max(1, math.ceil(2 * reach / spacing))


def _design(place: Array, columns: int, rows: int) -> Array:
    """What each control point has to do with each place among them.  # (N, 2) -> (N, rows columns)"""
    design = np.zeros((len(place), rows * columns))
    (i, along_x), (j, along_y) = (
        _weights(place[:, k].astype(np.complex128), n, ORDER) for k, n in enumerate((columns, rows))
    )
    for m, by_y in enumerate(along_y):
        for n, by_x in enumerate(along_x):
            design[np.arange(len(place)), (j + m) * columns + i + n] = (by_y * by_x).real
    return design


def _second_differences(columns: int, rows: int) -> Array:
    """Of control points, along rows and columns.  # (K, rows columns)"""
    along_x, along_y = (np.diff(np.eye(count), 2, axis=0) for count in (columns, rows))
    return np.vstack([np.kron(np.eye(rows), along_x), np.kron(along_y, np.eye(columns))])


CAHVOR = "LENSMODEL_CAHVOR"
CAHVORE = "LENSMODEL_CAHVORE_linearity="
ON_AXIS = (FileLens(CAHVOR, "opencv", "fx fy cx cy k1 k2"), FileLens(CAHVORE, "fisheye", "fx fy cx cy k1 k2"))
"""Both with the optical axis across the image, by their linearity: 1, 0."""


def read_cahvore(name: str, given: object, image_size: tuple[int, int], origin: str) -> ReadCamera:
    """The camera of a file's numbers: fx fy cx cy, then a b r0 r1 r2, then e0 e1 e2 of CAHVORE."""
    linearity = 1.0 if name == CAHVOR else number(name.removeprefix(CAHVORE), "linearity", origin)
    if not -1 <= linearity <= 1:
        raise InputError(f"{origin}: linearity {linearity:g}: must be from -1 to 1")
    fx, fy, cx, cy, *lens = numbers(given, "intrinsics", origin, (9,) if name == CAHVOR else (12,))
    alpha, beta, r0, r1, r2, *moves = lens
    if any(moves):
        raise InputError(
            f"{origin}: {shown(name)} with e0 e1 e2: its rays do not meet in a point, as those of a camera here do; "
            "calibrate with a central model, such as LENSMODEL_CAHVORE with e0 e1 e2 at 0"
        )
    scale = 1 + r0
    if not scale > 0:
        raise InputError(f"{origin}: r0 {r0:g}: must be more than -1")
    if not (alpha or beta) and linearity in (0.0, 1.0):
        on_axis = ON_AXIS[linearity == 0]
        return lens_camera(on_axis, [scale * fx, scale * fy, cx, cy, r1 / scale, r2 / scale], image_size, origin)
    linear = (fx, fy, cx, cy)
    what = f"its lens {name}"
    return fit_foreign(lambda pixel: cahvore_rays(pixel, linear, lens, linearity), linear, image_size, what, origin)


def cahvore_rays(pixel: Array, linear: Sequence[float], lens: Sequence[float], linearity: float) -> Array:
    """Directions (N, 3) at pixels (N, 2), by fx fy cx cy, by a b r0 r1 r2 and by the linearity; nan where none is."""
    alpha, beta, r0, r1, r2 = lens[:5]
    axis = np.array([np.sin(alpha) * np.cos(beta), np.sin(beta), np.cos(alpha) * np.cos(beta)])
    from_axis = rotation_between(np.array([0.0, 0.0, 1.0]), axis)

    def distort(x: Complex, y: Complex) -> tuple[Complex, Complex]:
        s = x * x + y * y
        mu = 1 + r0 + s * (r1 + s * r2)
        return x * mu, y * mu

    x, y = slopes_of(pixel, linear)
    shown_at = np.column_stack([x, y, np.ones_like(x)]) @ from_axis
    depth = np.where(shown_at[:, 2] > 0, shown_at[:, 2], np.nan)
    a, b = inverse_of(distort, shown_at[:, 0] / depth, shown_at[:, 1] / depth)
    chi = np.hypot(a, b)
    theta = _angle(chi, linearity)
    aside = np.where(chi > 0, np.sin(theta) / np.where(chi > 0, chi, 1.0), 1.0)
    ray: Array = np.column_stack([aside * a, aside * b, np.cos(theta)]) @ from_axis.T
    return ray


def _angle(chi: Array, linearity: float) -> Array:
    """The angle off the optical axis of a distance chi; nan where there is none."""
    if linearity == 0:
        return np.where(chi < np.pi, chi, np.nan)
    return np.asarray((np.arctan if linearity > 0 else np.arcsin)(linearity * chi) / linearity)
