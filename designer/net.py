"""The icosahedron unfolded into the plane, as seen from outside: five strips of four faces side by side."""

import math

import numpy as np
from numpy.typing import NDArray

from designer.code import FACE_CORNER
from designer.polyhedron import FACE_COUNT

NET_SIZE = (5.5, 3 * math.sqrt(3) / 2)
"""Width and height of the net, for edge length 1."""


def icosahedron_net() -> NDArray[np.float64]:
    """Where each face lies in the net of edge length 1: net_from_face, with the lower left corner at (0, 0).

    Faces keep their numbers: the caps are the uppermost and the lowest row, the bands lie between.

    Returns:
        Rigid motions of the plane.  # (20, 3, 3)
    """
    height = math.sqrt(3) / 2
    motions = np.empty((FACE_COUNT, 3, 3))
    for face, corners in enumerate(_corners(height)):
        turned = np.roll(corners, -FACE_CORNER[face], axis=0)  # the face frame's y points to the code corner
        centroid = turned.mean(axis=0)
        y_axis = (turned[0] - centroid) / np.linalg.norm(turned[0] - centroid)
        motions[face] = [[y_axis[1], y_axis[0], centroid[0]], [-y_axis[0], y_axis[1], centroid[1]], [0.0, 0.0, 1.0]]
    return motions


def _corners(height: float) -> list[NDArray[np.float64]]:
    """The corners of the faces in the vertex order of `polyhedron.icosahedron_faces`."""
    top, upper, lower, bottom = 3 * height, 2 * height, height, 0.0
    rows: tuple[list[list[tuple[float, float]]], ...] = ([], [], [], [])
    for k in range(5):
        rows[0].append([(k + 0.5, top), (k, upper), (k + 1, upper)])
        rows[1].append([(k, upper), (k + 0.5, lower), (k + 1, upper)])
        rows[2].append([(k + 0.5, lower), (k + 1.5, lower), (k + 1, upper)])
        rows[3].append([(k + 1, bottom), (k + 1.5, lower), (k + 0.5, lower)])
    return [np.array(triangle, dtype=float) for row in rows for triangle in row]
