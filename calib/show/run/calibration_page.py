"""The page of a calibration's folder, from what the folder stores and nothing else."""

from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

from calib.figures.sigma_map import sigma_map
from calib.records.run_folder import RunFolder, Solved, read_run
from calib.show.parts.folder_blocks import title_of
from calib.show.parts.origin import Origin
from calib.show.run.camera_scene import camera_view, spread_words
from calib.show.run.judging import is_verdict_on
from calib.show.run.photos import photo_rows, photos_section, remarks_of_all
from calib.show.run.run_files import files_section
from calib.show.run.run_tables import faces_table, faces_words
from calib.show.run.sections import (
    accuracy_section,
    camera_section,
    halves_of,
    headline_of,
    models_section,
    next_section,
    not_judged,
    page_lead,
    verdict_section,
)
from calib.verdict.judge import VERDICT, VERDICT_FILE, Judged
from calib.verdict.next_views import NEXT_VIEWS, NEXT_VIEWS_FILE, NextView, next_views
from designer.base.errors import InputError
from designer.base.words import printable
from designer.page.blocks import Page, Section


def calibration_page(folder: Path, origin: Origin) -> Page:
    """Read a folder and build its page.

    Raises:
        InputError: no camera in it can be read; the message names the file.
    """
    return page_of(read_run(folder), origin)


def page_of(run: RunFolder, origin: Origin) -> Page:
    """The page of a folder that is read already, with the verdict that lies in it."""
    folder, faults = run.folder, list(run.faults)
    judged = _judged(folder, faults)
    best = run.best("" if judged is None else judged.verdict.model)
    if judged is not None and not is_verdict_on(judged, best):
        faults.append(f"{VERDICT_FILE}: on another camera or other photos; calib report with --criteria judges again")
        judged = None
    verdict = None if judged is None else judged.verdict
    is_flat = len(best.calibration.observations.points.plane) == 1
    with ThreadPoolExecutor(1) as beside:  # pictures are decoded while figures are drawn
        rows, common = photo_rows(run, best), remarks_of_all(run.records)
        photos = beside.submit(photos_section, folder, rows, common, is_flat=is_flat)
        proposed = _proposed(folder, best, faults)
        found = sigma_map(best.calibration)
        halves = halves_of(best, judged)
        sections = [
            verdict_section(verdict, best, faults),
            *next_section(verdict, best, proposed),
            camera_section(run, best, is_usable=verdict is None or verdict.grade != "bad"),
            accuracy_section(best, found, halves, verdict),
        ]
        after: list[Section] = []
        if len(best.calibration.observations.points.plane) > 1:
            after.append(Section("Faces", (faces_table(best, run.records),), lead=faces_words(best)))
        view = camera_view(best, run.target, proposed)
        after.append(Section("Views in 3D", (view,), lead=spread_words(best)))
        if len(run.solved) > 1:
            after.append(models_section(run, best))
        lead = page_lead(best, found, halves)
        headline = not_judged(best) if verdict is None else headline_of(verdict)
        sections += [photos.result(), *after, files_section(run, best)]
    return Page(
        title=title_of(folder), kind="Calibration", headline=headline, sections=tuple(sections),
        lead=lead, made_by=origin.command, program=origin.program,
    )  # fmt: skip


def _judged(folder: Path, faults: list[str]) -> Judged | None:
    if not (folder / VERDICT_FILE).exists():
        return None
    try:
        return VERDICT.read(folder / VERDICT_FILE)
    except InputError as error:
        faults.append(printable(str(error).replace(f"{folder}/", "")))
        return None


def _proposed(folder: Path, best: Solved, faults: list[str]) -> tuple[NextView, ...]:
    """The photos to take next, as they are stored or as the camera tells."""
    if (folder / NEXT_VIEWS_FILE).exists():
        try:
            return NEXT_VIEWS.read(folder / NEXT_VIEWS_FILE).views
        except InputError as error:
            faults.append(printable(str(error).replace(f"{folder}/", "")))
    return next_views(best.calibration)
