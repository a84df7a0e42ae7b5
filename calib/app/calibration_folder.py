"""The folder of cameras that are solved and judged: each result is written when it is there."""

import os
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager, suppress
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, cast

from calib.app.detect import DETECTIONS_FILE, detections_answer
from calib.cameras import MODELS
from calib.cameras.camera import CAMERA
from calib.draw import CALIBRATION_PICTURE
from calib.draw.gallery import OVERLAYS
from calib.judge.folders import RECORDS_FILE, JudgedRun, keep_target, records_in
from calib.judge.judge import VERDICT, VERDICT_FILE
from calib.judge.next_views import NEXT_VIEWS, NEXT_VIEWS_FILE, NextViews
from calib.judge.solutions import Solution, best_of
from calib.observe.calibration_file import (
    CALIBRATION,
    CALIBRATION_FILE,
    CAMERA_FILE,
    OBSERVATIONS_FILE,
    write_calibration,
)
from calib.observe.dataset import Records, records_path
from calib.solver.calibration import session_files
from calib.solver.metrics.evaluation import Evaluation
from calib.solver.metrics.evaluation_files import METRICS_FILE, METRICS_FILES, Metrics, evaluation_files, metrics_of
from designer.base.codec import encode
from designer.base.errors import InputError, NotWrittenError
from designer.base.files import check_folder
from designer.base.own_files import is_ours, require_ours
from designer.page.output import Output
from designer.page.page_file import BLOCKS_FILE, why_no_page

if TYPE_CHECKING:
    from calib.observe.photos import FoundPhotos, Search
    from designer.base.answer import Value

FRAMES = "frames"
"""Folder of a run's frames of clips: a run of it is the same without the clip."""
OWN_PAGES = ("calibration", "detections")
"""Kinds that give way to a calibration's page: its own, and that of a run that found nothing."""


class RunFolder:
    """Writes one folder: each result when it is there."""

    def __init__(self, out: Output, models: Sequence[str]) -> None:
        """Refuse a place that takes no files, or holds somebody else's, before any work is done.

        Raises:
            InputError: the message names the file.
        """
        self.out, self.folder, self.models = out, out.place, tuple(models)
        self.solutions: list[Solution] = []
        self.faults: list[str] = []  # what could not be written of a run, for its page
        self._records: Records | None = None
        for place in (self.folder, self.folder / OVERLAYS):
            check_folder(place)
        for place in (self.folder, *map(self.place_of, self.models)):
            for name in (CALIBRATION_FILE, OBSERVATIONS_FILE, CAMERA_FILE, CALIBRATION_PICTURE):
                require_ours(place / name)
        require_ours(self.folder / VERDICT_FILE, kind=VERDICT.format)
        require_ours(self.folder / NEXT_VIEWS_FILE, kind=NEXT_VIEWS.format)

    def place_of(self, model: str) -> Path:
        """Where a model's files go: with several models, each has a folder of its name."""
        return self.folder / self._path_of(model)

    def _path_of(self, model: str) -> str:
        return "" if len(self.models) == 1 else f"{model}/"

    def require_room(self) -> None:
        """Refuse a folder with somebody's own page or tables in it, of a run that is to be written whole.

        Raises:
            InputError: the message names the file.
        """
        if why := why_no_page(self.folder, *OWN_PAGES):
            raise InputError(why)
        self._require_room_for_tables()

    def _require_room_for_tables(self) -> None:
        for place in dict.fromkeys(self.place_of(model) for model in self.models):
            require_ours(place / METRICS_FILE)
        for name in (DETECTIONS_FILE, RECORDS_FILE):
            require_ours(self.folder / name)

    def write_all(self, run: JudgedRun, search: "Search | None") -> JudgedRun:
        """Write a run that is there already, all but its page; the run as it is in the folder.

        Raises:
            InputError: a file is somebody else's, or the best camera makes no sense.
        """
        from calib.observe.photos import with_overlays

        self.require_room()
        if search is not None:
            with self.drawing() as staging:
                drawn = with_overlays(search, staging)
                self.write_search(drawn, staging)
                self.faults += [one.overlay_failure for one in drawn.results if one.overlay_failure]
        written = [self.write_solution(solution) for solution in run.solutions]
        best = next(one for one in written if one.model == run.best.model)
        if best.evaluation is None:
            raise InputError(best.failure)
        self.write_tables()
        return self.write_verdict(replace(run, solutions=tuple(written)))

    def without_own_pictures(self, photos: "FoundPhotos") -> "FoundPhotos":
        """The photos without the picture that an earlier run drew among them."""
        drawn = Path(os.path.abspath(self.folder)) / CALIBRATION_PICTURE
        return replace(photos, photos=tuple(one for one in photos.photos if Path(os.path.abspath(one.path)) != drawn))

    @contextmanager
    def drawing(self) -> Iterator[Path]:
        """A folder for overlays until all are drawn; nothing is left if that does not come to its end."""
        from calib.observe.photos import no_empty_folders, staging_folder

        self._require_room_for_tables()
        place = self.folder / OVERLAYS
        with no_empty_folders(place), staging_folder(place) as staging:
            yield staging

    def write_search(self, search: "Search", staging: Path) -> None:
        """Write what was found in the photos, and keep the overlays that were drawn instead of earlier ones."""
        from calib.observe.photos import OVERLAY_MARK, keep_pictures, kept_frames, remove_ours
        from calib.observe.search import write_search

        table, place = self.folder / DETECTIONS_FILE, self.folder / OVERLAYS
        self._records = write_search(table, search)
        pictures = keep_pictures(staging, place)
        if not (place / BLOCKS_FILE).exists():  # else they are of `calib detect --overlay`
            remove_ours(set(place.glob(f"*{OVERLAY_MARK}.*")) - set(pictures))
        if frames := kept_frames(search.results, self.folder / FRAMES):
            remove_ours(set((self.folder / FRAMES).glob("*.png")) - set(frames))
            self.out.write(frames)
        self.out.files += [table, records_path(table), *pictures]
        self.out.finished.append(table)
        self.out.answer = {"detections": detections_answer(search), **self.out.answer}

    def write_solution(self, solution: Solution) -> Solution:
        """Write a model's calibration, if there is one; the solution, or one that failed if it makes no sense.

        Raises:
            NotWrittenError: the disk is full.
        """
        from calib.observe.photos import remove_ours

        written = replace(solution, path=self._path_of(solution.model))
        if written.evaluation is not None:
            place = self.place_of(written.model)
            try:
                earlier = _session_cameras(place)
                files, provenance = write_calibration(place, written.calibration, written.provenance)
                remove_ours(dict.fromkeys(earlier - set(files), CAMERA.format))
                written = replace(written, provenance=provenance)
                self.out.files += files
                self.out.finished.append(place)
            except NotWrittenError:
                raise
            except InputError as error:
                written = replace(written, evaluation=None, failure=str(error))
        self.solutions.append(written)
        self.out.answer = {**self.out.answer, **solutions_answer(self.solutions, None, self.folder), "verdict": None}
        return written

    def write_tables(self) -> None:
        """Write tables of each model, and a picture of the best one."""
        from calib.draw import calibration_figures

        for one in self.solutions:
            if one.evaluation is not None:
                self.out.write(evaluation_files(one.evaluation, self.place_of(one.model)))
        self.out.write(calibration_figures(best_of(self.solutions).evaluated, self.folder))

    def write_verdict(self, run: JudgedRun) -> JudgedRun:
        """Write the target as it was used, the verdict, and the photos to take next; cameras of earlier runs go.

        Returns:
            The run as it is in the folder.
        """
        if run.target is not None:
            is_again = (self.folder / VERDICT_FILE).exists()
            kept = keep_target(self.folder, run.target, is_again=is_again)
            self.out.files += kept
            if not kept:
                self.faults.append("target.json: another file has the name and stays; the target is not in the folder")
        judged = run.judged and replace(run.judged, solution_sha256=run.best.provenance.observations_sha256)
        files = {self.folder / NEXT_VIEWS_FILE: NEXT_VIEWS.text(NextViews(run.next_views))}
        if judged is not None:
            files[self.folder / VERDICT_FILE] = VERDICT.text(judged)
        self.out.write(files)
        self._remove_earlier()
        records = self._records or records_in(self.folder, run.best.calibration.observations.view_names, [])
        return replace(run, judged=judged, records=records, faults=tuple(self.faults))

    def _remove_earlier(self) -> None:
        """Remove the cameras of earlier runs from the folder, which are not of this one; other runs' folders stay."""
        from calib.observe.photos import remove_ours

        here = {self.place_of(one.model) for one in self.solutions if one.evaluation is not None}
        for place in (self.folder, *(self.folder / model for model in MODELS)):
            is_run_of_its_own = place != self.folder and (place / VERDICT_FILE).exists()
            if place in here or is_run_of_its_own or not (place / CALIBRATION_FILE).is_file():
                continue
            if is_ours(place / CALIBRATION_FILE, CALIBRATION.format):
                names = (CALIBRATION_FILE, OBSERVATIONS_FILE, CAMERA_FILE)
                kinds: Mapping[str, str] = {**dict.fromkeys(names, ""), **METRICS_FILES}
                sessions = dict.fromkeys(_session_cameras(place), CAMERA.format)
                remove_ours({**{place / name: kind for name, kind in kinds.items()}, **sessions})
                with suppress(OSError):  # it holds something else
                    place.rmdir()


def _session_cameras(place: Path) -> set[Path]:
    """Where the cameras of the sessions are of the calibration that lies there."""
    if not any(place.glob("camera.*.json")):
        return set()
    with suppress(InputError):  # it is broken, and nothing tells whose cameras they are
        return {place / name for name in session_files(CALIBRATION.read(place / CALIBRATION_FILE).sessions)}
    return set()


def solutions_answer(solutions: Sequence[Solution], best: str | None, folder: Path) -> "dict[str, Value]":
    """All models, and the one to go on with."""
    models: list[Value] = [
        {"model": one.model, "status": "failed", "failure": one.failure} if one.evaluation is None else {
            **evaluation_answer(one.evaluation), "failure": None, "camera_file": str(folder / one.path / CAMERA_FILE),
            "calibration_file": str(folder / one.path / CALIBRATION_FILE),
        }
        for one in solutions
    ]  # fmt: skip
    return {"best": best, "models": models}


def evaluation_answer(evaluation: Evaluation) -> "dict[str, Value]":
    """A calibration and its errors, as `metrics.json` has them, and how it was solved."""
    calibration, metrics = evaluation.calibration, metrics_of(evaluation)
    reprojection = metrics.metrics.get("reprojection")
    return {
        **cast("dict[str, Value]", encode(Metrics, metrics)), "image_size_px": calibration.camera.image_size,
        "rms_px": None if reprojection is None else reprojection.errors.rmse,
        "sigma_px": None if calibration.weighted else calibration.scale,
        "sigma_of_stated": calibration.scale if calibration.weighted else None,
        "iterations": calibration.iterations, "seconds": calibration.seconds,
    }  # fmt: skip
