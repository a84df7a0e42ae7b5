"""The page of a run: from a run in memory, or from what its folder stores and nothing else."""

from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

from calib.figures.sigma_map import sigma_map
from calib.records.run_folder import Run, Solved, read_run
from calib.show.parts.folder_blocks import file_list, title_of
from calib.show.parts.gallery import OVERLAYS
from calib.show.parts.origin import Origin
from calib.show.run.camera_scene import camera_view, spread_words
from calib.show.run.figures import uncertainty_figure
from calib.show.run.photos import photo_rows, photos_section, remarks_of_all
from calib.show.run.sections import (
    accuracy_section,
    camera_section,
    halves_of,
    headline_of,
    key_facts,
    models_section,
    next_section,
    verdict_section,
)
from calib.show.run.tables import faces_table, faces_words
from designer.page.blocks import Fold, Page, Section

FILES_OF_RUN = (
    ("verdict.json", "what was checked, for programs"),
    ("next_views.json", "photos to take next"),
    ("target.json", "the target as it was used"),
    ("detections.csv", "rings found in the photos"),
    ("detections.records.json", "what was read of each face, and why rings are missing"),
    ("calibration.png", "figures of the recommended model on one sheet"),
)
FILES_OF_MODEL = (
    ("calibration.json", "the whole solution: camera, poses, covariances"),
    ("camera.json", "the camera, for other commands and programs"),
    ("observations.csv", "each observation and its residual"),
    ("metrics.json", "errors in summary"),
    ("metrics_views.csv", "errors by photo"),
    ("metrics_faces.csv", "errors by face"),
    ("metrics_points.csv", "errors by ring"),
    ("metrics_observations.csv", "errors by observation"),
    ("calibration.png", "figures on one sheet"),
)


def calibration_page(folder: Path, origin: Origin) -> Page:
    """Read a folder and build its page.

    Raises:
        InputError: no camera in it can be read; the message names the file.
    """
    return page_of(read_run(folder), folder, origin)


def page_of(run: Run, folder: Path, origin: Origin) -> Page:
    """The page of a run whose files lie in a folder."""
    best = run.best
    calibration = best.calibration
    faces = len(calibration.observations.points.plane)
    with ThreadPoolExecutor(1) as beside:  # pictures are decoded while figures are drawn
        rows, common = photo_rows(best.evaluation, run.records), remarks_of_all(run.records)
        place = folder if run.records is not None else None
        photos = beside.submit(photos_section, place, rows, common, is_flat=faces == 1)
        found, halves = sigma_map(calibration), halves_of(run)
        sections = [
            verdict_section(run),
            *next_section(run),
            camera_section(run),
            accuracy_section(run, found, halves),
        ]
        after: list[Section] = []
        if faces > 1:
            after.append(Section("Faces", (faces_table(best.evaluation, run.records),), lead=faces_words(best)))
        scene = camera_view(best, run.target, run.next_views)
        after.append(Section("Views in 3D", (scene,), lead=spread_words(best)))
        if run.others:
            after.append(models_section(run))
        lead = (uncertainty_figure(calibration, best.coverage, found, halves), key_facts(run))
        sections += [photos.result(), *after, _files_section(run, folder)]
    return Page(
        title=title_of(folder), kind="Calibration", headline=headline_of(run), sections=tuple(sections), lead=lead,
        made_by=origin.command, program=origin.program,
    )  # fmt: skip


def _files_section(run: Run, folder: Path) -> Section:
    """What the folder holds: of the run and of the best camera in sight, of the others behind a click."""
    found = file_list(folder, tuple(dict([*FILES_OF_RUN, *_of_model(run.best)]).items()))
    others = [(one, file_list(folder, _of_model(one))) for one in run.others]
    count = len(found.rows) + sum(len(files.rows) for _, files in others)
    pictures = f" The overlays of the photos are in {OVERLAYS}/." if (folder / OVERLAYS).is_dir() else ""
    folds = tuple(Fold(f"Files of model {one.model}", (files,)) for one, files in others)
    return Section("Files", (found, *folds), lead=f"{count} files beside this page.{pictures}")


def _of_model(one: Solved) -> list[tuple[str, str]]:
    return [(f"{one.path}{name}", purpose) for name, purpose in FILES_OF_MODEL]
