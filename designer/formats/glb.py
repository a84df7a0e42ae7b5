"""GLB: coloured and textured surfaces for viewers, web pages and simulators (glTF 2.0 in its binary form).

Not by trimesh, which keeps a material's colour, linear light, to eight bits: a dark one comes back as another.
"""

import json
import struct
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from designer.base.arrays import Array, Rows
from designer.make.mesh import Ids, Part
from designer.make.textured import TexturedMesh, linear_light
from designer.spec.spec import PrintSpec

_METRES_PER_MM = 0.001
ROUGHNESS = 0.9
"""Matt plastic."""

# Codes of the glTF 2.0 specification.
_UNSIGNED_INT, _FLOAT = 5125, 5126
_ARRAY_BUFFER, _ELEMENT_ARRAY_BUFFER = 34962, 34963
_LINEAR, _LINEAR_MIPMAP_LINEAR, _CLAMP_TO_EDGE = 9729, 9987, 33071
_MAGIC, _VERSION, _JSON_CHUNK, _BINARY_CHUNK = 0x46546C67, 2, 0x4E4F534A, 0x004E4942


@dataclass(frozen=True, eq=False)
class _Surface:
    """A mesh of one material."""

    name: str
    corner_mm: Array  # (N, 3)
    triangles: Ids | Rows  # (T, 3)
    colour: str = "#ffffff"
    textured: TexturedMesh | None = None  # whose picture is on it


def glb_bytes(part: Part, printing: PrintSpec) -> bytes:
    """The part as meshes `body` and `ink` in the target frame, in metres.

    The meshes carry no normals: glTF then has viewers draw flat faces, and vertices stay shared.
    """
    named = (("body", part.body, printing.body_colour), ("ink", part.ink, printing.ink_colour))
    return _glb([
        _Surface(name, mesh.vertices_mm, mesh.triangles, colour) for name, mesh, colour in named if mesh is not None
    ])  # fmt: skip


def textured_glb(mesh: TexturedMesh) -> bytes:
    """A mesh with its picture, likewise."""
    return _glb([_Surface("artwork", mesh.corner_mm, mesh.triangles, textured=mesh)])


def _glb(surfaces: Sequence[_Surface]) -> bytes:
    """The surfaces as nodes below one; y is as it is."""
    binary, views, accessors = bytearray(), list[dict[str, object]](), list[dict[str, object]]()

    def view(content: bytes, **target: int) -> int:
        """Where it stands in the buffer."""
        views.append({"buffer": 0, "byteOffset": len(binary), "byteLength": len(content), **target})
        binary.extend(content + bytes(-len(content) % 4))
        return len(views) - 1

    def vectors(values: Array, **bounds: list[float]) -> int:
        """Rows of two or three numbers."""
        row = view(values.astype("<f4").tobytes(), target=_ARRAY_BUFFER)
        kind = {"componentType": _FLOAT, "count": len(values), "type": f"VEC{values.shape[1]}"}
        accessors.append({"bufferView": row, **kind, **bounds})
        return len(accessors) - 1

    meshes, materials, images = list[dict[str, object]](), list[dict[str, object]](), list[dict[str, object]]()
    for number, one in enumerate(surfaces):
        surface: dict[str, object] = {"metallicFactor": 0.0, "roughnessFactor": ROUGHNESS}
        row = view(one.triangles.astype("<u4").tobytes(), target=_ELEMENT_ARRAY_BUFFER)
        indices = {"componentType": _UNSIGNED_INT, "count": one.triangles.size, "type": "SCALAR"}
        accessors.append({"bufferView": row, **indices})
        primitive: dict[str, object] = {"indices": len(accessors) - 1, "material": number}
        at = (_METRES_PER_MM * one.corner_mm).astype("<f4")
        attributes = {"POSITION": vectors(at, min=at.min(axis=0).tolist(), max=at.max(axis=0).tolist())}
        if one.textured is None:
            surface["baseColorFactor"] = [*np.round(linear_light(one.colour), 6).tolist(), 1.0]
        else:
            attributes["NORMAL"] = vectors(one.textured.normal)
            # From the picture's upper left.
            attributes["TEXCOORD_0"] = vectors(one.textured.place * (1, -1) + (0, 1))
            surface["baseColorTexture"] = {"index": len(images)}
            images.append({"bufferView": view(one.textured.picture), "mimeType": "image/png", "name": one.name})
        meshes.append({"name": one.name, "primitives": [{"attributes": attributes, **primitive}]})
        materials.append({"name": one.name, "pbrMetallicRoughness": surface})
    wrap = {"wrapS": _CLAMP_TO_EDGE, "wrapT": _CLAMP_TO_EDGE}
    pictures = {
        "textures": [{"source": row, "sampler": 0} for row in range(len(images))],
        "samplers": [{"magFilter": _LINEAR, "minFilter": _LINEAR_MIPMAP_LINEAR, **wrap}], "images": images,
    }  # fmt: skip
    document = {
        "asset": {"version": "2.0", "generator": "ringsolid"},
        "scene": 0,
        "scenes": [{"nodes": [0]}],
        "nodes": [
            {"name": "target", "children": list(range(1, len(surfaces) + 1))},
            *({"name": one.name, "mesh": row} for row, one in enumerate(surfaces)),
        ],
        "meshes": meshes,
        "materials": materials,
        **(pictures if images else {}),
        "accessors": accessors,
        "bufferViews": views,
        "buffers": [{"byteLength": len(binary)}],
    }
    # The GLB container: a header and two chunks, each padded to four bytes.
    text = json.dumps(document, separators=(",", ":")).encode("ascii")
    chunks = ((_JSON_CHUNK, text + b" " * (-len(text) % 4)), (_BINARY_CHUNK, bytes(binary)))
    header = struct.pack("<III", _MAGIC, _VERSION, 12 + sum(8 + len(content) for _, content in chunks))
    return header + b"".join(struct.pack("<II", len(content), kind) + content for kind, content in chunks)
