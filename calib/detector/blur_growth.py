"""How the blur of a lens changes over each face that it does not have in focus, and what that does to centres.

A thin lens spreads a point at depth z over a disc whose diameter goes with `1 / z - 1 / z_focus` (signed). On a plane
1 / z is linear in the image, so with the even blur of lens and pixel the square of the blur s is a quadratic there. The
picture is the mean of what pinholes all over the lens see; along a line across an edge each of them has the edge moved
in proportion to the blur *at the edge*. An edge that is curved moves towards its centre by about s^2 / 2 rho. Where one
side of a ring is blurred more than the other, the whole ring so moves by about s grad s: by hundredths of a pixel, and
by alike amounts on all faces that lean alike, which a camera takes for another focal length.
"""

from typing import TypeAlias

import numpy as np
from numpy.typing import NDArray

from calib.core.linear_algebra import least_squares
from calib.detector.candidates import semi_axes_px

Floats: TypeAlias = NDArray[np.float64]
Integers: TypeAlias = NDArray[np.int64]

LEAST_FOR_SLOPE, LEAST_FOR_QUADRATIC = 6, 12
ROUNDS = 4
FAR_OFF = 2.0
"""Blurs beyond so many robust standard deviations count less (Huber)."""
SHARPEST_PX = 0.3
NOTICED_PX = 0.001
"""Root mean square of s |grad s|: less than this a camera of a hundred thousand edge pixels does not notice."""
NARROW = 4.0
"""Opposite edges run into each other where a hole is hardly wider than the blur, which the model does not know: of
s grad s the share NARROW exp(-r) is left, r being the hole's semi-minor axis in blurs. Measured with a thin lens: .6 at
1.3, .3 at 1.5 and at 2.1, .1 at 2.6, twice of which is taken."""


def blur_growth(center_px: Floats, blur_px: Floats, is_known: NDArray[np.bool_], face: Integers) -> Floats:
    """The gradient of the blur's logarithm over the image at each feature, per px; 0 on faces with few that tell it.

    Args:
        center_px: of the features.  # (N, 2)
        blur_px: of their edges.  # (N,)
        is_known: which of these count.  # (N,)
        face: that each is on.  # (N,)

    Returns:
        Gradients.  # (N, 2)
    """
    growth = np.zeros_like(center_px)
    for f in np.unique(face[is_known]):
        known = is_known & (face == f)
        count = int(known.sum())
        if count < LEAST_FOR_SLOPE:
            continue
        middle = center_px[known].mean(axis=0)
        size = float(np.abs(center_px[known] - middle).max())
        at = (center_px - middle) / size
        terms = 6 if count >= LEAST_FOR_QUADRATIC else 3
        found = _fitted(_terms(at[known])[:, :terms], blur_px[known] ** 2)
        mine = face == f
        x, y = at[mine].T
        square = _terms(at[mine])[:, :terms] @ found
        a, b, c, d, e = [*found[1:], 0.0, 0.0, 0.0][:5]
        slope = np.stack([a + 2 * c * x + d * y, b + d * x + 2 * e * y], axis=1) / size
        growth[mine] = 0.5 * slope / np.maximum(square, SHARPEST_PX**2)[:, None]
    return growth


def is_noticed(growth: Floats, blur_px: Floats) -> bool:
    """Whether centres are to be measured with the growth of the blur known.  # (N, 2), (N,)"""
    return len(growth) > 0 and float(np.mean((blur_px**2 * np.linalg.norm(growth, axis=1)) ** 2)) > NOTICED_PX**2


def left_covariance(growth: Floats, blur_px: Floats, shape: Floats, ratio: Floats) -> Floats:
    """What opposite edges that run into each other may do to centres.

    Args:
        growth: as `blur_growth` tells it.  # (N, 2)
        blur_px: of the edges.  # (N,)
        shape: E.  # (N, 3)
        ratio: inner over outer radius; 0: a dot.  # (N,)

    Returns:
        Covariances to be added.  # (N, 2, 2)
    """
    hole_px = np.where(ratio > 0, ratio, 1.0) * semi_axes_px(shape)[1]
    left = (NARROW * np.exp(-hole_px / blur_px) * blur_px**2)[:, None] * growth
    return np.asarray(left[:, :, None] * left[:, None, :])


def _terms(at: Floats) -> Floats:
    """Of a quadratic.  # (N, 2) -> (N, 6)"""
    x, y = at.T
    return np.stack([np.ones_like(x), x, y, x * x, x * y, y * y], axis=1)


def _fitted(terms: Floats, values: Floats) -> Floats:
    """Coefficients by iterated reweighting."""
    weight = np.ones(len(values))
    for _ in range(ROUNDS):
        found = least_squares(terms * weight[:, None], values * weight)
        off = np.abs(values - terms @ found)
        usual = 1.4826 * float(np.median(off)) + 1e-9
        weight = np.sqrt(1 / np.maximum(off / (FAR_OFF * usual), 1.0))
    return np.asarray(found)
