"""Wide cameras of others, on photos that they were not solved from, beside published figures.

Run from the repository's root: `python -m tests.benchmarks.bench_wide_real [MODEL ...]`; needs the measurements beside
the project, in `../shared/real`. All is solved from nothing, every photo is to be used, and of the test photos only the
poses are found.

* `wide-ov-plane`: 18 photos to solve from, 7 to test. Published for the same split (fitted with a Huber loss of 1.5 px
  from a start near the answer): Kannala-Brandt .4746 px, double sphere .4796, extended unified .4797.
* `wide-figueroa`: every second photo to solve from, the others to test; the board is bent, which is an unknown, and
  corners have weights. mrcal 2.2 on the same kind of split: OPENCV8 .787 weighted RMS, .510 median; splined .794, .410
  in 51 s; bend -1.04 and .52 mm.
"""

import sys
import time
from pathlib import Path

import numpy as np

from calib.app.inputs import load_observations
from calib.cameras import fitted_models
from calib.core.types import Observations, keep_views
from calib.solver.metrics.errors import Errors, summarise
from calib.solver.metrics.evaluation import evaluate_on
from calib.solver.problem import SolveOptions
from calib.solver.solve import solve
from designer.base.errors import InputError

FOLDER = Path(__file__).parents[2].parent / "shared" / "real"
WIDE = ("fisheye", "thin_prism_fisheye", "ds", "eucm", "omni", "division", "opencv8", "opencv12", "splined")


def sets() -> tuple[tuple[str, Observations, Observations, bool], ...]:
    """Name, what is solved from, what is tested on, whether the bend is an unknown."""
    plane = FOLDER / "wide-ov-plane"
    corners = load_observations(FOLDER / "wide-figueroa" / "corners.csv")
    is_first = np.arange(corners.view_count) % 2 == 0
    return (
        ("ov-plane", load_observations(plane / "train.csv"), load_observations(plane / "test.csv"), False),
        ("figueroa", keep_views(corners, is_first), keep_views(corners, ~is_first), True),
    )


def row(name: str, train: Observations, test: Observations, model: str, *, free_bend: bool) -> str:
    """What came of one model on one set."""
    options = SolveOptions(free_bend=free_bend)
    try:
        solve(train, model, options)  # so that nothing is compiled in the time
        begin = time.perf_counter()
        solved = solve(train, model, options)
        seconds = time.perf_counter() - begin
        found = evaluate_on(solved, test, "test")
    except InputError as error:
        return f"{name:10}{model:20}{error}"
    errors: Errors | None = found.of("weighted") or found.of("reprojection")
    assert errors is not None
    told, used = summarise(errors), solved.observations.view_count + found.calibration.observations.view_count
    without = len(errors.size) - told.count
    bend = solved.target_bend
    said = "" if bend is None else "   bend {:.3f}, {:.3f} mm".format(*bend.height_mm)
    return (
        f"{name:10}{model:20}{told.rmse:8.4f}{told.median:9.4f}{without:8d}{int(solved.is_outlier.sum()):8d}"
        f"{used:5d} of {train.view_count + test.view_count}{seconds:8.2f} s{said}"
    )


def main() -> None:
    """Print a row for each set and model."""
    if not FOLDER.is_dir():
        print(f"{FOLDER}: absent; nothing to do")
        return
    models = sys.argv[1:] or [model for model in WIDE if model in fitted_models()]
    print(f"{'set':10}{'model':20}{'RMS':>8}{'median':>9}{'no px':>8}{'not fit':>8}   photos    time")
    for name, train, test, free_bend in sets():
        for model in models:
            print(row(name, train, test, model, free_bend=free_bend), flush=True)


if __name__ == "__main__":
    main()
