"""Cameras of several models on a page: where they differ, and what each leaves over."""

from collections.abc import Sequence

import numpy as np

from calib.metrics.residual_cells import cells_of, columns_rows, residuals_of
from calib.show.run.accuracy_figures import NOTHING_PX, apart_figure, apart_words, pixels, systematic_figure
from calib.show.run.run_folder import RunFolder, Solved, models_of
from calib.show.run.run_tables import models_table
from calib.verdict.apart import Apart, Known, apart
from designer.base.errors import InputError
from designer.page.blocks import Block, Figure, Fold, Paragraph, Section


def models_section(run: RunFolder, best: Solved) -> Section:
    """Cameras of other models: their errors, where they differ from the best, and what each leaves over."""
    others = models_of(run, best)[1:]
    differences: list[Block] = []
    words = []
    for one in others:
        if one.calibration.status != "converged":
            differences.append(Paragraph(f"{one.model} is {one.calibration.status}, so not compared."))
            continue
        found = _difference(best, one)
        if found is None:
            differences.append(Paragraph(f"{best.model} and {one.model} share no part of the covered image."))
            continue
        said = apart_words(found)
        words.append(f"{one.model} by {pixels(found.percentile_95_px)}")
        if np.nanmax(found.length_px) < NOTHING_PX:
            differences.append(Paragraph(f"Difference of {one.model} from {best.model}: {said[:1].lower()}{said[1:]}."))
            continue
        title = f"Difference of {one.model} from {best.model}"
        differences.append(apart_figure(title, found, best.calibration.camera.image_size, said))
    lead = (
        f"Where the target was seen, 95 % of the image differs from {best.model} at most: {', '.join(words)}."
        if words
        else ""
    )
    fields = Fold("What is systematic in what each model leaves over", tuple(_fields(models_of(run, best))))
    return Section("Models compared", (models_table(models_of(run, best)), *differences, fields), lead=lead)


def _difference(a: Solved, b: Solved) -> Apart | None:
    try:
        return apart(
            Known(a.calibration.camera, np.zeros_like(a.calibration.param_covariance)),
            Known(b.calibration.camera, np.zeros_like(b.calibration.param_covariance)), a.coverage,
        )  # fmt: skip
    except InputError:
        return None


def _fields(solved: Sequence[Solved]) -> list[Figure]:
    """The systematic fields of several models in one scale of colours."""
    residuals = [residuals_of(one.evaluation) for one in solved]
    shape = columns_rows(residuals[0].image_size, min(len(field.pixel) for field in residuals))
    cells = [cells_of(field.image_size, field.pixel, field.residual_px, shape) for field in residuals]
    longest = max(one.long_px for one in cells)
    return [
        systematic_figure(
            one, residuals[0].image_size, title=f"{of.model}: mean residual of each cell", long_px=longest
        )
        for of, one in zip(solved, cells, strict=True)
    ]
