"""Targets put together from pieces: which sits badly, by how much, and what all have in common."""

from dataclasses import replace
from functools import cache

import numpy as np
import pytest

from calib.measure_target.deviations import Compensation
from calib.measure_target.record import deviations_of, record_of
from calib.measure_target.result import AsBuilt
from calib.measure_target.seats import PARTS, SOURCE_OF, Seats, limits_of, seats_of
from calib.measure_target.solve import measure
from calib.measure_target.unknowns import AsBuiltOptions, TargetUnknowns
from designer.base.arrays import Array
from designer.kinds.cube import CubeSpec
from designer.kinds.layout import lay_out
from designer.target import TargetGeometry
from designer.tolerance.error_file import error_model
from designer.tolerance.made import how_made
from designer.tolerance.model import draw_values
from tests.support.as_built_scenes import photos, printed, random_shape, solid

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
    assert seats.common_height_mm is not None
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
    """Of 4000 assemblies drawn from the way of making 1 % have a piece beyond a limit, each kind of fault its part."""
    for name in ("fdm-tiles", "hand-stickers"):
        model = error_model(name).only(*SOURCE_OF.values())
        limits, rng = limits_of(model, 20), np.random.default_rng(SEED)
        beyond = np.zeros(4000, dtype=bool)
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
