"""NAME.as_built.csv: how a print differs from its design, a line a number."""

import csv
import io
import math
from collections.abc import Iterator

import numpy as np

from calib.measure_target.deviations import FREE_PARAMETERS, Estimate, bent_mm
from calib.measure_target.record import AsBuiltRecord
from calib.measure_target.seats import Seats
from designer.target import TargetGeometry

COLUMNS = ("part", "number", "face", "i", "j", "quantity", "value", "sigma", "significance", "unit", "is_known")
TABLE_FORMAT = "ringsolid.as-built"
_KIND_LINE = "# ringsolid as-built deviations, version 1\n"


def table_to_csv(record: AsBuiltRecord, bleed_mm: Estimate | None, nominal: TargetGeometry) -> str:
    """A line a number, with its standard deviation and how many of them it is from zero."""
    stream = io.StringIO(newline="")
    stream.write(_KIND_LINE)
    stream.write("# faces and rings in the axes of their face, z outwards; the stretch of the whole print taken off\n")
    writer = csv.writer(stream, lineterminator="\n")
    writer.writerow(COLUMNS)
    for place, quantity, one, unit, is_known in _rows(record, bleed_mm, nominal):
        significance = f"{one.significance:.3g}" if math.isfinite(one.significance) else ""
        writer.writerow((*place, quantity, f"{one.value:.9g}", f"{one.sigma:.4g}", significance, unit, int(is_known)))
    return stream.getvalue()


_Place = tuple[str | int, ...]
_Row = tuple[_Place, str, Estimate, str, bool]


def _seat_rows(seats: Seats) -> Iterator[_Row]:
    """As the table of the page has them."""
    if seats.common_height_mm is not None:
        yield ("print", "", "", "", ""), "common height", seats.common_height_mm, "mm", True
    for one in seats.seats:
        numbers = (one.shift_x_mm, one.shift_y_mm, one.height_mm, one.tilt_x_rad, one.tilt_y_rad, one.turn_rad)
        for name, number in zip(FREE_PARAMETERS, numbers, strict=True):
            unit = "mm" if name.startswith("shift") else "rad"
            yield ("face", one.face, one.face, "", ""), name, number, unit, one.verdict != "not known"


def _rows(record: AsBuiltRecord, bleed_mm: Estimate | None, nominal: TargetGeometry) -> Iterator[_Row]:
    whole, of_print = record.whole, ("print", "", "", "", "")
    if whole.size is not None:
        yield of_print, "size", whole.size, "1", True
    for name, one in whole.axes.items():
        yield of_print, f"axis {name}", one, "1", True
    for name, one in whole.skews_rad.items():
        yield of_print, f"skew {name}", one, "rad", True
    if bleed_mm is not None:
        yield of_print, "ink bleed", bleed_mm, "mm", True
    if record.seats is not None:
        yield from _seat_rows(record.seats)
    for face, verdict in enumerate(record.face_verdict if record.seats is None else ()):
        for name, value, sigma in zip(FREE_PARAMETERS, record.motion[face], record.motion_sigma[face], strict=True):
            unit, place = "mm" if name.startswith("shift") else "rad", ("face", face, face, "", "")
            yield place, name, Estimate(float(value), float(sigma)), unit, verdict != "not known"
    if record.ring_sigma_mm is None and not record.face_bow_mm.any():
        return
    offset_mm = bent_mm(nominal, record.ring_offset_mm, record.face_bow_mm)
    for ring in np.flatnonzero(record.ring_is_seen & record.face_is_determined[nominal.ring_face]).tolist():
        place = ("ring", ring, int(nominal.ring_face[ring]), *nominal.ring_index[ring].tolist())
        for axis, value, sigma in zip("xyz", offset_mm[ring], record.ring_offset_sigma_mm[ring], strict=True):
            yield place, f"offset {axis}", Estimate(float(value), float(sigma)), "mm", True
