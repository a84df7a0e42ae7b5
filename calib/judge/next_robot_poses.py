"""The robot's next poses that would tell most of where its camera sits: of many in reach, chosen one after the other.

Candidates are turned as poses of the robot that were used, or by one more turn about an axis of the flange, with the
target at places of the image and distances like those that were used. What one would tell is what
`calib.rigs.target_error` has for any frame, with the robot's own noise. The next pose (`calib.judge.greedy`)
is the one after which

    tr(S_turn) d^2 + tr(S_place)

is least, of the covariances of the camera's direction and of its centre, d being the usual distance of the target:
about how badly what the camera sees there is placed on the robot. What the motions so far leave open has a wide prior,
by which a pose that ends that comes first.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from calib.cameras.rig import POSE
from calib.core.linear_algebra import pseudo_inverse, symmetric_inverse
from calib.core.parallel import one_thread
from calib.core.se3 import exp_rotation, invert, make_pose, transform
from calib.core.types import KnownPoints
from calib.judge.greedy import InformativeCandidates, KnownAfter
from calib.judge.halves import NoHalves, RigHalves
from calib.judge.next_frames import (
    AROUND,
    CandidateFrames,
    few_of_many,
    is_new,
    shown_at,
    sights,
    some_points,
    told_by_candidates,
)
from calib.judge.next_view_words import short
from calib.judge.verdict import MOST_POSES, NextPose
from calib.rigs.relative import center_motion, center_sigma_mm
from calib.rigs.result import MechanismFit, RigCalibration
from calib.rigs.target_error import expected_information, frame_information, mechanism_prior
from calib.solver.free_shape import free_directions
from designer.base.arrays import Array
from designer.base.words import figure

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
class _CandidatePoses(CandidateFrames):
    """K poses of the robot, and what a photo from each would show."""

    base_from_flange: Array  # (K, 4, 4)
    tilt_rad: Array  # (K, 3) by which it is turned more than in that frame, about the flange's axes


@one_thread
def next_robot_poses(found: RigCalibration, halves: RigHalves | NoHalves) -> tuple[NextPose, ...]:
    """The poses to go to next, the most useful first; none if more do little, or if no robot carries one camera."""
    fit = found.carrier
    if fit is None or found.rig_frame == "table" or len(found.cameras) != 1 or found.status == "stopped":
        return ()
    if not (fit.sigma_rad > 0 and fit.sigma_mm > 0 and (found.noise_px > 0).all()):
        return ()
    points, basis = some_points(found), _directions(found)
    tried, count = _candidates(found, fit, points), basis.shape[1]
    if not len(tried.like_frame) or count > MOST_UNKNOWNS:
        return ()
    told = _known(found, basis)
    each = told_by_candidates(found, basis, tried, points)
    # The camera's direction, times the usual distance, and its centre.
    pose, moves = basis[found.rig.pose_rows(0)], np.zeros((1, POSE, len(told)))
    moves[0, :3, :count] = _usual_mm(found) * pose[:3]
    moves[0, 3:, :count] = center_motion(found.cam_from_rig[0]) @ pose
    candidates = InformativeCandidates.by(each, np.ones(each.shape[:2], dtype=np.bool_))
    steps = candidates.chosen(symmetric_inverse(told).inverse, moves, MOST_POSES)

    def stated(known: KnownAfter) -> tuple[float, float]:
        return _stated(found, halves.factor**2 * basis @ known.covariance[:count, :count] @ basis.T)

    return tuple(_told(found, tried, one.choice, stated(one.before), stated(one.after)) for one in steps)


def photo_names(poses: Sequence[NextPose]) -> tuple[str, ...]:
    """What the photos from there are to be called, as in `next_poses.csv`."""
    return tuple(f"next_{number}" for number in range(1, len(poses) + 1))


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


def _known(found: RigCalibration, basis: Array) -> Array:
    """What the frames tell of all unknowns, and of the camera what is stated, as information.  # (Q, Q)

    With what is known of parameters, and with what a bend of the target leaves open.
    """
    weak, own = _weak(found, basis), slice(basis.shape[1])
    told: Array = frame_information(found, basis).sum(axis=0) + weak
    if np.isfinite(found.covariance).all():
        to_basis = pseudo_inverse(basis)
        stated = to_basis @ found.covariance @ to_basis.T
        by_frames = symmetric_inverse(symmetric_inverse(told).inverse[own, own]).inverse
        told[own, own] += symmetric_inverse(stated).inverse - by_frames + weak[own, own]
    return told


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


def _stated(found: RigCalibration, noise: Array) -> tuple[float, float]:
    """The sigmas of direction and place as they are told, by a covariance (N, N) of the noise: rad, mm."""
    covariance = noise if found.target_covariance is None else noise + found.target_covariance
    rig = replace(found.rig, covariance=covariance)
    turn_rad = math.sqrt(np.diagonal(covariance)[rig.pose_rows(0)][:3].max())
    place_mm = float(center_sigma_mm(rig)[0].max())
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


def _candidates(found: RigCalibration, fit: MechanismFit, points: KnownPoints) -> _CandidatePoses:
    """Poses in reach from which the camera sees about as much of the target as it did."""
    carried = mechanism_prior(found)[0].carrier.rig_from_mechanism
    used = invert(carried) if found.rig_frame == "flange" else carried
    frames = np.unique(np.linspace(0, len(used) - 1, TURNS).astype(np.int64))
    is_vague = _is_vague(found)
    angles = TILTS_RAD[:1] if is_vague else TILTS_RAD
    tilts = np.concatenate([np.zeros((1, 3)), *(sign * angle * np.eye(3) for angle in angles for sign in (1, -1))])
    # Where the target's middle is tried, in the camera's frame.
    ray = sights(found.cameras[0], np.unique((0.0 if is_vague else ACROSS) * AROUND, axis=0))
    seen_at = (np.array(DISTANCES)[:, None, None] * _usual_mm(found) * ray).reshape(-1, 3)
    frame, tilt, place = (one.ravel() for one in np.indices((len(frames), len(tilts), len(seen_at))))
    like, tilt_rad = frames[frame], tilts[tilt]
    turn = used[like, :3, :3] @ exp_rotation(tilt_rad)
    turned = rig_from_target_at(found, make_pose(turn, np.zeros(3)))[:, :3, :3]
    in_rig = transform(invert(found.cam_from_rig[0]), seen_at[place])
    held = make_pose(turned, in_rig - turned @ _middle(found))
    goal = held @ invert(fit.carrier_from_target)
    goal = invert(goal) if found.rig_frame == "flange" else goal
    shown = shown_at(found, 0, held, points, LEAST_FACING)
    usual = np.median([np.bincount(seen.view).max() for seen in found.observations.sightings])
    share = len(found.observations.points.position_mm) / len(points.position_mm)
    beside, flange = REACH * _usual_mm(found), used[:, :3, 3]
    low, high = flange.min(axis=0) - beside, flange.max(axis=0) + beside
    is_in_reach = ((goal[:, :3, 3] >= low) & (goal[:, :3, 3] <= high)).all(axis=1)
    good = np.flatnonzero((shown.sum(axis=1) * share >= USUAL_SHARE * usual) & is_in_reach)
    rows = good[few_of_many(len(good), MOST_CANDIDATES)]
    return _CandidatePoses(held[rows], like[rows], shown[None, rows], goal[rows], tilt_rad[rows])


def _told(
    found: RigCalibration, tried: _CandidatePoses, row: int, before: tuple[float, float], after: tuple[float, float]
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
