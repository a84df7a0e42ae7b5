"""The command `calib evaluate`."""

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from calib.commands import options
from calib.commands.folder_page import with_page_again
from calib.commands.running import evaluation_answer
from calib.commands.solve import grid_of, image_size_of
from designer.base.answer import Summary
from designer.page.terminal import quoted

if TYPE_CHECKING:
    from calib.metrics.evaluation import Evaluation

DEGENERATE = 1


def evaluate(
    calibration: Annotated[Path, typer.Argument(help="a calibration.json, or the folder it lies in")],
    *,
    truth: Annotated[Path | None, typer.Option(help="truth.json of rendered photos: adds the errors of poses")] = None,
    out: Annotated[
        Path | None, typer.Option("--out", "-o", help="folder for tables and figures (default: the calibration's)")
    ] = None,
    held_out: Annotated[
        int, typer.Option(min=0, help="hold every N-th photo out in turn and evaluate those; 0: do not", metavar="N")
    ] = 0,
    on: Annotated[
        Path | None,
        typer.Option(help="sightings that it was not solved from, in a file that calib solve takes: poses only"),
    ] = None,
    target: Annotated[Path | None, typer.Option(help="the target file of --on detections.csv")] = None,
    image_size: options.ImageSizeOption = None,
    grid: options.GridOption = None,
    pitch: options.PitchOption = None,
    figures: Annotated[bool, typer.Option(help="draw residuals, coverage and uncertainty")] = True,
    verbose: options.VerboseOption = False,
) -> Summary:
    """Measure a calibration: reprojection, intersection, reconstruction and pose error.

    The exit code is 1 if the photos do not determine the camera.
    """
    from calib.api.evaluating import calibration_in, check_metrics_folder
    from calib.api.evaluating import evaluate as evaluate_one
    from calib.commands.run_screen import say_evaluation
    from calib.show.parts.origin import is_of_kind

    path = calibration_in(calibration)
    folder = path.parent if out is None else out
    check_metrics_folder(folder)
    found = evaluate_one(
        path, truth=truth, held_out=held_out, on=on, target=target, image_size=image_size_of(image_size),
        grid=grid_of(grid, pitch),
    )  # fmt: skip
    files = found.save(folder, figures=figures)
    say_evaluation(path, found.asked, verbose=verbose)
    print(f"wrote {folder / 'metrics.json'} and metrics_*.csv: by photo, ring, face and observation")
    pictures = [file.name for file in files if file.suffix == ".png"]
    if pictures:
        print(f"      {', '.join(pictures)}: look at them before you trust the numbers")
    summary = Summary(
        {"calibration_file": str(path), **evaluation_answer(found.asked)},
        files,
        _next_steps(path, found.asked),
        exit_code=DEGENERATE if found.calibration.status == "degenerate" else 0,
    )
    for step in summary.next_steps:
        print(f"next  {step}")
    reported = next((place for place in (folder, folder.parent) if is_of_kind(place, "calibration")), None)
    return summary if reported is None else with_page_again(summary, reported, ("calibration",))


def _next_steps(path: Path, evaluation: "Evaluation") -> tuple[str, ...]:
    """To photos that the camera was not solved from, and from there to other programs."""
    from calib.commands.run_screen import LEAST_VIEWS_HELD_OUT

    if evaluation.calibration.status == "degenerate":
        return ()
    views = evaluation.calibration.observations.view_count
    if not (evaluation.folds or evaluation.on) and views >= LEAST_VIEWS_HELD_OUT:
        return (f"calib evaluate {quoted(path)} --held-out 5   # on photos that it was not solved from",)
    camera = quoted(path.parent / "camera.json")
    return (f"calib convert {camera} --to colmap -o cameras.txt   # or opencv, ros, kalibr, ...",)
