"""GLB files: what the reference readers make of them."""

import io
from dataclasses import replace

import numpy as np
import pygltflib
import pytest
import trimesh

from designer.formats.glb import glb_bytes
from designer.make.mesh import Part
from tests.support.designs import small

PRINTING = replace(small("ico").job.printing, ink_colour="#d0a010")


@pytest.fixture(scope="module")
def part() -> Part:
    return small("ico").part


@pytest.fixture(scope="module")
def glb(part: Part) -> bytes:
    return glb_bytes(part, PRINTING)


def read(glb: bytes) -> trimesh.Scene:
    return trimesh.load_scene(io.BytesIO(glb), file_type="glb", process=False)


def test_scene_is_in_metres_and_in_the_target_frame(part: Part, glb: bytes) -> None:
    """A reader that applies the nodes gets the target frame's coordinates in metres, with volumes to match."""
    scene = read(glb)
    for name, mesh in (("body", part.body), ("ink", part.ink)):
        matrix, geometry = scene.graph[name]
        solid = scene.geometry[geometry].copy().apply_transform(matrix)
        assert mesh is not None
        np.testing.assert_allclose(solid.vertices, 0.001 * mesh.vertices_mm, atol=1e-8)
        assert solid.is_watertight
        assert solid.volume == pytest.approx(1e-9 * mesh.volume_mm3, rel=1e-5)
    vertices = part.ink.vertices_mm if part.ink else None
    np.testing.assert_allclose(scene.bounds, 0.001 * np.array([np.min(vertices, 0), np.max(vertices, 0)]), atol=1e-8)


def test_colours_are_the_filaments_in_linear_light(glb: bytes) -> None:
    """The glTF base colour is linear: encoded back to sRGB it is the colour asked for, and the surface is matt."""
    found = {}
    for material in pygltflib.GLTF2.load_from_bytes(glb).materials:
        surface = material.pbrMetallicRoughness
        assert surface.metallicFactor == 0
        assert surface.roughnessFactor > 0.5
        linear = np.array(surface.baseColorFactor[:3])
        encoded = np.where(linear <= 0.0031308, 12.92 * linear, 1.055 * linear ** (1 / 2.4) - 0.055)
        found[material.name] = "#" + bytes(np.round(255 * encoded).astype(np.uint8)).hex()
    assert found == {"body": PRINTING.body_colour, "ink": PRINTING.ink_colour}


def test_faces_are_flat(glb: bytes) -> None:
    """No mesh has normals, so that viewers must draw flat faces although triangles share vertices."""
    for mesh in pygltflib.GLTF2.load_from_bytes(glb).meshes:
        assert [primitive.attributes.NORMAL for primitive in mesh.primitives] == [None]


def test_accessors_declare_their_bounds_and_stay_in_the_buffer(glb: bytes) -> None:
    """Positions have exact bounds (glTF 2.0, 3.6.2.5), and each view lies at a multiple of four in the buffer."""
    document = pygltflib.GLTF2.load_from_bytes(glb)
    blob = document.binary_blob()
    assert len(blob) == document.buffers[0].byteLength
    ends = [0]
    for view in document.bufferViews:
        assert view.byteOffset == ends[-1]
        assert view.byteOffset % 4 == 0
        ends.append(view.byteOffset + view.byteLength)
    assert ends[-1] == len(blob)
    for accessor in document.accessors:
        if accessor.type == "VEC3":
            view = document.bufferViews[accessor.bufferView]
            points = np.frombuffer(blob[view.byteOffset :], "<f4", 3 * accessor.count).reshape(-1, 3)
            np.testing.assert_array_equal(points.min(axis=0), np.float32(accessor.min))
            np.testing.assert_array_equal(points.max(axis=0), np.float32(accessor.max))
