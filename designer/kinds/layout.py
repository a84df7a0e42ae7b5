"""The nominal geometry of a spec, how the faces of a target lie to each other, and its narrowest widths."""

import math
from dataclasses import dataclass

import numpy as np

from designer.base.arrays import Array, Rows
from designer.base.codes import Index
from designer.base.solid import INLAY_SHARE, area_of, plane_of
from designer.spec.build import BUILDS
from designer.spec.spec import PrintSpec, Spec
from designer.target import PARALLEL, TargetGeometry, bounding_radius_mm, corners_mm

DECIMALS = 9
"""Coordinates are rounded to a picometre, so that processors whose sine differs in the last bit agree on ids."""
SAME_PLACE = 0.02
"""Corners and middles of sides nearer than this share of a side are one: faces of a print meet about so well."""
STRAIGHT = 1e-6
"""A corner whose sine is below is in the middle of a side."""
_FACE_DOWN = np.diag([1.0, -1.0, -1.0])


def lay_out(spec: Spec) -> TargetGeometry:
    """The nominal geometry of a target."""
    return spec.lay_out()


def same_on_all_faces(
    spec: Spec,
    *,
    index: list[Index],
    in_face_mm: Array,  # (N, 2), the same on every face
    dots: list[frozenset[Index]],  # (F,)
    target_from_face: Array,  # (F, 4, 4)
    outline_mm: Array,  # (K, 2)
    window_mm: Array,  # (K, 2)
    face_code: list[int],  # (F,)
    lattice_mm: Array,  # (2, 2)
) -> TargetGeometry:
    """Put the same lattice on every face."""
    face_count, per_face = len(target_from_face), len(index)
    is_dot = np.array([pair in face_dots for face_dots in dots for pair in index])
    center = np.einsum("fij,nj->fni", target_from_face[:, :3, :2], in_face_mm) + target_from_face[:, None, :3, 3]
    radius = spec.ring_diameter_mm / 2

    def on_every_face(values: Array) -> Array:
        return np.tile(np.round(values, DECIMALS), (face_count, 1, 1))

    return TargetGeometry(
        source="nominal",
        spec=spec,
        ring_face=np.repeat(np.arange(face_count), per_face),
        ring_index=np.tile(np.array(index), (face_count, 1)),
        center_mm=np.round(center.reshape(-1, 3), DECIMALS),
        radius_outer_mm=np.full(face_count * per_face, radius),
        radius_inner_mm=np.where(is_dot, 0.0, radius * spec.ring_ratio),
        is_dot=is_dot,
        target_from_face=np.round(target_from_face, 12),
        outline_mm=on_every_face(outline_mm),
        window_mm=on_every_face(window_mm),
        face_code=np.array(face_code),
        lattice_mm=on_every_face(lattice_mm),
    )


def true_corners(outline_mm: Array) -> Rows:
    """Which corners of an outline are none where a side was halved to give all faces as many.  # (K,)"""
    before, after = outline_mm - np.roll(outline_mm, 1, axis=0), np.roll(outline_mm, -1, axis=0) - outline_mm
    turn = before[:, 0] * after[:, 1] - before[:, 1] * after[:, 0]
    return np.flatnonzero(np.abs(turn) > STRAIGHT * np.linalg.norm(before, axis=1) * np.linalg.norm(after, axis=1))


def distance_to_sides(points: Array, start: Array, end: Array) -> Array:
    """From points to the nearest place of each side, shapes as NumPy broadcasts them.  # (..., D), (..., D) -> (...)"""
    step, offset = end - start, points - start
    share = np.clip((offset * step).sum(axis=-1) / (step**2).sum(axis=-1), 0.0, 1.0)
    return np.asarray(np.linalg.norm(offset - share[..., None] * step, axis=-1))


def adjacent_faces(target: TargetGeometry) -> Rows:
    """The face across each side of each face, from corner k to the next; -1: none.  # (F, K)

    Front and back of a plate meet nowhere, however thin it is.
    """
    corner = corners_mm(target)
    after = np.roll(corner, -1, axis=1)
    middle, length = (corner + after) / 2, np.linalg.norm(after - corner, axis=2)
    apart = distance_to_sides(middle[:, :, None, None], corner, after)  # (F, K, F, K)
    faces = np.arange(target.face_count)
    apart[faces, :, faces] = np.inf
    for first, second in opposite_faces(target):
        apart[first, :, second] = apart[second, :, first] = np.inf
    nearest = apart.min(axis=3)  # (F, K, F)
    return np.where(nearest.min(axis=2) < SAME_PLACE * length, nearest.argmin(axis=2), -1)


def joined_faces(target: TargetGeometry) -> list[list[int]]:
    """The face across each true side of each face, from each true corner on; -1: none."""
    rows = zip(adjacent_faces(target), target.outline_mm, strict=True)
    return [beside[true_corners(outline)].tolist() for beside, outline in rows]


def opposite_faces(target: TargetGeometry) -> tuple[tuple[int, int], ...]:
    """Pairs of faces whose normals are opposite, the smaller number first."""
    normals = target.target_from_face[:, :3, 2]
    pairs = np.argwhere(np.triu(normals @ normals.T < PARALLEL - 1, 1))
    return tuple((int(first), int(second)) for first, second in pairs)


def inset_per_depth(target: TargetGeometry) -> float:
    """How far the plane that halves the angle of two faces moves in from their edge, per unit of depth; 0: no edge.

    Of faces whose normals are an angle a apart, tan(a / 2); of a solid's edges the largest.
    """
    body = None if target.spec is None else target.spec.body
    if body is not None and target.spec is not None and target.spec.solid is None:
        return body.inset_per_depth
    beside = adjacent_faces(target)
    face, side = np.nonzero(beside >= 0)
    if not len(face):
        return 0.0
    normals = target.target_from_face[:, :3, 2]
    cosine = (normals[face] * normals[beside[face, side]]).sum(axis=1)
    return math.tan(math.acos(float(np.clip(cosine.min(), -1.0, 1.0))) / 2)


def deepest_inlay_mm(target: TargetGeometry) -> float:
    """The deepest inlay of a border: its floor moves in with depth, and a tenth of it must be left; of walls, half."""
    inset = inset_per_depth(target)
    behind_mm = math.inf if target.spec is None else target.spec.depth_mm / 2
    return min(INLAY_SHARE * border_width_mm(target) / inset, behind_mm) if inset > 0 else math.inf


LIP_LAYERS = 2
"""Height of a lip, if stickers are thinner: a finger feels it, and the steps of slopes do not hide it."""
LIP_VIEW = math.tan(math.radians(70.0))
"""Up to this angle from a face's normal its whole outline keeps some of its border, beside a lip that hides it."""
LEAST_SEEN_BORDER = 0.5
"""Of a border's width, what stickers must keep of it."""


@dataclass(frozen=True)
class Lip:
    """The frame around each sticker."""

    width_mm: float  # in the face, from the solid's edge inwards
    clearance_mm: float  # between it and the sticker
    rise_mm: float  # above the sticker's face

    @property
    def inset_mm(self) -> float:
        """How far the sticker is cut inside its face's outline."""
        return self.width_mm + self.clearance_mm

    @property
    def least_border_mm(self) -> float:
        """Of the target, so that the sticker shows enough of it."""
        return max(self.inset_mm / (1 - LEAST_SEEN_BORDER), self.inset_mm + LIP_VIEW * self.rise_mm)


def lip_of(target: TargetGeometry, printing: PrintSpec) -> Lip:
    """The lip of a target's stickers: a line of the printer wide at its foot, on either side of an edge."""
    printer, thickness = printing.printer, printing.sticker_thickness_mm
    width = printer.line_width_mm + inset_per_depth(target) * thickness
    return Lip(width, printer.clearance_mm, max(LIP_LAYERS * printer.layer_height_mm - thickness, 0.0))


def sticker_inset_mm(target: TargetGeometry, printing: PrintSpec) -> float:
    """How far a sticker is cut inside its face's outline: in its lip, else where the face of the smaller body ends."""
    if not printing.way.has_stickers:
        return 0.0
    if printing.lip:
        return lip_of(target, printing).inset_mm
    return inset_per_depth(target) * printing.sticker_thickness_mm


def face_down(target: TargetGeometry) -> Array:
    """Axes of a bed on which the target lies on its last face, x along that face's x.  # (3, 3)

    A body with a larger face without rings stands on that one. A plate with raised or recessed rings lies on its back.
    """
    if target.is_plate and target.build is not None and BUILDS[target.build].ink != "flush":
        return target.target_from_face[0, :3, :3].T
    body, last = None if target.spec is None else target.spec.body, corners_mm(target)[-1]
    flat = [last, *(() if body is None else (body.corners_mm()[list(face)] for face in body.bare))]
    base = max(flat, key=lambda corner: round(area_of(corner), 6))
    if base is not last:
        x_axis = (base[1] - base[0]) / np.linalg.norm(base[1] - base[0])
        down = plane_of(base)[:3]
        return np.stack([x_axis, np.cross(x_axis, down), -down])
    axes: Array = _FACE_DOWN @ target.target_from_face[-1, :3, :3].T
    return axes


def is_turned(target: TargetGeometry, *, is_bed_deep: bool = False) -> bool:
    """Whether `design` turns a target by a quarter from `face_down`, so that its longer side lies along the bed's.

    Of sides alike the last bit does not decide.
    """
    width, depth, _ = np.ptp(corners_mm(target).reshape(-1, 3) @ face_down(target).T, axis=0).tolist()
    along, across = (depth, width) if is_bed_deep else (width, depth)
    return bool(across > along * (1 + PARALLEL))


def border_width_mm(target: TargetGeometry) -> float:
    """Width of the border, where it is narrowest, to a nanometre; 0 without one."""
    return round(border_mm(target.outline_mm, target.window_mm), 6)


def border_mm(outline_mm: Array, window_mm: Array) -> float:
    """The same of outlines and windows.  # (..., K, 2), (..., L, 2)"""
    edge = np.roll(outline_mm, -1, axis=-2) - outline_mm
    outward = np.stack([edge[..., 1], -edge[..., 0]], axis=-1) / np.linalg.norm(edge, axis=-1, keepdims=True)
    # From each side of the outline to the nearest corner of the window.
    to_corner = outline_mm[..., :, None, :] - window_mm[..., None, :, :]  # (..., K, L, 2)
    return float(np.einsum("...ski,...si->...sk", to_corner, outward).min())


def corner_room_mm(target: TargetGeometry, corner: Array) -> float:
    """How far from the axis through a corner of a solid the first ring begins."""
    axis = corner / np.linalg.norm(corner)
    along = target.center_mm @ axis
    aside = np.linalg.norm(target.center_mm - along[:, None] * axis, axis=1)
    return float((aside - target.radius_outer_mm)[along > 0].min())


@dataclass(frozen=True)
class Widths:
    """Narrowest widths, in millimetres; infinite where a target has no such thing."""

    stroke_mm: float  # of a ring
    centre_mm: float  # diameter of a ring's white centre
    gap_mm: float  # between neighbouring rings or dots
    margin_mm: float  # between a ring and the border or, without one, the edge
    border_mm: float  # 0 without one

    @property
    def inked_sides(self) -> int:
        """Of a margin that are ink: both if there is a border."""
        return 2 if self.border_mm > 0 else 1

    @property
    def ink_offset_range_mm(self) -> tuple[float, float]:
        """Between these offsets no stroke and no white closes."""
        shrink = min(self.stroke_mm / 2, self.border_mm if self.border_mm > 0 else np.inf)
        return -shrink, min(self.centre_mm / 2, self.gap_mm / 2, self.margin_mm / self.inked_sides)


def narrowest_widths(target: TargetGeometry) -> Widths:
    """The narrowest widths over all faces."""
    if target.marks is not None:
        least = min(one.least_mm for one in target.marks)
        room = [np.ptp(at, axis=0) - one.size_mm for at, one in zip(target.window_mm, target.marks, strict=True)]
        return Widths(least, np.inf, least, float(np.min(room)) / 2, border_width_mm(target))
    is_ring = ~target.is_dot
    inner, outer = target.radius_inner_mm[is_ring], target.radius_outer_mm[is_ring]
    return Widths(
        stroke_mm=float((outer - inner).min(initial=np.inf)),
        centre_mm=2 * float(inner.min(initial=np.inf)),
        gap_mm=_gap_mm(target),
        margin_mm=_margin_mm(target),
        border_mm=border_width_mm(target),
    )


def _gap_mm(target: TargetGeometry) -> float:
    """Least distance between the outer edges of features that are neighbours in their face's lattice."""
    face, index = target.ring_face, target.ring_index - target.ring_index.min(axis=0) + 1
    width = int(index.max()) + 2
    key = (face * width + index[:, 0]) * width + index[:, 1]
    order = np.argsort(key)
    least = np.inf if target.spec is None else target.spec.least_gap_mm
    for i_step, j_step in ((1, 0), (0, 1), (1, -1), (1, 1)):
        wanted = key + i_step * width + j_step
        place = np.minimum(np.searchsorted(key, wanted, sorter=order), len(key) - 1)
        neighbour = order[place]
        (has,) = np.nonzero(key[neighbour] == wanted)
        other = neighbour[has]
        distance = np.linalg.norm(target.center_mm[has] - target.center_mm[other], axis=1)
        gaps = distance - target.radius_outer_mm[has] - target.radius_outer_mm[other]
        least = min(least, float(gaps.min(initial=np.inf)))
    return least


def _margin_mm(target: TargetGeometry) -> float:
    """Least distance from a ring's outer edge to its face's window."""
    corner = target.window_mm[target.ring_face]  # (R, K, 2)
    edge = np.roll(corner, -1, axis=1) - corner
    to_center = target.center_in_face_mm[:, None, :2] - corner
    cross = edge[..., 0] * to_center[..., 1] - edge[..., 1] * to_center[..., 0]
    inside = cross / np.linalg.norm(edge, axis=2)
    return float((inside - target.radius_outer_mm[:, None]).min())


IMAGE_HALF_HEIGHT = 0.4096
"""Of the camera template machine-vision, at distance 1: tangents of half its angles of view, over the height and over
the diagonal."""
IMAGE_HALF_DIAGONAL = 0.6383
_AIM_SHARE, _PLANAR_AIM_SHARE = 0.8, 0.7
"""How far the camera looks past the target, of the distance from the image's middle to its corners: so far that rings
come into the corners, and that nothing with one face loses the dots that name its rings."""
_OUTSIDE = 0.9
"""Of the way to the target's hull, what the aim may take up."""


@dataclass(frozen=True)
class Viewpoints:
    """From where a target is photographed: turned at random, and looking past it by up to the aim's offset."""

    distance_mm: tuple[float, float]  # of the cameras from the target's origin, drawn evenly between the two
    aim_offset_mm: float
    half_angle_rad: float  # of the cap around the normal of a plate or the diagonal of a corner; pi: from all sides


def advised_photos(target: TargetGeometry, distance_mm: tuple[float, float] | None = None) -> Viewpoints:
    """Photos as a person should take them: near and far, turned, rings into the image's corners.

    The page of a design has the line of `calib render` for them, and studies assume them. From the nearest place the
    target's outline fills the height of the image of the camera template machine-vision.

    Args:
        target: any.
        distance_mm: other distances; None: from there to twice as far.
    """
    inside = bounding_radius_mm(target)
    near = inside / IMAGE_HALF_HEIGHT
    near, far = distance_mm or (_two_digits(near), _two_digits(2 * near))
    aim = (_PLANAR_AIM_SHARE if target.is_plate else _AIM_SHARE) * IMAGE_HALF_DIAGONAL * near
    aim = _two_digits(max(min(aim, _OUTSIDE * (near - inside)), 0.0))
    return Viewpoints((near, far), aim, math.pi if not target.faces_up else math.radians(45 if target.is_plate else 25))


def _two_digits(value: float) -> float:
    return float(f"{value:.2g}")
