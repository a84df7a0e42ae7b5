"""What `calib undistort` tells of its photos: as a pinhole would have taken them, and that pinhole."""

from dataclasses import dataclass

from calib.cameras.camera import Camera
from calib.core.number_text import figure as digits
from calib.show.parts.folder_blocks import some_of
from calib.show.photos.photos_file import PHOTOS_FILE, ToldPhoto, ToldPhotos, ToldSection
from calib.show.photos.undistortion import Change, change_of
from calib.show.run.sections import field_of_view_words
from designer.base.words import capital
from designer.page.blocks import Cell, Column, Command, Finding, Headline, Table

CAMERA_FILE = "camera.json"
FILES = (
    (CAMERA_FILE, "the pinhole that belongs to the undistorted photos"),
    (PHOTOS_FILE, "the camera that took the photos, and what became of each"),
)


@dataclass(frozen=True)
class UndistortedPhoto:
    """A photo that was undistorted."""

    image: str  # the photo's name
    path: str  # of the undistorted photo, within the folder
    remarks: tuple[str, ...] = ()


@dataclass(frozen=True, eq=False)
class UndistortedSet:
    """A set of undistorted photos."""

    camera_name: str  # as it was given
    taken: Camera  # that took the photos
    pinhole: Camera  # that the undistorted ones are of
    photos: tuple[UndistortedPhoto, ...]
    failures: tuple[str, ...]  # why others could not be, one line each
    share_filled: float  # of the pixels of each, the others are black
    earlier: int = 0  # undistorted photos in the folder that are not of this set

    @property
    def change(self) -> Change:
        """What happens to a photo's pixels."""
        return change_of(self.taken, self.pinhole)


def told_undistorted(made: UndistortedSet) -> ToldPhotos:
    """What the folder's page says."""
    change = made.change
    remarks = tuple("; ".join(photo.remarks) for photo in made.photos)
    columns = (Column("remark", is_number=False),) if any(remarks) else ()
    notes = tuple(Finding("usable", "Not in this set", line) for line in _not_here(made))
    return ToldPhotos(
        "undistorted", _headline(made, change), _facts(made, change), columns,
        tuple(
            ToldPhoto(photo.image, (Cell(remark),) if columns else (), photo.path, remark)
            for photo, remark in zip(made.photos, remarks, strict=True)
        ),
        "In the order they were given.", FILES, notes=notes,
        after=(
            ToldSection("The new camera", (_parameters(made),), lead=_pinhole_words(made)),
            ToldSection("Next", _next(made, change)),
        ),
        camera=made.taken, pinhole=made.pinhole,
    )  # fmt: skip


def _not_here(made: UndistortedSet) -> list[str]:
    lines = some_of(made.failures)
    if made.earlier:
        lines.append(
            f"{made.earlier} more undistorted photos are in this folder, of an earlier run: {CAMERA_FILE} may not be "
            "theirs"
        )
    return lines


def _headline(made: UndistortedSet, change: Change) -> Headline:
    count, failed, black = len(made.photos), len(made.failures), 1 - made.share_filled
    kept = f"{_percent(1 - change.share_kept)} of a photo is" if change.share_kept < 1 else "nothing of a photo is"
    filled = f"{_percent(black)} of the pixels are" if black else "no pixel is"
    sentence = (
        f"{capital('1 photo' if count == 1 else f'{count} photos')} as a pinhole of "
        f"{digits(float(made.pinhole.params[0]), 6)} px focal length would have taken "
        f"{'it' if count == 1 else 'them'}; {kept} cut off, and {filled} black."
    )
    if failed:
        return Headline("usable", "undistorted in part", f"{sentence} {failed} could not be undistorted.")
    return Headline("note", "undistorted", sentence)


def _percent(share: float) -> str:
    return "less than 0.1 %" if 0 < share < 0.001 else f"{100 * share:.1f} %"


def _facts(made: UndistortedSet, change: Change) -> tuple[tuple[str, str], ...]:
    taken, pinhole = made.taken, made.pinhole
    width, height = pinhole.image_size
    return (
        ("camera of the photos", f"{made.camera_name} (model {taken.model})"),
        ("image", f"{width} x {height} px"),
        ("focal length", f"{digits(float(pinhole.params[0]), 6)} px; before {digits(float(taken.params[0]), 6)} px"),
        ("field of view", f"{field_of_view_words(pinhole)}; before {field_of_view_words(taken)}"),
        ("moved farthest", change.shift_words),
        ("cut off", _percent(1 - change.share_kept)),
        ("black", _percent(1 - made.share_filled)),
    )


def _pinhole_words(made: UndistortedSet) -> str:
    kept = "as the camera's" if made.pinhole.params[0] == made.taken.params[0] else "chosen for these photos"
    return (
        f"A pinhole without distortion, its focal length {kept}. Use it with the undistorted photos only, and the "
        "camera's own file with the photos as they were taken."
    )


def _parameters(made: UndistortedSet) -> Table:
    columns = (Column("parameter", is_number=False), Column("px"), Column("before px", note="of the photos' camera"))
    rows = tuple(
        (Cell(name), Cell(f"{new:.3f}", float(new)), Cell(f"{old:.3f}", float(old)))
        for name, new, old in zip(("fx", "fy", "cx", "cy"), made.pinhole.params, made.taken.params, strict=False)
    )
    return Table("Parameters", columns, rows, "Pixel (0, 0) is the centre of the top-left pixel.")


def _next(made: UndistortedSet, change: Change) -> tuple[Command, ...]:
    again = "calib undistort CAMERA PHOTOS -o DIR --alpha"
    black, cut = made.share_filled < 1, change.share_kept < 1
    return (
        Command(f"calib convert {CAMERA_FILE} --to colmap -o cameras.txt", "in this folder: the pinhole for COLMAP"),
        Command(f"calib convert {CAMERA_FILE} --to opencv -o camera.yaml", "for OpenCV; there are ros, mrcal, ... too"),
        *((Command(f"{again} 0", "the same without black regions, with less of the photos"),) if black else ()),
        *((Command(f"{again} 1", "the same with all that the photos show, black beside it"),) if cut else ()),
    )
