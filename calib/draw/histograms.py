"""Histograms: how large the errors of a metric are, and residuals against the Gaussian."""

from typing import TYPE_CHECKING

import numpy as np

from calib.draw.style import BLUE, ORANGE, VERMILION, AxesDrawing, nothing, open_axes
from calib.solver.metrics.evaluation import Evaluation
from calib.solver.outliers import whitened
from calib.solver.problem import whiteners
from designer.base.arrays import Array
from designer.base.words import figure as digits

if TYPE_CHECKING:
    from matplotlib.axes import Axes


FEWEST_BINS, MOST_BINS = 10, 40
FEWEST_OF_RESIDUALS, MOST_OF_RESIDUALS = 15, 61
SHOWN_PERCENT = 99.5
"""The largest errors are counted in the last bin, so that one of thousands does not set the scale."""
ROOM = 1.45
"""Height over the highest bar, for the legend, which no line may cross."""


def _draw_sizes(axes: "Axes", sizes: Array, unit: str) -> None:
    """A histogram of the lengths (N,) of error vectors, with their root mean square and 95 % marked."""
    open_axes(axes, f"length of an error in {unit}", "how many")
    if not len(sizes):
        nothing(axes)
        return
    most = float(np.percentile(sizes, SHOWN_PERCENT)) or float(sizes.max()) or 1.0
    bins = min(max(round(2 * len(sizes) ** (1 / 3)), FEWEST_BINS), MOST_BINS)
    edges = np.linspace(0, most, bins + 1)
    count = np.histogram(np.minimum(sizes, most), edges)[0]
    axes.stairs(count, edges, fill=True, color=BLUE, alpha=0.6)
    rmse, percentile_95 = float(np.sqrt(np.mean(sizes**2))), float(np.percentile(sizes, 95))
    axes.axvline(rmse, ymax=1 / ROOM, color=VERMILION, linewidth=2.2, label="root mean square")
    axes.axvline(percentile_95, ymax=1 / ROOM, color=ORANGE, linewidth=2.2, linestyle="--", label="95 % are below")
    axes.set_xlim(0, most)
    axes.set_ylim(0, ROOM * count.max())
    axes.locator_params(axis="x", nbins=5)
    axes.legend(loc="upper right", frameon=False)


def _draw_histogram(axes: "Axes", values: Array, unit: str, sigma: float) -> None:
    """Coordinates of residuals against the Gaussian that the solution states."""
    open_axes(axes, f"predicted - measured, u and v together, in {unit}", "share in a bin, in %")
    if not len(values):
        nothing(axes)
        return
    spread = sigma if sigma > 0 else max(float(values.std()), 1e-12)
    limit = max(4.0 * spread, min(float(np.abs(values).max()), 6.0 * spread))
    bins = min(max(round(2 * len(values) ** (1 / 3)), FEWEST_OF_RESIDUALS), MOST_OF_RESIDUALS)
    edges = np.linspace(-limit, limit, bins + 1)
    share = 100 * np.histogram(values, edges)[0] / len(values)
    axes.stairs(share, edges, fill=True, color=BLUE, alpha=0.55, label=f"{len(values)} coordinates")
    at = np.linspace(-limit, limit, 400)
    gauss = np.exp(-0.5 * (at / spread) ** 2) / (spread * np.sqrt(2 * np.pi)) * 100 * (edges[1] - edges[0])
    if sigma > 0:
        label = f"Gaussian of the solution: sigma {digits(sigma, 3)} {unit}"
        axes.plot(at, gauss, color=VERMILION, linewidth=2.5, label=label)
    axes.set_xlim(-limit, limit)
    axes.set_ylim(0, 1.3 * max(share.max(), gauss.max()))
    axes.legend(loc="upper right", frameon=False)


def sizes_drawing(metric: str, sizes: Array, unit: str) -> AxesDrawing:
    """How large the errors of a metric are."""
    known = sizes[np.isfinite(sizes)]
    words = f"{len(known)} {metric} errors"
    if len(known):
        rmse, most = digits(float(np.sqrt(np.mean(known**2))), 3), digits(float(np.percentile(known, 95)), 3)
        words += f": root mean square {rmse} {unit}, 95 % are below {most} {unit}"
    return AxesDrawing(f"{metric.capitalize()} error", words, lambda axes: _draw_sizes(axes, known, unit))


def distribution_drawing(evaluation: Evaluation) -> AxesDrawing:
    """How many residuals are larger than a Gaussian has them."""
    scale = evaluation.calibration.scale
    counted, unit = _standardised(evaluation)
    words = f"{len(counted)} coordinates of residuals{'' if scale > 0 else '; no sigma is stated'}"
    if len(counted) and scale > 0:
        beyond = 100 * float(np.mean(np.abs(counted) > 3 * scale))
        words = f"{beyond:.2f} % of {len(counted)} coordinates lie beyond 3 sigma; of a Gaussian 0.27 % do"
    return AxesDrawing(
        "Distribution against the Gaussian", words, lambda axes: _draw_histogram(axes, counted, unit, scale)
    )


def _standardised(evaluation: Evaluation) -> tuple[Array, str]:
    """All coordinates of residuals that count, in px, or of a weighted solution over their stated deviations."""
    calibration, errors = evaluation.calibration, evaluation.of("reprojection")
    if errors is None or errors.sighting is None:
        return np.zeros(0), "px"
    vector, covariance = errors.vector[errors.is_counted], calibration.observations.cov_px2
    if not calibration.weighted or covariance is None:
        return vector.ravel(), "px"
    whitener = whiteners(covariance[errors.sighting[errors.is_counted]])
    return whitened(whitener, vector.T).T.ravel(), "stated sigmas"
