"""Tolerance studies: what a draw is, what it costs, and what may be allowed."""

import pickle
from dataclasses import replace

import numpy as np
import pytest
from scipy.special import erf

from calib.cameras.camera import Camera
from calib.cameras.refit import camera_difference
from calib.core.se3 import exp_rotation, invert, make_pose, transform
from calib.core.types import KnownPoints
from calib.detector.corner_fit import FARTHEST_PX
from calib.renderer.faces import ring_truth
from calib.renderer.scene import scene_from_target
from calib.solver.blocks import RobustLoss, view_blocks
from calib.solver.metrics.errors import predict, summarise
from calib.solver.metrics.intersection import intersection
from calib.solver.metrics.pose import pose
from calib.solver.metrics.reconstruction import reconstruction
from calib.solver.metrics.reprojection import reprojection
from calib.solver.metrics.rotation import rotation
from calib.solver.problem import SolveOptions
from calib.solver.schur import damped_step
from calib.solver.solve import solve
from calib.studies.tolerance.anchor import CameraFit, minimum_of
from calib.studies.tolerance.draw import (
    TrueShape,
    case_names,
    drawn_noise,
    drawn_values,
    moved_onto,
    run_cases,
    run_draws,
    seen_px,
    solved,
    true_shape,
)
from calib.studies.tolerance.predict import table_of_draws
from calib.studies.tolerance.quantities import NAMES, quantity_row
from calib.studies.tolerance.seen import (
    CORNER_BOUND,
    CORNER_VARIANCE,
    EDGE_VARIANCE,
    FLAT_MINOR,
    LEAST_MINOR_PX,
    USED_PX,
    ImageGrid,
    aimed_at,
    centre_covariances,
    corner_covariances,
    map_error_px,
)
from calib.studies.tolerance.setting import Setting, make_setting
from designer.base.arrays import Array
from designer.base.errors import InputError
from designer.tolerance.model import ErrorModel, displaced, displaced_shape
from designer.tolerance.shape import MadeShape, centers_mm
from designer.tolerance.source import Amount
from tests.support.perturbed_targets import ico
from tests.support.solver_scenes import CAMERAS
from tests.support.tolerance_settings import DISTANCE_MM, VIEWS, board_setting, errors, ico_setting, still


def drawn_shape(setting: Setting, model: ErrorModel, number: int) -> MadeShape:
    return displaced_shape(setting.target, drawn_values(setting, model, 0, number), model=model)


def of(row: Array, name: str) -> float:
    return float(row[quantity_row(name)])


@pytest.mark.parametrize("amount", [Amount("normal", 0.0), Amount("fixed", 0.0)])
def test_zero_errors_cost_nothing(amount: Amount) -> None:
    """Errors of size zero cost exactly nothing, alone and together, and leave nothing to scale."""
    model = replace(errors(), amounts=tuple((name, amount) for name in errors().sources))
    draws = run_draws(ico_setting(), model, 3, range(2))
    assert np.isfinite(draws).all()
    assert (draws == draws[:, :1]).all()
    table = table_of_draws(model, draws)
    assert (table.cost.value == 0).all()
    assert (table.together.value == 0).all()
    assert (table.share == 0).all()


def test_isotropic_scale() -> None:
    """A print 1 + s times as large divides all estimated translations by that and changes nothing else."""
    setting, size = ico_setting(), 0.01
    shape = displaced_shape(setting.target, {"scale": np.array([[size]])}, model=errors())
    pixel = seen_px(setting, centers_mm(shape))
    row, found = solved(setting, pixel, true_shape(shape, setting.seen), None)
    true = np.array(setting.cam_from_target)
    origin = setting.anchor.problem.origin_mm
    translation = found.cam_from_target[:, :3, 3] - found.cam_from_target[:, :3, :3] @ origin
    np.testing.assert_allclose(translation, true[:, :3, 3] / (1 + size), atol=1e-7)
    for name in ("reprojection", "intersection", "reconstruction", "rotation", "focal_length", "principal_point"):
        assert of(row, name) < 1e-5, name
    assert of(row, "distortion_map") < 1e-5
    assert of(row, "pose") == pytest.approx(DISTANCE_MM * size / (1 + size), rel=1e-4)
    # A ring at distance r from the origin is reconstructed that much nearer to it.
    radius = np.sqrt((setting.target.center_mm[setting.seen > 1] ** 2).sum(axis=1).mean())
    assert of(row, "reconstruction_true") == pytest.approx(radius * size, rel=0.02)


def test_rigid_motion_of_the_target_is_no_error() -> None:
    """A target that is moved as a whole costs nothing: true poses are re-expressed in its frame."""
    setting = ico_setting()
    motion = make_pose(exp_rotation(np.array([0.02, -0.03, 0.05])), np.array([1.0, -2.0, 0.5]))
    made = transform(motion, setting.target.center_mm)
    normal = setting.target.target_from_face[setting.target.ring_face, :3, 2] @ motion[:3, :3].T
    true = moved_onto(made, normal, setting.target.center_mm, setting.seen)
    row, _ = solved(setting, seen_px(setting, made), true, None)
    assert (row < 1e-6).all(), dict(zip(NAMES, row, strict=True))


def oracle(setting: Setting, found: CameraFit, pixel: Array, true: TrueShape) -> list[float]:
    """The quantities that `calib.solver.metrics` has, by it."""
    seen = replace(setting.observations, center_px=pixel)
    poses = np.array(found.cam_from_target)
    poses[:, :3, 3] -= poses[:, :3, :3] @ setting.anchor.problem.origin_mm
    solution = solve(seen, "opencv")  # for a calibration's other fields
    drawn = replace(solution, camera=found.camera, cam_from_target=poses, observations=seen)
    points = KnownPoints(true.center_mm, np.arange(len(true.plane)), true.plane)
    made = replace(drawn, observations=replace(seen, points=points))
    true_poses = setting.cam_from_target @ invert(true.moved_from_made)
    by_drawing, by_truth = predict(drawn, true_poses), predict(made, true_poses)
    poses_off, turns_off = pose(by_truth), rotation(by_truth)
    assert poses_off is not None
    assert turns_off is not None
    found_errors = [reprojection(by_drawing), intersection(by_drawing), reconstruction(by_drawing)]
    found_errors += [intersection(by_truth), reconstruction(by_truth), poses_off, turns_off]
    return [summarise(one).rmse for one in found_errors]


def test_quantities_are_those_of_the_metrics() -> None:
    """Reprojection, intersection, reconstruction, pose and rotation are what `solver.metrics` says of the solution."""
    setting = ico_setting()
    shape = drawn_shape(setting, errors("fdm-dual"), 1)
    true = true_shape(shape, setting.seen)
    pixel = seen_px(setting, centers_mm(shape)) + drawn_noise(setting, 0, 1)
    row, found = solved(setting, pixel, true, None)
    np.testing.assert_allclose(row[:7], oracle(setting, found, pixel, true), rtol=1e-8)
    off = found.camera.params - CAMERAS["opencv"].params
    assert of(row, "focal_length") == pytest.approx(np.sqrt((off[:2] ** 2).mean()))
    assert of(row, "principal_point") == pytest.approx(np.hypot(*off[2:4]))


def test_true_planes_are_those_of_the_made_target() -> None:
    """The true planes are parallel to the faces of the target that is put together, also under skew."""
    setting, model = ico_setting(), errors("fdm-dual")
    shape = drawn_shape(setting, model, 2)
    true = true_shape(shape, setting.seen)
    made = displaced(setting.target, drawn_values(setting, model, 0, 2), model=model)
    normal = made.target_from_face[made.ring_face, :3, 2] @ true.moved_from_made[:3, :3].T
    np.testing.assert_allclose(true.plane[:, :3], normal, atol=1e-12)
    np.testing.assert_allclose(true.center_mm, transform(true.moved_from_made, made.center_mm), atol=1e-10)
    np.testing.assert_allclose((true.plane[:, :3] * true.center_mm).sum(axis=1), true.plane[:, 3], atol=1e-10)


def test_alignment_is_the_best_rigid_motion() -> None:
    """No small motion brings the true shape nearer to the drawing, each ring counted as often as it is seen."""
    setting = ico_setting()
    rng = np.random.default_rng(0)
    seen = rng.integers(0, 50, setting.target.ring_count).astype(np.float64)
    true = true_shape(drawn_shape(setting, errors("fdm-dual"), 3), seen)

    def off(motion: Array) -> float:
        left = transform(motion, true.center_mm) - setting.target.center_mm
        return float(seen @ (left**2).sum(axis=1))

    for _ in range(20):
        turn, step = rng.normal(0, 1e-6, 3), rng.normal(0, 1e-4, 3)
        assert off(make_pose(exp_rotation(turn), step)) > off(np.eye(4))


@pytest.mark.parametrize("name", ["fdm-dual-calibrated", "fdm-dual"])
def test_minimum_is_that_from_scratch(name: str) -> None:
    """A draw's camera is that of a solution from scratch, far below its standard deviation, wherever it starts."""
    setting = ico_setting()
    for number in range(2):
        shape = drawn_shape(setting, errors(name), number)
        pixel = seen_px(setting, centers_mm(shape)) + drawn_noise(setting, 0, number)
        found = minimum_of(setting.anchor, np.ascontiguousarray(pixel.T))
        scratch = solve(replace(setting.observations, center_px=pixel), "opencv", setting.options)
        sigma = np.sqrt(np.diagonal(scratch.param_covariance))
        assert (np.abs(found.camera.params - scratch.camera.params) < 3e-5 * sigma).all()
        assert found.cost == pytest.approx((scratch.residual_px**2).sum(), rel=1e-9)
        bare = seen_px(setting, setting.target.center_mm) + drawn_noise(setting, 0, number)
        start = minimum_of(setting.anchor, np.ascontiguousarray(bare.T))  # of no errors, as draws have it
        near = minimum_of(setting.anchor, np.ascontiguousarray(pixel.T), start)
        np.testing.assert_allclose(near.camera.params[:4], found.camera.params[:4], atol=1e-5)


def test_large_errors_end_in_a_minimum_too() -> None:
    """Where residuals are pixels and steps from the truth lead away, the end is still a minimum."""
    setting = ico_setting()
    for number in range(3):
        pixel = seen_px(setting, centers_mm(drawn_shape(setting, errors("hand-stickers"), number)))
        found = minimum_of(setting.anchor, np.ascontiguousarray(pixel.T))
        problem = replace(setting.anchor.problem, measured_px=np.ascontiguousarray(pixel.T))
        blocks = view_blocks(problem, found.camera, found.cam_from_target, RobustLoss())
        assert blocks.cost.sum() == pytest.approx(found.cost, rel=1e-12)
        assert damped_step(blocks.products, setting.anchor.tie.row, 0.0).predicted < 1e-10 * found.cost


def test_draws_do_not_depend_on_how_they_are_run() -> None:
    """Draws are the same bit by bit in chunks, in another process's copy of the setting, and beside fewer sources."""
    setting, model = ico_setting(), errors()
    whole = run_draws(setting, model, 5, range(4))
    chunks = [run_draws(setting, model, 5, part) for part in (range(3, 4), range(3))]
    np.testing.assert_array_equal(whole, np.concatenate(chunks[::-1]))
    copy = pickle.loads(pickle.dumps(setting))  # noqa: S301 (our own)
    np.testing.assert_array_equal(whole[:1], run_draws(copy, model, 5, range(1)))
    fewer = run_draws(setting, model.only("face_tilt", "skew"), 5, range(2))
    rows = [case_names(model).index(name) for name in ("none", *model.only("face_tilt", "skew").sources)]
    np.testing.assert_array_equal(fewer[:, :-1], whole[:2, rows])
    assert not np.array_equal(whole[0], whole[1])
    assert not np.array_equal(whole[:1], run_draws(setting, model, 6, range(1)))


def test_together_is_the_source_if_there_is_one() -> None:
    """Of a single source, all together is that source."""
    draws = run_draws(ico_setting(), errors().only("skew"), 0, range(2))
    np.testing.assert_array_equal(draws[:, 1], draws[:, 2])


def test_errors_that_leave_no_target_are_failed_draws() -> None:
    """A draw that leaves no target is nan, is counted, and does not spoil the others."""
    model = errors().with_amount("ink_bleed", Amount("normal", 1.0)).only("ink_bleed", "skew")
    draws = run_draws(ico_setting(), model, 0, range(8))
    table = table_of_draws(model, draws)
    lost = table.failed[1 + model.sources.index("ink_bleed")]
    assert 0 < lost < 8
    assert table.failed[0] == 0
    assert table.failed[-1] == lost
    assert np.isfinite(table.cost.value).all()


def test_noise_has_its_covariance() -> None:
    """Drawn noise has the stated covariance, and is of its draw alone."""
    setting = ico_setting()
    noise = np.stack([drawn_noise(setting, 0, number) for number in range(400)])
    root = np.linalg.cholesky(setting.observations.cov_px2)
    white = np.linalg.solve(root, noise[..., None])[..., 0].reshape(-1, 2)
    np.testing.assert_allclose(white.T @ white / len(white), np.eye(2), atol=0.01)
    assert abs((noise[0] * noise[1]).mean()) < 0.1 * (noise[0] ** 2).mean()


def test_covariance_of_a_circle_and_of_ellipses() -> None:
    """A large circle has `variance / (pi R (1 + r / R))`; noise counts squared; ellipses turn with their axes."""
    radius = 18.0
    circle = centre_covariances(radius * np.eye(2)[None], np.array([0.45]))[0]
    growth = 1 + (FLAT_MINOR[0] / radius) ** FLAT_MINOR[1]
    assert circle[1, 1] == pytest.approx(growth * EDGE_VARIANCE / (np.pi * radius * 1.45), rel=1e-6)
    assert circle[0, 0] == pytest.approx(circle[1, 1], rel=0.05)
    half = centre_covariances(radius * np.eye(2)[None], np.array([0.45]), contrast_to_noise=50.0)[0]
    np.testing.assert_allclose(half, 4 * circle)
    flat = np.diag([20.0, 6.0])
    turn = np.array([[0.6, -0.8], [0.8, 0.6]])
    one, other = centre_covariances(np.stack([flat, turn @ flat]), np.array([0.45, 0.45]))
    np.testing.assert_allclose(other, turn @ one @ turn.T, rtol=1e-10)
    assert one[0, 0] > 4 * one[1, 1]


def corner_image(parameter: Array, reach: Array) -> tuple[Array, Array]:
    """Two blurred lines that cross at (x, y) with directions a and b, at pixels within their reach; and which these."""
    x, y, a, b = parameter
    v, u = np.mgrid[-40:41, -40:41].astype(np.float64)
    first, second = (-np.sin(t) * (u - x) + np.cos(t) * (v - y) for t in (a, b))
    across = abs(np.sin(b - a))
    near = (np.abs(first) < reach[1] * across) & (np.abs(second) < reach[0] * across)
    return erf(first / (0.7 * np.sqrt(2))) * erf(second / (0.7 * np.sqrt(2))) / 2, near


@pytest.mark.parametrize(("turn", "reach"), [(np.pi / 2, (12.0, 12.0)), (np.pi / 3, (9.0, 20.0)), (2.2, (18.0, 8.0))])
def test_covariance_of_a_corner_is_the_bound_of_its_image(turn: float, reach: tuple[float, float]) -> None:
    """The Fisher information of the image of two crossing lines of unknown directions tells it, to a tenth."""
    at = np.array([0.2, -0.3, 0.4, 0.4 + turn])
    near = corner_image(at, np.array(reach))[1]
    steps = 1e-4 * np.eye(4)
    slope = [
        (corner_image(at + s, np.array(reach))[0] - corner_image(at - s, np.array(reach))[0]) / 2e-4 for s in steps
    ]
    jacobian = np.array([one[near] for one in slope])
    expected = CORNER_VARIANCE / CORNER_BOUND * np.linalg.inv(jacobian @ jacobian.T)[:2, :2] / 100**2
    edges = np.array([[np.cos(at[2]), np.cos(at[3])], [np.sin(at[2]), np.sin(at[3])]]) * reach
    found = corner_covariances(edges[None], np.array([True]))[0]
    assert np.allclose(found, expected, atol=0.1 * np.abs(expected).max())
    assert np.trace(corner_covariances(edges[None], np.array([False]))[0]) > 4 * np.trace(found)


def test_edges_tell_as_far_as_the_fit_of_corners_uses_them() -> None:
    """What is foretold of boards with large squares is what the detector makes of them."""
    assert USED_PX == FARTHEST_PX


def test_rings_seen_are_those_the_renderer_would_show() -> None:
    """Seen are rings turned to the camera by 75 degrees or less, whole in the image, 5 px across or more."""
    setting = ico_setting()
    scene = scene_from_target(setting.target)
    for view in range(0, VIEWS, 6):
        truth = ring_truth(scene, setting.camera, setting.cam_from_target[view])
        rows = setting.observations.view == view
        ring = setting.observations.point[rows]
        np.testing.assert_allclose(setting.observations.center_px[rows], truth.center_px[ring], atol=1e-9)
        expected = truth.whole & (truth.incidence_rad <= np.radians(75)) & (truth.minor_radius_px >= LEAST_MINOR_PX)
        assert np.isin(ring, np.flatnonzero(truth.whole)).all()
        assert len(np.setxor1d(ring, np.flatnonzero(expected))) <= 0.02 * len(ring)


def test_map_error_is_the_camera_difference() -> None:
    """The error over the image is the root mean square of `camera_difference` on the same pixels."""
    camera = CAMERAS["opencv"]
    other = replace(camera, params=camera.params + np.array([3.0, -2, 8, -5, 0.01, -0.02, 1e-4, 2e-4, 0.01]))
    difference = camera_difference(camera, other)
    pixel = difference.pixel.reshape(-1, 2)
    from calib.cameras import rays

    grid = ImageGrid(np.ascontiguousarray(pixel.T), np.ascontiguousarray(rays(camera, pixel).T))
    expected = np.sqrt((difference.length_px**2).mean())
    assert map_error_px(grid, other) == pytest.approx(expected, rel=1e-9)
    assert map_error_px(grid, camera) < 1e-9


def test_map_is_of_the_seen_part() -> None:
    """Pixels of the map lie among the sightings, and reach their edge."""
    setting = board_setting()
    seen, grid = setting.observations.center_px, setting.grid.pixel.T
    assert (grid.min(axis=0) >= seen.min(axis=0) - 1e-3).all()
    assert (grid.max(axis=0) <= seen.max(axis=0) + 1e-3).all()
    assert (np.ptp(grid, axis=0) > 0.8 * np.ptp(seen, axis=0)).all()
    assert len(grid) > 100


def test_another_model_starts_from_its_best_fit() -> None:
    """Where the solved model is not the true one, its noise-free fit is the reference, and its misfit no error's."""
    setting = ico_setting("luhmann")
    assert setting.reference.model == "luhmann"
    bare = run_cases(setting, errors(), drawn_values(setting, errors(), 0, 0), still(setting))[0]
    scratch = solve(setting.observations, "luhmann", setting.options)
    assert of(bare, "focal_length") < 1e-3
    assert of(bare, "reprojection") == pytest.approx(np.sqrt((scratch.residual_px**2).sum(axis=1).mean()), rel=1e-4)


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"photos": aimed_at(ico(), 1e6)}, "none of 4 views sees"),
        ({"photos": aimed_at(ico(), -1.0)}, "must be more than 0"),
        ({"views": 0}, "give one or more"),
        ({"model": "virtual"}, "solves luhmann"),
        ({"options": SolveOptions(reject_sigma=4.0)}, "no outliers"),
    ],
)
def test_settings_that_mean_nothing_are_refused(change: dict[str, object], message: str) -> None:
    """A setting without sightings, or with options that have no place in it, is refused in one line."""
    given: dict[str, object] = {"views": 4, "photos": aimed_at(ico(), 250.0), "model": "opencv", "seed": 0}
    with pytest.raises(InputError, match=message):
        make_setting(ico(), CAMERAS["opencv"], **{**given, **change})  # type: ignore[arg-type]


def test_one_view_of_a_board_determines_nothing() -> None:
    """One view of a plane does not determine a camera, and is refused."""
    flat = board_setting().target
    with pytest.raises(InputError, match="do not determine"):
        make_setting(flat, Camera("pinhole", np.array([2500.0, 2500, 1223, 1023]), (2448, 2048)), views=1,
                     photos=aimed_at(flat, 250.0), model="opencv", seed=0)  # fmt: skip
