"""Observations of one printed target by several cameras, packed for the kernels."""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from calib.as_built.unknowns import TargetUnknowns, Unknowns
from calib.cameras.camera import Camera
from calib.core.types import Observations
from calib.solver.options import Tie
from calib.solver.problem import Problem, pack

Array = NDArray[np.float64]


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
    param_count: int  # free parameters of all cameras
    view_count: int  # of all cameras
    scale: float = 1.0
    """Standard deviation of an observation, in px or in units of its stated covariance; priors are weighed by it."""


@dataclass(frozen=True, eq=False)
class State:
    """Values of all unknowns."""

    cameras: tuple[Camera, ...]
    poses: tuple[Array, ...]  # (V, 4, 4) of each camera
    shape: TargetUnknowns


def joint_problem(
    sets: Sequence[Observations], ties: Sequence[Tie], unknowns: Unknowns, gauge: Array, *, weighted: bool
) -> Joint:
    """All sightings, packed; each view has some."""
    packed, view, param = [], 0, 0
    for seen, tie in zip(sets, ties, strict=True):
        packed.append(CameraSightings(pack(seen, weighted=weighted), seen.point, tie, view, param))
        view += seen.view_count
        param += int(tie.row.max(initial=-1)) + 1
    return Joint(tuple(packed), unknowns, gauge, param, view)


def without(joint: Joint, keeps: Sequence[NDArray[np.bool_]]) -> Joint:
    """The problem with some observations left out (M,) of each camera."""
    sets = [
        replace(one, problem=replace(one.problem, is_used=keep)) for one, keep in zip(joint.sets, keeps, strict=True)
    ]
    return replace(joint, sets=tuple(sets))
