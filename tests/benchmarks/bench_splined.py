"""The model `splined` beside published figures, on photos held out: poses only.

Run from the repository's root: `python -m tests.benchmarks.bench_splined [--real DIR] [--views 120] [--draws 5]`.

* wide-ov-plane (babelcalib's corners of a plane, 186 degrees): fitted to the training photos, RMS over all test
  corners; the published Kannala-Brandt has .4746 px, double sphere .4796, EUCM .4797 (with a start near the answer).
* wide-figueroa (mrcal's corners of a board of 77 mm squares, weights by pyramid level): fitted to every second frame,
  weighted RMS and median of the others, the board's bend an unknown; mrcal OPENCV8 .787 and .510, splined 30 x 20
  .794 and .410 in 51 s, and a bend of -1.04 and .52 mm.
* A lens of no formula (the template phase-one-spline), a board of 21 x 21 points, noise .05 px: what held-out points
  without noise are off by, and the chi-square of that error over the image against the stated covariance, 1 if honest
  and the surface can be the lens. A few directions make up most of it: single draws say little (of 24, .79 to 1.88,
  1.08 on average), and what the control points cannot hold of this lens, .003 px, is part of it.

The sets are told apart by folders below `--real`; those that are absent are left out.
"""

import argparse
import time
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np

from calib.cameras import linearise, project, rays
from calib.cameras.camera import Camera, camera_or_preset
from calib.cameras.refit import camera_difference
from calib.core.linear_algebra import least_squares, moved_covariance
from calib.core.types import Observations, keep_views
from calib.observe.correspondences import read_observations
from calib.solver.blocks import RobustLoss
from calib.solver.calibration import Calibration
from calib.solver.levenberg import minimise_poses
from calib.solver.problem import SolveOptions, pack
from calib.solver.solve import solve
from calib.solver.start import first_poses
from designer.base.arrays import Array
from tests.benchmarks.synthetic import row
from tests.support.solver_scenes import board, observe, poses_around

LENS_MODELS = ("fisheye", "splined")
NOISE_PX = 0.05


def held_out_px(camera: Camera, seen: Observations) -> Array:
    """Whitened residuals (M,), of poses that are fitted to these photos."""
    problem = pack(seen, weighted=True)
    first = first_poses(problem, camera, is_robust=False)
    found = minimise_poses(problem, camera, first.cam_from_target, RobustLoss(), max_iterations=60)
    length: Array = np.hypot(*found.blocks.residual_px) * problem.whitener[0]
    return length


def told(camera: Camera, seen: Observations) -> str:
    """RMS and median of photos held out."""
    length = held_out_px(camera, seen)
    return f"{np.sqrt(np.nanmean(length**2)):.4f} px RMS, median {np.nanmedian(length):.4f}"


def timed(call: Callable[[], Calibration]) -> tuple[Calibration, str]:
    """The second of two calls, and its time: wall and processor."""
    call()
    begin, cpu = time.perf_counter(), time.process_time()
    found = call()
    return found, f"{time.perf_counter() - begin:.2f} s ({time.process_time() - cpu:.2f} s of a processor)"


def ov_plane(folder: Path) -> None:
    """Held-out corners of the plane."""
    train, test = read_observations(folder / "train.csv"), read_observations(folder / "test.csv")
    for model in LENS_MODELS:
        found, seconds = timed(lambda model=model: solve(train, model))  # type: ignore[misc]
        row(f"ov-plane {model}", told(found.camera, test), seconds, "published .4746")


def figueroa(folder: Path) -> None:
    """Held-out frames of the bent board."""
    seen = read_observations(folder / "corners.csv")
    is_first = np.arange(seen.view_count) % 2 == 0
    train, test = keep_views(seen, is_first), keep_views(seen, ~is_first)
    options = SolveOptions(free_bend=True)
    for model in LENS_MODELS:
        found, seconds = timed(lambda model=model: solve(train, model, options))  # type: ignore[misc]
        bent = replace(test, points=found.observations.points)
        row(f"figueroa {model}", told(found.camera, bent), seconds, "mrcal .787/.510, .794/.410")


def chi_square(truth: Camera, found: Calibration) -> tuple[float, float]:
    """Over pixels that were surrounded by sightings: RMS error in px less a turn, and its mean square in sigmas."""
    size = np.array(truth.image_size)
    u, v = np.meshgrid(np.linspace(0.15, 0.85, 15) * size[0], np.linspace(0.15, 0.85, 11) * size[1])
    pixel = np.stack([u.ravel(), v.ravel()], axis=1)
    turn = camera_difference(truth, found.camera, radius_px=0.4 * float(size.min())).b_from_a
    off = project(found.camera, rays(truth, pixel) @ turn.T) - pixel
    ray = rays(found.camera, pixel)
    linear = linearise(found.camera, np.ascontiguousarray(ray.T))
    by_turn = np.cross(ray[:, None, :], linear.by_point.transpose(2, 0, 1)).reshape(-1, 3)
    fields = np.concatenate([linear.by_params.transpose(2, 0, 1), off[:, :, None]], axis=2).reshape(2 * len(pixel), -1)
    rest = (fields - by_turn @ least_squares(by_turn, fields)).reshape(len(pixel), 2, -1)
    error, covariance = rest[:, :, -1], moved_covariance(rest[:, :, :-1], found.param_covariance)
    square = np.einsum("ni,nij,nj->n", error, np.linalg.inv(covariance), error)
    return float(np.sqrt((error**2).sum(axis=1).mean())), float(square.mean() / 2)


def no_formula(views: int, draws: int) -> None:
    """A lens that no formula fits."""
    truth, points = camera_or_preset("phase-one-spline"), board(21, 21, 10.0)

    def scene(count: int, noise_px: float, rng: np.random.Generator) -> Observations:
        poses = poses_around(count, rng, half_angle_deg=45, distance_mm=380, aim_mm=60)
        return observe(truth, points, poses, rng, noise_px=noise_px)

    for draw in range(draws):
        rng = np.random.default_rng(draw)
        train, test = scene(views, NOISE_PX, rng), scene(24, 0.0, rng)
        for model in ("luhmann", *LENS_MODELS) if draw == 0 else LENS_MODELS[-1:]:
            found, seconds = timed(lambda model=model, train=train: solve(train, model))  # type: ignore[misc]
            error, chi = chi_square(truth, found)
            name = f"no formula, {views} views, draw {draw}, {model}"
            row(name, f"held out {told(found.camera, test)}", f"image {error:.4f} px, chi2 {chi:.2f}", seconds)


def main() -> None:
    """Print all."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--real", type=Path, default=Path(__file__).parents[3] / "shared/real")
    parser.add_argument("--views", type=int, default=120)
    parser.add_argument("--draws", type=int, default=5)
    args = parser.parse_args()
    for name, bench in (("wide-ov-plane", ov_plane), ("wide-figueroa", figueroa)):
        if (args.real / name).is_dir():
            bench(args.real / name)
        else:
            print(f"{name}: absent in {args.real}, left out")
    no_formula(args.views, args.draws)


if __name__ == "__main__":
    main()
