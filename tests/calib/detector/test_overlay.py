"""Overlays: what was found is marked where it is, what was not is told apart, and nothing makes drawing fail."""

from dataclasses import replace
from pathlib import Path

import cv2
import numpy as np
import pytest
from numpy.typing import NDArray

from calib.cameras.camera import Camera
from calib.core.types import Detections
from calib.detector.canvas import Canvas, ellipse_points, text_mask
from calib.detector.overlay import draw_overlay, write_overlay
from calib.detector.overlay_frame import FACE_COLOURS, MISSING, REJECTED, SIGMA_RANGE_PX, face_colours, sigma_colour
from calib.detector.where_expected import imaged_face
from calib.renderer.faces import ring_truth
from calib.renderer.scene import scene_from_target
from designer.base.arrays import Array
from designer.kinds.layout import lay_out
from designer.kinds.sizing import size_job
from designer.target import TargetGeometry
from tests.support.designs import asked_for
from tests.support.sightings import pinhole, sighting, view_from

ICO = lay_out(size_job(asked_for("ico", {"edge": "100mm"})).job.target)
BOARD = lay_out(size_job(asked_for("board", {"columns": 7, "rows": 5, "pitch": "20mm"})).job.target)
CAMERA = pinhole(1200, 900, 1300)
Pictures = tuple[NDArray[np.uint8], Detections]


@pytest.fixture(scope="module")
def board() -> Pictures:
    return sighting(BOARD, CAMERA, view_from((60, -90, 280)), np.random.default_rng(1), found_share=0.8)


@pytest.fixture(scope="module")
def ico() -> Pictures:
    return sighting(ICO, CAMERA, view_from((150, 120, 220)), np.random.default_rng(2))


def header_height(overlay: NDArray[np.uint8], pixels: NDArray[np.uint8]) -> int:
    """Rows above the picture: the paper's colour is not in photos."""
    left = overlay[:, 0].astype(int)
    return int(np.argmax(np.abs(left - left[0]).sum(axis=1) > 0))


def is_near(overlay: NDArray[np.uint8], place: Array, colour: tuple[int, int, int], reach: int = 3) -> bool:
    """Whether a colour is within some pixels of a place."""
    u, v = np.rint(place).astype(int)
    around = overlay[max(v - reach, 0) : v + reach + 1, max(u - reach, 0) : u + reach + 1].astype(int)
    return bool((np.abs(around - colour).sum(axis=2) < 30).any())


def test_found_rings_are_outlined_and_missing_ones_dashed(board: Pictures) -> None:
    """Each contour is in its face's colour, each centre in its sigma's; where a ring was left out there are dashes."""
    pixels, seen = board
    overlay = draw_overlay(pixels, seen, BOARD)
    scale = overlay.shape[1] // pixels.shape[1]
    top = np.array([0, header_height(overlay, pixels)])
    assert scale >= 1
    for ellipse, center, cov in zip(seen.ellipse_px, seen.center_px, seen.cov_px2, strict=True):
        for point in ellipse_points(ellipse, 8):
            assert is_near(overlay, (point + 0.5) * scale - 0.5 + top, FACE_COLOURS[0])
        assert is_near(overlay, (center + 0.5) * scale - 0.5 + top, sigma_colour(float(np.sqrt(cov[0, 0]))))
    missing = imaged_face(seen, BOARD, 0).missing_ellipse_px
    assert len(missing) == BOARD.ring_count - len(seen.ring)
    for ellipse in missing:
        marked = [is_near(overlay, (p + 0.5) * scale - 0.5 + top, MISSING) for p in ellipse_points(ellipse, 40)]
        assert np.mean(marked) > 0.2


@pytest.mark.parametrize("k1", [0.0, -0.25])
def test_missing_rings_are_expected_where_they_are(k1: float) -> None:
    """The place of a ring that was not found is right to a fifth of its radius, with a distorting lens too."""
    camera = Camera("opencv", np.array([700.0, 700, 599.5, 449.5, k1, 0, 0, 0, 0]), (1200, 900))
    pose = view_from((40, -60, 150))
    _, seen = sighting(BOARD, camera, pose, np.random.default_rng(3), found_share=0.75)
    truth = ring_truth(scene_from_target(BOARD), camera, pose)
    expected = imaged_face(seen, BOARD, 0).missing_ellipse_px
    lost = np.setdiff1d(np.flatnonzero(truth.whole), seen.ring)
    assert len(lost) >= 4
    off = np.linalg.norm(expected[:, None, :2] - truth.center_px[lost], axis=2).min(axis=0)
    assert (off < 0.2 * truth.minor_radius_px[lost]).all()


def test_rejected_things_are_crossed_out(board: Pictures) -> None:
    """Every ring-like thing without a name carries the warning colour."""
    pixels, seen = board
    places = np.array([[100.0, 80.0], [900.0, 700.0]])
    overlay = draw_overlay(pixels, replace(seen, rejected_px=places), BOARD)
    top = np.array([0, header_height(overlay, pixels)])
    scale = overlay.shape[1] // pixels.shape[1]
    assert all(is_near(overlay, (place + 0.5) * scale - 0.5 + top, REJECTED) for place in places)


def test_labels_cover_no_ring(ico: Pictures, board: Pictures) -> None:
    """Inside each outer contour nothing but the cross and the face number changes between indices and none."""
    for target, (pixels, seen) in ((BOARD, board), (ICO, ico)):
        renumbered = replace(target, ring_index=target.ring_index + 10)
        one = draw_overlay(pixels, seen, target)
        other = draw_overlay(pixels, seen, renumbered)
        assert one.shape == other.shape
        scale, top = one.shape[1] // pixels.shape[1], header_height(one, pixels)
        inside = np.zeros(one.shape[:2], np.uint8)
        for ellipse in seen.ellipse_px:
            points = (ellipse_points(ellipse, 40) + 0.5) * scale - 0.5 + [0, top]
            cv2.fillConvexPoly(inside, np.rint(points).astype(np.int32), 1)
        cover = (np.abs(one.astype(int) - other).sum(axis=2) > 0) & (inside > 0)
        # The axes' arrows go where index (0, 0) is, over rings if that is inside the lattice.
        assert cover.mean() / inside.mean() < 0.02


def test_neighbouring_faces_differ_in_colour() -> None:
    """No two faces of the icosahedron that share an edge have the same colour, and none is a warning's."""
    colours = face_colours(ICO)
    normals = ICO.target_from_face[:, :3, 2]
    for one in range(ICO.face_count):
        for other in range(one):
            if normals[one] @ normals[other] > 0.7:  # 41.8 degrees apart: an edge in common
                assert colours[one] != colours[other]
    assert not set(colours) & {MISSING, REJECTED}


def test_sigma_colours_grow_lighter_and_stop_at_the_ends() -> None:
    """The scale is monotone in lightness, so that it reads without colour vision, and clips outside its range."""
    low, high = SIGMA_RANGE_PX
    shades = np.array([sigma_colour(sigma) for sigma in np.geomspace(low, high, 30)])
    assert (np.diff(shades @ np.array([0.299, 0.587, 0.114])) > 0).all()
    assert sigma_colour(0.0) == sigma_colour(low) == sigma_colour(low / 10)
    assert sigma_colour(np.nan) == sigma_colour(high) == sigma_colour(10 * high)


def empty(target: TargetGeometry, size: tuple[int, int]) -> Detections:
    """Nothing found."""
    nothing = np.zeros((0, 2))
    return Detections(
        "a.png", size, target.layout_id, target.geometry_id, np.zeros(0), np.zeros((0, 3)), nothing,
        np.zeros((0, 2, 2)), np.zeros((0, 5)), (), ("no ring found",),
    )  # fmt: skip


@pytest.mark.parametrize("size", [(1, 1), (5, 700), (64, 48), (3000, 20)])
@pytest.mark.parametrize("dtype", [np.uint8, np.uint16])
def test_any_picture_without_target_is_drawn(size: tuple[int, int], dtype: type[np.unsignedinteger]) -> None:
    """The overlay of an empty photo of any shape has a header and a legend, and room for their text."""
    pixels = np.full(size[::-1], 7, dtype)
    overlay = draw_overlay(pixels, empty(ICO, size), ICO)
    assert overlay.dtype == np.uint8
    assert overlay.shape[1] >= max(720, size[0])
    assert overlay.shape[0] > size[1] + 40


@pytest.mark.parametrize("count", [1, 2, 3, 5])
def test_few_rings_are_drawn_too(count: int, board: Pictures) -> None:
    """One ring, or several in a line, tell no grid; what was found is drawn all the same."""
    pixels, seen = board
    j = BOARD.ring_index[seen.ring, 1]
    row = np.flatnonzero(j == np.bincount(j - j.min()).argmax() + j.min())[:count]
    few = seen.keep(row)
    overlay = draw_overlay(pixels, few, BOARD)
    scale, top = overlay.shape[1] // pixels.shape[1], np.array([0, header_height(overlay, pixels)])
    for ellipse in few.ellipse_px:
        assert is_near(overlay, (ellipse_points(ellipse, 4)[1] + 0.5) * scale - 0.5 + top, FACE_COLOURS[0])


def test_absurd_numbers_do_not_stop_the_picture(board: Pictures) -> None:
    """Rings far outside the picture, of no size or of not finite size are left out, not a crash."""
    pixels, seen = board
    ellipse = seen.ellipse_px.copy()
    ellipse[:4] = [[1e12, 0, 5, 5, 0], [np.nan] * 5, [300, 300, 0, 0, 0], [-50, -50, 1e9, 1e9, 1]]
    cov = seen.cov_px2.copy()
    cov[:2] = 1e9 * np.eye(2)
    draw_overlay(pixels, replace(seen, ellipse_px=ellipse, cov_px2=cov, rejected_px=np.array([[np.nan, 1e300]])), BOARD)


def test_long_and_odd_names_fit_the_header(board: Pictures) -> None:
    """Names of any length and bytes, and many remarks, make the header higher, never wider."""
    pixels, seen = board
    odd = replace(seen, image="x" * 300 + "\n\udcff.png", remarks=tuple("a remark of some length" for _ in range(30)))
    overlay, plain = draw_overlay(pixels, odd, BOARD), draw_overlay(pixels, seen, BOARD)
    assert overlay.shape[1] == plain.shape[1]
    assert overlay.shape[0] > plain.shape[0] + 40


def test_marks_are_placed_to_a_fraction_of_a_pixel() -> None:
    """A line's centre of gravity on an enlarged canvas is where the photo's coordinates say, to 0.1 px."""
    canvas = Canvas(np.zeros((120, 120, 3), np.uint8), np.zeros((41, 41), np.uint8), 3.0)
    canvas.line(np.array([[20.3, 5.0], [20.3, 35.0]]), (255, 255, 255), 3)
    weight = canvas.pixels[60, :, 0].astype(float)
    assert weight @ np.arange(120) / weight.sum() == pytest.approx((20.3 + 0.5) * 3 - 0.5, abs=0.1)


def test_text_fits_its_mask() -> None:
    """No letter is cut off: the rim of a text's mask is empty."""
    for text in ("0,0", "-12,7", "j", "Å|g"):
        mask = text_mask(text, 17)
        rim = np.concatenate([mask[0], mask[-1], mask[:, 0], mask[:, -1]])
        assert mask.max() > 128
        assert not rim.any()


def test_overlays_are_jpeg_with_colours_as_sharp_as_lightness(tmp_path: Path) -> None:
    """The suffix is that of the format; a red line one pixel wide stays red, and colours are in their order."""
    drawn = np.full((40, 60, 3), 230, np.uint8)
    drawn[:, 31] = (200, 40, 10)
    path = write_overlay(tmp_path / "a.overlay", drawn)
    assert path.name == "a.overlay.jpg"
    assert np.abs(cv2.imread(str(path))[:, :, ::-1].astype(int) - drawn).max() < 40


def test_very_long_pictures_are_drawn(tmp_path: Path) -> None:
    """A long strip is not enlarged beyond what a JPEG holds; one that is longer anyway is a PNG."""
    seen = empty(BOARD, (16, 20_000))
    assert max(draw_overlay(np.zeros((20_000, 16), np.uint8), seen, BOARD).shape) <= 65_535
    assert write_overlay(tmp_path / "a", np.zeros((70_000, 30, 3), np.uint8)).name == "a.png"
