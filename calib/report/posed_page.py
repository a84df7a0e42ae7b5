"""The page of the overlays of `calib pose`: where the camera stood in each photo, how surely, and what is left over."""

import math
from pathlib import Path

import numpy as np

from calib.report.cells import number, whole
from calib.report.folder_blocks import files_section, warnings
from calib.report.gallery import Shot, gallery, is_there, title_of_pictures
from calib.report.kept_target import TARGET_FILE, kept_target, target_words
from calib.report.origin import Origin
from calib.report.photo_rows import STANDS_OUT
from calib.report.photos import shortened
from calib.report.place_scene import distance_words, place_view, place_words
from calib.report.posed_file import POSED_FILE, PosedFile, PosedPhoto, read_posed
from calib.results.evaluation_table import figure as digits
from calib.results.evaluation_table import with_digits
from calib.types import Camera
from designer.command import printable
from designer.page.blocks import (
    Block,
    Cell,
    Column,
    Command,
    Facts,
    Finding,
    Findings,
    Headline,
    Level,
    Page,
    Paragraph,
    Section,
    Table,
)
from designer.target import TargetGeometry

GOOD_SHARE, USABLE_SHARE = 0.95, 0.5
"""Of the photos that have a pose."""
GOOD_RMS_PX, USABLE_RMS_PX = 0.5, 2.0
"""What is left over in the median photo. A ring's centre is good to a few hundredths of a pixel, so half a pixel is
lens or target: the pose is still fine for most uses. Two pixels are another focus, camera or print."""
LEVELS: tuple[Level, ...] = ("bad", "usable", "good")
WORDS: dict[Level, str] = {"good": "good", "usable": "usable", "bad": "do not use", "note": ""}
MOST_FAILURES = 20
FILES = (
    (POSED_FILE, "what this page is built from: poses and standard deviations"),
    (TARGET_FILE, "the target as it was used"),
)


def posed_page(folder: Path, origin: Origin) -> Page:
    """Read a folder and build its page.

    Raises:
        InputError: `posed.json` cannot be read; the message names it.
    """
    file, camera = read_posed(folder)
    target, wrong = kept_target(folder, file.geometry_id)
    usual = _usual_px(file)
    shots = [
        Shot(photo.overlay, photo.image, _caption(photo), _level(photo, usual))
        for photo in sorted(file.photos, key=_worst_first)
        if photo.overlay
    ]
    blocks: tuple[Block, ...] = (
        *_failed(file, wrong), *gallery(folder, shots, "The photos with most left over first."),
        _table(folder, file, usual),
    )  # fmt: skip
    rows = checks(file, usual)
    sections = (
        Section("Can the poses be used?", (Findings(rows),), lead="The headline is the worst of these."),
        Section("Photos", blocks, lead=_left_words(file)),
        *_scene(file, target, camera),
        Section("Next", _next(file)),
        files_section(folder, FILES, Command("calib report .", "in this folder: makes this page again")),
    )
    return Page(
        title=title_of_pictures(folder), kind="Camera poses", headline=_headline(file, rows, usual), sections=sections,
        lead=(Facts(_facts(file, target, camera)),), made_by=origin.command, program=origin.program,
    )  # fmt: skip


def checks(file: PosedFile, usual_px: float) -> tuple[Finding, ...]:
    """How many photos have a pose, and how well the camera explains them."""
    found, total = len(_rms(file)), len(file.photos) + len(file.failures)
    share = found / total
    level: Level = "good" if share >= GOOD_SHARE else "usable" if share >= USABLE_SHARE else "bad"
    rows = [Finding(
        level, "Photos with a pose", "The others are listed with the reason.", f"{found} of {total}",
        f"good from {100 * GOOD_SHARE:.0f} %, usable from {100 * USABLE_SHARE:.0f} %",
    )]  # fmt: skip
    if math.isfinite(usual_px):
        fit: Level = "good" if usual_px <= GOOD_RMS_PX else "usable" if usual_px <= USABLE_RMS_PX else "bad"
        rows.append(Finding(
            fit, "What is left over", "Median over the photos of the RMS distance between measured and predicted "
            "rings; more than the noise of a ring is lens, focus or print.",
            f"{digits(usual_px, 2)} px", f"good up to {GOOD_RMS_PX:g} px, usable up to {USABLE_RMS_PX:g} px",
        ))  # fmt: skip
    return tuple(rows)


def _rms(file: PosedFile) -> list[float]:
    return [photo.pose.rms_px for photo in file.photos if photo.pose is not None]


def _usual_px(file: PosedFile) -> float:
    known = [value for value in _rms(file) if math.isfinite(value)]
    return float(np.median(known)) if known else math.nan


def _headline(file: PosedFile, rows: tuple[Finding, ...], usual_px: float) -> Headline:
    level = min((row.level for row in rows), key=LEVELS.index)
    found, total = len(_rms(file)), len(file.photos)
    if not found:
        return Headline("bad", "no pose", f"None of {total} photo{'s' * (total != 1)} gives a pose.")
    sentence = (
        f"{found} of {total} photo{'s' * (total != 1)} give{'s' * (total == 1)} a pose, "
        f"{distance_words(file.cam_from_target)} from the target's origin"
    )
    return Headline(level, WORDS[level], f"{sentence}; {digits(usual_px, 2)} px are left over in the usual photo.")


def _facts(file: PosedFile, target: TargetGeometry | None, camera: Camera) -> tuple[tuple[str, str], ...]:
    width, height = camera.image_size
    sigma = [photo.pose.distance_sigma_mm for photo in file.photos if photo.pose is not None]
    facts = [
        ("target", f"{printable(file.target)} ({target_words(target, file.geometry_id)})"),
        ("camera", f"{printable(file.camera_name)} (model {printable(file.model)[:40]}), {width} x {height} px"),
        ("photos", str(len(file.photos))),
    ]  # fmt: skip
    if sigma and np.isfinite(sigma).all():
        facts.append(("sigma of the distance", f"{digits(float(np.median(sigma)), 2)} mm in the usual photo"))
    return (*facts, ("written to", printable(file.poses) or "nowhere: add -o poses.json"))


def _failed(file: PosedFile, wrong: str) -> tuple[Block, ...]:
    """Photos that could not be used, and what of the folder could not be read."""
    lines = [printable(line) for line in file.failures]
    lines += [
        f"{printable(photo.image)}: {shortened(photo.reason or 'no pose')}" for photo in file.photos if not photo.pose
    ]
    more = [f"{len(lines) - MOST_FAILURES} more"] if len(lines) > MOST_FAILURES else []
    return (*warnings("No pose", (*lines[:MOST_FAILURES], *more)), *warnings("File", (wrong,) if wrong else ()))


def _worst_first(photo: PosedPhoto) -> float:
    return -photo.pose.rms_px if photo.pose is not None and math.isfinite(photo.pose.rms_px) else -math.inf


def _level(photo: PosedPhoto, usual_px: float) -> Level | None:
    if photo.pose is None:
        return "bad"
    return "usable" if photo.pose.rms_px > STANDS_OUT * usual_px else None


def _caption(photo: PosedPhoto) -> str:
    if photo.pose is None:
        return shortened(photo.reason)
    pose = photo.pose
    return f"{pose.rings} rings, RMS {digits(pose.rms_px, 2)} px, {digits(pose.distance_mm)} mm away"


def _left_words(file: PosedFile) -> str:
    known = [(photo.pose.rms_px, photo.image) for photo in file.photos if photo.pose is not None]
    if not known:
        return ""
    least, most = min(known), max(known)
    return (
        f"What is left over of one is {digits(least[0], 2)} to {digits(most[0], 2)} px, most in {printable(most[1])}. "
        "Standard deviations hold if the camera file is exact and errors of the rings are independent."
    )


def _table(folder: Path, file: PosedFile, usual_px: float) -> Table:
    columns = (
        Column("photo", is_number=False),
        Column("rings"),
        Column("RMS px", note="of the distances between measured and predicted centres"),
        *(Column(f"{axis} mm", note="the camera in the target's frame") for axis in "xyz"),
        Column("σ place mm", note="standard deviation of the camera's place, the largest of x, y and z"),
        Column("distance mm", note="from the camera to the target's origin"),
        Column("σ distance mm", note="standard deviation of the distance"),
        Column("σ turn °", note="standard deviation of the rotation about its least sure axis"),
    )
    note = f"Marked: more than {STANDS_OUT:g} times as much left over as in the usual photo. Without numbers: no pose."
    return Table("All photos", columns, tuple(_row(folder, photo, usual_px) for photo in file.photos), note)


def _row(folder: Path, photo: PosedPhoto, usual_px: float) -> tuple[Cell, ...]:
    can_link = is_there(folder, photo.overlay)
    name = Cell(printable(photo.image), path=photo.overlay if can_link else "", level=_level(photo, usual_px))
    pose = photo.pose
    if pose is None:
        return (name, *(Cell("") for _ in range(9)))
    place = (
        Cell(with_digits(value, sigma), value)
        for value, sigma in zip(pose.camera_mm, pose.camera_sigma_mm, strict=True)
    )
    return (
        name, whole(pose.rings), number(pose.rms_px), *place, number(max(pose.camera_sigma_mm), 2),
        Cell(with_digits(pose.distance_mm, pose.distance_sigma_mm), pose.distance_mm),
        number(pose.distance_sigma_mm, 2), number(math.degrees(pose.rotation_sigma_rad), 2),
    )  # fmt: skip


def _scene(file: PosedFile, target: TargetGeometry | None, camera: Camera) -> tuple[Section, ...]:
    """Camera positions, if there are any."""
    names = tuple(
        f"{printable(photo.image)}: RMS {digits(photo.pose.rms_px, 2)} px"
        for photo in file.photos
        if photo.pose is not None
    )
    if not names:
        return ()
    caption = "Each pyramid is a photo; point at one for its name."
    view = place_view(target, camera, file.cam_from_target, names, caption)
    return (Section("Camera positions", (view,), lead=place_words(target, file.cam_from_target)),)


def _next(file: PosedFile) -> tuple[Block, ...]:
    if not file.poses:
        return (Command("calib pose ... -o poses.json", "the same command with -o keeps the poses as a file"),)
    text = f"The poses are in {printable(file.poses)}: cam_from_target and its covariance, photo by photo."
    return (Paragraph(text),)
