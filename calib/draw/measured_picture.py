"""A measured target as a picture: where faces and rings came out, and what that is worth.

The tables of a measured print: faces, rings, cameras, and what is gained.
"""

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from calib.draw.measured_scene import datum_words
from calib.draw.print_errors import is_plastic, seats_table, told
from calib.draw.style import EMPTY, GREY, INK, VERMILION, WIDTH_PX, nice, note, picture, round_length
from calib.measure_target.cross_validation import Gain
from calib.measure_target.deviations import FREE_PARAMETERS, Estimate, Verdict, bent_mm
from calib.measure_target.record import AsBuiltRecord, SolvedCamera, deviations_of
from designer.base.arrays import Array
from designer.base.words import figure
from designer.page.blocks import Cell, Column, Level, Table
from designer.page.folders import Shown, table_of
from designer.target import TargetGeometry

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

DIVERGING = "RdBu_r"
RING_ARROW = 0.6
"""The root mean square arrow of a ring, of the distance between rings."""
TITLE_PX = 60
MOST_FACES_PX, LEAST_FACES_PX = 1100.0, 300.0
LONG_PERCENT = 98
GAP = 0.12
"""Between faces, of a face's size."""
KEY = 0.2
"""Room above the faces for a scale, of a face's height."""
WIDE = 1.6
"""The width of the whole over its height, about."""


@dataclass(frozen=True, eq=False)
class Layout:
    """Faces in rows, x to the right and y up, in mm; the first row begins at y = 0 and goes down."""

    middle_mm: Array  # (F, 2) where the middle of a face's outline lies
    face_middle_mm: Array  # (F, 2) the same in the face's frame
    size_mm: tuple[float, float]
    key_mm: float  # room above them
    label_from_middle_mm: tuple[float, float]
    has_room_inside: bool  # for labels of two lines, left of a face's top

    def placed(self, face: int, point_mm: Array) -> Array:
        """Points (N, 2) of a face's frame in the picture."""
        placed: Array = point_mm - self.face_middle_mm[face] + self.middle_mm[face]
        return placed

    def label_mm(self, face: int) -> tuple[float, float]:
        """Where a face's name stands: left of its top, or above it."""
        x, y = self.middle_mm[face].tolist()
        return x + self.label_from_middle_mm[0], y + self.label_from_middle_mm[1]


def layout_of(target: TargetGeometry) -> Layout:
    """The faces in rows."""
    low, high = target.outline_mm.min(axis=1), target.outline_mm.max(axis=1)
    width, height = (high - low).max(axis=0).tolist()
    gap = GAP * max(width, height) if not target.is_planar else 0.0
    cell = np.array([width + gap, height + gap])
    count = target.face_count
    about = max(1, round(math.sqrt(count * WIDE * cell[1] / cell[0])))
    columns = min(range(max(1, about - 1), about + 2), key=lambda columns: (-count % columns, abs(columns - about)))
    columns = min(columns, count)
    rows = math.ceil(count / columns)
    place = np.arange(count)
    middle = np.column_stack([(place % columns + 0.5) * cell[0], -(place // columns + 0.5) * cell[1]])
    face = max(width, height)
    upper_left = np.stack([low[:, 0], high[:, 1]], axis=1)
    has_room = bool((np.linalg.norm(target.outline_mm - upper_left[:, None], axis=2).min(axis=1) > 0.2 * face).all())
    return Layout(
        middle, (low + high) / 2, (columns * cell[0], rows * cell[1]),
        KEY * height if count > 1 else 0.1 * height,
        (-0.36 * face, 0.26 * face) if has_room else (0.0, (height + gap) / 2), has_room,
    )  # fmt: skip


def report_picture(record: AsBuiltRecord, target: TargetGeometry) -> bytes:
    """The picture of a target as it was printed, as PNG."""
    layout = layout_of(target)
    width, height = layout.size_mm
    panel_px = float(np.clip(0.9 * WIDTH_PX * height / width, LEAST_FACES_PX, MOST_FACES_PX)) + 110
    came_out = deviations_of(record, target).in_face_mm
    own = bent_mm(target, record.ring_offset_mm, record.face_bow_mm)
    own[~np.isfinite(came_out).all(axis=1)] = np.nan
    word = target.feature_word
    if target.is_planar:
        maps = [(f"How {word} lie on the board", own)]
    else:
        against = "" if record.seats is None else f", against the {record.seats.piece}s that sit well"
        maps = [(f"How {word} came out, with their faces{against}", came_out)]
        if own[np.isfinite(own)].any():
            maps.append((f"How {word} lie on their faces, the faces' own motion taken off", own))

    def draw(page: "Figure") -> None:
        # Parts of the page that are laid out one by one: their texts never meet.
        parts = page.subfigures(len(maps), 1, squeeze=False)
        for part, (title, moved_mm) in zip(parts[:, 0], maps, strict=True):
            _draw_map(part.subplots(), title, moved_mm, record, target, layout)
        views, known = sum(one.views for one in record.cameras), int(record.face_is_determined.sum())
        faces = f", {known} of {target.face_count} faces known" if record.face_verdict else ""
        page.suptitle(
            f"The target as it was printed, from {views} photos{faces} ({record.status})", fontsize=16,
            fontweight="bold", x=0.01, ha="left",
        )  # fmt: skip

    return picture(round(TITLE_PX + len(maps) * panel_px), draw)


def _draw_map(
    axes: "Axes", title: str, moved_mm: Array, record: AsBuiltRecord, target: TargetGeometry, layout: Layout
) -> None:
    """All faces in their own frames, their rings with arrows in the plane and colours along the normal.

    Args:
        axes: to draw on.
        title: what is shown.
        moved_mm: how far each ring is off, in its face's axes; nan: not known.  # (R, 3)
        record: what was measured.
        target: the outlines of its faces and the places of its rings.
        layout: where the faces stand.
    """
    axes.set_aspect("equal", anchor="W")
    axes.set_axis_off()
    axes.set_title(title)
    width, height = layout.size_mm
    axes.set_xlim(-0.01 * width, 1.01 * width)
    axes.set_ylim(-height - 0.01 * width, layout.key_mm)
    for face, is_known in enumerate(record.face_is_determined.tolist()):
        corners = layout.placed(face, target.outline_mm[face])
        axes.fill(
            *corners.T, facecolor="none" if is_known else EMPTY, hatch="" if is_known else "///", edgecolor=GREY,
            linewidth=0.8,
        )  # fmt: skip
        if record.face_verdict:
            x, y = layout.label_mm(face)
            text = face_label(face, record.face_verdict[face])
            text = text if layout.has_room_inside else text.replace("\n", ": ")
            axes.text(x, y, text, fontsize=11, ha="center", va="center", color=INK)
    (rings,) = np.nonzero(np.isfinite(moved_mm).all(axis=1))
    if not len(rings) or not moved_mm[rings].any():
        word = target.feature_word
        held = f"{word} were held where they were designed"
        note(axes, held if len(rings) else f"no {word[:-1]} was seen on a known face")
        return
    place = np.concatenate(
        [layout.placed(int(target.ring_face[ring]), target.center_in_face_mm[ring, None, :2]) for ring in rings]
    )
    in_plane, along_normal = moved_mm[rings, :2], moved_mm[rings, 2]
    long_mm = float(np.sqrt((in_plane**2).sum(axis=1).mean()))
    pitch = float(np.linalg.norm(target.lattice_mm, axis=2).mean())
    times = round_length(RING_ARROW * pitch / long_mm) if long_mm > 0 else 1.0
    limit = nice(float(np.percentile(np.abs(along_normal), LONG_PERCENT)))
    size = (0.35 * pitch * 0.9 * WIDTH_PX * 0.72 / layout.size_mm[0]) ** 2
    shown = axes.scatter(
        place[:, 0], place[:, 1], c=along_normal, cmap=DIVERGING, vmin=-limit, vmax=limit, s=size, edgecolors=GREY,
        linewidths=0.4,
    )  # fmt: skip
    arrows = axes.quiver(
        *place.T, *(times * in_plane).T, angles="xy", scale_units="xy", scale=1, width=0.001, color=INK,
        headwidth=4, headlength=4, headaxislength=3.5, minlength=0, clip_on=False,
    )  # fmt: skip
    arrows.set_in_layout(False)  # they may leave the axes, which stay as they are
    note(
        axes,
        f"arrows: in the plane, drawn {times:g} times as large; colour: out (red) or in (blue), bow included; "
        f"{target.feature_word} without a dot were not seen; hatched: not known",
    )
    if long_mm > 0:
        _key(axes, layout, times, long_mm)
    bar = axes.figure.colorbar(shown, ax=axes, fraction=0.03, pad=0.01, aspect=30, extend="both")
    bar.set_label("along the normal, outwards, in mm")


def face_label(face: int, verdict: Verdict) -> str:
    """A face's number and its verdict; that it moved is drawn."""
    return str(face) if verdict == "moved" else f"{face}\n{verdict}"


def _key(axes: "Axes", layout: Layout, times: float, longest_mm: float) -> None:
    """An arrow that shows the scale."""
    length = round_length(longest_mm)
    y = 0.5 * layout.key_mm
    axes.annotate(
        "", (times * length, y), (0.0, y),
        arrowprops={"arrowstyle": "-|>", "color": VERMILION, "linewidth": 2.0, "shrinkA": 0, "shrinkB": 0},
    )  # fmt: skip
    axes.text(times * length + 0.1 * layout.key_mm, y, f"  {length:g} mm", fontsize=12, va="center", color=VERMILION)


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
        Shown[int](target.feature_word[:-1], int),
        Shown[int]("face", lambda ring: int(target.ring_face[ring])),
        Shown[int]("i, j", lambda ring: ", ".join(map(str, target.ring_index[ring].tolist()))),
        *map(offset, range(3)),
        Shown[int]("off by [mm]", lambda ring: float(size[ring]), "its own offset", 3),
        Shown[int]("with its face [mm]", lambda ring: float(total[ring]), "offset, bow and motion of the face", 3),
        title=f"How the {target.feature_word} lie on their faces",
        note="Their own offsets in the axes of their face, z outwards; bow and motion of the face taken off."
        f"{more}{datum_words(record)}",
    )


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
