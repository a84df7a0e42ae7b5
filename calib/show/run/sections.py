"""The sections of a run's page: verdict, next photos, camera, accuracy, models."""

import math
import shlex
from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np

from calib.cameras import rays
from calib.cameras.camera import Camera
from calib.core.number_text import figure as digits
from calib.figures.sigma_map import SigmaMap
from calib.metrics import OF_TRUTH
from calib.metrics.residual_cells import cells_of, cells_of_residuals, columns_rows, residuals_of
from calib.records.evaluation_files import of_views
from calib.records.run_folder import RunFolder, Solved, models_of
from calib.show.run.evaluation_table import focal_length
from calib.show.run.figures import (
    NOTHING_PX,
    apart_figure,
    apart_words,
    coverage_figure,
    distribution_figure,
    draw_next_views,
    halves_words,
    image_panel,
    pixels,
    residuals_figure,
    sizes_figure,
    systematic_figure,
    uncertainty_figure,
    uncertainty_words,
)
from calib.show.run.run_tables import held_out_table, metrics_table, models_table, parameters_table
from calib.verdict.apart import Apart, Known, apart
from calib.verdict.halves import HalvesApart, NoHalves, half_split, halves_apart
from calib.verdict.judge import Judged
from calib.verdict.next_views import NextView, why_no_next_views
from calib.verdict.verdict import Check, Grade, Verdict
from calib.verdict.words import measured
from designer.base.errors import InputError
from designer.base.words import capital, printable
from designer.page.blocks import (
    Block,
    Command,
    Facts,
    Figure,
    Finding,
    Findings,
    Fold,
    Headline,
    Level,
    Paragraph,
    Section,
    Steps,
)

if TYPE_CHECKING:
    from matplotlib.axes import Axes

LEVELS: dict[Grade, Level] = {"good": "good", "usable": "usable", "bad": "bad", "unknown": "note"}
WORDS: dict[Grade, str] = {"good": "good", "usable": "usable", "bad": "do not use", "unknown": "not checked"}
NOT_JUDGED = "verdict.json is missing, so nothing was judged; calib report with --criteria standard judges it."


def headline_of(verdict: Verdict) -> Headline:
    """The answer at the top of the page."""
    return Headline(LEVELS[verdict.grade], WORDS[verdict.grade], as_sentence(printable(verdict.sentence)))


def not_judged(best: Solved) -> Headline:
    """What stands there of a camera that nobody judged."""
    return Headline("note", "not judged", f"{_solution_words(best)}. {NOT_JUDGED}")


def _solution_words(best: Solved) -> str:
    calibration = best.calibration
    left = f", {digits(best.rmse_px, 3)} px are left over" if best.rmse_px >= 0 else ""
    return f"The camera ({best.model}) was solved from {calibration.observations.view_count} photos{left}"


def verdict_section(verdict: Verdict | None, best: Solved, faults: Sequence[str]) -> Section:
    """What was checked, and what is missing.

    Args:
        verdict: None: there is none.
        best: the camera that the page is about.
        faults: what of the folder could not be read.
    """
    blocks: list[Block] = []
    if verdict is not None:
        blocks.append(Findings(tuple(map(finding_of, verdict.checks))))
    remarks = (*best.calibration.remarks, *best.evaluation.remarks)
    missing = () if verdict is not None else (Finding("note", "Not judged", NOT_JUDGED),)
    rest = (
        *missing,
        *(Finding("usable", "Not on this page", printable(fault)) for fault in faults),
        *(Finding("note", "Said by the solution", printable(remark)) for remark in remarks),
    )
    if rest:
        blocks.append(Findings(rest))
    return Section("Verdict", tuple(blocks), lead=_lead(verdict))


def _lead(verdict: Verdict | None) -> str:
    if verdict is None:
        return ""
    known = [check for check in verdict.checks if check.grade != "unknown"]
    good = sum(check.grade == "good" for check in known)
    words = f"{good} of {len(known)} checks are within their limits for good"
    open_ = len(verdict.checks) - len(known)
    return f"{words}; {open_} could not be made." if open_ else f"{words}."


def finding_of(check: Check) -> Finding:
    """A check as a line of findings."""
    found = "" if check.value is None else measured(check)
    sign = "≥" if check.is_at_least else "≤"
    has_limits = check.good or check.usable
    rule = f"good {sign} {check.good:.4g}, usable {sign} {check.usable:.4g} {check.unit}".strip() if has_limits else ""
    sentence = f"{WORDS[check.grade]}: {check.sentence}" if check.grade == "unknown" else check.sentence
    return Finding(
        LEVELS[check.grade], printable(check.title), as_sentence(printable(sentence)), printable(found), rule
    )


def next_section(verdict: Verdict | None, best: Solved, proposed: Sequence[NextView]) -> tuple[Section, ...]:
    """What to do better next time, and a sketch of where to hold the target; nothing if there is nothing."""
    said = () if verdict is None else tuple(map(printable, verdict.advice))
    new = tuple(
        f"photo {number}: {view.sentence}"
        for number, view in enumerate(proposed, start=1)
        if not any(view.sentence in line for line in said)
    )
    blocks: list[Block] = []
    if said or new:
        blocks.append(Steps(tuple(as_sentence(line.replace("`", "")) for line in (*said, *new))))
    if proposed:
        blocks.append(next_views_figure(best, proposed))
    elif why := why_no_next_views(best.calibration):
        blocks.append(Paragraph(f"No photos are proposed: {printable(why)}."))
    return (Section("Next time", tuple(blocks), lead="What would make the camera better, the most useful first."),) * (
        len(blocks) > 0
    )


def as_sentence(text: str) -> str:
    """A text with a capital and a full stop."""
    return f"{capital(text)}{'' if text.endswith(('.', '!', '?')) else '.'}"


def next_views_figure(best: Solved, proposed: Sequence[NextView]) -> Figure:
    """Where to hold the target in the next photos."""
    seen = best.calibration.observations

    def draw(axes: "Axes") -> None:
        draw_next_views(axes, seen.image_size, proposed, seen.center_px)

    count = "One more photo" if len(proposed) == 1 else f"{len(proposed)} more photos"
    last = proposed[-1]
    words = f"{count} would bring 95 % of the image within about {digits(last.sigma_px_after, 1)} px (1 sigma)"
    if last.covered_after > proposed[0].covered_before:
        words += f" and the coverage to {100 * last.covered_after:.0f} %"
    words += ", if the lens is as estimated"
    return image_panel(
        "Where to hold the target next", seen.image_size, draw, words,
        f"{words}. Grey: rings seen so far. Numbered: outlines of the target in the next photos.", has_bar=False,
    )  # fmt: skip


def page_lead(best: Solved, found: SigmaMap, halves: HalvesApart | NoHalves) -> tuple[Block, ...]:
    """The picture that says most, and key facts."""
    calibration = best.calibration
    seen = calibration.observations
    width, height = calibration.camera.image_size
    facts = (
        ("camera model", best.model),
        ("image", f"{width} x {height} px"),
        (focal_title(calibration.camera), f"{focal_length(calibration).replace('+-', '±')} px"),
        ("field of view", field_of_view_words(calibration.camera)),
        ("photos used", str(seen.view_count)),
        ("sightings", f"{int((~calibration.is_outlier).sum())} rings and dots"),
        ("left over (RMS)", f"{digits(best.rmse_px, 3)} px"),
        ("image covered", f"{100 * best.coverage.share:.0f} %"),
        ("solution", calibration.status),
    )
    return uncertainty_figure(best, found, halves), Facts(facts)


def focal_title(camera: Camera) -> str:
    """What a focal length is called: that of a learned map is none of the lens."""
    return "focal length" if camera.learned is None else "focal length of the virtual sensor"


def field_of_view_words(camera: Camera) -> str:
    """Angles between the rays through the middles of opposite sides; of the linear part where the model has none."""
    width, height = camera.image_size
    middle = np.array([[0, height / 2], [width - 1, height / 2], [width / 2, 0], [width / 2, height - 1]])
    ray = rays(camera, middle)
    if not np.isfinite(ray).all():
        ray = np.column_stack([(middle - camera.params[2:4]) / camera.params[:2], np.ones(4)])
    unit = ray / np.linalg.norm(ray, axis=1, keepdims=True)
    across, down = (
        math.degrees(math.acos(min(1.0, max(-1.0, float(unit[k] @ unit[k + 1]))))) for k in (0, 2)
    )  # fmt: skip
    return f"{across:.1f}° x {down:.1f}°"


def camera_section(run: RunFolder, best: Solved, *, is_usable: bool) -> Section:
    """Parameters, and the files to use.

    Args:
        run: the folder.
        best: its camera.
        is_usable: whether to say how to use it; a camera that is judged unfit is not handed on.
    """
    place = f"{best.path}camera.json"
    blocks: list[Block] = [parameters_table(best)]
    blocks += [
        Fold(f"Parameters of model {one.model}", (parameters_table(one),)) for one in run.solved if one is not best
    ]
    if is_usable:
        blocks.append(Command(
            f"calib convert {shlex.quote(place)} --to opencv -o camera.yaml",
            "To use it: camera.json holds all; for OpenCV (ros, kalibr, colmap, mrcal, metashape) type in this folder",
        ))  # fmt: skip
    calibration = best.calibration
    words = (
        f"{focal_title(calibration.camera).capitalize()} {focal_length(calibration).replace('+-', '±')} px, "
        f"field of view {field_of_view_words(calibration.camera)}; "
        + (f"{place} is the file to use." if is_usable else f"{place} is not to be used: see the verdict.")
    )
    return Section("Camera", tuple(blocks), lead=words)


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
