"""The tables of a measured print: faces, rings, cameras, and what is gained."""

import math

import numpy as np

from calib.draw.measured_scene import datum_words
from calib.draw.print_errors import is_plastic, told
from calib.draw.seats import seats_table
from calib.measure_target.cross_validation import Gain
from calib.measure_target.deviations import FREE_PARAMETERS, Estimate
from calib.measure_target.record import AsBuiltRecord, SolvedCamera, deviations_of
from designer.base.number_text import figure
from designer.page.blocks import Cell, Column, Level, Table
from designer.page.folders import Shown, table_of
from designer.target import TargetGeometry

MOST_RINGS = 2000
"""In the table of rings, those that are off most."""
LEVEL_OF_VERDICT: dict[str, Level] = {"moved": "usable", "as designed": "good"}
LEVEL_OF_BETTER: dict[bool | None, Level] = {True: "good", False: "usable", None: "note"}


def axes_words(target: TargetGeometry) -> str:
    """What the axes of a print are."""
    if not is_plastic(target):
        return "Axes are the print's: x along its longer side."
    return (
        f"Axes are the bed's with the target as design lays it: face {target.face_count - 1} down, the longer side "
        "along x; give --bed-turn if it was turned."
    )


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


def rings_table(record: AsBuiltRecord, target: TargetGeometry) -> Table | None:
    """How the rings lie on their faces, those off most first; None if rings were held rigid."""
    if record.ring_sigma_mm is None:
        return None
    size = np.linalg.norm(record.ring_offset_mm, axis=1)
    size[~record.ring_is_seen] = np.nan
    order = np.argsort(-np.nan_to_num(size, nan=-1.0), kind="stable")
    order = order[np.isfinite(size[order])]
    total = deviations_of(record, target).size_mm

    def offset(axis: int) -> Shown[int]:
        return Shown[int](
            f"offset {'xyz'[axis]} [mm]",
            lambda ring: _estimate(
                Estimate(float(record.ring_offset_mm[ring, axis]), float(record.ring_offset_sigma_mm[ring, axis]))
            ),
        )

    more = f" The {MOST_RINGS} that are off most of {len(order)}." if len(order) > MOST_RINGS else ""
    return table_of(
        order[:MOST_RINGS].tolist(),
        Shown[int]("ring", int),
        Shown[int]("face", lambda ring: int(target.ring_face[ring])),
        Shown[int]("i, j", lambda ring: ", ".join(map(str, target.ring_index[ring].tolist()))),
        *map(offset, range(3)),
        Shown[int]("off by [mm]", lambda ring: float(size[ring]), "its own offset", 3),
        Shown[int]("with its face [mm]", lambda ring: float(total[ring]), "offset, bow and motion of the face", 3),
        title="How the rings lie on their faces",
        note="Their own offsets in the axes of their face, z outwards; bow and motion of the face taken off."
        f"{more}{datum_words(record)}",
    )  # fmt: skip


def cameras_table(record: AsBuiltRecord) -> Table:
    """The cameras that were solved beside the target."""
    kind = Shown[tuple[int, SolvedCamera]]
    return table_of(
        enumerate(record.cameras, start=1),
        kind("camera", lambda row: row[0]),
        kind("model", lambda row: row[1].model),
        kind("photos", lambda row: row[1].views),
        kind("observations", lambda row: row[1].observations),
        kind("left out", lambda row: row[1].left_out),
        kind("RMS residual [px]", lambda row: row[1].rms_px, digits=3),
        title="Cameras, solved together with the target",
    )


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
