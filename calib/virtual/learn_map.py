"""Learning the map from measured pixels to a distortion-free sensor, by Gaussian-process regression.

The targets of the regression are points of the sensor whose pixels were measured; what a homography does not explain
of them is the process's. Its amplitude and length are those of the greatest marginal likelihood (Rasmussen and
Williams 2006, eq. 5.8; scikit-learn's `GaussianProcessRegressor`), within bounds that keep unknown what is far from
all data. Nothing is random: the same data give the same map.
"""

import warnings
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from calib.cameras.learned import MAX_LENGTHS, exact_jacobian, to_sensor, trend_at
from calib.detect.homography import fit
from calib.one_thread import one_thread
from calib.types import LearnedMap
from calib.virtual.image_cells import MAX_CELLS, cells_of
from designer.errors import InputError

Array = NDArray[np.float64]
Objective = Callable[[Array], tuple[float, Array]]

MIN_SAMPLES = 12
AMPLITUDE_PX = (1.0, 1e4)
"""Bounds of the process's standard deviation. That a lens bends nothing by a pixel is never taken for granted."""
LENGTH = (0.05, 1.0)
"""Bounds of the process's length, in diagonals of the data: a longer one would claim to know what is far from them."""
NOISE_PX = (1e-4, 10.0)
"""Bounds of the standard deviation of a measurement."""
LEAST_NOISE = 1e-11
"""Variance of a sample, in units of the process's; below it the equations are singular in floating point."""
KNOWN_SHARE = 0.9
"""The map is known where its standard deviation is not above that of this share of the measurements,"""
KNOWN_PX = 0.005
"""or not above this."""
LARGEST_LIMIT = 0.5
FEW = 250
"""Samples that the first guess of the process is made of."""
ROUNDS = 2
LIKELIHOOD_CHANGE = 1e-6
"""Ends the search for the greatest likelihood, as a part of its logarithm."""
THINNED_ROUNDS = 4
IMPROVED_ROUND = 2
"""Of them, beside the first, finds the most likely process."""


@dataclass(frozen=True, eq=False)
class Samples:
    """N pixels whose points on the sensor are known."""

    pixel: Array  # (N, 2)
    point: Array  # (N, 2) in units of the sensor, about a pixel each
    variance: Array  # (N,) of a coordinate of the pixel, up to a common factor
    measurements: NDArray[np.int64]  # (N,) how many each is the mean of

    def part(self, kept: NDArray[np.bool_]) -> "Samples":
        """Some of the samples.  # (N,)"""
        return Samples(self.pixel[kept], self.point[kept], self.variance[kept], self.measurements[kept])


@dataclass(frozen=True)
class Process:
    """What the marginal likelihood decides."""

    amplitude_px: float  # standard deviation of the process, in units of the sensor
    length_px: float
    noise_factor: float  # what the samples' variances are to be multiplied by


@dataclass(frozen=True, eq=False)
class Learned:
    """A map and the process it was learned with."""

    map: LearnedMap
    process: Process


@dataclass(frozen=True, eq=False)
class _Task:
    """What the process is to explain."""

    samples: Samples
    image_size: tuple[int, int]
    trend: Array  # (3, 3)
    rest: Array  # (N, 2) what the homography leaves of the points

    @property
    def length_bounds_px(self) -> tuple[float, float]:
        """The bounds of the length."""
        diagonal = float(np.linalg.norm(np.ptp(self.samples.pixel, axis=0)))
        least = max(LENGTH[0] * diagonal, max(self.image_size) / MAX_LENGTHS)
        return least, max(LENGTH[1] * diagonal, 2 * least)

    def variance(self, stretch: Array, factor: float = 1.0) -> Array:
        """Variances of the samples' points, with the mean square stretch (N,) from the image to the sensor."""
        return factor * self.samples.variance * stretch


def learn_map(
    samples: Samples, image_size: tuple[int, int], process: Process | None = None, *, improve: bool = True
) -> Learned:
    """Learn the map from samples.

    Args:
        samples: at least `MIN_SAMPLES`, not on a line; the time grows with the third power of their number.
        image_size: width and height of the image in px.
        process: of an earlier map from like samples.
        improve: find the most likely process, from that one if it is given.

    Raises:
        InputError: too few samples.
    """
    if len(samples.pixel) < MIN_SAMPLES:
        raise InputError(
            f"{len(samples.pixel)} points to learn a map of the lens from; at least {MIN_SAMPLES} are needed: "
            "take a photo that shows more of the target"
        )
    trend, _, _ = fit(samples.pixel, samples.point, 1 / samples.variance)
    task = _Task(samples, image_size, trend, samples.point - trend_at(trend, samples.pixel))
    return _learned(task, process, improve=improve)


@one_thread
def _learned(task: _Task, process: Process | None, *, improve: bool) -> Learned:
    pixel = task.samples.pixel
    only_trend = LearnedMap(np.zeros((0, 2)), np.zeros((0, 2)), np.zeros(0), task.trend, 1.0, 1.0)
    stretch = _stretch(only_trend, pixel)
    process = process or _first_process(task, stretch)
    for _ in range(ROUNDS if improve else 0):
        # The noise is that of the measured pixel, so it depends on how the map stretches there.
        stretch = _stretch(_conditioned(task, stretch, process), pixel)
        process = _better_process(task, stretch, process)
    stretch = _stretch(_conditioned(task, stretch, process), pixel)
    return Learned(_conditioned(task, stretch, process), process)


def learn_from_many(samples: Samples, image_size: tuple[int, int]) -> Learned:
    """Learn the map from any number of samples, averaged in cells of the image if they are too many.

    What is averaged is how far they lie from the map so far, because that hardly changes in a cell.
    """
    if len(samples.pixel) <= MAX_CELLS:
        return learn_map(samples, image_size)
    cells = cells_of(samples.pixel, samples.variance)
    trend, _, _ = fit(samples.pixel, samples.point, 1 / samples.variance)
    point = trend_at(trend, cells.pixel) + cells.mean(samples.point - trend_at(trend, samples.pixel))
    learned = learn_map(Samples(cells.pixel, point, cells.variance, cells.measurements), image_size)
    for count in range(1, THINNED_ROUNDS):
        at_cells = to_sensor(learned.map, image_size, cells.pixel).point
        at_samples = to_sensor(learned.map, image_size, samples.pixel).point
        point = at_cells + cells.mean(samples.point - at_samples)
        thinned = Samples(cells.pixel, point, cells.variance, cells.measurements)
        learned = learn_map(thinned, image_size, learned.process, improve=count == IMPROVED_ROUND)
    return learned


def _stretch(learned: LearnedMap, pixel: Array) -> Array:
    """Mean square stretch of a map at pixels (N, 2): how much of a pixel's variance reaches the sensor.  # (N,)"""
    stretch: Array = 0.5 * (exact_jacobian(learned, pixel) ** 2).sum(axis=(1, 2))
    return stretch


def _first_process(task: _Task, stretch: Array) -> Process:
    """Amplitude, length and an even noise by the marginal likelihood of some of the samples."""
    from sklearn.gaussian_process import GaussianProcessRegressor
    from sklearn.gaussian_process.kernels import RBF, ConstantKernel, WhiteKernel

    low, high = task.length_bounds_px
    some = np.unique(np.linspace(0, len(task.rest) - 1, FEW).astype(np.int64))
    square = float(np.clip(100 * (task.rest**2).mean(), AMPLITUDE_PX[0] ** 2, AMPLITUDE_PX[1] ** 2))
    kernel = ConstantKernel(square, (AMPLITUDE_PX[0] ** 2, AMPLITUDE_PX[1] ** 2)) * RBF(
        np.sqrt(low * high), (low, high)
    ) + WhiteKernel(1e-3, (NOISE_PX[0] ** 2, NOISE_PX[1] ** 2))
    process = GaussianProcessRegressor(kernel, alpha=LEAST_NOISE * square, optimizer=_most_likely)
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")  # that a bound is reached is no fault
        found = process.fit(task.samples.pixel[some], task.rest[some]).kernel_
    return Process(
        float(np.sqrt(found.k1.k1.constant_value)),
        float(found.k1.k2.length_scale),
        float(found.k2.noise_level / np.median(task.variance(stretch))),
    )


def _better_process(task: _Task, stretch: Array, process: Process) -> Process:
    """Amplitude and length by marginal likelihood with the noise of each sample, then the best common factor.

    With amplitude and noise both times f the likelihood is greatest at `f = y' (K + noise)^-1 y / n`.
    """
    from sklearn.gaussian_process import GaussianProcessRegressor
    from sklearn.gaussian_process.kernels import RBF, ConstantKernel

    noise = task.variance(stretch, process.noise_factor)
    highest = float(np.clip(noise.min() / LEAST_NOISE, AMPLITUDE_PX[0] ** 2, AMPLITUDE_PX[1] ** 2))
    kernel = ConstantKernel(min(process.amplitude_px**2, highest), (AMPLITUDE_PX[0] ** 2, highest)) * RBF(
        process.length_px, task.length_bounds_px
    )
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        found = GaussianProcessRegressor(kernel, alpha=noise, optimizer=_most_likely)
        found.fit(task.samples.pixel, task.rest)
    factor = float((task.rest * found.alpha_).sum() / task.rest.size)
    least, most = (bound**2 / float(np.median(task.variance(stretch))) for bound in NOISE_PX)
    return Process(
        float(np.sqrt(found.kernel_.k1.constant_value)),
        float(found.kernel_.k2.length_scale),
        float(np.clip(process.noise_factor * factor, least, most)),
    )


def _most_likely(objective: Objective, start: Array, bounds: Array) -> tuple[Array, float]:
    """Where the marginal likelihood, of which `objective` is the negative logarithm, is greatest."""
    from scipy.optimize import minimize

    found = minimize(objective, start, method="L-BFGS-B", jac=True, bounds=bounds, options={"ftol": LIKELIHOOD_CHANGE})
    return found.x, float(found.fun)


def _conditioned(task: _Task, stretch: Array, process: Process) -> LearnedMap:
    """The process given the samples."""
    from sklearn.gaussian_process import GaussianProcessRegressor
    from sklearn.gaussian_process.kernels import RBF

    pixel = task.samples.pixel
    noise = np.maximum(task.variance(stretch, process.noise_factor) / process.amplitude_px**2, LEAST_NOISE)
    found = GaussianProcessRegressor(RBF(process.length_px), alpha=noise, optimizer=None).fit(pixel, task.rest)
    single = float(np.sqrt(np.quantile(noise * task.samples.measurements, KNOWN_SHARE)))
    return LearnedMap(
        knot_px=pixel,
        weight=found.alpha_,
        noise_variance=noise,
        trend=task.trend,
        length_px=process.length_px,
        limit=min(max(single, KNOWN_PX / process.amplitude_px), LARGEST_LIMIT),
    )
