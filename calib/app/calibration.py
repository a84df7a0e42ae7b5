"""Cameras that are solved and judged, and how that is told: what `calib.run` and `calib.solve` give."""

import os
from abc import abstractmethod
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Self, cast

from calib.app.detect import detections_answer
from designer.base.errors import InputError
from designer.page.output import Output, output_of
from designer.page.progress import Progress
from designer.page.result import Result
from designer.page.terminal import quoted

if TYPE_CHECKING:
    from calib.app.calibration_folder import RunFolder
    from calib.app.inputs import Place
    from calib.core.types import Observations
    from calib.judge.folders import JudgedRun, RigRun
    from calib.judge.next_views import NextView
    from calib.judge.solutions import Solution, SolveTask
    from calib.judge.verdict import Criteria, Verdict
    from calib.observe.photos import Search
    from calib.solver.plan import SolvePlan
    from calib.solver.solve_virtual import Reference
    from designer.base.answer import Value
    from designer.page.blocks import Page
    from designer.target import TargetGeometry

LEAST_VIEWS_HELD_OUT, MOST_NAMED = 6, 5
"""Photos that are worth the advice to hold some out; photos without the target that a screen names."""


class SolvedCameras(Result, kind="cameras", title="Cameras"):
    """Cameras that are solved and, as a rule, judged: one of several models, or those of a rig."""

    run: "JudgedRun | RigRun"
    """As it is read from its folder."""

    def __repr__(self) -> str:
        """A line, where no page can be shown."""
        return f"<{type(self).__name__}, {self.verdict.grade}: {self.verdict.sentence}>"

    @property
    def verdict(self) -> "Verdict":
        """Whether to use what was solved, and why; ValueError: nobody judged."""
        if self.run.judged is None:
            raise ValueError("nobody judged the cameras of this folder")
        return self.run.judged.verdict

    @property
    def is_negative(self) -> bool:
        """Not to be used."""
        return self.run.judged is not None and self.verdict.grade == "bad"

    @abstractmethod
    def write(self, out: Output) -> Self:
        """Write all but the page; the same with what the folder adds.

        Raises:
            InputError: a file is somebody else's, or the solution makes no sense.
        """

    def save(self, folder: str | os.PathLike[str], *, command: str = "", has_page: bool = True) -> tuple[Path, ...]:
        """Write the folder that the command writes: cameras, tables, pictures, verdict and page; return the files.

        Raises:
            InputError: the folder takes no files, or holds somebody else's; the message names them.
        """
        out = output_of(folder)
        written = self.write(out)
        if has_page:
            out.files += written.drawn_in(out.place, command)
        return tuple(out.files)


@dataclass(frozen=True, eq=False, repr=False)
class Run(
    SolvedCameras, kind="calibration", title="Calibration", sought="camera is determined", replaces=("detections",)
):
    """Cameras of one or several models from the same photos, judged: `run.best.camera`, `run.verdict.grade`."""

    run: "JudgedRun"  # as it is read from its folder
    task: "SolveTask | None" = None  # None: of a folder
    search: "Search | None" = None  # of the photos; None: solved from observations, or of a folder
    place: Path | None = None  # the folder; None: nothing is written
    truth_file: Path | None = None  # of rendered photos

    @property
    def solutions(self) -> "tuple[Solution, ...]":
        """What came of each model."""
        return self.run.solutions

    @property
    def best(self) -> "Solution":
        """The camera to go on with: determined, of a model that other programs know, with the least residuals."""
        return self.run.best

    @property
    def next_views(self) -> "tuple[NextView, ...]":
        """Photos that would make the camera better."""
        return self.run.next_views

    @property
    def target(self) -> "TargetGeometry | None":
        """As it was used; None: the points came from elsewhere."""
        return self.run.target

    @property
    def observations(self) -> "Observations":
        """What the cameras were solved from."""
        return self.best.calibration.observations if self.task is None else self.task.observations

    @property
    def remarks(self) -> tuple[str, ...]:  # type: ignore[override]  # a field of other results
        """What a person must know of photos, observations and cameras, one line each."""
        of_search = () if self.search is None else self.search.remarks
        made = () if self.task is None or self.task.made is None else (self.task.made.sentence,)
        of_best = (*self.best.calibration.remarks, *self.best.evaluated.remarks)
        return tuple(dict.fromkeys((*of_search, *made, *of_best, *self.observations.remarks)))

    @property
    def remedy(self) -> str:
        """To take the photos that are proposed."""
        if not self.is_negative:
            return ""
        count, to = len(self.next_views), "the photos" if self.search is not None else "what is solved from"
        none = "no camera is determined: " if self.best.calibration.status == "degenerate" else ""
        if not count:
            return f"{none}do what is said above"
        photos = (
            "the photo that is proposed, and add it"
            if count == 1
            else f"the {count} photos that are proposed, and add them"
        )
        return f"{none}take {photos} to {to}"

    def page(self) -> "Page":
        """All that is told, without pictures of the photos."""
        from calib.app.calibration_page import calibration_page

        return replace(calibration_page(self._as_stored, None), next_steps=())

    def words(self, page: "Page | None" = None) -> "Page":
        """Its lead, what is not good, and the tables."""
        from calib.app.calibration_page import calibration_words
        from designer.page.blocks import Command

        failed = (f"{one.model} was not solved: {one.failure}" for one in self.solutions if one.failure)
        empty = () if self.search is None else tuple(
            f"without the target: {seen.image}: {'; '.join(seen.remarks)}"
            for seen in self.search.detections if not len(seen.ring)
        )  # fmt: skip
        drawn = () if self.search is None else (one.overlay_failure for one in self.search.results)
        notes = dict.fromkeys((*failed, *empty[:MOST_NAMED], *filter(None, drawn), *self.remarks))
        said = calibration_words(self._as_stored, tuple(notes), () if self.search is None else self.search.failures)
        draw = () if page or self.place is None else (Command(f"calib report {quoted(self.place)}", "draws its page"),)
        steps = (*draw, *(Command(line, purpose) for line, purpose in self._next()))
        return replace(said, next_steps=steps)

    def page_in(self, folder: Path, command: str = "") -> "Page":
        """The page of the folder that holds the run."""
        from calib.app.calibration_page import calibration_page
        from designer.base.answer import program
        from designer.page.folders import title_of

        page = calibration_page(self._as_stored, folder)
        return replace(
            page, title=title_of(folder), kind=self.title, made_by=command, program=program(),
            is_negative=self.is_negative,
        )  # fmt: skip

    @property
    def _as_stored(self) -> "JudgedRun":
        """As it would be read from its folder, so that the page is the same."""
        return replace(self.run, solutions=tuple(one.without_truth for one in self.run.solved))

    def _next(self) -> Iterator[tuple[str, str]]:
        """What to type with a camera that may be used, and what it is for."""
        if self.place is None or self.is_negative:
            return
        place, best = self.place_of(self.best.model), self.best
        if best.calibration.observations.view_count >= LEAST_VIEWS_HELD_OUT and best.camera.learned is None:
            known = "" if self.truth_file is None else f" --truth {quoted(self.truth_file)}"
            yield f"calib evaluate {quoted(place)} --held-out 5{known}", "on photos that it was not solved from"
        yield f"calib convert {quoted(place / 'camera.json')} --to colmap -o cameras.txt", "or opencv, ros, kalibr, ..."

    def place_of(self, model: str) -> Path:
        """Where the files of a model are."""
        return (self.place or Path()) / next((one.path for one in self.solutions if one.model == model), "")

    def answer(self) -> "dict[str, Value]":
        """All models, the one to go on with, the verdict, and what was found in photos."""
        found: dict[str, Value] = {} if self.search is None else {"detections": detections_answer(self.search)}
        from calib.app.calibration_folder import solutions_answer
        from calib.judge.verdict import Verdict
        from designer.base.codec import encode

        judged = self.run.judged
        verdict = None if judged is None else cast("dict[str, Value]", encode(Verdict, judged.verdict))
        solved = solutions_answer(self.solutions, self.best.model, self.place or Path())
        return {**found, **solved, "verdict": verdict}

    def write(self, out: Output) -> "Run":
        """Write all but the page; the run as it is in the folder.

        Raises:
            InputError: a file is somebody else's, or the best camera makes no sense.
        """
        from calib.app.calibration_folder import RunFolder

        kept = RunFolder(out, [one.model for one in self.solutions]).write_all(self.run, self.search)
        return replace(self, run=kept)

    def _repr_html_(self) -> str:
        from html import escape
        from tempfile import TemporaryDirectory

        from designer.page.page_file import PAGE_FILE

        with TemporaryDirectory() as folder:
            self.save(folder)
            text = (Path(folder) / PAGE_FILE).read_text(encoding="utf-8")
        return f'<iframe srcdoc="{escape(text)}" width="100%" height="800" style="border:0"></iframe>'


def solved(
    task: "SolveTask", target: "TargetGeometry | None", search: "Search | None", criteria: "Criteria",
    progress: Progress, folder: "RunFolder | None", *, is_whole: bool, truth_file: Path | None = None,
) -> Run:  # fmt: skip
    """Solve all models and judge the best, writing each as it comes; the page too, if nobody else does.

    Raises:
        UndeterminedError: the photos tell too little.
        InputError: something else was wrong, or a file is somebody else's.
    """
    from calib.judge.folders import JudgedRun
    from calib.judge.halves import half_split
    from calib.judge.judge import inputs_of, judge_cameras
    from calib.judge.solutions import best_of, solve_models

    seen = task.observations
    if said := task.plan.flat_remark(task.made, seen.points):
        seen = replace(seen, remarks=(*seen.remarks, said))
    task = replace(task, plan=task.plan.for_target(task.made, seen.points), observations=seen)
    solutions: list[Solution] = []
    total = len(task.plan.models)
    progress("solving", 0, total)
    for solution in solve_models(task):
        solutions.append(solution if folder is None else folder.write_solution(solution))
        progress("solving", len(solutions), max(len(solutions), total))
    _require_one(solutions)
    if folder is not None and (search is not None or is_whole):
        progress("drawing", 0, 0)
        folder.write_tables()
    progress("judging", 0, 0)
    unjudged, best = JudgedRun(tuple(solutions), None, (), None, target), best_of(solutions)
    judged, proposed = judge_cameras(
        [one.calibration for one in unjudged.solved], unjudged.solved.index(best),
        half_split(best.calibration, task.plan.options_of(best.model)), criteria, target, inputs_of(task.settings),
    )  # fmt: skip
    found = replace(unjudged, judged=judged, next_views=proposed)
    if folder is None:
        return Run(found, task, search, None, truth_file)
    run = Run(folder.write_verdict(found), task, search, folder.folder, truth_file)
    if is_whole:
        run.drawn_in(folder.folder)
    return run


def _require_one(solutions: "Sequence[Solution]") -> None:
    """Refuse a run of which no model could be solved."""
    if any(one.evaluation is not None for one in solutions):
        return
    from calib.solver.accuracy import UndeterminedError

    reasons = {one.failure: one.model for one in solutions}
    several = len(reasons) > 1
    said = "; ".join(f"{model}: {why}" if several else why for why, model in reasons.items())
    raise UndeterminedError(said) if any(one.is_undetermined for one in solutions) else InputError(said)


def reference_of(
    reference: "Reference | None", target: "TargetGeometry | Place | None"
) -> "tuple[Reference | None, tuple[tuple[str, str], ...]]":
    """The photo that a map is learned from: a view's name, or what a photo of another board shows; for the record."""
    from calib.app.inputs import target_of

    named = (("reference", reference if isinstance(reference, str) else "observations"),) if reference else ()
    if target is None:
        return reference, named
    if not isinstance(reference, str):
        raise InputError(f"--reference-target {target}: name the photo of this board too, with --reference PHOTO")
    from calib.detector.pipeline import detect
    from calib.images.photo import read_image
    from calib.observe.observations import observations_from_detections

    board = target_of(target, "rings")
    seen = detect(read_image(Path(reference)).pixels, board, name=Path(reference).name)
    if not len(seen.ring):
        raise InputError(f"{reference}: shows no rings of {target}; give a photo of that board")
    shown = observations_from_detections([seen], board, origin=reference)
    return shown, (*named, ("reference-target", Path(str(target)).name))


def view_of_reference(reference: "Reference | None", plan: "SolvePlan", photos: Sequence[str]) -> "Reference | None":
    """The photo that a map is learned from, as it is called among the views.

    Raises:
        InputError: no model learns a map, or none of the photos is meant.
    """
    from calib.cameras import learned_models
    from calib.solver.calibrate import ALL_VIEWS
    from designer.base.words import suggestion

    if reference is None:
        return None
    if not set(learned_models()) & set(plan.models):
        learning = " or ".join(learned_models())
        raise InputError(f"reference: model {plan.models[0]} learns no map; leave it out, or take model {learning}")
    if not isinstance(reference, str) or reference == ALL_VIEWS or reference in photos or not photos:
        return reference
    ends = [name for name in photos if f"/{reference}".endswith(f"/{name}")]
    if len(ends) == 1:
        return ends[0]
    hint = suggestion(reference, list(photos)) or f"; the first is {photos[0]!r}"
    raise InputError(f"reference {reference!r}: none of the photos{hint}")
