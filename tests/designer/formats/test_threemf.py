"""3MF packages, read by lib3mf, and the settings that slicers read beside the model."""

import zipfile
from dataclasses import replace
from io import BytesIO
from xml.etree import ElementTree

import lib3mf
import numpy as np
import pytest

from designer.base.errors import InputError
from designer.builds.design import Design
from designer.formats.project import PlateFiles, plate_files
from designer.formats.threemf import decimals, text_lines, whole_numbers
from designer.make.bed import Piece, Plate, bed_from_target
from designer.make.mesh import Mesh
from designer.spec.kind import KINDS
from tests.support.designs import ink_of, packages_of, small, small_board

HOSTILE_NAME = """a<b>&"'c]]>é"""


@pytest.fixture(params=KINDS, scope="module")
def design(request: pytest.FixtureRequest) -> Design:
    return small(request.param)


@pytest.fixture(scope="module")
def files(design: Design) -> PlateFiles:
    return packages_of(design)


def read_strictly(package: bytes) -> lib3mf.Model:
    """The model as lib3mf reads it in strict mode, without a warning."""
    model = lib3mf.get_wrapper().CreateModel()
    reader = model.QueryReader("3mf")
    reader.SetStrictModeActive(True)
    reader.ReadFromBuffer(package)
    assert [reader.GetWarning(k) for k in range(reader.GetWarningCount())] == []
    return model


def meshes(model: lib3mf.Model) -> list[Mesh]:
    """All mesh objects, in their order in the file."""
    found, objects = [], model.GetMeshObjects()
    while objects.MoveNext():
        mesh = objects.GetCurrentMeshObject()
        vertices = np.array([list(vertex.Coordinates) for vertex in mesh.GetVertices()])
        triangles = np.array([list(triangle.Indices) for triangle in mesh.GetTriangleIndices()], dtype=np.int32)
        assert mesh.IsManifoldAndOriented()
        found.append(Mesh(vertices, triangles))
    return found


def build_transform(model: lib3mf.Model) -> np.ndarray:
    """Where the only build item puts its object.  # (4, 4)"""
    items = model.GetBuildItems()
    assert items.Count() == 1
    items.MoveNext()
    fields = np.array([list(row) for row in items.GetCurrent().GetObjectTransform().Fields])  # (4, 3): row vectors
    motion = np.eye(4)
    motion[:3] = fields.T
    return motion


def config(package: bytes, path: str) -> ElementTree.Element:
    with zipfile.ZipFile(BytesIO(package)) as archive:
        return ElementTree.fromstring(archive.read(path))


def settings(element: ElementTree.Element) -> dict[str | None, str | None]:
    """The metadata right under an element."""
    return {entry.get("key"): entry.get("value") for entry in element.findall("metadata")}


def test_prusa_ranges_cut_the_mesh_into_body_and_ink(design: Design, files: PlateFiles) -> None:
    """The triangle ranges are the body in filament 1 and the ink in filament 2, and leave out no triangle."""
    (mesh,) = meshes(read_strictly(files.prusa))
    (thing,) = config(files.prusa, "Metadata/Slic3r_PE_model.config")
    volumes = thing.findall("volume")
    assert [settings(volume)["extruder"] for volume in volumes] == ["1", "2"]
    after = 0
    for volume, part in zip(volumes, (design.part.body, ink_of(design)), strict=True):
        first, last = int(volume.attrib["firstid"]), int(volume.attrib["lastid"])
        assert first == after
        shell = Mesh(mesh.vertices_mm, mesh.triangles[first : last + 1])
        assert shell.volume_mm3 == pytest.approx(part.volume_mm3, rel=1e-5)
        after = last + 1
    assert after == len(mesh.triangles)


def test_prusa_package_keeps_the_prefix_prusaslicer_looks_for(files: PlateFiles) -> None:
    """The model's metadata slic3rpe:Version3mf is 1, with that prefix, and the config names the built object."""
    with zipfile.ZipFile(BytesIO(files.prusa)) as archive:
        model = archive.read("3D/3dmodel.model").decode()
    assert '<metadata name="slic3rpe:Version3mf">1</metadata>' in model
    (thing,) = config(files.prusa, "Metadata/Slic3r_PE_model.config")
    assert f'<item objectid="{thing.get("id")}" ' in model


def test_bambu_package_is_a_components_object(design: Design, files: PlateFiles) -> None:
    """lib3mf finds the two closed meshes, and one object to build that holds both, body first."""
    model = read_strictly(files.bambu)
    for mesh, part in zip(meshes(model), (design.part.body, ink_of(design)), strict=True):
        assert len(mesh.triangles) == len(part.triangles)
        assert mesh.volume_mm3 == pytest.approx(part.volume_mm3, rel=1e-5)
    objects = model.GetComponentsObjects()
    assert objects.Count() == 1
    objects.MoveNext()
    whole = objects.GetCurrentComponentsObject()
    names = [whole.GetComponent(k).GetObjectResource().GetName() for k in range(whole.GetComponentCount())]
    assert names == ["body", "ink"]
    assert whole.GetName() == design.job.name


def test_bambu_settings_name_filaments_by_mesh(files: PlateFiles) -> None:
    """model_settings.config gives the body filament 1 and the ink filament 2, by the model's ids."""
    package = files.bambu
    with zipfile.ZipFile(BytesIO(package)) as archive:
        model = archive.read("3D/3dmodel.model").decode()
    (thing,) = config(package, "Metadata/model_settings.config").findall("object")
    assert f'<item objectid="{thing.get("id")}" ' in model
    parts = thing.findall("part")
    assert [settings(part)["extruder"] for part in parts] == ["1", "2"]
    assert {part.get("subtype") for part in parts} == {"normal_part"}
    for part, name in zip(parts, ("body", "ink"), strict=True):
        assert f'<object id="{part.get("id")}" type="model" name="{name}"' in model


def test_cura_reads_the_extruder_of_each_mesh(files: PlateFiles) -> None:
    """Each mesh object carries Cura's extruder number, counted from 0."""
    model = read_strictly(files.bambu)
    objects, numbers = model.GetMeshObjects(), []
    while objects.MoveNext():
        group = objects.GetCurrentMeshObject().GetMetaDataGroup()
        entry = group.GetMetaDataByKey("http://software.ultimaker.com/xml/cura/3mf/2015/10", "extruder_nr")
        numbers.append(entry.GetValue())
    assert numbers == ["0", "1"]


@pytest.mark.parametrize("slicer", ["prusa", "bambu"])
def test_build_item_lays_the_part_on_the_bed(design: Design, files: PlateFiles, slicer: str) -> None:
    """The build item's transform is `bed_from_target`."""
    motion = build_transform(read_strictly(getattr(files, slicer)))
    assert motion == pytest.approx(bed_from_target(design.target, design.job.printing), abs=1e-4)


@pytest.mark.parametrize("slicer", ["prusa", "bambu"])
def test_colours_have_a_group_each(design: Design, slicer: str) -> None:
    """Body and ink colour are in the file, each in a colour group of its own."""
    printing = replace(design.job.printing, body_colour="#fedcba", ink_colour="#102030")
    files = plate_files(Plate("", (Piece("x", design.part, np.eye(4)),)), printing)
    groups, colours = read_strictly(getattr(files, slicer)).GetColorGroups(), []
    while groups.MoveNext():
        group = groups.GetCurrentColorGroup()
        colours.append([group.GetColor(number) for number in group.GetAllPropertyIDs()])
    assert [[(c.Red, c.Green, c.Blue, c.Alpha) for c in group] for group in colours] == [
        [(0xFE, 0xDC, 0xBA, 0xFF)],
        [(0x10, 0x20, 0x30, 0xFF)],
    ]


def test_numbers_are_written_as_python_formats_them() -> None:
    """Lines of characters are those of a format call for each: signs, zeros, and as many digits as each has."""
    rng = np.random.default_rng(0)
    value = np.concatenate([rng.normal(size=200) * 10.0 ** rng.integers(-7, 6, 200), [0.0, -0.0, -1e-9, 0.5, 9.999999]])
    number = rng.integers(0, 10 ** rng.integers(1, 9, len(value)))
    lines = text_lines(b'x="', decimals(value, 5), b'" n="', whole_numbers(number), b'"\n')
    assert lines == "".join(f'x="{x:.5f}" n="{n}"\n' for x, n in zip(value, number, strict=True)).encode()
    assert text_lines(b"<", whole_numbers(np.array([0])), b">") == b"<0>"


@pytest.mark.parametrize("slicer", ["prusa", "bambu"])
def test_every_file_in_the_package_has_a_content_type(files: PlateFiles, slicer: str) -> None:
    """The Open Packaging Conventions ask for a content type for each extension; strict readers refuse others.

    Nothing of the time of writing gets into the package.
    """
    package = getattr(files, slicer)
    types = config(package, "[Content_Types].xml")
    with zipfile.ZipFile(BytesIO(package)) as archive:
        extensions = {path.rsplit(".", 1)[1] for path in archive.namelist() if path != "[Content_Types].xml"}
        assert {entry.date_time for entry in archive.infolist()} == {(1980, 1, 1, 0, 0, 0)}
        if slicer == "prusa":
            assert b"Application" not in archive.read("3D/3dmodel.model")
    assert {entry.get("Extension") for entry in types} == extensions


def named(name: str) -> PlateFiles:
    design = small_board()
    return plate_files(Plate("", (Piece(name, design.part, np.eye(4)),)), design.job.printing)


def test_hostile_name_stays_text() -> None:
    """A name with XML's own characters is read back as it was given, in models and settings."""
    files = named(HOSTILE_NAME)
    objects = read_strictly(files.prusa).GetMeshObjects()
    objects.MoveNext()
    assert objects.GetCurrentMeshObject().GetName() == HOSTILE_NAME
    for package, path in ((files.prusa, "Slic3r_PE_model.config"), (files.bambu, "model_settings.config")):
        (thing,) = config(package, f"Metadata/{path}").findall("object")
        assert settings(thing)["name"] == HOSTILE_NAME


@pytest.mark.parametrize("name", ["a\0b", "a\nb", "\ud800"])
def test_name_that_xml_cannot_hold_is_refused(name: str) -> None:
    """Control characters and lone surrogates are bad input."""
    with pytest.raises(InputError, match="control character"):
        named(name)
