"""Lenses that displace points of a plane: radially by a quotient of polynomials, by their decentring and tilted parts.

`D(x, y) = (x, y) R(s) + (2 p1 xy + p2 (s + 2x^2) + s1 s + s2 s^2, p1 (s + 2y^2) + 2 p2 xy + s3 s + s4 s^2)` with
`s = x^2 + y^2` and `R(s) = (1 + a1 s + a2 s^2 + a3 s^3 + a4 s^4) / (1 + b1 s + b2 s^2 + b3 s^3)`
(Brown 1966; the quotient and the thin prism, s1 to s4, as in OpenCV's documentation of calib3d).
The plane is z = 1, so that (x, y) = (X, Y) / Z, or that of angles off the axis: (x, y) = (X, Y) theta / rho with
`rho^2 = X^2 + Y^2` and `theta = atan2(rho, Z)`, which holds what comes from the side and from behind.

`D` is kept where it is one-to-one: short of the first radius at which its radial part ceases to grow or has a pole, and
in each direction up to where its Jacobian J ceases to have `det J > 0` and `trace J > 0`.
"""

import math

import numpy as np

from calib.cameras.camera import Camera
from calib.cameras.parameters import AT_ONCE, FOCAL_AND_CENTRE, CompiledModel, LensParameter
from calib.cameras.polynomial import first_change, value_at
from calib.core.jit import jit, jit_sums
from designer.base.arrays import Array, Rows

TERMS = ("a1", "a2", "a3", "a4", "b1", "b2", "b3", "p1", "p2", "s1", "s2", "s3", "s4")
"""What a lens's parameters stand for."""
OVER, UNDER, DECENTRED, PRISM = 0, 4, 7, 9
"""The first of TERMS of each kind: of the numerator, the denominator, and the two others."""

MOST_STEPS = 60
TOLERANCE = 5e-16
ACCEPTED_RESIDUAL = 1e-12
"""A larger residual of the inverse, relative to the radius, means that there is no inverse."""
SAMPLES = 32
"""Of the way from the centre on which a lens may fold, evenly in the angle of the tangent."""
NEAR_AXIS = 1e-8
"""Tangent of an angle at which an angle and its tangent are one in floating point."""


def displaced_model(
    name: str,
    remedy: str,
    lens: tuple[tuple[str, str], ...],
    *,
    is_angular: bool = False,
    has_opencv_lens: bool = False,
) -> CompiledModel:
    """The model whose lens's parameters have these names and stand for these of TERMS, over one of the two planes."""
    names, stands_for = zip(*lens, strict=True)
    term = np.array([TERMS.index(one) for one in stands_for])

    def limited(camera: Camera) -> tuple[Array, float, float, Rows, bool]:
        coefficients = np.zeros(len(TERMS))
        coefficients[term] = camera.params[len(FOCAL_AND_CENTRE) :]
        return coefficients, *limits(coefficients, math.pi**2 if is_angular else np.inf), term, is_angular

    return CompiledModel(
        name=name,
        remedy=remedy,
        parameters=(*FOCAL_AND_CENTRE, *(LensParameter(one, "1") for one in names)),
        opencv_lens=names if has_opencv_lens else None,
        lens=limited,
        fill_rays=_rays,
        fill_pixels=_project,
        fill_linear=_linearise,
    )


@jit
def limits(c: Array, most: float) -> tuple[float, float]:
    """Squares of radii: up to which D is one-to-one in all directions, and up to which it may be; at most a given one.

    Up to the second, the radial part grows and has no pole: with R = A / B, `d/dr (r R) = (A B + 2 s (A' B - A B')) /
    B^2`. Of its Jacobian, which is symmetric, this is the least eigenvalue, or R, which is its mean up to there. Where
    it is more than the norm of all other parts' Jacobian can be, `J + J'` is positive definite.
    """
    over, under = np.array([1.0, c[0], c[1], c[2], c[3]]), np.array([1.0, c[4], c[5], c[6]])
    growth = np.zeros(8)
    for i in range(5):
        for j in range(4):
            growth[i + j] += (1 + 2 * (i - j)) * over[i] * under[j]
    last = min(most, first_change(growth), first_change(under))
    decentred = 6 * math.hypot(c[7], c[8]) + 2 * math.hypot(c[9], c[11])
    prism = 4 * math.hypot(c[10], c[12])
    if decentred == 0 and prism == 0:
        return last, last
    sure, least = 0.0, 1.0
    for k in range(1, SAMPLES):
        radius = math.tan(k / SAMPLES * math.atan(math.sqrt(last)))
        s = radius * radius
        least = min(least, value_at(growth, s) / value_at(under, s) ** 2)
        if not least > radius * (decentred + prism * s):
            break
        sure = s
    return sure, last


@jit
def _displaced(c: Array, x: float, y: float) -> tuple[float, float, float, float, float, float]:
    """D and its derivatives: of its x by x and by y, of its y by x and by y."""
    s = x * x + y * y
    over = 1 + s * (c[0] + s * (c[1] + s * (c[2] + s * c[3])))
    inverse = 1 / (1 + s * (c[4] + s * (c[5] + s * c[6])))
    radial = over * inverse
    slope = 2 * inverse * (
        c[0] + s * (2 * c[1] + s * (3 * c[2] + s * 4 * c[3])) - radial * (c[4] + s * (2 * c[5] + s * 3 * c[6]))
    )  # fmt: skip
    prism_x, prism_y = 2 * (c[9] + 2 * s * c[10]), 2 * (c[11] + 2 * s * c[12])
    xy2 = 2 * x * y
    u = x * radial + c[7] * xy2 + c[8] * (s + 2 * x * x) + s * (c[9] + s * c[10])
    v = y * radial + c[7] * (s + 2 * y * y) + c[8] * xy2 + s * (c[11] + s * c[12])
    both = slope * x * y + 2 * c[7] * x + 2 * c[8] * y
    return (
        u,
        v,
        radial + slope * x * x + 2 * c[7] * y + 6 * c[8] * x + prism_x * x,
        both + prism_x * y,
        both + prism_y * x,
        radial + slope * y * y + 6 * c[7] * y + 2 * c[8] * x + prism_y * y,
    )


@jit
def _is_kept(c: Array, sure: float, limit: float, x: float, y: float) -> bool:
    """Whether D is one-to-one on the way from the centre to a point."""
    s = x * x + y * y
    if s < sure or not s < limit:
        return s < sure
    radius = math.sqrt(s)
    for k in range(1, SAMPLES + 1):
        part = math.tan(k / SAMPLES * math.atan(radius)) / radius
        _, _, xx, xy, yx, yy = _displaced(c, part * x, part * y)
        if not (xx * yy - xy * yx > 0 and xx + yy > 0):
            return False
    return True


@jit
def _restored(c: Array, sure: float, limit: float, u: float, v: float) -> tuple[float, float]:
    """The point that D takes to (u, v), by Newton's method from the radial part's inverse; nan where there is none."""
    length = math.sqrt(u * u + v * v)
    if length == 0 or not length < np.inf:
        return u - u, v - v
    scale = min(_radius(c, limit, length), 0.9999 * math.sqrt(limit)) / length
    x, y = scale * u, scale * v
    residual = np.inf
    for _ in range(MOST_STEPS):
        e, f, xx, xy, yx, yy = _displaced(c, x, y)
        e, f = e - u, f - v
        last, residual = residual, abs(e) + abs(f)
        if residual <= TOLERANCE * length or (residual < ACCEPTED_RESIDUAL * length and residual >= last):
            return (x, y) if _is_kept(c, sure, limit, x, y) else (np.nan, np.nan)
        determinant = xx * yy - xy * yx
        dx, dy = (yy * e - xy * f) / determinant, (xx * f - yx * e) / determinant
        # Near the fold the slope all but vanishes, and a whole step would leave what can be inverted.
        for _ in range(MOST_STEPS):
            if (x - dx) ** 2 + (y - dy) ** 2 < limit:
                break
            dx, dy = 0.5 * dx, 0.5 * dy
        x, y = x - dx, y - dy
    return np.nan, np.nan


@jit
def _radius(c: Array, limit: float, displaced: float) -> float:
    """The radius that the radial part takes to another, roughly: Newton's method, kept in a bracket."""
    low, high = 0.0, math.sqrt(limit)
    radius = min(displaced, 0.5 * high)
    for _ in range(MOST_STEPS):
        s = radius * radius
        under = 1 / (1 + s * (c[4] + s * (c[5] + s * c[6])))
        radial = (1 + s * (c[0] + s * (c[1] + s * (c[2] + s * c[3])))) * under
        by_square = under * (
            c[0] + s * (2 * c[1] + s * (3 * c[2] + s * 4 * c[3])) - radial * (c[4] + s * (2 * c[5] + s * 3 * c[6]))
        )
        off = radius * radial - displaced
        if off > 0:
            high = radius
        else:
            low = radius
        slope = radial + 2 * s * by_square
        step = radius - off / slope if slope > 0 else -1.0
        if not low <= step <= high:
            step = 0.5 * (low + high) if high < np.inf else 2 * radius
        if abs(step - radius) <= 1e-3 * radius:  # the rest is left to the steps in two dimensions
            return step
        radius = step
    return radius


@jit
def _scale(is_angular: bool, x: float, y: float, z: float) -> tuple[float, float, float]:
    """What takes (X, Y) to the plane, and its derivatives by X^2 + Y^2 and by Z; nan where there is none."""
    if not is_angular:
        inverse = 1 / z if z > 0 else np.nan
        return inverse, 0.0, -inverse * inverse
    square = x * x + y * y
    rho, length2 = math.sqrt(square), square + z * z
    if rho <= NEAR_AXIS * z:
        inverse = 1 / z if z > 0 else np.nan
        return inverse, -inverse * inverse * inverse / 3, -inverse * inverse
    if not rho > 0:
        return np.nan, np.nan, np.nan
    scale = math.atan2(rho, z) / rho
    return scale, (z / length2 - scale) / (2 * square), -1 / length2


@jit
def _rays(
    params: Array, c: Array, sure: float, limit: float, term: Rows, is_angular: bool, pixel: Array, ray: Array
) -> None:
    for n in range(len(pixel)):
        x, y = _restored(c, sure, limit, (pixel[n, 0] - params[2]) / params[0], (pixel[n, 1] - params[3]) / params[1])
        theta = math.sqrt(x * x + y * y) if is_angular else 0.0
        if theta > NEAR_AXIS:
            sine = math.sin(theta) / theta
            ray[n, 0], ray[n, 1], ray[n, 2] = sine * x, sine * y, math.cos(theta)
        else:
            ray[n, 0], ray[n, 1], ray[n, 2] = x, y, 1.0 + 0.0 * x


@jit
def _project(
    params: Array, c: Array, sure: float, limit: float, term: Rows, is_angular: bool, point: Array, pixel: Array
) -> None:
    for n in range(len(point)):
        scale, _, _ = _scale(is_angular, point[n, 0], point[n, 1], point[n, 2])
        x, y = scale * point[n, 0], scale * point[n, 1]
        if _is_kept(c, sure, limit, x, y):
            u, v, _, _, _, _ = _displaced(c, x, y)
            pixel[n, 0], pixel[n, 1] = params[0] * u + params[2], params[1] * v + params[3]
        else:
            pixel[n, 0], pixel[n, 1] = np.nan, np.nan


ROWS = 20
"""Of what is worked out of a point: see `_fill`."""
PLACE, POWERS, BY_OVER, BY_UNDER = 10, 12, 16, 18
"""The first rows of what derivatives by the lens are made of."""


@jit
def _linearise(
    params: Array, c: Array, sure: float, limit: float, term: Rows, is_angular: bool, point: Array, kept: Array
) -> None:
    work, every = np.zeros(ROWS * AT_ONCE), len(params)
    f = params[0], params[1], params[2], params[3]
    d = c[0], c[1], c[2], c[3], c[4], c[5], c[6], c[7], c[8], c[9], c[10], c[11], c[12]
    for begin in range(0, point.shape[1], AT_ONCE):
        count = min(AT_ONCE, point.shape[1] - begin)
        end = begin + count
        for n in range(count):
            x, y = point[0, begin + n], point[1, begin + n]
            scale, by_square, by_depth = _scale(is_angular, x, y, point[2, begin + n])
            if not _is_kept(c, sure, limit, scale * x, scale * y):
                scale = np.nan
            work[n], work[AT_ONCE + n], work[2 * AT_ONCE + n] = x, y, scale
            work[3 * AT_ONCE + n], work[4 * AT_ONCE + n] = by_square, by_depth
        _fill(f, d, count, work)
        for row in range(9):
            kept[row, begin:end] = work[row * AT_ONCE : row * AT_ONCE + count]
        kept[9:12, begin:end], kept[8 + every : 12 + every, begin:end] = 0.0, 0.0
        kept[10, begin:end], kept[11 + every, begin:end] = 1.0, 1.0
        kept[9 + every, begin:end] = work[9 * AT_ONCE : 9 * AT_ONCE + count]
        for k in range(len(term)):
            _fill_by_lens(term[k], 0, f[0], work, kept[12 + k, begin:end])
            _fill_by_lens(term[k], 1, f[1], work, kept[12 + every + k, begin:end])


@jit_sums
def _fill(
    f: tuple[float, float, float, float],
    c: tuple[float, float, float, float, float, float, float, float, float, float, float, float, float],
    count: int,
    rows: Array,
) -> None:
    """Replace what is in the first five rows: X, Y, the scale to the plane, its derivatives by X^2 + Y^2 and by Z.

    Where there is no image, the scale is nan.

    There are then pixels, their derivatives by the point as in `Linearised`, D; x, y; s to the powers 1 to 4;
    (x, y) / B, and (x, y) A / B^2 below zero.
    """
    for n in range(count):
        px, py, scale = rows[n], rows[AT_ONCE + n], rows[2 * AT_ONCE + n]
        by_square, by_depth = rows[3 * AT_ONCE + n], rows[4 * AT_ONCE + n]
        x, y = scale * px, scale * py
        s = x * x + y * y
        # `_displaced` once more: as a call this loop takes a third longer. The laws hold the two alike.
        over = 1 + s * (c[0] + s * (c[1] + s * (c[2] + s * c[3])))
        inverse = 1 / (1 + s * (c[4] + s * (c[5] + s * c[6])))
        radial = over * inverse
        slope = 2 * inverse * (
            c[0] + s * (2 * c[1] + s * (3 * c[2] + s * 4 * c[3])) - radial * (c[4] + s * (2 * c[5] + s * 3 * c[6]))
        )  # fmt: skip
        prism_x, prism_y = 2 * (c[9] + 2 * s * c[10]), 2 * (c[11] + 2 * s * c[12])
        xy2 = 2 * x * y
        u = x * radial + c[7] * xy2 + c[8] * (s + 2 * x * x) + s * (c[9] + s * c[10])
        v = y * radial + c[7] * (s + 2 * y * y) + c[8] * xy2 + s * (c[11] + s * c[12])
        both = slope * x * y + 2 * c[7] * x + 2 * c[8] * y
        xx = radial + slope * x * x + 2 * c[7] * y + 6 * c[8] * x + prism_x * x
        xy, yx = both + prism_x * y, both + prism_y * x
        yy = radial + slope * y * y + 6 * c[7] * y + 2 * c[8] * x + prism_y * y
        across = 2 * px * py * by_square
        x_px, y_py = scale + 2 * px * px * by_square, scale + 2 * py * py * by_square
        x_pz, y_pz = px * by_depth, py * by_depth
        fx, fy = f[0], f[1]
        rows[n], rows[AT_ONCE + n] = fx * u + f[2], fy * v + f[3]
        rows[2 * AT_ONCE + n], rows[3 * AT_ONCE + n] = fx * (xx * x_px + xy * across), fx * (xx * across + xy * y_py)
        rows[4 * AT_ONCE + n] = fx * (xx * x_pz + xy * y_pz)
        rows[5 * AT_ONCE + n], rows[6 * AT_ONCE + n] = fy * (yx * x_px + yy * across), fy * (yx * across + yy * y_py)
        rows[7 * AT_ONCE + n] = fy * (yx * x_pz + yy * y_pz)
        rows[8 * AT_ONCE + n], rows[9 * AT_ONCE + n] = u, v
        rows[PLACE * AT_ONCE + n], rows[(PLACE + 1) * AT_ONCE + n] = x, y
        rows[POWERS * AT_ONCE + n], rows[(POWERS + 1) * AT_ONCE + n] = s, s * s
        rows[(POWERS + 2) * AT_ONCE + n], rows[(POWERS + 3) * AT_ONCE + n] = s * s * s, s * s * s * s
        x, y = inverse * x, inverse * y
        rows[BY_OVER * AT_ONCE + n], rows[(BY_OVER + 1) * AT_ONCE + n] = x, y
        rows[BY_UNDER * AT_ONCE + n], rows[(BY_UNDER + 1) * AT_ONCE + n] = -radial * x, -radial * y


@jit_sums
def _fill_by_lens(term: int, axis: int, focal: float, rows: Array, by_lens: Array) -> None:
    """The derivative of a coordinate of the pixel by a parameter, from the rows of `_fill`."""
    count = len(by_lens)
    if term < DECENTRED:
        kind, power = (BY_OVER, term - OVER) if term < UNDER else (BY_UNDER, term - UNDER)
        factor, powers = rows[(kind + axis) * AT_ONCE :], rows[(POWERS + power) * AT_ONCE :]
        for n in range(count):
            by_lens[n] = focal * factor[n] * powers[n]
    elif term < PRISM:
        is_mixed = (term == DECENTRED) == (axis == 0)
        one, other = rows[(PLACE + axis) * AT_ONCE :], rows[(PLACE + 1 - axis) * AT_ONCE :]
        for n in range(count):
            by_lens[n] = focal * (2 * one[n] * other[n] if is_mixed else 3 * one[n] * one[n] + other[n] * other[n])
    else:
        powers = rows[(POWERS + (term - PRISM) % 2) * AT_ONCE :]
        part = focal if (term - PRISM) // 2 == axis else 0.0
        for n in range(count):
            by_lens[n] = part * powers[n]
