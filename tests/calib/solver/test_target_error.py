"""What errors of the target do to a camera: stated against true, where photos tell the target's shape or do not."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from calib.cameras.camera import Camera
from calib.cameras.refit import camera_difference
from calib.core.se3 import exp_rotation
from calib.judge.checks import read_criteria
from calib.judge.evidence import lens_evidence
from calib.judge.halves import half_split
from calib.judge.next_views import next_views
from calib.measure_target.solve import measure
from calib.measure_target.unknowns import AsBuiltOptions
from calib.observe.calibration_file import Provenance, read_calibration, write_calibration
from calib.observe.observations import known_points
from calib.solver.accuracy import sigma_over_image_px
from calib.solver.calibration import Calibration
from calib.solver.free_shape import ShapeEquations, free_directions, shape_equations
from calib.solver.problem import SolveOptions
from calib.solver.solve import solve
from calib.solver.target_error import extended, left_open, stated_prior, with_target_error
from designer.base.arrays import Array
from designer.base.errors import InputError
from designer.kinds.board import BoardSpec
from designer.kinds.layout import lay_out
from designer.target import TargetGeometry
from designer.tolerance.error_file import error_model
from designer.tolerance.made import Made, how_made
from designer.tolerance.model import displaced, perturb
from designer.tolerance.prior import ShapePrior, shape_prior
from designer.tolerance.source import Amount
from tests.support.perturbed_targets import made_with
from tests.support.solver_scenes import observe
from tests.support.verdict_cases import judge_run

TRUE = Camera("opencv", np.array([2500.0, 2510, 1230, 1010, 0, 0, 0, 0, 0]), (2448, 2048))
"""Without distortion: what bends lines would tell a little of the target's shape too."""
PITCH = 24.0
BOARD = lay_out(BoardSpec((12 * PITCH, 10 * PITCH), 3.0, 11, 9, "square", 16.0, 0.45, PITCH, 0.0, 1.0, dots=False))
NOISE_PX = 0.04
VIEWS = 10
AS_PRINTED = error_model("fdm-board")


def _poses(seed: int, *, rolls: bool, axes: int) -> Array:
    """Cameras over a board that is tilted about one or two of its axes, rolled or not.  # (V, 4, 4)"""
    rng = np.random.default_rng(seed)
    poses = np.tile(np.eye(4), (VIEWS, 1, 1))
    for row, tilt in enumerate(np.linspace(-0.7, 0.7, VIEWS)):
        turn = exp_rotation(tilt * np.array([[1.0, 0, 0], [0, 1.0, 0]])[row % axes])
        roll = exp_rotation(np.array([0, 0, rng.uniform(-np.pi, np.pi)])) if rolls else np.eye(3)
        poses[row, :3, :3] = roll @ turn @ np.diag([1.0, -1.0, -1.0])
        poses[row, :3, 3] = *rng.uniform(-50, 50, 2), rng.uniform(380, 520)
    return poses


def _solved(made: TargetGeometry, poses: Array, seed: int = 0, *, weighted: bool = False) -> Calibration:
    """Photos of a part, solved as if it were as drawn."""
    seen = observe(TRUE, known_points(made), poses, np.random.default_rng(seed), noise_px=NOISE_PX)
    covariance = np.tile(NOISE_PX**2 * np.eye(2), (len(seen.view), 1, 1))
    seen = replace(seen, points=known_points(BOARD), cov_px2=covariance)
    return solve(seen, "opencv", SolveOptions(weighted=weighted))


def _stretched(share: float) -> TargetGeometry:
    return displaced(BOARD, {"axis_scale": np.array([[share, 0.0, 0.0]])}, model=AS_PRINTED)


def _error_px(one: Calibration) -> float:
    length = camera_difference(TRUE, one.camera).length_px
    return float(np.percentile(length[np.isfinite(length)], 95))


def _stated_px(one: Calibration, prior: ShapePrior | None = None) -> float:
    prior = shape_prior(BOARD, AS_PRINTED) if prior is None else prior
    told = with_target_error(one, Made("a test", "", prior))
    return sigma_over_image_px(told.camera, told.stated_covariance)


MOTIONS = {"one axis": (False, 1), "two axes": (False, 2), "rolled": (True, 1), "all": (True, 2)}


@pytest.mark.parametrize("motion", MOTIONS)
@pytest.mark.parametrize("share", [0.0, 0.003, 0.01])
def test_stretched_boards_are_covered_by_what_is_stated(share: float, motion: str) -> None:
    """Whatever the motion, a camera from a board .1 to .3 % too long errs by at most 3 stated sigmas.

    From one of 1 %, ten sigmas of its way of making, it does so where the photos tell it; elsewhere it is never good.
    """
    rolls, axes = MOTIONS[motion]
    one = with_target_error(_solved(_stretched(share), _poses(1, rolls=rolls, axes=axes)), how_made(BOARD))
    if share <= 0.003 or rolls:
        assert _error_px(one) < 3 * _stated_px(one)
    run = judge_run([one], 0, half_split(one, SolveOptions()), read_criteria())
    good = read_criteria()["uncertainty"].good
    assert run.verdict.grade != "good" or _error_px(one) < good
    if share == 0.01:
        assert _error_px(one) > 10 * good
        assert run.verdict.grade == "bad"


@pytest.mark.parametrize("weighted", [False, True])
def test_drawn_parts_are_covered_on_average(weighted: bool) -> None:
    """Over prints of a way of making and motions, errors are about as large as stated: neither hidden nor invented."""
    ratios = []
    for seed in range(12):
        rolls, axes = list(MOTIONS.values())[seed % len(MOTIONS)]
        made = perturb(BOARD, AS_PRINTED, np.random.default_rng(seed))
        one = _solved(made, _poses(seed, rolls=rolls, axes=axes), seed, weighted=weighted)
        ratios.append(_error_px(one) / _stated_px(one))
    assert 0.3 < np.sqrt(np.mean(np.square(ratios))) < 1.2
    assert max(ratios) < 3


@pytest.mark.parametrize("share", [0.001, 0.002])
def test_measuring_hides_nothing_that_the_photos_do_not_tell(share: float) -> None:
    """A stretch that the motion leaves open stays open in the measured target, and in a camera solved with it."""
    one = _solved(_stretched(share), _poses(1, rolls=False, axes=1))
    found = measure([one.observations], BOARD, "opencv", AsBuiltOptions(made=made_with(AS_PRINTED, BOARD)))
    again = solve(replace(one.observations, points=known_points(found.target)), "opencv", SolveOptions())
    told = with_target_error(again, how_made(found.target))
    assert _error_px(told) < 3 * sigma_over_image_px(told.camera, told.stated_covariance)
    run = judge_run([told], 0, half_split(told, SolveOptions()), read_criteria())
    assert run.verdict.grade != "good" or _error_px(told) < read_criteria()["uncertainty"].good


def test_where_photos_tell_the_shape_little_is_lost() -> None:
    """For a board as drawn, tilts and rolls of all kinds leave the noise's accuracy; one axis alone does not."""
    noise = {}
    for motion, (rolls, axes) in MOTIONS.items():
        one = _solved(BOARD, _poses(2, rolls=rolls, axes=axes))
        noise[motion] = _stated_px(one) / sigma_over_image_px(one.camera, one.param_covariance)
    assert noise["all"] < 2
    assert noise["one axis"] > 3


def test_the_advice_is_the_photos_that_would_tell_the_shape() -> None:
    """Photos tilted about one axis are to be rolled, and tilted about the other; such photos lower the uncertainty."""
    motions = {motion: _poses(2, rolls=rolls, axes=axes) for motion, (rolls, axes) in MOTIONS.items()}
    one = with_target_error(_solved(BOARD, motions["one axis"]), how_made(BOARD))
    advice = judge_run([one], 0, half_split(one, SolveOptions()), read_criteria()).verdict.advice
    assert any("roll the camera" in sentence and "other axis" in sentence for sentence in advice)
    assert any("fdm-board" in sentence for sentence in advice)
    more = _solved(BOARD, np.concatenate([motions["one axis"], motions["all"]]))
    assert _stated_px(more) < 0.3 * _stated_px(one)


@pytest.mark.parametrize("share", [0.0, 0.001])
def test_next_photos_promise_what_the_verdict_then_states(share: float) -> None:
    """They start from its figure; with them it is no larger than said, and of a target that is off as said."""
    rolls, axes = MOTIONS["all"]
    made, poses = _stretched(share), _poses(1, rolls=rolls, axes=axes)
    one = with_target_error(_solved(made, poses), how_made(BOARD))
    halves = half_split(one, SolveOptions())
    stated = lens_evidence([one], 0, halves).uncertainty
    views = next_views(one, most=3, factor=stated.factor, opened=left_open(one, stated_prior(one, BOARD)))
    assert views[0].sigma_px_before == pytest.approx(stated.image_px, rel=1e-6)
    views = next_views(one, most=3, opened=left_open(one, stated_prior(one, BOARD)))
    for count, view in enumerate(views, start=1):
        more = np.concatenate([poses, np.stack([v.cam_from_target for v in views[:count]])])
        then = with_target_error(_solved(made, more), how_made(BOARD))
        now_px = sigma_over_image_px(then.camera, then.stated_covariance)
        assert now_px < 1.1 * view.sigma_px_after
        if share:
            assert now_px > 0.9 * view.sigma_px_after
    unknown = next_views(one, most=3)  # nothing is promised of the target's part where it is not known what it is
    assert all(view.sigma_px_after > stated.image_px / 2 for view in unknown)


def test_a_file_of_errors_counts_as_it_was(tmp_path: Path) -> None:
    """Who changes it, or takes it away, after the camera was solved changes nothing of what that camera is told by."""
    path = tmp_path / "mine.toml"
    text = Path("templates/errors/fdm-board.toml").read_text()
    path.write_text(text)
    one = with_target_error(_solved(BOARD, _poses(3, rolls=True, axes=2)[:6]), how_made(BOARD, str(path)))
    then = shape_prior(BOARD, error_model(str(path)))
    provenance = Provenance("a test")
    write_calibration(tmp_path, one, provenance)
    path.write_text(text.replace("normal 0.3mm", "normal 9mm"))
    for change in (lambda: None, path.unlink):
        change()
        prior = stated_prior(read_calibration(tmp_path / "calibration.json")[0], BOARD)
        assert prior is not None
        assert np.array_equal(prior.modes_mm, then.modes_mm)
        assert np.array_equal(prior.ring_modes_mm, then.ring_modes_mm)


def test_the_size_of_the_target_does_not_matter() -> None:
    """A target too large as a whole moves no camera, however large it may be."""
    one = _solved(BOARD, _poses(3, rolls=True, axes=2))
    scale = AS_PRINTED.only("scale", "thermal").with_amount("scale", Amount("normal", 0.05))
    told = with_target_error(one, Made("a test", "", shape_prior(BOARD, scale)))
    assert told.target_error is not None
    assert (
        np.sqrt(np.diagonal(told.target_error.param_covariance)).max()
        < 1e-6 * np.sqrt(np.diagonal(one.param_covariance)).max()
    )


def test_the_equations_are_those_of_all_unknowns_at_once() -> None:
    """Poses taken out view by view, rings alone among them, leave what elimination from the dense problem leaves."""
    poses = _poses(4, rolls=True, axes=2)[:3]
    one = _solved(BOARD, _poses(4, rolls=True, axes=2))
    one = replace(_solved(BOARD, poses), param_covariance=one.param_covariance)
    prior = shape_prior(BOARD, AS_PRINTED)
    basis = free_directions(one.param_covariance)
    found = shape_equations(one, basis, prior.modes_mm, prior.ring_modes_mm)
    normal, gradient = _whole(found)
    dense = _dense(one, basis, prior)
    unknowns = len(gradient)
    poses_of, rest = dense[:, unknowns:-1], np.delete(dense, slice(unknowns, -1), axis=1)
    rest = rest - poses_of @ np.linalg.lstsq(poses_of, rest, rcond=None)[0]
    expected = rest.T @ rest
    # A pure scale leaves nothing but the rounding of what it was.
    length = np.linalg.norm(np.delete(dense, slice(unknowns, -1), axis=1), axis=0)
    size = np.outer(length, length)
    assert np.abs((normal - expected[:-1, :-1]) / size[:-1, :-1]).max() < 1e-6
    assert np.abs((gradient - expected[:-1, -1]) / size[:-1, -1]).max() < 1e-6
    assert found.square == pytest.approx(expected[-1, -1])
    assert found.equations == len(dense) - 6 * len(poses)


def test_the_error_is_that_of_the_dense_solution_and_many_photos_change_nothing() -> None:
    """Point by point elimination gives what the whole normal matrix gives, with few views and with more than points."""
    prior = shape_prior(BOARD, AS_PRINTED)
    for views in (3, 60):
        poses = np.concatenate([_poses(seed, rolls=True, axes=2) for seed in range(max(views // VIEWS, 1))])[:views]
        one = _solved(_stretched(0.001), poses)
        kept = np.isin(one.observations.point, np.arange(12)) | (views < 10)
        one = replace(one, is_outlier=~kept)
        basis = free_directions(one.param_covariance)
        equations = shape_equations(one, basis, prior.modes_mm, prior.ring_modes_mm)
        variance = NOISE_PX**2
        found = extended(equations, variance)
        normal, gradient = _whole(equations)
        is_shape = np.arange(len(normal)) >= basis.shape[1]
        whole = np.linalg.inv(normal + np.diag(np.where(is_shape, variance, 0.0)))
        gradient = np.where(is_shape, gradient, 0.0)
        step = -whole @ gradient
        size = basis.shape[1]
        np.testing.assert_allclose(found.camera_inverse, whole[:size, :size], rtol=1e-4, atol=1e-6 * whole[:size].max())
        np.testing.assert_allclose(found.mean[:size], step[:size], rtol=1e-4, atol=1e-6 * np.abs(step[:size]).max())
        left = equations.square + 2 * gradient @ step + step @ normal @ step
        assert found.left == pytest.approx(left, rel=1e-5)
        assert found.told == pytest.approx(is_shape.sum() - variance * np.trace(whole[size:, size:]), rel=1e-5)


def _whole(equations: ShapeEquations) -> tuple[Array, Array]:
    """Normal matrix and gradient of the camera's, the shared and all points' own numbers, poses eliminated."""
    own, count = equations.own, equations.own.block.shape[1]
    alone = -own.by_poses.T @ own.by_poses
    for row, block in enumerate(own.block):
        place = slice(count * row, count * row + count)
        alone[place, place] += block
    normal = np.block([[equations.normal, own.cross], [own.cross.T, alone]])
    return normal, np.concatenate([equations.gradient, own.gradient])


def _dense(one: Calibration, basis: Array, prior: ShapePrior) -> Array:
    """Derivatives by camera, shared and own numbers and all poses, by differences, and the residuals behind them."""
    seen = one.observations
    used, step = np.unique(seen.point), 1e-4

    def residual(params: Array, shift_mm: Array, motion: Array) -> Array:
        from calib.cameras import project
        from calib.core.se3 import transform

        camera = replace(one.camera, params=params)
        pixel = np.empty_like(seen.center_px)
        for view, pose in enumerate(one.cam_from_target):
            rows = seen.view == view
            place = transform(pose, (seen.points.position_mm + shift_mm)[seen.point[rows]])
            pixel[rows] = project(camera, place @ exp_rotation(motion[view, :3]).T + motion[view, 3:])
        return (pixel - seen.center_px).reshape(-1)

    params, none, still = one.camera.params, np.zeros_like(seen.points.position_mm), np.zeros((seen.view_count, 6))
    by_camera = [(params + sign * step * basis[:, k], none, still) for k in range(basis.shape[1]) for sign in (1, -1)]
    by_mode = [(params, sign * step * mode, still) for mode in prior.modes_mm for sign in (1, -1)]
    own = []
    for row in used:
        for c in range(prior.ring_modes_mm.shape[2]):
            shift = none.copy()
            shift[row] = step * prior.ring_modes_mm[row, :, c]
            own += [(params, shift, still), (params, -shift, still)]
    by_pose = []
    for number in range(still.size):
        motion = still.copy()
        motion.flat[number] = step
        by_pose += [(params, none, motion), (params, none, -motion)]
    columns = [residual(*given) for given in (*by_camera, *by_mode, *own, *by_pose)]
    pairs = zip(columns[::2], columns[1::2], strict=True)
    return np.column_stack([*((ahead - behind) / (2 * step) for ahead, behind in pairs), residual(params, none, still)])


def test_who_says_how_a_target_was_made() -> None:
    """What somebody says comes first, then what the file and the photos say; without a target only `exact` can be."""
    assumed = how_made(BOARD)
    assert assumed is not None
    assert assumed.name == "fdm-board"
    assert "--made" in assumed.sentence
    for exact in (how_made(BOARD, "exact"), how_made(BOARD, rendered_id=BOARD.geometry_id), how_made(None, "exact")):
        assert exact is not None
        assert exact.prior is None
    asked = how_made(BOARD, "sheet-print", rendered_id=BOARD.geometry_id)
    assert asked is not None
    assert asked.prior is not None
    assert asked.name == "sheet-print"
    measured = how_made(replace(BOARD, source="measured"))
    assert measured is not None
    assert measured.name == "measured"
    assert how_made(None) is None
    with pytest.raises(InputError, match="--made"):
        how_made(None, "fdm-board")
    one = _solved(BOARD, _poses(3, rolls=True, axes=2)[:6])
    assert with_target_error(one, None) is one
    told = with_target_error(one, how_made(BOARD, "exact"))
    assert np.array_equal(told.stated_covariance, one.param_covariance)
