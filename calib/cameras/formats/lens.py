"""Lenses of other tools: those that are a model of ours as they are, their relatives by a fit over the image.

OpenCV's lens of up to 14 coefficients k1 k2 p1 p2 k3 k4 k5 k6 s1 s2 s3 s4 tau_x tau_y is one of four models, the
smallest that has those that are not zero.
"""

from collections.abc import Callable, Sequence

import numpy as np
from numpy.typing import NDArray

from calib.cameras import ABILITIES, COMMON, LINEAR, fitted_models, neutral, parameter_names
from calib.cameras.formats.format import NOTHING, FileLens, ReadCamera
from calib.cameras.formats.holding import by_field, closest, try_fits
from calib.cameras.formats.parsing import make_camera
from calib.cameras.refit import fit_rays, image_grid, in_other_words
from designer.base.arrays import Array
from designer.base.errors import InputError

Complex = NDArray[np.complex128]

Distort = Callable[[Complex, Complex], tuple[Complex, Complex]]
"""A lens in normalised coordinates; built of `+ - * /` only, so that it takes complex numbers."""
Rays = Callable[[Array], Array]
"""Directions (N, 3) at pixels (N, 2), of any length; nan where there are none."""

OF_OPENCV = {5: COMMON, 8: "opencv8", 12: "opencv12", 14: "opencv14"}
"""Its models by the number of their coefficients."""
QUICK_OF_OPENCV = (COMMON, "opencv8")
"""Those that are fitted in a moment."""
SKEWED = {COMMON: "opencv_skew"}
"""Models with a skew beside the same numbers."""
PLAINER = {"thin_prism_fisheye": "fisheye"}
"""What a camera of a model is where the numbers beyond are zero."""
OPENCV_ORDER = ("k1", "k2", "p1", "p2", "k3", "k4", "k5", "k6", "s1", "s2", "s3", "s4", "tau_x", "tau_y")
STEP = 1e-30
MAX_STEPS = 100
TOLERANCE = 1e-12


def brown_camera(
    linear: Sequence[float], coefficients: Sequence[float], image_size: tuple[int, int], origin: str
) -> ReadCamera:
    """A camera with fx fy cx cy and up to 14 of OpenCV's coefficients."""
    last = max((count for count, value in enumerate(coefficients, start=1) if value), default=0)
    count = next(one for one in OF_OPENCV if one >= last)
    lens = [*coefficients, *[0.0] * count][:count]
    return ReadCamera(make_camera(OF_OPENCV[count], [*linear, *lens], image_size, origin))


def brown(radial_terms: Sequence[float], p1: float, p2: float) -> Distort:
    """Brown's distortion by k1 k2 ..., p1 and p2, as in `calib.cameras.brown`."""

    def distort(x: Complex, y: Complex) -> tuple[Complex, Complex]:
        s = x * x + y * y
        radial = 1 + sum((k * s**power for power, k in enumerate(radial_terms, start=1)), start=0 * s)
        a = x * radial + 2 * p1 * x * y + p2 * (s + 2 * x * x)
        return a, y * radial + p1 * (s + 2 * y * y) + 2 * p2 * x * y

    return distort


def lens_camera(lens: FileLens, values: Sequence[float], image_size: tuple[int, int], origin: str) -> ReadCamera:
    """The camera of a file's numbers, which are in the lens's order.

    Raises:
        InputError: a number that is none of ours is not zero, or there is no such camera.
    """
    known = dict(zip(lens.names, values, strict=True))
    if any(value for name, value in zip(lens.names, values, strict=True) if name == NOTHING):
        raise InputError(
            f"{origin}: {lens.name} with numbers that are zero in a camera that can be held; not supported"
        )
    linear = [known[name] if name in known else known["f"] for name in ("fx", "fy")] + [known["cx"], known["cy"]]
    model = str(lens.model)
    if model in OF_OPENCV.values():
        return brown_camera(linear, [known.get(name, 0.0) for name in OPENCV_ORDER], image_size, origin)
    none = dict(zip(parameter_names(model), neutral(model).tolist(), strict=True))
    rest = [known.get(name.removesuffix("_px"), value) for name, value in list(none.items())[4:]]
    camera = make_camera(model, [*linear, *rest], image_size, origin)
    return ReadCamera((in_other_words(camera, PLAINER[model]) if model in PLAINER else None) or camera)


def lens_named(lenses: Sequence[FileLens], name: object, said: str, origin: str, use: str = "there are") -> FileLens:
    """The lens of that name.

    Raises:
        InputError: there is none; the message has what the file said, and what to use.
    """
    found = next((lens for lens in lenses if lens.name == name), None)
    if found is None:
        known = ", ".join(one.name.partition("_linearity")[0] for one in lenses if one.is_written)
        raise InputError(f"{origin}: {said}: not supported; {use} {known}")
    return found


def fit_lens(
    distort: Distort, linear: Sequence[float], image_size: tuple[int, int], what: str, origin: str
) -> ReadCamera:
    """The camera nearest to one with a focal plane and another lens, behind fx fy cx cy."""

    def rays(pixel: Array) -> Array:
        x, y = inverse_of(distort, *slopes_of(pixel, linear))
        return np.column_stack([x, y, np.ones_like(x)])

    return fit_foreign(rays, linear, image_size, what, origin)


def slopes_of(pixel: Array, linear: Sequence[float]) -> tuple[Array, Array]:
    """Pixels (N, 2) less the centre, in focal lengths: (N,) and (N,)."""
    fx, fy, cx, cy = linear
    return (pixel[:, 0] - cx) / fx, (pixel[:, 1] - cy) / fy


def fit_foreign(
    rays: Rays,
    linear: Sequence[float],
    image_size: tuple[int, int],
    what: str,
    origin: str,
    models: Sequence[str] | None = None,
) -> ReadCamera:
    """The camera nearest to one that sees such rays, of these models.

    If none are given, of OpenCV's models, or of the wide ones if it sees far.
    """
    make_camera(LINEAR, linear, image_size, origin)  # held to the same rules
    pixel = image_grid(image_size).reshape(-1, 2)
    with np.errstate(all="ignore"):  # where the lens has no inverse the numbers run away, and are left out
        ray = rays(pixel)
        ray = ray / np.linalg.norm(ray, axis=1, keepdims=True)
    wide = [name for name in fitted_models() if ABILITIES[name].is_wide]
    groups = by_field(wide, QUICK_OF_OPENCV, ray) if models is None else [models]
    try:
        _, refit = closest(try_fits(groups, lambda model: fit_rays(pixel, ray, image_size, model)))
    except InputError as error:
        raise InputError(f"{origin}: {error}") from None
    return ReadCamera(refit.camera, refit, (f"{what} was fitted by the model {refit.camera.model}",))


def inverse_of(distort: Distort, x: Array, y: Array) -> tuple[Array, Array]:
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
