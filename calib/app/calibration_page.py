"""What a run says: its lead, the sections of its page, and what a screen says of it."""

import shlex
from collections.abc import Callable, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from calib.draw.gallery import OVERLAYS
from calib.draw.run_photos import photo_rows, photos_section, remarks_of_all, views_table
from calib.draw.run_tables import (
    as_sentence,
    check_findings,
    errors_table,
    faces_table,
    faces_words,
    field_of_view_words,
    focal_length,
    focal_title,
    headline_by,
    models_table,
    parameters_table,
    sessions_table,
    verdict_blocks,
)
from calib.judge.coverage import lit_part
from calib.judge.difference import Known, apart
from calib.judge.folders import JudgedRun
from calib.judge.halves import HalvesApart, NoHalves, half_split, halves_apart
from calib.judge.next_views import why_no_next_views
from calib.judge.solutions import Solution
from calib.judge.verdict import LEAST_PX, px
from calib.observe.dataset import ImageRecord
from calib.solver.metrics.residual_cells import cells_of, cells_of_residuals, columns_rows, residuals_of
from designer.base.words import counted, printable
from designer.base.words import figure as digits
from designer.page.blocks import (
    Block,
    Command,
    Facts,
    Figure,
    Finding,
    Findings,
    Fold,
    Headline,
    Page,
    Paragraph,
    Section,
    Steps,
)
from designer.page.folders import Shown, file_list, some_of, table_of

if TYPE_CHECKING:
    from calib.draw.sigma_map import SigmaMap

MOST_SKIPPED = 5
NOT_JUDGED = "verdict.json is missing, so nothing was judged; calib report with --criteria standard judges it."
FILES_OF_RUN = (
    ("verdict.json", "what was checked, for programs"),
    ("next_views.json", "photos to take next"),
    ("target.json", "the target as it was used"),
    ("detections.csv", "features found in the photos"),
    ("detections.records.json", "what was read of each face, and why features are missing"),
    ("calibration.png", "figures of the recommended model on one sheet"),
)
FILES_OF_MODEL = (
    ("calibration.json", "the whole solution: camera, poses, covariances"),
    ("camera.json", "the camera, for other commands and programs"),
    ("observations.csv", "each observation and its residual"),
    ("metrics.json", "errors in summary"),
    ("metrics_views.csv", "errors by photo"),
    ("metrics_faces.csv", "errors by face"),
    ("metrics_points.csv", "errors by feature"),
    ("metrics_observations.csv", "errors by observation"),
    ("calibration.png", "figures on one sheet"),
)


def headline_of(run: JudgedRun) -> Headline:
    """The answer, before anything else."""
    best = run.best
    left = f", with residuals of {digits(best.rms_px, 3)} px (RMS)" if best.rms_px >= 0 else ""
    views = best.calibration.observations.view_count
    unjudged = f"The camera ({best.model}) was solved from {views} photos{left}. {NOT_JUDGED}"
    return headline_by(None if run.judged is None else run.judged.verdict, unjudged)


def key_facts(run: JudgedRun) -> Facts:
    """Camera, photos and checks, a line each."""
    best = run.best
    calibration, camera, seen = best.calibration, best.calibration.camera, best.calibration.observations
    width, height = camera.image_size
    used = int((~calibration.is_outlier).sum())
    photos = counted(seen.view_count, "photo")
    lit = lit_part(calibration)
    field = field_of_view_words(lit.camera, "" if lit.is_measured else "observations end")
    scale = f", {digits(calibration.scale, 2)} times the noise that is stated" if calibration.weighted else ""
    return Facts((
        ("camera", f"{best.model}, {width} x {height} px, {calibration.status}"),
        ("lens", f"{focal_title(camera)} {focal_length(calibration)} px, field of view {field}"),
        ("residual", f"{digits(best.rms_px, 3)} px RMS, of {used} observations in {photos}{scale}"),
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


def _checks_words(run: JudgedRun) -> str:
    if run.judged is None:
        return ""
    checks, criteria = run.judged.verdict.checks, run.judged.criteria
    known = [check for check in checks if check.grade != "unknown"]
    good = sum(check.grade == "good" for check in known)
    open_ = f", {len(checks) - len(known)} could not be made" if len(known) < len(checks) else ""
    limits = f"{printable(criteria.name)} ({printable(criteria.title)})"
    return f"{good} of {len(known)} good{open_}; limits: {limits}; others with --criteria"


def verdict_section(run: JudgedRun) -> Section:
    """What was checked, and what is missing."""
    best, verdict = run.best, None if run.judged is None else run.judged.verdict
    remarks = tuple(dict.fromkeys((*best.calibration.remarks, *best.evaluated.remarks)))
    blocks = verdict_blocks(
        verdict, run.faults, remarks, () if verdict else (Finding("note", "Not judged", NOT_JUDGED),)
    )
    return Section("Verdict", blocks, lead=_checks_words(run))


def steps_of(run: JudgedRun) -> tuple[str, ...]:
    """What to do better next time, the most useful first."""
    return () if run.judged is None else tuple(map(printable, run.judged.verdict.advice))


def words_of_ours(run: JudgedRun) -> tuple[str, ...]:
    """What our own target would tell from the same places, of photos of another maker's board."""
    if run.target is None or run.target.marks is None:
        return ()
    from calib.studies.with_ours import with_ours

    found = with_ours(run.best.calibration, run.target)
    return () if found is None else (as_sentence(found.words),)


def next_section(run: JudgedRun) -> Section | None:
    """What to do better next time, and a sketch of where to hold the target; None if there is nothing."""
    from calib.draw.run_figures import next_views_figure

    blocks: list[Block] = []
    if steps := steps_of(run):
        blocks.append(Steps(tuple(as_sentence(line.replace("`", "")) for line in steps)))
    if run.next_views:
        blocks.append(next_views_figure(run.best.calibration.observations, run.next_views, run.best.coverage.area))
    elif why := why_no_next_views(run.best.calibration):
        blocks.append(Paragraph(f"No photos are proposed: {printable(why)}."))
    blocks += [Paragraph(line) for line in words_of_ours(run)]
    lead = "What would make the camera better, the most useful first."
    return Section("Next time", tuple(blocks), lead=lead) if blocks else None


def camera_section(run: JudgedRun) -> Section:
    """Parameters, and the files to use; a camera that is judged unfit is not handed on."""
    best, is_usable = run.best, run.judged is None or run.judged.verdict.grade != "bad"
    place = f"{best.path}camera.json"
    blocks: list[Block] = [parameters_table(best.metrics)]
    blocks += [sessions_table(best.calibration)] if best.calibration.sessions else []
    blocks += [Fold(f"Parameters of model {one.model}", (parameters_table(one.metrics),)) for one in run.others]
    if is_usable:
        blocks.append(Command(
            f"calib convert {shlex.quote(place)} --to opencv -o camera.yaml",
            "To use it: camera.json holds all; for OpenCV (ros, kalibr, colmap, mrcal, metashape) type in this folder",
        ))  # fmt: skip
    use = f"{place} is the file to use." if is_usable else f"{place} is not to be used: see the verdict."
    return Section("Camera", tuple(blocks), lead=use)


def halves_of(run: JudgedRun) -> HalvesApart | NoHalves:
    """How far cameras of halves of the photos lie apart: those that the verdict rests on, or else solved now."""
    best = run.best
    split = half_split(best.calibration, best.provenance.options) if run.judged is None else run.judged.halves
    return halves_apart(split, best.coverage)


def accuracy_section(run: JudgedRun, found: "SigmaMap", halves: HalvesApart | NoHalves) -> Section:
    """The residuals, and how certain the camera is."""
    from calib.draw.fields import systematic_drawing
    from calib.draw.run_figures import (
        coverage_figure,
        distribution_drawing,
        halves_words,
        residuals_figure,
        run_figure,
        sizes_figure,
        systematic_figure,
    )

    best = run.best
    checks = () if run.judged is None else run.judged.verdict.checks
    checked = {check.name: printable(check.sentence) for check in checks}
    residuals = residuals_of(best.evaluated)
    blocks: list[Block] = [
        coverage_figure(best.coverage, checked.get("coverage", "")),
        _halves_block(best, halves),
        residuals_figure(residuals, best.rms_px),
        systematic_figure(
            systematic_drawing(cells_of_residuals(residuals), residuals.image_size), checked.get("systematic", "")
        ),
        run_figure(distribution_drawing(best.evaluated)),
        *(sizes_figure(e.metric, e.size[e.is_counted], e.unit) for e in best.evaluated.errors),
        errors_table(best.metrics),
        *(() if best.held_out is None else (errors_table(best.held_out),)),
    ]
    lead = f"{found.words} (1 sigma, as stated). {halves_words(halves)}"
    return Section("Accuracy", tuple(blocks), lead=lead.rstrip())


def _halves_block(best: Solution, halves: HalvesApart | NoHalves) -> Block:
    """A map of how far the cameras of halves of the photos lie apart, or why there is none."""
    from calib.draw.run_figures import apart_figure, apart_words

    if isinstance(halves, NoHalves):
        return Paragraph(f"Halves of the photos were not compared: {printable(halves.reason)}.")
    words = (
        f"Solved from halves of the photos: {apart_words(halves)}; that is {digits(halves.ratio, 2)} times what their "
        "standard deviations let expect"
    )
    title = "Cross-validation: difference of cameras from halves of the photos"
    return apart_figure(title, halves, best.calibration.camera.image_size, words)


def models_section(run: JudgedRun) -> Section:
    """Cameras of other models: their errors, where they differ from the best, and the residuals of each."""
    from calib.draw.run_figures import apart_figure, apart_words

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


def _fields(solved: Sequence[Solution]) -> list[Figure]:
    """The systematic residuals of several models in one scale of colours."""
    from calib.draw.fields import systematic_drawing
    from calib.draw.run_figures import systematic_figure

    residuals = [residuals_of(one.evaluated) for one in solved]
    shape = columns_rows(residuals[0].image_size, min(len(field.pixel) for field in residuals))
    cells = [cells_of(field.image_size, field.pixel, field.residual_px, shape) for field in residuals]
    longest = max(one.long_px for one in cells)
    return [
        systematic_figure(systematic_drawing(one, field.image_size, f"{of.model}: mean residual of each cell", longest))
        for of, field, one in zip(solved, residuals, cells, strict=True)
    ]


@dataclass(frozen=True, eq=False)
class RunView:
    """What the sections of a run's page are made from."""

    run: JudgedRun
    folder: Path | None  # of the run's files
    found: "SigmaMap"  # how uncertain the best camera is over the image
    halves: HalvesApart | NoHalves  # how far cameras of halves of its photos lie apart


def calibration_page(run: JudgedRun, folder: Path | None) -> Page:
    """The page of a run whose files lie in a folder: `SECTIONS`, as far as they have something to say."""
    from calib.draw.run_figures import uncertainty_figure
    from calib.draw.sigma_map import sigma_map

    best = run.best
    with ThreadPoolExecutor(1) as beside:
        view = RunView(run, folder, sigma_map(best.calibration), halves_of(run))
        photos = beside.submit(_photos, view)  # pictures are decoded while figures are drawn
        made = [photos.result() if make is _photos else make(view) for make in SECTIONS]
    lead = (uncertainty_figure(best.calibration, best.coverage, view.found, view.halves), key_facts(run))
    return Page("", "", headline_of(run), tuple(one for one in made if one is not None), lead=lead)


def _photos(view: RunView) -> Section:
    """Each photo with its residuals, and pictures of what was found."""
    run = view.run
    rows, common = photo_rows(run.best.evaluated, run.records), remarks_of_all(run.records)
    return photos_section(None if run.records is None else view.folder, rows, common, is_flat=_is_flat(run))


def _is_flat(run: JudgedRun) -> bool:
    return len(run.best.calibration.observations.points.plane) == 1


def _faces(view: RunView) -> Section | None:
    """The faces of a solid one by one."""
    run = view.run
    if _is_flat(run):
        return None
    return Section("Faces", (faces_table(run.best.evaluated, run.records),), lead=faces_words(run.best))


def _scene(view: RunView) -> Section:
    """Camera and target in 3D."""
    from calib.draw.camera_scene import camera_view, spread_words

    run = view.run
    return Section("Views in 3D", (camera_view(run.best, run.target, run.next_views),), lead=spread_words(run.best))


def _files(view: RunView) -> Section | None:
    """What the folder holds: of the run and of the best camera in sight, of the others behind a click."""
    run, folder = view.run, view.folder
    if folder is None:
        return None
    found = file_list(folder, tuple(dict([*FILES_OF_RUN, *_of_model(run.best)]).items()))
    others = [(one, file_list(folder, _of_model(one))) for one in run.others]
    count = len(found.rows) + sum(len(files.rows) for _, files in others)
    pictures = f" The overlays of the photos are in {OVERLAYS}/." if (folder / OVERLAYS).is_dir() else ""
    folds = tuple(Fold(f"Files of model {one.model}", (files,)) for one, files in others)
    return Section("Files", (found, *folds), lead=f"{count} files beside this page.{pictures}")


def _of_model(one: Solution) -> list[tuple[str, str]]:
    return [(f"{one.path}{name}", purpose) for name, purpose in FILES_OF_MODEL]


SECTIONS: list[Callable[[RunView], Section | None]] = [
    lambda view: verdict_section(view.run),
    lambda view: next_section(view.run),
    lambda view: camera_section(view.run),
    lambda view: accuracy_section(view.run, view.found, view.halves),
    _photos,
    _faces,
    _scene,
    lambda view: models_section(view.run) if view.run.others else None,
    _files,
]
"""In the order of reading; one that has nothing to say of a run is None."""


def calibration_words(run: JudgedRun, notes: Sequence[str], skipped: Sequence[str]) -> Page:
    """What a screen says of a run: its lead, what is not good, and the page's tables.

    Args:
        skipped: photos that could not be searched, likewise.
    """
    best, judged = run.best, run.judged
    said = (
        *(() if judged is None else (one for one in check_findings(judged.verdict) if one.level != "note")),
        *(Finding("note", "", printable(note)) for note in notes),
        *(Finding("note", "", line) for line in words_of_ours(run)),
        *(Finding("usable", "Skipped", printable(line)) for line in some_of(skipped, MOST_SKIPPED)),
    )
    left_out = table_of(skipped, Shown("skipped", str), title="All skipped") if len(skipped) > MOST_SKIPPED else None
    tables = (
        views_table(photo_rows(best.evaluated, run.records), is_flat=_is_flat(run)),
        *(() if _is_flat(run) else (faces_table(best.evaluated, run.records),)),
        models_table((best, *run.others)),
        *(parameters_table(one.metrics) for one in (best, *run.others)),
        *(() if left_out is None else (left_out,)),
    )
    sections = (Section("Verdict", (Findings(said), Steps(steps_of(run)))), Section("Tables", tables))
    return Page("", "", headline_of(run), sections, lead=(key_facts(run),))
