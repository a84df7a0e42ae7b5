"""Error sources: what they do to a target."""

from collections.abc import Callable
from dataclasses import fields, replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.linalg import polar
from scipy.spatial.distance import pdist
from scipy.spatial.transform import Rotation

from designer.base.arrays import Array
from designer.kinds.board import BoardSpec
from designer.kinds.layout import lay_out
from designer.kinds.sizing import size_printing
from designer.make.bed import bed_from_target
from designer.marks.aprilgrid import AprilGrid
from designer.marks.chessboard import Chessboard
from designer.marks.circles import Circles
from designer.spec.options import AskedPrinting
from designer.target import TargetGeometry, target_from_json, target_of_marks, target_to_json
from designer.tolerance.model import displaced, perturb
from designer.tolerance.prior import directions
from designer.tolerance.shape import face_down, face_middle_mm, piece_count, piece_of_ring
from designer.tolerance.sources import SOURCES
from tests.support.perturbed_targets import (
    BENDING,
    FULL,
    MOTIONS,
    TARGETS,
    Values,
    board,
    drawn,
    ico,
    made_by_others,
    one,
)


@pytest.fixture(params=TARGETS)
def target(request: pytest.FixtureRequest) -> TargetGeometry:
    return TARGETS[request.param]()


def numbers_of(target: TargetGeometry) -> dict[str, Array | None]:
    """All fields that are numbers."""
    return {field.name: getattr(target, field.name) for field in fields(target) if field.name not in ("source", "spec")}


def in_target(target: TargetGeometry, in_face_mm: Array) -> Array:
    """Points (F, K, 2) of the faces' planes in the target frame."""
    frame = target.target_from_face
    placed: Array = np.einsum("fij,fkj->fki", frame[:, :3, :2], in_face_mm) + frame[:, None, :3, 3]
    return placed


# --- nothing, and everything ------------------------------------------------------------------------------------------


def test_zero_errors_change_no_number(target: TargetGeometry) -> None:
    """Sources of size zero give the numbers of the nominal target, bit for bit; only its source is another."""
    nothing = displaced(target, {name: 0 * numbers for name, numbers in drawn(target, 1).items()}, model=FULL)
    assert nothing.source == "perturbed"
    assert nothing.spec == target.spec
    expected = numbers_of(target)
    for name, values in numbers_of(nothing).items():
        assert np.array_equal(values, expected[name]) if values is not None else expected[name] is None, name
    assert displaced(target, {}, model=FULL) == nothing == perturb(target, FULL.scaled(0), np.random.default_rng(1))


def test_a_perturbed_target_is_a_target_of_the_same_layout(target: TargetGeometry) -> None:
    """Errors keep the layout's id, so detections fit; the geometry's id changes, and its file reads back."""
    made = perturb(target, FULL, np.random.default_rng(3))
    assert made.layout_id == target.layout_id
    assert made.geometry_id != target.geometry_id
    assert target_from_json(target_to_json(made)) == made


def by_hand(target: TargetGeometry, values: Values, bed: Array) -> Array:
    """Centres ring by ring, from the definitions of the sources that do not bend faces."""
    axis_scale, (xy, xz, yz) = values["axis_scale"][0], values["skew"][0]
    lean = np.array([[1, np.tan(xy), np.tan(xz)], [0, 1, np.tan(yz)], [0, 0, 1]])
    size = (1 + values["scale"][0, 0]) * (1 + 1e-4 * values["thermal"][0, 0])
    affine = bed.T @ (size * lean @ np.diag(1 + axis_scale)) @ bed
    centers = np.empty_like(target.center_mm)
    for row, face in enumerate(target.ring_face):
        frame = target.target_from_face[face]
        point = frame[:3, :3].T @ (target.center_mm[row] - frame[:3, 3])
        middle = np.append(target.outline_mm[face].mean(axis=0), 0)
        (a, b), (x, y, _) = values["face_stretch"][face], point - middle
        point += [a * x + b * y, b * x - a * y, 0]
        point += [*values["ring_jitter"][row], 0]
        spin = Rotation.from_rotvec([0, 0, values["face_rotation"][face, 0]])
        tilt = Rotation.from_rotvec([*values["face_tilt"][face], 0])
        point = tilt.apply(spin.apply(point - middle)) + middle
        point += [*values["face_shift"][face], values["face_offset"][face, 0] + values["wall"][0, 0]]
        centers[row] = affine @ (frame[:3, :3] @ point + frame[:3, 3])
    return centers


def test_sources_compose_as_a_part_is_made(target: TargetGeometry) -> None:
    """Rings move in their face, the face moves as a body, the axes distort all: as by hand, ring by ring."""
    bed = np.eye(4)
    bed[:3, :3] = Rotation.from_rotvec([0.4, 0.1, -1.2]).as_matrix()
    bed[:3, 3] = [100.0, 20.0, 30.0]
    flat = [name for name in SOURCES if name not in (*BENDING, "stair_steps")]
    values = drawn(target, 11, *flat)
    made = displaced(target, values, model=FULL, bed_from_target=bed)
    assert np.allclose(made.center_mm, by_hand(target, values, bed[:3, :3]), rtol=0, atol=1e-9)
    assert np.abs(made.center_mm - target.center_mm).max() > 0.3


# --- the print's axes -------------------------------------------------------------------------------------------------


def test_the_default_bed_is_the_designers() -> None:
    """Without a bed the target lies as `designer.make.bed` lays it, but for turns by 90 degrees around the vertical."""
    for target in (ico(), board()):
        printing = size_printing(AskedPrinting(), target)
        turn = bed_from_target(target, printing)[:3, :3] @ face_down(target).T
        assert np.allclose(turn[2], [0, 0, 1], atol=1e-12)
        assert np.allclose(np.abs(turn).sum(axis=1), 1, atol=1e-12)


@settings(max_examples=10, deadline=None)
@given(seed=st.integers(0, 2**32 - 1), vector=st.tuples(*[st.floats(-3, 3)] * 3))
def test_errors_do_not_depend_on_the_target_frame(seed: int, vector: tuple[float, float, float]) -> None:
    """With target and bed turned alike, the same numbers give the same part, turned."""
    target = made_by_others()
    turn = np.eye(4)
    turn[:3, :3] = Rotation.from_rotvec(vector).as_matrix()
    turned = replace(
        target, center_mm=target.center_mm @ turn[:3, :3].T, target_from_face=turn @ target.target_from_face
    )
    bed = np.eye(4)
    bed[:3, :3] = Rotation.from_rotvec([0.3, 0.8, -0.5]).as_matrix()
    values = drawn(target, seed)
    made = displaced(target, values, model=FULL, bed_from_target=bed)
    other = displaced(turned, values, model=FULL, bed_from_target=bed @ turn.T)
    assert np.allclose(other.center_mm, made.center_mm @ turn[:3, :3].T, atol=1e-9)
    assert np.allclose(other.target_from_face, turn @ made.target_from_face, atol=1e-9)
    for name in ("outline_mm", "window_mm", "lattice_mm", "radius_outer_mm", "radius_inner_mm"):
        assert np.allclose(getattr(other, name), getattr(made, name), atol=1e-9), name


# --- faces ------------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("name", MOTIONS)
def test_faces_move_as_rigid_bodies(name: str, target: TargetGeometry) -> None:
    """A motion of faces keeps all distances within a face, and changes distances between faces."""
    made = displaced(target, drawn(target, 4, name), model=FULL)
    for face in range(target.face_count):
        own = target.ring_face == face
        assert np.allclose(pdist(made.center_mm[own]), pdist(target.center_mm[own]), rtol=0, atol=1e-9)
    assert np.allclose(made.center_in_face_mm, target.center_in_face_mm, rtol=0, atol=1e-9)
    for field in ("radius_outer_mm", "outline_mm", "window_mm", "lattice_mm"):
        assert np.array_equal(getattr(made, field), getattr(target, field)), field
    if target.face_count > 1:
        assert np.abs(pdist(made.center_mm) - pdist(target.center_mm)).max() > 0.01


@pytest.mark.parametrize("name", MOTIONS)
def test_pieces_of_a_board_move_as_rigid_bodies(name: str) -> None:
    """Within a piece all distances stay, bows too; between pieces they do not, to first order as the prior says."""
    target = in_four()
    assert SOURCES[name].instances(target) == 4
    values = drawn(target, 4, name)
    bow = {"face_bow": np.array([[0.5, 0.2, -0.3]])}
    bent, made = (displaced(target, {**bow, **more}, model=FULL) for more in ({}, values))
    for piece in range(4):
        own = target.ring_piece == piece
        assert np.allclose(pdist(made.center_mm[own]), pdist(bent.center_mm[own]), rtol=0, atol=1e-9)
    assert np.abs(pdist(made.center_mm) - pdist(bent.center_mm)).max() > 1e-3
    assert np.array_equal(made.target_from_face, target.target_from_face)
    small = {name: 1e-3 * values[name]}
    step = (displaced(target, small, model=FULL).center_mm - target.center_mm).reshape(-1)
    told = directions(target, FULL, name).reshape(step.size, -1) @ small[name].reshape(-1)
    assert np.allclose(step, told, rtol=0, atol=1e-4 * np.abs(step).max())


def test_a_piece_turns_about_its_middle() -> None:
    """Of the rings on it: those opposite each other go opposite ways, and their mean stays."""
    target = in_four()
    made = displaced(target, one("face_rotation", target, 0.01), model=FULL)
    for piece in range(4):
        own = target.ring_piece == piece
        assert np.allclose((made.center_mm - target.center_mm)[own].mean(axis=0), 0, atol=1e-5)


def in_four() -> TargetGeometry:
    """A square lattice in quarters."""
    whole = lay_out(BoardSpec((100.0, 80.0), 5.0, 8, 6, "square", 7.0, 0.45, 10.0, 1.0, 4.0, dots=False))
    x, y = whole.center_in_face_mm[:, :2].T
    return replace(whole, ring_piece=2 * (y > 0).astype(int) + (x > 0).astype(int))


def test_a_board_of_which_no_pieces_are_told_has_the_usual_ones() -> None:
    """One that fits the usual bed is one piece, which as a whole keeps its shape; a larger one is cut."""
    assert piece_count(board()) == 1
    large = lay_out(BoardSpec((600.0, 400.0), 5.0, 29, 19, "square", 14.0, 0.45, 20.0, 1.0, 4.0, dots=True))
    size = np.array(
        [np.ptp(large.center_mm[piece_of_ring(large) == one, :2], axis=0) for one in range(piece_count(large))]
    )
    assert 4 <= piece_count(large) <= 9
    assert (size < 256).all()
    tilted = displaced(board(), one("face_tilt", board(), 0.1, 0.2), model=FULL)
    assert np.allclose(pdist(tilted.center_mm), pdist(board().center_mm), rtol=0, atol=1e-9)


@settings(max_examples=15, deadline=None)
@given(seed=st.integers(0, 2**32 - 1), size=st.floats(0.1, 10), which=st.sampled_from(sorted(TARGETS)))
def test_frames_stay_rigid_and_lie_in_the_moved_planes(seed: int, size: float, which: str) -> None:
    """Under skew and all else but bending, frames are rigid motions and rings keep to their plane."""
    target = TARGETS[which]()
    flat = [name for name in SOURCES if name not in BENDING]
    values = {name: size * numbers for name, numbers in drawn(target, seed, *flat).items() if name != "ink_bleed"}
    made = displaced(target, values, model=FULL)
    rotation = made.target_from_face[:, :3, :3]
    assert np.abs(rotation.transpose(0, 2, 1) @ rotation - np.eye(3)).max() < 1e-9
    assert np.linalg.det(rotation).min() > 0
    assert (made.target_from_face[:, 3] == [0, 0, 0, 1]).all()
    if which != "others":  # its rings lie above their planes
        assert np.abs(made.center_in_face_mm[:, 2]).max() < 2e-9  # the drawing is rounded to 1e-9 mm


def test_outlines_and_lattices_are_sheared_with_the_print(target: TargetGeometry) -> None:
    """Corners of outline and window go where the print's distortion takes them; so do the lattice's steps."""
    bed = np.eye(4)
    bed[:3, :3] = Rotation.from_rotvec([0.4, 0.1, -1.2]).as_matrix()
    values = {
        "skew": np.array([[0.05, -0.08, 0.1]]), "axis_scale": np.array([[0.1, -0.05, 0.02]]),
        "scale": np.array([[-0.2]]), "thermal": np.array([[300.0]]),
    }  # fmt: skip
    made = displaced(target, values, model=FULL, bed_from_target=bed)
    lean = np.array([[1, np.tan(0.05), np.tan(-0.08)], [0, 1, np.tan(0.1)], [0, 0, 1]]) @ np.diag([1.1, 0.95, 1.02])
    affine = 0.8 * (1 + 300 * FULL.expansion_per_kelvin) * bed[:3, :3].T @ lean @ bed[:3, :3]
    for name in ("outline_mm", "window_mm"):
        expected = in_target(target, getattr(target, name)) @ affine.T
        assert np.allclose(in_target(made, getattr(made, name)), expected, atol=1e-9), name
    steps = np.einsum("fij,fkj->fki", target.target_from_face[:, :3, :2], target.lattice_mm) @ affine.T
    assert np.allclose(np.einsum("fij,fkj->fki", made.target_from_face[:, :3, :2], made.lattice_mm), steps, atol=1e-9)
    for face in range(target.face_count):
        nearest, _ = polar(affine @ target.target_from_face[face, :3, :2])
        assert np.allclose(made.target_from_face[face, :3, :2], nearest, atol=1e-9)
        widened = abs(np.linalg.det(made.lattice_mm[face]) / np.linalg.det(target.lattice_mm[face]))
        own = target.ring_face == face
        assert np.allclose(made.radius_outer_mm[own] ** 2, widened * target.radius_outer_mm[own] ** 2)
        assert np.allclose(made.radius_inner_mm[own] ** 2, widened * target.radius_inner_mm[own] ** 2)


# --- bending, ink, layers ---------------------------------------------------------------------------------------------


def surface(target: TargetGeometry, face: int, height: Array) -> Callable[[Array], float]:
    """The quadratic through the heights of a face's rings, which must lie on one."""
    own = target.ring_face == face

    def terms(xy: Array) -> Array:
        x, y = np.atleast_2d(xy).T
        return np.stack([np.ones_like(x), x, y, x * x, x * y, y * y], axis=1)

    design = terms(target.center_in_face_mm[own, :2])
    solution, *_ = np.linalg.lstsq(design, height[own], rcond=None)
    assert np.allclose(design @ solution, height[own], atol=1e-7)
    return lambda xy: float((terms(xy) @ solution)[0])


@settings(max_examples=15, deadline=None)
@given(bow=st.tuples(*[st.floats(-1, 1)] * 3), which=st.sampled_from(["ico", "board"]))
def test_bow_has_no_mean_and_the_stated_sagitta(bow: tuple[float, float, float], which: str) -> None:
    """Rings leave their plane by a quadratic without a mean; from middle to rim, dome, saddle and twist add up."""
    target = TARGETS[which]()
    made = displaced(target, one("face_bow", target, *bow), model=FULL)
    frame = target.target_from_face[target.ring_face]
    step = np.einsum("rji,rj->ri", frame[:, :3, :3], made.center_mm - target.center_mm)
    assert np.abs(step[:, :2]).max() < 1e-9
    assert np.array_equal(made.target_from_face, target.target_from_face)
    middle = face_middle_mm(target)
    for face in range(target.face_count):
        assert abs(step[target.ring_face == face, 2].mean()) < 1e-9
        height = surface(target, face, step[:, 2])
        rim = np.linalg.norm(target.outline_mm[face] - middle[face], axis=1).max()
        for angle in (0.0, 0.5, 2.0):
            place = middle[face] + rim * np.array([np.cos(angle), np.sin(angle)])
            expected = bow[0] + bow[1] * np.cos(2 * angle) + bow[2] * np.sin(2 * angle)
            assert height(place) - height(middle[face]) == pytest.approx(expected, abs=1e-6)


def test_warp_bends_boards_only() -> None:
    """A board warps as a face bows; a body of faces stays as it is."""
    bow = np.array([[0.3, 0.1, -0.2]])
    assert np.array_equal(
        displaced(board(), {"warp": bow}, model=FULL).center_mm,
        displaced(board(), {"face_bow": bow}, model=FULL).center_mm,
    )
    assert np.array_equal(displaced(ico(), {"warp": bow}, model=FULL).center_mm, ico().center_mm)


def test_a_board_bows_by_its_diagonal() -> None:
    """A share of the diagonal is the sagitta from the middle to the corner that a warp gives in millimetres."""
    diagonal = float(np.linalg.norm(np.ptp(board().outline_mm[0], axis=0)))
    bow = np.array([[0.002, -0.001, 0.003]])
    assert np.array_equal(
        displaced(board(), {"bow_twist": bow}, model=FULL).center_mm,
        displaced(board(), {"warp": bow * diagonal}, model=FULL).center_mm,
    )
    assert np.array_equal(displaced(ico(), {"bow_twist": bow}, model=FULL).center_mm, ico().center_mm)


def test_ink_bleeds_without_moving_centres(target: TargetGeometry) -> None:
    """Ink grows at each edge: rings outward and inward, dots outward; no centre, frame or outline moves."""
    made = displaced(target, {"ink_bleed": np.array([[0.13]])}, model=FULL)
    assert np.allclose(made.radius_outer_mm, target.radius_outer_mm + 0.13)
    assert np.allclose(made.radius_inner_mm, np.where(target.is_dot, 0, target.radius_inner_mm - 0.13))
    for name in ("center_mm", "target_from_face", "outline_mm", "window_mm", "lattice_mm"):
        assert np.array_equal(getattr(made, name), getattr(target, name)), name


def test_ink_moves_corners_that_stand_alone() -> None:
    """Corners between squares stay where ink bleeds; those of a tag alone move out of it, and light circles shrink."""
    grid = AprilGrid((2, 2), 30.0, corner_squares=False)
    for marks, out in ((grid, 0.13), (replace(grid, corner_squares=True), 0.0), (Chessboard((5, 4), 20.0), 0.0)):
        target = target_of_marks([marks], np.eye(4)[None])
        made = displaced(target, {"ink_bleed": np.array([[0.13]])}, model=FULL)
        side = 2 * (target.ring_index % 2) - 1
        assert np.allclose((made.center_mm - target.center_mm)[:, :2], out * side)
        assert not made.radius_outer_mm.any()
    circles = target_of_marks([Circles((3, 3), 30.0, 10.0, light=True)], np.eye(4)[None])
    made = displaced(circles, {"ink_bleed": np.array([[0.13]])}, model=FULL)
    assert np.allclose(made.radius_outer_mm, 4.87)


def test_layers_lift_inclined_faces_along_themselves() -> None:
    """Each inclined face's rings rise on the bed by the share of a layer, and stay in their plane; level faces stay."""
    target = ico()
    rising = face_down(target)[2]  # of the bed, in the target
    made = displaced(target, one("stair_steps", target, 0.5), model=FULL)
    step = made.center_mm - target.center_mm
    steepness = np.abs(target.target_from_face[target.ring_face, :3, 2] @ rising)
    is_level = steepness > 1 - 1e-9
    assert is_level.sum() == 2 * 15
    assert np.array_equal(step[is_level], np.zeros((30, 3)))
    assert np.allclose(step[~is_level] @ rising, 0.5 * 0.2, atol=1e-12)
    assert np.abs(made.center_in_face_mm[:, 2]).max() < 2e-9
    flat = displaced(board(), one("stair_steps", board(), 0.5), model=FULL)
    assert np.array_equal(flat.center_mm, board().center_mm)


@pytest.mark.parametrize("name", SOURCES)
def test_small_errors_add_up(name: str, target: TargetGeometry) -> None:
    """To first order centres are linear in a source's numbers: what is left falls with the square of the size."""
    first, second = drawn(target, 8, name)[name], drawn(target, 9, name)[name]

    def step(numbers: Array) -> Array:
        return displaced(target, {name: numbers}, model=FULL).center_mm - target.center_mm

    def left_over(size: float) -> float:
        both = step(size * (first - 2 * second))
        return float(np.abs(both - step(size * first) + 2 * step(size * second)).max())

    assert left_over(0.1) <= left_over(1.0) / 50 + 1e-10
    moves = name != "ink_bleed" and not (name in ("warp", "bow_twist") and not target.is_plate)
    is_level = name == "stair_steps" and target.face_count == 1
    assert (np.abs(step(first)).max() > 1e-4) == (moves and not is_level)
