"""The photos of a calibration with what was found in them: small pictures of the overlays, and a table."""

import math
import os
from collections import Counter
from collections.abc import Iterator, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from calib.detect.batch import OVERLAY_MARK
from calib.inputs.image_headers import DamagedError, read_header
from calib.inputs.images import read_preview
from calib.report.cells import number, whole
from calib.report.photo_rows import PhotoRow
from calib.results.evaluation_table import figure as digits
from calib.types import UNMEASURABLE_WORDS
from designer.command import printable
from designer.errors import InputError
from designer.page.blocks import Block, Cell, Column, Finding, Findings, Gallery, Picture, Raster, Section, Table
from designer.page.links import is_linkable

OVERLAYS = "overlays"
SUFFIXES = (".jpg", ".png")
BUDGET_BYTES = 4_500_000
"""Of all small pictures together; in a page they take a third more."""
LEAST_BYTES, MOST_BYTES = 30_000, 150_000
"""Of one: with less nothing is seen, with more nothing new."""
WIDTHS = (1200, 1000, 800, 640, 520, 420, 320, 200, 100)
BYTES_A_PIXEL = 0.09
"""What a JPEG of an overlay takes, about."""
QUALITIES = (82, 68, 50)
MAX_PIXELS = 100_000_000
MAX_FILE_BYTES = 400 * 2**20
THREADS = 2
"""Pictures that are in memory at a time."""
HEAD_BYTES = 2**16
LONGEST_REMARK = 160
"""Characters of what is said of a photo under it."""


@dataclass(frozen=True)
class Overlay:
    """The overlay of a photo."""

    row: PhotoRow
    path: Path


def overlay_paths(folder: Path, rows: Sequence[PhotoRow]) -> dict[str, Path]:
    """Where the overlays of photos lie, of those that have one: named after the photo, or numbered."""
    place = folder / OVERLAYS
    try:
        there = {entry.name for entry in os.scandir(place) if entry.is_file()}
    except OSError:
        return {}
    flat = [row.name.replace("/", "_") for row in rows]
    count = Counter(Path(name).stem for name in flat)
    found = {}
    for order, (row, name) in enumerate(zip(rows, flat, strict=True), start=1):
        stem = Path(name).stem
        stems = (*((stem,) if count[stem] == 1 else ()), name, f"{order}-{name}", f"{order}")
        names = (f"{one}{OVERLAY_MARK}{suffix}" for one in stems for suffix in SUFFIXES)
        if (first := next((one for one in names if one in there), None)) is not None:
            found[row.name] = place / first
    return found


def photos_section(folder: Path, rows: Sequence[PhotoRow], common: Sequence[str], *, is_flat: bool) -> Section:
    """Pictures and table.

    Args:
        folder: of the calibration.
        rows: of its photos.
        common: what is remarked of all of them.
        is_flat: the target has one face, so that a photo has a tilt.
    """
    said = (Findings(tuple(Finding("note", "All photos", shortened(remark)) for remark in common)),) if common else ()
    blocks = (*said, *_gallery(folder, rows), views_table(rows, is_flat=is_flat))
    return Section("Photos", blocks, lead=_lead(rows))


def _lead(rows: Sequence[PhotoRow]) -> str:
    used = [row for row in rows if row.is_used]
    known = [row for row in used if math.isfinite(row.rmse_px)]
    words = f"{len(used)} of {len(rows)} photos were used"
    if known:
        least, most = min(known, key=lambda row: row.rmse_px), max(known, key=lambda row: row.rmse_px)
        words += (
            f"; what is left over of one is {digits(least.rmse_px, 2)} to {digits(most.rmse_px, 2)} px, "
            f"most in {printable(most.name)}"
        )
    marked = sum(row.level == "usable" for row in rows)
    if marked:
        words += f". {marked} with more than twice the usual error {'is' if marked == 1 else 'are'} marked"
    return f"{words}."


def _gallery(folder: Path, rows: Sequence[PhotoRow]) -> Iterator[Block]:
    """Small pictures of as many overlays as a page can take, the worst first, and what there is not."""
    places = overlay_paths(folder, rows)
    overlays = [Overlay(row, places[row.name]) for row in _worst_first(rows) if row.name in places]
    if not overlays:
        yield Findings((Finding(
            "note", "No pictures", f"The folder {OVERLAYS}/ holds no overlay of these photos; calib run draws them."
        ),))  # fmt: skip
        return
    most = BUDGET_BYTES // LEAST_BYTES
    shown = overlays[:most]
    limit = min(max(BUDGET_BYTES // len(shown), LEAST_BYTES), MOST_BYTES)
    pictures, broken = [], []
    with ThreadPoolExecutor(THREADS) as pool:
        for overlay, made in zip(shown, pool.map(lambda one: small_picture(one.path, limit), shown), strict=True):
            if isinstance(made, Raster):
                pictures.append(_picture(overlay, made))
            else:
                broken.append(made)
    if pictures:
        yield Gallery(tuple(pictures), _note(rows, overlays, shown))
    if broken:
        yield Findings((Finding(
            "usable", f"{len(broken)} overlays cannot be shown", "; ".join(broken[:5]) + ("; ..." * (len(broken) > 5))
        ),))  # fmt: skip


def _note(rows: Sequence[PhotoRow], overlays: Sequence[Overlay], shown: Sequence[Overlay]) -> str:
    """How the pictures are ordered, and which are not there."""
    words = "The photos with the largest errors first. A click enlarges a picture; the link leads to it in full."
    if len(shown) < len(overlays):
        words += f" {len(shown)} of {len(overlays)} are shown, so that the page stays small; all are in {OVERLAYS}/."
    if without := len(rows) - len(overlays):
        words += f" {without} {'has' if without == 1 else 'have'} no overlay."
    return words


def _worst_first(rows: Sequence[PhotoRow]) -> list[PhotoRow]:
    """Photos that were not used, then by falling error."""
    return sorted(rows, key=lambda row: (row.is_used, -row.rmse_px if math.isfinite(row.rmse_px) else math.inf))


def _picture(overlay: Overlay, image: Raster) -> Picture:
    path = f"{OVERLAYS}/{overlay.path.name}"
    return Picture(
        image, printable(overlay.row.name), caption_of(overlay.row), path if is_linkable(path) else "",
        overlay.row.level,
    )  # fmt: skip


def caption_of(row: PhotoRow) -> str:
    """What is said under a photo."""
    seen = f"{row.seen} rings" if row.expected is None else f"{row.seen} of {row.expected} rings"
    words = [seen]
    if math.isfinite(row.rmse_px):
        words.append(f"RMS {digits(row.rmse_px, 2)} px")
    if math.isfinite(row.tilt_deg):
        words.append(f"tilt {row.tilt_deg:.0f}°")
    elif row.faces > 1:
        words.append(f"{row.faces} faces")
    if math.isfinite(row.distance_mm):
        words.append(f"{row.distance_mm:.0f} mm away")
    if row.outliers:
        words.append(f"{row.outliers} outliers")
    if row.remark:
        words.append(shortened(row.remark))
    return ", ".join(words)


def shortened(remark: str) -> str:
    """A remark as one line that fits under a photo."""
    text = printable(remark)
    return text if len(text) <= LONGEST_REMARK else f"{text[: LONGEST_REMARK - 3]}..."


def small_picture(path: Path, limit: int) -> Raster | str:
    """A JPEG of at most about `limit` bytes, or why there is none, in a line without folders.

    The size is asked for before it is decoded, and a picture is scaled down at once.
    """
    try:
        with path.open("rb") as stream:
            head = read_header_of(stream.read(HEAD_BYTES))
        if path.stat().st_size > MAX_FILE_BYTES or head[0] * head[1] > MAX_PIXELS:
            return f"{printable(path.name)}: {head[0]} x {head[1]} px are too many for a small picture"
        return _within(read_preview(path, WIDTHS[0]).pixels, limit)
    except (InputError, DamagedError, OSError) as error:
        return printable(f"{path.name}: {str(error).removeprefix(f'{path}: ')}")


def read_header_of(head: bytes) -> tuple[int, int]:
    """Width and height in px from the start of a file; (0, 0) where they stand farther on, and the reader checks."""
    try:
        header = read_header(head)
    except DamagedError:
        if head.startswith(b"\xff\xd8\xff"):  # a JPEG is judged by its end too, which is not here
            return 0, 0
        raise
    return header.width, header.height


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


def views_table(rows: Sequence[PhotoRow], *, is_flat: bool) -> Table:
    """A row a photo."""
    side = Column("tilt °", note="between the target and the image plane; 0 is straight on")
    columns = (
        Column("photo", is_number=False),
        Column(
            "rings",
            note=f"found, of those of the faces in the photo that could be measured: not those {UNMEASURABLE_WORDS}",
        ),
        Column("outliers", note="sightings that were left out of the solution"),
        Column("RMSE px", note="root mean square of what is left over: predicted - measured"),
        Column("worst px", note="the largest that is left over"),
        Column("intersection mm", note="RMS distance on the target between the ray of a sighting and its ring"),
        side if is_flat else Column("faces", note="of the target, that were read"),
        Column("distance mm", note="from the camera to the target's middle"),
        Column("size %", note="of the image's width or height that the rings fill, whichever is more"),
        Column("remark", is_number=False),
    )
    return Table("All photos", columns, tuple(_table_row(row, is_flat=is_flat) for row in rows))


def _table_row(row: PhotoRow, *, is_flat: bool) -> tuple[Cell, ...]:
    rings = str(row.seen) if row.expected is None else f"{row.seen} / {row.expected}"
    side = number(row.tilt_deg, 2) if is_flat else whole(row.faces)
    return (
        Cell(printable(row.name), level=row.level), Cell(rings, float(row.seen)), whole(row.outliers),
        number(row.rmse_px), number(row.worst_px), number(row.intersection_mm), side, number(row.distance_mm),
        number(row.size_percent, 2),
        Cell(shortened(row.remark)),
    )  # fmt: skip
