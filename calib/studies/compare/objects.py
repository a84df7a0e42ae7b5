"""The paper's five objects: how they were made, how they were photographed, and what came out.

Ruppel, Kutlu et al., Beyond Reprojection Error: Camera Calibration with 3D Targets, section "Real-world evaluation":
medians of 12 sets of photos of each object, about 30 photos of a board, about 90 of an icosahedron.
"""

import math
from dataclasses import dataclass

from designer.base.small_file import read_spec_file
from designer.kinds.layout import lay_out
from designer.kinds.presets import preset_or_file
from designer.kinds.sizing import size_job
from designer.kinds.spec_file import parse_spec
from designer.target import TargetGeometry

VIRTUAL = "virtual"
MODELS = ("luhmann", "opencv", VIRTUAL)
"""The camera models that the paper compares."""
BOARD_VIEWS, ICOSAHEDRON_VIEWS = 30, 90
SETS = 12


@dataclass(frozen=True)
class PaperObject:
    """One object, and the medians that the paper's text gives for it."""

    label: str  # in the paper's figure
    name: str
    template: str  # of the target
    errors: str  # template of how it was made
    views: int
    intersection_mm: float  # nan: the text does not give it
    intersection_text: str
    reconstruction_mm: float

    @property
    def is_known(self) -> bool:
        """Whether the text gives numbers."""
        return math.isfinite(self.intersection_mm)

    @property
    def is_board(self) -> bool:
        """Whether it is flat, and photographed as boards are."""
        return self.views == BOARD_VIEWS

    def median(self, metric: str) -> float:
        """The paper's median of a metric, mm; nan where there is none."""
        return {"intersection": self.intersection_mm, "reconstruction": self.reconstruction_mm}.get(metric, math.nan)


OBJECTS: tuple[PaperObject, ...] = (
    PaperObject("I1", "MasterIco", "master-ico", "hand-stickers", ICOSAHEDRON_VIEWS, 3.0, "> 3", 2.7),
    PaperObject("I2", "ShinyIco", "shiny-ico", "fdm-dual", ICOSAHEDRON_VIEWS, 1.785, "1.74-1.83", 1.08),
    PaperObject("I3", "MattIco", "matt-ico", "fdm-dual", ICOSAHEDRON_VIEWS, math.nan, "-", math.nan),
    PaperObject("B1", "AluBoard", "alu-board", "sheet-print", BOARD_VIEWS, 0.4, "0.4", 0.5),
    PaperObject("B2", "3DBoard", "3d-board", "fdm-board", BOARD_VIEWS, 0.6, "0.6", 0.8),
)
REPROJECTION_RATIO = ("ShinyIco", "3DBoard", 2.0)
"""The one thing the text says of reprojection errors: that of the first is so many times that of the second."""


def object_named(name: str) -> PaperObject:
    """One of `OBJECTS`.

    Raises:
        StopIteration: there is none of that name.
    """
    return next(one for one in OBJECTS if one.name == name)


def make_target(template: str) -> TargetGeometry:
    """The drawing of a target template."""
    path = preset_or_file("targets", template)
    return lay_out(size_job(parse_spec(read_spec_file(path), str(path))).job.target)
