"""The command `calib pose`."""

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from calib.commands.camera_argument import read_camera
from calib.commands.options import PhotoJobsOption, TargetArgument, WeightedOption
from designer.base.answer import Summary
from designer.base.errors import InputError
from designer.base.words import printable
from designer.kinds.presets import camera_templates
from designer.page.progress import progress_bars
from designer.page.terminal import shown

if TYPE_CHECKING:
    from calib.observe.target_poses import PoseResult

NO_POSE = 1


def pose(
    target: TargetArgument,
    camera: Annotated[
        str,
        typer.Argument(
            help="camera file of ours or of another tool, or a camera template; with --rig a folder of photos",
            autocompletion=camera_templates,
        ),
    ],
    photos: Annotated[
        list[str] | None, typer.Argument(help="images, folders of images, or patterns such as 'run/*.png'")
    ] = None,
    *,
    rig: Annotated[
        Path | None,
        typer.Option(
            help="instead of a camera: the target in the frame of this rig, from a folder a camera, or one that holds "
            "these: calib pose --rig rig.json TARGET FOLDER..."
        ),
    ] = None,
    out: Annotated[Path | None, typer.Option("--out", "-o", help="poses to write, .json or .csv")] = None,
    overlay: Annotated[
        Path | None, typer.Option(help="folder for pictures with the axes and the residuals", metavar="DIR")
    ] = None,
    weighted: WeightedOption = True,
    jobs: PhotoJobsOption = None,
) -> Summary:
    """Find where a known camera stood before the target, and how surely, photo by photo; or the target before a rig.

    The exit code is 1 if no photo gives a pose.
    """
    from calib.api.posing import pose as find_poses
    from calib.commands.photo_screen import poses_answer, say_photos, with_photos_page
    from calib.observe.target_poses import check_output
    from calib.show.photos.posed_photos import told_posed

    if overlay is not None and overlay.exists() and not overlay.is_dir():
        raise InputError(f"{overlay}: is a file, not a folder; choose another with --overlay")
    if rig is not None:
        from calib.commands.pose_rig import pose_before_rig

        return pose_before_rig(target, rig, [camera, *(photos or ())], out, overlay, weighted=weighted, jobs=jobs)
    if not photos:
        raise InputError("no photos; give images, folders of images, or patterns, after the camera's file")
    named = read_camera(camera)
    if out is not None:
        check_output(out)
    with progress_bars() as progress:
        found = find_poses(target, named.camera, photos, weighted=weighted, jobs=jobs, progress=progress)
    if out is not None:
        found.save(out)
    drawn, pictures = ({}, ()) if overlay is None else _drawn(found, overlay)
    told = told_posed(found, target, camera, out, drawn)
    say_photos(told)
    if out is not None:
        print(f"wrote {shown(out)}: cam_from_target and its covariance, photo by photo")
    elif found.poses:
        print("next  the same command with -o poses.json keeps the poses")
    summary = Summary(
        poses_answer(found), (*(() if out is None else (out,)), *pictures), remarks=named.remarks,
        exit_code=0 if found.poses else NO_POSE,
    )  # fmt: skip
    return summary if overlay is None or not pictures else with_photos_page(summary, overlay, told, found.target)


def _drawn(found: "PoseResult", folder: Path) -> tuple[dict[str, str], tuple[Path, ...]]:
    """Draw the photos that have a pose; names of the pictures by those of the photos, and their places."""
    from calib.observe.overlays import keep_pictures, no_empty_folders, staging_folder
    from calib.show.photos.pose_overlay import draw_poses

    with no_empty_folders(folder), staging_folder(folder) as staging:
        drawn, failures = draw_poses(found, staging)
        pictures = keep_pictures(staging, folder)
    for failure in failures:
        print(printable(failure))
    return drawn, pictures
