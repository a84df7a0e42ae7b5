"""What is named as a cause: a target of another shape, what is alike in all photos, another reading of a table.

Each with its size and its remedy, and none that explains too little.
"""

from dataclasses import replace

import numpy as np
import pytest

from calib.cameras.camera import Camera, LearnedMap
from calib.core.se3 import exp_rotation
from calib.core.types import Observations
from calib.judge.checks import read_criteria
from calib.judge.coverage import coverage_of
from calib.judge.difference import Known, apart
from calib.judge.evidence import LensEvidence, lens_evidence
from calib.judge.halves import NoHalves
from calib.judge.judge import Judged
from calib.judge.reading import reading_of, turned, unit_doubt
from calib.judge.target_shape import AMPLITUDE, ShapeEffect, deformation_of, shape_effect
from calib.solver.calibration import Calibration
from calib.solver.capture_error import with_capture_error
from calib.solver.problem import SolveOptions
from calib.solver.solve import solve
from tests.support.solver_scenes import board, moved_points, observe, poses_around
from tests.support.verdict_cases import (
    BOARD,
    ICOSAHEDRON,
    OPTIONS,
    TRUE,
    believed,
    bent,
    check,
    judge_run,
    sightings,
    solved,
    verdict_on,
)


def _effect(seen: Observations) -> ShapeEffect:
    one = solved(seen)[0]
    found = shape_effect(one, coverage_of(one))
    assert found is not None
    return found


@pytest.mark.parametrize("bow_mm", [0.1, -0.5])
def test_a_bent_board_is_found_with_what_it_does(bow_mm: float) -> None:
    """The change of the camera that is foretold is the error that the bend has made, and the bow is measured."""
    seen = believed(sightings(bent(BOARD, bow_mm), views=20), BOARD)
    one = solved(seen)[0]
    found, nothing = _effect(seen), np.zeros((9, 9))
    true = apart(Known(TRUE, nothing), Known(one.camera, nothing), coverage_of(one))
    assert found.percentile_95_px == pytest.approx(true.percentile_95_px, rel=0.1)
    assert found.ratio > 20
    extent = np.linalg.norm(BOARD.position_mm - BOARD.position_mm.mean(axis=0), axis=1).max()
    assert found.bow_mm == pytest.approx(abs(bow_mm) * (extent / 110) ** 2, rel=0.1)


def test_the_effect_is_chance_for_a_true_target() -> None:
    """With honest noise the ratio has a root mean square of 1, for boards and icosahedra."""
    ratios = [_effect(sightings(seed=seed, views=8)).ratio for seed in range(10)]
    ratios += [_effect(sightings(ICOSAHEDRON, seed=seed, views=8, distance_mm=400)).ratio for seed in range(4)]
    assert 0.6 < np.sqrt(np.mean(np.square(ratios))) < 1.4
    assert max(ratios) < 2.5


def test_rings_too_wide_apart_on_an_icosahedron_are_found() -> None:
    """Faces in their places with rings 0.5 % too far apart spoil the camera by pixels, and it shows."""
    middle = np.stack([ICOSAHEDRON.position_mm[ICOSAHEDRON.face == face].mean(axis=0) for face in range(20)])
    off = ICOSAHEDRON.position_mm - middle[ICOSAHEDRON.face]
    wide = replace(ICOSAHEDRON, position_mm=ICOSAHEDRON.position_mm + 0.005 * off)
    found = _effect(believed(sightings(wide, views=12, distance_mm=400), ICOSAHEDRON))
    assert found.ratio > 5
    assert found.percentile_95_px > 0.5


def test_size_and_frame_of_the_target_do_not_matter() -> None:
    """A target of twice the size, in another frame, has the same effect: only its shape counts."""
    seen = believed(sightings(bent(BOARD, 0.2)), BOARD)
    turn = np.eye(4)
    turn[:3, :3], turn[:3, 3] = exp_rotation(np.array([0.3, -0.2, 1.0])), [10, 20, 30]
    points = moved_points(BOARD, turn, 2.0)
    plane = np.array([[*turn[:3, 2], 2.0 * float(turn[:3, 2] @ turn[:3, 3])]])
    one, other = _effect(seen), _effect(replace(seen, points=replace(points, plane=plane)))
    assert other.percentile_95_px == pytest.approx(one.percentile_95_px, rel=0.02)
    assert other.bow_mm == pytest.approx(2 * one.bow_mm, rel=0.02)


def test_nothing_is_said_of_what_is_not_known() -> None:
    """A learned map takes up a bend, and points on no face have no shape: no effect is told."""
    one = solved(sightings())[0]
    covered = coverage_of(one)
    points = replace(BOARD, face=np.full(len(BOARD.face), -1))
    assert shape_effect(replace(one, observations=replace(one.observations, points=points)), covered) is None
    learned = LearnedMap(np.zeros((1, 2)), np.zeros((1, 2)), np.ones(1), np.eye(3), 100.0, 1.0)
    assert shape_effect(replace(one, camera=replace(one.camera, learned=learned)), covered) is None
    assert shape_effect(replace(one, param_covariance=np.zeros((9, 9))), covered) is None


def test_deformations_move_rings_as_they_are_called() -> None:
    """Bows lift rings by the square of their distance; a stretch keeps the plane; faces do not move each other."""
    used = np.arange(len(BOARD.face))
    found = deformation_of(BOARD, used)
    off = BOARD.position_mm - BOARD.position_mm.mean(axis=0)
    extent = np.linalg.norm(off, axis=1).max()
    assert found.extent_mm == pytest.approx([extent])
    lift = found.shift_mm[:, :3] @ BOARD.plane[0, :3]
    assert lift[:, 0] + lift[:, 2] == pytest.approx(AMPLITUDE * (off**2).sum(axis=1) / extent)
    assert np.abs(found.shift_mm[:, 3:] @ BOARD.plane[0, :3]).max() < 1e-12
    many = deformation_of(ICOSAHEDRON, np.arange(len(ICOSAHEDRON.face)))
    assert many.count == 20 * many.per_face
    assert [len(np.unique(many.first[ICOSAHEDRON.face == face])) for face in range(20)] == [1] * 20


def _judged(seen: Observations) -> tuple[Judged, Calibration]:
    one = with_capture_error(solve(seen, "opencv", OPTIONS))
    return judge_run([one], 0, NoHalves("not solved"), read_criteria()), one


def _moving(amount_px: float) -> Observations:
    """A target that moves across while the rows are read; in photos of many distances, so that no lens does it."""
    seen = sightings(views=16)
    late = seen.center_px[:, 1:] / TRUE.image_size[1] - 0.5
    return replace(seen, center_px=seen.center_px + amount_px * late * [1.0, 0.0])


def test_motion_is_named_with_its_effect_and_what_to_do() -> None:
    """The check says what moved and by how much; the camera is worse for it, and the advice says to let it rest."""
    run, one = _judged(_moving(0.8))
    found = check(run, "capture")
    assert found.grade != "good"
    assert found.sentence.startswith("the photos show a target that moves along the camera's x")
    assert "let target and camera rest" in " ".join(run.verdict.advice)
    off = one.camera.params - TRUE.params
    assert abs(off[1]) < 4 * np.sqrt(one.stated_covariance[1, 1])


def test_at_rest_it_says_what_was_assumed() -> None:
    """A good camera stays good, and is told what nobody could see."""
    run, one = _judged(sightings(views=16))
    plain = judge_run([replace(one, capture_error=None)], 0, NoHalves("not solved"), read_criteria())
    found = check(run, "capture")
    assert found.grade == "good"
    assert "assumed; --capture tells otherwise" in found.sentence
    stated, by_noise = check(run, "uncertainty"), check(plain, "uncertainty")
    assert stated.grade == by_noise.grade
    assert (by_noise.value or 0.0) <= (stated.value or 0.0) < 1.3 * (by_noise.value or 0.0)


def test_what_does_not_explain_what_is_left_over_is_no_cause() -> None:
    """Beside a field fixed in the image, a fault only looks like one, and nothing is advised against it."""
    seen = _moving(0.8)
    apart = (seen.center_px - np.array(TRUE.image_size) * [0.6, 0.45]) / (0.1 * TRUE.image_size[0])
    bump = 0.3 * np.exp(-0.5 * (apart**2).sum(axis=1))[:, None] * [1.0, 0.5]
    run, _ = _judged(replace(seen, center_px=seen.center_px + bump))
    assert check(run, "capture").sentence.startswith("something looks like")
    assert "let target and camera rest" not in " ".join(run.verdict.advice)


def test_what_the_targets_points_have_in_common_is_no_motion() -> None:
    """Where most residuals are the same of each point in all photos, what looks like motion is not named."""
    lens = lens_evidence([_judged(_moving(0.8))[1]], 0, NoHalves("not solved"))
    assert isinstance(lens, LensEvidence)
    named, hedged = verdict_on(lens), verdict_on(replace(lens, target_px=lens.rms_px))
    for verdict, is_named in ((named, True), (hedged, False)):
        said = next(one for one in verdict.checks if one.name == "capture").sentence
        assert said.startswith("the photos show" if is_named else "something looks like")


def test_a_parameter_that_is_held_may_be_the_cause_as_well() -> None:
    """One focal length for both axes of a camera with two scales the rows as a target that moves does."""
    one = with_capture_error(solve(sightings(views=16), "opencv", SolveOptions(shared=(("fx_px", "fy_px"),))))
    run = judge_run([one], 0, NoHalves("not solved"), read_criteria())
    assert check(run, "capture").sentence.startswith("something looks like")
    assert "fixed or shared" in check(run, "capture").sentence


LENS = np.array([0.0, 0, 0, 0, -0.15, 0.05, 4e-4, -3e-4, 0.0])
NOISE_PX, PHOTOS = 0.05, 10


def _seen(
    size: tuple[int, int] = (1280, 1024), off_px: tuple[float, float] = (13.0, -13.0), seed: int = 0
) -> Observations:
    """Photos of a board by a camera whose principal point lies so far off the image's middle."""
    width, height = size
    params = LENS + np.array([1310.0, 1312, (width - 1) / 2 + off_px[0], (height - 1) / 2 + off_px[1], 0, 0, 0, 0, 0])
    rng = np.random.default_rng(seed)
    poses = poses_around(PHOTOS, rng, distance_mm=300.0, half_angle_deg=45)
    return observe(Camera("opencv", params, size), board(9, 7), poses, rng, noise_px=NOISE_PX)


def _read(seen: Observations) -> str:
    return reading_of(solve(seen, "opencv"))


@pytest.mark.parametrize(
    ("size", "off_px"), [((1280, 1024), (13.0, -13.0)), ((900, 900), (4.0, 9.0)), ((1280, 1024), (140.0, -60.0))]
)
def test_a_table_that_is_as_it_says_has_no_other_reading(size: tuple[int, int], off_px: tuple[float, float]) -> None:
    """Neither a principal point off the middle nor one in it makes a reading."""
    assert _read(_seen(size, off_px)) == ""


@pytest.mark.parametrize("count", [1, 3, 5])
def test_photos_upside_down_are_named(count: int) -> None:
    """All that were turned, and no other; of as many as were not, either half is meant."""
    seen = _seen()
    is_turned = np.isin(np.arange(PHOTOS), np.random.default_rng(count).permutation(PHOTOS)[:count])
    said = _read(turned(seen, 2 * is_turned))
    named = np.array([name in said for name in seen.view_names])
    assert "upside down" in said
    assert (named == is_turned).all() or (count == PHOTOS / 2 and (named == ~is_turned).all())


@pytest.mark.parametrize("turns", [(0, 0, 0, 0, 0, 0, 0, 1, 1, 1), (0, 3, 0, 0, 3, 0, 0, 0, 0, 0)])
def test_square_photos_on_their_side_are_named(turns: tuple[int, ...]) -> None:
    """All that were turned by a quarter, with how they are turned back, and no other; of no square image one is."""
    seen = _seen((1024, 1024), (14.0, -11.0))
    back = -np.array(turns) % 4
    said = _read(turned(seen, np.array(turns)))
    assert "on their side" in said
    named = np.array([name in said for name in seen.view_names])
    assert (named == (back > 0)).all()
    assert f"(by {90 * back.max()} deg clockwise)" in said


def test_photos_that_do_not_fit_either_way_are_not_called_turned() -> None:
    """Half of the photos with another focus leave as much over, and turning does not mend it."""
    seen = _seen()
    middle = np.array([640.0, 512])
    zoomed = np.where((seen.view % 2 == 0)[:, None], middle + 1.01 * (seen.center_px - middle) + 15.0, seen.center_px)
    assert "turned" not in _read(replace(seen, center_px=zoomed))


@pytest.mark.parametrize("size", [(1280, 1024), (1600, 1200), (1920, 1080)])
def test_exchanged_columns_are_named(size: tuple[int, int]) -> None:
    """By the principal point, where the points fit the image laid on its side; else the table is refused anyway."""
    width, height = size
    on_side = _seen((height, width), (9.0, -14.0))
    seen = replace(on_side, image_size=size)
    assert "u and v look exchanged" in _read(seen)


@pytest.mark.parametrize(("times", "unit"), [(1e-3, "metres"), (1 / 25.4, "inches"), (1e3, "micrometres"), (1.0, "")])
def test_lengths_in_another_unit_are_asked_about(times: float, unit: str) -> None:
    """By distance and size; a usual target is not."""
    seen = _seen()
    points = replace(seen.points, position_mm=times * seen.points.position_mm, plane=seen.points.plane)
    doubt = unit_doubt(solve(replace(seen, points=points), "opencv"))
    assert unit in doubt if unit else doubt == ""
