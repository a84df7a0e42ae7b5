"""The linear prediction of tolerance studies against differences, a dense solution, and draws."""

from dataclasses import replace

import numpy as np
import pytest

from calib.cameras import project
from calib.core.se3 import exp_rotation, log_rotation, transform
from calib.solver.accuracy import accuracy_of
from calib.solver.blocks import RobustLoss, view_blocks
from calib.studies.tolerance.anchor import minimum_of
from calib.studies.tolerance.draw import drawn_noise, run_cases, run_draws, seen_px
from calib.studies.tolerance.first_order import first_order
from calib.studies.tolerance.predict import baseline, linear_table, table_of_draws
from calib.studies.tolerance.quantities import NAMES, QUANTITIES, quantity_row
from calib.studies.tolerance.record import OFF
from calib.studies.tolerance.response import noise_squares, responses
from calib.studies.tolerance.setting import Setting
from calib.studies.tolerance.sizes import reach_of
from designer.base.arrays import Array
from designer.tolerance.model import ErrorModel, displaced_shape
from designer.tolerance.prior import directions
from designer.tolerance.shape import centers_mm
from designer.tolerance.source import Amount
from designer.tolerance.sources import SOURCES
from tests.support.perturbed_targets import FULL
from tests.support.tolerance_settings import board_setting, errors, ico_setting, still

MOVING = tuple(name for name in SOURCES if name not in ("ink_bleed", "warp"))
SMALL = {"mm": 1e-4, "rad": 1e-5, "1": 1e-5, "K": 0.01}
SCALES = ("scale", "thermal")
"""Of the whole print: without residuals, and nothing but poses and the true shape are off."""


def centers(setting: Setting, name: str, values: Array) -> Array:
    return centers_mm(displaced_shape(setting.target, {name: values}, model=FULL))


def params_at(setting: Setting, center_mm: Array) -> Array:
    found = minimum_of(setting.anchor, np.ascontiguousarray(seen_px(setting, center_mm).T))
    return found.camera.params


@pytest.mark.parametrize("make", [ico_setting, board_setting])
@pytest.mark.parametrize("name", MOVING)
def test_responses_are_derivatives(name: str, make: type[Setting]) -> None:
    """Responses to random numbers of a source are the derivatives, by differences, of solved cameras and quantities."""
    setting = make()
    source = SOURCES[name]
    shape = (source.instances(setting.target), source.components)
    values = SMALL[source.unit] * np.random.default_rng(1).standard_normal(shape)
    moved = directions(setting.target, FULL, name) @ values.reshape(-1)
    found = responses(first_order(setting), moved[:, :, None])
    ahead, behind = (params_at(setting, centers(setting, name, sign * values)) for sign in (1, -1))
    unit = 1e-6 if name in SCALES else max(1e-3 * np.abs(found.params[:, 0]).max(), 1e-9)
    np.testing.assert_allclose(found.params[:4, 0], ((ahead - behind) / 2)[:4], rtol=2e-3, atol=unit)
    exact = run_cases(setting, FULL.only(name), {name: values}, still(setting))[1]
    linear = np.sqrt(found.square[:, 0])
    for row, quantity in enumerate(QUANTITIES):
        assert linear[row] == pytest.approx(exact[row], rel=5e-3, abs=2e-7), quantity.name


def dense_jacobian(setting: Setting) -> tuple[Array, Array]:
    """Differences of all pixels by parameters and poses (2 M, P + 6 V), and by ring positions (2 M, 3 R)."""
    anchor, seen = setting.anchor, setting.observations
    position = setting.target.center_mm - anchor.problem.origin_mm
    count, rings = len(seen.view), setting.target.ring_count
    parameters = len(anchor.camera.params)
    by_unknown = np.zeros((count, 2, parameters + 6 * setting.view_count))
    by_ring = np.zeros((count, 2, 3 * rings))

    def pixels(camera_params: Array, turn: Array, shift: Array, move: Array) -> Array:
        pose = anchor.cam_from_target[seen.view]
        point = (position[seen.point] + move)[:, :, None]
        inside = (exp_rotation(turn) @ pose[:, :3, :3] @ point)[..., 0] + pose[:, :3, 3] + shift
        return project(replace(anchor.camera, params=camera_params), inside)

    def difference(change: Array, size: float) -> Array:
        """By the parameters, turn, shift and ring in one vector."""
        ends = []
        for sign in (1, -1):
            step = sign * size * change
            p = parameters
            ends.append(pixels(anchor.camera.params + step[:p], step[p : p + 3], step[p + 3 : p + 6], step[p + 6 :]))
        derivative: Array = (ends[0] - ends[1]) / (2 * size)
        return derivative

    unit = np.eye(parameters + 9)
    rows = np.arange(count)
    for k in range(parameters):
        by_unknown[:, :, k] = difference(unit[k], 1.0 if k < 4 else 1e-4)
    for k in range(6):
        by_unknown[rows, :, parameters + 6 * seen.view + k] = difference(unit[parameters + k], 1e-5 if k < 3 else 1e-2)
    for k in range(3):
        by_ring[rows, :, 3 * seen.point + k] = difference(unit[parameters + 6 + k], 1e-2)
    return by_unknown.reshape(2 * count, -1), by_ring.reshape(2 * count, -1)


def test_responses_against_a_dense_solution() -> None:
    """Unknowns, residuals and distances on the faces are those of one dense least-squares problem."""
    setting = board_setting()
    by_unknown, by_ring = dense_jacobian(setting)
    moved = np.random.default_rng(0).standard_normal((setting.target.ring_count, 3, 2))
    rigid = without_rigid_motion(setting, moved)
    pixel = by_ring @ rigid.reshape(-1, 2)
    scale = np.linalg.norm(by_unknown, axis=0)
    step = np.linalg.lstsq(by_unknown / scale, pixel, rcond=None)[0] / scale[:, None]
    found = responses(first_order(setting), moved)
    parameters = len(setting.anchor.camera.params)
    np.testing.assert_allclose(found.params, step[:parameters], rtol=1e-3, atol=1e-4 * np.abs(step[4]).max())
    pose = step[parameters:].reshape(setting.view_count, 6, 2)
    np.testing.assert_allclose(found.pose, pose, atol=1e-3 * np.abs(pose).max())
    residual = (pixel - by_unknown @ step).reshape(-1, 2, 2)
    np.testing.assert_allclose(found.square[0], (residual**2).sum(axis=(0, 1)) / len(residual), rtol=1e-5)
    # On a board the inverse of two columns of a ring's derivatives takes pixels to millimetres on the face.
    axes = setting.target.target_from_face[0, :3, :2]
    own = np.stack([by_ring[:, k::3].sum(axis=1) for k in range(3)], axis=1).reshape(-1, 2, 3) @ axes
    on_face = np.linalg.solve(own, residual)
    np.testing.assert_allclose(found.square[1], (on_face**2).sum(axis=(0, 1)) / len(residual), rtol=1e-5)


def without_rigid_motion(setting: Setting, displacement_mm: Array) -> Array:
    """Displacements (R, 3, N) less the turn and shift of all rings that fit them best, each as often as it is seen."""
    center = setting.target.center_mm
    arm = center - np.average(center, axis=0, weights=setting.seen)
    turns = np.stack([np.cross(axis, arm) for axis in np.eye(3)], axis=2)
    basis = np.concatenate([turns, np.tile(np.eye(3), (len(arm), 1, 1))], axis=2).reshape(-1, 6)
    root = np.sqrt(np.repeat(setting.seen, 3))[:, None]
    flat = displacement_mm.reshape(len(basis), -1)
    left: Array = flat - basis @ np.linalg.lstsq(root * basis, root * flat, rcond=None)[0]
    return left.reshape(displacement_mm.shape)


def test_rigid_motion_is_no_displacement() -> None:
    """A rigid motion of all rings has no response, and beside other displacements it changes none."""
    setting = ico_setting()
    first, center = first_order(setting), setting.target.center_mm
    small = np.array([1e-6, -2e-6, 3e-6])
    turned = (np.cross(small, center) + np.array([1e-4, 0.0, -1e-4]))[:, :, None]
    moved = np.random.default_rng(0).standard_normal((len(center), 3, 1)) * 1e-4
    alone, other = responses(first, turned), responses(first, moved)
    assert np.abs(alone.pose).max() < 1e-9
    assert np.sqrt(alone.square).max() < 1e-8
    np.testing.assert_allclose(responses(first, moved + turned).square, other.square, rtol=1e-4)


def test_columns_do_not_know_of_each_other() -> None:
    """A response is the same alone and among others, of many rings or of one, with noise or without."""
    setting = ico_setting()
    first, rings = first_order(setting), setting.target.ring_count
    rng = np.random.default_rng(0)
    moved = np.zeros((rings, 3, 37))
    for column in range(37):
        chosen = rng.choice(rings, 1 if column % 2 else rings, replace=False)
        moved[chosen, :, column] = rng.standard_normal((len(chosen), 3))
    noise = rng.standard_normal((len(setting.observations.view), 2, 37)) * (np.arange(37) % 3 == 0)
    together = responses(first, moved, noise)
    for column in (0, 1, 2, 17, 36):
        one = slice(column, column + 1)
        alone = responses(first, moved[:, :, one], noise[:, :, one])
        np.testing.assert_allclose(together.square[:, one], alone.square, rtol=1e-12)
        np.testing.assert_allclose(together.pose[:, :, one], alone.pose, rtol=1e-12, atol=1e-12)
        if column % 3:
            np.testing.assert_allclose(responses(first, moved[:, :, one]).square, alone.square, rtol=1e-9)


def test_prediction_against_draws() -> None:
    """At fdm-dual-calibrated each source's cost is within 10 % of that of draws, beside what chance allows."""
    setting, model = ico_setting(), errors()
    linear = linear_table(setting, model)
    drawn = table_of_draws(model, run_draws(setting, model, 0, range(40)))
    assert drawn.failed == (0,) * (len(model.sources) + 2)
    np.testing.assert_allclose(drawn.baseline.value, linear.baseline.value, rtol=0.25)
    rows = [quantity_row(name) for name in NAMES if name != "principal_point"]
    floor = 0.3 * linear.baseline.value
    for place, name in enumerate(model.sources):
        low = (drawn.cost.low[place] - floor) / 1.1
        high = (drawn.cost.high[place] + floor) / 0.9
        value = linear.cost.value[place]
        assert ((value >= low) & (value <= high))[rows].all(), (name, value / drawn.cost.value[place])
    assert np.abs(drawn.together.value / linear.together.value - 1)[rows].max() < 0.35


def test_board_is_predicted_too() -> None:
    """The board's costs are those of draws; warp is its own, and faces of a body do not have it."""
    setting, model = board_setting(), errors("fdm-board").scaled(0.2)
    linear = linear_table(setting, model)
    drawn = table_of_draws(model, run_draws(setting, model, 0, range(40)))
    for place, name in enumerate(model.sources):
        inside = (linear.cost.value[place] >= 0.9 * drawn.cost.low[place] - 0.3 * linear.baseline.value) & (
            linear.cost.value[place] <= 1.1 * drawn.cost.high[place] + 0.3 * linear.baseline.value
        )
        assert inside[:8].all(), (name, linear.cost.value[place], drawn.cost.value[place])
    of_ico = linear_table(ico_setting(), FULL.only("warp", "ink_bleed"))
    assert (of_ico.cost.value == 0).all()


def test_fixed_numbers_add_before_they_are_squared() -> None:
    """The cost of fixed numbers is that of the one target they make, also beside others."""
    setting = ico_setting()
    model = ErrorModel("fixed", "", (("face_offset", Amount("fixed", 1e-4)), ("skew", Amount("fixed", -1e-6))))
    table = linear_table(setting, model)
    values = {name: np.full((SOURCES[name].instances(setting.target), SOURCES[name].components), amount.size)
              for name, amount in model.amounts}  # fmt: skip
    rows = run_cases(setting, model, values, still(setting))
    np.testing.assert_allclose(table.cost.value[:, :5], rows[1:3, :5], rtol=2e-3, atol=2e-7)
    np.testing.assert_allclose(table.together.value, rows[3], rtol=5e-3, atol=2e-7)


def test_uniform_numbers_count_by_their_deviation() -> None:
    """A uniform source costs as a normal one of the same deviation."""
    setting = ico_setting()
    uniform = linear_table(setting, ErrorModel("u", "", (("skew", Amount("uniform", 0.003)),)))
    normal = linear_table(setting, ErrorModel("n", "", (("skew", Amount("normal", 0.003 / np.sqrt(3))),)))
    np.testing.assert_allclose(uniform.cost.value, normal.cost.value, rtol=1e-12)


def test_baseline_is_the_covariance() -> None:
    """With weights, what noise costs focal lengths and principal point is the covariance of the solution."""
    setting = ico_setting(weighted=True)
    anchor = setting.anchor
    products = view_blocks(anchor.problem, anchor.camera, anchor.cam_from_target, RobustLoss()).products
    accuracy = accuracy_of(products, anchor.tie.row, len(anchor.problem.is_used), robust=(1.0, 1.0))
    used = len(anchor.problem.is_used)
    factor = 2 * used / (2 * used - len(anchor.camera.params) - 6 * setting.view_count)
    variance = np.diagonal(accuracy.param_covariance) / factor
    found = baseline(first_order(setting))
    assert found[quantity_row("focal_length")] == pytest.approx(np.sqrt(variance[:2].mean()), rel=1e-6)
    assert found[quantity_row("principal_point")] == pytest.approx(np.sqrt(variance[2:4].sum()), rel=1e-6)


@pytest.mark.parametrize("weighted", [False, True])
def test_noise_is_the_sum_of_its_parts(weighted: bool) -> None:
    """The mean squares over the noise are the sums of the responses to each independent part of every pixel's noise."""
    setting = ico_setting(weighted=weighted)
    first, observations = first_order(setting), np.arange(len(setting.observations.view))
    total = np.zeros(len(QUANTITIES))
    for some in np.array_split(observations, 8):
        parts = np.zeros((len(observations), 2, 2 * len(some)))
        column = np.arange(len(some))
        parts[some, 0, column], parts[some, 1, column], parts[some, 1, len(some) + column] = setting.noise_root[some].T
        total += responses(first, np.zeros((setting.target.ring_count, 3, 2 * len(some))), parts).square.sum(axis=1)
    np.testing.assert_allclose(noise_squares(first), total, rtol=1e-9)


def test_noise_of_pixels_is_a_response_too() -> None:
    """Small errors of the pixels move camera and poses as the solution does."""
    setting = ico_setting()
    noise = 1e-3 * drawn_noise(setting, 0, 0)
    pixel = seen_px(setting, setting.target.center_mm) + noise
    found = minimum_of(setting.anchor, np.ascontiguousarray(pixel.T))
    still_rings = np.zeros((setting.target.ring_count, 3, 1))
    predicted = responses(first_order(setting), still_rings, noise[:, :, None])
    moved = found.camera.params - setting.camera.params
    np.testing.assert_allclose(predicted.params[:4, 0], moved[:4], rtol=1e-3, atol=1e-3 * np.abs(moved[:4]).max())
    turn = log_rotation(found.cam_from_target[:, :3, :3] @ setting.cam_from_target[:, :3, :3].transpose(0, 2, 1))
    np.testing.assert_allclose(predicted.pose[:, :3, 0], turn, atol=2e-3 * np.abs(turn).max())
    origin = transform(setting.anchor.cam_from_target, np.zeros(3))
    shift = found.cam_from_target[:, :3, 3] - origin
    np.testing.assert_allclose(predicted.pose[:, 3:, 0], shift, atol=2e-3 * np.abs(shift).max())


def test_reach_is_where_the_prediction_is_off() -> None:
    """At the stated multiple the exact cost is 10 % off the straight line; a scale stays on it."""
    setting, model = ico_setting(), errors()
    first = first_order(setting)
    base = baseline(first)
    found = reach_of(first, model, "face_offset", base, draws=3)
    assert (np.diff(found.tried) > 0).all()
    limited = np.flatnonzero(np.isfinite(found.factor) & (found.factor > found.tried[0]))
    assert len(limited)
    for row in limited:
        at = np.interp(np.log(found.factor[row]), np.log(found.tried), np.abs(found.ratio[:, row] - 1))
        assert at == pytest.approx(OFF, rel=1.0)
    scale = reach_of(first, model, "scale", base, draws=2)
    assert np.isinf(scale.factor[quantity_row("pose")])
