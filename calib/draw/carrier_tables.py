"""What moved the target or the cameras of a rig: a robot or a turntable, as the photos show it."""

import math
from collections.abc import Sequence

import numpy as np

from calib.judge.next_robot_poses import NextPose, gain_words, photo_names
from calib.observe.rotations import to_quaternion
from calib.rigs.result import CarrierFit, RigCalibration
from designer.base.number_text import figure as digits
from designer.base.words import capital, printable
from designer.page.blocks import Block, Cell, Column, Facts, Finding, Findings, Section, Table
from designer.page.folders import number

MOST_ROWS = 12
"""Frames that are shown, the worst."""


def carrier_section(carrier: CarrierFit, found: RigCalibration) -> Section:
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
            number(math.degrees(one.turn_sigma_rad_after), 2), number(one.place_sigma_mm_after, 2),
        )
        for name, one in zip(photo_names(poses), poses, strict=True)
    )  # fmt: skip
    return Table("The robot's next poses, base_from_flange", columns, rows)


def next_poses_words(poses: Sequence[NextPose]) -> str:
    """What all of them together would give."""
    first, last = poses[0], poses[-1]
    turn = gain_words(math.degrees(first.turn_sigma_rad_before), math.degrees(last.turn_sigma_rad_after), "deg")
    place = gain_words(first.place_sigma_mm_before, last.place_sigma_mm_after, "mm")
    count = "1 more, in" if len(poses) == 1 else f"{len(poses)} more, in"
    return f"{count} next_poses.csv: the camera's direction, 1 sigma, {turn}, its place {place}"


def _errors_table(carrier: CarrierFit, names: tuple[str, ...]) -> Table:
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
