"""Cameras with a surface: their equations, what is believed of the surface, and what is solved."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.interpolate import BSpline

from calib.cameras import linearise, project, rays
from calib.cameras.camera import Camera
from calib.cameras.refit import camera_difference
from calib.cameras.splined import MODEL
from calib.core.linear_algebra import moved_covariance
from calib.core.types import Observations, keep_views
from calib.solver.accuracy import UndeterminedError, projected_change
from calib.solver.calibration import Calibration
from calib.solver.problem import SolveOptions, pack
from calib.solver.solve import solve
from calib.solver.surface_equations import Smoothness, eliminated, places, precision, roughness, surface_equations
from designer.base.errors import InputError
from designer.base.packed import pack_covariance, unpack_covariance
from tests.support.solver_scenes import board, observe, poses_around, random_covariances

SIZE = (1000, 800)
NOISE_PX = 0.05


def wavy(size_px: float = 3.0) -> Camera:
    """A fisheye whose image is displaced by waves that no polynomial of the angle follows."""
    row, column = np.mgrid[: MODEL.control_rows, : MODEL.control_columns]
    waves = np.stack([np.sin(0.5 * column) * np.cos(0.4 * row), np.cos(0.45 * column + 1) * np.sin(0.35 * row)])
    base = [500.0, 502.0, 495.0, 402.0, -0.02, 0.005, -0.002, 0.0002]
    return Camera("splined", np.concatenate([base, size_px * waves.ravel()]), SIZE)


def scene(camera: Camera, views: int, seed: int = 3, noise_px: float = NOISE_PX) -> Observations:
    """Photos of a board."""
    rng = np.random.default_rng(seed)
    poses = poses_around(views, rng, half_angle_deg=45, distance_mm=170, aim_mm=40)
    return observe(camera, board(), poses, rng, noise_px=noise_px)


def less_turn(found: Calibration, pixel: np.ndarray, off: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Errors (N, 2) of pixels, and what their covariances are to be, less the turn of the camera that poses take up."""
    ray = rays(found.camera, pixel)
    linear = linearise(found.camera, np.ascontiguousarray(ray.T))
    by_turn = np.cross(ray[:, None, :], linear.by_point.transpose(2, 0, 1)).reshape(-1, 3)
    fields = np.concatenate([linear.by_params.transpose(2, 0, 1), off[:, :, None]], axis=2)
    fields = fields.reshape(2 * len(pixel), -1)
    rest = (fields - by_turn @ np.linalg.lstsq(by_turn, fields, rcond=None)[0]).reshape(len(pixel), 2, -1)
    change = rest[:, :, :-1]
    return rest[:, :, -1], moved_covariance(change, found.param_covariance)


def test_equations_are_those_of_all_derivatives() -> None:
    """Products that leave out the zeros are those of the dense derivatives, with covariances, weights and a bend."""
    rng, camera = np.random.default_rng(1), wavy()
    poses = poses_around(3, rng, distance_mm=250)
    seen = observe(camera, board(5, 4), poses, rng, noise_px=1.0)
    problem = pack(replace(seen, cov_px2=random_covariances(len(seen.view), rng)), weighted=True)
    moved = np.array(poses)
    moved[:, :3, 3] += poses[:, :3, :3] @ problem.origin_mm
    weight = rng.uniform(0, 1, len(seen.view))
    modes_mm = rng.standard_normal((2, 3, len(seen.view)))
    problem = replace(problem, modes_mm=modes_mm, amount=np.zeros(2))
    found = surface_equations(problem, MODEL, camera, moved, weight)

    turned, point = places(problem, moved)
    linear = linearise(camera, np.ascontiguousarray(point))
    by_point = linear.by_point.transpose(2, 0, 1)
    pose = np.zeros((len(seen.view), 2, 6 * 3))
    for n, view in enumerate(problem.view.tolist()):
        pose[n, :, 6 * view : 6 * view + 3] = np.cross(turned[:, n], by_point[n])
        pose[n, :, 6 * view + 3 : 6 * view + 6] = by_point[n]
    a, b, c = problem.whitener * np.sqrt(weight)
    whitener = np.stack([a, np.zeros_like(a), b, c], axis=1).reshape(-1, 2, 2)
    residual = (linear.pixel - problem.measured_px).T[:, :, None]
    by_modes = by_point @ poses[problem.view, :3, :3] @ modes_mm.transpose(2, 1, 0)
    rows = whitener @ np.concatenate([by_modes, linear.by_params.transpose(2, 0, 1), pose, residual], axis=2)
    flat = rows.reshape(-1, rows.shape[2])
    product, size = flat.T @ flat, 2 + len(camera.params)

    assert np.abs(found.normal - product[:size, :size]).max() < 1e-9 * np.abs(product).max()
    assert np.abs(found.gradient - product[:size, -1]).max() < 1e-9 * np.abs(product[:, -1]).max()
    assert np.abs(found.by_pose.reshape(-1, size) - product[size:-1, :size]).max() < 1e-9 * np.abs(product).max()
    less = product[:size, :size] - product[:size, size:-1] @ np.linalg.solve(
        product[size:-1, size:-1], product[size:-1, :size]
    )
    assert np.abs(eliminated(found).normal - less).max() < 1e-8 * np.abs(product).max()


def test_roughness_is_the_integral_of_squared_derivatives() -> None:
    """Sums over control points are the integrals of a surface's squared derivatives, by scipy's splines and sums."""
    rows, columns, scale = 5, 6, np.array([[-50.0, 0.01], [-20.0, 0.02]])
    unit_px, control = 80.0, np.random.default_rng(2).standard_normal((rows, columns))
    parts = roughness(scale, (rows, columns), unit_px)

    def along(count: int, order: int, place: np.ndarray, per_px: float) -> np.ndarray:
        knots = np.arange(-3.0, count + 1)
        one = [BSpline(knots, np.eye(count)[k], 3)(place, nu=order) for k in range(count)]
        return np.stack(one, axis=1) * (unit_px * per_px) ** order

    node, share = np.polynomial.legendre.leggauss(6)
    spans = [np.concatenate([k + 0.5 * (node + 1) for k in range(count - 3)]) for count in (rows, columns)]
    weights = [np.tile(0.5 * share, count - 3) for count in (rows, columns)]
    area = weights[0][:, None] * weights[1] / (unit_px**2 * scale[0, 1] * scale[1, 1])
    for order, factors in enumerate(((1,), (1, 1), (1, 2, 1), (1, 3, 3, 1))):
        expected = 0.0
        for across, factor in enumerate(factors):
            down = along(rows, order - across, spans[0], scale[1, 1])
            right = along(columns, across, spans[1], scale[0, 1])
            expected += factor * float((area * (down @ control @ right.T) ** 2).sum())
        assert control.ravel() @ parts[order] @ control.ravel() == pytest.approx(expected, rel=1e-10)


def test_the_prior_has_the_amplitude_that_it_is_given() -> None:
    """In the middle of the domain a displacement has about the standard deviation of the belief."""
    scale, half = MODEL.scale(SIZE), 0.5 * float(np.hypot(*SIZE))
    parts = roughness(scale, (MODEL.control_rows, MODEL.control_columns), half)
    covariance = np.linalg.inv(precision(parts, Smoothness(0.5, 7.0)))
    camera = Camera("splined", np.concatenate([wavy().params[:8], np.zeros(768)]), SIZE)
    middle = linearise(camera, np.ascontiguousarray(rays(camera, np.array([[499.5, 399.5]])).T))
    by_control = middle.by_params[0, 8 : 8 + len(covariance), 0]
    assert np.sqrt(by_control @ covariance @ by_control) == pytest.approx(7.0, rel=0.05)


def test_a_lens_of_no_formula_is_solved_with_honest_covariances() -> None:
    """Held-out pixels are off by what the covariance states, far less than the base leaves; the fixed stays fixed."""
    truth = wavy()
    seen = scene(truth, 12)
    base, found = solve(seen, MODEL.base.name), solve(seen, MODEL.name)
    assert found.status == "converged"
    assert found.scale == pytest.approx(NOISE_PX, rel=0.05)
    assert base.scale > 5 * found.scale
    u, v = np.meshgrid(np.linspace(200, 800, 13), np.linspace(200, 600, 9))
    pixel = np.stack([u.ravel(), v.ravel()], axis=1)
    ray = rays(truth, pixel)
    turn = camera_difference(truth, found.camera, radius_px=400).b_from_a
    off, covariance = less_turn(found, pixel, project(found.camera, ray @ turn.T) - pixel)
    square = np.einsum("ni,nij,nj->n", off, np.linalg.inv(covariance), off)
    assert np.sqrt((off**2).sum(axis=1).mean()) < 0.06
    assert 0.3 < square.mean() / 2 < 3.0  # on average 1
    # Far from most sightings less is known.
    edge = moved_covariance(projected_change(found.camera, np.array([[20.0, 399.5]])), found.param_covariance)[0]
    assert np.trace(edge) > 10 * np.trace(covariance.mean(axis=0))


def test_outliers_are_left_out_and_parameters_fixed() -> None:
    """What lies far off is left out as of other models, not what only the base does not follow; k4 keeps its value."""
    seen = scene(wavy(), 12)
    moved = np.array(seen.center_px)
    moved[::50] += [9.0, -7.0]
    found = solve(replace(seen, center_px=moved), MODEL.name, SolveOptions(reject_sigma=6, fixed=(("k4", 0.0),)))
    assert np.array_equal(np.flatnonzero(found.is_outlier), np.arange(0, len(moved), 50))
    assert found.camera.parameters["k4"] == 0
    assert found.scale == pytest.approx(NOISE_PX, rel=0.1)


def test_what_does_not_do_is_refused_in_a_line() -> None:
    """Too few sightings or photos, control points to fix, and distances in space."""
    few = keep_views(scene(wavy(), 3), np.array([True, True, False]))
    with pytest.raises(UndeterminedError, match=r"observations in 2 views: too few for the surface .* solve fisheye"):
        solve(few, MODEL.name)
    with pytest.raises(InputError, match="model splined has no parameter 'du_row0_column0_px'; it has fx_px"):
        solve(few, MODEL.name, SolveOptions(fixed=(("du_row0_column0_px", None),)))
    with pytest.raises(InputError, match="minimise ray: with the splined model distances in the image are minimised"):
        solve(few, MODEL.name, SolveOptions(minimise="ray"))


def test_covariances_of_hundreds_of_parameters_are_written_short() -> None:
    """Read back they are covariances whose correlations are right to 1e-4, and again the same; singular ones too."""
    rng = np.random.default_rng(4)
    root = rng.standard_normal((150, 40)) * 10.0 ** rng.uniform(-4, 3, (150, 1))
    for matrix in (root @ root.T, root @ root.T + np.diag((root**2).sum(axis=1))):
        value = pack_covariance(matrix)
        assert isinstance(value, dict)
        back = unpack_covariance(value)
        sigma = np.sqrt(np.diagonal(matrix))
        assert np.abs((back - matrix) / sigma[:, None] / sigma).max() < 1e-4
        assert np.linalg.eigvalsh(back / sigma[:, None] / sigma).min() > -1e-12
    assert np.isnan(unpack_covariance(dict(pack_covariance(np.full((101, 101), np.nan))))).all()  # type: ignore[arg-type]


@pytest.mark.parametrize(
    ("key", "wrong", "said"),
    [
        ("sigma", [1.0], "has 1 standard deviations"),
        ("sigma", ["a"] * 101, "must be numbers of 0 or more"),
        ("root_1e5", [[0.5]] * 101, "must be a triangle of 101 rows"),
        ("more", 1, "must hold sigma and root_1e5"),
    ],
)
def test_a_short_covariance_that_is_none_is_refused(key: str, wrong: object, said: str) -> None:
    """By what it must be."""
    value = pack_covariance(np.eye(101))
    assert isinstance(value, dict)
    with pytest.raises(ValueError, match=said):
        unpack_covariance({**value, key: wrong})  # type: ignore[dict-item]
