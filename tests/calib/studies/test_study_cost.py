"""Which distances to minimise: the study of costs."""

import json
import math
from dataclasses import replace
from functools import cache
from pathlib import Path

import numpy as np
import pytest

from calib.app.study_cost import study_cost
from calib.cameras.camera import Camera
from calib.core.se3 import exp_rotation
from calib.solver.costs import COSTS, IMAGE
from calib.solver.problem import SolveOptions
from calib.solver.solve import solve
from calib.studies.compare.scene import ComparedScene, make_target, photograph, scene_of, stream
from calib.studies.cost.estimates import (
    ESTIMATORS,
    MEASURES,
    START_VALUES,
    VALUES,
    WEIGHTED,
    WIDEST_FOCAL,
    CostPool,
    RealPool,
    StartPool,
    bad_start,
    held_out,
    pose_error_mm,
    solved_by_all,
)
from calib.studies.cost.ratios import FEWEST, SETTINGS, CostPlan, cases_of, cost_rows, identity, scene_named, start_rows
from calib.studies.samples import Case, Samples, StoredCase
from designer.base.errors import InputError

CAMERA = Camera("opencv", np.array([790.0, 790.0, 979.0, 546.0, -0.1, 0.01, 0.0, 0.0, 0.0]), (1920, 1080))
NAMES = [one.name for one in ESTIMATORS]


@cache
def scene() -> ComparedScene:
    """A board before a camera, from near and from farther away; few photos."""
    return replace(scene_of("board", make_target("3d-board"), CAMERA, 8), farthest=2.0)


def samples_of(values: np.ndarray, names: tuple[str, ...] = VALUES) -> Samples:
    """Samples with these values."""
    count = len(values)
    return Samples(
        StoredCase(Case("board", 8, 8, "as drawn"), "cost", len(names), np.zeros((0, 0))), np.arange(count),
        np.full(count, "converged"), np.full(count, 8), np.full((count, 4), np.nan), values, np.zeros(count, np.int64),
        ("",) * count,
    )  # fmt: skip


@pytest.mark.parametrize("estimator", ESTIMATORS, ids=NAMES)
def test_the_true_camera_has_no_errors_in_perfect_photos(estimator: object) -> None:
    """Whatever a pose minimises over half of the rings, the others lie on their rays."""
    one = next(known for known in ESTIMATORS if known is estimator)
    seen, _ = photograph(scene(), scene().target.center_mm, np.random.default_rng(1), 3, 0.0)
    assert max(held_out(CAMERA, one, seen)) < 1e-7


def test_errors_held_out_are_those_of_the_camera_and_the_noise() -> None:
    """A known displacement of the other half of the rings comes out in px, and over the range in mm."""
    seen, poses = photograph(scene(), scene().target.center_mm, np.random.default_rng(1), 2, 0.0)
    pixel = np.array(seen.center_px)
    pixel[1::2] += (0.3, -0.4)
    off_px, off_mm = held_out(CAMERA, ESTIMATORS[0], replace(seen, center_px=pixel))
    assert off_px == pytest.approx(0.5, rel=1e-4)
    far_mm = np.linalg.norm(poses[:, :3, 3], axis=1)
    assert 0.5 * far_mm.min() / 900 < off_mm < 0.5 * far_mm.max() / 500  # 790 px a radian, more off the axis
    moved = poses.copy()
    moved[:, :3, :3] = exp_rotation(np.array([0.0, 0.0, 0.1])) @ moved[:, :3, :3]
    moved[:, :3, 3] = (exp_rotation(np.array([0.0, 0.0, 0.1])) @ moved[:, :3, 3, None])[:, :, 0]
    assert pose_error_mm(moved, poses) < 1e-9  # a turn of the camera about itself leaves it where it is
    moved[:, :3, 3] += (3.0, 0.0, 4.0)
    assert pose_error_mm(moved, poses) == pytest.approx(5.0)


def test_all_costs_see_the_same_photos() -> None:
    """Without noise beyond the detector's whitened distances give the image's errors, and outliers cost all of them."""
    plain, outlying, robust = (
        np.array(CostPool(scene(), None, has, loss).sample(1, 0).params).reshape(-1, len(MEASURES))
        for has, loss in ((False, "squares"), (True, "squares"), (True, "huber"))
    )
    assert np.isfinite(plain).all()
    np.testing.assert_allclose(plain[NAMES.index("whitened")], plain[0], rtol=5e-3)
    assert (outlying[:, 2] > 1.02 * plain[:, 2]).all()
    assert (robust[:, 2] < outlying[:, 2]).all()


def test_the_study_solves_as_everybody() -> None:
    """Its shorter way gives the cameras and poses of `solve`."""
    seen, _ = photograph(scene(), scene().target.center_mm, stream(1, "x"), 6)
    for found in solved_by_all(seen, "opencv", "squares", []):
        one = found.estimator
        same = solve(seen, "opencv", SolveOptions(weighted=one.weighted, minimise=one.minimise))
        np.testing.assert_allclose(found.camera.params, same.camera.params, rtol=1e-7, atol=1e-7)
        np.testing.assert_allclose(found.cam_from_target, same.cam_from_target, rtol=1e-6, atol=1e-6)


def test_real_photos_are_held_out_in_turn() -> None:
    """Every photo once; without covariances those of the image change nothing, and no truth is made up."""
    seen, _ = photograph(scene(), scene().target.center_mm, stream(1, "x"), 6)
    pool = RealPool(replace(seen, cov_px2=None), "opencv", 3)
    (found,) = pool.run("", 6, 1, range(1))
    values = np.array(found.params).reshape(-1, len(MEASURES))
    assert found.distinct_views == 4
    assert np.isnan(values[:, :2]).all()
    np.testing.assert_array_equal(values[0, 2:], values[NAMES.index(WEIGHTED), 2:])


def test_ratios_have_the_intervals_of_paired_samples() -> None:
    """Errors that differ from set to set by far more than from cost to cost tell the costs apart all the same."""
    rng = np.random.default_rng(0)
    values = np.repeat(np.exp(rng.normal(0, 2, (40, 1, 1))), len(ESTIMATORS), axis=1)
    values = np.repeat(values, len(MEASURES), axis=2)
    values[:, 2] *= np.exp(rng.normal(math.log(1.05), 0.02, (40, 1)))
    values[:, 3] *= np.exp(rng.normal(math.log(0.95), 0.02, (40, 1)))
    values[5, 4] = np.nan
    rows = {(one.cost, one.measure): one for one in cost_rows(samples_of(values.reshape(40, -1)), "board", "as drawn")}
    worse, better, same = (rows[NAMES[k], "camera_px"] for k in (2, 3, 1))
    assert worse.is_worse
    assert better.is_better
    assert worse.low < 1.05 < worse.high
    assert better.low < 0.95 < better.high
    assert not same.is_better
    assert not same.is_worse
    assert rows[NAMES[4], "camera_px"].failed == 1
    few = cost_rows(samples_of(values[: FEWEST - 1].reshape(FEWEST - 1, -1)), "board", "as drawn")
    assert all(math.isnan(one.ratio) for one in few)


def test_bad_starts_are_as_bad_as_told() -> None:
    """Focal lengths within a factor of three, cameras without a lens, targets where they would look as large."""
    _, poses = photograph(scene(), scene().target.center_mm, stream(1, "x"), 6)
    for number in range(20):
        camera, start = bad_start(scene(), poses, stream(1, number))
        factor = camera.params[0] / CAMERA.params[0]
        assert 1 / WIDEST_FOCAL <= factor <= WIDEST_FOCAL
        np.testing.assert_allclose(start[:, :3, 3], factor * poses[:, :3, 3])
        turn = np.einsum("vij,vij->v", start[:, :3, :3], poses[:, :3, :3])  # 1 + 2 cos of the angle
        assert (turn >= 1 + 2 * math.cos(math.radians(60)) - 1e-9).all()


def test_starts_are_counted_in_pairs() -> None:
    """From where one cost reaches its least value and the other does not."""
    values = np.zeros((4, len(START_VALUES)))
    names = list(COSTS)
    values[:, names.index(IMAGE)] = (1, 1, 0, 0)
    values[:, names.index("ray")] = (1, 0, 1, 1)
    values[:, len(names) :] = 7.0
    row = next(one for one in start_rows(samples_of(values, START_VALUES), "board") if one.cost == "ray")
    assert (row.reached, row.only_this, row.only_image, row.steps) == (3, 2, 1, 7.0)
    assert row.share == 0.75


def test_a_start_at_the_answer_reaches_it(monkeypatch: pytest.MonkeyPatch) -> None:
    """All costs do from there; what a sample says does not hang on the others."""
    monkeypatch.setattr(
        "calib.studies.cost.estimates.bad_start", lambda scene, poses, rng: (scene.camera, np.array(poses))
    )
    pool = StartPool(scene())
    first, again = pool.run("", 8, 1, range(3, 4))[0], pool.sample(1, 3)
    assert first.params[: len(COSTS)] == (1.0,) * len(COSTS)
    assert first.params == again.params


def test_cases_are_all_there_and_sets_may_be_added() -> None:
    """What makes the study this one does not hold how many sets there are; scenes have templates that exist."""
    plan = CostPlan(30, 60)
    assert identity(plan) == identity(CostPlan(8, 20))
    wanted = [one.samples for one in cases_of(plan, None)]
    assert wanted == [30] * (4 * len(SETTINGS)) + [60] * len(SETTINGS)
    assert scene_named(SETTINGS[0]).farthest > 1


def test_numbers_and_photos_that_do_not_do_are_refused(tmp_path: Path) -> None:
    """The value, the rule and the remedy, before any work."""
    seen, _ = photograph(scene(), scene().target.center_mm, stream(1, "x"), 3)
    with pytest.raises(InputError, match="--sets 2"):
        study_cost(tmp_path, sets=2)
    with pytest.raises(InputError, match="--starts 0"):
        study_cost(tmp_path, starts=0)
    with pytest.raises(InputError, match="'virtual' is unknown; use luhmann"):
        study_cost(tmp_path, seen, model="virtual")
    with pytest.raises(InputError, match="give --detections too"):
        study_cost(tmp_path, target="board.target.json")
    with pytest.raises(InputError, match="3 photos, of which some are held out; give 4 or more"):
        study_cost(tmp_path, seen, model="opencv")
    assert json.dumps(sorted(path.name for path in tmp_path.iterdir())) == "[]"
