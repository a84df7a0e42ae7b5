"""What `calib render --rig` tells: how often each camera of a rig shows the target, alone and with the others."""

import shlex
from collections.abc import Mapping
from pathlib import Path

from calib.renderer.job import RenderJob
from calib.renderer.truth import TRUTH_FILE
from calib.show.parts.kept_target import TARGET_FILE, target_words
from calib.show.photos.photos_file import PHOTOS_FILE, ToldPhoto, ToldPhotos, ToldSection
from calib.show.photos.rendered_photos import (
    RenderedPhoto,
    effects,
    option_words,
    photo_caption,
    photo_cells,
    photo_columns,
    photos_of_job,
)
from designer.base.arrays import Flags, Rows
from designer.base.words import printable
from designer.page.blocks import Cell, Column, Command, Finding, Headline, Table
from designer.page.folders import number, whole

RIG_FILE, PHOTO_TABLE = "rig.json", "photos.csv"
FILES = (
    (RIG_FILE, "the true rig: cameras, where they stand, delays of their clocks"),
    (TRUTH_FILE, "how the target was held in each frame; a camera's folder has another, of its photos"),
    (PHOTO_TABLE, "camera, frame and file of each photo, and its time stamp where cameras are not synchronous"),
    (TARGET_FILE, "the target as it was rendered"),
    (PHOTOS_FILE, "what this page is built from"),
)
MOST_NAMED = 12
"""Cameras of which it is told how often two of them see the target together."""


def told_rendered_rig(
    jobs: Mapping[str, RenderJob],
    title: str,
    sees: Flags,
    delays_ms: Mapping[str, float],
    warnings: tuple[str, ...],
    command: Command,
) -> ToldPhotos:
    """What is to be said of a finished set.

    Args:
        jobs: that made the photos of each camera.
        title: of the rig.
        sees: (C, V) whether each camera shows the target large enough in each frame.
        delays_ms: by which cameras' clocks run behind; empty: they are synchronous.
        warnings: what will make a calibration hard.
        command: what the photos are for.
    """
    shows = {name: photos_of_job(job) for name, job in jobs.items()}
    target = next(iter(jobs.values())).target
    is_flat, is_wide = target.is_plate, any(job.camera.has_dark_corners for job in jobs.values())
    photos = tuple(
        ToldPhoto(
            f"{name}/{photo.name}", photo_cells(photo, is_flat=is_flat, is_wide=is_wide), f"{name}/{photo.name}",
            f"{name}: {photo_caption(photo)}",
        )
        for name, rows in shows.items()
        for photo in rows
    )  # fmt: skip
    return ToldPhotos(
        "photos", _headline(jobs, title, delays_ms, warnings), _facts(jobs, title, delays_ms),
        photo_columns(is_flat=is_flat, is_wide=is_wide), photos, "Camera by camera, in the order of frames.", FILES,
        notes=tuple(Finding("usable", "Hard to calibrate", f"{line[0].upper()}{line[1:]}.") for line in warnings),
        before=(ToldSection("Cameras", tuple(_tables(jobs, shows, sees.astype(int), delays_ms))),),
        after=(ToldSection("Next", (command,)),), geometry_id=target.geometry_id,
    )  # fmt: skip


def command_after_rig(target: Path, folder: Path, *, is_moving: bool) -> Command:
    """What the photos are for; where the target moves, their time stamps are in the table."""
    out = Path("rig") if folder.name in ("", "..") else folder.with_name(f"{folder.name}-rig")
    shown, photos, place = (shlex.quote(printable(str(path))) for path in (target, folder, out))
    if is_moving:
        photos = f"--table {shlex.quote(printable(str(folder / PHOTO_TABLE)))} --delays"
    return Command(
        f"calib rig {shown} {photos} -o {place}",
        f"calibrates the rig from these photos; what it should find is in {RIG_FILE}",
    )


def _headline(
    jobs: Mapping[str, RenderJob], title: str, delays_ms: Mapping[str, float], warnings: tuple[str, ...]
) -> Headline:
    first = next(iter(jobs.values()))
    frames = len(first.cam_from_target)
    moves = "which moves; the cameras are not synchronous" if delays_ms else "which stands still in each"
    sentence = (
        f"{'1 frame' if frames == 1 else f'{frames} frames'} of {title}: {len(jobs)} cameras, {frames * len(jobs)} "
        f"photos of {target_words(first.target)}, {moves}; {effects(first.options) or 'without blur and noise'}; "
        f"seed {first.seed}."
    )
    return Headline("usable", "hard to calibrate", sentence) if warnings else Headline("note", "rendered", sentence)


def _facts(jobs: Mapping[str, RenderJob], title: str, delays_ms: Mapping[str, float]) -> tuple[tuple[str, str], ...]:
    first = next(iter(jobs.values()))
    late = f"delays up to {max(map(abs, delays_ms.values())):.3g} ms" if delays_ms else "synchronous"
    return (
        ("rig", title),
        ("cameras", f"{len(jobs)}, {late}"),
        ("frames", str(len(first.cam_from_target))),
        ("target", f"{target_words(first.target)}, id {first.target.geometry_id}"),
        ("files", f"{first.file_format}, {first.options.bits} bits"),
        *option_words(first.options),
        ("seed", f"{first.seed} of the first camera, one more of each next"),
    )


def _tables(
    jobs: Mapping[str, RenderJob], shows: Mapping[str, list[RenderedPhoto]], sees: Rows, delays_ms: Mapping[str, float]
) -> list[Table]:
    """A row a camera; and how many frames two of them share."""
    shared = sees @ sees.T
    rows = tuple(
        (
            Cell(name), Cell(job.camera.model), Cell("{} x {}".format(*job.camera.image_size)), whole(int(frames)),
            whole(sum(photo.rings for photo in shows[name])), *((number(delays_ms[name], 3),) if delays_ms else ()),
        )
        for (name, job), frames in zip(jobs.items(), shared.diagonal(), strict=True)
    )  # fmt: skip
    late = (Column("delay ms", note="by which the camera's time stamps run behind"),) if delays_ms else ()
    columns = (
        Column("camera", is_number=False), Column("model", is_number=False), Column("image px", is_number=False),
        Column("frames", note="in which it sees a ring that is large enough for the detector"),
        Column("rings", note="that can be measured, in all its photos"), *late,
    )  # fmt: skip
    tables = [Table("What each camera sees", columns, rows)]
    if 1 < len(jobs) <= MOST_NAMED:
        heads = (Column("camera", is_number=False), *(Column(name) for name in jobs))
        pairs = tuple(
            (Cell(name), *(whole(int(count)) for count in row)) for name, row in zip(jobs, shared, strict=True)
        )
        tables.append(Table("Frames that two cameras share", heads, pairs))
    return tables
