"""A first guess of the focal length from what a camera wrote into its photo."""

import math
import warnings
from pathlib import Path

from PIL import Image

from calib.observe.image_headers import png_exif

EXIF_IFD, FOCAL_LENGTH_IN_35_MM = 0x8769, 0xA405
DIAGONAL_OF_35_MM = math.hypot(36, 24)


def exif_focal_px(path: Path) -> float | None:
    """Focal length in pixels by the tag `FocalLengthIn35mmFilm`, or None if the photo does not say.

    The tag compares diagonals, is rounded to whole millimetres, and knows of no crop: it is a guess to start from.
    """
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")
            with Image.open(path) as image:
                if image.format == "PNG":  # Pillow would decode the pixels, as a block may stand behind them
                    exif = Image.Exif()
                    exif.load(png_exif(path.read_bytes()))
                else:
                    exif = image.getexif()
                length = exif.get_ifd(EXIF_IFD).get(FOCAL_LENGTH_IN_35_MM)
                diagonal_px = math.hypot(*image.size)
        focal_mm = float(length) if length is not None else 0.0
    except Exception:
        return None  # a photo may hold anything; the solver needs no guess
    return focal_mm / DIAGONAL_OF_35_MM * diagonal_px if 1 <= focal_mm <= 5000 else None
