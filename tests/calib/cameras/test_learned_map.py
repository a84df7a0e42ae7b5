"""The learned map: its process, its table, its inverse, what it claims to know, and the camera that sees by it."""

from dataclasses import replace

import numpy as np
import pytest
from sklearn.gaussian_process import GaussianProcessRegressor
from sklearn.gaussian_process.kernels import RBF, ConstantKernel, WhiteKernel

from calib.cameras import project, rays
from calib.cameras.camera import Camera, LearnedMap
from calib.cameras.learn_map import MapSamples, cells_of, learn_from_many, learn_map, log_likelihood
from calib.cameras.learned import (
    exact_point,
    exact_variance,
    jacobian_with,
    kernel,
    known_at,
    spline_of,
    square_distances,
    to_image,
    to_sensor,
    trend_at,
)
from calib.cameras.parameters import slopes
from designer.base.errors import InputError
from tests.support.solver_scenes import SIZE
from tests.support.virtual_scenes import (
    CENTRE_PX,
    FOCAL_PX,
    bent,
    board_in,
    fisheye_map,
    samples_of,
    sensor_of,
    straight,
    virtual_camera,
    wavy_map,
)

NOISE_PX = 0.05


@pytest.fixture(scope="module")
def wavy() -> LearnedMap:
    """A map learned from a grid over the whole image, with noise."""
    return wavy_map(NOISE_PX)


def pixels(count: int = 3000, seed: int = 5) -> np.ndarray:
    """Pixels all over the image."""
    return np.random.default_rng(seed).uniform([0, 0], np.array(SIZE) - 1, (count, 2))


def test_map_is_scikit_learns_prediction(wavy: LearnedMap) -> None:
    """Mean and standard deviation are those of scikit-learn's process with the same knots, kernel and noise."""
    kernel = RBF(wavy.length_px)
    targets = exact_point(wavy, wavy.knot_px) - trend_at(wavy.trend, wavy.knot_px)
    targets += wavy.noise_variance[:, None] * wavy.weight  # (K + D) w = y, and K w is what the map holds
    oracle = GaussianProcessRegressor(kernel, alpha=wavy.noise_variance, optimizer=None).fit(wavy.knot_px, targets)
    pixel = pixels()
    mean, deviation = oracle.predict(pixel, return_std=True)
    assert np.abs(exact_point(wavy, pixel) - trend_at(wavy.trend, pixel) - mean).max() < 1e-6
    assert np.sqrt(exact_variance(wavy, pixel)) == pytest.approx(deviation[:, 0], rel=1e-4, abs=1e-7)


@pytest.mark.parametrize("numbers", [(40.0, 300.0), (40.0, 300.0, 0.1)])
def test_likelihood_is_scikit_learns(numbers: tuple[float, ...]) -> None:
    """The logarithm of the likelihood and its derivatives are scikit-learn's, also with an even noise."""
    rng = np.random.default_rng(0)
    pixel, values, noise = rng.uniform(0, 1000, (60, 2)), rng.normal(0, 9, (60, 2)), rng.uniform(0.01, 0.3, 60)
    kernel = ConstantKernel(numbers[0]) * RBF(numbers[1])
    if len(numbers) > 2:
        kernel += WhiteKernel(numbers[2])
    oracle = GaussianProcessRegressor(kernel, alpha=noise, optimizer=None).fit(pixel, values)
    expected, slope = oracle.log_marginal_likelihood(kernel.theta, eval_gradient=True)
    found = log_likelihood(square_distances(pixel, pixel), values, noise, np.array(numbers))
    assert found[0] == pytest.approx(expected, rel=1e-12)
    assert found[1] == pytest.approx(slope, rel=1e-9)
    assert found[2] == pytest.approx(oracle.alpha_, rel=1e-9, abs=1e-12)


def test_table_is_the_sum_over_knots(wavy: LearnedMap) -> None:
    """The table differs from the sum by less than 1e-5 px, its derivatives from those of the sum by less than 1e-7."""
    pixel = pixels()
    moved = to_sensor(wavy, SIZE, pixel)
    assert np.abs(moved.point - exact_point(wavy, pixel)).max() < 1e-5
    for axis in range(2):
        step = np.eye(2)[axis]
        slope = (exact_point(wavy, pixel + step) - exact_point(wavy, pixel - step)) / 2
        assert np.abs(moved.jacobian[:, :, axis] - slope).max() < 2e-6  # of the difference quotient
    assert np.abs(moved.jacobian - jacobian_with(wavy, pixel, kernel(pixel, wavy.knot_px, wavy.length_px))).max() < 1e-7


def test_inverse_is_exact(wavy: LearnedMap) -> None:
    """Where the map is known, its inverse gives the pixel back to 1e-10 px."""
    pixel = pixels()
    known = known_at(wavy, SIZE, pixel)
    back = to_image(wavy, SIZE, to_sensor(wavy, SIZE, pixel).point)
    assert known.mean() > 0.9
    assert np.abs(back - pixel)[known].max() < 1e-10


def test_inverse_of_a_strong_fisheye_is_exact() -> None:
    """The inverse finds the pixel where the map stretches the edge of the image several times."""
    learned, pixel = fisheye_map(), pixels()
    known = known_at(learned, SIZE, pixel)
    moved = to_sensor(learned, SIZE, pixel)
    stretch = np.linalg.svd(moved.jacobian, compute_uv=False)[known, 0]
    assert known.mean() > 0.9
    assert stretch.max() > 3 * stretch.min()
    assert np.abs(to_image(learned, SIZE, moved.point) - pixel)[known].max() < 1e-10


def test_nothing_maps_to_far_points_of_the_sensor(wavy: LearnedMap) -> None:
    """A point of the sensor that no pixel of the image is mapped to has no pixel."""
    far = np.array([[-1e4, 0], [0, 1e9], [np.nan, 0], [np.inf, 0], [5e3, 5e3]])
    assert np.isnan(to_image(wavy, SIZE, far)).all()


def test_known_is_what_the_variance_says(wavy: LearnedMap) -> None:
    """A pixel is known where the standard deviation is within the limit, but for a seam; beyond the edge never."""
    part = wavy_map(NOISE_PX, span=(0.3, 0.7))
    pixel = pixels()
    deviation = np.sqrt(exact_variance(part, pixel))
    known = known_at(part, SIZE, pixel)
    assert 0.1 < known.mean() < 0.6
    assert known[deviation < 0.9 * part.limit].all()
    assert not known[deviation > 1.1 * part.limit].any()
    outside = np.array([[-1.0, 1000], [2448, 1000], [1200, -1], [1200, 2048], [np.nan, 5]])
    assert not known_at(wavy, SIZE, outside).any()


def test_what_is_known_is_true() -> None:
    """Where the map is known, beyond its data too, it is off by hardly more than a measurement is."""
    for seed in range(3):
        part = wavy_map(NOISE_PX, seed, span=(0.25, 0.75))
        pixel = pixels(seed=seed)
        known = known_at(part, SIZE, pixel)
        off = to_sensor(part, SIZE, pixel).point - straight(pixel)
        assert np.sqrt((off[known] ** 2).mean()) < 0.7 * NOISE_PX
        assert np.abs(off[known]).max() < 6 * NOISE_PX
        assert np.abs(off[~known]).max() > 20 * NOISE_PX  # what is masked had to be


def test_map_of_no_distortion_is_a_homography() -> None:
    """A pinhole's image of a tilted plane gives its homography, everywhere in the image."""
    truth = np.array([[1.1, 0.05, -80], [-0.02, 0.95, 30], [6e-5, -4e-5, 1]])
    pixel = sensor_of(board_in((0.02, 0.98)))
    learned = learn_map(samples_of(pixel, trend_at(truth, pixel)), SIZE).map
    everywhere = pixels()
    assert np.abs(to_sensor(learned, SIZE, everywhere).point - trend_at(truth, everywhere)).max() < 1e-6


def test_errors_are_as_large_as_the_process_says() -> None:
    """The map's errors, over the standard deviations it states, have a root mean square of about 1."""
    direction = board_in((0.02, 0.98))
    ratio = []
    for seed in range(3):
        noise = NOISE_PX * np.random.default_rng(seed).standard_normal((len(direction), 2))
        learned = learn_map(samples_of(bent(sensor_of(direction)) + noise, sensor_of(direction)), SIZE)
        inside = pixels(seed=seed) * 0.9 + 0.05 * np.array(SIZE)
        off = exact_point(learned.map, inside) - straight(inside)
        deviation = learned.process.amplitude_px * np.sqrt(exact_variance(learned.map, inside))
        ratio.append((off / deviation[:, None]) ** 2)
        assert learned.process.noise_factor**0.5 == pytest.approx(NOISE_PX, rel=0.1)
    assert 0.7 < np.sqrt(np.mean(ratio)) < 1.3


def test_noise_is_that_of_the_pixel() -> None:
    """Points of large variance draw the map less: it is better with the variances than without."""
    direction = board_in((0.02, 0.98))
    rng = np.random.default_rng(2)
    sigma = np.where(rng.random(len(direction)) < 0.5, 0.02, 0.4)
    pixel = bent(sensor_of(direction)) + sigma[:, None] * rng.standard_normal((len(direction), 2))
    with_variances = MapSamples(pixel, sensor_of(direction), sigma**2, np.ones(len(pixel), dtype=np.int64))
    inside = pixels() * 0.9 + 0.05 * np.array(SIZE)
    off = [
        np.sqrt(((exact_point(learn_map(samples, SIZE).map, inside) - straight(inside)) ** 2).mean())
        for samples in (with_variances, samples_of(pixel, sensor_of(direction)))
    ]
    assert off[0] < 0.4 * off[1]


def test_learning_is_repeatable(wavy: LearnedMap) -> None:
    """The same data give the same map, bit for bit."""
    one, other = wavy, wavy_map.__wrapped__(NOISE_PX)
    assert np.array_equal(one.weight, other.weight)
    assert (one.length_px, one.limit) == (other.length_px, other.limit)


def test_many_samples_are_averaged_without_loss() -> None:
    """A map of 1600 points, averaged in cells, is as good as one of all of them."""
    direction = board_in((0.02, 0.98), 40, 40)
    noise = NOISE_PX * np.random.default_rng(1).standard_normal((len(direction), 2))
    samples = samples_of(bent(sensor_of(direction)) + noise, sensor_of(direction))
    learned = learn_from_many(samples, SIZE)
    assert len(learned.map.knot_px) <= 600
    whole = learn_map(samples, SIZE, learned.process, improve=False)
    inside = pixels() * 0.9 + 0.05 * np.array(SIZE)
    truth = straight(inside)
    off, best = (np.sqrt(((exact_point(one.map, inside) - truth) ** 2).mean()) for one in (learned, whole))
    assert off < 1.1 * best


def test_cells_hold_weighted_means() -> None:
    """Each cell's values are the means of its sightings, weighed inversely to their variances; no cell is empty."""
    rng = np.random.default_rng(0)
    pixel, variance, values = rng.uniform(0, 1000, (500, 2)), rng.uniform(0.5, 2, 500), rng.normal(size=(500, 2))
    cells = cells_of(pixel, variance, 60)
    assert 40 < len(cells.pixel) <= 60
    used = rng.random(500) < 0.7
    mean = cells.mean(values, used)
    for cell in range(len(cells.pixel)):
        inside = cells.of_sighting == cell
        assert np.ptp(pixel[inside], axis=0).max() < 1000 / 5
        assert cells.pixel[cell] == pytest.approx(np.average(pixel[inside], axis=0, weights=1 / variance[inside]))
        assert cells.variance[cell] == pytest.approx(1 / (1 / variance[inside]).sum())
        assert cells.measurements[cell] == inside.sum()
        inside &= used
        if inside.any():
            assert mean[cell] == pytest.approx(np.average(values[inside], axis=0, weights=1 / variance[inside]))


def test_tables_stay_small() -> None:
    """A map of a kernel much longer than the image has a table of few nodes, and a short one of not too many."""
    knots = sensor_of(board_in((0.02, 0.98), 8, 8))
    for length, most in ((1e5, 100), (max(SIZE) / 40, 1_100_000)):
        learned = LearnedMap(knots, np.ones((64, 2)), np.full(64, 1e-4), np.eye(3), length, 0.1)
        assert spline_of(learned, SIZE).node.shape[0] * spline_of(learned, SIZE).node.shape[1] <= most


def test_too_few_samples_are_refused() -> None:
    """A map of a handful of points is refused in one line."""
    pixel = np.random.default_rng(0).uniform(0, FOCAL_PX, (11, 2))
    with pytest.raises(InputError, match="11 points to learn a map"):
        learn_map(samples_of(pixel, pixel), SIZE)


@pytest.fixture(scope="module", params=["waves", "fisheye", "part of the image"])
def camera(request: pytest.FixtureRequest) -> Camera:
    """Virtual cameras behind different lenses."""
    if request.param == "waves":
        return virtual_camera(wavy_map(0.02))
    if request.param == "part of the image":
        return virtual_camera(wavy_map(0.02, span=(0.3, 0.7)))
    return virtual_camera(fisheye_map())


def test_rays_of_projected_points_are_parallel(camera: Camera) -> None:
    """rays(project(x)) is parallel to x; a point has an image exactly if a known pixel's ray meets it."""
    direction = np.column_stack([np.random.default_rng(2).uniform(-1.5, 1.5, (20000, 2)), np.ones(20000)])
    direction /= np.linalg.norm(direction, axis=1, keepdims=True)
    pixel = project(camera, 357 * direction)
    seen = np.isfinite(pixel).all(axis=1)
    assert seen.sum() > 100
    assert np.abs(rays(camera, pixel[seen]) - direction[seen]).max() < 1e-12
    assert camera.learned is not None
    assert known_at(camera.learned, SIZE, pixel[seen]).all()


def test_rays_are_those_of_the_lens() -> None:
    """The rays behind a wavy lens are those of the pinhole that saw the plane, to what the noise allows."""
    camera = replace(virtual_camera(wavy_map(0.02)), params=np.array([FOCAL_PX, FOCAL_PX, *CENTRE_PX]))
    pixel = np.random.default_rng(3).uniform(100, np.array(SIZE) - 100, (2000, 2))
    off = FOCAL_PX * slopes(rays(camera, pixel)) + CENTRE_PX - straight(pixel)
    assert np.sqrt((off**2).mean()) < 0.01


def test_a_map_is_needed() -> None:
    """A virtual camera without a map is a mistake of the program, and said so."""
    with pytest.raises(ValueError, match="needs a learned map"):
        rays(Camera("virtual", np.array([1.0, 1, 0, 0]), SIZE), np.zeros((1, 2)))
