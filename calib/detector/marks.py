"""Reading what stands at a lattice position: a ring, a dot, or nothing that can be told."""

import math
from typing import Final, TypeAlias

import numpy as np
from numpy.typing import NDArray

from calib.core.jit import jit
from calib.detector.plane_distance import upright

Floats: TypeAlias = NDArray[np.float64]

RING: Final = 1
DOT: Final = 2
UNREADABLE: Final = 0

SAMPLES = 16


@jit
def _sample_marks(image: NDArray[np.generic], ellipse: Floats, ratio: float, around: float, level: Floats) -> None:
    """Median brightness of the centre, the ink and the white around; then the shares of odd ink and odd white."""
    height, width = image.shape
    centre, ink, white = np.empty(SAMPLES + 1), np.empty(SAMPLES), np.empty(SAMPLES)
    for n in range(len(ellipse)):
        e = ellipse[n]
        level[n, :] = np.nan
        inside = True
        for s in range(SAMPLES):
            angle = 2.0 * math.pi * s / SAMPLES + upright(e[2], e[3], e[4])
            x0 = math.cos(angle) / e[2]
            x1 = (math.sin(angle) - e[3] * x0) / e[4]
            for zone in range(3):
                rho = 0.45 * ratio if zone == 0 else (0.5 * (1.0 + ratio) if zone == 1 else around)
                u, v = round(e[0] + rho * x0), round(e[1] + rho * x1)
                if not (0 <= u < width and 0 <= v < height):
                    inside = False
                    break
                value = float(image[v, u])
                if zone == 0:
                    centre[s] = value
                elif zone == 1:
                    ink[s] = value
                else:
                    white[s] = value
            if not inside:
                break
        if not inside:
            continue
        centre[SAMPLES] = float(image[round(e[1]), round(e[0])])
        level[n, 0], level[n, 1], level[n, 2] = np.median(centre), np.median(ink), np.median(white)
        middle = 0.5 * (level[n, 1] + level[n, 2])
        level[n, 3] = np.mean((ink > middle).astype(np.float64))
        level[n, 4] = np.mean((white < middle).astype(np.float64))


def read_marks(
    image: NDArray[np.generic], ellipse: Floats, *, ratio: float, around: float, contrast: float
) -> NDArray[np.int64]:
    """RING, DOT or UNREADABLE at each place.

    Args:
        image: grey levels.  # (H, W)
        ellipse: centre u v and E of the outer border, seen or predicted.  # (N, 5)
        ratio: inner over outer radius of rings.
        around: where white is looked for, in outer radii.
        contrast: white minus ink of the rings nearby, in grey levels; less than a third of it cannot be read.
    """
    level = zone_levels(image, ellipse, ratio=ratio, around=around)
    step = level[:, 2] - level[:, 1]
    with np.errstate(invalid="ignore", divide="ignore"):
        brightness = (level[:, 0] - level[:, 1]) / step
        readable = (step > contrast / 3) & (level[:, 3] <= 0.25) & (level[:, 4] <= 0.35)
    mark = np.full(len(ellipse), UNREADABLE)
    mark[readable & (brightness > 0.35)] = RING
    mark[readable & (brightness < 0.2)] = DOT
    return mark


def zone_levels(image: NDArray[np.generic], ellipse: Floats, *, ratio: float, around: float) -> Floats:
    """Median levels of centre, ink and white around; shares of odd ink and odd white; nan: cut by the edge.  # (N, 5)

    Args:
        image: grey levels.  # (H, W)
        ellipse: centre u v and E of the outer border, seen or predicted.  # (N, 5)
        ratio: inner over outer radius of rings.
        around: where white is looked for, in outer radii.
    """
    level = np.full((len(ellipse), 5), np.nan)
    _sample_marks(image, np.ascontiguousarray(ellipse), ratio, around, level)
    return level
