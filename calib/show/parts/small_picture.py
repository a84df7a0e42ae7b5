"""Small pictures of photos, as JPEG in a page."""

import math
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from calib.observe.images import read_preview
from designer.base.errors import InputError
from designer.base.words import printable
from designer.page.blocks import Raster

WIDTHS = (1200, 1000, 800, 640, 520, 420, 320, 200, 100)
BYTES_A_PIXEL = 0.09
"""What a JPEG of an overlay takes, about."""
QUALITIES = (82, 68, 50)
MAX_PIXELS = 100_000_000


def small_picture(path: Path, limit: int) -> Raster | str:
    """A JPEG of at most about `limit` bytes, or why there is none, in a line without folders."""
    try:
        return _within(read_preview(path, WIDTHS[0], MAX_PIXELS).pixels, limit)
    except (InputError, OSError) as error:
        return printable(f"{path.name}: {str(error).removeprefix(f'{path}: ')}")


def _within(pixels: NDArray[np.uint8] | NDArray[np.uint16], limit: int) -> Raster:
    """A JPEG of at most `limit` bytes: as wide as that allows at a fair quality, or else the smallest."""
    import cv2

    height, width = pixels.shape[:2]
    eight = pixels if pixels.dtype == np.uint8 else (pixels >> 8).astype(np.uint8)
    colour = np.ascontiguousarray(eight[..., :3] if eight.ndim == 3 else eight).astype(np.uint8, copy=False)
    most = math.sqrt(limit / BYTES_A_PIXEL * width / height)
    raster = Raster(b"", 1, 1)
    for narrow in [one for one in WIDTHS if one <= most] or WIDTHS[-1:]:
        size = min(narrow, width), max(1, round(min(narrow, width) * height / width))
        small = cv2.resize(colour, size, interpolation=cv2.INTER_AREA)
        for quality in QUALITIES:
            content = cv2.imencode(".jpg", small, [cv2.IMWRITE_JPEG_QUALITY, quality])[1].tobytes()
            raster = Raster(content, *size)
            if len(content) <= limit:
                return raster
    return raster
