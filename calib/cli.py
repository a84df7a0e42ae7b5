"""The command `calib`. What it is made of loads when it begins."""

from designer.base.interrupts import hold_interrupts

TYPE_CHECKING = False
if TYPE_CHECKING:
    import typer

PRINT, MAKE, CALIBRATE, JUDGE, USE = "Print right", "Make photos", "Calibrate", "Judge", "Use the camera"
IN_SPACE = "Measure in space"
TASKS: tuple[tuple[str, tuple[str, ...]], ...] = (
    (PRINT, ("coupon",)),
    (CALIBRATE, ("run", "live", "plan", "rig", "hand-eye", "turntable", "detect", "solve", "measure")),
    (JUDGE, ("evaluate", "report", "diff")),
    (USE, ("pose", "undistort", "convert")),
    (IN_SPACE, ("triangulate", "budget")),
    (MAKE, ("target", "render")),
    ("Set up", ("warm-up",)),
)
"""The commands by what they are for; each is the function of its name in the module of its name."""
LINES = {
    "run": "Detect, solve, detect again with the lens known, solve all models, judge.",
    "solve": "Solve the camera, and where it stood, from what was detected, and judge it.",
    "evaluate": "Measure a calibration: reprojection, intersection, reconstruction and pose error.",
    "report": "Write a folder's page, index.html, again from the results it stores.",
    "pose": "Find where a known camera stood, and how surely.",
    "coupon": "Tell ink bleed, scale and skew of a printer from photos or scans of its coupon.",
    "target": "Read a target file and say what it holds, or make one of a table of points.",
    "warm-up": "Compile all kernels now, on all cores, so that no later command has to.",
    "diff": "Compare two cameras: how far apart they see the same light.",
    "convert": "Write a camera or a rig as files of another tool, or read its files.",
    "undistort": "Resample photos to what a pinhole camera would have taken.",
    "plan": "Plan the fewest photos that make a camera known as well as wanted.",
    "detect": "Find a target's rings in photos, name them, and measure their centres.",
    "triangulate": "Find where points are that several cameras see, and how surely.",
    "budget": "Tell how large errors in space are to be expected, in mm.",
}
"""What the list of commands says of each, as its docstring begins."""
FUNCTIONS = {"detect": "detect_photos", "undistort": "undistort_photos"}
"""Those that are not called as their command; `calib.detect` and `calib.undistort` are of one photo."""


def app() -> "typer.Typer":
    """All commands."""
    from designer.base.command import Later, new_app

    commands = {
        name: Later(
            f"calib.{'app' if name in LINES else 'commands'}.{word}:{FUNCTIONS.get(name, word)}",
            task,
            LINES.get(name, ""),
        )
        for task, names in TASKS
        for name in names
        for word in (name.replace("-", "_"),)
    }
    return new_app(
        "calib",
        "Use the calibration targets that `design` makes. Begin with: calib run TARGET.json photos",
        {**commands, "study": Later("calib.commands.study:app", "Study")},
    )


def main() -> None:
    """Run the command line."""
    hold_interrupts()
    from designer.base.command import run

    run(app())


if __name__ == "__main__":
    main()
