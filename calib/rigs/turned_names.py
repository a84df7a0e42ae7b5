"""Boards that look the same turned, as a chessboard of 10 x 8 squares by half a turn: their points named alike.

One camera alone may name such a board either way in each photo: its lens does not depend on it. Cameras that see it
together must name it alike, and a robot's motions tell how it was turned from one frame to the next.
"""

from collections.abc import Sequence
from dataclasses import replace
from itertools import pairwise

import numpy as np

from calib.cameras.rig import Rig
from calib.core.se3 import exp_rotation, invert, log_rotation, make_pose
from calib.core.types import KnownPoints, RigObservations
from calib.rigs.problem import CameraChoice, Mechanism, RigOptions
from calib.rigs.start import relative_poses, solve_alone
from designer.base.arrays import Array, Rows
from designer.base.errors import InputError
from designer.base.words import printable

MOST_GUESSES = 400
FAR, CLEARLY, PLAIN = 0.3, 3.0, 0.03
"""Of poses, radians and parts of the distance summed: apart from which on they differ; how many times better than any
other the right one suits all frames, and by how much at least."""
REMEDY = (
    "tilt and turn it more from frame to frame, or take a board that tells, such as a ChArUco board or a chessboard "
    "whose columns and rows of squares sum to an odd number"
)


def named_alike(
    observations: RigObservations, cam_from_target: Sequence[Array], carrier: Mechanism | None = None,
    cam_from_rig: Array | None = None,
) -> RigObservations:  # fmt: skip
    """The sightings of a board that looks the same turned, with one name for each of its points.

    Args:
        observations: of which each view may be named turned, as its points say.
        cam_from_target: poses of each camera's views (C,) of (V_c, 4, 4), nan where there is none.
        carrier: what carries the target or the cameras, if something does.
        cam_from_rig: where the cameras stand, if it is known.  # (C, 4, 4)

    Raises:
        InputError: it cannot be told how it was turned.
    """
    points = observations.points
    if points.turned is None:
        return observations
    turns, count = turns_of(points), observations.frame_count
    pose = np.full((observations.camera_count, count, 4, 4), np.nan)
    for own, frames, poses in zip(pose, observations.frame, cam_from_target, strict=True):
        own[frames] = poses
    chosen = _of_cameras(observations, pose, turns, cam_from_rig)
    if carrier is not None or observations.time_s is not None:
        first = np.argmax(np.isfinite(pose[:, :, 0, 0]), axis=0)
        at = np.arange(count)
        frames = pose[first, at] @ turns[-chosen[first, at] % len(turns)]
        chosen = (chosen + _of_frames(observations, frames, turns, carrier)) % len(turns)
    sightings, said = [], list(observations.remarks)
    for name, seen, rows, own in zip(
        observations.camera_names, observations.sightings, observations.frame, chosen, strict=True
    ):
        turn = own[rows]
        point = points.turned[turn[seen.view], seen.point]
        sightings.append(replace(seen, point=point, points=replace(seen.points, turned=None)))
        if turn.any():
            said.append(
                f"{printable(name)}: in {np.count_nonzero(turn)} of {len(turn)} photos the board is named turned "
                "against what its detection took, as all photos together tell"
            )
    return replace(observations, sightings=tuple(sightings), remarks=tuple(said))


def named_by_rig(observations: RigObservations, rig: Rig) -> RigObservations:
    """The same before the cameras of a rig that is known, by the poses that each of them tells."""
    if observations.points.turned is None:
        return observations
    rows = [rig.row(name) for name in observations.camera_names]
    choices = [CameraChoice(rig.cameras[row].model, rig.cameras[row], is_refined=False) for row in rows]
    each = zip(observations.sightings, observations.camera_names, choices, strict=True)
    alone = [solve_alone(seen, name, choice, RigOptions()).cam_from_target for seen, name, choice in each]
    return named_alike(observations, alone, cam_from_rig=rig.cam_from_rig[rows])


def turned_in_rig(
    points: KnownPoints, cam_from_rig: Array, cam_from_target: Sequence[Array | None]
) -> list[tuple[Rows, Array]]:
    """For each camera of a frame: the points by their names there, and the motion that its pose is to be followed by.

    Args:
        points: of the target.
        cam_from_rig: where the cameras that see it stand.  # (C, 4, 4)
        cam_from_target: poses by each camera alone; None: it tells none.
    """
    same = np.arange(len(points.position_mm)), np.eye(4)
    if points.turned is None:
        return [same] * len(cam_from_rig)
    back = turns_of(points)[-np.arange(len(points.turned)) % len(points.turned)]
    found, first = [], None
    for where, pose in zip(cam_from_rig, cam_from_target, strict=True):
        turn = 0
        if pose is not None:
            guess = invert(where) @ pose @ back
            first = guess[0] if first is None else first
            turn = int(_apart(guess, first, guess).argmin())
        found.append((points.turned[turn], back[turn]))
    return found


def turns_of(points: KnownPoints) -> Array:
    """The motions of the target that bring it on itself, the first of which is none.  # (K, 4, 4)"""
    assert points.turned is not None  # noqa: S101 - who calls has looked
    count, middle = len(points.turned), points.position_mm.mean(axis=0)
    angle = 2 * np.pi / count * np.arange(count)
    turn = exp_rotation(angle[:, None] * points.plane[0, :3])
    return make_pose(turn, middle - turn @ middle)


def _of_cameras(observations: RigObservations, pose: Array, turns: Array, cam_from_rig: Array | None) -> Rows:
    """How each camera's views (C, V) are turned against those of the first that sees the frame."""
    count = len(pose)
    known = np.isfinite(pose[:, :, 0, 0])
    chosen, placed = np.zeros(known.shape, dtype=np.int64), set[int]()
    where = np.tile(np.eye(4), (count, 1, 1)) if cam_from_rig is None else cam_from_rig
    rig_from_target = np.full(pose.shape[1:], np.nan)
    while len(placed) < count:
        has = np.isfinite(rig_from_target[:, 0, 0])
        new = max(set(range(count)) - placed, key=lambda one: (int((known[one] & has).sum()), int(known[one].sum())))
        both = np.flatnonzero(known[new] & has)
        if len(both):
            guess = pose[new][both][:, None] @ turns[-np.arange(len(turns)) % len(turns)]  # (V, K, 4, 4)
            there = np.broadcast_to(rig_from_target[both][:, None], guess.shape)
            if cam_from_rig is None:
                few = np.unique(np.linspace(0, len(both) - 1, MOST_GUESSES // len(turns)).astype(int))
                where[new] = _likeliest(observations, new, guess[few], there[few])
            apart = _apart(guess @ invert(there), where[new], there)
            chosen[new, both] = apart.argmin(axis=1)
        own = known[new] & ~has
        rig_from_target[own] = invert(where[new]) @ pose[new][own]
        placed.add(new)
    return chosen


def _apart(guess: Array, pose: Array, there: Array) -> Array:
    """How far poses (V, K) are from one: radians and parts of the distance."""
    turn = np.linalg.norm(log_rotation(guess[..., :3, :3] @ pose[:3, :3].T), axis=-1)
    far = np.median(np.linalg.norm(there[..., :3, 3], axis=-1))
    way = np.linalg.norm(guess[..., :3, 3] - pose[:3, 3], axis=-1) / max(float(far), 1e-9)
    return np.asarray(turn + way)


def _likeliest(observations: RigObservations, camera: int, guess: Array, there: Array) -> Array:
    """The pose of a camera that suits all frames, each turned as it suits best.  # (V, K, 4, 4) twice -> (4, 4)"""
    frames, ways = guess.shape[:2]
    between, apart = relative_poses(guess.reshape(-1, 4, 4), there.reshape(-1, 4, 4))
    misfit = np.median(apart.reshape(-1, frames, ways).min(axis=2), axis=1)
    best = int(misfit.argmin())
    others = misfit[apart[best] > FAR]
    if len(others) and others.min() < CLEARLY * misfit[best] + PLAIN:
        name = printable(observations.camera_names[camera])
        raise InputError(
            f"camera {name}: the board looks the same turned, and the {frames} frames that it shares with others do "
            f"not tell how it was turned: {REMEDY}"
        )
    return np.asarray(between[best])


def _of_frames(observations: RigObservations, pose: Array, turns: Array, carrier: Mechanism | None) -> Rows:
    """How frames are turned against the first: by a carrier's turns between any two, else each as the one before it."""
    known = np.flatnonzero(np.isfinite(pose[:, 0, 0]))
    chosen = np.zeros(len(pose), dtype=np.int64)
    ways = np.arange(len(turns))
    back = turns[-ways % len(turns)]
    if carrier is None or carrier.has_free_angles:
        for before, frame in pairwise(known.tolist()):
            last = pose[before] @ back[chosen[before]]
            chosen[frame] = int(_angle(pose[frame] @ back @ invert(last)).argmin())
        return chosen
    told = carrier.rig_from_mechanism[known]
    told = _angle(told[:, None] @ invert(told))
    own = np.stack([_angle((pose[known] @ turn)[:, None] @ invert(pose[known])) for turn in back], axis=2)
    misfit = np.abs(own - told[:, :, None])  # of each pair of frames, turned by so much against each other
    misfit[np.diag_indices(len(known))] = np.nan
    turn, done = np.zeros(len(known), dtype=np.int64), [0]
    while len(done) < len(known):
        left = [row for row in range(len(known)) if row not in set(done)]
        cost = _cost(misfit, turn, np.array(left), np.array(done))
        surest = int(np.ptp(cost, axis=1).argmax())
        turn[left[surest]] = int(cost[surest].argmin())
        done.append(left[surest])
    every = np.arange(len(known))
    cost = np.sort(_cost(misfit, turn, every, every), axis=1)
    # Of a frame that is far off either way a robot's pose is wrong, which is told later.
    if len(known) > 1 and (unsure := np.flatnonzero(cost[:, 1] - cost[:, 0] < PLAIN)).size:
        name = printable(observations.frame_names[known[unsure[0]]])
        raise InputError(
            f"{name}: the board looks the same turned, and the robot's poses do not tell how it was turned there: "
            f"{REMEDY}"
        )
    chosen[known] = turn
    return chosen


def _cost(misfit: Array, turn: Rows, rows: Rows, others: Rows) -> Array:
    """What each way to turn some frames leaves over against others, the median.  # (N, K)"""
    ways = misfit.shape[2]
    against = (np.arange(ways)[:, None] - turn[others]) % ways  # (K, M)
    return np.asarray(np.nanmedian(misfit[rows[:, None, None], others, against], axis=2))


def _angle(pose: Array) -> Array:
    return np.asarray(np.linalg.norm(log_rotation(pose[..., :3, :3]), axis=-1))
