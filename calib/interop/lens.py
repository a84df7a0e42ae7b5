"""Lenses of other tools: Brown's as it is, its relatives by a fit over the image.

OpenCV's lens of up to 12 coefficients k1 k2 p1 p2 k3 k4 k5 k6 s1 s2 s3 s4 takes (x, y), r^2 = x^2 + y^2, to
`(x, y) (1 + k1 r^2 + k2 r^4 + k3 r^6) / (1 + k4 r^2 + k5 r^4 + k6 r^6)
+ (2 p1 xy + p2 (r^2 + 2x^2) + s1 r^2 + s2 r^4, p1 (r^2 + 2y^2) + 2 p2 xy + s3 r^2 + s4 r^4)`
(OpenCV's documentation of calib3d). With k4 and all that follow at zero it is the model `opencv`.
"""

from collections.abc import Callable, Sequence

import numpy as np
from numpy.typing import NDArray

from calib.cameras import COMMON, LINEAR
from calib.cameras.refit import fit_rays, image_grid
from calib.interop.format import ReadCamera
from calib.interop.parsing import make_camera
from designer.base.errors import InputError

Complex = NDArray[np.complex128]
Array = NDArray[np.float64]

Distort = Callable[[Complex, Complex], tuple[Complex, Complex]]
"""A lens in normalised coordinates; built of `+ - * /` only, so that it takes complex numbers."""

BROWN = 5
STEP = 1e-30
MAX_STEPS = 100
TOLERANCE = 1e-12


def brown_camera(
    linear: Sequence[float], coefficients: Sequence[float], image_size: tuple[int, int], origin: str
) -> ReadCamera:
    """A camera with fx fy cx cy and up to 12 of OpenCV's coefficients."""
    given = [*coefficients, *[0.0] * (12 - len(coefficients))]
    camera = make_camera(COMMON, [*linear, *given[:BROWN]], image_size, origin)
    if not any(given[BROWN:]):
        return ReadCamera(camera)
    what = "rational" if not any(given[8:]) else "thin-prism"

    def distort(x: Complex, y: Complex) -> tuple[Complex, Complex]:
        k1, k2, p1, p2, k3, k4, k5, k6, s1, s2, s3, s4 = given
        s = x * x + y * y
        radial = (1 + s * (k1 + s * (k2 + s * k3))) / (1 + s * (k4 + s * (k5 + s * k6)))
        return (
            x * radial + 2 * p1 * x * y + p2 * (s + 2 * x * x) + s * (s1 + s * s2),
            y * radial + p1 * (s + 2 * y * y) + 2 * p2 * x * y + s * (s3 + s * s4),
        )

    return fit_lens(distort, linear, image_size, f"its {what} lens", origin)


def fit_lens(
    distort: Distort, linear: Sequence[float], image_size: tuple[int, int], what: str, origin: str
) -> ReadCamera:
    """The camera of model `opencv` nearest to one with another lens, behind fx fy cx cy."""
    fx, fy, cx, cy = make_camera(LINEAR, linear, image_size, origin).params
    pixel = image_grid(image_size).reshape(-1, 2)
    with np.errstate(all="ignore"):  # where the lens has no inverse the numbers run away, and are left out
        x, y = invert(distort, (pixel[:, 0] - cx) / fx, (pixel[:, 1] - cy) / fy)
    try:
        refit = fit_rays(pixel, np.column_stack([x, y, np.ones_like(x)]), image_size, COMMON)
    except InputError as error:
        raise InputError(f"{origin}: {error}") from None
    return ReadCamera(refit.camera, refit, (f"{what} was fitted by the 5 coefficients of the model {COMMON}",))


def invert(distort: Distort, x: Array, y: Array) -> tuple[Array, Array]:
    """Points (N,) that a lens takes to (x, y), by Newton's method; nan where there is none short of its fold."""
    a, b = x.astype(np.float64), y.astype(np.float64)
    for _ in range(MAX_STEPS):
        e, f = distort(_complex(a), _complex(b))
        daa, dba, dab, dbb = _jacobian(distort, a, b)
        determinant = daa * dbb - dab * dba
        off_x, off_y = e.real - x, f.real - y
        step_a, step_b = (dbb * off_x - dab * off_y) / determinant, (daa * off_y - dba * off_x) / determinant
        a, b = a - step_a, b - step_b
        if not (np.abs(step_a) + np.abs(step_b) > TOLERANCE * (1 + np.abs(a) + np.abs(b))).any():
            break
    e, f = distort(_complex(a), _complex(b))
    is_good = np.hypot(e.real - x, f.real - y) < 1e-10 * (1 + np.hypot(x, y))
    # Beyond a fold the lens shows other points in the same places; there is none on the way from the centre.
    for part in np.linspace(0.1, 1, 10):
        daa, dba, dab, dbb = _jacobian(distort, part * a, part * b)
        is_good &= (daa * dbb - dab * dba > 0) & (daa + dbb > 0)
    return np.where(is_good, a, np.nan), np.where(is_good, b, np.nan)


def _jacobian(distort: Distort, a: Array, b: Array) -> tuple[Array, Array, Array, Array]:
    """Derivatives of x by a, y by a, x by b, y by b: `f(a + ih) = f(a) + ih f'(a)`, exact for a tiny h."""
    by_a, by_b = distort(_complex(a, STEP), _complex(b)), distort(_complex(a), _complex(b, STEP))
    return by_a[0].imag / STEP, by_a[1].imag / STEP, by_b[0].imag / STEP, by_b[1].imag / STEP


def _complex(real: Array, imaginary: float = 0.0) -> Complex:
    return real.astype(np.complex128) + np.complex128(1j * imaginary)
