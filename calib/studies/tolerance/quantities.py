"""The errors of a calibration that a tolerance study looks at."""

from typing import NamedTuple


class Quantity(NamedTuple):
    """A root mean square error of one calibration."""

    name: str
    unit: str
    title: str


QUANTITIES: tuple[Quantity, ...] = (
    Quantity("reprojection", "px", "reprojection error"),
    Quantity("intersection", "mm", "intersection error against the drawing"),
    Quantity("reconstruction", "mm", "reconstruction error against the drawing"),
    Quantity("intersection_true", "mm", "intersection error against the true shape"),
    Quantity("reconstruction_true", "mm", "reconstruction error against the true shape"),
    Quantity("pose", "mm", "error of the camera's centre"),
    Quantity("rotation", "deg", "error of the camera's axes"),
    Quantity("focal_length", "px", "error of the focal lengths"),
    Quantity("principal_point", "px", "error of the principal point"),
    Quantity("distortion_map", "px", "error of the camera where the target was seen"),
)
"""In the order of all arrays. The first three need no truth; reprojection, intersection, reconstruction, pose and
rotation are those of `calib.metrics`.

Focal length: root mean square of fx and fy; principal point: distance; both against the camera of the model that fits
the noise-free views of the nominal target best, which is the true camera if the model is its own. Camera
where the target was seen: distances between the pixels that both cameras give to one direction, after the best
rotation, as in `calib.cameras.refit`, within the convex hull of all sightings: a lens that is
extrapolated beyond says nothing.
"""

NAMES: tuple[str, ...] = tuple(quantity.name for quantity in QUANTITIES)


def quantity_row(name: str) -> int:
    """The row of a quantity in `QUANTITIES`.

    Raises:
        ValueError: there is none of that name.
    """
    return NAMES.index(name)
