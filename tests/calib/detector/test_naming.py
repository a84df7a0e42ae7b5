"""Names of faces and boards: right, or none."""

from dataclasses import replace

import cv2
import numpy as np
import pytest
from numpy.typing import NDArray

from calib.detector.alignment import Alignment, agreement, alignments, largest_overlap
from calib.detector.grid import Grid, lattice_of
from calib.detector.pipeline import detect
from calib.detector.plan import plan_for
from calib.detector.ring_marks import DOT, RING, UNREADABLE
from calib.renderer import RenderOptions, View, render_view
from designer.base.arrays import Rows
from designer.kinds.board import BoardSpec
from designer.kinds.layout import lay_out
from designer.spec.spec import Lattice
from designer.target import TargetGeometry
from tests.benchmarks.synthetic import look_at, readable_faces
from tests.support.perturbed_targets import with_piece
from tests.support.ring_views import CAMERA, USUAL, board, ico, misplaced, view_of

Image = NDArray[np.uint8]

DIRTY = RenderOptions(
    blur_px=1.0,
    contrast_to_noise=25,
    light_gradient=0.4,
    vignetting=0.3,
    shading=0.4,
    glare=0.5,
    clutter=40,
    occlusion=0.2,
)


def grey(view: View) -> Image:
    """The view's pixels, to be painted over."""
    return np.array(view.image, dtype=np.uint8)


def painted(image: Image, view: View, rows: Rows, radii: float, level: int) -> Image:
    """Discs of a level over features, in minor radii."""
    out = image.copy()
    for row in rows:
        middle = (round(16 * float(view.center_px[row, 0])), round(16 * float(view.center_px[row, 1])))
        cv2.circle(out, middle, int(16 * radii * view.minor_radius_px[row]), level, -1, cv2.LINE_AA, 4)
    return out


def test_the_largest_overlap_is_that_of_all_shifts_tried() -> None:
    """Counted shift by shift and turn by turn, no grid falls on more features of a face, and none on fewer."""
    plan, rng = plan_for(ico()), np.random.default_rng(0)
    turns = lattice_of(ico()).turns
    on_face = {(int(i), int(j)) for i, j in np.argwhere(plan.row_table[0] >= 0)}
    for side in (2, 5, 9):
        index = np.argwhere(rng.random((side, side)) < 0.6)
        most = max(
            sum((int(i) + di, int(j) + dj) in on_face for i, j in index @ turn.T)
            for turn in turns for di in range(-20, 31) for dj in range(-20, 31)
        )  # fmt: skip
        assert largest_overlap(plan, index, turns) == most


@pytest.mark.parametrize("seed", range(5))
def test_faces_of_a_solid_get_their_names_among_strangers(seed: int) -> None:
    """From any side nothing bears a wrong name, clutter, glare and covers or not."""
    view = view_of(ico(), seed, options=DIRTY)
    found = detect(view.image, ico(), name="view")
    assert (misplaced(found, view) < 2).all()
    assert len(found.ring)


@pytest.mark.parametrize("lattice", ["square", "triangular"])
@pytest.mark.parametrize("seed", range(2))
def test_boards_get_their_names_among_strangers(lattice: str, seed: int) -> None:
    """A board with its dots in view is named rightly, clutter and glare or not."""
    target = board("square" if lattice == "square" else "triangular")
    view = view_of(target, seed, distance_mm=330, options=DIRTY)
    found = detect(view.image, target, name="view")
    assert (misplaced(found, view) < 2).all()
    if readable_faces(view, target):
        assert len(found.ring) > 0.8 * view.clean.sum()


@pytest.mark.parametrize("seed", range(3))
def test_misread_code_is_corrected_or_dropped(seed: int) -> None:
    """Dots that a white spot makes rings of, or rings that are filled: no feature is misnamed for it."""
    rng = np.random.default_rng(seed)
    view = view_of(ico(), seed)
    target = ico()
    seen = np.flatnonzero(view.clean & (view.incidence_rad < 1.0))
    dots = rng.permutation(seen[target.is_dot[seen]])[:3]
    rings = rng.permutation(seen[~target.is_dot[seen] & (target.ring_index[seen].sum(axis=1) <= 2)])[:3]
    image = painted(painted(grey(view), view, dots, 0.45, 200), view, rings, 0.6, 26)
    found = detect(image, target, name="view")
    assert (misplaced(found, view) < 2).all()
    # What is not what the target says is left out, and the others see the faces through.
    assert not np.isin(found.ring, dots).any()
    assert len(found.ring) > 0.8 * seen.size


def test_all_codes_covered_leave_no_names() -> None:
    """Without any code there is no way to tell the faces apart: nothing, and a reason."""
    view = view_of(ico(), 3)
    corner = np.flatnonzero(view.visible & (ico().ring_index.sum(axis=1) <= 2))
    found = detect(painted(grey(view), view, corner, 1.25, 200), ico(), name="view")
    assert len(found.ring) == 0
    assert found.remarks


@pytest.mark.parametrize("seed", range(2))
def test_mirrored_solid_is_refused(seed: int) -> None:
    """Flipped left to right or upside down, a solid of which two faces show is refused as mirrored."""
    view = view_of(ico(), seed)
    assert readable_faces(view, ico()) >= 2
    for flipped in (np.fliplr(view.image), np.flipud(view.image)):
        found = detect(np.ascontiguousarray(flipped), ico(), name="view")
        assert len(found.ring) == 0
        assert any("mirror" in remark for remark in found.remarks)
    turned = detect(np.ascontiguousarray(np.rot90(view.image)), ico(), name="view")
    assert len(turned.ring) > 50


@pytest.mark.parametrize("target", [board(), board("triangular")], ids=["square", "triangular"])
def test_mirrored_board_is_refused(target: TargetGeometry) -> None:
    """The origin mark tells a flipped board."""
    view = view_of(target, 0)
    assert readable_faces(view, target)
    found = detect(np.ascontiguousarray(np.fliplr(view.image)), target, name="view")
    assert len(found.ring) == 0
    assert any("mirror" in remark for remark in found.remarks)


def test_board_with_a_covered_mark_is_refused_with_the_reason() -> None:
    """No dot in view: no name, and a remark that speaks of the dots."""
    view = view_of(board(), 1)
    dots = np.flatnonzero(board().is_dot)
    for level in (26, 200):
        found = detect(painted(grey(view), view, dots, 1.35, level), board(), name="view")
        assert len(found.ring) == 0 or (misplaced(found, view) < 2).all()
        if level == 200:
            assert len(found.ring) == 0
            assert any("dot" in remark or "mark" in remark for remark in found.remarks)
    one = detect(painted(grey(view), view, dots[:1], 1.35, 200), board(), name="view")
    assert len(one.ring) == 0 or (misplaced(one, view) < 2).all()


def test_half_a_board_with_its_mark_is_named() -> None:
    """A part of the board that holds the mark is enough."""
    view = view_of(board(), 2)
    image = grey(view)
    middle = view.center_px[board().is_dot].mean(axis=0)
    image[:, : int(middle[0]) - 120] = 100
    found = detect(image, board(), name="view")
    assert (misplaced(found, view) < 2).all()
    assert len(found.ring) > 30


def test_plain_board_is_named_up_to_its_symmetry() -> None:
    """Without dots a whole board is named the most upright way and said to be ambiguous; a part of it is refused."""
    target = board(dots=False)
    view = view_of(target, 4)
    found = detect(view.image, target, name="view")
    assert len(found.ring) == target.ring_count
    assert any("ambiguous" in remark for remark in found.remarks)
    index = target.ring_index[found.ring]
    way = np.linalg.lstsq(index - index.mean(axis=0), found.center_px - found.center_px.mean(axis=0), rcond=None)[0]
    right, up = way[0] / np.linalg.norm(way[0]), -way[1] / np.linalg.norm(way[1])
    assert right[0] + up[1] > 0
    # One of the two turns that map the board onto itself brings the names to the truth.
    there = np.linalg.norm(found.center_px - view.center_px[found.ring], axis=1)
    back = {tuple(i): r for r, i in enumerate(target.ring_index.tolist())}
    total = target.ring_index.min(axis=0) + target.ring_index.max(axis=0)
    opposite = np.array([back[tuple((total - i).tolist())] for i in index])
    turned = np.linalg.norm(found.center_px - view.center_px[opposite], axis=1)
    assert min(there.max(), turned.max()) < 1
    image = grey(view)
    image[:, : int(np.median(view.center_px[:, 0]))] = 100
    part = detect(image, target, name="view")
    assert len(part.ring) == 0
    assert any("ambiguous" in remark for remark in part.remarks)


def test_smaller_board_than_expected_is_no_whole_one() -> None:
    """A plain sheet larger than the target is not taken for it."""
    view = view_of(board(dots=False), 5)
    found = detect(view.image, board(dots=False, columns=7, rows=5), name="view")
    assert len(found.ring) == 0
    assert found.remarks


def test_alignments_are_all_ways_to_lay_a_grid_on_a_face() -> None:
    """Brute force over turns and shifts finds the same ways; the true one is among them."""
    plan = plan_for(ico())
    index = np.array([(0, 0), (1, 0), (2, 0), (0, 1), (2, 1)])
    grid = Grid(np.arange(5), index, np.zeros(5))
    found = alignments(plan, 0, grid, np.ones(5, dtype=bool), plan.lattice.turns)
    on_face = {tuple(i) for i in ico().ring_index[ico().ring_face == 0].tolist()}
    expected = {
        (turn.tobytes(), i, j)
        for turn in plan.lattice.turns
        for i in range(-10, 11)
        for j in range(-10, 11)
        if all(tuple(place) in on_face for place in (index @ turn.T + (i, j)).tolist())
    }
    assert {(a.turn.tobytes(), int(a.shift[0]), int(a.shift[1])) for a in found} == expected
    # A member that is not sure may fall off the face.
    sure = np.array([True] * 4 + [False])
    assert len(alignments(plan, 0, grid, sure, plan.lattice.turns)) > len(found)


def test_whole_face_lies_in_three_ways() -> None:
    """A whole triangle of rings fits its face in three turns, and in three mirrored ones."""
    plan = plan_for(ico())
    index = ico().ring_index[ico().ring_face == 0]
    grid = Grid(np.arange(len(index)), index + np.array([5, -3]), np.zeros(len(index)))
    for turns in (plan.lattice.turns, plan.lattice.mirrors):
        assert len(alignments(plan, 0, grid, np.ones(len(index), dtype=bool), turns)) == 3


def test_alignment_goes_there_and_back() -> None:
    """Indices of the grid on the face, and back, for every turn and mirror."""
    lattice = lattice_of(ico())
    index = np.random.default_rng(1).integers(-9, 9, (20, 2))
    for turn in (*lattice.turns, *lattice.mirrors):
        one = Alignment(turn, np.array([3, -2]))
        assert np.array_equal(one.on_grid(one.on_face(index)), index)
        assert np.array_equal(one.on_face(np.zeros((1, 2), dtype=np.int64)), [[3, -2]])


def test_agreement_counts_marks_for_and_against() -> None:
    """Each mark that fits counts one, each that contradicts takes two, an unreadable one nothing."""
    expected = np.array([True, True, False, False])
    assert agreement(expected, np.array([DOT, DOT, RING, RING])) == 4
    assert agreement(expected, np.array([RING, DOT, RING, RING])) == 1
    assert agreement(expected, np.array([UNREADABLE, DOT, DOT, RING])) == 0
    both = agreement(np.stack([expected, ~expected]), np.array([DOT, DOT, RING, RING]))
    assert both.tolist() == [4, -8]


def test_plan_names_corners_and_marks_of_the_solid() -> None:
    """Twelve corners of five faces each; codes of three dots in six places; no plan without rings."""
    plan = plan_for(ico())
    numbers, counts = np.unique(plan.corner_vertex, return_counts=True)
    assert len(numbers) == 12
    assert (counts == 5).all()
    assert (plan.mark_is_dot.sum(axis=1) == 3).all()
    rows = plan.rows_at(7, ico().ring_index[ico().ring_face == 7])
    assert np.array_equal(rows, np.flatnonzero(ico().ring_face == 7))
    assert plan.rows_at(7, np.array([[-1, 0], [6, 0], [3, 3], [1000, 1000]])).tolist() == [-1] * 4
    only = np.flatnonzero(board().is_dot)
    dots = replace(board(), **{name: getattr(board(), name)[only] for name in ROW_ARRAYS})
    with pytest.raises(ValueError, match="dots only"):
        plan_for(dots)


ROW_ARRAYS = ("ring_face", "ring_index", "center_mm", "radius_outer_mm", "radius_inner_mm", "is_dot")


@pytest.mark.parametrize(
    ("pieces", "carries"), [({7: (12, 0), 12: (7, 0)}, {7: 12, 12: 7}), ({3: (3, 1)}, {3: 3}), ({7: (12, 2)}, {7: 12})]
)
def test_pieces_in_wrong_places_are_told_and_named_by_their_neighbours(
    pieces: dict[int, tuple[int, int]], carries: dict[int, int]
) -> None:
    """Swapped, turned or twice there: told by the code in some views, and of no other face; all rings lie right."""
    shown = ico()
    for place, (piece, thirds) in pieces.items():
        shown = with_piece(shown, ico(), place, piece, thirds)
    told = set()
    for seed in range(6):
        view = view_of(shown, seed)
        found = detect(view.image, ico(), name="view")
        assert (misplaced(found, view) < 2).all()
        told |= {(record.face, record.carries) for record in found.faces if record.carries is not None}
    assert told
    assert told <= set(carries.items())


# Boards with two faces.


def two_sided(lattice: Lattice, *, has_back: bool | None = True) -> TargetGeometry:
    """11 x 9 rings of 8 mm on each face."""
    spec = BoardSpec((152.0, 128.0), 5.0, 11, 9, lattice, 8.0, 0.45, 12.0, 0.0, 4.0, dots=True, two_sided=has_back)
    return lay_out(spec)


def side_of(target: TargetGeometry, face: int, seed: int, distance_mm: float, aside_mm: float) -> View:
    """A face from about its front, up to 40 degrees aslant."""
    rng = np.random.default_rng(seed)
    direction = np.array([*(0.6 * rng.uniform(-1, 1, 2)), 1.0 - 2.0 * face])
    at = np.array([*rng.uniform(-aside_mm, aside_mm, 2), 0.0])
    return render_view(target, CAMERA, look_at(rng, direction / np.linalg.norm(direction), distance_mm, at), USUAL, rng)


@pytest.mark.parametrize("lattice", ["square", "triangular"])
@pytest.mark.parametrize("face", [0, 1])
def test_photos_of_either_side_are_named(lattice: Lattice, face: int) -> None:
    """Whole: all rings. Close by and aside, so that parts show: named or not, but nothing under a wrong name."""
    target = two_sided(lattice)
    view = side_of(target, face, 1, 400.0, 5.0)
    found = detect(view.image, target, name="whole")
    assert set(target.ring_face[found.ring]) == {face}
    assert len(found.ring) >= 0.98 * view.clean.sum()
    assert misplaced(found, view).max() < 0.5
    named = 0
    for seed in range(3):
        view = side_of(target, face, seed, 200.0, 35.0)
        found = detect(view.image, target, name="part")
        named += len(found.ring) > 0
        assert set(target.ring_face[found.ring]) <= {face}
        assert misplaced(found, view).max(initial=0.0) < 0.5
    assert named


def test_a_photo_in_a_mirror_is_not_the_other_side() -> None:
    """Flipped, each side is told as mirrored."""
    target = two_sided("square")
    for face in (0, 1):
        view = side_of(target, face, 2, 400.0, 5.0)
        found = detect(np.ascontiguousarray(view.image[:, ::-1]), target, name="mirror")
        assert not len(found.ring)
        assert any("mirror" in remark for remark in found.remarks)


def test_the_back_is_not_found_with_the_file_of_a_board_with_one_face() -> None:
    """Its mark is another; so is that of a board without dots."""
    target = two_sided("square")
    view = side_of(target, 1, 3, 400.0, 5.0)
    one_face = two_sided("square", has_back=None)
    assert not len(detect(view.image, one_face, name="other").ring)
    covered = replace(target, is_dot=np.zeros_like(target.is_dot), radius_inner_mm=0.45 * target.radius_outer_mm)
    plain = side_of(covered, 1, 3, 400.0, 5.0)
    assert not len(detect(plain.image, target, name="no mark").ring)
