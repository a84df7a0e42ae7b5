"""Pairs of cameras of a solved rig: distances and angles with their sigmas, epipolar errors, ties; rigs compared."""

import json
from dataclasses import replace
from pathlib import Path

import cv2
import numpy as np
import pytest

from calib.cameras.rig import Rig
from calib.core.se3 import compose, exp_rotation, invert, log_rotation, make_pose, skew
from calib.judge.evidence import joint_evidence
from calib.judge.halves import NOT_COMPARED, RigHalves, RigSplit
from calib.judge.joint_halves import enlarged
from calib.rigs.figures import epipolar_distances, seen_by_both, ties_of, widest_chain
from calib.rigs.problem import CameraChoice, RigOptions
from calib.rigs.relative import Relative, compare_rigs, middle_error, relative
from calib.rigs.solve import solve_rig
from designer.base.errors import InputError
from tests.support import foreign_rigs
from tests.support.command_line import calib
from tests.support.rig_views import camera, ring, scene_of, solved_slowly, stereo_pair
from tests.support.solver_scenes import icosahedron
from tests.support.space_scenes import drawn


def test_deviations_of_a_pair_are_those_of_drawn_rigs() -> None:
    """Distance, angle, place and turn scatter by what is told, when poses are drawn from the joint covariance."""
    rig, rng = solved_slowly(ring(frames=6)).rig, np.random.default_rng(0)
    poses = [drawn(rig, rng).cam_from_rig for _ in range(1000)]
    told = relative(rig, 1, 3)
    pairs = np.stack([compose(one[3], invert(one[1])) for one in poses])
    turn = log_rotation(pairs[:, :3, :3] @ told.b_from_a[:3, :3].T)
    assert np.cov(turn.T) == pytest.approx(told.covariance[:3, :3], abs=0.12 * told.turn_sigma_rad**2)
    place = (invert(pairs)[:, :3, 3] - invert(told.b_from_a)[:3, 3]) @ told.b_from_a[:3, :3].T
    assert np.cov(place.T) == pytest.approx(told.center_covariance_mm2, abs=0.12 * told.place_sigma_mm**2)
    assert np.linalg.norm(pairs[:, :3, 3], axis=1).std() == pytest.approx(told.baseline_sigma_mm, rel=0.08)


def test_what_is_told_of_a_pair_does_not_depend_on_the_reference() -> None:
    """Distances, angles and their deviations are those of the cameras, whichever camera's frame the rig has."""
    scene = stereo_pair(frames=6)
    choices = [CameraChoice(one.model) for one in scene.cameras]
    first, second = (
        relative(solve_rig(scene.observations, choices, RigOptions(reference=row)).rig, 0, 1) for row in (0, 1)
    )
    for name in ("baseline_mm", "baseline_sigma_mm", "angle_rad", "angle_sigma_rad", "place_sigma_mm"):
        assert getattr(first, name) == pytest.approx(getattr(second, name), rel=1e-3)


def test_cameras_at_one_place_have_the_deviation_of_any_direction() -> None:
    """Of a distance that may be zero no direction is known, so the largest deviation is told, and a finite one."""
    same = Relative(np.eye(4), np.diag([1.0, 2, 3, 4, 5, 9]), np.eye(3))
    assert same.baseline_sigma_mm == pytest.approx(3)
    assert same.angle_sigma_rad == pytest.approx(np.sqrt(3))


def test_epipolar_errors_are_zero_without_noise() -> None:
    """Of exact sightings the ray of one camera leads through the point in the other's image, whatever the lenses."""
    found = solved_slowly(ring(frames=4, noise_px=0.0, models=("opencv", "fisheye")), steps=0)
    distance = epipolar_distances(found, 0, 1)
    assert len(distance) > 20
    assert np.abs(distance).max() < 1e-6


def test_epipolar_errors_are_those_of_opencv() -> None:
    """Without lenses the distances are those from cv2's epipolar lines."""
    world = np.stack([np.eye(4), make_pose(exp_rotation(np.array([0.1, -0.4, 0.05])), np.array([150.0, 20, 30]))])
    held = make_pose(
        exp_rotation(np.array([[0.3, 0.2, 0.1], [1.0, -0.5, 0.3]])), np.array([[-60.0, 0, 500], [-40, 9, 450]])
    )
    lenses = (camera(1100, "pinhole"), camera(1150, "pinhole"))
    scene = scene_of(("a", "b"), lenses, world, held, icosahedron(60.0, 5), np.random.default_rng(0), 0.3)
    found = solved_slowly(scene, steps=0)
    rows = seen_by_both(found, 0, 1)
    pixel = [seen.center_px[row] for seen, row in zip(found.observations.sightings, rows, strict=True)]
    inverse = [np.linalg.inv(one.matrix) for one in lenses]
    pose = found.cam_from_rig[1]
    fundamental = inverse[1].T @ skew(pose[:3, 3]) @ pose[:3, :3] @ inverse[0]
    for side, (here, there) in enumerate(((0, 1), (1, 0))):
        line = cv2.computeCorrespondEpilines(pixel[there].astype(np.float64)[:, None], 2 - side, fundamental)[:, 0]
        expected = np.abs((line[:, :2] * pixel[here]).sum(axis=1) + line[:, 2])
        assert epipolar_distances(found, 0, 1)[:, side] == pytest.approx(expected, rel=2e-3, abs=2e-4)


def test_outliers_count_nowhere() -> None:
    """A sighting that was left out is in no residual, pair or epipolar error, but in the count of those left out."""
    found = solved_slowly(stereo_pair(frames=4))
    out = np.zeros(len(found.residual_px[0]), dtype=bool)
    out[:10] = True
    spoilt = found.residual_px[0].copy()
    spoilt[:10] = 1e3
    found = replace(found, residual_px=(spoilt, found.residual_px[1]), is_outlier=(out, found.is_outlier[1]))
    evidence = joint_evidence(found, NOT_COMPARED)
    left, (pair,) = evidence.cameras[0], evidence.pairs
    assert (left.left_out, left.sightings) == (10, len(out) - 10)
    assert left.rms_px < 1
    assert pair.rms_px < 1
    assert pair.points == len(out) - 10


def test_the_best_chain_decides_how_many_frames_join_a_camera() -> None:
    """Cameras of a chain hang together by its weakest link, not by what the ends share directly."""
    shared = np.array([[20, 12, 1, 0], [12, 20, 7, 0], [1, 7, 20, 3], [0, 0, 3, 20]])
    assert widest_chain(shared)[0].tolist()[1:] == [12, 7, 3]


def test_a_camera_hangs_on_the_one_it_is_best_known_to() -> None:
    """In a ring that is a neighbour, never the camera opposite; a single camera hangs on none."""
    found = solved_slowly(ring(frames=5))
    for tie in ties_of(found.rig, found.observations.shared):
        assert (tie.partner - tie.camera) % 2 == 1
        assert tie.place_sigma_mm == min(
            relative(found.rig, other, tie.camera).place_sigma_mm for other in range(4) if other != tie.camera
        )
    alone = replace(
        found.rig, names=("a",), cameras=found.cameras[:1], cam_from_rig=found.cam_from_rig[:1], covariance=None
    )
    assert ties_of(alone, np.array([[3]])) == ()


def test_enlarged_covariances_enlarge_what_noise_does_alone() -> None:
    """Halves that differ twice as much as they should double the noise's part, not what the target may be off."""
    found = solved_slowly(stereo_pair(frames=4))
    found = replace(found, target_covariance=np.eye(len(found.covariance)))
    more = enlarged(found, RigHalves((RigSplit("by turns", 2.0, 1000, 1.0, ()),)))
    assert more.stated_covariance == pytest.approx(4 * found.covariance + np.eye(len(found.covariance)))


def test_the_middle_is_placed_worse_by_a_rig_that_is_known_worse() -> None:
    """A point's error has a part by noise and one by the rig, and that one alone grows with the rig's covariance."""
    found = solved_slowly(stereo_pair(frames=5))
    one, two = middle_error(found), middle_error(replace(found, covariance=9 * found.covariance))
    assert two.noise_mm == pytest.approx(one.noise_mm)
    assert two.rig_mm == pytest.approx(3 * one.rig_mm)
    assert 400 < one.away_mm < 600


def placed_anew(rig: Rig, scale: float = 1.0) -> Rig:
    """The rig in another frame, all its lengths scaled."""
    poses = rig.cam_from_rig @ make_pose(exp_rotation(np.array([0.3, -1.0, 2.0])), np.array([500.0, -20, 90]))
    poses[:, :3, 3] *= scale
    return replace(rig, cam_from_rig=poses)


def test_whose_frame_a_rig_has_makes_no_difference() -> None:
    """The same rig in another frame differs by nothing, and order of the cameras does not matter."""
    rig = foreign_rigs.ring()
    other = placed_anew(rig)
    other = replace(other, names=other.names[::-1], cameras=other.cameras[::-1], cam_from_rig=other.cam_from_rig[::-1])
    found = compare_rigs(rig, other)
    assert found.cameras == rig.names
    assert max(one.place_mm + one.turn_rad for one in found.pairs) < 1e-9
    assert found.placed.max_mm < 1e-6
    assert all(one.max_px < 1e-6 for one in found.placed.cameras)


def test_a_scale_is_told_as_such() -> None:
    """Of a rig whose target was 1 % too long: baselines, and the points that both place, are 1 % apart."""
    rig = foreign_rigs.stereo()
    found = compare_rigs(rig, placed_anew(rig, 1.01))
    assert found.placed.scale == pytest.approx(0.01, rel=1e-6)
    (pair,) = found.pairs
    assert pair.baseline_mm[1] / pair.baseline_mm[0] == pytest.approx(1.01)
    assert pair.turn_rad < 1e-12


def test_a_turned_camera_is_told_in_its_pair_and_in_pixels() -> None:
    """A camera turned by .1 degrees: the pairs with it turn, the others do not, and pixels are apart."""
    rig = foreign_rigs.ring()
    turned = rig.cam_from_rig.copy()
    turned[2] = make_pose(exp_rotation(np.array([0.0, np.radians(0.1), 0])), np.zeros(3)) @ turned[2]
    found = compare_rigs(rig, replace(rig, cam_from_rig=turned))
    turns = {(one.a, one.b): np.degrees(one.turn_rad) for one in found.pairs}
    assert turns == pytest.approx({("cam a", "cam b"): 0, ("cam a", "cam c"): 0.1, ("cam b", "cam c"): 0.1})
    assert 0.2 < max(one.rms_px for one in found.placed.cameras) < 900 * np.radians(0.1)


def test_sigmas_are_those_of_both() -> None:
    """Of independent rigs the variances of a baseline add; of one that does not know, nothing is told."""
    rig = foreign_rigs.stereo()
    known = replace(rig, covariance=np.diag([*[1e-12] * 9, *[0] * 6, *[1e-12] * 9, *[0] * 3, 0.09, 0.09, 0.09]))
    assert compare_rigs(known, known).pairs[0].baseline_sigma_mm == pytest.approx(0.3 * np.sqrt(2))
    assert np.isnan(compare_rigs(known, rig).pairs[0].baseline_sigma_mm)


def test_cameras_of_other_names_and_sizes_are_refused() -> None:
    """Which they are is said; those of one rig alone are named."""
    rig = foreign_rigs.ring()
    found = compare_rigs(rig, replace(rig, names=("cam a", "cam b", "other")))
    assert found.only == (("cam c",), ("other",))
    with pytest.raises(InputError, match="of cameras left, right and cam a, cam b, cam c not two have the same names"):
        compare_rigs(foreign_rigs.stereo(), rig)
    smaller = tuple(replace(one, image_size=(640, 480)) for one in foreign_rigs.stereo().cameras)
    with pytest.raises(InputError, match="camera left: has images of 1024 x 768 px and 640 x 480 px"):
        compare_rigs(foreign_rigs.stereo(), replace(foreign_rigs.stereo(), cameras=smaller))


def test_cameras_that_see_nothing_together_are_compared_by_their_places() -> None:
    """Back to back: pairs are told, and nothing in space."""
    pair = foreign_rigs.stereo()
    apart = replace(
        pair, cam_from_rig=np.stack([np.eye(4), make_pose(exp_rotation(np.array([0, np.pi, 0])), np.zeros(3))])
    )
    found = compare_rigs(apart, apart)
    assert found.placed is None
    assert found.pairs[0].place_mm == 0


def test_the_command_tells_rigs_from_cameras(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Two rigs are compared, whatever files they come from; a rig and a camera, or options of cameras, are refused."""
    monkeypatch.chdir(tmp_path)
    foreign_rigs.stereo().save("a.json")
    foreign_rigs.stereo().cameras[0].save("camera.json")
    assert calib("convert", "a.json", "--to", "kalibr", "-o", "b.yaml").code == 0
    answer = calib("diff", "a.json", "b.yaml", "--json")
    told = json.loads(answer.out)["answer"]
    assert told["placed"]["rms_mm"] < 1e-6
    assert told["pairs"][0]["baseline_sigma_mm"] is None
    assert "left - right" in calib("diff", "a.json", "b.yaml").out
    for words, rule in (
        (("a.json", "camera.json"), "a.json: is a rig, camera.json none; name one of its cameras, as in a.json#left"),
        (("a.json", "b.yaml", "--radius", "9"), "--radius and --picture are of two cameras"),
    ):
        answer = calib("diff", *words)
        assert answer.code == 2
        assert rule in answer.err
    assert calib("diff", "a.json#left", "camera.json").code == 0
