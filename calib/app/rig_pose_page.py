"""What `calib pose --rig` tells: where the target is in the rig's frame, how surely, what each camera leaves over."""

import math
from collections.abc import Mapping
from typing import TYPE_CHECKING

import numpy as np

from calib.app.pose_page import WORDS
from calib.draw.gallery import STANDS_OUT, shortened
from calib.observe.photos import PhotoResult
from calib.rigs.rig_poses_file import CameraResidual, RigPoseResult, RigTargetPose
from calib.show.parts.kept_target import target_words
from calib.show.photos.photos_file import SHARE_RULE, ToldPhoto, ToldPhotos, ToldSection, level_of_share, worst_level
from designer.base.words import figure as digits
from designer.base.words import printable, with_digits
from designer.page.blocks import Cell, Column, Finding, Findings, Headline, Level, Table
from designer.page.folders import number, some_of, whole

if TYPE_CHECKING:
    from calib.app.pose import TargetPoses

GOOD_EXCESS, USABLE_EXCESS = 1.5, 3.0
"""Residuals in what noise and the rig's own errors let expect, in the median frame. What exceeds them is no error that
a covariance holds: a camera that was moved, photos that were not taken at once, another target."""
CLOCKS = "The rig's cameras are not synchronous: the target must stand still in each frame."
COLUMNS = (
    Column("frame", is_number=False),
    Column("rings"),
    Column("RMS px", note="of the distances between measured and predicted centres, of all cameras' one pose"),
    Column("remark", is_number=False),
)
POSE_COLUMNS = (
    Column("frame", is_number=False),
    Column("cameras", note="that show the target"),
    Column("rings"),
    Column("RMS px", note="of the distances between measured and predicted centres"),
    *(Column(f"{axis} mm", note="of the target's origin in the rig's frame, with its standard deviation")
      for axis in "xyz"),
    Column("σ place mm", note="root mean square length of the error, by noise and by the rig's own errors"),
    Column("by noise mm", note="its part by the noise of the centres alone"),
    Column("σ turn °", note="standard deviation of the rotation about its least sure axis"),
    Column("excess", note="residuals in what noise and rig let expect, beyond chance; sigmas are as much larger"),
)  # fmt: skip


def told_before_rig(made: "TargetPoses", found: RigPoseResult) -> ToldPhotos:
    """What is to be said of frames in which poses were searched."""
    rows = _checks(found)
    frames = {(one.camera, one.image): (pose.frame, one) for pose in found.poses for one in pose.cameras}
    without = [*found.failures, *(f"{one.frame}: {shortened(one.reason)}" for one in found.without_pose)]
    return ToldPhotos(
        "photos", _headline(found, rows), _facts(made, found), COLUMNS,
        tuple(
            _photo(name, result, frames.get((name, result.photo.name)), made.overlays, found.usual_px)
            for name, one in zip(found.photos.camera_names, found.searches, strict=True)
            for result in one.results
        ),
        "The photos with the largest residuals first.", (), lead=_camera_words(found),
        notes=(
            *((Finding("note", "Clocks", CLOCKS),) if found.rig.delay_s is not None else ()),
            *(Finding("usable", "No pose", line) for line in some_of(without)),
        ),
        table_note=f"Marked: residuals more than {STANDS_OUT:g} times the usual frame's.",
        before=(
            ToldSection("Can the poses be used?", (Findings(rows),), "The headline is the worst of these."),
            *((ToldSection("The target in the rig's frame", (poses_table(found),)),) if found.poses else ()),
        ),
        geometry_id=found.target.geometry_id,
    )  # fmt: skip


def poses_table(found: RigPoseResult) -> Table:
    """A row a frame."""
    frame = found.rig.rig_frame or found.rig.names[0]
    return Table(f"In the frame of {printable(frame)}", POSE_COLUMNS, tuple(map(_row, found.poses)))


def _row(pose: RigTargetPose) -> tuple[Cell, ...]:
    place = zip(pose.target_mm.tolist(), pose.target_sigma_mm.tolist(), strict=True)
    return (
        Cell(printable(pose.frame)), whole(len(pose.cameras)), whole(pose.rings), number(pose.rms_px),
        *(Cell(f"{with_digits(value, sigma)} ± {digits(sigma, 2)}", value) for value, sigma in place),
        number(pose.sigma_mm, 2), number(pose.noise_sigma_mm, 2), number(math.degrees(pose.rotation_sigma_rad), 2),
        number(pose.excess, 2),
    )  # fmt: skip


def _checks(found: RigPoseResult) -> tuple[Finding, ...]:
    """How many frames have a pose, how well the rig explains them, and whether its own errors are known."""
    count, total = len(found.poses), len(found.poses) + len(found.without_pose)
    rows = [Finding(
        level_of_share(count / total), "Frames with a pose", "The others are listed with the reason.",
        f"{count} of {total}", SHARE_RULE,
    )]  # fmt: skip
    if found.poses:
        excess = float(np.median([pose.excess for pose in found.poses]))
        fit: Level = "good" if excess <= GOOD_EXCESS else "usable" if excess <= USABLE_EXCESS else "bad"
        rows.append(Finding(
            fit, "Residuals", "Of the median frame, in what the noise and the rig's own errors let expect; more is a "
            "camera that was moved, photos that were not taken at once, or a print that is not its file.",
            f"{digits(excess, 2)} x", f"good up to {GOOD_EXCESS:g}, usable up to {USABLE_EXCESS:g}",
        ))  # fmt: skip
    if found.rig.covariance is None:
        rows.append(Finding(
            "usable", "The rig's own errors", "Its file does not tell them: sigmas are by the noise alone.",
            "not known", "known of rigs that calib rig solved",
        ))  # fmt: skip
    return tuple(rows)


def _headline(found: RigPoseResult, rows: tuple[Finding, ...]) -> Headline:
    count, total = len(found.poses), len(found.poses) + len(found.without_pose)
    if not count:
        return Headline("bad", "no pose", f"None of {total} frame{'s' * (total != 1)} gives a pose.")
    level = worst_level(rows)
    sigma = float(np.median([pose.sigma_mm for pose in found.poses]))
    noise = float(np.median([pose.noise_sigma_mm for pose in found.poses]))
    of_rig = "" if found.rig.covariance is None else f" ({digits(noise, 2)} mm by noise alone)"
    sentence = (
        f"{count} of {total} frame{'s' * (total != 1)} give{'s' * (total == 1)} a pose in the rig's frame; the target "
        f"is placed to {digits(sigma, 2)} mm{of_rig} in the usual frame."
    )
    return Headline(level, WORDS[level], sentence)


def _facts(made: "TargetPoses", found: RigPoseResult) -> tuple[tuple[str, str], ...]:
    return (
        ("target", f"{made.target_named} ({target_words(found.target)})"),
        ("rig", f"{made.taken_by} ({len(found.rig.names)} cameras)"),
        ("photos", f"{len(found.photos.photos)}, by {len(found.photos.camera_names)} cameras"),
        ("written to", "nowhere: add -o poses.json" if made.place is None else str(made.place)),
    )


def _camera_words(found: RigPoseResult) -> str:
    """What each camera leaves over."""
    if not found.poses:
        return ""
    words = []
    for name in found.photos.camera_names:
        own = [one.rms_px for pose in found.poses for one in pose.cameras if one.camera == name and one.rings]
        words.append(f"{printable(name)} {digits(float(np.median(own)), 2)} px" if own else f"{printable(name)} none")
    return f"RMS residuals in the usual frame, camera by camera: {', '.join(words)}."


def _photo(
    camera: str, result: PhotoResult, found: tuple[str, CameraResidual] | None,
    overlays: Mapping[tuple[str, str], str], usual_px: float,
) -> ToldPhoto:  # fmt: skip
    name = f"{camera}/{result.photo.name}"
    remark = shortened("; ".join(() if result.seen is None else result.seen.remarks) or result.failure)
    if found is None:
        rings = 0 if result.seen is None else len(result.seen.ring)
        unread: Level | None = "bad" if result.seen is None else None  # that one camera misses the target is ordinary
        return ToldPhoto(name, (Cell(""), whole(rings), Cell(""), Cell(remark or "no pose")), "", remark, unread)
    frame, one = found
    level: Level | None = "usable" if one.rms_px > STANDS_OUT * usual_px else None
    cells = (Cell(printable(frame)), whole(one.rings), number(one.rms_px), Cell(remark))
    caption = f"{one.rings} rings, RMS {digits(one.rms_px, 2)} px"
    badness = one.rms_px if math.isfinite(one.rms_px) else None
    return ToldPhoto(name, cells, overlays.get((camera, result.photo.name), ""), caption, level, badness)
