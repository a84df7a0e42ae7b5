"""What a run says: its lead (headline, facts, findings, steps), which commands print too, and the page's sections."""

import math
import shlex
from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np

from calib.cameras.camera import Camera
from calib.cameras.field_of_view import field_of_view
from calib.metrics.residual_cells import cells_of, cells_of_residuals, columns_rows, residuals_of
from calib.observe.records import ImageRecord
from calib.records.run_folder import Run, Solved
from calib.show.run.tables import errors_table, focal_length, models_table, parameters_table
from calib.verdict.apart import Known, apart
from calib.verdict.check_kind import LEAST_PX, px
from calib.verdict.halves import HalvesApart, NoHalves, half_split, halves_apart
from calib.verdict.lit_part import lit_part
from calib.verdict.next_views import why_no_next_views
from calib.verdict.verdict import Check, Grade, Verdict
from designer.base.number_text import figure as digits
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
    from calib.draw.sigma_map import SigmaMap

LEVELS: dict[Grade, Level] = {"good": "good", "usable": "usable", "bad": "bad", "unknown": "note"}
WORDS: dict[Grade, str] = {"good": "good", "usable": "usable", "bad": "do not use", "unknown": "not checked"}
WIDE_DEG = 100.0
"""From this field of view on the diagonal is told, too: the corners see much farther than the sides."""
NOT_JUDGED = "verdict.json is missing, so nothing was judged; calib report with --criteria standard judges it."


def headline_of(run: Run) -> Headline:
    """The answer, before anything else."""
    if run.verdict is not None:
        return headline_by(run.verdict)
    best = run.best
    left = f", with residuals of {digits(best.rms_px, 3)} px (RMS)" if best.rms_px >= 0 else ""
    views = best.calibration.observations.view_count
    return Headline(
        "note", "not judged", f"The camera ({best.model}) was solved from {views} photos{left}. {NOT_JUDGED}"
    )


def headline_by(verdict: Verdict) -> Headline:
    """The answer of a verdict."""
    return Headline(LEVELS[verdict.grade], WORDS[verdict.grade], as_sentence(printable(verdict.sentence)))


def as_sentence(text: str) -> str:
    """A text with a capital and a full stop."""
    return f"{capital(text)}{'' if text.endswith(('.', '!', '?')) else '.'}"


def key_facts(run: Run) -> Facts:
    """Camera, photos and checks, a line each."""
    best = run.best
    calibration, camera, seen = best.calibration, best.calibration.camera, best.calibration.observations
    width, height = camera.image_size
    counted = int((~calibration.is_outlier).sum())
    photos = f"{seen.view_count} photo{'s' if seen.view_count > 1 else ''}"
    lit = lit_part(calibration)
    field = field_of_view_words(lit.camera, "" if lit.is_measured else "observations end")
    scale = f", {calibration.scale:.3g} times the stated sigma" if calibration.weighted else ""
    return Facts((
        ("camera", f"{best.model}, {width} x {height} px, {calibration.status}"),
        ("lens", f"{focal_title(camera)} {focal_length(calibration)} px, field of view {field}"),
        ("residual", f"{digits(best.rms_px, 3)} px RMS, of {counted} observations in {photos}{scale}"),
        *((("photos", photo_words(run.records.images)),) if run.records is not None else ()),
        ("covered", f"{100 * best.coverage.share:.0f} % of the {best.coverage.area}"),
        *((("checks", _checks_words(run)),) if run.judged is not None else ()),
    ))  # fmt: skip


def photo_words(images: Sequence[ImageRecord]) -> str:
    """How many photos show the target, and how much of it."""
    found = sum(image.features for image in images)
    expected = sum(image.expected for image in images)
    counts = f", {found} of {expected} features of the faces seen that could be measured" if found else ""
    failed = sum(bool(image.failure) for image in images)
    shown = sum(image.features > 0 for image in images)
    return f"{shown or 'none'} of {len(images)} with the target{counts}" + (f"; {failed} failed" if failed else "")


def _checks_words(run: Run) -> str:
    if run.judged is None:
        return ""
    checks, criteria = run.judged.verdict.checks, run.judged.criteria
    known = [check for check in checks if check.grade != "unknown"]
    good = sum(check.grade == "good" for check in known)
    open_ = f", {len(checks) - len(known)} could not be made" if len(known) < len(checks) else ""
    limits = f"{printable(criteria.name)} ({printable(criteria.title)})"
    return f"{good} of {len(known)} good{open_}; limits: {limits}; others with --criteria"


def focal_title(camera: Camera) -> str:
    """What a focal length is called: that of a learned map is none of the lens."""
    return "focal length" if camera.learned is None else "focal length of the virtual sensor"


def field_of_view_words(camera: Camera, end: str = "") -> str:
    """Angles between the light at opposite sides, and where model or image circle end if that is inside the image.

    Args:
        camera: that sees.
        end: what ends there, in words; "": the image circle if the camera says where that is, else the model.
    """
    found = field_of_view(camera)
    end = end or ("the model ends" if camera.field_rad is None else "the image circle ends")
    if not math.isfinite(found.across_rad + found.down_rad):
        return "not known"
    across, down, diagonal, off_axis = (
        math.degrees(angle) for angle in (found.across_rad, found.down_rad, found.diagonal_rad, found.off_axis_rad)
    )
    words = f"{across:.1f}° x {down:.1f}°"
    if found.ends_inside:
        return f"{words}; {end} {off_axis:.1f}° off the axis, inside the image"
    return f"{words}, diagonal {diagonal:.1f}°" if diagonal > max(across, down) > WIDE_DEG else words


def check_findings(verdict: Verdict) -> tuple[Finding, ...]:
    """The checks, a line each; the one that is the headline says only its numbers."""
    return tuple(finding_of(check, is_said=check.name == verdict.leads_with) for check in verdict.checks)


def finding_of(check: Check, *, is_said: bool = False) -> Finding:
    """A check as a line of findings.

    Args:
        check: the check.
        is_said: the headline says its sentence already.
    """
    sign = "≥" if check.is_at_least else "≤"
    rule = f"good {sign} {check.good:.4g}, usable {sign} {check.usable:.4g} {check.unit}" if check.unit else ""
    sentence = f"{WORDS[check.grade]}: {check.sentence}" if check.grade == "unknown" else check.sentence
    text = "see the headline." if is_said else as_sentence(printable(sentence))
    return Finding(LEVELS[check.grade], printable(check.title), capital(text), printable(check.measured), rule)


def verdict_section(run: Run) -> Section:
    """What was checked, and what is missing."""
    best, verdict = run.best, run.verdict
    remarks = dict.fromkeys((*best.calibration.remarks, *best.evaluation.remarks))
    rest = (
        *((Finding("note", "Not judged", NOT_JUDGED),) if verdict is None else ()),
        *(Finding("usable", "Not on this page", printable(fault)) for fault in run.faults),
        *(Finding("note", "Said by the solution", printable(remark)) for remark in remarks),
    )
    checks = () if verdict is None else (Findings(check_findings(verdict)),)
    return Section("Verdict", (*checks, *((Findings(rest),) if rest else ())), lead=_checks_words(run))


def steps_of(run: Run) -> tuple[str, ...]:
    """What to do better next time, the most useful first."""
    return () if run.verdict is None else tuple(map(printable, run.verdict.advice))


def next_section(run: Run) -> Section | None:
    """What to do better next time, and a sketch of where to hold the target; None if there is nothing."""
    from calib.show.run.figures import next_views_figure

    blocks: list[Block] = []
    if steps := steps_of(run):
        blocks.append(Steps(tuple(as_sentence(line.replace("`", "")) for line in steps)))
    if run.next_views:
        blocks.append(next_views_figure(run.best.calibration.observations, run.next_views, run.best.coverage.area))
    elif why := why_no_next_views(run.best.calibration):
        blocks.append(Paragraph(f"No photos are proposed: {printable(why)}."))
    lead = "What would make the camera better, the most useful first."
    return Section("Next time", tuple(blocks), lead=lead) if blocks else None


def camera_section(run: Run) -> Section:
    """Parameters, and the files to use; a camera that is judged unfit is not handed on."""
    best, is_usable = run.best, run.verdict is None or run.verdict.grade != "bad"
    place = f"{best.path}camera.json"
    blocks: list[Block] = [parameters_table(best.metrics)]
    blocks += [Fold(f"Parameters of model {one.model}", (parameters_table(one.metrics),)) for one in run.others]
    if is_usable:
        blocks.append(Command(
            f"calib convert {shlex.quote(place)} --to opencv -o camera.yaml",
            "To use it: camera.json holds all; for OpenCV (ros, kalibr, colmap, mrcal, metashape) type in this folder",
        ))  # fmt: skip
    use = f"{place} is the file to use." if is_usable else f"{place} is not to be used: see the verdict."
    return Section("Camera", tuple(blocks), lead=use)


def halves_of(run: Run) -> HalvesApart | NoHalves:
    """How far cameras of halves of the photos lie apart: those that the verdict rests on, or else solved now."""
    best = run.best
    split = half_split(best.calibration, best.provenance.options) if run.judged is None else run.judged.halves
    return halves_apart(split, best.coverage)


def accuracy_section(run: Run, found: "SigmaMap", halves: HalvesApart | NoHalves) -> Section:
    """The residuals, and how certain the camera is.

    Args:
        run: whose verdict's checks the captions quote.
        found: how uncertain the best camera is over the image.
        halves: how far cameras of halves of its photos lie apart.
    """
    from calib.draw.fields import systematic_drawing
    from calib.draw.histograms import distribution_drawing
    from calib.show.run.figures import (
        coverage_figure,
        figure_of,
        halves_words,
        residuals_figure,
        sizes_figure,
        systematic_figure,
    )

    best = run.best
    checks = () if run.verdict is None else run.verdict.checks
    checked = {check.name: printable(check.sentence) for check in checks}
    residuals = residuals_of(best.evaluation)
    blocks: list[Block] = [
        coverage_figure(best.coverage, checked.get("coverage", "")),
        _halves_block(best, halves),
        residuals_figure(residuals, best.rms_px),
        systematic_figure(
            systematic_drawing(cells_of_residuals(residuals), residuals.image_size), checked.get("systematic", "")
        ),
        figure_of(distribution_drawing(best.evaluation)),
        *(sizes_figure(e.metric, e.size[e.is_counted], e.unit) for e in best.evaluation.errors),
        errors_table(best.metrics),
        *(() if best.held_out is None else (errors_table(best.held_out),)),
    ]
    lead = f"{found.words} (1 sigma, as stated). {halves_words(halves)}"
    return Section("Accuracy", tuple(blocks), lead=lead.rstrip())


def _halves_block(best: Solved, halves: HalvesApart | NoHalves) -> Block:
    """A map of how far the cameras of halves of the photos lie apart, or why there is none."""
    from calib.show.run.figures import apart_figure, apart_words

    if isinstance(halves, NoHalves):
        return Paragraph(f"Halves of the photos were not compared: {printable(halves.reason)}.")
    words = (
        f"Solved from halves of the photos: {apart_words(halves)}; that is {digits(halves.ratio, 2)} times what their "
        "standard deviations let expect"
    )
    title = "Cross-validation: difference of cameras from halves of the photos"
    return apart_figure(title, halves, best.calibration.camera.image_size, words)


def models_section(run: Run) -> Section:
    """Cameras of other models: their errors, where they differ from the best, and the residuals of each."""
    from calib.show.run.figures import apart_figure, apart_words

    best = run.best
    differences: list[Block] = []
    words = []
    for one in run.others:
        if one.calibration.status != "converged":
            differences.append(Paragraph(f"{one.model} is {one.calibration.status}, so not compared."))
            continue
        a, b = Known.exactly(best.calibration.camera), Known.exactly(one.calibration.camera)
        found = apart(a, b, best.coverage)
        if found is None:
            differences.append(Paragraph(f"{best.model} and {one.model} share no part of the covered image."))
            continue
        title, said = f"Difference of {one.model} from {best.model}", apart_words(found)
        words.append(f"{one.model} by {px(found.percentile_95_px)}")
        is_nothing = np.nanmax(found.length_px) < LEAST_PX
        figure = apart_figure(title, found, a.camera.image_size, said) if not is_nothing else None
        differences.append(figure or Paragraph(f"{title}: {said[:1].lower()}{said[1:]}."))
    lead = f"Where the target was seen, 95 % of the image differs from {best.model} at most: {', '.join(words)}."
    all_models = (best, *run.others)
    fields = Fold("Systematic residuals of each model", tuple(_fields(all_models)))
    return Section("Models compared", (models_table(all_models), *differences, fields), lead=lead if words else "")


def _fields(solved: Sequence[Solved]) -> list[Figure]:
    """The systematic residuals of several models in one scale of colours."""
    from calib.draw.fields import systematic_drawing
    from calib.show.run.figures import systematic_figure

    residuals = [residuals_of(one.evaluation) for one in solved]
    shape = columns_rows(residuals[0].image_size, min(len(field.pixel) for field in residuals))
    cells = [cells_of(field.image_size, field.pixel, field.residual_px, shape) for field in residuals]
    longest = max(one.long_px for one in cells)
    return [
        systematic_figure(systematic_drawing(one, field.image_size, f"{of.model}: mean residual of each cell", longest))
        for of, field, one in zip(solved, residuals, cells, strict=True)
    ]
