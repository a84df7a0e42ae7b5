"""The next frames that would make a rig better known: of many places to hold the target at, those that tell most.

The next is the one after which the cameras are known best against each other (`calib.judge.greedy`). Compared is the
fourth root of the mean fourth power, over all pairs, of the deviation of a camera's centre against the other as a share
of their distance, so that the weakest pairs count most.

Where a target could be held before the cameras of a rig, and which of its points they would see of it there.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from itertools import combinations

import numpy as np

from calib.cameras import project
from calib.cameras.camera import Camera
from calib.cameras.rig import POSE
from calib.core.parallel import one_thread
from calib.core.se3 import invert, make_pose, skew, transform
from calib.core.types import KnownPoints, Observations, RigObservations
from calib.judge.greedy import best_of, one_by_one
from calib.judge.halves import NoHalves, RigHalves
from calib.judge.next_view_words import distance_words, place_of, place_words, short
from calib.judge.rig_halves import enlarged
from calib.judge.verdict import MOST_CAMERAS, NextFrame
from calib.rigs.relative import relative
from calib.rigs.result import RigCalibration
from calib.rigs.target_error import frame_information
from designer.base.arrays import Array, Flags, Rows
from designer.base.words import figure, printable

POINTS = 150
"""Of the target, by which candidates are compared."""
AROUND = np.array([(0, 0), (-1, 0), (1, 0), (0, -1), (0, 1)])
"""Places of an image at which a target is tried."""
GOLDEN = 0.6180339887498949
"""Its multiples, less their whole parts, fill a circle evenly whatever number of them is taken."""
NEW_SHARE = 0.1
"""Of the target, seen where a camera has seen nothing: what it then tells is not known well."""


def some_points(found: RigCalibration) -> KnownPoints:
    """A few of the points, spread over their order, on planes whose normals point to where they were seen from."""
    points, faces = found.observations.points, len(found.observations.points.plane)
    seen_from = np.zeros(faces)
    for pose, seen, frames in zip(
        found.cam_from_rig, found.observations.sightings, found.observations.frame, strict=True
    ):
        center = invert(pose @ found.rig_from_target[frames])[:, :3, 3]
        above = np.sign(center @ points.plane[:, :3].T - points.plane[:, 3])  # (V, F)
        face = points.face[seen.point]
        rows = np.flatnonzero(face >= 0)
        np.add.at(seen_from, face[rows], above[seen.view[rows], face[rows]])
    points = replace(points, plane=np.where(seen_from < 0, -1.0, 1.0)[:, None] * points.plane)
    rows = np.unique(np.linspace(0, len(points.face) - 1, POINTS).astype(np.int64))
    return replace(points, position_mm=points.position_mm[rows], face=points.face[rows])


def shown_at(
    found: RigCalibration, camera: int, rig_from_target: Array, points: KnownPoints, least_cosine: float
) -> Flags:
    """Which points are in the image of a camera, and on planes that look at it, or on none.  # (K, S)

    Args:
        found: the rig.
        camera: that looks.
        rig_from_target: places that the target is held at (K, 4, 4).
        points: S points of the target.
        least_cosine: of the largest angle from which they are read.
    """
    size = 1.0 if found.carrier is None else found.carrier.size
    cam_from_target = found.cam_from_rig[camera] @ rig_from_target
    in_camera = transform(cam_from_target[:, None], size * points.position_mm)
    pixel = project(found.cameras[camera], in_camera.reshape(-1, 3)).reshape(*in_camera.shape[:2], 2)
    with np.errstate(invalid="ignore"):
        inside = ((pixel > 0) & (pixel < np.array(found.cameras[camera].image_size) - 1)).all(axis=2)
    if not len(points.plane):
        return np.asarray(inside)
    normal = points.plane[points.face, :3] @ cam_from_target[:, :3, :3].transpose(0, 2, 1)
    cosine = -(in_camera * normal).sum(axis=2) / np.maximum(np.linalg.norm(in_camera, axis=2), 1e-9)
    return np.asarray(inside & ((cosine > least_cosine) | (points.face < 0)))


def imagined(
    found: RigCalibration, rig_from_target: Array, shown: Sequence[Flags], points: KnownPoints
) -> RigCalibration:
    """The rig with frames in the place of its own, in which a few points (S,) that stand for all are seen.

    Args:
        found: the rig of C cameras.
        rig_from_target: where the target is in the frames (K, 4, 4).
        shown: which points each camera sees, (C,) of (K, S).
        points: the few.
    """
    count, seen = len(rig_from_target), []
    names = tuple(map(str, range(count)))
    for camera, own in zip(found.cameras, shown, strict=True):
        view, point = np.nonzero(own)
        seen.append(Observations(camera.image_size, names, view, point, np.zeros((len(view), 2)), None, points))
    share = len(found.observations.points.position_mm) / len(points.position_mm)
    frames = (np.arange(count),) * len(seen)
    return replace(
        found, observations=RigObservations(found.observations.camera_names, names, tuple(seen), frames),
        rig_from_target=rig_from_target, residual_px=tuple(np.zeros((len(one.view), 2)) for one in seen),
        is_outlier=tuple(np.zeros(len(one.view), dtype=bool) for one in seen), weighted=False,
        scale=found.noise_px / math.sqrt(share),
        carrier=None if found.carrier is None else replace(found.carrier, error=np.zeros((count, POSE))),
    )  # fmt: skip


def sights(camera: Camera, off: Array) -> Array:
    """Rays of a camera to places of its image, right and down, -1 to 1 (K, 2), as far as there are such.  # (K, 3)"""
    half = 0.5 * (np.array(camera.image_size) - 1)
    ray = camera.rays(half + half * off)
    return np.asarray(ray[np.isfinite(ray).all(axis=1)])


def is_new(found: RigCalibration, camera: int, pose: Array) -> bool:
    """Whether a camera would see much of the target where it has seen none of it so far, and knows its lens badly."""
    pixel = found.cameras[camera].project(
        transform(found.cam_from_rig[camera] @ pose, found.observations.points.position_mm)
    )
    seen = found.observations.sightings[camera].center_px
    with np.errstate(invalid="ignore"):
        beyond = ((pixel < seen.min(axis=0)) | (pixel > seen.max(axis=0))).any(axis=1)
    return bool(found.is_refined[camera] and beyond.mean() > NEW_SHARE)


def few_of_many(count: int, most: int) -> Rows:
    """So many rows of `count` at most, ascending: every so many-th of nested loops would share the inner value."""
    return np.sort(np.argsort((np.arange(count) * GOLDEN) % 1.0, kind="stable")[:most])


MOST_FRAMES = 3
"""What is known after so many is to be solved before more are chosen by it."""
MOST_CANDIDATES, FEWEST_CANDIDATES = 800, 50
"""Times cameras, and of any rig."""
ROUNDING = 1e-12
"""Of the largest eigenvalue: what is less tells nothing."""
FEWEST_SEEN, LEAST_FACING = 6, 0.34
"""Points by which a camera sees the target; cosine of the largest angle from which they are read."""
TURNS = 6
"""Of those that were used, spread over all of them."""
ACROSS = 0.55
"""How far towards the sides of an image a target is tried, of its half."""
NEARER, FARTHER = 0.8, 1.2
"""Of the distance that was usual."""
ALIKE = 1.15
"""Two distances within this are said as one."""
NAMED = 4
"""Cameras that a sentence names."""


@dataclass(frozen=True, eq=False)
class _Held:
    """K places to hold a target at, and which cameras would see it there."""

    rig_from_target: Array  # (K, 4, 4)
    like_frame: Rows  # (K,) that it is turned as in
    sees: Flags  # (C, K)


@one_thread
def next_frames(found: RigCalibration, halves: RigHalves | NoHalves) -> tuple[NextFrame, ...]:
    """The frames to take next, the most useful first; none if more do little, or nothing can be said."""
    told = replace(enlarged(found, halves), carrier=None, slack=None)  # a person holds the target in the next frames
    if not 2 <= len(found.cameras) <= MOST_CAMERAS or found.status == "degenerate":
        return ()
    if not np.isfinite(told.covariance).all() or not (told.noise_px > 0).all():
        return ()
    points, (poses, like) = some_points(told), _held_poses(told)
    shown = [shown_at(told, camera, poses, points, LEAST_FACING) for camera in range(len(told.cameras))]
    share = len(found.observations.points.position_mm) / len(points.position_mm)
    sees = np.stack([one.sum(axis=1) * share >= FEWEST_SEEN for one in shown])
    joins = sees.sum(axis=0) >= 2
    if not joins.any():
        return ()
    held = _Held(poses[joins], like[joins], sees[:, joins])
    own = [(one & does[:, None])[joins] for one, does in zip(shown, sees, strict=True)]
    frames = imagined(told, held.rig_from_target, own, points)
    frames = replace(frames, scale=halves.factor * frames.scale)
    roots, quantity, first = [], _pair_quantities(told), told.rig.first_row
    for told_by, does in zip(frame_information(frames, np.eye(len(told.covariance))), held.sees.T, strict=True):
        rows = np.concatenate([np.arange(first[k], first[k + 1]) for k in np.flatnonzero(does).tolist()])
        value, axis = np.linalg.eigh(told_by[np.ix_(rows, rows)])
        some = value > ROUNDING * value[-1]
        roots.append(_Root(rows, axis[:, some] * np.sqrt(value[some])))

    def choose(covariance: Array) -> int | None:
        before = quantity @ covariance @ quantity.T
        gains = (quantity @ _gained(covariance, root) for root in roots)
        return best_of(np.array([_badness(before - gain @ gain.T) for gain in gains]), _badness(before))

    def add(covariance: Array, row: int) -> Array:
        gain = _gained(covariance, roots[row])
        return np.asarray(covariance - gain @ gain.T)

    steps = one_by_one(np.array(told.covariance), choose, add, MOST_FRAMES)
    return tuple(_told(told, held, one.choice, one.before, one.after) for one in steps)


def _pair_quantities(found: RigCalibration) -> Array:
    """How the unknowns move each pair's centres against each other, as shares of their distance.  # (3 pairs, N)"""
    rig = found.rig
    rows = []
    for a, b in combinations(range(len(rig.names)), 2):
        pair = relative(rig, a, b)
        turn, shift = pair.b_from_a[:3, :3], pair.b_from_a[:3, 3]
        carried = turn @ rig.cam_from_rig[a, :3, 3]
        by_turn, by_shift = np.zeros((3, rig.first_row[-1])), np.zeros((3, rig.first_row[-1]))
        first, second = rig.pose_rows(a).start, rig.pose_rows(b).start
        by_turn[:, first : first + 3], by_turn[:, second : second + 3] = -turn, np.eye(3)
        by_shift[:, first + 3 : first + 6], by_shift[:, second + 3 : second + 6] = -turn, np.eye(3)
        # As `calib.rigs.relative` has it.
        moved = -(by_shift + skew(carried) @ by_turn) - skew(shift) @ by_turn
        rows.append(moved / max(pair.baseline_mm, 1e-9))
    return np.concatenate(rows)


def _badness(covariance: Array) -> float:
    """Of all pairs, whose blocks of three stand along the diagonal, the weakest above all."""
    trace = np.diagonal(covariance).reshape(-1, 3).sum(axis=1).clip(min=0.0)
    return float(np.sqrt(np.sqrt((trace**2).mean())))


@dataclass(frozen=True, eq=False)
class _Root:
    """G of what a frame tells, its information being `G G'`, of the unknowns of the cameras that see the target."""

    rows: Rows  # (S,)
    root: Array  # (S, R)


def _gained(covariance: Array, told: _Root) -> Array:
    """What a frame takes from a covariance S: H of `S - H H'`, which is `S G (1 + G' S G)^-1/2`.  # (N, R)"""
    half = covariance[:, told.rows] @ told.root
    value, axis = np.linalg.eigh(np.eye(half.shape[1]) + told.root.T @ half[told.rows])
    gained: Array = half @ (axis / np.sqrt(value.clip(min=1.0)))
    return gained


def _held_poses(found: RigCalibration) -> tuple[Array, Rows]:
    """Poses of the target (K, 4, 4), and the frame each is turned as in (K,)."""
    middle = found.observations.points.middle_mm
    frames = np.unique(np.linspace(0, len(found.rig_from_target) - 1, TURNS).astype(np.int64))
    places = [np.median(transform(found.rig_from_target, middle), axis=0)]
    for camera, rig_from_cam, seen in zip(found.cameras, found.rig.rig_from_cam, found.observations.frame, strict=True):
        centre = rig_from_cam[:3, 3]
        usual = np.median(np.linalg.norm(transform(found.rig_from_target[seen], middle) - centre, axis=1))
        ray = sights(camera, ACROSS * AROUND) @ rig_from_cam[:3, :3].T
        places += [centre + times * usual * one for times in (NEARER, 1.0, FARTHER) for one in ray]
    pairs = [(place, frame) for place in places for frame in frames.tolist()]
    most = max(MOST_CANDIDATES // len(found.cameras), FEWEST_CANDIDATES)
    pairs = [pairs[row] for row in few_of_many(len(pairs), most).tolist()]
    turn = found.rig_from_target[[frame for _, frame in pairs], :3, :3]
    shift = np.array([place for place, _ in pairs]) - turn @ middle
    return make_pose(turn, shift), np.array([frame for _, frame in pairs], dtype=np.int64)


def _told(found: RigCalibration, held: _Held, row: int, before: Array, after: Array) -> NextFrame:
    """A frame in words."""
    names = found.observations.camera_names
    seeing = np.flatnonzero(held.sees[:, row]).tolist()
    rig, then = (replace(found.rig, covariance=one) for one in (before, after))
    known = {pair: relative(rig, *pair) for pair in combinations(range(len(names)), 2)}
    a, b = max(known, key=lambda pair: known[pair].place_sigma_mm / max(known[pair].baseline_mm, 1e-9))
    sigma = known[a, b].place_sigma_mm, relative(then, a, b).place_sigma_mm
    is_rough = any(is_new(found, camera, held.rig_from_target[row]) for camera in seeing)
    then_mm = f"about {figure(sigma[1], 1)} mm if the lenses are as solved" if is_rough else f"{figure(sigma[1], 2)} mm"
    gain = f"the place of {short(names[b])} against {short(names[a])}, 1 sigma, {figure(sigma[0], 2)} -> {then_mm}"
    hold = f"hold the target {_where(found, held.rig_from_target[row], seeing)}"
    turned = f"turned as in {short(found.observations.frame_names[int(held.like_frame[row])])}"
    return NextFrame(
        held.rig_from_target[row], tuple(printable(names[k]) for k in seeing), f"{hold}, {turned}: {gain}",
        (printable(names[a]), printable(names[b])), *sigma,
    )  # fmt: skip


def _where(found: RigCalibration, pose: Array, seeing: list[int]) -> str:
    """Between which cameras, how far from them, and where in the image of the nearest."""
    points = found.observations.points.position_mm
    middle = transform(pose, found.observations.points.middle_mm)
    away = np.linalg.norm(found.rig.center_mm[seeing] - middle, axis=1)
    names = [short(found.observations.camera_names[k]) for k in seeing]
    nearest = int(np.argmin(away))
    if len(seeing) == 2 and away.max() <= ALIKE * away.min():
        apart = f"{distance_words(float(away.mean()))} from both"
    elif len(seeing) == 2:
        apart = " and ".join(f"{distance_words(x)} from {name}" for x, name in zip(away.tolist(), names, strict=True))
    else:
        apart = f"{distance_words(float(away.min()))} from {names[nearest]}"
    listed = names if len(names) <= NAMED else [*names[:NAMED], f"{len(names) - NAMED} more"]
    camera = found.cameras[seeing[nearest]]
    pixel = camera.project(transform(found.cam_from_rig[seeing[nearest]] @ pose, points))
    pixel = pixel[np.isfinite(pixel).all(axis=1)]
    width, height = camera.image_size
    place = place_words(place_of((pixel,), (float(width), float(height)))).replace(
        "the image", f"{names[nearest]}'s image"
    )
    return f"where {', '.join(listed[:-1])} and {listed[-1]} see it, {apart}, {place}"
