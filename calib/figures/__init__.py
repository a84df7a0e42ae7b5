"""Pictures of calibrations, as PNG. matplotlib takes a second to load, so it is loaded when something is drawn."""

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING

from calib.figures.comparison import comparison_height_px, draw_comparison
from calib.figures.fields import draw_means, draw_residuals
from calib.figures.page import describe, draw_histogram, draw_sightings, draw_uncertainty, draw_views
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
from calib.metrics.evaluation import Evaluation
from calib.metrics.residual_cells import cells_of_residuals, residuals_of

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

IMAGE_PX, HISTOGRAM_PX = 576, 375
"""Width of an image's axes on a calibration's picture, and height of those without an image."""
CALIBRATION_PICTURE, COMPARISON_PICTURE = "calibration.png", "comparison.png"


def calibration_figures(evaluation: Evaluation, folder: Path) -> dict[Path, bytes]:
    """The picture of one calibration: what it leaves over, covers, and does not know.

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
    residuals = residuals_of(evaluation)
    cells = cells_of_residuals(residuals)
    size = residuals.image_size

    def panel(row: int, column: int) -> "Axes":
        top = HEADLINE_PX + ABOVE_PX + row * (image_px + ABOVE_PX + BELOW_PX)
        return axes_at(page, column * WIDTH_PX / 2 + LEFT_PX, top, IMAGE_PX, image_px if row < 2 else HISTOGRAM_PX)

    draw_residuals(panel(0, 0), residuals)
    field = panel(0, 1)
    means = draw_means(field, cells, size, "What is systematic: mean residual of each cell", cells.long_px)
    bar_beside(field, means, "length of the mean in px", longer=True)
    draw_sightings(panel(1, 0), residuals)
    draw_uncertainty(panel(1, 1), evaluation.calibration, sigma_map(evaluation.calibration))
    draw_histogram(panel(2, 0), evaluation)
    draw_views(panel(2, 1), evaluation)
    headline(page, describe(evaluation))


def comparison_figures(evaluations: Sequence[Evaluation], folder: Path) -> dict[Path, bytes]:
    """The picture of several calibrations side by side.

    Args:
        evaluations: of the same photos, by different models.
        folder: where it is to lie.
    """
    return {
        folder / COMPARISON_PICTURE: picture(
            comparison_height_px(evaluations), lambda page: draw_comparison(page, evaluations), is_placed=True
        )
    }
