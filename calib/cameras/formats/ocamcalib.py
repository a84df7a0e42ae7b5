"""OCamCalib's calib_results.txt, the omnidirectional camera of Scaramuzza, Martinelli and Siegwart (2006).

A place on the sensor p = A m + centre, A = [c d; e 1], shows light from (m_x, m_y, f(|m|)), f a polynomial: `ss`. Its
rows come before columns, counted from 0 in this file (its export_data.m takes 1 from MATLAB's), and z points away from
what is seen, so that f(0) is below zero. The inverse polynomial of the file is an approximation of its own, not read.
"""

import re
from collections.abc import Sequence

import numpy as np

from calib.cameras.formats.format import CameraFormat, ReadCamera
from calib.cameras.formats.lens import fit_foreign
from calib.cameras.formats.parsing import image_size, number, numbers
from designer.base.arrays import Array
from designer.base.errors import InputError

MOST_TERMS = 20


def polynomial_camera(
    terms: Sequence[float],
    affine: Sequence[float],
    centre: tuple[float, float],
    size: tuple[int, int],
    origin: str,
    *,
    by_rows: bool = False,
) -> ReadCamera:
    """The camera nearest to Scaramuzza's; its affine c d e and its centre are of (u, v), or of (row, column)."""
    c, d, e = affine
    scale, straight = c - d * e, terms[0]
    if not scale or not straight:
        raise InputError(f"{origin}: c - d e and the first coefficient of the polynomial must not be zero")

    def rays(pixel: Array) -> Array:
        a, b = (pixel[:, ::-1] if by_rows else pixel).T - np.array(centre)[:, None]
        x, y = (a - d * b) / scale, (c * b - e * a) / scale
        z = np.polynomial.polynomial.polyval(np.hypot(x, y), terms) * np.sign(straight)
        return np.column_stack([y, x, z] if by_rows else [x, y, z])

    u, v = centre[::-1] if by_rows else centre
    return fit_foreign(rays, [abs(straight), abs(straight), u, v], size, "its polynomial lens", origin)


def read(text: str, origin: str, _: str | None = None) -> ReadCamera:
    """The camera in a text."""
    rows = [line.split() for line in text.splitlines() if line.strip() and not line.lstrip().startswith("#")]
    names = ("the polynomial", "the inverse polynomial", "the centre", "the affine parameters", "the image size")
    if len(rows) < len(names):
        raise InputError(f"{origin}: {names[len(rows)]} is missing; it has five lines of numbers, each after a comment")
    direct, _inverse, centre, affine, sides = (
        [number(one, name, origin) for one in row[: MOST_TERMS + 1]] for row, name in zip(rows, names, strict=False)
    )
    count = direct[0]
    if not 1 <= len(direct) - 1 == count < MOST_TERMS:
        raise InputError(f"{origin}: the polynomial must begin with how many coefficients follow, not {count:g}")
    row, column = numbers(centre, "the centre", origin, (2,))
    height, width = numbers(sides, "the image size", origin, (2,))
    three = numbers(affine, "the affine parameters", origin, (3,))
    size = image_size([width, height], origin)
    return polynomial_camera(direct[1:], three, (row, column), size, origin, by_rows=True)


FORMAT = CameraFormat(
    name="ocamcalib",
    title="OCamCalib results",
    file_name="calib_results.txt",
    recognised=re.compile(r"\A\s*#\s*polynomial coefficients"),
    read=read,
)
