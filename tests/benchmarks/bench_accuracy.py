"""The paper's synthetic study beside ours: 120 photos of its board and icosahedron, detected and solved.

`python -m tests.benchmarks.bench_accuracy [FOLDER]`; rendered photos stay in FOLDER and are used again.

The paper (Table 2, 120 images) states the means of 10,000 bootstrap samples; ours are one solution of all photos.
`binary` renders as the paper does, one ray a pixel, black or white; `area` is what a good camera delivers:
anti-aliased, a blur of 0.7 px, noise of a hundredth of the contrast.
"""

import os
import sys
import tempfile
from collections.abc import Sequence
from pathlib import Path

import numpy as np

from calib.core.types import Observations, keep_views
from calib.renderer.truth import TRUTH, Truth
from calib.solver.metrics.errors import summarise
from calib.solver.metrics.evaluation import evaluate
from calib.solver.problem import SolveOptions
from calib.solver.solve import solve
from calib.studies.paper_study import (
    PhotoSet,
    incidence_deg,
    only,
    paper_targets,
    photograph,
    photos_in,
    search,
    sightings,
)
from designer.target import TargetGeometry

VIEWS = 120
METRICS = ("reprojection", "intersection", "reconstruction", "pose")
PAPER = {"board": (0.125, 0.0432, 0.0040, 0.058), "icosahedron": (0.135, 0.0257, 0.0110, 0.078)}
GOAL = (0.005, 0.0015, float("nan"), 0.005)


def nobody(done: int) -> None:
    """Progress that is not shown."""


def study(target: TargetGeometry, photos: PhotoSet, folder: Path, weightings: Sequence[bool]) -> None:
    """Detect, solve, detect again with the camera, solve and evaluate; print a line each."""
    jobs = os.cpu_count() or 1
    photograph(photos, target, folder, jobs=jobs, tell=nobody)
    truth = TRUTH.read(folder / "truth.json")
    found = photos_in(folder)
    unaided = sightings(search(target, found, None, jobs=jobs, tell=nobody), target, folder)
    camera = solve(unaided, "opencv").camera
    seen = sightings(search(target, found, camera, jobs=jobs, tell=nobody), target, folder)
    angle = incidence_deg(seen, truth)
    for limit in (75.0, 90.0):
        for weighted in weightings:
            calibration = solve(only(seen, angle <= limit), "luhmann", SolveOptions(weighted=weighted))
            evaluation = evaluate(calibration, truth)
            found = [summarise(errors).rmse if (errors := evaluation.of(metric)) else np.nan for metric in METRICS]
            mean_pose = summarise(pose).mean if (pose := evaluation.of("pose")) else np.nan
            ratio = [paper / value for paper, value in zip(PAPER[photos.target], found, strict=True)]
            print(
                f"{photos.target:12} {photos.sampling:7} {f'<= {limit:.0f} deg' if limit < 90 else 'all':10} "
                f"{'weighted' if weighted else 'alike':9}"
                + "".join(f"{value:9.5f} ({times:5.1f}x)" for value, times in zip(found, ratio, strict=True))
                + f"  mean pose {mean_pose:.5f}  {len(calibration.observations.view)} sightings"
            )
    sys.stdout.flush()
    if len(target.target_from_face) > 1 and photos.sampling == "area":
        alone(unaided, truth)


def alone(seen: Observations, truth: Truth) -> None:
    """Each photo on its own, detected without a camera: the focal length, and whether its sigma covers its error."""
    true_px = truth.camera.params[0]
    for weighted in (False, True):
        errors, sigmas = [], []
        for view in range(seen.view_count):
            photo = keep_views(seen, np.arange(seen.view_count) == view)
            calibration = solve(photo, "luhmann", SolveOptions(weighted=weighted))
            errors.append(calibration.camera.params[0] - true_px)
            sigmas.append(np.sqrt(calibration.param_covariance[0, 0]))
        error, sigma = np.abs(errors), np.array(sigmas)
        part = error / true_px
        print(
            f"one photo alone, {'weighted' if weighted else 'alike'}: focal length off by {np.median(part):.4%} "
            f"(median), {np.quantile(part, 0.95):.4%} (95 %), {part.max():.4%} (worst of {len(part)}); "
            f"within .05 %: {(part < 5e-4).mean():.0%}; within 1, 2, 3 sigma: "
            + ", ".join(f"{(error < k * sigma).mean():.0%}" for k in (1, 2, 3))
        )


def main() -> None:
    """All sets of both targets."""
    print(f"luhmann model, {VIEWS} photos; in brackets: the paper's error over ours")
    print(f"{'':42}" + "".join(f"{name:>18}" for name in METRICS))
    with tempfile.TemporaryDirectory() as scratch:
        root = Path(sys.argv[1]) if len(sys.argv) > 1 else Path(scratch)
        for name, target in paper_targets().items():
            print(f"{name:12} {'paper':38}" + "".join(f"{value:9.5f}         " for value in PAPER[name]))
            for sampling in ("area", "binary"):
                photos = PhotoSet(name, sampling, VIEWS)
                study(target, photos, root / photos.name, (False, True))
    print(f"goal (area, <= 75 deg): {', '.join(f'{n} {g:g}' for n, g in zip(METRICS, GOAL, strict=True))}")


if __name__ == "__main__":
    main()
