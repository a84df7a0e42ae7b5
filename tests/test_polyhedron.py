"""The icosahedron's numbers, against definitions and elementary geometry."""

import math
from itertools import combinations

import numpy as np
import pytest

from designer.polyhedron import (
    DIHEDRAL_RAD,
    INRADIUS,
    INSET_PER_DEPTH,
    adjacent_faces,
    frames_of_triangles,
    icosahedron_faces,
    icosahedron_vertices,
)

VERTICES = icosahedron_vertices()
FACES = icosahedron_faces()
FRAMES = frames_of_triangles(VERTICES[FACES])


def test_vertices_are_twelve_at_edge_one() -> None:
    """Twelve vertices about the origin; each has five neighbours at distance 1, all others lie farther away."""
    assert VERTICES.shape == (12, 3)
    assert VERTICES.mean(axis=0) == pytest.approx(np.zeros(3), abs=1e-12)
    distance = np.linalg.norm(VERTICES[:, None] - VERTICES, axis=2)
    near = np.isclose(distance, 1.0, rtol=0, atol=1e-12)
    assert (near.sum(axis=1) == 5).all()
    assert distance[~near & ~np.eye(12, dtype=bool)].min() > 1.6


def test_faces_are_the_twenty_triangles_of_edge_one() -> None:
    """The faces are exactly the triples of mutual neighbours, each once."""
    triples = {
        frozenset(triple)
        for triple in combinations(range(12), 3)
        if all(math.isclose(math.dist(VERTICES[a], VERTICES[b]), 1) for a, b in combinations(triple, 2))
    }
    assert len(FACES) == 20
    assert {frozenset(face) for face in FACES.tolist()} == triples


def test_faces_run_counter_clockwise_from_outside() -> None:
    """Each face's normal, by the right-hand rule, points away from the origin and stands on the face."""
    corners = VERTICES[FACES]
    normal = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    assert (np.einsum("fi,fki->fk", normal, corners) > 0.1).all()


def test_face_frames_are_outward_right_handed_motions() -> None:
    """Rotation with determinant 1, origin at the centroid, y towards the first corner, z along the outward normal."""
    rotation, origin = FRAMES[:, :3, :3], FRAMES[:, :3, 3]
    assert rotation.transpose(0, 2, 1) @ rotation == pytest.approx(np.tile(np.eye(3), (20, 1, 1)), abs=1e-12)
    assert np.linalg.det(rotation) == pytest.approx(np.ones(20))
    assert (FRAMES[:, 3] == [0, 0, 0, 1]).all()
    assert origin == pytest.approx(VERTICES[FACES].mean(axis=1), abs=1e-12)
    # On a regular solid the outward normal runs through the centroid, at the inradius.
    assert rotation[:, :, 2] * INRADIUS == pytest.approx(origin, abs=1e-12)
    in_face = np.einsum("fji,fkj->fki", rotation, VERTICES[FACES] - origin[:, None])
    circumradius = 1 / math.sqrt(3)
    expected = circumradius * np.array([[0, 1, 0], [-math.sqrt(3) / 2, -0.5, 0], [math.sqrt(3) / 2, -0.5, 0]])
    assert in_face == pytest.approx(np.tile(expected, (20, 1, 1)), abs=1e-12)


def test_adjacency_is_symmetric_and_shares_the_edge() -> None:
    """The face across edge k holds both of its vertices, and has this face across that same edge."""
    for face, row in enumerate(adjacent_faces()):
        for k, other in enumerate(row):
            edge = {int(FACES[face, k]), int(FACES[face, (k + 1) % 3])}
            assert edge == set(FACES[face].tolist()) & set(FACES[other].tolist())
            back = adjacent_faces()[other].index(face)
            assert edge == {int(FACES[other, back]), int(FACES[other, (back + 1) % 3])}


def test_dihedral_angle_between_neighbours() -> None:
    """The angle inside the solid between any two neighbouring faces is DIHEDRAL_RAD, 138.19 degrees."""
    normal = FRAMES[:, :3, 2]
    for face, row in enumerate(adjacent_faces()):
        for other in row:
            assert math.pi - math.acos(normal[face] @ normal[other]) == pytest.approx(DIHEDRAL_RAD, abs=1e-9)
    assert math.degrees(DIHEDRAL_RAD) == pytest.approx(138.1897, abs=1e-4)


def test_inset_per_depth_is_where_offset_planes_meet() -> None:
    """Planes one unit under two neighbouring faces meet INSET_PER_DEPTH inside their common edge, seen along a face."""
    for face, row in enumerate(adjacent_faces()):
        for k, other in enumerate(row):
            start, end = VERTICES[FACES[face, k]], VERTICES[FACES[face, (k + 1) % 3]]
            planes = np.array([FRAMES[face, :3, 2], FRAMES[other, :3, 2], end - start])
            # n.x = n.start - 1 on both lowered planes, and x straight below the edge's start along the edge
            met = np.linalg.solve(planes, planes @ start - [1, 1, 0])
            inward = np.cross(FRAMES[face, :3, 2], (end - start) / np.linalg.norm(end - start))
            assert (met - start) @ inward == pytest.approx(INSET_PER_DEPTH)
