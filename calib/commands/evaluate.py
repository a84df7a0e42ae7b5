"""The command `calib evaluate`."""

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from calib.commands.answers.solutions import evaluation_answer
from calib.commands.folder_page import with_page_again
from calib.core.files import check_folder
from calib.show.screen import quoted, table_console
from designer.answer import Summary
from designer.command import printable
from designer.errors import InputError

if TYPE_CHECKING:
    from calib.metrics.evaluation import Evaluation
    from calib.metrics.held_out import Solve
    from calib.observe.truth import Truth
    from calib.records.calibration_file import Provenance
    from calib.solver.calibration import Calibration

DEGENERATE = 1
REFERENCE = "reference"
"""The setting that names the photo a map is learned from."""
LEAST_VIEWS_HELD_OUT = 6
"""Fewer are not worth the advice to hold some out."""


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
    figures: Annotated[bool, typer.Option(help="draw what is left over, covered and uncertain")] = True,
) -> Summary:
    """Measure a calibration: reprojection, intersection, reconstruction and pose error.

    The exit code is 1 if the photos do not determine the camera.
    """
    from calib.core.files import write_files
    from calib.metrics.evaluation import evaluate as evaluate_one
    from calib.observe.truth import read_truth
    from calib.records.calibration_file import CALIBRATION_FILE, read_calibration
    from calib.records.evaluation_files import FORMAT, METRICS_FILE, evaluation_files
    from calib.report.origin import is_of_kind
    from designer.own_files import require_ours

    path = calibration / CALIBRATION_FILE if calibration.is_dir() else calibration
    solved, provenance = read_calibration(path)
    known = None if truth is None else read_truth(truth)
    folder = path.parent if out is None else out
    check_folder(folder)
    require_ours(folder / METRICS_FILE, kind=FORMAT)
    of_all = evaluate_one(solved, known)
    chosen = _held_out(solved, provenance, held_out, known) if held_out else of_all
    files = evaluation_files(chosen, folder)
    if figures:
        from calib.figures import calibration_figures

        files |= calibration_figures(of_all, folder)
    write_files(files)
    _summarise(path, chosen)
    print(f"wrote {folder / METRICS_FILE} and metrics_*.csv: by photo, ring, face and sighting")
    pictures = [file.name for file in files if file.suffix == ".png"]
    if pictures:
        print(f"      {', '.join(pictures)}: look at them before you trust the numbers")
    summary = Summary(
        {"calibration_file": str(path), **evaluation_answer(chosen)},
        tuple(files),
        _advise(path, chosen),
        exit_code=DEGENERATE if solved.status == "degenerate" else 0,
    )
    reported = next((place for place in (folder, folder.parent) if is_of_kind(place, "calibration")), None)
    return summary if reported is None else with_page_again(summary, reported, ("calibration",))


def _held_out(calibration: "Calibration", provenance: "Provenance", folds: int, truth: "Truth | None") -> "Evaluation":
    from calib.metrics.held_out import LEAST_FOLDS, evaluate_held_out

    views = calibration.observations.view_count
    if not LEAST_FOLDS <= folds <= views:
        raise InputError(
            f"--held-out {folds}: {views} photos fall into {LEAST_FOLDS} to {views} parts; give one of these"
        )
    return evaluate_held_out(calibration, _solver_of(calibration, provenance), folds, truth)


def _solver_of(calibration: "Calibration", provenance: "Provenance") -> "Solve":
    """Solves again as the calibration was solved."""
    from calib.pipeline.calibrate import calibrate

    if dict(provenance.settings).get(REFERENCE):
        raise InputError(
            "--held-out: the map was learned from a photo of your choice, which the parts would need too; "
            "leave --held-out away, or solve without a reference"
        )
    return lambda seen: calibrate(seen, calibration.camera.model, provenance.options)


def _summarise(path: Path, evaluation: "Evaluation") -> None:
    """All tables, what was left out, and what the figures are worth."""
    from calib.report.evaluation_table import (
        faces_table,
        metrics_table,
        parameters_table,
        worst_points_table,
        worst_views_table,
    )

    calibration, console = evaluation.calibration, table_console()
    seen = calibration.observations
    print(
        f"{path}: model {calibration.camera.model}, {seen.image_size[0]} x {seen.image_size[1]} px, "
        f"{seen.view_count} photos, {len(seen.view)} sightings, {calibration.status}"
    )
    for remark in (*calibration.remarks, *evaluation.remarks):
        console.print(f"  {printable(remark)}", style="yellow", markup=False)
    print()
    console.print(parameters_table(evaluation))
    print()
    console.print(metrics_table(evaluation))
    for errors in evaluation.errors:
        for reason, count in errors.left_out:
            print(f"  {errors.metric}: {count} left out: {reason}")
    print(f"errors {_sample(evaluation)}\n")
    for table in (worst_views_table(evaluation), worst_points_table(evaluation), faces_table(evaluation)):
        if table is not None:
            console.print(table)
            print()


def _sample(evaluation: "Evaluation") -> str:
    """What the errors are of."""
    if not evaluation.folds:
        return "of the photos that the camera was solved from; those of other photos are larger as a rule"
    return (
        f"of photos held out, in {evaluation.folds} parts: the camera is solved from the other parts, only a photo's "
        "own pose\nfrom itself; reconstruction uses the photos of one part"
    )


def _advise(path: Path, evaluation: "Evaluation") -> tuple[str, ...]:
    """Say the next step; return it if it is a command line."""
    views = evaluation.calibration.observations.view_count
    if not evaluation.folds and views >= LEAST_VIEWS_HELD_OUT:
        step = f"calib evaluate {quoted(path)} --held-out 5"
        print(f"next  {step} measures it on photos that it was not solved from")
        return (step,)
    print("next  calib convert writes the camera for other programs, calib pose and calib undistort use it")
    return ()
