"""Image axes that are not square to each other."""

import numpy as np
import pytest

from calib.cameras.camera import Camera
from calib.solver.solve import solve
from tests.support.solver_scenes import CAMERAS, SIZE, board, observe, poses_around, sigma_of


@pytest.mark.parametrize("lens", ["opencv", "luhmann"])
def test_photos_tell_the_skew(lens: str) -> None:
    """As surely as is stated, and the noise is found; without the skew it would be told too large."""
    true = Camera(f"{lens}_skew", np.append(CAMERAS[lens].params, 3.0), SIZE)
    poses = poses_around(8, np.random.default_rng(99), half_angle_deg=35)
    seen = observe(true, board(9, 7), poses, np.random.default_rng(1), noise_px=0.05)
    found = solve(seen, true.model)
    sigma = sigma_of(found.param_covariance)
    assert sigma[-1] < 0.1
    assert (np.abs(found.camera.params - true.params) < 4 * sigma).all()
    assert found.scale == pytest.approx(0.05, rel=0.1)
    assert solve(seen, lens).scale > 1.4 * found.scale
