"""What is drawn of a target that is to be held somewhere."""

import numpy as np

from calib.core.se3 import look_at
from calib.judge.guide_held import ghost_lines
from tests.support.calibrations import board, camera, icosahedron

CAMERA = camera("pinhole", (1200, 900), 1400.0)


def facing(distance_mm: float) -> np.ndarray:
    """Straight on the first face of an icosahedron, or on a board."""
    return look_at(np.array([[0.0, 0.0, distance_mm]]), np.zeros((1, 3)), np.zeros(1))[0]


def test_solid_is_drawn_without_gaps_and_without_its_back() -> None:
    """Lines are drawn around the faces turned to the camera alone, and neighbours share their sides."""
    solid = icosahedron()
    lines = ghost_lines(solid, CAMERA, facing(400.0))
    assert 5 <= len(lines) <= 10
    corners = np.concatenate([line[:-1:6] for line in lines])
    apart = np.linalg.norm(corners[:, None] - corners, axis=2)
    assert ((apart < 1.0).sum(axis=1) >= 2).sum() >= len(lines)
    assert all((line[0] == line[-1]).all() for line in lines)


def test_board_is_drawn_by_its_border_unless_from_behind() -> None:
    """A board's line is its paper's border in the image; from behind there is none."""
    flat = board()
    (line,) = ghost_lines(flat, CAMERA, facing(300.0))
    width_mm = np.ptp(flat.outline_mm[0][:, 0])
    assert abs(np.ptp(line[:, 0]) - 1400.0 * width_mm / 300.0) < 0.5
    behind = facing(300.0) @ np.diag([1.0, -1.0, -1.0, 1.0])
    assert ghost_lines(flat, CAMERA, behind) == ()
