"""The command `calib undistort`."""

from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from calib.commands.camera_argument import camera_answer, read_camera
from calib.commands.options import CameraArgument, PhotosArgument
from calib.show.screen import progress_bars
from designer.base.answer import StoppedError, Summary
from designer.page.terminal import quoted, shown

if TYPE_CHECKING:
    from calib.show.photos.undistorted_photos import UndistortedFiles


def undistort(
    camera: CameraArgument,
    photos: PhotosArgument,
    *,
    out: Annotated[Path, typer.Option("--out", "-o", help="folder for the photos and the new camera file")],
    alpha: Annotated[
        float | None,
        typer.Option(
            min=0, max=1, help="0: no black regions; 1: all that the photos show (default: focal length kept)"
        ),
    ] = None,
    focal_px: Annotated[float | None, typer.Option(help="focal length of the new camera, in px")] = None,
) -> Summary:
    """Resample photos to what a pinhole camera would have taken.

    Each becomes NAME.undistorted.png with its bit depth and channels. The new camera.json belongs to them.
    """
    from calib.api.undistorting import Undistorter, UndistortionStoppedError
    from calib.commands.photo_screen import say_photos, with_photos_page
    from calib.show.photos.undistorted_photos import told_undistorted

    named = read_camera(camera)
    undistorter = Undistorter(named.camera, alpha=alpha, focal_px=focal_px)
    try:
        with progress_bars() as progress:
            made = undistorter.write(photos, out, progress=progress)
    except UndistortionStoppedError as stop:
        raise StoppedError(str(stop), _summary(stop.so_far)) from None
    told = told_undistorted(made, camera)
    say_photos(told)
    print(f"wrote {shown(out)}: NAME.undistorted.png, and {made.camera_file.name}, which belongs to them")
    step = f"calib convert {quoted(made.camera_file)} --to colmap -o cameras.txt   # or opencv, ros, kalibr, ..."
    summary = with_photos_page(replace(_summary(made), next_steps=(step,), remarks=named.remarks), out, told)
    print(f"next  {step}")
    return summary


def _summary(made: "UndistortedFiles") -> Summary:
    """The same for a program, of a stopped run too."""
    return Summary(
        {
            "undistorted": len(made.good),
            "failures": made.failures,
            "camera_file": str(made.camera_file),
            "camera": camera_answer(made.pinhole),
            "per_photo": [
                {"image": one.photo.name, "path": str(one.photo.path), "undistorted": str(place),
                 "share_filled": one.share_filled, "remarks": one.remarks}
                for one, place in made.good
            ],
        },
        made.files,
    )  # fmt: skip
