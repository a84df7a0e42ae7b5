"""The command `calib undistort`."""

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from calib.commands.answers.cameras import camera_answer
from calib.commands.camera_argument import CameraArgument, read_camera
from calib.commands.folder_page import folder_page
from calib.show.screen import quoted
from designer.answer import StoppedError, Summary
from designer.command import printable
from designer.errors import InputError

if TYPE_CHECKING:
    from calib.cameras.camera import Camera
    from calib.cameras.resample import Pixels
    from calib.observe.photos import PhotoFile

MARK = ".undistorted"
"""Stands in the name of each undistorted photo, so that one is not taken for a photo of the camera."""
CAMERA_FILE = "camera.json"
UNDISTORTED = "undistorted"
"""The kind of a folder's page."""
FOCAL_RANGE_PX = (1.0, 1e7)


@dataclass(frozen=True)
class _Done:
    """What came of one photo."""

    photo: "PhotoFile"
    place: Path | None = None  # of the undistorted photo; None: there is none
    share_filled: float = 0.0
    remarks: tuple[str, ...] = ()
    failure: str = ""  # one line that names the file


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
    from calib.api.searching import refuse_nothing
    from calib.cameras.undistortion import pinhole_of
    from calib.observe.photos import find_photos, named_photos

    if alpha is not None and focal_px is not None:
        raise InputError("--alpha and --focal-px both set the focal length; give one of them")
    if alpha is not None and math.isnan(alpha):
        raise InputError("--alpha nan: must be from 0 to 1")
    if focal_px is not None and not FOCAL_RANGE_PX[0] <= focal_px <= FOCAL_RANGE_PX[1]:
        raise InputError(f"--focal-px {focal_px:g}: must be from {FOCAL_RANGE_PX[0]:g} to {FOCAL_RANGE_PX[1]:g}")
    named_camera = read_camera(camera)
    taken = named_camera.camera
    pinhole = pinhole_of(taken, alpha=alpha, focal_px=focal_px)
    place = out / CAMERA_FILE
    _check_out(out, place)
    found = find_photos(photos)
    named = named_photos(found.paths)
    files = [photo for photo in named if not Path(photo.name).stem.endswith(MARK)]
    done = _undistort_all(files, place, taken, pinhole)
    failures = [*found.failures, *(one.failure for one in done if one.failure)]
    if all(one.failure for one in done):
        refuse_nothing(failures, "no photos to undistort")
    if len(named) > len(files):
        print(f"left out: {len(named) - len(files)} undistorted photos of an earlier run")
    step = f"calib convert {quoted(place)} --to colmap -o cameras.txt"
    _summarise(done, failures, taken, pinhole, place)
    pages, remarks = folder_page(out, UNDISTORTED, lambda: (_keep(out, camera, taken, pinhole, done, failures),))
    print(f"next  {step}  writes it for COLMAP")
    summary = _summary(done, failures, place, pinhole)
    remarks = (*named_camera.remarks, *remarks)
    return replace(summary, wrote=(*summary.wrote, *pages), next_steps=(step,), remarks=remarks)


def _keep(
    out: Path, camera_name: str, taken: "Camera", pinhole: "Camera", done: "Sequence[_Done]", failures: Sequence[str]
) -> Path:
    """Write what the folder's page is built from."""
    from calib.report.photos_file import write_photos
    from calib.report.undistorted_photos import UndistortedPhoto, UndistortedSet, told_undistorted

    good = [(one, one.place) for one in done if one.place is not None]
    photos = tuple(UndistortedPhoto(one.photo.name, place.name, one.remarks) for one, place in good)
    names = {photo.path for photo in photos}
    earlier = sum(place.name not in names for place in out.glob(f"*{MARK}.png"))
    filled = min(one.share_filled for one, _ in good)
    made = UndistortedSet(camera_name, taken, pinhole, photos, tuple(failures), filled, earlier)
    return write_photos(out, told_undistorted(made))


def _summary(done: Sequence[_Done], failures: Sequence[str], place: Path, pinhole: "Camera") -> Summary:
    """The same for a program, of a stopped run too."""
    good = [one for one in done if one.place is not None]
    return Summary(
        {
            "undistorted": len(good),
            "failures": list(failures),
            "camera_file": str(place),
            "camera": camera_answer(pinhole),
            "per_photo": [
                {"image": one.photo.name, "path": str(one.photo.path), "undistorted": str(one.place),
                 "share_filled": one.share_filled, "remarks": one.remarks}
                for one in good
            ],
        },
        (*(one.place for one in good if one.place is not None), *((place,) if good else ())),
    )  # fmt: skip


def _undistort_all(photos: "Sequence[PhotoFile]", place: Path, camera: "Camera", pinhole: "Camera") -> list[_Done]:
    """One photo after the other into the folder of the new camera's file, which comes with the first that succeeds."""
    from calib.cameras.camera_file import camera_to_json
    from calib.core.files import distinct_stems, write_files
    from calib.show.screen import progress_bar

    done: list[_Done] = []
    try:
        with progress_bar("undistorting", len(photos)) as tell:
            for photo, stem in zip(photos, distinct_stems([photo.name for photo in photos]), strict=True):
                result = place.with_name(f"{stem}{MARK}.png")
                is_first = all(one.failure for one in done)
                done.append(_one(photo, result, camera, pinhole, tell, len(done)))
                if is_first and not done[-1].failure:
                    write_files({place: camera_to_json(pinhole).encode()})
                tell(len(done))
    except KeyboardInterrupt:
        good = sum(not one.failure for one in done)
        failures = [one.failure for one in done if one.failure]
        raise StoppedError(
            f"stopped; {good} of {len(photos)} photos are in {place.parent}", _summary(done, failures, place, pinhole)
        ) from None
    return done


def _check_out(out: Path, place: Path) -> None:
    """Refuse a folder that is none, or holds another camera, before any work is done."""
    from calib.cameras.camera_file import FORMAT, load_camera
    from designer.own_files import require_ours

    if out.exists() and not out.is_dir():
        raise InputError(f"{out}: is a file, not a folder; choose another with -o")
    require_ours(place, kind=FORMAT)
    if place.exists() and place.stat().st_size and load_camera(place).model != "pinhole":
        raise InputError(f"{place}: exists and is no pinhole camera of an earlier run; choose another folder with -o")


def _one(
    photo: "PhotoFile", result: Path, camera: "Camera", pinhole: "Camera", tell: Callable[[float], None], before: int
) -> _Done:
    """One photo from file to file. No fault of a photo ends the run."""
    from calib.cameras.undistortion import undistort as undistort_pixels
    from calib.core.files import write_files
    from calib.observe.images import read_colour

    try:
        image = read_colour(photo.path)
        size = image.pixels.shape[1], image.pixels.shape[0]
        if size != camera.image_size:
            raise InputError(
                f"{photo.path}: has {size[0]} x {size[1]} px, but the camera file is of one with "
                f"{camera.image_size[0]} x {camera.image_size[1]} px; give photos and camera of one size"
            )
        undistorted = undistort_pixels(image.pixels, camera, pinhole, progress=lambda share: tell(before + 0.9 * share))
        if not undistorted.share_filled:
            raise InputError(
                f"{photo.path}: all of the undistorted photo would be black: the camera knows no light there; "
                "check the camera file"
            )
        write_files({result: _png(undistorted.pixels)})
    except InputError as error:
        return _Done(photo, failure=str(error))
    except Exception as error:
        return _Done(photo, failure=f"{photo.path}: cannot be undistorted: {type(error).__name__}: {error}")
    return _Done(photo, result, undistorted.share_filled, image.remarks)


def _png(pixels: "Pixels") -> bytes:
    import cv2

    done, data = cv2.imencode(".png", pixels, [cv2.IMWRITE_PNG_COMPRESSION, 3])
    if not done:
        raise InputError(f"{pixels.shape[1]} x {pixels.shape[0]} px are more than an image file holds")
    return data.tobytes()


def _summarise(
    done: Sequence[_Done], failures: Sequence[str], camera: "Camera", pinhole: "Camera", place: Path
) -> None:
    """What was done, what was not, and what the new camera is."""
    good = [one for one in done if not one.failure]
    for failure in failures:
        print(f"skipped {printable(failure)}")
    for one in good:
        for remark in one.remarks:
            print(f"{printable(one.photo.name)}: {remark}")
    fx, fy, cx, cy = pinhole.params
    kept = "as the camera's" if fx == camera.params[0] else f"the camera has {camera.params[0]:.2f}"
    black = 1 - min(one.share_filled for one in good)
    photos = "1 photo" if len(good) == 1 else f"{len(good)} photos"
    print(f"{photos} undistorted, {len(failures)} failures; focal length {fx:.2f} px ({kept})")
    if black > 0:
        print(f"  {100 * black:.1f} % of the pixels are black: the photos show nothing there; --alpha 0 avoids it")
    print(f"wrote {place.parent}: NAME{MARK}.png")
    print(f"      {place}: their pinhole, fx {fx:.3f} fy {fy:.3f} cx {cx:.3f} cy {cy:.3f} px")
