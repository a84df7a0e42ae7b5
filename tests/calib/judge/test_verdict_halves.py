"""Whether halves of the views tell honest standard deviations from others."""

from dataclasses import replace

import numpy as np
import pytest

from calib.cameras.camera import Camera
from calib.core.types import Observations
from calib.judge.coverage import Coverage, coverage_of
from calib.judge.difference import Known, apart, in_sigmas
from calib.judge.halves import Halves, NoHalves, half_split, halves_apart, splits
from calib.solver.calibration import Calibration
from tests.support.solver_scenes import observe, poses_around
from tests.support.verdict_cases import BOARD, ICOSAHEDRON, OPTIONS, TRUE, sightings, solved


def _ratio(seen: Observations) -> float:
    one = solved(seen)[0]
    halves = half_split(one, OPTIONS)
    assert isinstance(halves, Halves)
    found = halves_apart(halves, coverage_of(one))
    return found.ratio


def test_the_ratio_is_about_one_for_noise() -> None:
    """With honest noise the root mean square of the ratio is 1, whatever the target, and 2 is not reached."""
    ratios = [_ratio(sightings(seed=seed, views=8)) for seed in range(8)]
    ratios += [_ratio(sightings(ICOSAHEDRON, seed=seed, views=8, distance_mm=400)) for seed in range(4)]
    assert 0.75 < np.sqrt(np.mean(np.square(ratios))) < 1.3
    assert max(ratios) < 2


def test_errors_that_go_together_in_a_view_are_found() -> None:
    """A bend of its own in each photo leaves residuals that are no independent noise: the halves differ too much."""
    seen = sightings(views=12)
    bend = np.random.default_rng(4).normal(0, 0.3, seen.view_count)
    off = (seen.center_px - np.array(seen.image_size) / 2) / max(seen.image_size)
    shift = bend[seen.view, None] * off * np.linalg.norm(off, axis=1, keepdims=True) * 10
    assert _ratio(replace(seen, center_px=seen.center_px + shift)) > 2


def test_too_few_photos_are_not_halved() -> None:
    """Three photos have no halves; the reason says so."""
    found = half_split(solved(sightings(views=3))[0], OPTIONS)
    assert isinstance(found, NoHalves)
    assert "3 photos" in found.reason


def test_halves_that_determine_nothing_are_no_halves() -> None:
    """Photos of a board seen straight on do not tell focal length from distance, and half of them even less."""
    rng = np.random.default_rng(0)
    seen = observe(TRUE, BOARD, poses_around(4, rng, half_angle_deg=0.5), rng, noise_px=0.2)
    found = half_split(replace(solved(seen)[0], status="converged"), OPTIONS)
    assert isinstance(found, NoHalves)
    assert "half of the photos" in found.reason


@pytest.fixture(scope="module")
def calibration() -> Calibration:
    """A solution to be halved and moved."""
    return solved(sightings(views=11))[0]


def test_splits_are_fair_and_different(calibration: Calibration) -> None:
    """Each split has halves of the same size, or one more, and no two splits are the same."""
    found = splits(calibration)
    assert len(found) == 4
    for one in found:
        assert abs(int(one.sum()) - int((~one).sum())) <= 1
    assert len({frozenset({one.tobytes(), (~one).tobytes()}) for one in found}) == 4


def test_splits_follow_the_views_not_their_order(calibration: Calibration) -> None:
    """Views in another order are shared out alike."""
    order = np.random.default_rng(0).permutation(11)
    place = np.argsort(order)
    seen = calibration.observations
    rows = np.argsort(place[seen.view], kind="stable")
    moved = replace(
        seen, view_names=tuple(seen.view_names[n] for n in order), view=place[seen.view][rows],
        point=seen.point[rows], center_px=seen.center_px[rows],
    )  # fmt: skip
    again = replace(calibration, observations=moved, cam_from_target=calibration.cam_from_target[order])

    def named(one: Calibration) -> set[frozenset[frozenset[str]]]:
        names = np.array(one.observations.view_names)
        return {frozenset({frozenset(names[half]), frozenset(names[~half])}) for half in splits(one)}

    assert named(calibration) == named(again)


def test_the_stated_difference_is_that_of_drawn_parameters(calibration: Calibration) -> None:
    """Cameras drawn from the covariance lie one standard deviation apart, on average over many draws."""
    covered = coverage_of(calibration)
    rng, ratios = np.random.default_rng(1), []
    nothing = np.zeros_like(calibration.param_covariance)
    for step in rng.multivariate_normal(np.zeros(9), calibration.param_covariance, 40):
        drawn = replace(calibration.camera, params=calibration.camera.params + step)
        found = apart(Known(drawn, nothing), Known(calibration.camera, calibration.param_covariance), covered)
        ratios.append(found.ratio)
    assert np.sqrt(np.mean(np.square(ratios))) == pytest.approx(1, abs=0.2)


def test_a_camera_is_not_apart_from_itself(calibration: Calibration) -> None:
    """No difference, of no standard deviations; and nothing is said where nothing was seen."""
    one = Known(calibration.camera, calibration.param_covariance)
    found = apart(one, one, coverage_of(calibration))
    assert found.percentile_95_px == pytest.approx(0, abs=1e-9)
    assert found.ratio == pytest.approx(0, abs=1e-6)
    assert np.isnan(found.length_px[~found.is_covered]).all()


def test_a_shift_of_the_principal_point_is_hardly_a_difference() -> None:
    """A camera whose principal point is off by a pixel shows the same after a turn: what remains is far below it."""
    plain = Camera("pinhole", np.array([2500.0, 2500, 1223.5, 1023.5]), TRUE.image_size)
    moved = replace(plain, params=plain.params + np.array([0, 0, 1.0, 0]))
    whole = Coverage(TRUE.image_size, np.ones((134, 160), dtype=np.int64), (), np.ones((134, 160), dtype=bool))
    nothing = np.zeros((4, 4))
    found = apart(Known(plain, nothing), Known(moved, nothing), whole)
    assert 0 < found.percentile_95_px < 0.3


def test_in_sigmas_is_one_for_what_was_drawn() -> None:
    """Vectors drawn from their covariances are one standard deviation long; what cannot vary is left out."""
    rng = np.random.default_rng(2)
    root = rng.normal(0, 1, (4000, 2, 2))
    covariance = root @ root.transpose(0, 2, 1)
    drawn = (root @ rng.standard_normal((4000, 2, 1)))[:, :, 0]
    assert in_sigmas(drawn, covariance) == pytest.approx(1, abs=0.03)
    assert in_sigmas(3 * drawn, covariance) == pytest.approx(3, abs=0.1)
    flat = np.tile(np.diag([4.0, 0.0]), (4000, 1, 1))
    assert in_sigmas(2 * rng.standard_normal((4000, 2)) * [1, 0], flat) == pytest.approx(1, abs=0.05)


def test_views_left_out_stay_out() -> None:
    """Outliers that the solution left out are not given to the halves."""
    seen = sightings(views=8)
    pixel = seen.center_px.copy()
    pixel[::40] += 30.0
    spoilt = replace(solved(seen)[0], observations=replace(seen, center_px=pixel))
    is_outlier = np.zeros(len(pixel), dtype=bool)
    is_outlier[::40] = True
    halves = half_split(replace(spoilt, is_outlier=is_outlier), OPTIONS)
    for pair in halves.pairs:
        for half in pair:
            assert abs(half.known.camera.params[0] - TRUE.params[0]) < 5
            assert len(half.view_names) == 4
