"""Binary STL."""

import struct

import numpy as np

from designer.base.words import NAME
from designer.make.mesh import Mesh

_HEADER = f"{NAME} binary STL, millimetres".encode().ljust(80)
"""Must not begin with "solid": readers would take the file for text."""

_FACET = np.dtype([("normal", "<f4", 3), ("corners", "<f4", (3, 3)), ("attribute", "<u2")])


def stl_bytes(mesh: Mesh) -> bytes:
    """The mesh as a binary STL file, in the mesh's own frame, with unit normals out of the corners' order."""
    corners = mesh.vertices_mm[mesh.triangles]  # (T, 3, 3)
    normal = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    facets = np.zeros(len(corners), dtype=_FACET)
    facets["normal"] = normal / np.linalg.norm(normal, axis=1, keepdims=True)
    facets["corners"] = corners
    return _HEADER + struct.pack("<I", len(facets)) + facets.tobytes()
