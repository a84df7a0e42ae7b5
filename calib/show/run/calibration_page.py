"""The page of a run: from a run in memory, or from what its folder stores and nothing else."""

from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from pathlib import Path

from calib.draw.sigma_map import SigmaMap, sigma_map
from calib.records.run_folder import Run, Solved, read_run
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
from calib.verdict.halves import HalvesApart, NoHalves
from designer.page.blocks import Fold, Page, Section
from designer.page.folders import file_list, title_of

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


@dataclass(frozen=True, eq=False)
class RunView:
    """What the sections of a run's page are made from."""

    run: Run
    folder: Path  # of the run's files
    found: SigmaMap  # how uncertain the best camera is over the image
    halves: HalvesApart | NoHalves  # how far cameras of halves of its photos lie apart


def page_of(run: Run, folder: Path, origin: Origin) -> Page:
    """The page of a run whose files lie in a folder: `SECTIONS`, as far as they have something to say."""
    best = run.best
    with ThreadPoolExecutor(1) as beside:
        view = RunView(run, folder, sigma_map(best.calibration), halves_of(run))
        photos = beside.submit(_photos, view)  # pictures are decoded while figures are drawn
        made = [photos.result() if make is _photos else make(view) for make in SECTIONS]
    lead = (uncertainty_figure(best.calibration, best.coverage, view.found, view.halves), key_facts(run))
    return Page(
        title=title_of(folder), kind="Calibration", headline=headline_of(run), lead=lead,
        sections=tuple(one for one in made if one is not None), made_by=origin.command, program=origin.program,
    )  # fmt: skip


def _photos(view: RunView) -> Section:
    """Each photo with its residuals, and pictures of what was found."""
    run = view.run
    rows, common = photo_rows(run.best.evaluation, run.records), remarks_of_all(run.records)
    return photos_section(None if run.records is None else view.folder, rows, common, is_flat=_is_flat(run))


def _is_flat(run: Run) -> bool:
    return len(run.best.calibration.observations.points.plane) == 1


def _faces(view: RunView) -> Section | None:
    """The faces of a solid one by one."""
    run = view.run
    if _is_flat(run):
        return None
    return Section("Faces", (faces_table(run.best.evaluation, run.records),), lead=faces_words(run.best))


def _scene(view: RunView) -> Section:
    """Camera and target in 3D."""
    run = view.run
    return Section("Views in 3D", (camera_view(run.best, run.target, run.next_views),), lead=spread_words(run.best))


def _files(view: RunView) -> Section:
    """What the folder holds: of the run and of the best camera in sight, of the others behind a click."""
    run, folder = view.run, view.folder
    found = file_list(folder, tuple(dict([*FILES_OF_RUN, *_of_model(run.best)]).items()))
    others = [(one, file_list(folder, _of_model(one))) for one in run.others]
    count = len(found.rows) + sum(len(files.rows) for _, files in others)
    pictures = f" The overlays of the photos are in {OVERLAYS}/." if (folder / OVERLAYS).is_dir() else ""
    folds = tuple(Fold(f"Files of model {one.model}", (files,)) for one, files in others)
    return Section("Files", (found, *folds), lead=f"{count} files beside this page.{pictures}")


def _of_model(one: Solved) -> list[tuple[str, str]]:
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
