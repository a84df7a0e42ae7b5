"""Pictures of calibrations, as PNG. matplotlib takes a second to load, so it is loaded when something is drawn."""

import math
from pathlib import Path
from typing import TYPE_CHECKING

from calib.draw.style import ABOVE_PX, BELOW_PX, HEADLINE_PX, LEFT_PX, WIDTH_PX, axes_at, headline, note, picture
from calib.judge.coverage import coverage_of
from calib.solver.metrics.errors import summarise
from calib.solver.metrics.evaluation import Evaluation
from calib.solver.metrics.residual_cells import cells_of_residuals, residuals_of
from designer.base.words import counted
from designer.base.words import figure as digits

if TYPE_CHECKING:
    from matplotlib.figure import Figure

IMAGE_PX, HISTOGRAM_PX = 576, 375
"""Width of an image's axes on a calibration's picture, and height of those without an image."""
CALIBRATION_PICTURE = "calibration.png"


def calibration_figures(evaluation: Evaluation, folder: Path) -> dict[Path, bytes]:
    """The picture of one calibration, with the figures of its page: residuals, coverage, uncertainty."""
    width, height = evaluation.calibration.camera.image_size
    image_px = min(max(IMAGE_PX * height / width, 380.0), 1100.0)
    whole = round(HEADLINE_PX + 2 * image_px + HISTOGRAM_PX + 3 * (ABOVE_PX + BELOW_PX))
    content = picture(whole, lambda page: _draw_page(page, evaluation, image_px), is_placed=True)
    return {folder / CALIBRATION_PICTURE: content}


def _draw_page(page: "Figure", evaluation: Evaluation, image_px: float) -> None:
    """Three rows of two panels, the first two of which are images so high."""
    from calib.draw.fields import coverage_drawing, residuals_drawing, systematic_drawing, uncertainty_drawing
    from calib.draw.run_figures import distribution_drawing, sizes_drawing
    from calib.draw.sigma_map import sigma_map

    calibration, residuals = evaluation.calibration, residuals_of(evaluation)
    cells = cells_of_residuals(residuals)

    errors = evaluation.of("reprojection")
    rmse_px = math.nan if errors is None else summarise(errors).rmse
    drawings = [
        residuals_drawing(residuals, rmse_px), systematic_drawing(cells, residuals.image_size),
        coverage_drawing(coverage_of(calibration)), uncertainty_drawing(sigma_map(calibration)),
        distribution_drawing(evaluation),
    ]  # fmt: skip
    if errors is not None:
        drawings.append(sizes_drawing(errors.metric, errors.size[errors.is_counted], errors.unit))
    for place, drawing in enumerate(drawings):
        row, column = divmod(place, 2)
        top = HEADLINE_PX + ABOVE_PX + row * (image_px + ABOVE_PX + BELOW_PX)
        high = HISTOGRAM_PX if drawing.image_size is None else image_px
        axes = axes_at(page, column * WIDTH_PX / 2 + LEFT_PX, top, IMAGE_PX, high)
        axes.set_title(drawing.title)
        note(axes, drawing.words)
        drawing.draw(axes)
    headline(page, describe(evaluation))


def describe(evaluation: Evaluation) -> str:
    """The headline of a picture."""
    calibration, errors = evaluation.calibration, evaluation.of("reprojection")
    seen = calibration.observations
    rmse = "" if errors is None else f", residuals {digits(summarise(errors).rmse, 4)} px RMS"
    photos = counted(seen.view_count, "photo")
    size = f"{seen.image_size[0]} x {seen.image_size[1]} px"
    return f"{calibration.camera.model}: {photos} of {size}, {len(seen.view)} observations{rmse} ({calibration.status})"
