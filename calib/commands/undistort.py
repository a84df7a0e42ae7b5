"""The command `calib undistort`."""

import math
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from calib.cameras import LINEAR, pictures
from calib.commands.camera_argument import camera_answer, read_camera
from calib.commands.options import CameraArgument, PhotosArgument
from designer.base.answer import StoppedError, Summary
from designer.kinds.presets import one_of
from designer.page.progress import progress_bars
from designer.page.terminal import quoted, shown

if TYPE_CHECKING:
    from calib.show.photos.undistorted_photos import UndistortedFiles


def undistort(
    camera: CameraArgument,
    photos: PhotosArgument,
    *,
    out: Annotated[Path, typer.Option("--out", "-o", help="folder for the photos and the new camera file")],
    to: Annotated[
        str,
        typer.Option(
            help=f"what would have taken them: {', '.join(pictures())}", autocompletion=one_of(tuple(pictures()))
        ),
    ] = LINEAR,
    alpha: Annotated[
        float | None,
        typer.Option(
            min=0, max=1, help="0: no black regions; 1: all that the photos show (default: focal length kept)"
        ),
    ] = None,
    focal_px: Annotated[float | None, typer.Option(help="focal length of the new camera, in px")] = None,
    field: Annotated[str, typer.Option(help="horizontal field of view: 100deg (default: as the focal length)")] = "",
    yaw: Annotated[str, typer.Option(help="look to the right, by this angle")] = "0deg",
    pitch: Annotated[str, typer.Option(help="look up, by this angle")] = "0deg",
) -> Summary:
    """Resample photos to what a pinhole camera would have taken, or a cylinder or sphere around a wide lens.

    Each becomes NAME.undistorted.png with its bit depth and channels. The new camera.json belongs to them.
    """
    from calib.api.undistorting import Undistorter, UndistortionStoppedError
    from calib.commands.photo_screen import say_photos, with_photos_page
    from calib.renderer.quantities import bounded, parse_degrees
    from calib.show.photos.undistorted_photos import next_step, told_undistorted

    named = read_camera(camera)
    undistorter = Undistorter(
        named.camera, to=to, alpha=alpha, focal_px=focal_px,
        field_rad=math.radians(bounded("--field", field, parse_degrees, 1, 360, "deg")) if field else None,
        yaw_rad=math.radians(bounded("--yaw", yaw, parse_degrees, -180, 180, "deg")),
        pitch_rad=math.radians(bounded("--pitch", pitch, parse_degrees, -180, 180, "deg")),
    )  # fmt: skip
    try:
        with progress_bars() as progress:
            made = undistorter.write(photos, out, progress=progress)
    except UndistortionStoppedError as stop:
        raise StoppedError(str(stop), _summary(stop.so_far)) from None
    told = told_undistorted(made, camera)
    say_photos(told)
    print(f"wrote {shown(out)}: NAME.undistorted.png, and {made.camera_file.name}, which belongs to them")
    step = next_step(made, quoted(made.camera_file))
    line = f"{step.line}   # {step.purpose}"
    summary = with_photos_page(replace(_summary(made), next_steps=(line,), remarks=named.remarks), out, told)
    print(f"next  {line}")
    return summary


def _summary(made: "UndistortedFiles") -> Summary:
    """The same for a program, of a stopped run too."""
    return Summary(
        {
            "undistorted": len(made.good),
            "failures": made.failures,
            "camera_file": str(made.camera_file),
            "camera": camera_answer(made.new_camera),
            "equation": pictures()[made.new_camera.model].equation,
            "cam_from_new": made.cam_from_new.tolist(),
            "per_photo": [
                {"image": one.photo.name, "path": str(one.photo.path), "undistorted": str(place),
                 "share_filled": one.share_filled, "remarks": one.remarks}
                for one, place in made.good
            ],
        },
        made.files,
    )  # fmt: skip
