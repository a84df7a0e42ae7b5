"""Files that are sheared against a printer's skew: with `--skew-compensation` the print is the design."""

import io
import math
import re
from pathlib import Path

import numpy as np
import pytest
import trimesh
from hypothesis import given
from hypothesis import strategies as st
from numpy.typing import NDArray

from designer.base.arrays import Array
from designer.base.errors import InputError
from designer.base.units import MOST_SKEW_DEG, NO_SKEW, Skew, format_skew, parse_skew_rad
from designer.builds.design import Design, make_files
from designer.formats.stl import stl_bytes
from designer.kinds.sizing import size_job
from designer.kinds.spec_file import RawValue, parse_spec
from designer.make.bed import bed_from_target, printed_corners_mm, printed_size_mm
from designer.make.mesh import Mesh
from designer.make.printability import check_printability
from designer.tolerance.shape import shape_of
from designer.tolerance.sources import SOURCES
from tests.support import command_line

SKEW_TEXT = "xy 0.5deg, xz -0.7deg, yz 0.3deg"
SKEW: Skew = (math.radians(0.5), math.radians(-0.7), math.radians(0.3))
ICO: dict[str, RawValue] = {"kind": "ico", "edge": "30mm", "chord_error": "50um"}
BOARD: dict[str, RawValue] = {"kind": "board", "size": "90x50mm", "pitch": "10mm", "chord_error": "50um"}
CASES: dict[str, dict[str, RawValue]] = {
    "ico": ICO,
    "shrunk ico on a deep bed": {**ICO, "bed": "200x300x200mm", "shrink_compensation": "1%"},
    "stickers": {**ICO, "build": "stickers"},
    "board": BOARD,
    "board on a deep bed": {**BOARD, "bed": "200x300x200mm", "border": "3mm"},
}
lean = st.floats(-math.radians(MOST_SKEW_DEG), math.radians(MOST_SKEW_DEG))


def design_of(values: dict[str, RawValue], skew: str = "0") -> Design:
    """A design as a spec file asks for it."""
    return Design(size_job(parse_spec({**values, "skew_compensation": skew}, "")).job)


@pytest.fixture(params=CASES, scope="module")
def pair(request: pytest.FixtureRequest) -> tuple[Design, Design]:
    """A design without and with skew compensation."""
    return design_of(CASES[request.param]), design_of(CASES[request.param], SKEW_TEXT)


def meshes_of(design: Design) -> list[Mesh]:
    """Body and, if it is printed, ink."""
    return [design.part.body] if design.part.ink is None else [design.part.body, design.part.ink]


def vertices_of(design: Design) -> Array:
    """Of all that is printed, in the target frame.  # (V, 3)"""
    return np.concatenate([mesh.vertices_mm for mesh in meshes_of(design)])


def on_bed(design: Design, points_mm: Array) -> Array:
    """Points as the 3MF files lay them.  # (N, 3)"""
    motion = bed_from_target(design.target, design.job.printing)
    return points_mm @ motion[:3, :3].T + motion[:3, 3]


def printed(design: Design, points_mm: Array, skew_rad: Skew) -> Array:
    """What a printer with this skew makes of a file's points, by the error model of `design tolerance`.  # (N, 3)"""
    lay = bed_from_target(design.target, design.job.printing)
    shape = SOURCES["skew"].apply(shape_of(design.target, lay), np.array([skew_rad]))
    affine = shape.bed_axes.T @ shape.bed_affine @ shape.bed_axes
    return points_mm @ affine.T


# The law.


def test_a_skew_printer_makes_the_design_of_compensated_files(pair: tuple[Design, Design]) -> None:
    """Compensated, then skewed by as much, every vertex and corner is where an exact printer has it."""
    plain, sheared = pair
    np.testing.assert_allclose(printed(sheared, vertices_of(sheared), SKEW), vertices_of(plain), rtol=0, atol=1e-9)
    corners = printed_corners_mm(sheared.target, sheared.job.printing)
    expected = printed_corners_mm(plain.target, plain.job.printing)
    np.testing.assert_allclose(printed(sheared, corners, SKEW), expected, rtol=0, atol=1e-9)
    assert np.abs(vertices_of(sheared) - vertices_of(plain)).max() > 0.1


def test_meshes_stay_closed_in_stl(pair: tuple[Design, Design]) -> None:
    """As much volume, and closed when corners are welded in single precision."""
    for before, after in zip(*map(meshes_of, pair), strict=True):
        assert after.volume_mm3 == pytest.approx(before.volume_mm3, rel=1e-9)
        assert trimesh.load_mesh(io.BytesIO(stl_bytes(after)), file_type="stl").is_watertight


def stl_corners(data: bytes) -> NDArray[np.float32]:
    """Corners of a binary STL file.  # (T, 3, 3)"""
    facets = np.frombuffer(data[84:], dtype=np.dtype([("n", "<f4", 3), ("c", "<f4", (3, 3)), ("a", "<u2")]))
    return np.array(facets["c"])


# Placement and files.


def test_the_part_lies_on_the_bed(pair: tuple[Design, Design]) -> None:
    """Not turned by the shear, its last face down at z = 0, centred; the size told is that of the sheared part."""
    plain, sheared = pair
    motion, straight = (bed_from_target(one.target, one.job.printing) for one in (sheared, plain))
    np.testing.assert_array_equal(motion[:3, :3], straight[:3, :3])
    lying = on_bed(sheared, vertices_of(sheared))
    low, high = lying.min(axis=0), lying.max(axis=0)
    assert low[2] == pytest.approx(0.0, abs=1e-9)
    assert (low + high)[:2] / 2 == pytest.approx(np.array(sheared.job.printing.printer.bed_mm[:2]) / 2)
    assert high - low == pytest.approx(np.array(printed_size_mm(sheared.target, sheared.job.printing)))
    assert np.abs(high - low - printed_size_mm(plain.target, plain.job.printing))[:2].max() > 0.05


def test_the_bed_must_hold_the_sheared_part() -> None:
    """A plate that just fits does not any more, when a lean of 2 deg makes it 1.7 mm wider."""
    values = {**BOARD, "bed": "91x51x50mm"}
    for skew, fits in (("0", True), ("xy 2deg", False)):
        design = design_of(values, skew)
        check = check_printability(design.target, design.job.printing)
        assert ("bed" not in {finding.rule for finding in check.violations}) == fits


@pytest.mark.parametrize(
    ("values", "changed"),
    [
        ({"build": "stickers", "stand": True, "formats": "pdf,svg"}, {"t.toml", "t.body.stl"}),
        (
            {"stand": True, "formats": "glb"},
            {"t.toml", "t.body.stl", "t.pattern.stl", "t.prusa.3mf", "t.bambu.3mf", "t.glb"},
        ),
    ],
)
def test_only_solids_are_sheared(values: dict[str, RawValue], changed: set[str]) -> None:
    """Target file, stand, preview and artwork stay as they are."""
    plain, sheared = (files_of(design_of({**ICO, "name": "t", **values}, skew)) for skew in ("0", SKEW_TEXT))
    assert plain.keys() == sheared.keys()
    assert {name for name in plain if plain[name] != sheared[name]} == changed


def files_of(design: Design) -> dict[str, bytes]:
    """All files of a design by name."""
    return {file.name: file.content for file in make_files(design, lambda _: None)}


@pytest.mark.parametrize("name", ["ico", "stickers", "board"])
def test_stl_files_lie_as_they_must_be_printed(name: str) -> None:
    """STL says nothing of the bed: the part is laid on it as it is printed, last face down, about the same middle."""
    plain, sheared = design_of(CASES[name]), design_of(CASES[name], SKEW_TEXT)
    for design in (plain, sheared):
        body = stl_corners(files_of(design)[f"{design.job.name}.body.stl"]).reshape(-1, 3)
        expected = design.part.body.vertices_mm[design.part.body.triangles].reshape(-1, 3)
        lying = on_bed(design, expected)
        expected = lying - bed_from_target(design.target, design.job.printing)[:3, 3] * [1, 1, 0]
        assert body[:, 2].min() == pytest.approx(0.0, abs=1e-4)
        np.testing.assert_allclose(body, expected, rtol=0, atol=1e-5)


# Text.


@given(st.tuples(lean, lean, lean))
def test_text_reads_back_exactly(skew_rad: Skew) -> None:
    """What is written of any angles is read as the same angles, to the bit."""
    assert parse_skew_rad(format_skew(skew_rad)) == skew_rad


@pytest.mark.parametrize(
    ("text", "skew_rad"),
    [
        ("0", NO_SKEW),
        (0, NO_SKEW),
        (" xy 0 ", NO_SKEW),
        (SKEW_TEXT, SKEW),
        ("yz 0.3, XY 0.5 °,xz   -0.7deg", SKEW),
        ("xz -2mrad", (0.0, -0.002, 0.0)),
        ("yz 2deg", (0.0, 0.0, math.radians(2))),
    ],
)
def test_text_as_it_is_typed(text: str | float, skew_rad: Skew) -> None:
    """In any order, what is left out is zero, a bare number is in degrees."""
    assert parse_skew_rad(text) == skew_rad


@pytest.mark.parametrize(
    ("values", "skew", "message"),
    [
        (ICO, "xy 3deg", "xy must be from -2deg to 2deg; square"),
        (ICO, "xy 0.1deg, yz -2.01deg", "yz must be from -2deg"),
        (ICO, "xy 0.1deg, xy 0.2deg", "xy is given twice"),
        (ICO, "zx 0.1deg", "expected angles such as xy 0.02deg"),
        (ICO, "", "expected angles such as"),
        (ICO, "xy 0.1deg,", "expected angles such as"),
        (ICO, "xy 0.1mm", "xy: unit 'mm' does not fit"),
        (ICO, "xy nan", "xy: not a finite number"),
        (ICO, 0.3, "expected angles such as"),
        (ICO, [0.0, 0.0, 0.0], "expected angles such as"),
        ({**BOARD, "build": "sheet"}, SKEW_TEXT, "a sheet has none; leave it out"),
        ({**ICO, "formats": ["step"]}, SKEW_TEXT, "not STEP; leave out .* 3mf, painted, stl, png, pdf, svg, glb"),
    ],
)
def test_refusals(values: dict[str, RawValue], skew: RawValue, message: str) -> None:
    """One line with the value, the rule and the remedy."""
    with pytest.raises(InputError) as error:
        size_job(parse_spec({**values, "skew_compensation": skew}, ""))
    text = str(error.value)
    assert re.search(message, text)
    assert text.startswith("skew")
    assert "\n" not in text


def test_the_command_says_it(tmp_path: Path) -> None:
    """The option is one of `design`; the summary names it."""
    answer = command_line.design(
        "ico", "--edge", "20mm", "--formats", "stl", "--skew-compensation", "yz -0.1deg", "-o", tmp_path / "a"
    )
    assert answer.code == 0
    assert "sheared against yz -0.1deg" in answer.out
