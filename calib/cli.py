"""The command `calib`."""

from collections.abc import Callable

from calib.commands.budget import budget
from calib.commands.convert import convert
from calib.commands.coupon import coupon
from calib.commands.detect import detect
from calib.commands.diff import diff
from calib.commands.evaluate import evaluate
from calib.commands.hand_eye import hand_eye
from calib.commands.live import live
from calib.commands.measure import measure
from calib.commands.plan import plan
from calib.commands.pose import pose
from calib.commands.render import render
from calib.commands.report import report
from calib.commands.rig import rig
from calib.commands.run import run as run_all
from calib.commands.solve import solve
from calib.commands.study import app as study
from calib.commands.target import target
from calib.commands.triangulate import triangulate
from calib.commands.turntable import turntable
from calib.commands.undistort import undistort
from calib.commands.warm_up import warm_up
from designer.base.answer import Summary
from designer.base.command import command, new_app, run

Command = Callable[..., Summary]

app = new_app("calib", "Use the calibration targets that `design` makes. Begin with: calib run TARGET.json photos")

PRINT, MAKE, CALIBRATE, JUDGE, USE = "Print right", "Make photos", "Calibrate", "Judge", "Use the camera"
IN_SPACE = "Measure in space"
TASKS: tuple[tuple[str, tuple[Command, ...]], ...] = (
    (PRINT, (coupon,)),
    (CALIBRATE, (run_all, live, plan, rig, hand_eye, turntable, detect, solve, measure)),
    (JUDGE, (evaluate, report, diff)),
    (USE, (pose, undistort, convert)),
    (IN_SPACE, (triangulate, budget)),
    (MAKE, (target, render)),
    ("Set up", (warm_up,)),
)
"""The commands by what they are for."""

for task, functions in TASKS:
    for function in functions:
        command(app, task=task)(function)
app.add_typer(study, name="study", rich_help_panel="Study")


def main() -> None:
    """Run the command line."""
    run(app)


if __name__ == "__main__":
    main()
