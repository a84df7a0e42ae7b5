"""Tables of a rig, for its page and for the terminal: cameras, pairs, what each hangs on, halves of the frames.

What moved the target or the cameras of a rig: a robot or a turntable, as the photos show it.

Who shares how many frames: cameras on a circle, and a line between two that saw the target together.

How far each pose of a camera on a robot is off what all of them say.
"""

import math
from collections.abc import Sequence
from itertools import combinations
from typing import TYPE_CHECKING

import numpy as np

from calib.draw.run_tables import focal_length
from calib.draw.style import BLUE, GREY, INK, PALE, VERMILION, AxesDrawing, log_axis, open_axes, svg_panel
from calib.judge.folders import RigRun
from calib.judge.halves import RigHalves
from calib.judge.next_robot_poses import gain_words, photo_names
from calib.judge.verdict import NextPose
from calib.observe.rotations import to_quaternion
from calib.rigs.figures import PairFigures
from calib.rigs.pose_pairs import FAR, PairsSolution
from calib.rigs.relative import center_covariance, worst
from calib.rigs.result import MechanismFit, RigCalibration
from designer.base.arrays import Array, Rows
from designer.base.words import capital, cut, printable
from designer.base.words import figure as digits
from designer.page.blocks import Block, Cell, Column, Facts, Figure, Finding, Findings, Section, Table
from designer.page.folders import number, whole, with_sigma
from designer.page.pictures import drawing_of_svg

if TYPE_CHECKING:
    from matplotlib.axes import Axes

ALONG = 0.9
"""Of a unit vector, along one axis beyond which it is said to lie along that alone."""
SHIFTS = ("sideways", "up and down", "along its axis")
TURNS = ("up and down", "left and right", "about its axis")


def cameras_table(run: RigRun) -> Table:
    """A row a camera: its lens, what it leaves over, in how many frames it saw the target, how late it is."""
    told, evidence = run.stated, run.evidence
    has_delays = told.delay_s is not None
    columns = [
        Column("camera", is_number=False),
        Column("model", is_number=False),
        Column("focal length px", note="along u, in the middle of the image, with its standard deviation"),
        Column("residual px", note="root mean square length, of the sightings that count"),
        Column("x stated noise", note="what is left over, in standard deviations that the detector states"),
        Column("frames", note="in which it sees the target"),
        Column("sightings", note="that count"),
        Column("left out"),
    ]
    if has_delays:
        columns.append(Column("delay ms", note="by which its time stamps run behind, with its standard deviation"))
    rows = []
    for row, one in enumerate(evidence.cameras):
        alone = told.alone[row]
        value = float(alone.camera.params[0])
        focal = focal_length(alone) if told.is_refined[row] else f"{digits(value, 6)} (given)"
        cells = [
            Cell(printable(one.name)), Cell(alone.camera.model), Cell(focal, value), number(one.rms_px),
            number(math.nan if one.times_stated is None else one.times_stated), whole(one.frames),
            whole(one.sightings), whole(one.left_out),
        ]  # fmt: skip
        if told.delay_s is not None:
            sigma = math.nan if told.delay_sigma_s is None else 1e3 * float(told.delay_sigma_s[row])
            cells.append(with_sigma(1e3 * float(told.delay_s[row]), sigma))
        rows.append(tuple(cells))
    return Table("Cameras", tuple(columns), tuple(rows))


def pairs_table(pairs: Sequence[PairFigures]) -> Table:
    """A row a pair: how they stand to each other, and what they leave over together."""
    columns = (
        Column("cameras", is_number=False),
        Column("distance mm", note="of their centres, with its standard deviation"),
        Column("angle °", note="by which one is turned against the other, with its standard deviation"),
        Column("frames", note="in which both see the target"),
        Column("points", note="that both see in one frame, over all frames"),
        Column("residual px", note="of both, in the frames that both see; root mean square length"),
        Column(
            "epipolar px",
            note="root mean square distance of a point from where the other camera's ray leads; noise alone gives "
            "about 1.4 times the noise of a coordinate, more where the other camera is sharper; empty where no point "
            "is seen by both, and of cameras with delays, which saw a moving target in two places",
        ),
    )
    rows = []
    for pair in pairs:
        one = pair.relative
        angle = with_sigma(math.degrees(one.angle_rad), math.degrees(one.angle_sigma_rad))
        rows.append((
            Cell(" - ".join(map(printable, pair.names))), with_sigma(one.baseline_mm, one.baseline_sigma_mm), angle,
            whole(pair.frames), whole(pair.points), number(pair.rms_px), number(pair.epipolar_px),
        ))  # fmt: skip
    return Table("Pairs of cameras", columns, tuple(rows), visible_rows=20)


def ties_table(run: RigRun) -> Table:
    """A row a camera: the other that it is best known to, and the direction that is least known."""
    names = tuple(map(printable, run.evidence.names))
    columns = (
        Column("camera", is_number=False),
        Column("hangs on", is_number=False, note="the camera that it is best known to"),
        Column("frames", note="in the weakest link of the best chain to any other camera"),
        Column("place mm", note="standard deviation along the least known direction, as that camera sees it"),
        Column("least known", is_number=False, note="that direction, in the camera's own image"),
        Column("turn mrad", note="standard deviation about the least known axis"),
        Column("least known turn", is_number=False),
    )
    rows = tuple(
        (
            Cell(names[tie.camera]), Cell(names[tie.partner]), whole(tie.joining_frames), number(tie.place_sigma_mm, 2),
            Cell(direction_words(tie.place_axis, SHIFTS)), number(1e3 * tie.turn_sigma_rad, 2),
            Cell(direction_words(tie.turn_axis, TURNS)),
        )
        for tie in run.evidence.ties
    )  # fmt: skip
    return Table("What each camera hangs on", columns, rows)


def places_table(run: RigRun) -> Table:
    """A row a camera: where its centre is in the rig's frame, and how surely."""
    told = run.stated
    rig = told.rig
    columns = (
        Column("camera", is_number=False),
        *(Column(f"{axis} mm", note="of its centre in the rig's frame, with its standard deviation") for axis in "xyz"),
        Column("turn mrad", note="standard deviation about the least known axis"),
    )
    rows = []
    for row, name in enumerate(rig.names):
        pose = rig.cam_from_rig[row]
        covariance = told.stated_covariance[rig.pose_rows(row), rig.pose_rows(row)]
        spread = pose[:3, :3].T @ center_covariance(pose, covariance) @ pose[:3, :3]
        sigma = np.sqrt(np.diagonal(spread).clip(min=0.0)).tolist()
        centre = (rig.center_mm[row] + 0.0).tolist()  # no minus zero
        cells = [with_sigma(*pair) for pair in zip(centre, sigma, strict=True)]
        turn = 1e3 * worst(covariance[:3, :3])[0]
        rows.append((Cell(printable(name)), *cells, number(turn, 2) if turn else Cell("")))
    return Table(f"Places in the frame of {printable(frame_name(told))}", columns, tuple(rows))


def halves_table(halves: RigHalves) -> Table:
    """A row a way of halving the frames."""
    has_pairs = any(split.pairs for split in halves.splits)
    columns = [
        Column("halves", is_number=False),
        Column("ratio", note="of the difference of the cameras' poses to what their standard deviations let expect"),
        Column("x residuals", note="what the halves leave over, in what all frames together leave over"),
    ]
    if has_pairs:
        note = "of the cameras, with the standard deviation stated for it"
        columns += [Column("largest change of a distance mm", note=note), Column("of", is_number=False)]
    rows = []
    for split in halves.splits:
        cells = [Cell("alike, by turns" if split.kind == "by turns" else "the first against the last frames")]
        cells += [number(split.ratio, 2), number(split.noise, 2)]
        most = max(split.pairs, key=lambda pair: abs(pair.baseline_mm) / max(pair.sigma_mm, 1e-12), default=None)
        if has_pairs:
            cells.append(Cell("") if most is None else with_sigma(most.baseline_mm, most.sigma_mm))
            cells.append(Cell("" if most is None else " - ".join(map(printable, most.names))))
        rows.append(tuple(cells))
    return Table("Rigs from halves of the frames", tuple(columns), tuple(rows))


def frame_name(found: RigCalibration) -> str:
    """Whose frame the rig's is: a camera's name, or "flange", "base", "table"."""
    return found.rig_frame or found.observations.camera_names[max(found.reference, 0)]


def direction_words(axis: Array, words: tuple[str, str, str]) -> str:
    """A direction in a camera's axes: one of three words, or two of them."""
    if not np.isfinite(axis).all():
        return ""
    order = np.argsort(-np.abs(axis))
    first = words[int(order[0])]
    return first if abs(float(axis[order[0]])) >= ALONG else f"{first} and {words[int(order[1])]}"


MOST_ROWS = 12
"""Frames that are shown, the worst."""


def mechanism_section(carrier: MechanismFit, found: RigCalibration) -> Section:
    """Its own errors, frame by frame, and what its motions do not tell."""
    rows: list[tuple[str, str]] = [("carried by", printable(carrier.kind))]
    if math.isfinite(carrier.sigma_mm) and math.isfinite(carrier.sigma_rad):
        rows.append((
            "its own errors", f"{digits(carrier.sigma_mm, 2)} mm and {digits(1e3 * carrier.sigma_rad, 2)} mrad, "
            "the standard deviations of a coordinate"
        ))  # fmt: skip
    if carrier.size_sigma > 0:
        size = f"{100 * carrier.size:.2f} +- {digits(100 * carrier.size_sigma, 2)} % of what its file says"
        rows.append(("the target's size", f"{size}, by the robot's ways"))
    if found.slack is not None:
        less = math.sqrt(1 + found.slack)
        rows.append((
            "photos", f"each tells its pose {digits(less, 2)} times less surely than the noise of its sightings alone "
            "would let it: errors that all of a photo share"
        ))  # fmt: skip
    blocks: list[Block] = [Facts(tuple(rows))]
    if carrier.undetermined:
        findings = (Finding("usable", "Not determined", capital(printable(line))) for line in carrier.undetermined)
        blocks.append(Findings(tuple(findings)))
    blocks.append(_errors_table(carrier, found.observations.frame_names))
    lead = "Where the photos show it, against what it said of itself; one adjustment of all sightings."
    return Section("What carries", tuple(blocks), lead=lead)


def next_poses_table(poses: Sequence[NextPose]) -> Table:
    """What to tell the robot: a row a pose, as in `next_poses.csv`."""
    columns = (
        Column("pose", is_number=False, note="as the photo from there is to be called"),
        *(Column(f"{axis} mm", note="of the flange in the base") for axis in "xyz"),
        *(Column(f"q{axis}") for axis in "xyzw"),
        Column("direction deg", note="of the camera, its standard deviation with this pose and those above"),
        Column("place mm", note="likewise"),
    )
    rows = tuple(
        (
            Cell(name),
            *(Cell(f"{value + 0.0:.2f}", value) for value in one.base_from_flange[:3, 3].tolist()),
            *(Cell(f"{value + 0.0:.5f}", value) for value in to_quaternion(one.base_from_flange[:3, :3]).tolist()),
            number(math.degrees(one.turn_sigma_rad_after), 2),
            number(one.place_sigma_mm_after, 2),
        )
        for name, one in zip(photo_names(poses), poses, strict=True)
    )
    return Table("The robot's next poses, base_from_flange", columns, rows)


def next_poses_words(poses: Sequence[NextPose]) -> str:
    """What all of them together would give."""
    first, last = poses[0], poses[-1]
    turn = gain_words(math.degrees(first.turn_sigma_rad_before), math.degrees(last.turn_sigma_rad_after), "deg")
    place = gain_words(first.place_sigma_mm_before, last.place_sigma_mm_after, "mm")
    count = "1 more, in" if len(poses) == 1 else f"{len(poses)} more, in"
    return f"{count} next_poses.csv: the camera's direction, 1 sigma, {turn}, its place {place}"


def _errors_table(carrier: MechanismFit, names: tuple[str, ...]) -> Table:
    """The frames in which it is farthest off, by its own standard deviations."""
    turn, shift = (np.linalg.norm(part, axis=1) for part in (carrier.error[:, :3], carrier.error[:, 3:]))
    known = carrier.sigma_rad > 0 and carrier.sigma_mm > 0
    off = np.hypot(turn / carrier.sigma_rad, shift / carrier.sigma_mm) / math.sqrt(6) if known else turn
    columns = (
        Column("frame", is_number=False), Column("shift mm"), Column("turn mrad"),
        Column("x its own errors", note="root mean square of the six coordinates, in their standard deviations"),
    )  # fmt: skip
    order = np.argsort(-np.nan_to_num(off, nan=-1.0), kind="stable")[:MOST_ROWS].tolist()
    rows = tuple(
        (
            Cell(printable(names[row])), number(float(shift[row])), number(1e3 * float(turn[row])),
            number(float(off[row]) if known else math.nan, 2),
        )
        for row in order
    )  # fmt: skip
    return Table(f"The {len(rows)} frames that are farthest off", columns, rows)


MOST_NUMBERED = 5
"""Cameras, of more of which the lines have no numbers: they would cover each other."""
LONGEST_NAME = 14
WIDEST, THINNEST = 7.0, 0.8
"""Of lines, in points."""
HEIGHT_IN = 4.7


def sharing_figure(names: tuple[str, ...], shared: Rows) -> Figure:
    """The graph of a rig, and what it shows in words.

    Args:
        names: of the cameras (C,).
        shared: in how many frames two see the target together, on the diagonal at all (C, C).
    """
    image = drawing_of_svg(svg_panel(lambda axes: _draw_sharing(axes, names, shared), height_in=HEIGHT_IN))
    return Figure("Frames that two cameras share", image, sharing_words(names, shared), _caption(len(names)))


def sharing_words(names: tuple[str, ...], shared: Rows) -> str:
    """Who shares most and who least, as a sentence."""
    pairs = [(int(shared[a, b]), a, b) for a, b in combinations(range(len(names)), 2)]
    joined = [pair for pair in pairs if pair[0]]
    if not joined:
        return "No two cameras see the target in one frame."
    (least, a, b), (most, c, d) = min(joined), max(joined)
    none = len(pairs) - len(joined)
    apart = f"; {none} of {len(pairs)} pairs share none" if none else ""
    if least == most:
        return f"Each pair that shares frames shares {most}{apart}."
    few, many = (f"{printable(names[x])} and {printable(names[y])}" for x, y in ((a, b), (c, d)))
    return f"{many} share most frames, {most}; {few} fewest, {least}{apart}."


def _caption(count: int) -> str:
    numbers = "the number beside it" if count <= MOST_NUMBERED else "the table of pairs has the numbers"
    return f"A line is as thick as the frames that both see: {numbers}. Under a name: the frames that this camera sees."


def _draw_sharing(axes: "Axes", names: tuple[str, ...], shared: Rows) -> None:
    """Nodes, lines and numbers."""
    start = np.pi if len(names) == 2 else np.pi / 2
    angle = start - 2 * np.pi * np.arange(len(names)) / len(names)
    place = np.stack([np.cos(angle), np.sin(angle)], axis=1)
    pairs = list(combinations(range(len(names)), 2))
    most = max((int(shared[a, b]) for a, b in pairs), default=1) or 1
    for line, (a, b) in enumerate(pairs):
        count = int(shared[a, b])
        if not count:
            continue
        width = THINNEST + (WIDEST - THINNEST) * count / most
        axes.plot(*place[[a, b]].T, color=BLUE, linewidth=width, alpha=0.45, solid_capstyle="round", zorder=1)
        if len(names) <= MOST_NUMBERED:
            share = 0.5 if len(names) < 4 else 0.35 + 0.05 * (line % 2)  # where lines cross, numbers would, too
            x, y = ((1 - share) * place[a] + share * place[b]).tolist()
            box = {"boxstyle": "round,pad=0.15", "facecolor": PALE, "edgecolor": "none"}
            axes.text(x, y, str(count), ha="center", va="center", fontsize=11, color=INK, bbox=box, zorder=2)
    axes.scatter(place[:, 0], place[:, 1], s=420, color=BLUE, zorder=3)
    for row, (x, y) in enumerate(place.tolist()):
        axes.text(x, y, str(row + 1), ha="center", va="center", color=PALE, fontsize=11, zorder=4)
        side = "center" if abs(x) < 0.3 else "left" if x > 0 else "right"
        text = f"{cut(printable(names[row]), LONGEST_NAME)}\n{int(shared[row, row])}"
        axes.text(1.14 * x, 1.25 * y, text, ha=side, va="center", fontsize=11, color=GREY, zorder=4)
    axes.set_xlim(-1.75, 1.75)
    axes.set_ylim(-1.45, 1.45)
    axes.set_aspect("equal")
    axes.set_axis_off()


LEAST = 0.1
"""What is less is drawn there."""


def pose_errors_drawing(found: PairsSolution) -> AxesDrawing:
    """Weighed lengths of the poses' errors, in their order; those left out are marked."""
    counts = np.isfinite(found.off) & ~found.is_off
    out = int(found.is_off.sum())
    words = (
        f"Of {int(counts.sum())} poses the worst is {digits(float(found.off[counts].max()), 2)} standard deviations off"
    )
    more = f"; {out} {'is' if out == 1 else 'are'} left out" if out else ""
    return AxesDrawing("How well the poses fit", words + more, lambda axes: _draw_pose_errors(axes, found))


def _draw_pose_errors(axes: "Axes", found: PairsSolution) -> None:
    from matplotlib.ticker import MaxNLocator

    number = np.arange(1, len(found.off) + 1)
    for rows, colour, name in ((~found.is_off, BLUE, "count"), (found.is_off, VERMILION, "left out")):
        if rows.any():
            axes.plot(number[rows], found.off[rows].clip(LEAST), "o", color=colour, label=name, markersize=6)
    axes.axhline(np.sqrt(FAR), color=GREY, linestyle="--", linewidth=1.5)
    axes.set_yscale("log")
    log_axis(axes.yaxis)
    axes.xaxis.set_major_locator(MaxNLocator(integer=True))
    axes.legend(loc="upper left")
    open_axes(axes, "pose, in the order of the file", "error, standard deviations")
