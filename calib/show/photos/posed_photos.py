"""What `calib pose` tells of its photos: where the camera stood, how surely, and what is left over."""

import math
import os
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from calib.cameras import LINEAR
from calib.cameras.camera import Camera
from calib.core.number_text import figure as digits
from calib.core.number_text import with_digits
from calib.show.parts.folder_blocks import number, some_of, whole
from calib.show.parts.gallery import shortened
from calib.show.parts.kept_target import TARGET_FILE, target_words
from calib.show.photos.levels import SHARE_RULE, level_of_share, worst_level
from calib.show.photos.photos_file import PHOTOS_FILE, ToldPhoto, ToldPhotos, ToldSection
from calib.show.photos.place_scene import distance_words
from calib.show.run.photos import STANDS_OUT
from designer.page.blocks import Cell, Column, Command, Finding, Findings, Headline, Level, Paragraph

if TYPE_CHECKING:
    from calib.pipeline.target_poses import TargetPose
    from designer.target import TargetGeometry

GOOD_RMS_PX, USABLE_RMS_PX = 0.5, 2.0
"""What is left over in the median photo. A ring's centre is good to a few hundredths of a pixel, so half a pixel is
lens or target: the pose is still fine for most uses. Two pixels are another focus, camera or print."""
WORDS: Mapping[Level, str] = {"good": "good", "usable": "usable", "bad": "do not use", "note": ""}
FILES = (
    (PHOTOS_FILE, "what this page is built from: poses and standard deviations"),
    (TARGET_FILE, "the target as it was used"),
)
COLUMNS = (
    Column("rings"),
    Column("RMS px", note="of the distances between measured and predicted centres"),
    *(Column(f"{axis} mm", note="the camera in the target's frame") for axis in "xyz"),
    Column("σ place mm", note="standard deviation of the camera's place, the largest of x, y and z"),
    Column("distance mm", note="from the camera to the target's origin"),
    Column("σ distance mm", note="standard deviation of the distance"),
    Column("σ turn °", note="standard deviation of the rotation about its least sure axis"),
)


@dataclass(frozen=True, eq=False)
class Posed:
    """Poses in photos, and what they were found with."""

    target: Path
    geometry: "TargetGeometry"
    camera_name: str  # as it was given
    camera: Camera
    out: Path | None  # the file of poses
    names: Sequence[str]  # of the photos, in their order
    poses: "Mapping[str, TargetPose]"  # by name
    reasons: Mapping[str, str]  # why others have none, by name
    overlays: Mapping[str, str]  # names of pictures in the folder, by name of the photo
    failures: Sequence[str]  # arguments that stood for no photo, one line each

    @property
    def usual_px(self) -> float:
        """What is left over in the median photo; nan without one."""
        known = [pose.rms_px for pose in self.poses.values() if math.isfinite(pose.rms_px)]
        return float(np.median(known)) if known else math.nan


def told_posed(made: Posed) -> ToldPhotos:
    """What the page of the overlays says."""
    usual_px, rows = made.usual_px, _checks(made)
    without = [*made.failures, *(f"{name}: {shortened(_reason(made, name))}" for name in made.names
                                 if name not in made.poses)]  # fmt: skip
    # A learned map would be most of the file, and only the pyramids are drawn: by its linear part.
    learned = made.camera.learned is not None
    drawn = Camera(LINEAR, made.camera.params[:4], made.camera.image_size) if learned else made.camera
    return ToldPhotos(
        "poses", _headline(made, rows), _facts(made), COLUMNS,
        tuple(_photo(made, name, usual_px) for name in made.names),
        "The photos with most left over first.", FILES, lead=_left_words(made),
        notes=tuple(Finding("usable", "No pose", line) for line in some_of(without)),
        table_note=f"Marked: more than {STANDS_OUT:g} times as much left over as in the usual photo. Without numbers: "
        "no pose.",
        before=(ToldSection("Can the poses be used?", (Findings(rows),), "The headline is the worst of these."),),
        after=(ToldSection("Next", (_next(made.out),)),),
        geometry_id=made.geometry.geometry_id, camera=drawn,
    )  # fmt: skip


def _reason(made: Posed, name: str) -> str:
    return made.reasons.get(name, "") or "no pose"


def _checks(made: Posed) -> tuple[Finding, ...]:
    """How many photos have a pose, and how well the camera explains them."""
    found, total, usual_px = len(made.poses), len(made.names) + len(made.failures), made.usual_px
    rows = [Finding(
        level_of_share(found / total), "Photos with a pose", "The others are listed with the reason.",
        f"{found} of {total}", SHARE_RULE,
    )]  # fmt: skip
    if math.isfinite(usual_px):
        fit: Level = "good" if usual_px <= GOOD_RMS_PX else "usable" if usual_px <= USABLE_RMS_PX else "bad"
        rows.append(Finding(
            fit, "What is left over", "Median over the photos of the RMS distance between measured and predicted "
            "rings; more than the noise of a ring is lens, focus or print.",
            f"{digits(usual_px, 2)} px", f"good up to {GOOD_RMS_PX:g} px, usable up to {USABLE_RMS_PX:g} px",
        ))  # fmt: skip
    return tuple(rows)


def _distances(made: Posed) -> str:
    return distance_words(np.array([pose.cam_from_target for pose in made.poses.values()]))


def _headline(made: Posed, rows: tuple[Finding, ...]) -> Headline:
    found, total = len(made.poses), len(made.names)
    if not found:
        return Headline("bad", "no pose", f"None of {total} photo{'s' * (total != 1)} gives a pose.")
    level = worst_level(rows)
    sentence = (
        f"{found} of {total} photo{'s' * (total != 1)} give{'s' * (total == 1)} a pose, {_distances(made)} from the "
        f"target's origin; {digits(made.usual_px, 2)} px are left over in the usual photo."
    )
    return Headline(level, WORDS[level], sentence)


def _facts(made: Posed) -> tuple[tuple[str, str], ...]:
    width, height = made.camera.image_size
    sigma_mm = [pose.distance_sigma_mm for pose in made.poses.values()]
    facts = [
        ("target", f"{made.target} ({target_words(made.geometry)})"),
        ("camera", f"{made.camera_name} (model {made.camera.model}), {width} x {height} px"),
        ("photos", str(len(made.names))),
    ]  # fmt: skip
    if sigma_mm and np.isfinite(sigma_mm).all():
        facts.append(("sigma of the distance", f"{digits(float(np.median(sigma_mm)), 2)} mm in the usual photo"))
    return (*facts, ("written to", "nowhere: add -o poses.json" if made.out is None else os.fspath(made.out)))


def _left_words(made: Posed) -> str:
    known = [(pose.rms_px, name) for name, pose in made.poses.items()]
    if not known:
        return ""
    least, most = min(known), max(known)
    return (
        f"What is left over of one is {digits(least[0], 2)} to {digits(most[0], 2)} px, most in {most[1]}. "
        "Standard deviations hold if the camera file is exact and errors of the rings are independent."
    )


def _photo(made: Posed, name: str, usual_px: float) -> ToldPhoto:
    pose, overlay = made.poses.get(name), made.overlays.get(name, "")
    if pose is None:
        reason = shortened(_reason(made, name))
        return ToldPhoto(name, (Cell(""),) * len(COLUMNS), overlay, reason, "bad")
    place = zip(pose.camera_mm.tolist(), pose.camera_sigma_mm.tolist(), strict=True)
    cells = (
        whole(pose.rings), number(pose.rms_px), *(Cell(with_digits(value, sigma), value) for value, sigma in place),
        number(float(pose.camera_sigma_mm.max()), 2),
        Cell(with_digits(pose.distance_mm, pose.distance_sigma_mm), pose.distance_mm),
        number(pose.distance_sigma_mm, 2), number(math.degrees(pose.rotation_sigma_rad), 2),
    )  # fmt: skip
    caption = f"{pose.rings} rings, RMS {digits(pose.rms_px, 2)} px, {digits(pose.distance_mm)} mm away"
    level: Level | None = "usable" if pose.rms_px > STANDS_OUT * usual_px else None
    badness = pose.rms_px if math.isfinite(pose.rms_px) else None
    return ToldPhoto(name, cells, overlay, caption, level, badness, pose.cam_from_target)


def _next(out: Path | None) -> Command | Paragraph:
    if out is None:
        return Command("calib pose ... -o poses.json", "the same command with -o keeps the poses as a file")
    return Paragraph(f"The poses are in {out}: cam_from_target and its covariance, photo by photo.")
