"""How a target is to be held, in words: left and right, top and bottom are those of the photo."""

import math
from dataclasses import dataclass
from typing import Literal

from calib.results.evaluation_table import figure
from designer.command import printable

LongSide = Literal["", "level", "upright"]

MOST_NAME = 40
METRES_FROM_MM = 300.0


@dataclass(frozen=True)
class Hold:
    """Where and how to hold a target."""

    place: tuple[float, float]  # right and down, -1 to 1; see `calib.verdict.candidate_views`
    distance_mm: float
    tilt_deg: float  # of a flat target
    away: tuple[float, float]  # right and down, to its far side
    long_side: LongSide  # "": about as long as wide
    like_photo: str  # a solid must show the same side as there; "": any side
    is_flat: bool
    usual_distance_mm: float | None = None  # in the photos so far, where only the ratio of distances is known


def sentence_of(hold: Hold, before_px: float, after_px: float, *, is_rough: bool = False) -> str:
    """What to do and what it gives.

    Args:
        hold: where and how.
        before_px: what 95 % of the image stays within; infinite: not determined.
        after_px: the same with the photo.
        is_rough: the lens is known so badly that what the photo will show is not known well.
    """
    thing = "board" if hold.is_flat else "target"
    parts = [f"hold the {thing} {place_words(hold.place)} of the image"]
    if hold.long_side:
        parts.append(f"its long side {hold.long_side}")
    if hold.is_flat:
        parts.append(tilt_words(hold.tilt_deg, hold.away))
    else:
        side = f"turned as in {short(hold.like_photo)}" if hold.like_photo else "any side to the camera"
        parts.append(side)
    parts.append(f"at about {distance_words(hold.distance_mm, hold.usual_distance_mm)}")
    before = figure(before_px, 2) if math.isfinite(before_px) else "not determined"
    after = f"about {figure(after_px, 1)} px, if the lens is as estimated" if is_rough else f"{figure(after_px, 2)} px"
    return f"{', '.join(parts)}: 95 % sigma {before} -> {after}"


def place_words(place: tuple[float, float]) -> str:
    """A place in the image: "in the bottom left corner", "at the right edge"."""
    right, down = place
    row = "top" if down < 0 else "bottom"
    column = "left" if right < 0 else "right"
    if right == 0 and down == 0:
        return "in the middle"
    if right == 0:
        return f"at the {'top' if down < 0 else 'bottom'} edge"
    if down == 0:
        return f"at the {column} edge"
    corner = f"the {row} {column} corner"
    return f"in {corner}" if max(abs(right), abs(down)) >= 1 else f"half way to {corner}"


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
