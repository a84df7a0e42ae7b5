"""A measured target as a picture: where faces and rings came out, and what that is worth."""

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from calib.as_built.deviations import Verdict, bent_mm
from calib.core.number_text import figure as digits
from calib.core.se3 import exp_rotation
from calib.figures.style import EMPTY, GREY, INK, VERMILION, WIDTH_PX, note, picture, round_length
from calib.records.as_built_file import AsBuiltRecord
from calib.show.measured.scene import nice
from designer.target import TargetGeometry

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.cm import ScalarMappable
    from matplotlib.figure import Figure
    from matplotlib.image import AxesImage

Array = NDArray[np.float64]

DIVERGING = "RdBu_r"
SLIDE_PART = 0.18
"""What the corner that moved most moves in the picture, of the face's size."""
RING_ARROW = 0.6
"""The root mean square arrow of a ring, of the distance between rings."""
TITLE_PX = 60
GRID = 40
"""Places along the sides of a face whose colour is computed."""
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
    face_mm: float  # size of the largest face
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
        middle, (low + high) / 2, (columns * cell[0], rows * cell[1]), face,
        KEY * height if count > 1 else 0.1 * height,
        (-0.36 * face, 0.26 * face) if has_room else (0.0, (height + gap) / 2), has_room,
    )  # fmt: skip


def report_picture(record: AsBuiltRecord, nominal: TargetGeometry) -> bytes:
    """The picture of a measured target, as PNG."""
    layout = layout_of(nominal)
    width, height = layout.size_mm
    panel_px = float(np.clip(0.9 * WIDTH_PX * height / width, LEAST_FACES_PX, MOST_FACES_PX)) + 110
    panels = [_draw_faces] if record.face_verdict else []
    if nominal.is_planar or not _are_rigid(record):
        panels.append(_draw_rings)

    def draw(page: "Figure") -> None:
        # Parts of the page that are laid out one by one: their texts never meet.
        parts = page.subfigures(len(panels), 1, squeeze=False)
        for part, draw_panel in zip(parts[:, 0], panels, strict=True):
            draw_panel(part.subplots(), record, nominal, layout)
        views, known = sum(one.views for one in record.cameras), int(record.face_is_determined.sum())
        faces = f", {known} of {nominal.face_count} faces known" if record.face_verdict else ""
        page.suptitle(
            f"The target as it was printed, from {views} photos{faces} ({record.status})", fontsize=16,
            fontweight="bold", x=0.01, ha="left",
        )  # fmt: skip

    return picture(round(TITLE_PX + len(panels) * panel_px), draw)


def _are_rigid(record: AsBuiltRecord) -> bool:
    """Whether rings were held where they were designed on flat faces."""
    return record.ring_sigma_mm is None and not record.face_bow_mm.any()


def _map_axes(axes: "Axes", layout: Layout, title: str) -> None:
    """Axes that hold all faces in their own frames, in mm."""
    axes.set_aspect("equal", anchor="W")
    axes.set_axis_off()
    axes.set_title(title)
    width, height = layout.size_mm
    axes.set_xlim(-0.01 * width, 1.01 * width)
    axes.set_ylim(-height - 0.01 * width, layout.key_mm)


def _draw_faces(axes: "Axes", record: AsBuiltRecord, target: TargetGeometry, layout: Layout) -> None:
    """How faces lie: colour along the normal, a dashed outline and an arrow in the plane."""
    _map_axes(axes, layout, "How each face lies, seen from outside")
    motion, is_known = record.motion, np.array([verdict != "not known" for verdict in record.face_verdict])
    height = _height_mm(motion[:, None], target.outline_mm)
    limit = nice(float(np.abs(height[is_known]).max(initial=0.0)))
    slide = _slide_mm(motion[is_known], target.outline_mm[is_known])
    times = round_length(SLIDE_PART * layout.face_mm / slide) if slide > 0 else 1.0
    shown = None
    for face, verdict in enumerate(record.face_verdict):
        corners = layout.placed(face, target.outline_mm[face])
        axes.plot(*_closed(corners).T, color=GREY, linewidth=0.8)
        if not is_known[face]:
            _unknown(axes, layout, face, corners)
            continue
        shown = _height_map(axes, layout, face, target.outline_mm[face], motion[face], limit)
        turn = exp_rotation(np.array([0.0, 0.0, times * motion[face, 5]]))[:2, :2]
        moved = layout.placed(face, target.outline_mm[face] @ turn.T + times * motion[face, :2])
        axes.plot(*_closed(moved).T, color=INK, linewidth=1.2, linestyle="--", clip_on=False)
        _name(axes, layout, face, face_label(face, verdict))
    note(
        axes,
        "colour: out (red) or in (blue), with the tilt; "
        f"dashed: shift and turn in the plane, drawn {times:g} times as large; "
        "hatched: not known",
    )
    if slide > 0:
        _key(axes, layout, times, slide)
    if shown is not None:
        _bar(axes, shown)


def _draw_rings(axes: "Axes", record: AsBuiltRecord, target: TargetGeometry, layout: Layout) -> None:
    """How rings lie on their faces: arrows in the plane, colour along the normal."""
    several = not target.is_planar
    title = "How rings lie on their faces, the faces' own motion taken off" if several else "How rings lie on the board"
    _map_axes(axes, layout, title)
    for face, known in enumerate(record.face_is_determined.tolist()):
        corners = layout.placed(face, target.outline_mm[face])
        axes.plot(*_closed(corners).T, color=GREY, linewidth=0.8)
        if not known:
            _unknown(axes, layout, face, corners)
        elif several:
            _name(axes, layout, face, str(face))
    rings = np.flatnonzero(record.ring_is_seen & record.face_is_determined[target.ring_face])
    if _are_rigid(record) or not len(rings):
        note(axes, "rings were held where they were designed" if len(rings) else "no ring was seen on a known face")
        return
    offset_mm = bent_mm(target, record.ring_offset_mm, record.face_bow_mm)[rings]
    place = np.concatenate([
        layout.placed(int(target.ring_face[ring]), target.center_in_face_mm[ring, None, :2]) for ring in rings
    ])  # fmt: skip
    length = np.hypot(*offset_mm[:, :2].T)
    long = float(np.sqrt((length**2).mean()))
    pitch = float(np.linalg.norm(target.lattice_mm, axis=2).mean())
    times = round_length(RING_ARROW * pitch / long) if long > 0 else 1.0
    limit = nice(float(np.percentile(np.abs(offset_mm[:, 2]), LONG_PERCENT)))
    size = (0.35 * pitch * 0.9 * WIDTH_PX * 0.72 / layout.size_mm[0]) ** 2
    shown = axes.scatter(
        place[:, 0], place[:, 1], c=offset_mm[:, 2], cmap=DIVERGING, vmin=-limit, vmax=limit, s=size,
        edgecolors=GREY, linewidths=0.4,
    )  # fmt: skip
    arrows = axes.quiver(
        *place.T, *(times * offset_mm[:, :2]).T, angles="xy", scale_units="xy", scale=1, width=0.001, color=INK,
        headwidth=4, headlength=4, headaxislength=3.5, minlength=0, clip_on=False,
    )  # fmt: skip
    arrows.set_in_layout(False)  # they may leave the axes, which stay as they are
    sigma_mm = float(np.median(record.ring_offset_sigma_mm[rings]))
    note(
        axes,
        f"arrows: in the plane, drawn {times:g} times as large; colour: out (red) or in (blue), bow included; "
        f"known to {digits(sigma_mm, 2)} mm (median sigma); rings without a dot were not seen",
    )
    if long > 0:
        _key(axes, layout, times, long)
    _bar(axes, shown, longer=True)


def _bar(axes: "Axes", shown: "ScalarMappable", *, longer: bool = False) -> None:
    """The scale of colours, beside the faces."""
    bar = axes.figure.colorbar(
        shown, ax=axes, fraction=0.03, pad=0.01, aspect=30, extend="both" if longer else "neither"
    )
    bar.set_label("along the normal, outwards, in mm")


def _height_mm(motion: Array, place_mm: Array) -> Array:
    """How far places (..., 2) of a face come out along its normal by its motion (..., 6)."""
    height: Array = motion[..., 2] + motion[..., 3] * place_mm[..., 1] - motion[..., 4] * place_mm[..., 0]
    return height


def _height_map(axes: "Axes", layout: Layout, face: int, outline_mm: Array, value: Array, limit: float) -> "AxesImage":
    """A face coloured by how far each place of it came out."""
    from matplotlib.patches import Polygon

    low, high = outline_mm.min(axis=0), outline_mm.max(axis=0)
    x, y = np.meshgrid(*(np.linspace(a, b, GRID) for a, b in zip(low, high, strict=True)))
    (left, bottom), (right, top) = layout.placed(face, np.array([low, high])).tolist()
    height = _height_mm(value, np.stack([x, y], axis=-1))
    shown = axes.imshow(
        height, cmap=DIVERGING, vmin=-limit, vmax=limit, extent=(left, right, bottom, top), origin="lower",
        interpolation="bilinear",
    )  # fmt: skip
    shown.set_clip_path(Polygon(layout.placed(face, outline_mm).tolist(), transform=axes.transData))
    return shown


def _slide_mm(value: Array, outline_mm: Array) -> float:
    """How far the corner that moved most moved in the plane of its face."""
    across = np.stack([-value[:, 5:6] * outline_mm[:, :, 1], value[:, 5:6] * outline_mm[:, :, 0]], axis=2)
    return float(np.linalg.norm(value[:, None, :2] + across, axis=2).max(initial=0.0))


def _closed(corners: Array) -> Array:
    return np.vstack([corners, corners[:1]])


def _unknown(axes: "Axes", layout: Layout, face: int, corners: Array) -> None:
    """A face of which photos tell nothing."""
    axes.fill(*corners.T, facecolor=EMPTY, edgecolor=GREY, hatch="///", linewidth=0.8)
    _name(axes, layout, face, face_label(face, "not known"))


def face_label(face: int, verdict: Verdict) -> str:
    """A face's number and its verdict; that it moved is drawn."""
    return str(face) if verdict == "moved" else f"{face}\n{verdict}"


def _name(axes: "Axes", layout: Layout, face: int, text: str) -> None:
    x, y = layout.label_mm(face)
    axes.text(
        x,
        y,
        text if layout.has_room_inside else text.replace("\n", ": "),
        fontsize=11,
        ha="center",
        va="center",
        color=INK,
    )


def _key(axes: "Axes", layout: Layout, times: float, longest_mm: float) -> None:
    """An arrow that shows the scale."""
    length = round_length(longest_mm)
    y = 0.5 * layout.key_mm
    axes.annotate(
        "", (times * length, y), (0.0, y),
        arrowprops={"arrowstyle": "-|>", "color": VERMILION, "linewidth": 2.0, "shrinkA": 0, "shrinkB": 0},
    )  # fmt: skip
    axes.text(times * length + 0.1 * layout.key_mm, y, f"  {length:g} mm", fontsize=12, va="center", color=VERMILION)
