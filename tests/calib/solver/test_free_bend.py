"""A flat target whose bend is an unknown: the truth, the optimum, the covariances, and what others make of it."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

import calib
from calib.cameras import project
from calib.core.se3 import exp_rotation
from calib.core.types import KnownPoints, Observations
from calib.observe.calibration_file import Provenance, read_calibration, write_calibration
from calib.solver.calibration import TERMS, Calibration, plane_bend
from calib.solver.metrics.errors import summarise
from calib.solver.metrics.evaluation import evaluate_held_out, evaluate_on
from calib.solver.plan import plan_from_words
from calib.solver.problem import SolveOptions
from calib.solver.solve import solve
from designer.base.arrays import Array
from designer.base.errors import InputError
from tests.support.solver_scenes import CAMERAS, board, icosahedron, observe, pose_from, poses_around

BOARD = board(9, 7)
SIGMA = (0.5, 0.5, 0.02, 0.02, 0.02)
"""Less than photos tell of the first two, and about as much of the others."""
HEIGHT = (-1.1, 0.4, 0.3, -0.2, 0.1)
FREE = SolveOptions(free_bend=True)


def bent_board() -> KnownPoints:
    """The board as it is, by the formula."""
    x, y = (BOARD.position_mm[:, :2] / np.abs(BOARD.position_mm[:, :2]).max(axis=0)).T
    a, b, c, d, e = HEIGHT
    step = a * (1 - x**2) + b * (1 - y**2) + c * x * y + d * y * (1 - x**2) + e * x * (1 - y**2)
    return replace(BOARD, position_mm=BOARD.position_mm + step[:, None] * [0.0, 0, 1])


def seen(seed: int, noise_px: float, views: int = 9) -> Observations:
    """Photos of the bent board, which is taken to be flat."""
    rng = np.random.default_rng(seed)
    found = observe(CAMERAS["opencv"], bent_board(), poses_around(views, rng), rng, noise_px=noise_px)
    return replace(found, points=BOARD)


def test_the_bend_and_the_camera_are_found() -> None:
    """Within 4.5 sigma of the truth, all of them; flat, the same photos are left off by more than a pixel."""
    found = solve(seen(0, 0.1), "opencv", FREE)
    bend = found.target_bend
    assert bend is not None
    assert found.status == "converged"
    assert (np.abs(np.subtract(bend.height_mm, HEIGHT)) < 4.5 * np.array(bend.sigma_mm)).all()
    assert max(bend.sigma_mm) < 0.03
    off = np.abs(found.camera.params - CAMERAS["opencv"].params)
    assert (off < 4.5 * np.sqrt(np.diagonal(found.param_covariance))).all()
    assert found.scale == pytest.approx(0.1, rel=0.1)
    assert solve(found.observations, "opencv").scale == pytest.approx(found.scale, rel=5e-3)
    assert solve(seen(0, 0.1), "opencv").scale > 5 * found.scale
    assert found.remarks[0].startswith(f"the target is bent: its middle stands {bend.height_mm[0]:.3g} ± ")


def test_it_is_the_optimum_of_all_unknowns_and_so_are_the_covariances() -> None:
    """By differences of residuals and belief: their gradient is zero, and J'J's inverse by the scale is as stated."""
    found = solve(seen(1, 0.1, views=4), "opencv", replace(FREE, bend_sigma_mm=SIGMA))
    bend = found.target_bend
    assert bend is not None
    jacobian, residual = _by_differences(found)
    believed = np.zeros((TERMS, jacobian.shape[1]))
    believed[:, :TERMS] = found.scale * np.diag(1 / np.array(SIGMA))
    jacobian, residual = np.vstack([jacobian, believed]), np.append(residual, believed[:, :TERMS] @ bend.height_mm)
    scale = np.linalg.norm(jacobian, axis=0)
    assert np.abs(jacobian.T @ residual / scale).max() < 1e-3 * np.linalg.norm(residual)
    unit = jacobian / scale
    covariance = found.scale**2 * np.linalg.inv(unit.T @ unit) / np.outer(scale, scale)
    assert bend.covariance == pytest.approx(covariance[:TERMS, :TERMS], rel=2e-3, abs=1e-9)
    count = len(found.camera.params)
    of_camera = slice(TERMS, TERMS + count)
    assert np.allclose(found.param_covariance / covariance[of_camera, of_camera], 1, rtol=1e-2)
    of_first = slice(TERMS + count, TERMS + 6 + count)
    expected = np.sqrt(np.diagonal(covariance[of_first, of_first]))
    assert np.sqrt(np.diagonal(found.pose_covariance[0])) == pytest.approx(expected, rel=1e-3)


def _by_differences(found: Calibration) -> tuple[Array, Array]:
    """Derivatives of all residuals by the bend, the camera and the poses, and the residuals."""
    bend = found.target_bend
    assert bend is not None
    flat, count, views = bend.flattened(found.observations), len(found.camera.params), len(found.cam_from_target)

    def residual(step: Array) -> Array:
        heights = tuple(np.add(bend.height_mm, step[:TERMS]).tolist())
        place = replace(bend, height_mm=heights).bent(flat).points.position_mm[flat.point]
        pose = step[TERMS + count :].reshape(views, 6)
        turned = np.stack(
            [exp_rotation(one[:3]) @ old[:3, :3] for one, old in zip(pose, found.cam_from_target, strict=True)]
        )
        shift = found.cam_from_target[:, :3, 3] + pose[:, 3:]
        point = np.einsum("mij,mj->mi", turned[flat.view], place) + shift[flat.view]
        camera = replace(found.camera, params=found.camera.params + step[TERMS : TERMS + count])
        return (project(camera, point) - flat.center_px).reshape(-1)

    size = np.concatenate([[1e-3] * TERMS, [1e-2] * 4, [1e-5] * (count - 4), np.tile([1e-6] * 3 + [1e-3] * 3, views)])
    columns = [(residual(step) - residual(-step)) / (2 * step.max()) for step in np.diag(size)]
    return np.stack(columns, axis=1), residual(np.zeros(len(size)))


def test_other_photos_show_the_bent_target_too() -> None:
    """Without noise nothing is left of other photos, of photos held out, nor of a flat board."""
    found = solve(seen(2, 0.0), "opencv", FREE)
    for told in (
        evaluate_on(found, seen(3, 0.0), "others"),
        evaluate_held_out(found, lambda part: solve(part, "opencv", FREE), 3),
    ):
        assert told.remarks == ()
        assert max(summarise(errors).largest for errors in told.errors if errors.metric != "rotation") < 1e-5
    flat = observe(CAMERAS["opencv"], BOARD, poses_around(5, np.random.default_rng(4)), np.random.default_rng(4))
    bend = solve(flat, "opencv", FREE).target_bend
    assert bend is not None
    assert np.abs(bend.height_mm).max() < 1e-6


def test_outliers_are_weighed_down_in_the_bend_too() -> None:
    """With a loss that forgives, 2 % of gross errors move the bend by less than four sigma."""
    wild = seen(5, 0.1)
    rows = np.random.default_rng(6).random(len(wild.view)) < 0.02
    wild = replace(wild, center_px=wild.center_px + np.where(rows[:, None], [[20.0, -15.0]], 0.0))
    bend = solve(wild, "opencv", replace(FREE, loss="cauchy")).target_bend
    assert bend is not None
    assert (np.abs(np.subtract(bend.height_mm, HEIGHT)) < 4 * np.array(bend.sigma_mm)).all()


def test_a_bend_is_kept_in_files(tmp_path: Path) -> None:
    """It reads back bit for bit, with the bent points, and the camera judges other photos as before."""
    found = solve(seen(7, 0.1, views=5), "opencv", FREE)
    write_calibration(tmp_path, found, Provenance("test 1", options=FREE))
    back, _ = read_calibration(tmp_path / "calibration.json")
    assert back.target_bend is not None
    assert found.target_bend is not None
    assert np.array_equal(back.target_bend.axes, found.target_bend.axes)
    for name in ("middle_mm", "half_mm", "height_mm", "covariance_mm2"):
        assert getattr(back.target_bend, name) == getattr(found.target_bend, name)
    assert np.array_equal(back.observations.points.position_mm, found.observations.points.position_mm)
    other = seen(8, 0.1)
    told, again = evaluate_on(found, other, "b"), calib.evaluate(tmp_path, on=other).asked
    assert [summarise(one) for one in told.errors] == [summarise(one) for one in again.errors]


def test_the_axes_are_those_of_the_target_wherever_its_plane_lies() -> None:
    """Along x lies the first axis of the target that lies in the plane, along z the side that is seen."""
    turn = exp_rotation(np.array([np.pi / 2, 0, 0]))
    points = replace(BOARD, position_mm=BOARD.position_mm @ turn.T + [5, 6, 7], plane=np.array([[0.0, -1, 0, -6]]))
    bend = plane_bend(points)
    assert np.abs(bend.axes - [[1, 0, 0], [0, 0, 1], [0, -1, 0]]).max() < 1e-12
    assert bend.middle_mm == pytest.approx((5, 6, 7))
    assert bend.half_mm == pytest.approx(np.abs(BOARD.position_mm[:, :2]).max(axis=0))
    middle = np.outer([1, 1, 0, 0, 0], [0, -1, 0])
    assert bend.modes_mm(np.array([[5.0, 6, 7]])) == pytest.approx(middle[:, None])


def test_what_cannot_be_is_refused_in_a_line() -> None:
    """A solid, distances in space, a learned map."""
    rng = np.random.default_rng(9)
    solid = observe(CAMERAS["opencv"], icosahedron(), poses_around(5, rng), rng, noise_px=0.1)
    with pytest.raises(InputError, match="lie in no plane; it is for boards"):
        solve(solid, "opencv", FREE)
    with pytest.raises(InputError, match="leave --minimise ray out"):
        solve(seen(0, 0.1), "opencv", replace(FREE, minimise="ray"))
    with pytest.raises(InputError, match="model virtual is learned from a target as it is given"):
        calib.solve(seen(0, 0.1), model="virtual", free_bend=True)


def test_a_bend_that_is_left_out_for_what_is_minimised_is_said_once() -> None:
    """Of a board whose bend would be an unknown; not where nobody wants it, nor of what minimises in the image."""
    said = "the target is taken to be flat, as --minimise ray does not go with its bend"
    found = calib.solve(seen(0, 0.1), model="pinhole", minimise="ray")
    assert found.best.calibration.remarks.count(said) == 1
    for told in ({}, {"minimise": "ray", "free_bend": False}):
        assert not plan_from_words("pinhole", **told).flat_remark(None, BOARD)  # type: ignore[arg-type]  # by name
    assert not plan_from_words("pinhole", minimise="ray").flat_remark(None, icosahedron())


def test_what_photos_do_not_tell_is_as_open_as_before() -> None:
    """Of a board far away, by a camera that is known, the bend stays zero, and as sure as it was believed to be."""
    one = observe(CAMERAS["pinhole"], BOARD, pose_from((0.0, 0.0, 1e5)), np.random.default_rng(0), noise_px=0.1)
    fixed = tuple((name, value) for name, value in CAMERAS["pinhole"].parameters.items())
    bend = solve(one, "pinhole", replace(FREE, fixed=fixed, bend_sigma_mm=SIGMA)).target_bend
    assert bend is not None
    assert bend.sigma_mm == pytest.approx(SIGMA, rel=1e-2)
    assert (np.abs(bend.height_mm) < 0.1 * np.array(SIGMA)).all()
