"""The page's section on a solid in parts: its plates, its pieces, and the steps from printer to measured target.

A solid in parts, taken apart in 3D.

The page's section on a board in pieces: what lies on which plate, how pieces are joined, and a plan from behind.
"""

import math
from collections.abc import Sequence
from dataclasses import replace
from operator import itemgetter

import numpy as np
from manifold3d import triangulate

from designer.base.arrays import Array
from designer.base.words import runs
from designer.builds.design import Design
from designer.builds.plates import plate_folds
from designer.builds.slicing import print_settings, slicer_folds
from designer.formats.folder import OutputFile
from designer.formats.svg import decimal
from designer.make.assembly import Assembly
from designer.make.bed import Plate
from designer.make.board_tiles import BOW_TIE_MM, BoardInPieces
from designer.make.estimate import grams
from designer.make.mesh import mesh_of, wall_strip
from designer.page.blocks import Block, Figure, Fold, Section, Steps, Svg, Table, View3d, text_table
from designer.page.folders import Shown, table_of
from designer.page.pictures import drawing_of_svg
from designer.page.scene import Labels, Layer, Scene, Surface
from designer.target import TargetGeometry
from designer.target_scene import target_layers

TILES_OUT = 0.32
"""How far tiles are drawn away from their seats, over the edge."""
PARTS_OUT = 0.75
"""The same of the core's upper part; a post goes as far."""
INSIDE_OUT = 1.6
"""The same of a socket, which goes in from inside: out through the open bowl, below the ring."""
PLATE_COLOURS = ("#d55e00", "#009e73", "#0072b2", "#cc79a7", "#e69f00", "#56b4e9", "#f0e442")
"""Okabe and Ito's (2008), which colour-blind people tell apart; more plates begin again."""
CORE_COLOUR, POST_COLOUR = "#9aa1a9", "#5b636c"


def exploded_scene(design: Design, assembly: Assembly) -> Scene:
    """Tiles away from the core, the core taken apart; the sides of tiles tell the plate."""
    target, printing, edge = design.target, design.job.printing, assembly.solid.edge_mm
    lift = {part.name: (PARTS_OUT * edge if part.name in ("cap", "lid") else 0.0) * part.up for part in assembly.core}
    lift["ring"] = 0.5 * lift.get("cap", np.zeros(3))
    lift["socket"] = INSIDE_OUT * edge * -assembly.target_from_post[:3, 2]
    step = np.zeros((target.face_count, 3))
    for part in assembly.core:
        for face in part.seats:
            step[face] = lift[part.name] + TILES_OUT * edge * target.target_from_face[face, :3, 2]
    apart = _moved(target, step)
    tiles = target_layers(apart, body_colour=printing.body_colour, ink_colour=printing.ink_colour)
    plate_of = {piece.name: row for row, plate in enumerate(design.plates) for piece in plate.pieces}
    backs = tuple(
        _tile_back(assembly, apart, face, _colour(plate_of[f"tile {face}"])) for face in range(target.face_count)
    )
    core = [
        Surface(mesh.vertices_mm + lift[part.name], mesh.triangles.astype(np.int64), CORE_COLOUR)
        for part in assembly.core
        for mesh in (mesh_of(part.solid),)
    ]
    if assembly.post is not None:
        mesh = mesh_of(assembly.post)
        out = 0.5 * PARTS_OUT * edge * assembly.target_from_post[:3, 2]
        core.append(Surface(mesh.vertices_mm + out, mesh.triangles.astype(np.int64), POST_COLOUR))
    size = 0.09 * edge
    normals = apart.target_from_face[:, :3, 2]
    above = apart.target_from_face[:, :3, 3] + 0.06 * edge * normals
    numbers = Labels(above, normals, tuple(map(str, range(target.face_count))), size)
    legend = tuple(
        (_colour(row), f"{plate.words}: {plate.name.replace('-', ' ')}")
        for row, plate in enumerate(design.plates)
        if plate.is_two_filament
    )
    post = () if assembly.post is None else ((POST_COLOUR, "post"),)
    layers = (Layer("tiles", (*tiles[0].shapes, *backs)), Layer("numbers", (numbers,)), Layer("core", tuple(core)))
    return Scene(layers, (0.0, 0.0, 1.0), (1.0, 0.35, 0.5), (*legend, (CORE_COLOUR, "core"), *post))


def _colour(plate: int) -> str:
    return PLATE_COLOURS[plate % len(PLATE_COLOURS)]


def _moved(target: TargetGeometry, step_mm: Array) -> TargetGeometry:
    """The target with its faces moved.  # (F, 3)"""
    frames = target.target_from_face.copy()
    frames[:, :3, 3] += step_mm
    return replace(target, target_from_face=frames, center_mm=target.center_mm + step_mm[target.ring_face])


def _tile_back(assembly: Assembly, apart: TargetGeometry, face: int, colour: str) -> Surface:
    """The sides and the back of a tile."""
    sizes = assembly.sizes
    top, back = sizes.outline_mm, sizes.outline_at(sizes.thickness_mm)
    count = len(top)
    points = np.concatenate(
        [np.column_stack([top, np.full(count, -0.05)]), np.column_stack([back, np.full(count, -sizes.thickness_mm)])]
    )
    ids = np.arange(2 * count, dtype=np.int32).reshape(2, count)
    triangles = np.concatenate([wall_strip(ids[0], ids[1]), triangulate([back])[:, ::-1].astype(np.int32) + count])
    frame = apart.target_from_face[face]
    return Surface(points @ frame[:3, :3].T + frame[:3, 3], triangles.astype(np.int64), colour)


_LIES = {
    "cap": "open side down", "bowl": "open side down", "core": "open side down", "lid": "seat up", "ring": "flat",
    "socket": "pit up",
}  # fmt: skip


def assembling_section(design: Design, assembly: Assembly, files: Sequence[OutputFile]) -> Section:
    """How to print and assemble it."""
    count, inked = len(design.target.target_from_face), sum(plate.is_two_filament for plate in design.plates)
    sizes = assembly.sizes
    lead = (
        f"{count} flat tiles on {inked} plate{'s' * (inked > 1)} in two filaments, a core in one; each tile can be "
        "printed again alone."
    )
    view = View3d(
        "Taken apart",
        exploded_scene(design, assembly),
        f"{count} numbered tiles around a core; the colour of their backs tells the plate that they are printed on.",
        caption="Numbers are engraved on backs and in seats.",
    )
    lying = "face up: ink in the last layers, matt, less flat than the bed; --ink-side down: smooth, and shines"
    gloss: tuple[str, ...] = ()
    if sizes.ink_side == "down":
        lying = "face down: ink in the first layers, as flat and glossy as the bed; a textured sheet gives it grain"
        gloss = ("Mat faces that shine: thin matt varnish, or wet abrasive of grit 1000; try one tile.",)
    outline = f"; the chamfer of {sizes.chamfer_mm:g} mm is for the foot, {sizes.clearance_mm:g} mm between neighbours"
    look = Steps((
        "Let the bed cool before you take tiles off: bent warm they stay bent.",
        "Print a tile again that bows by more than 0.1 mm under a steel rule.",
        "Cut off strings and blobs at edge and back.",
        *gloss,
    ))  # fmt: skip
    blocks: tuple[Block, ...] = (
        view,
        print_settings(design, design.job.printing.printer.machine.shells, lying, outline),
        *plate_folds(design),
        *slicer_folds(design, files),
        Fold("Look at the tiles, then assemble", (look, _core_table(design, assembly), _steps(design, assembly))),
    )  # fmt: skip
    return Section("Making it", blocks, lead)


def _core_table(design: Design, assembly: Assembly) -> Table:
    """The pieces of the core: how they lie, and their weight if solid walls and sparse infill are as set."""
    takes = {plate.name: estimate for plate, estimate in zip(design.plates, design.estimate.plates, strict=True)}
    stem = "stem up" if assembly.mounted is not None and assembly.mounted.mount.up_is_in else "stem down"
    rows = []
    for plate in design.plates:
        if plate.is_two_filament:
            continue
        together = sum(piece.part.body.volume_mm3 for piece in plate.pieces)
        for piece in plate.pieces:
            corners = piece.part.body.vertices_mm @ piece.bed_from_part[:3, :3].T
            size = " x ".join(f"{length:.0f}" for length in (corners.max(axis=0) - corners.min(axis=0)))
            part = next((one for one in assembly.core if one.name == piece.name), None)
            seats = "" if part is None else runs(part.seats)
            alone = len(plate.pieces) == 1
            share = takes[plate.name].body_g * piece.part.body.volume_mm3 / together
            rows.append((
                piece.name, _LIES.get(piece.name, stem), f"{size} mm",
                grams(share) if alone else f"about {grams(share)}", seats,
            ))  # fmt: skip
    heads = ("piece", "how it lies", "size", "weight", "seats")
    return text_table("Pieces of the core", heads, rows)


def _steps(design: Design, assembly: Assembly) -> Steps:
    """From pieces to a solid."""
    sizes, split = assembly.sizes, {part.name: part for part in assembly.core}
    key = (
        "A tile whose pins do not go in flat belongs elsewhere."
        if sizes.has_pins
        else f"Cut {3 * len(assembly.tiles)} pegs of {sizes.peg_length_mm - 0.5:.1f} mm from filament of 1.75 mm, "
        "three a tile; with them in its back it goes into one seat in one orientation."
    )
    upper = split.get("cap") or split.get("lid")
    order = [
        *(f for part in assembly.core if part is not upper for f in part.seats),
        *(() if upper is None else upper.seats),
    ]
    steps = [
        f"Put all tiles on dry first, by their numbers. {key}",
        "Each touches the three pads of its seat without rocking, and no neighbour. If one is too high, push it out "
        "through the seat's hole; clean pads and holes.",
        f"Slow glue, a film of {sizes.glue_gap_mm:g} mm around the seat's hole, none on the pads. Press until it "
        "holds; wipe the seams.",
        f"Order: {runs(order)}, or any other.",
    ]
    if design.job.printing.jig:
        name, angle = design.job.name, math.degrees(assembly.solid.polyhedron.dihedral_rad)
        steps.append(
            f"{name}.press.stl, rim on the tile's border, loads all pads; {name}.jig.stl, pressed over an edge while "
            f"the glue sets, brings its faces to {angle:.2f} deg. Print them as in the files: rim up, and on end."
        )
    if "ring" in split:
        steps.append(
            "Glue the ring into the cap, its gap over the rib; cap on the bowl, whose rib lets it in one way. A few "
            "drops hold it; without, it comes off again."
        )
    if "lid" in split and upper is not None:
        steps.append(f"Put the lid in before tile {upper.seats[0]}, which holds it.")
    if assembly.mounted is not None:
        socket = "Glue the socket into the bowl from inside, slopes against slopes, its pit outwards. "
        mount = assembly.mounted.mount
        steps.insert(
            0,
            f"{socket * ('socket' in split)}The post ({mount.title}) takes {mount.needs}: {mount.source}. {mount.how} "
            "Glue the post into the pit.",
        )
    return Steps((*steps, "Let the glue harden for a day before you measure: it shrinks."))


_PIECE, _LINE, _KEY, _INK = "#e4e4e4", "#6b6b6b", "#d55e00", "#1a1a1a"


def jointing_section(design: Design, board: BoardInPieces, files: Sequence[OutputFile]) -> Section:
    """From plates to a board."""
    keys, plates = 2 * len(board.seams), design.plates
    inked = sum(plate.is_two_filament for plate in plates)
    lead = (
        f"{len(board.pieces)} flat pieces on {inked} plate{'s' * (inked > 1)} in two filaments, joined from behind by "
        f"{keys} keys in one."
    )
    lying = "printed side down: the bed makes the ink flat"
    width, height = design.job.target.size_words.split("x")[:2]
    alt = f"The {len(board.pieces)} pieces seen from behind with their numbers, and the keys across their seams."
    caption = f"As they are joined, face down, the board's upper side up. {width} x {height} mm; orange: keys."
    blocks: tuple[Block, ...] = (
        Figure("The pieces from behind", plan_svg(board), alt, caption),
        _pieces_table(board, plates),
        print_settings(design, design.job.printing.printer.machine.shells, lying),
        *plate_folds(design),
        *slicer_folds(design, files),
        Fold("Join the pieces", (_joining_steps(design, board),)),
    )
    return Section("Making it", blocks, lead)


def plan_svg(board: BoardInPieces) -> Svg:
    """A drawing of the assembled board from behind, numbers as they are engraved."""
    low = [min(piece.low_mm[k] for piece in board.pieces) for k in (0, 1)]
    high = [max(piece.high_mm[k] for piece in board.pieces) for k in (0, 1)]
    width, height = high[0] - low[0], high[1] - low[1]
    lines = [
        f'<svg xmlns="http://www.w3.org/2000/svg" width="{decimal(width)}mm" height="{decimal(height)}mm" '
        f'viewBox="0 0 {decimal(width)} {decimal(height)}">'
    ]
    for piece in board.pieces:
        x, y = ((piece.low_mm[k] + piece.high_mm[k]) / 2 for k in (0, 1))
        wide, tall = piece.high_mm[0] - piece.low_mm[0], piece.high_mm[1] - piece.low_mm[1]
        size = min(wide, tall) / 4
        lines += [
            f'<polygon points="{_from_behind(piece.outline_mm, high)}" '
            f'fill="{_PIECE}" stroke="{_LINE}" stroke-width="{decimal(width / 400)}"/>',
            f'<text x="{decimal(high[0] - x)}" y="{decimal(high[1] - y + size / 3)}" '
            f'font-size="{decimal(size)}" text-anchor="middle" fill="{_INK}">{piece.number}</text>',
        ]
    lines += [
        f'<polygon points="{_from_behind(middle + BOW_TIE_MM @ np.stack([seam.across, seam.along]), high)}" '
        f'fill="{_KEY}"/>'
        for seam in board.seams
        for middle in seam.keys_mm
    ]
    lines.append("</svg>\n")
    return drawing_of_svg("\n".join(lines).encode())


def _from_behind(corners: Array, high: list[float]) -> str:
    """Points of the board's front as they are drawn from behind."""
    return " ".join(f"{decimal(high[0] - x)},{decimal(high[1] - y)}" for x, y in corners.tolist())


def _pieces_table(board: BoardInPieces, plates: Sequence[Plate]) -> Table:
    """Where each piece is printed, and which it joins."""
    plate_of = {piece.name: plate.name.replace("-", " ") for plate in plates for piece in plate.pieces}
    rows = []
    for row, piece in enumerate(board.pieces):
        beside = sorted(board.pieces[other].number for s in board.seams for other in s.pieces if row in s.pieces)
        joins = ", ".join(str(number) for number in beside if number != piece.number)
        size = " x ".join(f"{length:.1f}" for length in np.ptp(piece.outline_mm, axis=0).tolist())
        name = plate_of[f"piece {piece.number}"]
        rows.append((piece.number, size, name, joins))
    keys = sorted({plate_of[name] for name in plate_of if name.startswith("key")})
    note = f"Numbers are engraved on backs and at seams. Keys, all alike: {', '.join(keys)}."
    heads = ("piece", "size, mm", "plate", "joins")
    columns = [Shown[tuple[int, str, str, str]](head, itemgetter(k)) for k, head in enumerate(heads)]
    return table_of(rows, *columns, title="Pieces", note=note, visible_rows=20)


def _joining_steps(design: Design, board: BoardInPieces) -> Steps:
    """Face down on something flat."""
    printer = design.job.printing.printer
    return Steps((
        "Cut brims off flush: they open seams. Print a piece again that rocks under a straight edge.",
        "Lay baking paper on glass or stone larger than the board: the board becomes as flat as that.",
        "Lay the pieces face down as in the plan. Where pockets do not meet, a piece is turned or in the wrong place.",
        f"Push together until the two pads of each seam touch; between them {printer.clearance_mm:g} mm stay open, "
        "without glue.",
        f"Try all keys dry: {printer.clearance_mm:g} mm on every side, a layer below the back. Too tight or loose: "
        "change the clearance in the printer's file (--printer), print them again.",
        "Glue the keys from the middle outwards: a drop of superglue or slow epoxy a pocket, a flat weight on it.",
        "Keys do not hold pieces flat: glue the back all over on a stiff plate (aluminium composite of 6 mm, glass), "
        "the face still on the flat surface.",
        "calib measure finds where each ring lies: calibrate with its target file.",
    ))  # fmt: skip
