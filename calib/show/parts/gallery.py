"""Small pictures of the photos in a folder, as many as a page can take."""

from collections.abc import Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from pathlib import Path

from calib.show.parts.folder_blocks import size_bytes
from calib.show.parts.small_picture import small_picture
from calib.show.parts.titles import title_of
from designer.base.words import printable
from designer.page.blocks import Finding, Findings, Gallery, Leaf, Level, Picture, Raster
from designer.page.links import is_linkable

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
ENLARGES = "A click enlarges a picture; the link leads to it in full."


@dataclass(frozen=True)
class Shot:
    """One photo, or a picture of one."""

    path: str  # within the folder, with "/" between folders
    name: str  # as the photo is called
    caption: str
    level: Level | None = None


def gallery(folder: Path, shots: Sequence[Shot], order: str) -> tuple[Leaf, ...]:
    """Small pictures in the order given, and which cannot be shown and why.

    Args:
        folder: of the page.
        shots: all that there are; of very many the first are shown.
        order: how they are sorted, as a sentence.
    """
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
    return text if len(text) <= LONGEST_REMARK else f"{text[: LONGEST_REMARK - 3]}..."


def title_of_pictures(folder: Path) -> str:
    """The folder's name, with that of the folder around it where its own says no more than that it holds overlays."""
    place = folder.resolve()
    return printable(f"{place.parent.name}/{place.name}") if place.name == OVERLAYS else title_of(folder)
