"""Kalibr's target files: `target_type` aprilgrid, checkerboard or circlegrid, lengths in metres (its ConfigReader)."""

import math
from collections.abc import Mapping
from pathlib import Path

from calib.cameras.formats.parsing import mapping, number, parse_yaml, required
from designer.base.errors import InputError
from designer.base.files import read_small_text
from designer.base.words import shown, suggestion_or_all
from designer.marks.aprilgrid import AprilGrid
from designer.marks.chessboard import Chessboard
from designer.marks.circles import Circles
from designer.marks.face_marks import FaceMarks

MAX_FILE_BYTES = 2**20
FIELDS: Mapping[str, tuple[str, ...]] = {
    "aprilgrid": ("tagCols", "tagRows", "tagSize", "tagSpacing"),
    "checkerboard": ("targetCols", "targetRows", "rowSpacingMeters", "colSpacingMeters"),
    "circlegrid": ("targetCols", "targetRows", "spacingMeters"),
}
"""What each type has."""


def read_kalibr_target(path: Path, diameter_mm: float | None) -> tuple[FaceMarks, tuple[str, ...]]:
    """The marks of a file, and remarks on what it does not say.

    Args:
        path: the YAML file.
        diameter_mm: of circles, which Kalibr does not ask for.

    Raises:
        InputError: it cannot be read, or breaks a rule; the message names it.
    """
    origin = str(path)
    tree = mapping(
        parse_yaml(read_small_text(path, MAX_FILE_BYTES, "Kalibr's target file"), origin), "the file", origin
    )
    kind = required(tree, ("target_type",), origin)
    if not isinstance(kind, str) or kind not in FIELDS:
        raise InputError(f"{origin}: target_type {shown(kind)} is unknown{suggestion_or_all(kind, FIELDS)}")
    values = [number(required(tree, (name,), origin), name, origin) for name in FIELDS[kind]]
    for name, value in zip(FIELDS[kind][:2], values[:2], strict=True):
        if value != int(value):
            raise InputError(f"{origin}: {name} {value:g}: must be a whole number")
    if (diameter_mm is None) != (kind != "circlegrid"):
        raise InputError(
            f"{origin}: does not say how large the circles are; give --diameter" if kind == "circlegrid"
            else f"--diameter: of circles; {origin} is of an {kind}; leave it out"
        )  # fmt: skip
    unused = [shown(one) for one in tree if one not in ("target_type", "asymmetricGrid", *FIELDS[kind])]
    said = (f"{origin}: not used: {', '.join(unused)}",) if unused else ()
    counts, lengths = (int(values[0]), int(values[1])), [1000 * value for value in values[2:]]
    try:
        if kind == "aprilgrid":
            return AprilGrid(counts, lengths[0], values[3]), said
        if kind == "circlegrid":
            step = 2 if str(tree.get("asymmetricGrid")).lower() in ("true", "1") else 1
            return Circles(counts, step * lengths[0], diameter_mm or 0.0, asymmetric=step == 2), said
        if not math.isclose(*lengths, rel_tol=1e-9):
            raise ValueError(f"rectangles of {lengths[1]:g} x {lengths[0]:g} mm: must be squares")
        squares = (counts[0] + 1, counts[1] + 1)
        corners = "Kalibr's rows and columns are inner corners; the upper left square is taken for dark"
        return Chessboard(squares, lengths[0]), (corners, *said)
    except ValueError as error:
        raise InputError(f"{origin}: {error}") from None
