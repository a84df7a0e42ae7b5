"""What `run` and `solve` return, and the folder they write: each result is written when it is there."""

import os
from collections.abc import Iterator, Sequence
from contextlib import contextmanager, suppress
from dataclasses import dataclass, replace
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING

from calib.api.page_shown import ShownAsPage
from calib.app.detect import DETECTIONS_FILE
from calib.app.inputs import folder_of
from calib.cameras import MODELS
from calib.core.types import Observations
from calib.draw import CALIBRATION_PICTURE
from calib.metrics.evaluation import Evaluation
from calib.observe.records import Records, records_path
from calib.records.calibration_file import (
    CALIBRATION,
    CALIBRATION_FILE,
    CAMERA_FILE,
    OBSERVATIONS_FILE,
    Provenance,
    write_calibration,
)
from calib.records.evaluation_files import METRICS_FILE, METRICS_FILES, evaluation_files, metrics_of
from calib.records.run_folder import RECORDS_FILE, Run, Solved, records_in
from calib.show.parts.kept_target import keep_target
from calib.verdict.judge import VERDICT, VERDICT_FILE, Judged
from calib.verdict.next_views import NEXT_VIEWS, NEXT_VIEWS_FILE, NextView, NextViews
from calib.verdict.solutions import Solution, SolveTask
from calib.verdict.verdict import Verdict
from designer.base.answer import program
from designer.base.errors import InputError, NotWrittenError
from designer.base.files import check_folder, write_files
from designer.base.own_files import is_ours, require_ours
from designer.target import TargetGeometry

if TYPE_CHECKING:
    from calib.observe.photos import FoundPhotos, Search


@dataclass(frozen=True, eq=False)
class RunResult(ShownAsPage):
    """Cameras of one or several models from the same photos, judged: `run.best.camera`, `run.verdict.grade`.

    In a notebook the result shows its report.
    """

    target: TargetGeometry | None  # None: the points came from elsewhere
    search: "Search | None"  # of the photos; None: solved from observations
    task: SolveTask
    solutions: tuple[Solution, ...]  # of each model, at least one of them solved
    judged: Judged
    next_views: tuple[NextView, ...]  # photos that would make the camera better
    kind = "calibration"

    def __repr__(self) -> str:
        """A line, where no page can be shown."""
        return f"<RunResult, {self.verdict.grade}: {self.verdict.sentence}>"

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

    def save(self, folder: str | os.PathLike[str]) -> tuple[Path, ...]:
        """Write the folder that `calib run` writes: cameras, tables, pictures, verdict and page; return the files.

        Raises:
            InputError: the folder takes no files, or holds somebody else's; the message names them.
        """
        writer = RunWriter(folder_of(folder), [one.model for one in self.solutions])
        writer.write_all(self)
        return tuple(writer.files)


def best_of(solutions: Sequence[Solution]) -> Solution:
    """The one to go on with, of those that were solved.

    Raises:
        ValueError: none was.
    """
    ranks = {
        row: (*one.evaluation.preference[:2], one.held_out_px or 0.0, one.evaluation.preference)
        for row, one in enumerate(solutions)
        if one.evaluation is not None
    }
    if not ranks:
        raise ValueError("no model was solved")
    return solutions[min(ranks, key=lambda row: ranks[row])]


OVERLAYS = "overlays"


class RunWriter:
    """Writes one folder, and knows what it has written."""

    def __init__(self, folder: Path, models: Sequence[str]) -> None:
        """Refuse a place that takes no files, or holds somebody else's, before any work is done.

        Raises:
            InputError: the message names the file.
        """
        self.folder, self.models = folder, tuple(models)
        self.begin()
        for place in (folder, folder / OVERLAYS):
            check_folder(place)
        for place in (folder, *(self.place_of(model) for model in models)):
            for name in (CALIBRATION_FILE, OBSERVATIONS_FILE, CAMERA_FILE, CALIBRATION_PICTURE):
                require_ours(place / name)
        require_ours(folder / VERDICT_FILE, kind=VERDICT.format)
        require_ours(folder / NEXT_VIEWS_FILE, kind=NEXT_VIEWS.format)

    def begin(self) -> None:
        """Nothing is written yet: of a run that is made again, what came of the first attempt does not count."""
        self.files: list[Path] = []
        self.solutions: list[Solution] = []
        self._solved: dict[str, Solved] = {}
        self._records: Records | None = None
        self._faults: list[str] = []  # what could not be written of a run, for its page

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
        from calib.observe.overlays import with_overlays

        self.require_room()
        if run.search is not None:
            with self.drawing() as staging:
                drawn = with_overlays(run.search, staging)
                self.write_search(drawn, staging)
                self._faults += [one.overlay_failure for one in drawn.results if one.overlay_failure]
        written = [self.write_solution(solution, run.task) for solution in run.solutions]
        if run.best.model not in self._solved:
            raise InputError(next(one.failure for one in written if one.model == run.best.model))
        self.write_tables()
        self.write_verdict(run)
        if remark := self.write_page(run, ""):
            raise InputError(remark)

    def require_room(self) -> None:
        """Refuse a folder with somebody's own page or tables in it, of a run that is to be written whole.

        Raises:
            InputError: the message names the file.
        """
        from calib.show.folder import why_no_page

        if why := why_no_page(self.folder, "calibration"):
            raise InputError(why)
        self._require_room_for_tables()

    def _require_room_for_tables(self) -> None:
        """Refuse somebody's own files under the names of tables to be written.

        Raises:
            InputError: the message names the file.
        """
        for place in dict.fromkeys(self.place_of(model) for model in self.models):
            require_ours(place / METRICS_FILE)
        for name in (DETECTIONS_FILE, RECORDS_FILE):
            require_ours(self.folder / name)

    def without_own_pictures(self, photos: "FoundPhotos") -> "FoundPhotos":
        """The photos without the picture that an earlier run drew among them."""
        drawn = Path(os.path.abspath(self.folder)) / CALIBRATION_PICTURE
        return replace(photos, paths=tuple(one for one in photos.paths if Path(os.path.abspath(one)) != drawn))

    @contextmanager
    def drawing(self) -> Iterator[Path]:
        """A folder for overlays until all are drawn; nothing is left if that does not come to its end."""
        from calib.observe.overlays import no_empty_folders, staging_folder

        self._require_room_for_tables()
        place = self.folder / OVERLAYS
        with no_empty_folders(place), staging_folder(place) as staging:
            yield staging

    def write_search(self, search: "Search", staging: Path) -> None:
        """Write what was found in the photos, and keep the overlays that were drawn instead of earlier ones."""
        from calib.observe.overlays import keep_pictures, remove_ours
        from calib.observe.photos import OVERLAY_MARK
        from calib.observe.search import write_search
        from designer.page.page_file import BLOCKS_FILE

        table, place = self.folder / DETECTIONS_FILE, self.folder / OVERLAYS
        self._records = write_search(table, search)
        pictures = keep_pictures(staging, place)
        if not (place / BLOCKS_FILE).exists():
            remove_ours(set(place.glob(f"*{OVERLAY_MARK}.*")) - set(pictures))
        self.files += [table, records_path(table), *pictures]

    def write_solution(self, solution: Solution, task: SolveTask) -> Solution:
        """Write a model's calibration, if there is one; the solution, or one that failed if it makes no sense.

        Raises:
            NotWrittenError: the disk is full.
        """
        written = solution if solution.evaluation is None else self._written(solution, solution.evaluation, task)
        self.solutions.append(written)
        return written

    def _written(self, solution: Solution, evaluation: Evaluation, task: SolveTask) -> Solution:
        model, place = solution.model, self.place_of(solution.model)
        provenance = Provenance(
            program(), layout_id=task.layout_id, geometry_id=task.observations.points.geometry_id,
            options=task.plan.options_of(model), settings=(*task.settings, ("model", model)),
        )  # fmt: skip
        try:
            files, provenance = write_calibration(place, solution.calibration, provenance)
        except NotWrittenError:
            raise
        except InputError as error:
            return replace(solution, evaluation=None, failure=str(error))
        path = "" if place == self.folder else f"{model}/"
        self._solved[model] = Solved(path, evaluation.without_truth, provenance, metrics_of(evaluation))
        self.files += files
        return solution

    def write_tables(self) -> None:
        """Write tables of each model, and a picture of the best one."""
        from calib.draw import calibration_figures

        for one in self.finished:
            if one.evaluation is not None:
                self._write(evaluation_files(one.evaluation, self.place_of(one.model)))
        best = best_of(self.finished)
        if best.evaluation is not None:
            self._write(calibration_figures(best.evaluation, self.folder))

    def write_verdict(self, run: RunResult) -> None:
        """Write the target as it was used, the verdict, and the photos to take next; cameras of earlier runs go."""
        if run.target is not None:
            is_again = (self.folder / VERDICT_FILE).exists()
            kept = keep_target(self.folder, run.target, is_again=is_again)
            self.files += kept
            if not kept:
                self._faults.append("target.json: another file has the name and stays; the target is not in the folder")
        self._write({
            self.folder / VERDICT_FILE: VERDICT.text(self._judged(run)),
            self.folder / NEXT_VIEWS_FILE: NEXT_VIEWS.text(NextViews(run.next_views)),
        })  # fmt: skip
        self._remove_earlier()

    def _judged(self, run: RunResult) -> Judged:
        return replace(run.judged, observations_sha256=self._solved[run.best.model].provenance.observations_sha256)

    def _remove_earlier(self) -> None:
        """Remove the cameras of earlier runs from the folder, which are not of this one; other runs' folders stay."""
        here = {self.place_of(model) for model in self._solved}
        for place in (self.folder, *(self.folder / model for model in MODELS)):
            is_run_of_its_own = place != self.folder and (place / VERDICT_FILE).exists()
            if place in here or is_run_of_its_own or not (place / CALIBRATION_FILE).is_file():
                continue
            if is_ours(place / CALIBRATION_FILE, CALIBRATION.format):
                from calib.observe.overlays import remove_ours

                names = (CALIBRATION_FILE, OBSERVATIONS_FILE, CAMERA_FILE)
                remove_ours(
                    {place / name: kind for name, kind in {**dict.fromkeys(names, ""), **METRICS_FILES}.items()}
                )
                with suppress(OSError):  # it holds something else
                    place.rmdir()

    def write_page(self, run: RunResult, command: str) -> str:
        """Write the folder's page; why there is none, or "".

        Args:
            run: what it shows, all written.
            command: that made it.
        """
        from calib.show.folder import write_folder_page
        from calib.show.run.calibration_page import page_of

        told = self.told(run)
        files, remark = write_folder_page(
            self.folder, "calibration", command, lambda origin: page_of(told, self.folder, origin)
        )
        self.files += files
        return remark

    def earlier_page(self) -> str:
        """A word on a page of an earlier run in the folder, which shows another; "" if there is none."""
        from calib.show.folder import PAGE_FILE

        page = self.folder / PAGE_FILE
        return f"{page}: is of an earlier run; calib report {self.folder} draws it again" if page.exists() else ""

    def told(self, run: RunResult) -> Run:
        """The run as it would be read from the folder."""
        solved = tuple(self._solved[model] for model in sorted(self._solved))
        records = self._records or records_in(self.folder, run.observations.view_names, [])
        return Run(solved, self._judged(run), run.next_views, records, run.target, tuple(self._faults))

    def _write(self, files: dict[Path, bytes]) -> None:
        write_files(files)
        self.files += files
