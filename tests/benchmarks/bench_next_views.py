"""What the proposed photos are worth: the deviation they leave against that of random photos like those taken so far.

`python -m tests.benchmarks.bench_next_views`

Each camera is solved from simulated photos with the target around the middle of the image. Then 1, 2 and 4 photos are
added: the proposed ones, and ten sets of random ones drawn like the first. All are solved; printed are what 95 % of the
image stays within, as predicted and as solved, the median of the random sets, and the ratio.
"""

import time
from dataclasses import replace

import numpy as np

from calib.cameras.refit import image_grid
from calib.core.types import KnownPoints, Observations, without_empty_views
from calib.judge.next_views import next_views
from calib.solver.accuracy import projected_sigma_px, share_px
from calib.solver.calibration import Calibration
from calib.solver.solve import solve
from designer.base.arrays import Array
from tests.support.solver_scenes import CAMERAS, NOISE_PX, board, icosahedron, observe, poses_around

TARGETS: dict[str, tuple[KnownPoints, float]] = {
    "board 20 x 16": (board(20, 16, 10.0), 450.0),
    "icosahedron, 720 rings": (icosahedron(80.0, 8), 350.0),
}
PHOTOS, SETS = 10, 10
ADDED = (1, 2, 4)
AIM_MM = 25.0
INCIDENCE_DEG = 70.0


def poses_like(count: int, distance_mm: float, rng: np.random.Generator) -> Array:
    """Poses (V, 4, 4) as a person takes photos who keeps the target around the middle."""
    return poses_around(count, rng, half_angle_deg=40.0, distance_mm=distance_mm, aim_mm=AIM_MM)


def added(first: Observations, more: Observations) -> Observations:
    """Two sets of photos as one."""
    return without_empty_views(
        replace(
            first,
            view_names=(*first.view_names, *(f"next_{name}" for name in more.view_names)),
            view=np.concatenate([first.view, more.view + first.view_count]),
            point=np.concatenate([first.point, more.point]),
            center_px=np.concatenate([first.center_px, more.center_px]),
        )
    )


def sigma_px(calibration: Calibration, noise_px: float) -> float:
    """What 95 % of the image stays within, for the same noise in all solutions."""
    pixel = image_grid(calibration.camera.image_size).reshape(-1, 2)
    found = projected_sigma_px(calibration.camera, calibration.param_covariance, pixel)
    return share_px(found) * noise_px / calibration.scale


def compare(name: str, model: str, seed: int) -> list[float]:
    """Print a line; return the ratios."""
    points, distance_mm = TARGETS[name]
    rng = np.random.default_rng(seed)
    camera = CAMERAS[model]

    def look(poses: Array) -> Observations:
        return observe(camera, points, poses, rng, noise_px=NOISE_PX, incidence_deg=INCIDENCE_DEG)

    first = look(poses_like(PHOTOS, distance_mm, rng))
    calibration = solve(first, model)
    begin = time.perf_counter()
    views = next_views(calibration)
    seconds = time.perf_counter() - begin
    cells, ratios = [], []
    for count in (n for n in ADDED if n <= len(views)):
        poses = np.stack([view.cam_from_target for view in views[:count]])
        chosen = sigma_px(solve(added(first, look(poses)), model), NOISE_PX)
        others = [
            sigma_px(solve(added(first, look(poses_like(count, distance_mm, rng))), model), NOISE_PX)
            for _ in range(SETS)
        ]
        random = float(np.median(others))
        ratios.append(random / chosen)
        predicted = views[count - 1].sigma_px_after
        cells.append(f"{count}: {predicted:.3f} -> {chosen:.3f} / {random:.3f} = {ratios[-1]:.1f}")
    before = sigma_px(calibration, NOISE_PX)
    print(f"{name:24}{model:9}{before:8.3f}  {seconds:5.2f} s  " + "   ".join(cells))
    return ratios


def main() -> None:
    """All targets and models, three draws each."""
    print("95 % sigma in px; photos added: predicted -> solved / random = ratio")
    ratios = [
        ratio for name in TARGETS for model in ("opencv", "luhmann", "pinhole") for seed in range(3)
        for ratio in compare(name, model, seed)
    ]  # fmt: skip
    print(
        f"random over proposed: {np.median(ratios):.1f} (median), {min(ratios):.1f} (least), {max(ratios):.1f} (most)"
    )


if __name__ == "__main__":
    main()
