"""Options that several capabilities take, each declared once."""

import re
from collections.abc import Iterable, Mapping, Sequence
from functools import partial
from os import PathLike
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

from calib.cameras import fitted_models, learned_models, models_of_all, models_of_all_wide, solved_models
from calib.renderer.quantities import MOST_JOBS
from calib.solver.costs import COSTS
from designer.base.errors import InputError
from designer.base.options import argument, option
from designer.base.units import Skew, parse_skew_rad
from designer.kinds.presets import camera_templates, criteria_templates, error_templates, one_of, rig_templates

if TYPE_CHECKING:
    from calib.app.inputs import Place
    from calib.cameras.camera import Camera
    from calib.cameras.rig import Rig
    from calib.core.types import Observations
    from calib.judge.verdict import Criteria
    from calib.observe.corners_vnl import PointGrid
    from calib.renderer.rig_template import SimulatedRig
    from designer.target import TargetGeometry

MAX_SIDE_PX, MAX_GRID = 1_000_000, 1000
CameraFile = Annotated[
    "Camera | Place",
    argument("camera file of ours or of another tool, or a camera template", complete=camera_templates),
]
Target = Annotated["TargetGeometry | Place", argument("the target file (NAME.target.json) of what the photos show")]
TargetFile = Annotated["TargetGeometry | Place", argument("a target file (NAME.target.json)")]
RigTemplate = Annotated[
    "Rig | SimulatedRig | Place",
    option(
        "rig template (stereo-pair, ring-of-eight, ...), a TOML file of cameras, a rig.json, another tool's",
        metavar="NAME|FILE",
        complete=rig_templates,
    ),
]
Photos = Annotated[
    "Place | Iterable[Place]",
    argument(
        "images, folders of images, patterns ('run/*.png'), clips, or a robot's bag", is_many=True, is_needed=True
    ),
]
Topic = Annotated[str | None, option("of a robot's bag: its images (default: the only one)", metavar="TOPIC")]
PhotoJobs = Annotated[int | None, option("photos at a time, all in memory (default: one per core)", 1, MOST_JOBS)]
Weighted = Annotated[bool, option("weigh observations by the covariances they state, or all alike", off="--unweighted")]
LIMITS = option(
    "limits of the verdict: a template (standard, metrology, robotics), or a TOML file of one's own",
    metavar="NAME|FILE",
    complete=criteria_templates,
)
Limits = Annotated["Criteria | Place", LIMITS]
Made = Annotated[
    str | None,
    option(
        "how the target was made: an error template (fdm-board, sheet-print, ...), a TOML file of errors, or exact "
        "(default: assumed from how it was built; exact if the photos were rendered)",
        metavar="NAME|FILE",
        complete=error_templates,
    ),
]
Capture = Annotated[
    str | None,
    option(
        "how the photos were taken, and so what may move alike in all while the shutter rolls: still, handheld or "
        "moving (default: still, unless the photos show otherwise)",
        metavar="WAY",
    ),
]
_SOLVED, _ALL, _ALL_WIDE, _LEARNED = (
    ", ".join(names) for names in (solved_models(), models_of_all(), models_of_all_wide(), learned_models())
)
Model = Annotated[
    str, option(f"{_SOLVED}, or all: {_ALL}; of a wide lens {_ALL_WIDE}", complete=one_of((*solved_models(), "all")))
]
Fix = Annotated[Sequence[str], option("keep a parameter as it starts, or at a value: k3, k3=0", is_many=True)]
Share = Annotated[Sequence[str], option("parameters that have one value: fx_px,fy_px", is_many=True)]
Priors = Annotated[
    "Mapping[str, tuple[float, float]] | Sequence[str]",
    option(
        "what is known of a parameter, its value with a standard deviation: fx=1250+-10px, k1=0+-.01, fy=1250px+-1%",
        flag="--prior",
        is_many=True,
        parse=str,
        metavar="NAME=VALUE+-SIGMA",
    ),
]
Breathing = Annotated[
    float | None,
    option(
        "the focal length follows the distance, as an autofocus makes it: it is solved how, and the camera is that at "
        "this distance: 400mm",
        1.0,
        1e6,
    ),
]
Vary = Annotated[
    str | None,
    option(
        "what differs between sessions: focal, fx, fy, cx, cy, several as in focal,cx,cy; with how much if that is "
        "known, focal+-2px (default: estimated)",
        metavar="NAMES",
    ),
]
Sessions = Annotated[
    "Mapping[str, str] | Place | None",
    option("of --vary: a table file,session (default: photos of one folder are of one)", metavar="FILE"),
]
FocalGuess = Annotated[float | None, option("first guess of the focal length: 2500px (not needed)", 1e-3, 1e7)]
Loss = Annotated[
    str,
    option("squares, huber or cauchy: how far-off observations count", names=lambda: ("squares", "huber", "cauchy")),
]
Reject = Annotated[
    float | None, option("leave out what is off by more than so many robust standard deviations, such as 4", 1, 1e9)
]
Minimise = Annotated[
    str,
    option(
        f"{', '.join(COSTS)}: distances in the image, or in space; image is surest (calib study cost)",
        names=lambda: tuple(COSTS),
    ),
]
FreeBend = Annotated[
    bool | None,
    option(
        "the bend of a flat target is an unknown, too (default: of one that was made, not rendered or measured)",
        off="--no-free-bend",
    ),
]
ReferencePhoto = Annotated[
    "Observations | str | None",
    option(
        f"{_LEARNED}: the photo that the map is learned from, or all (default: of a board the photo that covers the "
        "image best, of other targets all)",
        parse=str,
        metavar="TEXT",
    ),
]
ReferenceTarget = Annotated[
    "TargetGeometry | Place | None", option(f"{_LEARNED}: target file of a board that the reference photo shows")
]


def pair(text: str, most: int) -> tuple[int, int]:
    """Two whole numbers: `2448x2048`."""
    match = re.fullmatch(r"\s*([0-9]{1,9})\s*[x×]\s*([0-9]{1,9})\s*", text, re.IGNORECASE)
    pair = (int(match[1]), int(match[2])) if match else (0, 0)
    if not all(1 <= one <= most for one in pair):
        raise ValueError(f"expected two whole numbers from 1 to {most}, such as 10x7")
    return pair


ImageSize = Annotated[
    tuple[int, int] | None,
    option("of files that do not say it: 2448x2048", parse=partial(pair, most=MAX_SIDE_PX), metavar="TEXT"),
]
CameraSize = Annotated[
    tuple[int, int] | None,
    option(
        "that a camera of this machine is asked for: 1920x1080", parse=partial(pair, most=MAX_SIDE_PX), metavar="TEXT"
    ),
]
Grid = Annotated[
    tuple[int, int] | None, option("of a corners.vnl: 10x7 corners", parse=partial(pair, most=MAX_GRID), metavar="TEXT")
]
Pitch = Annotated[float | None, option("of a corners.vnl: distance of its corners, 20mm", 1e-6, 1e6)]
Points = Annotated[
    str | None,
    option(
        "what a table's points are: corner, ring (the image of its centre), or circle:13mm (the centre of its "
        "image, as blob and circle-grid detectors give it; default: as the table or the target says)",
        metavar="KIND",
    ),
]
MadeWithShrink = Annotated[float, option("that this print was made with, to tell that of the next", -50, 50)]
MadeWithSkew = Annotated[
    Skew,
    option(
        "that this print was made with, to tell that of the next: 'xy 0.02deg, yz -0.1deg'",
        metavar="ANGLES",
        parse=parse_skew_rad,
    ),
]
MOST_VIEWS = 100_000
MOST_DISTANCE_MM = 10_000.0
MAX_SEED = 2**63 - 1
Seed = Annotated[int, option("of all that is random", 0, MAX_SEED)]
Jobs = Annotated[int | None, option("processes (default: one per core)", 1, MOST_JOBS)]
Dask = Annotated[str | None, option("have the samples computed by the Dask cluster of this scheduler: tcp://host:8786")]
Resume = Annotated[bool, option("go on with the study in the folder")]
CameraTemplate = Annotated["Camera | Place", option("camera template, or a camera file", complete=camera_templates)]
Views = Annotated[int, option("how many photos", 1, MOST_VIEWS)]
Distance = Annotated[
    tuple[float, float] | float | None,
    option(
        "of the cameras from the target's origin: 400mm, or 250mm..500mm (default: as the page of a design advises)",
        1.0,
        MOST_DISTANCE_MM,
    ),
]
AimOffset = Annotated[
    float | None,
    option(
        "look past the target's origin, by up to this (default: as the page of a design advises)", 0, MOST_DISTANCE_MM
    ),
]
FittedModel = Annotated[str, option(f"camera model that is solved: {', '.join(fitted_models())}", names=fitted_models)]
Errors = Annotated[
    str, option("error template (fdm-dual, hand-stickers, ...), or a TOML file", complete=error_templates)
]
Changes = Annotated[
    Sequence[str],
    option("another size of one error: face_tilt=0.1deg", flag="--set", metavar="ERROR=SIZE", is_many=True),
]


def exports_folder(target: str | PathLike[str]) -> Path:
    """Where a target's results go if nobody says otherwise."""
    return Path("exports") / Path(target).name.removesuffix(".json").removesuffix(".target")


def grid_of(grid: tuple[int, int] | None, pitch_mm: float | None) -> "PointGrid | None":
    """The corners of a `corners.vnl`; InputError: one without the other."""
    if grid is None and pitch_mm is None:
        return None
    if grid is None or pitch_mm is None:
        raise InputError("--grid and --pitch belong together: --grid 10x7 --pitch 20mm")
    from calib.observe.corners_vnl import PointGrid

    return PointGrid(*grid, pitch_mm)
