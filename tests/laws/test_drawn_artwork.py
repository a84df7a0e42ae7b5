"""What lasers and board houses draw shows the detector the target."""

from pathlib import Path

import numpy as np
import pytest
from numpy.typing import NDArray
from PIL import Image

import calib
from designer.produce import Design
from designer.spec.build import Format
from tests.support.flat_files import circles, dxf_of, flat, gerbers_of

pytestmark = pytest.mark.filterwarnings("ignore:.*deprecated")  # in the readers of others

PX_PER_MM = 20


def detected(grey: NDArray[np.uint8], design: Design, within_px: float) -> float:
    """The share of rings that are found in drawn artwork, all of them where they were drawn."""
    found = calib.detect(grey, design.target)
    scale = np.polyfit(design.target.center_mm[found.ring, 0], found.center_px[:, 0], 1)
    assert np.abs(np.polyval(scale, design.target.center_mm[found.ring, 0]) - found.center_px[:, 0]).max() < within_px
    return len(found.ring) / design.target.ring_count


@pytest.mark.parametrize(("suffix", "ink"), [("gerber", ".gto"), ("gerber-mask", ".gts")])
def test_drawn_gerber_is_detected_with_all_rings(suffix: Format, ink: str, tmp_path: Path) -> None:
    """Artwork as PyGerber draws it shows the detector every ring; drawn areas are ink, or openings in it."""
    design = flat("board", suffix)
    layers = gerbers_of(design, f"{suffix}.zip", tmp_path)
    picture = tmp_path / "drawn.png"
    layers[ink].render_raster(str(picture), dpmm=PX_PER_MM)
    drawn = np.asarray(Image.open(picture).convert("L"))
    grey = np.where(drawn == drawn[0, 0], 255, 0).astype(np.uint8)  # of the first pixel's colour is what is white
    assert detected(np.pad(grey, 60, constant_values=255), design, within_px=0.6) == 1  # it draws on whole pixels


def test_drawn_dxf_is_detected_with_all_rings() -> None:
    """What a laser fills, all circles under the even-odd rule, shows the detector every ring."""
    design = flat("board", "dxf")
    drawn = circles(dxf_of(design))
    size = (np.ptp(design.target.outline_mm[0], axis=0) * PX_PER_MM).astype(int)
    fine = 4
    x, y = ((np.arange(fine * count) + 0.5) / (fine * PX_PER_MM) for count in size.tolist())
    dark = np.zeros((len(y), len(x)), dtype=bool)
    for cx, cy, radius in drawn.tolist():
        rows, columns = (np.flatnonzero(np.abs(axis - at) <= radius) for axis, at in ((y, cy), (x, cx)))
        inside = (x[columns] - cx) ** 2 + (y[rows, None] - cy) ** 2 <= radius**2
        dark[np.ix_(rows, columns)] ^= inside
    share = dark[::-1].reshape(size[1], fine, size[0], fine).mean(axis=(1, 3))
    grey = np.pad((255 * (1 - share)).astype(np.uint8), 60, constant_values=255)
    assert detected(grey, design, within_px=0.05) == 1
