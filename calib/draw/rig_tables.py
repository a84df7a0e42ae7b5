"""Tables of a rig, for its page and for the terminal: cameras, pairs, what each hangs on, halves of the frames."""

import math
from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from calib.draw.run_tables import focal_length
from calib.judge.rig_folder import RigRun
from calib.rigs.camera_alone import camera_alone
from calib.rigs.figures import PairFigures
from calib.rigs.halves import RigHalves, enlarged
from calib.rigs.relative import center_covariance, worst
from calib.rigs.result import RigCalibration
from designer.base.number_text import figure as digits
from designer.base.number_text import with_digits
from designer.base.words import printable
from designer.page.blocks import Cell, Column, Table
from designer.page.folders import number, whole

Array = NDArray[np.float64]

ALONG = 0.9
"""Of a unit vector, along one axis beyond which it is said to lie along that alone."""
SHIFTS = ("sideways", "up and down", "along its axis")
TURNS = ("up and down", "left and right", "about its axis")


def cameras_table(run: RigRun) -> Table:
    """A row a camera: its lens, what it leaves over, in how many frames it saw the target, how late it is."""
    told, evidence = enlarged(run.found, run.evidence.halves), run.evidence
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
        alone = camera_alone(told, row)
        value = float(alone.camera.params[0])
        focal = focal_length(alone) if told.is_refined[row] else f"{digits(value, 6)} (given)"
        cells = [
            Cell(printable(one.name)), Cell(alone.camera.model), Cell(focal, value), number(one.rms_px),
            number(math.nan if one.times_stated is None else one.times_stated), whole(one.frames),
            whole(one.sightings), whole(one.left_out),
        ]  # fmt: skip
        if told.delay_s is not None:
            sigma = math.nan if told.delay_sigma_s is None else 1e3 * float(told.delay_sigma_s[row])
            cells.append(_with_sigma(1e3 * float(told.delay_s[row]), sigma))
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
        angle = _with_sigma(math.degrees(one.angle_rad), math.degrees(one.angle_sigma_rad))
        rows.append((
            Cell(" - ".join(map(printable, pair.names))), _with_sigma(one.baseline_mm, one.baseline_sigma_mm), angle,
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
    told = enlarged(run.found, run.evidence.halves)
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
        cells = [_with_sigma(*pair) for pair in zip(centre, sigma, strict=True)]
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
            cells.append(Cell("") if most is None else _with_sigma(most.baseline_mm, most.sigma_mm))
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


def _with_sigma(value: float, sigma: float) -> Cell:
    """A value with its standard deviation; without one, where none is known."""
    if not math.isfinite(sigma) or sigma == 0:
        return number(value, 5)
    return Cell(f"{with_digits(value, sigma)} ± {digits(sigma, 2)}", value)
