"""What is told of undistorted photos: what would have taken them, its camera, and what moved."""

import math
from pathlib import Path
from typing import TYPE_CHECKING

from calib.cameras import LINEAR, pictures
from designer.base.words import figure as digits
from designer.base.words import printable
from designer.page.blocks import Block, Command, Facts, Finding, Findings, Headline, Page, Section
from designer.page.folders import Shown, notes, some_of, table_of
from designer.page.terminal import quoted

if TYPE_CHECKING:
    from calib.app.undistort import UndistortedPhoto, UndistortedPhotos
    from designer.base.arrays import Array

WIDE_DEG = 60.0
"""Light from farther off the axis fills much of a pinhole's picture with little."""


def undistorted_page(made: "UndistortedPhotos", *, is_drawn: bool) -> Page:
    """The page, or what a screen says."""
    from calib.draw.fields import undistortion_drawing
    from calib.draw.gallery import Shot, gallery, spread
    from calib.draw.style import figure_of

    findings = [Finding("usable", "Not undistorted", line) for line in some_of(made.failures)]
    if made.left_out:
        findings.append(Finding("note", "Left out", f"{made.left_out} undistorted photos of an earlier run"))
    if made.earlier:
        words = f"{made.earlier} more undistorted photos are in this folder: camera.json may not be theirs"
        findings.append(Finding("usable", "Of an earlier run", words))
    blocks: list[Block] = [*notes(made.remarks), *((Findings(tuple(findings)),) if findings else ())]
    lead: list[Block] = []
    if is_drawn:
        shots = [Shot(Path(one.undistorted).name, printable(one.image), _remark(one)) for one in made.per_photo]
        blocks += gallery(made.folder, spread(shots), "In the order they were given.")
        drawing = undistortion_drawing(made.taken_by, made.new_camera, made.change, _turn(made))
        lead.append(figure_of(drawing))
    if any(one.remarks for one in made.per_photo):
        kind = Shown["UndistortedPhoto"]
        remark = kind("remark", _remark)
        blocks.append(table_of(made.per_photo, kind("photo", lambda one: one.image), remark, title="All photos"))
    return Page(
        "", "", _headline(made), (Section("Photos", tuple(blocks)),), lead=(*lead, _facts(made)), next_steps=_next(made)
    )


def _remark(one: "UndistortedPhoto") -> str:
    return "; ".join(one.remarks)


def _turn(made: "UndistortedPhotos") -> "Array | None":
    """Where the new camera looks; None: where the camera does."""
    return made.cam_from_new if (made.cam_from_new != [[1, 0, 0], [0, 1, 0], [0, 0, 1]]).any() else None


def _headline(made: "UndistortedPhotos") -> Headline:
    from calib.draw.run_tables import field_of_view_words

    change, black = made.change, 1 - made.share_filled
    shown = "a photo" if change.share_known == 1 else "what the camera knows"
    kept = f"{_percent(1 - change.share_kept)} of {shown} is" if change.share_kept < 1 else f"nothing of {shown} is"
    filled = f"{_percent(black)} of the pixels are" if black else "no pixel is"
    photos, them = ("1 photo", "it") if made.undistorted == 1 else (f"{made.undistorted} photos", "them")
    focal, field = digits(float(made.new_camera.params[0]), 6), field_of_view_words(made.new_camera)
    sentence = (
        f"{photos} as {pictures()[made.new_camera.model].words} of {focal} px focal length would have taken {them}, "
        f"with a field of view of {field}; {kept} cut off, and {filled} black."
    )
    if made.failures:
        why = f"{len(made.failures)} could not be undistorted."
        return Headline("usable", "undistorted in part", f"{sentence} {why}")
    return Headline("note", "undistorted", sentence)


def _percent(share: float) -> str:
    return "less than 0.1 %" if 0 < share < 0.001 else f"{100 * share:.1f} %"


def _direction_words(cam_from_new: "Array") -> str:
    """Where a new camera looks."""
    import numpy as np

    x, y, z = cam_from_new[:, 2]
    yaw, pitch = np.degrees([np.arctan2(x, z), np.arctan2(-y, np.hypot(x, z))])
    sides = ((yaw, "to the right" if yaw > 0 else "to the left"), (pitch, "up" if pitch > 0 else "down"))
    return ", ".join(f"{abs(angle):.1f}° {side}" for angle, side in sides if abs(angle) >= 0.05) or "straight on"


def _facts(made: "UndistortedPhotos") -> Facts:
    from calib.cameras.camera import linear_part
    from calib.draw.run_tables import field_of_view_words

    taken, new, change, turn = made.taken_by, made.new_camera, made.change, _turn(made)
    (width, height), before = new.image_size, taken.image_size
    image = f"{width} x {height} px{'' if before == new.image_size else f'; before {before[0]} x {before[1]} px'}"
    moved = ("moved farthest", change.shift_words)
    unlit = ("without known light", f"{_percent(1 - change.share_known)} of a photo")
    numbers = zip(("fx", "fy", "cx", "cy"), new.params, linear_part(taken).params, strict=True)
    return Facts((
        ("camera of the photos", f"{made.named} (model {taken.model})"),
        ("new camera", f"{new.model}: {made.equation}{', in radians' if new.model != LINEAR else ''}"),
        *(() if turn is None else (("looks", _direction_words(turn)),)), ("image", image),
        *((name, f"{value:.3f} px; before {old:.3f} px") for name, value, old in numbers),
        ("field of view", f"{field_of_view_words(new)}; before {field_of_view_words(taken)}"),
        *((moved,) if new.model == LINEAR and turn is None else ()), ("cut off", _percent(1 - change.share_kept)),
        *((unlit,) if change.share_known < 1 else ()), ("black", _percent(1 - made.share_filled)),
    ))  # fmt: skip


def _next(made: "UndistortedPhotos") -> tuple[Command, ...]:
    """What is done with undistorted photos, and with which file; and what else they might have been."""
    from calib.cameras.field_of_view import field_of_view

    new, file = made.new_camera, quoted(made.folder / "camera.json")
    again = "calib undistort CAMERA PHOTOS -o DIR"
    is_wide = math.degrees(field_of_view(made.taken_by).off_axis_rad) > WIDE_DEG
    if new.model == LINEAR:
        others = "or opencv, ros, kalibr, mrcal, metashape, json"
        steps = [Command(f"calib convert {file} --to colmap -o cameras.txt", others)]
    else:
        steps = [Command(f"calib pose TARGET {file} PHOTOS", "the file is the camera of these photos")]
    if new.model == LINEAR and _turn(made) is None:
        if made.share_filled < 1:
            steps.append(Command(f"{again} --alpha 0", "the same without black regions, with less of the photos"))
        if made.change.share_kept < 1 and not is_wide:
            steps.append(Command(f"{again} --alpha 1", "the same with all that the photos show, black beside it"))
    if is_wide:
        rest = ((name, one) for name, one in pictures().items() if name not in (LINEAR, new.model))
        steps += [Command(f"{again} --to {name}", f"as {one.words}, which may show all") for name, one in rest]
        steps.append(Command(f"{again} --field 90deg --yaw 60deg", f"a {LINEAR} that looks to the right; --pitch: up"))
    return tuple(steps)
