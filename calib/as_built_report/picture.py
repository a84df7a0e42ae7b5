"""A measured target as a picture: where faces and rings came out, and what that is worth."""

from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from calib.as_built_report.deviations import Verdict
from calib.as_built_report.files import MeasureReport
from calib.as_built_report.held_out import Gain
from calib.as_built_report.layout import Layout, layout_of
from calib.as_built_report.words import degrees, percent, spread_mm
from calib.core.number_text import figure as digits
from calib.figures.style import (
    BLUE,
    EMPTY,
    GREY,
    INK,
    VERMILION,
    WIDTH_PX,
    note,
    nothing,
    picture,
    round_length,
)

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.cm import ScalarMappable
    from matplotlib.figure import Figure, SubFigure
    from matplotlib.image import AxesImage

Array = NDArray[np.float64]

DIVERGING = "RdBu_r"
SLIDE_PART = 0.18
"""What the corner that moved most moves in the picture, of the face's size."""
RING_ARROW = 0.6
"""The root mean square arrow of a ring, of the distance between rings."""
SECOND_COLUMN_POINTS, LINE_POINTS = 165, 23
HEADER_PX = 440
GRID = 40
"""Places along the sides of a face whose colour is computed."""
MOST_FACES_PX, LEAST_FACES_PX = 1100.0, 300.0
LONG_PERCENT = 98


def report_picture(report: MeasureReport) -> bytes:
    """The picture of a measured target, as PNG."""
    layout = layout_of(report.found.nominal)
    panel = _panel_px(layout)
    panels = sum(shown is not None for shown in (report.faces, report.rings))
    return picture(round(HEADER_PX + panels * panel), lambda page: _draw(page, report, layout, panel))


def _panel_px(layout: Layout) -> float:
    width, height = layout.size_mm
    return float(np.clip(0.9 * WIDTH_PX * height / width, LEAST_FACES_PX, MOST_FACES_PX)) + 110


def _draw(page: "Figure", report: MeasureReport, layout: Layout, panel_px: float) -> None:
    panels = [draw for draw, shown in ((_draw_faces, report.faces), (_draw_rings, report.rings)) if shown is not None]
    # Parts of the page that are laid out one by one: their texts never meet.
    parts = page.subfigures(1 + len(panels), 1, squeeze=False, height_ratios=[HEADER_PX, *[panel_px] * len(panels)])
    _draw_header(parts[0, 0], report)
    for part, draw in zip(parts[1:, 0], panels, strict=True):
        draw(part.subplots(), report, layout)
    known = int(report.found.is_determined.sum())
    faces = f", {known} of {report.found.nominal.face_count} faces known" if report.faces is not None else ""
    views = sum(seen.view_count for seen in report.found.observations)
    page.suptitle(
        f"The target as it was printed, from {views} photos{faces} ({report.found.status})", fontsize=16,
        fontweight="bold", x=0.01, ha="left",
    )  # fmt: skip


def _draw_header(part: "SubFigure", report: MeasureReport) -> None:
    """The whole print in words, and what is gained on photos held out."""
    held = report.held_out
    gains = () if held is None else (*held.gains, *held.against_truth)
    beside = max(len(gains), 1)
    axes = part.subplots(1, 1 + beside, gridspec_kw={"width_ratios": [2.9, *[1] * beside]})
    _write_whole(axes[0], report)
    if held is None:
        axes[1].set_title("Gain")
        nothing(axes[1], "no photos were held out")
        axes[1].set_frame_on(False)
    for column, gain in enumerate(gains):
        _draw_gain(axes[column + 1], gain, is_true=held is not None and column >= len(held.gains))
    if gains:
        axes[1].set_ylabel("RMSE of photos held out")


def _write_whole(axes: "Axes", report: MeasureReport) -> None:
    """Size, axes and skew."""
    axes.set_axis_off()
    axes.set_title("The whole print, along the bed's axes")
    whole = report.whole
    lines = [("size, + is too large", "not known: give a --length" if whole.size is None else percent(whole.size))]
    lines += [(f"axis {name} beyond that", percent(one)) for name, one in whole.axes]
    lines += [(f"skew {name}", degrees(one)) for name, one in whole.skews]
    if report.found.ring_sigma_mm is not None:
        plane, normal = map(spread_mm, report.found.ring_sigma_mm)
        lines += [("rings, in plane", f"{plane} (1 sigma)"), ("rings, normal to it", f"{normal} (1 sigma)")]
    for row, (name, text) in enumerate(lines):
        for column_points, words in ((0, name), (SECOND_COLUMN_POINTS, text)):
            axes.annotate(
                words, (0, 1), (column_points, -LINE_POINTS * (row + 0.5)), xycoords="axes fraction",
                textcoords="offset points", fontsize=13, va="center",
            )  # fmt: skip


def _draw_gain(axes: "Axes", gain: Gain, *, is_true: bool) -> None:
    """Two bars: with the nominal and with the measured target."""
    against = "against the truth\n" if is_true else ""
    axes.set_title(f"{gain.metric}, {gain.unit}\n{against}{gain.factor:.1f} times less", fontsize=12)
    for x, (value, colour) in enumerate(((gain.nominal, GREY), (gain.measured, BLUE))):
        axes.bar(x, value, width=0.7, color=colour)
        axes.text(x, value, digits(value, 2), ha="center", va="bottom", fontsize=11)
    axes.set_xticks([0, 1], ["as\ndesigned", "as\nmeasured"])
    axes.set_yticks([])
    axes.set_ylim(0, 1.15 * max(gain.nominal, gain.measured, 1e-12))
    for side in ("top", "right", "left"):
        axes.spines[side].set_visible(False)


def _map_axes(axes: "Axes", layout: Layout, title: str) -> None:
    """Axes that hold all faces in their own frames, in mm."""
    axes.set_aspect("equal", anchor="W")
    axes.set_axis_off()
    axes.set_title(title)
    width, height = layout.size_mm
    axes.set_xlim(-0.01 * width, 1.01 * width)
    axes.set_ylim(-height - 0.01 * width, layout.key_mm)


def _draw_faces(axes: "Axes", report: MeasureReport, layout: Layout) -> None:
    """How faces lie: colour along the normal, a dashed outline and an arrow in the plane."""
    faces, target = report.faces, report.found.nominal
    _map_axes(axes, layout, "How each face lies, seen from outside")
    if faces is None:
        return
    known = np.array([verdict != "not known" for verdict in faces.verdict])
    height = _heights_mm(faces.value, target.outline_mm)
    limit = round_up(float(np.abs(height[known]).max(initial=0.0)))
    slide = _slide_mm(faces.value[known], target.outline_mm[known])
    times = round_length(SLIDE_PART * layout.face_mm / slide) if slide > 0 else 1.0
    shown = None
    for face, verdict in enumerate(faces.verdict):
        corners = layout.placed(face, target.outline_mm[face])
        _outline(axes, corners)
        if verdict == "not known":
            _unknown(axes, layout, face, corners)
            continue
        shown = _height_map(axes, layout, face, target.outline_mm[face], faces.value[face], limit)
        x, y, turn = faces.value[face, 0], faces.value[face, 1], faces.value[face, 5]
        moved = target.outline_mm[face] @ _turned(times * turn).T + times * np.array([x, y])
        axes.plot(*_closed(layout.placed(face, moved)).T, color=INK, linewidth=1.2, linestyle="--", clip_on=False)
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


def _draw_rings(axes: "Axes", report: MeasureReport, layout: Layout) -> None:
    """How rings lie on their faces: arrows in the plane, colour along the normal."""
    rings, target = report.rings, report.found.nominal
    several = not target.is_planar
    title = "How rings lie on their faces, the faces' own motion taken off" if several else "How rings lie on the board"
    _map_axes(axes, layout, title)
    if rings is None:
        return
    for face, known in enumerate(report.found.is_determined.tolist()):
        corners = layout.placed(face, target.outline_mm[face])
        _outline(axes, corners)
        if not known:
            _unknown(axes, layout, face, corners)
        elif several:
            _name(axes, layout, face, str(face))
    if not len(rings.seen):
        return
    place = np.concatenate([
        layout.placed(int(target.ring_face[ring]), target.center_in_face_mm[ring, None, :2]) for ring in rings.seen
    ])  # fmt: skip
    length = np.hypot(*rings.offset_mm[:, :2].T)
    long = float(np.sqrt((length**2).mean()))
    pitch = float(np.linalg.norm(target.lattice_mm, axis=2).mean())
    times = round_length(RING_ARROW * pitch / long) if long > 0 else 1.0
    limit = round_up(float(np.percentile(np.abs(rings.offset_mm[:, 2]), LONG_PERCENT)))
    size = (0.35 * pitch * 0.9 * WIDTH_PX * 0.72 / layout.size_mm[0]) ** 2
    shown = axes.scatter(
        place[:, 0], place[:, 1], c=rings.offset_mm[:, 2], cmap=DIVERGING, vmin=-limit, vmax=limit, s=size,
        edgecolors=GREY, linewidths=0.4,
    )  # fmt: skip
    arrows = axes.quiver(
        *place.T, *(times * rings.offset_mm[:, :2]).T, angles="xy", scale_units="xy", scale=1, width=0.001, color=INK,
        headwidth=4, headlength=4, headaxislength=3.5, minlength=0, clip_on=False,
    )  # fmt: skip
    arrows.set_in_layout(False)  # they may leave the axes, which stay as they are
    sigma = float(np.median(rings.sigma_mm))
    note(
        axes,
        f"arrows: in the plane, drawn {times:g} times as large; colour: out (red) or in (blue), bow included; "
        f"known to {digits(sigma, 2)} mm (median sigma); rings without a dot were not seen",
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


def _heights_mm(value: Array, outline_mm: Array) -> Array:
    """How far the corners (F, K, 2) came out along the normal: `shift z + tilt x y - tilt y x`.  # (F, K)"""
    height: Array = value[:, 2:3] + value[:, 3:4] * outline_mm[:, :, 1] - value[:, 4:5] * outline_mm[:, :, 0]
    return height


def round_up(limit: float) -> float:
    """The end of a scale of colours: the next of 1, 2 and 5 times a power of ten."""
    if not limit > 0:
        return 1e-3
    power = 10.0 ** np.floor(np.log10(limit))
    return float(next(step * power for step in (1, 2, 5, 10) if step * power >= limit * (1 - 1e-9)))


def _height_map(axes: "Axes", layout: Layout, face: int, outline_mm: Array, value: Array, limit: float) -> "AxesImage":
    """A face coloured by how far each place of it came out."""
    from matplotlib.patches import Polygon

    low, high = outline_mm.min(axis=0), outline_mm.max(axis=0)
    x, y = np.meshgrid(*(np.linspace(a, b, GRID) for a, b in zip(low, high, strict=True)))
    height = value[2] + value[3] * y - value[4] * x
    (left, bottom), (right, top) = layout.placed(face, np.array([low, high])).tolist()
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


def _turned(angle_rad: float) -> Array:
    cos, sin = np.cos(angle_rad), np.sin(angle_rad)
    return np.array([[cos, -sin], [sin, cos]])


def _closed(corners: Array) -> Array:
    return np.vstack([corners, corners[:1]])


def _outline(axes: "Axes", corners: Array) -> None:
    axes.plot(*_closed(corners).T, color=GREY, linewidth=0.8)


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
