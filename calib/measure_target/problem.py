"""Observations of one printed target by several cameras, packed for the kernels."""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from calib.cameras.camera import Camera
from calib.core.types import Observations
from calib.measure_target.held import HeldCameras, HeldPoses
from calib.measure_target.unknowns import TargetUnknowns, Unknowns
from calib.solver.options import Tie
from calib.solver.problem import Problem, pack
from designer.base.arrays import Array


@dataclass(frozen=True, eq=False)
class CameraSightings:
    """What one camera saw; its poses and free parameters stand in those of all cameras from a place on."""

    problem: Problem  # positions are those of the nominal target
    ring: NDArray[np.int64]  # (M,)
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
    frame: tuple[NDArray[np.int64], ...] | None = None, reference: int = 0,
) -> Joint:  # fmt: skip
    """All sightings, packed; each view has some.

    Args:
        sets: of each camera.
        ties: of each camera's parameters.
        unknowns: of the target.
        gauge: that holds what photos do not tell.
        weighted: by the covariances of the observations.
        frame: of each camera's views, if the cameras are held together.
        reference: the camera whose frame the rig's is, or -1.
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


def without(joint: Joint, keeps: Sequence[NDArray[np.bool_]]) -> Joint:
    """The problem with some observations left out (M,) of each camera."""
    sets = [
        replace(one, problem=replace(one.problem, is_used=keep)) for one, keep in zip(joint.sets, keeps, strict=True)
    ]
    return replace(joint, sets=tuple(sets))
