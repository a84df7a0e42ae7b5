"""The preview, pixel by pixel where the geometry says what must be seen."""

import io
import math
from dataclasses import replace

import numpy as np
import pytest
from PIL import Image

from designer.builds.design import Design
from designer.formats.png import CAPTION_PX, HEIGHT_PX, NET_WIDTH_PX, preview_png
from designer.target import TargetGeometry
from tests.support.designs import design_of

BODY, INK = "#ff4020", "#2040ff"  # told apart by their hue under any light


ICO = design_of(kind="ico", edge="60mm", border="2mm", chord_error="50um")
BOARD = design_of(kind="board", size="90x70mm", ring_diameter="7mm", pitch="10mm", thickness="8mm", chord_error="50um")
CUBE = design_of(kind="cube", edge="60mm", border="2mm", chord_error="50um")
DESIGNS = {"ico": ICO, "board": BOARD, "cube": CUBE}


def preview(design: Design, body: str = BODY, ink: str = INK, caption: str = "a caption") -> bytes:
    printing = replace(design.job.printing, body_colour=body, ink_colour=ink)
    return preview_png(design.artwork, design.job.target, printing, caption)


def pixels(png: bytes) -> np.ndarray:
    return np.asarray(Image.open(io.BytesIO(png)).convert("RGB")).astype(int)


def projected(design: Design, points: np.ndarray) -> np.ndarray:
    """Where a pinhole camera five radii away sees points, in picture pixels with v down."""
    x, y, z = camera_axes(design)
    corners = corners_of(design)
    distance = 5 * np.linalg.norm(corners, axis=1).max()

    def onto_image(p: np.ndarray) -> np.ndarray:
        return np.stack([p @ x, -(p @ y)], axis=1) * (distance / (distance - p @ z))[:, None]

    scale = 0.46 * HEIGHT_PX / np.abs(onto_image(corners)).max()
    return HEIGHT_PX / 2 + scale * onto_image(points)


def camera_axes(design: Design) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Right, up and towards the camera: a board is seen from its lower left, a solid from its right front."""
    direction, up = ([-0.35, -0.45, 1.0], [0, 1, 0]) if design is BOARD else ([0.9, -0.35, 0.45], [0, 0, 1])
    z = np.array(direction) / np.linalg.norm(direction)
    x = np.cross(up, z) / np.linalg.norm(np.cross(up, z))
    return x, np.cross(z, x), z


def corners_of(design: Design) -> np.ndarray:
    """The corners of all faces in the target frame.  # (N, 3)"""
    frame = design.target.target_from_face
    corners = np.einsum("fij,fkj->fki", frame[:, :3, :2], design.target.outline_mm) + frame[:, None, :3, 3]
    return corners.reshape(-1, 3)


def colour_at(image: np.ndarray, place: np.ndarray) -> str:
    """The hue at a pixel: body, ink or neither."""
    red, _, blue = image[math.floor(place[1]), math.floor(place[0])]
    return "body" if red > 1.5 * blue else "ink" if blue > 1.5 * red else "neither"


def samples(target: TargetGeometry, row: int) -> tuple[np.ndarray, list[str]]:
    """Places on a feature, in its face's frame, and what must be seen there: centre, stroke and white beside it."""
    outer, inner = target.radius_outer_mm[row], target.radius_inner_mm[row]
    steps = np.array([0.0, (outer + inner) / 2, outer + 0.25])
    places = target.center_in_face_mm[row, :2] + np.stack([np.zeros(3), -steps], axis=1)
    return places, ["ink" if target.is_dot[row] else "body", "ink", "body"]


@pytest.mark.parametrize("name", DESIGNS)
def test_rings_and_dots_are_seen_where_they_are(name: str) -> None:
    """A ring's centre is white, its stroke ink, the white beside it white; a dot's centre is ink; so is the border."""
    design = DESIGNS[name]
    image, target = pixels(preview(design)), design.target
    frames = target.target_from_face
    steep = np.flatnonzero(frames[:, :3, 2] @ camera_axes(design)[2] > 0.4)
    assert len(steep) >= (5 if design is ICO else 1)

    def colours(face: int, places: np.ndarray) -> list[str]:
        in_space = places @ frames[face, :3, :2].T + frames[face, :3, 3]
        return [colour_at(image, place) for place in projected(design, in_space)]

    for row in np.flatnonzero(np.isin(target.ring_face, steep)):
        places, expected = samples(target, row)
        assert colours(target.ring_face[row], places) == expected, row
    for face in [] if design is BOARD else steep:
        in_border = (target.outline_mm[face, 1:3] + target.window_mm[face, 1:3]).sum(axis=0, keepdims=True) / 4
        assert colours(face, in_border) == ["ink"]


@pytest.mark.parametrize("design", [ICO, CUBE], ids=["ico", "cube"])
def test_net_shows_every_code(design: Design) -> None:
    """Beside the view, all faces are unfolded without being mirrored: every ring and dot is in its place.

    A face's number is printed over its middle; features there are left out.
    """
    image, target, solid = pixels(preview(design)), design.target, design.job.target.solid
    assert solid is not None
    net, (width, height) = solid.polyhedron.unfolded()
    edge_px = 0.96 * min((image.shape[1] - HEIGHT_PX) / width, HEIGHT_PX / height)
    for row in range(target.ring_count):
        if np.linalg.norm(target.center_in_face_mm[row]) < 0.2 * 60:
            continue
        places, expected = samples(target, row)
        motion = net[target.ring_face[row]]
        x, y = edge_px * (places / 60 @ motion[:2, :2].T + motion[:2, 2] - np.array([width, height]) / 2).T
        middle = ((image.shape[1] + HEIGHT_PX) / 2, HEIGHT_PX / 2)
        seen = [colour_at(image, place) for place in np.stack([middle[0] + x, middle[1] - y], axis=1)]
        assert seen == expected, row


def test_size_and_background() -> None:
    """A board is one view, a solid has its net beside it, above a line of caption; corners show the background."""
    for design, width in ((ICO, HEIGHT_PX + NET_WIDTH_PX), (BOARD, HEIGHT_PX)):
        image = pixels(preview(design))
        assert image.shape == (HEIGHT_PX + CAPTION_PX, width, 3)
        corners = image[[0, 0, HEIGHT_PX - 1], [0, -1, 0]]
        assert (corners == corners[0]).all()
        target_pixels = (np.abs(image[:HEIGHT_PX, :HEIGHT_PX] - corners[0]).sum(axis=2) > 30).nonzero()
        assert max(np.ptp(axis) for axis in target_pixels) > 0.85 * HEIGHT_PX
        assert min(axis.min() for axis in target_pixels) > 0.02 * HEIGHT_PX


def test_caption_is_written() -> None:
    """The caption stands below the picture and changes nothing in it."""
    one, other = pixels(preview(BOARD)), pixels(preview(BOARD, caption="another"))
    assert (one[:HEIGHT_PX] == other[:HEIGHT_PX]).all()
    assert (one[HEIGHT_PX:] != other[HEIGHT_PX:]).any()


def test_board_shows_its_thickness() -> None:
    """Seen from the lower left, the plate's front side shows in the body's colour below its lower edge."""
    image = pixels(preview(BOARD))
    (side,) = projected(BOARD, np.array([[0.0, -35.0, -4.0]]))
    (below,) = projected(BOARD, np.array([[0.0, -35.0, -12.0]]))
    assert colour_at(image, side) == "body"
    assert colour_at(image, below) == "neither"


def test_black_faces_stay_apart() -> None:
    """Black ink under light is not black everywhere, so that the edges between dark borders can be seen."""
    image = pixels(preview(ICO, "#ffffff", "#000000"))
    darks = {tuple(pixel) for pixel in image[:HEIGHT_PX].reshape(-1, 3)[::7].tolist() if max(pixel) < 25}
    assert len(darks) > 3
