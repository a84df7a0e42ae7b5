"""A solid in parts, taken apart in 3D."""

from dataclasses import replace

import numpy as np
from manifold3d import triangulate

from designer.base.arrays import Array
from designer.make.assembly import Assembly
from designer.make.booleans import mesh_of
from designer.make.mesh import wall_strip
from designer.page.scene import Labels, Layer, Scene, Surface
from designer.produce import Design
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
