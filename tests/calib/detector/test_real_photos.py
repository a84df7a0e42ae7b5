"""Real photos of plain ring sheets; they lie beside the repository and are not part of it."""

from functools import cache
from pathlib import Path

import cv2
import numpy as np
import pytest

from calib.core import homography
from calib.core.types import Detections
from calib.detector.lens import radial_lens, usable_groups
from calib.detector.pipeline import detect
from designer.base.arrays import Array
from designer.target import TargetGeometry
from tests.benchmarks.synthetic import target_of
from tests.support.ring_views import board

FOLDER = Path(__file__).parents[4] / "shared" / "real"
WALL, GLARE = FOLDER / "rings-10x7", FOLDER / "rings-4x3-glare"
ONE_ROW = FOLDER / "rendered-collinear" / "img_000.png"
pytestmark = pytest.mark.skipif(not FOLDER.is_dir(), reason="the folder ../shared/real with real photos is absent")


@cache
def found_in(path: Path, columns: int, rows: int) -> Detections:
    """What is found of a plain sheet."""
    pixels = np.asarray(cv2.imread(str(path), cv2.IMREAD_GRAYSCALE), dtype=np.uint8)
    return detect(pixels, board(dots=False, columns=columns, rows=rows), name=path.name)


def assert_on_a_smooth_grid(found: Detections, target: TargetGeometry, worst: float) -> None:
    """No place twice, and all near a plane seen through a simple lens: no farther off than a share of the pitch."""
    center = np.asarray(found.center_px)
    apart: Array = np.linalg.norm(center[:, None] - center[None], axis=2)
    np.fill_diagonal(apart, np.inf)
    major = np.asarray(found.ellipse_px)[:, 2]
    assert (apart.min(axis=1) > major).all()
    plane = target.center_in_face_mm[found.ring, :2]
    lens, _ = radial_lens(usable_groups([(plane, center)]), found.image_size)
    straight = lens.straighten(center)
    _, _, residual = homography.fit(plane, straight, np.ones(len(plane)))
    assert np.linalg.norm(residual, axis=1).max() < worst * np.median(apart.min(axis=1))
    # Not mirrored: i to the right and j up span the image clockwise, because v points down.
    slope = np.linalg.lstsq(plane - plane.mean(axis=0), center - center.mean(axis=0), rcond=None)[0]
    assert np.linalg.det(slope) < 0


@pytest.mark.parametrize("path", sorted(WALL.glob("*.png")), ids=lambda path: path.stem)
def test_all_rings_of_the_sheet_on_the_wall(path: Path) -> None:
    """All 70 rings, through strong barrel distortion, each once, and on a smooth grid."""
    found = found_in(path, 10, 7)
    assert len(found.ring) == 70
    assert len(np.unique(found.ring)) == 70
    assert_on_a_smooth_grid(found, board(dots=False, columns=10, rows=7), 0.1)


@pytest.mark.parametrize("path", sorted(GLARE.glob("*.png")), ids=lambda path: path.stem)
def test_no_ring_of_the_glossy_sheet_is_false(path: Path) -> None:
    """What is found of the hand-held sheet, lamps reflected in it, lies on its grid."""
    found = found_in(path, 4, 3)
    if len(found.ring) == 0:
        assert found.remarks
        return
    assert len(np.unique(found.ring)) == len(found.ring)
    assert_on_a_smooth_grid(found, board(dots=False, columns=4, rows=3), 0.12)


def test_nearly_all_photos_of_the_glossy_sheet_are_complete() -> None:
    """In at least 10 of 11 photos at least 11 of the 12 rings are found: glare hides one in some."""
    paths = sorted(GLARE.glob("*.png"))
    count = [len(found_in(path, 4, 3).ring) for path in paths]
    assert sum(rings >= 11 for rings in count) >= 10, dict(zip((path.stem for path in paths), count, strict=True))


def test_reported_sigmas_are_those_of_good_photos() -> None:
    """On real paper the reported uncertainty is some hundredths of a pixel: neither nothing nor a pixel."""
    paths = sorted(WALL.glob("*.png"))
    if not paths:
        pytest.skip("no photos of the sheet on the wall")
    cov = np.concatenate([found_in(path, 10, 7).cov_px2 for path in paths])
    sigma = np.sqrt(np.trace(cov, axis1=1, axis2=2) / 2)
    assert 0.003 < np.median(sigma) < 0.05


@pytest.mark.skipif(not ONE_ROW.is_file(), reason="no path-traced photo")
def test_a_face_that_shows_one_row_does_not_cost_the_photo() -> None:
    """A sharp photo of many faces, one of which shows a single row of rings, keeps all other faces."""
    pixels = np.asarray(cv2.imread(str(ONE_ROW), cv2.IMREAD_GRAYSCALE), dtype=np.uint8)
    assert len(detect(pixels, target_of("ico 100 mm"), name=ONE_ROW.name).ring) >= 150
