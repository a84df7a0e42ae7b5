"""The laws of builds and formats: whatever is written shows every ring, can be printed, and is the same again."""

import base64
import hashlib
import io
import re
import tempfile
import xml.etree.ElementTree as ET
import zipfile
import zlib
from collections.abc import Callable, Iterator, Mapping
from functools import cache
from pathlib import Path

import build123d
import ezdxf
import lib3mf
import numpy as np
import pytest
import svgelements
import trimesh
from PIL import Image
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components
from scipy.spatial import cKDTree
from shapely import MultiPoint

from designer.app.design import DesignedTarget, design
from designer.base.arrays import Array, Rows
from designer.base.errors import InputError
from designer.formats.folder import OutputFile
from designer.kinds.sizing import size_job
from designer.make import cad
from designer.spec.build import BUILDS, Format, builds_of
from designer.spec.format import FORMATS
from designer.spec.kind import kind_named
from tests.support.designs import SMALL, asked_for, step_in_place
from tests.support.programs import PYTHON, run

pytestmark = pytest.mark.filterwarnings("ignore:.*deprecated")  # in the readers of others

IN_PIECES = {"size": "150x100mm", "bed": "130x130x100mm"}
"""Of a board that is larger than the bed."""


def rings_of_mesh(vertices: Array, triangles: Rows, most_mm: float) -> int:
    """How many closed parts have a hole and are no larger than the largest ring."""
    used, triangles = np.unique(triangles, return_inverse=True)
    vertices, triangles = vertices[used], triangles.reshape(-1, 3)
    _, joined = np.unique(np.round(vertices, 4), axis=0, return_inverse=True)
    corners = joined.reshape(-1)[triangles]
    edges = np.concatenate([corners[:, [0, 1]], corners[:, [1, 2]], corners[:, [2, 0]]])
    count = int(joined.max()) + 1
    _, part = connected_components(coo_array((np.ones(len(edges)), edges.T), (count, count)), directed=False)
    euler = np.bincount(part) - np.bincount(part[edges[:, 0]]) / 2 + np.bincount(part[corners[:, 0]])
    place = np.empty((count, 3))
    place[joined.reshape(-1)] = vertices
    low, high = np.full((len(euler), 3), np.inf), np.full((len(euler), 3), -np.inf)
    np.minimum.at(low, part, place)
    np.maximum.at(high, part, place)
    return int(((euler == 0) & (np.linalg.norm(high - low, axis=1) <= most_mm)).sum())


def meshes_of_3mf(content: bytes) -> Iterator[tuple[Array, Rows]]:
    """Meshes, those of PrusaSlicer by their volumes: ranges of triangles that its own file names."""
    with zipfile.ZipFile(io.BytesIO(content)) as package:
        volumes = "Metadata/Slic3r_PE_model.config"
        text = package.read(volumes).decode() if volumes in package.namelist() else ""
        objects = [re.findall(r'firstid="(\d+)" lastid="(\d+)"', one) for one in text.split("<object ")[1:]]
        for name in (name for name in package.namelist() if name.endswith(".model")):
            for number, mesh in enumerate(ET.fromstring(package.read(name)).findall(".//{*}mesh")):
                points = [[float(one.attrib[axis]) for axis in "xyz"] for one in mesh.findall(".//{*}vertex")]
                corners = [[int(one.attrib[f"v{k}"]) for k in (1, 2, 3)] for one in mesh.findall(".//{*}triangle")]
                ranges = objects[number] if objects else [(0, len(corners) - 1)]
                yield from ((np.array(points), np.array(corners[int(a) : int(b) + 1])) for a, b in ranges)


def in_3mf(content: bytes, most_mm: float) -> int:
    """By lib3mf strictly, without a warning; of its meshes each one closed; a thumbnail shows something."""
    reader = (model := lib3mf.get_wrapper().CreateModel()).QueryReader("3mf")
    reader.SetStrictModeActive(True)
    reader.ReadFromBuffer(content)
    assert [reader.GetWarning(k) for k in range(reader.GetWarningCount())] == []
    meshes = model.GetMeshObjects()
    while meshes.MoveNext():
        assert meshes.GetCurrentMeshObject().IsManifoldAndOriented()
    picture = Image.open(io.BytesIO(bytes(model.GetPackageThumbnailAttachment().WriteToBuffer())))
    assert picture.size in {(256, 256), (512, 512)}
    low, high = picture.convert("L").getextrema()
    assert high - low > 100
    return sum(rings_of_mesh(*mesh, most_mm) for mesh in meshes_of_3mf(content))


def in_mesh(kind: str, scale: float) -> Callable[[bytes, float], int]:
    def count(content: bytes, most_mm: float) -> int:
        scene = trimesh.load_scene(io.BytesIO(content), file_type=kind)
        meshes = [one for one in scene.geometry.values() if isinstance(one, trimesh.Trimesh)]
        assert all(one.is_watertight and one.is_winding_consistent and one.volume > 0 for one in meshes)
        return sum(rings_of_mesh(one.vertices * scale, one.faces, most_mm) for one in meshes)

    return count


def rings_of_surface(vertices: Array, body: Rows, ink: Rows, most_mm: float) -> int:
    """Of one closed surface in two colours: its ink made closed by a copy that looks inwards."""
    solid = trimesh.Trimesh(vertices, np.concatenate([body, ink]))
    assert solid.is_watertight
    assert solid.is_winding_consistent
    assert solid.volume > 0
    return rings_of_mesh(vertices, np.concatenate([ink, ink[:, ::-1]]), most_mm)


def in_colour_3mf(content: bytes, most_mm: float) -> int:
    """Base materials by lib3mf, strictly: body, which is the object's, and ink."""
    reader = (model := lib3mf.get_wrapper().CreateModel()).QueryReader("3mf")
    reader.SetStrictModeActive(True)
    reader.ReadFromBuffer(content)
    assert reader.GetWarningCount() == 0
    groups, meshes = model.GetBaseMaterialGroups(), model.GetMeshObjects()
    assert (groups.MoveNext(), meshes.MoveNext(), meshes.Count()) == (True, True, 1)
    group, mesh = groups.GetCurrentBaseMaterialGroup(), meshes.GetCurrentMeshObject()
    names = {number: group.GetName(number) for number in group.GetAllPropertyIDs()}
    is_ink = np.array([names[one.PropertyIDs[0]] == "ink" for one in mesh.GetAllTriangleProperties()])
    vertices = np.array([list(one.Coordinates) for one in mesh.GetVertices()])
    triangles = np.array([list(one.Indices) for one in mesh.GetTriangleIndices()])
    assert mesh.IsManifoldAndOriented()
    return rings_of_surface(vertices, triangles[~is_ink], triangles[is_ink], most_mm)


def in_painted_3mf(content: bytes, most_mm: float) -> int:
    """By lib3mf strictly, but for the attribute of Bambu Studio, which has no namespace; painted alike for each slicer.

    "8" is a whole triangle in the second filament; what is not painted is in the first.
    """
    with zipfile.ZipFile(io.BytesIO(content)) as archive:
        members = {name: archive.read(name) for name in archive.namelist()}
    model = ET.fromstring(members["3D/3dmodel.model"])
    triangles = model.findall(".//{*}triangle")
    ink = [one.get("paint_color") for one in triangles]
    assert {*ink} == {None, "8"}
    assert ink == [one.get("{http://schemas.slic3r.org/3mf/2017/06}mmu_segmentation") for one in triangles]
    strict = {**members, "3D/3dmodel.model": members["3D/3dmodel.model"].replace(b' paint_color="8"', b"")}
    plain = io.BytesIO()
    with zipfile.ZipFile(plain, "w") as archive:
        for name, member in strict.items():
            archive.writestr(name, member)
    reader = (read := lib3mf.get_wrapper().CreateModel()).QueryReader("3mf")
    reader.SetStrictModeActive(True)
    reader.ReadFromBuffer(plain.getvalue())
    assert (reader.GetWarningCount(), read.GetMeshObjects().Count()) == (0, 1)
    vertices = np.array([[float(one.attrib[axis]) for axis in "xyz"] for one in model.findall(".//{*}vertex")])
    corners = np.array([[int(one.attrib[f"v{k}"]) for k in (1, 2, 3)] for one in triangles])
    is_ink = np.array(ink) == "8"
    return rings_of_surface(vertices, corners[~is_ink], corners[is_ink], most_mm)


def in_ply(content: bytes, most_mm: float) -> int:
    """Coloured corners, alike all over a triangle, as its face is coloured."""
    mesh = trimesh.load_mesh(io.BytesIO(content), file_type="ply", process=False)
    colour = mesh.visual.vertex_attributes["color"] if mesh.visual.kind is None else mesh.visual.vertex_colors
    corners = np.asarray(colour)[mesh.faces, :3]
    assert (corners == corners[:, :1]).all()
    is_ink = corners[:, 0, 0] == 0
    return rings_of_surface(mesh.vertices, mesh.faces[~is_ink], mesh.faces[is_ink], most_mm)


def in_vrml(content: bytes, most_mm: float) -> int:
    """By its text: neither trimesh nor another reader here knows it."""
    text = content.decode("ascii")
    assert text.startswith("#VRML V2.0 utf8\n")

    def numbers(field: str) -> Array:
        found = re.search(rf"\b{field} \[([^\]]*)\]", text)
        assert found is not None
        return np.array(found[1].replace(",", " ").split(), dtype=float)

    quads = numbers("coordIndex").astype(int).reshape(-1, 4)
    assert (quads[:, 3] == -1).all()
    light = numbers("color").reshape(-1, 3)[numbers("colorIndex").astype(int)]
    is_ink, triangles = (light == 0).all(axis=1), quads[:, :3]
    return rings_of_surface(numbers("point").reshape(-1, 3), triangles[~is_ink], triangles[is_ink], most_mm)


def in_obj_zip(content: bytes, most_mm: float) -> int:
    """OBJ with the materials of its MTL, which lies beside it."""
    with zipfile.ZipFile(io.BytesIO(content)) as archive:
        files = {name: io.BytesIO(archive.read(name)) for name in archive.namelist()}
    (obj,) = (file for name, file in files.items() if name.endswith(".obj"))
    resolver = trimesh.resolvers.ZipResolver(files)
    scene = trimesh.load_scene(obj, file_type="obj", resolver=resolver, process=False, group_material=True)
    by_name = {one.visual.material.name: one for one in scene.geometry.values()}
    assert {name: one.visual.material.diffuse[0] for name, one in by_name.items()} == {"body": 255, "ink": 0}
    body, ink = by_name["body"], by_name["ink"]
    vertices = np.concatenate([body.vertices, ink.vertices])
    return rings_of_surface(vertices, body.faces, ink.faces + len(body.vertices), most_mm)


def in_relief(ending: str, content: bytes, most_mm: float) -> int:
    """Flat pieces of a surface that have a hole: tops of raised rings, floors of recessed ones."""
    meshes = [trimesh.load(io.BytesIO(content), file_type="stl")] if ending == "stl" else []
    if not meshes:
        meshes = [trimesh.Trimesh(*mesh) for mesh in meshes_of_3mf(content)]
    count = 0
    for mesh in meshes:
        assert isinstance(mesh, trimesh.Trimesh)
        assert mesh.is_watertight
        assert mesh.volume > 0
        for facet in mesh.facets:
            corners = mesh.faces[facet]
            points = mesh.vertices[used := np.unique(corners)]
            edges = np.unique(np.sort(corners[:, [0, 1, 1, 2, 2, 0]].reshape(-1, 2), axis=1), axis=0)
            is_ring = len(used) - len(edges) + len(corners) == 0
            count += is_ring and bool(np.linalg.norm(np.ptp(points, axis=0)) <= most_mm)
    return count


def in_step(content: bytes, most_mm: float) -> int:
    with tempfile.NamedTemporaryFile(suffix=".step") as place:
        Path(place.name).write_bytes(content)
        ink = next(child for child in build123d.import_step(place.name).children if child.label == "ink")
    return sum(child.label == "ring" for child in ink.children)


def in_svg(content: bytes, most_mm: float) -> int:
    paths = svgelements.SVG.parse(io.BytesIO(content), ppi=25.4).elements(lambda one: isinstance(one, svgelements.Path))
    parts = [svgelements.Path(part) for path in paths for part in path.as_subpaths()]
    return paired([part.bbox() for part in parts if any(isinstance(step, svgelements.Arc) for step in part)])


def in_dxf(content: bytes, most_mm: float) -> int:
    circles = ezdxf.read(io.StringIO(content.decode("ascii"))).modelspace().query("CIRCLE")
    return paired(
        [
            (at.x - radius, at.y - radius, at.x + radius, at.y + radius)
            for at, radius in ((one.dxf.center, one.dxf.radius) for one in circles)
        ]
    )


def in_pdf(content: bytes, most_mm: float) -> int:
    boxes = []
    for stream in re.findall(rb"stream\r?\n(.*?)endstream", content, re.DOTALL):
        text = zlib.decompress(base64.a85decode(b"<~" + stream.strip(), adobe=True)).decode("latin-1")
        for arcs in re.findall(r"(?:[-\d.]+ [-\d.]+ m )((?:(?:[-\d.]+ ){6}c\s+){4})", text):
            points = np.array([float(number) for number in re.findall(r"[-\d.]+", arcs)]).reshape(-1, 3, 2)[:, 2]
            boxes.append((*points.min(axis=0).tolist(), *points.max(axis=0).tolist()))
    return paired(boxes)


def in_gerber(ending: str) -> Callable[[bytes, float], int]:
    def count(content: bytes, most_mm: float) -> int:
        """Apertures of a circle with a hole, flashed: `%ADD11C,7.0X3.15*%`."""
        with zipfile.ZipFile(io.BytesIO(content)) as archive:
            text = "".join(archive.read(name).decode() for name in archive.namelist() if name[-4:] in ending)
        holed = set(re.findall(r"%ADD(\d+)C,[\d.]+X[\d.]+\*%", text))
        flashed, chosen = 0, ""
        for line in text.splitlines():
            if pick := re.match(r"D(\d{2,})\*", line):
                chosen = pick[1]
            flashed += line.endswith("D03*") and chosen in holed
        return flashed

    return count


def paired(boxes: list[tuple[float, float, float, float]]) -> int:
    """Of circles by their boxes: how many have another about the same middle."""
    middles = [((left + right) / 2, (low + high) / 2) for left, low, right, high in boxes]
    return len(cKDTree(middles).query_pairs(0.01))


READERS: Mapping[str, tuple[Format, Callable[[bytes, float], int]]] = {
    "prusa.3mf": ("3mf", in_3mf), "bambu.3mf": ("3mf", in_3mf), "bambu-orca.3mf": ("project", in_3mf),
    "stl": ("stl", in_mesh("stl", 1.0)), "glb": ("glb", in_mesh("glb", 1000.0)), "step": ("step", in_step),
    "colour.3mf": ("colour", in_colour_3mf), "colour.ply": ("colour", in_ply), "colour.wrl": ("colour", in_vrml),
    "colour.zip": ("colour", in_obj_zip), "painted.3mf": ("painted", in_painted_3mf),
    "svg": ("svg", in_svg), "laser.svg": ("laser", in_svg), "dxf": ("dxf", in_dxf), "pdf": ("pdf", in_pdf),
    "gerber.zip": ("gerber", in_gerber(".gto.gbo")), "gerber-mask.zip": ("gerber-mask", in_gerber(".gts.gbs")),
}  # fmt: skip
"""By the end of a name: the format, and how many rings a reader finds. What is a picture has its own tests."""
PRINTED = ("prusa.3mf", "bambu.3mf", "bambu-orca.3mf", "stl")
PICTURED = ("sim.glb", "sim.obj", "order.pdf", "shop.pdf")
WAYS = [(kind, build) for kind in ("board", "cube") for build in builds_of(kind_named(kind).spec.form)]
"""Every build, of a small plate and a small solid."""


each_way = pytest.mark.parametrize(("kind", "build"), WAYS)
USUAL = {"one-piece": {"stand": True, "ink_offset": "-20um", "shrink_compensation": "0.3%"}}
"""What only a build of one piece takes in every format."""


def wishes_of(kind: str, build: str) -> dict[str, object]:
    """All formats of a small target that is built so."""
    values = {**SMALL[kind], "chord_error": "0.2mm", "labels": False, "page": "fit", "formats": "all", "build": build}
    return {**values, **USUAL.get(build, {}), **(IN_PIECES if (kind, build) == ("board", "tiles") else {})}


@cache
def made(kind: str, build: str) -> tuple[DesignedTarget, tuple[OutputFile, ...]]:
    """It and its files; all but the first have their STEP made in this process, which has loaded the CAD kernel."""
    target = design(kind, **wishes_of(kind, build))
    with pytest.MonkeyPatch.context() as patch:
        if (kind, build) != WAYS[0]:
            patch.setattr("designer.builds.design.apart", step_in_place)
        return target, target.files()


@each_way
def test_every_format_of_every_build_shows_every_ring_or_is_refused(kind: str, build: str) -> None:
    """Read back by others: as many rings as the design has in the files of each format, however many files.

    Every mesh is closed.
    """
    target, files = made(kind, build)
    seen = dict[str, int]()
    most_mm = 4 * float(target.geometry.radius_outer_mm.max())
    rings = target.geometry.ring_count - int(target.geometry.is_dot.sum())
    for file in files:
        endings = [ending for ending in READERS if file.name.endswith(f".{ending}")]
        if endings and not file.name.endswith(PICTURED):
            ending = max(endings, key=len)
            count = READERS[ending][1](file.content, most_mm)
            if BUILDS[build].ink != "flush" and ending in PRINTED:
                alone = re.search(r"\.(body|pattern)\.", file.name) if BUILDS[build].ink == "raised" else None
                whole = 0 if alone else in_relief(ending, file.content, most_mm)
                assert count == (rings if alone and alone[1] == "pattern" else 0)  # of two files in turn
                count = whole
            seen[ending] = seen.get(ending, 0) + count
    if not BUILDS[build].is_two_filament:
        assert seen.pop("stl", 0) == 0  # a body without ink
    assert seen == dict.fromkeys(seen, rings)
    written = {"png", "simulator", "shop", *(READERS[ending][0] for ending in seen)}
    for name in FORMATS:
        if name not in written and not (name == "stl" and not BUILDS[build].is_two_filament):
            with pytest.raises(InputError, match=r"formats that go with it|3mf: left out"):
                raise_if_left_out(kind, {**wishes_of(kind, build), "formats": name}, name)


@each_way
def test_each_piece_lies_once_on_a_bed_clear_of_the_others(kind: str, build: str) -> None:
    """All names once over all plates; lowest at z = 0 within the bed; no piece's shadow comes near another's."""
    job, plates = made(kind, build)[0].design.job, made(kind, build)[0].design.plates
    names = [piece.name for plate in plates for piece in plate.pieces]
    assert len(names) == len(set(names)) >= BUILDS[build].has_body
    for plate in plates:
        lying = [piece.as_it_lies for piece in plate.pieces]
        corners = [np.concatenate([mesh.vertices_mm for mesh in (one.body, one.ink) if mesh]) for one in lying]
        for points in corners:
            assert points[:, 2].min() == pytest.approx(0.0, abs=1e-6)
            assert (points > -1e-6).all()
            assert (points < np.array(job.printing.printer.bed_mm)).all()
        shadows = [MultiPoint(points[:, :2]).convex_hull for points in corners]
        assert all(a.distance(b) > 1.0 for k, a in enumerate(shadows) for b in shadows[:k])


def test_step_is_that_of_the_design_although_another_process_makes_it() -> None:
    """The spec that it is handed is the design: the same bytes as made in place, where others were made before."""
    target, files = made("board", "one-piece")
    design, job = target.design, target.design.job
    (step,) = (file.content for file in files if file.name.endswith(".step"))
    assert step == cad.step_bytes(job.target, design.printed_pattern, job.printing, name=job.name, scale=design.scale)


AGAIN = """
import hashlib, sys
import designer.builds.design
from designer import load
from tests.support.designs import step_in_place
designer.builds.design.apart = step_in_place
for spec in sys.argv[1:]:
    for file in load(spec).files():
        print(file.name, hashlib.sha256(file.content).hexdigest())
"""


def test_a_written_spec_makes_every_file_again(tmp_path: Path) -> None:
    """NAME.toml, which stands beside the files of each build, gives all of them byte for byte in another process."""
    specs, told = [], list[str]()
    for kind, build in {build: (kind, build) for kind, build in WAYS}.values():
        target, files = made(kind, build)
        (toml,) = (file.content for file in files if file.name.endswith(".toml"))
        specs.append(tmp_path / f"{kind}-{build}.toml")
        specs[-1].write_bytes(toml)
        assert target.name in toml.decode()
        told += [f"{file.name} {hashlib.sha256(file.content).hexdigest()}" for file in files]
    assert run(PYTHON, "-c", AGAIN, *specs).stdout.splitlines() == told


def raise_if_left_out(kind: str, values: Mapping[str, object], name: Format) -> None:
    """Size a job of one format; one that is left out with a remark counts as refused."""
    sized = size_job(asked_for(kind, values))
    if name not in sized.job.formats:
        raise InputError(next(line for line in sized.remarks if line.startswith(f"{name}: left out")))
