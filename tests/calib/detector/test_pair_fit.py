"""Pairs of ellipses fitted to edges: the start of the direct fit."""

import numpy as np
import pytest

from calib.detector.pair_fit import fit_pairs
from calib.detector.ring_fit import fit_rings
from calib.detector.ring_model import BLUR, GEOMETRY_PARAMETERS, RATIO
from designer.base.arrays import Array
from tests.support.ring_images import INK_LEVEL, LIMIT, WHITE_LEVEL, Mosaic, Ring, mosaic, random_rings


def rough(m: Mosaic, rng: np.random.Generator, off_px: float = 0.5) -> Array:
    """What borders give: centres and axes off by a fraction of a pixel, no line.  # (N, 8)"""
    start = m.params[:, :GEOMETRY_PARAMETERS].copy()
    start[:, :2] += rng.uniform(-off_px, off_px, (len(start), 2))
    start[:, 2:5] *= 1 + rng.uniform(-off_px, off_px, (len(start), 1)) * np.sqrt(start[:, 2] * start[:, 4])[:, None]
    start[:, 5:7] = 0
    start[:, RATIO] += rng.uniform(-off_px, off_px, len(start)) * np.sqrt(start[:, 2] * start[:, 4])
    return start


@pytest.mark.parametrize(("radius", "tilt"), [(8.0, 0.3), (15.0, 0.8), (30.0, 1.0), (50.0, 0.6)])
@pytest.mark.parametrize("blur", [0.5, 1.0])
def test_edges_without_noise_give_centre_shape_and_levels(radius: float, tilt: float, blur: float) -> None:
    """From a rough start: the centre to a few hundredths of a pixel, blur and levels well enough to start from."""
    rng = np.random.default_rng(1)
    m = mosaic(random_rings(8, rng, radius_px=radius, tilt_rad=tilt, blur_px=blur), columns=4)
    params, rms = fit_pairs(m.image, rough(m, rng))
    assert (rms >= 0).all()
    assert rms.max() < 0.15
    minor = radius * np.cos(tilt)
    assert np.abs(params[:, :2] - m.center_px).max() < 0.03 + 0.6 / minor
    assert params[:, 2:5] == pytest.approx(m.params[:, 2:5], abs=0.3 / minor / radius)
    assert params[:, RATIO] == pytest.approx(m.params[:, RATIO], abs=0.8 / minor)
    assert params[:, BLUR] == pytest.approx(m.params[:, BLUR], rel=0.3)
    contrast = params[:, 9] * params[:, 12]
    assert contrast == pytest.approx(np.full(8, WHITE_LEVEL - INK_LEVEL), rel=0.2)


def test_pairs_start_the_direct_fit() -> None:
    """From rough places to the bound: what pairs give is near enough for all direct fits."""
    rng = np.random.default_rng(2)
    m = mosaic(random_rings(60, rng, tilt_rad=0.8))
    noisy = (m.image + 3.2 * rng.standard_normal(m.image.shape)).astype(np.float32)
    params, rms = fit_pairs(noisy, rough(m, rng, off_px=1.0))
    assert (rms >= 0).all()
    fits = fit_rings(noisy, params, limit=LIMIT)
    assert fits.ok.all()
    direct, pairs = (np.sqrt(((x - m.center_px) ** 2).mean()) for x in (fits.center_px, params[:, :2]))
    assert direct < 0.014
    assert pairs < 0.03


@pytest.mark.parametrize("level", [INK_LEVEL, 255.0])
def test_blot_over_an_edge_pulls_little(level: float) -> None:
    """A blot of ink or light over an eighth of the outer edge costs half a tenth of a pixel, not a fifth of one."""
    m = mosaic([Ring(radius_px=20.0, tilt_rad=0.5, axis_rad=1.0)], columns=1)
    v, u = np.mgrid[: m.image.shape[0], : m.image.shape[1]]
    square = []
    for angle in np.arange(0, 6.28, 0.7):
        at = m.center_px[0] + 18 * np.array([np.cos(angle), np.sin(angle)])
        spoilt = m.image.copy()
        spoilt[np.hypot(u - at[0], v - at[1]) < 4] = level
        params, rms = fit_pairs(spoilt, m.params[:, :GEOMETRY_PARAMETERS].copy())
        assert rms[0] >= 0
        square.append(((params[0, :2] - m.center_px[0]) ** 2).sum())
    assert np.sqrt(np.mean(square)) < 0.08


def test_nothing_to_fit_is_refused() -> None:
    """No edge, no ring, or a place outside: -1, and no crash."""
    p = Ring().parameters()[None, :GEOMETRY_PARAMETERS]
    for level in (0, 128, 255):
        assert fit_pairs(np.full((61, 61), level, dtype=np.uint8), p)[1][0] == -1
    far = np.repeat(p, 3, axis=0)
    far[:, :2] = (-500, 20), (20, 1e7), (400, 20)
    assert (fit_pairs(np.zeros((61, 61), dtype=np.uint8), far)[1] == -1).all()
    for shape in ((1, 1), (2, 61), (61, 2)):
        assert fit_pairs(np.zeros(shape, dtype=np.uint8), p)[1][0] == -1
    params, rms = fit_pairs(np.zeros((61, 61), dtype=np.uint8), np.zeros((0, GEOMETRY_PARAMETERS)))
    assert params.shape == (0, 15)
    assert rms.shape == (0,)


def test_all_types_of_pixels_agree() -> None:
    """The same levels as bytes or as floats, the two types that the detector looks at, give the same pairs."""
    rng = np.random.default_rng(4)
    m = mosaic(random_rings(5, rng))
    levels = np.rint(m.image).astype(np.uint8)
    start = rough(m, rng)
    of_bytes, of_floats = (fit_pairs(levels.astype(kind), start)[0] for kind in (np.uint8, np.float32))
    assert of_floats == pytest.approx(of_bytes, rel=1e-5, abs=1e-6)


def test_ring_cut_by_the_border_is_refused_or_right() -> None:
    """Edges outside the image are not made up."""
    rng = np.random.default_rng(5)
    m = mosaic([Ring(radius_px=20.0, tilt_rad=0.5)], columns=1)
    for cut in range(5, 60, 5):
        start = rough(m, rng)
        start[:, 0] -= cut
        params, rms = fit_pairs(np.ascontiguousarray(m.image[:, cut:]), start)
        assert rms[0] == -1 or np.abs(params[0, :2] + (cut, 0) - m.center_px[0]).max() < 0.3
