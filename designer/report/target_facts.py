"""Dimensions and codes of a target, as names and values for its page."""

from designer.base.code import CODES, code_positions
from designer.base.skew import NO_SKEW, format_skew
from designer.kinds.faces import adjacent_faces, opposite_faces
from designer.make.bed import printed_size_mm
from designer.make.clearance import narrowest_widths
from designer.page.blocks import Cell, Column, Facts, Leaf, Paragraph, Table
from designer.produce import Design
from designer.report.filament import Filament, two_digits
from designer.target import TargetGeometry

DOT, RING = "●", "○"


def dimension_facts(design: Design, filament: Filament | None) -> Facts:
    """What a drawing would say."""
    spec, target = design.job.target, design.target
    centre_mm = spec.ring_diameter_mm * spec.ring_ratio
    ring = [
        ("rings", _ring_words(target)),
        ("ring", f"diameter {spec.ring_diameter_mm:g} mm, white centre {centre_mm:.4g} mm"),
        ("pitch", f"{spec.pitch_mm:g} mm between neighbouring centres"),
        ("border", f"{spec.border_mm:g} mm" if spec.border_mm else "none"),
        ("narrowest", _narrowest_words(target)),
    ]  # fmt: skip
    made = _print_rows(design, filament)
    ids = [
        ("target id", target.geometry_id),
        ("layout id", target.layout_id),
    ]
    return Facts((*spec.facts(), *ring, *made, *ids))


def _ring_words(target: TargetGeometry) -> str:
    dots = int(target.is_dot.sum())
    total = f"{target.ring_count} in all, of which {dots} are dots"
    if target.is_planar:
        return total
    return f"{target.ring_count // target.face_count} on each of {target.face_count} faces, {total}"


def _narrowest_words(target: TargetGeometry) -> str:
    widths = narrowest_widths(target)
    parts = (
        ("stroke", widths.stroke_mm),
        ("gap", widths.gap_mm),
        ("margin", widths.margin_mm),
        ("border", widths.border_mm),
    )
    return ", ".join(f"{name} {width:.3g} mm" for name, width in parts if 0 < width < float("inf"))


def _print_rows(design: Design, filament: Filament | None) -> list[tuple[str, str]]:
    """Sizes of what is made."""
    printing = design.job.printing
    if filament is None:
        pages = design.pages
        width, height = pages[0].width_mm, pages[0].height_mm
        return [("sheet", f"{len(pages)} page{'s' * (len(pages) > 1)} of {width:.0f} x {height:.0f} mm")]
    size = " x ".join(f"{length:.1f}" for length in printed_size_mm(design.target, printing))
    rows = [("on the bed", f"{size} mm"), ("weight", f"about {two_digits(filament.total_g)} g in PLA")]
    if printing.is_two_filament:
        offset = f", grown by {printing.ink_offset_mm:+g} mm a side" if printing.ink_offset_mm else ""
        rows.append(("ink", f"{printing.inlay_mm:g} mm deep{offset}"))
    if printing.shrink_compensation_percent:
        rows.append(("shrinkage", f"files are {printing.shrink_compensation_percent:+g} % against the design"))
    if printing.skew_compensation_rad != NO_SKEW:
        rows.append(("skew", f"files are sheared against {format_skew(printing.skew_compensation_rad)}"))
    if printing.build == "stickers":
        rows.append(("sticker", f"{printing.sticker_thickness_mm:g} mm thick; the body is smaller by it on every face"))
    return rows


def code_blocks(design: Design) -> tuple[Leaf, ...]:
    """How faces are told apart, or how a board tells its orientation."""
    target = design.target
    return _face_codes(target) if target.has_codes else _origin_mark(target)


def _face_codes(target: TargetGeometry) -> tuple[Leaf, ...]:
    opposite = {a: b for pair in opposite_faces(target) for a, b in (pair, pair[::-1])}
    columns = (
        Column("face"),
        Column("marks", is_number=False, note="positions row by row from the code corner; ● dot, ○ ring"),
        Column("dots at (i, j)", is_number=False, note="index in the face's lattice, as in the target file"),
        Column("beside it", is_number=False, note="the faces across its edges, counter-clockwise from the code corner"),
        Column("opposite"),
    )
    beside = adjacent_faces(target).tolist()
    rows = tuple(
        (
            Cell(str(face), float(face)),
            Cell(_code_marks(int(code))),
            Cell(", ".join(str(index) for index in sorted(CODES[int(code)]))),
            Cell(", ".join(map(str, beside[face]))),
            Cell(str(opposite[face]), float(opposite[face])),
        )
        for face, code in enumerate(target.face_code.tolist())
    )
    positions = len(code_positions(int(target.face_code[0])))
    note = (
        f"Three of the {positions} positions in the corner of a face carry dots, in {target.face_count} different ways:"
        " so one face tells which it is and how it is turned. i counts from the code corner down the left side, j down "
        "the right side, the face seen from outside with its code corner up."
    )
    return (Table("Codes of the faces", columns, rows, note=note, visible_rows=20),)


def _code_marks(code: int) -> str:
    """`● ○○ ●○●`: the corner block, row by row from the code corner."""
    dots, place = CODES[code], code_positions(code)
    rows = sorted({i + j for i, j in place})
    return " ".join("".join(DOT if at in dots else RING for at in place if sum(at) == row) for row in rows)


def _origin_mark(target: TargetGeometry) -> tuple[Leaf, ...]:
    (dots,) = target.is_dot.nonzero()
    if not len(dots):
        text = "No dots: origin and orientation cannot be told from a photo, only up to the symmetry of the lattice."
        return (Paragraph(text),)
    columns = (
        Column("ring", note="row in the target file"),
        Column("index (i, j)", is_number=False),
        Column("x mm", note="from the middle of the board, to the right"),
        Column("y mm", note="upwards"),
    )
    place = target.center_in_face_mm
    rows = tuple(
        (
            Cell(str(dot), float(dot)),
            Cell(f"({target.ring_index[dot, 0]}, {target.ring_index[dot, 1]})"),
            Cell(f"{place[dot, 0]:.3f}", float(place[dot, 0])),
            Cell(f"{place[dot, 1]:.3f}", float(place[dot, 1])),
        )
        for dot in dots.tolist()
    )
    note = (
        "Three dots instead of rings mark origin and orientation; no turn and no mirror image maps them onto "
        "themselves. Keep them in every photo: a board whose dots are all hidden cannot be named."
    )
    return (Table("The origin mark", columns, rows, note=note),)
