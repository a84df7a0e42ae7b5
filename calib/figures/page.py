"""The figures of one calibration: sightings, uncertainty, distribution and photos."""

from typing import TYPE_CHECKING

import numpy as np

from calib.core.number_text import figure as digits
from calib.figures.fields import draw_map
from calib.figures.sigma_map import SigmaMap
from calib.figures.style import BLUE, EMPTY, INK, ORANGE, SEQUENTIAL, VERMILION, bar_beside, image_axes, note, nothing
from calib.metrics.errors import summarise
from calib.metrics.evaluation import Evaluation, by_view
from calib.metrics.residual_cells import Residuals, cells_of, columns_rows
from calib.solver.calibration import Calibration
from calib.solver.outliers import whitened
from calib.solver.problem import whiteners
from designer.base.words import printable

if TYPE_CHECKING:
    from matplotlib.axes import Axes

COVERED = 4
"""Sightings of a cell of the map of sightings, on average."""
WORST = 3
FEWEST_BINS, MOST_BINS = 15, 61


def draw_sightings(axes: "Axes", residuals: Residuals) -> None:
    """How many sightings lie in each cell."""
    image_axes(axes, residuals.image_size, "Where the sightings are")
    width, height = residuals.image_size
    axes.fill_between([-0.5, width - 0.5], -0.5, height - 0.5, facecolor=EMPTY, hatch="///", linewidth=0)
    shape = columns_rows(residuals.image_size, len(residuals.pixel), COVERED)
    cells = cells_of(residuals.image_size, residuals.pixel, residuals.residual_px, shape)
    empty, total = int((cells.count == 0).sum()), cells.count.size
    note(axes, f"{empty} of {total} cells of the image are empty")
    if empty < total:
        count = np.where(cells.count > 0, cells.count, np.nan)
        shown = axes.pcolormesh(cells.edge_u, cells.edge_v, count, cmap=SEQUENTIAL, vmin=0)
        bar_beside(axes, shown, "sightings in a cell")


def draw_uncertainty(axes: "Axes", calibration: Calibration, found: SigmaMap) -> None:
    """Standard deviation of the camera's pixels over the image."""
    image_axes(axes, found.image_size, "Uncertainty of the camera (1 sigma)")
    axes.set_facecolor(EMPTY)
    if not found.is_known:
        note(axes, "no parameter was estimated" if len(found.known_px) else "the photos do not determine it")
        return
    draw_map(axes, found.pixel, found.sigma_px, "px", may_be_wide=True)
    less = "less a common rotation" if calibration.camera.learned is None else "the learned map taken as exact"
    note(axes, f"centre {digits(found.centre_px, 2)} px, worst {digits(found.worst_px, 2)} px; {less}")


def draw_histogram(axes: "Axes", evaluation: Evaluation) -> None:
    """Coordinates of residuals against the Gaussian that the solution states."""
    calibration = evaluation.calibration
    values, unit = standardised(evaluation)
    sigma = calibration.scale
    axes.set_title("Distribution of the residuals")
    axes.set_xlabel(f"predicted - measured, u and v together, in {unit}")
    axes.set_ylabel("share in a bin, in %")
    for side in ("top", "right"):
        axes.spines[side].set_visible(False)
    if not len(values):
        nothing(axes, "no residual counts")
        return
    spread = sigma if sigma > 0 else max(float(values.std()), 1e-12)
    limit = max(4.0 * spread, min(float(np.abs(values).max()), 6.0 * spread))
    bins = min(max(round(2 * len(values) ** (1 / 3)), FEWEST_BINS), MOST_BINS)
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
    beyond = 100 * float(np.mean(np.abs(values) > 3 * spread))
    note(axes, f"{beyond:.2f} % beyond 3 sigma; a Gaussian has 0.27 %" if sigma > 0 else "no sigma is stated")


def standardised(evaluation: Evaluation) -> tuple[np.ndarray[tuple[int], np.dtype[np.float64]], str]:
    """All coordinates of residuals that count, in px, or of a weighted solution over their stated deviations."""
    calibration, errors = evaluation.calibration, evaluation.of("reprojection")
    if errors is None or errors.sighting is None:
        return np.zeros(0), "px"
    vector, covariance = errors.vector[errors.is_counted], calibration.observations.cov_px2
    if not calibration.weighted or covariance is None:
        return vector.ravel(), "px"
    whitener = whiteners(covariance[errors.sighting[errors.is_counted]])
    return whitened(whitener, vector.T).T.ravel(), "stated sigmas"


def draw_views(axes: "Axes", evaluation: Evaluation) -> None:
    """Reprojection RMSE of each photo."""
    from matplotlib.ticker import MaxNLocator

    axes.set_title("Reprojection error of each photo")
    axes.xaxis.set_major_locator(MaxNLocator(integer=True))
    axes.set_xlabel("photo, in the order they were given")
    axes.set_ylabel("RMSE in px")
    for side in ("top", "right"):
        axes.spines[side].set_visible(False)
    errors = evaluation.of("reprojection")
    summaries = None if errors is None else by_view(evaluation, errors)
    if errors is None or summaries is None or not errors.is_counted.any():
        nothing(axes, "no residual counts")
        return
    rmse = np.nan_to_num(np.array([summary.rmse for summary in summaries]))
    worst = np.argsort(-rmse, kind="stable")[:WORST]
    colours = np.full(len(rmse), BLUE, dtype=object)
    colours[worst] = ORANGE
    axes.bar(np.arange(1, len(rmse) + 1), rmse, width=0.85, color=colours.tolist())
    overall = summarise(errors).rmse
    axes.axhline(overall, color=INK, linewidth=1.8, linestyle="--")
    axes.set_xlim(0.4, len(rmse) + 0.6)
    axes.set_ylim(0, 1.2 * max(float(rmse.max()), 1e-12))
    names = [_short(evaluation.calibration.observations.view_names[row]) for row in worst.tolist()]
    note(axes, f"all photos {digits(overall, 3)} px (dashed); worst: " + ", ".join(names))


def _short(name: str) -> str:
    """A file's name that fits a figure, and is text."""
    text = printable(name)
    return text if len(text) <= 24 else f"{text[:11]}...{text[-10:]}"


def describe(evaluation: Evaluation) -> str:
    """The headline of a page."""
    calibration, errors = evaluation.calibration, evaluation.of("reprojection")
    seen = calibration.observations
    rmse = "" if errors is None else f", reprojection RMSE {digits(summarise(errors).rmse, 4)} px"
    photos = "1 photo" if seen.view_count == 1 else f"{seen.view_count} photos"
    size = f"{seen.image_size[0]} x {seen.image_size[1]} px"
    return f"{calibration.camera.model}: {photos} of {size}, {len(seen.view)} sightings{rmse} ({calibration.status})"
