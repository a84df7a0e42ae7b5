"""An octahedron with a triangular lattice on each of its eight faces."""

import math
from dataclasses import dataclass
from functools import cache
from typing import TYPE_CHECKING, ClassVar

from designer.kinds.regular_solid import AskedSolid, SolidSpec
from designer.spec.kind import Kind

if TYPE_CHECKING:
    from designer.base.solid import Polyhedron

# Which code each face carries, and at which of its three corners.
# Found by simulated annealing as those of the icosahedron: against itself turned by any of the 23 other rotations, or
# seen in a mirror by any of the 24 mirror symmetries, at least 42 marks disagree (40 with 5 rings a side), each face in
# 2 or more, and any two that share an edge or a corner in 6 or more (`tests/designer/test_code.py`).
FACE_CODE = (33, 27, 31, 28, 29, 30, 32, 34)
CODE_CORNER = (1, 0, 0, 2, 1, 0, 1, 0)


@cache
def octahedron() -> "Polyhedron":
    """The solid, when it is asked for: reading a command line needs no NumPy."""
    import numpy as np

    from designer.base.solid import Polyhedron

    # Vertices 0-3 lie around the waist, 4 above, 5 below; faces 0-3 look up, 4-7 down, 4 + k below k.
    around = ((1, 0, 0), (0, 1, 0), (-1, 0, 0), (0, -1, 0))
    upper = [[4, k, (k + 1) % 4] for k in range(4)]
    lower = [[5, (k + 1) % 4, k] for k in range(4)]
    return Polyhedron(
        name="octahedron",
        vertices=math.sqrt(0.5) * np.array([*around, (0, 0, 1), (0, 0, -1)], dtype=np.float64),
        faces=np.array(upper + lower),
        inradius=math.sqrt(6) / 6,
        dihedral_rad=math.acos(-1 / 3),
        face_code=FACE_CODE,
        code_corner=CODE_CORNER,
        net=((4, 4), (0, 4), (5, 4), (1, 5), (3, 0), (7, 3), (2, 1), (6, 7)),
        net_angle_rad=math.pi / 2,
    )


@dataclass(frozen=True)
class OctahedronSpec(SolidSpec):
    """An octahedron."""

    kind: ClassVar[str] = "octahedron"
    fewest_rings: ClassVar[int] = 5
    shape = staticmethod(octahedron)


KIND = Kind("an octahedron with rings on its eight faces", AskedSolid.of(OctahedronSpec), OctahedronSpec)
