"""A cube with a square lattice on each of its six faces."""

import math
from dataclasses import dataclass
from functools import cache
from typing import TYPE_CHECKING, ClassVar

from designer.kinds.regular_solid import AskedSolid, SolidSpec
from designer.spec.kind import Kind

if TYPE_CHECKING:
    from designer.base.solid import Polyhedron

# Which code each face carries, and at which of its four corners.
# Found by simulated annealing to set a target apart from itself turned by any of the 23 other rotations and seen in a
# mirror by any of the 24 mirror symmetries: every face then disagrees in 2 marks or more, any two faces that share an
# edge in 8 or more, and all six in 28 or more of 42 (`tests/designer/test_code.py`).
FACE_CODE = (21, 25, 23, 20, 24, 22)
CODE_CORNER = (3, 3, 0, 1, 2, 2)


@cache
def cube() -> "Polyhedron":
    """The solid, when it is asked for: reading a command line needs no NumPy."""
    import numpy as np

    from designer.base.solid import Polyhedron

    # Vertices 0-3 lie above, 4-7 below them; face 0 looks up, 1-4 to the sides, 5 down.
    around = ((0.5, 0.5), (-0.5, 0.5), (-0.5, -0.5), (0.5, -0.5))
    return Polyhedron(
        name="cube",
        vertices=np.array([(x, y, z) for z in (0.5, -0.5) for x, y in around]),
        faces=np.array([[0, 1, 2, 3], [3, 2, 6, 7], [0, 3, 7, 4], [1, 0, 4, 5], [2, 1, 5, 6], [7, 6, 5, 4]]),
        inradius=0.5,
        dihedral_rad=math.pi / 2,
        face_code=FACE_CODE,
        code_corner=CODE_CORNER,
        net=((1, 1), (2, 1), (3, 2), (4, 3), (0, 1), (5, 1)),
        net_angle_rad=math.pi / 4,
    )


@dataclass(frozen=True)
class CubeSpec(SolidSpec):
    """A cube."""

    kind: ClassVar[str] = "cube"
    fewest_rings: ClassVar[int] = 5
    shape = staticmethod(cube)


KIND = Kind("a cube with rings on its six faces", AskedSolid.of(CubeSpec), CubeSpec)
