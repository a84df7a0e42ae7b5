"""Photos of a board with two faces: each face under its own name, whole or in part, and no wrong name."""

from dataclasses import replace

import numpy as np
import pytest

from calib.detector.pipeline import detect
from calib.renderer import View, render_view
from designer.kinds.board import BoardSpec
from designer.kinds.layout import lay_out
from designer.spec.spec import Lattice
from designer.target import TargetGeometry
from tests.benchmarks.synthetic import look_at
from tests.support.ring_views import CAMERA, USUAL, misplaced


def board(lattice: Lattice, *, two_sided: bool | None = True) -> TargetGeometry:
    """11 x 9 rings of 8 mm on each face."""
    spec = BoardSpec((152.0, 128.0), 5.0, 11, 9, lattice, 8.0, 0.45, 12.0, 0.0, 4.0, dots=True, two_sided=two_sided)
    return lay_out(spec)


def view_of(target: TargetGeometry, face: int, seed: int, distance_mm: float, aside_mm: float) -> View:
    """A face from about its front, up to 40 degrees aslant."""
    rng = np.random.default_rng(seed)
    direction = np.array([*(0.6 * rng.uniform(-1, 1, 2)), 1.0 - 2.0 * face])
    at = np.array([*rng.uniform(-aside_mm, aside_mm, 2), 0.0])
    return render_view(target, CAMERA, look_at(rng, direction / np.linalg.norm(direction), distance_mm, at), USUAL, rng)


@pytest.mark.parametrize("lattice", ["square", "triangular"])
@pytest.mark.parametrize("face", [0, 1])
def test_photos_of_either_side_are_named(lattice: Lattice, face: int) -> None:
    """Whole: all rings. Close by and aside, so that parts show: named or not, but nothing under a wrong name."""
    target = board(lattice)
    view = view_of(target, face, 1, 400.0, 5.0)
    found = detect(view.image, target, name="whole")
    assert set(target.ring_face[found.ring]) == {face}
    assert len(found.ring) >= 0.98 * view.clean.sum()
    assert misplaced(found, view).max() < 0.5
    named = 0
    for seed in range(3):
        view = view_of(target, face, seed, 200.0, 35.0)
        found = detect(view.image, target, name="part")
        named += len(found.ring) > 0
        assert set(target.ring_face[found.ring]) <= {face}
        assert misplaced(found, view).max(initial=0.0) < 0.5
    assert named


def test_a_photo_in_a_mirror_is_not_the_other_side() -> None:
    """Flipped, each side is told as mirrored."""
    target = board("square")
    for face in (0, 1):
        view = view_of(target, face, 2, 400.0, 5.0)
        found = detect(np.ascontiguousarray(view.image[:, ::-1]), target, name="mirror")
        assert not len(found.ring)
        assert any("mirror" in remark for remark in found.remarks)


def test_the_back_is_not_found_with_the_file_of_a_board_with_one_face() -> None:
    """Its mark is another; so is that of a board without dots."""
    target = board("square")
    view = view_of(target, 1, 3, 400.0, 5.0)
    one_face = board("square", two_sided=None)
    assert not len(detect(view.image, one_face, name="other").ring)
    covered = replace(target, is_dot=np.zeros_like(target.is_dot), radius_inner_mm=0.45 * target.radius_outer_mm)
    plain = view_of(covered, 1, 3, 400.0, 5.0)
    assert not len(detect(plain.image, target, name="no mark").ring)
