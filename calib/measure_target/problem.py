"""Observations of one printed target by several cameras, packed for the kernels.

Cameras that are held together while they look at a print: poses of frames and cameras instead of one a photo.

Equations over photos become equations over frames and cameras as `calib.solver.eliminate` says, with the rings'
couplings.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from calib.cameras.camera import Camera
from calib.core.types import Observations
from calib.measure_target.unknowns import TargetUnknowns, Unknowns
from calib.solver.eliminate import Chain, Normal, through_camera
from calib.solver.levenberg import move_poses
from calib.solver.problem import Problem, Tie, pack
from designer.base.arrays import Array, Flags, Rows


@dataclass(frozen=True, eq=False)
class HeldCameras:
    """Which photos were taken at once, and where each camera's pose stands among the shared unknowns."""

    frame: tuple[Rows, ...]  # (C,) of (V_c,): the frame of each view
    frame_count: int
    pose: tuple[Rows, ...]  # (C,) of (6,): places; -1: the rig's frame is this camera's


@dataclass(frozen=True, eq=False)
class HeldPoses:
    """Where cameras and target are."""

    cam_from_rig: Array  # (C, 4, 4)
    rig_from_target: Array  # (V, 4, 4)

    def seen(self, held: HeldCameras) -> tuple[Array, ...]:
        """What each camera sees: `cam_from_target` (V_c, 4, 4) of its views."""
        pairs = zip(self.cam_from_rig, held.frame, strict=True)
        return tuple(pose @ self.rig_from_target[frames] for pose, frames in pairs)


def chains_of(held: HeldCameras, poses: HeldPoses) -> list[Chain]:
    """What steps of frames and cameras do to the pose of each photo."""
    chains = []
    for frame, column, cam_from_rig in zip(held.frame, held.pose, poses.cam_from_rig, strict=True):
        chains.append(Chain(frame, *through_camera(cam_from_rig, poses.rig_from_target[frame]), column))
    return chains


def over_frames(normal: Normal, chains: Sequence[Chain], frame_count: int) -> Normal:
    """The equations over photos, one camera's after another's, as equations over frames and cameras."""
    others = len(normal.other)
    pose, pose_row = np.zeros((frame_count, 6, 6)), np.zeros((frame_count, 6, others + 1))
    other, rings = normal.other.copy(), len(normal.ring)
    ring_row = np.zeros((rings, 3, 6 * frame_count + others + 1))
    count = normal.ring_row.shape[2] - others - 1
    ring_row[:, :, 6 * frame_count :] = normal.ring_row[:, :, count:]
    ring_poses = normal.ring_row[:, :, :count].reshape(3 * rings, len(normal.pose), 6)
    into_frames = ring_row[:, :, : 6 * frame_count].reshape(rings, 3, frame_count, 6)
    first = 0
    for chain in chains:
        views = slice(first, first := first + len(chain.frame))
        by_frame, block, row = chain.by_frame, normal.pose[views], normal.pose_row[views]
        turned = by_frame.transpose(0, 2, 1)
        pose[chain.frame] += turned @ block @ by_frame
        pose_row[chain.frame] += turned @ row
        through = ring_poses[:, views].transpose(1, 0, 2)
        into_frames[:, :, chain.frame] += (through @ by_frame).transpose(1, 0, 2).reshape(rings, 3, len(turned), 6)
        free, column = chain.column >= 0, chain.column[chain.column >= 0]
        by_camera = chain.by_shared[:, :, free]
        pose_row[chain.frame[:, None, None], np.arange(6)[:, None], column] += turned @ block @ by_camera
        ring_row[:, :, 6 * frame_count + column] += (through @ by_camera).sum(axis=0).reshape(rings, 3, len(column))
        back = by_camera.transpose(0, 2, 1)
        coupled = (back @ row).sum(axis=0)
        other[column] += coupled
        other[:, column] += coupled[:, :-1].T
        other[column[:, None], column] += (back @ block @ by_camera).sum(axis=0)
    ring_row[:, :, : 6 * frame_count] = into_frames.reshape(rings, 3, 6 * frame_count)
    return replace(normal, pose=pose, pose_row=pose_row, ring_row=ring_row, other=other)


def moved_poses(held: HeldCameras, poses: HeldPoses, frame_step: Array, other_step: Array) -> HeldPoses:
    """The poses after a step of frames (V, 6) and of the shared unknowns."""
    cam_from_rig = np.array(poses.cam_from_rig)
    for camera, column in enumerate(held.pose):
        if (column >= 0).all():
            cam_from_rig[camera] = move_poses(cam_from_rig[camera, None], other_step[None, column])[0]
    return HeldPoses(cam_from_rig, move_poses(poses.rig_from_target, frame_step))


@dataclass(frozen=True, eq=False)
class CameraSightings:
    """What one camera saw; its poses and free parameters stand in those of all cameras from a place on."""

    problem: Problem  # positions are those of the nominal target
    ring: Rows  # (M,)
    tie: Tie
    first_view: int
    first_param: int


@dataclass(frozen=True, eq=False)
class Joint:
    """All sightings, the unknowns of the target they show, and what an observation is worth."""

    sets: tuple[CameraSightings, ...]
    unknowns: Unknowns
    gauge: Array  # (G, Q) rows over the shared unknowns that hold what photos do not tell, whitened for scale 1
    param_count: int  # free parameters of all cameras, and where they stand if they are held together
    view_count: int  # of all cameras
    scale: float = 1.0
    """Standard deviation of an observation, in px or in units of its stated covariance; priors are weighed by it."""
    held: HeldCameras | None = None  # None: each photo is taken by itself

    @property
    def pose_count(self) -> int:
        """How many poses of the target there are."""
        return self.view_count if self.held is None else self.held.frame_count


@dataclass(frozen=True, eq=False)
class State:
    """Values of all unknowns."""

    cameras: tuple[Camera, ...]
    poses: tuple[Array, ...]  # (V, 4, 4) of each camera
    shape: TargetUnknowns
    held: HeldPoses | None = None  # which the poses follow, if cameras are held together


def joint_problem(
    sets: Sequence[Observations], ties: Sequence[Tie], unknowns: Unknowns, gauge: Array, *, weighted: bool,
    frame: tuple[Rows, ...] | None = None, reference: int = 0,
) -> Joint:  # fmt: skip
    """All sightings, packed; each view has some.

    Cameras are held together if `frame` of each camera's views is given; `reference` is the one whose frame is the
    rig's, or -1.
    """
    packed, view, param = [], 0, 0
    for seen, tie in zip(sets, ties, strict=True):
        packed.append(CameraSightings(pack(seen, weighted=weighted), seen.point, tie, view, param))
        view += seen.view_count
        param += int(tie.row.max(initial=-1)) + 1
    if frame is None:
        return Joint(tuple(packed), unknowns, gauge, param, view)
    pose = []
    for camera in range(len(packed)):
        pose.append(np.full(6, -1) if camera == reference else param + np.arange(6))
        param += 0 if camera == reference else 6
    held = HeldCameras(frame, max(int(rows.max(initial=-1)) for rows in frame) + 1, tuple(pose))
    return Joint(tuple(packed), unknowns, gauge, param, view, held=held)


def without(joint: Joint, keeps: Sequence[Flags]) -> Joint:
    """The problem with some observations left out (M,) of each camera."""
    sets = [
        replace(one, problem=replace(one.problem, is_used=keep)) for one, keep in zip(joint.sets, keeps, strict=True)
    ]
    return replace(joint, sets=tuple(sets))
