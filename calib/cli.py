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
    (JUDGE, ("evaluate", "check", "report", "diff")),
    (USE, ("pose", "undistort", "convert", "markers")),
    (IN_SPACE, ("triangulate", "budget")),
    (MAKE, ("target", "render")),
    ("Set up", ("warm-up",)),
)
"""The commands by what they are for; each is the function of its name in the module of its name."""
STUDIES = ("bootstrap", "paper", "compare", "cost", "plot")
STUDY = "Calibrate thousands of samples of a set of photos: how sure is the camera, and what does a target do to it?"
LINES = {
    "run": "Detect, solve, detect again with the lens known, solve all models, judge.",
    "live": "Take photos under guidance of a page, until the camera is good.",
    "solve": "Solve the camera, and where it stood, from what was detected, and judge it.",
    "evaluate": "Measure a calibration: reprojection, intersection, reconstruction and pose error.",
    "check": "Tell whether a camera or a rig is still as its file says.",
    "report": "Write a folder's page, index.html, again from the results it stores.",
    "measure": "Measure a printed target with photos of it.",
    "pose": "Find where a known camera stood, and how surely.",
    "coupon": "Tell ink bleed, scale and skew of a printer from photos or scans of its coupon.",
    "target": "Read a target file and say what it holds, or make one of a board or of points.",
    "warm-up": "Compile all kernels now, on all cores, so that no later command has to.",
    "diff": "Compare two cameras: how far apart they see the same light.",
    "convert": "Write a camera or a rig as files of another tool, or read its files.",
    "markers": "Write detections as control points of a program that finds cameras.",
    "rig": "Solve where several cameras stand that saw one target together.",
    "hand-eye": "Solve where a camera sits on a robot, or beside it.",
    "turntable": "Solve where a camera stands beside a turntable, its axis and angles.",
    "undistort": "Resample photos to what a pinhole camera would have taken.",
    "plan": "Plan the fewest photos that make a camera known as well as wanted.",
    "detect": "Find a target's rings or corners in photos, name them, and measure their places.",
    "render": "Render synthetic photos of a target from known poses.",
    "triangulate": "Find where points are that several cameras see, and how surely.",
    "study bootstrap": "Draw views with replacement, calibrate and measure, thousands of times.",
    "study paper": (
        "Make the paper's study again from nothing: both targets, photos, detections, 10,000 samples a case, its table."
    ),
    "study compare": (
        "Simulate the paper's real-world figure: five made objects, three camera models, 12 sets of photos a print."
    ),
    "study cost": "Measure what to minimise: distances in the image, or in space between rays and rings.",
    "study plot": "Make the tables and figures of a study again, of a running one too.",
    "budget": "Tell how large errors in space are to be expected, in mm.",
}
"""What the list of commands says of each, as its docstring begins."""
FUNCTIONS = {"detect": "detect_photos", "undistort": "undistort_photos", "study bootstrap": "bootstrap"}
"""Those that are not called as their command; `calib.detect` and `calib.undistort` are of one photo."""
MODULES = {"study plot": "study_paper"}


def place_of(name: str) -> str:
    """Where the function of a command is: "module:function"."""
    word = name.replace("-", "_").replace(" ", "_")
    return f"calib.app.{MODULES.get(name, word)}:{FUNCTIONS.get(name, word)}"


def app() -> "typer.Typer":
    """All commands."""
    from designer.base.command import Later, LaterGroup, new_app

    commands = {name: Later(place_of(name), task, LINES[name]) for task, names in TASKS for name in names}
    studies = {name: Later(place_of(f"study {name}"), help=LINES[f"study {name}"]) for name in STUDIES}
    return new_app(
        "calib",
        "Use the calibration targets that `design` makes. Begin with: calib run TARGET.json photos",
        {**commands, "study": LaterGroup(studies, STUDY, "Study")},
    )


def main() -> None:
    """Run the command line."""
    hold_interrupts()
    from designer.base.command import run

    run(app())


if __name__ == "__main__":
    main()
