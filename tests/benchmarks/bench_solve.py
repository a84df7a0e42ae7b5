"""How long a camera takes to solve, against cv2.calibrateCamera and mrcal, one thread each.

Run from the repository's root: `python -m tests.benchmarks.bench_solve [--rounds N]`. Views of a board of 21 x 21
rings, tilted up to 50 degrees, focal length 2500 px, k1 = -0.12, noise 0.05 px; pixels are rounded to 32 bits, because
OpenCV rounds them. All start from scratch: ours and OpenCV without a guess, mrcal with the focal length within 5 %,
which it asks for. OpenCV runs with its default stopping rule, which takes it to the same minimum. Then two more lenses,
rational and fisheye (700 px, seen up to 89 degrees off the axis), against OpenCV's of the same formula; its fisheye is
given a guess, without which it ends in an error. The shortest of several rounds is printed, the solvers taking turns,
so that a busy machine slows all alike.
"""

import argparse
import json
import multiprocessing
import os
import resource
import shutil
import subprocess
import tempfile
import time
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

from designer.base.arrays import Array

for name in ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "NUMBA_NUM_THREADS", "MKL_NUM_THREADS"):
    os.environ[name] = "1"  # before NumPy is loaded

import cv2  # noqa: E402
import numpy as np  # noqa: E402

from calib.cameras import project  # noqa: E402
from calib.cameras.camera import Camera  # noqa: E402
from calib.core.se3 import transform  # noqa: E402
from calib.core.types import KnownPoints, Observations  # noqa: E402
from calib.solver.calibration import Calibration  # noqa: E402
from calib.solver.solve import solve  # noqa: E402
from tests.benchmarks.synthetic import row  # noqa: E402
from tests.support.solver_scenes import poses_around  # noqa: E402

SIZE = (2448, 2048)
CAMERA = Camera("opencv", np.array([2500.0, 2510, 1230, 1010, -0.12, 0.05, 4e-4, -3e-4, 0.01]), SIZE)
RATIONAL = Camera(
    "opencv8", np.array([2500.0, 2510, 1230, 1010, -0.12, 0.05, 4e-4, -3e-4, 0.01, 0.02, -0.01, 0.005]), SIZE
)
FISHEYE = Camera("fisheye", np.array([700.0, 702, 1230, 1010, -0.02, 0.01, -0.004, 0.0006]), SIZE)
OTHER_VIEWS, OTHER_GOAL, NEAR_MM = 120, 8.0, 130.0
SIDE, PITCH_MM, NOISE_PX = 21, 10.0, 0.05
TILT_DEG, DISTANCE_MM = 50.0, 380.0
VIEWS = (20, 50, 120, 200)
GOALS = {20: 10.0, 50: 10.0, 120: 15.0, 200: 15.0}
"""Times as fast as OpenCV."""
MEMORY_VIEWS, MEMORY_RINGS, MEMORY_GOAL_MB = 200, (50, 30), 200.0
MRCAL_SCRIPT = Path(__file__).with_name("mrcal_solve.py")


@dataclass(frozen=True, eq=False)
class Solution:
    """What a solver found."""

    seconds: float
    params: Array  # (9,) as OpenCV has them
    rms_px: float  # root mean square distance


def grid(columns: int, rows: int, pitch_mm: float) -> KnownPoints:
    """A plane grid, row by row, its middle the origin."""
    x, y = np.meshgrid(np.arange(columns) - (columns - 1) / 2, np.arange(rows) - (rows - 1) / 2)
    position = pitch_mm * np.stack([x.ravel(), y.ravel(), np.zeros(columns * rows)], axis=1)
    return KnownPoints(position, np.zeros(columns * rows, dtype=np.int64), np.array([[0.0, 0, 1, 0]]))


def scene(
    points: KnownPoints, views: int, seed: int = 0, camera: Camera = CAMERA, distance_mm: float = DISTANCE_MM
) -> Observations:
    """Views that show all points."""
    rng = np.random.default_rng(seed)
    poses, pixels = 0, []
    candidates = poses_around(4 * views, rng, half_angle_deg=TILT_DEG, distance_mm=distance_mm, aim_mm=15)
    for pose in candidates[rng.permutation(len(candidates))]:
        pixel = project(camera, transform(pose, points.position_mm))
        if poses < views and (pixel > 0).all() and (pixel < np.array(SIZE) - 1).all():
            pixels.append(pixel)
            poses += 1
    if poses < views:
        raise ValueError(f"only {poses} of {views} views show the whole board")
    measured = np.concatenate(pixels) + NOISE_PX * rng.standard_normal((views * len(points.position_mm), 2))
    count = len(points.position_mm)
    return Observations(
        SIZE, tuple(f"view{n}" for n in range(views)), np.repeat(np.arange(views), count),
        np.tile(np.arange(count), views), measured.astype(np.float32).astype(np.float64), None, points,
    )  # fmt: skip


def rms_of(residual: Array) -> float:
    """Root mean square length of residuals (M, 2)."""
    return float(np.sqrt((residual**2).sum(axis=1).mean()))


def ours(seen: Observations, model: str) -> tuple[Solution, Calibration]:
    """Our solver, from scratch, covariances included."""
    begin = time.perf_counter()
    found = solve(seen, model)
    return Solution(time.perf_counter() - begin, found.camera.params, rms_of(found.residual_px)), found


def opencv(seen: Observations) -> Solution:
    """cv2.calibrateCamera with its five coefficients."""
    count = len(seen.points.position_mm)
    pixel = list(seen.center_px.astype(np.float32).reshape(seen.view_count, count, 2))
    position = [seen.points.position_mm.astype(np.float32)] * seen.view_count
    begin = time.perf_counter()
    rms, matrix, lens, _, _ = cv2.calibrateCamera(position, pixel, seen.image_size, None, None)
    seconds = time.perf_counter() - begin
    return Solution(
        seconds, np.array([matrix[0, 0], matrix[1, 1], matrix[0, 2], matrix[1, 2], *lens.ravel()]), float(rms)
    )


def mrcal_python() -> str:
    """The Python that has mrcal, which Debian installs for its own; empty if there is none."""
    python = shutil.which("python3", path=os.defpath)
    if python is None:
        return ""
    probe = subprocess.run([python, "-c", "import mrcal"], capture_output=True, check=False, env=_clean_environment())
    return python if probe.returncode == 0 else ""


def mrcal(seen: Observations, python: str) -> Solution:
    """mrcal, by a script in its own Python; it times itself."""
    pixel = seen.center_px.reshape(seen.view_count, SIDE, SIDE, 2)
    weighted = np.concatenate([pixel, np.ones((seen.view_count, SIDE, SIDE, 1))], axis=3)
    with tempfile.TemporaryDirectory() as folder:
        source, target = Path(folder) / "in.npz", Path(folder) / "out.json"
        np.savez(
            source, observations=weighted, image_size=np.array(SIZE, dtype=np.int32), spacing_mm=PITCH_MM,
            focal_px=0.95 * CAMERA.params[0],
        )  # fmt: skip
        subprocess.run(
            [python, str(MRCAL_SCRIPT), str(source), str(target)], check=True, capture_output=True,
            env=_clean_environment(),
        )  # fmt: skip
        found = json.loads(target.read_text(encoding="utf-8"))
    return Solution(found["seconds"], np.array(found["params"]), found["rms_px"])


def _clean_environment() -> dict[str, str]:
    """This process's environment without what points Python to other packages."""
    return {key: value for key, value in os.environ.items() if not key.startswith("PYTHON") and key != "VIRTUAL_ENV"}


def times(views: int, rounds: int, python: str) -> None:
    """The table's rows for one number of views."""
    seen = scene(grid(SIDE, SIDE, PITCH_MM), views)
    solvers: dict[str, Callable[[], Solution]] = {
        "ours, opencv": lambda: ours(seen, "opencv")[0],
        "ours, luhmann": lambda: ours(seen, "luhmann")[0],
        "cv2.calibrateCamera": lambda: opencv(seen),
    }
    if python:
        solvers["mrcal"] = lambda: mrcal(seen, python)
    for work in list(solvers.values())[:2]:
        work()  # compile
    best: dict[str, Solution] = {}
    for _ in range(rounds):
        for name, work in solvers.items():
            found = work()
            if name not in best or found.seconds < best[name].seconds:
                best[name] = found
    first, sigma = best["ours, opencv"], np.sqrt(np.diag(ours(seen, "opencv")[1].param_covariance))
    print(f"{views} views x {SIDE * SIDE} rings")
    for name, one in best.items():
        ratio = one.seconds / first.seconds
        text = f"RMS {one.rms_px:.8f} px ({one.rms_px / first.rms_px - 1:+.1e})"
        if name.startswith(("cv2", "mrcal")):
            focal = np.abs(one.params[:4] / first.params[:4] - 1).max()
            off = np.abs((one.params - first.params) / sigma).max()
            text = f"x {ratio:.1f}; {text}, params {focal:.1e} (focal, centre), {off:.1e} sigma (all)"
        goal = f">= x {GOALS[views]:g}" if name == "cv2.calibrateCamera" else ""
        row(name, goal, f"{1e3 * one.seconds:.1f} ms", text)


def other_lenses(rounds: int) -> None:
    """Rows of lenses that OpenCV has by the same formula."""
    for camera, distance_mm in ((RATIONAL, DISTANCE_MM), (FISHEYE, NEAR_MM)):
        seen = scene(grid(SIDE, SIDE, PITCH_MM), OTHER_VIEWS, camera=camera, distance_mm=distance_mm)
        ours(seen, camera.model)  # compile
        found = [(ours(seen, camera.model)[0], opencv_as(camera, seen)) for _ in range(rounds)]
        mine, theirs = (min(one, key=lambda solution: solution.seconds) for one in zip(*found, strict=True))
        sigma = np.sqrt(np.diag(ours(seen, camera.model)[1].param_covariance))
        off = np.abs((theirs.params - mine.params) / sigma).max()
        text = f"x {theirs.seconds / mine.seconds:.1f}; RMS {theirs.rms_px:.8f} px, params {off:.1e} sigma (all)"
        row(f"ours, {camera.model}", "", f"{1e3 * mine.seconds:.1f} ms", f"RMS {mine.rms_px:.8f} px")
        row(f"cv2, {camera.model}", f">= x {OTHER_GOAL:g}", f"{1e3 * theirs.seconds:.1f} ms", text)


def opencv_as(camera: Camera, seen: Observations) -> Solution:
    """OpenCV's solution by the formula of a camera, its parameters in our order; its fisheye takes a guess."""
    count = len(seen.points.position_mm)
    pixel = list(seen.center_px.astype(np.float32).reshape(seen.view_count, count, 1, 2))
    position = [seen.points.position_mm.astype(np.float32)[:, None]] * seen.view_count
    begin = time.perf_counter()
    if camera is FISHEYE:
        flags = cv2.CALIB_RECOMPUTE_EXTRINSIC | cv2.CALIB_FIX_SKEW | cv2.CALIB_USE_INTRINSIC_GUESS
        width, height = seen.image_size
        focal = max(seen.image_size) / np.pi
        guess = np.array([[focal, 0, (width - 1) / 2], [0, focal, (height - 1) / 2], [0, 0, 1]])
        position = [one.transpose(1, 0, 2).astype(np.float64) for one in position]
        pixel = [one.transpose(1, 0, 2).astype(np.float64) for one in pixel]
        rms, matrix, lens, _, _ = cv2.fisheye.calibrate(
            position, pixel, seen.image_size, guess, np.zeros((4, 1)), flags=flags
        )
    else:
        flags = cv2.CALIB_RATIONAL_MODEL
        rms, matrix, lens, _, _ = cv2.calibrateCamera(position, pixel, seen.image_size, None, None, flags=flags)
    seconds = time.perf_counter() - begin
    linear = [matrix[0, 0], matrix[1, 1], matrix[0, 2], matrix[1, 2]]
    return Solution(seconds, np.array([*linear, *lens.ravel()[: len(camera.params) - 4]]), float(rms))


def memory() -> None:
    """The peak of a process that does nothing else, above what it holds after the imports."""
    rings = MEMORY_RINGS[0] * MEMORY_RINGS[1]
    for model in ("opencv", "luhmann"):
        with multiprocessing.get_context("spawn").Pool(1) as pool:
            compiled, data, peak, status = pool.apply(_memory_mb, (model,))
        parts = f"{compiled:.0f} with the kernels loaded, {data:.0f} with the data too; {status}"
        row(
            f"memory, {model}, {MEMORY_VIEWS} x {rings}, above the imports",
            f"<= {MEMORY_GOAL_MB:g} MB",
            f"{peak:.0f} MB",
            parts,
        )


def _memory_mb(model: str) -> tuple[float, float, float, str]:
    """Memory above that after the imports: once a small problem is solved, with the data, and at the peak; MB."""
    imported = _resident_mb()
    solve(scene(grid(5, 5, 40.0), 5), model)
    compiled = _resident_mb()
    seen = scene(grid(*MEMORY_RINGS, 200.0 / max(MEMORY_RINGS)), MEMORY_VIEWS)
    data = _resident_mb()
    found = solve(seen, model)
    peak = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024
    return compiled - imported, data - imported, peak - imported, found.status


def _resident_mb() -> float:
    """What this process holds now (Linux)."""
    pages = int(Path("/proc/self/statm").read_text(encoding="ascii").split()[1])
    return pages * resource.getpagesize() / 2**20


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--rounds", type=int, default=7, help="how often each solver runs (default 7)")
    rounds = parser.parse_args().rounds
    cv2.setNumThreads(1)
    python = mrcal_python()
    print(
        f"OpenCV {cv2.__version__}; "
        + ("mrcal of the system" if python else "no mrcal in the system's Python: left out")
    )
    for views in VIEWS:
        times(views, rounds, python)
    other_lenses(rounds)
    memory()


if __name__ == "__main__":
    main()
