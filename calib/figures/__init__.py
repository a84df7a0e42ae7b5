"""Pictures of calibrations, as PNG. matplotlib takes a second to load, so it is loaded when something is drawn."""

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING

from calib.figures.comparison import comparison_height_px, draw_comparison
from calib.figures.fields import draw_means, draw_residuals
from calib.figures.page import describe, draw_histogram, draw_sightings, draw_uncertainty, draw_views
from calib.figures.sigma_map import sigma_map
from calib.figures.style import WIDTH_PX, bar_beside, picture
from calib.metrics.evaluation import Evaluation
from calib.metrics.residual_cells import cells_of_residuals, residuals_of

if TYPE_CHECKING:
    from matplotlib.figure import Figure

CALIBRATION_PICTURE, COMPARISON_PICTURE = "calibration.png", "comparison.png"


def calibration_figures(evaluation: Evaluation, folder: Path) -> dict[Path, bytes]:
    """The picture of one calibration: what it leaves over, covers, and does not know.

    Args:
        evaluation: of the views that the camera was solved from.
        folder: where it is to lie.
    """
    width, height = evaluation.calibration.camera.image_size
    # A panel is half the page wide, and as high as its image with its texts.
    panel = min(max(0.36 * WIDTH_PX * height / width, 380.0), 1100.0) + 130
    return {folder / CALIBRATION_PICTURE: picture(round(2 * panel + 560), lambda page: _draw_page(page, evaluation))}


def _draw_page(page: "Figure", evaluation: Evaluation) -> None:
    residuals = residuals_of(evaluation)
    cells = cells_of_residuals(residuals)
    size = residuals.image_size
    axes = page.subplots(3, 2, gridspec_kw={"height_ratios": [1, 1, 0.75]})
    draw_residuals(axes[0, 0], residuals)
    means = draw_means(axes[0, 1], cells, size, "What is systematic: mean residual of each cell", cells.long_px)
    bar_beside(axes[0, 1], means, "length of the mean in px", longer=True)
    draw_sightings(axes[1, 0], residuals)
    draw_uncertainty(axes[1, 1], evaluation.calibration, sigma_map(evaluation.calibration))
    draw_histogram(axes[2, 0], evaluation)
    draw_views(axes[2, 1], evaluation)
    page.suptitle(describe(evaluation), fontsize=16, fontweight="bold", x=0.01, ha="left")


def comparison_figures(evaluations: Sequence[Evaluation], folder: Path) -> dict[Path, bytes]:
    """The picture of several calibrations side by side.

    Args:
        evaluations: of the same photos, by different models.
        folder: where it is to lie.
    """
    return {
        folder / COMPARISON_PICTURE: picture(
            comparison_height_px(evaluations), lambda page: draw_comparison(page, evaluations)
        )
    }
