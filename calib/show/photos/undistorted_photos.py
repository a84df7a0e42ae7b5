"""What `calib undistort` tells of its photos: as a pinhole would have taken them, that pinhole, and what moved."""

from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from calib.cameras import project, rays
from calib.cameras.camera import Camera
from calib.core.number_text import figure as digits
from calib.observe.photos import PhotoFile
from calib.show.parts.folder_blocks import some_of
from calib.show.photos.photos_file import PHOTOS_FILE, ToldPhoto, ToldPhotos, ToldSection
from calib.show.run.sections import field_of_view_words
from designer.page.blocks import Cell, Column, Command, Figure, Finding, Headline

if TYPE_CHECKING:
    from matplotlib.axes import Axes

Array = NDArray[np.float64]

MARK = ".undistorted"
"""Stands in the name of each undistorted photo, so that one is not taken for a photo of the camera."""
CAMERA_FILE = "camera.json"
FILES = (
    (CAMERA_FILE, "the pinhole of the undistorted photos, and of them only: others have the camera's own file"),
    (PHOTOS_FILE, "the camera that took the photos, and what became of each"),
)
STEPS = 61
"""Of the grid on the photo, along each side, by which it is judged."""
LINES, POINTS = 13, 101
"""Drawn along each side, and points of each."""
MOST_BEYOND = 0.5
"""Of the frame's width or height: what a figure shows beyond it."""


@dataclass(frozen=True)
class UndistortedFile:
    """What came of one photo."""

    photo: PhotoFile
    place: Path | None = None  # of the undistorted photo; None: there is none
    share_filled: float = 0.0
    remarks: tuple[str, ...] = ()
    failure: str = ""  # one line that names the file


@dataclass(frozen=True, eq=False)
class UndistortedFiles:
    """What came of many photos: `made.pinhole`, `made.failures`."""

    folder: Path
    camera: Camera  # that took the photos
    pinhole: Camera  # that the undistorted ones are of, in `camera_file`
    photos: tuple[UndistortedFile, ...]
    missing: tuple[str, ...]  # arguments that stood for no photo, one line each
    left_out: int  # undistorted photos of an earlier run among them

    @property
    def good(self) -> tuple[tuple[UndistortedFile, Path], ...]:
        """The photos that were undistorted, and where they are."""
        return tuple((one, one.place) for one in self.photos if one.place is not None)

    @property
    def failures(self) -> tuple[str, ...]:
        """Why others were not, one line each."""
        return (*self.missing, *(one.failure for one in self.photos if one.failure))

    @property
    def share_filled(self) -> float:
        """Of the pixels of the worst photo; the others are black."""
        return min(one.share_filled for one, _ in self.good)

    @property
    def camera_file(self) -> Path:
        """Of the camera that belongs to them."""
        return self.folder / CAMERA_FILE

    @property
    def files(self) -> tuple[Path, ...]:
        """All that was written."""
        return (*(place for _, place in self.good), *((self.camera_file,) if self.good else ()))

    @property
    def earlier(self) -> int:
        """Undistorted photos in the folder that are not of this set."""
        names = {place.name for _, place in self.good}
        return sum(place.name not in names for place in self.folder.glob(f"*{MARK}.png"))


@dataclass(frozen=True)
class Change:
    """What happens to the pixels of a photo."""

    share_kept: float  # of the photo, inside the new frame; the rest is cut off
    shift_px: float  # the farthest that a pixel moves, of those kept; nan: none is

    @property
    def shift_words(self) -> str:
        """How far pixels move."""
        return f"{digits(self.shift_px, 3)} px" if np.isfinite(self.shift_px) else "an unknown distance"


def change_of(taken: Camera, pinhole: Camera) -> Change:
    """What happens to a grid of the photo's pixels."""
    last = np.array(taken.image_size) - 1.0
    grid = np.stack(np.meshgrid(*(np.linspace(0, end, STEPS) for end in last)), axis=-1).reshape(-1, 2)
    place = project(pinhole, rays(taken, grid))
    inside = ((place >= -0.5) & (place <= last + 0.5)).all(axis=1)
    shift = np.linalg.norm(place - grid, axis=1)[inside]
    return Change(float(inside.mean()), float(shift.max()) if len(shift) else np.nan)


def told_undistorted(made: UndistortedFiles, camera_name: str) -> ToldPhotos:
    """What is to be said of undistorted photos; the camera's name is as it was given."""
    change = change_of(made.camera, made.pinhole)
    remarks = tuple("; ".join(one.remarks) for one, _ in made.good)
    columns = (Column("remark", is_number=False),) if any(remarks) else ()
    notes = [Finding("usable", "Not undistorted", line) for line in some_of(made.failures)]
    if made.left_out:
        notes.append(Finding("note", "Left out", f"{made.left_out} undistorted photos of an earlier run"))
    if made.earlier:
        words = f"{made.earlier} more undistorted photos are in this folder: {CAMERA_FILE} may not be theirs"
        notes.append(Finding("usable", "Of an earlier run", words))
    return ToldPhotos(
        "undistorted", _headline(made, change), _facts(made, change, camera_name), columns,
        tuple(
            ToldPhoto(one.photo.name, (Cell(remark),) if columns else (), place.name, remark)
            for (one, place), remark in zip(made.good, remarks, strict=True)
        ),
        "In the order they were given.", FILES, notes=tuple(notes),
        after=(ToldSection("Next", _next(made, change)),),
        camera=made.camera, pinhole=made.pinhole,
    )  # fmt: skip


def _headline(made: UndistortedFiles, change: Change) -> Headline:
    count, failed, black = len(made.good), len(made.failures), 1 - made.share_filled
    kept = f"{_percent(1 - change.share_kept)} of a photo is" if change.share_kept < 1 else "nothing of a photo is"
    filled = f"{_percent(black)} of the pixels are" if black else "no pixel is"
    sentence = (
        f"{'1 photo' if count == 1 else f'{count} photos'} as a pinhole of "
        f"{digits(float(made.pinhole.params[0]), 6)} px focal length would have taken "
        f"{'it' if count == 1 else 'them'}; {kept} cut off, and {filled} black."
    )
    if failed:
        return Headline("usable", "undistorted in part", f"{sentence} {failed} could not be undistorted.")
    return Headline("note", "undistorted", sentence)


def _percent(share: float) -> str:
    return "less than 0.1 %" if 0 < share < 0.001 else f"{100 * share:.1f} %"


def _facts(made: UndistortedFiles, change: Change, camera_name: str) -> tuple[tuple[str, str], ...]:
    taken, pinhole = made.camera, made.pinhole
    width, height = pinhole.image_size
    return (
        ("camera of the photos", f"{camera_name} (model {taken.model})"),
        ("image", f"{width} x {height} px"),
        *(
            (name, f"{new:.3f} px; before {old:.3f} px")
            for name, new, old in zip(("fx", "fy", "cx", "cy"), pinhole.params, taken.params, strict=False)
        ),
        ("field of view", f"{field_of_view_words(pinhole)}; before {field_of_view_words(taken)}"),
        ("moved farthest", change.shift_words),
        ("cut off", _percent(1 - change.share_kept)),
        ("black", _percent(1 - made.share_filled)),
    )


def _next(made: UndistortedFiles, change: Change) -> tuple[Command, ...]:
    again = "calib undistort CAMERA PHOTOS -o DIR --alpha"
    black, cut = made.share_filled < 1, change.share_kept < 1
    return (
        Command(f"calib convert {CAMERA_FILE} --to colmap -o cameras.txt", "in this folder: the pinhole for COLMAP"),
        Command(f"calib convert {CAMERA_FILE} --to opencv -o camera.yaml", "for OpenCV; there are ros, mrcal, ... too"),
        *((Command(f"{again} 0", "the same without black regions, with less of the photos"),) if black else ()),
        *((Command(f"{again} 1", "the same with all that the photos show, black beside it"),) if cut else ()),
    )


def undistortion_figure(taken: Camera, pinhole: Camera) -> Figure:
    """Lines that were straight and level in the photo, in the undistorted frame."""
    from calib.figures.style import AxesDrawing, image_axes
    from calib.show.run.figures import figure_of

    width, height = taken.image_size
    u, v = np.linspace(0, width - 1, POINTS), np.linspace(0, height - 1, POINTS)
    across = [np.column_stack([u, np.full(POINTS, y)]) for y in np.linspace(0, height - 1, LINES)]
    down = [np.column_stack([np.full(POINTS, x), v]) for x in np.linspace(0, width - 1, LINES)]
    lines = [project(pinhole, rays(taken, line)) for line in (*across, *down)]

    def draw(axes: "Axes") -> None:
        image_axes(axes, taken.image_size)
        for line in lines:
            axes.plot(*line.T, color="#0072b2", linewidth=0.8)
        axes.plot([0, width, width, 0, 0], [0, 0, height, height, 0], color="#1a1a1a", linewidth=2)
        (left, right), (top, bottom) = (_span(lines, axis, side) for axis, side in enumerate(taken.image_size))
        axes.set(xlim=(left, right), ylim=(bottom, top))

    shift = change_of(taken, pinhole).shift_words
    words = f"Rows and columns of the photo when they are undistorted: pixels move by up to {shift}"
    frame = "The thick frame is the new image: lines outside are cut off, and where none reaches it is black."
    return figure_of(AxesDrawing("What undistortion moves", words, draw, taken.image_size), frame)


def _span(lines: list[Array], axis: int, side: int) -> tuple[float, float]:
    """What a figure shows along an axis: the frame, and lines that go beyond it, but not too far."""
    values = np.concatenate([line[:, axis] for line in lines])
    values = values[np.isfinite(values)]
    margin, most = 0.03 * side, MOST_BEYOND * side
    low, high = min(0.0, *values), max(float(side), *values)
    return max(low, -most) - margin, min(high, side + most) + margin
