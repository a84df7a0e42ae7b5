"""Whether cameras of wide lenses are within their stated sigmas, from the axis to the rim of the image circle.

Run from the repository's root: `python -m tests.benchmarks.bench_wide_sigmas [--sets N]`. Photos with targets all over
the image, as `calib render` draws them, are simulated with normal noise and solved from nothing. Where the solved
camera shows what a pixel truly sees is compared with the pixel, less the rotation that the image fits best, as the
stated covariance has it. Printed are, by angle off the axis, the root mean square error over the sets in px and in
stated sigmas: 1 if they are honest; and what 95 % of the image are stated to stay within. No other tool states these.
"""

import argparse
from collections.abc import Mapping
from dataclasses import replace
from itertools import pairwise

import numpy as np

import calib
from calib.cameras import linearise, project, rays
from calib.cameras.camera import Camera, camera_or_preset
from calib.cameras.refit import image_grid
from calib.core.linear_algebra import least_squares, moved_covariance, worse_sigma
from calib.core.types import KnownPoints
from calib.judge.difference import in_sigmas
from calib.observe.observations import known_points
from calib.solver.accuracy import GRID, projected_change
from calib.solver.calibration import Calibration
from calib.solver.solve import solve
from designer.base.arrays import Array
from designer.kinds.layout import lay_out
from designer.kinds.sizing import size_job
from designer.target import TargetGeometry
from tests.support.designs import asked_for
from tests.support.solver_scenes import observe

NOISE_PX = 0.05
BANDS_DEG = (0, 30, 60, 80, 90, 95)
DISTANCE_MM = (170.0, 400.0)
TARGETS: Mapping[str, tuple[str, dict[str, object]]] = {
    "icosahedron": ("ico", {"edge": "120mm"}),
    "board": ("board", {"columns": 12, "rows": 10, "pitch": "18mm", "ring_diameter": "13mm"}),
}


def truth_less_turn(calibration: Calibration, true: Camera, pixel: Array) -> Array:
    """How far the solved camera shows light from the pixels (N, 2) that it truly reaches, less the best rotation."""

    def off(at: Array) -> tuple[Array, Array]:
        ray = rays(true, at)
        known = np.isfinite(ray).all(axis=1)
        point = np.where(known[:, None], ray, [0.0, 0.0, 1.0])
        by_point = linearise(calibration.camera, np.ascontiguousarray(point.T)).by_point.transpose(2, 0, 1)
        moved = np.where(known[:, None], project(calibration.camera, point) - at, np.nan)
        return moved, np.cross(point[:, None, :], by_point)

    grid = image_grid(true.image_size, *GRID).reshape(-1, 2)
    moved, by_turn = off(grid)
    known = np.isfinite(moved).all(axis=1)
    turn = least_squares(by_turn[known].reshape(-1, 3), moved[known].reshape(-1, 1))
    moved, by_turn = off(pixel)
    rest: Array = moved - (by_turn @ turn)[..., 0]
    return rest


def errors_of(
    target: TargetGeometry, points: KnownPoints, camera: Camera, seed: int, views: int
) -> tuple[Array, Array, Array]:
    """Angles off the axis (N,), errors (N, 2) and their covariances (N, 2, 2) over the image of one solved camera."""
    photos = calib.render(target, camera, views=views, distance_mm=DISTANCE_MM, random_roll=True, seed=seed)
    seen = observe(camera, points, photos.cam_from_target, np.random.default_rng(seed), noise_px=NOISE_PX)
    solved = solve(seen, camera.model)
    pixel = image_grid(camera.image_size, 40).reshape(-1, 2)
    pixel = pixel[np.isfinite(rays(camera, pixel)).all(axis=1)]
    limited = replace(solved.camera, field_rad=camera.field_rad)
    covariance = moved_covariance(projected_change(limited, pixel), solved.param_covariance)
    error = truth_less_turn(solved, camera, pixel)
    known = np.isfinite(covariance).all(axis=(1, 2)) & np.isfinite(error).all(axis=1)
    return np.degrees(np.arccos(rays(camera, pixel[known])[:, 2])), error[known], covariance[known]


def main() -> None:
    """Print the table."""
    parser = argparse.ArgumentParser()
    parser.add_argument("--sets", type=int, default=100)
    parser.add_argument("--photos", type=int, default=40)
    asked = parser.parse_args()
    sets: int = asked.sets
    photos: int = asked.photos
    print(f"{sets} sets of {photos} photos, noise {NOISE_PX} px")
    print(f"{'camera':16}{'target':13}{'angle off the axis':>20}{'error px':>10}{'in sigmas':>11}")
    for name in ("fisheye-190", "action-camera"):
        camera = camera_or_preset(name)
        for what, (kind, sizes) in TARGETS.items():
            target = lay_out(size_job(asked_for(kind, sizes)).job.target)
            parts = [errors_of(target, known_points(target), camera, seed, photos) for seed in range(sets)]
            within = [float(np.percentile(worse_sigma(covariance), 95)) for _, _, covariance in parts]
            print(f"{name:16}{what:13}{'95 % stated within':>20}{np.median(within):10.4f}")
            angle, error, covariance = (np.concatenate(part) for part in zip(*parts, strict=True))
            for low, high in pairwise(BANDS_DEG):
                here = (angle >= low) & (angle < high)
                if here.any():
                    rms = float(np.sqrt((error[here] ** 2).sum(axis=1).mean()))
                    told = f"{low}-{high} deg"
                    print(f"{name:16}{what:13}{told:>20}{rms:10.4f}{in_sigmas(error[here], covariance[here]):11.2f}")


if __name__ == "__main__":
    main()
