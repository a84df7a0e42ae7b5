"""The command `calib run`."""

import os
import time
from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from calib.commands.answers.photos import detections_answer
from calib.commands.answers.solutions import solutions_answer
from calib.commands.detect import (
    NOTHING_LEFT,
    exports_folder,
    keep_pictures,
    no_empty_folders,
    overlays_page,
    refuse_nothing,
    search_photos,
    staging_folder,
    summarise,
    truth_beside,
    write_results,
)
from calib.commands.folder_page import say_next
from calib.commands.judged_page import (
    DEFAULT_CRITERIA,
    CriteriaOption,
    PageOption,
    check_judged_folder,
    judge_and_report,
)
from calib.commands.screen import quoted, shown, waiting
from calib.commands.solutions import (
    Work,
    advise,
    best_of,
    files_of_solutions,
    say_files,
    solve_and_say,
    stop,
)
from calib.commands.solve import (
    FixOption,
    FocalOption,
    LossOption,
    MadeOption,
    ModelOption,
    ReferenceOption,
    ReferenceTargetOption,
    RejectOption,
    ShareOption,
    WeightedOption,
    made_settings,
    plan_of,
    reference_of,
    reference_settings,
)
from calib.files import check_folder, named_in_files
from designer.answer import Summary, Value
from designer.command import command_line, printable
from designer.errors import InputError

if TYPE_CHECKING:
    from calib.commands.judged_page import JudgedPage
    from calib.detect.batch import Detect, FoundPhotos, PhotoResult, Pixels
    from calib.detect.pipeline import Found as Named
    from calib.pipeline.settings import SolvePlan
    from calib.pipeline.solutions import Solution
    from calib.results.truth import Truth
    from calib.types import Camera, Detections
    from designer.target import TargetGeometry

NOTHING_FOUND = 1
LEAST_VIEWS_HELD_OUT = 6
"""Fewer are not worth the advice to hold some out."""


def run(
    target: Annotated[Path, typer.Argument(help="the target file (NAME.target.json) of what the photos show")],
    photos: Annotated[list[str], typer.Argument(help="images, folders of images, or patterns such as 'run/*.png'")],
    *,
    out: Annotated[Path | None, typer.Option("--out", "-o", help="folder (default: exports/NAME/calibration)")] = None,
    model: ModelOption = "all",
    fix: FixOption = None,
    share: ShareOption = None,
    focal: FocalOption = None,
    loss: LossOption = "squares",
    reject: RejectOption = None,
    weighted: WeightedOption = True,
    reference: ReferenceOption = None,
    reference_target: ReferenceTargetOption = None,
    made: MadeOption = None,
    truth: Annotated[
        Path | None, typer.Option(help="of rendered photos (default: the truth.json beside them, if there is one)")
    ] = None,
    criteria: CriteriaOption = DEFAULT_CRITERIA,
    page: PageOption = True,
    jobs: Annotated[
        int | None, typer.Option(min=1, max=1024, help="photos at a time, all in memory (default: one per core)")
    ] = None,
) -> Summary:
    """From photos to a calibrated camera: detect, solve, detect again with the lens known, solve all models, judge.

    The exit code is 1 if nothing was found, or if the verdict is: do not use.
    """
    from calib.detect.batch import find_photos, named_photos
    from calib.inputs.observations import observations_from_detections
    from calib.verdict.criteria import read_criteria
    from designer.target import load_target
    from designer.tolerance.made import how_made

    geometry, limits = load_target(target, "rings"), read_criteria(criteria)
    plan = plan_of(model, fix, share, focal, loss, reject, weighted=weighted)
    folder = out if out is not None else exports_folder(target) / "calibration"
    for place in (folder, folder / "overlays"):
        check_folder(place)
    check_judged_folder(folder, plan.models)
    found = _without_pictures(find_photos(photos), folder)
    truth_path = truth if truth is not None else truth_beside(found.paths)
    known = None if truth_path is None else _read_truth(truth_path, is_asked=truth is not None)
    rendered_id = "" if known is None else known.rendered_id(path.name for path in found.paths)
    way = how_made(geometry, made, rendered_id=rendered_id)
    views = [photo.name for photo in named_photos(found.paths)]
    map_of = reference_of(reference, reference_target, plan, views) if views else None
    detected = _detect_twice(geometry, found, plan, folder, jobs or os.cpu_count() or 1, rendered_id)
    seen = _with_target(detected.results)
    if not seen:
        return _nothing_found(folder, target, geometry, found, detected, page=page)
    observations = observations_from_detections(seen, geometry, origin="the photos")
    table = folder / "detections.csv"
    settings = (
        ("target", named_in_files(target)), ("detections", named_in_files(table)), ("photos", str(len(found.paths))),
        *made_settings(made),
        *reference_settings(reference, reference_target),
    )  # fmt: skip
    work = Work(
        observations, detected.plan, folder, geometry.layout_id, settings, map_of, known,
        way, (table,),
    )  # fmt: skip
    solutions, pictures = _draw(solve_and_say(work), folder, table)
    judged = judge_and_report(solutions, work, limits, geometry, page=page)
    steps = _advise(solutions, judged, None if known is None else truth_path)
    return Summary(
        {"detections": detected.answer, **solutions_answer(solutions, best_of(solutions)), **judged.answer},
        (*detected.files, *files_of_solutions(solutions), *pictures, *judged.files),
        steps,
        (*detected.remarks, *observations.remarks, *judged.remarks),
        judged.exit_code,
    )


def _nothing_found(
    folder: Path, target: Path, geometry: "TargetGeometry", found: "FoundPhotos", detected: "_Detected", *, page: bool
) -> Summary:
    """Write the page that shows why, of the run's folder, or of its overlays if an earlier camera has the folder."""
    from calib.report.run_folder import is_run_folder

    place = folder / "overlays" if is_run_folder(folder) else folder
    table, overlays = folder / "detections.csv", folder / "overlays"
    pages: tuple[Path, ...] = ()
    remarks: tuple[str, ...] = ()
    if page:
        pages, remarks = overlays_page(
            place, target, geometry, table, detected.results, found.failures, overlays=overlays
        )
    again, more = command_line(), ": the page says more" if page else ""
    summary = Summary(
        {"detections": detected.answer, **solutions_answer([], None), "verdict": None}, (*detected.files, *pages),
        (f"{again}   # with the right target file, or other photos{more}",) if again else (),
        (*detected.remarks, *remarks), NOTHING_FOUND,
    )  # fmt: skip
    return say_next(summary, place)


def _draw(solutions: "Sequence[Solution]", folder: Path, table: Path) -> "tuple[list[Solution], tuple[Path, ...]]":
    """Write tables of each model, and pictures of the recommended one and of all side by side.

    Returns:
        The solutions with their tables, and the pictures.
    """
    from calib.figures import calibration_figures, comparison_figures
    from calib.files import write_files
    from calib.results.evaluation_files import evaluation_files

    written, evaluations, best = [], [], best_of(solutions)
    pictures: dict[Path, bytes] = {}
    try:
        with waiting("drawing"):
            for one in solutions:
                files: dict[Path, bytes] = {}
                if one.evaluation is not None:
                    evaluations.append(one.evaluation)
                    files = evaluation_files(one.evaluation, one.folder)
                    write_files(files)
                    if one is best:
                        pictures |= calibration_figures(one.evaluation, folder)
                written.append(replace(one, files=(*one.files, *files)))
            if len(evaluations) > 1:
                pictures |= comparison_figures(evaluations, folder)
            write_files(pictures)
    except KeyboardInterrupt:
        stop(solutions, [table])
    print()
    say_files(written)
    for path, what in zip(pictures, (f"{best.model} in pictures", "the models side by side"), strict=False):
        print(f"wrote {shown(path)}: {what}")
    return written, tuple(pictures)


def _advise(solutions: "Sequence[Solution]", judged: "JudgedPage", truth: Path | None) -> tuple[str, ...]:
    """Say what to look at, and what to type next; return the latter."""

    def evaluate(best: "Solution") -> str:
        enough = best.evaluation is not None and (
            best.evaluation.calibration.observations.view_count >= LEAST_VIEWS_HELD_OUT
        )
        if not enough or best.model == "virtual":
            return ""
        known = "" if truth is None else f" --truth {quoted(truth)}"
        return f"calib evaluate {quoted(best.folder)} --held-out 5{known}   # on photos that it was not solved from"

    again = judged.again("and add them to the photos")
    return advise(solutions, first=judged.look, again=again, evaluate=evaluate)


def _without_pictures(found: "FoundPhotos", folder: Path) -> "FoundPhotos":
    """The photos without the pictures that an earlier run drew among them."""
    from calib.figures import CALIBRATION_PICTURE, COMPARISON_PICTURE

    place = Path(os.path.abspath(folder))
    drawn = {place / COMPARISON_PICTURE, place / CALIBRATION_PICTURE}
    return replace(found, paths=tuple(path for path in found.paths if Path(os.path.abspath(path)) not in drawn))


def _read_truth(path: Path, *, is_asked: bool) -> "Truth | None":
    """The truth; one that lies there by chance and is none does not matter."""
    from calib.results.truth import read_truth

    try:
        return read_truth(path)
    except InputError as error:
        if is_asked:
            raise
        print(f"not used: {printable(str(error))}")
        return None


@dataclass(frozen=True, eq=False)
class _Detected:
    """What was found in the photos, and what was written of it."""

    results: "list[PhotoResult]"
    plan: "SolvePlan"  # with a first guess of the focal length if the photos state one
    answer: dict[str, Value]
    files: tuple[Path, ...]
    remarks: tuple[str, ...]


@dataclass(frozen=True, eq=False)
class _First:
    """What the first search found in a photo."""

    named: "Named | None"  # which no lens has a part in
    seen: "Detections"


def _detect_twice(
    geometry: "TargetGeometry", found: "FoundPhotos", plan: "SolvePlan", folder: Path, jobs: int, rendered_id: str
) -> _Detected:
    """Search the photos, solve a first camera, and search again with its lens; write the detections and overlays."""
    from calib.detect.batch import reading_once
    from calib.inputs.records import records_path

    start = time.perf_counter()
    read, (first, remember) = reading_once(), _remembering()
    results = search_photos(remember, found, geometry, None, None, jobs, read)
    plan, guess = _with_stated_focal(plan, results)
    camera, why = _first_camera(results, geometry, plan)
    overlays, table = folder / "overlays", folder / "detections.csv"
    with no_empty_folders(overlays), staging_folder(overlays) as staging:
        results = search_photos(_again(camera, first), found, geometry, None, staging, jobs, read)
        seen = [result.seen for result in results if result.seen is not None]
        if not seen:
            refuse_nothing([*found.failures, *(result.failure for result in results)], NOTHING_LEFT)
        write_results(table, results, seen, geometry, rendered_id)
        pictures = keep_pictures(staging, overlays)
    seconds = time.perf_counter() - start
    summarise(geometry, found, results, seconds)
    without = f"searched without the lens, which a first solution does not give: {printable(why)}" if why else ""
    remarks = tuple(filter(None, (without, guess)))
    for remark in remarks:
        print(remark)
    print(f"wrote {shown(table)} and detections.records.json")
    if pictures:
        print(f"      {shown(overlays)}: an overlay of each photo, {len(pictures)} in all")
    answer = detections_answer(geometry, found, results, seconds)
    return _Detected(results, plan, answer, (table, records_path(table), *pictures), remarks)


def _with_target(results: "Sequence[PhotoResult]") -> "list[Detections]":
    """The detections in photos that show the target."""
    return [result.seen for result in results if result.seen is not None and len(result.seen.ring)]


def _remembering() -> "tuple[dict[str, _First], Detect]":
    """The detector, and what it found in each photo."""
    from calib.detect.pipeline import detect, find
    from calib.report.why_nothing import explained

    first: dict[str, _First] = {}

    def search(
        pixels: "Pixels", target: "TargetGeometry", *, name: str, camera: "Camera | None" = None
    ) -> "Detections":
        named = find(pixels, target)
        seen = explained(detect(pixels, target, name=name, camera=camera, found=named), pixels, target)
        first[name] = _First(named, seen)
        return seen

    return first, search


def _again(camera: "Camera | None", first: "dict[str, _First]") -> "Detect":
    """The detector with the lens known; photos of another size, or all without a camera, are as they were."""
    from calib.detect.pipeline import detect
    from calib.report.why_nothing import explained

    def search(pixels: "Pixels", target: "TargetGeometry", *, name: str, **_: object) -> "Detections":
        before, (height, width) = first.get(name), pixels.shape
        fits = camera is not None and camera.image_size == (width, height)
        if before is not None and not fits:
            return before.seen
        named = None if before is None else before.named
        return explained(
            detect(pixels, target, name=name, camera=camera if fits else None, found=named), pixels, target
        )

    return search


def _with_stated_focal(plan: "SolvePlan", results: "Sequence[PhotoResult]") -> "tuple[SolvePlan, str]":
    """The plan with a first guess of the focal length, if a photo states one and nobody gave one, and a word on it."""
    from calib.inputs.exif import exif_focal_px

    if plan.options.focal_px is not None:
        return plan, ""
    for result in results:
        if result.seen is not None and len(result.seen.ring):
            guess = exif_focal_px(result.photo.path)
            if guess is not None:
                said = f"first guess of the focal length: {guess:.0f} px, from what {printable(result.photo.name)} says"
                return replace(plan, options=replace(plan.options, focal_px=guess)), said
    return plan, ""


def _first_camera(
    results: "Sequence[PhotoResult]", geometry: "TargetGeometry", plan: "SolvePlan"
) -> "tuple[Camera | None, str]":
    """A camera good enough to see rings through its lens, or why the photos do not determine one."""
    from calib.inputs.observations import observations_from_detections
    from calib.solver.solve import solve

    seen = _with_target(results)
    if not seen:
        return None, ""
    chosen = plan.options
    options = replace(plan.options_of("opencv"), weighted=False)
    if "opencv" not in plan.models:  # another model's parameters are other numbers
        options = replace(options, fixed=(), shared=(), focal_px=chosen.focal_px)
    try:
        observations = observations_from_detections(seen, geometry, origin="the photos")
        calibration = solve(observations, "opencv", options)
    except InputError as error:
        return None, str(error)
    if calibration.status != "converged":
        return None, calibration.remarks[0]
    return calibration.camera, ""
