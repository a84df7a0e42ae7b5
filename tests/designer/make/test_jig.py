"""What helps to glue tiles: the angle of every solid, measured in the mesh, and a press that touches no ring."""

import math
from dataclasses import replace

import numpy as np
import pytest
from manifold3d import Manifold

from designer.base.errors import InputError
from designer.base.solid import Polyhedron, Solid
from designer.kinds.cube import cube
from designer.kinds.ico import icosahedron
from designer.make.mesh import prism, solid_of
from designer.make.stand import PIT_MM, PLATE_MM, edge_jig, tile_press
from tests.support.designs import design_of

DIHEDRAL_DEG = {"cube": 90.0, "ico": 138.1897, "tetra": 70.5288, "octa": 109.4712, "dodeca": 116.5651}
"""Coxeter, Regular Polytopes, table I."""


def shape_of(name: str) -> Polyhedron:
    """A solid; of one that is no kind an icosahedron with its angle."""
    own = {"cube": cube(), "ico": icosahedron()}
    return own.get(name) or replace(icosahedron(), dihedral_rad=math.radians(DIHEDRAL_DEG[name]))


@pytest.mark.parametrize("name", DIHEDRAL_DEG)
def test_flanks_stand_at_the_dihedral_angle(name: str) -> None:
    """The two largest planes that face each other; upright on the bed, and nothing hangs over."""
    mesh = edge_jig(Solid(shape_of(name), 80.0))
    corner = mesh.vertices_mm[mesh.triangles]
    normal = np.cross(corner[:, 1] - corner[:, 0], corner[:, 2] - corner[:, 0])
    area = np.linalg.norm(normal, axis=1)
    normal /= area[:, None]
    flank = (normal[:, 1] > 1e-6) & (np.abs(normal[:, 0]) > 1e-6) & (np.abs(normal[:, 0]) < 1 - 1e-6)
    left, right = (normal[flank & (normal[:, 0] * side > 0)][0] for side in (-1, 1))
    assert math.degrees(math.pi - math.acos(left @ right)) == pytest.approx(DIHEDRAL_DEG[name], abs=1e-4)
    assert set(np.round(np.abs(normal[:, 2]), 9)) == {0.0, 1.0}
    assert solid_of(mesh).volume() > 0


def test_a_pair_of_faces_lies_flat_in_the_jig() -> None:
    """Two plates at the angle touch both flanks from end to end and run into nothing, their edge in the slot."""
    jig, tilt = solid_of(edge_jig(Solid(icosahedron(), 80.0))), math.radians((180 - DIHEDRAL_DEG["ico"]) / 2)
    plate = Manifold.cube((60.0, 4.0, 30.0)).translate((0.2, 0.0, 5.0))
    for side in (plate, plate.mirror((1.0, 0.0, 0.0))):
        sign = 1.0 if side is plate else -1.0
        lies = side.rotate((0.0, 0.0, sign * math.degrees(tilt)))
        assert (lies.translate((0.0, 1e-4, 0.0)) ^ jig).volume() < 1e-3
        assert (lies.translate((0.0, -0.1, 0.0)) ^ jig).volume() > 0.09 * 25 * 30 * math.cos(tilt)


@pytest.mark.parametrize("kind", ["ico", "cube"])
def test_a_press_meets_the_border_alone(kind: str) -> None:
    """Its rim lies within the tile and beside its window; over every ring it is free."""
    design = design_of(kind, edge="60mm", build="tiles", jig=True, chord_error="50um")
    target = design.target
    press = solid_of(tile_press(target, design.job.printing.printer))
    rim = press.slice(PLATE_MM + PIT_MM / 2)
    assert rim.area() > 0.5 * (prism((target.outline_mm[0],), 0, 1) - prism((target.window_mm[0],), 0, 1)).volume()
    assert (rim ^ prism((target.window_mm[0],), 0, 1).slice(0.5)).area() == 0
    assert press.slice(PLATE_MM / 2).area() == pytest.approx(press.slice(0.1).area())
    assert press.bounding_box()[5] == PLATE_MM + PIT_MM


def test_a_board_has_no_edges_to_hold() -> None:
    """Refused in a line."""
    with pytest.raises(InputError, match=r"jig: a board in tiles has no edges .* leave --jig out"):
        design_of("board", size="330x260mm", build="tiles", jig=True)
