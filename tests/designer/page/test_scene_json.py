"""Scenes as text: the numbers survive, nothing of the text becomes markup, nonsense is refused."""

import base64
import json
import re
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from numpy.typing import NDArray

from designer.page.scene import Cameras, Drawn, Labels, Layer, Rings, Scene, Segments, Surface, scene_json

RNG = np.random.default_rng(7)
Z = np.tile([0.0, 0.0, 1.0], (3, 1))
CORNERS = np.array([[[-1.0, -1.0, 1.0], [1.0, -1.0, 1.0], [1.0, 1.0, 1.0], [-1.0, 1.0, 1.0]]])

SURFACE = Surface(RNG.normal(size=(4, 3)), np.array([[0, 1, 2], [0, 2, 3]]), "#ffffff")
RINGS = Rings(RNG.normal(size=(3, 3)), Z, np.full(3, 2.0), np.array([1.0, 0.9, 0.0]), ("#000000",), ("a", "b", "c"))
SEGMENTS = Segments(RNG.normal(size=(2, 2, 3)), ("#112233", "#445566"))
CAMERAS = Cameras(np.tile(np.eye(4), (2, 1, 1)), CORNERS, 10.0, ("#0072b2",), ("one", "two"))
LABELS = Labels(RNG.normal(size=(3, 3)), Z, ("1", "2", "3"), 4.0)
SHAPES: tuple[Drawn, ...] = (SURFACE, RINGS, SEGMENTS, CAMERAS, LABELS)
SCENE = Scene(
    (Layer("all", SHAPES), Layer("none", (), is_shown=False, has_switch=False)),
    up=(0.0, 0.0, 1.0),
    from_direction=(1.0, 2.0, 3.0),
    legend=(("#00ff00", "green"),),
)


def of_shape(shape: Drawn) -> Scene:
    """A scene of one shape."""
    return replace(SCENE, layers=(Layer("a <layer>", (shape,)),))


def unpacked(packed: dict[str, object]) -> NDArray[np.generic]:
    """The array that a reader gets, by the documented format."""
    types = {"f4": "<f4", "u2": "<u2", "u4": "<u4"}
    data, shape = packed["data"], packed["shape"]
    assert isinstance(data, str)
    assert isinstance(shape, list)
    array: NDArray[np.generic] = np.frombuffer(base64.b64decode(data), types[str(packed["type"])]).reshape(shape)
    return array


def test_numbers_survive() -> None:
    """Arrays come back in their shape, floats to single precision, whole numbers exactly."""
    shapes = json.loads(scene_json(SCENE))["layers"][0]["shapes"]
    surface, rings, segments, cameras, labels = shapes
    assert [shape["kind"] for shape in shapes] == ["surface", "rings", "segments", "cameras", "labels"]
    for packed, array in [
        (surface["vertices_mm"], SURFACE.vertices_mm),
        (surface["triangles"], SURFACE.triangles),
        (rings["center_mm"], RINGS.center_mm),
        (rings["normal"], RINGS.normal),
        (rings["radius_outer_mm"], RINGS.radius_outer_mm),
        (rings["radius_inner_mm"], RINGS.radius_inner_mm),
        (segments["ends_mm"], SEGMENTS.ends_mm),
        (cameras["target_from_cam"], CAMERAS.target_from_cam),
        (cameras["view"], CAMERAS.view),
        (labels["position_mm"], LABELS.position_mm),
    ]:
        np.testing.assert_array_equal(unpacked(packed), np.asarray(array).astype(np.float32))
    assert (rings["names"], cameras["names"], labels["texts"]) == (["a", "b", "c"], ["one", "two"], ["1", "2", "3"])
    assert (cameras["size_mm"], labels["size_mm"], surface["colour"]) == (10.0, 4.0, "#ffffff")


def test_scene_survives() -> None:
    """Direction, legend, and what is shown and has a switch reach the viewer."""
    read = json.loads(scene_json(SCENE))
    assert (read["up"], read["from"], read["legend"]) == ([0, 0, 1], [1, 2, 3], [["#00ff00", "green"]])
    assert [(layer["shown"], layer["switch"]) for layer in read["layers"]] == [(True, True), (False, False)]


def test_each_thing_keeps_its_colour() -> None:
    """A thing's colour is its own, or the one for all."""
    colours = ("#0000ff", "#ff0000", "#0000ff")
    for given_colours, expected in [(colours, [0, 1, 0]), (("#0000ff",), [0, 0, 0])]:
        packed = json.loads(scene_json(of_shape(replace(RINGS, colours=given_colours))))["layers"][0]["shapes"][0]
        assert packed["colours"]["palette"] == ["#0000ff", "#ff0000"][: len(set(expected))]
        assert unpacked(packed["colours"]["index"]).tolist() == expected


def test_many_vertices_keep_their_numbers() -> None:
    """A triangle may name vertices beyond the 16 bits that most surfaces need."""
    surface = Surface(np.zeros((70_000, 3)), np.array([[0, 1, 69_999]]), "#ffffff")
    packed = json.loads(scene_json(of_shape(surface)))["layers"][0]["shapes"][0]["triangles"]
    assert unpacked(packed).tolist() == [[0, 1, 69_999]]


def test_byte_order_and_layout_do_not_matter() -> None:
    """The same numbers give the same text, in whatever way an array holds them."""
    others = [SURFACE.vertices_mm.astype(">f8"), np.asfortranarray(SURFACE.vertices_mm)]
    expected = scene_json(of_shape(SURFACE))
    assert [scene_json(of_shape(replace(SURFACE, vertices_mm=other))) for other in others] == [expected] * 2


@given(st.text(st.characters(codec=None), max_size=40))
def test_text_stays_text(text: str) -> None:
    """Any name comes back as it was, and holds no character that could end or begin an element or a line."""
    scene = replace(
        of_shape(replace(CAMERAS, names=(text, text + "</script><!--"))),
        legend=(("#000000", text + "&lt;\u2028\u2029"),),
    )
    written = scene_json(scene)
    assert re.fullmatch(r"[ -%'-;=?-~]*", written)  # ASCII without control characters, "&", "<" and ">"
    read = json.loads(written)
    assert read["layers"][0]["shapes"][0]["names"] == [text, text + "</script><!--"]
    assert read["legend"][0][1] == text + "&lt;\u2028\u2029"


@pytest.mark.parametrize(
    ("shape", "message"),
    [
        (replace(RINGS, center_mm=np.full((3, 3), np.nan)), "not finite"),
        (replace(RINGS, center_mm=np.full((3, 3), 1e39)), "too large to draw"),
        (replace(RINGS, colours=("#000000", "#111111")), "2 colours for 3"),
        (replace(LABELS, size_mm=np.inf), "not JSON compliant"),
    ],
)
def test_what_cannot_be_drawn_is_refused(shape: Drawn, message: str) -> None:
    """A number that no viewer can place, or a colour that belongs to nothing, never reaches a page."""
    with pytest.raises(ValueError, match=message):
        scene_json(of_shape(shape))


def test_empty_shapes_are_fine() -> None:
    """A layer may have nothing to show: no outliers, no cameras."""
    none = np.zeros((0, 3))
    empty: tuple[Drawn, ...] = (
        Rings(none, none, np.zeros(0), np.zeros(0), ()),
        Segments(np.zeros((0, 2, 3)), ("#000000",)),
        Cameras(np.zeros((0, 4, 4)), CORNERS, 1.0, ("#000000",), ()),
        Labels(none, none, (), 1.0),
    )
    shapes = json.loads(scene_json(replace(SCENE, layers=(Layer("empty", empty),))))["layers"][0]["shapes"]
    assert unpacked(shapes[0]["center_mm"]).shape == (0, 3)
