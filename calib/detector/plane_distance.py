"""The distance function of `ring_model`, with derivatives, for compiled code."""

import math
from typing import Final, TypeAlias

import numpy as np
from numpy.typing import NDArray

from calib.core.jit import jit, jit_inside
from calib.detector.ring_model import E00, E10, E11, M0, M1

Floats: TypeAlias = NDArray[np.float64]
Numbers: TypeAlias = Floats | tuple[float, ...]
"""Where a loop runs over pixels: a tuple, which stays in registers, so that several pixels are worked out at once."""
LENS_NUMBERS: Final = 8
"""Of what a lens does about a ring: six of its bend (`ring_model`'s q), and two of the gradient of the blur's
logarithm."""
Distance: TypeAlias = tuple[float, float, float, float, float, float, float, float, float, float, float, float]
"""F, |grad F|, dF/dv (2), dF/dE (3), dF/dm (2), F times the curvature of the level set (per px); half the second
derivative of F along its gradient over |grad F|^2, and the part of it that |E xi| has."""


@jit_inside
def plane_distance(p: Numbers, q: Numbers, v0: float, v1: float) -> Distance:
    """F and its derivatives at the offset (v0, v1)."""
    x0 = v0 + q[0] * v0 * v0 + q[1] * v0 * v1 + q[2] * v1 * v1
    x1 = v1 + q[3] * v0 * v0 + q[4] * v0 * v1 + q[5] * v1 * v1
    y0 = p[E00] * x0
    y1 = p[E10] * x0 + p[E11] * x1
    length = math.sqrt(y0 * y0 + y1 * y1) + 1e-12
    # Divisions are what costs time here: four of six are had by multiplying.
    w = 1.0 - p[M0] * x0 - p[M1] * x1
    s = 1.0 / (length * w)
    inv_w = s * length
    f = length * inv_w
    fx0 = (p[E00] * y0 + p[E10] * y1) * s + f * p[M0] * inv_w
    fx1 = p[E11] * y1 * s + f * p[M1] * inv_w
    fv0 = fx0 * (1.0 + 2.0 * q[0] * v0 + q[1] * v1) + fx1 * (2.0 * q[3] * v0 + q[4] * v1)
    fv1 = fx0 * (q[1] * v0 + 2.0 * q[2] * v1) + fx1 * (1.0 + q[4] * v0 + 2.0 * q[5] * v1)
    g = math.sqrt(fv0 * fv0 + fv1 * fv1) + 1e-12
    # The level set |E xi| - F (1 - m . xi) = 0 has the Hessian of |E xi| alone.
    e0 = -p[E00] * fv1
    e1 = p[E11] * fv0 - p[E10] * fv1
    inv_g = 1.0 / g
    across = (y0 * e1 - y1 * e0) * s * inv_g
    curvature = across * across * inv_g
    # W F = |E xi| twice along the gradient, W = 1 - m . xi.
    along = (y0 * (p[E10] * fv0 + p[E11] * fv1) - y1 * p[E00] * fv0) * s * inv_g
    stretch = 0.5 * along * along * w * w * s * inv_g * inv_g
    bow = stretch + (p[M0] * fv0 + p[M1] * fv1) * inv_w * inv_g * inv_g
    by_e00, by_e10, by_e11 = y0 * x0 * s, y1 * x0 * s, y1 * x1 * s
    return f, g, fv0, fv1, by_e00, by_e10, by_e11, f * x0 * inv_w, f * x1 * inv_w, curvature, bow, stretch


@jit
def parameters_of(p: Floats) -> Numbers:
    """Parameters as a tuple."""
    return (p[0], p[1], p[2], p[3], p[4], p[5], p[6], p[7], p[8], p[9], p[10], p[11], p[12], p[13], p[14])


@jit
def bend_of(q: Floats) -> Numbers:
    """The lens's bend and the growth of its blur as a tuple."""
    return (q[0], q[1], q[2], q[3], q[4], q[5], q[6], q[7])


@jit
def upright(e00: float, e10: float, e11: float) -> float:
    """The turn Q of the polar decomposition E = Q S, S symmetric, of a lower triangular E: an angle in the plane."""
    return math.atan2(e10, e00 + e11)


@jit
def offset_on_circle(p: Floats, rho: float, angle: float) -> tuple[float, float]:
    """The straightened offset xi of the point at plane distance rho in a direction of the plane.

    Angles are counted so that the map from the plane is symmetric (`upright`): turning the image by a right angle then
    turns all directions by a right angle, whatever the triangular E does.
    """
    angle += upright(p[E00], p[E10], p[E11])
    x0 = math.cos(angle) / p[E00]
    x1 = (math.sin(angle) - p[E10] * x0) / p[E11]
    scale = rho / (1.0 + rho * (p[M0] * x0 + p[M1] * x1))
    return scale * x0, scale * x1
