"""A measured target as a picture: where faces and rings came out, and what that is worth."""

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from calib.draw.measured_scene import nice
from calib.draw.style import EMPTY, GREY, INK, VERMILION, WIDTH_PX, note, picture, round_length
from calib.measure_target.deviations import Verdict, bent_mm
from calib.measure_target.record import AsBuiltRecord, deviations_of
from designer.base.arrays import Array
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
    if target.is_planar:
        maps = [("How rings lie on the board", own)]
    else:
        against = "" if record.seats is None else f", against the {record.seats.piece}s that sit well"
        maps = [(f"How rings came out, with their faces{against}", came_out)]
        if own[np.isfinite(own)].any():
            maps.append(("How rings lie on their faces, the faces' own motion taken off", own))

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
        note(axes, "rings were held where they were designed" if len(rings) else "no ring was seen on a known face")
        return
    place = np.concatenate([
        layout.placed(int(target.ring_face[ring]), target.center_in_face_mm[ring, None, :2]) for ring in rings
    ])  # fmt: skip
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
        f"arrows: in the plane, drawn {times:g} times as large; colour: out (red) or in (blue), bow included; rings "
        "without a dot were not seen; hatched: not known",
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
