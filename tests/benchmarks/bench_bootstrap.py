"""How long bootstrap samples take, solves and all metrics, against a plain loop over cv2.calibrateCamera.

Run from the repository's root: `python -m tests.benchmarks.bench_bootstrap [--samples N] [--check N]`. One process and
one thread each. 200 views, 21 x 21 rings on a board and 8 rings a side on an icosahedron, noise 0.05 px; samples of 20,
50 and 120 views. OpenCV solves 30 of the same samples, without a guess and with its default stopping rule; it gives no
metrics and none is asked of it. The time of 3 x 10,000 samples is extrapolated from both, for two processes by half.

With `--check`, so many samples of each size are compared with solutions from scratch, led down to rounding.
"""

import argparse
import os
import resource
import time
from dataclasses import dataclass, replace
from itertools import pairwise

from designer.base.arrays import Array

for name in ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "NUMBA_NUM_THREADS", "MKL_NUM_THREADS"):
    os.environ[name] = "1"  # before NumPy is loaded

import cv2  # noqa: E402
import numpy as np  # noqa: E402

from calib.renderer.truth import Truth, true_views  # noqa: E402
from calib.solver.blocks import RobustLoss, view_blocks  # noqa: E402
from calib.solver.calibration import Calibration  # noqa: E402
from calib.solver.levenberg import move_poses, turn_of_centre  # noqa: E402
from calib.solver.problem import SolveOptions, pack  # noqa: E402
from calib.solver.schur import damped_step  # noqa: E402
from calib.solver.solve import solve  # noqa: E402
from calib.studies.bootstrap import Pool, expanded, make_pool, run_sample  # noqa: E402
from calib.studies.samples import draw_counts  # noqa: E402
from tests.benchmarks.synthetic import row  # noqa: E402
from tests.support.solver_scenes import CAMERAS, board, icosahedron, observe, poses_around  # noqa: E402

VIEWS, SIZES = 200, (20, 50, 120)
NOISE_PX = 0.05
MANY = 10_000
OPENCV_SAMPLES = 30
GOAL_S, GOAL_RATIO, PROCESSES = 114.0, 50.0, 2


@dataclass(frozen=True)
class Target:
    """What is photographed, and from where."""

    name: str
    half_angle_deg: float


TARGETS = (Target("board", 50.0), Target("icosahedron", 180.0))


def make(target: Target, model: str) -> tuple[Pool, float]:
    """A pool, and how long it took."""
    rng = np.random.default_rng(0)
    points = board(21, 21, 10.0) if target.name == "board" else icosahedron(100.0, 8)
    poses = poses_around(VIEWS, rng, half_angle_deg=target.half_angle_deg)
    seen = observe(CAMERAS[model], points, poses, rng, noise_px=NOISE_PX)
    truth = Truth(seen.points.geometry_id, CAMERAS[model], true_views(seen.view_names, poses))
    begin = time.perf_counter()
    pool = make_pool(seen, model, SolveOptions(), truth)
    return pool, time.perf_counter() - begin


def opencv_seconds(pool: Pool, case: str, size: int, samples: int) -> float:
    """Mean time of cv2.calibrateCamera for the first samples of a case.

    OpenCV makes its own first guess of planes only; for another target it is given the solution of all views.
    """
    seen = pool.observations
    start = np.searchsorted(seen.view, np.arange(seen.view_count + 1))
    pixel = [seen.center_px[a:b].astype(np.float32) for a, b in pairwise(start)]
    point = seen.points.position_mm.astype(np.float32)
    position = [point[seen.point[a:b]] for a, b in pairwise(start)]
    guess, flags = None, 0
    if np.ptp(point[:, 2]) > 0:
        fx, fy, cx, cy = pool.calibration.camera.params[:4].tolist()
        guess, flags = np.array([[fx, 0, cx], [0, fy, cy], [0, 0, 1]]), cv2.CALIB_USE_INTRINSIC_GUESS
    total = 0.0
    for number in range(samples):
        counts = draw_counts(0, case, number, size, pool.view_count)
        drawn = np.repeat(np.arange(pool.view_count), counts).tolist()
        matrix = None if guess is None else guess.copy()  # it is written to
        begin = time.perf_counter()
        cv2.calibrateCamera(
            [position[v] for v in drawn], [pixel[v] for v in drawn], seen.image_size, matrix, None, flags=flags
        )
        total += time.perf_counter() - begin
    return total / samples


def times(target: Target, model: str, samples: int, *, against_opencv: bool) -> None:
    """The rows of a target and a model."""
    pool, pool_s = make(target, model)
    pool.run("warm", SIZES[0], 1, range(3))
    title = f"{target.name}, {model}"
    row(f"{title}: pool of {VIEWS} views", "", f"{pool_s:.2f} s", f"{len(pool.observations.view)} observations")
    ours, theirs = [], []
    for size in SIZES:
        begin = time.perf_counter()
        results = pool.run(str(size), size, 0, range(samples))
        ours.append((time.perf_counter() - begin) / samples)
        looks = np.mean([one.iterations for one in results])
        bad = sum(one.status != "converged" for one in results)
        row(f"{title}: {size} views", "", f"{1e3 * ours[-1]:.2f} ms", f"{looks:.2f} looks; {bad} not converged")
        if against_opencv:
            theirs.append(opencv_seconds(pool, str(size), size, OPENCV_SAMPLES // len(SIZES)))
            row("  cv2.calibrateCamera", "", f"{1e3 * theirs[-1]:.0f} ms", f"x {theirs[-1] / ours[-1]:.0f}")
    whole = MANY * sum(ours)
    row(f"{title}: 3 x {MANY}, one process", "", f"{whole:.0f} s", f"{whole / PROCESSES:.0f} s on {PROCESSES} at best")
    row(f"{title}: on {PROCESSES} processes", f"<= {GOAL_S:.0f} s", f"{whole / PROCESSES:.0f} s")
    if against_opencv:
        loop = MANY * sum(theirs)
        ratio = loop / (whole / PROCESSES)
        row(f"{title}: against one loop", f">= x {GOAL_RATIO:.0f}", f"x {ratio:.0f}", f"loop {loop:.0f} s")


def down_to_rounding(pool: Pool, found: Calibration) -> Array:
    """The parameters after a few more steps: the solver stops within 1e-5 standard deviations."""
    problem = pack(found.observations, weighted=False)
    poses = np.array(found.cam_from_target)
    poses[:, :3, 3] += poses[:, :3, :3] @ problem.origin_mm
    camera = found.camera
    for _ in range(6):
        step = damped_step(view_blocks(problem, camera, poses, RobustLoss()).products, pool.tie.row, 0.0)
        trial = replace(camera, params=camera.params + step.free[pool.tie.row])
        poses = move_poses(poses, step.pose, turn_of_centre(camera, trial))
        camera = trial
    return camera.params


def check(target: Target, model: str, samples: int) -> None:
    """The largest difference of a parameter from a solution from scratch, in its standard deviations."""
    pool, _ = make(target, model)
    for size in SIZES:
        rounding = raw = 0.0
        for number in range(samples):
            counts = draw_counts(0, str(size), number, size, pool.view_count)
            params = np.array(run_sample(pool, counts, number).params)
            found = solve(expanded(pool.observations, np.repeat(np.arange(pool.view_count), counts)), model)
            sigma = np.sqrt(np.diagonal(found.param_covariance))
            raw = max(raw, float(np.abs((params - found.camera.params) / sigma).max()))
            rounding = max(rounding, float(np.abs((params - down_to_rounding(pool, found)) / sigma).max()))
        row(
            f"{target.name}, {model}, {size} views: {samples} samples", "<= 1e-6 sigma", f"{rounding:.1e}",
            f"{raw:.1e} where the solver stops",
        )  # fmt: skip


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--samples", type=int, default=150, help="of each size (default 150)")
    parser.add_argument("--check", type=int, default=0, help="samples to compare with solutions from scratch")
    options = parser.parse_args()
    cv2.setNumThreads(1)
    for target in TARGETS:
        for model in ("luhmann", "opencv"):
            if options.check:
                check(target, model, options.check)
            else:
                times(target, model, options.samples, against_opencv=target.name == "board" and model == "opencv")
    print(f"peak memory {resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024:.0f} MB")


if __name__ == "__main__":
    main()
