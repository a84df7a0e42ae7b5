"""Lenses so long that perspective is faint: right within what is stated, or a word on what to fix."""

import numpy as np
import pytest

from calib.cameras.camera import Camera
from calib.core.types import Observations
from calib.solver.solve import solve
from tests.support.solver_scenes import board, noisy, observe, poses_around

SIZE, NOISE_PX = (1280, 1024), 0.05


def _seen(focal_px: float, seed: int) -> Observations:
    """A dozen photos of a tilted board that fills a good part of the image."""
    rng = np.random.default_rng(seed)
    camera = Camera("pinhole", np.array([focal_px, focal_px, 652.0, 499.0]), SIZE)
    poses = poses_around(12, rng, distance_mm=focal_px / 3, half_angle_deg=45)
    return observe(camera, board(9, 7, 30.0), poses, rng, noise_px=NOISE_PX)


@pytest.mark.parametrize("focal_px", [2e4, 6e4, 1e5])
def test_a_long_lens_is_found_or_what_to_fix_is_said(focal_px: float) -> None:
    """The two poses of a plane that a far camera sees alike are told apart by the focal length, and it by them."""
    for seed in range(4):
        found = solve(_seen(focal_px, seed), "opencv")
        sigma = np.sqrt(np.diagonal(found.param_covariance))
        assert abs(found.camera.params[0] - focal_px) < 3.5 * sigma[0]
        if found.status != "converged":
            assert "--fix cx_px=639.5,cy_px=511.5,k1=0" in found.remarks[0]


def test_parallel_rays_are_called_so() -> None:
    """Without any perspective no camera is stated, and it is said what shows no perspective and what to do."""
    seen = _seen(1e8, 3)
    found = solve(seen, "opencv")
    assert found.status == "degenerate"
    assert "telecentric lens, which no model here holds" in found.remarks[0]
    assert "telecentric" not in " ".join(solve(noisy(_seen(2e4, 1), 1.0, np.random.default_rng(0)), "opencv").remarks)
