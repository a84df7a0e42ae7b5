"""The icosahedron: vertices, faces, neighbours, and face frames, for edge length 1.

Vertex 0 lies on +z, vertices 1-5 and 6-10 form the upper and lower ring, vertex 11 lies on -z. Faces run from
the top cap (0-4) over the upper (5-9) and lower band (10-14) to the bottom cap (15-19). Each face lists its
vertices counter-clockwise as seen from outside.
"""

import math
from functools import cache

import numpy as np
from numpy.typing import NDArray

FACE_COUNT = 20
DIHEDRAL_RAD = math.acos(-math.sqrt(5) / 3)
INRADIUS = (3 * math.sqrt(3) + math.sqrt(15)) / 12
"""Distance from the centroid to a face, for edge length 1."""
INSET_PER_DEPTH = 1 / math.tan(DIHEDRAL_RAD / 2)
"""How far the plane that halves the dihedral angle moves in from an edge, per unit of depth below the face."""


def deepest_inlay(border: float) -> float:
    """The deepest inlay of a border: its floor moves in with depth, and a tenth of its width must be left."""
    return 0.9 * border / INSET_PER_DEPTH


def icosahedron_vertices() -> NDArray[np.float64]:
    """The vertices of the icosahedron with edge length 1, centred at the origin.  # (12, 3)"""
    circumradius = math.sin(2 * math.pi / 5)
    height, ring_radius = circumradius / math.sqrt(5), 2 * circumradius / math.sqrt(5)
    turn = 2 * math.pi / 5 * np.arange(5)
    upper = np.stack([ring_radius * np.cos(turn), ring_radius * np.sin(turn), np.full(5, height)], axis=1)
    lower_turn = turn + math.pi / 5
    lower = np.stack([ring_radius * np.cos(lower_turn), ring_radius * np.sin(lower_turn), np.full(5, -height)], axis=1)
    poles = np.array([[0.0, 0.0, circumradius], [0.0, 0.0, -circumradius]])
    return np.concatenate([poles[:1], upper, lower, poles[1:]])


def icosahedron_faces() -> NDArray[np.int64]:
    """Vertex numbers of each face, counter-clockwise from outside.  # (20, 3)"""
    k = np.arange(5)
    after = (k + 1) % 5
    top = np.stack([np.zeros(5, dtype=np.int64), 1 + k, 1 + after], axis=1)
    upper = np.stack([1 + k, 6 + k, 1 + after], axis=1)
    lower = np.stack([6 + k, 6 + after, 1 + after], axis=1)
    bottom = np.stack([np.full(5, 11), 6 + after, 6 + k], axis=1)
    return np.concatenate([top, upper, lower, bottom])


@cache
def adjacent_faces() -> tuple[tuple[int, int, int], ...]:
    """For each face, the faces across its edges (v0 v1), (v1 v2), (v2 v0)."""
    faces = icosahedron_faces()
    owner = {(int(face[k]), int(face[(k + 1) % 3])): f for f, face in enumerate(faces) for k in range(3)}
    rows = [[owner[int(face[(k + 1) % 3]), int(face[k])] for k in range(3)] for face in faces]
    return tuple((row[0], row[1], row[2]) for row in rows)


def frames_of_triangles(corners: NDArray[np.float64]) -> NDArray[np.float64]:
    """Right-handed frames of triangles: origin at the centroid, y to the first corner, z along the normal.

    Args:
        corners: counter-clockwise corners as seen from the side z points to.  # (F, 3, 3)

    Returns:
        target_from_face.  # (F, 4, 4)
    """
    centroid = corners.mean(axis=1)
    normal = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    z_axis = normal / np.linalg.norm(normal, axis=1, keepdims=True)
    to_corner = corners[:, 0] - centroid
    y_axis = to_corner / np.linalg.norm(to_corner, axis=1, keepdims=True)
    frames = np.tile(np.eye(4), (len(corners), 1, 1))
    frames[:, :3, 0] = np.cross(y_axis, z_axis)
    frames[:, :3, 1] = y_axis
    frames[:, :3, 2] = z_axis
    frames[:, :3, 3] = centroid
    return frames
