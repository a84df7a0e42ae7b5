"""Reading what stands at a lattice position, and whether a fit is the feature it was made for."""

import math
from typing import Final, TypeAlias

import numpy as np
from numpy.typing import NDArray

from calib.core.jit import jit
from calib.detector.candidates import Candidates, plane_offset
from calib.detector.place import Places, usual_nearby
from calib.detector.plan import TargetPlan
from calib.detector.ring_fit import RingFits
from calib.detector.ring_model import E00, E11, RATIO, upright
from designer.base.arrays import Array, Rows

Floats: TypeAlias = Array

RING: Final = 1
DOT: Final = 2
UNREADABLE: Final = 0
SAMPLES = 16
COVERED = "covered, washed out or too blurred"
FAINT = "too little contrast"
ODD_SHAPE = "not the shape a feature has there"
VAGUE = "too blurred to be placed well"
OFF_GRID = "off the grid"
MAX_STRETCH = 0.25
"""How much longer or shorter, as a logarithm, a circle may look in any direction than its place predicts."""
MAX_OFF_RADII = 0.2
"""Nothing may lie farther from its place than this share of its radius, however uncertain it is."""
LEAST_CONTRAST = 4.0
"""Times its own noise: what has less need not be a feature at all."""
FAINTEST = 0.3
"""Of the contrast around it on its face."""
MAX_SIGMA_PX = 0.5
"""Centres less certain than this (2-D) would only do harm to who does not weigh them."""


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


def read_marks(image: NDArray[np.generic], ellipse: Floats, *, ratio: float, around: float, contrast: float) -> Rows:
    """RING, DOT or UNREADABLE at ellipses (N, 5): centre u v and E of the outer border, seen or predicted.

    White is looked for `around` outer radii from the centre. Where it is brighter than ink by less than a third of
    `contrast`, that of the rings nearby, nothing can be read.
    """
    return marks_of(zone_levels(image, ellipse, ratio=ratio, around=around), contrast)


def marks_of(level: Floats, contrast: float | Floats) -> Rows:
    """RING, DOT or UNREADABLE from what `zone_levels` gives, where the rings nearby have that contrast.  # (N, 5)"""
    step = level[:, 2] - level[:, 1]
    with np.errstate(invalid="ignore", divide="ignore"):
        brightness = (level[:, 0] - level[:, 1]) / step
        readable = (step > contrast / 3) & (level[:, 3] <= 0.25) & (level[:, 4] <= 0.35)
    mark = np.full(len(level), UNREADABLE)
    mark[readable & (brightness > 0.35)] = RING
    mark[readable & (brightness < 0.2)] = DOT
    return mark


def usual_contrast(image: NDArray[np.generic], candidates: Candidates) -> float:
    """White minus ink of the usual ring, in grey levels."""
    rings = np.flatnonzero(candidates.ratio > 0)
    if not len(rings):
        return 1.0
    e, ratio = candidates.ellipse[rings], candidates.ratio[rings]
    height, width = image.shape
    steps = []
    upright = np.arctan2(e[:, 3], e[:, 2] + e[:, 4])
    for angle in (upright + quarter * (np.pi / 2) + 0.4 for quarter in range(4)):
        across = np.cos(angle) / e[:, 2]
        along = (np.sin(angle) - e[:, 3] * across) / e[:, 4]
        levels = []
        for rho in (0.5 * (1 + ratio), np.full(len(rings), 1.3)):
            u = np.clip(np.rint(e[:, 0] + rho * across), 0, width - 1).astype(np.int64)
            v = np.clip(np.rint(e[:, 1] + rho * along), 0, height - 1).astype(np.int64)
            levels.append(np.asarray(image[v, u], dtype=np.float64))
        steps.append(levels[1] - levels[0])
    return max(float(np.median(steps)), 1e-6)


def zone_levels(image: NDArray[np.generic], ellipse: Floats, *, ratio: float, around: float) -> Floats:
    """Median levels of centre, ink and white around; shares of odd ink and odd white; nan: cut by the edge.  # (N, 5)

    Arguments are those of `read_marks`.
    """
    level = np.full((len(ellipse), 5), np.nan)
    _sample_marks(image, np.ascontiguousarray(ellipse), ratio, around, level)
    return level


def judge(fits: RingFits, residual_px: Floats | None, places: Places, plan: TargetPlan) -> NDArray[np.str_]:
    """Why fits are refused, given their places and how far they are from where the grid puts them; empty: not.

    Light differs between faces: contrast is held against that of the neighbours on the face, and noise, which does not
    shrink with it, against the photo's usual noise in their light.
    """
    is_dot, shape = plan.target.is_dot[places.ring], places.shape
    count = len(fits.ok)
    reason = np.full(count, "", dtype="<U40")
    if not count:
        return reason
    contrast = fits.contrast
    good = fits.ok & (contrast > 0)
    photo_contrast = float(np.median(contrast[good])) if good.any() else 1.0
    roughness = fits.noise / np.maximum(contrast, 1e-9)
    usual_roughness = float(np.median(roughness[good])) if good.any() else 0.0
    doubtful = (contrast < FAINTEST * photo_contrast) | (roughness > 3 * usual_roughness + 0.04)
    nearby = usual_nearby(plan, places, doubtful, contrast, good)
    nearby = np.where(np.isnan(nearby), photo_contrast, np.minimum(nearby, photo_contrast))
    stretch = stretch_of(fits.params[:, E00 : E11 + 1], shape)
    usual_stretch = float(np.median(stretch[good])) if good.any() else 0.0
    ratio = fits.params[:, RATIO]
    rings = good & ~is_dot
    usual_ratio = float(np.median(ratio[rings])) if rings.any() else plan.ratio
    distance = np.zeros(count) if residual_px is None else np.linalg.norm(residual_px, axis=1)
    sigma = np.sqrt(np.trace(fits.cov_px2, axis1=1, axis2=2))
    usual_distance = float(np.median(distance[good])) if good.any() else 0.0
    if residual_px is not None:
        in_radii = np.linalg.norm(plane_offset(shape, residual_px), axis=1)
        reason[in_radii > MAX_OFF_RADII] = OFF_GRID
    reason[distance > 8 * usual_distance + 5 * np.where(good, sigma, 0) + 0.1] = OFF_GRID
    odd = (np.abs(stretch - usual_stretch) > MAX_STRETCH).any(axis=1)
    odd |= ~is_dot & (np.abs(ratio - usual_ratio) > 0.2)
    reason[odd] = ODD_SHAPE
    reason[sigma > MAX_SIGMA_PX] = VAGUE
    reason[roughness > 3 * usual_roughness * photo_contrast / nearby + 0.04] = COVERED
    reason[(contrast < FAINTEST * nearby) | (contrast < LEAST_CONTRAST * fits.noise)] = FAINT
    reason[~good] = COVERED
    return reason


def stretch_of(shape: Floats, predicted: Floats) -> Floats:
    """Logarithms of the two scales between predicted circles and those seen: the singular values of E_p inv(E)."""
    # M = E_p inv(E) of lower triangles: its singular values are s +- d with 2 s = |(a + d, c)| and 2 d = |(a - d, c)|.
    area = shape[:, 0] * shape[:, 2]
    is_flat = np.abs(area) < 1e-12
    e00, e10, e11 = np.where(is_flat[:, None], np.array([1.0, 0.0, 1.0]), shape).T
    a, d = predicted[:, 0] / e00, predicted[:, 2] / e11
    c = (predicted[:, 1] - d * e10) / e00
    half_sum, half_difference = 0.5 * np.hypot(a + d, c), 0.5 * np.hypot(a - d, c)
    scale = np.stack([half_sum + half_difference, np.abs(half_sum - half_difference)], axis=1)
    return np.asarray(np.log(np.maximum(scale, 1e-12)))
