"""What `calib evaluate` shows of a camera's errors."""

from pathlib import Path

from calib.metrics.evaluation import Evaluation
from calib.show.run.evaluation_table import (
    faces_table,
    metrics_table,
    parameters_table,
    worst_points_table,
    worst_views_table,
)
from calib.show.screen import table_console
from designer.base.words import printable


def say_evaluation(path: Path, evaluation: Evaluation) -> None:
    """All tables, what was left out, and what the figures are worth."""
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


def _sample(evaluation: Evaluation) -> str:
    """What the errors are of."""
    if not evaluation.folds:
        return "of the photos that the camera was solved from; those of other photos are larger as a rule"
    return (
        f"of photos held out, in {evaluation.folds} parts: the camera is solved from the other parts, only a photo's "
        "own pose\nfrom itself; reconstruction uses the photos of one part"
    )
