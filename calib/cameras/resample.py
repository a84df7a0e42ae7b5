"""Grey levels between pixels, by a kernel that moves nothing.

OpenCV's `remap` rounds places to 1/32 px and its cubic kernel is not exact for parabolas: edges come out up to 0.04 px
off. Ring centres are measured to 0.003 px, so that would show.
"""

import numpy as np
from numpy.typing import NDArray

from calib.core.jit import jit

Array = NDArray[np.float64]
Pixels = NDArray[np.uint8] | NDArray[np.uint16]

TAPS = 6


@jit
def _weights(s: float, weight: Array) -> None:
    """The six weights for a place `s` in 0..1 after the third of six pixels.

    Keys' kernel of fourth order: "Cubic Convolution Interpolation for Digital Image Processing", 1981, section VI.
    """
    for k in range(TAPS):
        d = abs(s + 2 - k)
        if d < 1:
            weight[k] = 1 + d * d * (4 / 3 * d - 7 / 3)
        elif d < 2:
            weight[k] = 2.5 + d * (-59 / 12 + d * (3 - 7 / 12 * d))
        else:
            weight[k] = -1.5 + d * (1.75 + d * (-2 / 3 + d / 12))


@jit
def _resample(source: NDArray[np.generic], place: Array, top: float, result: NDArray[np.generic]) -> int:
    """Fill `result` (R, W', C) from `source` (H, W, C) at places (R, W', 2); count the pixels that have data."""
    height, width, channels = source.shape
    along_u, along_v = np.empty(TAPS), np.empty(TAPS)
    column, row = np.empty(TAPS, np.int64), np.empty(TAPS, np.int64)
    filled = 0
    for i in range(place.shape[0]):
        for j in range(place.shape[1]):
            u, v = place[i, j, 0], place[i, j, 1]
            if not (-0.5 <= u <= width - 0.5 and -0.5 <= v <= height - 0.5):  # nan is outside, too
                for c in range(channels):
                    result[i, j, c] = 0
                continue
            filled += 1
            left, upper = int(np.floor(u)), int(np.floor(v))
            _weights(u - left, along_u)
            _weights(v - upper, along_v)
            for k in range(TAPS):
                column[k] = min(max(left - 2 + k, 0), width - 1)
                row[k] = min(max(upper - 2 + k, 0), height - 1)
            for c in range(channels):
                value = 0.0
                for a in range(TAPS):
                    line = 0.0
                    for b in range(TAPS):
                        line += along_u[b] * source[row[a], column[b], c]
                    value += along_v[a] * line
                result[i, j, c] = int(min(max(value, 0.0), top) + 0.5)
    return filled


def resample(source: Pixels, place: Array, result: Pixels) -> int:
    """Fill rows of an image from places in another; black where there is none.

    Args:
        source: grey levels (H, W) or (H, W, C), of 8 or 16 bits.
        place: u, v in `source` of each pixel, nan where there is none.  # (R, W', 2)
        result: is written to, (R, W') or (R, W', C) of the same kind.

    Returns:
        How many pixels lie inside the source.
    """
    layered = source.reshape(*source.shape[:2], -1)
    filled: int = _resample(layered, place, float(np.iinfo(source.dtype).max), result.reshape(*result.shape[:2], -1))
    return filled
