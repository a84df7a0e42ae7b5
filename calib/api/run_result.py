"""What `run` and `solve` return, and the folder they write: each result is written when it is there."""

import os
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, replace
from functools import cached_property
from pathlib import Path

from calib.api.page_shown import ShownAsPage
from calib.api.staging import keep_pictures, no_empty_folders, staging_folder
from calib.core.files import check_folder, write_files
from calib.core.types import Detections, Observations
from calib.figures import CALIBRATION_PICTURE, COMPARISON_PICTURE, calibration_figures, comparison_figures
from calib.metrics.evaluation import Evaluation
from calib.observe.dataset import write_detections
from calib.observe.photos import FoundPhotos, PhotoFile, PhotoResult, Search, detect_photos
from calib.observe.records import Records, read_records, records_path
from calib.pipeline.solving import Solution, SolveTask, preference
from calib.records.calibration_file import (
    CALIBRATION_FILE,
    CAMERA_FILE,
    OBSERVATIONS_FILE,
    Provenance,
    write_calibration,
)
from calib.records.evaluation_files import METRICS_FILE, evaluation_files
from calib.records.run_folder import RECORDS_FILE, RunFolder, Solved, solved_of
from calib.show.folder import PAGE_FILE, why_no_page, write_folder_page
from calib.show.parts.kept_target import keep_target
from calib.verdict.judge import VERDICT, VERDICT_FILE, Judged
from calib.verdict.next_views import NEXT_VIEWS, NEXT_VIEWS_FILE, NextView, NextViews
from calib.verdict.verdict import Verdict
from designer.base.answer import program
from designer.base.errors import InputError, NotWrittenError
from designer.base.own_files import require_ours
from designer.target import TargetGeometry


@dataclass(frozen=True, eq=False)
class RunResult(ShownAsPage):
    """Cameras of one or several models from the same photos, judged: `run.best.camera`, `run.verdict.grade`.

    In a notebook the result shows its report.
    """

    target: TargetGeometry | None  # None: the points came from elsewhere
    search: Search | None  # of the photos; None: solved from observations
    task: SolveTask
    solutions: tuple[Solution, ...]  # of each model, at least one of them solved
    judged: Judged
    next_views: tuple[NextView, ...]  # photos that would make the camera better

    @property
    def observations(self) -> Observations:
        """What the cameras were solved from."""
        return self.task.observations

    @cached_property
    def best(self) -> Solution:
        """The camera to go on with: determined, of a model that other programs know, with the least residuals."""
        return best_of(self.solutions)

    @property
    def verdict(self) -> Verdict:
        """Whether to use the best camera, and why."""
        return self.judged.verdict

    @property
    def remarks(self) -> tuple[str, ...]:
        """What a person must know of photos, observations and cameras, one line each."""
        of_search = () if self.search is None else self.search.remarks
        made = () if self.task.made is None else (self.task.made.sentence,)
        of_best = (*self.best.calibration.remarks, *(self.best.evaluation.remarks if self.best.evaluation else ()))
        return tuple(dict.fromkeys((*of_search, *made, *of_best)))

    def save(self, folder: str | Path) -> tuple[Path, ...]:
        """Write the folder that `calib run` writes: cameras, tables, pictures, verdict and page; return the files.

        Raises:
            InputError: the folder takes no files, or holds somebody else's; the message names them.
        """
        from calib.api.run_result import RunWriter

        writer = RunWriter(Path(folder), self.task.plan.models)
        writer.write_all(self)
        return tuple(writer.files)

    def _write_all(self, folder: Path) -> tuple[Path, ...]:
        return self.save(folder)


def best_of(solutions: Sequence[Solution]) -> Solution:
    """The one to go on with, of those that were solved.

    Raises:
        ValueError: none was.
    """
    solved = [one for one in solutions if one.evaluation is not None]
    if not solved:
        raise ValueError("no model was solved")
    return min(solved, key=lambda one: preference(one.evaluation))  # type: ignore[arg-type]  # none is None here


DETECTIONS_FILE, OVERLAYS = "detections.csv", "overlays"


class RunWriter:
    """Writes one folder, and knows what it has written."""

    def __init__(self, folder: Path, models: Sequence[str]) -> None:
        """Refuse a place that takes no files, or holds somebody else's, before any work is done.

        Raises:
            InputError: the message names the file.
        """
        self.folder, self.models = folder, tuple(models)
        self.files: list[Path] = []
        self.solutions: list[Solution] = []
        self._provenance: dict[str, Provenance] = {}
        self._records: Records | None = None
        self._faults: list[str] = []  # what could not be written of a run, for its page
        for place in (folder, folder / OVERLAYS):
            check_folder(place)
        for place in (folder, *(self.place_of(model) for model in models)):
            for name in (CALIBRATION_FILE, OBSERVATIONS_FILE, CAMERA_FILE, CALIBRATION_PICTURE, COMPARISON_PICTURE):
                require_ours(place / name)
        require_ours(folder / VERDICT_FILE, kind=VERDICT.format)
        require_ours(folder / NEXT_VIEWS_FILE, kind=NEXT_VIEWS.format)

    @property
    def finished(self) -> list[Solution]:
        """The solutions that are written."""
        return [one for one in self.solutions if one.evaluation is not None]

    def place_of(self, model: str) -> Path:
        """Where a model's files go: with several models, each has a folder of its name."""
        return self.folder if len(self.models) == 1 else self.folder / model

    def write_all(self, run: RunResult) -> None:
        """Write a run that is there already, and its page.

        Raises:
            InputError: a file is somebody else's, or the best camera makes no sense.
        """
        if why := why_no_page(self.folder, "calibration"):
            raise InputError(why)
        self._require_room_for_tables()
        if run.search is not None:
            with self.drawing() as staging:
                drawn = _with_overlays(run.search, staging)
                self.write_search(drawn, staging)
                self._faults += [one.overlay_failure for one in drawn.results if one.overlay_failure]
        written = [self.write_solution(solution, run.task) for solution in run.solutions]
        if run.best.model not in self._provenance:
            raise InputError(next(one.failure for one in written if one.model == run.best.model))
        self.write_tables(written)
        self.write_verdict(run)
        if remark := self.write_page(run, ""):
            raise InputError(remark)

    def _require_room_for_tables(self) -> None:
        """Refuse somebody's own files under the names of tables to be written.

        Raises:
            InputError: the message names the file.
        """
        for place in dict.fromkeys(self.place_of(model) for model in self.models):
            require_ours(place / METRICS_FILE)
        for name in (DETECTIONS_FILE, RECORDS_FILE):
            require_ours(self.folder / name)

    def without_own_pictures(self, photos: FoundPhotos) -> FoundPhotos:
        """The photos without the pictures that an earlier run drew among them."""
        place = Path(os.path.abspath(self.folder))
        drawn = {place / COMPARISON_PICTURE, place / CALIBRATION_PICTURE}
        return replace(photos, paths=tuple(one for one in photos.paths if Path(os.path.abspath(one)) not in drawn))

    @contextmanager
    def drawing(self) -> Iterator[Path]:
        """A folder for overlays until all are drawn; nothing is left if that does not come to its end."""
        self._require_room_for_tables()
        place = self.folder / OVERLAYS
        with no_empty_folders(place), staging_folder(place) as staging:
            yield staging

    def write_search(self, search: Search, staging: Path) -> None:
        """Write what was found in the photos, and keep the overlays that were drawn."""
        table = self.folder / DETECTIONS_FILE
        self._records = write_search(table, search)
        pictures = keep_pictures(staging, self.folder / OVERLAYS)
        self.files += [table, records_path(table), *pictures]

    def write_solution(self, solution: Solution, task: SolveTask) -> Solution:
        """Write a model's calibration, if there is one; the solution, or one that failed if it makes no sense.

        Raises:
            NotWrittenError: the disk is full.
        """
        written = solution if solution.evaluation is None else self._written(solution, task)
        self.solutions.append(written)
        return written

    def _written(self, solution: Solution, task: SolveTask) -> Solution:
        model = solution.model
        provenance = Provenance(
            program(), layout_id=task.layout_id, geometry_id=task.observations.points.geometry_id,
            options=task.plan.options_of(model), settings=(*task.settings, ("model", model)),
        )  # fmt: skip
        try:
            files, self._provenance[model] = write_calibration(self.place_of(model), solution.calibration, provenance)
        except NotWrittenError:
            raise
        except InputError as error:
            return replace(solution, evaluation=None, failure=str(error))
        self.files += files
        return solution

    def write_tables(self, solutions: Sequence[Solution]) -> None:
        """Write tables of each model, and pictures of the best one and of all side by side."""
        best, evaluations = best_of(solutions), []
        for one in solutions:
            if one.evaluation is not None:
                evaluations.append(one.evaluation)
                self._write(evaluation_files(one.evaluation, self.place_of(one.model)))
        pictures: dict[Path, bytes] = {}
        if best.evaluation is not None:
            pictures |= calibration_figures(best.evaluation, self.folder)
        if len(evaluations) > 1:
            pictures |= comparison_figures(evaluations, self.folder)
        self._write(pictures)

    def write_verdict(self, run: RunResult) -> None:
        """Write the target as it was used, the verdict, and the photos to take next."""
        if run.target is not None:
            is_again = (self.folder / VERDICT_FILE).exists()
            kept = keep_target(self.folder, run.target, is_again=is_again)
            self.files += kept
            if not kept:
                self._faults.append("target.json: another file has the name and stays; the target is not in the folder")
        judged = replace(run.judged, observations_sha256=self._provenance[run.best.model].observations_sha256)
        self._write({
            self.folder / VERDICT_FILE: VERDICT.text(judged),
            self.folder / NEXT_VIEWS_FILE: NEXT_VIEWS.text(NextViews(run.next_views)),
        })  # fmt: skip

    def write_page(self, run: RunResult, command: str) -> str:
        """Write the folder's page; why there is none, or "".

        Args:
            run: what it shows, all written.
            command: that made it.
        """
        from calib.show.run.calibration_page import page_of

        files, remark = write_folder_page(
            self.folder, "calibration", command, lambda origin: page_of(self._as_read(run), origin)
        )
        self.files += files
        return remark

    def earlier_page(self) -> str:
        """A word on a page of an earlier run in the folder, which shows another; "" if there is none."""
        page = self.folder / PAGE_FILE
        return f"{page}: is of an earlier run; calib report {self.folder} draws it again" if page.exists() else ""

    def _as_read(self, run: RunResult) -> RunFolder:
        """The folder as it would be read."""
        solved = tuple(self._solved(one) for one in sorted(run.solutions, key=lambda one: one.model) if one.evaluation)
        records = self._records or _earlier_records(self.folder, run.observations.view_names)
        return RunFolder(self.folder, solved, records, run.target, tuple(self._faults))

    def _solved(self, solution: Solution) -> Solved:
        place = self.place_of(solution.model)
        path = "" if place == self.folder else f"{solution.model}/"
        evaluation = Evaluation(solution.calibration, ()) if solution.evaluation is None else solution.evaluation
        return solved_of(place, path, evaluation.without_truth, self._provenance[solution.model], self.folder, [])

    def _write(self, files: dict[Path, bytes]) -> None:
        write_files(files)
        self.files += files


def write_search(table: Path, search: Search) -> Records:
    """Write the detections and their records, photos that could not be searched among them; the records."""
    failed = [result.record for result in search.results if result.seen is None]
    return write_detections(
        table, search.detections, search.target, detector=program(), failed=failed, rendered_id=search.rendered_id
    )


def _earlier_records(folder: Path, photos: Sequence[str]) -> Records | None:
    """Of the search that left its records in the folder, as before `calib solve -o` the same one; None: of others."""
    try:
        records = read_records(folder / RECORDS_FILE) if (folder / RECORDS_FILE).exists() else None
    except InputError:
        return None
    is_of_these = records is not None and set(photos) <= {one.image for one in records.images}
    return records if is_of_these else None


def _with_overlays(search: Search, staging: Path) -> Search:
    """The search with a picture of each photo, drawn from its file."""
    known = {result.photo.name: result for result in search.results}

    def found_before(photo: PhotoFile, _: object) -> Detections:
        seen = known[photo.name].seen
        if seen is None:
            raise InputError(known[photo.name].failure)
        return seen

    photos = [result.photo for result in search.results]
    drawn = detect_photos(photos, search.target, found_before, overlay_folder=staging, jobs=4)
    return replace(
        search, results=tuple(_drawn(before, now) for before, now in zip(search.results, drawn, strict=True))
    )


def _drawn(before: PhotoResult, now: PhotoResult) -> PhotoResult:
    gone = now.failure if before.seen is not None else ""
    failure = f"no overlay for {before.photo.name}: {gone}" if gone else now.overlay_failure
    return replace(before, overlay=now.overlay, overlay_failure=failure)
