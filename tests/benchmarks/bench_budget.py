"""`calib budget` against simulated calibrations, and triangulation beside others: `python -m
tests.benchmarks.bench_budget [DRAWS]`, two minutes for 500 draws.

Each draw is a calibration of its own, from new noise in all sightings, and a triangulation by it of newly sighted
points. What is stated is the budget of one such calibration. Then a million points, and a few by mrcal, OpenCV and
COLMAP (pycolmap), where they are installed.
"""  # noqa: D205

import subprocess
import sys
import tempfile
import time
from dataclasses import replace
from pathlib import Path

import cv2
import numpy as np

import calib
from calib.cameras.rig import Rig
from calib.core.se3 import log_rotation, transform
from calib.core.types import RigObservations
from calib.rigs.problem import CameraChoice
from calib.rigs.result import RigCalibration
from calib.rigs.solve import solve_rig
from calib.space.budget import expected_errors, without_rigid_motion
from calib.space.propagate import rms_error_mm
from calib.space.triangulate import triangulate_points
from designer.base.arrays import Array
from tests.support.rig_views import RigScene, residuals_of, ring, stereo_pair
from tests.support.space_scenes import points_before, row_of_cameras, sighted, without_errors

SCENES = {
    "stereo pair, 0.3 to 1.5 m": (lambda: stereo_pair(frames=20), {"distance_mm": (300, 1500)}),
    "ring of four": (lambda: ring(frames=20), {}),
    "ring of four, two of them fisheyes": (lambda: ring(frames=20, models=("opencv", "fisheye")), {}),
}
MRCAL_PYTHON, MRCAL_SCRIPT = "/usr/bin/python3", Path(__file__).with_name("mrcal_triangulate.py")
POINTS, LENGTH_MM, MANY, FEW = 400, 100.0, 1_000_000, 2000


def main() -> int:
    """All of it."""
    draws = int(sys.argv[1]) if len(sys.argv) > 1 else 500
    for name, (make, options) in SCENES.items():
        print(f"{name}: {draws} calibrations", flush=True)
        _against_draws(make(), options, draws)
    _many()
    _beside_others()
    _beside_mrcal()
    return 0


def with_new_noise(scene: RigScene, rng: np.random.Generator) -> RigObservations:
    """What the cameras would have seen another time."""
    seen = []
    for row, one in enumerate(scene.observations.sightings):
        poses = scene.rig_from_target[scene.observations.frame[row]]
        exact = one.center_px + residuals_of(scene.cameras[row], scene.cam_from_rig[row], poses, one)
        seen.append(replace(one, center_px=exact + scene.noise_px * rng.standard_normal(exact.shape)))
    return replace(scene.observations, sightings=tuple(seen))


def calibrated(scene: RigScene, observations: RigObservations) -> RigCalibration:
    """The rig as its sightings give it."""
    return solve_rig(observations, [CameraChoice(one.model) for one in scene.cameras])


def true_rig(scene: RigScene) -> Rig:
    """The rig as it is."""
    noise = np.full(len(scene.cameras), scene.noise_px)
    return Rig(scene.observations.camera_names, scene.cameras, scene.cam_from_rig, None, noise)


def _against_draws(scene: RigScene, options: dict[str, object], draws: int) -> None:
    """Scatter over what the budget says, point by point: in the rig's frame, of the shape, of lengths."""
    rng = np.random.default_rng(1)
    truth = true_rig(scene)
    stated_by = calibrated(scene, with_new_noise(scene, rng)).rig
    budget = calib.budget(stated_by, noise_px=scene.noise_px, **options)  # type: ignore[arg-type]
    rows = rng.permutation(len(budget.expected.point_mm))[:POINTS]
    points = budget.expected.point_mm[np.sort(rows)]
    expected = expected_errors(stated_by, points, np.full(len(scene.cameras), scene.noise_px))
    assert expected.by_calibration is not None
    seen = sighted(truth, points)
    size = np.array([one.image_size for one in truth.cameras])[seen.camera]
    inside = (np.abs(seen.center_px - (size - 1) / 2) <= size / 2).all(axis=1)
    seen = replace(seen, camera=seen.camera[inside], place=seen.place[inside], center_px=seen.center_px[inside])
    off = np.empty((draws, len(points), 3))
    for draw in range(draws):
        rig = calibrated(scene, with_new_noise(scene, rng)).rig
        noisy = replace(seen, center_px=seen.center_px + scene.noise_px * rng.standard_normal(seen.center_px.shape))
        off[draw] = triangulate_points(rig, noisy).position_mm - points
    keep = np.isfinite(off).all(axis=(0, 2))  # a few contradict themselves by chance
    off, points, stated = off[:, keep], points[keep], rms_error_mm(expected.covariance_mm2)[keep]
    _say("in the rig's frame", _rms(off), stated)
    shape = np.moveaxis(without_rigid_motion(points, np.moveaxis(off, 0, 2), stated), 2, 0)
    of_shape = without_rigid_motion(points, expected.by_calibration[keep], stated)
    noise = np.trace(expected.noise_mm2, axis1=1, axis2=2)[keep]
    _say("rigid motion taken off", _rms(shape), np.sqrt(noise + (of_shape**2).sum(axis=(1, 2))))


def _rms(off: Array) -> Array:
    rms: Array = np.sqrt((off**2).sum(axis=2).mean(axis=0))
    return rms


def _say(what: str, scatter: Array, stated: Array) -> None:
    ratio = scatter / stated
    share = 100 * np.mean(np.abs(ratio - 1) < 0.1)
    print(
        f"  {what:24} scatter, median {np.median(scatter):.4f} mm; stated {np.median(stated):.4f} mm; ratio of "
        f"each point: median {np.median(ratio):.3f}, 5 to 95 % {np.percentile(ratio, 5):.3f} to "
        f"{np.percentile(ratio, 95):.3f}; within 10 %: {share:.0f} %",
        flush=True,
    )


def _many() -> None:
    """How long a million points take, with covariances."""
    rng = np.random.default_rng(2)
    for cameras in (2, 4):
        rig = row_of_cameras(cameras)
        seen = sighted(rig, points_before(rig, MANY, rng), rng)
        triangulate_points(rig, sighted(rig, points_before(rig, 10, rng)))
        begin = time.perf_counter()
        found = triangulate_points(rig, seen)
        print(
            f"{MANY} points from {cameras} cameras: {time.perf_counter() - begin:.1f} s, {found.is_placed.sum()} placed"
        )


def _beside_others() -> None:
    """Errors and time of others on the same sightings."""
    rng = np.random.default_rng(3)
    rig = without_errors(row_of_cameras(2))
    points = points_before(rig, FEW, rng, near_mm=300)
    seen = sighted(rig, points, rng)
    begin = time.perf_counter()
    found = triangulate_points(rig, seen)
    ours = time.perf_counter() - begin
    error = _error(found.position_mm - points)
    print(f"{FEW} points of a stereo pair: ours RMS {error:.4f} mm, {1e6 * ours / FEW:.1f} us a point with covariances")
    begin = time.perf_counter()
    slopes = [
        cv2.undistortPoints(seen.center_px[seen.camera == row][:, None], one.matrix, one.distortion)[:, 0]
        for row, one in enumerate(rig.cameras)
    ]
    theirs = cv2.triangulatePoints(rig.cam_from_rig[0, :3], rig.cam_from_rig[1, :3], slopes[0].T, slopes[1].T)
    seconds = time.perf_counter() - begin
    print(f"  OpenCV   RMS {_error((theirs[:3] / theirs[3]).T - points):.4f} mm, {1e6 * seconds / FEW:.1f} us a point")
    try:
        import pycolmap
    except ImportError:
        print("  pycolmap is not installed")
        return
    rays = np.stack([rig.cameras[row].rays(seen.center_px[seen.camera == row]) for row in range(2)], axis=1)
    begin = time.perf_counter()
    poses = list(rig.cam_from_rig[:, :3])
    colmap = np.array([np.ravel(pycolmap.triangulate_multi_view_point(poses, pair)) for pair in rays])
    seconds = time.perf_counter() - begin
    print(f"  COLMAP   RMS {_error(colmap - points):.4f} mm, {1e6 * seconds / FEW:.1f} us a point")


def _error(off: Array) -> float:
    return float(np.sqrt(np.nanmean((off**2).sum(axis=1))))


def _beside_mrcal() -> None:
    """Covariances of a stereo pair's points by mrcal, from the same sightings."""
    scene = stereo_pair(frames=20)
    found = calibrated(scene, scene.observations)
    points = points_before(true_rig(scene), 40, np.random.default_rng(4), near_mm=300, far_mm=1500)
    pixels = np.stack(
        [one.project(transform(pose, points)) for one, pose in zip(found.cameras, found.cam_from_rig, strict=True)],
        axis=1,
    )
    with tempfile.TemporaryDirectory() as folder:
        given, answer = Path(folder) / "in.npz", Path(folder) / "out.npz"
        np.savez(given, pixels=pixels, noise_px=scene.noise_px, **_for_mrcal(found))
        done = subprocess.run(
            [MRCAL_PYTHON, str(MRCAL_SCRIPT), str(given), str(answer)], capture_output=True, text=True, check=False
        )
        if done.returncode:
            print(f"mrcal does not run: {done.stderr.strip().splitlines()[-1:]}")
            return
        theirs = np.load(answer)
        expected = expected_errors(found.rig, points, np.full(2, scene.noise_px))
        unit = (scene.noise_px / found.noise_px.mean()) ** 2
        shared = expected.calibration_mm2
        assert shared is not None
        for name, mine, their in (
            ("noise", expected.noise_mm2, theirs["observation"]),
            ("calibration", shared * unit, theirs["calibration"]),
        ):
            ratio = rms_error_mm(mine) / rms_error_mm(their)
            print(f"sigmas by {name}, ours over mrcal's: {ratio.min():.4f} to {ratio.max():.4f}")
        print(f"  mrcal {1e6 * float(theirs['seconds']) / len(points):.0f} us a point with covariances")


def _for_mrcal(found: RigCalibration) -> dict[str, Array]:
    """A solved pair as mrcal takes it; what a camera does not see has weight -1."""
    points = found.observations.points.position_mm
    first, last = points.min(axis=0), points.max(axis=0)
    spacing = float(np.sort(np.unique(np.round(np.diff(np.unique(np.round(points[:, 0], 6))), 6)))[0])
    columns, rows = (round(float(last[axis] - first[axis]) / spacing) + 1 for axis in (0, 1))
    cell = np.round((points[:, :2] - first[:2]) / spacing).astype(int)
    boards, indices = [], []
    for camera, seen in enumerate(found.observations.sightings):
        for view, frame in enumerate(found.observations.frame[camera].tolist()):
            board = np.full((rows, columns, 3), -1.0)
            these = seen.view == view
            at = cell[seen.point[these]]
            board[at[:, 1], at[:, 0]] = np.column_stack([seen.center_px[these], np.ones(len(at))])
            boards.append(board)
            indices.append((frame, camera, camera - 1))
    order = np.lexsort(np.array(indices).T[::-1])
    corner = transform(found.rig_from_target, np.broadcast_to(first, (len(found.rig_from_target), 3)))
    poses = found.cam_from_rig[1:]
    return {
        "intrinsics": np.array([one.params for one in found.cameras]),
        "extrinsics": np.concatenate([log_rotation(poses[:, :3, :3]), poses[:, :3, 3]], axis=1),
        "frames": np.concatenate([log_rotation(found.rig_from_target[:, :3, :3]), corner], axis=1),
        "observations": np.array(boards)[order], "indices": np.array(indices)[order],
        "image_sizes": np.array([one.image_size for one in found.cameras]), "spacing_mm": np.array(spacing),
    }  # fmt: skip


if __name__ == "__main__":
    raise SystemExit(main())
