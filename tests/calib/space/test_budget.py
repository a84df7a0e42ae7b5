"""What is to be expected of a rig, against what simulated rigs do, and against formulas."""

from dataclasses import replace

import numpy as np
import pytest

import calib
from calib.cameras.rig import Rig
from calib.core.se3 import look_at, transform
from calib.space.budget import (
    expected_errors,
    if_known_exactly,
    length_errors,
    parts_of,
    with_baseline,
    with_camera,
    with_frames,
    without_rigid_motion,
)
from calib.space.triangulate import triangulate_points
from calib.space.volume import default_volume, volume_between
from designer.base.errors import InputError
from tests.support.rig_views import SIZE, camera
from tests.support.space_scenes import (
    NOISE_PX,
    drawn,
    points_before,
    row_of_cameras,
    sighted,
    wide_camera,
    without_errors,
)

NOISE = np.full(2, NOISE_PX)


def pinhole_pair(baseline_mm: float = 100.0) -> Rig:
    """Two cameras side by side, with axes that are parallel."""
    poses = np.tile(np.eye(4), (2, 1, 1))
    poses[1, 0, 3] = -baseline_mm
    one = camera(model="pinhole")
    covariance = np.zeros((20, 20))
    return Rig(("left", "right"), (one, one), poses, covariance, NOISE)


def ring() -> Rig:
    """Four cameras around a point 100 mm above the origin of their frame."""
    eyes = 600 * np.array([[1.0, 0, 0], [0, 1, 0], [-1, 0, 0], [0, -1, 0]]) + [0, 0, 100]
    one = camera(model="pinhole")
    return Rig(tuple("abcd"), (one,) * 4, look_at(eyes, np.array([0.0, 0, 100])), None, np.full(4, NOISE_PX))


def test_depth_of_a_stereo_pair_follows_the_formula() -> None:
    """Noise alone: `sigma_Z = sqrt(2) Z^2 sigma / (f b)` on the bisector, and across `Z sigma / (sqrt(2) f)`."""
    rig = pinhole_pair()
    found = calib.budget(rig, distance_mm=(500, 4000))
    focal, z = rig.cameras[0].params[0], found.depth.distance_mm
    np.testing.assert_allclose(found.depth.depth_mm, np.sqrt(2) * z**2 * NOISE_PX / (focal * 100), rtol=0.01)
    np.testing.assert_allclose(found.depth.across_mm, z * NOISE_PX / (np.sqrt(2) * focal), rtol=0.01)
    assert found.by_calibration.worst_mm == 0


def test_known_error_of_the_baseline_scales_the_depth() -> None:
    """A baseline that is unsure by 1 % makes a depth that is unsure by 1 %, and lengths too; nothing else."""
    rig = pinhole_pair()
    covariance = np.zeros((20, 20))
    covariance[17, 17] = 1.0
    unsure = replace(rig, covariance=covariance)
    points = np.array([[50.0, 0, 800], [50, 0, 2000]])
    expected = expected_errors(unsure, points, NOISE)
    np.testing.assert_allclose(np.sqrt(expected.calibration_mm2[:, 2, 2]), 0.01 * points[:, 2], rtol=1e-9)
    _, shared = length_errors(unsure, points, np.eye(3), 100.0, NOISE)
    np.testing.assert_allclose(np.sqrt(shared), 1.0, rtol=1e-3)
    known = {one.part: one for one in if_known_exactly(unsure, expected)}
    assert set(known) == {"the noise of the pixels", "the whole rig", "the positions", "the position of right"}
    assert known["the positions"].position.median_mm == pytest.approx(known["the whole rig"].position.median_mm)


def test_expected_errors_are_the_scatter_of_simulated_rigs() -> None:
    """Rigs drawn by their covariance, sightings with noise: point by point, and with rigid motions taken off."""
    rng = np.random.default_rng(5)
    truth = row_of_cameras(2)
    points = points_before(truth, 30, rng)
    expected = expected_errors(truth, points, NOISE)
    assert expected.by_calibration is not None
    off = np.array(
        [triangulate_points(drawn(truth, rng), sighted(truth, points, rng)).position_mm - points for _ in range(80)]
    )
    scatter = np.sqrt((off**2).sum(axis=2).mean(axis=0))
    stated = np.sqrt(np.trace(expected.covariance_mm2, axis1=1, axis2=2))
    assert np.median(scatter / stated) == pytest.approx(1, abs=0.15)
    shape = without_rigid_motion(points, np.moveaxis(off, 0, 2), stated)
    moved = without_rigid_motion(points, expected.by_calibration, stated)
    stated = np.sqrt(np.trace(expected.noise_mm2, axis1=1, axis2=2) + (moved**2).sum(axis=(1, 2)))
    assert np.median(np.sqrt((shape**2).sum(axis=1).mean(axis=1)) / stated) == pytest.approx(1, abs=0.15)


def test_a_rigid_motion_is_no_error_of_a_shape() -> None:
    """A common turn and shift of all points leaves nothing; a common scale stays."""
    rng = np.random.default_rng(6)
    points = rng.uniform([-500, -500, 1000], [500, 500, 2000], (40, 3))
    turn, shift = np.cross(rng.standard_normal(3), points), np.tile(rng.standard_normal(3), (40, 1))
    errors = np.stack([turn, shift, 0.01 * points], axis=2)
    left = np.abs(without_rigid_motion(points, errors, np.linspace(1, 9, 40))).max(axis=(0, 1))
    assert (left[:2] < 1e-9).all()
    assert left[2] > 1


def test_parts_are_those_that_are_not_fixed() -> None:
    """The reference camera's pose is no part; kinds hold all of their cameras' rows, each once."""
    rig = row_of_cameras(3)
    parts = parts_of(rig)
    assert "the rotation of a" not in parts
    assert "the lens of a" in parts
    kinds = np.concatenate([parts[kind] for kind in ("the lenses", "the rotations", "the positions")])
    np.testing.assert_array_equal(np.sort(kinds), np.flatnonzero(np.diagonal(rig.covariance)))


def test_knowing_a_part_never_makes_it_worse() -> None:
    """And knowing the kind is worth at least as much as knowing one camera of it."""
    found = calib.budget(row_of_cameras(3), distance_mm=(700, 1500))
    known = {one.part: one.position.median_mm for one in found.known}
    assert max(known.values()) <= found.position.median_mm
    assert known["the whole rig"] == found.by_noise.median_mm <= known["the lenses"] <= known["the lens of b"]
    assert known["the noise of the pixels"] == pytest.approx(found.by_calibration.median_mm)


def test_changes_are_budgets_of_changed_rigs() -> None:
    """More frames: a quarter of the covariance; a baseline twice as long; one camera more, as it was said."""
    rig = row_of_cameras(2)
    np.testing.assert_allclose(with_frames(rig, 4).covariance, rig.covariance / 4)
    wide = with_baseline(rig, 2)
    np.testing.assert_allclose(np.diff(wide.center_mm, axis=0), 2 * np.diff(rig.center_mm, axis=0))
    np.testing.assert_array_equal(wide.cam_from_rig[:, :3, :3], rig.cam_from_rig[:, :3, :3])
    eye, aim = np.array([70.0, -200, 10]), np.array([50.0, 0, 1000])
    more = with_camera(rig, 1, eye, aim)
    np.testing.assert_allclose(more.center_mm[2], eye)
    seen = transform(more.cam_from_rig[2], aim)
    np.testing.assert_allclose(seen[:2] / seen[2], 0, atol=1e-12)
    first, last = rig.first_row[1], rig.first_row[2]
    np.testing.assert_allclose(more.covariance[last:, last:], rig.covariance[first:last, first:last])
    np.testing.assert_allclose(more.covariance[:first, last:], rig.covariance[:first, first:last])
    correlation = more.covariance / np.sqrt(np.outer(*[np.diagonal(more.covariance)] * 2) + 1e-300)
    assert np.linalg.eigvalsh(correlation).min() > -1e-9
    changes = {one.change: one for one in calib.budget(rig, distance_mm=(700, 1500)).changes}
    now = calib.budget(rig, distance_mm=(700, 1500)).position.median_mm
    assert len(changes) == 4
    assert all(one.position.median_mm < now for one in changes.values())


@pytest.mark.parametrize("sign", [1, -1])
def test_one_camera_more_shares_what_the_cameras_share(sign: int) -> None:
    """Where a lens and the other camera's rotation are wrong together, a camera more is wrong with them: no loss."""
    rig = row_of_cameras(2)
    together = np.zeros(len(rig.covariance))
    together[2], together[rig.pose_rows(1).start + 1] = 5.0, sign * 5.0 / rig.cameras[0].params[0]
    joined = replace(rig, covariance=0.01 * rig.covariance + np.outer(together, together))
    found = calib.budget(joined, distance_mm=(700, 1500))
    more = next(one for one in found.changes if one.change == "one camera more")
    assert more.shape.median_mm < found.shape.median_mm


def test_without_a_covariance_only_noise_is_told() -> None:
    """What is not known is nan, and said."""
    found = calib.budget(replace(row_of_cameras(2), covariance=None), distance_mm=(700, 1500))
    assert np.isnan([found.by_calibration.median_mm, found.shape.median_mm]).all()
    assert found.position == found.by_noise
    assert found.known == ()
    assert "tells no covariance" in found.remarks[0]


def test_volumes_follow_the_cameras() -> None:
    """Ahead of a pair; around what a ring looks at; all ways of fisheyes back to back; a box as given."""
    pair = volume_between(pinhole_pair(), 500, 2000, 2)
    assert pair.is_ahead
    np.testing.assert_allclose(pair.rig_from_volume[:3, 3], [50, 0, 0])
    np.testing.assert_allclose(pair.rig_from_volume[:3, :3], np.eye(3), atol=1e-12)
    assert default_volume(pinhole_pair(), 2).near_mm == 500  # five baselines
    around = default_volume(ring(), 2)
    assert not around.is_ahead
    np.testing.assert_allclose(around.rig_from_volume[:3, 3], [0, 0, 100], atol=1e-6)
    assert around.far_mm == 150  # a quarter of the way
    eyes = np.array([[-40.0, 0, 0], [40, 0, 0]])
    back = Rig(("a", "b"), (wide_camera(),) * 2, look_at(eyes, 10 * eyes), None, NOISE)
    assert calib.budget(back).share > 0.1
    box = calib.budget(pinhole_pair(), volume=((-100, -100, 900), (100, 100, 1100)))
    assert (box.share, box.depth) == (1.0, None)
    assert box.points > 3000 >= box.points - 4000


def test_three_cameras_that_have_to_see_a_point_see_less() -> None:
    """`seen_by` is kept: where fewer see, nothing is told."""
    rig = replace(row_of_cameras(3), covariance=None)
    two, three = (calib.budget(rig, distance_mm=(700, 1500), seen_by=count) for count in (2, 3))
    assert three.expected.cameras.min() == 3 > two.expected.cameras.min()


@pytest.mark.parametrize(
    ("wrong", "said"),
    [
        ({"distance_mm": (2.0, 1.0)}, "the smaller comes first"),
        ({"distance_mm": (500, 4000), "volume": ((0, 0, 0), (1, 1, 1))}, "each says where"),
        ({"volume": ((0, 0, 5), (1, 1, 1))}, "the smaller first"),
        ({"volume": ((0, 0, -500), (1, 1, -400))}, "no point of the volume"),
        ({"seen_by": 3}, "seen_by 3: must be from 2 to 2"),
        ({"noise_px": 0.0}, "noise_px"),
        ({"noise_px": (0.1, 0.1, 0.1)}, "3 numbers for 2 cameras"),
        ({"length_mm": -1.0}, "length_mm"),
    ],
)
def test_options_that_break_a_rule_are_refused(wrong: dict[str, object], said: str) -> None:
    """By their names on a command line, with the rule."""
    with pytest.raises(InputError, match=said):
        calib.budget(pinhole_pair(), **wrong)  # type: ignore[arg-type]


def test_where_errors_are_as_large_as_the_distance_it_is_said() -> None:
    """The law of small errors holds there no more, and no point would have a position."""
    far = calib.budget(pinhole_pair(), distance_mm=(1e5, 1e6))
    assert "errors reach a third of the distance" in " ".join(far.remarks)
    assert "errors reach" not in " ".join(calib.budget(pinhole_pair(), distance_mm=(500, 2000)).remarks)


def test_noise_that_nobody_states_is_asked_for() -> None:
    """A rig from elsewhere may not tell it."""
    rig = replace(without_errors(pinhole_pair()), noise_px=None)
    with pytest.raises(InputError, match="give noise_px"):
        calib.budget(rig)
    assert calib.budget(rig, noise_px=0.2).noise_px.tolist() == [0.2, 0.2]
    assert rig.cameras[0].image_size == SIZE
