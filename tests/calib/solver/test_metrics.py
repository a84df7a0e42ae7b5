"""The metrics against their formulas on cases that can be done by hand, and the laws they keep."""

import math
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.optimize import least_squares

from calib.cameras import project, rays
from calib.cameras.camera import Camera
from calib.core.se3 import compose, exp_rotation, invert, look_at, make_pose, transform
from calib.core.types import KnownPoints, Observations
from calib.observe.observations import known_points
from calib.renderer.truth import Truth, true_views
from calib.solver.calibration import Calibration
from calib.solver.metrics import METRICS
from calib.solver.metrics.errors import Errors, ErrorSummary, centers_mm, predict, summarise, summarise_groups
from calib.solver.metrics.evaluation import (
    Evaluation,
    by_face,
    by_point,
    by_view,
    evaluate,
    evaluate_held_out,
    evaluate_on,
)
from calib.solver.problem import SolveOptions
from calib.solver.solve import solve
from designer.base.arrays import Array
from designer.base.errors import InputError
from designer.target import TargetGeometry
from tests.support.calibrations import board, calibration_of, camera, example, icosahedron, poses_around, seen_by

BOARD, ICO = board(), icosahedron()
UNEVEN = replace(
    ICO, source="measured", center_mm=ICO.center_mm + np.random.default_rng(8).normal(0, 0.05, ICO.center_mm.shape)
)
"""A target as measured: each ring off its place by some hundredths of a millimetre, its face's plane included."""
PLAIN = Camera("pinhole", np.array([100.0, 100.0, 0.0, 0.0]), (1000, 1000))
FLOOR = KnownPoints(np.array([[0.0, 0, 0], [10, 0, 0]]), np.zeros(2, dtype=int), np.array([[0.0, 0, 1, 0]]))


def above(height_mm: float, x_mm: float = 0.0, y_mm: float = 0.0) -> Array:
    """A camera over the floor that looks straight down: pixel u along x, v along -y."""
    return make_pose(np.diag([1.0, -1.0, -1.0]), np.array([-x_mm, y_mm, height_mm]))


def sightings(*seen: tuple[int, int, float, float], points: KnownPoints = FLOOR, views: int = 1) -> Observations:
    """Sightings given as view, point, u, v."""
    table = np.array(seen)
    names = tuple(f"{n}.png" for n in range(views))
    return Observations((1000, 1000), names, table[:, 0], table[:, 1], table[:, 2:], None, points)


def errors_of(calibration: Calibration, metric: str, true: Array | None = None) -> Errors:
    """The errors by one metric."""
    found = METRICS[metric].errors_of(predict(calibration, true))
    assert found is not None
    return found


def truth_of(calibration: Calibration, poses: Array) -> Truth:
    """A truth with other poses."""
    seen = calibration.observations
    return Truth(seen.points.geometry_id, calibration.camera, true_views(seen.view_names, poses))


def with_accuracies(calibration: Calibration) -> Calibration:
    """The calibration with covariances of its sightings, none round and no two alike, which count."""
    factor = np.random.default_rng(2).uniform(0.5, 2, (len(calibration.observations.view), 2, 2))
    seen = replace(calibration.observations, cov_px2=factor @ factor.transpose(0, 2, 1) + 0.1 * np.eye(2))
    return replace(calibration, observations=seen, weighted=True)


@pytest.mark.parametrize("model", ["opencv", "luhmann", "pinhole"])
@pytest.mark.parametrize("target", [BOARD, ICO, UNEVEN], ids=["board", "icosahedron", "rings off their faces' planes"])
def test_perfect_data_has_no_errors(model: str, target: TargetGeometry) -> None:
    """The true camera and poses leave nothing over of exact sightings, by any metric, also of a measured target."""
    calibration = with_accuracies(example(target, np.random.default_rng(1), model=model, views=12))
    found = evaluate(calibration, truth_of(calibration, calibration.cam_from_target))
    assert [errors.metric for errors in found.errors] == list(METRICS)
    for errors in found.errors:
        assert summarise(errors).count > 0
        assert errors.size[errors.is_counted].max() < 1e-8, errors.metric


def test_reprojection_is_predicted_minus_detected() -> None:
    """A ring at the origin, 100 mm below, is predicted at (0, 0); seen at (3, 4) the error is (-3, -4), 5 px long."""
    calibration = calibration_of(PLAIN, sightings((0, 0, 3.0, 4.0)), above(100.0)[None])
    errors = errors_of(calibration, "reprojection")
    assert np.allclose(errors.vector, [[-3, -4]])
    assert summarise(errors) == ErrorSummary(1, 5.0, 5.0, 5.0, 5.0, 5.0)


def test_intersection_is_where_the_ray_meets_the_floor() -> None:
    """From 100 mm with f = 100 px a pixel is a millimetre: seen at (3, 4), the ring is predicted at (3, -4, 0) mm."""
    calibration = calibration_of(PLAIN, sightings((0, 0, 3.0, 4.0)), above(100.0)[None])
    assert np.allclose(errors_of(calibration, "intersection").vector, [[3, -4, 0]])


def test_reconstruction_of_two_rays_is_the_middle_of_their_shortest_distance() -> None:
    """Two rays cross at right angles, 2 mm apart: the point is half way between them."""
    poses = look_at(np.array([[-50.0, 1, 0], [0, -1, 50]]), np.array([[0.0, 1, 0], [0, -1, 0]]))
    points = KnownPoints(np.array([[0.25, 0.0, 0.5]]), np.array([-1]), np.zeros((0, 4)))
    seen = sightings((0, 0, 0.0, 0.0), (1, 0, 0.0, 0.0), points=points, views=2)
    errors = errors_of(calibration_of(PLAIN, seen, poses), "reconstruction")
    assert np.allclose(errors.vector + points.position_mm, [[0, 0, 0]], atol=1e-12)


def test_pose_error_is_the_distance_of_the_centres() -> None:
    """A camera 3, 4, 12 mm from its true place is 13 mm off, however it is turned."""
    true = above(100.0)
    moved = compose(make_pose(exp_rotation(np.array([0.1, 0.2, 0.3])), np.zeros(3)), above(112.0, 3.0, 4.0))
    calibration = calibration_of(PLAIN, sightings((0, 0, 1.0, 1.0)), moved[None])
    errors = errors_of(calibration, "pose", true[None])
    assert np.allclose(errors.vector, [[3, 4, 12]])
    assert summarise(errors).rmse == pytest.approx(13)


def test_rotation_error_has_no_turn_that_all_views_share() -> None:
    """Another principal point turns all cameras alike: no error. What remains is each view's own turn, in degrees."""
    rng = np.random.default_rng(2)
    true = poses_around(5, rng)
    own = np.radians(rng.normal(0, 0.01, (5, 3)))
    own -= own.mean(axis=0)
    common = make_pose(exp_rotation(np.array([0.02, -0.01, 0.3])), np.zeros(3))
    estimate = common @ make_pose(exp_rotation(own), np.zeros(3)) @ true
    calibration = calibration_of(PLAIN, sightings((0, 0, 1.0, 1.0), views=5), estimate)
    assert np.allclose(errors_of(calibration, "rotation", true).vector, np.degrees(own), atol=1e-5)


@given(st.lists(st.tuples(st.integers(-1, 4), st.floats(0, 1e6)), max_size=40))
@settings(max_examples=100, deadline=None)
def test_groups_are_summarised_as_if_alone(entries: list[tuple[int, float]]) -> None:
    """The summary of a group is that of its errors by numpy; a group without errors has a count of 0 and nan."""
    group = np.array([one for one, _ in entries], dtype=np.int64)
    size = np.array([length for _, length in entries], dtype=np.float64)
    errors = Errors("m", "", "px", ("u",), size.reshape(-1, 1), np.zeros(len(size)), ("",))
    for number, found in enumerate(summarise_groups(errors, group, 5)):
        own = size[group == number]
        assert found.count == len(own)
        if len(own):
            expected = (math.sqrt((own**2).mean()), own.mean(), np.median(own), np.percentile(own, 95), own.max())
            actual = (found.rmse, found.mean, found.median, found.percentile_95, found.largest)
            assert actual == pytest.approx(expected, rel=1e-9, abs=1e-9)
        else:
            assert math.isnan(found.rmse)


def test_the_point_has_the_least_squares_of_distances_to_its_rays() -> None:
    """That SciPy finds."""
    calibration = example(ICO, np.random.default_rng(4), views=15, noise_px=0.5)
    errors = errors_of(calibration, "reconstruction")
    seen, pose = calibration.observations, calibration.cam_from_target
    for row in np.flatnonzero(errors.is_counted)[::40]:
        of_point = seen.point == errors.point[row]
        turn = pose[seen.view[of_point], :3, :3]
        d = np.einsum("nji,nj->ni", turn, rays(calibration.camera, seen.center_px[of_point]))
        s, true = centers_mm(pose)[seen.view[of_point]], seen.points.position_mm[errors.point[row]]
        best = least_squares(lambda x, d=d, s=s: np.cross(d, s - x).ravel(), true, xtol=1e-15, ftol=1e-15, gtol=1e-15)
        assert np.allclose(errors.vector[row] + true, best.x, atol=1e-7)


def moved(calibration: Calibration, motion: Array, scale: float = 1.0) -> Calibration:
    """The same photos in a target frame that is moved, and whose millimetre is another."""
    points = calibration.observations.points
    position = scale * transform(motion, points.position_mm)
    normal = points.plane[:, :3] @ motion[:3, :3].T
    offset = scale * (points.plane[:, 3] + normal @ motion[:3, 3])
    pose = compose(calibration.cam_from_target, invert(motion)).copy()
    pose[:, :3, 3] *= scale
    other = KnownPoints(position, points.face, np.column_stack([normal, offset]), points.geometry_id)
    return replace(calibration, observations=replace(calibration.observations, points=other), cam_from_target=pose)


@pytest.mark.parametrize("target", [BOARD, ICO], ids=["board", "icosahedron"])
def test_metrics_do_not_depend_on_the_target_frame(target: object) -> None:
    """A rigid motion of target and poses together changes no metric; a scale of both scales millimetres only."""
    rng = np.random.default_rng(5)
    calibration = example(target, rng, views=8, noise_px=0.2)  # type: ignore[arg-type]
    shift = make_pose(exp_rotation(0.002 * rng.normal(size=(8, 3))), rng.normal(size=(8, 3)))
    calibration = replace(calibration, cam_from_target=shift @ calibration.cam_from_target)
    true = poses_around(8, rng)
    before = evaluate(calibration, truth_of(calibration, true))
    motion, scale = make_pose(exp_rotation(rng.normal(size=3)), 300 * rng.normal(size=3)), 2.5
    there = compose(true, invert(motion)).copy()
    there[:, :3, 3] *= scale
    other = moved(calibration, motion, scale)
    after = evaluate(other, truth_of(other, there))
    for one, two in zip(before.errors, after.errors, strict=True):
        factor = scale if one.unit == "mm" else 1.0
        assert np.array_equal(one.reason, two.reason)
        assert np.allclose(two.size, factor * one.size, rtol=1e-8, atol=1e-9, equal_nan=True), one.metric


def test_outliers_are_listed_but_do_not_count() -> None:
    """A gross error changes no summary when it is marked: not of its view, its ring, or the ring's reconstruction."""
    rng = np.random.default_rng(6)
    clean = example(BOARD, rng, views=6, noise_px=0.1)
    pixel = clean.observations.center_px.copy()
    pixel[17] += [80, -50]
    flag = np.zeros(len(pixel), dtype=bool)
    flag[17] = True
    gross = calibration_of(
        clean.camera, replace(clean.observations, center_px=pixel), clean.cam_from_target, is_outlier=flag
    )
    without = replace(clean, is_outlier=flag)
    for metric in ("reprojection", "intersection", "reconstruction"):
        assert summarise(errors_of(gross, metric)) == summarise(errors_of(without, metric))
    errors = errors_of(gross, "reprojection")
    assert errors.size[17] > 90
    assert errors.left_out == (("outlier", 1),)


def left_out(errors: Errors) -> dict[str, int]:
    """Why errors do not count, and how many."""
    return dict(errors.left_out)


def test_a_ray_along_its_plane_has_no_intersection() -> None:
    """A camera in the plane of a ring sees it edge-on: counted by reason, no number, no warning of numpy."""
    pose = look_at(np.array([[-100.0, 0, 0], [0, -100, 50]]), np.zeros(3))
    seen = sightings((0, 0, 0.0, 0.0), (1, 0, 0.0, 0.0), views=2)
    errors = errors_of(calibration_of(PLAIN, seen, pose), "intersection")
    assert left_out(errors) == {"the ray is parallel to its plane": 1}
    assert summarise(errors).count == 1


@pytest.mark.parametrize(
    ("metric", "reason"),
    [
        ("intersection", "the plane is behind the camera"),  # which the line meets
        ("reprojection", "the camera model has no pixel there"),
    ],
)
def test_what_is_behind_the_camera_has_no_error(metric: str, reason: str) -> None:
    """It is counted, and not in the summary."""
    up = make_pose(np.eye(3), np.array([0.0, 0, -100]))  # 100 mm above the floor, looking up
    errors = errors_of(calibration_of(PLAIN, sightings((0, 0, 0.0, 0.0)), up[None]), metric)
    assert left_out(errors) == {reason: 1}
    assert math.isnan(summarise(errors).rmse)


def test_points_on_no_plane_have_no_intersection_error() -> None:
    """Face -1 says that no plane is known; the other metrics take such points as any others."""
    calibration = example(BOARD, np.random.default_rng(7), views=5, noise_px=0.1)
    points = calibration.observations.points
    face = points.face.copy()
    face[:10] = -1
    loose = replace(calibration.observations, points=replace(points, face=face))
    calibration = replace(calibration, observations=loose)
    count = int((loose.point < 10).sum())
    assert left_out(errors_of(calibration, "intersection")) == {"on no known plane": count}
    assert summarise(errors_of(calibration, "reconstruction")).count == BOARD.ring_count
    found = evaluate(calibration)
    assert by_face(found, found.errors[0])[0].count == len(loose.point) - count  # type: ignore[index]


def test_a_point_needs_two_views_apart() -> None:
    """One view, one view twice, and rays that make less than a degree reconstruct nothing; they are counted."""
    points = KnownPoints(np.array([[0.0, 0, 0], [1, 0, 0], [2, 0, 0]]), np.zeros(3, dtype=int), FLOOR.plane)
    poses = np.stack([above(100.0), above(100.0, 30.0), above(100.0, 0.2)])
    one = Observations(
        (1000, 1000), ("a", "b", "c"), np.array([0, 0, 0, 1, 2]), np.array([0, 1, 2, 0, 1]),
        np.array([[0.0, 0], [1, 0], [2, 0], [-30, 0], [0.8, 0]]), None, points,
    )  # fmt: skip
    errors = errors_of(calibration_of(PLAIN, one, poses), "reconstruction")
    assert left_out(errors) == {"seen in one view only": 1, "its rays are all but parallel": 1}
    assert np.allclose(errors.vector[errors.is_counted], 0, atol=1e-9)
    twice = sightings((0, 0, 0.0, 0.0), (0, 0, 1.0, 0.0))
    assert left_out(errors_of(calibration_of(PLAIN, twice, poses[:1]), "reconstruction")) == {
        "seen in one view only": 1
    }


def test_pixels_without_a_ray_are_counted() -> None:
    """A pixel outside the lens's image has no ray: its errors are nan, counted by reason, and disturb no other."""
    lens = Camera("opencv", np.array([500.0, 500, 500, 500, -0.5, 0, 0, 0, 0]), (1000, 1000))
    calibration = example(BOARD, np.random.default_rng(8), views=4)
    seen = seen_by(lens, calibration.observations.points, calibration.cam_from_target)
    pixel = seen.center_px.copy()
    pixel[3] = [9000.0, 500.0]
    broken = calibration_of(lens, replace(seen, center_px=pixel), calibration.cam_from_target)
    assert left_out(errors_of(broken, "intersection")) == {"the camera model has no ray there": 1}
    assert summarise(errors_of(broken, "intersection")).largest < 1e-9
    assert summarise(errors_of(broken, "reconstruction")).largest < 1e-9


def test_weighted_errors_are_mahalanobis_lengths() -> None:
    """The squared length of a weighted error is e' cov^-1 e; there is none where all sightings are to count alike."""
    calibration = with_accuracies(example(BOARD, np.random.default_rng(3), views=3, noise_px=0.3))
    covariance, plain = calibration.observations.cov_px2, errors_of(calibration, "reprojection").vector
    expected = np.einsum("mi,mij,mj->m", plain, np.linalg.inv(covariance), plain)
    assert errors_of(calibration, "weighted").size ** 2 == pytest.approx(expected)
    assert evaluate(replace(calibration, weighted=False)).of("weighted") is None


def test_other_sightings_are_told_by_poses_alone() -> None:
    """The camera stays as it is, whatever it is; poses have the least squares that SciPy finds from the true ones."""
    solved = example(BOARD, np.random.default_rng(4), views=4)
    camera = replace(solved.camera, params=1.01 * solved.camera.params)
    other = example(BOARD, np.random.default_rng(5), views=3, noise_px=0.2)
    found = evaluate_on(replace(solved, camera=camera), other.observations, "others.csv")
    assert found.calibration.camera is camera
    assert (found.calibration.observations.view_count, found.on, found.remarks) == (3, "others.csv", ())
    seen, errors = other.observations, errors_of(found.calibration, "reprojection")
    for view, pose in enumerate(other.cam_from_target):
        rows = seen.view == view

        def residual(step: Array) -> Array:
            place = transform(compose(make_pose(exp_rotation(step[:3]), step[3:]), pose), position)  # noqa: B023
            return (project(camera, place) - seen.center_px[rows]).reshape(-1)  # noqa: B023

        position = seen.points.position_mm[seen.point[rows]]
        least = least_squares(residual, np.zeros(6), x_scale=[1e-3] * 3 + [1.0] * 3, xtol=1e-12, ftol=1e-12)
        assert (errors.size[errors.view == view] ** 2).sum() == pytest.approx(2 * least.cost, rel=1e-6)


def test_views_that_are_not_evaluated_and_sightings_that_are_known_are_told() -> None:
    """A view whose points do not fit any pose, by name; sightings that the camera was solved from, by number."""
    solved = example(BOARD, np.random.default_rng(6), views=4)
    seen = solved.observations
    lost = seen.view == 2
    away = replace(seen, center_px=np.where(lost[:, None], [[-1e5, 0.0]], seen.center_px))
    found = evaluate_on(
        replace(solved, camera=Camera("fisheye", np.array([400.0, 400, 600, 450, -0.2, 0, 0, 0]), seen.image_size)),
        away,
        "b",
    )
    assert found.calibration.observations.view_count == 3
    assert found.remarks[0].startswith(f"{seen.view_names[2]}: not evaluated: ")
    count = int((~lost).sum())
    assert found.remarks[1] == f"the camera was solved from {count} of these {count} observations"
    written = np.array([[float(f"{x:.6f}") for x in pixel] for pixel in seen.center_px.tolist()])  # as in a file
    known = evaluate_on(solved, replace(seen, center_px=written), "b").remarks
    assert f"the camera was solved from {len(written)} of these {len(written)} observations" in known
    others = np.random.default_rng(7).permutation(seen.center_px)
    mixed = replace(seen, center_px=np.where(lost[:, None], others, seen.center_px))
    assert f"{seen.view_names[2]}: its points are off by " in " ".join(evaluate_on(solved, mixed, "b").remarks)
    with pytest.raises(InputError, match="photos of 10 x 20 px, but the camera's have 1200 x 900"):
        evaluate_on(solved, replace(seen, image_size=(10, 20)), "b")


def test_views_without_truth_have_no_pose_error() -> None:
    """Truth is matched by file name; a view that it does not know is counted as such, and a remark says so."""
    calibration = example(BOARD, np.random.default_rng(9), views=4)
    names = calibration.observations.view_names
    truth = Truth("other", calibration.camera, true_views(names[2:1:-1], calibration.cam_from_target[2:1:-1]))
    found = evaluate(calibration, truth)
    pose = found.of("pose")
    assert left_out(pose) == {"its true pose is not known": 3}
    assert pose.is_counted.tolist() == [False, False, True, False]
    assert len(found.remarks) == 2
    with pytest.raises(InputError, match="none of which was calibrated with"):
        evaluate(calibration, replace(truth, views=true_views(["x.png"], np.eye(4)[None])))
    without = evaluate(calibration)  # nothing is compared with what is not known
    assert [errors.metric for errors in without.errors] == ["reprojection", "intersection", "reconstruction"]


def test_groups_make_up_the_whole() -> None:
    """Counts by view, by ring and by face sum to the whole, and so do the squares."""
    found = evaluate(example(ICO, np.random.default_rng(11), views=9, noise_px=0.2))
    for errors in found.errors:
        whole = summarise(errors)
        for grouped in (by_view(found, errors), by_point(found, errors), by_face(found, errors)):
            assert grouped is not None or errors.view is None
            if grouped is not None:
                assert sum(one.count for one in grouped) == whole.count
                square = sum(one.count * one.rmse**2 for one in grouped if one.count)
                assert square == pytest.approx(whole.count * whole.rmse**2)


def solve_opencv(seen: Observations) -> Calibration:
    """As a person would solve."""
    return solve(seen, "opencv", SolveOptions())


def held_out(calibration: Calibration, folds: int) -> Evaluation:
    """Evaluated on views held out."""
    return evaluate_held_out(calibration, solve_opencv, folds)


def test_held_out_errors_are_of_cameras_that_did_not_see_the_view() -> None:
    """A photo with a lens of its own is fitted when it is among those solved from, and shows when it is held out."""
    rng = np.random.default_rng(12)
    calibration = example(ICO, rng, views=6, noise_px=0.02)
    odd = seen_by(camera(focal_px=1450.0), calibration.observations.points, calibration.cam_from_target[:1])
    seen = calibration.observations
    shared = np.isin(seen.point, odd.point) & (seen.view == 0)
    pixel = seen.center_px.copy()
    pixel[shared] = odd.center_px[np.isin(odd.point, seen.point[shared])]
    keep = (seen.view > 0) | shared
    seen = replace(seen, view=seen.view[keep], point=seen.point[keep], center_px=pixel[keep])
    solved = solve_opencv(seen)
    inside, outside = evaluate(solved), held_out(solved, 6)
    of_odd = [by_view(one, one.errors[0])[0].rmse for one in (inside, outside)]  # type: ignore[index]
    assert of_odd[1] > 1.2 * of_odd[0]
    assert outside.folds == 6


def test_held_out_errors_are_a_little_larger() -> None:
    """With views alike, errors of those held out exceed the others by little, and every sighting has one."""
    solved = solve_opencv(example(BOARD, np.random.default_rng(13), views=12, noise_px=0.1).observations)
    inside, outside = evaluate(solved), held_out(solved, 4)
    one, two = inside.errors[0], outside.errors[0]
    assert sorted(two.sighting.tolist()) == one.sighting.tolist()
    assert np.array_equal(solved.observations.view[two.sighting], two.view)
    assert np.array_equal(solved.observations.point[two.sighting], two.point)
    assert 1.0 < summarise(two).rmse / summarise(one).rmse < 1.1


def test_held_out_parts_must_fit_the_views() -> None:
    """Two parts at least, and not more than there are views."""
    solved = solve_opencv(example(BOARD, np.random.default_rng(14), views=5, noise_px=0.1).observations)
    for folds in (1, 6):
        with pytest.raises(InputError, match="parts of 5 views"):
            held_out(solved, folds)


def test_an_outlier_stays_out_when_views_are_held_out() -> None:
    """What the solution left out moves neither the cameras of the parts nor the poses of views held out."""
    rng = np.random.default_rng(15)
    seen = example(BOARD, rng, views=8, noise_px=0.1).observations
    pixel = seen.center_px.copy()
    pixel[40] += [200, 0]
    solved = solve(replace(seen, center_px=pixel), "opencv", SolveOptions(reject_sigma=6))
    assert solved.is_outlier[40]
    found = summarise(held_out(solved, 4).errors[0])
    assert found.largest < 1


def test_what_a_held_out_camera_does_not_show_moves_no_pose() -> None:
    """A pixel that the other views' camera has no ray for, as outside of a learned map, is not used for a pose."""
    lens = Camera("opencv", np.array([500.0, 500, 500, 500, -0.5, 0, 0, 0, 0]), (1000, 1000))
    poses = poses_around(4, np.random.default_rng(16))
    seen = seen_by(lens, known_points(BOARD), poses)
    pixel = seen.center_px.copy()
    pixel[3] = [9000.0, 500.0]
    one = calibration_of(lens, replace(seen, center_px=pixel), poses)
    found = evaluate_held_out(one, lambda rest: calibration_of(lens, rest, poses[: rest.view_count]), 2)
    intersection = found.of("intersection")
    assert intersection is not None
    assert left_out(intersection) == {"the camera model has no ray there": 1}
    assert summarise(intersection).largest < 1e-6
