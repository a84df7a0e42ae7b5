"""What one frame shows, how far it is from the proposed view, whether it is worth taking, and when that is done.

A photo is taken by itself when the target stands still and the view is worth it. Frames may be skipped, or come slowly:
all is told by their times.

    shutter = shutter.after(time_s, found, look)
    if shutter.is_due: ...; shutter = shutter.fired()

What is wrong with a frame keeps it from being taken. Each limit is where the exact detector's centres begin to suffer:
rendered frames that are worse in one respect and perfect in all others leave more than a tenth of a pixel, or lose
rings (`bench_frame_quality`).
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from calib.cameras.camera import Camera
from calib.core.linear_algebra import rms_length
from calib.core.types import LEAST_POINTS, Detections, KnownPoints, Observations
from calib.detector.frame_quality import FrameQuality
from calib.judge.candidate_views import novelty
from calib.judge.guidance import FrameNote, Look, outlines_of
from calib.judge.next_views import ViewGains
from calib.judge.target_hints import HeldView, held_at, hint_of, is_same
from calib.judge.views import TargetShape
from calib.solver.accuracy import NO_FIT
from calib.solver.start import solve_poses
from designer.base.arrays import Array

MOST_POINTS = 60
"""Of a frame, that its pose is found from."""
WORTH_TAKING = 0.6
"""Of what the proposed view gives: a view that gives so much is taken wherever it is."""
WORTH_MATCHING = 0.25
"""One that is about as proposed is taken if it gives so much: less of it may be in the picture than was thought."""
SOME_SIDE = 0.5
"""A solid where it was proposed that gives less shows a side that tells little."""
SAME_VIEW = 0.01
"""Of the image's longer side: rings that moved by less, root mean square, show the last photo once more."""
SMALL, LARGE_ENOUGH = 0.1, 0.3
"""Of the image, in the direction that a target fills more of, from nothing of worth to all of it while no camera is
known: a small one tells no perspective."""


@dataclass(frozen=True, eq=False)
class LookedFor:
    """What frames are compared with."""

    camera: Camera  # as it is known, or a usual one
    points: KnownPoints
    shape: TargetShape
    wanted: HeldView | None  # None: nothing is proposed
    gains: ViewGains | None  # None: no camera is known
    taken: Array  # (V, 4, 4) poses of the photos by the camera
    last: Detections | None  # the photo taken before


def look_at_frame(found: Detections, looked_for: LookedFor, notes: Sequence[FrameNote]) -> Look:
    """What a frame shows."""
    outlines = outlines_of(found, looked_for.points.face)
    if found.image_size != looked_for.camera.image_size:
        (width, height), (wide, high) = found.image_size, looked_for.camera.image_size
        said = f"{width} x {height} px, the photos so far are {wide} x {high}"
        notes = (*notes, FrameNote("size", said, forbids=True))
    notes = tuple(notes)
    pose = frame_pose(found, looked_for.camera, looked_for.points)
    if pose is None:
        hint = "show more of the target" if len(found.ring) else "show the target"
        return Look(None, outlines, 0.0, False, hint if looked_for.wanted is not None else "", notes, False)
    shape, wanted = looked_for.shape, looked_for.wanted
    now, worth = held_at(looked_for.camera, shape, pose), _worth(found, pose, looked_for)
    if wanted is None:
        return Look(pose, outlines, worth, False, "", notes, False)
    is_match = is_same(shape, wanted, now) and worth >= (WORTH_MATCHING if shape.is_flat else SOME_SIDE)
    hint = "" if is_match else hint_of(shape, wanted, now, max(looked_for.camera.image_size))
    if not (is_match or hint):  # it is as proposed, and yet tells little
        hint = "show all of it" if shape.is_flat else "turn another side to the camera"
    is_wanted = (is_match or worth >= WORTH_TAKING) and not any(note.forbids for note in notes)
    return Look(pose, outlines, worth, is_match, hint, notes, is_wanted and not shows_same(found, looked_for.last))


def _worth(found: Detections, pose: Array, looked_for: LookedFor) -> float:
    if looked_for.gains is not None:
        return looked_for.gains.worth(pose, found.ring, found.center_px)
    filled = float((np.ptp(found.center_px, axis=0) / found.image_size).max())
    size = min(max((filled - SMALL) / (LARGE_ENOUGH - SMALL), 0.0), 1.0)
    return size * novelty(looked_for.shape, pose, looked_for.taken)


def shows_same(found: Detections, last: Detections | None) -> bool:
    """Whether a frame shows what the last photo shows already."""
    if last is None or last.image_size != found.image_size:
        return False
    _, now, before = np.intersect1d(found.ring, last.ring, assume_unique=True, return_indices=True)
    if 2 * len(now) < min(len(found.ring), len(last.ring)) or not len(now):
        return False
    moved = ((found.center_px[now] - last.center_px[before]) ** 2).sum(axis=1).mean()
    return bool(np.sqrt(moved) < SAME_VIEW * max(found.image_size))


def frame_pose(found: Detections, camera: Camera, points: KnownPoints) -> Array | None:
    """Where the target is in a frame; None if too little of it is seen.  # (4, 4)"""
    if len(found.ring) < LEAST_POINTS or found.image_size != camera.image_size:
        return None
    some = slice(None, None, -(-len(found.ring) // MOST_POINTS))
    ring, pixel = found.ring[some], found.center_px[some]
    view = np.zeros(len(ring), dtype=np.int64)
    seen = Observations(camera.image_size, (found.image,), view, ring, pixel, None, points)
    solved = solve_poses(camera, seen, weighted=False)
    pose = solved.cam_from_target[0]
    if not np.isfinite(pose).all() or not np.isfinite(solved.residual_px).all():
        return None
    return pose if rms_length(solved.residual_px) < NO_FIT * max(camera.image_size) else None


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
    # Blurred for its size, or much more than the lens can do.
    is_softer = quality.blur_px > max(SOFTER * sharpest_px, sharpest_px + SOFTER_PX)
    is_out_of_focus = quality.blur_px > MOST_BLUR * quality.radius_px or is_softer
    if quality.full_share > FULL:
        said = "too bright: the white is washed out; less light, or a shorter exposure"
        notes.append(FrameNote("bright", said, forbids=True))
    if quality.contrast < FAINT or quality.black_share > BLACK:
        notes.append(FrameNote("dark", "too dark: more light on the target", forbids=True))
    if quality.motion_px > min(max(LEAST_MOTION_PX, MOST_MOTION * quality.radius_px), MOST_MOTION_PX):
        sector = SECTORS[round(quality.motion_rad / (math.pi / 4)) % 4]
        said = f"hold still: blurred by {quality.motion_px:.0f} px {sector}"
        notes.append(FrameNote("motion", said, forbids=True))
    elif is_out_of_focus:
        notes.append(FrameNote("focus", f"out of focus: edges are {quality.blur_px:.1f} px wide", forbids=True))
    if quality.radius_px < SMALL_PX:
        notes.append(FrameNote("small", f"closer: marks of {quality.radius_px:.0f} px are too small", forbids=True))
    if quality.facing < FLAT:
        notes.append(FrameNote("slant", "too slanted: turn it towards the camera", forbids=False))
    return tuple(notes)
