"""GLB: the coloured solid for viewers and web pages (glTF 2.0 in its binary form)."""

import json
import struct

import numpy as np

from designer.make.mesh import Mesh, Part
from designer.make.textured import linear_light
from designer.spec.spec import PrintSpec

_METRES_PER_MM = 0.001
_ROUGHNESS = 0.9
"""Matt plastic."""

# Codes of the glTF 2.0 specification.
UNSIGNED_INT, FLOAT = 5125, 5126
ARRAY_BUFFER, ELEMENT_ARRAY_BUFFER = 34962, 34963
_MAGIC, _VERSION, _JSON_CHUNK, _BINARY_CHUNK = 0x46546C67, 2, 0x4E4F534A, 0x004E4942


def glb_bytes(part: Part, printing: PrintSpec) -> bytes:
    """The part as meshes `body` and `ink`, in millimetres in the target frame, under a root that scales to metres.

    The meshes carry no normals: glTF then has viewers draw flat faces, and vertices stay shared.
    """
    meshes = [("body", part.body, printing.body_colour)]
    if part.ink is not None:
        meshes.append(("ink", part.ink, printing.ink_colour))
    binary = b"".join(_indices(mesh).tobytes() + _positions(mesh).tobytes() for _, mesh, _ in meshes)
    buffers = [size for _, mesh, _ in meshes for size in (_indices(mesh).nbytes, _positions(mesh).nbytes)]
    starts = np.cumsum([0, *buffers[:-1]]).tolist()
    targets = (ELEMENT_ARRAY_BUFFER, ARRAY_BUFFER) * len(meshes)
    document = {
        "asset": {"version": "2.0", "generator": "ringsolid"},
        "scene": 0,
        "scenes": [{"nodes": [0]}],
        "nodes": [
            {"name": "target", "scale": [_METRES_PER_MM] * 3, "children": list(range(1, len(meshes) + 1))},
            *({"name": name, "mesh": row} for row, (name, _, _) in enumerate(meshes)),
        ],
        "meshes": [
            {
                "name": name,
                "primitives": [{"attributes": {"POSITION": 2 * row + 1}, "indices": 2 * row, "material": row}],
            }
            for row, (name, _, _) in enumerate(meshes)
        ],
        "materials": [_material(name, colour) for name, _, colour in meshes],
        "accessors": [accessor for row, (_, mesh, _) in enumerate(meshes) for accessor in _accessors(mesh, 2 * row)],
        "bufferViews": [
            {"buffer": 0, "byteOffset": start, "byteLength": size, "target": target}
            for start, size, target in zip(starts, buffers, targets, strict=True)
        ],
        "buffers": [{"byteLength": len(binary)}],
    }
    return container(json.dumps(document, separators=(",", ":")).encode("ascii"), binary)


def _indices(mesh: Mesh) -> np.ndarray[tuple[int, ...], np.dtype[np.uint32]]:
    return mesh.triangles.astype("<u4")


def _positions(mesh: Mesh) -> np.ndarray[tuple[int, ...], np.dtype[np.float32]]:
    return mesh.vertices_mm.astype("<f4")


def _accessors(mesh: Mesh, first_view: int) -> list[dict[str, object]]:
    """How to read the indices and positions of a mesh from two buffer views."""
    positions = _positions(mesh)
    bounds = {"min": positions.min(axis=0).tolist(), "max": positions.max(axis=0).tolist()}
    return [
        {"bufferView": first_view, "componentType": UNSIGNED_INT, "count": mesh.triangles.size, "type": "SCALAR"},
        {"bufferView": first_view + 1, "componentType": FLOAT, "count": len(positions), "type": "VEC3", **bounds},
    ]


def _material(name: str, colour: str) -> dict[str, object]:
    """A matt material; glTF's colour factors are linear light."""
    factor = [*np.round(linear_light(colour), 6).tolist(), 1.0]
    surface = {"baseColorFactor": factor, "metallicFactor": 0.0, "roughnessFactor": _ROUGHNESS}
    return {"name": name, "pbrMetallicRoughness": surface}


def container(document: bytes, binary: bytes) -> bytes:
    """The GLB container: a header and two chunks, each padded to four bytes."""
    document += b" " * (-len(document) % 4)
    size = 12 + 8 + len(document) + 8 + len(binary)  # the arrays hold four-byte values, so `binary` needs no padding
    header = struct.pack("<III", _MAGIC, _VERSION, size)
    chunks = ((_JSON_CHUNK, document), (_BINARY_CHUNK, binary))
    return header + b"".join(struct.pack("<II", len(content), kind) + content for kind, content in chunks)
