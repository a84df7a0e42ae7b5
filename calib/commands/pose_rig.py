"""`calib pose --rig`."""

from pathlib import Path
from typing import TYPE_CHECKING

from designer.base.answer import Summary
from designer.base.words import printable
from designer.page.progress import progress_bars
from designer.page.terminal import shown

if TYPE_CHECKING:
    from calib.records.rig_poses_file import RigPoseResult

NO_POSE = 1


def pose_before_rig(
    target: Path,
    rig: Path,
    folders: list[str],
    out: Path | None,
    overlay: Path | None,
    *,
    weighted: bool,
    jobs: int | None,
) -> Summary:
    """Find where the target is in the rig's frame, and how surely, frame by frame."""
    from calib.api.posing import pose as find_poses
    from calib.commands.photo_screen import rig_poses_answer, say_photos, with_photos_page
    from calib.records.rig_poses_file import check_rig_poses_output
    from calib.show.photos.posed_rig import poses_table, told_before_rig
    from designer.page.terminal import say_table

    if out is not None:
        check_rig_poses_output(out)
    with progress_bars() as progress:
        found = find_poses(target, photos=folders, rig=rig, weighted=weighted, jobs=jobs, progress=progress)
    if out is not None:
        found.save(out)
    drawn, pictures = ({}, ()) if overlay is None else _drawn(found, overlay)
    told = told_before_rig(found, target, rig, out, drawn)
    say_photos(told, has_table=False)
    if found.poses:
        say_table(poses_table(found))
    if out is not None:
        print(f"wrote {shown(out)}: rig_from_target and its covariance, frame by frame")
    elif found.poses:
        print("next  the same command with -o poses.json keeps the poses")
    summary = Summary(
        rig_poses_answer(found), (*(() if out is None else (out,)), *pictures), remarks=found.photos.remarks,
        exit_code=0 if found.poses else NO_POSE,
    )  # fmt: skip
    return summary if overlay is None or not pictures else with_photos_page(summary, overlay, told)


def _drawn(found: "RigPoseResult", folder: Path) -> tuple[dict[tuple[str, str], str], tuple[Path, ...]]:
    """Draw the photos of frames that have a pose, a folder a camera; paths of the pictures by camera and photo."""
    from calib.observe.overlays import keep_pictures, no_empty_folders, staging_folder
    from calib.records.rig_file import folder_names
    from calib.show.photos.pose_overlay import draw_poses
    from calib.show.photos.posed_rig import posed_alone

    drawn: dict[tuple[str, str], str] = {}
    pictures: list[Path] = []
    with no_empty_folders(folder):
        names = found.photos.camera_names
        for number, (name, place) in enumerate(zip(names, folder_names(names), strict=True)):
            with no_empty_folders(folder / place), staging_folder(folder / place) as staging:
                made, failures = draw_poses(posed_alone(found, number), staging)
                pictures += keep_pictures(staging, folder / place)
            drawn |= {(name, image): f"{place}/{picture}" for image, picture in made.items()}
            for failure in failures:
                print(printable(failure))
    return drawn, tuple(pictures)
