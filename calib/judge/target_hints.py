"""How a target is held before a camera, by how much it is held differently elsewhere, and what to do about it in words.

Left and right, up and down are those of the photo.
"""

import math
from dataclasses import dataclass

import numpy as np

from calib.cameras import project
from calib.cameras.camera import Camera
from calib.core.se3 import angles_between, transform
from calib.judge.candidate_views import LONG
from calib.judge.next_view_words import A_LITTLE, distance_words
from calib.judge.views import TargetShape
from designer.base.arrays import Array, Flags
from designer.target import TargetGeometry

Line = Array
"""Points of an image in a row (K, 2)."""
SAME_TURN_DEG = 15.0
"""A person holds a target to about 5 degrees about each axis, so that the whole turn is now and then this far off."""
SAME_PLACE_MM, LEAST_PLACE, MOST_PLACE = 40.0, 0.1, 0.3
"""Likewise to about 20 mm along each axis, and to no less and no more than parts of the distance: near the camera a
hand is held by what is seen."""
STEPS_A_SIDE = 6
"""A lens bends the side of a face; so many straight pieces do for a drawing."""
EDGE_ON = math.cos(math.radians(88.0))
"""A face seen more from the side than that is a line."""
QUARTER, HALF = math.pi / 2, math.pi


@dataclass(frozen=True, eq=False)
class HeldView:
    """Where a target is, and how it is turned."""

    middle_mm: Array  # (3,) in the camera's frame
    middle_px: Array  # (2,) nan: not in the image
    normal: Array  # (3,) of a flat target, to the side that is seen; z of a solid
    long_side: Array  # (3,) its long side

    @property
    def distance_mm(self) -> float:
        """From the camera."""
        return float(np.linalg.norm(self.middle_mm))

    @property
    def tilt_deg(self) -> float:
        """Of a flat target against the sensor."""
        return math.degrees(math.acos(min(max(-float(self.normal[2]), -1.0), 1.0)))

    @property
    def away(self) -> Array:
        """Where its far side is, right and down, as long as the sine of its tilt.  # (2,)"""
        return self.normal[:2]


def held_at(camera: Camera, shape: TargetShape, cam_from_target: Array) -> HeldView:
    """How a target is held at a pose."""
    middle = transform(cam_from_target, shape.center_mm)
    turn = cam_from_target[:3, :3]
    return HeldView(middle, project(camera, middle[None])[0], turn @ shape.axes[2], turn @ shape.axes[0])


def turn_between(shape: TargetShape, first: HeldView, second: HeldView) -> tuple[float, float]:
    """By how much a flat target is tilted and turned in its plane from one to the other (rad).

    A board tells the same upside down, and a square one also with another side up.
    """
    tilt = float(angles_between(first.normal, second.normal))
    along = second.long_side - first.normal * float(first.normal @ second.long_side)
    across = np.cross(first.normal, first.long_side)
    angle = math.atan2(float(across @ along), float(first.long_side @ along))
    period = HALF if shape.aspect > LONG else QUARTER
    return tilt, angle - period * round(angle / period)


def are_near(shape: TargetShape, pose: Array, cam_from_target: Array) -> Flags:
    """Which of poses (C, 4, 4) hold a target about as another one does, whichever way it is turned in its plane."""
    place, wanted = transform(cam_from_target, shape.center_mm), transform(pose, shape.center_mm)
    near = _same_place_mm(float(np.linalg.norm(wanted)))
    is_near: Flags = np.linalg.norm(place - wanted, axis=1) <= near
    if shape.is_flat:
        facing = cam_from_target[:, :3, :3] @ shape.axes[2]
        is_near &= facing @ (pose[:3, :3] @ shape.axes[2]) >= math.cos(math.radians(SAME_TURN_DEG))
    return is_near


def is_same(shape: TargetShape, wanted: HeldView, now: HeldView) -> bool:
    """Whether a person who was to hold a target in one way holds it so; a solid may show any side."""
    apart_mm = float(np.linalg.norm(now.middle_mm - wanted.middle_mm))
    if apart_mm > _same_place_mm(wanted.distance_mm):
        return False
    return not shape.is_flat or math.hypot(*turn_between(shape, wanted, now)) <= math.radians(SAME_TURN_DEG)


def _same_place_mm(distance_mm: float) -> float:
    """How far apart two places are that are the same to a person."""
    return max(min(SAME_PLACE_MM, MOST_PLACE * distance_mm), LEAST_PLACE * distance_mm)


def ghost_lines(target: TargetGeometry, camera: Camera, cam_from_target: Array) -> tuple[Line, ...]:
    """The outline of a target as a person knows it.

    Closed lines (K, 2) in the image around each face that is turned to the camera and projected as a whole.
    """
    lines = []
    for target_from_face, outline_mm in zip(target.target_from_face, target.outline_mm, strict=True):
        cam_from_face = cam_from_target @ target_from_face
        step = np.linspace(0, 1, STEPS_A_SIDE, endpoint=False)[:, None]
        side = outline_mm[:, None] + step * (np.roll(outline_mm, -1, axis=0) - outline_mm)[:, None]
        flat = np.concatenate([side.reshape(-1, 2), outline_mm[:1]])
        border = transform(cam_from_face, np.c_[flat, np.zeros(len(flat))])
        middle = border[:-1].mean(axis=0)
        if -cam_from_face[:3, 2] @ middle < EDGE_ON * np.linalg.norm(middle):
            continue
        pixel = project(camera, border)
        if np.isfinite(pixel).all():
            lines.append(pixel.round(1))
    return tuple(lines)


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
