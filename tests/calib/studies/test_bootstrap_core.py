"""Bootstrap samples: draws, the short way to a sample's camera, and its metrics, each against the long way."""

import math
import pickle
from collections import Counter
from dataclasses import replace

import numpy as np
import pytest
from numpy.typing import NDArray

from calib.cameras import rays
from calib.core.types import KnownPoints, Observations, keep_views
from calib.renderer.truth import Truth, true_views
from calib.solver.blocks import RobustLoss, view_blocks
from calib.solver.calibration import Calibration
from calib.solver.levenberg import move_poses, turn_of_centre
from calib.solver.metrics.errors import Errors, predict, summarise
from calib.solver.metrics.intersection import intersection
from calib.solver.metrics.pose import pose
from calib.solver.metrics.reconstruction import reconstruction
from calib.solver.metrics.reprojection import reprojection
from calib.solver.problem import SolveOptions, pack, tie_parameters
from calib.solver.schur import damped_step
from calib.solver.solve import solve
from calib.studies.bootstrap import Pool, expanded, make_pool, run_sample, solve_from_scratch
from calib.studies.near import find_near
from calib.studies.sample_metrics import Sample, sample_errors
from calib.studies.samples import SampleErrors, SampleResult, draw_counts
from designer.base.arrays import Array, Rows
from designer.base.errors import InputError
from tests.support.solver_scenes import CAMERAS, board, icosahedron, observe, poses_around, random_covariances, rows_of

VIEWS = 40
TARGETS = {"board": board(), "icosahedron": icosahedron()}
HALF_ANGLE_DEG = {"board": 50.0, "icosahedron": 180.0}


def scene(target: str, model: str, noise_px: float = 0.1) -> tuple[Observations, Truth]:
    """Views and what is true of them."""
    rng = np.random.default_rng(5)
    poses = poses_around(VIEWS, rng, half_angle_deg=HALF_ANGLE_DEG[target])
    seen = observe(CAMERAS[model], TARGETS[target], poses, rng, noise_px=noise_px)
    return seen, Truth(seen.points.geometry_id, CAMERAS[model], true_views(seen.view_names, poses))


def pool_of(target: str, model: str, options: SolveOptions | None = None) -> Pool:
    seen, truth = scene(target, model)
    return make_pool(seen, model, options or SolveOptions(), truth)


def drawn(counts: Rows) -> Rows:
    return np.repeat(np.arange(len(counts)), counts)


def polished(found: Calibration, options: SolveOptions) -> tuple[Array, Array]:
    """Parameters and their standard deviations, with steps down to rounding: the solver stops a little before."""
    problem = pack(found.observations, weighted=options.weighted)
    tie = tie_parameters(found.camera.model, options).row
    poses = np.array(found.cam_from_target)
    poses[:, :3, 3] += poses[:, :3, :3] @ problem.origin_mm
    camera = found.camera
    for _ in range(15):
        step = damped_step(view_blocks(problem, camera, poses, RobustLoss()).products, tie, 0.0)
        trial = replace(camera, params=camera.params + np.where(tie >= 0, step.free[tie], 0.0))
        poses = move_poses(poses, step.pose, turn_of_centre(camera, trial))
        camera = trial
    return camera.params, np.sqrt(np.diagonal(found.param_covariance))


def numbers_of(result: SampleResult) -> Array:
    return np.array(result.errors)


@pytest.mark.parametrize("target", ["board", "icosahedron"])
@pytest.mark.parametrize("model", ["luhmann", "opencv"])
def test_a_sample_is_what_a_solution_from_scratch_gives(target: str, model: str) -> None:
    """Parameters within 1e-6 of their sigma, metrics as evaluated there, whatever the size of the sample."""
    pool = pool_of(target, model)
    for number, size in enumerate((10, 20, 50, 120)):
        counts = draw_counts(0, target, number, size, VIEWS)
        views = np.flatnonzero(counts)
        assert (
            find_near(pool.expansion, views, counts[views]) is not None
        )  # the short way, not the long one compared with itself
        result = run_sample(pool, counts, number)
        long = solve(expanded(pool.observations, drawn(counts)), model)
        params, sigma = polished(long, SolveOptions())
        assert np.abs((np.array(result.params) - params) / sigma).max() < 1e-6
        assert result.status == "converged" == long.status
        assert result.distinct_views == len(np.unique(drawn(counts)))
        slow = solve_from_scratch(pool, counts, number)
        np.testing.assert_allclose(numbers_of(result), numbers_of(slow), rtol=2e-5)


@pytest.mark.parametrize(
    "options",
    [SolveOptions(weighted=True), SolveOptions(fixed=(("k3", 0.0),)), SolveOptions(shared=(("fx_px", "fy_px"),))],
    ids=["weighted", "fixed", "shared"],
)
def test_a_persons_choices_hold_in_samples(options: SolveOptions) -> None:
    """Weights, fixed and shared parameters: the same minimum as from scratch."""
    seen, truth = scene("board", "opencv")
    rng = np.random.default_rng(1)
    seen = replace(seen, cov_px2=random_covariances(len(seen.view), rng))
    pool = make_pool(seen, "opencv", options, truth)
    counts = draw_counts(3, "options", 0, 30, VIEWS)
    views = np.flatnonzero(counts)
    assert find_near(pool.expansion, views, counts[views]) is not None
    result = run_sample(pool, counts, 0)
    long = solve(expanded(pool.observations, drawn(counts)), "opencv", options)
    params, sigma = polished(long, options)
    free = sigma > 0
    assert np.abs((np.array(result.params) - params)[free] / sigma[free]).max() < 1e-6
    np.testing.assert_array_equal(np.array(result.params)[~free], params[~free])
    np.testing.assert_allclose(numbers_of(result), numbers_of(solve_from_scratch(pool, counts, 0)), rtol=2e-5)


def test_much_noise_takes_more_looks_and_ends_at_the_same_minimum() -> None:
    """Where the expansion of the pool is not exact enough, steps follow until it is the minimum."""
    seen, truth = scene("icosahedron", "luhmann", noise_px=0.15)
    pool = make_pool(seen, "luhmann", SolveOptions(), truth)
    looks = []
    for number in range(4):
        counts = draw_counts(0, "noisy", number, 25, VIEWS)
        views = np.flatnonzero(counts)
        assert find_near(pool.expansion, views, counts[views]) is not None
        result = run_sample(pool, counts, number)
        long = solve(expanded(pool.observations, drawn(counts)), "luhmann")
        params, sigma = polished(long, SolveOptions())
        assert np.abs((np.array(result.params) - params) / sigma).max() < 1e-6
        looks.append(result.iterations)
    assert max(looks) > 1


def metrics_by_definition(pool: Pool, counts: NDArray[np.int64], camera_from: Pool) -> SampleErrors:
    """`calib.solver.metrics` on the views as often as drawn, with the pool's own poses and any camera."""
    rows = drawn(counts)
    seen = expanded(pool.observations, rows)
    base = pool.calibration
    given = replace(
        base, camera=camera_from.calibration.camera, observations=seen, cam_from_target=base.cam_from_target[rows],
        residual_px=np.zeros((len(seen.view), 2)), is_outlier=np.zeros(len(seen.view), dtype=bool),
        pose_covariance=np.zeros((len(rows), 6, 6)),
    )  # fmt: skip
    truth = None
    if pool.true_center_mm is not None:
        truth = np.tile(np.eye(4), (len(rows), 1, 1))
        truth[:, :3, 3] = -pool.true_center_mm[rows]
    prediction = predict(given, truth)

    def rmse(errors: Errors | None) -> float:
        return math.nan if errors is None else summarise(errors).rmse

    return SampleErrors(
        rmse(reprojection(prediction)), rmse(intersection(prediction)), rmse(reconstruction(prediction)),
        rmse(pose(prediction)),
    )  # fmt: skip


def metrics_in_one_pass(pool: Pool, counts: Rows) -> SampleErrors:
    views = np.flatnonzero(counts)
    sample = Sample(
        pool.observations, pool.problem, views, counts[views], pool.calibration.camera, pool.cam_from_target[views]
    )
    return sample_errors(sample, pool.true_center_mm)


def assert_same(one: SampleErrors, other: SampleErrors) -> None:
    for name in ("reprojection_px", "intersection_mm", "reconstruction_mm", "pose_mm"):
        np.testing.assert_allclose(getattr(one, name), getattr(other, name), rtol=1e-9, err_msg=name)


@pytest.mark.parametrize("target", ["board", "icosahedron"])
@pytest.mark.parametrize("size", [3, 60])
def test_metrics_in_one_pass_are_those_of_the_views_as_often_as_drawn(target: str, size: int) -> None:
    """All four metrics to 1e-9, a point that only one distinct view saw and a view of unknown truth left out."""
    pool = pool_of(target, "opencv")
    assert pool.true_center_mm is not None
    center = np.array(pool.true_center_mm)
    center[::3] = np.nan
    pool = replace(pool, true_center_mm=center)
    counts = draw_counts(0, "metrics", 2, size, VIEWS)
    assert_same(metrics_in_one_pass(pool, counts), metrics_by_definition(pool, counts, pool))


def test_what_has_no_error_is_left_out_of_one_pass_too() -> None:
    """Points on no plane, pixels without a ray, and points seen from one place only, as in `calib.solver.metrics`."""
    pool = pool_of("board", "opencv")
    points = pool.observations.points
    face = np.array(points.face)
    face[::5] = -1
    # A lens that folds the image over within the picture: no rays from the corners.
    params = np.array(pool.calibration.camera.params)
    params[4:] = -3.0, 0.0, 0.0, 0.0, 0.0
    camera = replace(pool.calibration.camera, params=params)
    seen = replace(pool.observations, points=replace(points, face=face))
    assert np.isnan(rays(camera, seen.center_px)).any()
    pool = replace(pool, observations=seen, calibration=replace(pool.calibration, camera=camera), true_center_mm=None)
    counts = draw_counts(0, "gaps", 0, 12, VIEWS)
    assert_same(metrics_in_one_pass(pool, counts), metrics_by_definition(pool, counts, pool))
    assert math.isnan(metrics_in_one_pass(pool, counts).pose_mm)
    alone = np.zeros(VIEWS, dtype=np.int64)
    alone[4] = 5  # one view five times reconstructs nothing
    assert math.isnan(metrics_in_one_pass(pool, alone).reconstruction_mm)
    assert_same(metrics_in_one_pass(pool, alone), metrics_by_definition(pool, alone, pool))


def test_draws_depend_on_seed_case_and_number_only() -> None:
    """The same three give the same counts, another of any gives others; every draw has the size."""
    counts = draw_counts(7, "board 50", 12, 50, 200)
    assert counts.sum() == 50
    assert len(counts) == 200
    np.testing.assert_array_equal(counts, draw_counts(7, "board 50", 12, 50, 200))
    for other in ((8, "board 50", 12), (7, "board 20", 12), (7, "board 50", 13), (71, "board 50", 2)):
        assert (draw_counts(*other, 50, 200) != counts).any()


def test_draws_are_uniform() -> None:
    """Over many samples each view is drawn as often as any, and a view k times as the binomial law says."""
    size, pool, samples = 20, 10, 2000
    counts = np.stack([draw_counts(0, "uniform", n, size, pool) for n in range(samples)])
    expected = samples * size / pool
    assert np.abs(counts.sum(axis=0) - expected).max() < 5 * math.sqrt(expected)
    times = Counter(counts.ravel().tolist())
    for k in range(5):
        share = math.comb(size, k) * (1 / pool) ** k * (1 - 1 / pool) ** (size - k)
        assert abs(times[k] - samples * pool * share) < 5 * math.sqrt(samples * pool * share)


def test_chunks_do_not_matter() -> None:
    """Samples are the same bit by bit alone, in chunks, in any order, and from a pool that went to another process."""
    pool = pool_of("board", "opencv")
    whole = pool.run("chunks", 15, 9, range(6))
    there: Pool = pickle.loads(pickle.dumps(pool))  # noqa: S301 - as a process pool does
    parts = [*there.run("chunks", 15, 9, range(3, 6)), *there.run("chunks", 15, 9, range(3))]
    assert sorted(parts, key=lambda one: one.number) == whole


def test_degenerate_samples_are_kept_with_their_reason() -> None:
    """One view of a plane drawn again and again: status and words of the solver, parameters and metrics as they are."""
    pool = pool_of("board", "opencv")
    counts = np.zeros(VIEWS, dtype=np.int64)
    counts[0] = 6
    result = run_sample(pool, counts, 4)
    assert result.status == "degenerate"
    assert result.message
    assert result.number == 4
    assert result.distinct_views == 1
    assert len(result.params) == 9


def test_samples_that_cannot_be_solved_are_kept_as_failed() -> None:
    """Fewer equations than unknowns: no camera, no metrics, and why."""
    seen, _ = scene("board", "opencv")
    rows = np.flatnonzero((np.arange(len(seen.view)) - np.searchsorted(seen.view, seen.view)) % 19 == 3)
    pool = make_pool(rows_of(seen, rows), "opencv", SolveOptions(), None)
    counts = np.zeros(VIEWS, dtype=np.int64)
    counts[3] = 1
    result = run_sample(pool, counts, 0)
    assert result.status == "failed"
    assert "too few" in result.message
    assert np.isnan(numbers_of(result)).all()
    assert np.isnan(result.params).all()


def test_outliers_are_rejected_in_each_sample_anew() -> None:
    """With a rejection, a sample is the solution from scratch, outliers out of its metrics."""
    seen, truth = scene("board", "opencv")
    center = np.array(seen.center_px)
    center[::200] += 20.0
    seen = replace(seen, center_px=center)
    pool = make_pool(seen, "opencv", SolveOptions(reject_sigma=5.0), truth)
    result = run_sample(pool, draw_counts(0, "reject", 0, 12, VIEWS), 0)
    assert result.status == "converged"
    assert result.errors.reprojection_px < 0.2


def test_views_without_truth_in_the_pool_are_refused_if_none_is_known() -> None:
    """A truth of other photos is an error at once, not a column of nan after an hour."""
    seen, truth = scene("board", "opencv")
    with pytest.raises(InputError, match="truth"):
        make_pool(
            seen,
            "opencv",
            SolveOptions(),
            replace(truth, views=tuple(replace(view, file=f"other {view.file}") for view in truth.views)),
        )


def test_a_target_far_from_its_origin_changes_nothing() -> None:
    """Points given 100 m from their frame's origin: the same errors."""
    seen, _ = scene("icosahedron", "opencv")
    shift = np.array([1e5, -1e5, 1e5])
    old = seen.points
    plane = np.array(old.plane)
    plane[:, 3] += plane[:, :3] @ shift
    moved = replace(seen, points=KnownPoints(old.position_mm + shift, old.face, plane))
    counts = draw_counts(0, "far", 0, 20, VIEWS)
    near, far = (run_sample(make_pool(one, "opencv", SolveOptions(), None), counts, 0) for one in (seen, moved))
    np.testing.assert_allclose(numbers_of(near)[:3], numbers_of(far)[:3], rtol=1e-6)


def test_what_is_called_determined_is_so() -> None:
    """No sample comes by the short way that the solver would call degenerate; few views of a plane are tried."""
    seen, _ = scene("board", "opencv", noise_px=1.0)
    flat = keep_views(seen, np.arange(VIEWS) < 12)  # those least tilted
    pool = make_pool(flat, "opencv", SolveOptions(), None)
    states = set()
    for number in range(12):
        counts = draw_counts(0, "flat", number, 2, 12)
        result = run_sample(pool, counts, number)
        long = solve(expanded(pool.observations, drawn(counts)), "opencv")
        states.add(long.status)
        assert result.status == long.status
    assert "degenerate" in states
