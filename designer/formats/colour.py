"""Full-colour models for printing services: one closed surface, a colour a triangle, edges where the ink's are.

    NAME.colour.3mf   base materials of the core specification; as it lies on a bed
    NAME.colour.ply   binary; a colour a face and a corner: corners on a ring's edge are there twice
    NAME.colour.wrl   VRML 2.0, a colour a face
    NAME.colour.zip   OBJ with the materials of its MTL, as forms to upload take them: in one file

All are in millimetres, which only a 3MF file can say, and all but it in the target's frame.
"""

from collections.abc import Iterator

import numpy as np
from PIL import ImageColor

from designer.base.arrays import Array
from designer.formats.threemf import TRIANGLE, build_item, package, quoted, triangle_lines, vertex_lines, zipped
from designer.make.mesh import ColouredMesh
from designer.spec.spec import PrintSpec

_MM = "millimetres, in the target's frame"
_CORE = "http://schemas.microsoft.com/3dmanufacturing/core/2015/02"
_PLY_COLOUR = "property uchar red\nproperty uchar green\nproperty uchar blue\n"
_VERTEX = np.dtype([("place", "<f4", 3), ("colour", "u1", 3)])
_FACE = np.dtype([("count", "u1"), ("corner", "<i4", 3), ("colour", "u1", 3)])


def colour_files(
    name: str, mesh: ColouredMesh, printing: PrintSpec, bed_from_target: Array, thumbnail: bytes
) -> Iterator[tuple[str, bytes, str]]:
    """Suffix, content and purpose of each file.

    Args:
        name: of the design.
        mesh: in the target's frame.
        printing: gives the two colours.
        bed_from_target: where the 3MF file puts it.
        thumbnail: of the 3MF file, PNG.
    """
    colours = {"body": printing.body_colour, "ink": printing.ink_colour}
    ask = "in mm: say so where it is asked"
    model = package(_threemf(name, mesh, colours, bed_from_target), {"Metadata/thumbnail.png": thumbnail})
    yield "colour.3mf", model, "for services that print in full colour"
    yield "colour.ply", _ply(mesh, colours), f"the same with coloured corners and faces; {ask}"
    yield "colour.wrl", _vrml(mesh, colours), f"the same in VRML; {ask}"
    files = {f"{name}.colour.obj": _obj(f"{name}.colour.mtl", mesh), f"{name}.colour.mtl": _mtl(colours)}
    yield "colour.zip", zipped(files), f"the same in OBJ with its MTL; {ask}"


def _shares(colour: str) -> str:
    return " ".join(f"{value / 255:.6g}" for value in ImageColor.getrgb(colour)[:3])


def _threemf(name: str, mesh: ColouredMesh, colours: dict[str, str], bed_from_target: Array) -> tuple[str | bytes, ...]:
    bases = "".join(
        f'   <base name="{each}" displaycolor={quoted(colour.upper())}/>\n' for each, colour in colours.items()
    )
    return (
        f'<?xml version="1.0" encoding="UTF-8"?>\n<model unit="millimeter" xml:lang="en-US" xmlns="{_CORE}">\n',
        f' <resources>\n  <basematerials id="1">\n{bases}  </basematerials>\n',
        f'  <object id="2" type="model" name={quoted(name)} pid="1" pindex="0">\n   <mesh>\n    <vertices>\n',
        vertex_lines(mesh.surface), "    </vertices>\n    <triangles>\n",
        triangle_lines(mesh.body), triangle_lines(mesh.ink, (*TRIANGLE[:3], b'" pid="1" p1="1"/>\n')),
        "    </triangles>\n   </mesh>\n  </object>\n </resources>\n",
        f" <build>\n{build_item(2, bed_from_target)} </build>\n</model>\n",
    )  # fmt: skip


def _ply(mesh: ColouredMesh, colours: dict[str, str]) -> bytes:
    vertices, faces = list[np.ndarray](), list[np.ndarray]()
    count = 0
    for triangles, colour in zip((mesh.body, mesh.ink), colours.values(), strict=True):
        used, corner = np.unique(triangles, return_inverse=True)
        vertex, face = np.zeros(len(used), _VERTEX), np.zeros(len(triangles), _FACE)
        vertex["place"], vertex["colour"] = mesh.surface.vertices_mm[used], ImageColor.getrgb(colour)[:3]
        face["count"], face["corner"], face["colour"] = 3, corner.reshape(-1, 3) + count, ImageColor.getrgb(colour)[:3]
        vertices.append(vertex)
        faces.append(face)
        count += len(used)
    head = (
        f"ply\nformat binary_little_endian 1.0\ncomment {_MM}\nelement vertex {count}\n"
        f"property float x\nproperty float y\nproperty float z\n{_PLY_COLOUR}"
        f"element face {len(mesh.surface.triangles)}\nproperty list uchar int vertex_indices\n{_PLY_COLOUR}end_header\n"
    )
    return head.encode() + b"".join(part.tobytes() for part in (*vertices, *faces))


def _vrml(mesh: ColouredMesh, colours: dict[str, str]) -> bytes:
    corner = (b"", b" ", b" ", b" -1\n")
    return b"".join((
        f"#VRML V2.0 utf8\n# {_MM}\nShape {{\n appearance Appearance {{ material Material {{ }} }}\n".encode(),
        b" geometry IndexedFaceSet {\n  solid TRUE\n  creaseAngle 0\n  coord Coordinate { point [\n",
        vertex_lines(mesh.surface, (b"", b" ", b" ", b"\n")), b"  ] }\n  coordIndex [\n",
        triangle_lines(mesh.body, corner), triangle_lines(mesh.ink, corner),
        f"  ]\n  color Color {{ color [ {', '.join(map(_shares, colours.values()))} ] }}\n".encode(),
        b"  colorPerVertex FALSE\n  colorIndex [\n", b"0\n" * len(mesh.body), b"1\n" * len(mesh.ink), b"  ]\n }\n}\n",
    ))  # fmt: skip


def _obj(materials: str, mesh: ColouredMesh) -> bytes:
    corner = (b"f ", b" ", b" ", b"\n")
    return b"".join((
        f"# {_MM}\nmtllib {materials}\no target\n".encode(), vertex_lines(mesh.surface, (b"v ", b" ", b" ", b"\n")),
        b"usemtl body\n", triangle_lines(mesh.body, corner, first=1),
        b"usemtl ink\n", triangle_lines(mesh.ink, corner, first=1),
    ))  # fmt: skip


def _mtl(colours: dict[str, str]) -> bytes:
    return "\n".join(f"newmtl {name}\nKd {_shares(one)}\nKs 0 0 0\nillum 1\n" for name, one in colours.items()).encode()
