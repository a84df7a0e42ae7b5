"""CAHVOR and CAHVORE as mrcal has them.

A direction at the angle theta off the optical axis o, `o = (sin a cos b, sin b, cos a cos b)`, is shown at
`chi (1 + r0 + r1 chi^2 + r2 chi^4)` from where o is, in a plane across o at a distance of one, with the linearity L and
`chi = tan(L theta) / L`, theta for L = 0, `sin(L theta) / L` for L < 0; CAHVOR has L = 1. From there it goes by a
pinhole's fx fy cx cy to the image (mrcal's documentation, Camera models, and its cahvore.cc). With e0, e1 or e2 the
rays of CAHVORE do not meet in a point.
"""

from collections.abc import Sequence

import numpy as np

from calib.cameras.formats.format import FileLens, ReadCamera
from calib.cameras.formats.lens import Complex, fit_foreign, invert, lens_camera, slopes_of
from calib.cameras.formats.parsing import number, numbers
from calib.core.se3 import rotation_between
from designer.base.arrays import Array
from designer.base.errors import InputError
from designer.base.words import shown

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
    a, b = invert(distort, shown_at[:, 0] / depth, shown_at[:, 1] / depth)
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
