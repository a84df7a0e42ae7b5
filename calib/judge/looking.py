"""What one frame shows, how far it is from the proposed view, and whether it is worth taking."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from calib.cameras.camera import Camera
from calib.core.types import LEAST_POINTS, Detections, KnownPoints, Observations
from calib.judge.guide_held import HeldView, held_at, is_same
from calib.judge.guide_told import FrameNote, Look
from calib.judge.hints import hint_of
from calib.judge.telling import outlines_of
from calib.judge.view_worth import ViewGains, novelty, worth_of
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
    outlines, notes = outlines_of(found, looked_for.points.face), (*notes, *_other_size(found, looked_for.camera))
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


def _other_size(found: Detections, camera: Camera) -> tuple[FrameNote, ...]:
    if found.image_size == camera.image_size:
        return ()
    (width, height), (wide, high) = found.image_size, camera.image_size
    return (FrameNote("size", f"{width} x {height} px, the photos so far are {wide} x {high}", forbids=True),)


def _worth(found: Detections, pose: Array, looked_for: LookedFor) -> float:
    if looked_for.gains is not None:
        return worth_of(looked_for.gains, pose, found.ring, found.center_px)
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
    off_px = float(np.sqrt((solved.residual_px**2).sum(axis=1).mean()))
    return pose if off_px < NO_FIT * max(camera.image_size) else None
