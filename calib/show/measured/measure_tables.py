"""The tables of the page of a measured print."""

import math

import numpy as np

from calib.as_built_report.as_built_file import AsBuiltRecord
from calib.as_built_report.deviations import FREE_PARAMETERS, Estimate
from calib.as_built_report.words import FINEST, axes_words, degrees, percent
from calib.core.number_text import figure, with_digits
from calib.show.measured.measure_scene import deviations_of
from designer.base.words import capital
from designer.page.blocks import Cell, Column, Level, Table
from designer.target import TargetGeometry

MOST_RINGS = 2000
"""In the table of rings, those that are off most."""
LEVEL_OF_VERDICT: dict[str, Level] = {"moved": "usable", "as designed": "good"}


def estimate_cell(one: Estimate, unit: float = 1.0, *, is_starred: bool = True) -> Cell:
    """A number with its sigma, and a star if it may have one and is more than noise."""
    value, sigma = unit * one.value, unit * one.sigma
    if not math.isfinite(value):
        return Cell("-")
    text = with_digits(value, max(sigma, FINEST))
    sign = "" if text.startswith("-") else "+"
    return Cell(f"{sign}{text} ± {figure(sigma, 2)}{' *' if is_starred and one.is_significant else ''}", value)


def whole_table(record: AsBuiltRecord, target: TargetGeometry | None) -> Table:
    """Size and shape of the whole print."""
    whole = record.whole
    rows = []
    if whole.size is not None:
        rows.append(_whole_row("size, + is too large", whole.size, percent(whole.size)))
    rows += [_whole_row(f"axis {name} beyond the mean", one, percent(one)) for name, one in whole.axes]
    rows += [_whole_row(f"skew {name}", one, degrees(one)) for name, one in whole.skews]
    columns = (
        Column("of the whole print", is_number=False), Column("value ± sigma"), Column("sigmas from zero"),
        Column("", is_number=False),
    )  # fmt: skip
    note = "" if target is None else f"{capital(axes_words(target).replace('`', ''))}."
    return Table("Size and shape", columns, tuple(rows), note)


def _whole_row(name: str, one: Estimate, text: str) -> tuple[Cell, ...]:
    word, level = ("off", "usable") if one.is_significant else ("may be noise", None)
    sigmas = one.significance
    return (
        Cell(name), Cell(text.replace("+-", "±"), one.value),
        Cell(f"{sigmas:.1f}" if math.isfinite(sigmas) else "-", sigmas),
        Cell(word, level="usable" if level else None),
    )  # fmt: skip


def faces_table(record: AsBuiltRecord) -> Table | None:
    """How each face lies; None of a single one, of which that is the pose."""
    if not record.verdicts:
        return None
    columns = [Column("face"), Column("verdict", is_number=False), Column("photos")]
    for name in FREE_PARAMETERS:
        columns.append(Column(f"{name} [{'mm' if name.startswith('shift') else 'deg'}]"))
    rows = []
    for face, verdict in enumerate(record.verdicts):
        cells = [
            estimate_cell(
                Estimate(float(record.motion[face, k]), float(record.motion_sigma[face, k])),
                1.0 if name.startswith("shift") else math.degrees(1),
                is_starred=verdict == "moved",
            )
            if verdict != "not known"
            else Cell("")
            for k, name in enumerate(FREE_PARAMETERS)
        ]
        views = float(record.face_views[face])
        rows.append(
            (Cell(str(face), face), Cell(verdict, level=LEVEL_OF_VERDICT.get(verdict, "note")),
             Cell(f"{views:g}", views), *cells)
        )  # fmt: skip
    note = (
        "In the face's own axes, z outwards, the stretch of the whole print taken off; * is more than 3 sigma, of a "
        "face that moved."
    )
    return Table("How the faces lie", tuple(columns), tuple(rows), note, visible_rows=20)


def rings_table(record: AsBuiltRecord, target: TargetGeometry | None) -> Table | None:
    """How the rings lie on their faces, those off most first; None if rings were held rigid."""
    if record.ring_sigma_mm is None:
        return None
    size = np.linalg.norm(record.ring_offset_mm, axis=1)
    size[~record.ring_is_seen] = np.nan
    order = np.argsort(-np.nan_to_num(size, nan=-1.0), kind="stable")
    order = order[np.isfinite(size[order])][:MOST_RINGS]
    total = None if target is None else deviations_of(record, target).size_mm
    columns = [
        Column("ring"), *((Column("face"), Column("i, j", is_number=False)) if target is not None else ()),
        *(Column(f"offset {axis} [mm]") for axis in "xyz"), Column("off by [mm]", note="its own offset"),
        *((Column("with its face [mm]", note="offset, bow and motion of the face"),) if target is not None else ()),
    ]  # fmt: skip
    rows = [_ring_row(record, ring, float(size[ring]), target, total) for ring in order.tolist()]
    known = int(np.isfinite(size).sum())
    more = f" The {MOST_RINGS} that are off most of {known}." if known > MOST_RINGS else ""
    note = f"Their own offsets in the axes of their face, z outwards; bow and motion of the face taken off.{more}"
    return Table("How the rings lie on their faces", tuple(columns), tuple(rows), note)


def _ring_row(
    record: AsBuiltRecord, ring: int, size: float, target: TargetGeometry | None, total: np.ndarray | None
) -> tuple[Cell, ...]:
    cells = [Cell(str(ring), ring)]
    if target is not None:
        face = int(target.ring_face[ring])
        i, j = target.ring_index[ring].tolist()
        cells += [Cell(str(face), face), Cell(f"{i}, {j}")]
    cells += [
        estimate_cell(
            Estimate(float(record.ring_offset_mm[ring, axis]), float(record.ring_offset_sigma_mm[ring, axis]))
        )
        for axis in range(3)
    ]
    cells.append(Cell(figure(size, 3), size))
    if total is not None:
        cells.append(Cell(figure(float(total[ring]), 3), float(total[ring])))
    return tuple(cells)


def cameras_table(record: AsBuiltRecord) -> Table:
    """The cameras that were solved beside the target."""
    columns = (
        Column("camera"), Column("model", is_number=False), Column("photos"), Column("sightings"), Column("left out"),
        Column("rms [px]"),
    )  # fmt: skip
    rows = tuple(
        (Cell(str(number), number), Cell(one.model), Cell(str(one.views), one.views),
         Cell(str(one.observations), one.observations), Cell(str(one.left_out), one.left_out),
         Cell("-") if one.rms_px is None else Cell(figure(one.rms_px, 3), one.rms_px))
        for number, one in enumerate(record.cameras, start=1)
    )  # fmt: skip
    return Table("Cameras, solved together with the target", columns, rows)


def lengths_table(record: AsBuiltRecord) -> Table | None:
    """The lengths that were given; None if there were none."""
    if not record.lengths:
        return None
    rows = tuple(
        (Cell(one.name), Cell(f"{one.value_mm:g} ± {one.sigma_mm:g}", one.value_mm),
         Cell("-") if one.left_over_sigma is None else Cell(f"{one.left_over_sigma:+.1f}", one.left_over_sigma))
        for one in record.lengths
    )  # fmt: skip
    columns = (Column("length", is_number=False), Column("measured [mm]"), Column("left over [sigma]"))
    return Table("Lengths by caliper", columns, rows)
