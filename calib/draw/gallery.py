"""Small pictures of the photos in a folder, as many as a page can take, and how good a share of photos or rings is."""

import math
from collections.abc import Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from calib.images.headers import DamagedError
from calib.images.photo import read_preview
from designer.base.words import cut, printable
from designer.page.blocks import Finding, Findings, Gallery, Leaf, Level, Picture, Raster, is_linkable, level_of
from designer.page.folders import size_bytes, title_of

STANDS_OUT = 2.0
"""A photo whose error is so many times the median of all is marked."""
OVERLAYS = "overlays"
"""The folder in which `calib run` puts pictures of what it found."""
BUDGET_BYTES = 4_500_000
"""Of all small pictures together; in a page they take a third more."""
LEAST_BYTES, MOST_BYTES = 30_000, 150_000
"""Of one: with less nothing is seen, with more nothing new."""
THREADS = 2
"""Pictures that are in memory at a time."""
LONGEST_REMARK = 160
"""Characters of what is said of a photo under it."""
MOST_PICTURES = BUDGET_BYTES // LEAST_BYTES
MOST_NAMED = 5
"""Pictures that cannot be shown whose names are said."""
WIDTHS = (1200, 1000, 800, 640, 520, 420, 320, 200, 100)
BYTES_A_PIXEL = 0.09
"""What a JPEG of an overlay takes, about."""
QUALITIES = (82, 68, 50)
MAX_PIXELS = 100_000_000
GOOD_SHARE, USABLE_SHARE = 0.95, 0.5
"""Of the rings that could have been measured, of the readable photos with the target or a pose, and of the photos that
could be read. From 95 % on, what is missing is what nobody can see to: a hair on a ring, a finger at the edge. Below a
half, something is wrong with target file, light or focus, and what was found is no fair sample of the image."""
SHARE_RULE = f"good from {100 * GOOD_SHARE:.0f} %, usable from {100 * USABLE_SHARE:.0f} %"
ENLARGES = "A click enlarges a picture; the link leads to it in full."


def level_of_share(share: float) -> Level:
    """Of a share of what should have been found."""
    return level_of(-share, -GOOD_SHARE, -USABLE_SHARE)


@dataclass(frozen=True)
class Shot:
    """One photo, or a picture of one."""

    path: str  # within the folder, with "/" between folders
    name: str  # as the photo is called
    caption: str
    level: Level | None = None


def gallery(folder: Path, shots: Sequence[Shot], order: str) -> tuple[Leaf, ...]:
    """Small pictures in the order given, and which cannot be shown and why."""
    reasons = [_why_not(folder, shot) for shot in shots]
    inside = [shot for shot, why in zip(shots, reasons, strict=True) if not why]
    broken = [f"{printable(shot.name)}: {why}" for shot, why in zip(shots, reasons, strict=True) if why]
    shown = inside[:MOST_PICTURES]
    limit = min(max(BUDGET_BYTES // max(len(shown), 1), LEAST_BYTES), MOST_BYTES)
    pictures = []
    with ThreadPoolExecutor(THREADS) as pool:
        for shot, made in zip(shown, pool.map(lambda one: small_picture(folder / one.path, limit), shown), strict=True):
            if isinstance(made, Raster):
                pictures.append(Picture(made, printable(shot.name), shot.caption, shot.path, shot.level))
            else:
                broken.append(made)
    blocks: list[Leaf] = []
    if pictures:
        cut = f" {len(shown)} of {len(inside)} are shown, so that the page stays small." * (len(shown) < len(inside))
        blocks.append(Gallery(tuple(pictures), f"{order} {ENLARGES}{cut}"))
    if broken:
        text = "; ".join(broken[:MOST_NAMED]) + ("; ..." * (len(broken) > MOST_NAMED))
        title = "1 picture cannot be shown" if len(broken) == 1 else f"{len(broken)} pictures cannot be shown"
        blocks.append(Findings((Finding("usable", title, text),)))
    return tuple(blocks)


def _why_not(folder: Path, shot: Shot) -> str:
    """Why a picture is not even opened: it may lie elsewhere, or be a pipe, which would wait; "" if it is."""
    if not is_linkable(shot.path):
        return "its name is none that a page can link to"
    return "" if is_there(folder, shot.path) else "is not there"


def is_there(folder: Path, path: str) -> bool:
    """Whether a file can be linked: inside the folder, and a file."""
    return is_linkable(path) and size_bytes(folder / path) is not None


def spread(shots: Sequence[Shot]) -> Sequence[Shot]:
    """Of more than a page can take, as many as it can, evenly from first to last; then the rest."""
    if len(shots) <= MOST_PICTURES:
        return shots
    some = [row * (len(shots) - 1) // (MOST_PICTURES - 1) for row in range(MOST_PICTURES)]
    chosen = set(some)
    return [*(shots[row] for row in some), *(shot for row, shot in enumerate(shots) if row not in chosen)]


def shortened(remark: str) -> str:
    """A remark as one line that fits under a photo."""
    text = printable(remark)
    return cut(text, LONGEST_REMARK)


def title_of_pictures(folder: Path) -> str:
    """The folder's name, with that of the folder around it where its own says no more than that it holds overlays."""
    place = folder.resolve()
    return printable(f"{place.parent.name}/{place.name}") if place.name == OVERLAYS else title_of(folder)


def small_picture(path: Path, limit: int) -> Raster | str:
    """A JPEG of at most about `limit` bytes, or why there is none, in a line without folders."""
    try:
        return _within(read_preview(path, WIDTHS[0], MAX_PIXELS).pixels, limit)
    except (DamagedError, OSError) as error:
        return printable(f"{path.name}: {error}")


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
