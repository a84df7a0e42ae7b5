"""From photos, or from observations, to judged cameras: what `calib run` and `calib solve` do."""

from collections.abc import Iterable, Sequence
from contextlib import nullcontext
from os import fspath
from pathlib import Path
from typing import TYPE_CHECKING

from calib.api.run_result import RunResult, RunWriter, best_of
from calib.app.detect import DETECTIONS_FILE
from calib.app.inputs import (
    Observed,
    Place,
    folder_of,
    observations_of,
    photos_of,
    rendered_id_of,
    target_of,
    truth_from,
)
from calib.cameras import learned_models
from calib.solver.accuracy import UndeterminedError
from calib.solver.capture_error import capture_of
from calib.solver.costs import IMAGE
from calib.solver.plan import ALL, SolvePlan, plan_from_words
from calib.verdict.criteria import STANDARD, read_criteria
from calib.verdict.halves import half_split
from calib.verdict.judge import inputs_of, judge_cameras
from calib.verdict.solutions import Solution, SolveTask, solve_models
from calib.verdict.verdict import Criteria
from calib.virtual.calibrate import ALL_VIEWS
from designer.base.errors import InputError
from designer.base.files import named_in_files
from designer.base.small_file import place_of
from designer.base.words import suggestion
from designer.page.progress import Progress, unheard
from designer.target import TargetGeometry

if TYPE_CHECKING:
    from calib.observe.photos import Search
    from calib.renderer.truth import Truth
    from calib.virtual.solve_virtual import Reference


class NothingFoundError(InputError):
    """No photo shows the target; what was seen instead: `error.search`."""

    def __init__(self, message: str, search: "Search") -> None:
        super().__init__(message)
        self.search = search


def run(
    target: TargetGeometry | Place,
    photos: Place | Iterable[Place],
    *,
    model: str = ALL,
    fix: Sequence[str] = (),
    share: Sequence[str] = (),
    focal_px: float | None = None,
    loss: str = "squares",
    reject_sigma: float | None = None,
    weighted: bool = True,
    minimise: str = IMAGE,
    free_bend: bool = False,
    reference: "Reference | None" = None,
    made: str | None = None,
    capture: str | None = None,
    truth: Place | None = None,
    criteria: Criteria | Place = STANDARD,
    jobs: int | None = None,
    progress: Progress = unheard,
    out: RunWriter | Place | None = None,
    settings: Sequence[tuple[str, str]] = (),
) -> RunResult:
    """Detect twice, solve all models, and judge the best camera: `run("ico.target.json", "photos/*.jpg")`.

    The second search knows the lens that a first solution gives.

    >>> run = calib.run("ico.target.json", "photos/*.jpg")
    >>> run.verdict.grade, run.best.camera.matrix

    Args:
        target: what the photos show: a geometry, or its file.
        photos: images, folders of images, or patterns.
        model: a camera model's name, or `all`.
        fix: parameters to keep as they start, or at a value: `k3`, `k3=0`.
        share: parameters that have one value: `fx_px,fy_px`.
        focal_px: a first guess of the focal length; not needed.
        loss: `squares`, `huber` or `cauchy`: how far-off observations count.
        reject_sigma: leave out what is off by more than so many robust standard deviations.
        weighted: weigh observations by their covariances, or all alike.
        minimise: distances in the `image`, in space between `ray` and ring, or where the ray meets its plane
            (`intersection`); `ray-by-range`, `intersection-by-range`, `whitened`.
        free_bend: the bend of a flat target is an unknown, too: two curvatures, along its sides.
        reference: of model `virtual`: the photo that its map is learned from, or `all`.
        made: how the target was made: an error template, a file of errors, or `exact`; None: assumed from its build.
        capture: how the photos were taken: `still`, `handheld` or `moving`; None: still, unless they show otherwise.
        truth: the `truth.json` of rendered photos; None: the one beside them, if there is one.
        criteria: limits of the verdict: a template's name, a file, or criteria.
        jobs: photos at a time; None: one per core.
        progress: is told what is being done.
        out: a folder to write everything to as it comes; None: nothing is written, `RunResult.save` does.
        settings: names and values to keep in the record.

    Raises:
        InputError: files or options that break a rule, or photos that do not determine a camera.
        NothingFoundError: no photo shows the target.
    """
    from calib.observe.observations import observations_from_detections
    from calib.observe.photos import named_photos
    from calib.observe.search import PhotoSearch, with_truth
    from designer.tolerance.made import how_made

    geometry, limits, taken = target_of(target, "rings"), _criteria(criteria), capture_of(capture)
    plan = plan_from_words(
        model,
        fix=fix,
        share=share,
        focal_px=focal_px,
        loss=loss,
        reject=reject_sigma,
        weighted=weighted,
        minimise=minimise,
        free_bend=free_bend,
    )
    writer = _writer(out, plan)
    asked = photos_of(photos)
    if writer is not None:
        asked = writer.without_own_pictures(asked)
    asked, known = with_truth(asked, None if truth is None else place_of(truth, "a truth.json"))
    way = how_made(geometry, made, rendered_id=asked.rendered_id)
    reference = _checked_reference(reference, plan, [photo.name for photo in named_photos(asked.paths)])
    with nullcontext() if writer is None else writer.drawing() as staging:
        search, plan = PhotoSearch(geometry, asked, staging, jobs, progress).twice(plan)
        if writer is not None and staging is not None:
            writer.write_search(search, staging)
    if not search.with_target:
        raise NothingFoundError(f"none of {len(search.results)} photos shows the target", search)
    found = observations_from_detections(search.with_target, geometry, origin="the photos")
    plan, observations = plan.suited(found)
    table = () if writer is None else (("detections", named_in_files(writer.folder / DETECTIONS_FILE)),)
    file = "NAME.target.json" if isinstance(target, TargetGeometry) else named_in_files(Path(target))
    kept = (("target", file), *table, ("photos", str(len(asked.paths))), *settings)
    shown = tuple(one.photo.path for one in search.results if one.seen is not None)
    task = SolveTask(observations, plan, geometry.layout_id, kept, reference, known, way, taken, shown)
    return _solved(task, geometry, search, limits, progress, writer, is_whole=not isinstance(out, RunWriter))


def solve(
    observed: Observed,
    target: TargetGeometry | Place | None = None,
    *,
    model: str = ALL,
    fix: Sequence[str] = (),
    share: Sequence[str] = (),
    focal_px: float | None = None,
    loss: str = "squares",
    reject_sigma: float | None = None,
    weighted: bool = True,
    minimise: str = IMAGE,
    free_bend: bool = False,
    reference: "Reference | None" = None,
    made: str | None = None,
    capture: str | None = None,
    truth: "Truth | Place | None" = None,
    rendered_id: str = "",
    criteria: Criteria | Place = STANDARD,
    progress: Progress = unheard,
    out: RunWriter | Place | None = None,
    settings: Sequence[tuple[str, str]] = (),
) -> RunResult:
    """Solve and judge cameras from what was observed: `solve("detections.csv", "ico.target.json")`.

    >>> detector = calib.Detector("ico.target.json")
    >>> run = calib.solve([detector.detect(frame) for frame in frames], detector.target)

    Args:
        observed: a file of observations, what was found in photos, or observations as `load_observations` has them.
        target: that they show; None: points from elsewhere.
        model: as for `run`, like all options that are named alike.
        fix: parameters to keep.
        share: parameters that have one value.
        focal_px: a first guess of the focal length.
        loss: how far-off observations count.
        reject_sigma: leave out what is farther off.
        weighted: by covariances, or all alike.
        minimise: distances in the image, or in space.
        free_bend: the bend of a flat target is an unknown.
        reference: of model `virtual`.
        made: how the target was made.
        capture: how the photos were taken.
        truth: of rendered photos, or its `truth.json`.
        rendered_id: of the geometry that the photos were rendered of; "": what the records beside a file say.
        criteria: limits of the verdict.
        progress: is told what is being done.
        out: a folder to write everything to.
        settings: names and values to keep in the record.

    Raises:
        InputError: options that break a rule, or observations that do not determine a camera.
    """
    from designer.tolerance.made import how_made

    geometry, limits = None if target is None else target_of(target), _criteria(criteria)
    taken = capture_of(capture)
    plan = plan_from_words(
        model,
        fix=fix,
        share=share,
        focal_px=focal_px,
        loss=loss,
        reject=reject_sigma,
        weighted=weighted,
        minimise=minimise,
        free_bend=free_bend,
    )
    writer = _writer(out, plan)
    observations = observations_of(observed, target)
    way = how_made(geometry, made, rendered_id=rendered_id or rendered_id_of(observed))
    reference = _checked_reference(reference, plan, observations.view_names)
    plan, observations = plan.suited(observations)
    layout_id = "" if geometry is None else geometry.layout_id
    known = truth_from(truth)
    task = SolveTask(observations, plan, layout_id, tuple(settings), reference, known, way, taken)
    return _solved(task, geometry, None, limits, progress, writer, is_whole=not isinstance(out, RunWriter))


def _solved(
    task: SolveTask,
    target: TargetGeometry | None,
    search: "Search | None",
    criteria: Criteria,
    progress: Progress,
    writer: RunWriter | None,
    *,
    is_whole: bool,
) -> RunResult:
    """Solve all models and judge the best, writing each as it comes; the page too, if nobody else does."""
    solutions: list[Solution] = []
    total = len(task.plan.models)
    progress("solving", 0, total)
    for solution in solve_models(task):
        solutions.append(solution if writer is None else writer.write_solution(solution, task))
        progress("solving", len(solutions), max(len(solutions), total))
    _require_one(solutions)
    if writer is not None and (search is not None or is_whole):
        progress("drawing", 0, 0)
        writer.write_tables()
    progress("judging", 0, 0)
    solved = sorted((one for one in solutions if one.evaluation is not None), key=lambda one: one.model)
    best = best_of(solutions)
    judged, proposed = judge_cameras(
        [one.calibration for one in solved], solved.index(best),
        half_split(best.calibration, task.plan.options_of(best.model)), criteria, target, inputs_of(task.settings),
    )  # fmt: skip
    result = RunResult(target, search, task, tuple(solutions), judged, proposed)
    if writer is not None:
        writer.write_verdict(result)
        if is_whole and (remark := writer.write_page(result, "")):
            raise InputError(remark)
    return result


def _require_one(solutions: Sequence[Solution]) -> None:
    """Refuse a run of which no model could be solved.

    Raises:
        UndeterminedError: the photos tell too little.
        InputError: something else was wrong with one.
    """
    if any(one.evaluation is not None for one in solutions):
        return
    reasons = {one.failure: one.model for one in solutions}
    several = len(reasons) > 1
    said = "; ".join(f"{model}: {why}" if several else why for why, model in reasons.items())
    raise UndeterminedError(said) if any(one.is_undetermined for one in solutions) else InputError(said)


def _criteria(criteria: Criteria | Place) -> Criteria:
    if isinstance(criteria, Criteria):
        return criteria
    place_of(criteria, "a template's name, or a TOML file")
    return read_criteria(fspath(criteria))


def _writer(out: RunWriter | Place | None, plan: SolvePlan) -> RunWriter | None:
    if out is None or isinstance(out, RunWriter):
        return out
    return RunWriter(folder_of(out), plan.may_solve)


def _checked_reference(reference: "Reference | None", plan: SolvePlan, photos: Sequence[str]) -> "Reference | None":
    """The photo that a map is learned from, as it is called among the views.

    Raises:
        InputError: no model learns a map, or none of the photos is meant.
    """
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
