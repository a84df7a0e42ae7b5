"""Models for simulators: what other readers make of them, and where the rings of the picture are."""

import io
import xml.etree.ElementTree as ET
from functools import cache

import numpy as np
import pytest
import trimesh
from PIL import Image

from designer.builds.design import EXPORTERS, Design
from designer.make.textured import TexturedMesh, textured
from tests.support.designs import design_of, small

KINDS = ("ico", "board", "cube", "solid")
each = pytest.mark.parametrize("kind", KINDS)


@cache
def mesh_of(kind: str) -> TexturedMesh:
    """The mesh of a small target, and its picture."""
    design = small(kind)
    printing = design.job.printing
    return textured(design.artwork, design.job.target, (printing.body_colour, printing.ink_colour))


@cache
def read_small(kind: str) -> tuple[dict[str, bytes], trimesh.Trimesh]:
    """The same of a small target; not to be changed."""
    return read_obj(small(kind))


def read_obj(design: Design) -> tuple[dict[str, bytes], trimesh.Trimesh]:
    """A design's files, and what a reader makes of the OBJ."""
    files = {suffix: content for suffix, content, _ in EXPORTERS["simulator"](design)}
    resolver = trimesh.resolvers.ZipResolver(
        {f"{design.job.name}.{name}": io.BytesIO(one) for name, one in files.items()}
    )
    read = trimesh.load_mesh(io.BytesIO(files["sim.obj"]), file_type="obj", resolver=resolver, process=False)
    return files, read


@each
def test_rings_of_the_picture_are_where_the_target_has_them(kind: str) -> None:
    """The centre of gravity of each feature, in linear light, is its centre within .02 mm, and its area is right."""
    design = small(kind)
    target, mesh = design.target, mesh_of(kind)
    encoded = np.asarray(Image.open(io.BytesIO(mesh.picture)).convert("L")) / 255
    ink = 1 - np.where(encoded <= 0.04045, encoded / 12.92, ((encoded + 0.055) / 1.055) ** 2.4)
    height, width = ink.shape
    sides = target.outline_mm.shape[1]
    pixel = mesh.place * (width, height) * (1, -1) + (-0.5, height - 0.5)
    for face in range(target.face_count):
        rows = slice(face * sides, face * sides + 3)
        here, there = np.c_[target.outline_mm[face][:3], np.ones(3)], pixel[rows]
        to_pixel = np.linalg.solve(here, there)  # (3, 2)
        scale = np.linalg.norm(to_pixel[0])
        for ring in np.flatnonzero(target.ring_face == face).tolist():
            middle = np.append(target.center_in_face_mm[ring, :2], 1) @ to_pixel
            reach = int(1.1 * target.radius_outer_mm[ring] * scale)
            left, top = np.round(middle).astype(int) - reach
            part = ink[top : top + 2 * reach + 1, left : left + 2 * reach + 1]
            v, u = np.mgrid[: part.shape[0], : part.shape[1]]
            is_own = np.hypot(u + left - middle[0], v + top - middle[1]) < 1.03 * target.radius_outer_mm[ring] * scale
            part = part * is_own
            centre = np.array([(part * u).sum(), (part * v).sum()]) / part.sum() + (left, top)
            assert np.linalg.norm(centre - middle) < 0.02 * scale
            area = np.pi * (target.radius_outer_mm[ring] ** 2 - target.radius_inner_mm[ring] ** 2)
            assert part.sum() / scale**2 == pytest.approx(area, rel=0.03)


@each
def test_the_mesh_is_the_target(kind: str) -> None:
    """Closed, in millimetres, as large as the target, with the picture that lies beside it, and not too large."""
    design = small(kind)
    files, read = read_small(kind)
    solid, expected = read.copy(), design.part
    solid.merge_vertices(merge_tex=True, merge_norm=True)
    assert solid.is_watertight
    inked = expected.ink.volume_mm3 if expected.ink else 0.0
    assert solid.volume == pytest.approx(expected.body.volume_mm3 + inked, rel=1e-3)
    assert read.visual.material.image.size == Image.open(io.BytesIO(files["sim.png"])).size
    assert len(files["sim.png"]) <= 1_000_000
    glb = trimesh.load_mesh(io.BytesIO(files["sim.glb"]), file_type="glb", process=False)
    np.testing.assert_allclose(1000 * glb.vertices, read.vertices, atol=1e-4)
    np.testing.assert_allclose(glb.visual.uv, read.visual.uv, atol=1e-6)


@each
def test_mass_and_inertia_are_those_of_the_print(kind: str) -> None:
    """As heavy as body and ink of the print; all files say the inertia that a reader computes of the mesh."""
    design = small(kind)
    files, read = read_small(kind)
    solid = read.copy()
    solid.merge_vertices(merge_tex=True, merge_norm=True)
    mass_kg = 1e-3 * (design.estimate.body_g + design.estimate.ink_g)
    expected = solid.moment_inertia / solid.volume * mass_kg * 1e-6
    urdf, sdf, mjcf = (ET.fromstring(files[name]) for name in ("urdf", "sdf", "mjcf.xml"))
    for values in (
        {key: float(value) for key, value in urdf.find(".//inertia").attrib.items()},  # type: ignore[union-attr]
        {one.tag: float(one.text or "") for one in sdf.find(".//inertia") or ()},
    ):
        told = [[values["i" + "".join(sorted(a + b))] for b in "xyz"] for a in "xyz"]
        np.testing.assert_allclose(told, expected, rtol=1e-5, atol=1e-12)
    inertial = mjcf.find(".//inertial")
    assert inertial is not None
    assert float(inertial.attrib["mass"]) == pytest.approx(mass_kg)
    full = [float(value) for value in inertial.attrib["fullinertia"].split()]
    np.testing.assert_allclose(full, expected[[0, 1, 2, 0, 0, 1], [0, 1, 2, 1, 2, 2]], rtol=1e-5, atol=1e-12)
    np.testing.assert_allclose(
        [float(value) for value in inertial.attrib["pos"].split()], 1e-3 * solid.center_mass, atol=1e-9
    )


def test_a_sheet_is_taken_for_plastic_all_through() -> None:
    """What is not printed in plastic weighs what its body would."""
    design = design_of("board", size="60x60mm", thickness="4mm", columns=5, rows=5, build="sheet")
    files, _ = read_obj(design)
    mass = ET.fromstring(files["urdf"]).find(".//mass")
    assert mass is not None
    assert float(mass.attrib["value"]) == pytest.approx(1.24e-6 * 60 * 60 * 4, rel=0.01)
