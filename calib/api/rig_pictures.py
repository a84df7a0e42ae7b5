"""Pictures of a few photos of a rig's cameras, each in its camera's folder."""

from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path

from calib.api.rig_observing import RigSearch
from calib.draw.gallery import OVERLAYS
from calib.observe.overlays import keep_pictures, no_empty_folders, remove_ours, staging_folder, with_overlays
from calib.observe.photos import OVERLAY_MARK
from calib.records.rig_file import CAMERAS, folder_names
from calib.rigs.result import RigCalibration
from calib.show.rig.pictures import pictured


def draw_rig_pictures(
    folder: Path, found: RigCalibration, search: RigSearch
) -> tuple[tuple[Path, ...], tuple[str, ...]]:
    """Draw the photos that a rig's page shows.

    Args:
        folder: of the rig.
        found: the rig.
        search: of the photos that it was solved from.

    Returns:
        The pictures' places, and why others have none, a line each.

    Raises:
        InputError: a place takes no files, or holds somebody else's.
    """
    pictures: list[Path] = []
    failures: list[str] = []
    wanted = [(one.camera, one.row.name) for one in pictured(found)]
    for camera, (place, one) in enumerate(zip(_places(folder, found), search.searches, strict=True)):
        chosen = tuple(result for result in one.results if (camera, result.photo.name) in wanted)
        if not chosen:
            continue
        with no_empty_folders(place), staging_folder(place, "-o") as staging:
            drawn = with_overlays(replace(one, results=chosen), staging)
            pictures += keep_pictures(staging, place)
        failures += [result.overlay_failure for result in drawn.results if result.overlay_failure]
    return tuple(pictures), tuple(failures)


def remove_rig_pictures(folder: Path, found: RigCalibration) -> None:
    """Remove the pictures that an earlier run drew, which may be of other photos."""
    for place in _places(folder, found):
        remove_ours(place.glob(f"*{OVERLAY_MARK}.*"))


def _places(folder: Path, found: RigCalibration) -> Iterator[Path]:
    """Where the pictures of each camera are."""
    for name in folder_names(found.observations.camera_names):
        yield folder / CAMERAS / name / OVERLAYS
