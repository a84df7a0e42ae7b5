"""A robot's bag to a rig, and to a camera on a flange: processor time, peak memory, and how far off the result is.

Run from the repository's root: `python -m tests.benchmarks.bench_bag [--photos N] [--kind mcap]`; goals stand beside
the figures. Two cameras of 1280 x 800 px take N photos each of a board, 10 a second, of a robot that stands still for
half a second and moves for another; its flange's pose comes 100 times a second, by a clock that is 30 ms behind.

*--moving N*: instead, N recordings of a robot that never stops, 24 photos of 640 x 480 px in 5 s, the lens known, its
own noise none and 0.05 mm: how far the camera's six numbers are off in stated sigmas, and the clock in ms.
"""

import argparse
import resource
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterator
from pathlib import Path

import numpy as np

import calib
from calib.core.se3 import exp_rotation, interpolated, invert, look_at, make_pose, steps_between
from calib.renderer.options import RenderOptions
from calib.renderer.view import render_view
from calib.rigs.motion import Trajectory
from designer.base.arrays import Array
from tests.support.bags import START_NS, Said, image, transforms, write_bag
from tests.support.calibrations import board, camera, poses_around

BOARD = board(11, 8, "24mm")
CAMERA = camera("opencv", (1280, 800), 1000.0)
STEP_S, BEHIND_S = 0.1, 0.03
RIGHT_FROM_LEFT = make_pose(exp_rotation(np.array([0.0, -0.1, 0.01])), np.array([-120.0, 0.0, 5.0]))
FLANGE_FROM_CAM = make_pose(exp_rotation(np.array([0.1, -0.2, 1.5])), np.array([40.0, -25.0, 90.0]))
BASE_FROM_TARGET = make_pose(exp_rotation(np.array([0.02, 0.01, 0.3])), np.array([600.0, 100.0, -50.0]))
GOAL_S = 60


def key_poses(count: int, rng: np.random.Generator) -> tuple[Array, Array]:
    """Times and cam_from_target at which it begins and ends to stand still."""
    stops = poses_around(count, rng, half_angle_rad=0.7, distance_mm=520.0)
    at_s = np.arange(count)[:, None] + np.array([0.0, 0.5])
    return at_s.ravel(), np.repeat(stops, 2, axis=0)


def said(photos: int, rng: np.random.Generator) -> Iterator[Said]:
    """The messages, in their order."""
    at_s, stops = key_poses(int(np.ceil(photos * STEP_S)) + 1, rng)
    options = RenderOptions(blur_px=0.7, contrast_to_noise=60)
    for number in range(photos):
        begin_s = number * STEP_S
        for part in range(10):  # poses between two photos
            robot_s = begin_s + part * STEP_S / 10
            (pose,) = interpolated(at_s, stops, np.array([robot_s]))
            stamp = START_NS + round(1e9 * (robot_s - BEHIND_S))
            base_from_flange = BASE_FROM_TARGET @ invert(pose) @ invert(FLANGE_FROM_CAM)
            yield transforms("/tf", stamp, {("base_link", "tool0"): base_from_flange})
        (pose,) = interpolated(at_s, stops, np.array([begin_s]))
        for topic, one in (("/left/image_raw", pose), ("/right/image_raw", RIGHT_FROM_LEFT @ pose)):
            shown = render_view(BOARD, CAMERA, one, options, rng).image.astype(np.uint8)
            yield image(topic, START_NS + round(1e9 * begin_s), shown)


def timed(code: str) -> tuple[str, float, float]:
    """What a program prints, its processor time in s, and the most memory it had in MB."""
    before = resource.getrusage(resource.RUSAGE_CHILDREN)
    told = subprocess.run([sys.executable, "-c", code], check=True, capture_output=True, text=True).stdout
    after = resource.getrusage(resource.RUSAGE_CHILDREN)
    used_s = after.ru_utime + after.ru_stime - before.ru_utime - before.ru_stime
    return told.strip(), used_s, after.ru_maxrss / 1024


BEGIN = "import calib, numpy as np; from tests.benchmarks.bench_bag import *; path = {path!r}\n"
END = """
seen = found.calibration.observations
print(len(seen.frame_names), "frames, off by", np.linalg.norm((off @ invert(true))[:3, 3]), "mm", *seen.remarks)
"""
RIG = """
found = calib.rig(BOARD, path, topics='/left/image_raw,/right/image_raw', model='opencv', made='exact')
off, true = found.rig.cam_from_rig[1], RIGHT_FROM_LEFT
"""
HAND_EYE = """
given = {{"image": '/left/image_raw', "tf": ('base_link', 'tool0')}}
found = calib.hand_eye(BOARD, path, **given, model='opencv', made='exact')
off, true = found.hand_eye.flange_from_cam, FLANGE_FROM_CAM
"""


def moving(count: int, noise_mm: float) -> None:
    """Recordings of a robot that never stops, each with noise of its own."""
    plate, lens, at_s = board(7, 5, "12mm"), camera("opencv", (640, 480), 700.0), np.linspace(0, 2 * np.pi, 12)
    eye = 170 * np.stack([0.5 * np.sin(at_s), 0.5 * np.sin(2 * at_s + 0.5), 0.9 + 0.15 * np.cos(at_s)], axis=1)
    way = Trajectory(np.linspace(0, 6, 12), look_at(eye, np.zeros((12, 3)), 1.2 * np.sin(3 * at_s)))
    square, ahead_ms = [], []
    for seed in range(count):
        rng, messages = np.random.default_rng(100 + seed), list[Said]()
        for number in range(480):
            time_s = 0.4 + 0.01 * number
            (pose,) = way.at(np.array([time_s]))
            wobble = noise_mm * rng.normal(size=6)
            flange = BASE_FROM_TARGET @ invert(pose) @ invert(FLANGE_FROM_CAM)
            flange = flange @ make_pose(exp_rotation(wobble[:3] / 500), wobble[3:])
            stamp = START_NS + round(1e9 * (time_s - BEHIND_S))
            messages.append(transforms("/tf", stamp, {("base_link", "tool0"): flange}))
            if number % 20 == 0:
                options = RenderOptions(blur_px=0.6, contrast_to_noise=80)
                shown = render_view(plate, lens, pose, options, rng).image.astype(np.uint8)
                messages.append(image("/cam", START_NS + round(1e9 * time_s), shown))
        with tempfile.TemporaryDirectory() as folder:
            bag = write_bag(Path(folder) / "run.mcap", messages)
            found = calib.hand_eye(plate, bag, tf=("base_link", "tool0"), camera=lens, made="exact")
        step, rows = steps_between(found.rig.cam_from_rig[0], invert(FLANGE_FROM_CAM)), found.rig.pose_rows(0)
        square.append(step @ np.linalg.solve(found.rig.covariance[rows, rows], step) / 6)
        said_of = next(one for one in found.calibration.observations.remarks if "is ahead by " in one)
        ahead_ms.append(float(said_of.partition("is ahead by ")[2].split()[0]) - 1e3 * BEHIND_S)
    print(
        f"robot's noise {noise_mm} mm: mean squares of six numbers {np.mean(square):.2f} (goal 0.7 to 1.4), the clock "
        f"off by {np.sqrt(np.mean(np.square(ahead_ms))):.3f} ms, {np.abs(ahead_ms).max():.3f} at most"
    )


def main() -> None:
    """Write the bag, go through it, and print the figures."""
    parser = argparse.ArgumentParser()
    parser.add_argument("--photos", type=int, default=500)
    parser.add_argument("--kind", default="mcap")
    parser.add_argument("--keep", help="folder that the bag is left in, and taken from")
    parser.add_argument("--moving", type=int, default=0)
    given = parser.parse_args()
    if given.moving:
        for noise_mm in (0.0, 0.05):
            moving(given.moving, noise_mm)
        return
    with tempfile.TemporaryDirectory() as folder:
        path = Path(given.keep or folder) / f"run.{given.kind}"
        if not path.exists():
            begin = time.process_time()
            write_bag(path, said(given.photos, np.random.default_rng(1)))
            print(f"written in {time.process_time() - begin:.0f} s")
        for name, code in (("rig", RIG), ("hand-eye", HAND_EYE)):
            told, used_s, memory_mb = timed((BEGIN + code).format(path=str(path)) + END)
            print(f"{name}: {used_s:.1f} s of processor time (goal {GOAL_S}), {memory_mb:.0f} MB\n  {told}")


if __name__ == "__main__":
    main()
