"""Boards with rings on both faces: marks that cannot be taken for each other, closed meshes, errors that bend both."""

from functools import cache
from itertools import combinations, product

import numpy as np
import pytest
import trimesh

from designer.base.errors import InputError
from designer.builds.design import Design
from designer.kinds.board import BACK_DOTS, BOARD_DOTS, lattice_steps
from designer.kinds.layout import adjacent_faces, inset_per_depth
from designer.make.printability import check_printability
from designer.make.stand import make_stand
from designer.spec.kind import spec_to_mapping
from designer.spec.spec import Lattice
from designer.target import target_from_json, target_to_json
from designer.tolerance.made import error_model_for
from designer.tolerance.shape import centers_mm, shape_of
from designer.tolerance.sources import source_named
from tests.support.designs import COARSE, design_of, ink_of, small_board

each_lattice = pytest.mark.parametrize("lattice", ["square", "triangular"])


@cache
def two_sided(lattice: Lattice = "square", **values: object) -> Design:
    """A board of a few rings on each face, 3.6 mm thick."""
    asked = {"size": "60x50mm", "thickness": "3.6mm", "ring_diameter": "5mm", "pitch": "8mm", "chord_error": COARSE}
    return design_of("board", **{**asked, "two_sided": True, "lattice": lattice, **values})


def images_of(dots: frozenset[tuple[int, int]], lattice: Lattice) -> list[np.ndarray]:
    """The dots of a mark under all turns and mirror images of the lattice, in space."""
    turn = 2 * np.pi / (4 if lattice == "square" else 6)
    place = np.array(sorted(dots)) @ lattice_steps(lattice)
    ways = []
    for k, flip in product(range(6), (1.0, -1.0)):
        cosine, sine = np.cos(k * turn), np.sin(k * turn)
        ways.append(place @ np.array([[cosine, sine], [-sine, cosine]]) * [1.0, flip])
    return ways


@each_lattice
def test_marks_of_front_and_back_share_one_dot_at_most(lattice: Lattice) -> None:
    """However one is turned, shifted or mirrored: two dots tell the face, and a flipped photo is no other face."""
    front, back = images_of(BOARD_DOTS, lattice), images_of(BACK_DOTS, lattice)
    for a, b in product(front[:1], back):
        for shift in (a[:, None] - b).reshape(-1, 2):
            apart = np.linalg.norm(a[:, None] - (b + shift), axis=2)
            assert (apart < 1e-9).sum() == 1
    for mark in (BOARD_DOTS, BACK_DOTS):
        place = np.array(sorted(mark)) @ lattice_steps(lattice)
        lengths = [np.linalg.norm(p - q) for p, q in combinations(place, 2)]
        assert min(abs(p - q) for p, q in combinations(lengths, 2)) > 0.1  # so no turn or mirror maps it to itself


@each_lattice
def test_back_lies_behind_the_front(lattice: Lattice) -> None:
    """The back's frame is the front's turned about y by half a turn, a thickness deeper; each face has its mark."""
    target = two_sided(lattice).target
    assert target.face_count == 2
    assert target.is_plate
    assert not target.is_planar
    assert np.array_equal(target.target_from_face[1, :3, :3], np.diag([-1.0, 1.0, -1.0]))
    assert target.center_mm[target.ring_face == 1, 2] == pytest.approx(-3.6)
    assert np.bincount(target.ring_face).tolist() == [target.ring_count / 2] * 2
    assert np.bincount(target.ring_face[target.is_dot]).tolist() == [3, 3]
    for face, mark in enumerate((BOARD_DOTS, BACK_DOTS)):
        dots = target.ring_index[target.is_dot & (target.ring_face == face)]
        assert {tuple(dot - dots[0]) for dot in dots} == {(i - a, j - b) for i, j in mark for a, b in [min(mark)]}
    again = target_from_json(target_to_json(target))
    assert again == target
    assert again.spec == target.spec


def test_boards_with_one_face_keep_their_files() -> None:
    """What they do not have is not written: the ids of boards made before stay."""
    assert "two_sided" not in spec_to_mapping(small_board().job.target)
    assert spec_to_mapping(two_sided().job.target)["two_sided"] is True


def test_faces_of_a_plate_do_not_meet() -> None:
    """However thin it is, front and back share no edge, and their border's floor does not move in."""
    target = two_sided(thickness="1.2mm", border="2mm", size="160x120mm").target
    assert (adjacent_faces(target) == -1).all()
    assert inset_per_depth(target) == 0.0


@each_lattice
def test_half_of_the_ink_is_at_the_top_and_half_at_the_bottom(lattice: Lattice) -> None:
    """As deep in one face as in the other."""
    mesh = ink_of(two_sided(lattice))
    ink = trimesh.Trimesh(mesh.vertices_mm, mesh.triangles)
    assert np.unique(np.round(ink.vertices[:, 2], 6)).tolist() == pytest.approx([-3.6, -3.0, -0.6, 0.0])
    upper = ink.slice_plane([0, 0, -1.8], [0, 0, 1], cap=False).volume
    assert upper == pytest.approx(ink.volume / 2, rel=0.01)  # letters differ


def test_changes_are_those_of_the_first_and_the_last_layers() -> None:
    """Three layers below, three above: the filament changes in each, and once where the lower ink ends."""
    takes = two_sided().estimate
    assert (takes.inked_layers, takes.changes) == (6, 7)


def test_a_bent_board_bends_both_faces_alike() -> None:
    """A back ring moves as the point of the front above it, a dome, a saddle or a twist (the mean aside)."""
    target = two_sided().target
    for values in np.eye(3):
        shape = source_named("warp").apply(shape_of(target), values[None])
        height = (centers_mm(shape) - target.center_mm)[:, 2]
        front, back = (np.flatnonzero(target.ring_face == face) for face in (0, 1))
        apart = np.linalg.norm(target.center_mm[back, None, :2] - target.center_mm[front, :2], axis=2)
        assert apart.min(axis=1).max() < 1e-9
        assert height[back] == pytest.approx(height[front][apart.argmin(axis=1)], abs=1e-12)
        assert np.ptp(height) > 0.1


@pytest.mark.parametrize("build", ["one-piece", "sheet"])
def test_errors_of_making_place_the_back(build: str) -> None:
    """How a two-sided board comes out has errors of its faces against each other; other boards have none."""
    assumed = error_model_for(two_sided(build=build).target)
    assert assumed is not None
    assert all(assumed.errors.amount(name).sigma > 0 for name in ("face_offset", "face_shift", "face_tilt", "warp"))


@pytest.mark.parametrize(
    ("values", "message"),
    [
        ({"dots": False}, "two_sided without dots: nothing tells front from back"),
        ({"size": "30x30mm"}, "it must hold 4 x 4"),
        (
            {"thickness": "1mm", "inlay_depth": "0.6mm"},
            "from both sides goes through a board 1mm thick; use at most 0.25mm",
        ),
    ],
)
def test_what_no_two_sided_board_can_be(values: dict[str, object], message: str) -> None:
    """The value, the rule, the remedy."""
    with pytest.raises(InputError, match=message):
        _ = two_sided(**values).part


def test_rules_of_two_sides() -> None:
    """A plate that does not end at a layer puts the upper ink off; a stand would cover rings of the back."""
    design = two_sided(thickness="3.5mm")
    check = check_printability(design.target, design.job.printing)
    assert any("use 3.6mm" in finding.text for finding in check.findings)
    with pytest.raises(InputError, match="leave --stand out"):
        make_stand(design.target, design.job.printing)
