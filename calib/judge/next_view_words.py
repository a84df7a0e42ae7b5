"""How a target is to be held, in words: left and right, top and bottom are those of the photo."""

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from designer.base.arrays import Array
from designer.base.words import figure, printable

MOST_NAME = 40
METRES_FROM_MM = 300.0
LITTLE_ROOM = 0.1
"""Of the image's side: what leaves less free is in the middle."""
OFF_MIDDLE, HALF_WAY, CLOSE = 0.25, 0.5, 0.8
"""Leaning to a side, of the room there is: no longer in the middle, half way, as good as there."""
SHIFT, LITTLE_SHIFT = 0.08, 0.03
"""Of the image's side: what is less far off the middle and at no side is only a little off it, or in it."""
A_LITTLE = 0.25
NEAR = 0.12
"""Of the image's side: what leaves no more free is near the border."""


@dataclass(frozen=True)
class ViewGain:
    """What a photo gives."""

    before_px: float  # what 95 % of the image stays within; infinite: not determined
    after_px: float  # the same with the photo
    covered_before: float  # of the image, 0 to 1
    covered_after: float
    is_rough: bool = False  # the lens is known so badly that what the photo will show is not known well
    tells_sigma: bool = True  # the deviation is worth a word
    tells_area: bool = False  # what is covered is


def thing_word(*, is_flat: bool) -> str:
    """What people call a target."""
    return "board" if is_flat else "target"


def gain_words(gain: ViewGain) -> str:
    """What a photo gives: "95 % sigma 0.21 -> 0.13 px, coverage 18 -> 31 %"; of a lens that is known badly its size."""
    words = []
    if gain.tells_sigma:
        before = figure(gain.before_px, 2) if math.isfinite(gain.before_px) else "not determined"
        rough = f"about {figure(gain.after_px, 1)} px if the lens is as estimated"
        words.append(f"95 % sigma {before} -> {rough if gain.is_rough else f'{figure(gain.after_px, 2)} px'}")
    if gain.tells_area:
        words.append(f"coverage {100 * gain.covered_before:.0f} -> {100 * gain.covered_after:.0f} %")
    return ", ".join(words)


def place_of(
    outline_px: Sequence[Array], image_size: tuple[float, float], first_px: tuple[float, float] = (0.0, 0.0)
) -> tuple[float, float]:
    """Where outlines lie in an image, or a part of it from some pixel on, to the right and down, -1 to 1.

    0 is in the middle, 0.25 a little off it, 0.5 half way to a side, 1 at it. By what is left free at both sides: at
    a side is what leaves little free there and much less than at the other.
    """
    if not outline_px:
        return 0.0, 0.0
    points = np.concatenate(list(outline_px))
    low, high = points.min(axis=0) - first_px, points.max(axis=0) - first_px
    place = [
        _along(first / side, (side - last) / side)
        for first, last, side in zip((low + 0.5).tolist(), (high + 0.5).tolist(), image_size, strict=True)
    ]
    return place[0], place[1]


def _along(before: float, after: float) -> float:
    """The place along one axis of what leaves so much free before and after it, of the image's side."""
    lean = (before - after) / max(before + after, LITTLE_ROOM)
    if abs(lean) < OFF_MIDDLE:
        return 0.0
    if abs(lean) >= CLOSE or (abs(lean) >= HALF_WAY and min(before, after) <= NEAR):
        return math.copysign(1.0, lean)
    shift = 0.5 * abs(before - after)
    return math.copysign(0.5 if shift >= SHIFT else 0.25 if shift >= LITTLE_SHIFT else 0.0, lean)


def place_words(place: tuple[float, float]) -> str:
    """A place in the image: "in the bottom left corner of the image", "at the left edge, towards the top"."""
    right, down = place
    row, column = "top" if down < 0 else "bottom", "left" if right < 0 else "right"
    if max(abs(right), abs(down)) <= A_LITTLE:
        off = f"{row * (down != 0)} {column * (right != 0)}".strip()
        return "in the middle of the image" + (f", a little to the {off}" if off else "")
    right, down = (0.0 if abs(along) <= A_LITTLE else along for along in (right, down))
    if right == 0 or down == 0:
        side = row if right == 0 else column
        return f"{'at' if max(abs(right), abs(down)) >= 1 else 'half way to'} the {side} edge of the image"
    if abs(right) >= 1 and abs(down) >= 1:
        return f"in the {row} {column} corner of the image"
    if abs(right) < 1 and abs(down) < 1:
        return f"half way to the {row} {column} corner of the image"
    at, towards = (column, row) if abs(right) >= 1 else (row, column)
    return f"at the {at} edge of the image, towards the {towards}"


def tilt_words(tilt_deg: float, away: tuple[float, float]) -> str:
    """A tilt and which side is farther away: "tilted 40 deg with its right side away from the camera"."""
    right, down = away
    if tilt_deg == 0 or (right == 0 and down == 0):
        return "facing the camera straight on"
    column = "" if right == 0 else "left" if right < 0 else "right"
    if column and down:
        side = f"{'top' if down < 0 else 'bottom'} {column} corner"
    else:
        side = f"{column or ('top' if down < 0 else 'bottom')} side"
    return f"tilted {tilt_deg:.0f} deg with its {side} away from the camera"


def distance_words(distance_mm: float, usual_mm: float | None = None) -> str:
    """A distance that a person can keep, to two digits; as a multiple of another one if that is given."""
    if usual_mm is not None:
        return f"{figure(distance_mm / usual_mm, 2)} times the usual distance"
    if distance_mm >= METRES_FROM_MM:
        return f"{figure(distance_mm / 1000, 2)} m"
    return f"{figure(distance_mm, 2)} mm"


def short(name: str) -> str:
    """A file's name as text that fits a sentence."""
    text = printable(name)
    return text if len(text) <= MOST_NAME else f"{text[:15]}...{text[-20:]}"
