"""What a print takes, against stacks and boxes that are counted by hand; `test_slicing` asks PrusaSlicer."""

import math
import tomllib
from dataclasses import replace
from itertools import pairwise
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from manifold3d import Manifold

import designer
from designer.app import costs
from designer.app.costs import costs_of, verdict
from designer.base.answer import LINE
from designer.base.arrays import Array
from designer.base.errors import InputError
from designer.kinds.sizing import size_job
from designer.kinds.spec_file import parse_spec, spec_to_toml
from designer.make.bed import TOWER_BRIM_MM, TOWER_MM, Piece, Plate, purged
from designer.make.estimate import DENSITY_G_PER_CM3, changing_layers, duration, estimate, grams
from designer.make.mesh import Mesh, Part, mesh_of
from designer.make.motion import Pace, chords_mm, lines_time_s, loops_time_s
from designer.make.section import Layered, Sliced, contours
from designer.spec.machine import FilamentChange, Shells, Speeds
from designer.spec.spec import Price, PrintSpec
from designer.tolerance.effort import size_of
from designer.tolerance.error_file import error_model
from tests.support.designs import asked_for, design_of, small

PRINTING = size_job(asked_for("ico", {"edge": "20mm", "printer": "generic"})).job.printing
LAYER_MM, LINE_MM = PRINTING.printer.layer_height_mm, PRINTING.printer.line_width_mm
PACE = Pace(100.0, 2000.0, 8.0)


def box(x: float, y: float, z: float, at: tuple[float, float, float] = (0, 0, 0)) -> Mesh:
    """A box, its lowest corner at a place."""
    return mesh_of(Manifold.cube((x, y, z)).translate(at))


def plate(*parts: Part) -> Plate:
    """Parts that lie where they are."""
    return Plate("", tuple(Piece(str(n), part, np.eye(4)) for n, part in enumerate(parts)))


def printing(shells: Shells | None = None, change: FilamentChange | None = None, faster: float = 1.0) -> PrintSpec:
    """With other walls, layers and infill, or another change of filament, or faster walls and infill."""
    machine = PRINTING.printer.machine
    speeds = machine.speeds
    machine = replace(
        machine,
        shells=shells or machine.shells,
        change=change or machine.change,
        speeds=Speeds(faster * speeds.outer_wall_mm_s, faster * speeds.inner_wall_mm_s, faster * speeds.infill_mm_s),
        least_layer_s=0.0,
    )
    return replace(PRINTING, printer=replace(PRINTING.printer, machine=machine))


@pytest.mark.parametrize(
    ("body", "ink", "changes"),
    [
        ("", "", ()),
        ("111", "000", ()),
        ("111", "001", (2,)),
        ("111", "100", (0, 1)),  # to the ink in the first layer, back for the second
        ("111", "111", (0, 1, 2)),
        ("1111", "0110", (1, 2)),  # the second layer with ink begins with it
        ("0011", "1100", (2,)),
        ("10101", "01010", (1, 2, 3, 4)),
    ],
)
def test_changes_of_simple_stacks(body: str, ink: str, changes: tuple[int, ...]) -> None:
    """Each layer begins with the filament that is loaded, and a layer of both takes one change."""
    has_body, has_ink = (np.array([digit == "1" for digit in text], dtype=bool) for text in (body, ink))
    assert changing_layers(has_body, has_ink) == changes


def test_a_plain_box_by_hand() -> None:
    """Its filament is its volume less the inside, of which the infill's share is filled."""
    shells = Shells(walls=2, bottom_layers=3, top_layers=4, infill=0.2)
    spacing = LINE_MM - LAYER_MM * (1 - math.pi / 4)
    wall, high = LINE_MM + spacing, 10 - 7 * LAYER_MM
    inside = (40 - 2 * wall) * (30 - 2 * wall) * high
    one = estimate((plate(Part(box(40, 30, 10), None)),), printing(shells))
    assert one.body_g == pytest.approx((40 * 30 * 10 - 0.8 * inside) / 1000 * DENSITY_G_PER_CM3, rel=1e-6)
    assert (one.changes, one.purge_g, one.ink_g, one.plates[0].layers) == (0, 0.0, 0.0, 50)
    assert one.price == pytest.approx(one.total_g / 1000 * 25)


def test_more_of_anything_takes_more() -> None:
    """Each wall, layer and per cent of infill adds plastic; so does a higher box, and time goes with it."""
    usual = Shells()
    base = estimate((plate(Part(box(40, 30, 10), None)),), printing(usual))
    for more in (
        replace(usual, walls=4), replace(usual, bottom_layers=5), replace(usual, top_layers=6),
        replace(usual, infill=0.2),
    ):  # fmt: skip
        assert estimate((plate(Part(box(40, 30, 10), None)),), printing(more)).body_g > base.body_g
    higher = estimate((plate(Part(box(40, 30, 12), None)),), printing(usual))
    assert higher.body_g > base.body_g
    assert higher.time_s > base.time_s > estimate((plate(Part(box(40, 30, 10), None)),), printing(faster=2)).time_s


def test_high_parts_are_cut_here_and_there_and_keep_their_volume() -> None:
    """A box of 400 layers takes eight times the plastic of 50; time grows by the layers, the first one left out."""
    shells = Shells(bottom_layers=0, top_layers=0)
    low, middle, high = (estimate((plate(Part(box(20, 20, z), None)),), printing(shells)) for z in (10, 45, 80))
    assert high.body_g == pytest.approx(8 * low.body_g, rel=1e-6)
    assert high.time_s - middle.time_s == pytest.approx(middle.time_s - low.time_s, rel=1e-6)


def test_pieces_of_a_plate_share_its_changes() -> None:
    """Twice the pieces, twice the plastic, and as many changes; on two plates twice as many."""

    def part(x: float) -> Part:
        return Part(box(20, 20, 2, (x, 0, 0.4)), box(20, 20, 0.4, (x, 0, 0)))

    one = estimate((plate(part(0)),), PRINTING)
    both = estimate((plate(part(0), part(30)),), PRINTING)
    apart = estimate((plate(part(0)), plate(part(30))), PRINTING)
    assert (one.changes, both.changes, apart.changes) == (1, 1, 2)
    assert both.body_g == pytest.approx(2 * one.body_g)
    assert both.ink_g == pytest.approx(2 * one.ink_g)
    assert apart.purge_g == pytest.approx(2 * both.purge_g)


def test_a_change_costs_its_time_and_its_purge() -> None:
    """Two changes: one purges to the ink and one to the body; volume over flow is time."""
    part = Part(box(20, 20, 2, (0, 0, 0.2)), box(20, 10, 0.2, (0, 0, 0)))
    over = Part(part.body, mesh_of(Manifold.cube((20, 10, 0.2)) + Manifold.cube((20, 10, 0.2)).translate((0, 0, 2.2))))
    change = FilamentChange(time_s=7, purge_to_ink_mm3=100, purge_to_body_mm3=300, purge_flow_mm3_s=10, has_tower=False)
    one = estimate((plate(over),), printing(change=change))
    assert one.changes == 2
    assert one.purge_g == pytest.approx(0.4 * DENSITY_G_PER_CM3)
    assert one.changing_s == pytest.approx(2 * 7 + 400 / 10)
    tower = estimate((plate(over),), printing(change=replace(change, has_tower=True)))
    deep = 300 / (TOWER_MM * LAYER_MM)
    walls = (2 * deep + TOWER_MM / 2) * LINE_MM * 12  # the last change is in the twelfth layer
    more = LAYER_MM * (walls + 2 * (TOWER_MM + deep) * TOWER_BRIM_MM) + 300  # the foot
    assert tower.purge_g == pytest.approx((400 + more) / 1000 * DENSITY_G_PER_CM3)


def test_a_tower_takes_the_time_that_it_takes_in_gcode() -> None:
    """151 changes of 25 mm³, a layer each: 885 s for the lines, 416 s for the box, by the moves of PrusaSlicer 2.5."""
    change = replace(PRINTING.printer.machine.change, purge_to_ink_mm3=25, purge_to_body_mm3=25, purge_flow_mm3_s=7.3)
    printer = replace(PRINTING.printer, machine=replace(PRINTING.printer.machine, change=change))
    tower = purged(range(151), printer)
    assert tower.time_s == pytest.approx(885 + 416, rel=0.05)
    assert tower.time_s > 1.5 * tower.volume_mm3 / change.purge_flow_mm3_s  # each change begins slowly


def test_what_falls_down_a_chute_is_no_tower() -> None:
    """As much is purged, at full speed; less stands around it."""
    change = replace(PRINTING.printer.machine.change, purge_to_ink_mm3=200, purge_to_body_mm3=600)
    printer = replace(PRINTING.printer, machine=replace(PRINTING.printer.machine, change=change))
    chute = replace(printer, machine=replace(printer.machine, change=replace(change, most_on_tower_mm3=0.0)))
    for changing in ((0,), (0, 1), (2, 3, 4), tuple(range(100))):
        least_mm3 = 200 * len(changing[::2]) + 600 * len(changing[1::2])
        falls, stands = purged(changing, chute), purged(changing, printer)
        assert least_mm3 < falls.volume_mm3 < stands.volume_mm3
        assert least_mm3 / change.purge_flow_mm3_s < falls.time_s < stands.time_s


@pytest.mark.parametrize(
    ("template", "kind", "values"),
    [("fdm-board", "board", {"size": "100x100mm"}), ("fdm-dual", "cube", {"edge": "50mm"})],
)
def test_templates_tell_the_hours_and_the_price_of_the_estimate(
    template: str, kind: str, values: dict[str, str]
) -> None:
    """`design ways` ranks by formulas; they are within a tenth of what `design` tells."""
    design, errors = design_of(kind, **values), error_model(template)
    assert errors.hours is not None
    assert errors.price is not None
    size = size_of(design.target)
    assert errors.hours.of(size) == pytest.approx(design.estimate.time_s / 3600, rel=0.1)
    assert errors.price.of(size) == pytest.approx(design.estimate.price, rel=0.1)


@given(st.lists(st.tuples(st.floats(-20, 20), st.floats(-20, 20)), min_size=3, max_size=30))
def test_a_loop_is_timed_as_a_planner_does(points: list[tuple[float, float]]) -> None:
    """The slow oracle: forth and back over the corners, one line after another."""
    loop = np.array(points)
    assert loops_time_s([loop, loop], PACE) == pytest.approx(2 * slow_time_s(loop), rel=1e-9)


def slow_time_s(loop: Array) -> float:
    """One closed line, begun and ended at the jerk."""
    steps = np.roll(loop, -1, axis=0) - loop
    length = np.maximum(np.hypot(*steps.T), 1e-9)
    along = steps / length[:, None]
    most = [PACE.jerk_mm_s]
    for before, after in pairwise(along):
        most.append(min(PACE.speed_mm_s, PACE.jerk_mm_s / max(np.abs(after - before).max(), 1e-9)))
    speeds = [*most, PACE.jerk_mm_s]
    for k in range(len(length)):
        speeds[k + 1] = min(speeds[k + 1], math.sqrt(speeds[k] ** 2 + 2 * PACE.acceleration_mm_s2 * length[k]))
    for k in reversed(range(len(length))):
        speeds[k] = min(speeds[k], math.sqrt(speeds[k + 1] ** 2 + 2 * PACE.acceleration_mm_s2 * length[k]))
    time = 0.0
    for begin, end, way in zip(speeds[:-1], speeds[1:], length, strict=True):
        peak = min(PACE.speed_mm_s, math.sqrt((begin**2 + end**2) / 2 + PACE.acceleration_mm_s2 * way))
        peak = max(peak, begin, end)
        speeding = (2 * peak - begin - end) / PACE.acceleration_mm_s2
        ramps = (2 * peak**2 - begin**2 - end**2) / 2 / PACE.acceleration_mm_s2
        time += speeding + max(way - ramps, 0) / peak
    return time


def test_a_line_from_rest_to_rest() -> None:
    """Textbook: l / v + v / a if the speed is reached, 2 sqrt(l / a) if not."""
    times = [lines_time_s(np.array([length]), PACE, 0.0) for length in (50.0, 0.5)]
    assert times == pytest.approx([50 / 100 + 100 / 2000, 2 * math.sqrt(0.5 / 2000)])


@given(st.floats(0, math.pi), st.floats(0.3, 3))
def test_lines_that_fill_an_area_are_as_long_as_it_is_large(angle_rad: float, spacing_mm: float) -> None:
    """Length times spacing is the area, holes left out."""
    outer = 40 * np.array([[0, 0], [1, 0], [1, 1], [0, 1]]) + 0.123
    hole = 10 * np.array([[1, 1], [1, 2], [2, 2], [2, 1.0]])
    chords = chords_mm([outer, hole], spacing_mm, angle_rad)
    assert chords.sum() * spacing_mm == pytest.approx(1500, abs=60 * spacing_mm)
    assert chords.max() <= 40 * math.sqrt(2) + 1e-9


def test_layers_that_repeat_are_cut_as_each_alone() -> None:
    """Of a post on a plate under a roof: the same areas as from the solid itself; only upright walls repeat."""
    post = Manifold.cube((20, 20, 2)) + Manifold.cylinder(5, 6).translate((10, 10, 1))
    solid = post + Manifold.cylinder(3, 6, 1).translate((10, 10, 6))
    layered = Layered(mesh_of(solid), LAYER_MM)
    areas = [layered.section(layer).area() for layer in range(45)]
    assert areas == pytest.approx([solid.slice((layer + 0.5) * LAYER_MM).area() for layer in range(45)], rel=1e-3)
    alike = [layered.lowest_like(layer) for layer in range(-1, 46)]
    assert alike == [-1] + [0] * 10 + [10] * 20 + [*range(30, 46)]


def test_layers_that_repeat_are_covered_as_each_alone(monkeypatch: pytest.MonkeyPatch) -> None:
    """The slow oracle: every layer for itself, of a part with steps and a slope."""
    body = Manifold.cube((20, 20, 4)) + Manifold.cube((12, 12, 6)) + Manifold.cylinder(2, 4, 1).translate((6, 6, 6))
    lifted = mesh_of(body.translate((0, 0, 0.4)))
    parts = plate(Part(lifted, box(20, 20, 0.4))), plate(Part(lifted, box(1, 1, 0.05))), plate(Part(lifted, None))
    quick = [estimate((one,), PRINTING) for one in parts]
    monkeypatch.setattr("designer.make.estimate._Slicing._kind", lambda _, layer: (layer,))
    assert [estimate((one,), PRINTING) for one in parts] == quick


def test_an_outline_is_body_and_ink_together_convex_or_not() -> None:
    """The same areas from the hull as from the union; what is not convex keeps its notch; ink is where it is."""
    notched = mesh_of(Manifold.cube((20, 20, 4)) - Manifold.cube((10, 20, 4)).translate((5, 0, 2)))
    for body, areas in ((box(20, 20, 4), (400, 400)), (notched, (400, 200))):
        sliced = Sliced(Part(body, box(20, 20, 1, (0, 0, 4))), LAYER_MM)
        outline = [sliced.outline(layer).area() for layer in (-1, 0, 15, 24, 25)]
        assert outline == pytest.approx([0, *areas, 400, 0])
        both = [[one.area() for one in sliced.sections(layer)] for layer in (15, 24)]
        assert both == [pytest.approx([areas[1], 0]), pytest.approx([0, 400])]
    assert Sliced(Part(notched, None), LAYER_MM).outline(15).area() == pytest.approx(200)


def test_every_kind_has_an_estimate_and_a_sheet_has_nothing_to_print() -> None:
    """From Python in one word; a sheet takes no plastic and is compared with nothing."""
    target = designer.ico(edge_mm=20, chord_error="50um")
    assert target.estimate.changes == target.estimate.inked_layers == 151
    sheet = designer.board(size="60x60mm", build="sheet")
    assert (sheet.estimate.plates, sheet.estimate.total_g, sheet.costs.is_printed) == ((), 0, False)


def test_a_print_beyond_reason_is_said_and_the_better_build_named() -> None:
    """Hours of changing are a fault of one piece, and not of stickers; a small board has none."""
    large = costs_of(designer.ico(edge_mm=60, chord_error="50um").design)
    assert large.own.faults
    assert large.better is not None
    assert not large.better.faults
    assert f"--build {large.better.build}" in verdict(large)
    itself = designer.ico(edge_mm=60, chord_error="50um", build=large.better.build)
    assert large.better.estimate == itself.estimate  # though one tile stood for all
    assert verdict(costs_of(small("board"))) == ""


def test_other_builds_are_the_same_told_by_a_process_beside(monkeypatch: pytest.MonkeyPatch) -> None:
    """A command has it for large targets."""
    design = designer.ico(edge_mm=30, chord_error="50um").design
    plain = costs_of(design)
    assert plain.others
    monkeypatch.setattr(costs, "MANY_RINGS", 0)
    monkeypatch.setattr(costs, "_other_builds", lambda design: pytest.fail("was not asked"))
    token = LINE.set("design ico")
    try:
        assert costs_of(design) == plain
    finally:
        LINE.reset(token)


@pytest.mark.parametrize(
    ("time_s", "text"), [(10, "1 min"), (2400, "40 min"), (12_100, "3 h 22 min"), (14_380, "4 h"), (140_000, "39 h")]
)
def test_durations_have_the_digits_of_an_estimate(time_s: float, text: str) -> None:
    """Minutes below ten hours."""
    assert duration(time_s) == text


def test_grams_have_the_digits_of_an_estimate() -> None:
    """Two, or three above a hundred."""
    assert [grams(mass) for mass in (0.0, 0.7234, 9.76, 45.6, 123.4, 1234.0)] == [
        "0 g", "0.72 g", "9.8 g", "46 g", "123 g", "1230 g",
    ]  # fmt: skip


@pytest.mark.parametrize(
    ("machine", "message"),
    [
        ("{ jerk_mm_s = -1 }", "machine.*jerk_mm_s.*0 or more|machine.*jerk_mm_s.*more than 0"),
        ("{ speeds = { outer_wall_mm_s = 0 } }", "outer_wall_mm_s.*more than 0"),
        ("{ change = { purge_to_ink_mm3 = '1' } }", "purge_to_ink_mm3"),
        ("{ speed = 5 }", "speed"),
        ("5", "machine"),
    ],
)
def test_a_printers_file_is_held_to_the_rules(machine: str, message: str, tmp_path: Path) -> None:
    """One line with the place and the rule."""
    path = tmp_path / "mine.toml"
    lines = 'title = "mine"\nbed = "200x200x200mm"\nnozzle = "0.4mm"\n'
    nozzle = 'nozzles = [{ diameter = "0.4mm", line_width = "0.45mm", layer_height = "0.2mm" }]\n'
    path.write_text(f"{lines}{nozzle}machine = {machine}\n")
    with pytest.raises(InputError, match=message) as raised:
        designer.ico(edge_mm=20, printer=str(path))
    assert len(str(raised.value).splitlines()) == 1


def test_contours_are_what_one_walks_along() -> None:
    """Point after point, each contour from its first one on."""
    rng = np.random.default_rng(0)
    for count in (1, 2, 3, 7, 64, 500):
        following, walked, left = rng.permutation(count), list[list[int]](), set(range(count))
        while left:
            at, loop = min(left), list[int]()
            while at in left:
                left.remove(at)
                loop.append(at)
                at = int(following[at])
            walked += [loop] if len(loop) > 2 else []
        points = np.repeat(np.arange(count, dtype=float)[:, None], 2, axis=1)
        assert [loop[:, 0].tolist() for loop in contours(points, following)] == walked


@pytest.mark.parametrize("price", ["cheap", "-1", "20 euros", "1e9", "", "nan", True])
def test_a_price_is_a_number(price: str | bool) -> None:
    """With its currency, or in EUR; a spec's file repeats both."""
    made = designer.ico(edge_mm=20, filament_price="30.5 usd").design.job
    assert made.printing.filament_price == Price(30.5, "USD")
    assert size_job(parse_spec(tomllib.loads(spec_to_toml(made)), "")).job == made
    assert designer.ico(edge_mm=20, filament_price=30).design.job.printing.filament_price == Price(30.0, "EUR")
    with pytest.raises(InputError, match=r"filament_price.*must be a number from 0 to 10000"):
        designer.ico(edge_mm=20, filament_price=price)
