"""Photos that could be taken next: where a target may be held, as the photos taken so far show to be possible.

Also the first ones, while nothing is known of the camera, which are to tell it: a solid shows planes at many slants at
once; of a board each photo tells two numbers of a camera, if it is tilted, and those that are tilted to the same side
tell the same two.

A place is given by two numbers from -1 to 1: the target's box in the image at the left (top) end, in the middle, at the
right (bottom) end of where it has room.
"""

import math
from dataclasses import dataclass, fields, replace

import numpy as np

from calib.cameras import COMMON, project, rays
from calib.cameras.camera import Camera
from calib.cameras.refit import plain_camera
from calib.core.se3 import exp_rotation, make_pose, rotation_between, transform, transform_each
from calib.judge.coverage import LitPart, lit_part
from calib.judge.views import Habits, TargetShape, facing, pitch_px, px_per_mm
from calib.solver.calibration import Calibration
from designer.base.arrays import Array, Flags, Rows

PLACES = (
    (0, 0), (-1, -1), (0, -1), (1, -1), (-1, 0), (1, 0), (-1, 1), (0, 1), (1, 1), (-0.5, -0.5), (0.5, -0.5),
    (-0.5, 0.5), (0.5, 0.5),
)  # fmt: skip
TILTS_DEG = (20.0, 40.0)
SIDES = ((1.0, 0.0), (-1.0, 0.0), (0.0, 1.0), (0.0, -1.0))
CORNERS = ((1.0, 1.0), (-1.0, 1.0), (1.0, -1.0), (-1.0, -1.0))
NEARER, FARTHER, DISTANCES = 0.7, 1.4, 4
"""Of the distances to a face that were used; much beyond them a fixed lens is not sharp."""
LONG = 1.15
"""A target this much longer than wide is worth turning upright."""
MOST_LIKE = 6
"""So many of the used views are tried with a solid at another place."""
TURNS_ALL_ROUND = 8
"""Of a solid of which there is no photo yet."""
LARGEST_INCIDENCE_DEG = 70.0
MARGIN_PITCHES = 0.75
"""Between the outermost ring's centre and the image's border."""
PLACED_WITHIN = 0.8
"""Of the margin: what the placing may miss it by."""
OVERSHOOT = 0.3
"""Of a solid's size in the image: so much of it may lie outside, where single faces are read."""
LITTLE_ROOM = 0.1
"""Of the image: a target with less room than this is nowhere else than in the middle."""
PLACING_STEPS = 5


@dataclass(frozen=True, eq=False)
class CandidateViews:
    """C photos that could be taken, or only how the target is turned in them."""

    cam_from_target: Array  # (C, 4, 4)
    place: Array  # (C, 2) right and down, -1 to 1
    distance_mm: Array  # (C,) from the camera to the target's middle
    tilt_deg: Array  # (C,) of a flat target against the sensor; nan: a solid
    away: Array  # (C, 2) to the right and down: where a flat target's far side is in the image; 0: none is
    is_upright: Flags  # (C,) a flat target's long side is vertical
    like_view: Rows  # (C,) the used view that shows a solid from the same side; -1: none, or a flat target

    def __getitem__(self, rows: Rows | Flags) -> "CandidateViews":
        return CandidateViews(*(getattr(self, one.name)[rows] for one in fields(self)))


def tilt_rotation(tilt_rad: float, away: Array) -> Array:
    """The turn of a target that faces the camera which moves the side at `away` (right, down) away from the camera.

    About the axis `away x z`, which turns `away` towards z.
    """
    length = float(np.hypot(*away))
    if not length > 0:
        return np.eye(3)
    return exp_rotation(tilt_rad * np.array([away[1], -away[0], 0.0]) / length)


def candidates_of(
    calibration: Calibration, shape: TargetShape, habits: Habits, reach: tuple[float, float] = (NEARER, FARTHER)
) -> CandidateViews:
    """All photos that are tried: each turn at each place and distance, as far as it can be held there.

    Args:
        calibration: what is known so far; it may have no photos yet.
        shape: the target.
        habits: how it was held, or may be held.
        reach: how much nearer and farther than that it may be.
    """
    turns = _flat_turns(shape) if shape.is_flat else _turns_of_views(calibration, shape)
    near, far = habits.distance_mm
    # How far the faces of a solid lie before its middle; a solution may place the camera inside of it.
    before = ((shape.middle_mm - shape.center_mm) * shape.normal).sum(axis=1)
    depth = 0.0 if shape.is_flat else min(max(float(np.nanmax(before)), 0.0), 0.9 * near)
    distances = depth + np.geomspace(reach[0] * (near - depth), reach[1] * (far - depth), DISTANCES)
    overshoots = (0.0, OVERSHOOT) if not shape.is_flat else tuple({0.0, round(0.7 * (1 - habits.face_share), 2)})
    places = np.array([(*place, over) for over in overshoots for place in PLACES if not over or 1 in np.abs(place)])
    t, d, p = (x.ravel() for x in np.indices((len(turns.tilt_deg), DISTANCES, len(places))))
    pose, ok = _placed(lit_part(calibration), shape, turns.cam_from_target[t], places[p], distances[d])
    return replace(turns[t], cam_from_target=pose, place=places[p, :2], distance_mm=distances[d])[ok]


def candidates_at(shape: TargetShape, cam_from_target: Array) -> CandidateViews:
    """Photos of poses that are given (C, 4, 4), as a turntable has them, and no others."""
    count = len(cam_from_target)
    tilt = np.full(count, np.nan)
    if shape.is_flat:
        tilt = np.degrees(np.arccos(np.abs(cam_from_target[:, 2, :3] @ shape.axes[2]).clip(max=1.0)))
    distance_mm, none = np.linalg.norm(transform(cam_from_target, shape.center_mm), axis=1), np.zeros((count, 2))
    no_view, is_upright = np.full(count, -1), np.zeros(count, dtype=np.bool_)
    return CandidateViews(cam_from_target, none, distance_mm, tilt, none, is_upright, no_view)


def held_ahead(shape: TargetShape, turn: Array, distance_mm: float) -> Array:
    """The pose in the middle of the image of a target turned so (..., 3, 3).  # (..., 4, 4)"""
    return make_pose(turn, np.array([0.0, 0.0, distance_mm]) - turn @ shape.center_mm)


def _flat_turns(shape: TargetShape) -> CandidateViews:
    """Straight on and tilted to sides and corners, with the long side level and, if it is long, upright."""
    tilts = [(0.0, (0.0, 0.0))]
    tilts += [(tilt, side) for tilt in TILTS_DEG for side in SIDES]
    tilts += [(TILTS_DEG[-1], corner) for corner in CORNERS]
    upright = np.stack([-shape.axes[1], shape.axes[0], -shape.axes[2]])
    faces = [(shape.level, False)] + ([(upright, True)] if shape.aspect > LONG else [])
    rows = [(tilt, away, face, turned) for face, turned in faces for tilt, away in tilts]
    turns = [tilt_rotation(np.radians(tilt), np.array(away)) @ face for tilt, away, face, _ in rows]
    return replace(
        candidates_at(shape, held_ahead(shape, np.stack(turns), 1.0)),
        tilt_deg=np.array([tilt for tilt, *_ in rows]), away=np.array([away for _, away, *_ in rows]),
        is_upright=np.array([turned for *_, turned in rows]),
    )  # fmt: skip


def _turns_of_views(calibration: Calibration, shape: TargetShape) -> CandidateViews:
    """As a solid was turned in some of the used views, evenly spread over their order; without any all ways."""
    count = len(calibration.cam_from_target)
    if not count:
        turns = np.stack([side_turn(number) for number in range(TURNS_ALL_ROUND)])
        return candidates_at(shape, held_ahead(shape, turns, 1.0))
    views = np.unique(np.linspace(0, count - 1, min(count, MOST_LIKE)).round().astype(np.int64))
    return replace(candidates_at(shape, calibration.cam_from_target[views]), like_view=views)


def side_turn(number: int) -> Array:
    """How a solid is turned to the camera with one side after the other.  # (3, 3)"""
    return exp_rotation(np.array([0.6 + 0.7 * number, 0.4 + 0.9 * number, 0.0]))


def _placed(lit: LitPart, shape: TargetShape, turned: Array, wanted: Array, distance_mm: Array) -> tuple[Array, Flags]:
    """Poses whose box in the image is where it is wanted, and which of them there are.

    The target is aimed at, its box looked at and the aim moved by what is missing, a few times. A flat target keeps its
    tilt anywhere; a solid is turned along, so that it shows the same side.

    Args:
        lit: part of the image.
        shape: of the target.
        turned: poses (C, 4, 4) that it is turned as in.
        wanted: a place and an overshoot (C, 3).
        distance_mm: of the target's middle (C,).
    """
    camera, (first, last) = lit.camera, lit.box_px
    place, overshoot = wanted[:, :2], wanted[:, 2:]
    if not lit.is_lit(np.where(np.array(CORNERS) > 0, last, first)).all():
        # Dark corners of the box around what is lit: places are moved in to the rim of its ellipse.
        place = place / np.maximum(np.linalg.norm(place, axis=1, keepdims=True), 1.0)
    size = last - first + 1
    aim = np.tile(0.5 * (first + last), (len(turned), 1))
    pose, span = turned, np.zeros_like(aim)
    ok = np.ones(len(turned), dtype=bool)
    sight = transform(turned, shape.center_mm)
    sight /= np.linalg.norm(sight, axis=1, keepdims=True)
    for step in range(PLACING_STEPS):
        ray = rays(camera, aim)
        ok &= np.isfinite(ray).all(axis=1)
        ray = np.where(ok[:, None], ray, [0.0, 0.0, 1.0])
        rotation = turned[:, :3, :3] if shape.is_flat else rotation_between(sight, ray) @ turned[:, :3, :3]
        middle = distance_mm[:, None] * ray
        pose = make_pose(rotation, middle - rotation @ shape.center_mm)
        if step == PLACING_STEPS - 1:
            break
        low, high = _box(camera, shape, pose)
        ok &= np.isfinite(low).all(axis=1) & np.isfinite(high).all(axis=1)
        low, high = (np.where(ok[:, None], x, aim) for x in (low, high))
        span = high - low
        margin = np.nan_to_num(MARGIN_PITCHES * shape.pitch_mm * px_per_mm(camera, middle))
        room = 0.5 * np.maximum(size - 1 - span - 2 * margin[:, None], 0.0) + overshoot * span
        aim += 0.5 * (first + last) + place * room - 0.5 * (low + high)
    has_room = (size - span > LITTLE_ROOM * size) | (overshoot > 0) | (place == 0)
    is_in_front = np.isfinite(project(camera, pose[:, :3, 3])).all(axis=1)
    return pose, ok & has_room.all(axis=1) & is_in_front


def faces_seen(shape: TargetShape, pose: Array) -> tuple[Flags, Array, Array]:
    """Which faces look at the camera (C, F), and their middles and normals in its frame (C, F, 3)."""
    normal = (pose[:, None, :3, :3] @ shape.normal[:, :, None])[..., 0]
    place = transform_each(pose, shape.middle_mm)
    with np.errstate(invalid="ignore"):
        seen: Flags = facing(place, normal) > np.cos(np.radians(LARGEST_INCIDENCE_DEG))
    return seen, place, normal


def _box(camera: Camera, shape: TargetShape, pose: Array) -> tuple[Array, Array]:
    """The corners (C, 2) of the box in the image around the faces that look at the camera; nan without any."""
    rows = np.concatenate(shape.corner)
    pixel = project(camera, transform_each(pose, shape.position_mm[rows]))
    shown = faces_seen(shape, pose)[0][:, shape.face[rows]]
    known = shown & np.isfinite(pixel[..., 0]) & np.isfinite(pixel[..., 1])
    ok = known.any(axis=1) & (known == shown).all(axis=1)
    low = np.where(known[..., None], pixel, np.inf).min(axis=1)
    high = np.where(known[..., None], pixel, -np.inf).max(axis=1)
    return np.where(ok[:, None], low, np.nan), np.where(ok[:, None], high, np.nan)


@dataclass(frozen=True, eq=False)
class ShownPoints:
    """What C photos show of N points."""

    is_read: Flags  # (C, N)
    weight: Array  # (C, N) of information, of that of a large ring; 0: not read
    pixel: Array  # (C, N, 2)


def shown_in(camera: Camera, shape: TargetShape, habits: Habits, pose: Array, rows: Rows) -> ShownPoints:
    """Where photos show a target's points, and which would be read.

    Those on a face that looks at the camera and is not too fine, inside the image, and of which as much is inside as
    the photos taken so far show to be needed.

    Args:
        camera: that takes the photos.
        shape: the target.
        habits: what the photos taken so far show to be readable.
        pose: of the photos (C, 4, 4).
        rows: the points asked for (N,); the share of a face is that of its rows.
    """
    turned, place, normal = faces_seen(shape, pose)
    with np.errstate(invalid="ignore"):
        pitch = pitch_px(camera, shape, place, normal)
        turned &= pitch >= habits.pitch_px * (1 - 1e-9)
        margin = PLACED_WITHIN * MARGIN_PITCHES * shape.pitch_mm * px_per_mm(camera, place)
    face = shape.face[rows]
    pixel = project(camera, transform_each(pose, shape.position_mm[rows]))
    edge, inside = margin[:, face], turned[:, face]
    for along, size in zip((pixel[..., 0], pixel[..., 1]), camera.image_size, strict=True):
        with np.errstate(invalid="ignore"):
            inside &= (along >= edge) & (along <= size - 1 - edge)
    of_face = (face[:, None] == np.arange(len(shape.normal))).astype(np.float64)
    share = inside @ of_face / np.maximum(of_face.sum(axis=0), 1.0)
    is_read = inside & (share >= habits.face_share - 1e-9)[:, face]
    # A centre's variance falls with the number of pixels at the ring's edge.
    fine = np.ones_like(pitch)
    if habits.fine_pitch_px > 0:
        fine = np.nan_to_num(pitch / habits.fine_pitch_px).clip(0.0, 1.0)
    return ShownPoints(is_read, is_read * fine[:, face], pixel)


USUAL_FOCAL = 0.9
"""Focal length over the image's longer side of most cameras with an ordinary lens: 58 degrees from side to side. That
of a webcam or a telephone is from .7 to 1, that of a machine-vision camera from .8 to 2."""
FILLS = 0.7
"""Of the image, in the direction that a target fills more of."""
TILT_DEG = 30.0
TO_SIDES = ((1.0, 0.0), (0.0, 1.0), (-1.0, 0.0), (0.0, -1.0), (1.0, 1.0), (-1.0, -1.0), (1.0, -1.0), (-1.0, 1.0))
"""Sides of a board to be held away, right and down, one photo after the other."""
TILTED_BY_DEG = 12.0
OTHERWISE_DEG = 20.0
"""Photos of a board that are turned by so much tell other numbers."""
NEW = 0.6
"""Of that: a view is told from those taken."""
SIZING_STEPS = 4


def guessed_camera(image_size: tuple[int, int], guess: Camera | None) -> Camera:
    """The camera by which a first proposal is drawn: the one given, if it has the images' size, or a usual one."""
    if guess is not None and guess.image_size == image_size:
        return guess
    return plain_camera(COMMON, image_size, USUAL_FOCAL * max(image_size))


def first_pose(camera: Camera, shape: TargetShape, taken: Array) -> Array:
    """Where to hold a target for one of the first photos, otherwise than in those taken (V, 4, 4).  # (4, 4)"""
    for number in range(len(TO_SIDES)):
        pose = _turned_pose(camera, shape, number)
        if novelty(shape, pose, taken) > NEW:
            return pose
    return _turned_pose(camera, shape, len(taken))


def _turned_pose(camera: Camera, shape: TargetShape, number: int) -> Array:
    turn = side_turn(number)
    if shape.is_flat:
        turn = tilt_rotation(math.radians(TILT_DEG), np.array(TO_SIDES[number % len(TO_SIDES)])) @ shape.level
    extent = float(np.ptp(shape.position_mm, axis=0).max())
    distance = extent * float(camera.params[0]) / max(camera.image_size)
    pose = held_ahead(shape, turn, distance)
    for _ in range(SIZING_STEPS):
        distance = max(distance * _filled(camera, shape, pose) / FILLS, 0.7 * extent)
        pose = held_ahead(shape, turn, distance)
    return pose


def _filled(camera: Camera, shape: TargetShape, pose: Array) -> float:
    """Of the image's width or height, what the target fills of the one that it fills more of."""
    seen = faces_seen(shape, pose[None])[0][0]
    pixel = project(camera, transform(pose, shape.position_mm[seen[shape.face]]))
    pixel = pixel[np.isfinite(pixel).all(axis=1)]
    return float((np.ptp(pixel, axis=0) / camera.image_size).max()) if len(pixel) > 1 else FILLS


def novelty(shape: TargetShape, pose: Array, taken: Array) -> float:
    """What a view tells that the photos taken (V, 4, 4) do not, by how it is turned: 0 to 1.

    Args:
        shape: the target.
        pose: of the view (4, 4), by a guessed camera.
        taken: of the photos, by the same.
    """
    turn = pose[:3, :3]
    if shape.is_flat:
        normal = turn @ shape.axes[2]
        enough = min(math.degrees(math.acos(min(max(-float(normal[2]), -1.0), 1.0))) / TILTED_BY_DEG, 1.0)
        cosine = (taken[:, :3, :3] @ shape.axes[2]) @ normal
    else:
        enough = 1.0
        cosine = 0.5 * (np.trace(taken[:, :3, :3].transpose(0, 2, 1) @ turn, axis1=1, axis2=2) - 1)
    nearest = np.degrees(np.arccos(np.clip(cosine.max(initial=-1.0), -1.0, 1.0)))
    return enough * min(float(nearest) / OTHERWISE_DEG, 1.0)
