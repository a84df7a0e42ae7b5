"""A rendered preview: the target in perspective, from both sides if it is a solid, so that every code is seen.

The bodies are convex, so painting the faces that look at the camera, ink over body, hides everything rightly.
"""

import io
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from PIL import Image, ImageDraw

from designer.pattern import Pattern

SIZE_PX = 900
"""Width and height of one view."""
_OVERSAMPLING = 3
_BACKGROUND = (228, 232, 238)
_CAPTION_PX = 46
_LIGHT = np.array([0.35, 0.55, 0.76])
"""Towards the light, in the camera's frame with y up and z towards the viewer."""


_Colour = tuple[int, int, int]


@dataclass(frozen=True)
class _View:
    """A camera on a sphere around the target's origin."""

    camera_from_target: NDArray[np.float64]  # (3, 3) x right, y up, z towards the viewer
    distance_mm: float
    scale_px: float  # pixels per millimetre at the origin

    def to_pixels(self, points_mm: NDArray[np.float64]) -> list[tuple[float, float]]:
        """Perspective image of points.  # (N, 3)"""
        seen = points_mm @ self.camera_from_target.T
        factor = self.scale_px * self.distance_mm / (self.distance_mm - seen[:, 2])
        middle = SIZE_PX * _OVERSAMPLING / 2
        return list(zip((middle + factor * seen[:, 0]).tolist(), (middle - factor * seen[:, 1]).tolist(), strict=True))


def preview_png(pattern: Pattern, *, thickness_mm: float, body_colour: str, ink_colour: str, caption: str) -> bytes:
    """The preview as a PNG file.

    Args:
        pattern: the ink on all faces.
        thickness_mm: of the plate behind a single face.
        body_colour: "#rrggbb".
        ink_colour: "#rrggbb".
        caption: a line below the picture.
    """
    is_board = len(pattern.faces) == 1
    # Seen from before one face and from behind, each of the icosahedron's faces shows by 19 degrees or more.
    normal = pattern.target_from_face[len(pattern.faces) // 4, :3, 2]
    directions = [np.array([-0.35, -0.45, 1.0])] if is_board else [normal, -normal]
    image = Image.new("RGB", (SIZE_PX * len(directions), SIZE_PX + _CAPTION_PX), _BACKGROUND)
    colours = _rgb(body_colour), _rgb(ink_colour)
    for place, direction in enumerate(directions):
        view = _look_from(pattern, direction, up=np.eye(3)[1 if is_board else 2])
        canvas = Image.new("RGB", (SIZE_PX * _OVERSAMPLING,) * 2, _BACKGROUND)
        draw = ImageDraw.Draw(canvas)
        if is_board:
            _paint_sides(draw, pattern, view, thickness_mm, colours[0])
        for number in range(len(pattern.faces)):
            _paint_face(draw, pattern, number, view, colours)
        image.paste(canvas.reduce(_OVERSAMPLING), (place * SIZE_PX, 0))
    ImageDraw.Draw(image).text((18, SIZE_PX + 8), caption, fill=(60, 66, 74), font_size=22)
    buffer = io.BytesIO()
    image.save(buffer, "PNG")
    return buffer.getvalue()


def _look_from(pattern: Pattern, direction: NDArray[np.float64], up: NDArray[np.float64]) -> _View:
    """A camera in the given direction from the target, whose picture the target fills."""
    z_axis = direction / np.linalg.norm(direction)
    x_axis = np.cross(up, z_axis)
    x_axis /= np.linalg.norm(x_axis)
    rotation = np.stack([x_axis, np.cross(z_axis, x_axis), z_axis])
    corners = _corners(pattern)
    distance = 5 * float(np.linalg.norm(corners, axis=1).max())
    span = np.abs(np.array(_View(rotation, distance, 1.0).to_pixels(corners)) - SIZE_PX * _OVERSAMPLING / 2).max()
    return _View(rotation, distance, 0.46 * SIZE_PX * _OVERSAMPLING / float(span))


def _corners(pattern: Pattern) -> NDArray[np.float64]:
    """The corners of all faces in the target frame.  # (N, 3)"""
    frames = zip(pattern.target_from_face, pattern.faces, strict=True)
    return np.concatenate([_in_target(frame, face.outline) for frame, face in frames])


def _in_target(frame: NDArray[np.float64], points: NDArray[np.float64]) -> NDArray[np.float64]:
    """Points of a face's plane in the target frame.  # (N, 2) -> (N, 3)"""
    placed: NDArray[np.float64] = points @ frame[:3, :2].T + frame[:3, 3]
    return placed


def _paint_face(
    draw: ImageDraw.ImageDraw,
    pattern: Pattern,
    number: int,
    view: _View,
    colours: tuple[_Colour, _Colour],
) -> None:
    """One face in body and ink colour, if it looks at the camera."""
    frame, face = pattern.target_from_face[number], pattern.faces[number]
    to_camera = view.distance_mm * view.camera_from_target[2] - frame[:3, 3]
    if frame[:3, 2] @ to_camera <= 0:
        return
    light = _brightness(view.camera_from_target @ frame[:3, 2])
    body, ink = (_shaded(colour, light) for colour in colours)

    def paint(contour: NDArray[np.float64], colour: _Colour) -> None:
        draw.polygon(view.to_pixels(_in_target(frame, contour)), fill=colour)

    paint(face.outline, body if face.window is None else ink)
    if face.window is not None:
        paint(face.window, body)
    for row, position in zip(face.stamp.tolist(), face.position_mm, strict=True):
        stamp = pattern.stamps[row]
        paint(stamp.rim + position, ink)
        if stamp.hole is not None:
            paint(stamp.hole + position, body)
    for contour in face.dark_text:
        paint(contour, ink)
    for contour in face.light_text:
        paint(contour, body)


def _paint_sides(
    draw: ImageDraw.ImageDraw, pattern: Pattern, view: _View, thickness_mm: float, colour: _Colour
) -> None:
    """The sides of a plate that look at the camera."""
    frame, outline = pattern.target_from_face[0], pattern.faces[0].outline
    top = _in_target(frame, outline)
    bottom = top - thickness_mm * frame[:3, 2]
    for k in range(len(outline)):
        after = (k + 1) % len(outline)
        along = top[after] - top[k]
        normal = np.cross(along, frame[:3, 2]) / np.linalg.norm(along)
        if normal @ (view.distance_mm * view.camera_from_target[2] - top[k]) > 0:
            quad = np.array([top[k], top[after], bottom[after], bottom[k]])
            draw.polygon(view.to_pixels(quad), fill=_shaded(colour, _brightness(view.camera_from_target @ normal)))


def _brightness(normal: NDArray[np.float64]) -> float:
    """Diffuse light with some from everywhere."""
    return 0.55 + 0.45 * max(0.0, float(normal @ _LIGHT))


def _shaded(colour: _Colour, light: float) -> _Colour:
    """A colour under light; black keeps a little, so that dark faces stay apart."""
    red, green, blue = (min(255, round(14 * light + 0.945 * light * channel)) for channel in colour)
    return red, green, blue


def _rgb(colour: str) -> _Colour:
    return int(colour[1:3], 16), int(colour[3:5], 16), int(colour[5:7], 16)
