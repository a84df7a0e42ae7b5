"""Sigmas that are wrong by different amounts: told by the residuals, weighed and stated rightly."""

from dataclasses import replace

import numpy as np
import pytest

from calib.core.types import Observations
from calib.solver.problem import SolveOptions
from calib.solver.solve import solve
from designer.base.arrays import Array
from tests.support.solver_scenes import CAMERAS, icosahedron, observe, poses_around

TRUE = CAMERAS["opencv"]
RUNS = 16


def _seen(seed: int, power: float) -> tuple[Observations, Array]:
    """Sightings with sigmas from .01 to .1 px, whose errors are as large as that power of them; and these errors."""
    rng = np.random.default_rng(seed)
    seen = observe(TRUE, icosahedron(), poses_around(6, rng), rng)
    sigma = 0.03 * np.exp(rng.uniform(-1.1, 1.1, len(seen.view)))
    error = (0.03 * (sigma / 0.03) ** power)[:, None] * rng.standard_normal((len(sigma), 2))
    cov = sigma[:, None, None] ** 2 * np.eye(2)
    return replace(seen, center_px=seen.center_px + error, cov_px2=cov), error


def _in_sigmas(seed: int, power: float, options: SolveOptions) -> tuple[float, float, float]:
    """Errors of the sightings with the smallest and the largest sigmas, and of the camera, in sigmas as solved."""
    seen, error = _seen(seed, power)
    assert seen.cov_px2 is not None
    solved = solve(seen, "opencv", options)
    assert solved.observations.cov_px2 is not None
    square = (error**2).sum(axis=1) / (solved.scale**2 * solved.observations.cov_px2[:, 0, 0]) / 2
    size = seen.cov_px2[:, 0, 0]
    off = solved.camera.params - TRUE.params
    camera = float(off @ np.linalg.solve(solved.param_covariance, off)) / len(off)
    few = np.quantile(size, [0.25, 0.75])
    return float(np.sqrt(square[size < few[0]].mean())), float(np.sqrt(square[size > few[1]].mean())), camera


@pytest.mark.parametrize("power", [0.0, 0.5, 1.5])
def test_sigmas_wrong_by_different_amounts_are_stated_rightly(power: float) -> None:
    """Small and large ones then scatter by one, and so does the camera; with one factor for all neither does."""
    small, large, camera = np.mean([_in_sigmas(seed, power, SolveOptions()) for seed in range(RUNS)], axis=0)
    assert 0.93 < small < 1.07
    assert 0.93 < large < 1.07
    assert 0.7 < camera < 1.35


def test_sigmas_that_are_right_stand() -> None:
    """Nothing is changed where errors are as stated, nor where weights are not to count or losses forgive."""
    right = [_seen(seed, 1.0)[0] for seed in range(RUNS)]
    changed = [not np.array_equal(solve(seen, "opencv").observations.cov_px2, seen.cov_px2) for seen in right]
    assert sum(changed) <= 1
    wrong = _seen(0, 0.0)[0]
    for options in (SolveOptions(weighted=False), SolveOptions(loss="huber")):
        assert solve(wrong, "opencv", options).observations.cov_px2 is wrong.cov_px2
