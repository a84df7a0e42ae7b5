"""Where the features lie: faces, lattices, margins and frames."""

import math
from itertools import product

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from designer.kinds.board import BoardSpec
from designer.kinds.ico import IcoSpec
from designer.kinds.layout import lay_out
from designer.spec.spec import Lattice, Spec
from designer.target import TargetGeometry

PAPER_ICO = IcoSpec(100.0, 8, 7.0, 0.45, 10.0, 2.0, 3.0)


@st.composite
def ico_specs(draw: st.DrawFn) -> IcoSpec:
    """Icosahedra whose rings just keep their margin."""
    rings = draw(st.integers(5, 12))
    pitch = draw(st.floats(1, 20))
    diameter = pitch * draw(st.floats(0.3, 0.95))
    border, margin = pitch * draw(st.floats(0.05, 1)), pitch * draw(st.floats(0.05, 1))
    window_inradius = (rings - 1) * pitch / (2 * math.sqrt(3)) + diameter / 2 + margin
    edge = (window_inradius + border) * 2 * math.sqrt(3)
    return IcoSpec(edge, rings, diameter, draw(st.floats(0.2, 0.8)), pitch, border, margin)


@st.composite
def board_specs(draw: st.DrawFn) -> BoardSpec:
    """Boards whose rings just keep their margin."""
    columns, rows = draw(st.integers(3, 9)), draw(st.integers(3, 9))
    lattice: Lattice = draw(st.sampled_from(["square", "triangular"]))
    pitch = draw(st.floats(1, 20))
    diameter = pitch * draw(st.floats(0.3, 0.95))
    border, margin = draw(st.sampled_from([0.0, 0.5 * pitch])), pitch * draw(st.floats(0.05, 1))
    row_step = pitch * (1 if lattice == "square" else math.sqrt(3) / 2)
    around = diameter + 2 * (border + margin)
    size = ((columns - 1) * pitch + around, (rows - 1) * row_step + around)
    return BoardSpec(size, 5.0, columns, rows, lattice, diameter, 0.45, pitch, border, margin, draw(st.booleans()))


specs = st.one_of(ico_specs(), board_specs())


def least_clearance_mm(target: TargetGeometry) -> float:
    """Least distance of a feature's rim to the sides of its face's window, by the sides' equations."""
    least = math.inf
    for face in range(target.face_count):
        mine = target.ring_face == face
        corners = target.window_mm[face]
        for start, end in zip(corners, np.roll(corners, -1, axis=0), strict=True):
            inward = np.array([start[1] - end[1], end[0] - start[0]]) / math.dist(start, end)
            inside = (target.center_in_face_mm[mine, :2] - start) @ inward - target.radius_outer_mm[mine]
            least = min(least, inside.min())
    return least


@given(specs)
@settings(max_examples=40, deadline=None)
def test_rings_lie_on_a_lattice_in_their_faces_and_keep_their_margin(spec: Spec) -> None:
    """Each in its face's plane, at its index times the lattice's steps, a pitch from its nearest neighbour.

    Between every ring and the border (or the board's edge) there is the spec's margin, and each side of the window is
    parallel to its side of the outline, the border's width inside it.
    """
    target = lay_out(spec)
    assert np.abs(target.center_in_face_mm[:, 2]).max() < 1e-6
    for face in range(target.face_count):
        mine = target.ring_face == face
        along = target.ring_index[mine] @ target.lattice_mm[face]
        assert np.ptp(target.center_in_face_mm[mine, :2] - along, axis=0).max() < 1e-6
    distance = np.linalg.norm(target.center_mm[mine, None] - target.center_mm[mine], axis=2)
    distance += np.where(np.eye(len(distance)), np.inf, 0)
    assert distance.min(axis=1) == pytest.approx(np.full(len(distance), spec.pitch_mm), abs=1e-6)
    assert least_clearance_mm(target) == pytest.approx(spec.margin_mm, abs=1e-6)
    for outline, window in zip(target.outline_mm, target.window_mm, strict=True):
        for k in range(len(outline)):
            start, end = outline[k], outline[(k + 1) % len(outline)]
            inward = np.array([start[1] - end[1], end[0] - start[0]]) / math.dist(start, end)
            ends = window[[k, (k + 1) % len(outline)]]
            assert (ends - start) @ inward == pytest.approx(np.full(2, spec.border_mm), abs=1e-6)


def test_sizes_of_rings_and_dots() -> None:
    """Rings have the spec's diameter and ratio; dots have the rings' outer diameter and no hole."""
    target = lay_out(PAPER_ICO)
    assert (target.radius_outer_mm == 3.5).all()
    assert target.radius_inner_mm[~target.is_dot] == pytest.approx(3.5 * 0.45)
    assert (target.radius_inner_mm[target.is_dot] == 0).all()


@given(ico_specs())
@settings(max_examples=20, deadline=None)
def test_face_lattice_has_the_triangles_symmetry(spec: IcoSpec) -> None:
    """A third turn about a face's centre maps the features' places and both outlines onto themselves."""
    target = lay_out(spec)
    turn = np.array([[-0.5, -math.sqrt(3) / 2], [math.sqrt(3) / 2, -0.5]])
    places = (target.center_in_face_mm[target.ring_face == 7, :2], target.outline_mm[7], target.window_mm[7])
    for points in places:
        distance = np.linalg.norm((points @ turn.T)[:, None] - points, axis=2)
        assert distance.min(axis=1).max() < 1e-6


def test_code_block_stands_at_the_corner_on_y() -> None:
    """Index (0, 0) lies on the face frame's y axis, nearest to the first corner; i runs down left, j down right."""
    target = lay_out(PAPER_ICO)
    first = target.center_in_face_mm[(target.ring_index == 0).all(axis=1)]
    assert len(first) == 20
    assert first[:, 0] == pytest.approx(np.zeros(20), abs=1e-6)
    assert (first[:, 1] > 0.9 * target.center_in_face_mm[:, 1].max()).all()
    assert target.lattice_mm[0, 0] == pytest.approx(
        10 * np.array([math.cos(4 * math.pi / 3), math.sin(4 * math.pi / 3)])
    )
    assert target.lattice_mm[0, 1] == pytest.approx(
        10 * np.array([math.cos(5 * math.pi / 3), math.sin(5 * math.pi / 3)])
    )


@given(board_specs())
@settings(max_examples=40, deadline=None)
def test_board_is_centred_and_looks_up(spec: BoardSpec) -> None:
    """The board's frame is the target's; outline and features are centred on it, the outline counter-clockwise."""
    target = lay_out(spec)
    assert (target.target_from_face == np.eye(4)).all()
    assert (target.center_mm[:, 2] == 0).all()
    assert target.center_mm.min(axis=0) == pytest.approx(-target.center_mm.max(axis=0), abs=1e-6)
    x, y = target.outline_mm[0].T
    assert 0.5 * (x * np.roll(y, -1) - y * np.roll(x, -1)).sum() == pytest.approx(spec.size_mm[0] * spec.size_mm[1])


@given(board_specs())
@settings(max_examples=40, deadline=None)
def test_origin_mark_lies_near_the_middle(spec: BoardSpec) -> None:
    """Dots sit at indices (0, 0), (1, 0), (0, 2), all on the board, and no shift brings them nearer to the middle."""
    target = lay_out(spec)
    index = [tuple(pair) for pair in target.ring_index.tolist()]
    assert {index[row] for row in np.flatnonzero(target.is_dot)} == ({(0, 0), (1, 0), (0, 2)} if spec.dots else set())
    place = dict(zip(index, target.center_mm, strict=True))

    def distance(i: int, j: int) -> float:
        marks = [place.get((i + di, j + dj)) for di, dj in ((0, 0), (1, 0), (0, 2))]
        return math.inf if any(mark is None for mark in marks) else float(np.linalg.norm(np.mean(marks, axis=0)))

    assert distance(0, 0) <= min(distance(i, j) for i, j in product(range(-9, 10), repeat=2)) + 1e-6
    assert distance(0, 0) < 1.5 * spec.pitch_mm


@pytest.mark.parametrize("lattice", ["square", "triangular"])
def test_dots_do_not_move_the_indices(lattice: Lattice) -> None:
    """A board without dots has the same features under the same indices."""
    with_dots, without = (
        lay_out(BoardSpec((90.0, 80.0), 5.0, 8, 7, lattice, 7.0, 0.45, 10.0, 0.0, 5.0, dots)) for dots in (True, False)
    )
    assert (with_dots.ring_index == without.ring_index).all()
    assert (with_dots.center_mm == without.center_mm).all()
    assert not without.is_dot.any()


def test_triangular_board_alternates_rows() -> None:
    """Rows of n and n - 1 rings, shifted by half a pitch, a row every pitch sqrt(3) / 2."""
    target = lay_out(BoardSpec((90.0, 80.0), 5.0, 8, 7, "triangular", 7.0, 0.45, 10.0, 0.0, 5.0, dots=False))
    heights = np.unique(target.center_mm[:, 1])
    assert np.diff(heights) == pytest.approx(np.full(6, 5 * math.sqrt(3)), abs=1e-6)
    counts = [(target.center_mm[:, 1] == height).sum() for height in heights]
    assert counts == [8, 7, 8, 7, 8, 7, 8]
    left = [target.center_mm[target.center_mm[:, 1] == height, 0].min() for height in heights]
    assert left == pytest.approx([-35, -30] * 3 + [-35], abs=1e-6)
