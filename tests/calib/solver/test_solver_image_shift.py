"""A photo whose picture is shifted as a whole: its pose hides it, the solution names it."""

from dataclasses import replace

import numpy as np
import pytest

from calib.observe.observations import known_points
from calib.solver.calibration import Calibration
from calib.solver.problem import SolveOptions
from calib.solver.solve import solve
from tests.support.calibrations import board, camera, poses_around, seen_by

CAMERA = camera("opencv", (640, 480), 620.0)
TARGET = board(9, 7, "12mm")


def solved(
    photos: int, shift_px: tuple[float, float], model: str = "opencv", drawn: tuple[int, float] | None = None
) -> Calibration:
    """A solution of photos of which the third is shifted; drawn: a seed, and the noise in px."""
    rng = np.random.default_rng(photos if drawn is None else [photos, drawn[0]])
    seen = seen_by(CAMERA, known_points(TARGET), poses_around(photos, rng, distance_mm=220.0))
    off = np.where(seen.view == 2, 1.0, 0.0)[:, None] * shift_px
    noisy = replace(
        seen, center_px=seen.center_px + off + rng.normal(0, 0.03 if drawn is None else drawn[1], seen.center_px.shape)
    )
    return solve(noisy, model, SolveOptions())


@pytest.mark.parametrize("photos", [5, 20])
@pytest.mark.parametrize("shift_px", [(16.0, 0.0), (0.0, -16.0)])
def test_a_photo_shifted_by_a_block_is_named(photos: int, shift_px: tuple[float, float]) -> None:
    """By as much as it is, though no residual is larger than a few tenths of a pixel."""
    one = solved(photos, shift_px)
    assert np.hypot(*one.residual_px.T).max() < 1
    (remark,) = (line for line in one.remarks if "shifted" in line)
    assert remark.startswith(one.observations.view_names[2])
    told = np.array([float(word.strip(",")) for word in remark.split("about ")[1].split(" px")[0].split()])
    assert np.abs(told - shift_px).max() < 4


@pytest.mark.parametrize("photos", [4, 20])
@pytest.mark.parametrize("model", ["opencv", "pinhole"])
def test_sound_photos_are_not_blamed(photos: int, model: str) -> None:
    """Not where the model fits, nor where it leaves all of the lens over."""
    assert not [line for line in solved(photos, (0, 0), model).remarks if "shifted" in line]


@pytest.mark.parametrize(("photos", "seed"), [(4, 2), (4, 5), (5, 1)])
def test_few_photos_of_a_lens_that_is_left_over_blame_nobody(photos: int, seed: int) -> None:
    """A photo may stand far out of so few where a model without a lens is fitted; none of them is called shifted."""
    assert not [line for line in solved(photos, (0, 0), "pinhole", (seed, 0.3)).remarks if "shifted" in line]


@pytest.mark.parametrize(("photos", "seed"), [(5, 3), (6, 2), (8, 1)])
@pytest.mark.parametrize("shift_px", [(24.0, 0.0), (0.0, 60.0)])
def test_a_shift_is_put_on_its_own_photo_where_the_lens_is_left_over(
    photos: int, seed: int, shift_px: tuple[float, float]
) -> None:
    """Or on none: what the model leaves over hides shifts, it does not move them to another photo."""
    one = solved(photos, shift_px, "pinhole", (seed, 0.03))
    blamed = [line.split(":")[0] for line in one.remarks if "shifted" in line]
    assert blamed in ([], [one.observations.view_names[2]])
