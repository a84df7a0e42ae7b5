"""How good a camera is on its page: coverage, what is left over, and what two halves of the photos say."""

from calib.core.number_text import figure as digits
from calib.figures.sigma_map import SigmaMap
from calib.metrics import OF_TRUTH
from calib.metrics.residual_cells import cells_of_residuals, residuals_of
from calib.records.evaluation_files import of_views
from calib.show.run.accuracy_figures import (
    apart_figure,
    apart_words,
    coverage_figure,
    distribution_figure,
    halves_words,
    residuals_figure,
    sizes_figure,
    systematic_figure,
    uncertainty_words,
)
from calib.show.run.run_folder import Solved
from calib.show.run.run_tables import held_out_table, metrics_table
from calib.verdict.halves import HalvesApart, NoHalves, half_split, halves_apart
from calib.verdict.of_run import Judged
from calib.verdict.verdict import Verdict
from designer.base.words import printable
from designer.page.blocks import Block, Figure, Paragraph, Section


def halves_of(best: Solved, judged: Judged | None) -> HalvesApart | NoHalves:
    """How far cameras of halves of the photos lie apart: those that the verdict rests on, or else solved now."""
    split = half_split(best.calibration, best.provenance.options) if judged is None else judged.halves
    if isinstance(split, NoHalves):
        return split
    found = halves_apart(split, best.coverage)
    return NoHalves("the cameras of the halves share no part of the covered image") if found is None else found


def accuracy_section(best: Solved, found: SigmaMap, halves: HalvesApart | NoHalves, verdict: Verdict | None) -> Section:
    """What is left over and how certain the camera is.

    Args:
        best: the camera.
        found: how uncertain it is over the image.
        halves: how far cameras of halves of its photos lie apart.
        verdict: on the camera, whose checks the captions quote; None: there is none.
    """
    checked = {} if verdict is None else {check.name: printable(check.sentence) for check in verdict.checks}
    residuals = residuals_of(best.evaluation)
    blocks: list[Block] = [
        coverage_figure(best.coverage, checked.get("coverage", "")),
        _halves_block(best, halves),
        residuals_figure(residuals, best.rmse_px),
        systematic_figure(cells_of_residuals(residuals), residuals.image_size, checked=checked.get("systematic", "")),
        distribution_figure(best),
        *_histograms(best),
        metrics_table(best),
    ]
    if best.stored is not None and best.stored.parts:
        blocks.append(held_out_table(best.stored))
    lead = f"{uncertainty_words(found)} (1 sigma, as stated). {halves_words(halves)}"
    return Section("Accuracy", tuple(blocks), lead=lead.rstrip())


def _halves_block(best: Solved, halves: HalvesApart | NoHalves) -> Block:
    """A map of how far the cameras of halves of the photos lie apart, or why there is none."""
    if isinstance(halves, NoHalves):
        return Paragraph(f"Halves of the photos were not compared: {printable(halves.reason)}.")
    words = (
        f"Solved from halves of the photos: {apart_words(halves)}; that is {digits(halves.ratio, 2)} times what their "
        "standard deviations let expect"
    )
    title = "Halves of the photos: difference of their cameras"
    return apart_figure(title, halves, best.calibration.camera.image_size, words)


def _histograms(best: Solved) -> list[Figure]:
    """The sizes of the errors by each metric that is known."""
    figures = [sizes_figure(e.metric, e.size[e.is_counted], e.unit) for e in best.evaluation.errors]
    stored = {} if best.stored is None or best.stored.parts else best.stored.metrics
    for name in OF_TRUTH[:1]:
        if name in stored:
            unit = printable(stored[name].unit)
            sizes = of_views(best.folder, f"{name}_rmse_{stored[name].unit}")
            figures += [sizes_figure(name, sizes, unit)] if len(sizes) else []
    return figures
