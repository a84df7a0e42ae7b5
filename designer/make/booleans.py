"""Meshes as solids that can be united, cut and measured, and back."""

import numpy as np
from manifold3d import CrossSection, Error, Manifold, Mesh64, OpType

from designer.base.arrays import Array
from designer.make.mesh import Mesh

CIRCLE_SEGMENTS = 48
"""Of bores, pins and cavities: a chord of a 40 mm circle strays by .04 mm."""


def solid_of(mesh: Mesh) -> Manifold:
    """A closed mesh as a solid.

    Raises:
        ValueError: the mesh is not closed.
    """
    vertices = np.ascontiguousarray(mesh.vertices_mm)
    solid = Manifold(Mesh64(vert_properties=vertices, tri_verts=np.ascontiguousarray(mesh.triangles, dtype=np.uint64)))
    if solid.status() != Error.NoError:
        raise ValueError(f"a mesh that is no solid: {solid.status().name}")
    return solid


def mesh_of(solid: Manifold) -> Mesh:
    """The surface of a solid."""
    mesh = solid.to_mesh64()
    return Mesh(np.array(mesh.vert_properties[:, :3], dtype=np.float64), mesh.tri_verts.astype(np.int32))


def placed(solid: Manifold, frame: Array) -> Manifold:
    """The solid moved by a rigid motion.  # (4, 4)"""
    return solid.transform(np.ascontiguousarray(frame[:3]))


def cylinder(radius_mm: float, low_mm: float, high_mm: float, at: tuple[float, float] = (0.0, 0.0)) -> Manifold:
    """A cylinder along z."""
    solid = Manifold.cylinder(high_mm - low_mm, radius_mm, circular_segments=CIRCLE_SEGMENTS)
    return solid.translate((at[0], at[1], low_mm))


def cone(low_radius_mm: float, high_radius_mm: float, height_mm: float) -> Manifold:
    """A cone's lower part, which stands on z = 0."""
    return Manifold.cylinder(height_mm, low_radius_mm, high_radius_mm, circular_segments=CIRCLE_SEGMENTS)


def prism(contours: tuple[Array, ...], low_mm: float, high_mm: float) -> Manifold:
    """Counter-clockwise contours in a plane of constant z, extruded along z."""
    section = CrossSection([np.ascontiguousarray(contour) for contour in contours])
    return Manifold.extrude(section, high_mm - low_mm).translate((0.0, 0.0, low_mm))


def union(solids: list[Manifold]) -> Manifold:
    """All solids as one; of none an empty one."""
    return Manifold.batch_boolean(solids, OpType.Add) if solids else Manifold()


def frame_along(axis: Array) -> Array:
    """A frame about the origin whose z runs along an axis.  # (4, 4)"""
    z = axis / np.linalg.norm(axis)
    aside = np.eye(3)[int(np.argmin(np.abs(z)))]
    x = np.cross(aside, z)
    x /= np.linalg.norm(x)
    frame = np.eye(4)
    frame[:3, 0], frame[:3, 1], frame[:3, 2] = x, np.cross(z, x), z
    return frame
