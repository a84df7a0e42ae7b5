"""Pictures of a solid in parts: taken apart in 3D, and each plate from above."""

from dataclasses import replace

import numpy as np
from manifold3d import JoinType, triangulate
from numpy.typing import NDArray

from designer.make.assembly import Assembly
from designer.make.booleans import mesh_of, solid_of
from designer.make.mesh import Mesh, wall_strip
from designer.make.plate import Piece, Plate
from designer.make.tower import TOWER_MM
from designer.page.blocks import Svg
from designer.page.scene import Labels, Layer, Scene, Surface
from designer.produce import Design
from designer.target import TargetGeometry
from designer.target_scene import target_layers

Array = NDArray[np.float64]

TILES_OUT = 0.32
"""How far tiles are drawn away from their seats, over the edge."""
PARTS_OUT = 0.75
"""The same of the core's upper part; a post goes as far."""
INSIDE_OUT = 1.6
"""The same of a socket, which goes in from inside: out through the open bowl, below the ring."""
PLATE_COLOURS = ("#d55e00", "#009e73", "#0072b2", "#cc79a7", "#e69f00", "#56b4e9", "#f0e442")
"""Okabe and Ito's (2008), which colour-blind people tell apart; more plates begin again."""
CORE_COLOUR, POST_COLOUR = "#9aa1a9", "#5b636c"
_PX_PER_MM = 96 / 25.4


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
    layers = (
        Layer("tiles", (*tiles[0].shapes, *backs)), Layer("numbers", (numbers,)), Layer("core", tuple(core)),
    )  # fmt: skip
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
    points = np.concatenate([
        np.column_stack([top, np.full(count, -0.05)]), np.column_stack([back, np.full(count, -sizes.thickness_mm)]),
    ])  # fmt: skip
    ids = np.arange(2 * count, dtype=np.int32).reshape(2, count)
    triangles = np.concatenate([wall_strip(ids[0], ids[1]), triangulate([back])[:, ::-1].astype(np.int32) + count])
    frame = apart.target_from_face[face]
    return Surface(points @ frame[:3, :3].T + frame[:3, 3], triangles.astype(np.int64), colour)


def plate_picture(design: Design, assembly: Assembly, plate: Plate) -> Svg:
    """A plate from above: outlines, names, the corner of the prime tower; ink below the tiles is grey."""
    width, depth, _ = design.job.printing.printer.bed_mm
    ink = "#b8bec5" if assembly.sizes.ink_side == "down" else "#22262b"
    lines = [
        f'<svg xmlns="http://www.w3.org/2000/svg" viewBox="0 0 {width:g} {depth:g}" width="{width:g}mm" '
        f'height="{depth:g}mm" font-family="sans-serif" text-anchor="middle">',
        f'<rect width="{width:g}" height="{depth:g}" fill="#f4f5f6" stroke="#8a9099" stroke-width="0.6"/>',
    ]
    if plate.is_two_filament:
        lines.append(
            f'<rect x="{width - TOWER_MM:g}" y="0" width="{TOWER_MM:g}" height="{TOWER_MM:g}" fill="none" '
            'stroke="#d55e00" stroke-width="0.6" stroke-dasharray="3 2"/>'
            f'<text x="{width - TOWER_MM / 2:g}" y="{TOWER_MM / 2:g}" font-size="7" fill="#b34f00">prime tower</text>'
        )
    for piece in plate.pieces:
        lines += _piece_lines(design, assembly, piece, depth, ink)
    return Svg("\n".join((*lines, "</svg>\n")).encode(), width * _PX_PER_MM, depth * _PX_PER_MM)


def _piece_lines(design: Design, assembly: Assembly, piece: Piece, depth_mm: float, ink: str) -> list[str]:
    """A piece: its shadow on the bed, rings as circles, its name."""
    lies = piece.as_it_lies
    shadow = [_hull_on_bed(assembly, piece)] if lies.ink is not None else _shadow(lies.body)
    path = "".join(
        "M" + "L".join(f"{x:.2f} {depth_mm - y:.2f}" for x, y in np.asarray(polygon).tolist()) + "Z"
        for polygon in shadow
    )
    lines = [f'<path d="{path}" fill="#ffffff" fill-rule="evenodd" stroke="#22262b" stroke-width="0.5"/>']
    size = 7.0
    if lies.ink is not None:
        face = int(piece.name.split()[1])
        mine = design.target.ring_face == face
        at = design.target.center_in_face_mm[mine] @ piece.bed_from_part[:3, :3].T + piece.bed_from_part[:3, 3]
        for (x, y, _), radius in zip(at.tolist(), design.target.radius_outer_mm[mine].tolist(), strict=True):
            lines.append(
                f'<circle cx="{x:.2f}" cy="{depth_mm - y:.2f}" r="{0.72 * radius:.2f}" fill="none" '
                f'stroke="{ink}" stroke-width="{0.5 * radius:.2f}"/>'
            )
        size = 0.35 * assembly.sizes.seat_inradius_mm + 2.0
    x, y = piece.bed_from_part[:2, 3].tolist() if lies.ink is not None else _middle(np.concatenate(shadow))
    text = piece.name.removeprefix("tile ")
    lines.append(
        f'<text x="{x:.2f}" y="{depth_mm - y + size / 3:.2f}" font-size="{size:.1f}" font-weight="bold" '
        f'fill="#0b3d66" stroke="#ffffff" stroke-width="{size / 6:.2f}" paint-order="stroke">{text}</text>'
    )
    return lines


def _shadow(body: Mesh) -> list[Array]:
    """What a body covers of the bed, without specks."""
    outline = solid_of(body).project().offset(0.3, JoinType.Miter).offset(-0.3, JoinType.Miter)
    return [np.asarray(polygon) for polygon in outline.to_polygons()]


def _hull_on_bed(assembly: Assembly, piece: Piece) -> Array:
    """A tile's outline at its widest, on the bed."""
    outline = assembly.sizes.outline_at(0.0)
    motion = piece.bed_from_part
    on_bed: Array = outline @ motion[:2, :2].T + motion[:2, 3]
    return on_bed


def _middle(points: Array) -> tuple[float, float]:
    """Of the box around points."""
    x, y = ((points.max(axis=0) + points.min(axis=0)) / 2).tolist()
    return x, y
