"""When a photo is taken by itself: when the target stands still and the view is worth it.

    shutter = shutter.after(time_s, found, look)
    if shutter.is_due: ...; shutter = shutter.fired()

Frames may be skipped, or come slowly: all is told by their times.

What to tell a person of a frame at once, and what keeps it from being taken by itself.

Each limit is where the exact detector's centres begin to suffer: rendered frames that are worse in one respect and
perfect in all others leave more than a tenth of a pixel, or lose rings (`bench_frame_quality`).
"""

import math
from dataclasses import dataclass, replace

import numpy as np

from calib.core.types import Detections
from calib.detector.frame_quality import FrameQuality
from calib.judge.guide_told import FrameNote, Look
from calib.judge.looking import shows_same

STILL_S = 0.3
"""So long a target is to stand still."""
FAST = 0.04
"""Of the image's longer side a second: what moves faster does not stand still. At 1280 px that is 51 px a second, half
a pixel in an exposure of 10 ms; the tremor of a hand that holds still is about as much."""
DRIFT = 0.006
"""Of the image's longer side: what has moved so far since it stood still, however slowly, does not."""
LONGEST_GAP_S = 1.5
"""After a longer one nobody knows what was between two frames."""
FEWEST_RINGS = 4


@dataclass(frozen=True, eq=False)
class Shutter:
    """Whether to take the frame that was looked at last: `Shutter().after(time_s, found, look).is_due`."""

    still_s: float = STILL_S
    since_s: float | None = None  # when it began to stand still; None: it does not
    now_s: float = 0.0
    first: Detections | None = None  # when it began to stand still
    last: Detections | None = None  # the frame before
    taken: Detections | None = None  # the last photo
    is_armed: bool = True  # false: a photo was taken, and nothing is new since
    is_wanted: bool = False

    @property
    def still(self) -> float:
        """How long it has stood still, of how long it is to: 0 to 1."""
        if self.since_s is None:
            return 0.0
        return min((self.now_s - self.since_s) / self.still_s, 1.0) if self.still_s > 0 else 1.0

    @property
    def is_due(self) -> bool:
        """Whether to take the last frame now."""
        return self.is_armed and self.is_wanted and self.still >= 1

    def after(self, time_s: float, found: Detections, look: Look) -> "Shutter":
        """After a frame was looked at."""
        if self.taken is not None and not self.is_armed and not shows_same(found, self.taken):
            return replace(self, is_armed=True).after(time_s, found, look)
        gap = time_s - self.now_s
        stands = self.last is not None and self.first is not None and 0 < gap <= LONGEST_GAP_S
        if stands and self.last is not None and self.first is not None:
            longer = max(found.image_size)
            stands = moved_px(self.last, found) <= FAST * longer * gap and moved_px(self.first, found) <= DRIFT * longer
        is_seen = len(found.ring) >= FEWEST_RINGS
        begun = self.since_s if stands and self.since_s is not None else time_s if is_seen else None
        first = self.first if stands else found if is_seen else None
        return replace(
            self, since_s=begun, now_s=time_s, first=first, last=found if is_seen else None, is_wanted=look.is_wanted
        )

    def fired(self) -> "Shutter":
        """After the last frame was taken: nothing more of the same view."""
        return replace(self, since_s=None, first=None, taken=self.last, is_armed=False)

    def rearmed(self) -> "Shutter":
        """After another view was proposed."""
        return replace(self, is_armed=True)


def moved_px(before: Detections, now: Detections) -> float:
    """How far the rings moved that two frames have in common, their median; infinite of too few."""
    _, old, new = np.intersect1d(before.ring, now.ring, assume_unique=True, return_indices=True)
    if len(old) < FEWEST_RINGS:
        return float("inf")
    off = now.center_px[new] - before.center_px[old]
    return float(np.median(np.hypot(off[:, 0], off[:, 1])))


MOST_MOTION = 0.3
"""Of a ring's smaller semi-axis, moved during the exposure."""
LEAST_MOTION_PX, MOST_MOTION_PX = 1.0, 2.0
"""What moves by less is as sharp as pixels are; by more, a rolling shutter bends what it takes row after row."""
MOST_BLUR = 0.22
"""Standard deviation of the blur, of a ring's smaller semi-axis: beyond, ink and white run into each other."""
SOFTER, SOFTER_PX = 1.6, 0.4
"""Times the blur of the sharpest frame so far, and px more than it: what the lens can do better is out of focus."""
FULL, BLACK = 0.3, 0.6
"""Shares of the white that is at full scale, and of the ink that is at nothing."""
FAINT = 0.12
"""Of full scale: less between ink and white drowns in noise."""
SMALL_PX = 3.5
"""Of the usual ring's smaller semi-axis."""
FLAT = 0.3
"""Smaller over larger semi-axis of the usual ring: seen from 73 degrees."""
SECTORS = ("left and right", "diagonally", "up and down", "diagonally")


def notes_of(quality: FrameQuality | None, sharpest_px: float = math.inf) -> tuple[FrameNote, ...]:
    """What to say of a frame, the most important first: `notes_of(frame_quality(frame, found, target))`.

    Args:
        quality: of it; None: too little was found to tell.
        sharpest_px: the least blur of the frames so far.
    """
    if quality is None:
        return ()
    notes = []
    if quality.full_share > FULL:
        notes.append(
            FrameNote("bright", "too bright: the white is washed out; less light, or a shorter exposure", True)
        )
    if quality.contrast < FAINT or quality.black_share > BLACK:
        notes.append(FrameNote("dark", "too dark: more light on the target", forbids=True))
    if quality.motion_px > min(max(LEAST_MOTION_PX, MOST_MOTION * quality.radius_px), MOST_MOTION_PX):
        sector = SECTORS[round(quality.motion_rad / (math.pi / 4)) % 4]
        said = f"hold still: blurred by {quality.motion_px:.0f} px {sector}"
        notes.append(FrameNote("motion", said, forbids=True))
    elif _is_out_of_focus(quality, sharpest_px):
        notes.append(FrameNote("focus", f"out of focus: edges are {quality.blur_px:.1f} px wide", forbids=True))
    if quality.radius_px < SMALL_PX:
        notes.append(FrameNote("small", f"closer: rings of {quality.radius_px:.0f} px are too small", forbids=True))
    if quality.facing < FLAT:
        notes.append(FrameNote("slant", "too slanted: turn it towards the camera", forbids=False))
    return tuple(notes)


def _is_out_of_focus(quality: FrameQuality, sharpest_px: float) -> bool:
    """Blurred for its size, or much more than the lens can do."""
    is_softer = quality.blur_px > max(SOFTER * sharpest_px, sharpest_px + SOFTER_PX)
    return quality.blur_px > MOST_BLUR * quality.radius_px or is_softer
