"""What `calib pose` tells: where the camera or the target was, how surely, and how large the residuals are."""

import math
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass
from functools import partial
from statistics import median
from typing import TYPE_CHECKING

import numpy as np

from calib.draw.camera_scene import distance_words, place_view, place_words
from calib.draw.gallery import SHARE_RULE, STANDS_OUT, Shot, gallery, is_there, level_of_share, shortened
from calib.observe.dataset import common_remarks
from calib.observe.target_poses import PoseResult
from designer.base.words import figure as digits
from designer.base.words import printable, with_digits
from designer.page.blocks import (
    WORDS,
    Cell,
    Command,
    Facts,
    Finding,
    Findings,
    Headline,
    Level,
    Page,
    Section,
    Table,
    level_of,
    worst_level,
)
from designer.page.folders import Shown, some_of, table_of, with_sigma

if TYPE_CHECKING:
    from calib.app.pose import TargetPoses
    from calib.observe.target_poses import TargetPose
    from calib.rigs.target_poses import RigPoseResult, RigTargetPose

GOOD_RMS_PX, USABLE_RMS_PX = 0.5, 2.0
"""Of the residuals in the median photo. A ring's centre is good to a few hundredths of a pixel, so half a pixel is
lens or target: the pose is still fine for most uses. Two pixels are another focus, camera or print."""
GOOD_EXCESS, USABLE_EXCESS = 1.5, 3.0
"""Residuals in what noise and the rig's own errors let expect, in the median frame. What exceeds them is no error that
a covariance holds: a camera that was moved, photos that were not taken at once, another target."""
CLOCKS = "The rig's cameras are not synchronous: the target must stand still in each frame."
MEASURED = "of the distances between measured and predicted"
LEAST_SURE = "standard deviation of the rotation about its least sure axis"


@dataclass(frozen=True, eq=False)
class PosedPhoto:
    """A photo that was searched, with what is told of it."""

    name: str
    picture: str  # from the folder of the page; "": there is none
    rings: int
    rms_px: float  # nan: it has no pose
    remark: str
    level: Level | None = None  # None: like the others
    frame: str = ""  # of a rig
    pose: "TargetPose | None" = None  # of a camera alone

    @property
    def caption(self) -> str:
        """What stands below its picture."""
        away = "" if self.pose is None else f", {digits(self.pose.distance_mm)} mm away"
        return f"{self.rings} points, RMS {digits(self.rms_px, 2)} px{away}"


REMARK = Shown[PosedPhoto]("remark", lambda one: one.remark)


def poses_page(made: "TargetPoses") -> Page:
    """Whether the poses can be used, photo by photo, and where they are; with pictures where a folder holds them."""
    found = made.found
    return _of_camera(made, found) if isinstance(found, PoseResult) else _of_rig(made, found)


def _of_camera(made: "TargetPoses", found: PoseResult) -> Page:
    photos, total, usual_px = _photos(made, found), len(found.search.results), found.usual_px
    checks = [_share_check("Photos", len(found.poses), total)]
    if math.isfinite(usual_px):
        checks.append(Finding(
            level_of(usual_px, GOOD_RMS_PX, USABLE_RMS_PX), "Residuals", "Median over the photos of the RMS distance "
            "between measured and predicted points; more than the noise of a point is lens, focus or print.",
            f"{digits(usual_px, 2)} px", f"good up to {GOOD_RMS_PX:g} px, usable up to {USABLE_RMS_PX:g} px",
        ))  # fmt: skip
    poses = np.array([one.pose.cam_from_target for one in photos if one.pose is not None])
    sentence, lead, after, (width, height) = "", "", [], found.camera.image_size
    facts = [("camera", f"{made.taken_by} (model {found.camera.model}), {width} x {height} px"), ("photos", str(total))]
    if found.poses:
        sentence = (
            f", {distance_words(poses)} from the target's origin; the residuals are {digits(usual_px, 2)} px RMS in "
            "the usual photo"
        )
        least, most = (limit((pose.rms_px, pose.image) for pose in found.poses) for limit in (min, max))
        lead = (
            f"The RMS residuals of a photo are {digits(least[0], 2)} to {digits(most[0], 2)} px, largest in {most[1]}. "
            "Standard deviations hold if the camera file is exact and errors of the points are independent."
        )
        sigma_mm = np.array([pose.distance_sigma_mm for pose in found.poses])
        if np.isfinite(sigma_mm).all():
            facts.append(("sigma of the distance", f"{digits(float(np.median(sigma_mm)), 2)} mm in the usual photo"))
    if found.poses and made.folder is not None:
        names = tuple(f"{one.name}: {one.caption}" for one in photos if one.pose is not None)
        view = place_view(found.target, found.camera, poses, names)
        after.append(Section("Camera positions", (view,), lead=place_words(found.target, poses)))
    searched = {seen.image for seen in found.search.detections}
    without = (f"{one.image}: {shortened(one.reason)}" for one in found.without_pose if one.image in searched)
    said = (
        *(Finding("note", "All photos", shortened(remark)) for remark in _common(found)),
        *_without_pose([*found.search.failures, *without]), *_remarks(made, lead),
    )  # fmt: skip
    kind = Shown[PosedPhoto]
    table = table_of(
        photos, _name_column(made), kind("points", lambda one: one.rings),
        kind("RMS px", lambda one: one.rms_px, f"{MEASURED} centres", 3),
        *(kind(f"{axis} mm", partial(_place_cell, axis=row), "the camera in the target's frame")
          for row, axis in enumerate("xyz")),
        kind("σ place mm", lambda one: math.nan if one.pose is None else float(one.pose.camera_sigma_mm.max()),
             "standard deviation of the camera's place, the largest of x, y and z"),
        kind("distance mm", _distance_cell, "from the camera to the target's origin"),
        kind("σ distance mm", lambda one: math.nan if one.pose is None else one.pose.distance_sigma_mm,
             "standard deviation of the distance"),
        kind("σ turn °", lambda one: math.nan if one.pose is None else math.degrees(one.pose.rotation_sigma_rad),
             LEAST_SURE),
        REMARK, title="All photos",
        note=f"Marked: residuals more than {STANDS_OUT:g} times the usual photo's. Without numbers: no pose.",
    )  # fmt: skip
    headline = _headline(checks, "photo", len(found.poses), total, sentence)
    return _page(made, headline, facts, checks, (), said, photos, table, after)


def _photos(made: "TargetPoses", found: PoseResult) -> list[PosedPhoto]:
    poses = {one.image: one for one in found.poses}
    reasons = {one.image: one.reason for one in found.without_pose}
    common, photos = _common(found), list[PosedPhoto]()
    for result in found.search.results:
        name, seen = result.photo.name, result.seen
        pose, picture = poses.get(name), made.overlays.get(("", name), "")
        rings = 0 if seen is None else len(seen.ring)
        remarks = [] if seen is None else [remark for remark in seen.remarks if remark not in common]
        if pose is None:
            reason = reasons.get(name, "no pose")
            text = "; ".join([*remarks, reason] if rings else [reason])
            photos.append(PosedPhoto(name, picture, rings, math.nan, shortened(text), "bad"))
            continue
        if pose.rings < rings:
            remarks.append(f"{rings - pose.rings} more points lie where the camera knows no light")
        level: Level | None = "usable" if pose.rms_px > STANDS_OUT * found.usual_px else None
        text = shortened("; ".join(remarks))
        photos.append(PosedPhoto(name, picture, pose.rings, pose.rms_px, text, level, pose=pose))
    return photos


def _common(found: PoseResult) -> tuple[str, ...]:
    return common_remarks([seen.remarks for seen in found.search.detections])


def _place_cell(one: PosedPhoto, axis: int) -> Cell:
    if one.pose is None:
        return Cell("")
    value = float(one.pose.camera_mm[axis])
    return Cell(with_digits(value, float(one.pose.camera_sigma_mm[axis])), value)


def _distance_cell(one: PosedPhoto) -> Cell:
    if one.pose is None:
        return Cell("")
    return Cell(with_digits(one.pose.distance_mm, one.pose.distance_sigma_mm), one.pose.distance_mm)


def _of_rig(made: "TargetPoses", found: "RigPoseResult") -> Page:
    photos, total = _rig_photos(made, found), len(found.poses) + len(found.without_pose)
    checks = [_share_check("Frames", len(found.poses), total)]
    sentence, lead, before = "", "", []
    if found.poses:
        excess = median(pose.excess for pose in found.poses)
        checks.append(Finding(
            level_of(excess, GOOD_EXCESS, USABLE_EXCESS), "Residuals", "Of the median frame, in what the noise and the "
            "rig's own errors let expect; more is a camera that was moved, photos that were not taken at once, or a "
            "print that is not its file.",
            f"{digits(excess, 2)} x", f"good up to {GOOD_EXCESS:g}, usable up to {USABLE_EXCESS:g}",
        ))  # fmt: skip
        sigma, noise = (
            digits(median(each), 2) for each in zip(*((one.sigma_mm, one.noise_sigma_mm) for one in found.poses),
                                                    strict=True)
        )  # fmt: skip
        of_rig = "" if found.rig.covariance is None else f" ({noise} mm by noise alone)"
        sentence = f" in the rig's frame; the target is placed to {sigma} mm{of_rig} in the usual frame"
        lead = f"RMS residuals in the usual frame, camera by camera: {', '.join(_camera_words(found))}."
        before.append(Section("The target in the rig's frame", (poses_table(found),)))
    if found.rig.covariance is None:
        checks.append(Finding(
            "usable", "The rig's own errors", "Its file does not tell them: sigmas are by the noise alone.",
            "not known", "known of rigs that calib rig solved",
        ))  # fmt: skip
    said = (
        *((Finding("note", "Clocks", CLOCKS),) if found.rig.delay_s is not None else ()),
        *_without_pose([*found.failures, *(f"{one.frame}: {shortened(one.reason)}" for one in found.without_pose)]),
        *_remarks(made, lead),
    )  # fmt: skip
    kind = Shown[PosedPhoto]
    table = table_of(
        photos, _name_column(made), kind("frame", lambda one: one.frame), kind("points", lambda one: one.rings),
        kind("RMS px", lambda one: one.rms_px, f"{MEASURED} centres, of all cameras' one pose", 3), REMARK,
        title="All photos", note=f"Marked: residuals more than {STANDS_OUT:g} times the usual frame's.",
    )  # fmt: skip
    facts = [
        ("rig", f"{made.taken_by} ({len(found.rig.names)} cameras)"),
        ("photos", f"{len(found.photos.photos)}, by {len(found.photos.camera_names)} cameras"),
    ]
    headline = _headline(checks, "frame", len(found.poses), total, sentence)
    return _page(made, headline, facts, checks, before, said, photos, table, ())


def _rig_photos(made: "TargetPoses", found: "RigPoseResult") -> list[PosedPhoto]:
    frames = {(one.camera, one.image): (pose.frame, one) for pose in found.poses for one in pose.cameras}
    photos = []
    for camera, search in zip(found.photos.camera_names, found.searches, strict=True):
        for result in search.results:
            own, seen = (camera, result.photo.name), result.seen
            name, remark = "/".join(own), shortened("; ".join(() if seen is None else seen.remarks) or result.failure)
            if own in frames:
                frame, one = frames[own]
                level: Level | None = "usable" if one.rms_px > STANDS_OUT * found.usual_px else None
                picture = made.overlays.get(own, "")
                photos.append(PosedPhoto(name, picture, one.rings, one.rms_px, remark, level, frame))
                continue
            # That one camera misses the target is ordinary, that a photo cannot be read is not.
            rings, unread = 0 if seen is None else len(seen.ring), seen is None
            photos.append(PosedPhoto(name, "", rings, math.nan, remark or "no pose", "bad" if unread else None))
    return photos


def poses_table(found: "RigPoseResult") -> Table:
    """A row a frame."""
    kind = Shown["RigTargetPose"]
    return table_of(
        found.poses, kind("frame", lambda one: one.frame),
        kind("cameras", lambda one: len(one.cameras), "that show the target"), kind("points", lambda one: one.rings),
        kind("RMS px", lambda one: one.rms_px, f"{MEASURED} centres", 3),
        *(kind(f"{axis} mm", partial(_target_cell, axis=row),
               "of the target's origin in the rig's frame, with its standard deviation")
          for row, axis in enumerate("xyz")),
        kind("σ place mm", lambda one: one.sigma_mm,
             "root mean square length of the error, by noise and by the rig's own errors"),
        kind("by noise mm", lambda one: one.noise_sigma_mm, "its part by the noise of the centres alone"),
        kind("σ turn °", lambda one: math.degrees(one.rotation_sigma_rad), LEAST_SURE),
        kind("excess", lambda one: one.excess,
             "residuals in what noise and rig let expect, beyond chance; sigmas are as much larger"),
        title=f"In the frame of {printable(found.rig.rig_frame or found.rig.names[0])}",
    )  # fmt: skip


def _target_cell(pose: "RigTargetPose", axis: int) -> Cell:
    return with_sigma(float(pose.target_mm[axis]), float(pose.target_sigma_mm[axis]))


def _camera_words(found: "RigPoseResult") -> Iterator[str]:
    """What each camera leaves over."""
    for name in found.photos.camera_names:
        own = [one.rms_px for pose in found.poses for one in pose.cameras if one.camera == name and one.rings]
        yield f"{printable(name)} {f'{digits(median(own), 2)} px' if own else 'none'}"


def _share_check(what: str, count: int, total: int) -> Finding:
    return Finding(
        level_of_share(count / total), f"{what} with a pose", "The others are listed with the reason.",
        f"{count} of {total}", SHARE_RULE,
    )  # fmt: skip


def _headline(checks: Sequence[Finding], what: str, count: int, total: int, sentence: str) -> Headline:
    of = f"of {total} {what}{'s' * (total != 1)}"
    if not count:
        return Headline("bad", "no pose", f"None {of} gives a pose.")
    level = worst_level(checks)
    return Headline(level, WORDS[level], f"{count} {of} give{'s' * (total == 1)} a pose{sentence}.")


def _without_pose(lines: Sequence[str]) -> Iterator[Finding]:
    return (Finding("usable", "No pose", line) for line in some_of(lines))


def _remarks(made: "TargetPoses", lead: str) -> Iterator[Finding]:
    """What is to be known of the camera, of all photos, and of pictures that there are not."""
    yield from (Finding("note", "", line) for line in (*made.remarks, lead) if line)
    yield from (Finding("usable", "", line) for line in made.undrawn)


def _name_column(made: "TargetPoses") -> Shown[PosedPhoto]:
    """The photo's name, which leads to its picture."""

    def name(one: PosedPhoto) -> Cell:
        is_linked = made.folder is not None and is_there(made.folder, one.picture)
        return Cell(printable(one.name), path=one.picture if is_linked else "", level=one.level)

    return Shown[PosedPhoto]("photo", name)


def _page(
    made: "TargetPoses", headline: Headline, facts: Iterable[tuple[str, str]], checks: Sequence[Finding],
    before: Iterable[Section], said: tuple[Finding, ...], photos: Sequence[PosedPhoto], table: Table,
    after: Iterable[Section],
) -> Page:  # fmt: skip
    """The page: the worst photos first among the pictures."""
    shots = [
        Shot(one.picture, one.name, one.caption, one.level)
        for one in sorted(photos, key=lambda one: -one.rms_px if math.isfinite(one.rms_px) else 0.0) if one.picture
    ]  # fmt: skip
    pictures = (
        () if made.folder is None else gallery(made.folder, shots, "The photos with the largest residuals first.")
    )
    keep = Command("calib pose ... -o poses.json", "the same command with -o keeps the poses as a file")
    sections = (
        Section("Can the poses be used?", (Findings(tuple(checks)),), lead="The headline is the worst of these."),
        *before, Section("Photos", (*((Findings(said),) if said else ()), *pictures, table)), *after,
    )  # fmt: skip
    facts = (
        ("target", f"{made.target_named} ({made.found.target.words})"), *facts,
        ("written to", "nowhere: add -o poses.json" if made.place is None else str(made.place)),
    )  # fmt: skip
    return Page(
        "", "", headline, sections, lead=(Facts(facts),),
        next_steps=(keep,) if made.place is None and made.poses else (),
    )  # fmt: skip
