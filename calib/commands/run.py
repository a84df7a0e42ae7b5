"""The command `calib run`."""

import os
import time
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from calib.commands.detect import search_photos, staging_folder, summarise, write_results
from calib.commands.solve import (
    FixOption,
    FocalOption,
    LossOption,
    ModelOption,
    ReferenceOption,
    ReferenceTargetOption,
    RejectOption,
    ShareOption,
    WeightedOption,
    check_folder,
    leave_if_degenerate,
    plan_of,
    reference_of,
    reference_setting,
    say_files,
    solve_and_say,
)
from designer.command import printable
from designer.errors import InputError

if TYPE_CHECKING:
    from calib.detect.batch import Found, PhotoResult
    from calib.pipeline.settings import SolvePlan
    from calib.pipeline.solutions import Solution
    from calib.types import Camera
    from designer.target import TargetGeometry

NOTHING_FOUND = 1


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
    weighted: WeightedOption = False,
    reference: ReferenceOption = None,
    reference_target: ReferenceTargetOption = None,
    truth: Annotated[
        Path | None, typer.Option(help="of rendered photos (default: the truth.json beside them, if there is one)")
    ] = None,
    jobs: Annotated[
        int | None, typer.Option(min=1, max=1024, help="photos at a time, all in memory (default: one per core)")
    ] = None,
) -> None:
    """From photos to a calibrated camera: detect, solve, detect again with the lens known, solve all models, compare.

    The exit code is 1 if nothing was found, or if the photos do not determine the camera.
    """
    from calib.detect.batch import find_photos
    from calib.inputs.observations import dataset_of, observations_from_detections
    from calib.results.truth import read_truth
    from designer.target import load_target

    geometry = load_target(target)
    plan = plan_of(model, fix, share, focal, loss, reject, weighted=weighted)
    board = reference_of(reference, reference_target)
    folder = out if out is not None else _default_folder(target)
    check_folder(folder)
    found = find_photos(photos)
    truth_path = truth if truth is not None else _truth_beside(found.paths)
    known = None if truth_path is None else read_truth(truth_path)
    results = _detect_twice(geometry, found, plan, folder, jobs or os.cpu_count() or 1)
    seen = [result.seen for result in results if result.seen is not None and len(result.seen.ring)]
    if not seen:
        raise typer.Exit(NOTHING_FOUND)
    prepared = observations_from_detections(dataset_of(seen), geometry, origin="the photos")
    for remark in prepared.remarks:
        print(printable(remark))
    settings = (("target", target.name), ("photos", str(len(found.paths))), *reference_setting(reference))
    solutions = solve_and_say(prepared.observations, plan, folder, settings=settings, reference=board, truth=known)
    print(f"\nwrote {folder}: detections.csv, detections.records.json; overlays: look at some of them first")
    _draw(solutions, folder)
    say_files(folder, solutions)
    leave_if_degenerate(solutions)


def _draw(solutions: "Sequence[Solution]", folder: Path) -> None:
    """The tables and pictures of each model, and one that compares them."""
    from calib.figures import calibration_figures, comparison_figures
    from calib.files import write_files
    from calib.results.evaluation_files import evaluation_files

    evaluated = [(one.folder, one.evaluation) for one in solutions if one.evaluation is not None]
    for place, evaluation in evaluated:
        write_files(evaluation_files(evaluation, place) | calibration_figures(evaluation, place))
    if len(evaluated) > 1:
        write_files(comparison_figures([evaluation for _, evaluation in evaluated], folder))
        print("      comparison.png: the models side by side; metrics*.csv and calibration.png of each in its folder")


def _default_folder(target: Path) -> Path:
    return Path("exports") / target.name.removesuffix(".json").removesuffix(".target") / "calibration"


def _truth_beside(paths: Sequence[Path]) -> Path | None:
    """The truth of rendered photos, if all are of one rendered set."""
    folders = {path.parent for path in paths}
    beside = next(iter(folders)) / "truth.json" if len(folders) == 1 else None
    return beside if beside is not None and beside.is_file() else None


def _detect_twice(
    geometry: "TargetGeometry", found: "Found", plan: "SolvePlan", folder: Path, jobs: int
) -> "list[PhotoResult]":
    """Search the photos, solve a first camera, and search again with its lens; write the detections and overlays."""
    from calib.detect.pipeline import detect

    start = time.perf_counter()
    results = search_photos(detect, found, geometry, None, None, jobs)
    camera = _first_camera(results, geometry, plan, found)
    overlays = folder / "overlays"
    with staging_folder(overlays) as staging:
        results = search_photos(detect, found, geometry, camera, staging, jobs)
        seen = [result.seen for result in results if result.seen is not None]
        if not seen:
            failures = [*found.failures, *(result.failure for result in results)]
            others = f" (and {len(failures) - 1} more like it)" if len(failures) > 1 else ""
            raise InputError(f"{failures[0] if failures else 'no photos left to search'}{others}")
        write_results(folder / "detections.csv", results, seen, geometry)
        if staging is not None:
            for picture in staging.iterdir():
                picture.replace(overlays / picture.name)
    summarise(geometry, found, results, time.perf_counter() - start)
    if camera is None:
        print("the lens is not known from a first solution: searched without it")
    return results


def _first_camera(
    results: "Sequence[PhotoResult]", geometry: "TargetGeometry", plan: "SolvePlan", found: "Found"
) -> "Camera | None":
    """A camera good enough to see rings through its lens; None if the photos do not determine one."""
    from dataclasses import replace

    from calib.inputs.exif import exif_focal_px
    from calib.inputs.observations import dataset_of, observations_from_detections
    from calib.solver.options import SolveOptions
    from calib.solver.solve import solve

    seen = [result.seen for result in results if result.seen is not None and len(result.seen.ring)]
    if not seen:
        return None
    guess = plan.options.focal_px or (exif_focal_px(found.paths[0]) if found.paths else None)
    try:
        observations = observations_from_detections(dataset_of(seen), geometry, origin="the photos").observations
        calibration = solve(observations, "opencv", replace(SolveOptions(), focal_px=guess))
    except InputError:
        return None
    return calibration.camera if calibration.status == "converged" else None
