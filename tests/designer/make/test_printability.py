"""Design rules: each speaks at its limit and is silent above it, on targets designed, measured and made by others."""

from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from designer.kinds.board import BoardSpec
from designer.kinds.ico import IcoSpec
from designer.kinds.layout import border_width_mm, lay_out, narrowest_widths
from designer.kinds.sizing import size_job
from designer.kinds.spec_file import RawValue, parse_spec
from designer.make.printability import RULES, PrintCheck, PrintFinding, check_printability
from designer.spec.spec import PrinterProfile, PrintSpec
from designer.target import TargetGeometry

LINE = 0.45
PRINTER = PrinterProfile("mine", (256.0, 256.0, 256.0), 0.4, LINE, 0.2)
PRINTING = PrintSpec("one-piece", PRINTER, 0.6, 0.0, 0.0, 0.1, "#ffffff", "#000000", True, False, 0.005)
SOLID = replace(PRINTING, inlay_mm=1.0)
ICO = lay_out(IcoSpec(100.0, 8, 7.0, 0.45, 10.0, 2.0, 3.0))
BOARD = lay_out(BoardSpec((90.0, 80.0), 5.0, 8, 7, "square", 7.0, 0.45, 10.0, 1.5, 2.0, dots=True))


def found(target: TargetGeometry, printing: PrintSpec, rule: str) -> list[PrintFinding]:
    check = check_printability(target, printing)
    return [finding for finding in check.findings if rule in finding.rules]


def level(target: TargetGeometry, printing: PrintSpec, rule: str) -> str:
    """The gravest level of a rule's findings; "holds" without any."""
    levels = [finding.level for finding in found(target, printing, rule)]
    return next((grave for grave in ("violation", "warning", "note") if grave in levels), "holds")


def test_papers_target_holds_all_rules() -> None:
    """Edge 100 mm with a 0.4 mm nozzle: every rule holds, and the only finding is a note on overhangs."""
    check = check_printability(ICO, SOLID)
    assert check.holding == tuple(RULES)
    assert check.violations == ()
    assert [finding.level for finding in check.findings] == ["note"]


def board_with_stroke(width: float) -> TargetGeometry:
    return replace(BOARD, radius_inner_mm=np.where(BOARD.is_dot, 0.0, 3.5 - width))


def board_with_centre(width: float) -> TargetGeometry:
    return replace(BOARD, radius_inner_mm=np.where(BOARD.is_dot, 0.0, width / 2))


def board_with_gap(width: float) -> TargetGeometry:
    radius = (10 - width) / 2
    return replace(
        BOARD,
        radius_outer_mm=np.full(BOARD.ring_count, radius),
        window_mm=1.1 * BOARD.outline_mm,
        outline_mm=1.2 * BOARD.outline_mm,
    )


def board_with_margin(width: float) -> TargetGeometry:
    reach = BOARD.center_mm.max(axis=0)[:2] + 3.5 + width
    return replace(BOARD, window_mm=np.sign(BOARD.window_mm) * reach, outline_mm=np.sign(BOARD.window_mm) * (reach + 2))


def board_with_border(width: float) -> TargetGeometry:
    return replace(BOARD, window_mm=BOARD.outline_mm - np.sign(BOARD.outline_mm) * width)


WIDTHS: dict[str, Callable[[float], TargetGeometry]] = {
    "stroke": board_with_stroke,
    "centre": board_with_centre,
    "gap": board_with_gap,
    "margin": board_with_margin,
    "border": board_with_border,
}


@pytest.mark.parametrize("rule", WIDTHS)
def test_widths_need_the_nozzle_and_want_two_lines(rule: str) -> None:
    """Below the nozzle: a violation; from there to two lines: a warning; from two lines on: nothing."""
    limits = [(0.39, "violation"), (0.4, "warning"), (0.89, "warning"), (0.9, "holds"), (1.3, "holds")]
    for width, expected in limits:
        assert level(WIDTHS[rule](width), PRINTING, rule) == expected, width


@pytest.mark.parametrize("rule", WIDTHS)
def test_widths_do_not_bind_paper(rule: str) -> None:
    """Stickers and sheets are printed on paper, whose lines are finer than any rule here."""
    assert level(WIDTHS[rule](0.39), replace(PRINTING, build="sheet"), rule) == "holds"


@pytest.mark.parametrize(
    ("rule", "per_offset"), [("stroke", 2), ("centre", -2), ("gap", -2), ("margin", -2), ("border", 1)]
)
def test_ink_offset_counts(rule: str, per_offset: int) -> None:
    """An offset of o widens strokes by 2 o and the border by o, and narrows the white between two edges by 2 o."""
    for offset in (-0.1, 0.1):
        printing = replace(PRINTING, ink_offset_mm=offset)
        assert level(WIDTHS[rule](0.4 - per_offset * offset + 0.01), printing, rule) == "warning"
        assert level(WIDTHS[rule](0.4 - per_offset * offset - 0.01), printing, rule) == "violation"


def test_margin_to_a_plain_boards_edge_counts_one_offset() -> None:
    """Without a border only the ring's own edge moves."""
    plain = board_with_margin(0.45)
    plain = replace(plain, outline_mm=plain.window_mm)
    assert level(plain, replace(PRINTING, ink_offset_mm=0.04), "margin") == "warning"
    assert level(plain, replace(PRINTING, ink_offset_mm=0.06), "margin") == "violation"
    assert level(plain, PRINTING, "border") == "holds"


# --- measured geometry -----------------------------------------------------------------------------------------------


def test_one_ring_near_the_border_is_noticed() -> None:
    """In a measured target a single ring that has come too near to the border breaks the rule of margins."""
    center = ICO.center_mm.copy()
    corner_ring = 7  # the end of face 0's first side
    outward = ICO.center_in_face_mm[corner_ring] / np.linalg.norm(ICO.center_in_face_mm[corner_ring])
    center[corner_ring] += ICO.target_from_face[0, :3, :3] @ outward * 5.6
    assert level(replace(ICO, source="measured", center_mm=center), SOLID, "margin") == "violation"


@pytest.mark.parametrize("corner", range(3))
def test_one_narrow_side_of_one_border_is_noticed(corner: int) -> None:
    """The border is held to the rule on every side of every face."""
    window = ICO.window_mm.copy()
    window[13, corner] += 1.7 * (ICO.outline_mm[13, corner] - window[13, corner]) / 2 / 2
    narrow = replace(ICO, source="measured", window_mm=window)
    assert border_width_mm(narrow) < border_width_mm(ICO) - 0.5
    assert border_width_mm(ICO) == pytest.approx(2.0)
    thin = replace(SOLID, printer=replace(PRINTER, nozzle_mm=1.9, line_width_mm=1.9))
    assert level(narrow, thin, "border") == "violation"
    assert level(ICO, thin, "border") == "warning"


def test_smallest_ring_decides() -> None:
    """One ring with a thin stroke, or a small centre, breaks the rule."""
    inner = BOARD.radius_inner_mm.copy()
    ring = int(np.flatnonzero(~BOARD.is_dot)[5])
    inner[ring] = 3.15
    assert level(replace(BOARD, radius_inner_mm=inner), PRINTING, "stroke") == "violation"
    inner[ring] = 0.19
    assert level(replace(BOARD, radius_inner_mm=inner), PRINTING, "centre") == "violation"


TRIANGULAR = lay_out(BoardSpec((90.0, 80.0), 5.0, 8, 7, "triangular", 7.0, 0.45, 10.0, 1.5, 2.0, dots=True))


@given(st.sampled_from([BOARD, TRIANGULAR]), st.integers(0, 2**32 - 1), st.floats(0, 0.6))
@settings(max_examples=40, deadline=None)
def test_widths_are_those_of_the_numbers(nominal: TargetGeometry, seed: int, sigma_mm: float) -> None:
    """For any perturbed board, gap and margin are the least over all pairs of rings and all sides, by brute force."""
    rng = np.random.default_rng(seed)
    center = nominal.center_mm + sigma_mm * np.pad(rng.standard_normal((nominal.ring_count, 2)), ((0, 0), (0, 1)))
    radius = nominal.radius_outer_mm + 0.1 * sigma_mm * rng.standard_normal(nominal.ring_count)
    target = replace(nominal, source="perturbed", center_mm=center, radius_outer_mm=radius)
    between = np.linalg.norm(center[:, None] - center, axis=2) - radius[:, None] - radius
    np.fill_diagonal(between, np.inf)
    widths, reach = narrowest_widths(target), nominal.window_mm[0].max(axis=0)
    assert widths.gap_mm == pytest.approx(between.min())
    assert widths.margin_mm == pytest.approx((reach - np.abs(center[:, :2]) - radius[:, None]).min())


def test_a_target_of_one_ring_has_no_gaps() -> None:
    """The rules hold for the smallest target made by others."""
    one = TargetGeometry(
        "measured", None, np.array([0]), np.array([[0, 0]]), np.zeros((1, 3)), np.array([3.5]), np.array([1.5]),
        np.array([False]), np.eye(4)[None], BOARD.outline_mm, BOARD.outline_mm, np.array([-1]), np.eye(2)[None],
    )  # fmt: skip
    assert narrowest_widths(one).gap_mm == np.inf
    assert check_printability(one, PRINTING).findings == ()


# --- inlay, bed, overhang --------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("depth", "expected"),
    [(0.1, "violation"), (0.19, "violation"), (0.2, "holds"), (0.3, "warning"), (0.6, "holds"), (0.61, "warning")],
)
def test_inlay_is_whole_layers(depth: float, expected: str) -> None:
    """Less than a layer is a violation, a broken layer a warning; on a board any number of layers will do."""
    assert level(BOARD, replace(PRINTING, inlay_mm=depth), "inlay") == expected


def test_inlay_of_steep_faces_wants_09_mm() -> None:
    """On an icosahedron less than 0.9 mm fills the steep faces in part only."""
    assert level(ICO, replace(SOLID, inlay_mm=0.8), "inlay") == "warning"
    fine = replace(SOLID, inlay_mm=0.9, printer=replace(PRINTER, layer_height_mm=0.1))
    assert level(ICO, fine, "inlay") == "holds"


def test_inlay_must_not_undercut_the_border() -> None:
    """A 2 mm border bears 2 mm * tan(69.09 deg) = 5.24 mm at most."""
    assert level(ICO, replace(SOLID, inlay_mm=5.2), "inlay") == "holds"
    assert level(ICO, replace(SOLID, inlay_mm=5.4), "inlay") == "violation"


def test_inlay_must_not_go_through_the_board() -> None:
    """A plate 5 mm thick bears less than 5 mm of ink."""
    assert level(BOARD, replace(PRINTING, inlay_mm=4.8), "inlay") == "holds"
    assert level(BOARD, replace(PRINTING, inlay_mm=5.0), "inlay") == "violation"


def test_a_part_that_is_larger_than_the_bed_is_a_violation() -> None:
    """An icosahedron of edge 100 needs 186.9 x 161.9 x 151.2 mm, and 5 mm more on all sides for a brim."""
    beds = {"fits": (197.0, 172.0, 151.3), "turned": (172.0, 197.0, 151.3), "wide": (197.0, 300.0, 300.0)}
    without_brim = {"bare": (187.0, 162.0, 151.3), "bare, turned": (162.0, 187.0, 151.3)}
    tight = {"short": (186.0, 186.0, 300.0), "narrow": (300.0, 161.0, 300.0), "low": (300.0, 300.0, 151.0)}
    for cases, verdict in ((beds, "holds"), (without_brim, "note"), (tight, "violation")):
        for bed in cases.values():
            assert level(ICO, replace(SOLID, printer=replace(PRINTER, bed_mm=bed)), "bed") == verdict
    assert "bed" not in check_printability(ICO, replace(SOLID, printer=replace(PRINTER, bed_mm=bed))).holding


@pytest.mark.parametrize(
    ("size", "p1s", "a1"),
    [
        ("240x240mm", "violation", "holds"), ("256x256mm", "violation", "note"), ("250x230mm", "violation", "note"),
        ("256x228mm", "note", "note"), ("246x218mm", "holds", "holds"),
    ],
)  # fmt: skip
def test_corners_that_a_bed_excludes_are_not_printed_on(size: str, p1s: str, a1: str) -> None:
    """Bambu Lab's P1S keeps 18 x 28 mm in front left for its cutter; the profile of the A1 excludes nothing."""
    for name, verdict in (("bambu-p1s", p1s), ("bambu-x1c", p1s), ("bambu-a1", a1)):
        job = size_job(parse_spec({"kind": "board", "size": size, "printer": name}, "")).job
        assert level(lay_out(job.target), job.printing, "bed") == verdict
        if verdict == "violation":
            assert "18 x 28 mm in front left" in found(lay_out(job.target), job.printing, "bed")[0].text


def test_sheets_need_no_bed() -> None:
    """Artwork for a print shop is not held to the printer's bed."""
    small = replace(PRINTING, build="sheet", printer=replace(PRINTER, bed_mm=(10.0, 10.0, 10.0)))
    assert level(BOARD, small, "bed") == "holds"


def test_overhang_is_noted_on_solids_only() -> None:
    """Resting on a face, an icosahedron's next faces rise at 41.8 degrees; a board has no overhang."""
    assert "41.8 deg" in found(ICO, SOLID, "overhang")[0].text
    assert found(BOARD, PRINTING, "overhang") == []


@given(
    st.fixed_dictionaries(
        {"kind": st.just("ico"), "edge": st.floats(15, 200), "nozzle": st.sampled_from(["0.2mm", "0.4mm"])}
    )
    | st.fixed_dictionaries(
        {"kind": st.just("board"), "size": st.builds("{0}x{0}mm".format, st.floats(30, 150))},
        optional={"border": st.floats(1, 5)},
    )
)
@settings(max_examples=40, deadline=None)
def test_what_was_sized_here_breaks_no_width_rule(values: dict[str, RawValue]) -> None:
    """Automatic sizes violate no rule of widths and inlay, and every finding is one line that ends in a remedy."""
    job = size_job(parse_spec(values, "")).job
    check: PrintCheck = check_printability(lay_out(job.target), job.printing)
    assert [finding.rule for finding in check.violations if finding.rule != "bed"] == []
    for finding in check.findings:
        assert len(finding.text.splitlines()) == 1
        assert ";" in finding.text or finding.level == "note"
