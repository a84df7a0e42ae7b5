"""Grids of circles in photos: named where all of the grid is seen, and measured as true as rings are."""

from dataclasses import replace

import cv2
import numpy as np
import pytest
from numpy.typing import NDArray

from calib.cameras.camera import Camera
from calib.detector.marks import FINDERS, FoundFace
from calib.renderer.options import RenderOptions
from calib.renderer.view import View, render_view
from designer.marks.circles import Circles
from designer.target import target_of_marks
from tests.support.sightings import view_from

SYMMETRIC = Circles((7, 5), 20.0, 11.0)
ASYMMETRIC = Circles((4, 7), 40.0, 12.0, asymmetric=True)
SIZE = 640, 480
LENS = Camera("opencv", np.array([560, 560, 319.5, 239.5, -0.2, 0, 0, 0, 0]), SIZE)


def find(pixels: NDArray[np.generic], *faces: Circles) -> tuple[FoundFace, ...]:
    """What the finder makes of it."""
    return FINDERS["circles"](np.asarray(pixels, dtype=np.uint8), faces)


def view_of(marks: Circles, tilt_deg: float, *, aside: float = 0.0, seed: int = 1) -> View:
    """A photo of it, its middle aside by so many widths."""
    width, tilt = max(marks.size_mm), np.radians(tilt_deg)
    target = target_of_marks([marks], np.eye(4)[None], marks.pitch_mm / 2)
    aim = np.array([aside * width, 0.03 * width, 0])
    eye = aim + 1.6 * width * np.array([0.3 * np.sin(tilt), -np.sin(tilt), np.cos(tilt)])
    options = RenderOptions(blur_px=0.7, contrast_to_noise=50)
    pose = view_from((eye[0], eye[1], eye[2]), (aim[0], aim[1], aim[2]))
    return render_view(target, LENS, pose, options, np.random.default_rng(seed))


def told(pixels: NDArray[np.generic], *faces: Circles) -> str:
    """All remarks; nothing may be named."""
    found = find(pixels, *faces)
    assert not any(len(one.row) for one in found)
    return " ".join(remark for one in found for remark in one.remarks)


@pytest.mark.parametrize("tilt_deg", [0, 35, 60])
@pytest.mark.parametrize("marks", [SYMMETRIC, ASYMMETRIC, replace(ASYMMETRIC, light=True), Circles((6, 6), 20.0, 8.0)])
def test_centres_are_those_of_the_circles(marks: Circles, tilt_deg: float) -> None:
    """Images of the circles' own centres, not of their ellipses', at any tilt, by as much as is stated."""
    view = view_of(marks, tilt_deg)
    (found,) = find(view.image, marks)
    assert found.cov_px2 is not None
    assert len(found.row) >= 0.95 * len(marks.index)
    off = found.near_px - view.center_px[found.row]
    squares = np.einsum("ni,ni->n", off, np.linalg.solve(found.cov_px2, off[:, :, None])[:, :, 0]) / 2
    assert np.sqrt((off**2).mean()) < 0.02
    assert 0.75 < np.sqrt(squares.mean()) < 1.3
    assert bool(found.remarks) == (marks.alike > 1)


def test_an_asymmetric_grid_has_one_name_however_it_is_turned() -> None:
    """An odd number of rows tells the orientation; a mirrored print is told of an even one."""
    view = view_of(ASYMMETRIC, 30)
    turned = np.ascontiguousarray(view.image[::-1, ::-1])
    (found,) = find(turned, ASYMMETRIC)
    assert np.abs(np.array(SIZE) - 1 - found.near_px - view.center_px[found.row]).max() < 0.1
    even = replace(ASYMMETRIC, circles=(4, 6))
    assert "flip it back" in told(np.ascontiguousarray(view_of(even, 30).image[:, ::-1]), even)


def test_of_a_plain_grid_the_most_upright_names_are_taken() -> None:
    """Upside down its first circle is the last one, which is said."""
    view = view_of(SYMMETRIC, 20)
    (found,) = find(np.ascontiguousarray(view.image[::-1, ::-1]), SYMMETRIC)
    assert found.near_px[0, 0] < found.near_px[6, 0]
    assert found.near_px[0, 1] < found.near_px[-1, 1]
    assert "ambiguous" in found.remarks[0]


def test_a_grid_printed_light_for_dark_is_named_and_said() -> None:
    """Its centres are measured in the image with its grey levels exchanged."""
    view = view_of(ASYMMETRIC, 30)
    (found,) = find(255 - view.image, ASYMMETRIC)
    assert np.abs(found.near_px - view.center_px[found.row]).max() < 0.1
    assert "inverted" in found.remarks[0]


def test_a_cover_hides_what_is_under_it() -> None:
    """A finger over some circles takes nothing from the others; of a grid in the photo in part nothing is told."""
    view = view_of(SYMMETRIC, 30)
    u, v = view.center_px[17].round().astype(int).tolist()
    covered = cv2.ellipse(view.image.astype(np.uint8), (u, v), (70, 25), 30, 0, 360, 150, -1)
    (found,) = find(covered, SYMMETRIC)
    assert len(found.row) >= 28
    assert 17 not in found.row
    assert np.abs(found.near_px - view.center_px[found.row]).max() < 0.15
    assert "all rows and columns must be in view" in told(view_of(SYMMETRIC, 30, aside=0.75).image, SYMMETRIC)


@pytest.mark.parametrize("told_mm", [5.0, 19.0])
def test_another_diameter_is_measured_and_said(told_mm: float) -> None:
    """Circles narrower or wider than told are found, measured as they look, and lose nothing by it."""
    view = view_of(SYMMETRIC, 45)
    (found,) = find(view.image, replace(SYMMETRIC, diameter_mm=told_mm))
    assert len(found.row) == 35
    assert np.sqrt(((found.near_px - view.center_px[found.row]) ** 2).mean()) < 0.02
    assert f"mm wide, not {told_mm:g}" in found.remarks[1]
    assert float(found.remarks[1].split()[2]) == pytest.approx(SYMMETRIC.diameter_mm, rel=0.05)


def drawn(marks: Circles, *discs: tuple[int, int]) -> NDArray[np.uint8]:
    """Discs of a radius and a grey level, one on the other, at each place of a grid, without its lengths."""
    flat = np.full((480, 640), 230, np.uint8)
    for column, row in marks.index.tolist():
        for radius, level in discs:
            step = 40 if marks.asymmetric else 80
            cv2.circle(flat, (80 + step * column, 80 + step * row), radius, level, -1, cv2.LINE_AA)
    return flat


def test_a_grid_is_not_taken_for_one_with_a_row_more() -> None:
    """Turned, 4 x 9 circles are 5 x 8 but for four at one end: another board, which is told."""
    smaller = Circles((4, 9), 40.0, 12.0, asymmetric=True)
    assert "grid of 4 x 9" in told(drawn(smaller, (15, 20)), replace(smaller, circles=(5, 8)))


def test_rings_are_no_circles() -> None:
    """Neither a grid of them is named, nor their light centres."""
    flat = drawn(SYMMETRIC, (30, 20), (14, 230))
    for marks in (SYMMETRIC, replace(SYMMETRIC, light=True)):
        assert told(flat, marks) == ""


def test_other_grids_are_told() -> None:
    """What is seen, where it is not the target's; and never one of two."""
    seen = view_of(SYMMETRIC, 30).image
    assert "a symmetric grid of 7 x 5 circles is seen" in told(seen, Circles((6, 5), 20.0, 11.0))
    shifted = view_of(ASYMMETRIC, 30).image
    assert "an asymmetric grid of 4 x 7 circles" in told(shifted, SYMMETRIC)
    swapped = replace(ASYMMETRIC, circles=ASYMMETRIC.circles[::-1])
    assert "grid of 4 x 7 circles is seen, the target is an asymmetric one of 7 x 4" in told(shifted, swapped)
    assert "are alike" in told(seen, SYMMETRIC, SYMMETRIC)
    both = np.hstack([seen[:, 40:-40], seen[:, 40:-40]])
    assert "two grids" in told(both, SYMMETRIC)
    found = find(np.hstack([seen, view_of(ASYMMETRIC, 30).image]), SYMMETRIC, ASYMMETRIC)
    assert [one.face for one in found if len(one.row)] == [0, 1]


@pytest.mark.parametrize("pixels", [
    np.random.default_rng(1).integers(0, 256, (500, 700)).astype(np.uint8), np.zeros((400, 400), np.uint8),
    np.full((400, 400), 255, np.uint8), np.zeros((1, 500), np.uint8), np.zeros((500, 1), np.uint8),
    np.where(np.hypot(*(np.indices((240, 240)) % 6 - 3)) < 2.5, 20, 230).astype(np.uint8),
])  # fmt: skip
def test_there_is_no_grid_in_hostile_images(pixels: NDArray[np.uint8]) -> None:
    """Noise, one colour, a line of pixels and a screen of thousands of dots give no names."""
    for marks in (SYMMETRIC, ASYMMETRIC):
        assert not any(len(one.row) for one in find(pixels, marks))
