"""The tables of a measured print, for its page and for `calib measure --verbose`."""

import math

import numpy as np

from calib.as_built.cross_validation import Gain
from calib.as_built.deviations import FREE_PARAMETERS, Estimate
from calib.draw.print_errors import errors_table, told, whole_rows
from calib.records.as_built_file import AsBuiltRecord
from calib.show.measured.scene import datum_words, deviations_of
from calib.show.measured.seats import seats_table
from calib.show.measured.words import axes_words
from designer.base.number_text import figure
from designer.page.blocks import Cell, Column, Level, Table
from designer.target import TargetGeometry

MOST_RINGS = 2000
"""In the table of rings, those that are off most."""
LEVEL_OF_VERDICT: dict[str, Level] = {"moved": "usable", "as designed": "good"}
LEVEL_OF_BETTER: dict[bool | None, Level] = {True: "good", False: "usable", None: "note"}


def whole_table(record: AsBuiltRecord, target: TargetGeometry | None) -> Table | None:
    """Size and shape of the whole print; None if nothing of them is known."""
    rows = whole_rows(record.whole)
    return errors_table("Size and shape", rows, "" if target is None else axes_words(target)) if rows else None


def faces_table(record: AsBuiltRecord) -> Table | None:
    """How each face lies; None of a single one, of which that is the pose."""
    if not record.face_verdict:
        return None
    if record.seats is not None:
        return seats_table(record.seats, record.face_views.tolist())
    units = [("mm", 1.0) if name.startswith("shift") else ("deg", math.degrees(1)) for name in FREE_PARAMETERS]
    named = zip(FREE_PARAMETERS, units, strict=True)
    columns = [Column("face"), Column("verdict", is_number=False), Column("photos")]
    columns += [Column(f"{name} [{unit}]") for name, (unit, _) in named]
    rows = []
    for face, verdict in enumerate(record.face_verdict):
        views = int(record.face_views[face])
        cells = [
            Cell(str(face), face),
            Cell(verdict, level=LEVEL_OF_VERDICT.get(verdict, "note")),
            Cell(str(views), views),
        ]
        for value, sigma, (_, unit) in zip(record.motion[face], record.motion_sigma[face], units, strict=True):
            one = Estimate(float(value), float(sigma))
            is_known = verdict != "not known"
            cells.append(_estimate(one, unit, is_starred=verdict == "moved") if is_known else Cell(""))
        rows.append(tuple(cells))
    note = (
        "In the face's own axes, z outwards, the stretch of the whole print taken off; * is more than 3 sigma, of a "
        "face that moved."
    )
    return Table("How the faces lie", tuple(columns), tuple(rows), note, visible_rows=20)


def _estimate(one: Estimate, unit: float = 1.0, *, is_starred: bool = True) -> Cell:
    """A number with its sigma, and a star if it may have one and is more than noise."""
    star = " *" if is_starred and one.is_significant else ""
    return Cell(told(one, star, unit), unit * one.value if one.is_known else None)


def rings_table(record: AsBuiltRecord, target: TargetGeometry | None) -> Table | None:
    """How the rings lie on their faces, those off most first; None if rings were held rigid."""
    if record.ring_sigma_mm is None:
        return None
    size = np.linalg.norm(record.ring_offset_mm, axis=1)
    size[~record.ring_is_seen] = np.nan
    order = np.argsort(-np.nan_to_num(size, nan=-1.0), kind="stable")
    order = order[np.isfinite(size[order])]
    total = None if target is None else deviations_of(record, target).size_mm
    columns = [
        Column("ring"), *((Column("face"), Column("i, j", is_number=False)) if target is not None else ()),
        *(Column(f"offset {axis} [mm]") for axis in "xyz"), Column("off by [mm]", note="its own offset"),
        *((Column("with its face [mm]", note="offset, bow and motion of the face"),) if target is not None else ()),
    ]  # fmt: skip
    rows = []
    for ring in order[:MOST_RINGS].tolist():
        cells = [Cell(str(ring), ring)]
        if target is not None:
            face, (i, j) = int(target.ring_face[ring]), target.ring_index[ring].tolist()
            cells += [Cell(str(face), face), Cell(f"{i}, {j}")]
        offsets = zip(record.ring_offset_mm[ring], record.ring_offset_sigma_mm[ring], strict=True)
        cells += [_estimate(Estimate(float(value), float(sigma))) for value, sigma in offsets]
        sizes = (size[ring],) if total is None else (size[ring], total[ring])
        cells += [Cell(figure(float(one), 3), float(one)) for one in sizes]
        rows.append(tuple(cells))
    more = f" The {MOST_RINGS} that are off most of {len(order)}." if len(order) > MOST_RINGS else ""
    own = "Their own offsets in the axes of their face, z outwards; bow and motion of the face taken off."
    note = f"{own}{more}{'' if target is None else datum_words(record)}"
    return Table("How the rings lie on their faces", tuple(columns), tuple(rows), note)


def cameras_table(record: AsBuiltRecord) -> Table:
    """The cameras that were solved beside the target."""
    columns = (
        Column("camera"), Column("model", is_number=False), Column("photos"), Column("observations"),
        Column("left out"), Column("RMS residual [px]"),
    )  # fmt: skip
    rows = tuple(
        (Cell(str(number), number), Cell(one.model), Cell(str(one.views), one.views),
         Cell(str(one.observations), one.observations), Cell(str(one.left_out), one.left_out),
         Cell(figure(one.rms_px, 3), one.rms_px))
        for number, one in enumerate(record.cameras, start=1)
    )  # fmt: skip
    return Table("Cameras, solved together with the target", columns, rows)


def gains_table(record: AsBuiltRecord) -> Table | None:
    """Each error in cross-validation, with the drawing and with the measured target; None if there is none."""
    held = record.held_out
    if held is None or not (held.gains or held.against_truth):
        return None
    columns = (
        Column("error", is_number=False), Column("n"), Column("with the drawing"), Column("measured"),
        Column("times less"), Column("at least", note="with 97.5 % certainty"),
    )  # fmt: skip
    rows = [_gain_row(gain, gain.metric) for gain in held.gains]
    rows += [_gain_row(gain, f"{gain.metric} against the truth") for gain in held.against_truth]
    note = (
        f"Root mean square errors of photos held out, in {held.parts} parts: camera and target are solved from the "
        "other parts, only a photo's own pose from itself. At least: with 97.5 % certainty."
    )
    return Table("Cross-validation", columns, tuple(rows), note)


def _gain_row(gain: Gain, name: str) -> tuple[Cell, ...]:
    errors = (Cell(f"{figure(error, 3)} {gain.unit}", error) for error in (gain.nominal, gain.measured))
    is_finite = math.isfinite(gain.factor)
    least = "-" if gain.least_factor is None else figure(gain.least_factor, 3)
    return (
        Cell(name), Cell(str(gain.count), gain.count), *errors,
        Cell(figure(gain.factor, 3) if is_finite else "any", gain.factor if is_finite else None,
             level=LEVEL_OF_BETTER[gain.is_better]),
        Cell(least, gain.least_factor),
    )  # fmt: skip
