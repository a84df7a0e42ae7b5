"""Centres of circles' images: taken to the images of the circles' centres, or asked about, so that nothing is wrong."""

from dataclasses import replace

import cv2
import numpy as np
import pytest

from calib.cameras import project
from calib.cameras.camera import Camera
from calib.core.se3 import transform
from calib.core.types import KnownPoints, Observations, RigObservations
from calib.judge.checks import checks_of, read_criteria
from calib.judge.evidence import joint_evidence
from calib.judge.halves import NoHalves
from calib.rigs.accuracy import with_circle_doubt as with_rig_circle_doubt
from calib.rigs.problem import CameraChoice
from calib.rigs.result import RigCalibration
from calib.rigs.solve import solve_rig
from calib.solver.capture_error import with_capture_error
from calib.solver.circles import circle_shift_px, with_circle_doubt
from calib.solver.metrics.evaluation import evaluate_on
from calib.solver.solve import solve
from designer.base.arrays import Array
from designer.base.errors import InputError
from tests.support.solver_scenes import board, icosahedron, noisy, observe, poses_around, times_stated

SIZE = (1600, 1200)
CAMERAS = {
    "opencv": Camera("opencv", np.array([1500.0, 1502, 805, 596, -0.22, 0.08, 5e-4, -4e-4, 0.0]), SIZE),
    "pinhole": Camera("pinhole", np.array([1500.0, 1500, 805, 596]), SIZE),
    "fisheye": Camera("fisheye", np.array([600.0, 600, 805, 596, 0.03, -0.01, 0.002, 0.0]), SIZE),
}
DISTANCE_MM = {"fisheye": 130.0}
STANDARD = read_criteria("standard")
NOISE_PX, PITCH_MM = 0.04, 20.0
RIM = 180


def _blob_centre_px(camera: Camera, center_mm: Array, axes_mm: Array) -> Array:
    """The centre of a circle's image by OpenCV's moments, of a fine polygon."""
    angle = np.linspace(0, 2 * np.pi, RIM, endpoint=False)
    rim = project(camera, center_mm + np.column_stack([np.cos(angle), np.sin(angle)]) @ axes_mm)
    middle = rim.mean(axis=0)  # what OpenCV holds as floats of 24 bits are differences from it
    moments = cv2.moments((rim - middle).astype(np.float32))
    centre: Array = middle + np.array([moments["m10"], moments["m01"]]) / moments["m00"]
    return centre


def _scene(
    model: str,
    diameter_mm: float,
    *,
    seed: int = 0,
    photos: int = 20,
    points: KnownPoints | None = None,
    distance_mm: float | None = None,
) -> tuple[Observations, Observations, Array]:
    """What a blob detector gives of circles without noise, where their centres are seen, and the poses."""
    rng = np.random.default_rng(seed)
    distance_mm = distance_mm or DISTANCE_MM.get(model, 330.0)
    poses = poses_around(photos, rng, distance_mm=distance_mm, half_angle_deg=55, aim_mm=0.15 * distance_mm)
    plain = observe(CAMERAS[model], points or board(10, 7, PITCH_MM), poses, rng, incidence_deg=70)
    if not diameter_mm:
        return plain, plain, poses
    centers = []
    for view, point in zip(plain.view.tolist(), plain.point.tolist(), strict=True):
        normal = plain.points.plane[plain.points.face[point], :3]
        axes = np.linalg.svd(normal[None])[2][1:] @ poses[view][:3, :3].T
        place = transform(poses[view], plain.points.position_mm[point][None])[0]
        centers.append(_blob_centre_px(CAMERAS[model], place, 0.5 * diameter_mm * axes))
    return replace(plain, center_px=np.array(centers)), plain, poses


def _said(seen: Observations, diameter_mm: float) -> Observations:
    """The observations with what their points are; nan: nobody says it."""
    return replace(seen, points=replace(seen.points, circle_mm=np.full(len(seen.points.face), diameter_mm)))


@pytest.mark.parametrize("model", CAMERAS)
@pytest.mark.parametrize("diameter_mm", [2.0, 15.0])
def test_the_shift_is_that_of_the_image_of_the_area(model: str, diameter_mm: float) -> None:
    """Through any lens, what lies between OpenCV's centre of a blob and the image of the circle's centre."""
    blob, plain, poses = _scene(model, diameter_mm, photos=3)
    at_truth = replace(solve(plain, model), camera=CAMERAS[model], cam_from_target=poses)
    shift = circle_shift_px(at_truth, np.full(len(plain.view), diameter_mm))
    true = blob.center_px - plain.center_px
    assert np.hypot(*true.T).max() > 1e-3 * diameter_mm**2
    np.testing.assert_allclose(shift, true, atol=2e-3 * np.abs(true).max() + 1e-4)


@pytest.mark.parametrize("model", CAMERAS)
@pytest.mark.parametrize("diameter_mm", [0.0, 6.0, 15.0])
def test_circles_of_a_known_diameter_are_as_good_as_points(model: str, diameter_mm: float) -> None:
    """The camera is that which points with the same noise give, to a fraction of its standard deviations."""
    blob, plain, _ = _scene(model, diameter_mm, seed=1)
    noise = noisy(plain, NOISE_PX, np.random.default_rng(2)).center_px - plain.center_px
    found, exact = (solve(one, model) for one in (
        _said(replace(blob, center_px=blob.center_px + noise), diameter_mm),
        replace(plain, center_px=plain.center_px + noise),
    ))  # fmt: skip
    sigma = np.sqrt(np.diagonal(exact.param_covariance))
    np.testing.assert_array_less(np.abs(found.camera.params - exact.camera.params), 0.15 * sigma + 1e-9)
    np.testing.assert_allclose(found.observations.center_px, plain.center_px + noise, atol=0.02)
    assert with_circle_doubt(found).circle_doubt is None


def test_circles_on_a_solid_lie_in_its_faces() -> None:
    """The correction takes each circle's own plane."""
    model = "opencv"
    blob, plain, _ = _scene(model, 8.0, points=icosahedron(100.0, 6))
    found, exact = solve(_said(blob, 8.0), model), solve(plain, model)
    assert np.hypot(*(blob.center_px - plain.center_px).T).max() > 0.1
    np.testing.assert_allclose(found.camera.params, exact.camera.params, rtol=1e-5, atol=2e-4)


@pytest.mark.parametrize("model", CAMERAS)
@pytest.mark.parametrize("diameter_mm", [0.0, 6.0, 13.0])
def test_what_nobody_said_is_in_the_stated_covariance(model: str, diameter_mm: float) -> None:
    """Points that may be centres of circles leave a camera off by no more than is stated, whatever they are."""
    times = []
    for seed in range(3):
        blob, _, _ = _scene(model, diameter_mm, seed=10 + seed, photos=10)
        noise_px = NOISE_PX * (1 + 2 * seed)
        seen = noisy(blob, noise_px, np.random.default_rng(seed))
        found = with_circle_doubt(solve(_said(seen, np.nan), model))
        assert found.circle_doubt is not None
        times.append(times_stated(found, CAMERAS[model], found.stated_covariance))
    assert max(times) < 1.96


@pytest.mark.parametrize(("noise_px", "is_told"), [(0.02, True), (1.0, False)])
def test_photos_tell_what_their_points_are(noise_px: float, is_told: bool) -> None:
    """With little noise the diameter is found to a few standard deviations, and no corner is called a circle."""
    for diameter_mm in (0.0, 13.0):
        blob, _, _ = _scene("opencv", diameter_mm, distance_mm=200.0)
        seen = noisy(blob, noise_px, np.random.default_rng(4))
        doubt = with_circle_doubt(solve(_said(seen, np.nan), "opencv")).circle_doubt
        assert doubt is not None
        if diameter_mm and is_told:
            assert doubt.sigmas > 10
            assert abs(doubt.diameter_mm - diameter_mm) < 1.0
        else:
            assert doubt.sigmas < 4


def test_a_diameter_is_told_with_what_it_is_unsure_by() -> None:
    """Photos that tell circles of 13 mm as ones of 15 say so within three of the standard deviations they tell."""
    told = []
    for seed in range(4):
        blob, _, _ = _scene("opencv", 13.0, distance_mm=200.0, seed=seed, photos=10)
        seen = noisy(blob, 0.1, np.random.default_rng(seed))
        doubt = with_circle_doubt(solve(_said(seen, np.nan), "opencv")).circle_doubt
        assert doubt is not None
        if doubt.told_mm is not None:
            told.append((doubt.told_mm[0] - 13.0) / doubt.told_mm[1])
    assert told
    assert np.abs(told).max() < 3
    assert replace(doubt, sigmas=3.9).told_mm is None


def test_circles_need_their_planes() -> None:
    """Points on no known plane cannot be circles, and a message says what to give."""
    _, plain, _ = _scene("opencv", 0.0, photos=4)
    loose = replace(plain, points=replace(plain.points, face=np.full(len(plain.points.face), -1)))
    with pytest.raises(InputError, match="give the points a column face"):
        solve(_said(loose, 5.0), "opencv")
    assert with_circle_doubt(solve(_said(loose, np.nan), "opencv")).circle_doubt is None


def _pair(diameter_mm: float, said_mm: float, *, noise_px: float = 0.0, away_mm: float = 330.0) -> RigCalibration:
    """A pair of cameras, the second 40 mm to the right, solved from circles, and what is said of these."""
    rng = np.random.default_rng(3)
    apart = np.eye(4)
    apart[0, 3] = -40.0
    poses, seen = poses_around(10, rng, distance_mm=away_mm, half_angle_deg=45), []
    for pose in (poses, apart @ poses):
        plain = observe(CAMERAS["opencv"], board(10, 7, PITCH_MM), pose, rng, incidence_deg=75)
        at_truth = replace(solve(plain, "opencv"), camera=CAMERAS["opencv"], cam_from_target=pose)
        shift = circle_shift_px(at_truth, np.full(len(plain.view), diameter_mm))
        seen.append(_said(noisy(replace(plain, center_px=plain.center_px + shift), noise_px, rng), said_mm))
    frames = np.arange(10)
    rig = RigObservations(("left", "right"), seen[0].view_names, tuple(seen), (frames, frames))
    return solve_rig(rig, [CameraChoice("opencv")] * 2)


@pytest.mark.parametrize("diameter_mm", [0.0, 13.0])
def test_a_rig_of_points_of_which_nobody_spoke_states_what_they_may_do(diameter_mm: float) -> None:
    """The second camera is off by no more than is stated; circles near by are told, points are not taken for some."""
    found = with_rig_circle_doubt(_pair(diameter_mm, np.nan, noise_px=0.03, away_mm=200.0))
    assert found.circle_doubt is not None
    assert (found.circle_doubt.told_mm is not None) == bool(diameter_mm)
    place = slice(found.rig.pose_rows(1).start + 3, found.rig.pose_rows(1).stop)
    off = found.cam_from_rig[1, :3, 3] - [-40.0, 0.0, 0.0]
    for row, error in zip(range(place.start, place.stop), off, strict=True):
        assert abs(error) < 3 * np.sqrt(found.stated_covariance[row, row])
    said = _pair(diameter_mm, 0.0, noise_px=0.03)
    assert with_rig_circle_doubt(said) is said
    check = next((one for one in checks_of(joint_evidence(found, NoHalves("not asked")), STANDARD)
                  if one.name == "points"), None)  # fmt: skip
    assert (check is not None) == bool(diameter_mm)
    assert check is None or ("--points says what they are" in check.sentence and "±" in check.sentence)


def test_cameras_of_a_rig_take_circles_to_points_together() -> None:
    """Two cameras that see circles stand as those that see points do."""
    circles, points = _pair(13.0, 13.0), _pair(0.0, 0.0)
    assert "13 mm" in circles.remarks[-1]
    np.testing.assert_allclose(circles.cam_from_rig, points.cam_from_rig, atol=2e-4)
    np.testing.assert_allclose(circles.cameras[1].params, points.cameras[1].params, rtol=2e-5, atol=1e-3)


def test_a_camera_is_evaluated_on_circles_as_on_points() -> None:
    """Other photos of circles leave nothing over with the true camera."""
    blob, plain, _ = _scene("opencv", 13.0, photos=5)
    true = replace(solve(plain, "opencv"), camera=CAMERAS["opencv"])
    found = evaluate_on(true, _said(blob, 13.0), "other.csv")
    errors = found.of("reprojection")
    assert errors is not None
    assert np.abs(errors.vector).max() < 1e-3


def test_circles_are_told_once() -> None:
    """What nobody said is in the doubt about circles alone, and not also among what is alike in all photos."""
    blob, _, _ = _scene("opencv", 13.0, distance_mm=200.0)
    seen = noisy(blob, 0.02, np.random.default_rng(4))
    for circle_mm, is_doubt in ((np.nan, True), (0.0, False)):
        found = with_circle_doubt(with_capture_error(solve(_said(seen, circle_mm), "opencv")))
        assert found.capture_error is not None
        assert any("discs" in effect.name for effect in found.capture_error.effects) != is_doubt
        assert (found.circle_doubt is not None) == is_doubt
