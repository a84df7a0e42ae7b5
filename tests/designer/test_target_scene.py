"""Targets and cameras as layers: what is drawn lies where the target has it, with the target's areas."""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from designer.base.arrays import Array
from designer.kinds.board import BoardSpec
from designer.kinds.ico import IcoSpec
from designer.kinds.layout import lay_out
from designer.page.scene import Cameras, Labels, Layer, Rings, Scene, Segments, Surface, scene_json
from designer.target import TargetGeometry, bounding_radius_mm
from designer.target_scene import (
    THICKNESS_MM,
    camera_layer,
    camera_size_mm,
    polygon_area_mm2,
    polygon_triangles,
    target_layers,
    target_scene,
)
from tests.support.perturbed_targets import made_by_others
from tests.support.programs import modules_loaded_by

BODY, INK = "#eeeeee", "#111111"
ICO = lay_out(IcoSpec(60.0, 5, 7.0, 0.45, 10.0, 1.0, 0.5))
BOARD_SPEC = BoardSpec((90.0, 60.0), 5.0, 7, 5, "square", 7.0, 0.45, 10.0, 0.0, 4.0, dots=True)
BOARD = lay_out(BOARD_SPEC)
BORDERED = lay_out(replace(BOARD_SPEC, border_mm=1.5))
TARGETS = {"ico": ICO, "board": BOARD, "bordered board": BORDERED, "by others": made_by_others()}
CORNERS = np.array([[[-0.5, -0.4, 1.0], [0.5, -0.4, 1.0], [0.5, 0.4, 1.0], [-0.5, 0.4, 1.0]]])

every_target = pytest.mark.parametrize("name", TARGETS)


def layers_of(target: TargetGeometry) -> tuple[Layer, ...]:
    """The layers in two colours."""
    return target_layers(target, body_colour=BODY, ink_colour=INK)


def surfaces_of(target: TargetGeometry) -> dict[str, Surface]:
    """The surfaces by their colour."""
    return {shape.colour: shape for shape in layers_of(target)[0].shapes if isinstance(shape, Surface)}


def rings_of(target: TargetGeometry) -> Rings:
    """The rings of the first layer, which must be alone."""
    (rings,) = (shape for shape in layers_of(target)[0].shapes if isinstance(shape, Rings))
    return rings


def area_vectors_mm2(surface: Surface) -> Array:
    """Of each triangle: its normal, as long as its area.  # (T, 3)"""
    a, b, c = (surface.vertices_mm[surface.triangles[:, k]] for k in range(3))
    vectors: Array = np.cross(b - a, c - a) / 2
    return vectors


def area_mm2(surface: Surface) -> float:
    return float(np.linalg.norm(area_vectors_mm2(surface), axis=1).sum())


def polygon_areas_mm2(polygons: Array) -> float:
    return sum(polygon_area_mm2(polygon) for polygon in polygons)


@every_target
def test_rings_lie_on_their_faces(name: str) -> None:
    """A ring is drawn in its face's plane at the target's place, turned outwards, with the target's radii."""
    target = TARGETS[name]
    rings, frame = rings_of(target), target.target_from_face[target.ring_face]
    height = np.einsum("ri,ri->r", rings.center_mm - frame[:, :3, 3], frame[:, :3, 2])
    np.testing.assert_allclose(height, 0, atol=1e-9)
    off = rings.center_mm - target.center_mm
    np.testing.assert_allclose(np.linalg.norm(off, axis=1), np.abs(target.center_in_face_mm[:, 2]), atol=1e-9)
    np.testing.assert_allclose(np.linalg.norm(rings.normal, axis=1), 1, atol=1e-12)
    np.testing.assert_array_equal(rings.normal, frame[:, :3, 2])
    np.testing.assert_array_equal(rings.radius_outer_mm, target.radius_outer_mm)
    np.testing.assert_array_equal(rings.radius_inner_mm, target.radius_inner_mm)


def total_area_mm2(name: str) -> float:
    """Of all that is seen from outside: faces, and of a board its back and sides."""
    outlines = polygon_areas_mm2(TARGETS[name].outline_mm)
    return outlines if "board" not in name else 2 * outlines + 2 * sum(BOARD_SPEC.size_mm) * BOARD_SPEC.thickness_mm


@every_target
def test_windows_are_of_the_body_and_borders_of_ink(name: str) -> None:
    """With the polygons' exact areas."""
    target, surfaces = TARGETS[name], surfaces_of(TARGETS[name])
    border = polygon_areas_mm2(target.outline_mm) - polygon_areas_mm2(target.window_mm)
    assert (area_mm2(surfaces[INK]) if INK in surfaces else 0) == pytest.approx(border, abs=1e-9)
    assert area_mm2(surfaces[BODY]) == pytest.approx(total_area_mm2(name) - border)


@pytest.mark.parametrize(
    ("name", "volume_mm3"),
    [("ico", 5 * (3 + np.sqrt(5)) / 12 * 60.0**3), ("board", 27_000.0), ("bordered board", 27_000.0)],
)
def test_a_target_is_drawn_closed(name: str, volume_mm3: float) -> None:
    """Its surfaces look outwards and enclose the solid's volume, a board below its printed side."""
    surfaces = surfaces_of(TARGETS[name]).values()
    np.testing.assert_allclose(sum(area_vectors_mm2(one).sum(axis=0) for one in surfaces), 0, atol=1e-6)
    cones = [np.einsum("ti,ti->", area_vectors_mm2(one), one.vertices_mm[one.triangles[:, 0]]) / 3 for one in surfaces]
    assert sum(cones) == pytest.approx(volume_mm3)
    assert name == "ico" or {one.vertices_mm[:, 2].max() for one in surfaces} == {0.0}


def test_board_of_unknown_thickness() -> None:
    """A board made by others has a thickness too."""
    surface = surfaces_of(replace(BOARD, spec=None))[BODY]
    assert surface.vertices_mm[:, 2].min() == -THICKNESS_MM


def test_colours_of_rings() -> None:
    """Rings and dots are in ink, or each in the colour given for it."""
    assert rings_of(BOARD).colours == (INK,)
    colours = tuple(f"#{n:06x}" for n in range(BOARD.ring_count))
    shapes = target_layers(BOARD, body_colour=BODY, ink_colour=INK, ring_colours=colours)[0].shapes
    assert [shape.colours for shape in shapes if isinstance(shape, Rings)] == [colours]


def test_names_of_rings() -> None:
    """A ring is named by face, kind and indices, as tables name it."""
    names = rings_of(ICO).names
    row = int(np.flatnonzero(ICO.is_dot & (ICO.ring_face == 3))[0])
    i, j = ICO.ring_index[row]
    assert names[row] == f"face 3, dot ({i}, {j})"
    assert len(set(names)) == ICO.ring_count
    assert rings_of(BOARD).names[0].startswith("ring (")


def test_face_numbers() -> None:
    """Each face's number stands on the face, turned outwards; a board needs none. They are hidden at first."""
    layer = {layer.name: layer for layer in layers_of(ICO)}["face numbers"]
    (labels,) = layer.shapes
    assert isinstance(labels, Labels)
    assert not layer.is_shown
    assert labels.texts == tuple(str(face) for face in range(20))
    np.testing.assert_allclose(labels.position_mm, ICO.target_from_face[:, :3, 3], atol=1e-9)
    np.testing.assert_allclose(labels.normal, ICO.target_from_face[:, :3, 2], atol=1e-12)
    assert "face numbers" not in {layer.name for layer in layers_of(BOARD)}


@every_target
def test_axes(name: str) -> None:
    """Three axes from the target's origin, hidden at first; each letter is seen from every side."""
    target = TARGETS[name]
    layer = layers_of(target)[-1]
    segments, labels = layer.shapes
    assert isinstance(segments, Segments)
    assert isinstance(labels, Labels)
    assert not layer.is_shown
    length = segments.ends_mm[0, 1, 0]
    np.testing.assert_allclose(segments.ends_mm[:, 0], 0)
    np.testing.assert_allclose(segments.ends_mm[:, 1], length * np.eye(3))
    assert (length > bounding_radius_mm(target)) == (target.face_count > 1)
    for letter, axis in zip("XYZ", np.eye(3), strict=True):
        own = [n for n, text in enumerate(labels.texts) if text == letter]
        assert (labels.position_mm[own] @ axis > length).all()
        np.testing.assert_allclose(labels.normal[own].sum(axis=0), 0)


@every_target
def test_scene_can_be_written(name: str) -> None:
    """Every target makes a scene that the page takes, seen from a side where rings are."""
    scene = target_scene(TARGETS[name], body_colour=BODY, ink_colour=INK, legend=((INK, "ink"),))
    assert isinstance(scene, Scene)
    assert scene_json(scene) == scene_json(scene)
    assert np.linalg.norm(np.cross(scene.up, scene.from_direction)) > 0.5
    if TARGETS[name].face_count == 1:
        assert TARGETS[name].target_from_face[0, :3, 2] @ scene.from_direction > 0.5


def test_cameras_stand_where_photos_were_taken() -> None:
    """The apex is the point that the pose takes to the camera's origin; its axes are the camera's."""
    rng = np.random.default_rng(3)
    turn, _ = np.linalg.qr(rng.normal(size=(4, 3, 3)))
    poses = np.tile(np.eye(4), (4, 1, 1))
    poses[:, :3, :3] = turn * np.sign(np.linalg.det(turn))[:, None, None]
    poses[:, :3, 3] = rng.normal(size=(4, 3)) + np.array([0.0, 0.0, 500.0])
    layer = camera_layer(poses, CORNERS, ("a", "b", "c", "d"), ("#0072b2",), 20.0)
    (cameras,) = layer.shapes
    assert isinstance(cameras, Cameras)
    np.testing.assert_allclose(poses @ cameras.target_from_cam, np.tile(np.eye(4), (4, 1, 1)), atol=1e-12)
    assert (cameras.names, cameras.size_mm) == (("a", "b", "c", "d"), 20.0)
    assert 10 < camera_size_mm(poses) < 100
    assert camera_size_mm(poses[:0]) > 0


@settings(max_examples=60, deadline=None)
@given(st.integers(3, 14), st.integers(0, 2**32 - 1))
def test_polygons_are_filled(corners: int, seed: int) -> None:
    """The triangles of a star-shaped polygon, convex or not, all turn left and add up to its area."""
    rng = np.random.default_rng(seed)
    angle = 2 * np.pi * (np.arange(corners) + 0.8 * rng.random(corners)) / corners
    polygon = np.stack([np.cos(angle), np.sin(angle)], axis=1) * rng.uniform(0.2, 1, corners)[:, None]
    if corners == 3 and polygon_area_mm2(polygon) <= 0:
        polygon = polygon[::-1]
    triangles = polygon_triangles(polygon)
    areas = [polygon_area_mm2(polygon[rows]) for rows in triangles]
    assert len(triangles) == corners - 2
    assert min(areas) > -1e-12
    assert sum(areas) == pytest.approx(polygon_area_mm2(polygon))


def test_imports_are_light() -> None:
    """Reports of calibrations draw targets: neither meshes nor CAD may come along."""
    heavy = {"manifold3d", "build123d", "scipy", "cv2", "numba", "matplotlib", "pydantic", "designer.make.mesh"}
    assert not heavy & modules_loaded_by("import designer.target_scene, designer.page.scene")
