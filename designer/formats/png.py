"""A rendered preview: the target in perspective and, of a solid, the net with every face's code and number.

The bodies are convex, or walls that all look at the camera: painting the faces that do, ink over body, hides rightly.
"""

import io
import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
from PIL import Image, ImageColor, ImageDraw

from designer.base.arrays import Array
from designer.make.pattern import Contour, FacePattern, Pattern
from designer.spec.spec import PrintSpec, Spec

HEIGHT_PX = 800
"""Height of the picture above its caption; the view in perspective is as wide."""
THUMBNAIL_PX = 512
NET_WIDTH_PX = 1640
CAPTION_PX = 46
_TOUCH = 1e-3
"""Of a face's area, what it may cover of others in a net."""
_OVERSAMPLING = 3
_SIDES_OF_PLATE = 2
_BACKGROUND = (228, 232, 238)
_NUMBER_COLOUR = (200, 30, 60)
_LIGHT = np.array([0.35, 0.55, 0.76])
"""Towards the light, in the camera's frame with y up and z towards the viewer."""

_Colour = tuple[int, int, int]
_Pixels = list[tuple[float, float]]


@dataclass(frozen=True)
class _SphereCamera:
    """A camera on a sphere around the target's origin."""

    camera_from_target: Array  # (3, 3) x right, y up, z towards the viewer
    distance_mm: float
    scale_px: float  # pixels per millimetre at the origin
    side_px: int  # of its picture

    def to_pixels(self, points_mm: Array) -> _Pixels:
        """Perspective image of points.  # (N, 3)"""
        seen = points_mm @ self.camera_from_target.T
        factor = self.scale_px * self.distance_mm / (self.distance_mm - seen[:, 2])
        middle = self.side_px / 2
        return list(zip((middle + factor * seen[:, 0]).tolist(), (middle - factor * seen[:, 1]).tolist(), strict=True))


def preview_png(pattern: Pattern, spec: Spec, printing: PrintSpec, caption: str) -> bytes:
    """The preview as a PNG file: the target, of a solid its net and of a plate its back too, and a line below them.

    Args:
        pattern: the ink on all faces.
        spec: of the target.
        printing: gives the colours.
        caption: the line.
    """
    colours = _rgb(printing.body_colour), _rgb(printing.ink_colour)
    sides = range(len(pattern.faces) if spec.body is None else 1)
    panels = [_perspective(pattern, side, spec.depth_mm, colours) for side in sides]
    if spec.solid is not None:
        outline = pattern.faces[0].outline
        edge_mm = float(np.linalg.norm(outline[1] - outline[0]))
        motion, size = spec.solid.polyhedron.unfolded()
        motion[:, :2, 2] *= edge_mm
        panels.append(_unfolded(pattern, motion, edge_mm * size, colours))
    elif spec.body is not None:
        panels.append(_unfolded(pattern, *unfolded_mm(pattern), colours))
    image = Image.new("RGB", (sum(panel.width for panel in panels), HEIGHT_PX + CAPTION_PX), _BACKGROUND)
    left = 0
    for panel in panels:
        image.paste(panel, (left, 0))
        left += panel.width
    ImageDraw.Draw(image).text((18, HEIGHT_PX + 8), caption, fill=(60, 66, 74), font_size=22)
    return _png(image)


@dataclass(frozen=True)
class Thumbnails:
    """A picture in the sizes that slicers ask for, as PNG files."""

    large: bytes  # 512 pixels a side
    middle: bytes  # 256
    small: bytes  # 128

    @classmethod
    def of(cls, picture: Image.Image) -> "Thumbnails":
        """Of a square picture of 512 pixels."""
        return cls(*(_png(picture if step == 1 else picture.reduce(step)) for step in (1, 2, 4)))


def target_thumbnails(pattern: Pattern, spec: Spec, printing: PrintSpec) -> Thumbnails:
    """The target as in its preview."""
    colours = _rgb(printing.body_colour), _rgb(printing.ink_colour)
    return Thumbnails.of(_perspective(pattern, 0, spec.depth_mm, colours, THUMBNAIL_PX, oversampling=2))


def bed_thumbnails(
    bed_mm: tuple[float, float], outlines: Sequence[Contour], disks: Array, printing: PrintSpec
) -> Thumbnails:
    """A plate from above.

    Args:
        bed_mm: width and depth of the bed.
        outlines: of what lies on it.
        disks: x, y, inner and outer radius of rings and dots.  # (N, 4)
        printing: gives the colours.
    """
    body, ink = _rgb(printing.body_colour), _rgb(printing.ink_colour)
    side = 2 * THUMBNAIL_PX
    scale = side / max(bed_mm)
    canvas = Image.new("RGB", (side, side), _BACKGROUND)
    draw = ImageDraw.Draw(canvas)
    offset = (side - scale * np.array(bed_mm)) / 2
    for outline in outlines:
        x, y = (offset + scale * outline).T
        draw.polygon(list(zip(x.tolist(), (side - y).tolist(), strict=True)), fill=body, outline=ink, width=3)
    middle = offset + scale * disks[:, :2]
    for (x, y), (inner, outer) in zip(middle.tolist(), (scale * disks[:, 2:]).tolist(), strict=True):
        for radius, colour in ((outer, ink), (inner, body)):
            if radius:
                draw.ellipse((x - radius, side - y - radius, x + radius, side - y + radius), fill=colour)
    return Thumbnails.of(canvas.reduce(2))


def _png(image: Image.Image) -> bytes:
    buffer = io.BytesIO()
    image.save(buffer, "PNG")
    return buffer.getvalue()


def _perspective(
    pattern: Pattern,
    side: int,
    thickness_mm: float,
    colours: tuple[_Colour, _Colour],
    side_px: int = HEIGHT_PX,
    oversampling: int = _OVERSAMPLING,
) -> Image.Image:
    """The target as a camera sees it; of a plate from one of its sides, of a corner into it."""
    is_plate = len(pattern.faces) <= _SIDES_OF_PLATE
    is_inward = all(frame[:3, 2] @ frame[:3, 3] < 0 for frame in pattern.target_from_face)
    direction = np.array([-0.35, -0.45, 1.0]) if is_plate else np.array([0.9, -0.35, 0.45])
    if is_inward:
        direction = np.array([-0.35, 0.25, 1.0])
    elif is_plate:
        direction = pattern.target_from_face[side, :3, :3] @ direction
    view = _look_from(pattern, direction, np.eye(3)[1 if is_plate or is_inward else 2], side_px * oversampling)
    canvas = Image.new("RGB", (view.side_px,) * 2, _BACKGROUND)
    draw = ImageDraw.Draw(canvas)
    if is_plate:
        _paint_sides(draw, pattern, view, thickness_mm, colours[0])
    for frame, face in zip(pattern.target_from_face, pattern.faces, strict=True):
        if frame[:3, 2] @ (view.distance_mm * view.camera_from_target[2] - frame[:3, 3]) > 0:
            light = _brightness(view.camera_from_target @ frame[:3, 2])

            def to_pixels(points: Contour, frame: Array = frame) -> _Pixels:
                return view.to_pixels(_in_target(frame, points))

            _paint_face(draw, face, pattern, to_pixels, (_shaded(colours[0], light), _shaded(colours[1], light)))
    return canvas.reduce(oversampling)


def _unfolded(pattern: Pattern, net: Array, size_mm: Array, colours: tuple[_Colour, _Colour]) -> Image.Image:
    """The net of a solid, seen from outside, with the faces' numbers."""
    canvas = Image.new("RGB", (NET_WIDTH_PX * _OVERSAMPLING, HEIGHT_PX * _OVERSAMPLING), _BACKGROUND)
    draw = ImageDraw.Draw(canvas)
    width, height = size_mm.tolist()
    px_per_mm = 0.96 * min(canvas.width / width, canvas.height / height)
    left, top = (canvas.width - px_per_mm * width) / 2, (canvas.height - px_per_mm * height) / 2
    for number, (motion, face) in enumerate(zip(net, pattern.faces, strict=True)):

        def to_pixels(points: Contour, motion: Array = motion) -> _Pixels:
            x, y = (px_per_mm * (points @ motion[:2, :2].T + motion[:2, 2])).T
            return list(zip((left + x).tolist(), (top + px_per_mm * height - y).tolist(), strict=True))

        _paint_face(draw, face, pattern, to_pixels, (_shaded(colours[0], 1.0), _shaded(colours[1], 1.0)))
        (middle,) = to_pixels(np.zeros((1, 2)))
        edge_px = px_per_mm * float(np.linalg.norm(face.outline[1] - face.outline[0]))
        draw.text(
            middle, str(number), fill=_NUMBER_COLOUR, font_size=0.13 * edge_px, anchor="mm",
            stroke_width=0.012 * edge_px, stroke_fill=(255, 255, 255),
        )  # fmt: skip
    return canvas.reduce(_OVERSAMPLING)


def unfolded_mm(pattern: Pattern) -> tuple[Array, Array]:
    """The net of any faces: each hangs on one that was laid down before, where it covers none, else lies apart.

    Returns:
        Motions of the plane from the faces' frames to the net, and the net's width and height.  # (F, 3, 3), (2,)
    """
    from shapely import Polygon, union_all

    shape = [Polygon(face.outline) for face in pattern.faces]
    motion, laid = np.tile(np.eye(3), (len(shape), 1, 1)), dict[int, Polygon]()
    queue = [max(range(len(shape)), key=lambda face: round(shape[face].area, 3))]
    laid[queue[0]] = shape[queue[0]]
    for parent in queue:
        for face in range(len(shape)):
            hung = None if face in laid else _hung_on(pattern, motion[parent], parent, face)
            if hung is None:
                continue
            moved = Polygon(pattern.faces[face].outline @ hung[:2, :2].T + hung[:2, 2])
            if union_all([*laid.values()]).intersection(moved).area < _TOUCH * moved.area:
                motion[face], laid[face] = hung, moved
                queue.append(face)
    for face in (face for face in range(len(shape)) if face not in laid):
        at = [max(one.bounds[2] for one in laid.values()) - shape[face].bounds[0], -shape[face].bounds[1]]
        motion[face, :2, 2] = at
        laid[face] = Polygon(pattern.faces[face].outline + at)
    left, low, right, high = union_all([*laid.values()]).bounds
    motion[:, :2, 2] -= [left, low]
    return motion, np.array([right - left, high - low])


def _hung_on(pattern: Pattern, placed: Array, parent: int, face: int) -> Array | None:
    """The motion that brings a face's side to the one that it shares with a face in the net; None: it shares none."""
    own, other = pattern.faces[face].outline, pattern.faces[parent].outline
    apart = np.linalg.norm(
        _in_target(pattern.target_from_face[parent], other)[:, None]
        - _in_target(pattern.target_from_face[face], own), axis=2
    )  # fmt: skip
    near = apart < 0.01 * math.sqrt(float(np.ptp(own, axis=0).min() * np.ptp(own, axis=0).max()))
    # A side of the one runs along the other's the opposite way.
    sides = np.argwhere(near & np.roll(near, (-1, 1), axis=(0, 1)))
    if not len(sides):
        return None
    at, mine = sides[0]
    here, there = own[mine - 1] - own[mine], (np.roll(other, -1, axis=0) - other)[at] @ placed[:2, :2].T
    turn = math.atan2(there[1], there[0]) - math.atan2(here[1], here[0])
    motion = np.eye(3)
    motion[:2, :2] = [[math.cos(turn), -math.sin(turn)], [math.sin(turn), math.cos(turn)]]
    motion[:2, 2] = placed[:2, :2] @ other[at] + placed[:2, 2] - motion[:2, :2] @ own[mine]
    return motion


def _paint_face(
    draw: ImageDraw.ImageDraw,
    face: FacePattern,
    pattern: Pattern,
    to_pixels: Callable[[Contour], _Pixels],
    colours: tuple[_Colour, _Colour],
) -> None:
    """One face in body and ink colour."""
    body, ink = colours

    def paint(contour: Contour, colour: _Colour) -> None:
        draw.polygon(to_pixels(contour), fill=colour)

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


def _look_from(pattern: Pattern, direction: Array, up: Array, side_px: int) -> _SphereCamera:
    """A camera in the given direction from the target, whose picture the target fills."""
    z_axis = direction / np.linalg.norm(direction)
    x_axis = np.cross(up, z_axis)
    x_axis /= np.linalg.norm(x_axis)
    rotation = np.stack([x_axis, np.cross(z_axis, x_axis), z_axis])
    frames = zip(pattern.target_from_face, pattern.faces, strict=True)
    corners = np.concatenate([_in_target(frame, face.outline) for frame, face in frames])
    distance = 5 * float(np.linalg.norm(corners, axis=1).max())
    span = np.abs(np.array(_SphereCamera(rotation, distance, 1.0, side_px).to_pixels(corners)) - side_px / 2).max()
    return _SphereCamera(rotation, distance, 0.46 * side_px / float(span), side_px)


def _in_target(frame: Array, points: Contour) -> Array:
    """Points of a face's plane in the target frame.  # (N, 2) -> (N, 3)"""
    placed: Array = points @ frame[:3, :2].T + frame[:3, 3]
    return placed


def _paint_sides(
    draw: ImageDraw.ImageDraw, pattern: Pattern, view: _SphereCamera, thickness_mm: float, colour: _Colour
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


def _brightness(normal: Array) -> float:
    """Diffuse light with some from everywhere."""
    return 0.55 + 0.45 * max(0.0, float(normal @ _LIGHT))


def _shaded(colour: _Colour, light: float) -> _Colour:
    """A colour under light; black keeps a little, so that dark faces stay apart."""
    red, green, blue = (min(255, round(14 * light + 0.945 * light * channel)) for channel in colour)
    return red, green, blue


def _rgb(colour: str) -> _Colour:
    red, green, blue = ImageColor.getrgb(colour)[:3]
    return red, green, blue
