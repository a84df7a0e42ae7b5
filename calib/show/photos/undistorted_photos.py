"""What `calib undistort` tells of its photos: what would have taken them, its camera, and what moved."""

from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from calib.cameras import LINEAR, PictureKind, pictures, project, rays
from calib.cameras.camera import Camera
from calib.cameras.field_of_view import field_of_view
from calib.cameras.linear_part import linear_part
from calib.observe.photos import PhotoFile
from calib.show.photos.photos_file import PHOTOS_FILE, ToldPhoto, ToldPhotos, ToldSection
from calib.show.run.sections import field_of_view_words
from designer.base.number_text import figure as digits
from designer.page.blocks import Cell, Column, Command, Figure, Finding, Headline
from designer.page.folders import some_of

if TYPE_CHECKING:
    from matplotlib.axes import Axes

Array = NDArray[np.float64]

MARK = ".undistorted"
"""Stands in the name of each undistorted photo, so that one is not taken for a photo of the camera."""
CAMERA_FILE = "camera.json"
FILES = (
    (CAMERA_FILE, "the camera of the undistorted photos, and of them only: others have the camera's own file"),
    (PHOTOS_FILE, "the camera that took the photos, and what became of each"),
)
STEPS = 61
"""Of the grid on the photo, along each side, by which it is judged."""
LINES, POINTS = 13, 101
"""Drawn along each side, and points of each."""
WIDE_RAD = np.radians(60)
"""Light from farther off the axis fills much of a pinhole's picture with little."""
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
    """What came of many photos: `made.new_camera`, `made.failures`."""

    folder: Path
    camera: Camera  # that took the photos
    new_camera: Camera  # that the undistorted ones are of, in `camera_file`
    photos: tuple[UndistortedFile, ...]
    missing: tuple[str, ...]  # arguments that stood for no photo, one line each
    left_out: int  # undistorted photos of an earlier run among them
    cam_from_new: Array = field(default_factory=lambda: np.eye(3))  # (3, 3) where the new camera looks

    @property
    def is_turned(self) -> bool:
        """Whether the new camera looks elsewhere than the camera."""
        return not np.array_equal(self.cam_from_new, np.eye(3))

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

    share_kept: float  # of what the camera knows the light of, inside the new frame; the rest is cut off
    share_known: float  # of the photo
    shift_px: float  # the farthest that a pixel moves, of those kept; nan: none is, or it is another kind of picture

    @property
    def shift_words(self) -> str:
        """How far pixels move."""
        return f"{digits(self.shift_px, 3)} px" if np.isfinite(self.shift_px) else "an unknown distance"


def change_of(taken: Camera, new_camera: Camera, cam_from_new: Array | None = None) -> Change:
    """What happens to a grid of the photo's pixels."""
    last = np.array(taken.image_size) - 1.0
    grid = np.stack(np.meshgrid(*(np.linspace(0, end, STEPS) for end in last)), axis=-1).reshape(-1, 2)
    place = _moved(taken, new_camera, cam_from_new, grid)
    known = np.isfinite(rays(taken, grid)[:, 2])
    inside = ((place >= -0.5) & (place <= np.array(new_camera.image_size) - 0.5)).all(axis=1)
    shift = np.linalg.norm(place - grid, axis=1)[inside]
    is_like = cam_from_new is None and new_camera.image_size == taken.image_size
    kept = float((inside & known).sum() / max(known.sum(), 1))
    return Change(kept, float(known.mean()), float(shift.max()) if len(shift) and is_like else np.nan)


def _moved(taken: Camera, new_camera: Camera, cam_from_new: Array | None, pixel: Array) -> Array:
    """Where pixels (N, 2) of a photo are in the new one."""
    ray = rays(taken, pixel)
    return project(new_camera, ray if cam_from_new is None else ray @ cam_from_new)


def told_undistorted(made: UndistortedFiles, camera_name: str) -> ToldPhotos:
    """What is to be said of undistorted photos; the camera's name is as it was given."""
    turned = made.cam_from_new if made.is_turned else None
    change = change_of(made.camera, made.new_camera, turned)
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
        camera=made.camera, pinhole=made.new_camera, cam_from_new=turned,
    )  # fmt: skip


def _headline(made: UndistortedFiles, change: Change) -> Headline:
    count, failed, black = len(made.good), len(made.failures), 1 - made.share_filled
    shown = "a photo" if change.share_known == 1 else "what the camera knows"
    kept = f"{_percent(1 - change.share_kept)} of {shown} is" if change.share_kept < 1 else f"nothing of {shown} is"
    filled = f"{_percent(black)} of the pixels are" if black else "no pixel is"
    photos, them = ("1 photo", "it") if count == 1 else (f"{count} photos", "them")
    focal, field = digits(float(made.new_camera.params[0]), 6), field_of_view_words(made.new_camera)
    sentence = (
        f"{photos} as {_picture(made).words} of {focal} px focal length would have taken {them}, with a field of view "
        f"of {field}; {kept} cut off, and {filled} black."
    )
    if failed:
        return Headline("usable", "undistorted in part", f"{sentence} {failed} could not be undistorted.")
    return Headline("note", "undistorted", sentence)


def _picture(made: UndistortedFiles) -> PictureKind:
    """What the undistorted photos are."""
    return pictures()[made.new_camera.model]


def direction_words(cam_from_new: Array) -> str:
    """Where a new camera looks."""
    x, y, z = cam_from_new[:, 2]
    yaw, pitch = np.degrees([np.arctan2(x, z), np.arctan2(-y, np.hypot(x, z))])
    sides = (
        f"{abs(yaw):.1f}° to the {'right' if yaw > 0 else 'left'}",
        f"{abs(pitch):.1f}° {'up' if pitch > 0 else 'down'}",
    )
    return (
        ", ".join(words for words, angle in zip(sides, (yaw, pitch), strict=True) if abs(angle) >= 0.05)
        or "straight on"
    )


def _percent(share: float) -> str:
    return "less than 0.1 %" if 0 < share < 0.001 else f"{100 * share:.1f} %"


def _facts(made: UndistortedFiles, change: Change, camera_name: str) -> tuple[tuple[str, str], ...]:
    taken, new = made.camera, made.new_camera
    (width, height), before = new.image_size, taken.image_size
    return (
        ("camera of the photos", f"{camera_name} (model {taken.model})"),
        ("new camera", f"{new.model}: {_picture(made).equation}{', in radians' if new.model != LINEAR else ''}"),
        *((("looks", direction_words(made.cam_from_new)),) if made.is_turned else ()),
        (
            "image",
            f"{width} x {height} px{'' if before == new.image_size else f'; before {before[0]} x {before[1]} px'}",
        ),
        *(
            (name, f"{value:.3f} px; before {old:.3f} px")
            for name, value, old in zip(("fx", "fy", "cx", "cy"), new.params, linear_part(taken).params, strict=True)
        ),
        ("field of view", f"{field_of_view_words(new)}; before {field_of_view_words(taken)}"),
        *((("moved farthest", change.shift_words),) if new.model == LINEAR and not made.is_turned else ()),
        ("cut off", _percent(1 - change.share_kept)),
        *(
            (("without known light", f"{_percent(1 - change.share_known)} of a photo"),)
            if change.share_known < 1
            else ()
        ),
        ("black", _percent(1 - made.share_filled)),
    )


def next_step(made: UndistortedFiles, camera_file: str) -> Command:
    """What is done with undistorted photos, and with which file."""
    if made.new_camera.model != LINEAR:
        return Command(f"calib pose TARGET {camera_file} PHOTOS", "the file is the camera of these photos")
    return Command(
        f"calib convert {camera_file} --to colmap -o cameras.txt", "or opencv, ros, kalibr, mrcal, metashape, json"
    )


def _next(made: UndistortedFiles, change: Change) -> tuple[Command, ...]:
    again, new = "calib undistort CAMERA PHOTOS -o DIR", made.new_camera
    is_wide = field_of_view(made.camera).off_axis_rad > WIDE_RAD
    steps = [next_step(made, CAMERA_FILE)]
    if new.model == LINEAR and not made.is_turned:
        if made.share_filled < 1:
            steps.append(Command(f"{again} --alpha 0", "the same without black regions, with less of the photos"))
        if change.share_kept < 1 and not is_wide:
            steps.append(Command(f"{again} --alpha 1", "the same with all that the photos show, black beside it"))
    if is_wide:
        others = ((name, one) for name, one in pictures().items() if name not in (LINEAR, new.model))
        steps += [Command(f"{again} --to {name}", f"as {one.words}, which may show all") for name, one in others]
        steps.append(Command(f"{again} --field 90deg --yaw 60deg", f"a {LINEAR} that looks to the right; --pitch: up"))
    return tuple(steps)


def undistortion_figure(taken: Camera, new_camera: Camera, cam_from_new: Array | None = None) -> Figure:
    """Lines that were straight and level in the photo, in the undistorted frame."""
    from calib.draw.style import AxesDrawing, image_axes
    from calib.show.run.figures import figure_of

    last_u, last_v = (side - 1 for side in taken.image_size)
    u, v = np.linspace(0, last_u, POINTS), np.linspace(0, last_v, POINTS)
    across = [np.column_stack([u, np.full(POINTS, y)]) for y in np.linspace(0, last_v, LINES)]
    down = [np.column_stack([np.full(POINTS, x), v]) for x in np.linspace(0, last_u, LINES)]
    lines = [_unbroken(_moved(taken, new_camera, cam_from_new, line), new_camera) for line in (*across, *down)]
    width, height = new_camera.image_size

    def draw(axes: "Axes") -> None:
        image_axes(axes, new_camera.image_size)
        for line in lines:
            axes.plot(*line.T, color="#0072b2", linewidth=0.8)
        axes.plot([0, width, width, 0, 0], [0, 0, height, height, 0], color="#1a1a1a", linewidth=2)
        (left, right), (top, bottom) = (_span(lines, axis, side) for axis, side in enumerate(new_camera.image_size))
        axes.set(xlim=(left, right), ylim=(bottom, top))

    words = "Rows and columns of the photo when they are undistorted"
    if np.isfinite((change := change_of(taken, new_camera, cam_from_new)).shift_px):
        words += f": pixels move by up to {change.shift_words}"
    frame = "The thick frame is the new image: lines outside are cut off, and where none reaches it is black."
    return figure_of(AxesDrawing("What undistortion moves", words, draw, new_camera.image_size), frame)


def _unbroken(line: Array, new_camera: Camera) -> Array:
    """A line (N, 2) with a gap where it goes on at the other side of the picture."""
    jumps = np.abs(np.diff(line[:, 0], prepend=line[0, 0])) > new_camera.image_size[0] / 2
    return np.where(jumps[:, None], np.nan, line)


def _span(lines: list[Array], axis: int, side: int) -> tuple[float, float]:
    """What a figure shows along an axis: the frame, and lines that go beyond it, but not too far."""
    values = np.concatenate([line[:, axis] for line in lines])
    values = values[np.isfinite(values)]
    margin, most = 0.03 * side, MOST_BEYOND * side
    low, high = min(0.0, *values), max(float(side), *values)
    return max(low, -most) - margin, min(high, side + most) + margin
