"""Regular solids of every kind, against definitions and elementary geometry."""

import math
from itertools import combinations

import numpy as np
import pytest

from designer.base.solid import Polyhedron, Solid, face_frames, regular_polygon
from designer.kinds.layout import adjacent_faces, inset_per_depth, lay_out, opposite_faces
from designer.kinds.sizing import size_job
from designer.spec.kind import kinds
from designer.target import TargetGeometry
from tests.support.designs import asked_for, small

SOLIDS = {kind.name: solid.polyhedron for kind in kinds() if (solid := small(kind.name).job.target.solid) is not None}
each_solid = pytest.mark.parametrize("shape", SOLIDS.values(), ids=SOLIDS)


@each_solid
def test_vertices_and_faces_are_those_of_a_regular_solid(shape: Polyhedron) -> None:
    """Edges have length 1 and two faces each, vertices are equally far from the origin, Euler's formula holds."""
    radius = np.linalg.norm(shape.vertices, axis=1)
    assert radius == pytest.approx(np.full(len(radius), radius[0]), abs=1e-12)
    sides = [(int(face[k - 1]), int(face[k])) for face in shape.faces for k in range(shape.sides)]
    assert len(set(sides)) == len(sides)
    assert {(b, a) for a, b in sides} == set(sides)
    assert [math.dist(shape.vertices[a], shape.vertices[b]) for a, b in sides] == pytest.approx([1] * len(sides))
    assert len(shape.vertices) - len(sides) / 2 + len(shape.faces) == 2


@each_solid
def test_faces_run_counter_clockwise_from_outside(shape: Polyhedron) -> None:
    """Each face's normal, by the right-hand rule, points away from the origin, which is an inradius away."""
    corners = shape.vertices[shape.faces]
    normal = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 1])
    normal /= np.linalg.norm(normal, axis=1, keepdims=True)
    height = np.einsum("fi,fki->fk", normal, corners)
    assert height == pytest.approx(np.full(height.shape, shape.inradius), abs=1e-12)


@each_solid
def test_face_frames_hold_the_face_upright(shape: Polyhedron) -> None:
    """A rigid motion from the regular polygon, its lowest side level, to the face, z along the outward normal."""
    corners = shape.vertices[shape.faces_from_code]
    frames = face_frames(corners)
    rotation = frames[:, :3, :3]
    unit = np.tile(np.eye(3), (len(frames), 1, 1))
    assert rotation.transpose(0, 2, 1) @ rotation == pytest.approx(unit, abs=1e-12)
    assert np.linalg.det(rotation) == pytest.approx(np.ones(len(frames)))
    assert frames[:, :3, 3] == pytest.approx(shape.inradius * rotation[:, :, 2], abs=1e-12)
    polygon = regular_polygon(shape.sides, shape.face_inradius)
    placed = np.einsum("fij,kj->fki", rotation[:, :, :2], polygon) + frames[:, None, :3, 3]
    assert placed == pytest.approx(corners, abs=1e-12)
    lowest = np.argsort(polygon[:, 1])[:2]
    assert polygon[lowest, 1] == pytest.approx([-shape.face_inradius] * 2)
    assert polygon[0, 1] == pytest.approx(polygon[:, 1].max())


@pytest.mark.parametrize("name", SOLIDS)
def test_faces_of_a_target_are_those_of_its_solid(name: str) -> None:
    """Outlines in their frames are the solid's faces, at the size of the spec."""
    target, solid = target_of(name), small(name).job.target.solid
    assert solid is not None
    frame = target.target_from_face
    placed = np.einsum("fij,fkj->fki", frame[:, :3, :2], target.outline_mm) + frame[:, None, :3, 3]
    assert placed == pytest.approx(
        solid.edge_mm * solid.polyhedron.vertices[solid.polyhedron.faces_from_code], abs=1e-6
    )


def target_of(name: str) -> TargetGeometry:
    return small(name).target


@pytest.mark.parametrize("name", SOLIDS)
def test_adjacent_faces_share_the_edge(name: str) -> None:
    """The face across a side holds both of its vertices, and has this face across the same edge."""
    faces, beside = SOLIDS[name].faces_from_code, adjacent_faces(target_of(name))
    for face, row in enumerate(beside.tolist()):
        for k, other in enumerate(row):
            edge = {int(faces[face, k]), int(faces[face, (k + 1) % len(row)])}
            assert edge == set(faces[face].tolist()) & set(faces[other].tolist())
            back = beside[other].tolist().index(face)
            assert edge == {int(faces[other, back]), int(faces[other, (back + 1) % len(row)])}


@pytest.mark.parametrize("name", SOLIDS)
def test_dihedral_angle_and_inset(name: str) -> None:
    """The declared angle is the one between neighbouring faces; planes below two faces meet by the inset inside."""
    shape, target = SOLIDS[name], target_of(name)
    normal = target.target_from_face[:, :3, 2]
    for face, row in enumerate(adjacent_faces(target).tolist()):
        for other in row:
            assert math.pi - math.acos(normal[face] @ normal[other]) == pytest.approx(shape.dihedral_rad, abs=1e-9)
    # In the plane across an edge the lowered planes meet on the line that halves the angle inside.
    assert inset_per_depth(target) == pytest.approx(shape.inset_per_depth)
    assert shape.inset_per_depth == pytest.approx(1 / math.tan(shape.dihedral_rad / 2))


@pytest.mark.parametrize("name", SOLIDS)
def test_solid_moved_in_lies_as_deep_below_every_face(name: str) -> None:
    """Corners of the part below are those of the planes moved in, of the scaled solid."""
    shape = SOLIDS[name]
    corner = Solid(shape, 30.0).corners_mm(below_mm=1.5, scale=1.1)
    frames = face_frames(33.0 * shape.vertices[shape.faces_from_code])
    height = np.einsum("fi,vi->fv", frames[:, :3, 2], corner).max(axis=1)
    assert height == pytest.approx(np.full(len(frames), 33.0 * shape.inradius - 1.5))


@pytest.mark.parametrize("name", SOLIDS)
def test_the_last_face_has_an_opposite_one(name: str) -> None:
    """A target lies on its last face, so that one face looks up and each pair of opposite faces is listed once.

    Of a tetrahedron, which is no mirror image of itself through its middle, a corner looks up, and there are no pairs.
    """
    pairs, vertices = opposite_faces(target_of(name)), SOLIDS[name].vertices
    is_centred = np.isclose(-vertices[:, None], vertices, atol=1e-9).all(axis=2).any(axis=1).all()
    assert sorted(face for pair in pairs for face in pair) == list(range(len(SOLIDS[name].faces) if is_centred else 0))


@each_solid
def test_net_unfolds_the_solid(shape: Polyhedron) -> None:
    """Faces as seen from outside, from (0, 0) on, none over another; edges that touch there are one on the solid."""
    motion, size = shape.unfolded()
    polygon = regular_polygon(shape.sides, shape.face_inradius)
    flat = np.einsum("fij,kj->fki", motion[:, :2, :2], polygon) + motion[:, None, :2, 2]
    assert np.linalg.det(motion) == pytest.approx(np.ones(len(motion)))
    assert flat.min(axis=(0, 1)) == pytest.approx(np.zeros(2), abs=1e-9)
    assert flat.max(axis=(0, 1)) == pytest.approx(size)
    solid = shape.vertices[shape.faces_from_code]
    joined = 0
    for one, other in combinations(range(len(flat)), 2):
        assert math.dist(motion[one, :2, 2], motion[other, :2, 2]) > 2 * shape.face_inradius - 1e-9
        same = np.linalg.norm(flat[one][:, None] - flat[other], axis=2) < 1e-9
        if same.sum() == 2:
            assert (np.linalg.norm(solid[one][:, None] - solid[other], axis=2) < 1e-9)[same].all()
            joined += 1
    assert joined == len(flat) - 1


def test_a_larger_edge_is_the_same_solid_larger() -> None:
    """The layout of twice the edge with twice all sizes is twice the layout, and has the same layout id."""
    for name in SOLIDS:
        sizes = {"edge": 60, "ring_diameter": 4, "pitch": 6, "border": 1, "margin": 1}
        one, two = (
            lay_out(size_job(asked_for(name, {key: times * value for key, value in sizes.items()})).job.target)
            for times in (1, 2)
        )
        assert two.center_mm == pytest.approx(2 * one.center_mm, abs=1e-8)
        assert two.layout_id == one.layout_id
