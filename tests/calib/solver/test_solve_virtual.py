"""The virtual camera, solved: from one photo of a board, and from all views of anything."""

from dataclasses import replace

import numpy as np
import pytest

from calib.cameras import project, rays
from calib.cameras.camera import Camera
from calib.cameras.learned import known_at
from calib.core.se3 import exp_rotation, invert, look_at, transform
from calib.core.types import Observations
from calib.solver.calibration import Calibration
from calib.solver.learn_views import _without_gauge
from calib.solver.problem import SolveOptions
from calib.solver.solve import solve
from calib.solver.solve_virtual import choose_view, on_plane_mm, sensor_points, solve_virtual
from calib.solver.start import solve_poses
from designer.base.errors import InputError
from tests.support.solver_scenes import (
    CAMERAS,
    SIZE,
    icosahedron,
    moved_points,
    noisy,
    observe,
    poses_around,
    random_covariances,
)
from tests.support.virtual_scenes import angle_px, large_board, through_waves, true_rays

NOISE_PX = 0.03
LENS = CAMERAS["opencv"]
FRONT = look_at(np.array([[20.0, 10, 300]]), np.array([[2.0, 1, 0]]), np.array([0.1]))
"""A pose from which a board fills the image."""


def poses_of_board(count: int, rng: np.random.Generator) -> np.ndarray:
    """Poses (V, 4, 4): from all around, and the last so that the board fills the image."""
    return np.concatenate([poses_around(count - 1, rng, distance_mm=330.0, aim_mm=40.0), FRONT])


def seen_board(seed: int, *, waves: bool, views: int = 16) -> tuple[Observations, np.ndarray]:
    """A board through a lens, and the true poses."""
    rng = np.random.default_rng(seed)
    poses = poses_of_board(views, rng)
    seen = observe(LENS, large_board(), poses, rng)
    return noisy(through_waves(seen) if waves else seen, NOISE_PX, rng), poses


def seen_icosahedron(seed: int, *, waves: bool, views: int = 30) -> tuple[Observations, np.ndarray]:
    """An icosahedron through a lens, and the true poses."""
    rng = np.random.default_rng(seed)
    poses = poses_around(views, rng, half_angle_deg=175, distance_mm=280.0, aim_mm=40.0)
    seen = observe(LENS, icosahedron(rings_per_side=8), poses, rng)
    return noisy(through_waves(seen) if waves else seen, NOISE_PX, rng), poses


def ray_error_px(camera: Camera, seen: Observations, *, waves: bool) -> float:
    """Root mean square error of a camera's rays at the pixels of other views, in px."""
    truth = true_rays(seen.center_px, LENS) if waves else rays(LENS, seen.center_px)
    return float(np.sqrt(np.nanmean(angle_px(truth, rays(camera, seen.center_px)) ** 2)))


def centres(cam_from_target: np.ndarray) -> np.ndarray:
    """Where the cameras stand in the target's frame.  # (V, 3)"""
    return invert(cam_from_target)[:, :3, 3]


@pytest.fixture(scope="module")
def board_solved() -> tuple[Calibration, np.ndarray]:
    """A board behind a wavy lens, solved from one photo, and the true poses."""
    seen, poses = seen_board(1, waves=True)
    return solve_virtual(seen), poses


@pytest.fixture(scope="module")
def ico_solved() -> tuple[Calibration, np.ndarray]:
    """An icosahedron behind a wavy lens, solved from all views, and the true poses."""
    seen, poses = seen_icosahedron(1, waves=True)
    return solve_virtual(seen), poses


def test_board_behind_a_wavy_lens(board_solved: tuple[Calibration, np.ndarray]) -> None:
    """Where no polynomial fits the lens, rays of other views are ten times better than those of the lens models."""
    solved, _ = board_solved
    other, _ = seen_board(2, waves=True)
    assert solved.status == "converged"
    assert "learned from view15.png" in solved.remarks[0]  # the one that fills the image
    off = ray_error_px(solved.camera, other, waves=True)
    assert off < 0.6 * NOISE_PX
    for model in ("luhmann", "opencv"):
        assert off < 0.1 * ray_error_px(solve(solved.observations, model).camera, other, waves=True)


def test_icosahedron_behind_a_wavy_lens(ico_solved: tuple[Calibration, np.ndarray]) -> None:
    """So it is with a target that spans no plane, where all views tell the map."""
    solved, _ = ico_solved
    other, _ = seen_icosahedron(2, waves=True)
    assert solved.status == "converged"
    off = ray_error_px(solved.camera, other, waves=True)
    assert off < 0.8 * NOISE_PX
    for model in ("luhmann", "opencv"):
        assert off < 0.1 * ray_error_px(solve(solved.observations, model).camera, other, waves=True)


@pytest.mark.parametrize("all_views", [False, True])
def test_polynomial_lens_is_met_closely(all_views: bool) -> None:
    """Behind a lens that the model `opencv` is true for, the rays are good to a part of the noise."""
    seen, _ = seen_board(3, waves=False)
    other, _ = seen_board(4, waves=False)
    solved = solve_virtual(seen, all_views=all_views)
    assert ray_error_px(solved.camera, other, waves=False) < (0.35 if all_views else 0.6) * NOISE_PX


def test_all_views_of_a_board_tell_more_than_one(board_solved: tuple[Calibration, np.ndarray]) -> None:
    """The map of all views is at least twice as good as that of one photo."""
    one, _ = board_solved
    seen, _ = seen_board(1, waves=True)
    other, _ = seen_board(2, waves=True)
    every = solve_virtual(seen, all_views=True)
    assert "from all 16 views" in every.remarks[0]
    assert ray_error_px(every.camera, other, waves=True) < 0.5 * ray_error_px(one.camera, other, waves=True)


def test_poses_are_those_of_the_camera(ico_solved: tuple[Calibration, np.ndarray]) -> None:
    """Solved from all views, positions are true, and the frame is that of the real camera."""
    solved, truth = ico_solved
    assert np.linalg.norm(centres(solved.cam_from_target) - centres(truth), axis=1).max() < 0.2
    turn = solved.cam_from_target[:, :3, :3] @ truth[:, :3, :3].transpose(0, 2, 1)
    assert np.abs(turn - np.eye(3)).max() < 0.01  # the start's centre is drawn aside by the waves
    assert solved.camera.params == pytest.approx(LENS.params[:4], abs=30)


def test_positions_from_a_photo_of_a_board(board_solved: tuple[Calibration, np.ndarray]) -> None:
    """The virtual camera stands where the real one does, turned the same way for all views, with square pixels."""
    solved, truth = board_solved
    assert np.linalg.norm(centres(solved.cam_from_target) - centres(truth), axis=1).max() < 0.1
    turn = solved.cam_from_target[:, :3, :3] @ truth[:, :3, :3].transpose(0, 2, 1)
    assert np.abs(turn - turn[-1]).max() < 2e-4
    fx, fy, _, _ = solved.camera.params
    assert fx == pytest.approx(fy, rel=1e-4)
    assert fx == pytest.approx(2500, rel=0.05)


def test_residuals_are_in_measured_pixels(
    board_solved: tuple[Calibration, np.ndarray], ico_solved: tuple[Calibration, np.ndarray]
) -> None:
    """A residual is the image of the point minus the measured pixel, exactly; their size is the noise's."""
    for solved, _ in (board_solved, ico_solved):
        seen = solved.observations
        there = transform(solved.cam_from_target[seen.view], seen.points.position_mm[seen.point])
        assert np.abs(project(solved.camera, there) - seen.center_px - solved.residual_px).max() < 1e-9
        assert solved.scale == pytest.approx(NOISE_PX, rel=0.1)
        assert np.sqrt((solved.residual_px**2).mean()) == pytest.approx(NOISE_PX, rel=0.15)


def test_tilted_reference_weighs_pixels_alike() -> None:
    """With a reference seen aslant the sensor is stretched unevenly, but residuals in pixels are least as before."""
    rng = np.random.default_rng(5)
    aslant = look_at(np.array([[250.0, 0, 250]]), np.zeros((1, 3)), np.zeros(1))
    poses = np.concatenate([poses_of_board(12, rng), aslant])
    seen = noisy(observe(LENS, large_board(), poses, rng), NOISE_PX, rng)
    solved = solve_virtual(seen, reference="view12.png")
    assert solved.camera.learned is not None
    assert solved.scale == pytest.approx(NOISE_PX, rel=0.1)
    again = solve_poses(solved.camera, solved.observations)
    assert (again.residual_px**2).sum() == pytest.approx((solved.residual_px**2).sum(), rel=1e-3)
    assert "learned from view12.png" in solved.remarks[0]


def test_what_lies_off_the_map_is_left_out_and_said() -> None:
    """Sightings where the map is not known are missing, counted in a remark; views without enough of them too."""
    rng = np.random.default_rng(6)
    far = look_at(np.array([[20.0, 10, 900]]), np.array([[2.0, 1, 0]]), np.array([0.1]))
    aside = look_at(np.array([[0.0, 0, 900]]), np.array([[280.0, 230, 0]]), np.array([0.0]))
    poses = np.concatenate([poses_of_board(10, rng), far, aside])
    seen = noisy(observe(LENS, large_board(), poses, rng), NOISE_PX, rng)
    solved = solve_virtual(seen, reference="view10.png")
    kept = solved.observations
    assert "view11.png" not in kept.view_names
    assert len(kept.view) < len(seen.view)
    assert f"{len(seen.view) - len(kept.view)} of {len(seen.view)} observations" in " ".join(solved.remarks)
    assert "1 of 12 views left out, with fewer than 6" in " ".join(solved.remarks)
    assert solved.camera.learned is not None
    assert known_at(solved.camera.learned, SIZE, kept.center_px).all()
    assert np.isfinite(solved.residual_px).all()
    assert len(solved.cam_from_target) == kept.view_count == len(solved.pose_covariance)


def test_photo_of_a_board_spans_the_sensor_of_an_icosahedron() -> None:
    """With a board's photo as the reference, an icosahedron's pinhole is solved behind that map."""
    rng = np.random.default_rng(7)
    board = replace(
        noisy(through_waves(observe(LENS, large_board(), FRONT, rng)), NOISE_PX, rng), view_names=("board.png",)
    )
    seen, truth = seen_icosahedron(7, waves=True)
    solved = solve_virtual(seen, reference=board)
    assert "learned from board.png" in solved.remarks[0]
    assert np.linalg.norm(centres(solved.cam_from_target) - centres(truth), axis=1).max() < 0.2
    assert ray_error_px(solved.camera, board, waves=True) < 0.8 * NOISE_PX
    with pytest.raises(InputError, match=r"board\.png: 2448 x 2048 px, but the photos have 1000 x 800"):
        solve_virtual(replace(seen, image_size=(1000, 800)), reference=board)


def test_weights_are_those_of_the_measured_pixels() -> None:
    """With true covariances the scale is 1, and the poses are better than without."""
    rng = np.random.default_rng(8)
    poses = poses_of_board(10, rng)
    seen = observe(LENS, large_board(), poses, rng)
    covariance = random_covariances(len(seen.view), rng)
    noise = np.einsum("nij,nj->ni", np.linalg.cholesky(covariance), rng.standard_normal((len(seen.view), 2)))
    seen = replace(seen, center_px=seen.center_px + noise, cov_px2=covariance)
    weighted = solve_virtual(seen, SolveOptions(weighted=True))
    assert weighted.weighted
    assert weighted.scale == pytest.approx(1, abs=0.15)
    alike = solve_virtual(seen, SolveOptions(weighted=False))
    assert not alike.weighted
    off = [np.linalg.norm(centres(one.cam_from_target) - centres(poses), axis=1).mean() for one in (weighted, alike)]
    assert off[0] < 0.95 * off[1]


def test_outliers_leave_the_map_on_request() -> None:
    """A point gone astray in the reference photo does not bend the map when outliers are to be left out."""
    seen, _ = seen_board(9, waves=True)
    pixel = np.array(seen.center_px)
    astray = np.flatnonzero(seen.view == 15)[40:45]
    pixel[astray] += 3.0
    solved = solve_virtual(replace(seen, center_px=pixel), SolveOptions(reject_sigma=6.0), "view15.png")
    other, _ = seen_board(2, waves=True)
    assert ray_error_px(solved.camera, other, waves=True) < 0.6 * NOISE_PX
    assert solved.remarks[1].startswith("5 of 311 points of view15.png left out of the map")
    assert solved.is_outlier.sum() >= 5


def test_bumpy_board_takes_all_views() -> None:
    """A measured board that is not flat spans no sensor; the map is learned from all its views."""
    seen, _ = seen_board(12, waves=False, views=8)
    bumps = np.random.default_rng(12).normal(0, 0.2, (357, 3)) * [0, 0, 1]
    solved = solve_virtual(replace(seen, points=replace(seen.points, position_mm=seen.points.position_mm + bumps)))
    assert "from all 8 views" in solved.remarks[0]


def test_what_cannot_be_done_ends_in_one_line() -> None:
    """A view that is not there, a target without a plane, and too few views are refused in one line."""
    seen, _ = seen_board(13, waves=False, views=6)
    with pytest.raises(InputError, match=r"nowhere\.png: no such view"):
        solve_virtual(seen, reference="nowhere.png")
    with pytest.raises(InputError, match="either from a reference photo or from all views"):
        solve_virtual(seen, reference="view1.png", all_views=True)
    solid, _ = seen_icosahedron(13, waves=False, views=2)
    with pytest.raises(InputError, match=r"view0\.png: the points of this target lie on no plane"):
        solve_virtual(solid, reference="view0.png")
    with pytest.raises(InputError, match="2 views to learn a map of the lens from: at least 3"):
        solve_virtual(solid)


def test_of_photos_that_fill_the_image_the_most_frontal_is_the_reference() -> None:
    """Seen aslant, the sensor would be stretched."""
    tilted = look_at(np.array([[110.0, 10, 280]]), np.array([[2.0, 1, 0]]), np.array([0.1]))
    poses = np.concatenate([tilted, FRONT, tilted])
    both = observe(LENS, large_board(), poses, np.random.default_rng(10))
    plane = on_plane_mm(both.points, both.point)
    assert plane is not None
    assert choose_view(both, plane) == 1


def test_gauge_is_taken_out_of_a_step() -> None:
    """What a turn of the camera or another pinhole does to the sensor's points is not a change of the map."""
    rng = np.random.default_rng(0)
    params = np.array([2500.0, 2400, 1200, 1000])
    point = rng.uniform(0, 2000, (400, 2))
    ray = np.column_stack([(point - params[2:]) / params[:2], np.ones(400)]) @ exp_rotation(1e-5 * rng.normal(size=3)).T
    other = params + 1e-2 * rng.normal(size=4)
    step = ray[:, :2] / ray[:, 2:] * other[:2] + other[2:] - point
    variance = rng.uniform(0.5, 2, 400)
    assert np.abs(step).max() > 1e-2
    assert np.abs(_without_gauge(step, point, params, variance)).max() < 1e-5
    bend = 1e-2 * ((point[:, :1] - 1000) / 1000) ** 3 * [[1.0, 0.0]]
    rest = _without_gauge(bend + step, point, params, variance)
    assert np.abs(rest - _without_gauge(bend, point, params, variance)).max() < 1e-5
    assert np.abs(rest).max() > 1e-3


def test_sensor_is_an_image_of_the_plane() -> None:
    """The sensor's points are the plane's, turned, scaled and moved: like the image in its middle, never mirrored."""
    rng = np.random.default_rng(11)
    seen = observe(CAMERAS["pinhole"], large_board(), FRONT, rng)
    plane = on_plane_mm(seen.points, seen.point)
    assert plane is not None
    for sign in (1, -1):
        point = sensor_points(seen.center_px, plane[seen.point] * [1, sign])
        distance = np.linalg.norm(point - point[0], axis=1)
        millimetres = np.linalg.norm(plane[seen.point] - plane[seen.point][0], axis=1)
        scale = distance[1:] / millimetres[1:]
        assert np.ptp(scale) < 1e-9 * scale[0]
        near = np.linalg.norm(seen.center_px - seen.center_px.mean(axis=0), axis=1) < 200
        assert np.abs(point - seen.center_px)[near].max() < 10
    bumpy = replace(seen.points, position_mm=seen.points.position_mm + rng.normal(0, 0.05, (357, 3)))
    assert on_plane_mm(bumpy, seen.point) is None
    turned = moved_points(seen.points, look_at(np.array([[5.0, 7, 9]]), np.zeros((1, 3)), np.zeros(1))[0])
    again = on_plane_mm(turned, seen.point)
    assert again is not None
    assert np.linalg.norm(again[5] - again[300]) == pytest.approx(np.linalg.norm(plane[5] - plane[300]))
