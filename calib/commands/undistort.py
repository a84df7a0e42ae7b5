"""The command `calib undistort`."""

from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from calib.commands.answers.cameras import camera_answer
from calib.commands.camera_argument import CameraArgument, read_camera
from calib.commands.folder_page import folder_page
from calib.show.screen import progress_bars, quoted
from designer.base.answer import StoppedError, Summary
from designer.base.words import printable

if TYPE_CHECKING:
    from calib.api.undistorting import UndistortedFiles

UNDISTORTED = "undistorted"
"""The kind of a folder's page."""


def undistort(
    camera: CameraArgument,
    photos: Annotated[list[str], typer.Argument(help="images, folders of images, or patterns such as 'run/*.png'")],
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

    named = read_camera(camera)
    undistorter = Undistorter(named.camera, alpha=alpha, focal_px=focal_px)
    try:
        with progress_bars() as progress:
            made = undistorter.write(photos, out, progress=progress)
    except UndistortionStoppedError as stop:
        raise StoppedError(str(stop), _summary(stop.so_far)) from None
    if made.left_out:
        print(f"left out: {made.left_out} undistorted photos of an earlier run")
    step = f"calib convert {quoted(made.camera_file)} --to colmap -o cameras.txt"
    _summarise(made)
    pages, remarks = folder_page(out, UNDISTORTED, lambda: (_keep(made, camera),))
    print(f"next  {step}  writes it for COLMAP")
    summary = _summary(made)
    remarks = (*named.remarks, *remarks)
    return replace(summary, wrote=(*summary.wrote, *pages), next_steps=(step,), remarks=remarks)


def _keep(made: "UndistortedFiles", camera_name: str) -> Path:
    """Write what the folder's page is built from."""
    from calib.api.undistorting import MARK
    from calib.show.photos.photos_file import write_photos
    from calib.show.photos.undistorted_photos import UndistortedPhoto, UndistortedSet, told_undistorted

    photos = tuple(UndistortedPhoto(one.photo.name, place.name, one.remarks) for one, place in made.good)
    names = {photo.path for photo in photos}
    earlier = sum(place.name not in names for place in made.folder.glob(f"*{MARK}.png"))
    told = UndistortedSet(camera_name, made.camera, made.pinhole, photos, made.failures, made.share_filled, earlier)
    return write_photos(made.folder, told_undistorted(told))


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


def _summarise(made: "UndistortedFiles") -> None:
    """What was done, what was not, and what the new camera is."""
    for failure in made.failures:
        print(f"skipped {printable(failure)}")
    for one, _ in made.good:
        for remark in one.remarks:
            print(f"{printable(one.photo.name)}: {remark}")
    fx, fy, cx, cy = made.pinhole.params
    before = made.camera.params[0]
    kept = "as the camera's" if fx == before else f"the camera has {before:.2f}"
    count = len(made.good)
    photos = "1 photo" if count == 1 else f"{count} photos"
    print(f"{photos} undistorted, {len(made.failures)} failures; focal length {fx:.2f} px ({kept})")
    if made.share_filled < 1:
        black = 100 * (1 - made.share_filled)
        print(f"  {black:.1f} % of the pixels are black: the photos show nothing there; --alpha 0 avoids it")
    print(f"wrote {made.folder}: NAME.undistorted.png")
    print(f"      {made.camera_file}: their pinhole, fx {fx:.3f} fy {fy:.3f} cx {cx:.3f} cy {cy:.3f} px")
