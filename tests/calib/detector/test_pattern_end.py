"""Where the pattern ends: what covers, the image's edge and full pixels leave of a target's last row."""

import math
from functools import cache

import numpy as np
import pytest

from calib.detector.pipeline import detect
from calib.renderer import RenderOptions, View, render_view
from designer.base.arrays import Array
from designer.kinds.board import BoardSpec
from designer.kinds.layout import lay_out
from designer.target import TargetGeometry
from tests.support.ring_views import CAMERA, USUAL

COLUMNS, ROWS = 21, 19
THUMB = 110


@cache
def board(rows: int = ROWS) -> TargetGeometry:
    """A board of so many rows, with a margin wide enough for one more."""
    size = 230.0, 250.0 + 10.0 * (rows - ROWS)
    return lay_out(BoardSpec(size, 5.0, COLUMNS, rows, "square", 6.5, 0.45, 10.0, 0.0, 4.0, dots=True))


@cache
def view(options: RenderOptions = USUAL) -> View:
    """The board from the front, rolled by three degrees: the rings of the lowest row come into the image in turn."""
    roll = math.radians(3)
    across = np.array([math.cos(roll), math.sin(roll), 0])
    pose = np.eye(4)
    pose[:3, :3] = np.stack([across, np.cross([0, 0, -1], across), [0, 0, -1]])
    pose[:3, 3] = 0, 0, 440
    return render_view(board(), CAMERA, pose, options, np.random.default_rng(5))


def lowest_row() -> Array:
    """Centres of the row of rings nearest to the image's lower edge, the highest first.  # (COLUMNS, 2)"""
    center, index = view().center_px, board().ring_index[:, 1]
    row = center[index == index[np.argmax(center[:, 1])]]
    return np.asarray(row[np.argsort(row[:, 1])])


@pytest.mark.parametrize("whole", [4, 8])
def test_a_thumb_on_what_the_image_leaves_of_a_row_is_no_end(whole: int) -> None:
    """Neighbours are hidden together: a few of them are no proof that the target has no such row."""
    row, radius = lowest_row(), view().minor_radius_px.max()
    image = view().image[: int(row[whole - 1, 1] + radius + 3)].copy()
    seen = row[row[:, 1] + radius < len(image) + 1]
    u, v = np.meshgrid(np.arange(image.shape[1]), np.arange(image.shape[0]))
    is_over = (u > seen[:, 0].min() - 1.2 * radius) & (u < seen[:, 0].max() + 1.2 * radius)
    image[is_over & (v > np.interp(u, row[:, 0], row[:, 1]) - 1.2 * radius)] = THUMB
    found = detect(image, board(), name="photo")
    assert len(found.ring) >= COLUMNS * (ROWS - 1) - 2
    assert not found.remarks


@pytest.mark.parametrize("options", [USUAL, RenderOptions(blur_px=0.6)], ids=["noise", "no noise"])
def test_margin_where_a_row_should_be_is_an_end(options: RenderOptions) -> None:
    """A board of a row more is refused; that nothing in the picture is brighter does not make it glare."""
    image = view(options).image
    assert len(detect(image, board(), name="photo").ring) == COLUMNS * ROWS
    # Less than half of the missing row is in view: that it is bare is all that tells.
    part = image[: int(lowest_row()[8, 1] + 42)]
    assert "pattern ends" in detect(part, board(ROWS + 1), name="photo").remarks[0]
