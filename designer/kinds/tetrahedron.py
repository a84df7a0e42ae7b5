"""A tetrahedron with a triangular lattice on each of its four faces."""

import math
from dataclasses import dataclass
from functools import cache
from typing import TYPE_CHECKING, ClassVar

from designer.kinds.regular_solid import AskedSolid, SolidSpec
from designer.spec.kind import Kind

if TYPE_CHECKING:
    from designer.base.solid import Polyhedron

# Which code each face carries, and at which of its three corners.
# Found by simulated annealing as those of the icosahedron: against itself turned by any of the 11 other rotations, or
# seen in a mirror by any of the 12 mirror symmetries, at least 20 marks disagree (16 with 5 rings a side), of any two
# faces 8 or more (`tests/designer/test_code.py`).
FACE_CODE = (35, 37, 36, 38)
CODE_CORNER = (1, 2, 0, 0)


@cache
def tetrahedron() -> "Polyhedron":
    """The solid, when it is asked for: reading a command line needs no NumPy."""
    import numpy as np

    from designer.base.solid import Polyhedron

    # Vertex 0 lies above, 1-3 around below; faces 0-2 look to the sides, face 3 down.
    height, radius = math.sqrt(2 / 3), 1 / math.sqrt(3)
    turns = [math.pi / 2 + 2 * math.pi / 3 * k for k in range(3)]
    below = [(radius * math.cos(turn), radius * math.sin(turn), -height / 4) for turn in turns]
    return Polyhedron(
        name="tetrahedron",
        vertices=np.array([(0.0, 0.0, 3 * height / 4), *below]),
        faces=np.array([[0, 1, 2], [0, 2, 3], [0, 3, 1], [1, 3, 2]]),
        inradius=height / 4,
        dihedral_rad=math.acos(1 / 3),
        face_code=FACE_CODE,
        code_corner=CODE_CORNER,
        net=((3, 3), (0, 3), (1, 3), (2, 3)),
        net_angle_rad=math.pi / 2,
    )


@dataclass(frozen=True)
class TetrahedronSpec(SolidSpec):
    """A tetrahedron."""

    kind: ClassVar[str] = "tetrahedron"
    fewest_rings: ClassVar[int] = 5
    shape = staticmethod(tetrahedron)


KIND = Kind("a tetrahedron with rings on its four faces", AskedSolid.of(TetrahedronSpec), TetrahedronSpec)
