"""What lies on which plate, as a table and in pictures, and how plates are opened in each slicer."""

from collections.abc import Iterator, Sequence

import numpy as np
from manifold3d import CrossSection, JoinType

from designer.base.arrays import Array
from designer.base.words import capital
from designer.kinds.board_cuts import strip_mm
from designer.make.bed import TOWER_MM, Piece, Plate
from designer.make.mesh import solid_of
from designer.page.blocks import Figure, Fold, Leaf, Link, Steps, Svg, Table, text_table
from designer.produce import Design
from designer.report.costs import grams
from designer.report.making import SLICERS, Slicer, colour_words, usual_slicer
from designer.spec.machine import Area

_LINE, _INK, _HIDDEN = "#22262b", "#22262b", 'stroke="#8a9099" stroke-width="0.3" stroke-dasharray="1 0.7"'
_PX_PER_MM = 96 / 25.4


def plate_table(design: Design) -> Table:
    """What is on which plate, and its weight; hours and changes are told once, with the costs."""
    rows = []
    for plate, takes in zip(design.plates, design.estimate.plates, strict=True):
        filaments = "1 and 2" if plate.is_two_filament else "1"
        weight = grams(takes.body_g * (1 + takes.ink_mm3 / takes.body_mm3))
        rows.append((plate.name.replace("-", " "), plate.words, filaments, weight))
    heads = ("plate", "holds", "filaments", "weight")
    return text_table("Plates, in this order", heads, rows, visible_rows=20)


def plate_figures(design: Design) -> tuple[Leaf, ...]:
    """Each plate as its slicer shows it from above, with its files."""
    printing, has_files, figures = design.job.printing, "3mf" in design.job.formats, []
    below = "Dashed: rings and dots on the side that lies on the bed" if printing.ink_side == "down" else ""
    hatched = "Hatched: may not be printed on" if printing.printer.excluded_mm else ""
    for plate in design.plates:
        stem = f"{design.job.name}.{plate.name}"
        links = tuple(Link(f"{stem}.{kind}.3mf", f"{stem}.{kind}.3mf") for kind in ("prusa", "bambu") if has_files)
        alt = f"The bed from above with {plate.words}{' and a free place for the prime tower' * plate.is_two_filament}."
        caption = ". ".join(part for part in ("Seen from above", below * plate.is_two_filament, hatched) if part)
        title = f"{plate.name.replace('-', ' ').capitalize()}: {plate.words}"
        figures.append(Figure(title, plate_picture(design, plate), alt, f"{caption}.", links))
    return tuple(figures)


def plate_picture(design: Design, plate: Plate) -> Svg:
    """A plate from above: what is seen in full lines, ink that lies on the bed in dashed ones."""
    printer = design.job.printing.printer
    width, depth, _ = printer.bed_mm
    lines = [
        f'<svg xmlns="http://www.w3.org/2000/svg" viewBox="0 0 {width:g} {depth:g}" width="{width:g}mm" '
        f'height="{depth:g}mm" font-family="sans-serif" text-anchor="middle">',
        '<defs><pattern id="excluded" width="4" height="4" patternUnits="userSpaceOnUse">'
        '<path d="M0 4L4 0" stroke="#d55e00" stroke-width="0.6"/></pattern></defs>',
        f'<rect width="{width:g}" height="{depth:g}" fill="#f4f5f6" stroke="#8a9099" stroke-width="0.6"/>',
    ]
    edge = 'stroke="#d55e00" stroke-width="0.6"'
    lines += [_box(area, depth, f'fill="url(#excluded)" {edge}') for area in printer.excluded_mm]
    if plate.is_two_filament:
        tower = _tower_area(design)
        lines.append(_box(tower, depth, f'fill="none" {edge} stroke-dasharray="3 2"'))
        x, y = (tower[0] + tower[2]) / 2, depth - (tower[1] + tower[3]) / 2
        lines.append(f'<text x="{x:g}" y="{y:g}" font-size="7" fill="#b34f00">prime tower</text>')
    for piece in plate.pieces:
        lines += _piece_lines(design, piece, depth)
    return Svg("\n".join((*lines, "</svg>\n")).encode(), width * _PX_PER_MM, depth * _PX_PER_MM)


def _tower_area(design: Design) -> Area:
    """The place that is left free for it."""
    printer = design.job.printing.printer
    width, depth, _ = printer.bed_mm
    if design.job.target.solid is not None:
        return width - TOWER_MM, depth - TOWER_MM, width, depth
    left, front = strip_mm(printer).tolist()
    return 0.0, 0.0, left or width, front or depth


def _box(area: Area, depth_mm: float, style: str) -> str:
    left, front, right, rear = area
    size = f'width="{right - left:g}" height="{rear - front:g}"'
    return f'<rect x="{left:g}" y="{depth_mm - rear:g}" {size} {style}/>'


def _piece_lines(design: Design, piece: Piece, depth_mm: float) -> Iterator[str]:
    """What it covers of the bed, its rings and dots, its name."""
    lies = piece.as_it_lies
    shadow = _shadow(piece)
    path = "".join(
        "M" + "L".join(f"{x:.2f} {depth_mm - y:.2f}" for x, y in polygon.tolist()) + "Z" for polygon in shadow
    )
    yield f'<path d="{path}" fill="#ffffff" fill-rule="evenodd" stroke="{_LINE}" stroke-width="0.5"/>'
    points = np.concatenate(shadow)
    (x, y), size, text = ((points.max(axis=0) + points.min(axis=0)) / 2).tolist(), 7.0, piece.name
    if lies.ink is not None:
        yield from _ink_lines(design, piece, depth_mm)
        kind, text = piece.name.split()
        if kind == "tile":
            x, y = piece.bed_from_part[:2, 3].tolist()
        size = 0.2 * float(np.ptp(points, axis=0).min())
    yield (
        f'<text x="{x:.2f}" y="{depth_mm - y + size / 3:.2f}" font-size="{size:.1f}" font-weight="bold" '
        f'fill="#0b3d66" stroke="#ffffff" stroke-width="{size / 6:.2f}" paint-order="stroke">{text}</text>'
    )


def _ink_lines(design: Design, piece: Piece, depth_mm: float) -> Iterator[str]:
    """Rings as rings and dots as dots, dashed where they lie on the bed."""
    target, is_hidden = design.target, design.job.printing.ink_side == "down"
    kind, number = piece.name.split()
    if kind == "tile":
        mine = target.ring_face == int(number)
    else:
        assert target.ring_piece is not None  # noqa: S101 - of a board in pieces
        mine = target.ring_piece == int(number) - 1
    motion = piece.bed_from_part
    at = design.scale * target.center_in_face_mm[mine] @ motion[:3, :3].T + motion[:3, 3]
    radii = design.scale * np.stack([target.radius_inner_mm[mine], target.radius_outer_mm[mine]], axis=1)
    for (x, y, _), (inner, outer) in zip(at.tolist(), radii.tolist(), strict=True):
        place = f'<circle cx="{x:.2f}" cy="{depth_mm - y:.2f}"'
        if not is_hidden and inner:
            stroke = f'stroke="{_INK}" stroke-width="{outer - inner:.2f}"'
            yield f'{place} r="{(inner + outer) / 2:.2f}" fill="none" {stroke}/>'
        elif not is_hidden:
            yield f'{place} r="{outer:.2f}" fill="{_INK}"/>'
        else:
            yield f'{place} r="{outer:.2f}" fill="#e3e6ea" {_HIDDEN}/>'
            if inner:
                yield f'{place} r="{inner:.2f}" fill="#ffffff" {_HIDDEN}/>'


def _shadow(piece: Piece) -> list[Array]:
    """What a piece covers of the bed, without specks; what has ink is convex."""
    body = piece.as_it_lies.body
    if piece.part.ink is not None:
        outline = CrossSection.hull_points(body.vertices_mm[:, :2])
    else:
        outline = solid_of(body).project().offset(0.3, JoinType.Miter).offset(-0.3, JoinType.Miter)
    return [np.asarray(polygon) for polygon in outline.to_polygons()]


def plate_folds(design: Design, files: Sequence[str]) -> tuple[Fold, ...]:
    """A fold for each slicer, that of the printer first."""
    first = usual_slicer(design.job.printing.printer)
    folds = ((one.title, _steps(design, one, files)) for one in sorted(SLICERS, key=lambda one: one.title != first))
    return tuple(Fold(title, (steps,)) for title, steps in folds if steps is not None)


def _steps(design: Design, slicer: Slicer, files: Sequence[str]) -> Steps | None:
    """From the files to the printer; None: there are none for it."""
    printing, slot = design.job.printing, slicer.slot
    project, first = f"{design.job.name}.{slicer.project}", f"{design.job.name}.plate-1.{slicer.package}"
    is_project = project in files
    if not is_project and first not in files:
        return None
    one_by_one = f"open {first}, later the other plates, each as a project of its own"
    opening = (slicer.choose, f"{capital(one_by_one)}. {slicer.opened}")
    if is_project:
        opening = _opening_project(design, project, one_by_one if first in files else "write --formats 3mf and open it")
    tower = "it stands there" if is_project else "put it there"
    body, ink = colour_words(printing.body_colour), colour_words(printing.ink_colour)
    return Steps((
        *opening,
        f"{capital(slot)} 1 is {body}, {slot} 2 is {ink}, of one material.",
        "If it asks whether objects of equal height are parts of one object: no. What has ink is an object with two "
        "parts, body and ink; what has none, an object with one.",
        f"Look at the object list: body in {slot} 1 and ink in {slot} 2 in every object with ink. If a number differs, "
        "set it on the part, not on the object.",
        f"Don't arrange: the plate is full, and the free corner or strip is the prime tower's: {tower}. A piece "
        "may be moved; don't turn any: the axes of calib measure are then not the printer's.",
        f"Set the values of the table above. {slicer.purge}".strip(),
        f"Slice, and look at the preview by {slicer.preview}: on plates with ink every ring whole, and one filament "
        "only above the ink; all others in one filament.",
    ))  # fmt: skip


def _opening_project(design: Design, project: str, instead: str) -> tuple[str, str]:
    """One file for all of them, and what to do if it is not taken for one."""
    presets = design.job.printing.printer.presets
    assert presets is not None  # noqa: S101 - else there is no project
    return (
        f"Open {project} as a project (File, Open Project): it holds the {len(design.plates)} plates, named and "
        f"locked, with the pieces in place. It asks for the presets {presets.printer}, {presets.process} and "
        f"{presets.filament}, unchanged, and for the plate type {presets.plate_type}: put your own filaments and plate "
        "in their place.",
        "This file keeps to the rules in the published sources of both programs; it was not opened in the programs "
        "themselves. Compare with the pictures of the plates before you slice. If there is but one plate, or a notice "
        f"says that only geometry is loaded, {instead}.",
    )
