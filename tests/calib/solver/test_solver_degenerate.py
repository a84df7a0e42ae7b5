"""Observations that do not determine a camera are called degenerate, with the reason; what can be solved is solved."""

from dataclasses import replace

import numpy as np
import pytest

from calib.cameras import parameter_names
from calib.cameras.camera import Camera
from calib.core.se3 import look_at
from calib.core.types import Observations
from calib.solver.problem import SolveOptions
from calib.solver.solve import solve
from designer.base.errors import InputError
from tests.support.solver_scenes import (
    CAMERAS,
    board,
    icosahedron,
    noisy,
    observe,
    pose_from,
    poses_around,
    rows_of,
    sigma_of,
)

LENSES = ("opencv", "luhmann")
FIXED_FOCAL = SolveOptions(fixed=(("fx_px", 2500.0), ("fy_px", 2510.0)))


def frontal(views: int, noise_px: float = 0.02, model: str = "opencv") -> Observations:
    """A board seen straight on, from several distances, with and without roll."""
    distance = np.linspace(420, 600, views)
    eye = np.column_stack([np.zeros(views), np.zeros(views), distance])
    poses = look_at(eye, np.zeros((views, 3)), np.linspace(0, 2, views))
    return observe(CAMERAS[model], board(), poses, np.random.default_rng(0), noise_px=noise_px)


@pytest.mark.parametrize("noise_px", [0.0, 0.02])
@pytest.mark.parametrize("views", [1, 4])
@pytest.mark.parametrize("model", CAMERAS)
def test_views_straight_on_do_not_tell_the_focal_length(model: str, views: int, noise_px: float) -> None:
    """One or several fronto-parallel views of a plane: degenerate, and the remark says why and what to do."""
    found = solve(frontal(views, noise_px, model), model)
    assert found.status == "degenerate"
    assert "straight on" in found.remarks[0]
    assert "focal length" in found.remarks[0]
    assert "fix the focal length" in found.remarks[0]


@pytest.mark.parametrize("views", [1, 4])
def test_a_known_focal_length_makes_views_straight_on_enough(views: int) -> None:
    """With the focal lengths fixed, fronto-parallel views are solved, and the distance is right."""
    seen = frontal(views)
    found = solve(seen, "opencv", FIXED_FOCAL)
    assert found.status == "converged"
    assert found.scale == pytest.approx(0.02, rel=0.15)
    assert found.camera.params[:2].tolist() == [2500.0, 2510.0]
    distance = np.linspace(420, 600, views)
    assert np.abs(found.cam_from_target[:, 2, 3] - distance).max() < 0.2


def test_one_tilted_plane_has_too_few_equations_for_a_pinhole() -> None:
    """A homography has eight numbers; four of the camera and six of the pose are too many: degenerate."""
    seen = observe(CAMERAS["pinhole"], board(), pose_from((0.0, 300.0, 320.0)), np.random.default_rng(0), noise_px=0.02)
    found = solve(seen, "pinhole")
    assert found.status == "degenerate"
    assert "plane" in found.remarks[0]
    options = SolveOptions(shared=(("fx_px", "fy_px"),), fixed=(("cx_px", 1230.0), ("cy_px", 1010.0)))
    square = replace(CAMERAS["pinhole"], params=np.array([2500.0, 2500, 1230, 1010]))
    seen = observe(square, board(), pose_from((0.0, 300.0, 320.0)), np.random.default_rng(0), noise_px=0.02)
    found = solve(seen, "pinhole", options)
    assert found.status == "converged"
    assert abs(found.camera.params[0] - 2500) < 4 * sigma_of(found.param_covariance)[0] < 20


def test_parallel_planes_are_one_plane() -> None:
    """Views that differ by a shift and a roll about the plane's normal tell no more of the pinhole than one does."""
    rng = np.random.default_rng(1)
    tilted = pose_from((0.0, 300.0, 320.0), 0.0)[0]
    poses = np.tile(tilted, (4, 1, 1))
    poses[:, :3, 3] += np.array([[0, 0, 0], [15, 0, 20], [-15, 5, 60], [5, -15, 90]])
    found = solve(observe(CAMERAS["pinhole"], board(), poses, rng, noise_px=0.02), "pinhole")
    assert found.status == "degenerate"
    assert "focal length is not determined" in found.remarks[0]


@pytest.mark.parametrize("model", LENSES)
def test_poses_of_a_degenerate_camera_are_still_given(model: str) -> None:
    """A degenerate result has finite poses and residuals, so that a person can look at it."""
    found = solve(frontal(1), model)
    assert np.isfinite(found.cam_from_target).all()
    assert np.isfinite(found.residual_px).all()
    assert np.isfinite(found.camera.params).all()


def test_too_few_points_are_refused() -> None:
    """Fewer equations than unknowns: one line with both numbers and the remedy."""
    rng = np.random.default_rng(0)
    seen = observe(CAMERAS["opencv"], icosahedron(), pose_from((130.0, 250.0, 260.0)), rng)
    few = rows_of(seen, rng.permutation(len(seen.view))[:7])
    with pytest.raises(InputError, match="7 observations in 1 view: too few for 15 unknowns"):
        solve(few, "opencv")
    fixed = SolveOptions(fixed=tuple((name, 0.0) for name in ("k1", "k2", "p1", "p2", "k3")))
    assert solve(few, "opencv", fixed).iterations > 0


def test_as_many_equations_as_unknowns_have_no_accuracy() -> None:
    """Without redundancy there is no standard deviation to state: degenerate, and the remark says so."""
    seen = observe(CAMERAS["pinhole"], icosahedron(), pose_from((130.0, 250.0, 260.0)), np.random.default_rng(0))
    spread = np.linspace(0, len(seen.view) - 1, 10).astype(int)
    for options in (SolveOptions(), SolveOptions(fixed=tuple((name, None) for name in parameter_names("pinhole")))):
        unknowns = 6 if options.fixed else 10
        found = solve(rows_of(seen, spread[: max(unknowns // 2, 6)]), "pinhole", options)
        assert np.isnan(found.scale) == (2 * max(unknowns // 2, 6) == unknowns)


@pytest.mark.parametrize("points", [1, 3])
def test_views_without_a_pose_are_left_out_and_named(points: int) -> None:
    """A view of too few points, or of points on a line, is left out; the remark names it, the others are solved."""
    rng = np.random.default_rng(2)
    seen = observe(CAMERAS["opencv"], board(), poses_around(6, rng), rng, noise_px=0.02)
    of_one = np.flatnonzero(seen.view == 2)[:points]
    of_line = np.flatnonzero((seen.view == 4) & (seen.points.position_mm[seen.point, 1] == 0))
    rows = np.sort(np.concatenate([np.flatnonzero((seen.view != 2) & (seen.view != 4)), of_one, of_line]))
    found = solve(rows_of(seen, rows), "opencv")
    assert found.status == "converged"
    assert found.observations.view_names == ("view0.png", "view1.png", "view3.png", "view5.png")
    assert len(found.cam_from_target) == len(found.pose_covariance) == 4
    assert len(found.residual_px) == len(found.observations.view)
    assert [remark.split(":")[0] for remark in found.remarks] == ["view2.png", "view4.png"]
    assert all("left out" in remark for remark in found.remarks)


def test_a_mirrored_solid_has_no_camera() -> None:
    """An icosahedron seen in a mirror is no icosahedron: never a converged camera with small residuals."""
    rng = np.random.default_rng(0)
    seen = observe(CAMERAS["opencv"], icosahedron(), poses_around(5, rng, half_angle_deg=180), rng, noise_px=0.02)
    pixel = np.array(seen.center_px)
    pixel[:, 0] = 2447 - pixel[:, 0]
    try:
        found = solve(replace(seen, center_px=pixel), "opencv")
    except InputError:
        return
    assert found.status == "degenerate" or found.scale > 1


@pytest.mark.parametrize(
    ("options", "word"),
    [
        (SolveOptions(fixed=(("k4", 0.0),)), "no parameter 'k4'"),
        (SolveOptions(fixed=(("fx_px", -1.0),)), "fx_px"),
        (SolveOptions(fixed=(("fx_px", float("nan")),)), "fx_px"),
        (SolveOptions(focal_px=-5.0), "focal"),
        (SolveOptions(focal_px=float("nan")), "focal"),
    ],
)
def test_options_that_do_not_fit_are_refused(options: SolveOptions, word: str) -> None:
    """A name, value or group that cannot be is refused in one line that holds it."""
    rng = np.random.default_rng(0)
    seen = observe(CAMERAS["opencv"], board(), poses_around(3, rng), rng)
    with pytest.raises(InputError, match=word) as refused:
        solve(seen, "opencv", options)
    assert "\n" not in str(refused.value)


def test_steps_that_run_out_are_said() -> None:
    """A descent cut short is `stopped`, not converged, and the remark says so."""
    rng = np.random.default_rng(0)
    seen = observe(CAMERAS["opencv"], board(), poses_around(6, rng), rng, noise_px=0.05)
    found = solve(seen, "opencv", SolveOptions(max_iterations=1))
    assert found.status == "stopped"
    assert "short of the minimum" in found.remarks[0]


def test_a_longer_lens_than_the_views_can_tell_is_not_stated_as_sure() -> None:
    """Where noise swamps the perspective, the focal length's deviation covers the truth or the result is degenerate."""
    long_lens = Camera("pinhole", np.array([60000.0, 60000, 1223.5, 1023.5]), (2448, 2048))
    for seed in range(4):
        rng = np.random.default_rng(seed)
        poses = poses_around(6, rng, half_angle_deg=20, distance_mm=8000, aim_mm=2)
        seen = observe(long_lens, board(9, 7, 12.0), poses, rng, noise_px=0.3)
        found = solve(seen, "pinhole")
        sigma = sigma_of(found.param_covariance)[0]
        assert found.status == "degenerate" or abs(found.camera.params[0] - 60000) < 4 * sigma


def far_board(focal_px: float, seed: int) -> Observations:
    """A dozen photos of a tilted board that fills a good part of the image."""
    rng = np.random.default_rng(seed)
    camera = Camera("pinhole", np.array([focal_px, focal_px, 652.0, 499.0]), (1280, 1024))
    poses = poses_around(12, rng, distance_mm=focal_px / 3, half_angle_deg=45)
    return observe(camera, board(9, 7, 30.0), poses, rng, noise_px=0.05)


@pytest.mark.parametrize("focal_px", [2e4, 6e4, 1e5])
def test_a_long_lens_is_found_or_what_to_fix_is_said(focal_px: float) -> None:
    """The two poses of a plane that a far camera sees alike are told apart by the focal length, and it by them."""
    for seed in range(3):
        found = solve(far_board(focal_px, seed), "opencv")
        sigma = np.sqrt(np.diagonal(found.param_covariance))
        assert abs(found.camera.params[0] - focal_px) < 3.5 * sigma[0]
        if found.status != "converged":
            assert "--fix cx_px=639.5,cy_px=511.5,k1=0" in found.remarks[0]


def test_parallel_rays_are_called_so() -> None:
    """Without any perspective no camera is stated, and it is said what shows no perspective and what to do."""
    seen = far_board(1e8, 3)
    found = solve(seen, "opencv")
    assert found.status == "degenerate"
    assert "telecentric lens, which no model here holds" in found.remarks[0]
    assert "telecentric" not in " ".join(
        solve(noisy(far_board(2e4, 1), 1.0, np.random.default_rng(0)), "opencv").remarks
    )
