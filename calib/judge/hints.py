"""What a person is to do, in a few words: left and right, up and down are those of the photo."""

import math

import numpy as np

from calib.judge.guide_held import HeldView, turn_between
from calib.judge.next_view_words import A_LITTLE, distance_words
from calib.judge.views import TargetShape
from designer.base.arrays import Array

LITTLE_SHIFT = 0.06
"""Of the image's longer side: so near is there."""
LITTLE_NEARER = 1.12
"""Of distances: likewise."""
LITTLE_TURN_DEG = 8.0
FACING_DEG = 8.0
"""A board tilted by less faces the camera."""
ASIDE = 0.4
"""Of a direction's larger part: a smaller one is not worth a word."""


def place_short(place: tuple[float, float]) -> str:
    """A place in the image: "bottom left", "top", "middle"."""
    right, down = (0.0 if abs(along) <= A_LITTLE else along for along in place)
    words = ["top" if down < 0 else "bottom"] * (down != 0) + ["left" if right < 0 else "right"] * (right != 0)
    return " ".join(words) or "middle"


def side_words(away: Array) -> str:
    """A side of a target, right and down: "left side", "top right corner"."""
    right, down = away.tolist()
    largest = max(abs(right), abs(down))
    words = ["top" if down < 0 else "bottom"] * (abs(down) > ASIDE * largest)
    words += ["left" if right < 0 else "right"] * (abs(right) > ASIDE * largest)
    return f"{' '.join(words)} {'corner' if len(words) > 1 else 'side'}"


def short_of(held: HeldView, place: tuple[float, float], *, is_flat: bool) -> str:
    """How a target is held: "bottom left, right side back, 0.45 m"."""
    words = [place_short(place)]
    if is_flat:
        words.append("straight on" if held.tilt_deg < FACING_DEG else f"{side_words(held.away)} back")
    return ", ".join([*words, distance_words(held.distance_mm)])


def hint_of(shape: TargetShape, wanted: HeldView, now: HeldView, longer_px: int) -> str:
    """How to come from one place to another, what is farthest off first: "closer, and to the left"; "" if there."""
    steps = sorted([_shift(wanted, now, longer_px), _nearer(wanted, now), *_turns(shape, wanted, now)], reverse=True)
    words = [words for size, words in steps if size > 1][:2]
    return ", and ".join(words)


def _shift(wanted: HeldView, now: HeldView, longer_px: int) -> tuple[float, str]:
    """How far it is to be moved in the image, in units of what is little, and where to."""
    off = (wanted.middle_px - now.middle_px) / longer_px
    if not np.isfinite(off).all():
        return 0.0, ""
    largest = float(np.abs(off).max())
    right, down = (float(x) if abs(x) > ASIDE * largest else 0.0 for x in off)
    words = ["to the left" if right < 0 else "to the right"] * (right != 0) + ["up" if down < 0 else "down"] * (
        down != 0
    )
    return math.hypot(*off) / LITTLE_SHIFT, " and ".join(words)


def _nearer(wanted: HeldView, now: HeldView) -> tuple[float, str]:
    ratio = now.distance_mm / wanted.distance_mm
    return abs(math.log(ratio)) / math.log(LITTLE_NEARER), "closer" if ratio > 1 else "farther away"


def _turns(shape: TargetShape, wanted: HeldView, now: HeldView) -> list[tuple[float, str]]:
    """How a flat target is to be tilted, and turned in its plane."""
    if not shape.is_flat:
        return []
    tilt, turn = turn_between(shape, wanted, now)
    if wanted.tilt_deg < FACING_DEG:
        words = "face the camera with it"
    else:
        words = f"tilt the {side_words(wanted.away - now.away)} away"
    little = math.radians(LITTLE_TURN_DEG)
    # Seen along its normal, the present long side lies counterclockwise of the wanted one if the angle is above zero.
    return [(tilt / little, words), (abs(turn) / (2 * little), f"turn it {'' if turn > 0 else 'counter'}clockwise")]
