"""A target, and the cameras that saw it, as layers of a 3D view."""

import math
from typing import TypeAlias

import numpy as np

from designer.base.arrays import Array, Rows
from designer.page.scene import Cameras, Drawn, Labels, Layer, Rings, Scene, Segments, Surface
from designer.target import TargetGeometry, bounding_radius_mm

Part: TypeAlias = tuple[Array, Rows]
"""Vertices, and triangles that name them by their rows."""

THICKNESS_MM = 3.0
"""Of a board whose spec is not known."""
EDGE_COLOUR = "#8a9099"
"""A grey that is seen on white and on black."""
AXES = (("X", "#d55e00"), ("Y", "#009e73"), ("Z", "#0072b2"))
"""Okabe and Ito's vermilion, green and blue (2008), which colour-blind people tell apart."""
CAMERA_SHARE = 0.09
"""Depth of a camera's pyramid over its distance from the target."""
MARKS_LIFT = 2e-4
"""Of black marks above a face, over the target's radius."""
POINT_PART = 0.1
"""Radius of a point that has no mark, of the usual distance to the next."""


def target_scene(
    target: TargetGeometry,
    *,
    body_colour: str,
    ink_colour: str,
    ring_colours: tuple[str, ...] | None = None,
    legend: tuple[tuple[str, str], ...] = (),
    more: tuple[Layer, ...] = (),
    has_numbers: bool = False,
) -> Scene:
    """The target standing upright, seen from its front; `more` layers go on top. See `target_layers`."""
    up, from_direction = np.array([0.0, 0.0, 1.0]), np.array([1.0, 0.35, 0.5])
    if target.is_plate:
        axes = target.target_from_face[0, :3, :3]
        up, from_direction = axes[:, 1], axes @ np.array([0.45, 0.3, 1.0])
    elif target.faces_up:
        up, from_direction = np.array([0.0, 1.0, 0.0]), np.array([-0.35, 0.25, 1.0])
    layers = target_layers(
        target, body_colour=body_colour, ink_colour=ink_colour, ring_colours=ring_colours, has_numbers=has_numbers
    )
    return Scene((*layers, *more), up=_tuple(up), from_direction=_tuple(from_direction), legend=legend)


def target_layers(
    target: TargetGeometry,
    *,
    body_colour: str,
    ink_colour: str,
    ring_colours: tuple[str, ...] | None = None,
    has_numbers: bool = False,
) -> tuple[Layer, ...]:
    """The target itself; its face numbers (of several faces) and the axes of its frame, which are hidden at first.

    Args:
        target: nominal, measured or perturbed.
        body_colour: "#rrggbb" of what is not printed on.
        ink_colour: "#rrggbb" of the border, and of the rings and dots if they have no colours of their own.
        ring_colours: "#rrggbb" of each ring or dot, to show a value at each.  # (R,)
        has_numbers: show the face numbers at first.
    """
    colours = ring_colours or (ink_colour,)
    body = Layer("target", (*_body(target, body_colour, ink_colour), _rings(target, colours)), has_switch=False)
    numbers = () if target.is_planar else (Layer("face numbers", (_face_numbers(target),), is_shown=has_numbers),)
    return (body, *numbers, Layer("axes", _axes(target), is_shown=False))


def camera_layer(
    cam_from_target: Array, view: Array, names: tuple[str, ...], colours: tuple[str, ...], size_mm: float
) -> Layer:
    """Where photos were taken from.

    Args:
        cam_from_target: poses.  # (V, 4, 4)
        view: what they see, in units of `size_mm`; see `Cameras`.  # (R, S, 3)
        names: of the photos.  # (V,)
        colours: "#rrggbb" of each, or one for all.  # (V,) or (1,)
        size_mm: depth of the pyramids, radius of the domes; see `camera_size_mm`.
    """
    rotation, translation = cam_from_target[:, :3, :3], cam_from_target[:, :3, 3]
    target_from_cam = np.tile(np.eye(4), (len(cam_from_target), 1, 1))
    target_from_cam[:, :3, :3] = rotation.transpose(0, 2, 1)
    target_from_cam[:, :3, 3] = -np.einsum("vji,vj->vi", rotation, translation)
    return Layer("cameras", (Cameras(target_from_cam, view, size_mm, colours, names),))


def camera_size_mm(cam_from_target: Array) -> float:
    """A depth for pyramids that suits how far the cameras stand.  # (V, 4, 4)"""
    if not len(cam_from_target):
        return 1.0
    return max(CAMERA_SHARE * float(np.median(np.linalg.norm(cam_from_target[:, :3, 3], axis=1))), 1e-3)


def _body(target: TargetGeometry, body_colour: str, ink_colour: str) -> tuple[Drawn, ...]:
    """The faces inside their borders, the borders, and the rest of a board's slab."""
    inside: list[Part] = []
    border: list[Part] = []
    has_border = bool(np.abs(target.outline_mm - target.window_mm).max() > 0)
    for frame, outline, window in zip(target.target_from_face, target.outline_mm, target.window_mm, strict=True):
        inside.append((_placed(frame, window), polygon_triangles(window)))
        if has_border:
            border.append((np.concatenate([_placed(frame, outline), _placed(frame, window)]), _strip(len(outline))))
    edges = [] if has_border else [_sides(_placed(f, o)) for f, o in _faces(target)]
    if target.is_plate:
        frame, outline = target.target_from_face[0], target.outline_mm[0]
        front, back = _placed(frame, outline), _placed(frame, outline, -thickness_mm(target))
        inside.append((np.concatenate([back, front]), _strip(len(outline))))
        if target.is_planar:
            inside.append((back, polygon_triangles(outline)[:, ::-1]))
        edges += [_sides(back), np.stack([front, back], axis=1)]
    shapes: list[Drawn] = [_surface(inside, body_colour)]
    if black := _marks(target):
        shapes.append(_surface(black, ink_colour))
    if has_border:
        shapes.append(_surface(border, ink_colour))
    if edges:
        shapes.append(Segments(np.concatenate(edges), (EDGE_COLOUR,)))
    return tuple(shapes)


def _marks(target: TargetGeometry) -> list[Part]:
    """What is black of other makers' marks, a hair above the faces."""
    lift = MARKS_LIFT * bounding_radius_mm(target)
    return [
        (_placed(frame, polygon, lift), polygon_triangles(polygon))
        for frame, marks in zip(target.target_from_face, target.marks or (), strict=target.marks is not None)
        for polygon in marks.polygons_mm
    ]


def _rings(target: TargetGeometry, colours: tuple[str, ...]) -> Rings:
    """Rings and dots on their faces: one that was measured a hair below would be hidden by the face."""
    frame = target.target_from_face[target.ring_face]
    in_face = target.center_in_face_mm
    center = np.einsum("rij,rj->ri", frame[:, :3, :2], in_face[:, :2]) + frame[:, :3, 3]
    where = ["" if target.is_planar else f"face {face}, " for face in target.ring_face]
    ours = ["dot" if is_dot else "ring" for is_dot in target.is_dot]
    what = ours if target.marks is None else [target.feature_word[:-1]] * target.ring_count
    names = tuple(f"{w}{k} ({i}, {j})" for w, k, (i, j) in zip(where, what, target.ring_index, strict=True))
    # A point without a mark is shown as a small dot; a corner between black squares only if it has a colour to show.
    as_point = POINT_PART * np.linalg.norm(target.lattice_mm[target.ring_face, 0], axis=1)
    if target.marks is not None and len(colours) == 1:
        as_point = np.zeros_like(as_point)
    radius = np.where(target.radius_outer_mm > 0, target.radius_outer_mm, as_point)
    return Rings(center, frame[:, :3, 2], radius, target.radius_inner_mm, colours, names)


def _face_numbers(target: TargetGeometry) -> Labels:
    """Numbers in the middle of the faces, as files and printed labels count them."""
    middle = np.concatenate([_placed(frame, window.mean(axis=0)[None]) for frame, window in _faces(target)])
    size = 0.11 * math.sqrt(float(np.mean([abs(polygon_area_mm2(outline)) for outline in target.outline_mm])))
    texts = tuple(str(face) for face in range(target.face_count))
    return Labels(middle, target.target_from_face[:, :3, 2], texts, size)


def _axes(target: TargetGeometry) -> tuple[Drawn, ...]:
    """The frame's axes with their letters; those of a solid reach out of it."""
    radius = bounding_radius_mm(target)
    length = (0.55 if target.is_plate else 1.14) * radius
    ends = np.zeros((3, 2, 3))
    ends[:, 1] = length * np.eye(3)
    # A label hides when its normal points away: two with opposite normals are always seen.
    at, normal = np.repeat((length + 0.05 * radius) * np.eye(3), 2, axis=0), np.repeat(np.eye(3), 2, axis=0)
    normal[1::2] *= -1
    letters = tuple(letter for letter, _ in AXES for _ in range(2))
    return Segments(ends, tuple(colour for _, colour in AXES)), Labels(at, normal, letters, 0.05 * radius)


def thickness_mm(target: TargetGeometry) -> float:
    """How thick a board is drawn."""
    if not target.is_planar:
        front, back = target.target_from_face[:, :3, 3]
        return float(target.target_from_face[0, :3, 2] @ (front - back))
    return THICKNESS_MM if target.spec is None else target.spec.depth_mm


def _faces(target: TargetGeometry) -> list[tuple[Array, Array]]:
    """Frame and outline of each face."""
    return list(zip(target.target_from_face, target.outline_mm, strict=True))


def _placed(frame: Array, points_mm: Array, height_mm: float = 0.0) -> Array:
    """Points of a face's plane, or of one above it, in the target's frame.  # (4, 4), (K, 2) -> (K, 3)"""
    placed: Array = points_mm @ frame[:3, :2].T + frame[:3, 3] + height_mm * frame[:3, 2]
    return placed


def _strip(count: int) -> Rows:
    """Triangles between two closed lines of `count` points each, the second line's after the first's."""
    here, after = np.arange(count), np.roll(np.arange(count), -1)
    first = np.stack([here, after, count + after], axis=1)
    return np.concatenate([first, np.stack([here, count + after, count + here], axis=1)])


def _surface(parts: list[Part], colour: str) -> Surface:
    """Parts of one colour together."""
    start = np.cumsum([0, *(len(vertices) for vertices, _ in parts)])
    triangles = np.concatenate([rows + first for (_, rows), first in zip(parts, start, strict=False)])
    return Surface(np.concatenate([vertices for vertices, _ in parts]), triangles, colour)


def _sides(points_mm: Array) -> Array:
    """The sides of a polygon.  # (K, 3) -> (K, 2, 3)"""
    return np.stack([points_mm, np.roll(points_mm, -1, axis=0)], axis=1)


def polygon_area_mm2(points_mm: Array) -> float:
    """Area of a polygon, above 0 if it runs counter-clockwise.  # (K, 2)"""
    x, y = points_mm.T
    return float((x * np.roll(y, -1) - y * np.roll(x, -1)).sum() / 2)


def polygon_triangles(points_mm: Array) -> Rows:
    """Triangles that fill a simple counter-clockwise polygon, cutting off one ear after another.  # (K, 2) -> (T, 3)"""
    left = list(range(len(points_mm)))
    triangles: list[tuple[int, int, int]] = []
    while len(left) > 3:
        ear = next((n for n in range(len(left)) if _is_ear(points_mm, left, n)), 0)
        triangles.append((left[ear - 1], left[ear], left[(ear + 1) % len(left)]))
        del left[ear]
    return np.array([*triangles, tuple(left)], dtype=np.int64)


def _is_ear(points_mm: Array, left: list[int], n: int) -> bool:
    """Whether corner `n` of what is left turns left and its triangle holds no other corner."""
    corners = [left[n - 1], left[n], left[(n + 1) % len(left)]]
    triangle = points_mm[corners]
    others = points_mm[[k for k in left if k not in corners]]
    if polygon_area_mm2(triangle) <= 0:
        return False
    side, to_point = np.roll(triangle, -1, axis=0) - triangle, others[:, None] - triangle
    inside = (side[:, 0] * to_point[..., 1] - side[:, 1] * to_point[..., 0] > 0).all(axis=1)
    return not inside.any()


def _tuple(vector: Array) -> tuple[float, float, float]:
    x, y, z = (float(value) for value in vector)
    return x, y, z
