"""Photos as a camera without a lens would have taken them.

OpenCV's `remap` rounds places to 1/32 px and its cubic kernel is not exact for parabolas: edges come out up to 0.04 px
off. Ring centres are measured to 0.003 px, so that would show.

How far apart two cameras see the same light, by parts of the image.
"""

from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from typing import Annotated, cast

import numpy as np
from numpy.typing import NDArray

from calib.cameras import LINEAR, pictures, project, rays
from calib.cameras.camera import Camera, linear_part
from calib.cameras.parameters import slopes
from calib.cameras.refit import CameraDifference
from calib.core.jit import jit
from calib.core.parallel import in_chunks
from designer.base.arrays import Array
from designer.base.errors import InputError
from designer.base.marks import NOT_IN_FILE, Gap
from designer.base.words import figure as digits

Pixels = NDArray[np.uint8] | NDArray[np.uint16]

TAPS = 6
STRIP_PIXELS = 1_000_000
"""Of the result whose places are in memory at a time."""
ZOOM_RANGE = (0.02, 50.0)
_INNER_POINTS = 48
STEPS = 61
"""Of the grid on the photo, along each side, by which it is judged."""


@jit
def _weights(s: float, weight: Array) -> None:
    """The six weights for a place `s` in 0..1 after the third of six pixels.

    Keys' kernel of fourth order: "Cubic Convolution Interpolation for Digital Image Processing", 1981, section VI.
    """
    for k in range(TAPS):
        d = abs(s + 2 - k)
        if d < 1:
            weight[k] = 1 + d * d * (4 / 3 * d - 7 / 3)
        elif d < 2:
            weight[k] = 2.5 + d * (-59 / 12 + d * (3 - 7 / 12 * d))
        else:
            weight[k] = -1.5 + d * (1.75 + d * (-2 / 3 + d / 12))


@jit
def _resample(source: NDArray[np.generic], place: Array, top: float, result: NDArray[np.generic]) -> int:
    """Fill `result` (R, W', C) from `source` (H, W, C) at places (R, W', 2); count the pixels that have data."""
    height, width, channels = source.shape
    along_u, along_v = np.empty(TAPS), np.empty(TAPS)
    column, row = np.empty(TAPS, np.int64), np.empty(TAPS, np.int64)
    filled = 0
    for i in range(place.shape[0]):
        for j in range(place.shape[1]):
            u, v = place[i, j, 0], place[i, j, 1]
            if not (-0.5 <= u <= width - 0.5 and -0.5 <= v <= height - 0.5):  # nan is outside, too
                for c in range(channels):
                    result[i, j, c] = 0
                continue
            filled += 1
            left, upper = int(np.floor(u)), int(np.floor(v))
            _weights(u - left, along_u)
            _weights(v - upper, along_v)
            for k in range(TAPS):
                column[k] = min(max(left - 2 + k, 0), width - 1)
                row[k] = min(max(upper - 2 + k, 0), height - 1)
            for c in range(channels):
                value = 0.0
                for a in range(TAPS):
                    line = 0.0
                    for b in range(TAPS):
                        line += along_u[b] * source[row[a], column[b], c]
                    value += along_v[a] * line
                result[i, j, c] = int(min(max(value, 0.0), top) + 0.5)
    return filled


def resample(source: Pixels, place: Array, result: Pixels) -> int:
    """Fill rows (R, W') or (R, W', C) of an image from places (R, W', 2) in another; count those that are not black."""
    layered = source.reshape(*source.shape[:2], -1)
    filled: int = _resample(layered, place, float(np.iinfo(source.dtype).max), result.reshape(*result.shape[:2], -1))
    return filled


@dataclass(frozen=True, eq=False)
class Undistorted:
    """A photo without distortion: `straight.pixels`."""

    pixels: Pixels  # (H, W) or (H, W, C) as the photo's
    share_filled: float  # of the pixels, the others are black


def pinhole_of(camera: Camera, *, alpha: float | None = None, focal_px: float | None = None) -> Camera:
    """The pinhole camera that takes the undistorted photos, of the same size, principal point and pixel shape.

    Args:
        camera: the camera of the photos.
        alpha: 0: as wide as can be without black regions; 1: wide enough for all that the photos show; between the
            two in proportion (as in OpenCV's `getOptimalNewCameraMatrix`, but the principal point stays).
        focal_px: along u. Without both, the focal length stays as it is.

    Raises:
        InputError: no focal length does it.
    """
    same = linear_part(camera)
    if focal_px is not None:
        return _zoomed(same, focal_px / float(same.params[0]))
    if alpha is None:
        return same
    wide = _zoom_that_shows_all(camera, same) if alpha > 0 else 1.0
    full = _zoom_without_black(camera, same) if alpha < 1 else 1.0
    return _zoomed(same, alpha * wide + (1 - alpha) * full)


def _zoomed(pinhole: Camera, zoom: float) -> Camera:
    """The pinhole with other focal lengths."""
    return replace(pinhole, params=pinhole.params * np.array([zoom, zoom, 1.0, 1.0]))


def _zoom_that_shows_all(camera: Camera, pinhole: Camera) -> float:
    """The largest zoom at which everything that the photos show is inside the frame."""
    last = np.array(camera.image_size) - 1.0
    inner = np.stack(np.meshgrid(*(np.linspace(0, end, _INNER_POINTS) for end in last)), axis=-1).reshape(-1, 2)
    ray = rays(camera, np.concatenate([_border(camera.image_size), inner]))
    if (ray[:, 2] <= 0).any():
        others = " or ".join(name for name in pictures() if name != LINEAR)
        raise InputError(
            f"alpha: the photos show light {np.degrees(np.arccos(np.nanmin(ray[:, 2]))):.0f} degrees off the axis, and "
            f"a {LINEAR}'s picture ends before 90; give a field, alpha 0, or another picture: {others}"
        )
    direction = slopes(ray)
    focal, middle = pinhole.params[:2], pinhole.params[2:]
    with np.errstate(divide="ignore", invalid="ignore"):
        room = np.where(direction > 0, last - middle, -middle) / (focal * direction)
    if np.isnan(room).all():
        raise InputError("the camera knows no light anywhere in its image; check the camera file")
    zoom = float(np.nanmin(room, initial=np.inf))
    if not ZOOM_RANGE[0] <= zoom <= ZOOM_RANGE[1]:
        raise InputError(
            f"alpha 1 needs a focal length of {zoom * focal[0]:.3g} px to show all of the photos, which is no picture; "
            "use a smaller alpha, or give the focal length"
        )
    return zoom


def _zoom_without_black(camera: Camera, pinhole: Camera) -> float:
    """The smallest zoom at which all of the frame's border, and so all inside, has data in the photos."""
    border = _border(camera.image_size)
    size = np.array(camera.image_size)

    def is_full(zoom: float) -> bool:
        place = project(camera, rays(_zoomed(pinhole, zoom), border))
        return bool(((place >= -0.5) & (place <= size - 0.5)).all())

    enough = too_little = 1.0
    while not is_full(enough):
        too_little, enough = enough, 1.25 * enough
        if enough > ZOOM_RANGE[1]:
            raise InputError("alpha 0 finds no frame without black regions; give the focal length instead")
    while enough <= too_little and too_little > ZOOM_RANGE[0]:
        enough, too_little = too_little, 0.8 * too_little
        if not is_full(too_little):
            break
    for _ in range(40):
        middle = 0.5 * (enough + too_little)
        enough, too_little = (middle, too_little) if is_full(middle) else (enough, middle)
    return enough


def _border(size: tuple[int, int]) -> Array:
    """The pixels along the border of an image.  # (N, 2)"""
    u, v = (np.arange(side, dtype=np.float64) for side in size)
    sides = [(u, np.zeros_like(u)), (u, np.full_like(u, v[-1])), (np.zeros_like(v), v), (np.full_like(v, u[-1]), v)]
    return np.concatenate([np.column_stack(side) for side in sides])


@dataclass(frozen=True)
class UndistortionChange:
    """What happens to the pixels of a photo."""

    share_kept: float  # of what the camera knows the light of, inside the new frame; the rest is cut off
    share_known: float  # of the photo
    shift_px: float  # the farthest that a pixel moves, of those kept; nan: none is, or it is another kind of picture

    @property
    def shift_words(self) -> str:
        """How far pixels move."""
        return f"{digits(self.shift_px, 3)} px" if np.isfinite(self.shift_px) else "an unknown distance"


def change_of(taken: Camera, new_camera: Camera, cam_from_new: Array | None = None) -> UndistortionChange:
    """What happens to a grid of the photo's pixels."""
    last = np.array(taken.image_size) - 1.0
    grid = np.stack(np.meshgrid(*(np.linspace(0, end, STEPS) for end in last)), axis=-1).reshape(-1, 2)
    place = moved(taken, new_camera, cam_from_new, grid)
    known = np.isfinite(rays(taken, grid)[:, 2])
    inside = ((place >= -0.5) & (place <= np.array(new_camera.image_size) - 0.5)).all(axis=1)
    shift = np.linalg.norm(place - grid, axis=1)[inside]
    is_like = cam_from_new is None and new_camera.image_size == taken.image_size
    kept = float((inside & known).sum() / max(known.sum(), 1))
    return UndistortionChange(kept, float(known.mean()), float(shift.max()) if len(shift) and is_like else np.nan)


def moved(taken: Camera, new_camera: Camera, cam_from_new: Array | None, pixel: Array) -> Array:
    """Where pixels (N, 2) of a photo are in the new one."""
    ray = rays(taken, pixel)
    return project(new_camera, ray if cam_from_new is None else ray @ cam_from_new)


def source_places(
    camera: Camera, new_camera: Camera, first: int, last: int, cam_from_new: Array | None = None
) -> Array:
    """Where the pixels of some rows of the new image lie in the photo; nan where there is none.  # (R, W, 2)"""
    width = new_camera.image_size[0]
    column, row = np.meshgrid(np.arange(width, dtype=np.float64), np.arange(first, last, dtype=np.float64))
    ray = rays(new_camera, np.stack([column, row], axis=-1))
    return project(camera, ray if cam_from_new is None else ray @ cam_from_new.T)


def undistort(
    pixels: Pixels,
    camera: Camera,
    new_camera: Camera,
    *,
    cam_from_new: Array | None = None,
    progress: Callable[[float], None] = lambda _: None,
) -> Undistorted:
    """A photo of 8 or 16 bits as a camera without a lens would have taken it, black where that would see more.

    Args:
        pixels: (H, W) or (H, W, C).
        camera: that took the photo.
        new_camera: see `calib.cameras.picture_of`.
        cam_from_new: where that looks.  # (3, 3) None: along the camera's axis
        progress: is told the share that is done.
    """
    if (pixels.shape[1], pixels.shape[0]) != camera.image_size:
        raise ValueError(f"the photo has the shape {pixels.shape}, the camera the size {camera.image_size}")
    width, height = new_camera.image_size
    pixels = cast("Pixels", np.ascontiguousarray(pixels))
    result = cast("Pixels", np.empty((height, width, *pixels.shape[2:]), dtype=pixels.dtype))
    filled: list[int] = []
    strip = max(1, STRIP_PIXELS // width)
    for top in range(0, height, strip):

        def work(first: int, last: int, top: int = top) -> None:
            rows = slice(top + first, top + last)
            filled.append(
                resample(pixels, source_places(camera, new_camera, rows.start, rows.stop, cam_from_new), result[rows])
            )

        in_chunks(work, min(strip, height - top))
        progress(min(top + strip, height) / height)
    return Undistorted(result, sum(filled) / (width * height))


WHOLE = "whole image"


@dataclass(frozen=True)
class ZoneDifference:
    """Over a part of the image; nan where nothing is known."""

    share: Annotated[float, NOT_IN_FILE]  # of it, in which both cameras know what they see
    rms_px: Gap
    median_px: Gap
    percentile_95_px: Gap
    max_px: Gap
    rms_rad: Gap  # of the angles between the directions that both see in one pixel


def zones_of(difference: CameraDifference) -> Mapping[str, ZoneDifference]:
    """The whole image, and from its centre to its corners."""
    part = difference.off_centre_px / (np.hypot(*difference.image_size) / 2)
    inside = {
        WHOLE: part >= 0, "centre": part < 1 / 3, "between": (part >= 1 / 3) & (part < 2 / 3), "corners": part >= 2 / 3,
    }  # fmt: skip
    length, angle = difference.length_px, difference.angle_rad
    return {name: _zone(length[zone], angle[zone]) for name, zone in inside.items()}


def _zone(length_px: Array, angle_rad: Array) -> ZoneDifference:
    """Of lengths and angles that may not be known."""
    known, angle = length_px[np.isfinite(length_px)], angle_rad[np.isfinite(angle_rad)]
    if not len(known):
        return ZoneDifference(0.0, *[np.nan] * 5)
    rms, (median, most) = np.sqrt(np.mean(known**2)), np.percentile(known, [50, 95])
    rms_rad = float(np.sqrt(np.mean(angle**2))) if len(angle) else np.nan
    return ZoneDifference(
        len(known) / length_px.size, float(rms), float(median), float(most), float(known.max()), rms_rad
    )
