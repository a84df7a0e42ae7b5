"""Files for print shops: boxes, colours and the cut as shops look for them, and dots where the target has them."""

import base64
import io
import re
import zlib

import numpy as np
import pytest
from PIL import Image

from designer.builds.design import EXPORTERS, Design
from tests.support.designs import design_of

MM = 25.4 / 72
BOARD = design_of("board", size="60x50mm", columns=5, rows=4, ring_diameter="7mm", pitch="10mm", build="sheet")
BOTH = design_of(
    "board", size="60x50mm", columns=5, rows=4, ring_diameter="7mm", pitch="10mm", two_sided=True, build="sheet"
)


def files_of(design: Design) -> dict[str, bytes]:
    return {suffix: content for suffix, content, _ in EXPORTERS["shop"](design)}


def boxes(pdf: bytes, name: str) -> list[list[float]]:
    """Of each page, in mm."""
    found = re.findall(rb"/" + name.encode() + rb" \[([^\]]*)\]", pdf)
    return [[MM * float(number) for number in one.split()] for one in found]


def operators(pdf: bytes) -> str:
    streams = re.findall(rb"ASCII85Decode.*?stream\r?\n(.*?)~>\s*endstream", pdf, re.DOTALL)
    return "".join(zlib.decompress(base64.a85decode(one.strip())).decode("latin-1") for one in streams)


@pytest.mark.parametrize("design", [BOARD, BOTH], ids=["one side", "two sides"])
def test_boxes_are_the_finished_size_and_the_bleed(design: Design) -> None:
    """A page a side, of one size; TrimBox is the board, BleedBox 3 mm more, in the same place on both."""
    pdf = files_of(design)["shop.pdf"]
    trims, bleeds, media = (boxes(pdf, name) for name in ("TrimBox", "BleedBox", "MediaBox"))
    assert len(trims) == design.target.face_count
    for trim, bleed, page in zip(trims, bleeds, media, strict=True):
        np.testing.assert_allclose([trim[2] - trim[0], trim[3] - trim[1]], (60, 50), atol=1e-3)
        np.testing.assert_allclose(np.array(bleed) - trim, (-3, -3, 3, 3), atol=1e-3)
        assert page[0] < bleed[0]
        assert bleed[2] < page[2]
    assert np.ptp(trims, axis=0).max() < 1e-6


def test_black_is_black_ink_alone_and_the_cut_a_spot_colour() -> None:
    """No other ink is on the page; the cut is stroked in CutContour, which overprints."""
    pdf = files_of(BOARD)["shop.pdf"]
    text = operators(pdf)
    assert set(re.findall(r"([\d. ]+) (?:k|K)\b", text)) == {"0 0 0 1"}
    assert not re.search(r" (?:rg|RG|g|G)\b", text.replace("0 0 0 1 k", ""))
    assert "/CutContour CS" in text
    assert b"/Separation /CutContour" in pdf
    assert b"/OP true" in pdf


@pytest.mark.parametrize("design", [BOARD, design_of("ico", edge="40mm", build="stickers")], ids=["board", "ico"])
def test_dots_of_pictures_are_where_the_target_has_rings(design: Design) -> None:
    """Each TIFF is of 1200 dpi, black or white, as large as its face; a ring's centre is right to 5 um."""
    files = {name: one for name, one in files_of(design).items() if name.endswith("tif")}
    assert len(files) == design.target.face_count
    picture = Image.open(io.BytesIO(next(iter(files.values()))))
    assert picture.mode == "1"
    assert tuple(picture.info["dpi"]) == (1200, 1200)
    ink, per_mm = ~np.asarray(picture), 1200 / 25.4
    outline = design.target.outline_mm[0]
    np.testing.assert_allclose(picture.size, np.ptp(outline, axis=0) * per_mm, atol=1)
    low, high = outline.min(axis=0), outline.max(axis=0)
    for ring in np.flatnonzero(design.target.ring_face == 0).tolist():
        x, y = design.target.center_in_face_mm[ring, :2]
        u, v = (x - low[0]) * per_mm - 0.5, (high[1] - y) * per_mm - 0.5
        reach = int(1.02 * design.target.radius_outer_mm[ring] * per_mm)
        rows, columns = np.mgrid[int(v) - reach : int(v) + reach + 2, int(u) - reach : int(u) + reach + 2]
        part = ink[rows, columns] & (np.hypot(columns - u, rows - v) < reach)
        off = np.array([(part * columns).sum(), (part * rows).sum()]) / part.sum() - (u, v)
        assert np.linalg.norm(off) / per_mm < 0.005
