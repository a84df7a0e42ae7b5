"""Reading photos: pixels as the sensor saw them, in grey or in colour."""

import stat
from collections.abc import Mapping
from dataclasses import dataclass
from os import PathLike
from pathlib import Path
from typing import cast

import numpy as np
from numpy.typing import NDArray

from calib.images.headers import DamagedError, Format, Header, needed_png, read_header
from calib.images.more_formats import MOSAIC, heic_pixels, is_mosaic, raw_pixels
from designer.base.errors import InputError

MAX_PIXELS = 250_000_000
"""Above this a photo is refused before it is decoded; the largest sensors on sale have 200 million."""
MAX_DECODED_BYTES = 10**9
"""Of pixels with all their channels: 250 million of three colours, or 166 million of three with 16 bits."""
MAX_FILE_BYTES = 2**31 - 1
SUFFIXES_OF: Mapping[Format, tuple[str, ...]] = {
    "PNG": (".png",),
    "JPEG": (".jpg", ".jpeg", ".jpe", ".jfif", ".mpo"),
    "TIFF": (".tif", ".tiff"),
    "BMP": (".bmp", ".dib"),
    "PNM": (".pgm", ".ppm", ".pnm", ".pbm", ".pam"),
    "WebP": (".webp",),
    "HEIC": (".heic", ".heif", ".hif"),
    "raw": (".dng", ".cr2", ".cr3", ".nef", ".arw", ".raf", ".rw2", ".orf", ".pef", ".srw", ".raw", ".iiq", ".3fr"),
}
"""How the files of a format are usually named; what a file really is, its content says."""

_TURNS = {
    2: "mirrored", 3: "turned by 180 degrees", 4: "mirrored top to bottom", 5: "turned and mirrored",
    6: "turned by 90 degrees", 7: "turned and mirrored", 8: "turned by 270 degrees",
}  # fmt: skip
_SHRINKS = (1, 2, 4, 8)
"""How many times fewer columns and rows a JPEG can be decoded to."""
_DEPTHS = (np.dtype(np.uint8), np.dtype(np.uint16), np.dtype(np.float32))
Grey = NDArray[np.uint8] | NDArray[np.uint16]


@dataclass(frozen=True, eq=False)
class Photo:
    """An image in sensor orientation, and what a person should know of its file."""

    pixels: Grey  # (H, W), or of `read_colour` and `read_preview` as the file has it
    remarks: tuple[str, ...]


def read_image(path: Path) -> Photo:
    """Read a PNG, JPEG, TIFF, WebP, BMP or PNM file of 8 or 16 bits; with their extras HEIC and raw photos.

    Colours become grey as 0.299 R + 0.587 G + 0.114 B, which a JPEG holds as such. Transparency is ignored: the
    colour below it counts. An orientation noted by the camera is not applied, because a camera model belongs to the
    sensor. Of several pages the first is read.

    Raises:
        InputError: no image, cut off or damaged, too large, of another depth, or not to be read; it names the file.
    """
    return _in_grey(_read(path, in_colour=False))


def photo_of(data: bytes) -> Photo:
    """Read what such a file holds, as `read_image` does.

    Raises:
        DamagedError: no image, cut off or damaged, too large, or of another depth.
    """
    return _in_grey(_decoded(data, in_colour=False))


def _in_grey(photo: Photo) -> Photo:
    remarks = (*photo.remarks, "transparency ignored") if _has_alpha(photo.pixels) else photo.remarks
    return Photo(grey_of(photo.pixels), remarks)


def read_colour(path: Path) -> Photo:
    """Read the same files as `read_image`, channels and all.

    Returns:
        Pixels in grey (H, W), or blue, green, red and possibly alpha (H, W, C).

    Raises:
        InputError: as `read_image` does.
    """
    return _read(path, in_colour=True)


def read_preview(path: Path, columns: int, most_pixels: int) -> Photo:
    """Read the same files as `read_colour` for a small picture.

    A JPEG is decoded to no more pixels than the columns asked for need, and without a search for damage, which nobody
    measures on a preview.

    Args:
        path: of the file.
        columns: that are enough.
        most_pixels: of a file with more there is no preview.

    Raises:
        DamagedError: why there is none, without the file's name.
    """
    return preview_of(_read_file(path), columns, most_pixels)


def preview_of(data: bytes, columns: int, most_pixels: int = MAX_PIXELS) -> Photo:
    """The same of what such a file holds."""
    header = _header_within_limits(data, most_pixels)
    shrink = max(by for by in _SHRINKS if by == 1 or header.width >= by * columns)
    return Photo(_decode(data, header, in_colour=True, shrink=shrink if header.format == "JPEG" else 1), ())


def stated_dpi(path: Path) -> float | None:
    """The resolution that a scan's file states, in dots per inch; None: none, or another along its rows.

    Raises:
        InputError: the file cannot be read.
    """
    from PIL import Image, UnidentifiedImageError

    try:
        with Image.open(path) as image:
            across, down = (float(one) for one in image.info.get("dpi", (0.0, 0.0)))
    except (OSError, UnidentifiedImageError, ValueError, TypeError, Image.DecompressionBombError) as error:
        raise InputError(f"{path}: cannot be read: {error}") from None
    return across if across > 1 and abs(across - down) < 1e-3 * across else None


def _read(path: Path, *, in_colour: bool) -> Photo:
    """Read and decode a file within the limits; its pixels as it has them."""
    try:
        return _decoded(_read_file(path), path.suffix, in_colour=in_colour)
    except DamagedError as error:
        raise InputError(f"{path}: {error}") from None


def _decoded(data: bytes, suffix: str | None = None, *, in_colour: bool) -> Photo:
    """Decode a file's content within the limits; its pixels as it has them."""
    header = _header_within_limits(data)
    unit_rows = 0
    if header.format == "JPEG":
        from calib.images.jpeg_damage import brightness_step, check_jpeg_scans

        unit_rows = check_jpeg_scans(data)  # decoders go on after damage, with pixels in wrong places
    remarks, orientation = list[str](), header.exif.orientation
    if header.format == "raw":
        green, orientation, said = raw_pixels(data, MAX_PIXELS)
        remarks.append(said)
    pixels = green if header.format == "raw" else _decode(data, header, in_colour=in_colour)
    if unit_rows and (doubt := brightness_step(grey_of(pixels), unit_rows)):
        remarks.append(doubt)
    if header.format in {"PNG", "TIFF", "PNM", "BMP"} and pixels.ndim == 2 and is_mosaic(pixels):
        remarks.append(MOSAIC)
    if suffix is not None and suffix.lower() not in SUFFIXES_OF[header.format]:
        remarks.append(f"the file is {header.format}, whatever its name says")
    if orientation != 1:
        turn = _TURNS[orientation]
        remarks.append(f"read as the sensor saw it: viewers show it {turn} (orientation {orientation})")
    if header.page_count > 1:
        remarks.append(f"page 1 of {header.page_count} read")
    return Photo(pixels, tuple(remarks))


def _header_within_limits(data: bytes, most_pixels: int = MAX_PIXELS) -> Header:
    """The header of a file that is not too large to decode."""
    header = read_header(data)
    count, size = header.width * header.height, f"has {header.width} x {header.height} px"
    if count > most_pixels:
        raise DamagedError(f"{size}; at most {most_pixels // 1_000_000} million are read: scale it down")
    if count * header.pixel_bytes > MAX_DECODED_BYTES:
        most = f"at most {MAX_DECODED_BYTES // 10**9} GB"
        raise DamagedError(f"{size} of {header.pixel_bytes} bytes; {most} are read: convert it to grey")
    return header


def _read_file(path: Path) -> bytes:
    """The file's content. Only regular files are opened: a pipe or a device may never end.

    Raises:
        DamagedError: why not, without the file's name.
    """
    try:
        status = path.stat()
        if stat.S_ISDIR(status.st_mode):
            raise DamagedError("is a folder, not an image")
        if not stat.S_ISREG(status.st_mode):
            raise DamagedError("is a pipe or a device; give image files")
        if status.st_size == 0:
            raise DamagedError("is empty (0 bytes); copy it again")
        if status.st_size > MAX_FILE_BYTES:
            raise DamagedError(f"has {status.st_size} bytes; at most {MAX_FILE_BYTES} are read")
        return path.read_bytes()
    except OSError as error:
        raise DamagedError(f"cannot be read: {error.strerror}; check the path") from None
    except ValueError as error:
        raise DamagedError(f"is no file name: {error}") from None


def _decode(data: bytes, header: Header, *, in_colour: bool, shrink: int = 1) -> Grey:
    """The pixels as the file has them; without colour a JPEG gives its grey, and in colour as few as are asked for."""
    import cv2

    if header.format == "HEIC":
        return _checked(heic_pixels(data), header, shrink)
    if header.format == "raw":
        return raw_pixels(data, MAX_PIXELS)[0]
    flags = cv2.IMREAD_UNCHANGED
    if header.format == "JPEG":
        coloured = (
            cv2.IMREAD_ANYCOLOR, cv2.IMREAD_REDUCED_COLOR_2, cv2.IMREAD_REDUCED_COLOR_4, cv2.IMREAD_REDUCED_COLOR_8
        )[_SHRINKS.index(shrink)]  # fmt: skip
        # Without colour only the luminance is decoded: several times faster, and the same grey.
        flags = cv2.IMREAD_IGNORE_ORIENTATION | (coloured if in_colour else cv2.IMREAD_GRAYSCALE)
    elif header.format == "PNG":
        data = needed_png(data)
    elif header.format == "TIFF" and header.exif.orientation != 1:
        at, one = header.exif.upright
        data = data[:at] + one + data[at + len(one) :]
    elif data[:2] in {b"P1", b"P2", b"P3"}:
        data += b"\n"  # a text may end in a digit
    # The decoders' complaints go to standard error, into the progress bar; what is wrong is said here.
    cv2.utils.logging.setLogLevel(cv2.utils.logging.LOG_LEVEL_SILENT)
    try:
        image = cv2.imdecode(np.frombuffer(data, np.uint8), flags)
    except cv2.error:
        image = None
    if image is None:
        raise DamagedError("is cut off or damaged, or of a kind of its format that is not read; copy or convert it")
    return _checked(image, header, shrink)


def _checked(image: NDArray[np.generic], header: Header, shrink: int) -> Grey:
    """The pixels, if they are of the size and depth that they have to be."""
    if image.shape[:2] != (-(-header.height // shrink), -(-header.width // shrink)):
        raise DamagedError("its header does not fit its content; copy it again")
    if image.dtype not in (np.uint8, np.uint16):
        raise DamagedError(f"holds {image.dtype} values; convert it to 8 or 16 bits without sign")
    pixels = cast("Grey", image[:, :, 0] if image.shape[2:] == (1,) else image)  # its type was checked
    if header.is_white_zero and pixels.dtype == np.uint16:
        pixels = np.bitwise_not(pixels)  # the decoder does it for 8 bits only
    return pixels


def _has_alpha(pixels: Grey) -> bool:
    return pixels.ndim == 3 and pixels.shape[2] == 4


def grey_of(image: Grey) -> Grey:
    """Grey from grey, or from three channels (blue, green, red) or four."""
    import cv2

    if image.ndim == 2:
        return image
    if image.shape[2] == 1:
        return image[:, :, 0]
    code = cv2.COLOR_BGRA2GRAY if _has_alpha(image) else cv2.COLOR_BGR2GRAY
    return cast("Grey", cv2.cvtColor(image, code))


def grey_pixels(image: "NDArray[np.generic] | str | PathLike[str]") -> Grey:
    """Grey levels (H, W) of an array or a file, as the detector takes them; InputError: it is no image."""
    if isinstance(image, str | PathLike):
        return read_image(Path(image)).pixels
    return grey_of(require_image(image))


def require_image(image: NDArray[np.generic]) -> Grey:
    """The array, if it is an image; InputError: it is none."""
    if not isinstance(image, np.ndarray):
        raise InputError(f"{type(image).__name__}: is no image; give a numpy array (H, W) or (H, W, 3), or a file")
    if image.ndim not in (2, 3) or (image.ndim == 3 and image.shape[2] not in (1, 3, 4)) or not image.size:
        raise InputError(f"an array of shape {image.shape} is no image; give (H, W), or (H, W, 3) in blue, green, red")
    if image.dtype not in _DEPTHS:
        raise InputError(f"an image of {image.dtype}: give uint8, uint16 or float32")
    if image.dtype == np.float32 and not np.isfinite(image).all():
        at = np.argwhere(~np.isfinite(image))[0].tolist()
        raise InputError(f"an image with {image[tuple(at)]} at {at}: all its values must be finite; fill its gaps")
    return cast("Grey", image)  # or of float32, a depth that OpenCV converts too
