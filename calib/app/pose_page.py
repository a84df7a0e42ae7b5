"""What `calib pose` tells of its photos: where the camera stood, how surely, and how large the residuals are."""

import math
from collections.abc import Mapping
from typing import TYPE_CHECKING

import numpy as np

from calib.draw.gallery import STANDS_OUT, shortened
from calib.observe.photos import PhotoResult
from calib.observe.records import common_remarks
from calib.observe.target_poses import PoseResult, TargetPose
from calib.show.parts.kept_target import target_words
from calib.show.photos.photos_file import SHARE_RULE, ToldPhoto, ToldPhotos, ToldSection, level_of_share, worst_level
from calib.show.photos.place_scene import distance_words
from designer.base.words import figure as digits
from designer.base.words import with_digits
from designer.page.blocks import Cell, Column, Finding, Findings, Headline, Level
from designer.page.folders import number, some_of, whole

if TYPE_CHECKING:
    from calib.app.pose import TargetPoses

GOOD_RMS_PX, USABLE_RMS_PX = 0.5, 2.0
"""Of the residuals in the median photo. A ring's centre is good to a few hundredths of a pixel, so half a pixel is
lens or target: the pose is still fine for most uses. Two pixels are another focus, camera or print."""
WORDS: Mapping[Level, str] = {"good": "good", "usable": "usable", "bad": "do not use", "note": ""}
COLUMNS = (
    Column("rings"),
    Column("RMS px", note="of the distances between measured and predicted centres"),
    *(Column(f"{axis} mm", note="the camera in the target's frame") for axis in "xyz"),
    Column("σ place mm", note="standard deviation of the camera's place, the largest of x, y and z"),
    Column("distance mm", note="from the camera to the target's origin"),
    Column("σ distance mm", note="standard deviation of the distance"),
    Column("σ turn °", note="standard deviation of the rotation about its least sure axis"),
    Column("remark", is_number=False),
)


def told_posed(made: "TargetPoses", found: PoseResult) -> ToldPhotos:
    """What is to be said of photos for which poses were searched."""
    rows, poses = _checks(found), {pose.image: pose for pose in found.poses}
    reasons = {one.image: one.reason for one in found.without_pose}
    failed = [*found.search.missing, *(result.failure for result in found.search.results if result.failure)]
    searched = {seen.image for seen in found.search.detections}
    without = [*failed, *(f"{name}: {shortened(why)}" for name, why in reasons.items() if name in searched)]
    common = common_remarks([seen.remarks for seen in found.search.detections])
    overlays = {image: path for (_, image), path in made.overlays.items()}
    return ToldPhotos(
        "photos", _headline(found, rows), _facts(made, found), COLUMNS,
        tuple(_photo(result, poses, reasons, overlays, common, found.usual_px) for result in found.search.results),
        "The photos with the largest residuals first.", (), lead=_residual_words(found),
        notes=(
            *(Finding("note", "All photos", shortened(remark)) for remark in common),
            *(Finding("usable", "No pose", line) for line in some_of(without)),
        ),
        table_note=f"Marked: residuals more than {STANDS_OUT:g} times the usual photo's. Without numbers: no pose.",
        before=(ToldSection("Can the poses be used?", (Findings(rows),), "The headline is the worst of these."),),
        geometry_id=found.target.geometry_id, camera=found.camera,
    )  # fmt: skip


def _checks(found: PoseResult) -> tuple[Finding, ...]:
    """How many photos have a pose, and how well the camera explains them."""
    count, total, usual_px = len(found.poses), len(found.search.results), found.usual_px
    rows = [Finding(
        level_of_share(count / total), "Photos with a pose", "The others are listed with the reason.",
        f"{count} of {total}", SHARE_RULE,
    )]  # fmt: skip
    if math.isfinite(usual_px):
        fit: Level = "good" if usual_px <= GOOD_RMS_PX else "usable" if usual_px <= USABLE_RMS_PX else "bad"
        rows.append(Finding(
            fit, "Residuals", "Median over the photos of the RMS distance between measured and predicted rings; more "
            "than the noise of a ring is lens, focus or print.",
            f"{digits(usual_px, 2)} px", f"good up to {GOOD_RMS_PX:g} px, usable up to {USABLE_RMS_PX:g} px",
        ))  # fmt: skip
    return tuple(rows)


def _headline(found: PoseResult, rows: tuple[Finding, ...]) -> Headline:
    count, total = len(found.poses), len(found.search.results)
    if not count:
        return Headline("bad", "no pose", f"None of {total} photo{'s' * (total != 1)} gives a pose.")
    level = worst_level(rows)
    distance = distance_words(np.array([pose.cam_from_target for pose in found.poses]))
    sentence = (
        f"{count} of {total} photo{'s' * (total != 1)} give{'s' * (total == 1)} a pose, {distance} from the target's "
        f"origin; the residuals are {digits(found.usual_px, 2)} px RMS in the usual photo."
    )
    return Headline(level, WORDS[level], sentence)


def _facts(made: "TargetPoses", found: PoseResult) -> tuple[tuple[str, str], ...]:
    width, height = found.camera.image_size
    sigma_mm = [pose.distance_sigma_mm for pose in found.poses]
    facts = [
        ("target", f"{made.target_named} ({target_words(found.target)})"),
        ("camera", f"{made.taken_by} (model {found.camera.model}), {width} x {height} px"),
        ("photos", str(len(found.search.results))),
    ]
    if sigma_mm and np.isfinite(sigma_mm).all():
        facts.append(("sigma of the distance", f"{digits(float(np.median(sigma_mm)), 2)} mm in the usual photo"))
    return (*facts, ("written to", "nowhere: add -o poses.json" if made.place is None else str(made.place)))


def _residual_words(found: PoseResult) -> str:
    known = [(pose.rms_px, pose.image) for pose in found.poses]
    if not known:
        return ""
    least, most = min(known), max(known)
    return (
        f"The RMS residuals of a photo are {digits(least[0], 2)} to {digits(most[0], 2)} px, largest in {most[1]}. "
        "Standard deviations hold if the camera file is exact and errors of the rings are independent."
    )


def _photo(
    result: PhotoResult,
    poses: Mapping[str, TargetPose],
    reasons: Mapping[str, str],
    overlays: Mapping[str, str],
    common: tuple[str, ...],
    usual_px: float,
) -> ToldPhoto:
    name, seen = result.photo.name, result.seen
    pose, overlay = poses.get(name), overlays.get(name, "")
    remarks = [] if seen is None else [remark for remark in seen.remarks if remark not in common]
    if pose is None:
        rings = 0 if seen is None else len(seen.ring)
        reason = reasons.get(name, "no pose")
        text = shortened("; ".join([*remarks, reason] if rings else [reason]))
        return ToldPhoto(name, (whole(rings), *(Cell(""),) * (len(COLUMNS) - 2), Cell(text)), overlay, text, "bad")
    if seen is not None and pose.rings < len(seen.ring):
        remarks.append(f"{len(seen.ring) - pose.rings} more rings lie where the camera knows no light")
    place = zip(pose.camera_mm.tolist(), pose.camera_sigma_mm.tolist(), strict=True)
    cells = (
        whole(pose.rings), number(pose.rms_px), *(Cell(with_digits(value, sigma), value) for value, sigma in place),
        number(float(pose.camera_sigma_mm.max()), 2),
        Cell(with_digits(pose.distance_mm, pose.distance_sigma_mm), pose.distance_mm),
        number(pose.distance_sigma_mm, 2), number(math.degrees(pose.rotation_sigma_rad), 2),
        Cell(shortened("; ".join(remarks))),
    )  # fmt: skip
    caption = f"{pose.rings} rings, RMS {digits(pose.rms_px, 2)} px, {digits(pose.distance_mm)} mm away"
    level: Level | None = "usable" if pose.rms_px > STANDS_OUT * usual_px else None
    badness = pose.rms_px if math.isfinite(pose.rms_px) else None
    return ToldPhoto(name, cells, overlay, caption, level, badness, pose.cam_from_target)
