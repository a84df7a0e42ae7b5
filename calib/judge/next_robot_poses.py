"""The robot's next poses that would tell most of where its camera sits: of many in reach, chosen one after the other.

Candidates are turned as poses of the robot that were used, or by one more turn about an axis of the flange, with the
target at places of the image and distances like those that were used. What one would tell is what
`calib.rigs.carried_information` has for any frame, with the robot's own noise. The next pose is the one after which

    tr(S_turn) d^2 + tr(S_place)

is least, of the covariances of the camera's direction and of its centre, d being the usual distance of the target:
about how badly what the camera sees there is placed on the robot. What the motions so far leave open has a wide prior,
by which a pose that ends that comes first.

Which of a target's points a camera of a rig would see of it, held anywhere.

A few of many candidates that stand in order, without a rhythm that would meet that of the order.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Annotated

import numpy as np

from calib.cameras import project
from calib.cameras.rig import POSE
from calib.core.linear_algebra import symmetric_inverse
from calib.core.parallel import one_thread
from calib.core.se3 import exp_rotation, invert, make_pose, rigid_fault, transform
from calib.core.types import KnownPoints, Observations, RigObservations, frozen_array
from calib.judge.next_view_words import short
from calib.rigs.carried_information import expected_information, frame_information
from calib.rigs.halves import NoRigHalves, RigHalves
from calib.rigs.relative import center_covariance
from calib.rigs.result import CarrierFit, RigCalibration
from calib.rigs.target_error import carrier_prior
from calib.solver.free_shape import free_directions
from designer.base.arrays import Array, Flags, Rows
from designer.base.marks import ONE_LINE, Gap, Length, Shape
from designer.base.words import figure

POINTS = 150
"""Of the target, by which candidates are compared."""
LEAST_SEEN_FACING = 0.34
"""Cosine of the largest angle from which rings are read."""
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


def that_look(in_camera: Array, cam_from_target: Array, points: KnownPoints, least: float = LEAST_SEEN_FACING) -> Flags:
    """Which points (K, S) lie on planes that look at the camera, or on none."""
    if not len(points.plane):
        return np.ones(in_camera.shape[:2], dtype=bool)
    normal = points.plane[points.face, :3] @ cam_from_target[:, :3, :3].transpose(0, 2, 1)
    cosine = -(in_camera * normal).sum(axis=2) / np.maximum(np.linalg.norm(in_camera, axis=2), 1e-9)
    looks: Flags = (cosine > least) | (points.face < 0)
    return looks


def is_new(found: RigCalibration, camera: int, pose: Array) -> bool:
    """Whether a camera would see much of the target where it has seen none of it so far, and knows its lens badly."""
    pixel = found.cameras[camera].project(
        transform(found.cam_from_rig[camera] @ pose, found.observations.points.position_mm)
    )
    seen = found.observations.sightings[camera].center_px
    with np.errstate(invalid="ignore"):
        beyond = ((pixel < seen.min(axis=0)) | (pixel > seen.max(axis=0))).any(axis=1)
    return bool(found.is_refined[camera] and beyond.mean() > NEW_SHARE)


GOLDEN = 0.6180339887498949
"""Its multiples, less their whole parts, fill a circle evenly whatever number of them is taken."""


def few_of_many(count: int, most: int) -> Rows:
    """So many rows of `count` at most, ascending: every so many-th of nested loops would share the inner value."""
    return np.sort(np.argsort((np.arange(count) * GOLDEN) % 1.0, kind="stable")[:most])


MOST_POSES = 5
"""A robot takes a few more in a minute; what is known after them is to be solved before more are chosen by it."""
LITTLE_GAIN = 0.97
"""A pose that leaves more than this of the deviation is not worth taking."""
MOST_CANDIDATES = 1000
MOST_UNKNOWNS = 60
"""Of a camera: those of a lens with a surface, solved with the robot, are hundreds, and would take minutes."""
TURNS = 8
"""Of those that were used, spread over all of them."""
TILTS_RAD = (math.radians(20), math.radians(40))
"""By which a flange is turned more, about each of its axes and both ways."""
ACROSS = 0.5
"""How far towards the sides of an image a target is tried, of its half."""
DISTANCES = (0.8, 1.0, 1.2)
"""Of the one that was usual."""
REACH = 0.35
"""Of the usual distance: so far a flange may be beside the box of where it has been, along the base's axes."""
LEAST_FACING = 0.57
"""Cosine of the largest angle from which rings are read well."""
USUAL_SHARE = 0.5
"""Of the sightings that a frame usually has, which a candidate must have."""
WEAK_RAD = 1.0
"""Standard deviation of turns that nothing tells; of shifts it is the usual distance."""
WEAK_LENS = 1e-3
"""What is known of the lens without any frame, in inverse standard deviations of what is known of it by all."""
KNOWN = 0.3
"""Of what is known of turns and shifts without any frame: what is less sure than this is not determined."""
VAGUE = 0.05
"""Of the usual distance, by which a camera's place is unsure: the target might not be where it is looked for."""


@dataclass(frozen=True, eq=False)
class NextPose:
    """A pose for the robot to take a photo from, and what it would do: `found.next_poses[0].base_from_flange`."""

    base_from_flange: Annotated[Array, Shape(4, 4)]
    sentence: Annotated[str, Length(1, 1000), ONE_LINE]
    turn_sigma_rad_before: Gap  # of the camera's direction, the least known of its axes; nan: not determined
    turn_sigma_rad_after: Gap  # with this pose and those proposed before it
    place_sigma_mm_before: Gap  # of the camera's place, along the least known axis of the frame that it is in
    place_sigma_mm_after: Gap

    def __post_init__(self) -> None:
        object.__setattr__(self, "base_from_flange", frozen_array(self.base_from_flange))
        if fault := rigid_fault(self.base_from_flange[None]):
            raise ValueError(f"base_from_flange {fault[1]}")


@dataclass(frozen=True, eq=False)
class _TriedPoses:
    """K poses of the robot, and what a photo from each would tell."""

    base_from_flange: Array  # (K, 4, 4)
    rig_from_target: Array  # (K, 4, 4)
    like_frame: Rows  # (K,) that it is turned as in
    tilt_rad: Array  # (K, 3) by which it is turned more, about the flange's axes
    shown: Flags  # (K, S) of some points


@one_thread
def next_robot_poses(found: RigCalibration, halves: RigHalves | NoRigHalves) -> tuple[NextPose, ...]:
    """The poses to go to next, the most useful first; none if more do little, or if no robot carries one camera."""
    fit = found.carrier
    if fit is None or found.rig_frame == "table" or len(found.cameras) != 1 or found.status == "stopped":
        return ()
    if not (fit.sigma_rad > 0 and fit.sigma_mm > 0 and (found.noise_px > 0).all()):
        return ()
    points, basis = some_points(found), _directions(found)
    tried = _candidates(found, fit, points)
    if not len(tried.like_frame) or basis.shape[1] > MOST_UNKNOWNS:
        return ()
    told = frame_information(found, basis).sum(axis=0) + _weak(found, basis)
    each = frame_information(_imagined(found, fit, tried, points), basis)
    factor = halves.factor if isinstance(halves, RigHalves) else 1.0
    moves, count = _moves(found, basis), basis.shape[1]
    chosen: list[NextPose] = []
    while len(chosen) < MOST_POSES:
        before, after = symmetric_inverse(told).inverse, symmetric_inverse(told + each).inverse
        least = _badness(moves, after)
        best = int(np.argmin(least))
        if not least[best] <= LITTLE_GAIN * _badness(moves, before[None])[0]:
            break
        sigmas = [_stated(found, factor**2 * basis @ one[:count, :count] @ basis.T) for one in (before, after[best])]
        chosen.append(_told(found, tried, best, *sigmas))
        told = told + each[best]
        each[best] = 0.0  # the same pose again would show what it hides again, too
    return tuple(chosen)


def photo_names(poses: Sequence[NextPose]) -> tuple[str, ...]:
    """What the photos from there are to be called, as in `next_poses.csv`."""
    return tuple(f"next_{number}" for number in range(1, len(poses) + 1))


def poses_in_reach(found: RigCalibration) -> Array:
    """All poses of the robot that are tried: base_from_flange (K, 4, 4)."""
    if found.carrier is None:
        raise ValueError("a rig without a carrier")
    return _candidates(found, found.carrier, some_points(found)).base_from_flange


def rig_from_target_at(found: RigCalibration, base_from_flange: Array) -> Array:
    """Where the target is in the rig's frame when the robot's flange is somewhere.  # (..., 4, 4)"""
    if found.carrier is None:
        raise ValueError("a rig without a carrier")
    carried = invert(base_from_flange) if found.rig_frame == "flange" else base_from_flange
    placed: Array = carried @ found.carrier.carrier_from_target
    return placed


def _directions(found: RigCalibration) -> Array:
    """The unknowns of the camera: its lens's, as far as they were solved, and its pose.  # (N, K)"""
    size = len(found.covariance)
    pose = found.rig.pose_rows(0)
    lens = found.covariance[: pose.start, : pose.start]
    if not np.isfinite(lens).all():
        spread = np.where(np.diagonal(lens) == 0, 0.0, np.maximum(np.abs(found.cameras[0].params), 1.0))
        lens = np.diag(spread**2)
    own = free_directions(lens)
    own = np.concatenate([own, np.zeros((size - len(own), own.shape[1]))])
    return np.concatenate([own, np.eye(size)[:, pose]], axis=1)


def _weak(found: RigCalibration, basis: Array) -> Array:
    """What is taken as known of all unknowns without any frame, as information.  # (Q, Q)"""
    least = expected_information(found, basis.shape[1])
    rows = np.arange(len(least))
    lens = basis.shape[1] - POSE
    pose = np.repeat([WEAK_RAD, _usual_mm(found)], 3) ** -2.0
    least[rows[:lens], rows[:lens]] = WEAK_LENS**2
    least[rows[lens : lens + POSE], rows[lens : lens + POSE]] = pose
    least[rows[-POSE:], rows[-POSE:]] = pose
    return least


def _moves(found: RigCalibration, basis: Array) -> Array:
    """How a camera's direction, times the usual distance, and its centre follow the basis's directions.  # (6, K)"""
    pose = basis[found.rig.pose_rows(0)]
    shift = found.cam_from_rig[0, :3, 3]
    centre = np.cross(shift, pose[:3], axisb=0, axisc=0) + pose[3:]
    return np.concatenate([_usual_mm(found) * pose[:3], centre])


def _badness(moves: Array, covariance: Array) -> Array:
    """The root of what is to be least, of covariances (K, Q, Q).  # (K,)"""
    count = moves.shape[1]
    variance = np.einsum("mi,kij,mj->k", moves, covariance[:, :count, :count], moves)
    return np.asarray(np.sqrt(variance.clip(min=0.0)))


def _stated(found: RigCalibration, noise: Array) -> tuple[float, float]:
    """The sigmas of direction and place as they are told, by a covariance (N, N) of the noise: rad, mm."""
    rows = found.rig.pose_rows(0)
    covariance = noise[rows, rows]
    if found.target_covariance is not None:
        covariance = covariance + found.target_covariance[rows, rows]
    pose = found.cam_from_rig[0]
    place = pose[:3, :3].T @ center_covariance(pose, covariance) @ pose[:3, :3]
    turn_rad, place_mm = (float(np.sqrt(np.diagonal(one).max())) for one in (covariance[:3, :3], place))
    return (
        turn_rad if turn_rad < KNOWN * WEAK_RAD else math.nan,
        place_mm if place_mm < KNOWN * _usual_mm(found) else math.nan,
    )


def _is_vague(found: RigCalibration) -> bool:
    """Whether the camera's place is so unsure that the target might not be where it is looked for."""
    return not _stated(found, found.covariance)[1] < VAGUE * _usual_mm(found)


def _middle(found: RigCalibration) -> Array:
    """Of the target, as large as it was found."""
    size = 1.0 if found.carrier is None else found.carrier.size
    return size * found.observations.points.middle_mm


def _usual_mm(found: RigCalibration) -> float:
    """How far the target was from the camera."""
    seen = transform(found.cam_from_rig[0] @ found.rig_from_target, _middle(found))
    return float(np.median(np.linalg.norm(seen, axis=1)))


def _candidates(found: RigCalibration, fit: CarrierFit, points: KnownPoints) -> _TriedPoses:
    """Poses in reach from which the camera sees about as much of the target as it did."""
    carried = carrier_prior(found)[0].carrier.rig_from_carrier
    used = invert(carried) if found.rig_frame == "flange" else carried
    frames = np.unique(np.linspace(0, len(used) - 1, TURNS).astype(np.int64))
    is_vague = _is_vague(found)
    angles = TILTS_RAD[:1] if is_vague else TILTS_RAD
    tilts = np.concatenate([np.zeros((1, 3)), *(sign * angle * np.eye(3) for angle in angles for sign in (1, -1))])
    seen_at = _places(found, across=0.0 if is_vague else ACROSS)
    frame, tilt, place = (one.ravel() for one in np.indices((len(frames), len(tilts), len(seen_at))))
    like, tilt_rad = frames[frame], tilts[tilt]
    turn = used[like, :3, :3] @ exp_rotation(tilt_rad)
    turned = rig_from_target_at(found, make_pose(turn, np.zeros(3)))[:, :3, :3]
    in_rig = transform(invert(found.cam_from_rig[0]), seen_at[place])
    held = make_pose(turned, in_rig - turned @ _middle(found))
    goal = held @ invert(fit.carrier_from_target)
    goal = invert(goal) if found.rig_frame == "flange" else goal
    shown = _shown(found, held, points)
    usual = np.median([np.bincount(seen.view).max() for seen in found.observations.sightings])
    share = len(found.observations.points.position_mm) / len(points.position_mm)
    good = np.flatnonzero((shown.sum(axis=1) * share >= USUAL_SHARE * usual) & _in_reach(found, goal, used))
    rows = good[few_of_many(len(good), MOST_CANDIDATES)]
    return _TriedPoses(goal[rows], held[rows], like[rows], tilt_rad[rows], shown[rows])


def _places(found: RigCalibration, across: float) -> Array:
    """Where the target's middle is tried, in the camera's frame.  # (K, 3)"""
    half = 0.5 * (np.array(found.cameras[0].image_size) - 1)
    off = np.unique(across * np.array([(0, 0), (-1, 0), (1, 0), (0, -1), (0, 1)]), axis=0)
    ray = found.cameras[0].rays(half + half * off)
    ray = ray[np.isfinite(ray).all(axis=1)]
    places: Array = (np.array(DISTANCES)[:, None, None] * _usual_mm(found) * ray).reshape(-1, 3)
    return places


def _in_reach(found: RigCalibration, goal: Array, used: Array) -> Flags:
    """Which places of the flange are among those where it has been, or not far beside."""
    beside = REACH * _usual_mm(found)
    low, high = used[:, :3, 3].min(axis=0) - beside, used[:, :3, 3].max(axis=0) + beside
    return np.asarray(((goal[:, :3, 3] >= low) & (goal[:, :3, 3] <= high)).all(axis=1))


def _shown(found: RigCalibration, held: Array, points: KnownPoints) -> Flags:
    """Which of some points a photo would show.  # (K, S)"""
    size = 1.0 if found.carrier is None else found.carrier.size
    cam_from_target = found.cam_from_rig[0] @ held
    in_camera = transform(cam_from_target[:, None], size * points.position_mm)
    pixel = project(found.cameras[0], in_camera.reshape(-1, 3)).reshape(*in_camera.shape[:2], 2)
    with np.errstate(invalid="ignore"):
        inside = ((pixel > 0) & (pixel < np.array(found.cameras[0].image_size) - 1)).all(axis=2)
    return np.asarray(inside & that_look(in_camera, cam_from_target, points, LEAST_FACING))


def _imagined(found: RigCalibration, fit: CarrierFit, tried: _TriedPoses, points: KnownPoints) -> RigCalibration:
    """The rig with photos from the tried poses in the place of its own, of a few points that stand for all."""
    view, point = np.nonzero(tried.shown)
    count = len(tried.like_frame)
    names = tuple(map(str, range(count)))
    seen = Observations(found.cameras[0].image_size, names, view, point, np.zeros((len(view), 2)), None, points)
    share = len(found.observations.points.position_mm) / len(points.position_mm)
    return replace(
        found,
        observations=RigObservations(found.observations.camera_names, names, (seen,), (np.arange(count),)),
        rig_from_target=tried.rig_from_target,
        residual_px=(np.zeros((len(view), 2)),),
        is_outlier=(np.zeros(len(view), dtype=bool),),
        scale=found.noise_px / math.sqrt(share),
        weighted=False,
        carrier=replace(fit, error=np.zeros((count, POSE))),
    )


def _told(
    found: RigCalibration, tried: _TriedPoses, row: int, before: tuple[float, float], after: tuple[float, float]
) -> NextPose:
    """A pose in words."""
    name = short(found.observations.frame_names[int(tried.like_frame[row])])
    tilt = np.rad2deg(tried.tilt_rad[row])
    axis = int(np.argmax(np.abs(tilt)))
    pose = tried.base_from_flange[row]
    place = ", ".join(f"{value + 0.0:.1f}" for value in pose[:3, 3].tolist())
    turn = f"rotate the flange {tilt[axis]:.0f} deg about its {'xyz'[axis]} axis" if tilt.any() else "keep its rotation"
    is_rough = _is_vague(found) or is_new(found, 0, tried.rig_from_target[row])
    if_so = " if all is as solved" if is_rough and math.isfinite(after[1]) else ""
    direction = gain_words(math.degrees(before[0]), math.degrees(after[0]), "deg", is_rough=is_rough)
    centre = gain_words(before[1], after[1], "mm", is_rough=is_rough)
    sentence = (
        f"from the pose of {name} {turn} and move it to {place} mm in the base: the camera's direction, 1 sigma, "
        f"{direction}, its place {centre}{if_so}"
    )
    return NextPose(pose, sentence, before[0], after[0], before[1], after[1])


def gain_words(before: float, after: float, unit: str, *, is_rough: bool = False) -> str:
    """Two deviations: "0.031 -> 0.024 deg"."""
    first = figure(before, 2) if math.isfinite(before) else "not determined"
    if not math.isfinite(after):
        return "still not determined"
    return f"{first} -> {f'about {figure(after, 1)}' if is_rough else figure(after, 2)} {unit}"
