"""What was found in each photo, as a table."""

from collections.abc import Sequence

import numpy as np

from calib.api.searching import Search
from calib.core.types import NOT_MEASURABLE, Detections
from calib.observe.records import common_remarks
from designer.page.blocks import Cell, Column, Table

MAX_ROWS = 60
"""Photos in the table; of a larger set only those are shown that need a look."""


def photo_table(search: Search) -> Table:
    """A row a photo that was searched: faces, features found of those that could be measured, their sigma, remarks."""
    seen = search.detections
    common = common_remarks([one.remarks for one in seen])
    rows = seen if len(seen) <= MAX_ROWS else [one for one in seen if one.remarks or not len(one.ring)][:MAX_ROWS]
    is_solid = not search.target.is_planar
    columns = [Column("image", is_number=False), *([Column("faces", is_number=False)] if is_solid else [])]
    columns += [Column("found"), Column("sigma px"), Column("remark", is_number=False)]
    notes = [f"all images: {remark}" for remark in common]
    if len(rows) < len(seen):
        notes.append(f"{len(seen) - len(rows)} more images: their counts are in the records")
    cells = tuple(_row(one, common, is_solid=is_solid) for one in rows)
    return Table("", tuple(columns), cells, note="; ".join(notes))


def _row(one: Detections, common: Sequence[str], *, is_solid: bool) -> tuple[Cell, ...]:
    named = sorted(record.face for record in one.faces if record.face is not None)
    faces = (Cell(" ".join(map(str, named))),) if is_solid else ()
    is_found = bool(len(one.ring))
    found = Cell(f"{len(one.ring)}/{expected_features(one)}") if is_found else Cell("none", level="bad")
    remarks = "; ".join(remark for remark in remarks_on(one) if remark not in common)
    return (Cell(one.image), *faces, found, Cell(f"{median_sigma_px(one):.4f}" if is_found else ""), Cell(remarks))


def remarks_on(one: Detections) -> tuple[str, ...]:
    """What to know of an image, and why rings of seen faces are missing that could have been measured."""
    lost = (f"{count} {why}" for why, count in missing_of(one).items() if count and why not in NOT_MEASURABLE)
    return (*one.remarks, *lost)


def missing_of(one: Detections) -> dict[str, int]:
    """How many features of named faces are missing, by reason."""
    missing: dict[str, int] = {}
    for record in one.faces:
        for reason, count in record.missing if record.face is not None else ():
            missing[reason] = missing.get(reason, 0) + count
    return missing


def expected_features(one: Detections) -> int:
    """How many features of the named faces could have been measured."""
    return sum(record.measurable for record in one.faces if record.face is not None)


def median_sigma_px(one: Detections) -> float:
    """Median of the centres' standard deviations, along their worse axis; nan without centres."""
    if not len(one.ring):
        return np.nan
    return float(np.median(np.sqrt(np.linalg.eigvalsh(one.cov_px2)[:, 1])))
