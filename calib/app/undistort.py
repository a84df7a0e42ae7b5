"""Photos as a camera without a lens would have taken them: `calib undistort`, `calib.undistort(image, camera)`."""

import math
from collections.abc import Collection
from dataclasses import dataclass
from os import PathLike, fspath
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

from calib.app.cameras_told import CameraNumbers, numbers_of, remarks_on
from calib.app.options import CameraFile, Photos
from calib.cameras import LINEAR, pictures
from designer.base.errors import InputError
from designer.base.marks import NOT_IN_FILE
from designer.base.options import checked, option
from designer.base.words import NAME
from designer.page.capability import capability, written_to
from designer.page.progress import Progress, unheard
from designer.page.result import Result

if TYPE_CHECKING:
    from calib.app.inputs import Place
    from calib.cameras.camera import Camera
    from calib.cameras.undistortion import Undistorted, UndistortionChange
    from calib.images.photo import Grey
    from calib.observe.photos import PhotoFile
    from designer.base.arrays import Array
    from designer.page.blocks import Page
    from designer.page.output import Output

MARK = ".undistorted"
"""Stands in the name of each undistorted photo, so that one is not taken for a photo of the camera."""
CAMERA_FILE, RESULT_FILE = "camera.json", "undistorted.json"
Picture = Annotated[
    str, option(f"what would have taken them: {', '.join(pictures())}", names=lambda: tuple(pictures()))
]
Alpha = Annotated[
    float | None, option("0: no black regions; 1: all that the photos show (default: focal length kept)", 0, 1)
]
Focal = Annotated[float | None, option("focal length of the new camera, in px", 1, 1e7, flag="--focal-px")]
Field = Annotated[
    float | None, option("horizontal field of view: 100deg (default: as the focal length)", math.radians(1), math.tau)
]
Yaw = Annotated[float, option("look to the right, by this angle", -math.pi, math.pi)]
Pitch = Annotated[float, option("look up, by this angle", -math.pi, math.pi)]


@dataclass(frozen=True)
class UndistortedPhoto:
    """One that was undistorted."""

    image: str
    path: str
    undistorted: str
    share_filled: float  # of its pixels; the others are black
    remarks: tuple[str, ...]


@dataclass(frozen=True, eq=False)
class UndistortedPhotos(
    Result, kind="undistorted", title="Undistorted photos",
    files={CAMERA_FILE: "the camera of the undistorted photos, and of them only: others have the camera's own file"},
):  # fmt: skip
    """What came of many photos: `made.new_camera`, `made.failures`."""

    folder: Annotated[Path, NOT_IN_FILE]
    taken_by: Annotated["Camera", NOT_IN_FILE]
    named: Annotated[str, NOT_IN_FILE]  # that camera, as it was given
    new_camera: Annotated["Camera", NOT_IN_FILE]  # that the undistorted ones are of, in `camera_file`
    change: Annotated["UndistortionChange", NOT_IN_FILE]
    left_out: Annotated[int, NOT_IN_FILE]  # undistorted photos of an earlier run among those given
    earlier: Annotated[int, NOT_IN_FILE]  # in the folder, that are not of this set
    undistorted: int
    failures: tuple[str, ...]  # of the others, a line each
    camera_file: str
    camera: CameraNumbers
    equation: str
    cam_from_new: "Array"  # (3, 3) where the new camera looks
    per_photo: tuple[UndistortedPhoto, ...]
    remarks: tuple[str, ...]

    @property
    def share_filled(self) -> float:
        """Of the pixels of the worst photo; the others are black."""
        return min(one.share_filled for one in self.per_photo)

    def page(self) -> "Page":
        """What would have taken the photos, its camera, and what moved."""
        from calib.app.undistort_page import undistorted_page

        return undistorted_page(self, is_drawn=True)

    def words(self, page: "Page | None" = None) -> "Page":
        """The same without pictures."""
        from calib.app.undistort_page import undistorted_page

        return undistorted_page(self, is_drawn=False)


class Undistorter:
    """Straightens many photos of one camera: `Undistorter("camera.json").undistort(image)`.

    >>> straight = calib.Undistorter("camera.json", alpha=0)
    >>> straight.undistort(frame).pixels, straight.new_camera.matrix
    >>> side = calib.Undistorter("fisheye.json", field_rad=1.5, yaw_rad=1.2)

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

    @checked
    def __init__(
        self, camera: CameraFile, *, to: Picture = LINEAR, alpha: Alpha = None, focal_px: Focal = None,
        field_rad: Field = None, yaw_rad: Yaw = 0.0, pitch_rad: Pitch = 0.0,
    ) -> None:  # fmt: skip
        from calib.app.inputs import load_camera
        from calib.cameras.picture_of import looking, picture_of

        if alpha is not None and focal_px is not None:
            raise InputError("--alpha and --focal-px both set the focal length; give one of them")
        self.camera, self.cam_from_new = load_camera(camera), looking(yaw_rad, pitch_rad)
        self.turn = self.cam_from_new if yaw_rad or pitch_rad else None
        self.new_camera = picture_of(
            self.camera, to, alpha=alpha, focal_px=focal_px, field_rad=field_rad, cam_from_new=self.turn
        )

    @property
    def source_px(self) -> "Array":
        """Where new pixels lie in the photo, nan where they do not; `cv2.remap` takes it in float32.  # (H, W, 2)"""
        from calib.cameras.undistortion import source_places

        return source_places(self.camera, self.new_camera, 0, self.new_camera.image_size[1], self.cam_from_new)

    def undistort(self, image: "Grey | Place", progress: Progress = unheard) -> "Undistorted":
        """A photo as the new camera would have taken it, with the bit depth and channels of the photo.

        Args:
            image: (H, W), or (H, W, C), of 8 or 16 bits; or a file.
            progress: is told the share that is done.

        Raises:
            InputError: no such file, no image, one of another size than the camera's, or nothing would be seen in it.
        """
        from calib.images.photo import read_colour, require_image

        if isinstance(image, str | PathLike):
            return self.straightened(fspath(image), read_colour(Path(image)).pixels, progress)
        return self.straightened("the image", require_image(image), progress)

    def straightened(self, name: str, pixels: "Grey", progress: Progress = unheard) -> "Undistorted":
        """The same of pixels, with the name for messages."""
        import numpy as np

        from calib.cameras import undistortion
        from calib.observe.photos import require_size

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


def undistort(
    image: "Grey | Place", camera: CameraFile, *, to: Picture = LINEAR, alpha: Alpha = None, focal_px: Focal = None,
    field_rad: Field = None, yaw_rad: Yaw = 0.0, pitch_rad: Pitch = 0.0,
) -> "Undistorted":  # fmt: skip
    """Resample a photo to what a camera without a lens would have taken: `undistort(image, "camera.json").pixels`.

    Args:
        image: as `Undistorter.undistort` has it, which is for many photos and tells the new camera.
        camera: that took it, and the rest as `Undistorter` takes it.
        to: what would have taken it.
        alpha: 0: no black regions; 1: all that the photo shows; None: the focal length is kept.
        focal_px: of the new camera.
        field_rad: horizontal field of view.
        yaw_rad: by which the new camera looks to the right.
        pitch_rad: and up.

    Raises:
        InputError: a file that cannot be read, an image of another size, or a picture that cannot be.
    """
    straight = Undistorter(
        camera, to=to, alpha=alpha, focal_px=focal_px, field_rad=field_rad, yaw_rad=yaw_rad, pitch_rad=pitch_rad
    )
    return straight.undistort(image)


@capability
def undistort_photos(
    camera: CameraFile,
    photos: Photos,
    *,
    out: Annotated["Output | Place", written_to("folder for the photos and the new camera file")],
    to: Picture = LINEAR,
    alpha: Alpha = None,
    focal_px: Focal = None,
    field_rad: Field = None,
    yaw_rad: Yaw = 0.0,
    pitch_rad: Pitch = 0.0,
    progress: Progress = unheard,
) -> UndistortedPhotos:
    """Resample photos to what a pinhole camera would have taken: `undistort_photos("camera.json", "in", out="out")`.

    Or a cylinder or sphere around a wide lens. Each becomes NAME.undistorted.png with its bit depth and channels. The
    new camera.json belongs to them.

    >>> calib.undistort_photos("fisheye.json", "photos/*.jpg", out="around", to="cylinder").new_camera

    Raises:
        InputError: a folder of somebody else's or of another camera, or not one photo that can be undistorted.
    """
    from calib.app.inputs import in_order, opened_camera, photos_of
    from calib.cameras.camera import camera_to_json
    from calib.cameras.undistortion import change_of
    from calib.observe.photos import named_photos
    from calib.observe.search import refuse_nothing
    from designer.base.files import distinct_stems
    from designer.page.output import output_of

    opened = opened_camera(in_order(camera, "calib undistort CAMERA PHOTO...", camera=camera, photos=photos)).read
    output = output_of(out)
    straight = Undistorter(
        opened.camera, to=to, alpha=alpha, focal_px=focal_px, field_rad=field_rad, yaw_rad=yaw_rad, pitch_rad=pitch_rad
    )
    name = fspath(camera) if isinstance(camera, str | PathLike) else f"model {opened.camera.model}"
    asked, folder = photos_of(photos), output.place
    given = named_photos(asked.photos)
    mine = [photo for photo in given if not Path(photo.name).stem.endswith(MARK)]
    places = [folder / f"{stem}{MARK}.png" for stem in distinct_stems([one.name for one in mine])]
    _check_out(folder, straight, [place.name for place in places])
    made, failures = list[UndistortedPhoto](), list(asked.failures)
    for number, (photo, place) in enumerate(zip(mine, places, strict=True)):

        def tell(_: str, share: float, __: int, before: int = number) -> None:
            progress("undistorting", before + 0.9 * share, len(mine))

        done = _file(straight, photo, place, output, tell)
        if isinstance(done, str):
            failures.append(done)
        else:
            if not made:
                output.write({folder / CAMERA_FILE: camera_to_json(straight.new_camera).encode()})
                output.finished.append(folder)
            made.append(done)
        progress("undistorting", number + 1, len(mine))
    if not made:
        refuse_nothing(failures, "no photos to undistort")
    written = {place.name for place in output.files}
    result = UndistortedPhotos(
        folder=folder, taken_by=straight.camera, named=name, new_camera=straight.new_camera,
        change=change_of(straight.camera, straight.new_camera, straight.turn), left_out=len(given) - len(mine),
        earlier=sum(place.name not in written for place in folder.glob(f"*{MARK}.png")), undistorted=len(made),
        failures=tuple(failures), camera_file=str(folder / CAMERA_FILE), camera=numbers_of(straight.new_camera),
        equation=pictures()[straight.new_camera.model].equation, cam_from_new=straight.cam_from_new,
        per_photo=tuple(made), remarks=(*asked.remarks, *remarks_on(name, opened)),
    )  # fmt: skip
    output.files += result.save(folder, has_page=False)
    return result


def _file(
    straight: Undistorter, photo: "PhotoFile", place: Path, output: "Output", progress: Progress
) -> UndistortedPhoto | str:
    """One photo from file to file, or why not, in a line: no fault of a photo ends the run."""
    import cv2

    from calib.images.photo import read_colour
    from calib.observe.photos import why_failed

    try:
        image = read_colour(photo.path) if photo.opened is None else photo.opened()
        made = straight.straightened(str(photo.path), image.pixels, progress)
        is_done, data = cv2.imencode(".png", made.pixels, [cv2.IMWRITE_PNG_COMPRESSION, 3])
        if not is_done:
            raise InputError(f"{made.pixels.shape[1]} x {made.pixels.shape[0]} px are more than an image file holds")
        output.write({place: data.tobytes()})
    except Exception as error:
        return why_failed(error, f"{photo.path}: cannot be undistorted")
    return UndistortedPhoto(photo.name, str(photo.path), str(place), made.share_filled, image.remarks)


def _check_out(folder: Path, straight: Undistorter, replaced: Collection[str]) -> None:
    """Refuse a folder that is none, or will hold photos of another camera, before any work is done."""
    import numpy as np

    from calib.cameras import ABILITIES
    from calib.cameras.camera import CAMERA, load_camera
    from designer.base.own_files import require_ours

    place = folder / CAMERA_FILE
    if folder.exists() and not folder.is_dir():
        raise InputError(f"{folder}: is a file, not a folder; choose another with -o")
    require_ours(place, kind=CAMERA.format)
    require_ours(folder / RESULT_FILE, kind=f"{NAME}.{UndistortedPhotos.kind}")
    if not place.exists() or not place.stat().st_size:
        return
    there = load_camera(place)
    if ABILITIES[there.model].picture is None:
        raise InputError(f"{place}: exists and is no camera of undistorted photos; choose another folder with -o")
    is_same = there.to_json() == straight.new_camera.to_json()
    is_same = is_same and np.allclose(_direction_in(folder), straight.cam_from_new)
    if not is_same and any(one.name not in replaced for one in folder.glob(f"*{MARK}.png")):
        raise InputError(
            f"{place}: is of another camera or direction, and photos of it are in the folder; "
            "choose another folder with -o"
        )


def _direction_in(folder: Path) -> "Array":
    """Where the new camera of an earlier run looked, as far as that is known."""
    import numpy as np

    from designer.base.files import parse_json, read_small_text

    path = folder / RESULT_FILE
    try:
        told = parse_json(read_small_text(path, 2**28, "a result"), path, "a result")
        turned = np.array(told["cam_from_new"] if isinstance(told, dict) else None, dtype=np.float64)
    except (InputError, KeyError, TypeError, ValueError):
        return np.eye(3)
    return turned if turned.shape == (3, 3) else np.eye(3)
