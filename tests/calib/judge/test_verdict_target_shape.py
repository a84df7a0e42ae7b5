"""Whether a target that is not as its file says shows in the photos."""

from dataclasses import replace

import numpy as np
import pytest

from calib.cameras.camera import LearnedMap
from calib.core.se3 import exp_rotation
from calib.core.types import Observations
from calib.judge.apart import Known, apart
from calib.judge.coverage import coverage_of
from calib.judge.target_shape import AMPLITUDE, ShapeEffect, deformation_of, shape_effect
from tests.support.solver_scenes import moved_points
from tests.support.verdict_cases import BOARD, ICOSAHEDRON, TRUE, believed, bent, sightings, solved


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
    assert true is not None
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
