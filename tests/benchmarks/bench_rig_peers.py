"""A stereo pair solved and used, against cv2.stereoCalibrate, mrcal and pycolmap, one thread each, in one run.

Run from the repository's root: `python -m tests.benchmarks.bench_rig_peers [--draws N]`. Two cameras 120 mm apart see a
board of 11 x 8 points, 25 mm apart, in 30 frames at 450 mm, noise 0.1 px; pixels are rounded to 32 bits, because OpenCV
rounds them. The peers get the frames in which both cameras see the whole board, which they ask for; ours gets the same
frames, and in a second line all that each camera saw. OpenCV: each camera by calibrateCamera, then stereoCalibrate with
the lenses fixed (as its samples do), and with all free from there, to 1e-12. mrcal: LENSMODEL_OPENCV5 for both.

Errors are root mean squares over the draws: of the second camera's place in the first's frame, of the baseline's
length, and of the rotation. Then points about the pair are triangulated by the true rig: ours against pycolmap's, which
takes them one by one.
"""

import argparse
import json
import os
import subprocess
import tempfile
import time
from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import cache
from pathlib import Path

from designer.base.arrays import Array, Flags

for name in ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "NUMBA_NUM_THREADS", "MKL_NUM_THREADS"):
    os.environ[name] = "1"  # before NumPy is loaded

import cv2  # noqa: E402
import numpy as np  # noqa: E402
import pycolmap  # noqa: E402

from calib.cameras.rig import Rig  # noqa: E402
from calib.core.se3 import exp_rotation, log_rotation, make_pose, transform  # noqa: E402
from calib.core.types import Observations, RigObservations, keep_frames  # noqa: E402
from calib.rigs.problem import CameraChoice  # noqa: E402
from calib.rigs.solve import solve_rig  # noqa: E402
from calib.space.propagate import PointSightings  # noqa: E402
from calib.space.triangulate import triangulate_points  # noqa: E402
from tests.benchmarks.bench_solve import grid  # noqa: E402
from tests.benchmarks.synthetic import row  # noqa: E402
from tests.support.foreign_cameras import SYSTEM_PYTHON  # noqa: E402
from tests.support.rig_views import RigScene, stereo_pair  # noqa: E402

COLUMNS, ROWS, PITCH_MM, FRAMES, AWAY_MM, NOISE_PX = 11, 8, 25.0, 30, 450.0, 0.1
POINTS = 2000
MRCAL_SCRIPT = Path(__file__).with_name("mrcal_pair.py")
TIGHT = (cv2.TERM_CRITERIA_COUNT + cv2.TERM_CRITERIA_EPS, 200, 1e-12)


@dataclass(frozen=True, eq=False)
class SolvedPair:
    """What a solver found."""

    seconds: float
    pose: Array  # (4, 4) second_from_first


def rounded(seen: RigObservations) -> RigObservations:
    """The pixels as OpenCV takes them."""
    return replace(
        seen,
        sightings=tuple(
            replace(one, center_px=one.center_px.astype(np.float32).astype(np.float64)) for one in seen.sightings
        ),
    )


def whole_frames(seen: RigObservations) -> Flags:
    """The frames (V,) in which both cameras see every point."""
    count = len(seen.points.position_mm)
    whole = np.ones(seen.frame_count, dtype=bool)
    for rows, one in zip(seen.frame, seen.sightings, strict=True):
        full = np.zeros(seen.frame_count, dtype=bool)
        full[rows] = np.bincount(one.view, minlength=one.view_count) == count
        whole &= full
    return whole


def pixels_of(one: Observations) -> Array:
    """Of all points in all views.  # (V, N, 2)"""
    order = np.lexsort((one.point, one.view))
    return one.center_px[order].reshape(one.view_count, -1, 2)


def ours(seen: RigObservations) -> SolvedPair:
    """Our solver, from scratch, joint covariance included."""
    begin = time.perf_counter()
    found = solve_rig(seen, [CameraChoice("opencv"), CameraChoice("opencv")])
    return SolvedPair(time.perf_counter() - begin, found.cam_from_rig[1])


def opencv(seen: RigObservations, *, is_free: bool) -> SolvedPair:
    """cv2.calibrateCamera for each, then cv2.stereoCalibrate with the lenses fixed, or all free from there."""
    position = [seen.points.position_mm.astype(np.float32)] * seen.frame_count
    pixel = [list(pixels_of(one).astype(np.float32)) for one in seen.sightings]
    size = seen.sightings[0].image_size
    begin = time.perf_counter()
    alone = [cv2.calibrateCamera(position, one, size, None, None)[1:3] for one in pixel]
    flags = cv2.CALIB_USE_INTRINSIC_GUESS if is_free else cv2.CALIB_FIX_INTRINSIC
    done = cv2.stereoCalibrate(
        position, *pixel, *alone[0], *alone[1], size, None, None, None, None, flags=flags, criteria=TIGHT
    )
    return SolvedPair(time.perf_counter() - begin, make_pose(done[5], done[6].ravel()))


@cache
def has_mrcal() -> bool:
    """Whether there is a Python with it."""
    call = [SYSTEM_PYTHON, "-c", "import mrcal"]
    return Path(SYSTEM_PYTHON).exists() and not subprocess.run(call, check=False, capture_output=True).returncode


def mrcal(seen: RigObservations) -> SolvedPair | None:
    """The Python of mrcal-calibrate-cameras; None where it is not installed."""
    if not has_mrcal():
        return None
    both = np.stack([pixels_of(one) for one in seen.sightings], axis=1).reshape(-1, ROWS, COLUMNS, 2)
    weighted = np.concatenate([both, np.ones((*both.shape[:3], 1))], axis=3)
    with tempfile.TemporaryDirectory() as folder:
        given, answer = Path(folder) / "in.npz", Path(folder) / "out.json"
        size = np.array(seen.sightings[0].image_size, dtype=np.int32)
        np.savez(given, observations=weighted, image_size=size, focal_px=1120.0, spacing_mm=PITCH_MM)
        subprocess.run([SYSTEM_PYTHON, str(MRCAL_SCRIPT), str(given), str(answer)], check=True, capture_output=True)
        found = json.loads(answer.read_text())
    pose = np.array(found["rt_cam_ref"])
    return SolvedPair(found["seconds"], make_pose(exp_rotation(pose[:3]), pose[3:]))


SOLVERS: dict[str, Callable[[RigObservations], SolvedPair | None]] = {
    "ours, the same frames": ours,
    "OpenCV, lenses fixed": lambda seen: opencv(seen, is_free=False),
    "OpenCV, all free": lambda seen: opencv(seen, is_free=True),
    "mrcal": mrcal,
}


def errors_of(found: SolvedPair, truth: Array) -> tuple[float, float, float]:
    """Of the second camera's place in mm, the baseline's length in mm, and the rotation in millidegrees."""
    place = [-(pose[:3, :3].T @ pose[:3, 3]) for pose in (found.pose, truth)]
    turn = np.linalg.norm(log_rotation(found.pose[:3, :3] @ truth[:3, :3].T))
    length = np.linalg.norm(found.pose[:3, 3]) - np.linalg.norm(truth[:3, 3])
    return float(np.linalg.norm(place[0] - place[1])), abs(float(length)), float(1e3 * np.degrees(turn))


def compare_solvers(draws: int) -> None:
    """Errors and times of all, draw by draw, the solvers taking turns."""
    errors: dict[str, list[tuple[float, float, float]]] = {name: [] for name in (*SOLVERS, "ours, all sightings")}
    seconds: dict[str, list[float]] = {name: [] for name in errors}
    used = []
    for draw in range(-1, draws):  # the first warms up
        scene = stereo_pair(
            grid(COLUMNS, ROWS, PITCH_MM), frames=FRAMES, away_mm=AWAY_MM, noise_px=NOISE_PX, seed=100 + draw
        )
        seen = rounded(scene.observations)
        whole = whole_frames(seen)
        same = keep_frames(seen, whole)
        results = {name: solver(same) for name, solver in SOLVERS.items()} | {"ours, all sightings": ours(seen)}
        if draw < 0:
            continue
        used.append(int(whole.sum()))
        for name, found in results.items():
            if found is not None:
                errors[name].append(errors_of(found, scene.cam_from_rig[1]))
                seconds[name].append(found.seconds)
    print(f"A stereo pair, {draws} draws; whole in {min(used)} to {max(used)} of {FRAMES} frames")
    row("solver", "", "place mm", "baseline mm   rotation mdeg   seconds   ours is faster by")
    mine = float(np.median(seconds["ours, the same frames"]))
    for name in (name for name, found in errors.items() if found):
        place, length, turn = np.sqrt(np.mean(np.square(errors[name]), axis=0))
        took = float(np.median(seconds[name]))
        row(name, "", f"{place:.4f}", f"{length:11.4f}   {turn:13.2f}   {took:7.3f}   {took / mine:.1f}")


def compare_points() -> None:
    """Ours against pycolmap by the true rig: errors in mm of one set of noisy sightings, and times."""
    scene: RigScene = stereo_pair(grid(COLUMNS, ROWS, PITCH_MM), frames=2, away_mm=AWAY_MM, seed=1)
    rng = np.random.default_rng(5)
    middle = np.linalg.inv(scene.cam_from_rig[0])[:3, 3] + [0, 0, AWAY_MM]
    point = middle + rng.uniform(-120, 120, (POINTS, 3))
    rig = Rig(("left", "right"), scene.cameras, scene.cam_from_rig, noise_px=np.full(2, NOISE_PX))
    seen = [one.project(transform(pose, point)) for one, pose in zip(rig.cameras, rig.cam_from_rig, strict=True)]
    pixel = np.stack(seen, axis=1) + NOISE_PX * rng.standard_normal((POINTS, 2, 2))  # (N, 2, 2)
    rows = np.arange(POINTS)
    sightings = PointSightings(
        ("frame",), tuple(map(str, rows)), np.zeros(POINTS, dtype=int), rows,
        np.tile([0, 1], POINTS), np.repeat(rows, 2), pixel.reshape(-1, 2),
    )  # fmt: skip
    triangulate_points(rig, sightings)
    begin = time.perf_counter()
    mine = triangulate_points(rig, sightings).position_mm
    took = time.perf_counter() - begin
    cameras = [
        pycolmap.Camera(
            model="FULL_OPENCV", width=one.image_size[0], height=one.image_size[1], params=_colmap(one.params)
        )
        for one in scene.cameras
    ]
    poses = [pycolmap.Rigid3d(pose[:3]) for pose in scene.cam_from_rig]
    begin = time.perf_counter()
    theirs = np.array([pycolmap.estimate_triangulation(one + 0.5, poses, cameras)["xyz"] for one in pixel])
    their_time = time.perf_counter() - begin
    rms = [float(np.sqrt(np.mean((found - point) ** 2) * 3)) for found in (mine, theirs)]
    print(f"\nTriangulation of {POINTS} points at about {AWAY_MM:g} mm, by the true rig")
    row("ours, with covariances and contradictions", "", f"{rms[0]:.4f} mm", f"{1e6 * took / POINTS:.1f} us a point")
    row("pycolmap", "", f"{rms[1]:.4f} mm", f"{1e6 * their_time / POINTS:.1f} us a point")


def _colmap(params: Array) -> list[float]:
    """Fx fy cx cy k1 k2 p1 p2 k3 0 0 0, from the corner of the image."""
    fx, fy, cx, cy, *lens = params.tolist()
    return [fx, fy, cx + 0.5, cy + 0.5, *lens, 0, 0, 0]


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--draws", type=int, default=20)
    cv2.setNumThreads(1)
    compare_solvers(parser.parse_args().draws)
    compare_points()
