"""Pictures of calibrations, as PNG. matplotlib takes a second to load, so it is loaded when something is drawn."""

from pathlib import Path
from typing import TYPE_CHECKING

from calib.core.number_text import figure as digits
from calib.figures.fields import draw_coverage, draw_means, draw_residuals, draw_uncertainty
from calib.figures.histograms import draw_histogram, draw_sizes
from calib.figures.sigma_map import sigma_map
from calib.figures.style import (
    ABOVE_PX,
    BELOW_PX,
    HEADLINE_PX,
    LEFT_PX,
    WIDTH_PX,
    axes_at,
    bar_beside,
    headline,
    picture,
)
from calib.metrics.errors import summarise
from calib.metrics.evaluation import Evaluation
from calib.metrics.residual_cells import cells_of_residuals, residuals_of
from calib.verdict.coverage import coverage_of

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

IMAGE_PX, HISTOGRAM_PX = 576, 375
"""Width of an image's axes on a calibration's picture, and height of those without an image."""
CALIBRATION_PICTURE = "calibration.png"


def calibration_figures(evaluation: Evaluation, folder: Path) -> dict[Path, bytes]:
    """The picture of one calibration, with the figures of its page: residuals, coverage, uncertainty.

    Args:
        evaluation: of the views that the camera was solved from.
        folder: where it is to lie.
    """
    width, height = evaluation.calibration.camera.image_size
    image_px = min(max(IMAGE_PX * height / width, 380.0), 1100.0)
    whole = round(HEADLINE_PX + 2 * image_px + HISTOGRAM_PX + 3 * (ABOVE_PX + BELOW_PX))
    content = picture(whole, lambda page: _draw_page(page, evaluation, image_px), is_placed=True)
    return {folder / CALIBRATION_PICTURE: content}


def _draw_page(page: "Figure", evaluation: Evaluation, image_px: float) -> None:
    """Three rows of two panels, the first two of which are images so high."""
    calibration, residuals = evaluation.calibration, residuals_of(evaluation)
    cells, covered = cells_of_residuals(residuals), coverage_of(calibration)

    def panel(row: int, column: int) -> "Axes":
        top = HEADLINE_PX + ABOVE_PX + row * (image_px + ABOVE_PX + BELOW_PX)
        return axes_at(page, column * WIDTH_PX / 2 + LEFT_PX, top, IMAGE_PX, image_px if row < 2 else HISTOGRAM_PX)

    draw_residuals(panel(0, 0), residuals)
    field = panel(0, 1)
    means = draw_means(field, cells, residuals.image_size, "Systematic residuals: mean of each cell", cells.long_px)
    bar_beside(field, means, "length of the mean in px", longer=True)
    draw_coverage(panel(1, 0), covered.image_size, covered.views)
    draw_uncertainty(panel(1, 1), calibration, sigma_map(calibration))
    draw_histogram(panel(2, 0), evaluation)
    errors = evaluation.of("reprojection")
    if errors is not None:
        draw_sizes(panel(2, 1), errors.size[errors.is_counted], errors.unit)
    headline(page, describe(evaluation))


def describe(evaluation: Evaluation) -> str:
    """The headline of a picture."""
    calibration, errors = evaluation.calibration, evaluation.of("reprojection")
    seen = calibration.observations
    rmse = "" if errors is None else f", residuals {digits(summarise(errors).rmse, 4)} px RMS"
    photos = "1 photo" if seen.view_count == 1 else f"{seen.view_count} photos"
    size = f"{seen.image_size[0]} x {seen.image_size[1]} px"
    return f"{calibration.camera.model}: {photos} of {size}, {len(seen.view)} observations{rmse} ({calibration.status})"
