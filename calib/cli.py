"""The command `calib`."""

from pathlib import Path
from typing import Annotated

import typer

from calib.commands.compare import compare
from calib.commands.convert import convert
from calib.commands.detect import detect
from calib.commands.diff import diff
from calib.commands.evaluate import evaluate
from calib.commands.measure import measure
from calib.commands.pose import pose
from calib.commands.render import render
from calib.commands.report import report
from calib.commands.run import run as run_all
from calib.commands.solve import solve
from calib.commands.study import app as study
from calib.commands.undistort import undistort
from designer.answer import Summary
from designer.command import command, run

app = typer.Typer(name="calib", help="Use calibration targets.", rich_markup_mode=None, pretty_exceptions_enable=False)


@app.callback()
def _commands() -> None:
    """Use the calibration targets that `design` makes."""


@command(app)
def target(file: Annotated[Path, typer.Argument(help="a target file (NAME.target.json)")]) -> Summary:
    """Read a target file as detector and calibrator will, and say what it holds."""
    from designer.target import bounding_radius_mm, load_target

    geometry = load_target(file)
    dots = int(geometry.is_dot.sum())
    kind = "made elsewhere" if geometry.spec is None else geometry.spec.kind
    if geometry.face_count > 1:
        marks = f"{geometry.face_count} faces with codes"
    else:
        marks = "one face with an origin mark" if dots else "one face without marks, its orientation ambiguous"
    print(f"{file}: {kind}, {geometry.source} geometry, {marks}")
    print(f"  rings {geometry.ring_count - dots}, dots {dots}")
    print(f"  farthest corner {bounding_radius_mm(geometry):.3f} mm from the origin")
    print(f"  layout id {geometry.layout_id}, geometry id {geometry.geometry_id}")
    return Summary({
        "target_id": geometry.geometry_id, "layout_id": geometry.layout_id,
        "kind": None if geometry.spec is None else geometry.spec.kind, "source": geometry.source,
        "faces": geometry.face_count, "rings": geometry.ring_count, "dots": dots,
        "farthest_corner_mm": bounding_radius_mm(geometry),
    })  # fmt: skip


command(app, "run")(run_all)
for one in (render, detect, solve, evaluate, convert, undistort, pose, diff, measure, report):
    command(app)(one)
command(study)(compare)
app.add_typer(study, name="study")


def main() -> None:
    """Run the command line."""
    run(app)


if __name__ == "__main__":
    main()
