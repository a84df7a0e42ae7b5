"""Photos of a rig's cameras on its page: of each the one with the largest residuals and a usual one."""

import math
from collections.abc import Iterator
from dataclasses import dataclass, replace
from pathlib import Path

from calib.draw.gallery import OVERLAYS, Shot, gallery
from calib.draw.run_photos import PhotoRow, caption_of, overlay_paths, used_rows
from calib.judge.views import view_facts
from calib.observe.photos import OVERLAY_MARK, keep_pictures, no_empty_folders, staging_folder, with_overlays
from calib.observe.rig_search import RigSearch
from calib.rigs.result import RigCalibration
from calib.rigs.rig_calibration_file import CAMERAS, folder_names
from designer.page.blocks import Section

MOST_PICTURES = 12
"""On the page of a rig, whatever number of cameras it has."""
WORST, USUAL = "largest residuals", "usual residuals"


@dataclass(frozen=True)
class PicturedPhoto:
    """A photo that is to be shown, and why."""

    camera: int
    row: PhotoRow
    why: str


def pictured(found: RigCalibration) -> tuple[PicturedPhoto, ...]:
    """Of each camera the photo with the largest residuals and one with the usual, in the order of the cameras.

    Of very many cameras the worst photos of all.
    """
    each = [_worst_and_usual(found, camera) for camera in range(len(found.cameras))]
    worst = sorted((one for pair in each for one in pair[:1]), key=lambda one: -one.row.rmse_px)
    usual = [one for pair in each for one in pair[1:]]
    return tuple(sorted([*worst, *usual][:MOST_PICTURES], key=lambda one: one.camera))


def _worst_and_usual(found: RigCalibration, camera: int) -> list[PicturedPhoto]:
    """Two photos of a camera, with the residuals of the rig's own solution; fewer where it has no more with any."""
    alone = found.alone[camera]
    facts, unknown = view_facts(alone), [math.nan] * alone.observations.view_count
    rows = used_rows(alone, facts, facts.rms_px.tolist(), unknown, unknown, {})
    known = sorted((row for row in rows if math.isfinite(row.rmse_px)), key=lambda row: -row.rmse_px)
    chosen = [*known[:1], *([known[len(known) // 2]] if len(known) > 1 else [])]
    return [PicturedPhoto(camera, row, why) for row, why in zip(chosen, (WORST, USUAL), strict=False)]


def pictures_section(folder: Path, found: RigCalibration) -> Section | None:
    """Small pictures of these photos; None where none were drawn, as of a table."""
    names = found.observations.camera_names
    places = [f"{CAMERAS}/{place}" for place in folder_names(names)]
    if not any((folder / place / OVERLAYS).is_dir() for place in places):
        return None
    shots, chosen = list[Shot](), pictured(found)
    for camera, place in enumerate(places):
        own = [one for one in chosen if one.camera == camera]
        paths = overlay_paths(folder / place, [one.row for one in own])
        named = "" if len(names) == 1 else f"{names[camera]}: "
        shots += [
            Shot(f"{place}/{paths[one.row.name]}", f"{named}{one.row.name}", f"{one.why}: {caption_of(one.row)}",
                 one.row.level)
            for one in own if one.row.name in paths
        ]  # fmt: skip
    if not shots:
        return None
    each = "T" if len(names) == 1 else "Camera by camera, t"
    pictures = gallery(folder, shots, f"{each}he photo with the largest residuals of the rig and one with the usual.")
    return Section("Photos", pictures, lead="The points that were found, each with its name.")


def draw_rig_pictures(folder: Path, found: RigCalibration, search: RigSearch) -> tuple[str, ...]:
    """Draw the photos that a rig's page shows; why others have no picture, a line each.

    Raises:
        InputError: a place takes no files, or holds somebody else's.
    """
    failures: list[str] = []
    wanted = [(one.camera, one.row.name) for one in pictured(found)]
    for camera, (place, one) in enumerate(zip(_places(folder, found), search.searches, strict=True)):
        chosen = tuple(result for result in one.results if (camera, result.photo.name) in wanted)
        if not chosen:
            continue
        with no_empty_folders(place), staging_folder(place, "-o") as staging:
            drawn = with_overlays(replace(one, results=chosen), staging)
            keep_pictures(staging, place)
        failures += [result.overlay_failure for result in drawn.results if result.overlay_failure]
    return tuple(failures)


def pictures_in(folder: Path, found: RigCalibration) -> tuple[Path, ...]:
    """The pictures of photos in a rig's folder."""
    return tuple(path for place in _places(folder, found) for path in sorted(place.glob(f"*{OVERLAY_MARK}.*")))


def _places(folder: Path, found: RigCalibration) -> Iterator[Path]:
    """Where the pictures of each camera are."""
    for name in folder_names(found.observations.camera_names):
        yield folder / CAMERAS / name / OVERLAYS
