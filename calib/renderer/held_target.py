"""Where a target is held before a rig: still poses one after another, or a way along which it moves.

Every frame is meant for one camera in turn, somewhere in its image. Every second is the one of several tries that most
cameras see: so all of each image is used, and cameras are joined wherever they can see a target together.
"""

import math
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np
from scipy.spatial.transform import Rotation, RotationSpline

from calib.cameras import project
from calib.cameras.rig import Rig
from calib.core.se3 import exp_rotation, make_pose, rotation_between, transform
from calib.core.types import LEAST_RADIUS_PX
from calib.renderer.poses import directions_over_image
from calib.renderer.rig_template import HeldTarget
from designer.base.arrays import Array
from designer.base.errors import InputError
from designer.target import TargetGeometry, bounding_radius_mm

if TYPE_CHECKING:
    from scipy.interpolate import CubicSpline

TRIES = 40
SAMPLED_RINGS = 60
LEAST_SEEN = 0.1
"""Of the rings, so many make a camera see the target: of a solid it never sees half."""
CLEAR = 1.2
"""Of the target's radius: nearer than that nobody holds it to any camera."""
MOST_WAYPOINTS = 4096
FASTEST_TURN_RAD_S = 1.0
"""On the way from one pose to the next, on average; a target that is turned far goes the slower."""
LEAST_S = 0.1
JITTER = 0.1
"""Of the largest delay: by which photos of one frame are taken earlier or later besides, as their time stamps say."""


@dataclass(frozen=True, eq=False)
class TargetWay:
    """A smooth way of a target."""

    position_mm: "CubicSpline"
    turn: RotationSpline

    def at(self, time_s: Array) -> Array:
        """`rig_from_target` at times (...).  # (..., 4, 4)"""
        flat = np.ravel(time_s)
        pose = make_pose(self.turn(flat).as_matrix(), np.asarray(self.position_mm(flat)))
        return pose.reshape(*np.shape(time_s), 4, 4)


@dataclass(frozen=True, eq=False)
class HeldFrames:
    """How a target is held in V frames, of which C cameras take photos."""

    rig: Rig  # with the delays of the cameras' clocks, where they are not synchronous
    rig_from_target: Array  # (V, 4, 4) at each frame's time
    as_seen: Array  # (C, V, 4, 4) when each photo was taken
    time_s: Array | None = None  # (V,) of each frame; None: the target stands still in each
    stamp_s: Array | None = None  # (C, V) of each photo


def held_frames(
    rig: Rig, target: TargetGeometry, held: HeldTarget, count: int, delay_s: float, rng: np.random.Generator
) -> HeldFrames:
    """Frames before a rig whose clocks but the first differ by up to `delay_s`; 0: the target stands still in each.

    Raises:
        InputError: as for `held_poses`, or a way that is too long.
    """
    if not delay_s:
        poses = held_poses(rig, target, held, count, rng)
        return HeldFrames(rig, poses, np.broadcast_to(poses, (len(rig.names), *poses.shape)))
    time_s = np.arange(count) / held.rate_hz
    behind_s = rng.uniform(-delay_s, delay_s, len(rig.names))
    behind_s[0] = 0.0
    stamp_s = time_s + JITTER * delay_s * rng.uniform(-1, 1, (len(rig.names), count))
    margin = (1 + JITTER) * delay_s
    way = way_of(rig, target, held, (-margin, float(time_s[-1]) + margin), rng)
    as_seen = way.at(stamp_s - behind_s[:, None])
    return HeldFrames(replace(rig, delay_s=behind_s), way.at(time_s), as_seen, time_s, stamp_s)


def held_poses(rig: Rig, target: TargetGeometry, held: HeldTarget, count: int, rng: np.random.Generator) -> Array:
    """Poses `rig_from_target` (count, 4, 4), one for each frame.

    Raises:
        InputError: a target that does not go between the cameras so near.
    """
    near_mm, radius_mm = held.distance_mm[0], bounding_radius_mm(target)
    if not near_mm > radius_mm:
        raise InputError(
            f"--distance {near_mm:g}mm: the target reaches {radius_mm:.0f}mm from its origin; hold it farther away"
        )
    return np.array([_held_pose(rig, target, held, frame, rng) for frame in range(count)])


def _held_pose(rig: Rig, target: TargetGeometry, held: HeldTarget, frame: int, rng: np.random.Generator) -> Array:
    """Of some tries the first that the frame's camera sees or, every second frame, the one that most cameras see."""
    camera = frame % len(rig.cameras)
    ray = directions_over_image(rig.cameras[camera], TRIES, math.pi, rng)
    rig_from_cam = rig.rig_from_cam[camera]
    place = transform(rig_from_cam, rng.uniform(*held.distance_mm, size=(TRIES, 1)) * ray)
    back = (rig_from_cam[:3, 3] - place) / np.linalg.norm(rig_from_cam[:3, 3] - place, axis=1, keepdims=True)
    turn = _turned_to(back, held.tilt_rad, rng) if target.faces_up else Rotation.random(TRIES, rng=rng).as_matrix()
    pose = make_pose(turn, place)
    share = seen_shares(rig, target, pose)
    away_mm = np.linalg.norm(place[:, None] - rig.center_mm, axis=2).min(axis=1)
    share[away_mm < CLEAR * bounding_radius_mm(target)] = 0
    is_seen = share >= LEAST_SEEN
    for_most = is_seen[:, camera] * (is_seen.sum(axis=1) + share.mean(axis=1))
    chosen = for_most if frame % 2 else is_seen[:, camera]
    return np.asarray(pose[int(np.argmax(chosen)) if chosen.any() else int(np.argmax(share[:, camera]))])


def _turned_to(back: Array, tilt_rad: float, rng: np.random.Generator) -> Array:
    """Turns of a flat target's z axis towards directions (N, 3), off them by up to a tilt, rolled at random."""
    count = len(back)
    roll, side = rng.uniform(-math.pi, math.pi, (2, count, 1))
    tilt = tilt_rad * rng.uniform(size=(count, 1)) * np.hstack([np.cos(side), np.sin(side), np.zeros((count, 1))])
    axis = np.array([0.0, 0.0, 1.0])
    turn: Array = rotation_between(axis, back) @ exp_rotation(tilt) @ exp_rotation(roll * axis)
    return turn


def seen_shares(rig: Rig, target: TargetGeometry, rig_from_target: Array) -> Array:
    """What share of a target's rings each camera sees as large as the detector wants, for poses (N, 4, 4).  # (N, C)"""
    rows = np.unique(np.linspace(0, target.ring_count - 1, SAMPLED_RINGS).astype(int))
    axes = target.target_from_face[target.ring_face[rows], :3, :3]
    # The centre, and a radius along either axis of the face: their images span the ring's.
    radius_mm = target.reach_mm[rows, None]
    point = target.center_mm[rows] + np.stack([0 * axes[..., 0], radius_mm * axes[..., 0], radius_mm * axes[..., 1]])
    shares = []
    for camera, cam_from_rig in zip(rig.cameras, rig.cam_from_rig, strict=True):
        cam_from_target = (cam_from_rig @ rig_from_target)[:, None]
        place = transform(cam_from_target[:, None], point)  # (N, 3, P, 3)
        facing = ((cam_from_target[..., :3, :3] @ axes[..., 2, None])[..., 0] * place[:, 0]).sum(axis=2) < 0
        pixel = project(camera, place)
        inside = ((pixel > -0.5) & (pixel < np.array(camera.image_size) - 0.5)).all(axis=(1, 3))
        minor_px = _minor_axis(pixel[:, 1] - pixel[:, 0], pixel[:, 2] - pixel[:, 0])
        shares.append((inside & facing & (minor_px >= LEAST_RADIUS_PX)).mean(axis=1))
    return np.array(shares).T


def _minor_axis(first: Array, second: Array) -> Array:
    """The semi-minor axis of an ellipse with two conjugate semi-axes (..., 2): the smaller singular value of both."""
    half = 0.5 * (first**2 + second**2).sum(axis=-1)
    area = first[..., 0] * second[..., 1] - first[..., 1] * second[..., 0]
    minor: Array = np.sqrt(np.maximum(half - np.sqrt(np.maximum(half**2 - area**2, 0)), 0))
    return minor


def way_of(
    rig: Rig, target: TargetGeometry, held: HeldTarget, seconds: tuple[float, float], rng: np.random.Generator
) -> TargetWay:
    """A way through poses where the target could be held, from one time to another.

    Raises:
        InputError: as for `held_poses`, or a way that is too long.
    """
    from scipy.interpolate import CubicSpline

    count, needed_s = 4, seconds[1] - seconds[0]
    while True:
        pose = held_poses(rig, target, held, count, rng)
        way_s = np.linalg.norm(np.diff(pose[:, :3, 3], axis=0), axis=1) / held.speed_mm_s
        turn = Rotation.from_matrix(pose[:, :3, :3])
        step_s = np.maximum(np.maximum(way_s, (turn[:-1].inv() * turn[1:]).magnitude() / FASTEST_TURN_RAD_S), LEAST_S)
        if step_s.sum() >= needed_s:
            break
        count *= 2
        if count > MOST_WAYPOINTS:
            raise InputError("the target moves too far to be simulated; ask for fewer frames, or a slower target")
    time_s = seconds[0] + np.concatenate([[0.0], np.cumsum(step_s)])
    return TargetWay(CubicSpline(time_s, pose[:, :3, 3]), RotationSpline(time_s, turn))
