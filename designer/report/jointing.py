"""The page's section on a board in pieces: what lies on which plate, how pieces are joined, and a plan from behind."""

from collections.abc import Sequence

from designer.formats.folder import OutputFile
from designer.formats.svg import decimal
from designer.make.board_tiles import KEY_END_MM, KEY_REACH_MM, KEY_WAIST_MM, BoardInPieces, Seam
from designer.make.plate import Plate
from designer.page.blocks import Block, Cell, Column, Figure, Fold, Section, Steps, Svg, Table
from designer.page.pictures import drawing_of_svg
from designer.produce import Design
from designer.report.making import print_settings
from designer.report.plates import plate_figures, plate_folds, plate_table

_PIECE, _LINE, _KEY, _INK, _PAPER = "#e4e4e4", "#6b6b6b", "#d55e00", "#1a1a1a", "#ffffff"


def jointing_section(design: Design, board: BoardInPieces, files: Sequence[OutputFile]) -> Section:
    """From plates to a board."""
    keys, plates = 2 * len(board.seams), design.plates
    inked = sum(plate.is_two_filament for plate in plates)
    lead = (
        f"{len(board.pieces)} flat pieces on {inked} plate{'s' * (inked > 1)} in two filaments, and {keys} keys in "
        "one; the keys join the pieces from behind."
    )
    blocks: tuple[Block, ...] = (
        _plan(design, board),
        _pieces_table(board, plates),
        plate_table(design),
        Fold("Plates", plate_figures(design)),
        *print_settings(design, design.job.printing.printer.machine.shells),
        *plate_folds(design, [file.name for file in files]),
        Fold("Join the pieces", (_joining_steps(design, board),), is_open=True),
    )
    return Section("Making it", blocks, lead)


def _plan(design: Design, board: BoardInPieces) -> Figure:
    """The assembled board from behind."""
    width, height = design.job.target.size_words.split("x")[:2]
    alt = f"The {len(board.pieces)} pieces seen from behind with their numbers, and the keys across their seams."
    caption = (
        f"From behind, the board's upper side up: so the pieces lie while they are joined, face down. {width} x "
        f"{height} mm; orange: keys."
    )
    return Figure("The pieces from behind", plan_svg(board), alt, caption)


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
        left, top = high[0] - piece.high_mm[0], high[1] - piece.high_mm[1]
        wide, tall = piece.high_mm[0] - piece.low_mm[0], piece.high_mm[1] - piece.low_mm[1]
        size = min(wide, tall) / 4
        lines += [
            f'<rect x="{decimal(left)}" y="{decimal(top)}" width="{decimal(wide)}" height="{decimal(tall)}" '
            f'fill="{_PIECE}" stroke="{_LINE}" stroke-width="{decimal(width / 400)}"/>',
            f'<text x="{decimal(left + wide / 2)}" y="{decimal(top + tall / 2 + size / 3)}" '
            f'font-size="{decimal(size)}" text-anchor="middle" fill="{_INK}">{piece.number}</text>',
        ]
    lines += [_key_svg(seam, middle, high) for seam in board.seams for middle in seam.keys_mm.tolist()]
    lines.append("</svg>\n")
    return drawing_of_svg("\n".join(lines).encode())


def _key_svg(seam: Seam, middle: list[float], high: list[float]) -> str:
    """A bow tie across its seam."""
    half, waist, end = KEY_REACH_MM, KEY_WAIST_MM / 2, KEY_END_MM / 2
    corners = []
    for across, along in ((-half, -end), (0.0, -waist), (half, -end), (half, end), (0.0, waist), (-half, end)):
        x, y = (middle[k] + across * float(seam.across[k]) + along * float(seam.along[k]) for k in (0, 1))
        corners.append(f"{decimal(high[0] - x)},{decimal(high[1] - y)}")
    return f'<polygon points="{" ".join(corners)}" fill="{_KEY}"/>'


def _pieces_table(board: BoardInPieces, plates: Sequence[Plate]) -> Table:
    """Where each piece is printed, and which it joins."""
    plate_of = {piece.name: plate.name.replace("-", " ") for plate in plates for piece in plate.pieces}
    columns = (
        Column("piece", note="as it is engraved on the back"),
        Column("size, mm", is_number=False),
        Column("plate", is_number=False),
        Column("joins", is_number=False, note="engraved at the seams"),
    )
    rows = []
    for row, piece in enumerate(board.pieces):
        beside = sorted(board.pieces[other].number for s in board.seams for other in s.pieces if row in s.pieces)
        joins = ", ".join(str(number) for number in beside if number != piece.number)
        size = " x ".join(f"{high - low:.1f}" for low, high in zip(piece.low_mm, piece.high_mm, strict=True))
        name = plate_of[f"piece {piece.number}"]
        rows.append((Cell(str(piece.number), float(piece.number)), Cell(size), Cell(name), Cell(joins)))
    keys = sorted({plate_of[name] for name in plate_of if name.startswith("key")})
    return Table("Pieces", columns, tuple(rows), note=f"Keys, all alike: {', '.join(keys)}.", visible_rows=20)


def _joining_steps(design: Design, board: BoardInPieces) -> Steps:
    """Face down on something flat."""
    printer = design.job.printing.printer
    return Steps((
        "Cut brims off flush and wipe the edges: what stands out of an edge opens the seam. A straight edge over each "
        "piece shows whether it is flat; print one that rocks again.",
        "Lay a flat surface, larger than the board: a pane of glass or a stone top, with a sheet of baking paper on it."
        " What is joined on it becomes as flat as it is.",
        "Lay the pieces face down as in the plan: their numbers up, readable, and at each seam the small numbers name "
        "the piece beside. No two seams have their keys the same way apart, so pockets that do not meet show a piece "
        "in the wrong place or the wrong way round.",
        f"Push them together until the two pads of each seam touch. Between the pads the seam stays open by "
        f"{printer.clearance_mm:g} mm; no glue goes in there.",
        f"Try all keys dry. They have {printer.clearance_mm:g} mm on every side and end a layer below the back. Too "
        "tight or loose: the printer's clearance is in its file (--printer), print the keys again.",
        "Glue the keys: a drop of superglue or slow epoxy in each pocket, key in, a flat weight on it. Begin in the "
        "middle and go outwards.",
        "Keys hold pieces beside each other, not flat: glue the back on a stiff plate (aluminium composite of 6 mm, or "
        "glass), all over and with the face still on the flat surface.",
        "Straight edge over every seam, both ways: light under it is an error of the target. calib measure finds "
        "where each ring lies by itself, and so how the pieces lie: it has no number for a piece. Calibrate with its "
        "target file.",
    ))  # fmt: skip
