"""Two cameras compared: how far apart they see the same light, over the image."""

from dataclasses import dataclass
from functools import cached_property
from os import fspath
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from calib.app.inputs import Place, opened_camera
from calib.cameras.camera import Camera
from calib.cameras.refit import CameraDifference, camera_difference
from calib.interop.reading import OpenedCamera
from calib.renderer.quantities import real
from designer.base.errors import InputError
from designer.base.files import write_files
from designer.base.marks import Gap
from designer.base.own_files import require_ours


@dataclass(frozen=True)
class ZoneDifference:
    """Over a part of the image; nan where nothing is known."""

    share: float  # of it, in which both cameras know what they see
    rms_px: Gap
    median_px: Gap
    percentile_95_px: Gap
    max_px: Gap
    rms_rad: Gap  # of the angles between the directions that both see in one pixel


@dataclass(frozen=True, eq=False)
class ComparedCameras:
    """What came of a comparison: `compared.zones["corners"].rms_px`, `compared.save_picture("map.png")`."""

    names: tuple[str, str]
    opened: tuple[OpenedCamera, OpenedCamera]
    difference: CameraDifference

    @cached_property
    def zones(self) -> dict[str, ZoneDifference]:
        """The whole image, and from its centre to its corners."""
        part = self.difference.off_centre_px / (np.hypot(*self.difference.image_size) / 2)
        inside = {
            "whole image": part >= 0,
            "centre": part < 1 / 3,
            "between": (part >= 1 / 3) & (part < 2 / 3),
            "corners": part >= 2 / 3,
        }
        length, angle = self.difference.length_px, self.difference.angle_rad
        return {name: _zone(length[zone], angle[zone]) for name, zone in inside.items()}

    @property
    def rotation_words(self) -> str:
        """What was removed."""
        difference = self.difference
        if difference.radius_px == 0:
            return "no rotation removed"
        is_whole = difference.radius_px >= np.hypot(*difference.image_size) / 2
        where = "the whole image" if is_whole else f"{difference.radius_px:g} px about the centre"
        return f"rotation removed: {np.degrees(difference.turn_rad):.4f} deg, fitted to {where}"

    @property
    def largest(self) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """The pixel (2,) where the difference is largest, and the difference (2,) there."""
        at = np.unravel_index(np.nanargmax(self.difference.length_px), self.difference.length_px.shape)
        return self.difference.pixel[at], self.difference.difference_px[at]

    @property
    def not_compared(self) -> int:
        """Pixels of those looked at where a camera does not know what it sees."""
        return int(np.isnan(self.difference.length_px).sum())

    def save_picture(self, path: Place) -> Path:
        """Draw the map of differences; return its place.

        Raises:
            InputError: no PNG file, one of the cameras' files, or somebody else's.
        """
        from calib.draw.difference_picture import difference_picture

        place, whole = Path(path), self.zones["whole image"]
        check_picture(place, self.opened)
        title = f"from {self.names[0]} to {self.names[1]}; {self.rotation_words}"
        note = f"RMS {whole.rms_px:.4f} px ({np.degrees(whole.rms_rad):.5f} deg), max {whole.max_px:.4f} px"
        write_files({place: difference_picture(self.difference, title, note)})
        return place


def diff(
    a: Camera | Place, b: Camera | Place, *, radius_px: float | None = None, picture: Place | None = None
) -> ComparedCameras:
    """Compare two cameras: `diff("a/camera.json", "b.yaml").zones["whole image"].rms_px`.

    The frames of two calibrations are never quite parallel, so the best rotation between them is removed first.

    Args:
        a: a camera, a file of any kind, a folder with one, or a template.
        b: another camera of the same image size.
        radius_px: fit the rotation only this near to the centre; 0: remove none; None: fit it to the whole image.
        picture: where the map is to go, refused before any work is done if it cannot; `save_picture` draws it.

    Raises:
        InputError: a file that cannot be read, other image sizes, or nothing that both cameras know.
    """
    if radius_px is not None:
        real("--radius", radius_px, 0, 1e9, " px")
    opened = opened_camera(a), opened_camera(b)
    if picture is not None:
        check_picture(Path(picture), opened)
    difference = camera_difference(opened[0].read.camera, opened[1].read.camera, radius_px=radius_px)
    names = tuple("a camera" if isinstance(one, Camera) else fspath(one) for one in (a, b))
    return ComparedCameras((names[0], names[1]), opened, difference)


def check_picture(picture: Path, opened: tuple[OpenedCamera, ...]) -> None:
    """Refuse a place that is no PNG file, an input, or holds something else.

    Raises:
        InputError: the message names it.
    """
    if picture.suffix.lower() != ".png":
        raise InputError(f"{picture}: the picture is a .png file; name it so, such as {picture.stem or 'diff'}.png")
    if any(one.is_file(picture) for one in opened):
        raise InputError(f"{picture}: is a file to read; choose another name with --picture")
    require_ours(picture)


def _zone(length_px: NDArray[np.float64], angle_rad: NDArray[np.float64]) -> ZoneDifference:
    """Of lengths and angles that may not be known."""
    known, angle = length_px[np.isfinite(length_px)], angle_rad[np.isfinite(angle_rad)]
    if not len(known):
        return ZoneDifference(0.0, *[np.nan] * 5)
    rms, (median, most) = np.sqrt(np.mean(known**2)), np.percentile(known, [50, 95])
    rms_rad = float(np.sqrt(np.mean(angle**2))) if len(angle) else np.nan
    return ZoneDifference(
        len(known) / length_px.size, float(rms), float(median), float(most), float(known.max()), rms_rad
    )
