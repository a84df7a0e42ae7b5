"""The next frames that would make a rig better known: of many places to hold the target at, those that tell most.

The next is the one after which the cameras are known best against each other (`calib.judge.greedy`). Compared is the
fourth root of the mean fourth power, over all pairs, of the deviation of a camera's centre against the other as a share
of their distance, so that the weakest pairs count most.

Where a target could be held before the cameras of a rig, and which of its points they would see of it there.
"""

from dataclasses import dataclass, replace
from itertools import combinations

import numpy as np

from calib.cameras import project
from calib.cameras.camera import Camera
from calib.cameras.rig import POSE, Rig
from calib.core.parallel import one_thread
from calib.core.se3 import make_pose, transform
from calib.core.types import KnownPoints
from calib.judge.greedy import InformativeCandidates
from calib.judge.halves import NoHalves, RigHalves
from calib.judge.information import Knowledge, PlaceInRig, photo_products
from calib.judge.next_view_words import distance_words, place_of, place_words, short
from calib.judge.verdict import MOST_CAMERAS, NextFrame
from calib.judge.views import photographed_sides
from calib.rigs.relative import center_motion, relative, relative_motion
from calib.rigs.result import RigCalibration
from calib.rigs.target_error import tells_size, told_by_frames
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


@dataclass(frozen=True, eq=False)
class CandidateFrames:
    """K places to hold a target at before a rig, and which of a few of its points each of C cameras would see there."""

    rig_from_target: Array  # (K, 4, 4)
    like_frame: Rows  # (K,) that it is turned as in
    shown: Flags  # (C, K, S)


def some_points(found: RigCalibration) -> KnownPoints:
    """A few of the points, spread over their order, on planes whose normals point to where they were seen from."""
    points = found.observations.points
    sign = photographed_sides(points, found.alone)
    rows = np.unique(np.linspace(0, len(points.face) - 1, POINTS).astype(np.int64))
    return replace(
        points, plane=sign[:, None] * points.plane, position_mm=points.position_mm[rows], face=points.face[rows]
    )


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


def told_by_candidates(found: RigCalibration, basis: Array, tried: CandidateFrames, points: KnownPoints) -> Array:
    """What each candidate would tell, as `calib.rigs.target_error.frame_information` has it for frames.  # (K, Q, Q)

    Args:
        found: the rig; with a carrier one of a single camera.
        basis: directions (N, B) of the rows of the rig's covariance.
        tried: the candidates.
        points: the few (S,), which stand for all.
    """
    carrier, rig, size, besides = found.carrier, found.rig, 1.0, 0
    if carrier is not None:
        size, besides = carrier.size, POSE + tells_size(found)  # the target's size, and its place on the carrier
        found = replace(found, carrier=replace(carrier, error=np.zeros((len(tried.like_frame), POSE))))
    position_mm, count = size * points.position_mm, basis.shape[1] + besides
    share = len(found.observations.points.position_mm) / len(points.position_mm)
    product = np.zeros((len(tried.like_frame), count + POSE, count + POSE))
    for camera, (lens, pose, shown) in enumerate(zip(found.cameras, found.cam_from_rig, tried.shown, strict=True)):
        rows = slice(rig.first_row[camera], rig.first_row[camera + 1])
        own = np.flatnonzero(basis[rows].any(axis=0))
        known = Knowledge(lens, basis[rig.params_rows(camera)][:, own], float(found.noise_px[camera]), True)
        seat = PlaceInRig(pose, basis[rig.pose_rows(camera)][:, own])
        resized = position_mm[None] if tells_size(found) else None
        into = np.r_[own, basis.shape[1] : basis.shape[1] + tells_size(found), count : count + POSE]
        product[:, into[:, None], into] += photo_products(
            known, pose @ tried.rig_from_target, position_mm, share * shown, resized, seat
        )
    return told_by_frames(replace(found, rig_from_target=tried.rig_from_target), product)


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
MOST_NUMBERS = 50_000_000
"""Of what all candidates tell, so that it fits in memory: a lens with a surface has hundreds of unknowns."""
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


@one_thread
def next_frames(found: RigCalibration, halves: RigHalves | NoHalves) -> tuple[NextFrame, ...]:
    """The frames to take next, the most useful first; none if more do little, or nothing can be said."""
    found = replace(found, carrier=None, slack=None)  # a person holds the target in the next frames
    if not 2 <= len(found.cameras) <= MOST_CAMERAS or found.status == "degenerate":
        return ()
    if not np.isfinite(found.covariance).all() or not (found.noise_px > 0).all():
        return ()
    points, (poses, like) = some_points(found), _held_poses(found)
    shown = np.stack([shown_at(found, camera, poses, points, LEAST_FACING) for camera in range(len(found.cameras))])
    share = len(found.observations.points.position_mm) / len(points.position_mm)
    sees = shown.sum(axis=2) * share >= FEWEST_SEEN  # (C, K)
    joins = sees.sum(axis=0) >= 2
    if not joins.any():
        return ()
    tried = CandidateFrames(poses[joins], like[joins], (shown & sees[:, :, None])[:, joins])
    information = told_by_candidates(found, np.eye(len(found.covariance)), tried, points)
    unknowns = np.repeat(sees[:, joins].T, np.diff(found.rig.first_row), axis=1)
    steps = InformativeCandidates.by(information, unknowns).chosen(
        np.array(found.covariance), _pair_moves(found.rig), MOST_FRAMES
    )
    square = halves.factor**2
    return tuple(
        _told(found, tried, one.choice, square * one.before.covariance, square * one.after.covariance) for one in steps
    )


def _pair_moves(rig: Rig) -> Array:
    """How the unknowns move the centres of each pair against each other, as shares of their distance.  # (P, 3, N)"""
    pairs = list(combinations(range(len(rig.names)), 2))
    moves = np.zeros((len(pairs), 3, rig.first_row[-1]))
    for own, (a, b) in zip(moves, pairs, strict=True):
        rows, motion = relative_motion(rig, a, b)
        pair = relative(rig, a, b)
        own[:, rows] = center_motion(pair.b_from_a) @ motion / max(pair.baseline_mm, 1e-9)
    return moves


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
    most = min(MOST_CANDIDATES // len(found.cameras), MOST_NUMBERS // len(found.covariance) ** 2)
    most = max(most, FEWEST_CANDIDATES)
    pairs = [pairs[row] for row in few_of_many(len(pairs), most).tolist()]
    turn = found.rig_from_target[[frame for _, frame in pairs], :3, :3]
    shift = np.array([place for place, _ in pairs]) - turn @ middle
    return make_pose(turn, shift), np.array([frame for _, frame in pairs], dtype=np.int64)


def _told(found: RigCalibration, tried: CandidateFrames, row: int, before: Array, after: Array) -> NextFrame:
    """A frame in words."""
    names = found.observations.camera_names
    seeing, pose = np.flatnonzero(tried.shown[:, row].any(axis=1)).tolist(), tried.rig_from_target[row]
    rig, then = (replace(found.rig, covariance=one) for one in (before, after))
    known = {pair: relative(rig, *pair) for pair in combinations(range(len(names)), 2)}
    a, b = max(known, key=lambda pair: known[pair].place_sigma_mm / max(known[pair].baseline_mm, 1e-9))
    sigma = known[a, b].place_sigma_mm, relative(then, a, b).place_sigma_mm
    is_rough = any(is_new(found, camera, pose) for camera in seeing)
    then_mm = f"about {figure(sigma[1], 1)} mm if the lenses are as solved" if is_rough else f"{figure(sigma[1], 2)} mm"
    gain = f"the place of {short(names[b])} against {short(names[a])}, 1 sigma, {figure(sigma[0], 2)} -> {then_mm}"
    hold = f"hold the target {_where(found, pose, seeing)}"
    turned = f"turned as in {short(found.observations.frame_names[int(tried.like_frame[row])])}"
    return NextFrame(
        pose, tuple(printable(names[k]) for k in seeing), f"{hold}, {turned}: {gain}",
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
