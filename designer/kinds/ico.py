"""An icosahedron with a triangular lattice on each of its 20 faces."""

import math
from dataclasses import dataclass
from functools import cache
from typing import TYPE_CHECKING, ClassVar

from designer.kinds.regular_solid import AskedSolid, SolidSpec
from designer.spec.kind import Kind

if TYPE_CHECKING:
    from designer.base.arrays import Array, Rows
    from designer.base.solid import Polyhedron

# Which code each face carries, and at which of its three corners.
# Found by simulated annealing to set a target apart from itself turned by any of the 59 other rotations and seen
# in a mirror by any of the 60 mirror symmetries: at least 90 of its 120 code marks then disagree (78 with 5 rings a
# side, whose corner blocks overlap), at most one face agrees, and any two faces that share an edge or a corner
# disagree in 4 marks or more (`tests/designer/test_code.py`).
FACE_CODE = (6, 17, 8, 13, 12, 19, 1, 16, 7, 2, 18, 3, 10, 9, 5, 4, 0, 14, 11, 15)
CODE_CORNER = (1, 2, 1, 0, 0, 1, 0, 2, 1, 1, 0, 2, 0, 1, 2, 1, 2, 0, 1, 1)


def _vertices() -> "Array":
    """Vertex 0 lies on +z, vertices 1-5 and 6-10 form the upper and lower ring, vertex 11 lies on -z.  # (12, 3)"""
    import numpy as np

    circumradius = math.sin(2 * math.pi / 5)
    height, ring_radius = circumradius / math.sqrt(5), 2 * circumradius / math.sqrt(5)
    turn = 2 * math.pi / 5 * np.arange(5)
    upper = np.stack([ring_radius * np.cos(turn), ring_radius * np.sin(turn), np.full(5, height)], axis=1)
    lower_turn = turn + math.pi / 5
    lower = np.stack([ring_radius * np.cos(lower_turn), ring_radius * np.sin(lower_turn), np.full(5, -height)], axis=1)
    poles = np.array([[0.0, 0.0, circumradius], [0.0, 0.0, -circumradius]])
    return np.concatenate([poles[:1], upper, lower, poles[1:]])


def _faces() -> "Rows":
    """The top cap (0-4), the upper (5-9) and the lower band (10-14), the bottom cap (15-19).  # (20, 3)"""
    import numpy as np

    k = np.arange(5)
    after = (k + 1) % 5
    top = np.stack([np.zeros(5, dtype=np.int64), 1 + k, 1 + after], axis=1)
    upper = np.stack([1 + k, 6 + k, 1 + after], axis=1)
    lower = np.stack([6 + k, 6 + after, 1 + after], axis=1)
    bottom = np.stack([np.full(5, 11), 6 + after, 6 + k], axis=1)
    return np.concatenate([top, upper, lower, bottom])


def _net() -> tuple[tuple[int, int], ...]:
    """Both bands in a row, the caps above and below: five strips of four faces side by side."""
    bands = [face for k in range(5) for face in (5 + k, 10 + k)]
    rows = [(face, bands[max(place - 1, 0)]) for place, face in enumerate(bands)]
    return (*rows, *((k, 5 + k) for k in range(5)), *((15 + k, 10 + k) for k in range(5)))


@cache
def icosahedron() -> "Polyhedron":
    """The solid, when it is asked for: reading a command line needs no NumPy."""
    from designer.base.solid import Polyhedron

    return Polyhedron(
        name="icosahedron",
        vertices=_vertices(),
        faces=_faces(),
        inradius=(3 * math.sqrt(3) + math.sqrt(15)) / 12,
        dihedral_rad=math.acos(-math.sqrt(5) / 3),
        face_code=FACE_CODE,
        code_corner=CODE_CORNER,
        net=_net(),
        net_angle_rad=5 * math.pi / 6,
    )


@dataclass(frozen=True)
class IcoSpec(SolidSpec):
    """An icosahedron."""

    kind: ClassVar[str] = "ico"
    fewest_rings: ClassVar[int] = 5
    shape = staticmethod(icosahedron)


KIND = Kind("an icosahedron with rings on its 20 faces", AskedSolid.of(IcoSpec), IcoSpec)
