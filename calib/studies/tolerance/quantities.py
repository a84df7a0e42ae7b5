"""The errors of a calibration that a tolerance study looks at, and limits on them: `intersection=0.05mm`."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import NamedTuple

from calib.renderer.quantities import parse_degrees, parse_pixels
from designer.base.errors import InputError
from designer.base.units import parse_length_mm
from designer.base.words import several, shown, suggestion


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
rotation are those of `calib.solver.metrics`.

Focal length: root mean square of fx and fy; principal point: distance; both against the camera of the model that fits
the noise-free views of the nominal target best, which is the true camera if the model is its own. Camera
where the target was seen: distances between the pixels that both cameras give to one direction, after the best
rotation, as in `calib.cameras.refit`, within the convex hull of all observations: a lens that is
extrapolated beyond says nothing.
"""
NAMES: tuple[str, ...] = tuple(quantity.name for quantity in QUANTITIES)
MAIN: tuple[str, ...] = tuple(name for name in NAMES if name not in ("rotation", "principal_point"))
"""The quantities that tables and figures show; files have all."""
TRUE_SHAPE: Mapping[str, str] = {"intersection": "intersection_true", "reconstruction": "reconstruction_true"}
"""Errors against the drawing, and the same against the true shape: an error of the print may show in one of them only.
"""
_PARSERS: Mapping[str, Callable[[str], float]] = {"px": parse_pixels, "mm": parse_length_mm, "deg": parse_degrees}


@dataclass(frozen=True)
class Requirement:
    """A limit that a person sets."""

    quantity: str
    limit: float  # in the quantity's unit


def quantity_row(name: str) -> int:
    """The row of a quantity in `QUANTITIES`."""
    return NAMES.index(name)


def quantity_named(name: str) -> Quantity:
    """A quantity by its name."""
    if name not in NAMES:
        hint = suggestion(name, list(NAMES)) or f"; there are {', '.join(NAMES)}"
        raise InputError(f"unknown quantity {name!r}{hint}")
    return QUANTITIES[quantity_row(name)]


def other_reference(name: str) -> Quantity | None:
    """The same error against the true shape instead of the drawing, or the other way round; None if it has neither."""
    pairs = {**TRUE_SHAPE, **{true: drawing for drawing, true in TRUE_SHAPE.items()}}
    return quantity_named(pairs[name]) if name in pairs else None


def parse_requirements(texts: Sequence[str]) -> tuple[Requirement, ...]:
    """Limits as people write them, each of another quantity."""
    found = [_parse(text) for text in several("--require", texts)]
    names = [one.quantity for one in found]
    for name in names:
        if names.count(name) > 1:
            raise InputError(f"--require {name} is given twice; give one limit for each quantity")
    return tuple(found)


def _parse(text: str) -> Requirement:
    name, sign, value = text.partition("=")
    if not sign:
        raise InputError(f"--require {shown(text)}: write QUANTITY=LIMIT, such as intersection=0.05mm")
    try:
        quantity = quantity_named(name.strip())
        limit = _PARSERS[quantity.unit](value)
    except ValueError as error:
        raise InputError(f"--require {shown(text)}: {error}") from None
    if not limit > 0:
        raise InputError(f"--require {shown(text)}: must be more than 0; give the largest error you can accept")
    return Requirement(quantity.name, limit)
