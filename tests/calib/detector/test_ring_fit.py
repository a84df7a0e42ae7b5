"""The direct fit of a ring to its pixels: its distance, its equations, its centres and their covariances."""

import math
import os
from dataclasses import replace

import cv2
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.typing import NDArray
from scipy.stats import ncx2, norm

from calib.core.parallel import in_chunks
from calib.detector.ring_equations import CHUNK, FAR, MOST_GROWN, ROOM, accumulate, blurs_from_edge, edges
from calib.detector.ring_fit import RingFits, fit_rings
from calib.detector.ring_model import (
    BLUR,
    DARKNESS,
    LENS_NUMBERS,
    M0,
    MAX_PIXELS,
    PARAMETERS,
    RATIO,
    WHITE,
    choose_pixels,
    plane_distance,
)
from designer.base.arrays import Array
from tests.support.ring_images import (
    CELL,
    INK_LEVEL,
    LIMIT,
    WHITE_LEVEL,
    Mosaic,
    Ring,
    disturbed,
    mosaic,
    parameters_of,
    random_rings,
)

TILT = math.radians(45)
LENS_BLUR_PX = math.sqrt(0.7**2 - 1 / 12)
"""With the pixel's own width an edge blur of 0.7 px."""
NOISE = (WHITE_LEVEL - INK_LEVEL) / 50
SURE = 1e12
"""Information that makes a vanishing line as good as known."""


def fit_known(
    m: Mosaic, start: Array, *, line: Array | None = None, bend: Array | None = None, limit: float = LIMIT
) -> RingFits:
    """Fit with the vanishing line as good as known: the true one, if no other is given."""
    line = m.params[:, M0 : M0 + 2].copy() if line is None else line
    information = np.tile(SURE * np.eye(2), (len(start), 1, 1))
    return fit_rings(m.image, start, limit=limit, line=line, line_information=information, bend=bend)


def errors(fits: RingFits, m: Mosaic) -> Array:
    """Centres less the truth.  # (N, 2)"""
    assert fits.ok.all()
    return np.asarray(fits.center_px - m.center_px)


def distance(p: Array, q: Array, v: Array) -> Array:
    """F of `ring_model`, in NumPy.  # (..., 2) -> (...)"""
    u, w = v[..., 0], v[..., 1]
    xi = np.stack([u + q[0] * u * u + q[1] * u * w + q[2] * w * w, w + q[3] * u * u + q[4] * u * w + q[5] * w * w], -1)
    plane = np.array([[p[2], 0.0], [p[3], p[4]]])
    return np.asarray(np.linalg.norm(xi @ plane.T, axis=-1) / (1 - xi @ p[5:7]))


def numeric_gradient(p: Array, q: Array, v: Array, step: float = 1e-5) -> Array:
    """dF/dv by central differences.  # (..., 2)"""
    ways = step * np.eye(2)
    return np.stack([(distance(p, q, v + way) - distance(p, q, v - way)) / (2 * step) for way in ways], axis=-1)


def kernel_outputs(p: Array, q: Array, v: Array) -> Array:
    """What the kernel says."""
    return np.array(plane_distance(p, q, float(v[0]), float(v[1])))


@st.composite
def models(draw: st.DrawFn) -> tuple[Array, Array, Array]:
    """Parameters, a lens's bend and an offset not far from the ring's edges."""
    tilt, axis = draw(st.floats(0, 1.1)), draw(st.floats(0, 6.28))
    ring = Ring(radius_px=draw(st.floats(8, 40)), tilt_rad=tilt, axis_rad=axis, focal_px=draw(st.floats(400, 3000)))
    p = ring.parameters()
    bend = np.array([draw(st.floats(-1, 1)) for _ in range(6)]) * 2e-3 / ring.radius_px
    angle, size = draw(st.floats(0, 6.28)), draw(st.floats(0.4, 1.3))
    y = size * np.array([math.cos(angle), math.sin(angle)])
    u = y[0] / p[2]
    return p, bend, np.array([u, (y[1] - p[3] * u) / p[4]])


@settings(max_examples=60, deadline=None, derandomize=True)
@given(models())
def test_distance_is_its_formula_with_true_derivatives(model: tuple[Array, Array, Array]) -> None:
    """F is |E xi| / (1 - m . xi), and all derivatives are those of that formula."""
    p, q, v = model
    out = kernel_outputs(p, q, v)
    assert out[0] == pytest.approx(distance(p, q, v), rel=1e-9)
    gradient = numeric_gradient(p, q, v)
    assert out[2:4] == pytest.approx(gradient, rel=1e-6, abs=1e-9)
    assert out[1] == pytest.approx(np.linalg.norm(gradient), rel=1e-6)
    for k in range(2, 7):
        step = np.zeros(PARAMETERS)
        step[k] = 1e-4 * p[4]
        change = (distance(p + step, q, v) - distance(p - step, q, v)) / (2 * step[k])
        assert out[2 + k] == pytest.approx(change, rel=1e-5, abs=1e-6)


@settings(max_examples=60, deadline=None, derandomize=True)
@given(models())
def test_curvature_is_that_of_the_level_set(model: tuple[Array, Array, Array]) -> None:
    """The last output is F times the curvature of the curve F = constant, here from its second differences."""
    p, _, v = model
    q = np.zeros(LENS_NUMBERS)
    step = 1e-3 * Ring().radius_px
    (fuu, fuv), (_, fvv) = (
        (numeric_gradient(p, q, v + way) - numeric_gradient(p, q, v - way)) / (2 * step) for way in step * np.eye(2)
    )
    fu, fv = numeric_gradient(p, q, v)
    curvature = (fuu * fv**2 - 2 * fuv * fu * fv + fvv * fu**2) / np.hypot(fu, fv) ** 3
    assert kernel_outputs(p, q, v)[9] == pytest.approx(distance(p, q, v) * curvature, rel=2e-3, abs=1e-6)


def test_curvature_of_circle_and_ellipse_is_the_textbook_one() -> None:
    """A circle of radius R has the curvature 1 / R; the tip of an ellipse's major axis has a / b^2."""
    p = np.zeros(PARAMETERS)
    p[2:5] = 1 / 20, 0.0, 1 / 8
    assert kernel_outputs(p, np.zeros(LENS_NUMBERS), np.array([20.0, 0.0]))[9] == pytest.approx(20 / 64)
    assert kernel_outputs(p, np.zeros(LENS_NUMBERS), np.array([0.0, 8.0]))[9] == pytest.approx(8 / 400)
    p[2:5] = 1 / 20, 0.0, 1 / 20
    assert kernel_outputs(p, np.zeros(LENS_NUMBERS), np.array([12.0, 16.0]))[9] == pytest.approx(1 / 20)


@settings(max_examples=30, deadline=None, derandomize=True)
@given(models())
def test_bow_is_half_the_second_derivative_along_the_gradient(model: tuple[Array, Array, Array]) -> None:
    """From differences of F; without a vanishing line nothing but |E xi| bends F."""
    p, _, v = model
    for m, stretch in ((p[5:7].copy(), False), (np.zeros(2), True)):
        p[5:7] = m
        gradient = numeric_gradient(p, np.zeros(LENS_NUMBERS), v)
        size = np.linalg.norm(gradient)
        step = 1e-3 * Ring().radius_px
        here, there = (distance(p, np.zeros(LENS_NUMBERS), v + way * step * gradient / size) for way in (-1, 1))
        second = (here - 2 * distance(p, np.zeros(LENS_NUMBERS), v) + there) / step**2
        found = kernel_outputs(p, np.zeros(LENS_NUMBERS), v)
        assert found[10] == pytest.approx(0.5 * second / size**2, rel=2e-3, abs=1e-5)
        assert not stretch or found[11] == found[10]


@pytest.mark.parametrize("curvature", [0.05, 0.15, 0.3])
def test_a_blurred_disc_is_a_rician_distribution(curvature: float) -> None:
    """The edge of a disc, blurred, is SciPy's noncentral chi-square, seven times nearer than a straight one moved."""
    x = np.linspace(-2.5, 3.5, 61)
    exact = ncx2.cdf(curvature**-2, 2, (1 / curvature + x) ** 2)
    found = norm.sf([sum(blurs_from_edge(float(one), 0.0, 0.0, 1.0, curvature)) for one in x])
    moved = norm.sf(x + 0.5 * curvature)
    assert np.abs(found - exact).max() < 0.14 * np.abs(moved - exact).max()


def brightness(p: Array, q: Array, pixel: NDArray[np.int32], origin: Array) -> Array:
    """The brightness model in NumPy.  # (N, 2) -> (N,)"""
    v = pixel - p[:2]
    out = np.array([kernel_outputs(p, q, offset) for offset in v])
    gradient, away = out[:, 2:4], pixel - origin
    steepness = np.linalg.norm(gradient, axis=1)

    def blurs(rho: float) -> tuple[Array, Array]:
        off = distance(p, q, v) - rho
        at_edge = away - (off / steepness**2)[:, None] * gradient
        blur = p[BLUR] * (1 + np.clip(at_edge @ q[6:], -MOST_GROWN, MOST_GROWN))
        slope = blur * steepness
        one = [blurs_from_edge(*row) for row in np.column_stack([off, out[:, 10:], 1 / slope, out[:, 9] * blur / rho])]
        return np.asarray(np.sum(one, axis=1)), slope

    outer, slope = blurs(1.0)
    ink, per_f = norm.cdf(-outer), -norm.pdf(outer) / slope
    if p[RATIO] > 0:
        inner, slope = blurs(p[RATIO])
        ink, per_f = ink - norm.cdf(-inner), per_f + norm.pdf(inner) / slope
    light = p[WHITE] + away @ p[10:12]
    bleed = p[BLUR] ** 2 * per_f * (gradient @ (p[13:15] - p[DARKNESS] * p[10:12]))
    return np.asarray(light * (1 - p[DARKNESS] * ink) + ink * (away @ p[13:15]) + bleed)


def lit_parameters() -> Array:
    """A large tilted ring with uneven light on white and on ink."""
    p = Ring(radius_px=30.0, tilt_rad=0.9, axis_rad=0.7, focal_px=600.0).parameters()
    p[10:12], p[13:15] = (0.7, -0.4), (0.3, 0.5)
    return p


def equations(image: NDArray[np.float32], pixel: NDArray[np.int32], p: Array, q: Array) -> tuple[float, Array, Array]:
    """Cost, J'J (its lower triangle) and J'r as the kernel has them."""
    size = (PARAMETERS, PARAMETERS)
    normal, gradient = np.empty(size), np.empty(PARAMETERS)
    sample = np.vstack([pixel.T, image[pixel[:, 1], pixel[:, 0]]]).astype(np.float64)
    cost = accumulate(sample, len(pixel), p, q, p[:2].copy(), normal, gradient, np.empty(ROOM))
    return cost, np.tril(normal), gradient


def square_of_pixels(first: int, last: int) -> NDArray[np.int32]:
    """All pixels with both coordinates in a range."""
    return (
        np.stack(np.meshgrid(np.arange(first, last), np.arange(first, last)), axis=-1).reshape(-1, 2).astype(np.int32)
    )


def test_an_edge_is_the_normal_distribution() -> None:
    """Series and polynomial agree with SciPy's to 1e-9 of the contrast, and 1e-8 for the slope, far out too."""
    t = np.linspace(-2 * FAR, 2 * FAR, 1001)
    found = np.array([edges(float(one), float(other)) for one, other in zip(t, t[::-1], strict=True)])
    for sign, tail, density in ((1, 0, 1), (-1, 2, 3)):
        assert np.abs(found[:, tail] - norm.sf(sign * t)).max() < 1e-9
        assert np.abs(found[:, density] - norm.pdf(t)).max() < 1e-8


def test_residuals_and_normal_equations_follow_the_model() -> None:
    """Cost and derivatives are those of the brightness model; small terms of second order may lack derivatives."""
    p, q = lit_parameters(), np.array([2e-4] * 6 + [0.004, -0.006])
    pixel = square_of_pixels(16, 92)
    image = np.random.default_rng(1).uniform(0, 250, (109, 109)).astype(np.float32)
    value: Array = image[pixel[:, 1], pixel[:, 0]].astype(np.float64)
    origin = p[:2].copy()
    residual: Array = np.subtract(value, brightness(p, q, pixel, origin))
    cost, normal, gradient = equations(image, pixel, p, q)
    assert cost == pytest.approx((residual**2).sum(), rel=1e-9)
    size = np.array([1e-4, 1e-4, 1e-6, 1e-6, 1e-6, 1e-6, 1e-6, 1e-5, 1e-4, 1e-2, 1e-3, 1e-3, 1e-5, 1e-3, 1e-3])
    jacobian = np.stack(
        [
            np.subtract(brightness(p + step, q, pixel, origin), brightness(p - step, q, pixel, origin))
            / (2 * step.sum())
            for step in np.diag(size)
        ],
        axis=1,
    )
    expected = jacobian.T @ jacobian
    scale = np.sqrt(np.diag(expected))
    assert normal / np.outer(scale, scale) == pytest.approx(np.tril(expected / np.outer(scale, scale)), abs=0.08)
    rough = np.sqrt(cost / len(pixel)) * scale * np.sqrt(len(pixel))
    assert gradient / rough == pytest.approx(jacobian.T @ residual / rough, abs=0.02)


def test_equations_of_many_pixels_are_the_sum_over_pixels() -> None:
    """However many pixels are multiplied together at once, each counts once."""
    p, q = lit_parameters(), np.zeros(LENS_NUMBERS)
    image = np.random.default_rng(2).uniform(0, 250, (109, 109)).astype(np.float32)
    pixel = square_of_pixels(20, 33)
    assert len(pixel) % CHUNK
    singles = [equations(image, one[None], p, q) for one in pixel]
    for whole, parts in zip(equations(image, pixel, p, q), zip(*singles, strict=True), strict=True):
        assert whole == pytest.approx(np.sum(parts, axis=0), rel=1e-9, abs=1e-9)


@settings(max_examples=40, deadline=None, derandomize=True)
@given(
    radius=st.floats(14, 30),
    ratio=st.floats(0.36, 0.55),
    tilt=st.floats(0, 0.95),
    blur=st.floats(0.5, 1.1),
    gradient=st.floats(0, 0.4),
    seed=st.integers(0, 10**6),
)
def test_centre_without_noise_is_the_projected_centre(
    radius: float, ratio: float, tilt: float, blur: float, gradient: float, seed: int
) -> None:
    """Whatever the tilt, the blur and the slope of light and veil: the projected centre comes out to 0.003 px."""
    rng = np.random.default_rng(seed)
    light, veil = (gradient / (2 * radius) * np.array([math.cos(a), math.sin(a)]) for a in rng.uniform(0, 6.28, 2))
    ring = replace(
        random_rings(1, rng, radius_px=radius, ratio=ratio, tilt_rad=tilt, blur_px=blur)[0],
        light=tuple(light),
        veil=tuple(0.3 * veil),
    )
    m = mosaic([ring], columns=1)
    start = disturbed(m.params, rng)
    assert np.abs(errors(fit_rings(m.image, start, limit=LIMIT), m)).max() < 0.003
    assert np.abs(errors(fit_known(m, start), m)).max() < 0.002


def test_all_parameters_come_out_without_noise() -> None:
    """Shape, line, ratio, blur and levels of a noise-free ring are those it was drawn with."""
    rng = np.random.default_rng(4)
    m = mosaic(random_rings(4, rng, radius_px=18.0, tilt_rad=0.8, focal_px=300.0))
    fits = fit_rings(m.image, disturbed(m.params, rng), limit=LIMIT)
    assert fits.params[:, 2:5] == pytest.approx(m.params[:, 2:5], rel=2e-3, abs=1e-4)
    assert fits.params[:, M0 : M0 + 2] == pytest.approx(m.params[:, M0 : M0 + 2], abs=2e-4)
    assert fits.params[:, RATIO : WHITE + 1] == pytest.approx(m.params[:, RATIO : WHITE + 1], rel=0.01)
    assert fits.contrast == pytest.approx(np.full(4, WHITE_LEVEL - INK_LEVEL), rel=0.01)


@pytest.mark.parametrize(("radius_px", "blur_px"), [(15.0, 0.7), (15.0, 1.5), (22.0, 2.0)])
def test_blurred_rings_are_as_exact(radius_px: float, blur_px: float) -> None:
    """Blur of a tilted ring moves no centre by more than a tenth of what noise does (RMS, vanishing line known)."""
    rings = mosaic(random_rings(24, np.random.default_rng(5), radius_px=radius_px, tilt_rad=0.9, blur_px=blur_px))
    assert np.sqrt((errors(fit_known(rings, rings.params.copy()), rings) ** 2).sum(axis=1).mean()) < 4e-4


def test_large_rings_are_as_exact_though_sampled() -> None:
    """Rings too large for all their pixels lose no exactness by sampling."""
    rng = np.random.default_rng(5)
    m = mosaic(random_rings(4, rng, radius_px=60.0, tilt_rad=0.9))
    fits = fit_rings(m.image, disturbed(m.params, rng), limit=LIMIT)
    assert np.abs(errors(fits, m)).max() < 0.003
    assert fits.pixels.max() < 1500


@pytest.mark.parametrize("blur_px", [1.0, 3.0, 6.0, 10.0, 30.0])
def test_every_quarter_of_a_large_ring_is_sampled_however_blurred(blur_px: float) -> None:
    """Three lines or more cross each quarter of either edge, also where they are long, and there is room for them."""
    p, pixels = parameters_of(np.diag([120.0, 120.0, 1.0]), 0.45, blur_px), np.empty((3, MAX_PIXELS))
    p[:2], reach = 500.0, 3 * blur_px + 1
    count = choose_pixels(np.zeros((1001, 1001), dtype=np.uint8), p, np.zeros(LENS_NUMBERS), reach, LIMIT, pixels)
    assert count < MAX_PIXELS
    u, v = pixels[:2, :count] - 500.0
    per_edge = 2 * np.ceil(reach / 2) + 1
    assert (np.bincount((u > 0) * 2 + (v > 0), minlength=4) >= 2 * 3 * per_edge - 10).all()


@pytest.fixture(scope="module")
def noisy() -> Mosaic:
    """The published case: R = 15 px, ratio 0.45, blur 0.7 px, contrast over noise 50, 45 degrees, f = 1000 px."""
    rng = np.random.default_rng(6)
    m = mosaic(random_rings(300, rng, tilt_rad=TILT, blur_px=LENS_BLUR_PX))
    return Mosaic((m.image + NOISE * rng.standard_normal(m.image.shape)).astype(np.float32), m.params)


def test_centres_reach_the_bound(noisy: Mosaic) -> None:
    """RMSE per axis is within 0.0125 px with the line free and 0.0050 px with it known (bound: 0.0097 and 0.0042)."""
    start = disturbed(noisy.params, np.random.default_rng(7))
    free = errors(fit_rings(noisy.image, start, limit=LIMIT), noisy)
    known = errors(fit_known(noisy, start), noisy)
    # 600 values: the RMSE itself scatters by 2.9 %. Below the bound by more than that something is wrong as well.
    assert 0.0088 < np.sqrt((free**2).mean()) < 0.0125
    assert 0.0037 < np.sqrt((known**2).mean()) < 0.0050
    assert np.abs(free.mean(axis=0)).max() < 0.0025
    assert np.abs(known.mean(axis=0)).max() < 0.001
    assert 1.9 < np.sqrt((free**2).mean() / (known**2).mean()) < 2.8


@pytest.mark.parametrize("is_known", [False, True])
def test_covariance_is_the_scatter(noisy: Mosaic, is_known: bool) -> None:
    """Reported covariances are those of the errors: over all rings, and along each ring's own axes."""
    start = disturbed(noisy.params, np.random.default_rng(8))
    fits = fit_known(noisy, start) if is_known else fit_rings(noisy.image, start, limit=LIMIT)
    error = errors(fits, noisy)
    sigma = np.sqrt(np.trace(fits.cov_px2, axis1=1, axis2=2).mean() / 2)
    assert 0.87 < sigma / np.sqrt((error**2).mean()) < 1.15
    chi_square = np.einsum("ni,nij,nj->n", error, np.linalg.inv(fits.cov_px2), error)
    assert 0.75 < chi_square.mean() / 2 < 1.3
    assert fits.noise.mean() == pytest.approx(NOISE, rel=0.05)


def test_covariance_holds_where_noise_grows_with_light() -> None:
    """With shot noise the scatter along the tilt is still what is reported."""
    rng = np.random.default_rng(9)
    m = mosaic(random_rings(150, rng, tilt_rad=TILT))
    image = (m.image + np.sqrt(m.image) * 0.5 * rng.standard_normal(m.image.shape)).astype(np.float32)
    shot = Mosaic(image, m.params)
    fits = fit_rings(image, disturbed(m.params, rng), limit=LIMIT)
    error = errors(fits, shot)
    assert 0.85 < np.sqrt(np.trace(fits.cov_px2, axis1=1, axis2=2).mean() / (error**2).sum(axis=1).mean()) < 1.18


def test_a_covariance_lets_each_pixel_err_by_its_own_residual(noisy: Mosaic) -> None:
    """A centre's covariance is the sandwich of J'J and J' diag(r^2) J, but for derivatives that the fit leaves out."""
    start = disturbed(noisy.params, np.random.default_rng(4))[:3]
    fits, bend = fit_rings(noisy.image, start, limit=LIMIT), np.zeros(8)
    size = np.array([1e-4, 1e-4, 1e-6, 1e-6, 1e-6, 1e-6, 1e-6, 1e-5, 1e-4, 1e-2, 1e-3, 1e-3, 1e-5, 1e-3, 1e-3])
    for first, p, cov in zip(start, fits.params, fits.cov_px2, strict=True):
        chosen = np.empty((3, MAX_PIXELS))
        count = choose_pixels(noisy.image, first, bend, 3 * first[8] + 1, LIMIT, chosen)
        pixel, origin = chosen[:2, :count].T.astype(np.int32), first[:2].copy()
        residual = np.subtract(chosen[2, :count], brightness(p, bend, pixel, origin))
        moved = [
            brightness(p + step, bend, pixel, origin) - brightness(p - step, bend, pixel, origin)
            for step in np.diag(size)
        ]
        jacobian = np.stack(moved, axis=1) / (2 * size)
        influence = np.linalg.solve(jacobian.T @ jacobian, jacobian.T)[:2] * residual
        expected = influence @ influence.T * count / (count - PARAMETERS)
        assert cov == pytest.approx(expected, abs=0.1 * np.trace(expected))


def test_line_with_a_covariance_widens_the_centres_by_it(noisy: Mosaic) -> None:
    """A line as uncertain as the pixels' own: the centres lie between free and known, and their covariance says so."""
    rng = np.random.default_rng(10)
    start = disturbed(noisy.params, rng)
    free = fit_rings(noisy.image, start, limit=LIMIT)
    scatter = np.cov((free.params - noisy.params)[:, M0 : M0 + 2].T)
    spread = np.tile(scatter, (len(start), 1, 1))
    line = noisy.params[:, M0 : M0 + 2] + np.array([rng.multivariate_normal(np.zeros(2), s) for s in spread])
    fits = fit_rings(
        noisy.image, start, limit=LIMIT, line=line, line_information=np.asarray(np.linalg.inv(spread), np.float64)
    )
    error = errors(fits, noisy)
    rms = np.sqrt((error**2).mean())
    assert 0.0045 < rms < 0.0090
    assert 0.87 < np.sqrt(np.trace(fits.cov_px2, axis1=1, axis2=2).mean() / 2) / rms < 1.15


def test_dot_with_known_line_has_an_exact_centre() -> None:
    """One circle is enough if the vanishing line is known; its ellipse's middle would be 0.1 px off."""
    rng = np.random.default_rng(11)
    m = mosaic(random_rings(12, rng, ratio=0.0, tilt_rad=TILT))
    fits = fit_known(m, disturbed(m.params, rng))
    assert np.abs(errors(fits, m)).max() < 0.002
    assert (fits.params[:, RATIO] == 0).all()
    wrong = fit_known(m, disturbed(m.params, rng), line=np.zeros((12, 2)))
    assert np.abs(errors(wrong, m)).max() > 0.08


def test_dot_covariance_is_the_scatter() -> None:
    """Dots of known line scatter as they say."""
    rng = np.random.default_rng(12)
    m = mosaic(random_rings(120, rng, ratio=0.0, tilt_rad=TILT))
    m = Mosaic((m.image + 2 * NOISE * rng.standard_normal(m.image.shape)).astype(np.float32), m.params)
    fits = fit_known(m, disturbed(m.params, rng))
    error = errors(fits, m)
    assert 0.83 < np.sqrt(np.trace(fits.cov_px2, axis1=1, axis2=2).mean() / (error**2).sum(axis=1).mean()) < 1.2


def test_lens_bend_is_undone() -> None:
    """A ring bent by a quadratic form has its projected centre where the form is zero."""
    rng = np.random.default_rng(13)
    ring = Ring(radius_px=30.0, tilt_rad=0.7, axis_rad=1.0)
    p = ring.parameters()
    bend = np.array([3.0, -2.0, 1.5, 1.0, 2.5, -3.0]) * 1e-4
    side = ring.side_px
    place = (np.arange(side * CELL) + 0.5) / CELL - 0.5
    v = np.stack(np.meshgrid(place, place), axis=-1) - p[:2]
    slope = np.linalg.norm(numeric_gradient(p, bend, v), axis=-1)
    ink = np.clip(0.5 - CELL * (distance(p, bend, v) - 1) / slope, 0, 1)
    ink -= np.clip(0.5 - CELL * (distance(p, bend, v) - p[RATIO]) / slope, 0, 1)
    light = cv2.GaussianBlur(WHITE_LEVEL - (WHITE_LEVEL - INK_LEVEL) * ink, (0, 0), ring.blur_px * CELL)
    m = Mosaic(light.reshape(side, CELL, side, CELL).mean(axis=(1, 3)).astype(np.float32), p[None])
    start = disturbed(m.params, rng)
    straight = errors(fit_known(m, start), m)
    bent = errors(fit_known(m, start, bend=bend[None]), m)
    assert np.abs(bent).max() < 0.003
    assert np.abs(straight).max() > 0.05


def test_moving_and_transposing_the_image_moves_and_transposes_the_centres(noisy: Mosaic) -> None:
    """The fit knows no preferred place or axis."""
    rows = slice(0, 30)
    image, params = noisy.image[: 3 * 61], noisy.params[rows]
    start = disturbed(params, np.random.default_rng(14))
    base = fit_rings(image, start, limit=LIMIT)
    moved = start.copy()
    moved[:, :2] += (13, 7)
    shifted = fit_rings(np.pad(image, ((7, 5), (13, 2)), mode="edge"), moved, limit=LIMIT)
    assert shifted.center_px - (13, 7) == pytest.approx(base.center_px, abs=1e-6)
    assert shifted.cov_px2 == pytest.approx(base.cov_px2, rel=1e-4)
    swapped = np.array([transposed(p) for p in start])
    turned = fit_rings(np.ascontiguousarray(image.T), swapped, limit=LIMIT)
    assert turned.center_px[:, ::-1] == pytest.approx(base.center_px, abs=3e-4)
    assert turned.cov_px2[:, ::-1, ::-1] == pytest.approx(base.cov_px2, rel=0.02, abs=1e-6)


def transposed(p: Array) -> Array:
    """The parameters of the same ring with u and v exchanged."""
    out = p.copy()
    plane = np.array([[p[2], 0.0], [p[3], p[4]]])[:, ::-1]
    gram = plane.T @ plane
    e11 = math.sqrt(gram[1, 1])
    out[2:5] = math.sqrt(gram[0, 0] - (gram[0, 1] / e11) ** 2), gram[0, 1] / e11, e11
    for k in (0, M0, 10, 13):
        out[[k, k + 1]] = p[[k + 1, k]]
    return out


def test_results_do_not_depend_on_the_number_of_threads(noisy: Mosaic, monkeypatch: pytest.MonkeyPatch) -> None:
    """One thread or many: the same bits."""
    start = disturbed(noisy.params, np.random.default_rng(15))
    results = []
    for threads in (1, 2, 7):
        monkeypatch.setattr(os, "cpu_count", lambda n=threads: n)
        results.append(fit_rings(noisy.image, start, limit=LIMIT))
    for other in results[1:]:
        assert np.array_equal(other.params, results[0].params)
        assert np.array_equal(other.cov_px2, results[0].cov_px2)


@pytest.mark.parametrize("threads", [None, 1, 3, 64])
@pytest.mark.parametrize("count", [0, 1, 15, 16, 33, 1000])
def test_chunks_cover_each_row_once(count: int, threads: int | None, monkeypatch: pytest.MonkeyPatch) -> None:
    """Whatever the numbers of rows and threads, each row is worked on once."""
    monkeypatch.setattr(os, "cpu_count", lambda: threads)
    done = np.zeros(count, dtype=int)

    def work(first: int, last: int) -> None:
        done[first:last] += 1

    in_chunks(work, count)
    assert (done == 1).all()


def test_an_error_in_a_thread_is_not_lost(monkeypatch: pytest.MonkeyPatch) -> None:
    """What one piece raises reaches the caller."""
    monkeypatch.setattr(os, "cpu_count", lambda: 4)

    def work(first: int, last: int) -> None:
        raise ArithmeticError(f"{first} to {last}")

    with pytest.raises(ArithmeticError):
        in_chunks(work, 200)


def test_bytes_and_floats_agree(noisy: Mosaic) -> None:
    """The same grey levels in the detector's two types give the same bits; 257 times as bright, the same centres."""
    levels = np.rint(noisy.image[:61]).astype(np.uint8)
    start = disturbed(noisy.params[:10], np.random.default_rng(16))
    of_bytes, of_floats = (fit_rings(levels.astype(kind), start, limit=LIMIT) for kind in (np.uint8, np.float32))
    assert np.array_equal(of_floats.params, of_bytes.params)
    start[:, WHITE] *= 257
    bright = fit_rings(levels.astype(np.float32) * 257, start, limit=LIMIT)
    assert bright.center_px == pytest.approx(of_bytes.center_px, abs=1e-4)
    assert bright.cov_px2 == pytest.approx(of_bytes.cov_px2, rel=0.01)


def test_levels_are_found_when_the_centre_starts_right() -> None:
    """A centre that need not move ends no fit whose blur and levels are still wrong."""
    m = mosaic([Ring(tilt_rad=0.5, axis_rad=float(turn)) for turn in range(8)])
    start = m.params.copy()
    start[:, BLUR] *= 1.5
    start[:, DARKNESS] *= 0.7
    fits = fit_rings(m.image, start, limit=LIMIT)
    assert fits.noise.max() < 0.3
    assert fits.params[:, BLUR] == pytest.approx(m.params[:, BLUR], rel=0.02)


def test_nothing_to_fit_fails_cleanly() -> None:
    """Even grey, and places outside the image, give no ring and no crash."""
    p = Ring().parameters()[None]
    for level in (0, 128, 255):
        fits = fit_rings(np.full((61, 61), level, dtype=np.uint8), p, limit=LIMIT)
        assert (~fits.ok | (np.abs(fits.contrast) < 1)).all()
    far = np.repeat(p, 4, axis=0)
    far[:, :2] = (-500, 20), (20, 1e7), (400, 20), (-40, -40)
    assert not fit_rings(np.full((61, 61), 128, dtype=np.uint8), far, limit=LIMIT).ok.any()
    assert len(fit_rings(np.zeros((5, 5), np.uint8), np.zeros((0, PARAMETERS)), limit=LIMIT).ok) == 0


def test_noise_is_no_ring() -> None:
    """Where only noise is, a fit fails or says how little it knows."""
    rng = np.random.default_rng(17)
    image = rng.normal(128, 10, (300, 300)).astype(np.float32)
    start = np.repeat(Ring().parameters()[None], 60, axis=0)
    start[:, :2] = rng.uniform(40, 260, (60, 2))
    fits = fit_rings(image, start, limit=LIMIT)
    sigma = np.sqrt(np.trace(fits.cov_px2, axis1=1, axis2=2))
    faint = fits.contrast < 30
    assert (~fits.ok | (sigma > 0.1) | faint).all()


@pytest.mark.parametrize("share", [0.2, 0.5, 0.8, 0.95])
def test_ring_cut_by_the_border_fails_or_is_right(share: float) -> None:
    """A ring of which a part lies outside gives no centre, or one as good as its covariance says."""
    rng = np.random.default_rng(18)
    m = mosaic(random_rings(1, rng, tilt_rad=0.6), columns=1)
    noise = NOISE * rng.standard_normal((20, *m.image.shape))
    for n in range(20):
        cut = int(share * 30) + 1
        image = np.ascontiguousarray((m.image + noise[n])[:, cut:], dtype=np.float32)
        start = disturbed(m.params, rng)
        start[:, 0] -= cut
        fits = fit_rings(image, start, limit=LIMIT)
        error = fits.center_px[0] - m.center_px[0] + (cut, 0)
        assert not fits.ok[0] or error @ np.linalg.solve(fits.cov_px2[0], error) < 36


def test_neighbours_beyond_the_limit_do_not_disturb() -> None:
    """Pixels farther out than the limit are not used: ink there changes nothing."""
    ring = Ring(tilt_rad=0.5, axis_rad=0.3)
    m = mosaic([ring], columns=1)
    p = m.params[0]
    v, u = np.mgrid[: ring.side_px, : ring.side_px]
    far = distance(p, np.zeros(LENS_NUMBERS), np.stack([u, v], axis=-1) - p[:2]) > 1.21
    spoilt = m.image.copy()
    spoilt[far] = 0
    start = disturbed(m.params, np.random.default_rng(19))
    with_ink = fit_known(Mosaic(spoilt, m.params), start, limit=1.15)
    without = fit_known(m, start, limit=1.15)
    assert with_ink.center_px == pytest.approx(without.center_px, abs=0.002)
