"""Automatic sizes, and which sizes are refused."""

import math
import re
import tomllib

import pytest
from hypothesis import assume, given, settings
from hypothesis import strategies as st

from designer.base.errors import InputError
from designer.kinds.board import BoardSpec
from designer.kinds.ico import IcoSpec
from designer.kinds.layout import border_width_mm, lay_out, narrowest_widths
from designer.kinds.presets import preset_names
from designer.kinds.sizing import Sized, size_job
from designer.kinds.spec_file import RawValue, parse_spec, spec_to_toml
from designer.spec.options import widths_mm
from designer.spec.spec import Spec

TOO_LITTLE = "size, or its rings and their distance; give --size 200x200mm, or --columns 10 --rows 7 --pitch 20mm"
LINES = {"0.2mm": 0.22, "0.4mm": 0.45}  # nozzle: width of its line, in all profiles


def sized(**values: RawValue) -> Sized:
    return size_job(parse_spec(values, ""))


def ico(**values: RawValue) -> IcoSpec:
    spec = sized(kind="ico", **values).job.target
    assert isinstance(spec, IcoSpec)
    return spec


def board(**values: RawValue) -> BoardSpec:
    spec = sized(kind="board", **values).job.target
    assert isinstance(spec, BoardSpec)
    return spec


def sized_or_refusal(**values: RawValue) -> Sized | str:
    """The sizes, or the one line that refuses the values."""
    try:
        return sized(**values)
    except InputError as error:
        message = str(error)
    assert len(message.splitlines()) == 1
    assert not re.search(r"\s-\d|\bnan|\binf\b|\b0mm at pitch", message)
    return message


def refusal(kind: str, **values: RawValue) -> str:
    """The one line that refuses the values."""
    message = sized_or_refusal(kind=kind, **values)
    assert isinstance(message, str)
    return message


def without_none(**values: RawValue | None) -> dict[str, RawValue]:
    """The values that are given."""
    return {key: value for key, value in values.items() if value is not None}


def named(message: str, before: str) -> float:
    """The length that a message names after some words."""
    return float(message.split(before)[1].split("mm", maxsplit=1)[0])


def least_width_mm(spec: Spec) -> float:
    """The least of strokes, centres, gaps, margin and border as laid out, the border only where there is one."""
    target = lay_out(spec)
    widths = narrowest_widths(target)
    border = [widths.border_mm] if spec.border_mm else []
    return min(widths.stroke_mm, widths.centre_mm, widths.gap_mm, widths.margin_mm, *border)


# --- automatic sizes -------------------------------------------------------------------------------------------------


def test_edge_100_is_the_papers_target() -> None:
    """Edge 100 mm alone gives the paper's 8 rings a side of 7 mm at 10 mm inside a border of 2 mm: 720 in all."""
    spec = ico(edge="100mm")
    assert (spec.rings_per_side, spec.ring_diameter_mm, spec.pitch_mm, spec.border_mm) == (8, 7.0, 10.0, 2.0)
    assert spec.ring_ratio == 0.45
    assert lay_out(spec).ring_count == 720
    assert "as in the paper" in sized(kind="ico", edge="100mm").remarks[0]


@given(st.floats(50, 2000), st.sampled_from(["0.2mm", "0.4mm"]))
@settings(max_examples=30, deadline=None)
def test_large_edges_keep_the_papers_proportions(edge_mm: float, nozzle: str) -> None:
    """From about 50 mm on, D = 0.07 edge, C = 0.1 edge and border 0.02 edge, to drawing precision."""
    spec = ico(edge=edge_mm, nozzle=nozzle)
    assert spec.rings_per_side == 8
    assert spec.border_mm == pytest.approx(max(0.02 * edge_mm, 2 * LINES[nozzle]), abs=1e-4)
    assume(spec.border_mm == pytest.approx(0.02 * edge_mm, abs=1e-4))
    assert spec.pitch_mm == pytest.approx(0.1 * edge_mm, abs=0.011)
    assert spec.ring_diameter_mm == pytest.approx(0.07 * edge_mm, abs=0.02)


edges = st.floats(3, 200)
nozzles = st.sampled_from(["0.2mm", "0.4mm"])


@given(edges, nozzles)
@settings(max_examples=60, deadline=None)
def test_automatic_sizes_keep_their_rules(edge_mm: float, nozzle: str) -> None:
    """All widths are two lines with 5 to 8 rings a side; or one line with 5, and a warning; or there is an error.

    The named smallest edge lies above the edge that is refused.
    """
    line = LINES[nozzle]
    result = sized_or_refusal(kind="ico", edge=edge_mm, nozzle=nozzle)
    if isinstance(result, str):
        assert named(result, "use at least ") > edge_mm
        return
    spec = result.job.target
    assert isinstance(spec, IcoSpec)
    least = least_width_mm(spec)
    if "one line" in result.remarks[0]:
        assert spec.rings_per_side == 5
        assert line - 1e-6 <= least < 2 * line
    else:
        assert 5 <= spec.rings_per_side <= 8
        assert least >= 2 * line - 1e-6


@given(edges, st.floats(0, 30), nozzles)
@settings(max_examples=60, deadline=None)
def test_larger_edges_carry_no_fewer_rings(edge_mm: float, more_mm: float, nozzle: str) -> None:
    """A larger edge never gives fewer rings, nor one line where a smaller one had two, nor an error."""
    smaller = sized_or_refusal(kind="ico", edge=edge_mm, nozzle=nozzle)
    assume(not isinstance(smaller, str))
    larger = sized(kind="ico", edge=edge_mm + more_mm, nozzle=nozzle)
    assert larger.job.target.rings_per_side >= smaller.job.target.rings_per_side
    assert "one line" in smaller.remarks[0] or "one line" not in larger.remarks[0]


@pytest.mark.parametrize("given_width", ["border", "margin"])
def test_a_given_width_does_not_narrow_the_others(given_width: str) -> None:
    """A border or margin asked for at one line leaves strokes and gaps as wide, and rings as many, as without it."""
    spec = ico(edge="100mm", **{given_width: "0.45mm"})
    assert spec.rings_per_side == 8
    assert min(widths_mm(spec)) >= 0.9


def test_two_lines_everywhere_need_about_29_mm() -> None:
    """With a 0.4 mm nozzle, 29 mm is about the smallest edge whose widths are all two lines (the facts' figure)."""
    assert "one line" in sized(kind="ico", edge="28mm").remarks[0]
    assert "one line" not in sized(kind="ico", edge="29mm").remarks[0]


@pytest.mark.parametrize("nozzle", LINES)
def test_edge_20_just_works(nozzle: str) -> None:
    """`design ico --edge 20mm` works with both nozzles: 5 rings a side with 0.4 mm, more with 0.2 mm."""
    spec = ico(edge="20mm", nozzle=nozzle)
    assert spec.rings_per_side == (5 if nozzle == "0.4mm" else 7)
    assert widths_mm(spec)[0] > {"0.4mm": 0.6, "0.2mm": 0.44}[nozzle]


@given(
    nozzle=nozzles,
    border=st.none() | st.floats(0.4, 20),
    margin=st.none() | st.floats(0.01, 20),
    ratio=st.none() | st.floats(0.2, 0.8),
    build=st.sampled_from(["one-piece", "stickers"]),
)
@settings(max_examples=40, deadline=None)
def test_named_smallest_edge_is_the_smallest(
    nozzle: str, border: float | None, margin: float | None, ratio: float | None, build: str
) -> None:
    """The smallest edge in the error works, and one 0.2 mm smaller does not."""
    values = without_none(border=border, margin=margin, ring_ratio=ratio, nozzle=nozzle, build=build)
    smallest = named(refusal("ico", edge="1mm", **values), "use at least ")
    assert isinstance(sized_or_refusal(kind="ico", edge=smallest, **values), Sized)
    refusal("ico", edge=smallest - 0.2, **values)


# --- given sizes -----------------------------------------------------------------------------------------------------


def test_given_sizes_are_kept() -> None:
    """Edge, diameter and pitch as given; as many rings as fit, and m when it is given."""
    spec = ico(edge="100mm", ring_diameter="7mm", pitch="10mm")
    assert (spec.edge_mm, spec.ring_diameter_mm, spec.pitch_mm, spec.rings_per_side) == (100, 7, 10, 8)
    assert ico(edge="100mm", ring_diameter="5mm", pitch="7.2mm", rings_per_side=6).rings_per_side == 6
    assert ico(edge="133mm", ring_diameter="10.5mm", pitch="13.2mm").rings_per_side == 8
    assert ico(edge="106.5mm", ring_diameter="7mm", pitch="10mm").rings_per_side == 8


@given(
    st.floats(30, 120),
    st.floats(0.02, 0.08),
    st.floats(1.15, 2.5),
    st.none() | st.floats(0.5, 5),
    st.none() | st.floats(0, 5),
)
@settings(max_examples=40, deadline=None)
def test_given_sizes_fit_or_are_refused(
    edge_mm: float, diameter_ratio: float, pitch_ratio: float, border: float | None, margin: float | None
) -> None:
    """What is accepted lies inside the window with its margin; one more ring a side would not."""
    diameter_mm = edge_mm * diameter_ratio
    sizes = {"edge": edge_mm, "ring_diameter": diameter_mm, "pitch": diameter_mm * pitch_ratio}
    sizes |= without_none(border=border, margin=margin)
    assume(not isinstance(sized_or_refusal(kind="ico", **sizes), str))
    spec = ico(**sizes)
    clearance = narrowest_widths(lay_out(spec)).margin_mm
    assert clearance >= spec.margin_mm - 1e-6
    assert clearance > 0
    # A ring more moves the outermost towards the sides by a third of a row's height.
    assert clearance - spec.pitch_mm / (2 * math.sqrt(3)) < spec.margin_mm + 1e-6


@given(
    st.floats(6, 60),
    st.floats(1, 20),
    st.floats(1.1, 2.5),
    st.none() | st.floats(0.5, 5),
    st.none() | st.floats(0.5, 5),
)
@settings(max_examples=60, deadline=None)
def test_largest_ring_and_smallest_edge_named_work(
    edge_mm: float, diameter_mm: float, pitch_ratio: float, border: float | None, margin: float | None
) -> None:
    """Rings that cannot be five a side: the largest ring with its pitch, and the smallest edge, that are named, work.

    Only an edge is named where no ring that can be printed would fit.
    """
    values = without_none(border=border, margin=margin)
    pitch_mm = diameter_mm * pitch_ratio
    rings = {"ring_diameter": diameter_mm, "pitch": pitch_mm}
    message = sized_or_refusal(kind="ico", edge=edge_mm, **rings, **values)
    assume(isinstance(message, str) and "cannot carry" in message)
    if "rings of at most" in message:
        offer = message.split("; ")[1]
        largest, its_pitch = named(offer, "rings of at most "), named(offer, "at pitch ")
        assert ico(edge=edge_mm, ring_diameter=largest, pitch=its_pitch, **values).rings_per_side >= 5
    edge = named(message, "an edge of at least ")
    assert ico(edge=edge, **rings, **values).rings_per_side >= 5
    refusal("ico", edge=edge - 0.2, **rings, **values)


@pytest.mark.parametrize(
    ("kind", "values", "message"),
    [
        ("ico", {"edge": 100, "rings_per_side": 4}, "rings_per_side 4 is too few .* use at least 5"),
        ("ico", {"edge": 100, "ring_diameter": 7, "pitch": 6}, "6mm makes rings of 7mm touch; use at least 7.9mm"),
        ("ico", {"edge": 100, "ring_diameter": 7, "pitch": 7.2}, "leaves 0.2mm between .* use at least 7.9mm"),
        ("ico", {"edge": 100, "ring_diameter": 1, "pitch": 3}, "stroke of 0.275mm, thinner than .* at least 1.64mm"),
        ("ico", {"edge": 100, "ring_ratio": 0.2, "ring_diameter": 1.5, "pitch": 3}, "white centre of 0.3mm"),
        ("ico", {"edge": 100, "border": 0.1}, "border 0.1mm .* use at least 0.45mm"),
        ("ico", {"edge": 100, "border": 40}, "edge 100mm with border 40mm is too small .* use at least 151.4mm"),
        ("ico", {"edge": 100, "border": 40, "rings_per_side": 5}, "no room inside a border of 40mm"),
        ("ico", {"edge": 100, "ring_diameter": 7, "pitch": 10, "rings_per_side": 9}, "9 rings .* at most 8 rings"),
        ("ico", {"edge": 100, "build": "sheet"}, "build 'sheet' is not for 'ico'; use 'stickers' or 'recessed' or"),
        ("ico", {"edge": 100, "build": "relief"}, "at one; use 'stickers' or 'recessed' or 'one-piece' or 'tiles'"),
        ("ico", {"edge": 100, "build": "stickers", "sticker_thickness": 4}, "sticker thickness 4mm .* at most"),
        ("board", {"bed": "40x40x40mm"}, "a board of 30x10mm holds .* use a larger board"),
        ("board", {"columns": 10, "rows": 7}, TOO_LITTLE),
        ("board", {"size": "30x30mm", "pitch": 10}, r"30x30mm holds 2 x 2 rings at pitch 10mm; it must hold 3 x 3"),
        ("board", {"columns": 2, "rows": 5, "pitch": 10}, "it must hold 3 x 3"),
        ("board", {"size": "60x60mm", "pitch": 10, "columns": 7}, "need 72 x 62mm|more than the board's 60x60mm"),
        ("board", {"size": "60x60mm", "pitch": 10, "border": 0.3}, "border 0.3mm .* use 0 for none or at least"),
        ("board", {"size": "60x60mm", "pitch": 10, "margin": 0}, "margin 0mm lets rings touch"),
        ("board", {"size": "10x10m", "pitch": 5}, r"rings are more than \d+; use a larger pitch"),
        ("board", {"size": "60x60mm", "pitch": 10, "ring_diameter": 12}, "touch; use at least 12.9mm"),
        ("board", {"size": "60x60mm", "build": "sheet", "shrink_compensation": 1}, "a sheet has none; leave it out"),
        ("board", {"size": "60x60mm", "build": "stickers"}, "build 'stickers' is not for 'board'"),
    ],
)
def test_impossible_sizes_are_refused(kind: str, values: dict[str, RawValue], message: str) -> None:
    """One line with value, rule and remedy."""
    assert re.search(message, refusal(kind, **values))


@pytest.mark.parametrize("printer", preset_names("printers"))
def test_a_board_of_which_nothing_is_said_fits_the_bed(printer: str) -> None:
    """About A4; less where the bed, with a brim around the board and a prime tower beside it, is smaller; and said."""
    result = sized(kind="board", printer=printer)
    spec, (*bed, _) = board(printer=printer), result.job.printing.printer.bed_mm
    (width, height), (longer, shorter) = spec.size_mm, sorted(bed, reverse=True)
    assert 100 <= height <= min(200, shorter - 45)
    assert 100 <= width <= min(280, longer - 10)
    assert width == 280 or width + 10 > longer - 10
    assert f"board {width:g}x{height:g}mm (" in result.remarks[0]
    assert result.job.name == f"board-{width:g}x{height:g}mm"


@pytest.mark.parametrize("values", [{"size": "200x200mm"}, {"columns": 10, "rows": 7, "pitch": "20mm"}])
def test_what_a_board_needs_is_enough(values: dict[str, RawValue]) -> None:
    """Both ways that the refusal of an incomplete board offers give a board, with at least 5 x 5 rings."""
    assert min(board(**values).columns, board(**values).rows) >= 5


@pytest.mark.parametrize(
    "values",
    [
        {"kind": "board", "size": "200x200mm"},
        {"kind": "board", "size": "200x200mm", "ring_diameter": "7mm", "thickness": "3mm"},
        {"kind": "board", "columns": 10, "rows": 7, "pitch": "20mm", "margin": "4mm"},
        {"kind": "ico", "edge": "100mm", "pitch": "10mm"},
        {"kind": "ico", "edge": "100mm", "rings_per_side": 7, "border": "3mm"},
    ],
)
def test_every_size_that_was_chosen_is_said(values: dict[str, RawValue]) -> None:
    """The remark names each size that was not given, with its value, and none that was; given again, none is left."""
    result = sized(**values)
    spec = result.job.target
    numbers = {
        "pitch": f"pitch {spec.pitch_mm:g}mm (",
        "ring_diameter": f"rings of {spec.ring_diameter_mm:g}mm (",
        "margin": f"margin {spec.margin_mm:g}mm (",
    }
    if isinstance(spec, BoardSpec):
        numbers |= {
            "thickness": f"thickness {spec.thickness_mm:g}mm (",
            "columns": f"{spec.columns} x {spec.rows} rings (",
            "size": f"board {spec.size_mm[0]:g}x{spec.size_mm[1]:g}mm (",
        }
    else:
        numbers |= {
            "border": f"border {spec.border_mm:g}mm (",
            "rings_per_side": f"{spec.rings_per_side} rings a side (",
        }
    said = {name for name, words in numbers.items() if words in result.remarks[0]}
    assert said == numbers.keys() - values.keys()
    again = sized(**tomllib.loads(spec_to_toml(result.job)))
    assert again.remarks[0] == "sizes: as given"


def test_named_remedies_work() -> None:
    """The pitch, diameter and count that messages offer are accepted."""
    pitch = named(refusal("ico", edge=100, ring_diameter=7, pitch=6), "use at least ")
    assert ico(edge=100, ring_diameter=7, pitch=pitch).pitch_mm == pitch
    pitch = named(refusal("ico", edge=100, ring_diameter=7, pitch=7.2), "use at least ")
    assert ico(edge=100, ring_diameter=7, pitch=pitch).pitch_mm == pitch
    diameter = named(refusal("ico", edge=100, ring_diameter=1, pitch=3), "rings of at least ")
    assert ico(edge=100, ring_diameter=diameter, pitch=3).ring_diameter_mm == diameter
    diameter = named(refusal("ico", edge=100, ring_diameter=1.5, pitch=4, ring_ratio=0.2), "rings of at least ")
    assert ico(edge=100, ring_diameter=diameter, pitch=4, ring_ratio=0.2).ring_diameter_mm == diameter
    count = int(refusal("ico", edge=100, ring_diameter=7, pitch=10, rings_per_side=9).split("at most ")[1].split()[0])
    assert ico(edge=100, ring_diameter=7, pitch=10, rings_per_side=count).rings_per_side == count


# --- boards ----------------------------------------------------------------------------------------------------------


def test_papers_board_holds_21_by_21() -> None:
    """220 mm at pitch 10 with a margin of half a pitch: 21 x 21 rings; the aluminium board's 400 mm: 39 x 39."""
    spec = board(size="220x220mm", ring_diameter="7mm", pitch="10mm")
    assert (spec.columns, spec.rows, spec.thickness_mm, spec.border_mm, spec.margin_mm) == (21, 21, 5.0, 0.0, 5.0)
    assert lay_out(spec).ring_count == 441
    large = board(size="400x400mm", ring_diameter="8mm", pitch="10mm", build="sheet")
    assert (large.columns, large.rows) == (39, 39)


def test_board_by_its_rings_is_as_large_as_they_need() -> None:
    """10 x 7 rings of 6.6 at 10 mm: 9 and 6 pitches, a ring and half a pitch around; without dots if asked."""
    spec = board(columns=10, rows=7, pitch="10mm", ring_diameter="6.6mm", dots=False)
    assert spec.size_mm == pytest.approx((90 + 6.6 + 10, 60 + 6.6 + 10))
    assert not spec.dots


@given(
    size=st.tuples(st.floats(30, 150), st.floats(30, 150)),
    pitch=st.none() | st.floats(4, 20),
    lattice=st.sampled_from(["square", "triangular"]),
    border=st.sampled_from([0, 1, 5]),
    margin=st.none() | st.floats(0.5, 9),
)
@settings(max_examples=40, deadline=None)
def test_boards_hold_all_that_fits(
    size: tuple[float, float], pitch: float | None, lattice: str, border: float, margin: float | None
) -> None:
    """Rings keep margin and border, and neither a column nor a row more would fit."""
    values = without_none(pitch=pitch, margin=margin)
    values |= {"size": f"{size[0]}x{size[1]}mm", "lattice": lattice, "border": border}
    assume(not isinstance(sized_or_refusal(kind="board", **values), str))
    spec = board(**values)
    assert spec.size_mm == size
    target = lay_out(spec)
    assert narrowest_widths(target).margin_mm >= spec.margin_mm - 1e-6
    assert border_width_mm(target) == pytest.approx(border, abs=1e-6)
    row_step = spec.pitch_mm * (1 if lattice == "square" else math.sqrt(3) / 2)
    around = spec.ring_diameter_mm + 2 * (spec.border_mm + spec.margin_mm)
    assert spec.columns * spec.pitch_mm + around > size[0]
    assert spec.rows * row_step + around > size[1]


@given(st.floats(20, 2000), st.sampled_from(["0.2mm", "0.4mm"]))
@settings(max_examples=60, deadline=None)
def test_automatic_boards_print_well(size_mm: float, nozzle: str) -> None:
    """A board by its size alone has strokes, centres and gaps of two lines, D = 0.7 C, at least 3 x 3; or an error."""
    result = sized_or_refusal(kind="board", size=f"{size_mm}x{size_mm}mm", nozzle=nozzle)
    if isinstance(result, str):
        assert "it must hold 3 x 3" in result
        return
    spec = result.job.target
    assert min(widths_mm(spec)) >= 2 * LINES[nozzle] - 1e-6
    assert spec.ring_diameter_mm == pytest.approx(0.7 * spec.pitch_mm, abs=0.011)
    assert min(spec.columns, spec.rows) >= 3


# --- how it is made --------------------------------------------------------------------------------------------------


def test_defaults_of_each_build() -> None:
    """Two filaments give 3MF, STL and PNG; paper and sheet give PDF, SVG, PNG and STL, never a 3MF."""
    for values, formats in (
        ({"kind": "ico", "edge": 100}, ("3mf", "stl", "png")),
        ({"kind": "ico", "edge": 100, "build": "stickers"}, ("stl", "png", "pdf", "svg")),
        ({"kind": "board", "size": "60x60mm"}, ("3mf", "stl", "png")),
        ({"kind": "board", "size": "60x60mm", "build": "sheet", "formats": "all"},
         ("stl", "png", "pdf", "svg", "shop", "colour", "simulator", "dxf", "laser", "gerber", "gerber-mask")),
    ):  # fmt: skip
        assert sized(**values).job.formats == formats
    assert "3mf: left out" in sized(kind="ico", edge=100, build="stickers", formats="3mf").remarks[-1]


def test_profile_is_bambu_p1s_with_a_04_nozzle() -> None:
    """Without a printer, the default is bambu-p1s with its 0.4 mm nozzle."""
    printer = sized(kind="ico", edge=100).job.printing.printer
    assert (printer.name, printer.nozzle_mm, printer.line_width_mm) == ("bambu-p1s", 0.4, 0.45)


@given(st.floats(7, 40), nozzles, st.none() | st.floats(0.2, 2))
@settings(max_examples=40, deadline=None)
def test_automatic_inlay_is_whole_layers_and_leaves_border(edge_mm: float, nozzle: str, border: float | None) -> None:
    """1 mm, or as many whole layers as leave a tenth of the border's width at the floor, and at least one."""
    values = without_none(border=border)
    result = sized_or_refusal(kind="ico", edge=edge_mm, nozzle=nozzle, **values)
    assume(isinstance(result, Sized))
    job = result.job
    layers = job.printing.inlay_mm / job.printing.printer.layer_height_mm
    assert layers == pytest.approx(round(layers))
    assert layers >= 1
    assert job.printing.inlay_mm <= 1.0
    # The floor moves in by depth / tan(half the dihedral angle of 138.19 degrees).
    inset = job.printing.inlay_mm / math.tan(math.radians(138.189685) / 2)
    assert inset <= 0.9 * job.target.border_mm + 1e-9 or layers == 1
    assert inset < job.target.border_mm


def test_inlay_of_flat_faces_is_three_layers() -> None:
    """Boards get 3 layers, but no more than half the plate."""
    assert sized(kind="board", size="60x60mm").job.printing.inlay_mm == pytest.approx(0.6)
    assert sized(kind="board", size="60x60mm", nozzle="0.2mm").job.printing.inlay_mm == pytest.approx(0.3)
    assert sized(kind="board", size="60x60mm", thickness="0.8mm").job.printing.inlay_mm == pytest.approx(0.4)


def test_names_come_from_kind_and_size() -> None:
    """The default name tells kind and size; a given one is kept."""
    assert sized(kind="ico", edge="2cm").job.name == "ico-20mm"
    assert sized(kind="board", size="220x110mm").job.name == "board-220x110mm"
    assert sized(kind="board", columns=10, rows=7, pitch=10).job.name == "board-10x7-10mm"
    assert sized(kind="ico", edge=20, name="x").job.name == "x"
