"""A minute of 1080p video at 30 Hz to a verdict: `python -m tests.benchmarks.bench_video [--seconds 60] [--keep DIR]`.

A board is rendered along a path as of a hand: it moves to a view, blurred by the exposure, and pauses there, trembling.
"""

import argparse
import resource
import tempfile
import time
from pathlib import Path

import cv2
import numpy as np

import calib
from calib.cameras import project
from calib.core.se3 import exp_rotation, log_rotation, make_pose
from calib.renderer.options import RenderOptions
from calib.renderer.view import render_view
from designer.base.arrays import Array
from designer.target import target_to_json
from tests.support.calibrations import board, camera, poses_around

RATE_HZ, EXPOSED = 30, 0.4
SIZE = (1920, 1080)
MOVES_S, STANDS_S = 1.3, 1.1
TREMBLES_MM, TREMBLES_RAD = 0.15, 0.0008


def hand_path(seconds: float, rng: np.random.Generator) -> Array:
    """Poses of a target that is moved and stands, frame by frame.  # (N, 4, 4)"""
    views = poses_around(int(seconds / (MOVES_S + STANDS_S)) + 2, rng, half_angle_rad=0.6, distance_mm=330.0)
    views[:, :3, 3] += rng.uniform(-1, 1, (len(views), 3)) * (130, 70, 40)
    poses = []
    tremble = np.zeros(6)
    for frame in range(round(seconds * RATE_HZ)):
        place, share = divmod(frame / RATE_HZ / (MOVES_S + STANDS_S), 1.0)
        way = min(share * (MOVES_S + STANDS_S) / MOVES_S, 1.0)
        way = way * way * (3 - 2 * way)
        a, b = views[int(place)], views[int(place) + 1]
        turn = exp_rotation(way * log_rotation(b[:3, :3] @ a[:3, :3].T)) @ a[:3, :3]
        shake = rng.normal(size=6) * np.repeat((TREMBLES_RAD, TREMBLES_MM), 3)
        tremble = 0.9 * tremble + 0.3 * shake
        poses.append(make_pose(exp_rotation(tremble[:3]) @ turn, (1 - way) * a[:3, 3] + way * b[:3, 3] + tremble[3:]))
    return np.array(poses)


def write_clip(path: Path, seconds: float, rng: np.random.Generator, codec: str = "mp4v") -> None:
    """Render and write a clip, with its target beside it."""
    target, lens = board(17, 11, "12mm"), camera("opencv", SIZE, 1500.0)
    (path.parent / "board.target.json").write_text(target_to_json(target))
    options = RenderOptions(blur_px=0.8, contrast_to_noise=40)
    writer = cv2.VideoWriter(str(path), cv2.VideoWriter_fourcc(*codec), RATE_HZ, SIZE)
    before = None
    for pose in hand_path(seconds, rng):
        image = render_view(target, lens, pose, options, rng).image.astype(np.uint8)
        middle = project(lens, pose[None, :3, 3])[0]
        moved = np.zeros(2) if before is None else EXPOSED * (middle - before)
        before = middle
        if np.hypot(*moved) > 0.5:
            image = cv2.filter2D(image, -1, line_kernel(moved))
        writer.write(cv2.cvtColor(image, cv2.COLOR_GRAY2BGR))
    writer.release()


def line_kernel(moved: Array) -> Array:
    """Of a motion blur."""
    half = int(np.ceil(np.hypot(*moved) / 2)) + 1
    kernel = np.zeros((2 * half + 1, 2 * half + 1), np.float32)
    for share in np.linspace(-0.5, 0.5, 8 * half):
        at = half + share * moved
        x, y = np.floor(at).astype(int)
        dx, dy = at - (x, y)
        for sx, wx in ((0, 1 - dx), (1, dx)):
            for sy, wy in ((0, 1 - dy), (1, dy)):
                kernel[y + sy, x + sx] += wx * wy
    return kernel / kernel.sum()


def spent_s() -> float:
    """Processor time of this process."""
    used = resource.getrusage(resource.RUSAGE_SELF)
    return used.ru_utime + used.ru_stime


def main() -> None:
    """Make the clip, run it, tell."""
    parser = argparse.ArgumentParser()
    parser.add_argument("--seconds", type=float, default=60.0)
    parser.add_argument("--keep", type=Path)
    parser.add_argument("--suffix", default="mp4", choices=("mp4", "avi"))
    asked = parser.parse_args()
    with tempfile.TemporaryDirectory() as scratch:
        place = asked.keep or Path(scratch)
        place.mkdir(parents=True, exist_ok=True)
        path = place / f"clip.{asked.suffix}"
        if not path.exists():
            write_clip(path, asked.seconds, np.random.default_rng(1), {"mp4": "mp4v", "avi": "MJPG"}[asked.suffix])
        calib.warm_up()
        begun, wall = spent_s(), time.perf_counter()
        run = calib.run(place / "board.target.json", path, out=place / "run")
        print(f"{spent_s() - begun:.1f} s of processor time, {time.perf_counter() - wall:.1f} s")
        print(run.verdict.grade, run.best.model, list(run.search.remarks) if run.search else "")
        truth = camera("opencv", SIZE, 1500.0)
        print("focal length", run.best.camera.params[:2], "true", truth.params[:2])
        print(calib.diff(run.best.camera, truth).zones["whole image"].rms_px, "px from the true lens")


if __name__ == "__main__":
    main()
