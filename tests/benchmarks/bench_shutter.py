"""Frames that are taken by themselves from video of a hand-held target: how many are blurred, moving or saturated.

`python -m tests.benchmarks.bench_shutter [photos] [seed]`

A person brings the target from place to place and holds it there, with tremor. Each frame is summed over its exposure,
row after row of a rolling shutter; the light swings, and so does the focus. What is worth taking is left out: each view
counts as wanted. Printed are the photos that were taken by themselves and had a fault, by the truth of the rendering,
what was said of frames that had one, and of those that had none; for comparison, how well the motion in a frame and the
variance of its Laplacian tell sharp frames from blurred ones (area under the curve of hits over false alarms).
"""

import sys
from collections import Counter
from collections.abc import Iterator
from dataclasses import dataclass, replace

import cv2
import numpy as np

from calib.cameras.camera import Camera
from calib.core.se3 import exp_rotation, look_at
from calib.core.types import Detections
from calib.detector import pipeline
from calib.detector.frame_quality import frame_quality
from calib.judge.guidance import Look
from calib.judge.live_frame import MOST_MOTION_PX, Shutter, notes_of
from calib.renderer.options import RenderOptions
from calib.renderer.scene import scene_from_target
from designer.base.arrays import Array, Flags
from designer.target import TargetGeometry
from tests.support import ring_views
from tests.support.moving_frames import MovingFrame, moving_frame
from tests.support.moving_frames import Shutter as Exposure

CAMERA = Camera("opencv", np.array([560.0, 560.0, 321.0, 238.0, 0.05, -0.1, 0.0, 0.0, 0.0]), (640, 480))
FRAMES_PER_S = 8.0
MOVE_S, HOLD_S = 0.5, 1.2
TREMOR_MM_S, TREMOR_RAD_S = 3.0, 0.02
FREQUENCY = np.array([1.1, 2.3, 3.7, 1.7, 2.9, 4.3])
"""Hz, of the tremor along three axes and about them."""
MOST_SKEW_PX = 2.0
"""From the first row to the last: what a rolling shutter may bend."""
MOST_FULL = 0.3
WHITE_SHARE = 0.25
"""Of the image, about, that a target's white is."""
BLURRED = 0.25
"""Of a ring's smaller semi-axis."""


@dataclass(frozen=True, eq=False)
class Shot:
    """A frame, what is true of it, and what was said."""

    time_s: float
    frame: MovingFrame
    exposure: Exposure
    focus_px: float
    found: Detections
    notes: tuple[str, ...]
    motion_px: float
    laplacian: float

    @property
    def travel_px(self) -> float:
        """During the exposure of a row."""
        return float(np.nanmedian(self.frame.travel_px))

    @property
    def fault(self) -> str:
        """What is wrong with it by the truth; "" for nothing."""
        radius = float(np.median(self.found.ellipse_px[:, 3])) if len(self.found.ring) else 10.0
        skew = self.travel_px * self.exposure.readout_s / self.exposure.exposure_s
        if self.travel_px > MOST_MOTION_PX:
            return "blurred by motion"
        if skew > MOST_SKEW_PX:
            return "bent by motion"
        if self.focus_px > BLURRED * radius:
            return "out of focus"
        return "saturated" if float((self.frame.image >= 254).mean()) > MOST_FULL * WHITE_SHARE else ""


@dataclass(frozen=True, eq=False)
class Stay:
    """A way to a place, and the tremor there."""

    before: Array  # (4, 4)
    pose: Array  # (4, 4)
    begin_s: float  # when it has come there
    frame_s: float  # when the frame's first row begins
    phase: Array  # (6,) of the tremor

    def pose_at(self, later_s: float) -> Array:
        """The pose so much after the frame's first row began.  # (4, 4)"""
        time_s = self.frame_s + later_s
        now = between(self.before, self.pose, min(max(1 - (self.begin_s - time_s) / MOVE_S, 0.0), 1.0))
        sway = np.sin(2 * np.pi * FREQUENCY * time_s + self.phase) * np.sqrt(2 / 3) / (2 * np.pi * FREQUENCY)
        now[:3, 3] += TREMOR_MM_S * sway[:3]
        now[:3, :3] = exp_rotation(TREMOR_RAD_S * sway[3:]) @ now[:3, :3]
        return now


def path_of(rng: np.random.Generator, distance_mm: float) -> Iterator[tuple[float, float, Array, Array]]:
    """Begin and end of each stay in s, the pose there, and the pose before."""
    now, before = 0.0, pose_near(rng, distance_mm)
    while True:
        pose = pose_near(rng, distance_mm)
        yield now + MOVE_S, now + MOVE_S + HOLD_S, pose, before
        now, before = now + MOVE_S + HOLD_S, pose


def pose_near(rng: np.random.Generator, distance_mm: float) -> Array:
    """Somewhere in the picture."""
    eye = distance_mm * np.array([*rng.uniform(-0.5, 0.5, 2), 1.0])
    pose = np.array(look_at(eye, np.zeros(3), rng.uniform(-0.5, 0.5)))
    pose[:3, 3] += distance_mm * np.array([*rng.uniform(-0.15, 0.15, 2), 0.0])
    return pose


def between(before: Array, after: Array, share: float) -> Array:
    """On the way, without a jerk at either end (minimum jerk: Flash and Hogan 1985)."""
    s = share**3 * (10 - 15 * share + 6 * share**2)
    pose = (1 - s) * before + s * after
    left, _, right = np.linalg.svd(pose[:3, :3])
    pose[:3, :3] = left @ right
    return pose


def video(target: TargetGeometry, rng: np.random.Generator, distance_mm: float) -> Iterator[Shot]:
    """Frame after frame of a person with a target."""
    scene, sharpest = scene_from_target(target), float("inf")
    number, phase = 0, rng.uniform(0, 6, 6)
    for begin, end, pose, before in path_of(rng, distance_mm):
        exposure = Exposure(float(rng.uniform(0.003, 0.03)), float(rng.choice([0.0, 0.01, 0.03])))
        gain = float(rng.choice([1.0, 1.0, 1.0, 1.7]))
        focus_px = float(rng.choice([0.6, 0.6, 0.8, 3.5]))
        while (time_s := number / FRAMES_PER_S) < end:
            number += 1

            options = RenderOptions(blur_px=focus_px, contrast_to_noise=40, clutter=20)
            stay = Stay(before, pose, begin, time_s, phase)
            seen = moving_frame(scene, CAMERA, stay.pose_at, replace(exposure, gain=gain), options, rng)
            found = pipeline.detect(seen.image, target, name=f"{number}")
            quality = frame_quality(seen.image, found, target)
            notes = notes_of(quality, sharpest)
            if quality is not None and not notes:
                sharpest = min(sharpest, quality.blur_px)
            laplacian = float(cv2.Laplacian(seen.image, cv2.CV_64F).var())
            motion = np.nan if quality is None else quality.motion_px
            forbidding = tuple(note.name for note in notes if note.forbids)
            yield Shot(time_s, seen, exposure, focus_px, found, forbidding, motion, laplacian)


def area_under(score: Array, is_bad: Flags) -> float:
    """The chance that a bad frame has a higher score than a good one (Mann and Whitney 1947)."""
    if is_bad.all() or not is_bad.any():
        return float("nan")
    rank = np.argsort(np.argsort(score)) + 1.0
    bad = int(is_bad.sum())
    return float((rank[is_bad].sum() - bad * (bad + 1) / 2) / (bad * (len(score) - bad)))


def taken_of(shots: Iterator[Shot], wanted: int) -> tuple[list[Shot], list[Shot]]:
    """All frames until so many photos were taken by themselves, and these."""
    shutter, everything, taken = Shutter(), list[Shot](), list[Shot]()
    for shot in shots:
        everything.append(shot)
        look = Look(None, (), 1.0, True, "", (), is_wanted=len(shot.found.ring) > 0 and not shot.notes)
        shutter = shutter.after(shot.time_s, shot.found, look)
        if shutter.is_due:
            taken.append(shot)
            shutter = shutter.fired()
            if len(taken) == wanted:
                break
    return everything, taken


def main() -> None:
    """Both targets, half of the photos each."""
    photos = int(sys.argv[1]) if len(sys.argv) > 1 else 20
    rng = np.random.default_rng(int(sys.argv[2]) if len(sys.argv) > 2 else 0)
    everything, taken = list[Shot](), list[Shot]()
    for target, distance_mm in ((ring_views.board(), 230.0), (ring_views.ico(), 330.0)):
        some, kept = taken_of(video(target, rng, distance_mm), -(-photos // 2))
        everything, taken = everything + some, taken + kept
    faults = Counter(shot.fault for shot in taken if shot.fault)
    print(f"{len(taken)} photos taken by themselves of {len(everything)} frames; with a fault: {sum(faults.values())}")
    for name, count in faults.items():
        print(f"  {name}: {count}")
    errors = [shot.found.center_px - shot.frame.center_px[shot.found.ring] for shot in taken]
    offset = np.concatenate([one - np.nanmean(one, axis=0) for one in errors])
    print(f"centres of photos taken, about their mean: RMS {np.sqrt(np.nanmean(offset**2)):.3f} px")
    shown = [shot for shot in everything if len(shot.found.ring)]
    good = [shot for shot in shown if not shot.fault]
    refused = Counter(name for shot in good for name in shot.notes)
    print(f"frames with rings {len(shown)}, without a fault {len(good)}, of which refused: {dict(refused)}")
    is_moved = np.array([shot.travel_px > MOST_MOTION_PX for shot in shown])
    motion = np.array([shot.motion_px for shot in shown])
    dull = -np.array([shot.laplacian for shot in shown])
    known = np.isfinite(motion)
    print(
        f"motion told from edges: area {area_under(motion[known], is_moved[known]):.3f}; "
        f"variance of the Laplacian: {area_under(dull[known], is_moved[known]):.3f}"
    )


if __name__ == "__main__":
    main()
