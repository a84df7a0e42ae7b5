"""How an edge between ink and white looks in a picture: its blur, the picture's tone curve, and its sharpening.

Light is blurred by the lens, so that across an edge it rises from ink to white as z(x), x = d / s in standard
deviations of the blur: a bell, or the disc of a lens out of focus, or something between. The file holds grey levels

    v = S(l^(1/g)),    S(t) = t + c (3 t^2 - 2 t^3 - t),    0 to 1 = full scale,

with a power g and a contrast c, and sharpening adds a (v - G * v), with G a bell of r blurs. A power moves the middle
of an edge into the ink by nearly half a blur (g = 2.2), which ink that shrank by as much would do too. But it also
makes the edge lopsided, which bleeding ink does not: any symmetric blur has z(-x) = 1 - z(x). So the curve is told by
the edge's shape.
"""

import math
from dataclasses import astuple, dataclass, fields

import numpy as np

from calib.core.jit import jit_inside
from designer.base.arrays import Array

REACH, STEP = 9.0, 0.05
"""Of the profile, in blurs."""
GAMMA, GAMMA_SIGMA = 2.0, 0.35
"""The tone curve's power before anything was seen, and the standard deviation of its logarithm: linear to steep. The
usual encoding (IEC 61966-2-1, sRGB) is near 2.2; what a phone does on top is not published."""
SHARPENING_SIGMA, RADIUS, RADIUS_SIGMA = 0.4, 1.5, 0.3
"""Likewise of the sharpening: none, with this much to either side, and its bell in blurs. Assumptions."""


CONTRAST_SIGMA = 0.3
"""Likewise of the contrast: an S-curve lifts the slope in the middle by half as much. Assumption."""
DISC, DISC_SIGMA = 0.2, 0.4
"""Likewise of the disc's share of the blur's variance: pixels and most lenses give a bell. Assumption."""


@dataclass(frozen=True)
class Tone:
    """The shape of an edge: `tone.profile(ink, white)`."""

    disc: float = DISC
    log_gamma: float = math.log(GAMMA)
    contrast: float = 0.0
    sharpening: float = 0.0
    log_radius: float = math.log(RADIUS)

    @property
    def numbers(self) -> Array:
        """All of them.  # (5,)"""
        return np.array(astuple(self))

    def profile(self, levels: tuple[float, float]) -> "Profile":
        """Of edges between ink and white of these shares of the full scale."""
        return Profile(_levels(self, *levels))


COUNT = len(fields(Tone))
PRIOR = Tone().numbers
PRIOR_SIGMA = np.array([DISC_SIGMA, GAMMA_SIGMA, CONTRAST_SIGMA, SHARPENING_SIGMA, RADIUS_SIGMA])
LEAST = np.array([0.0, math.log(0.5), -0.9, -0.9, -1.2])
MOST = np.array([0.98, math.log(6.0), 0.9, 3.0, 1.2])
"""What the numbers are held within: S must rise everywhere, and no picture has more."""


@dataclass(frozen=True, eq=False)
class Profile:
    """The rise of an edge from 0 (ink) to 1 (white)."""

    level: Array  # at steps of STEP from -REACH on

    def at(self, x: Array) -> Array:
        """The rise at distances into the white, in blurs."""
        return np.array([risen(self.level, one) for one in x])


@jit_inside
def risen(level: Array, x: float) -> float:
    """A profile's rise at a distance into the white, in blurs."""
    place = (min(max(x, -REACH), REACH - 2 * STEP) + REACH) / STEP
    low = int(place)
    return float(level[low] + (place - low) * (level[low + 1] - level[low]))


def _levels(tone: Tone, ink: float, white: float) -> Array:
    """The profile's numbers."""
    gamma = math.exp(tone.log_gamma)
    x, rise = _blurred_edge(tone.disc)
    curve = np.linspace(0.0, 1.2, 601)
    light_ink, light_white = np.interp([ink, white], _s_curve(curve, tone.contrast), curve) ** gamma
    level = _s_curve((light_ink + (light_white - light_ink) * rise) ** (1 / gamma), tone.contrast)
    level = (level - level[0]) / (level[-1] - level[0])
    bell = _bell(math.exp(tone.log_radius))
    sharpened: Array = level + tone.sharpening * (level - _smoothed(level, bell))
    inside = np.abs(x) <= REACH + STEP / 2
    return sharpened[inside]


def _s_curve(level: Array, contrast: float) -> Array:
    curve: Array = level + contrast * (3 * level**2 - 2 * level**3 - level)
    return curve


def _blurred_edge(disc: float) -> tuple[Array, Array]:
    """Distances in blurs, and the light there; `disc` of the blur's variance is a disc's, of radius twice its root."""
    from scipy.special import ndtr

    x = np.arange(-2 * REACH, 2 * REACH + STEP / 2, STEP)
    rise = ndtr(x / math.sqrt(1 - min(disc, 0.98)))
    radius = 2 * math.sqrt(max(disc, 0.0))
    if radius < 2 * STEP:
        return x, rise
    edge = np.arange(-math.ceil(radius / STEP), math.ceil(radius / STEP) + 1) * STEP
    # Each step's share of the disc's area, so that the profile changes smoothly with the radius.
    angle = np.arcsin(np.clip(np.stack([edge - STEP / 2, edge + STEP / 2]) / radius, -1, 1))
    area = (angle + np.sin(2 * angle) / 2) / np.pi
    return x, _smoothed(rise, area[1] - area[0])


def _bell(sigma: float) -> Array:
    reach = np.arange(-math.ceil(4 * sigma / STEP), math.ceil(4 * sigma / STEP) + 1) * STEP
    bell = np.exp(-0.5 * (reach / sigma) ** 2)
    normed: Array = bell / bell.sum()
    return normed


def _smoothed(level: Array, kernel: Array) -> Array:
    """A profile convolved; beyond its ends it goes on as it ends."""
    half = len(kernel) // 2
    smooth: Array = np.convolve(np.pad(level, half, mode="edge"), kernel, mode="valid")
    return smooth
