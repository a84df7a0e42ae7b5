"""The command `calib`."""

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
from calib.commands.target import target
from calib.commands.undistort import undistort
from designer.command import command, run

app = typer.Typer(name="calib", help="Use calibration targets.", rich_markup_mode=None, pretty_exceptions_enable=False)


@app.callback()
def _commands() -> None:
    """Use the calibration targets that `design` makes."""


command(app, "run")(run_all)
for one in (target, render, detect, solve, evaluate, convert, undistort, pose, diff, measure, report):
    command(app)(one)
command(study)(compare)
app.add_typer(study, name="study")


def main() -> None:
    """Run the command line."""
    run(app)


if __name__ == "__main__":
    main()
