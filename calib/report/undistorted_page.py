"""The page of `calib undistort`: photos as a pinhole would have taken them, and that pinhole."""

import os
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from calib.camera_file import load_camera
from calib.cameras import project, rays
from calib.report.accuracy_figures import image_panel
from calib.report.camera_section import field_of_view_words
from calib.report.folder_blocks import files_section, warnings
from calib.report.gallery import Shot, gallery, is_there, spread
from calib.report.origin import Origin
from calib.report.titles import title_of
from calib.report.undistorted_file import UNDISTORTED_FILE, UndistortedFile, read_undistorted
from calib.results.evaluation_table import figure as digits
from calib.types import Camera
from designer.command import printable
from designer.errors import InputError
from designer.page.blocks import Block, Cell, Column, Command, Facts, Figure, Headline, Page, Section, Table
from designer.words import capital

if TYPE_CHECKING:
    from matplotlib.axes import Axes

Array = NDArray[np.float64]

CAMERA_FILE = "camera.json"
MARK = ".undistorted.png"
FILES = (
    (CAMERA_FILE, "the pinhole that belongs to the undistorted photos"),
    (UNDISTORTED_FILE, "the camera that took the photos, and what became of each"),
)
STEPS = 61
"""Of the grid on the photo, along each side, by which it is judged."""
LINES, POINTS = 13, 101
"""Drawn along each side, and points of each."""
MOST_BEYOND = 0.5
"""Of the frame's width or height: what a figure shows beyond it."""
MOST_FAILURES = 20


@dataclass(frozen=True)
class Change:
    """What happens to the pixels of a photo."""

    share_kept: float  # of the photo, inside the new frame; the rest is cut off
    shift_px: float  # the farthest that a pixel moves, of those kept; nan: none is


def undistorted_page(folder: Path, origin: Origin) -> Page:
    """Read a folder and build its page.

    Raises:
        InputError: `undistorted.json` or `camera.json` cannot be read; the message names it.
    """
    file, taken = read_undistorted(folder)
    pinhole = load_camera(folder / CAMERA_FILE)
    if pinhole.model != "pinhole" or pinhole.image_size != taken.image_size:
        raise InputError(f"{folder / CAMERA_FILE}: not the pinhole of these photos; undistort again")
    change = change_of(taken, pinhole)
    shots = [Shot(photo.path, photo.image, "; ".join(map(printable, photo.remarks))) for photo in file.photos]
    careful = [*map(printable, file.failures[:MOST_FAILURES])]
    if len(file.failures) > MOST_FAILURES:
        careful.append(f"{len(file.failures) - MOST_FAILURES} more photos could not be undistorted")
    stale = _others(folder, file)
    if stale:
        careful.append(
            f"{stale} more undistorted photos are in this folder, of an earlier run: {CAMERA_FILE} may not be theirs"
        )
    blocks: tuple[Block, ...] = (
        *warnings("Not in this set", careful), *gallery(folder, spread(shots), "In the order they were given."),
        _table(folder, file),
    )  # fmt: skip
    sections = (
        Section("Photos", blocks),
        Section("The new camera", (_parameters(pinhole, taken),), lead=_pinhole_words(pinhole, taken)),
        Section("Next", _next(file, change)),
        files_section(folder, FILES, Command("calib report .", "in this folder: makes this page again")),
    )
    return Page(
        title=title_of(folder), kind="Undistorted photos", headline=_headline(file, pinhole, change),
        sections=sections, lead=(_bent(taken, pinhole, change), Facts(_facts(file, taken, pinhole, change))),
        made_by=origin.command, program=origin.program,
    )  # fmt: skip


def change_of(taken: Camera, pinhole: Camera) -> Change:
    """What happens to a grid of the photo's pixels."""
    last = np.array(taken.image_size) - 1.0
    grid = np.stack(np.meshgrid(*(np.linspace(0, end, STEPS) for end in last)), axis=-1).reshape(-1, 2)
    place = project(pinhole, rays(taken, grid))
    inside = ((place >= -0.5) & (place <= last + 0.5)).all(axis=1)
    shift = np.linalg.norm(place - grid, axis=1)[inside]
    return Change(float(inside.mean()), float(shift.max()) if len(shift) else np.nan)


def _others(folder: Path, file: UndistortedFile) -> int:
    """How many undistorted photos lie there that are not of this run."""
    ours = {photo.path for photo in file.photos}
    with os.scandir(folder) as entries:
        return sum(entry.name.endswith(MARK) and entry.name not in ours for entry in entries)


def _headline(file: UndistortedFile, pinhole: Camera, change: Change) -> Headline:
    count = len(file.photos)
    word = "1 photo" if count == 1 else f"{count} photos"
    sentence = (
        f"{capital(word)} as a pinhole of {digits(float(pinhole.params[0]), 6)} px focal length would "
        f"have taken {'it' if count == 1 else 'them'}; {_kept_words(change)}, {_black_words(file)}."
    )
    if file.failures:
        failed = len(file.failures)
        return Headline("usable", "undistorted in part", f"{sentence} {failed} could not be undistorted.")
    return Headline("note", "undistorted", sentence)


def _kept_words(change: Change) -> str:
    if change.share_kept == 1:
        return "nothing of a photo is cut off"
    return f"{_percent(1 - change.share_kept)} of a photo is cut off"


def _black_words(file: UndistortedFile) -> str:
    black = 1 - file.share_filled
    return "and no pixel is black" if black == 0 else f"and {_percent(black)} of the pixels are black"


def _percent(share: float) -> str:
    return "less than 0.1 %" if 0 < share < 0.001 else f"{100 * share:.1f} %"


def _facts(file: UndistortedFile, taken: Camera, pinhole: Camera, change: Change) -> tuple[tuple[str, str], ...]:
    width, height = pinhole.image_size
    return (
        ("camera of the photos", f"{printable(file.camera_name)} (model {taken.model})"),
        ("image", f"{width} x {height} px"),
        ("focal length", f"{digits(float(pinhole.params[0]), 6)} px; before {digits(float(taken.params[0]), 6)} px"),
        ("field of view", f"{field_of_view_words(pinhole)}; before {field_of_view_words(taken)}"),
        ("moved farthest", f"{digits(change.shift_px, 3)} px" if np.isfinite(change.shift_px) else "not known"),
        ("cut off", _percent(1 - change.share_kept)),
        ("black", _percent(1 - file.share_filled)),
    )


def _bent(taken: Camera, pinhole: Camera, change: Change) -> Figure:
    """Lines that were straight and level in the photo, in the undistorted frame."""
    width, height = taken.image_size
    u, v = np.linspace(0, width - 1, POINTS), np.linspace(0, height - 1, POINTS)
    across = [np.column_stack([u, np.full(POINTS, y)]) for y in np.linspace(0, height - 1, LINES)]
    down = [np.column_stack([np.full(POINTS, x), v]) for x in np.linspace(0, width - 1, LINES)]
    lines = [project(pinhole, rays(taken, line)) for line in (*across, *down)]
    shift = f"{digits(change.shift_px, 3)} px" if np.isfinite(change.shift_px) else "an unknown distance"

    def draw(axes: "Axes") -> None:
        from calib.figures.style import image_axes

        image_axes(axes, taken.image_size, "")
        for line in lines:
            axes.plot(*line.T, color="#0072b2", linewidth=0.8)
        axes.plot([0, width, width, 0, 0], [0, 0, height, height, 0], color="#1a1a1a", linewidth=2)
        (left, right), (top, bottom) = (_span(lines, axis, side) for axis, side in enumerate(taken.image_size))
        axes.set(xlim=(left, right), ylim=(bottom, top))

    words = f"Rows and columns of the photo when they are undistorted: pixels move by up to {shift}"
    caption = (
        f"{words}. The thick frame is the new image: lines outside are cut off, and where none reaches it is black."
    )
    return image_panel("What undistortion moves", taken.image_size, draw, words, caption, has_bar=False)


def _span(lines: list[Array], axis: int, side: int) -> tuple[float, float]:
    """What a figure shows along an axis: the frame, and lines that go beyond it, but not too far."""
    values = np.concatenate([line[:, axis] for line in lines])
    values = values[np.isfinite(values)]
    margin, most = 0.03 * side, MOST_BEYOND * side
    low, high = min(0.0, *values), max(float(side), *values)
    return max(low, -most) - margin, min(high, side + most) + margin


def _pinhole_words(pinhole: Camera, taken: Camera) -> str:
    kept = "as the camera's" if pinhole.params[0] == taken.params[0] else "chosen for these photos"
    return (
        f"A pinhole without distortion, its focal length {kept}. Use it with the undistorted photos only, and the "
        "camera's own file with the photos as they were taken."
    )


def _parameters(pinhole: Camera, taken: Camera) -> Table:
    names = ("fx", "fy", "cx", "cy")
    columns = (Column("parameter", is_number=False), Column("px"), Column("before px", note="of the photos' camera"))
    rows = tuple(
        (Cell(name), Cell(f"{new:.3f}", float(new)), Cell(f"{old:.3f}", float(old)))
        for name, new, old in zip(names, pinhole.params, taken.params, strict=False)
    )
    return Table("Parameters", columns, rows, "Pixel (0, 0) is the centre of the top-left pixel.")


def _table(folder: Path, file: UndistortedFile) -> Table:
    has_remarks = any(photo.remarks for photo in file.photos)
    titles = ("photo", "undistorted", *(("remark",) if has_remarks else ()))
    rows = []
    for photo in file.photos:
        can_link = is_there(folder, photo.path)
        cell = Cell(printable(photo.path) if can_link else "not there", path=photo.path if can_link else "")
        remark = (Cell("; ".join(map(printable, photo.remarks))),) if has_remarks else ()
        rows.append((Cell(printable(photo.image)), cell, *remark))
    return Table("All photos", tuple(Column(title, is_number=False) for title in titles), tuple(rows))


def _next(file: UndistortedFile, change: Change) -> tuple[Block, ...]:
    steps: list[Block] = [
        Command(f"calib convert {CAMERA_FILE} --to colmap -o cameras.txt", "in this folder: the pinhole for COLMAP"),
        Command(f"calib convert {CAMERA_FILE} --to opencv -o camera.yaml", "for OpenCV; there are ros, mrcal, ... too"),
    ]
    if file.share_filled < 1:
        steps.append(Command(
            "calib undistort CAMERA PHOTOS -o DIR --alpha 0", "the same without black regions, with less of the photos"
        ))  # fmt: skip
    if change.share_kept < 1:
        steps.append(Command(
            "calib undistort CAMERA PHOTOS -o DIR --alpha 1", "the same with all that the photos show, black beside it"
        ))  # fmt: skip
    return tuple(steps)
