"""3MF packages that slicers open as objects in two filaments: the body in the first, the ink in the second.

A plate's pieces are an object each; a piece without ink is all body.
PrusaSlicer wants one mesh and reads the filaments from triangle ranges; Bambu Studio, OrcaSlicer and Cura want
one mesh a part, joined as components. Each layout falls apart in the other's slicer, hence two files.
The packages are written with `zipfile` because lib3mf renames the prefix of `slic3rpe:Version3mf`, which
PrusaSlicer knows by its text.

ZIP packages that are the same for the same content.
"""

import io
import zipfile
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from html import escape
from types import MappingProxyType

import numpy as np
from numpy.typing import NDArray

from designer.base.arrays import Array, Rows
from designer.base.errors import InputError
from designer.base.words import NAME
from designer.make.bed import Piece
from designer.make.mesh import ColouredMesh, Mesh
from designer.spec.spec import PrintSpec

Members = Mapping[str, bytes]
_NONE: Members = MappingProxyType({})
_FIRST_DATE = (1980, 1, 1, 0, 0, 0)
_LEVEL = 1
"""Level 6 takes three times as long for files a fifth smaller."""


def zipped(members: Mapping[str, bytes]) -> bytes:
    """A package of files by their paths, in the order given."""
    package = io.BytesIO()
    with zipfile.ZipFile(package, "w") as archive:
        for path, content in members.items():
            entry = zipfile.ZipInfo(path, _FIRST_DATE)
            entry.create_system = 3  # Unix; else the byte depends on the system that writes
            archive.writestr(entry, content, zipfile.ZIP_DEFLATED, _LEVEL)
    return package.getvalue()


_CONTENT_TYPES = {
    "rels": "application/vnd.openxmlformats-package.relationships+xml",
    "model": "application/vnd.ms-package.3dmanufacturing-3dmodel+xml",
    "config": "application/xml",
    "xml": "application/xml",
    "png": "image/png",
}
"""By the ends of names."""
_THUMBNAIL = "http://schemas.openxmlformats.org/package/2006/relationships/metadata/thumbnail"
_RELATIONSHIPS = (
    ("3D/3dmodel.model", "http://schemas.microsoft.com/3dmanufacturing/2013/01/3dmodel"),
    ("Metadata/thumbnail.png", _THUMBNAIL),
    ("Metadata/plate_1.png", _THUMBNAIL),
    ("Metadata/plate_1.png", "http://schemas.bambulab.com/package/2021/cover-thumbnail-middle"),
    ("Metadata/plate_1_small.png", "http://schemas.bambulab.com/package/2021/cover-thumbnail-small"),
)
"""What a file of a package is to it, if it is there."""
_MODEL_START = """<?xml version="1.0" encoding="UTF-8"?>
<model unit="millimeter" xml:lang="en-US" xmlns="http://schemas.microsoft.com/3dmanufacturing/core/2015/02"
 xmlns:m="http://schemas.microsoft.com/3dmanufacturing/material/2015/02"
 xmlns:slic3rpe="http://schemas.slic3r.org/3mf/2017/06"
 xmlns:cura="http://software.ultimaker.com/xml/cura/3mf/2015/10"
 xmlns:BambuStudio="http://schemas.bambulab.com/package/2021">
"""

# Resource ids in the model files. OrcaSlicer keeps one colour of a colour group, so each has its own.
_BODY_COLOUR, _INK_COLOUR = 1, 2
_FIRST_OBJECT, _IDS_OF_OBJECT = 3, 3  # body, ink, and the object of both
PAINTED_METADATA = (
    ' <metadata name="slic3rpe:Version3mf">1</metadata>\n <metadata name="slic3rpe:MmPaintingVersion">1</metadata>\n'
)
_PAINTED = b'" paint_color="8" slic3rpe:mmu_segmentation="8"/>\n'
"""A whole triangle in the second filament, as `TriangleSelector::serialize` has it: 4 is the first, 8 the second."""
_COLOUR_CHANGE, _PAUSE = 0, 1  # `CustomGCode::Type` of both slicers
Around = tuple[bytes, bytes, bytes, bytes]
"""Text before each of three numbers, and after them."""
VERTEX: Around = (b'<vertex x="', b'" y="', b'" z="', b'"/>\n')
TRIANGLE: Around = (b'<triangle v1="', b'" v2="', b'" v3="', b'"/>\n')
Characters = NDArray[np.uint8]
_LEFT_OUT = 0


@dataclass(frozen=True)
class ObjectText:
    """The XML of a piece that both packages share."""

    body_id: int
    name: str  # escaped, in its quotes
    body: Mesh
    ink: Mesh | None
    item: str
    body_vertices: bytes
    ink_vertices: bytes
    body_triangles: bytes

    @classmethod
    def of(cls, piece: Piece, first_id: int) -> "ObjectText":
        """With three ids from the first on."""
        body, ink = piece.part.as_printed.body, piece.part.as_printed.ink
        item = build_item(first_id + 2, piece.bed_from_part)
        ink_vertices = b"" if ink is None else vertex_lines(ink)
        return cls(
            first_id,
            quoted(piece.name),
            body,
            ink,
            item,
            vertex_lines(body),
            ink_vertices,
            triangle_lines(body.triangles),
        )

    @classmethod
    def painted(cls, name: str, mesh: ColouredMesh, bed_from_part: Array) -> "ObjectText":
        """One mesh, whose ink is painted with the second filament."""
        triangles = triangle_lines(mesh.body) + triangle_lines(mesh.ink, (*TRIANGLE[:3], _PAINTED))
        item = build_item(_FIRST_OBJECT + 2, bed_from_part)
        return cls(_FIRST_OBJECT, quoted(name), mesh.surface, None, item, vertex_lines(mesh.surface), b"", triangles)

    @property
    def ink_id(self) -> int:
        """Of the ink's mesh."""
        return self.body_id + 1

    @property
    def object_id(self) -> int:
        """Of what is built."""
        return self.body_id + 2


def objects_of(pieces: Sequence[Piece]) -> list[ObjectText]:
    """An object a piece, numbered in their order.

    Raises:
        InputError: a name that XML cannot hold.
    """
    for piece in pieces:
        if not piece.name.isprintable():
            raise InputError(f"name {piece.name!r} holds a control character; use printable letters")
    return [ObjectText.of(piece, _FIRST_OBJECT + _IDS_OF_OBJECT * row) for row, piece in enumerate(pieces)]


def prusa_change(change_mm: float | None, colour: str) -> Members:
    """PrusaSlicer's change of colour in front of the layer with this top; nothing where there is none."""
    if change_mm is None:
        return _NONE
    return {"Metadata/Prusa_Slicer_custom_gcode_per_print_z.xml": (
        '<?xml version="1.0" encoding="utf-8"?>\n<custom_gcodes_per_print_z>\n'
        f'<code print_z="{change_mm:g}" type="{_COLOUR_CHANGE}" extruder="1" color={quoted(colour)} '
        'extra="" gcode="M600"/>\n<mode value="SingleExtruder"/>\n</custom_gcodes_per_print_z>\n'
    ).encode()}  # fmt: skip


def bambu_changes(changes_mm: Sequence[float | None]) -> Members:
    """The pause of each plate of a project, as Bambu Studio and OrcaSlicer have it: `bambu_changes([4.8, None])`."""
    plates = "".join(
        f'<plate>\n<plate_info id="{number}"/>\n'
        f'<layer top_z="{change_mm:g}" type="{_PAUSE}" extruder="1" color="" extra="" gcode="M400 U1"/>\n'
        '<mode value="SingleExtruder"/>\n</plate>\n'
        for number, change_mm in enumerate(changes_mm, start=1) if change_mm is not None
    )  # fmt: skip
    if not plates:
        return _NONE
    head = '<?xml version="1.0" encoding="utf-8"?>\n'
    text = f"{head}<custom_gcodes_per_layer>\n{plates}</custom_gcodes_per_layer>\n"
    return {"Metadata/custom_gcode_per_layer.xml": text.encode()}


def prusa_package(objects: Sequence[ObjectText], printing: PrintSpec, members: Members = _NONE) -> bytes:
    """One mesh of both shells an object; PrusaSlicer cuts it at the triangle ranges of its own file.

    Args:
        objects: what is built.
        printing: gives the two colours.
        members: further files of the package by their paths, such as `prusa_config`.
    """
    model: list[str | bytes] = [
        _MODEL_START, ' <metadata name="slic3rpe:Version3mf">1</metadata>\n', f" <resources>\n{_colours(printing)}",
    ]  # fmt: skip
    config = '<?xml version="1.0" encoding="UTF-8"?>\n<config>\n'
    for one in objects:
        first_ink, inked = len(one.body.triangles), (*TRIANGLE[:3], f'" pid="{_INK_COLOUR}" p1="0"/>\n'.encode())
        volumes, ink_triangles = _prusa_volume("body", 1, 0, first_ink - 1), b""
        if one.ink is not None:
            ink_triangles = triangle_lines(one.ink.triangles, inked, first=len(one.body.vertices_mm))
            volumes += _prusa_volume("ink", 2, first_ink, first_ink + len(one.ink.triangles) - 1)
        model += [
            f'  <object id="{one.object_id}" type="model" name={one.name} pid="{_BODY_COLOUR}" pindex="0">\n',
            "   <mesh>\n    <vertices>\n", one.body_vertices, one.ink_vertices, "    </vertices>\n",
            "    <triangles>\n", one.body_triangles, ink_triangles, "    </triangles>\n",
            "   </mesh>\n  </object>\n",
        ]  # fmt: skip
        config += (
            f' <object id="{one.object_id}" instances_count="1">\n'
            f'  <metadata type="object" key="name" value={one.name}/>\n{volumes} </object>\n'
        )
    files = {"Metadata/Slic3r_PE_model.config": f"{config}</config>\n".encode()}
    return package((*model, *_end(objects)), {**files, **members})


def prusa_config(settings: Mapping[str, str]) -> Members:
    """Settings as PrusaSlicer keeps them in a package."""
    lines = "".join(f"; {key} = {value}\n" for key, value in settings.items())
    return {"Metadata/Slic3r_PE.config": f"; generated by {NAME}\n\n{lines}".encode()}


def _prusa_volume(name: str, filament: int, first: int, last: int) -> str:
    """The triangles `first` to `last` as a part of its own."""
    return (
        f'  <volume firstid="{first}" lastid="{last}">\n'
        f'   <metadata type="volume" key="name" value="{name}"/>\n'
        f'   <metadata type="volume" key="volume_type" value="ModelPart"/>\n'
        f'   <metadata type="volume" key="extruder" value="{filament}"/>\n'
        "  </volume>\n"
    )


def bambu_package(
    objects: Sequence[ObjectText], printing: PrintSpec, metadata: str = "", plates: str = "", members: Members = _NONE
) -> bytes:
    """One mesh a part, joined as components of the object that is built.

    Args:
        objects: what is built.
        printing: gives the two colours.
        metadata: of the model, in XML.
        plates: what the slicer's settings hold beside the objects, in XML.
        members: further files of the package by their paths.
    """
    model: list[str | bytes] = [_MODEL_START, metadata, f" <resources>\n{_colours(printing)}"]
    config = '<?xml version="1.0" encoding="UTF-8"?>\n<config>\n'
    for one in objects:
        leaves = [one.body_id] if one.ink is None else [one.body_id, one.ink_id]
        components = "".join(f'    <component objectid="{leaf}"/>\n' for leaf in leaves)
        model += _leaf("body", one.body_id, _BODY_COLOUR, 0, one.body_vertices, one.body_triangles)
        parts = _bambu_part("body", one.body_id, 1)
        if one.ink is not None:
            model += _leaf("ink", one.ink_id, _INK_COLOUR, 1, one.ink_vertices, triangle_lines(one.ink.triangles))
            parts += _bambu_part("ink", one.ink_id, 2)
        model += [
            f'  <object id="{one.object_id}" type="model" name={one.name}>\n',
            f"   <components>\n{components}   </components>\n  </object>\n",
        ]
        config += (
            f' <object id="{one.object_id}">\n'
            f'  <metadata key="name" value={one.name}/>\n  <metadata key="extruder" value="1"/>\n{parts} </object>\n'
        )
    settings = {"Metadata/model_settings.config": f"{config}{plates}</config>\n".encode()}
    return package((*model, *_end(objects)), {**settings, **members})


def _leaf(
    name: str, number: int, colour: int, cura_extruder: int, vertices: bytes, triangles: bytes
) -> tuple[str | bytes, ...]:
    """A part's mesh object."""
    return (
        f'  <object id="{number}" type="model" name="{name}" pid="{colour}" pindex="0">\n   <metadatagroup>\n',
        f'    <metadata name="cura:extruder_nr" type="xs:string" preserve="true">{cura_extruder}</metadata>\n',
        "   </metadatagroup>\n   <mesh>\n    <vertices>\n", vertices, "    </vertices>\n",
        "    <triangles>\n", triangles, "    </triangles>\n   </mesh>\n  </object>\n",
    )  # fmt: skip


def _bambu_part(name: str, number: int, filament: int) -> str:
    return (
        f'  <part id="{number}" subtype="normal_part">\n'
        f'   <metadata key="name" value="{name}"/>\n'
        f'   <metadata key="extruder" value="{filament}"/>\n'
        "  </part>\n"
    )


def _colours(printing: PrintSpec) -> str:
    return "".join(
        f'  <m:colorgroup id="{number}">\n   <m:color color={quoted(colour.upper())}/>\n  </m:colorgroup>\n'
        for number, colour in ((_BODY_COLOUR, printing.body_colour), (_INK_COLOUR, printing.ink_colour))
    )


def quoted(text: str) -> str:
    """As the value of an attribute in XML."""
    escaped = escape(text, quote=False).replace('"', "&quot;")  # lib3mf knows no &#x27;
    return f'"{escaped}"'


def build_item(object_id: int, bed_from_part: Array) -> str:
    """What is built, and where it stands."""
    # 3MF multiplies row vectors: the transform is written column by column.
    transform = " ".join(f"{value:.9f}" for value in bed_from_part[:3].T.ravel())
    return f'  <item objectid="{object_id}" transform="{transform}"/>\n'


def _end(objects: Sequence[ObjectText]) -> tuple[str, ...]:
    """What is built."""
    return " </resources>\n <build>\n", *(one.item for one in objects), " </build>\n</model>\n"


def vertex_lines(mesh: Mesh, around: Around = VERTEX) -> bytes:
    """A line a vertex, text around x, y and z, to 10 nm: finer than single precision holds at a bed's size."""
    x, y, z = (decimals(column, 5) for column in mesh.vertices_mm.T)
    return text_lines(around[0], x, around[1], y, around[2], z, around[3])


def triangle_lines(triangles: NDArray[np.int32], around: Around = TRIANGLE, first: int = 0) -> bytes:
    """A line a triangle, text around the numbers of its vertices, which count from `first`."""
    if not len(triangles):
        return b""
    number = whole_numbers(np.arange(first, first + 1 + triangles.max()))  # each is written in several triangles
    one, two, three = (number[corner] for corner in triangles.T)
    return text_lines(around[0], one, around[1], two, around[2], three, around[3])


def package(model: Iterable[str | bytes], members: Members) -> bytes:
    """Zip a model and what a slicer reads beside it, by their paths."""
    files = {
        "3D/3dmodel.model": b"".join(part.encode() if isinstance(part, str) else part for part in model),
        **members,
    }
    head, schema = '<?xml version="1.0" encoding="UTF-8"?>\n', "http://schemas.openxmlformats.org/package/2006"
    endings = sorted({"rels", *(path.rpartition(".")[2] for path in files)})
    types = "".join(f' <Default Extension="{one}" ContentType="{_CONTENT_TYPES[one]}"/>\n' for one in endings)
    relations = "".join(
        f' <Relationship Id="rel-{number}" Target="/{path}" Type="{kind}"/>\n'
        for number, (path, kind) in enumerate(_RELATIONSHIPS, start=1)
        if path in files
    )
    return zipped({
        "[Content_Types].xml": f'{head}<Types xmlns="{schema}/content-types">\n{types}</Types>\n'.encode(),
        "_rels/.rels": f'{head}<Relationships xmlns="{schema}/relationships">\n{relations}</Relationships>\n'.encode(),
        **files,
    })  # fmt: skip


def text_lines(*parts: bytes | Characters) -> bytes:
    """Lines that go on from part to part: text that all share, and characters of numbers.  # (N, W)"""
    blocks = [np.frombuffer(part, np.uint8)[None] if isinstance(part, bytes) else part for part in parts]
    ends = np.cumsum([block.shape[1] for block in blocks])
    lines = np.empty((max(len(block) for block in blocks), ends[-1]), np.uint8)
    for block, end in zip(blocks, ends, strict=True):
        lines[:, end - block.shape[1] : end] = block
    return lines.tobytes().translate(None, delete=bytes([_LEFT_OUT]))


def whole_numbers(values: NDArray[np.integer]) -> Characters:
    """Numbers from 0 on.  # (N,) -> (N, W)"""
    return _digits(values.astype(np.int64), 1)


def decimals(values: Array, places: int) -> Characters:
    """Numbers rounded to so many decimal places, which all are written.  # (N,) -> (N, W)"""
    digits = _digits(np.rint(np.abs(values) * 10**places).astype(np.int64), 1 + places)
    text = np.full((len(values), 2 + digits.shape[1]), ord("."), np.uint8)
    text[:, 0] = np.where(np.signbit(values), ord("-"), _LEFT_OUT)
    text[:, 1 : -places - 1] = digits[:, :-places]
    text[:, -places:] = digits[:, -places:]
    return text


def _digits(values: Rows, least: int) -> Characters:
    """Decimal digits of numbers from 0 on, `least` at least.  # (N,) -> (N, W)"""
    width = max(least, len(str(values.max(initial=0))))
    digits = np.empty((len(values), width), np.uint8)
    rest = values
    for place in range(width):  # from the last one on
        tenth = rest // 10
        digit = rest - 10 * tenth + ord("0")
        digits[:, width - 1 - place] = digit if place < least else np.where(rest > 0, digit, _LEFT_OUT)
        rest = tenth
    return digits
