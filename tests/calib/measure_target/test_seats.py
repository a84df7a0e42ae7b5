"""Targets put together from pieces, and boards with two faces: what sits badly, and what photos and a caliper tell."""

from dataclasses import replace
from functools import cache

import numpy as np
import pytest

from calib.app.measure import rescale
from calib.core.se3 import invert, log_rotation, look_at, make_pose
from calib.core.types import Observations
from calib.measure_target.back import back_covariance, with_thickness
from calib.measure_target.deviations import Compensation
from calib.measure_target.lengths import CaliperLength
from calib.measure_target.record import deviations_of, record_of
from calib.measure_target.result import AsBuilt
from calib.measure_target.solve import measure
from calib.measure_target.tile_fit import PARTS, SOURCE_OF, Seats, limits_of, seats_of
from calib.measure_target.unknowns import AsBuiltOptions, TargetUnknowns
from calib.observe.observations import known_points
from calib.solver.solve import solve
from designer.base.arrays import Array
from designer.kinds.board import BoardSpec
from designer.kinds.cube import CubeSpec
from designer.kinds.layout import lay_out
from designer.target import TargetGeometry
from designer.tolerance.error_file import error_model
from designer.tolerance.made import how_made
from designer.tolerance.model import displaced, draw_values, perturb
from tests.support.as_built_scenes import frame_errors, mahalanobis, photos, printed, random_shape, solid
from tests.support.solver_scenes import CAMERAS, observe, poses_around

SEED = 5


@cache
def cube() -> TargetGeometry:
    """A cube with 25 rings on a face."""
    return lay_out(CubeSpec(80.0, 5, 9.0, 0.45, 13.0, 2.0, 1.0))


def assembled(target: TargetGeometry, *, lift_mm: float = 0.0, turn_rad: float = 1e-3) -> TargetUnknowns:
    """Pieces put down well, within 0.05 mm and 0.06 deg, or all of them higher."""
    rng = np.random.default_rng(SEED)
    shape = random_shape(target, rng, strain=1e-3, turn_rad=turn_rad, shift_mm=0.05, ring_mm=(0.03, 0.02))
    motion = np.array(shape.motion)
    motion[:, 5] += lift_mm
    return replace(shape, motion=motion)


def moved(shape: TargetUnknowns, face: int, motion: Array) -> TargetUnknowns:
    """One of them put down elsewhere."""
    changed = np.array(shape.motion)
    changed[face] = motion
    return replace(shape, motion=changed)


def measured(target: TargetGeometry, shape: TargetUnknowns, made: str = "fdm-tiles") -> tuple[AsBuilt, Seats]:
    """What photos of it tell."""
    seen = photos(printed(target, shape), np.random.default_rng(SEED), 24)
    found = measure([seen], target, "opencv", AsBuiltOptions(made=how_made(target, made)))
    seats = seats_of(found, error_model(made))
    assert seats is not None
    return found, seats


@pytest.mark.parametrize(("make", "face"), [(solid, 7), (cube, 2)])
@pytest.mark.parametrize("made", ["fdm-tiles", "hand-stickers"])
def test_the_piece_that_sits_badly_is_named_with_its_numbers(make: object, face: int, made: str) -> None:
    """One is put down 0.9 mm high and turned by 2.3 deg: it alone is named, with these numbers; none moves for it."""
    target = solid() if make is solid else cube()
    motion = np.array([0.002, -0.001, 0.04, 0.02, -0.03, 0.9])
    shape = moved(assembled(target), face, motion)
    _, seats = measured(target, shape, made)
    assert [one.face for one in seats.bad] == [face]
    (bad,) = seats.bad
    assert set(bad.faults) == {"lifted", "turned"}
    assert seats.common_height_mm is None
    heights = np.array([one.height_mm.value for one in seats.seats])
    sigmas = np.array([one.height_mm.sigma for one in seats.seats])
    # Where all of them are is a convention, to a part of their scatter.
    others = np.arange(target.face_count) != face
    assert abs(np.median((heights - shape.motion[:, 5])[others])) < 0.03
    assert abs(bad.height_mm.value - 0.9) < 0.03 + 4 * sigmas[face]
    assert abs(bad.turn_rad.value - 0.04) < 0.001 + 4 * bad.turn_rad.sigma


def test_what_all_pieces_have_in_common_is_no_piece_s_fault() -> None:
    """All are glued 0.7 mm too high: that is told once, and no tile is blamed, though each is beyond its limit."""
    shape = assembled(solid(), lift_mm=0.7)
    found, seats = measured(solid(), shape)
    assert seats.bad == ()
    true_mm = float(shape.motion[:, 5].mean())
    assert abs(seats.common_height_mm.value - true_mm) < 4 * seats.common_height_mm.sigma
    assert seats.common_height_mm.sigma < 0.02
    assert (found.motion[:, 5] > seats.limits.lifted).mean() > 0.9
    heights_mm, told_mm = shown_heights_mm(found), np.array([one.height_mm.value for one in seats.seats])
    np.testing.assert_allclose(heights_mm, told_mm, rtol=0, atol=0.015)  # what the rings' own offsets leave in a mean


def shown_heights_mm(found: AsBuilt) -> Array:
    """How high each face's rings stand in picture and scene."""
    record = record_of(
        found, None, Compensation(), bed_turn_rad=0.0, weighted=True, remarks=(), made=error_model("fdm-tiles"),
        program="", settings={},
    )  # fmt: skip
    height = deviations_of(record, found.target).in_face_mm[:, 2]
    face = found.target.ring_face
    return np.asarray(np.bincount(face, height) / np.bincount(face))


def test_an_outlying_face_takes_no_part_in_the_datum() -> None:
    """A face 2 mm off leaves the others where they are without it, to 0.02 mm: least squares would move them by 0.1."""
    shape = assembled(solid())
    plain, _ = measured(solid(), shape)
    odd, _ = measured(solid(), moved(shape, 4, np.array([0.0, 0.0, 0.0, 0.0, 0.0, 2.0])))
    assert not plain.is_outlying.any()
    assert np.flatnonzero(odd.is_outlying).tolist() == [4]
    others = np.arange(20) != 4
    assert np.abs((odd.motion - plain.motion)[others, 3:]).max() < 0.02


def test_an_assembly_as_usual_is_blamed_once_in_a_hundred() -> None:
    """Of assemblies drawn from the way of making 1 % have a piece beyond a limit, each kind of fault its part."""
    for name in ("fdm-tiles", "hand-stickers"):
        model = error_model(name).only(*SOURCE_OF.values())
        limits, rng = limits_of(model, 20), np.random.default_rng(SEED)
        beyond = np.zeros(1500, dtype=bool)
        for number in range(len(beyond)):
            values = draw_values(solid(), model, rng)
            beyond[number] = any(
                (np.linalg.norm(values[source], axis=1) > limits.of(fault)).any() for fault, source in SOURCE_OF.items()
            )
        bounded = sum(model.amount(source).kind == "uniform" for source in SOURCE_OF.values())
        expected = 0.01 * (len(PARTS) - bounded) / len(PARTS)
        assert abs(beyond.mean() - expected) < 4 * np.sqrt(expected / len(beyond)), name


def test_one_print_has_no_pieces() -> None:
    """A body in one piece is not told of tiles, nor a target of which nobody knows how it was made."""
    seen = photos(printed(solid(), assembled(solid())), np.random.default_rng(SEED), 12)
    found = measure([seen], solid(), "opencv")
    assert seats_of(found, error_model("fdm-dual")) is None
    assert seats_of(found, None) is None


NOISE_PX = 0.02


def plate() -> TargetGeometry:
    """7 x 6 rings of 14 mm on each side of 5 mm."""
    spec = BoardSpec((150.0, 130.0), 5.0, 7, 6, "square", 14.0, 0.45, 20.0, 0.0, 1.0, dots=True, two_sided=True)
    return replace(lay_out(spec), build="one-piece")


def from_both_sides(print_: TargetGeometry, rng: np.random.Generator, views: int = 20) -> Observations:
    """Every second photo is of the back."""
    poses = poses_around(views, rng)
    turn = make_pose(np.diag([-1.0, 1.0, -1.0]), np.zeros(3))
    poses[1::2] = poses[1::2] @ turn
    return observe(CAMERAS["opencv"], known_points(print_), poses, rng, noise_px=NOISE_PX, incidence_deg=70)


def test_the_print_is_measured_and_the_back_stays_as_designed() -> None:
    """A skewed print of another thickness: skew is found; the back is as uncertain as it was made."""
    target, rng = plate(), np.random.default_rng(3)
    model = error_model("fdm-board-two-sided")
    values = {"skew": np.array([[3e-3, 0, 0]]), "face_offset": np.array([[0.0], [0.08]])}
    print_ = displaced(target, values, model=model)
    found = measure([from_both_sides(print_, rng)], target, "opencv", AsBuiltOptions(made=how_made(target)))
    assert found.status == "converged"
    assert found.is_determined.all()
    assert 2 * abs(found.strain[0, 1]) == pytest.approx(3e-3, rel=0.05)
    assert found.target.target_from_face[1, 2, 3] == pytest.approx(-5.0, abs=0.01)
    assert found.motion_covariance[11, 11] == pytest.approx(2 * 0.05**2, rel=0.1)
    assert "--length 'face 0 to face 1:READING'" in found.remarks[-1]


def test_a_caliper_tells_the_thickness_and_nothing_else() -> None:
    """The back moves to the reading, with its sigma; rings keep their distances; with and without photos."""
    target, rng = plate(), np.random.default_rng(4)
    length = CaliperLength("face 0 to face 1", 5.08, 0.02)
    seen = [from_both_sides(target, rng)]
    plain, told = (
        measure(seen, target, "opencv", AsBuiltOptions(made=how_made(target)), lengths) for lengths in ((), (length,))
    )
    back = target.ring_face == 1
    assert told.target.center_mm[~back] == pytest.approx(plain.target.center_mm[~back], abs=1e-9)
    assert (told.target.center_mm - plain.target.center_mm)[back] == pytest.approx(
        np.tile([0, 0, -0.08], (int(back.sum()), 1)), abs=1e-3
    )
    assert not told.scale_known
    assert told.motion_covariance[11, 11] ** 0.5 == pytest.approx(0.02, rel=0.05)
    quick = rescale(target, length)
    assert quick.size is None
    assert np.array_equal(quick.target.center_mm, with_thickness(target, 5.08).center_mm)
    assert np.array_equal(quick.target.center_mm[~back], target.center_mm[~back])
    wide = rescale(target, CaliperLength("ring 0 to ring 6", 120.6, 0.02))
    assert wide.size.value == pytest.approx(0.005)


def test_the_backs_uncertainty_is_that_of_prints() -> None:
    """Prints drawn from the errors put the back against the front as the covariance says (chi-square of 6 numbers)."""
    target, model, rng = plate(), error_model("sheet-two-sided"), np.random.default_rng(5)
    model = replace(model, amounts=tuple(one for one in model.amounts if one[0].startswith("face_")))
    covariance = back_covariance(target, model)
    squares = []
    for _ in range(300):
        print_ = perturb(target, model, rng)
        frame = print_.target_from_face
        laid = target.target_from_face[0] @ invert(frame[:1])[0] @ frame[1]
        moved = replace(target, target_from_face=np.stack([target.target_from_face[0], laid]))
        squares.append(mahalanobis(frame_errors(moved, target)[1:], covariance[None])[0])
    assert np.mean(squares) == pytest.approx(6, rel=0.15)


def test_cameras_that_face_each_other_are_placed_by_the_board_between_them() -> None:
    """Each sees its own side at the same moments: where they stand to each other follows, thickness included."""
    target, rng = plate(), np.random.default_rng(6)
    camera, views = CAMERAS["opencv"], 60
    first = look_at(np.array([[0.0, 0.0, 450.0]]), np.zeros((1, 3)), np.zeros(1))[0]
    second = look_at(np.array([[20.0, 10.0, -430.0]]), np.zeros((1, 3)), np.ones(1))[0]
    wander = poses_around(views, rng, half_angle_deg=45.0, distance_mm=1.0, aim_mm=0.2)  # of the board in the rig
    wander[:, :3, 3] = rng.uniform(-25, 25, (views, 3))
    upright = np.diag([1.0, -1.0, -1.0, 1.0])
    true = second @ invert(first[None])[0]

    def second_from_first(thickness_mm: float) -> np.ndarray:
        points = known_points(with_thickness(target, thickness_mm))
        poses = []
        for cam_from_rig in (first, second):
            seen = observe(camera, known_points(target), cam_from_rig @ upright @ wander, rng, noise_px=NOISE_PX)
            poses.append(solve(replace(seen, points=points), "opencv").cam_from_target)
        return np.asarray(poses[1] @ invert(poses[0]))

    for thickness_mm, off_mm in ((5.0, 0.0), (5.5, 0.5)):
        error = second_from_first(thickness_mm) @ invert(true[None])
        shift = np.linalg.norm(np.median(error[:, :3, 3], axis=0))
        assert shift == pytest.approx(off_mm, abs=0.15)
        assert np.degrees(np.linalg.norm(log_rotation(error[:, :3, :3]), axis=1)).max() < 0.05
