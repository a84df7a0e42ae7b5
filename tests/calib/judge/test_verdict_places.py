"""Places of the image that captions name are those where something is known, and numbers of one screen are one."""

from dataclasses import replace

import numpy as np
import pytest

from calib.cameras.camera import Camera
from calib.cameras.refit import image_grid
from calib.draw.sigma_map import place_on_map, sigma_map
from calib.judge.apart import Known, sigma_over
from calib.judge.checks import OWN_ROTATION
from calib.judge.coverage import coverage_of
from calib.solver.solve import solve
from tests.support.solver_scenes import CAMERAS
from tests.support.verdict_cases import check, judged, sightings

SIZE = (1000, 800)
GRID = image_grid(SIZE, 41, 33)


@pytest.mark.parametrize(
    ("at", "lost", "words"),
    [
        ((32, 0), None, "in the bottom left corner"),
        ((30, 2), None, "in the bottom left corner"),
        ((30, 2), (slice(31, 33), slice(0, 2)), "towards the bottom left"),
        ((25, 8), None, "towards the bottom left"),
        ((16, 39), None, "at the right edge"),
        ((16, 39), (slice(None), slice(40, 41)), "towards the right"),
        ((3, 20), (slice(0, 2), slice(None)), "towards the top"),
        ((16, 20), (slice(0, 2), slice(None)), "in the middle"),
    ],
)
def test_a_corner_is_named_only_if_something_is_known_there(
    at: tuple[int, int], lost: tuple[slice, slice] | None, words: str
) -> None:
    """What lies short of a corner or an edge, or where the map ends before it, is only towards it."""
    is_known = np.ones(GRID.shape[:2], dtype=bool)
    if lost is not None:
        is_known[lost] = False
    assert place_on_map(GRID, is_known, at, SIZE) == words


def test_a_lens_that_breaks_down_is_known_in_one_share_of_the_image() -> None:
    """The share on the map is that of the verdict's sentence, and the worst place is short of the grey."""
    calibration = solve(sightings(views=12), "opencv")
    params = calibration.camera.params.copy()
    params[4:] = [-1.1, 0.0, 0.0, 0.0, 0.0]
    folded = Camera("opencv", params, CAMERAS["opencv"].image_size)
    found = sigma_map(replace(calibration, camera=folded))
    assert 0.3 < found.known_share < 0.95
    assert np.isnan(found.sigma_px[0, 0])
    assert found.worst_place.startswith("towards")
    assert found.known_share == pytest.approx(np.isfinite(found.sigma_px).mean(), abs=0.03)


def test_the_number_of_the_covered_area_says_which_rotation_was_removed() -> None:
    """The number of the image is that of the map; that of the covered area is said to have its own rotation removed."""
    seen = sightings(views=12)
    calibration = solve(seen, "opencv")
    said = check(judged(seen), "uncertainty")
    assert said.value == pytest.approx(sigma_map(calibration).most_px)
    covered = coverage_of(calibration)
    inside = np.percentile(sigma_over(Known(calibration.camera, calibration.param_covariance), covered), 95)
    assert f"{inside:.2g} px ({OWN_ROTATION})" in said.sentence
