"""A lens that is out of focus blurs one side of a ring more than the other: where the centre is then."""

import math

import numpy as np
import pytest
from numpy.typing import NDArray

from calib.detector.lines import blur_growth, is_noticed, left_covariance
from calib.detector.ring_fit import fit_rings
from calib.detector.ring_model import BLUR, M0
from designer.base.arrays import Array
from tests.benchmarks.synthetic import Box, ring_shade
from tests.support.ring_images import INK_LEVEL, LIMIT, WHITE_LEVEL, Ring

SHARP_PX, DEFOCUS_PX, NODES = 0.9, 1.3, 5


def through_a_lens(ring: Ring, slope: Array) -> NDArray[np.float32]:
    """The mean of what pinholes all over a lens see: from y the picture is moved by (DEFOCUS_PX + slope . u) y.

    The lens's opening is Gaussian, taken at the nodes of Gauss and Hermite.
    """
    node, weight = np.polynomial.hermite_e.hermegauss(NODES)
    weight /= weight.sum()
    box, middle = Box(0, 0, ring.side_px, ring.side_px), np.full(2, ring.side_px // 2)
    ink = np.zeros((ring.side_px, ring.side_px))
    for x, share_x in zip(node, weight, strict=True):
        for y, share_y in zip(node, weight, strict=True):
            seen = np.eye(3)
            seen[:2, :2] += np.outer([x, y], slope)
            seen[:2, 2] = (DEFOCUS_PX - slope @ middle) * np.array([x, y])
            view = seen @ ring.plane()
            ink += share_x * share_y * ring_shade(view, np.zeros(2), 1.0, ring.ratio, box, SHARP_PX)
    return np.asarray(WHITE_LEVEL - (WHITE_LEVEL - INK_LEVEL) * ink, dtype=np.float32)


@pytest.mark.parametrize(
    ("ratio", "tilt_rad", "slope"), [(0.45, 0.0, 0.006), (0.45, 0.3, -0.006), (0.0, 0.8, 0.012), (0.0, 0.0, -0.006)]
)
def test_features_stay_where_they_are_out_of_focus(ratio: float, tilt_rad: float, slope: float) -> None:
    """With the growth of the blur known a centre is many times nearer than without, be it of a ring or of a dot."""
    blur_px = math.hypot(SHARP_PX, DEFOCUS_PX)
    ring = Ring(radius_px=14.0, ratio=ratio, tilt_rad=tilt_rad, axis_rad=math.pi / 2, blur_px=blur_px)
    start, along = ring.parameters()[None], np.array([slope, 0.0])
    line, sure = start[:, M0 : M0 + 2], 1e14 * np.eye(2)[None]
    image, growth = through_a_lens(ring, along), DEFOCUS_PX * along[None] / start[:, BLUR] ** 2
    with_it = (
        fit_rings(image, start, limit=LIMIT, line=line, line_information=sure, growth=growth).center_px - start[:, :2]
    )
    without = fit_rings(image, start, limit=LIMIT, line=line, line_information=sure).center_px - start[:, :2]
    assert np.abs(without).max() > 0.0014
    assert np.abs(with_it).max() < 0.15 * np.abs(without).max()


def test_the_growth_is_that_of_a_lens_out_of_focus() -> None:
    """On each face by itself, between few features too, and whatever a few odd ones say."""
    rng = np.random.default_rng(2)
    center, face = rng.uniform(0, 200, (60, 2)), np.repeat([0, 1, 2], [40, 16, 4])
    slope = np.array([[0.01, -0.004], [-0.006, 0.002], [0.0, 0.0]])[face]
    across = 1.5 + (slope * center).sum(axis=1)
    square = 0.7**2 + across**2
    blur = np.sqrt(square)
    blur[3] = 5.0
    found = blur_growth(center, blur, np.ones(60, dtype=bool), face)
    expected = across[:, None] * slope / square[:, None]
    assert np.abs(found - expected)[face < 2].max() < 2e-4
    assert not found[face == 2].any()  # too few to tell
    assert is_noticed(found, blur)
    assert not is_noticed(0.01 * found, blur)


def test_narrow_holes_make_centres_less_sure_along_the_growth() -> None:
    """Where a hole is hardly wider than the blur; of wide ones, or where the blur is the same all over, nothing."""
    shape = np.array([[1 / 12.0, 0.0, 1 / 4.0], [1 / 20.0, 0.0, 1 / 20.0]])
    growth, blur, ratio = np.array([[0.0, 0.01]] * 2), np.array([1.5, 1.5]), np.array([0.45, 0.45])
    steep, plain = left_covariance(growth, blur, shape, ratio)
    assert 0.01 < math.sqrt(steep[1, 1]) < 0.05
    assert not steep[0].any()
    assert math.sqrt(plain[1, 1]) < 0.001
    assert not left_covariance(0 * growth, blur, shape, ratio).any()
