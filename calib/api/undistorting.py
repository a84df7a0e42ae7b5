"""Photos as a camera without a lens would have taken them: an array, or files into a folder."""

import math
from collections.abc import Collection, Iterable, Iterator
from os import PathLike, fspath
from pathlib import Path

import cv2
import numpy as np
from numpy.typing import NDArray

from calib.api.detecting import Pixels, require_image
from calib.api.searching import refuse_nothing
from calib.app.inputs import (
    Place,
    camera_of,
    folder_of,
    photos_of,
)
from calib.cameras import ABILITIES, LINEAR, pictures, undistortion
from calib.cameras.camera import CAMERA, Camera, camera_to_json
from calib.cameras.camera import load_camera as load_own_camera
from calib.cameras.picture_of import looking, picture_of
from calib.cameras.undistortion import Undistorted
from calib.images.photo import Grey, read_colour
from calib.observe.photos import PhotoFile, named_photos, require_size, why_failed
from calib.renderer.quantities import choice, real
from calib.show.photos.photos_file import PHOTOS_FILE, read_photos
from calib.show.photos.undistorted_photos import CAMERA_FILE, MARK, UndistortedFile, UndistortedFiles
from designer.base.errors import InputError
from designer.base.files import distinct_stems, write_files
from designer.base.own_files import require_ours
from designer.page.progress import Progress, unheard

FOCAL_RANGE_PX = (1.0, 1e7)
LEAST_FIELD_RAD = math.radians(1)
Array = NDArray[np.float64]


class Undistorter:
    """Straightens many photos of one camera: `Undistorter("camera.json").undistort(image)`.

    >>> straight = calib.Undistorter("camera.json", alpha=0)
    >>> straight.undistort(frame).pixels, straight.new_camera.matrix
    >>> side = calib.Undistorter("fisheye.json", field_rad=1.5, yaw_rad=1.2)
    >>> around = calib.Undistorter("fisheye.json", to="cylinder").write("photos/*.jpg", "undistorted")

    `new_camera` is the camera of the undistorted photos, whose frame is turned against the camera's by `cam_from_new`
    (3, 3); its files, `project` and `rays` are of them.

    Args:
        camera: that took the photos: a camera, a file, or a template.
        to: what would have taken them: a pinhole, or pictures by angles for what no pinhole shows.
        alpha: of a pinhole; 0: no black regions; 1: all that the photos show; None: the focal length is kept.
        focal_px: of the new camera, in px, or px per radian; None: as `alpha` or `field_rad` says.
        field_rad: horizontal field of view, the axis in its middle; None: that of the focal length, or all there is.
        yaw_rad: by which the new camera looks to the right.
        pitch_rad: and up.

    Raises:
        InputError: a file that cannot be read, or a picture that cannot be.
    """

    def __init__(
        self,
        camera: Camera | Place,
        *,
        to: str = LINEAR,
        alpha: float | None = None,
        focal_px: float | None = None,
        field_rad: float | None = None,
        yaw_rad: float = 0.0,
        pitch_rad: float = 0.0,
    ) -> None:
        if alpha is not None and focal_px is not None:
            raise InputError("--alpha and --focal-px both set the focal length; give one of them")
        if alpha is not None:
            real("--alpha", alpha, 0, 1)
        if focal_px is not None:
            real("--focal-px", focal_px, *FOCAL_RANGE_PX)
        if field_rad is not None:
            real("--field", field_rad, LEAST_FIELD_RAD, math.tau, " rad")
        turned = (
            real("--yaw", yaw_rad, -math.pi, math.pi, " rad"),
            real("--pitch", pitch_rad, -math.pi, math.pi, " rad"),
        )
        self.camera = camera_of(camera)
        self.cam_from_new = looking(*turned)
        self.new_camera = picture_of(
            self.camera, choice("--to", to, tuple(pictures())), alpha=alpha, focal_px=focal_px, field_rad=field_rad,
            cam_from_new=self.cam_from_new if any(turned) else None,
        )  # fmt: skip

    @property
    def source_px(self) -> Array:
        """Where new pixels lie in the photo, nan where they do not; `cv2.remap` takes it in float32.  # (H, W, 2)"""
        return undistortion.source_places(
            self.camera, self.new_camera, 0, self.new_camera.image_size[1], self.cam_from_new
        )

    def undistort(self, image: Pixels | Place, progress: Progress = unheard) -> Undistorted:
        """A photo as the new camera would have taken it, with the bit depth and channels of the photo.

        Args:
            image: (H, W), or (H, W, C), of 8 or 16 bits; or a file.
            progress: is told the share that is done.

        Raises:
            InputError: no such file, no image, one of another size than the camera's, or nothing would be seen in it.
        """
        return self._made(fspath(image) if isinstance(image, str | PathLike) else "the image", image, progress)

    def write(
        self, photos: Place | Iterable[Place], folder: Place, *, progress: Progress = unheard
    ) -> UndistortedFiles:
        """Write each photo as `NAME.undistorted.png` into a folder, with the `camera.json` that belongs to them.

        Args:
            photos: images, folders of images, or patterns.
            folder: for the files; an earlier run's may be there.
            progress: is told how many are done.

        Raises:
            InputError: a folder of somebody else's or of another camera, or not one photo that can be undistorted.
            UndistortionStoppedError: by a person; it says what is finished and stays.
        """
        place = folder_of(folder)
        asked = photos_of(photos)
        named = named_photos(asked.paths)
        mine = [photo for photo in named if not Path(photo.name).stem.endswith(MARK)]
        _check_out(
            place,
            self.new_camera,
            self.cam_from_new,
            {f"{stem}{MARK}.png" for stem in distinct_stems([one.name for one in mine])},
        )
        done: list[UndistortedFile] = []
        try:
            for one in self._written(mine, place, progress):
                done.append(one)
        except KeyboardInterrupt:
            so_far = self._files(place, done, asked.failures, 0)
            raise UndistortionStoppedError(so_far, len(mine)) from None
        made = self._files(place, done, asked.failures, len(named) - len(mine))
        if not made.good:
            refuse_nothing(made.failures, "no photos to undistort")
        return made

    def _files(
        self, folder: Path, done: list[UndistortedFile], missing: tuple[str, ...], left_out: int
    ) -> UndistortedFiles:
        return UndistortedFiles(folder, self.camera, self.new_camera, tuple(done), missing, left_out, self.cam_from_new)

    def _written(self, photos: list[PhotoFile], folder: Path, progress: Progress) -> Iterator[UndistortedFile]:
        """One photo after the other; the new camera's file comes with the first that succeeds."""
        total, has_camera = len(photos), False
        for number, (photo, stem) in enumerate(zip(photos, distinct_stems([one.name for one in photos]), strict=True)):

            def tell(_: str, share: float, __: int, before: int = number) -> None:
                progress("undistorting", before + 0.9 * share, total)

            made = self._file(photo, folder / f"{stem}{MARK}.png", tell)
            if not made.failure and not has_camera:
                write_files({folder / CAMERA_FILE: camera_to_json(self.new_camera).encode()})
                has_camera = True
            yield made
            progress("undistorting", number + 1, total)

    def _file(self, photo: PhotoFile, result: Path, progress: Progress) -> UndistortedFile:
        """One photo from file to file. No fault of a photo ends the run."""
        try:
            image = read_colour(photo.path)
            undistorted = self._made(str(photo.path), image.pixels, progress)
            write_files({result: _png(undistorted.pixels)})
        except Exception as error:
            return UndistortedFile(photo, failure=why_failed(error, f"{photo.path}: cannot be undistorted"))
        return UndistortedFile(photo, result, undistorted.share_filled, image.remarks)

    def _made(self, name: str, image: Pixels | Place, progress: Progress) -> Undistorted:
        pixels = read_colour(Path(image)).pixels if isinstance(image, str | PathLike) else require_image(image)
        if pixels.dtype not in (np.dtype(np.uint8), np.dtype(np.uint16)):
            raise InputError(f"an image of {pixels.dtype}: give uint8 or uint16")
        require_size(name, pixels, self.camera)
        made = undistortion.undistort(
            pixels, self.camera, self.new_camera, cam_from_new=self.cam_from_new,
            progress=lambda share: progress("undistorting", share, 1),
        )  # fmt: skip
        if not made.share_filled:
            raise InputError(
                f"{name}: all of the undistorted photo would be black: the camera knows no light there; "
                "check the camera file"
            )
        return made


class UndistortionStoppedError(KeyboardInterrupt):
    """A person stopped it: what is finished is `error.so_far`."""

    def __init__(self, so_far: UndistortedFiles, asked: int) -> None:
        super().__init__(f"stopped; {len(so_far.good)} of {asked} photos are in {so_far.folder}")
        self.so_far = so_far


def undistort(
    image: Pixels | Place,
    camera: Camera | Place,
    *,
    to: str = LINEAR,
    alpha: float | None = None,
    focal_px: float | None = None,
    field_rad: float | None = None,
    yaw_rad: float = 0.0,
    pitch_rad: float = 0.0,
) -> Undistorted:
    """Resample a photo to what a camera without a lens would have taken: `undistort(image, "camera.json").pixels`.

    Args:
        image: as `Undistorter.undistort` has it, which is for many photos and tells the new camera.
        camera: that took it: a camera, a file, or a template.
        to: what would have taken it: a pinhole, or pictures by angles for what no pinhole shows.
        alpha: of a pinhole; 0: no black regions; 1: all that the photo shows; None: the focal length is kept.
        focal_px: of the new camera, in px, or px per radian.
        field_rad: horizontal field of view; None: that of the focal length, or all there is.
        yaw_rad: by which the new camera looks to the right.
        pitch_rad: and up.

    Raises:
        InputError: a file that cannot be read, an image of another size, or a picture that cannot be.
    """
    asked = Undistorter(
        camera, to=to, alpha=alpha, focal_px=focal_px, field_rad=field_rad, yaw_rad=yaw_rad, pitch_rad=pitch_rad
    )
    return asked.undistort(image)


def _check_out(folder: Path, new_camera: Camera, cam_from_new: Array, replaced: Collection[str]) -> None:
    """Refuse a folder that is none, or will hold photos of another camera, before any work is done."""
    place = folder / CAMERA_FILE
    if folder.exists() and not folder.is_dir():
        raise InputError(f"{folder}: is a file, not a folder; choose another with -o")
    require_ours(place, kind=CAMERA.format)
    if not place.exists() or not place.stat().st_size:
        return
    there = load_own_camera(place)
    if ABILITIES[there.model].picture is None:
        raise InputError(f"{place}: exists and is no camera of undistorted photos; choose another folder with -o")
    is_same = there.to_json() == new_camera.to_json() and np.allclose(_direction_in(folder), cam_from_new)
    if not is_same and any(one.name not in replaced for one in folder.glob(f"*{MARK}.png")):
        raise InputError(
            f"{place}: is of another camera or direction, and photos of it are in the folder; "
            "choose another folder with -o"
        )


def _direction_in(folder: Path) -> Array:
    """Where the new camera of an earlier run looked, as far as that is known."""
    if not (folder / PHOTOS_FILE).exists():
        return np.eye(3)
    try:
        turned = read_photos(folder).cam_from_new
    except InputError:
        return np.eye(3)
    return np.eye(3) if turned is None else turned


def _png(pixels: Grey) -> bytes:
    done, data = cv2.imencode(".png", pixels, [cv2.IMWRITE_PNG_COMPRESSION, 3])
    if not done:
        raise InputError(f"{pixels.shape[1]} x {pixels.shape[0]} px are more than an image file holds")
    return data.tobytes()
