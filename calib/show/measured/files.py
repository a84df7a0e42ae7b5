"""The files of a measured target: NAME.target.json, and NAME.as_built.json, .csv and .png beside it."""

import csv
import io
import math
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from calib.as_built.deviations import FREE_PARAMETERS, Estimate, bent_mm
from calib.as_built.seats import Seats
from calib.records.as_built_file import AS_BUILT, AsBuiltRecord
from calib.show.measured.picture import report_picture
from designer.base.errors import InputError
from designer.base.files import check_folder
from designer.base.own_files import require_ours
from designer.target import FORMAT as TARGET_FORMAT
from designer.target import TargetGeometry, load_target, target_to_json

TARGET_SUFFIX = ".target.json"
COLUMNS = ("part", "number", "face", "i", "j", "quantity", "value", "sigma", "significance", "unit", "is_known")
_TABLE, _KIND_LINE = "ringsolid.as-built", "# ringsolid as-built deviations, version 1\n"


@dataclass(frozen=True)
class FilePlaces:
    """Where the files lie."""

    target: Path
    record: Path
    table: Path
    picture: Path


def places_of(target: Path) -> FilePlaces:
    """The files beside a measured target.

    Raises:
        InputError: its name does not end as those of target files do.
    """
    if not target.name.endswith(TARGET_SUFFIX) or target.name == TARGET_SUFFIX:
        name = target.name.removesuffix(".json").removesuffix(".target").rstrip(".") or "measured"
        raise InputError(f"-o {target}: target files end in {TARGET_SUFFIX}; call it {name}{TARGET_SUFFIX}")
    stem = target.name.removesuffix(TARGET_SUFFIX)
    return FilePlaces(target, *(target.with_name(f"{stem}.as_built{end}") for end in (".json", ".csv", ".png")))


def check_places(places: FilePlaces, nominal: Path | None) -> None:
    """Refuse places that hold something else, before any work is done.

    Raises:
        InputError: a place is the target's own, of another target that is not a measured one, or not to be written.
    """
    out = places.target
    check_folder(out.parent)
    if out.exists() and nominal is not None and nominal.exists() and out.samefile(nominal):
        raise InputError(f"-o {out}: is the target it is measured against; choose another name")
    require_ours(out, kind=TARGET_FORMAT)
    if out.exists() and out.stat().st_size and (source := load_target(out).source) != "measured":
        raise InputError(f"-o {out}: exists and holds a {source} target, not a measured one; choose another name")
    for place, kind in ((places.record, AS_BUILT.format), (places.table, _TABLE), (places.picture, "")):
        require_ours(place, kind=kind)


def measured_files(
    places: FilePlaces, record: AsBuiltRecord, measured: TargetGeometry, nominal: TargetGeometry
) -> dict[Path, bytes]:
    """The target, all numbers, the table and the picture."""
    return {
        places.target: target_to_json(measured).encode(),
        places.record: AS_BUILT.text(record),
        places.table: table_to_csv(record, nominal).encode(),
        places.picture: report_picture(record, measured),
    }


def table_to_csv(record: AsBuiltRecord, nominal: TargetGeometry) -> str:
    """A line a number, with its standard deviation and how many of them it is from zero."""
    stream = io.StringIO(newline="")
    stream.write(_KIND_LINE)
    stream.write("# faces and rings in the axes of their face, z outwards; the stretch of the whole print taken off\n")
    writer = csv.writer(stream, lineterminator="\n")
    writer.writerow(COLUMNS)
    for place, quantity, one, unit, is_known in _rows(record, nominal):
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
        numbers = (
            one.shift_x_mm, one.shift_y_mm, one.height_mm, one.tilt_x_rad, one.tilt_y_rad, one.turn_rad
        )  # fmt: skip
        for name, number in zip(FREE_PARAMETERS, numbers, strict=True):
            unit = "mm" if name.startswith("shift") else "rad"
            yield ("face", one.face, one.face, "", ""), name, number, unit, one.verdict != "not known"


def _rows(record: AsBuiltRecord, nominal: TargetGeometry) -> Iterator[_Row]:
    whole, of_print = record.whole, ("print", "", "", "", "")
    if whole.size is not None:
        yield of_print, "size", whole.size, "1", True
    for name, one in whole.axes.items():
        yield of_print, f"axis {name}", one, "1", True
    for name, one in whole.skews_rad.items():
        yield of_print, f"skew {name}", one, "rad", True
    if record.ink_bleed is not None:
        yield of_print, "ink bleed", record.ink_bleed.bleed_mm, "mm", True
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
