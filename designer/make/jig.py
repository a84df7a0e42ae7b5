"""What helps to glue tiles: a jig for edges, and a press.

The *jig* is a block with a V of the solid's dihedral angle. Over an edge it brings two printed faces to this angle
while glue sets, wherever pins and pads leave them. Printed on end, it has no steps of layers on its flanks. The *press*
is a plate with a rim, which meets a tile's border alone: no ring is rubbed, and all pads of the seat are loaded.
"""

import math

import numpy as np
from manifold3d import CrossSection, Manifold

from designer.base.solid import Solid
from designer.make.mesh import Mesh, mesh_of, prism
from designer.make.pattern import moved_in
from designer.spec.spec import PrinterProfile
from designer.target import TargetGeometry

FLANK_OVER_EDGE, MOST_FLANK_MM = 0.35, 35.0
LENGTH_OVER_EDGE, MOST_LENGTH_MM = 0.5, 50.0
BELOW_MM = 6.0
"""Behind the V's ground."""
SLOT_MM = (1.5, 2.0)
"""Half its width, and its depth: the ground meets no edge, and takes the glue that comes out of it."""
PLATE_MM, PIT_MM = 4.0, 1.0
"""Of the press: behind the rim, and how high that is."""


def edge_jig(solid: Solid) -> Mesh:
    """The jig as it is printed: the V opens towards y, its ground lies along z."""
    tilt = (math.pi - solid.polyhedron.dihedral_rad) / 2
    flank = min(FLANK_OVER_EDGE * solid.edge_mm, MOST_FLANK_MM)
    out, up = flank * math.cos(tilt), flank * math.sin(tilt)
    half, deep = SLOT_MM
    right = [(out, -BELOW_MM), (out, up), (half, half * math.tan(tilt)), (half, -deep)]
    corners = [*right, *((-x, y) for x, y in reversed(right))]
    length = min(LENGTH_OVER_EDGE * solid.edge_mm, MOST_LENGTH_MM)
    return mesh_of(Manifold.extrude(CrossSection([np.array(corners)]), length))


def tile_press(target: TargetGeometry, printer: PrinterProfile) -> Mesh:
    """The press as it is printed, its rim up: as wide as the border, less a clearance on either side."""
    clear = printer.clearance_mm
    plate = prism((moved_in(target.outline_mm[0], clear),), 0.0, PLATE_MM + PIT_MM)
    return mesh_of(plate - prism((moved_in(target.window_mm[0], -clear),), PLATE_MM, PLATE_MM + PIT_MM + 1.0))
