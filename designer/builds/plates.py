"""What lies on which plate, in pictures with time and weight."""

from collections.abc import Iterator

import numpy as np
from manifold3d import CrossSection, JoinType

from designer.base.arrays import Array
from designer.builds.design import Design
from designer.formats.png import Thumbnails, bed_thumbnails
from designer.make.bed import Piece, Plate
from designer.make.estimate import duration, grams
from designer.make.mesh import solid_of
from designer.page.blocks import Figure, Fold, Leaf, Link, Paragraph, Svg
from designer.spec.machine import Area

_LINE, _INK, _HIDDEN = "#22262b", "#22262b", 'stroke="#8a9099" stroke-width="0.3" stroke-dasharray="1 0.7"'
_PX_PER_MM = 96 / 25.4


def plate_folds(design: Design) -> tuple[Fold, ...]:
    """Each plate as its slicer shows it from above, what it takes, and its files; those without ink are closed."""
    printing, has_files, inked, plain = design.job.printing, "3mf" in design.job.formats, list[Leaf](), list[Leaf]()
    for plate, takes in zip(design.plates, design.estimate.plates, strict=True):
        stem = f"{design.job.name}.{plate.name}"
        links = tuple(Link(f"{stem}.{kind}.3mf", f"{stem}.{kind}.3mf") for kind in ("prusa", "bambu") if has_files)
        free = " and a free place for the prime tower" * plate.is_two_filament
        alt = f"The bed of {plate.name} from above with {plate.words}{free}."
        weight = grams(takes.body_g * (1 + takes.ink_mm3 / takes.body_mm3))
        changes = f", {takes.changes} changes" if takes.inked_layers else ""
        caption = f"{duration(takes.time_s)}, {weight}{changes}."
        title = f"{plate.name.replace('-', ' ').capitalize()}: {plate.words}"
        figure = Figure(title, plate_picture(design, plate), alt, caption, links)
        (inked if plate.is_two_filament else plain).append(figure)
    said = (
        "From above, in the order to print",
        "dashed rings lie on the bed" * (printing.ink_side == "down"),
        "hatched: not to be printed on" * bool(printing.printer.machine.excluded_mm),
    )
    words = Paragraph(f"{'; '.join(filter(None, said))}.")
    others = f"{len(plain)} plate{'s' * (len(plain) > 1)} in one filament"
    return (
        Fold(f"{len(inked)} plate{'s' * (len(inked) > 1)} in two filaments", (words, *inked), is_open=True),
        *((Fold(others, tuple(plain)),) if plain else ()),
    )


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
    lines += [_box(area, depth, f'fill="url(#excluded)" {edge}') for area in printer.machine.excluded_mm]
    if plate.tower_area is not None:
        tower = plate.tower_area
        lines.append(_box(tower, depth, f'fill="none" {edge} stroke-dasharray="3 2"'))
        x, y = (tower[0] + tower[2]) / 2, depth - (tower[1] + tower[3]) / 2
        lines.append(f'<text x="{x:g}" y="{y:g}" font-size="7" fill="#b34f00">prime tower</text>')
    for piece in plate.pieces:
        lines += _piece_lines(design, piece, depth)
    return Svg("\n".join((*lines, "</svg>\n")).encode(), width * _PX_PER_MM, depth * _PX_PER_MM)


def plate_thumbnails(design: Design, plate: Plate) -> Thumbnails:
    """A plate from above, with ink that lies on the bed too."""
    printing = design.job.printing
    disks = [_disks(design, piece) for piece in plate.pieces if piece.part.ink is not None]
    outlines = [contour for piece in plate.pieces for contour in _shadow(piece)]
    width, depth, _ = printing.printer.bed_mm
    return bed_thumbnails((width, depth), outlines, np.concatenate([np.empty((0, 4)), *disks]), printing)


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
    is_hidden = design.job.printing.ink_side == "down"
    for x, y, inner, outer in _disks(design, piece).tolist():
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


def _disks(design: Design, piece: Piece) -> Array:
    """Rings and dots of a piece on the bed: x, y, inner and outer radius.  # (N, 4)"""
    target = design.target
    kind, number = piece.name.split()
    if kind == "tile":
        mine = target.ring_face == int(number)
    else:
        assert target.ring_piece is not None  # noqa: S101 - of a board in pieces
        mine = target.ring_piece == int(number) - 1
    motion = piece.bed_from_part
    at = design.scale * target.center_in_face_mm[mine] @ motion[:3, :3].T + motion[:3, 3]
    radii = design.scale * np.stack([target.radius_inner_mm[mine], target.radius_outer_mm[mine]], axis=1)
    return np.hstack([at[:, :2], radii])


def _shadow(piece: Piece) -> list[Array]:
    """What a piece covers of the bed, without specks; what has ink is convex, but for pieces of boards with teeth."""
    body = piece.as_it_lies.body
    if piece.part.ink is not None and not piece.name.startswith("piece"):
        outline = CrossSection.hull_points(body.vertices_mm[:, :2])
    else:
        outline = solid_of(body).project().offset(0.3, JoinType.Miter).offset(-0.3, JoinType.Miter)
    return [np.asarray(polygon) for polygon in outline.to_polygons()]
