"""The next frames that would make a rig better known: of many places to hold the target at, those that tell most.

As for single cameras (`calib.judge.next_views`) frames are chosen one after the other: the next is the one after
which the cameras are known best against each other, with all chosen before it taken. Compared is the fourth root of the
mean fourth power, over all pairs, of the deviation of a camera's centre against the other as a share of their distance,
so that the weakest pairs count most.
"""

from dataclasses import dataclass, replace
from itertools import combinations
from typing import Annotated

import numpy as np

from calib.cameras import linearise
from calib.cameras.camera import Camera
from calib.core.linear_algebra import symmetric_inverse
from calib.core.parallel import one_thread
from calib.core.se3 import make_pose, rigid_fault, skew, transform
from calib.core.types import KnownPoints, frozen_array
from calib.judge.next_robot_poses import few_of_many, is_new, some_points, that_look
from calib.judge.next_view_words import distance_words, place_of, place_words, short
from calib.rigs.halves import NoRigHalves, RigHalves, enlarged
from calib.rigs.relative import relative
from calib.rigs.result import RigCalibration
from designer.base.arrays import Array, Flags, Rows
from designer.base.marks import ONE_LINE, AtLeast, AtMost, Length, Shape, Word
from designer.base.words import figure, printable

MOST_FRAMES = 3
"""What is known after so many is to be solved before more are chosen by it."""
LITTLE_GAIN = 0.97
"""A frame that leaves more than this of the deviation is not worth taking."""
MOST_CAMERAS = 16
"""Of larger rigs the candidates would take long."""
MOST_CANDIDATES, FEWEST_CANDIDATES = 800, 50
"""Times cameras, and of any rig."""
ROUNDING = 1e-12
"""Of the largest eigenvalue: what is less tells nothing."""
FEWEST_SEEN = 6
"""Points by which a camera sees the target."""
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
LARGEST_MM = 1e9
_Sigma = Annotated[float, AtLeast(0), AtMost(LARGEST_MM)]


@dataclass(frozen=True, eq=False)
class NextFrame:
    """A frame to take, and what it would do."""

    rig_from_target: Annotated[Array, Shape(4, 4)]
    cameras: Annotated[tuple[Word, ...], Length(2, MOST_CAMERAS)]  # that would see the target
    sentence: Annotated[str, Length(1, 1000), ONE_LINE]
    pair: tuple[Word, Word]  # that is known worst before it
    sigma_mm_before: _Sigma  # of the place of one of them against the other, along the least known direction
    sigma_mm_after: _Sigma  # with this frame and those proposed before it

    def __post_init__(self) -> None:
        object.__setattr__(self, "rig_from_target", frozen_array(self.rig_from_target))
        if fault := rigid_fault(self.rig_from_target[None]):
            raise ValueError(f"rig_from_target {fault[1]}")


@dataclass(frozen=True, eq=False)
class _Held:
    """K places to hold a target at, and what each camera would see of it."""

    rig_from_target: Array  # (K, 4, 4)
    like_frame: Rows  # (K,) that it is turned as in
    sees: Flags  # (C, K)
    own: tuple[Array, ...]  # (C,) of (K, Q, Q) products by a camera's unknowns
    cross: tuple[Array, ...]  # (C,) of (K, Q, 6) by these and by the frame's pose
    frame: Array  # (C, K, 6, 6) by the frame's pose


@one_thread
def next_frames(found: RigCalibration, halves: RigHalves | NoRigHalves) -> tuple[NextFrame, ...]:
    """The frames to take next, the most useful first; none if more do little, or nothing can be said."""
    told = enlarged(found, halves)
    if not 2 <= len(found.cameras) <= MOST_CAMERAS or found.status == "degenerate":
        return ()
    if not np.isfinite(told.covariance).all() or not (told.noise_px > 0).all():
        return ()
    factor = halves.factor if isinstance(halves, RigHalves) else 1.0
    held = _candidates(told, factor)
    if not len(held.rig_from_target):
        return ()
    quantity, roots = _pair_quantities(told), [_root(told, held, row) for row in range(held.sees.shape[1])]
    covariance = np.array(told.covariance)
    chosen: list[NextFrame] = []
    while len(chosen) < MOST_FRAMES:
        before = quantity @ covariance @ quantity.T
        after = [_badness(before - gain @ gain.T) for gain in (quantity @ _gained(covariance, root) for root in roots)]
        best = int(np.argmin(after))
        if not after[best] <= LITTLE_GAIN * _badness(before):
            break
        gain = _gained(covariance, roots[best])
        chosen.append(_told(told, held, best, covariance, covariance - gain @ gain.T))
        covariance = covariance - gain @ gain.T
    return tuple(chosen)


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


def _root(found: RigCalibration, held: _Held, row: int) -> _Root:
    """Of a place, the target's own pose eliminated."""
    cameras = np.flatnonzero(held.sees[:, row]).tolist()
    first = found.rig.first_row
    rows = np.concatenate([np.arange(first[camera], first[camera + 1]) for camera in cameras])
    own = np.zeros((len(rows), len(rows)))
    begin = 0
    for camera in cameras:
        end = begin + first[camera + 1] - first[camera]
        own[begin:end, begin:end] = held.own[camera][row]
        begin = end
    cross = np.concatenate([held.cross[camera][row] for camera in cameras])
    pose = symmetric_inverse(held.frame[cameras, row].sum(axis=0)).inverse
    value, axis = np.linalg.eigh(own - cross @ pose @ cross.T)
    told = value > ROUNDING * value[-1]
    return _Root(rows, axis[:, told] * np.sqrt(value[told]))


def _gained(covariance: Array, told: _Root) -> Array:
    """What a frame takes from a covariance S: H of `S - H H'`, which is `S G (1 + G' S G)^-1/2`.  # (N, R)"""
    half = covariance[:, told.rows] @ told.root
    value, axis = np.linalg.eigh(np.eye(half.shape[1]) + told.root.T @ half[told.rows])
    gained: Array = half @ (axis / np.sqrt(value.clip(min=1.0)))
    return gained


def _candidates(found: RigCalibration, factor: float) -> _Held:
    """Places all over the cameras' images at the usual distances, turned as in frames that were taken."""
    points = some_points(found)
    poses, like = _held_poses(found)
    per_camera = [
        _seen(camera, pose, poses, points, factor * float(noise), len(found.observations.points.position_mm))
        for camera, pose, noise in zip(found.cameras, found.cam_from_rig, found.noise_px, strict=True)
    ]
    sees = np.stack([one[0] for one in per_camera])
    joins = sees.sum(axis=0) >= 2
    return _Held(
        poses[joins], like[joins], sees[:, joins], tuple(one[1][joins] for one in per_camera),
        tuple(one[2][joins] for one in per_camera), np.stack([one[3][joins] for one in per_camera]),
    )  # fmt: skip


def _held_poses(found: RigCalibration) -> tuple[Array, Rows]:
    """Poses of the target (K, 4, 4), and the frame each is turned as in (K,)."""
    middle = found.observations.points.middle_mm
    frames = np.unique(np.linspace(0, len(found.rig_from_target) - 1, TURNS).astype(np.int64))
    places = [np.median(transform(found.rig_from_target, middle), axis=0)]
    for camera, rig_from_cam, seen in zip(found.cameras, found.rig.rig_from_cam, found.observations.frame, strict=True):
        centre = rig_from_cam[:3, 3]
        usual = np.median(np.linalg.norm(transform(found.rig_from_target[seen], middle) - centre, axis=1))
        half = 0.5 * (np.array(camera.image_size) - 1)
        across = np.array([(0, 0), (-1, 0), (1, 0), (0, -1), (0, 1)]) * ACROSS
        ray = camera.rays(half + half * across)
        ray = ray[np.isfinite(ray).all(axis=1)] @ rig_from_cam[:3, :3].T
        places += [centre + times * usual * one for times in (NEARER, 1.0, FARTHER) for one in ray]
    pairs = [(place, frame) for place in places for frame in frames.tolist()]
    most = max(MOST_CANDIDATES // len(found.cameras), FEWEST_CANDIDATES)
    pairs = [pairs[row] for row in few_of_many(len(pairs), most).tolist()]
    turn = found.rig_from_target[[frame for _, frame in pairs], :3, :3]
    shift = np.array([place for place, _ in pairs]) - turn @ middle
    return make_pose(turn, shift), np.array([frame for _, frame in pairs], dtype=np.int64)


def _seen(
    camera: Camera, cam_from_rig: Array, poses: Array, points: KnownPoints, noise_px: float, of: int
) -> tuple[Flags, Array, Array, Array]:
    """Whether a camera sees the target at each place (K,), and the products of its derivatives, of all points.

    Args:
        camera: that looks.
        cam_from_rig: where it stands.
        poses: `rig_from_target` (K, 4, 4).
        points: some of the target's.
        noise_px: of a coordinate.
        of: so many points the target has.
    """
    in_rig = transform(poses[:, None], points.position_mm)
    in_camera = transform(cam_from_rig, in_rig)
    at = linearise(camera, np.ascontiguousarray(in_camera.reshape(-1, 3).T))
    count, size = len(poses), len(points.position_mm)
    pixel = at.pixel.T.reshape(count, size, 2)
    with np.errstate(invalid="ignore"):
        shown = ((pixel > 0) & (pixel < np.array(camera.image_size) - 1)).all(axis=2)
    shown &= that_look(in_camera, cam_from_rig @ poses, points)
    by_point = at.by_point.transpose(2, 0, 1).reshape(count, size, 2, 3)
    by_params = at.by_params.transpose(2, 0, 1).reshape(count, size, 2, -1)
    by_rig = by_point @ cam_from_rig[:3, :3]
    turned = (in_camera - cam_from_rig[:3, 3])[:, :, None], (in_rig - poses[:, None, :3, 3])[:, :, None]
    design = np.concatenate(
        [by_params, np.cross(turned[0], by_point), by_point, np.cross(turned[1], by_rig), by_rig], axis=3
    )
    design = np.where(shown[:, :, None, None], design, 0.0).reshape(count, 2 * size, -1)
    product = design.transpose(0, 2, 1) @ design * (of / size / noise_px**2)
    enough = shown.sum(axis=1) * (of / size) >= FEWEST_SEEN
    product = np.where(enough[:, None, None], product, 0.0)
    return enough, product[:, :-6, :-6], product[:, :-6, -6:], product[:, -6:, -6:]


def _told(found: RigCalibration, held: _Held, row: int, before: Array, after: Array) -> NextFrame:
    """A frame in words."""
    names = found.observations.camera_names
    seeing = np.flatnonzero(held.sees[:, row]).tolist()
    rig, then = (replace(found.rig, covariance=one) for one in (before, after))
    pairs = list(combinations(range(len(names)), 2))
    a, b = max(pairs, key=lambda pair: _share(relative(rig, *pair).place_sigma_mm, relative(rig, *pair).baseline_mm))
    sigma = relative(rig, a, b).place_sigma_mm, relative(then, a, b).place_sigma_mm
    is_rough = any(is_new(found, camera, held.rig_from_target[row]) for camera in seeing)
    then_mm = f"about {figure(sigma[1], 1)} mm if the lenses are as solved" if is_rough else f"{figure(sigma[1], 2)} mm"
    gain = f"the place of {short(names[b])} against {short(names[a])}, 1 sigma, {figure(sigma[0], 2)} -> {then_mm}"
    hold = f"hold the target {_where(found, held.rig_from_target[row], seeing)}"
    turned = f"turned as in {short(found.observations.frame_names[int(held.like_frame[row])])}"
    return NextFrame(
        held.rig_from_target[row], tuple(printable(names[k]) for k in seeing), f"{hold}, {turned}: {gain}",
        (printable(names[a]), printable(names[b])), *sigma,
    )  # fmt: skip


def _share(sigma_mm: float, baseline_mm: float) -> float:
    return sigma_mm / max(baseline_mm, 1e-9)


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
