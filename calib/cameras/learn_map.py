"""Learning the map from measured pixels to a distortion-free sensor, by Gaussian-process regression.

With `K = variance exp(-d^2 / (2 length^2)) + diag(noise)` over the samples' distances d, and y a column of their
values, `log p = -y' K^-1 y / 2 - log |K| / 2 - n log(2 pi) / 2`, and its derivative by what K depends on is
`tr((w w' - K^-1) dK) / 2` with the weights `w = K^-1 y`. Columns are independent: their likelihoods add up.

The targets of the regression are points of the sensor whose pixels were measured; what a homography does not explain
of them is the process's. Its amplitude and length are those of the greatest marginal likelihood (Rasmussen and
Williams 2006, eq. 5.8), within bounds that keep unknown what is far from all data. Nothing is random: the same data
give the same map.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from calib.cameras.camera import MAX_LENGTHS, LearnedMap
from calib.cameras.learned import correlation, jacobian_with, square_distances, to_sensor, trend_at
from calib.core.homography import fit
from calib.core.parallel import one_thread_with_scipy
from designer.base.arrays import Array, Flags, Rows
from designer.base.errors import InputError

MAX_CELLS = 600
SHRINK = 0.95
SMALL_CHANGE = 1e-6
"""Ends the search for the greatest likelihood, as a part of its logarithm."""
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
THINNED_ROUNDS = 4
IMPROVED_ROUND = 2
"""Of them, beside the first, finds the most likely process."""


@dataclass(frozen=True, eq=False)
class Cells:
    """The image in N cells: which of them M sightings lie in, and where on average."""

    of_sighting: Rows  # (M,)
    share: Array  # (M,) of a sighting in its cell's mean
    pixel: Array  # (N, 2)
    variance: Array  # (N,) of the mean, in units of the sightings' variances
    measurements: Rows  # (N,) how many sightings it holds

    def mean(self, values: Array, used: Flags | None = None) -> Array:
        """Means (N, 2) of the values (M, 2) of the sightings used; 0 in cells without any."""
        count = len(self.pixel)
        share = self.share if used is None else self.share * used
        total = np.bincount(self.of_sighting, share, count)
        columns = [np.bincount(self.of_sighting, share * column, count) for column in values.T]
        return np.stack(columns, axis=1) / np.where(total > 0, total, 1.0)[:, None]


def cells_of(pixel: Array, variance: Array, most: int = MAX_CELLS) -> Cells:
    """Square cells, as small as may be for at most `most` to hold a pixel; these count inversely to their variance."""
    offset = pixel - pixel.min(axis=0)
    extent = np.ptp(pixel, axis=0)
    # Cells of this size are too few by far, unless all lie in a row.
    side = max(2 * float(np.sqrt(extent.prod() / most)), 2 * float(extent.max()) / most) + 1.0
    of_sighting = _cell_numbers(offset, side)
    while side > 1e-3 and (finer := _cell_numbers(offset, SHRINK * side)).max() < most:
        side, of_sighting = SHRINK * side, finer
    total = np.bincount(of_sighting, 1 / variance)
    share = 1 / (variance * total[of_sighting])
    mean: Array = np.stack([np.bincount(of_sighting, share * column) for column in pixel.T], axis=1, dtype=np.float64)
    return Cells(of_sighting, share, mean, 1 / total, np.bincount(of_sighting))


def _cell_numbers(offset: Array, side: float) -> Rows:
    """Number of the cell of each offset (M, 2), without gaps."""
    column, row = np.floor(offset / side).astype(np.int64).T
    numbers: Rows = np.unique(row * (column.max() + 1) + column, return_inverse=True)[1]
    return numbers


def weights_of(values: Array, gram: Array) -> Array:
    """`K^-1 y` of columns of values (N, 2) and K (N, N), which is overwritten."""
    from scipy.linalg.lapack import dpotrs

    solved: Array = dpotrs(_factor(gram), values, lower=1)[0]
    return solved


def likeliest(
    square_px2: Array, values: Array, noise: Array, start: Sequence[float], bounds: Sequence[tuple[float, float]]
) -> tuple[Array, Array]:
    """Variance, length and, if there is a third, even noise of the greatest likelihood within bounds; weights there.

    Of values (N, 2) at samples whose squared distances are (N, N) and whose noise is known to be (N,) at least.
    """
    from scipy.optimize import minimize

    def objective(logarithm: Array) -> tuple[float, Array]:
        likelihood, slope, _ = log_likelihood(square_px2, values, noise, np.exp(logarithm))
        return -likelihood, -slope

    found = minimize(
        objective, np.log(start), method="L-BFGS-B", jac=True, bounds=np.log(bounds), options={"ftol": SMALL_CHANGE}
    )
    process = np.exp(found.x)
    return process, log_likelihood(square_px2, values, noise, process)[2]


def log_likelihood(square_px2: Array, values: Array, noise: Array, process: Array) -> tuple[float, Array, Array]:
    """The logarithm of the likelihood, its derivatives by those of the process's numbers, and the weights (N, 2).

    The process has a variance, a length and, if there is a third number, noise besides that known beforehand (N,).
    """
    from scipy.linalg.lapack import dpotri, dpotrs

    variance, length, *even = process.tolist()
    count, columns = values.shape
    noise = noise + sum(even)
    signal = variance * correlation(square_px2, length)
    gram = signal.copy()
    gram[np.diag_indices(count)] += noise
    try:
        factor = _factor(gram)
    except np.linalg.LinAlgError:
        return -np.inf, np.zeros(len(process)), np.zeros_like(values)
    log_root = float(np.log(np.diagonal(factor)).sum())
    weight = dpotrs(factor, values, lower=1)[0]
    below = dpotri(factor, lower=1, overwrite_c=1)[0].T  # the inverse's triangle, the other one zero
    inverse_diagonal = np.diagonal(below)
    signal *= square_px2
    slope = [
        (weight * values).sum() - (noise @ weight**2).sum() - columns * (count - inverse_diagonal @ noise),
        ((weight * (signal @ weight)).sum() - 2 * columns * np.vdot(below, signal)) / length**2,
        *(one * ((weight**2).sum() - columns * inverse_diagonal.sum()) for one in even),
    ]
    likelihood = -0.5 * float((weight * values).sum()) - columns * (log_root + 0.5 * count * np.log(2 * np.pi))
    return likelihood, 0.5 * np.array(slope), weight


def _factor(gram: Array) -> Array:
    """The lower Cholesky factor of a symmetric matrix, in its place and in Fortran's order, zero above the diagonal."""
    from scipy.linalg.lapack import dpotrf

    factor, failed = dpotrf(gram.T, lower=1, overwrite_a=1)
    if failed:
        raise np.linalg.LinAlgError("not positive definite")
    return np.asarray(factor)


@dataclass(frozen=True, eq=False)
class MapSamples:
    """N pixels whose points on the sensor are known."""

    pixel: Array  # (N, 2)
    point: Array  # (N, 2) in units of the sensor, about a pixel each
    variance: Array  # (N,) of a coordinate of the pixel, up to a common factor
    measurements: Rows  # (N,) how many each is the mean of

    def part(self, kept: Flags) -> "MapSamples":
        """Some of the samples.  # (N,)"""
        return MapSamples(self.pixel[kept], self.point[kept], self.variance[kept], self.measurements[kept])


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

    samples: MapSamples
    image_size: tuple[int, int]
    trend: Array  # (3, 3)
    rest: Array  # (N, 2) what the homography leaves of the points
    square_px2: Array  # (N, N) squared distances of the pixels

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
    samples: MapSamples, image_size: tuple[int, int], process: Process | None = None, *, improve: bool = True
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
    rest = samples.point - trend_at(trend, samples.pixel)
    task = _Task(samples, image_size, trend, rest, square_distances(samples.pixel, samples.pixel))
    return _learned(task, process, improve=improve)


@one_thread_with_scipy
def _learned(task: _Task, process: Process | None, *, improve: bool) -> Learned:
    nothing = np.zeros_like(task.rest)
    stretch = _stretch(task, LearnedMap(task.samples.pixel, nothing, nothing[:, 0], task.trend, 1.0, 1.0))
    process = process or _first_process(task, stretch)
    for _ in range(ROUNDS if improve else 0):
        # The noise is that of the measured pixel, so it depends on how the map stretches there.
        stretch = _stretch(task, _conditioned(task, stretch, process))
        process = _better_process(task, stretch, process)
    stretch = _stretch(task, _conditioned(task, stretch, process))
    return Learned(_conditioned(task, stretch, process), process)


def learn_from_many(samples: MapSamples, image_size: tuple[int, int]) -> Learned:
    """Learn the map from any number of samples, averaged in cells of the image if they are too many.

    What is averaged is how far they lie from the map so far, because that hardly changes in a cell.
    """
    if len(samples.pixel) <= MAX_CELLS:
        return learn_map(samples, image_size)
    cells = cells_of(samples.pixel, samples.variance)
    trend, _, _ = fit(samples.pixel, samples.point, 1 / samples.variance)
    point = trend_at(trend, cells.pixel) + cells.mean(samples.point - trend_at(trend, samples.pixel))
    learned = learn_map(MapSamples(cells.pixel, point, cells.variance, cells.measurements), image_size)
    for count in range(1, THINNED_ROUNDS):
        at_cells = to_sensor(learned.map, image_size, cells.pixel).point
        at_samples = to_sensor(learned.map, image_size, samples.pixel).point
        point = at_cells + cells.mean(samples.point - at_samples)
        thinned = MapSamples(cells.pixel, point, cells.variance, cells.measurements)
        learned = learn_map(thinned, image_size, learned.process, improve=count == IMPROVED_ROUND)
    return learned


def _stretch(task: _Task, learned: LearnedMap) -> Array:
    """Mean square stretch of a map at its knots, the samples: what of a pixel's variance reaches the sensor.  # (N,)"""
    jacobian = jacobian_with(learned, task.samples.pixel, correlation(task.square_px2, learned.length_px))
    stretch: Array = 0.5 * (jacobian**2).sum(axis=(1, 2))
    return stretch


def _first_process(task: _Task, stretch: Array) -> Process:
    """Amplitude, length and an even noise by the marginal likelihood of some of the samples."""
    low, high = task.length_bounds_px
    some = np.unique(np.linspace(0, len(task.rest) - 1, FEW).astype(np.int64))
    square = float(np.clip(100 * (task.rest**2).mean(), AMPLITUDE_PX[0] ** 2, AMPLITUDE_PX[1] ** 2))
    (variance, length, noise), _ = likeliest(
        task.square_px2[np.ix_(some, some)],
        task.rest[some],
        np.full(len(some), LEAST_NOISE * square),
        (square, np.sqrt(low * high), 1e-3),
        (_squares(AMPLITUDE_PX), (low, high), _squares(NOISE_PX)),
    )
    return Process(float(np.sqrt(variance)), float(length), float(noise / np.median(task.variance(stretch))))


def _better_process(task: _Task, stretch: Array, process: Process) -> Process:
    """Amplitude and length by marginal likelihood with the noise of each sample, then the best common factor.

    With amplitude and noise both times f the likelihood is greatest at `f = y' (K + noise)^-1 y / n`.
    """
    noise = task.variance(stretch, process.noise_factor)
    low, high = _squares(AMPLITUDE_PX)
    highest = float(np.clip(noise.min() / LEAST_NOISE, low, high))
    start = min(process.amplitude_px**2, highest), process.length_px
    (variance, length), weight = likeliest(
        task.square_px2, task.rest, noise, start, ((low, highest), task.length_bounds_px)
    )
    factor = float((task.rest * weight).sum() / task.rest.size)
    least, most = np.array(_squares(NOISE_PX)) / np.median(task.variance(stretch))
    return Process(float(np.sqrt(variance)), float(length), float(np.clip(process.noise_factor * factor, least, most)))


def _squares(bounds: tuple[float, float]) -> tuple[float, float]:
    """Bounds of a variance, of those of a standard deviation."""
    return bounds[0] ** 2, bounds[1] ** 2


def _conditioned(task: _Task, stretch: Array, process: Process) -> LearnedMap:
    """The process given the samples."""
    noise = np.maximum(task.variance(stretch, process.noise_factor) / process.amplitude_px**2, LEAST_NOISE)
    gram = correlation(task.square_px2, process.length_px)
    gram[np.diag_indices_from(gram)] += noise
    single = float(np.sqrt(np.quantile(noise * task.samples.measurements, KNOWN_SHARE)))
    return LearnedMap(
        knot_px=task.samples.pixel,
        weight=weights_of(task.rest, gram),
        noise_variance=noise,
        trend=task.trend,
        length_px=process.length_px,
        limit=min(max(single, KNOWN_PX / process.amplitude_px), LARGEST_LIMIT),
    )
