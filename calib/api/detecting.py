"""One photo, from an array or a file, to named centres."""

from os import PathLike
from pathlib import Path
from typing import TYPE_CHECKING, TypeAlias, cast

import numpy as np
from numpy.typing import NDArray

from calib.app.inputs import Place, camera_of, target_of
from calib.core.types import Detections
from calib.detector import pipeline
from calib.images.photo import Grey, grey_of, read_image
from calib.observe.photos import PhotoFile, require_size
from calib.show.photos.why_nothing import explained
from designer.base.errors import InputError
from designer.base.words import shown
from designer.target import TargetGeometry

if TYPE_CHECKING:
    from calib.cameras.camera import Camera

Pixels: TypeAlias = NDArray[np.generic]

DEPTHS = (np.dtype(np.uint8), np.dtype(np.uint16), np.dtype(np.float32))


class Detector:
    """Finds one target in many photos: `Detector(target).detect(image)`.

    >>> detector = calib.Detector("ico.target.json", camera="camera.json")
    >>> found = detector.detect(frame)

    Args:
        target: what the photos show: a geometry, or its file.
        camera: that takes them, if it is known: a camera, a file, or a template; centres become surer with its lens.

    Raises:
        InputError: a file that cannot be read, or a target without rings.
    """

    def __init__(self, target: TargetGeometry | Place, camera: "Camera | Place | None" = None) -> None:
        self.target = target_of(target, "rings")
        self.camera = None if camera is None else camera_of(camera)

    def detect(self, image: Pixels | Place, name: str = "") -> Detections:
        """The target's rings and dots in a photo; none, with the reason in `remarks`, if it does not show the target.

        Args:
            image: grey (H, W), or blue, green, red (H, W, 3) as OpenCV reads it, of 8 or 16 bits or float32; or a file.
            name: what the photo is called in the result; "": a file's own name.

        Raises:
            InputError: no such file, no image, or one of another size than the camera's.
        """
        pixels = grey_pixels(image)
        if isinstance(image, str | PathLike):
            name = name or Path(image).name
        return self.look(PhotoFile(Path(name or "the image"), name or "image"), pixels)

    def glance(self, image: Pixels | Place, name: str = "", likely: "Camera | None" = None) -> Detections:
        """The same in a third of the time, for live video: the same names, and centres to about .2 px.

        >>> seen = detector.glance(frame)

        Each frame is looked at afresh: nothing is kept from the one before. Names are told as `detect` tells them, and
        fewer of them; `cov_px2` says how rough the centres are. Where another target is in view, `remarks` say so;
        why it is taken for another, `detect` says at more length.

        Args:
            image: as for `detect`.
            name: what the frame is called in the result.
            likely: a camera that is not sure to be the one, as one from few photos: its lens is tried before another
                is guessed from the frame.

        Raises:
            InputError: no such file, no image, or one of another size than the camera's.
        """
        from calib.detector.glance import glance
        from calib.detector.lens import CameraLens
        from calib.detector.plan import plan_for

        pixels = grey_pixels(image)
        require_size(name or "the image", pixels, self.camera)
        lens = None if self.camera is None else CameraLens(self.camera)
        is_same_size = likely is not None and likely.image_size == (pixels.shape[1], pixels.shape[0])
        hint = CameraLens(likely) if likely is not None and is_same_size else None
        return glance(pixels, plan_for(self.target), name or "image", lens, hint)

    def look(self, photo: PhotoFile, pixels: Grey) -> Detections:
        """The same of grey levels that are read already, as `calib.observe.photos.detect_photos` asks."""
        require_size(str(photo.path), pixels, self.camera)
        found = pipeline.detect(pixels, self.target, name=photo.name, camera=self.camera)
        return explained(found, pixels, self.target)

    def draw(self, image: Pixels | Place, found: Detections) -> NDArray[np.uint8]:
        """A picture of what was found in a photo and what was not, for a person: red, green, blue.  # (H', W', 3)

        Args:
            image: the photo, as for `detect`.
            found: in it.

        Raises:
            InputError: no such file, no image, or found in a photo of another size or with another target.
        """
        from calib.detector.overlay import draw_overlay

        pixels = grey_pixels(image)
        if not isinstance(found, Detections):
            raise InputError(f"{shown(found)}: is of type {type(found).__name__}; give what was detected in the photo")
        if found.image_size != (pixels.shape[1], pixels.shape[0]) or found.layout_id != self.target.layout_id:
            raise InputError(f"{found.image}: was detected in another photo, or with another target; give its own")
        if pixels.dtype == np.float32:  # of any scale: a picture shows what lies between its darkest and its lightest
            low, high = float(pixels.min()), float(pixels.max())
            pixels = ((pixels - low) * (255 / max(high - low, 1e-9))).astype(np.uint8)
        return draw_overlay(pixels, found, self.target)


def detect(
    image: Pixels | Place, target: TargetGeometry | Place, *, camera: "Camera | Place | None" = None, name: str = ""
) -> Detections:
    """Find a target's rings in one photo, name them, and measure their centres: `detect(image, "ico.target.json")`.

    >>> found = calib.detect(cv2.imread("a.png"), geometry)
    >>> cv2.solvePnP(found.object_points, found.image_points, matrix, distortion)

    Args:
        image: as `Detector.detect` has it.
        target: what it shows: a geometry, or its file. For many photos of one target a `Detector` reads it once.
        camera: that took it, if it is known.
        name: what the photo is called in the result.

    Raises:
        InputError: a file that cannot be read, an array that is no image, or a camera of another size.
    """
    return Detector(target, camera).detect(image, name)


def grey_pixels(image: Pixels | Place) -> Grey:
    """Grey levels (H, W) of an array or a file, as the detector takes them.

    Raises:
        InputError: it is no image.
    """
    if isinstance(image, str | PathLike):
        return read_image(Path(image)).pixels
    return grey_of(require_image(image))


def require_image(image: Pixels) -> Grey:
    """The array, if it is an image.

    Raises:
        InputError: it is none.
    """
    if not isinstance(image, np.ndarray):
        raise InputError(f"{type(image).__name__}: is no image; give a numpy array (H, W) or (H, W, 3), or a file")
    if image.ndim not in (2, 3) or (image.ndim == 3 and image.shape[2] not in (1, 3, 4)) or not image.size:
        raise InputError(f"an array of shape {image.shape} is no image; give (H, W), or (H, W, 3) in blue, green, red")
    if image.dtype not in DEPTHS:
        raise InputError(f"an image of {image.dtype}: give uint8, uint16 or float32")
    if image.dtype == np.float32 and not np.isfinite(image).all():
        at = np.argwhere(~np.isfinite(image))[0].tolist()
        raise InputError(f"an image with {image[tuple(at)]} at {at}: all its values must be finite; fill its gaps")
    return cast("Grey", image)  # or of float32, a depth that OpenCV converts too
