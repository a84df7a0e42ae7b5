"""Points from several cameras: where they are, how surely, and what contradicts; the lengths of a check object."""

from dataclasses import replace
from pathlib import Path

import cv2
import numpy as np
import pytest

import calib
from calib.cameras.rig import Rig
from calib.core.se3 import look_at, transform
from calib.core.types import keep_frames
from calib.rigs.problem import CameraChoice
from calib.rigs.result import RigCalibration
from calib.rigs.solve import solve_rig
from calib.space.known_lengths import check_lengths
from calib.space.propagate import calibration_factor, linear_sight
from calib.space.triangulate import (
    BEHIND,
    CONTRADICT,
    NO_RAYS,
    ONE_CAMERA,
    PARALLEL,
    TWO_CONTRADICT,
    TriangulatedPoints,
    triangulate_points,
)
from designer.base.errors import InputError
from tests.support.rig_views import RigScene, camera, stereo_pair
from tests.support.space_scenes import (
    NOISE_PX,
    drawn,
    moved,
    points_before,
    row_of_cameras,
    sighted,
    wide_camera,
    without_errors,
)


def squares(error: np.ndarray, covariance: np.ndarray) -> np.ndarray:
    """Squared errors (N,) in units of their covariances."""
    return np.einsum("ni,nij,nj->n", error, np.linalg.inv(covariance), error)


def test_exact_sightings_give_exact_points() -> None:
    """Of cameras of different models, to a millionth of a millimetre, and without residuals."""
    rng = np.random.default_rng(1)
    rig = row_of_cameras(3, models=("opencv", "fisheye"))
    points = points_before(rig, 50, rng)
    found = triangulate_points(rig, sighted(rig, points))
    assert np.abs(found.position_mm - points).max() < 1e-6
    assert max(np.abs(found.residual_px).max(), found.ray_error_mm.max()) < 1e-6


def test_cameras_that_face_each_other_meet_points_between_and_behind() -> None:
    """Light from behind a fisheye is light: a ray is a direction, not a slope."""
    eyes = np.array([[-200.0, 0, 0], [200.0, 0, 0]])
    poses = look_at(eyes, np.array([[-500.0, 0, 50], [500.0, 0, 50]]))
    rig = Rig(("a", "b"), (wide_camera(), wide_camera()), poses, None, np.full(2, 0.1))
    points = np.array([[0.0, 300, 0], [30, -400, 100], [-20, 10, 350]])
    np.testing.assert_allclose(triangulate_points(rig, sighted(rig, points)).position_mm, points, atol=1e-6)


def test_derivatives_by_the_rigs_unknowns_are_those_of_the_pixels() -> None:
    """Parameters and poses as `Rig` states them, against small steps of the rig itself."""
    rig = row_of_cameras(2, models=("fisheye", "opencv"))
    points = points_before(rig, 5, np.random.default_rng(2))
    for row in range(2):
        told = linear_sight(rig, row, points).by_unknowns
        for column in range(told.shape[2]):
            step = np.zeros(rig.first_row[-1])
            step[rig.first_row[row] + column] = 1e-6
            ends = [moved(rig, sign * step) for sign in (1, -1)]
            seen = [one.cameras[row].project(transform(one.cam_from_rig[row], points)) for one in ends]
            np.testing.assert_allclose(told[:, :, column], (seen[0] - seen[1]) / 2e-6, rtol=1e-5, atol=1e-4)


@pytest.mark.parametrize("cameras", [2, 3])
def test_points_scatter_as_stated(cameras: int) -> None:
    """By noise and by the rig's errors together: squares in units of the covariance have the mean of three numbers."""
    rng = np.random.default_rng(3)
    truth = row_of_cameras(cameras)
    points = points_before(truth, 40, rng)
    off, total = [], []
    for _ in range(40):
        found = triangulate_points(drawn(truth, rng), sighted(truth, points, rng))
        off.append(found.position_mm - points)
        total.append(squares(off[-1], found.covariance_mm2))
        assert not found.is_gross.any()
    assert np.mean(total) == pytest.approx(3, rel=0.15)
    scatter, stated = np.std(off, axis=0), np.sqrt(np.diagonal(found.covariance_mm2, axis1=1, axis2=2))
    assert np.median(scatter / stated) == pytest.approx(1, abs=0.1)
    assert np.median(stated / np.sqrt(np.diagonal(found.noise_mm2, axis1=1, axis2=2))) > 1.2  # the rig's part matters


def test_noise_alone_where_the_rig_is_exact() -> None:
    """A rig without errors adds none; one whose errors are not known says so."""
    rng = np.random.default_rng(4)
    rig = row_of_cameras(2)
    seen = sighted(rig, points_before(rig, 5, rng))
    exact = triangulate_points(without_errors(rig), seen)
    assert not exact.calibration_mm2.any()
    unknown = calib.triangulate(replace(rig, covariance=None), seen)
    assert unknown.points.calibration_mm2 is None
    assert "tells no covariance" in unknown.remarks[0]
    assert calibration_factor(replace(rig, covariance=np.full_like(rig.covariance, np.nan))) is None


def test_stated_noise_weighs() -> None:
    """A sighting that states a hundredth of the noise decides where the point is across its ray."""
    rng = np.random.default_rng(5)
    rig = without_errors(row_of_cameras(3))
    seen = sighted(rig, points_before(rig, 20, rng), rng, 0.5)
    cov = np.where((seen.camera == 0)[:, None, None], 1e-4**2, 0.5**2) * np.eye(2)
    found = triangulate_points(rig, replace(seen, cov_px2=cov))
    assert np.abs(found.residual_px[seen.camera == 0]).max() < 1e-5 < np.abs(found.residual_px[seen.camera == 1]).max()


def gross_scene(count: int) -> tuple[Rig, np.ndarray]:
    """Cameras that are known well enough to see a pixel's error."""
    rig = without_errors(row_of_cameras(count))
    return rig, points_before(rig, 40, np.random.default_rng(6))


def test_a_gross_error_is_named_and_the_others_give_the_point() -> None:
    """Of three cameras that do not stand in a line each can be told wrong."""
    rig, points = gross_scene(3)
    seen = sighted(rig, points, np.random.default_rng(7))
    center = seen.center_px.copy()
    wrong = [
        int(np.flatnonzero((seen.place == place) & (seen.camera == cam))[0]) for place, cam in ((3, 0), (8, 1), (12, 2))
    ]
    center[wrong] += [[6.0, -5.0], [7.0, 5.0], [-6.0, 5.0]]
    found = triangulate_points(rig, replace(seen, center_px=center))
    assert np.flatnonzero(found.is_gross).tolist() == sorted(wrong)
    assert found.is_placed.all()
    assert (squares(found.position_mm - points, found.covariance_mm2) < 25).all()
    assert (np.hypot(*found.residual_px[wrong].T) > 4).all()


def test_two_cameras_that_contradict_each_other_are_both_in_doubt() -> None:
    """The epipolar error is told; there is no position, for nobody knows which is wrong."""
    rig, points = gross_scene(2)
    seen = sighted(rig, points, np.random.default_rng(8))
    center = seen.center_px.copy()
    center[5] += [0.0, 3.0]
    found = triangulate_points(rig, replace(seen, center_px=center))
    assert found.reason[5] == TWO_CONTRADICT
    assert np.flatnonzero(found.reason).tolist() == [5]
    assert np.isnan(found.position_mm[5]).all()
    assert found.misclosure_px[5] == pytest.approx(3.0, abs=0.5)
    every = triangulate_points(rig, replace(seen, center_px=center), rejects=False)
    assert every.is_placed.all()
    assert not every.is_gross.any()


def test_an_error_along_the_line_of_three_cameras_is_not_pinned_on_one() -> None:
    """Where each of two cameras can be the wrong one, neither is accused."""
    pinhole = camera(model="pinhole")
    poses = np.tile(np.eye(4), (3, 1, 1))
    poses[:, 0, 3] = [0, -100, -200]
    rig = Rig(("a", "b", "c"), (pinhole,) * 3, poses, None, np.full(3, NOISE_PX))
    points = np.column_stack([np.linspace(-100, 300, 30), np.zeros(30), np.full(30, 1000.0)])
    seen = sighted(rig, points, np.random.default_rng(9))
    center = seen.center_px.copy()
    center[30 + 4] += [5.0, 0.0]
    found = triangulate_points(rig, replace(seen, center_px=center))
    assert np.flatnonzero(found.reason).tolist() == [4]
    assert found.reason[4] == CONTRADICT
    assert not found.is_gross.any()


def test_a_larger_noise_than_stated_accuses_nobody() -> None:
    """Gross is what is far from the others' scatter, not from a number in a file; the factor is told."""
    rng = np.random.default_rng(10)
    rig, points = gross_scene(3)
    found = triangulate_points(rig, sighted(rig, points, rng, 5 * NOISE_PX))
    assert found.is_placed.all()
    assert found.is_gross.mean() < 0.02
    assert found.scale == pytest.approx(5, rel=0.25)


def test_points_without_a_position_say_why() -> None:
    """Seen once, from one place, or by rays that part: never a number."""
    pinhole = camera(model="pinhole")
    poses = np.tile(np.eye(4), (3, 1, 1))
    poses[1, 0, 3], poses[2, 0, 3] = -100.0, -100.0
    rig = Rig(("a", "b", "twin of b"), (pinhole,) * 3, poses, None, np.full(3, NOISE_PX))
    middle, right = pinhole.params[2:4], np.array([100.0, 0.0])
    rows = (
        ((0, middle),),
        ((1, middle), (2, middle)),  # from one place
        ((0, middle), (1, middle)),  # parallel
        ((0, middle - right), (1, middle + right)),  # they meet behind
        ((0, middle), (1, [np.nan, np.nan])),
        ((0, middle + right), (1, middle)),
    )
    camera_rows = np.array([row for point in rows for row, _ in point])
    place = np.array([number for number, point in enumerate(rows) for _ in point])
    center = np.array([pixel for point in rows for _, pixel in point], dtype=np.float64)
    zero = np.zeros(len(rows), dtype=np.int64)
    names = tuple(map(str, range(len(rows))))
    seen = calib.PointSightings(("f",), names, zero, np.arange(len(rows)), camera_rows, place, center)
    found = triangulate_points(rig, seen)
    assert found.reason.tolist()[:1] == [ONE_CAMERA]
    assert set(found.reason.tolist()[1:4]) <= {PARALLEL, BEHIND}
    assert found.reason.tolist()[4:] == [NO_RAYS, 0]
    assert np.isnan(found.position_mm[:5]).all()
    assert np.isnan(found.covariance_mm2[:5]).all()


def test_it_is_not_worse_than_opencv() -> None:
    """Beside cv2.triangulatePoints on undistorted pixels, whose lines of sight have algebraic weights."""
    rng = np.random.default_rng(11)
    rig = without_errors(row_of_cameras(2))
    points = points_before(rig, 400, rng, near_mm=300)
    seen = sighted(rig, points, rng)
    found: TriangulatedPoints = triangulate_points(rig, seen)
    slopes = [
        cv2.undistortPoints(seen.center_px[seen.camera == row][:, None], one.matrix, one.distortion)[:, 0]
        for row, one in enumerate(rig.cameras)
    ]
    theirs = cv2.triangulatePoints(rig.cam_from_rig[0, :3], rig.cam_from_rig[1, :3], slopes[0].T, slopes[1].T)
    theirs = (theirs[:3] / theirs[3]).T
    mine_mm, theirs_mm = (np.sqrt(((one - points) ** 2).sum(axis=1).mean()) for one in (found.position_mm, theirs))
    assert mine_mm <= 1.01 * theirs_mm
    np.testing.assert_allclose(found.position_mm, theirs, atol=0.1 * mine_mm + 0.3)


TABLE = "camera,frame,point,u,v\na,f,p,600,400\nb,f,p,500,400\n"


@pytest.mark.parametrize(
    ("text", "said"),
    [
        (TABLE.replace("b,f", "c,f"), "line 3: camera 'c' is not in the rig"),
        (TABLE + "a,f,p,1,2\n", "line 4: the same point of the same frame and camera a second time"),
        (TABLE.replace("600", "6000"), "line 2: u, v lie far outside the camera's image"),
        (TABLE.replace("u,v", "u,v,sigma_px").replace("400", "400,0"), "line 2: sigma_px must be from"),
    ],
)
def test_a_table_that_breaks_a_rule_is_refused_by_its_line(text: str, said: str, tmp_path: Path) -> None:
    """The value, the rule, the line."""
    (tmp_path / "s.csv").write_text(text)
    with pytest.raises(InputError, match=r"s\.csv") as error:
        calib.triangulate(row_of_cameras(2), tmp_path / "s.csv")
    assert said in str(error.value)


def test_the_table_of_points_says_what_the_arrays_say(tmp_path: Path) -> None:
    """Read back: the same numbers by frame and point, covariances that add up, gaps that are empty."""
    rng = np.random.default_rng(12)
    rig = row_of_cameras(2)
    points = points_before(rig, 4, rng)
    seen = sighted(rig, points)
    lines = ["# by hand", "camera,frame,point,u,v,sigma_px"]
    lines += [
        f"{rig.names[row]},f{place % 2},p{place},{u!r},{v!r},0.2"
        for row, place, (u, v) in zip(seen.camera.tolist(), seen.place.tolist(), seen.center_px.tolist(), strict=True)
    ]
    (tmp_path / "s.csv").write_text("\n".join([*lines, "a,f0,alone,5,5,0.2"]))
    found = calib.triangulate(rig, tmp_path / "s.csv")
    (table,) = found.save(tmp_path / "points.csv")
    rows = [line.split(",") for line in table.read_text().splitlines() if not line.startswith("#")]
    read = {(row[0], row[1]): dict(zip(rows[0], row, strict=True)) for row in rows[1:]}
    for place, point in enumerate(points):
        row = read[f"f{place % 2}", f"p{place}"]
        np.testing.assert_allclose([float(row[axis]) for axis in "XYZ"], point, atol=1e-6)
        assert float(row["c_ZZ"]) == pytest.approx(float(row["noise_ZZ"]) + float(row["calibration_ZZ"]))
        assert row["reason"] == ""
    alone = read["f0", "alone"]
    assert (alone["X"], alone["c_XX"], alone["reason"]) == ("", "", "seen by one camera only")


@pytest.fixture(scope="module")
def pair() -> tuple[RigScene, RigCalibration]:
    """A stereo pair, solved from every second frame."""
    scene = stereo_pair(frames=16)
    even = np.arange(16) % 2 == 0
    return scene, solve_rig(keep_frames(scene.observations, even), [CameraChoice("opencv")] * 2)


def test_distances_of_other_frames_lie_within_what_is_stated(pair: tuple[RigScene, RigCalibration]) -> None:
    """Errors of all pairs are as large as their standard deviations, which hold 95 % of them; so is the scale."""
    scene, found = pair
    told = calib.triangulate(found.rig, keep_frames(scene.observations, np.arange(16) % 2 == 1)).lengths
    assert told.frames == 8
    assert told.ratio == pytest.approx(1, abs=0.12)
    assert told.within_95 == pytest.approx(0.95, abs=0.03)
    assert abs(told.scale) < 3 * told.scale_sigma < 1e-3
    assert sum(one.pairs for one in told.bins) == told.pairs


def test_an_object_that_is_larger_than_its_file_shows_in_the_scale() -> None:
    """By exactly as much; its sigma is that of the scatter over simulated photos."""
    rng = np.random.default_rng(2)
    rig = without_errors(row_of_cameras(2))
    points = points_before(rig, 30, rng)
    found = triangulate_points(rig, sighted(rig, 1.01 * points))
    told = check_lengths(found, points, "a thing")
    assert told.scale == pytest.approx(0.01, rel=1e-4)
    scales = []
    for _ in range(40):
        seen = sighted(rig, points, rng)
        again = check_lengths(triangulate_points(rig, seen), points, "a thing")
        scales.append(again.scale)
    assert np.std(scales) == pytest.approx(told.scale_sigma, rel=0.3)


def test_centres_that_scatter_more_than_they_state_are_taken_as_they_are(pair: tuple[RigScene, RigCalibration]) -> None:
    """A detector that is too sure of itself does not make lengths look surer than they are; it is said."""
    scene, found = pair
    seen = keep_frames(scene.observations, np.arange(16) % 2 == 1)
    sure = tuple(
        replace(one, cov_px2=None if one.cov_px2 is None else one.cov_px2 / 9) for one in seen.sightings
    )  # fmt: skip
    told = calib.triangulate(found.rig, replace(seen, sightings=sure))
    assert told.lengths.ratio == pytest.approx(1, abs=0.15)
    assert "times as much as they state" in told.remarks[-1]


def test_a_table_of_known_points_is_a_check_object(pair: tuple[RigScene, RigCalibration], tmp_path: Path) -> None:
    """As `calib rig` takes it, with X, Y, Z."""
    scene, found = pair
    seen = scene.observations
    lines = [f"# camera {name} 1280 x 960" for name in seen.camera_names] + ["camera,frame,u,v,X,Y,Z"]
    for name, one in zip(seen.camera_names, seen.sightings, strict=True):
        rows = np.column_stack([one.center_px, one.points.position_mm[one.point]])[one.view < 2]
        lines += [
            f"{name},f{view},{','.join(map(repr, row))}"
            for view, row in zip(one.view.tolist(), rows.tolist(), strict=False)
        ]
    (tmp_path / "board.csv").write_text("\n".join(lines) + "\n")
    told = calib.triangulate(found.rig, tmp_path / "board.csv").lengths
    assert (told.frames, told.ratio < 2) == (2, True)


def test_the_rigs_own_target_is_said_to_check_no_size(pair: tuple[RigScene, RigCalibration]) -> None:
    """Its size is in the rig, too, so the scale fits whatever it is; of another target nothing is said."""
    scene, found = pair
    one = keep_frames(scene.observations, np.arange(16) == 1)
    rigs = found.rig, replace(found.rig, geometry_id="another"), replace(found.rig, geometry_id="")
    told = [calib.triangulate(rig, one).remarks for rig in rigs]
    assert ["this very target" in " ".join(remarks) for remarks in told] == [True, False, False]


@pytest.mark.parametrize(
    ("given", "said"),
    [
        ({}, "give a table of sightings; or photos"),
        ({"photos": ["a", "b"]}, "name the target file"),
        ({"target": "x.target.json", "sightings": "p.csv"}, "target: is of photos"),
        ({"photos": "none", "target": "x.target.json"}, "x.target.json: cannot be read"),
    ],
)
def test_what_does_not_go_together_is_refused(
    given: dict[str, object], said: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Points or a check object, and all of it."""
    monkeypatch.chdir(tmp_path)
    Path("p.csv").write_text("camera,frame,point,u,v\na,f,p,600,400\nb,f,p,500,400\n")
    with pytest.raises(InputError, match=said):
        calib.triangulate(row_of_cameras(2), **given)  # type: ignore[arg-type]


def test_a_camera_of_another_rig_is_named(pair: tuple[RigScene, RigCalibration]) -> None:
    """Or photos of another size."""
    scene, _ = pair
    with pytest.raises(InputError, match="camera 'left': not in the rig"):
        calib.triangulate(row_of_cameras(2), scene.observations)
