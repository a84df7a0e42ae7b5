"""What a solution minimises: distances in the image, or in space between the rays of pixels and points.

>>> calib.solve("detections.csv", "ico.target.json", minimise="ray")

A distance in space is a file of this folder, which holds it as `DISTANCE`; a cost is a line of `COSTS`. They are what
Ruppel, Kutlu et al. (Beyond Reprojection Error) leave to future work: metrics of rays in the adjustment itself.
"""

from dataclasses import dataclass
from typing import TYPE_CHECKING

from calib.core.registry import Registry

if TYPE_CHECKING:
    from calib.solver.distance import Distance


@dataclass(frozen=True)
class Minimised:
    """Something to minimise."""

    title: str
    unit: str  # of what is squared
    distance: str = ""  # its name; "": in the image
    over_range: bool = False  # divided by how far along the ray it is


IMAGE = "image"
COSTS: dict[str, Minimised] = {
    IMAGE: Minimised("distances in the image", "px"),
    "ray": Minimised("distances of rings from rays", "mm", "ray"),
    "ray-by-range": Minimised("distances of rings from rays, over the range", "mm/mm", "ray", over_range=True),
    "intersection": Minimised("distances in the faces' planes", "mm", "intersection"),
    "intersection-by-range": Minimised(
        "distances in the faces' planes, over the range", "mm/mm", "intersection", over_range=True
    ),
    "whitened": Minimised("distances of rings from rays, by the covariance of the rays", "px", "whitened"),
}

DISTANCES: "Registry[Distance]" = Registry(__name__, "DISTANCE", ("ray", "intersection", "whitened"))
