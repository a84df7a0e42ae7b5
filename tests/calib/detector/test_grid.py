"""Lattices, and grids grown over them."""

from dataclasses import replace

import numpy as np
import pytest

from calib.cameras.camera import camera_or_preset
from calib.detector.candidates import Candidates
from calib.detector.grid import Grid, grow_grids, lattice_of
from designer.target import TargetGeometry
from tests.support.ring_views import Scene, board, ico, scene_of


@pytest.mark.parametrize(("target", "count"), [(board(), 4), (board("triangular"), 6), (ico(), 6)])
def test_lattices_have_their_turns_and_mirrors(target: TargetGeometry, count: int) -> None:
    """A square lattice has 4 turns and 4 mirrors, a triangular one 6 and 6; they keep distances and form a group."""
    lattice = lattice_of(target)
    assert len(lattice.turns) == len(lattice.mirrors) == count
    assert len(lattice.move) == count
    steps = target.lattice_mm[0]
    index = np.random.default_rng(1).integers(-9, 9, (30, 2))
    before = np.linalg.norm(index @ steps, axis=1)
    for sign, group in ((1, lattice.turns), (-1, lattice.mirrors)):
        for turn in group:
            assert np.linalg.norm(index @ turn.T @ steps, axis=1) == pytest.approx(before)
            assert round(float(np.linalg.det(turn))) == sign
            assert {tuple(m) for m in (lattice.move @ turn.T).tolist()} == {tuple(m) for m in lattice.move.tolist()}
    every = {turn.tobytes() for turn in lattice.turns}
    assert {(a @ b).tobytes() for a in lattice.turns for b in lattice.turns} == every
    assert {(a @ b).tobytes() for a in lattice.mirrors for b in lattice.mirrors} == every


def test_moves_are_the_nearest_neighbours_as_an_image_shows_them() -> None:
    """Moves lead to the neighbours, in units of the outer radius, with y down."""
    lattice = lattice_of(board())
    moves = {tuple(m): tuple(np.round(s, 9)) for m, s in zip(lattice.move.tolist(), lattice.move_in_radii, strict=True)}
    assert moves == {(1, 0): (3, 0), (-1, 0): (-3, 0), (0, 1): (0, -3), (0, -1): (0, 3)}
    lengths = np.linalg.norm(lattice_of(ico()).move_in_radii, axis=1)
    assert lengths == pytest.approx(np.full(6, 13 / 4.5))


def test_oblong_lattices_turn_by_half_only() -> None:
    """A lattice of 12 x 14 mm has two turns and two mirrors."""
    oblong = replace(board(), lattice_mm=np.array([[[12.0, 0.0], [0.0, 14.0]]]))
    lattice = lattice_of(oblong)
    assert (len(lattice.turns), len(lattice.mirrors)) == (2, 2)


def test_lattices_that_differ_or_are_flat_are_refused() -> None:
    """Faces must share one lattice, and its two steps must span the plane: one line says so."""
    steps = ico().lattice_mm.copy()
    steps[3] *= 1.2
    with pytest.raises(ValueError, match="lattice") as caught:
        lattice_of(replace(ico(), lattice_mm=steps))
    assert "\n" not in str(caught.value)
    with pytest.raises(ValueError, match="lattice"):
        lattice_of(replace(board(), lattice_mm=np.array([[[12.0, 0.0], [24.0, 0.0]]])))


def agreeing(target: TargetGeometry, scene: Scene, grid: Grid) -> int:
    """How many features of a grid lie on one face under one proper turn: index on the face = turn @ index + shift."""
    real = scene.row[grid.row] >= 0
    row = scene.row[grid.row[real]]
    best = 0
    for turn in lattice_of(target).turns:
        shift = target.ring_index[row] - grid.index[real] @ turn.T
        _, counts = np.unique(np.column_stack([target.ring_face[row], shift]), axis=0, return_counts=True)
        best = max(best, int(counts.max(initial=0)))
    return best


def check(target: TargetGeometry, scene: Scene, grids: tuple[Grid, ...]) -> list[int]:
    """Hold all grids to one face and one turn each; return their sizes, the largest first."""
    used = np.concatenate([grid.row for grid in grids])
    assert len(np.unique(used)) == len(used)
    for grid in grids:
        assert len(np.unique(grid.index, axis=0)) == len(grid.index)
        assert agreeing(target, scene, grid) == len(grid.row)
    return [len(grid.row) for grid in grids]


@pytest.mark.parametrize("target", [board(), board("triangular")], ids=["square", "triangular"])
@pytest.mark.parametrize("seed", range(6))
def test_grid_of_a_board_holds_all_its_features(target: TargetGeometry, seed: int) -> None:
    """From any side one grid takes in every feature, dots too, under one turn of the lattice."""
    scene = scene_of(target, seed)
    sizes = check(target, scene, grow_grids(scene.candidates, lattice_of(target), across_gaps=True))
    assert sizes == [scene.candidates.count]


@pytest.mark.parametrize("seed", range(6))
def test_grid_bends_with_a_strong_lens(seed: int) -> None:
    """Barrel distortion of a wide webcam breaks no grid."""
    scene = scene_of(board(), seed, camera=camera_or_preset("wide-webcam"), distance_mm=170.0)
    assert scene.candidates.count > 25
    sizes = check(board(), scene, grow_grids(scene.candidates, lattice_of(board()), across_gaps=True))
    assert sizes[0] >= scene.candidates.count - 2


@pytest.mark.parametrize("target", [board(), board("triangular")], ids=["square", "triangular"])
@pytest.mark.parametrize("seed", range(6))
def test_grid_steps_over_missing_features(target: TargetGeometry, seed: int) -> None:
    """With a sixth of the features gone, the rest still hangs together under the right indices."""
    scene = scene_of(target, seed, missing=0.16)
    sizes = check(target, scene, grow_grids(scene.candidates, lattice_of(target), across_gaps=True))
    assert sizes[0] > 0.9 * scene.candidates.count


@pytest.mark.parametrize(
    ("target", "across_gaps"),
    [(board(), True), (board("triangular"), True), (ico(), False)],
    ids=["square", "tri", "ico"],
)
def test_strangers_spoil_few_grids(target: TargetGeometry, across_gaps: bool) -> None:
    """Among twenty ring-like strangers of all sizes, nearly all features are in grids that count them rightly."""
    right = total = 0
    for seed in range(15):
        scene = scene_of(target, seed, clutter=20)
        grids = grow_grids(scene.candidates, lattice_of(target), across_gaps=across_gaps)
        right += sum(agreeing(target, scene, grid) for grid in grids)
        total += int((scene.row >= 0).sum())
    assert right > 0.88 * total


@pytest.mark.parametrize("seed", range(10))
def test_grids_do_not_run_over_the_edges_of_a_solid(seed: int) -> None:
    """Faces that meet at an edge stay apart, also where rings are missing; flat faces are found whole."""
    scene = scene_of(ico(), seed, missing=0.1 * (seed % 2))
    sizes = check(ico(), scene, grow_grids(scene.candidates, lattice_of(ico()), across_gaps=False))
    assert sum(sizes) > 0.9 * scene.candidates.count


def test_grid_counts_steps_over_one_missing_feature_only_when_told() -> None:
    """A column gone: across gaps the grid goes on with the right count, without that it stops."""
    scene = scene_of(board(), 1)
    keep = np.flatnonzero(board().ring_index[scene.row, 0] != 0)
    part = replace(scene, candidates=scene.candidates.take(keep), row=scene.row[keep])
    over = grow_grids(part.candidates, lattice_of(board()), across_gaps=True)
    assert check(board(), part, over) == [len(keep)]
    stopped = grow_grids(part.candidates, lattice_of(board()), across_gaps=False)
    assert len(stopped) == 2
    assert sum(check(board(), part, stopped)) == len(keep)


def test_order_of_candidates_does_not_matter() -> None:
    """Grids are the same sets of candidates whatever order these come in."""
    scene = scene_of(board(), 3, missing=0.1, clutter=10)
    lattice = lattice_of(board())
    base = grow_grids(scene.candidates, lattice, across_gaps=True)[0]
    order = np.random.default_rng(1).permutation(scene.candidates.count)
    other = grow_grids(scene.candidates.take(order), lattice, across_gaps=True)[0]
    real = scene.row[base.row] >= 0
    assert set(scene.row[base.row[real]].tolist()) == {r for r in scene.row[order[other.row]].tolist() if r >= 0}


@pytest.mark.parametrize("count", [0, 1, 2, 5])
def test_few_candidates_give_few_grids(count: int) -> None:
    """Nothing, or candidates far from each other, make no grid and no crash."""
    rng = np.random.default_rng(2)
    ellipse = np.column_stack(
        [500.0 * np.arange(count), rng.uniform(0, 100, count), np.tile([0.1, 0, 0.1], (count, 1))]
    )
    lonely = Candidates(ellipse, np.full(count, 0.45), np.zeros(count, dtype=np.int64), np.full(count, 0.1))
    assert grow_grids(lonely, lattice_of(board()), across_gaps=True) == ()


def test_candidates_at_one_place_end_the_search() -> None:
    """Hundreds of ellipses on top of each other neither crash nor hang the search."""
    count = 400
    ellipse = np.tile([100.0, 100.0, 0.1, 0.0, 0.1], (count, 1))
    heap = Candidates(ellipse, np.full(count, 0.45), np.zeros(count, dtype=np.int64), np.full(count, 0.1))
    assert grow_grids(heap, lattice_of(ico()), across_gaps=True) == ()
