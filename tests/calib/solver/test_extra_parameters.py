"""Parameters that a solution did not have, told from its residuals, against solutions with and without them."""

from dataclasses import replace

import numpy as np

from calib.core.types import Observations
from calib.solver.free_shape import extra_parameters
from calib.solver.problem import SolveOptions
from calib.solver.solve import solve
from designer.base.arrays import Array
from tests.support.solver_scenes import CAMERAS, SIZE, board, noisy, observe, poses_around

TRUE = CAMERAS["opencv"]
NOISE_PX = 0.02
ACROSS = np.array([1.0, 0.0])
AMOUNT_PX = 0.3


def _seen() -> Observations:
    rng = np.random.default_rng(0)
    return observe(TRUE, board(), poses_around(16, rng), rng)


def _by_row(seen: Observations) -> Array:
    """A shift across, from one end of the image to the other by a unit.  # (M, 2, 1)"""
    return ((seen.center_px[:, 1:] - SIZE[1] / 2) / SIZE[1] * ACROSS)[:, :, None]


def test_what_was_left_out_is_told_with_its_deviation_and_what_it_did_to_the_camera() -> None:
    """The estimate is right within its deviation, and the camera is moved by as much as is told."""
    seen = _seen()
    by_row = _by_row(seen)
    off, moved = [], []
    for seed in range(6):
        noise = noisy(seen, NOISE_PX, np.random.default_rng(seed))
        faulty = replace(noise, center_px=noise.center_px + AMOUNT_PX * by_row[:, :, 0])
        without, solved = (solve(one, "opencv", SolveOptions()) for one in (noise, faulty))
        found = extra_parameters(solved, by_row)
        assert found is not None
        off.append((found.amplitude[0] - AMOUNT_PX) / found.sigma[0])
        moved.append((solved.camera.params - without.camera.params) / (AMOUNT_PX * found.taken[:, 0]))
    assert 0.3 < np.sqrt(np.mean(np.square(off))) < 1.8
    np.testing.assert_allclose(np.median(moved, axis=0)[[0, 1, 3]], 1.0, atol=0.15)


def test_what_centres_of_a_photo_share_makes_the_deviation_wider() -> None:
    """Photos that each have an amount of their own say less of the mean than as many independent centres."""
    seen, rng = _seen(), np.random.default_rng(1)
    by_row = _by_row(seen)
    amount = 0.5 * rng.standard_normal(seen.view_count)[seen.view, None]
    solved = solve(replace(noisy(seen, NOISE_PX, rng), center_px=seen.center_px + amount * by_row[:, :, 0]), "opencv")
    found = extra_parameters(solved, by_row)
    assert found is not None
    assert found.spread[0] > 4
    assert 0.5 / np.sqrt(seen.view_count) / 2.5 < found.sigma[0] < 2.5 * 0.5 / np.sqrt(seen.view_count)


def test_what_camera_or_poses_take_up_whole_is_told_by_nothing() -> None:
    """A shift of every photo by the same is the principal point's: no amplitude, a deviation without bound."""
    seen = _seen()
    solved = solve(noisy(seen, NOISE_PX, np.random.default_rng(0)), "opencv", SolveOptions())
    found = extra_parameters(solved, np.tile(ACROSS[:, None], (len(seen.view), 1, 1)))
    assert found is not None
    assert found.amplitude[0] == 0
    assert np.isinf(found.sigma[0])
    np.testing.assert_allclose(found.taken[:4, 0], [0, 0, 1, 0], atol=1e-3)
