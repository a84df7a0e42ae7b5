"""A robot's bag to a rig, and to a camera on a flange: processor time, peak memory, and how far off the result is.

Run from the repository's root: `python -m tests.benchmarks.bench_bag [--photos N] [--kind mcap]`; goals stand beside
the figures. Two cameras of 1280 x 800 px take N photos each of a board, 10 a second, of a robot that stands still for
half a second and moves for another; its flange's pose comes 100 times a second, by a clock that is 30 ms behind.
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

from calib.core.se3 import exp_rotation, interpolated, invert, make_pose
from calib.renderer.options import RenderOptions
from calib.renderer.view import render_view
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


def main() -> None:
    """Write the bag, go through it, and print the figures."""
    parser = argparse.ArgumentParser()
    parser.add_argument("--photos", type=int, default=500)
    parser.add_argument("--kind", default="mcap")
    parser.add_argument("--keep")
    given = parser.parse_args()
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
