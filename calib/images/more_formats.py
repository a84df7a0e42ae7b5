"""HEIC and raw photos, by decoders of the extras `[heif]` and `[raw]`: as the sensor saw them, without gamma of ours.

Of a Bayer mosaic the green is taken alone, at full size: between green pixels the mean of the four around. Red and blue
are seen through the lens at other places. Levels are linear in light, from black to white 0 to 65535: a blurred edge of
light is symmetric in them.
"""

import io
import os
import tempfile
import threading
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from importlib.util import find_spec
from typing import TYPE_CHECKING, cast

import numpy as np
from numpy.typing import NDArray

from calib.images.headers import HEIC_TURN, DamagedError, Format

if TYPE_CHECKING:
    from calib.images.photo import Grey

EXTRAS: Mapping[Format, tuple[str, str]] = {"HEIC": ("heif", "pillow_heif"), "raw": ("raw", "rawpy")}
"""Formats that need an extra: its name, and the module that it brings."""
OF_FLIP = {3: 3, 5: 8, 6: 6}
"""Orientations as EXIF has them, by how LibRaw says that a photo is to be turned."""
DEVELOP = "develop it to a 16-bit TIFF or PNG, without lens correction"
OF_A_MOSAIC = "raw: its green pixels, linear in light, {} x {} px without the maker's crop: another image than a JPEG's"


CELLS, LEAST_CONTRAST, LEAST_SHARE = 250_000, 0.03, 0.85
"""Cells of two by two pixels that are looked at; in most of a mosaic greens differ so from the others, of the level."""
MOSAIC = "looks like a Bayer mosaic that nobody developed: develop it, or give its green alone"


def is_mosaic(pixels: "Grey") -> bool:
    """Whether an image in grey is a mosaic of colours: in nearly all of its cells one diagonal is the brighter one."""
    by = 2 * max(1, round((pixels.size / (4 * CELLS)) ** 0.5))
    height, width = (side // 2 * 2 for side in pixels.shape)
    if not min(height, width):
        return False
    a, b, c, d = (
        pixels[row:height:by, column:width:by].astype(np.float32) for row, column in ((0, 0), (0, 1), (1, 0), (1, 1))
    )
    differs, usual = a + d - b - c, float(np.median(a + b + c + d))
    middle = float(np.median(differs))
    is_same = np.sign(differs) == np.sign(middle)
    return abs(middle) > LEAST_CONTRAST * usual and float(is_same.mean()) > LEAST_SHARE


def needed_extra(name: Format) -> str:
    """How to install what a format needs; "" if it is there, or needs nothing."""
    extra, module = EXTRAS.get(name, ("", ""))
    return f"pip install 'ringsolid[{extra}]'" if extra and find_spec(module) is None else ""


@contextmanager
def _decoder_of(name: Format) -> Iterator[None]:
    """Say what is missing, or that a decoder gave up."""
    if install := needed_extra(name):
        raise DamagedError(f"is a {name} photo, which needs an extra: {install}, or convert it to PNG at full size")
    try:
        yield
    except DamagedError:
        raise
    except ImportError as error:  # a library that it is built on is missing
        raise DamagedError(
            f"is a {name} photo, and {EXTRAS[name][1]} cannot be loaded: {error}; install it again"
        ) from None
    except Exception as error:  # of many kinds, by what is wrong
        said = (str(error) or type(error).__name__).splitlines()[0]
        raise DamagedError(
            f"is cut off or damaged, or of a kind of {name} photo that is not read ({said}); convert it"
        ) from None


@contextmanager
def _heard_raw() -> Iterator[None]:
    """Keep LibRaw's words off the screen, where it writes by itself, and take them for what they say.

    Raises:
        DamagedError: it goes on after damage, with pixels that are not there.
    """
    with _ONE_RAW, tempfile.TemporaryFile() as heard:
        screen = os.dup(2)
        os.dup2(heard.fileno(), 2)
        try:
            yield
        finally:
            os.dup2(screen, 2)
            os.close(screen)
        heard.seek(0)
        if b"unknown file: " in heard.read():
            raise DamagedError("is cut off or damaged; copy it again")


_ONE_RAW = threading.Lock()


def heic_pixels(data: bytes) -> "Grey":
    """Blue, green, red of a HEIC file, 8 or 16 bits, not turned; DamagedError: it cannot be decoded.  # (H, W, 3)"""
    with _decoder_of("HEIC"):
        import pillow_heif

        image = pillow_heif.open_heif(_unturned(data), convert_hdr_to_8bit=False, bgr_mode=True)
        return cast("Grey", np.ascontiguousarray(np.asarray(image)))


def _unturned(data: bytes) -> io.BytesIO:
    """The file with its turns set to none, so that the decoder gives what the sensor saw."""
    changed, at = bytearray(data), -1
    while (at := data.find(HEIC_TURN, at + 1)) >= 0:
        changed[at + len(HEIC_TURN)] = 0
    return io.BytesIO(bytes(changed))


def raw_pixels(data: bytes, most_pixels: int) -> tuple[NDArray[np.uint16], int, str]:
    """The green of a raw photo (H, W), how it is turned as EXIF says it, and what to know of it.

    Raises:
        DamagedError: it cannot be decoded, has no Bayer mosaic, or too many pixels.
    """
    import cv2

    with _decoder_of("raw"):
        import rawpy

        with _heard_raw(), rawpy.imread(io.BytesIO(data)) as raw:
            width, height = raw.sizes.width, raw.sizes.height
            if not 0 < width * height <= most_pixels:
                raise DamagedError(f"has {width} x {height} px; at most {most_pixels // 1_000_000} million are read")
            if raw.raw_type != rawpy.RawType.Flat:
                raise DamagedError(f"is a raw photo without a mosaic of colours; {DEVELOP}")
            level, colour = raw.raw_image_visible.astype(np.float32), raw.raw_colors_visible
            black = np.array(raw.black_level_per_channel, np.float32)[colour]
            light = 65535 * (level - black) / np.maximum(np.float32(raw.white_level) - black, 1)
            turned = OF_FLIP.get(raw.sizes.flip, 1)
            greens = [number for number, letter in enumerate(raw.color_desc.decode()) if letter == "G"]
            is_mosaic, is_grey = raw.raw_pattern is not None and raw.raw_pattern.shape == (2, 2), raw.num_colors == 1
    if not (is_mosaic or is_grey):
        raise DamagedError(f"is a raw photo without a Bayer mosaic; {DEVELOP}")
    if is_mosaic and not is_grey:
        is_green = np.isin(colour, greens)
        around = np.array([[0, 0.25, 0], [0.25, 0, 0.25], [0, 0.25, 0]], np.float32)
        light = np.where(is_green, light, cv2.filter2D(light, -1, around, borderType=cv2.BORDER_REFLECT_101))
    pixels = np.rint(light.clip(0, 65535)).astype(np.uint16)
    return pixels, turned, OF_A_MOSAIC.format(width, height)
