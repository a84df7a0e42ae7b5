"""How cameras of a rig stand to each other, and how surely: what does not depend on whose frame the rig's is.

How well a rig places a point in the middle of what its cameras saw: by noise, and by the rig itself.

Of one camera on a robot, or before a turntable, it is the target as a photo shows it: by the camera's pose there, and
by its lens. Both are off together, as by a principal point that a turned camera makes up for.

One place stands for the volume; `calib budget` maps all of it.

Two solutions of one rig compared: how cameras stand to each other, and where the two place the same points.

Points all over the volume that the first rig works in are seen by it; the second places them by the same pixels. Then
the two frames are laid over each other, so that what differs is of the rigs and not of whose frame they have.
"""

import math
from dataclasses import dataclass
from itertools import combinations

import numpy as np

from calib.cameras.rig import POSE, Rig, keep_cameras
from calib.core.linear_algebra import symmetric_inverse
from calib.core.se3 import compose, invert, log_rotation, make_pose, nearest_rotation, skew, transform
from calib.rigs.result import RigCalibration
from calib.rigs.target_error import posed_frames, tells_size
from calib.solver.free_shape import PosedSightings, free_directions
from calib.space.budget import expected_errors
from calib.space.propagate import PointSightings
from calib.space.triangulate import triangulate_points
from calib.space.volume import default_volume, seen_by_cameras
from designer.base.arrays import Array, Flags, Rows
from designer.base.errors import InputError
from designer.base.marks import Gap

SURELY = 3.0
"""Standard deviations from zero beyond which a length or an angle has a direction, along which its own is told."""


@dataclass(frozen=True, eq=False)
class Relative:
    """Camera B as camera A sees it."""

    b_from_a: Array  # (4, 4)
    covariance: Array  # (6, 6) of it: rotation vector (rad), shift (mm), in B's axes
    center_covariance_mm2: Array  # (3, 3) of B's centre in A's frame, in B's axes

    @property
    def baseline_mm(self) -> float:
        """The distance of the two centres."""
        return float(np.linalg.norm(self.b_from_a[:3, 3]))

    @property
    def baseline_sigma_mm(self) -> float:
        """Its standard deviation; of two centres that may coincide, that along the least known direction."""
        return _sigma_of_length(self.b_from_a[:3, 3], self.covariance[3:, 3:])

    @property
    def angle_rad(self) -> float:
        """By which one is turned against the other, 0 to pi."""
        return float(np.linalg.norm(log_rotation(self.b_from_a[:3, :3])))

    @property
    def angle_sigma_rad(self) -> float:
        """Its standard deviation; of two that may not be turned, that about the least known axis."""
        return _sigma_of_length(log_rotation(self.b_from_a[:3, :3]), self.covariance[:3, :3])

    @property
    def turn_sigma_rad(self) -> float:
        """Of the rotation, about the least known axis."""
        return worst(self.covariance[:3, :3])[0]

    @property
    def place_sigma_mm(self) -> float:
        """Of B's centre in A's frame, along the least known direction."""
        return worst(self.center_covariance_mm2)[0]


def relative(rig: Rig, a: int, b: int) -> Relative:
    """Camera b against camera a, by the rig's joint covariance; nan where that is not known."""
    b_from_a = compose(rig.cam_from_rig[b], invert(rig.cam_from_rig[a]))
    covariance = np.full((6, 6), np.nan)
    if rig.covariance is not None:
        rows, jacobian = relative_motion(rig, a, b)
        covariance = jacobian @ rig.covariance[np.ix_(rows, rows)] @ jacobian.T
    return Relative(b_from_a, covariance, center_covariance(b_from_a, covariance))


def relative_motion(rig: Rig, a: int, b: int) -> tuple[Rows, Array]:
    """How the cameras' poses, rows (12,) of the covariance, turn and shift camera b against camera a.  # (6, 12)

    w = w_b - R w_a and s = s_b - R s_a + (R t_a) x w, with R of b_from_a.
    """
    turn = compose(rig.cam_from_rig[b], invert(rig.cam_from_rig[a]))[:3, :3]
    jacobian = np.zeros((6, 12))
    jacobian[:3, :3], jacobian[:3, 6:9] = -turn, np.eye(3)
    jacobian[3:, 3:6], jacobian[3:, 9:] = -turn, np.eye(3)
    jacobian[3:] += skew(turn @ rig.cam_from_rig[a, :3, 3]) @ jacobian[:3]
    return np.r_[rig.pose_rows(a), rig.pose_rows(b)], jacobian


def center_motion(cam_from_other: Array) -> Array:
    """How a camera's centre moves in another frame, in the camera's axes: by `-s - t x w`.  # (3, 6)"""
    return np.concatenate([-skew(cam_from_other[:3, 3]), -np.eye(3)], axis=1)


def center_covariance(cam_from_other: Array, covariance: Array) -> Array:
    """Of where a camera is in another frame, in the camera's axes.  # (3, 3)"""
    jacobian = center_motion(cam_from_other)
    moved: Array = jacobian @ covariance @ jacobian.T
    return moved


def center_sigma_mm(rig: Rig) -> Array:
    """Of where the cameras are, along the axes of the rig's frame; 0 of the camera whose frame it is.  # (C, 3)"""
    sigma = np.full((len(rig.names), 3), np.nan)
    if rig.covariance is not None:
        for row, pose in enumerate(rig.cam_from_rig):
            rows = rig.pose_rows(row)
            in_camera = center_covariance(pose, rig.covariance[rows, rows])
            sigma[row] = np.sqrt(np.diagonal(pose[:3, :3].T @ in_camera @ pose[:3, :3]).clip(min=0.0))
    return sigma


def worst(covariance: Array) -> tuple[float, Array]:
    """The largest standard deviation of a covariance (N, N), and along which unit vector (N,); nan if not known."""
    if not np.isfinite(covariance).all():
        return float("nan"), np.full(len(covariance), np.nan)
    value, axis = np.linalg.eigh(0.5 * (covariance + covariance.T))
    return float(np.sqrt(max(value[-1], 0.0))), axis[:, -1]


def _sigma_of_length(vector: Array, covariance: Array) -> float:
    """Of a vector's length; beyond doubt it has a direction, else any may be meant."""
    length: float = float(np.linalg.norm(vector))
    most = worst(covariance)[0]
    if not length > SURELY * most:
        return most
    unit = vector / length
    return float(np.sqrt(np.maximum(unit @ covariance @ unit, 0.0)))


@dataclass(frozen=True, eq=False)
class MiddleError:
    """Of one point, in the rig's frame."""

    point_mm: Array  # (3,)
    away_mm: float  # from the nearest camera that sees it
    cameras: tuple[int, ...]  # that see it
    noise_mm: float  # root mean square length of its error, by the noise of one sighting a camera
    rig_mm: float  # likewise by what the rig is off

    @property
    def sigma_mm(self) -> float:
        """Both together."""
        return math.hypot(self.noise_mm, self.rig_mm)


def middle_error(found: RigCalibration) -> MiddleError | None:
    """The expected error of a triangulated point in the middle of all held targets; None if not two cameras see it."""
    rig = found.rig
    middle = np.median(transform(found.rig_from_target, found.observations.points.middle_mm), axis=0)
    if len(rig.names) < 2 or not (found.noise_px > 0).all():
        return None
    expected = expected_errors(rig, middle[None], found.noise_px)
    by_rig = expected.calibration_mm2
    if by_rig is None or not np.isfinite(expected.covariance_mm2).all():
        return None
    seeing = np.flatnonzero(seen_by_cameras(rig, middle[None])[0])
    away_mm = float(np.linalg.norm(rig.center_mm[seeing] - middle, axis=1).min())
    noise_mm, rig_mm = (math.sqrt(float(np.trace(part[0]))) for part in (expected.noise_mm2, by_rig))
    return MiddleError(middle, away_mm, tuple(seeing.tolist()), noise_mm, rig_mm)


@dataclass(frozen=True)
class CarriedError:
    """Of what one camera sees, in the frame of what carries it."""

    away_mm: float  # from the camera
    sigma_mm: float  # root mean square length of its error, by the camera's lens and pose there; nan: not determined


def carried_error(found: RigCalibration) -> CarriedError | None:
    """Of the target's middle, over all photos; None without a carrier, or of several cameras.

    A photo's pose of the target follows the lens, by least squares; its own noise is left out.
    """
    if found.carrier is None or len(found.cameras) != 1:
        return None
    frames, middle_mm = found.observations.frame[0], found.carrier.size * found.observations.points.middle_mm
    seen = transform(found.cam_from_rig[0] @ found.rig_from_target[frames], middle_mm)
    away_mm = float(np.linalg.norm(np.median(seen, axis=0)))
    if not np.isfinite(found.stated_covariance).all():
        return CarriedError(away_mm, math.nan)
    basis = free_directions(found.stated_covariance)
    wide = np.concatenate([basis, np.zeros((len(basis), POSE + tells_size(found)))], axis=1)
    lever_mm = found.rig_from_target[:, :3, :3] @ middle_mm
    square = sum(
        float((_point_moves(photo, lever_mm[frame])[:, : basis.shape[1]] ** 2).sum())
        for frame, photo in zip(frames.tolist(), posed_frames(found, wide, frames), strict=True)
    )
    return CarriedError(away_mm, math.sqrt(square / len(frames)))


def _point_moves(photo: PosedSightings, lever_mm: Array) -> Array:
    """How a point moves in the rig's frame with each unknown of the camera, the target's pose following.  # (3, Q)"""
    by_pose, by_camera = photo.by_pose.reshape(-1, POSE), photo.by_camera.reshape(2 * len(photo.point), -1)
    follows = -symmetric_inverse(by_pose.T @ by_pose).inverse @ (by_pose.T @ by_camera)
    moved: Array = follows[3:] - skew(lever_mm) @ follows[:3]
    return moved


LATTICE = (16, 12, 12)
FEWEST = 10
"""Points from which something can be told."""


@dataclass(frozen=True)
class PairDifference:
    """What differs between two rigs of how camera b stands to camera a."""

    a: str
    b: str
    baseline_mm: tuple[float, float]  # in the first rig, and in the second
    baseline_sigma_mm: Gap  # of the difference, if the two are independent; nan: one of them does not know
    place_mm: float  # of b's centre in a's frame
    turn_rad: float  # of b's rotation against a's


@dataclass(frozen=True)
class CameraApart:
    """How far apart the two rigs see the same points in one camera; nan where they show none."""

    name: str
    rms_px: Gap
    max_px: Gap


@dataclass(frozen=True)
class PlacedApart:
    """How far apart two rigs place the points of a volume, their frames laid over each other."""

    volume: str  # in words
    points: int
    rms_mm: float
    max_mm: float
    scale: float  # by which lengths of the second are longer, less 1
    cameras: tuple[CameraApart, ...]


@dataclass(frozen=True)
class RigDifference:
    """What differs between two rigs of the same cameras, which are known by their names."""

    cameras: tuple[str, ...]  # of both
    only: tuple[tuple[str, ...], tuple[str, ...]]  # cameras of the first alone, and of the second
    pairs: tuple[PairDifference, ...]
    placed: PlacedApart | None  # None: no two cameras see the same points


def compare_rigs(first: Rig, second: Rig) -> RigDifference:
    """What differs from one rig to another.

    Raises:
        InputError: they share no two cameras, or one that has another image size.
    """
    names = tuple(name for name in first.names if name in second.names)
    if len(names) < 2:
        raise InputError(
            f"of cameras {', '.join(first.names)} and {', '.join(second.names)} not two have the same names; "
            "give two rigs of the same cameras"
        )
    both = (
        keep_cameras(first, [first.row(name) for name in names]),
        keep_cameras(second, [second.row(n) for n in names]),
    )
    for name, a, b in zip(names, both[0].cameras, both[1].cameras, strict=True):
        if a.image_size != b.image_size:
            sizes = " and ".join(f"{one.image_size[0]} x {one.image_size[1]} px" for one in (a, b))
            raise InputError(f"camera {name}: has images of {sizes}; give two rigs of the same cameras")
    only = tuple(tuple(name for name in rig.names if name not in names) for rig in (first, second))
    pairs = tuple(_pair(*both, a, b) for a, b in combinations(range(len(names)), 2))
    return RigDifference(names, (only[0], only[1]), pairs, _placed(*both))


def _pair(first: Rig, second: Rig, a: int, b: int) -> PairDifference:
    one, other = relative(first, a, b), relative(second, a, b)
    centers = [invert(pair.b_from_a)[:3, 3] for pair in (one, other)]
    turn = log_rotation(other.b_from_a[:3, :3] @ one.b_from_a[:3, :3].T)
    return PairDifference(
        first.names[a], first.names[b], (one.baseline_mm, other.baseline_mm),
        float(np.hypot(one.baseline_sigma_mm, other.baseline_sigma_mm)),
        float(np.linalg.norm(centers[1] - centers[0])), float(np.linalg.norm(turn)),
    )  # fmt: skip


def _placed(first: Rig, second: Rig) -> PlacedApart | None:
    """Where the second rig places what the first sees."""
    try:
        volume = default_volume(first, 2)
    except InputError:
        return None
    point = volume.lattice(LATTICE)
    point = point[volume.holds(point)]
    seen = seen_by_cameras(first, point)
    point, seen = point[seen.sum(axis=1) >= 2], seen[seen.sum(axis=1) >= 2]
    found = _placed_by(first, second, point, seen)
    is_placed = np.isfinite(found).all(axis=1)
    point, found, seen = point[is_placed], found[is_placed], seen[is_placed]
    if len(point) < FEWEST:
        return None
    middle, other = point.mean(axis=0), found.mean(axis=0)
    turn = nearest_rotation((found - other).T @ (point - middle))
    second_from_first = make_pose(turn, other - turn @ middle)
    off = found - transform(second_from_first, point)
    spread = [np.linalg.norm(one - one.mean(axis=0)) for one in (point, found)]
    distance = np.linalg.norm(off, axis=1)
    return PlacedApart(
        volume.words, len(point), float(np.sqrt(np.mean(distance**2))), float(distance.max()),
        float(spread[1] / spread[0] - 1), _apart_px(first, second, second_from_first, point, seen),
    )  # fmt: skip


def _placed_by(first: Rig, second: Rig, point: Array, seen: Flags) -> Array:
    """Where the second rig sees points (N, 3) in the pixels of the first; nan where it does not.  # (N, 3)"""
    place, camera = np.nonzero(seen)
    pixel = np.empty((len(place), 2))
    for row, (one, pose) in enumerate(zip(first.cameras, first.cam_from_rig, strict=True)):
        pixel[camera == row] = one.project(transform(pose, point[place[camera == row]]))
    rows = np.arange(len(point))
    sightings = PointSightings(
        ("lattice",), tuple(map(str, rows.tolist())), np.zeros_like(rows), rows, camera, place, pixel
    )
    return triangulate_points(second, sightings, np.ones(len(second.names))).position_mm


def _apart_px(first: Rig, second: Rig, second_from_first: Array, point: Array, seen: Flags) -> tuple[CameraApart, ...]:
    """How far apart the rigs see points (N, 3) of the first's frame, camera by camera."""
    result = []
    for row, name in enumerate(first.names):
        shown = point[seen[:, row]]
        one = first.cameras[row].project(transform(first.cam_from_rig[row], shown))
        pose = compose(second.cam_from_rig[row], second_from_first)
        off = np.linalg.norm(second.cameras[row].project(transform(pose, shown)) - one, axis=1)
        off = off[np.isfinite(off)]
        rms, most = (float(np.sqrt(np.mean(off**2))), float(off.max())) if len(off) else (np.nan, np.nan)
        result.append(CameraApart(name, rms, most))
    return tuple(result)
