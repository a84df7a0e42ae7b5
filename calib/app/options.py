"""Options that several capabilities take, each declared once."""

from collections.abc import Iterable
from os import PathLike
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

from designer.base.options import argument, option
from designer.kinds.presets import camera_templates, criteria_templates, error_templates

if TYPE_CHECKING:
    from calib.app.inputs import Place
    from calib.cameras.camera import Camera
    from calib.verdict.verdict import Criteria
    from designer.target import TargetGeometry

MOST_JOBS = 1024
CameraFile = Annotated[
    "Camera | Place",
    argument("camera file of ours or of another tool, or a camera template", complete=camera_templates),
]
Target = Annotated["TargetGeometry | Place", argument("the target file (NAME.target.json) of what the photos show")]
Photos = Annotated[
    "Place | Iterable[Place]", argument("images, folders of images, or patterns such as 'run/*.png'", is_many=True)
]
PhotoJobs = Annotated[int | None, option("photos at a time, all in memory (default: one per core)", 1, MOST_JOBS)]
Weighted = Annotated[
    bool, option("weigh observations by the covariances they state, or all alike", off="--unweighted")
]  # fmt: skip
Limits = Annotated[
    "Criteria | Place",
    option(
        "limits of the verdict: a template (standard, metrology, robotics), or a TOML file of one's own",
        metavar="NAME|FILE",
        complete=criteria_templates,
    ),
]
Made = Annotated[
    str | None,
    option(
        "how the target was made: an error template (fdm-board, sheet-print, ...), a TOML file of errors, or exact "
        "(default: assumed from how it was built; exact if the photos were rendered)",
        metavar="NAME|FILE",
        complete=error_templates,
    ),
]


def exports_folder(target: str | PathLike[str]) -> Path:
    """Where a target's results go if nobody says otherwise."""
    return Path("exports") / Path(target).name.removesuffix(".json").removesuffix(".target")
