"""A flat target that is bent, before what carries it or the camera is solved: its points, and what they are unsure by.

A robot's ways fit photos of a board that bows by half a millimetre to a camera that sits a centimetre elsewhere: the
bow turns each photo's pose, and no noise of the robot's looks like that.
"""

from dataclasses import replace

import numpy as np

from calib.cameras import parameter_names
from calib.core.types import Observations
from calib.rigs.problem import CameraChoice
from calib.rigs.result import RigCalibration
from calib.rigs.target_error import unseen_errors
from calib.solver.accuracy import UndeterminedError
from calib.solver.plane_bend import PlaneBend
from calib.solver.problem import SolveOptions
from calib.solver.solve import solve
from designer.tolerance.prior import ShapePrior


def bent_alone(seen: Observations, choice: CameraChoice) -> tuple[Observations, PlaneBend]:
    """The sightings with the target's points as bent as the camera's own photos show them, and the bend.

    Raises:
        InputError: the target is not flat.
        UndeterminedError: the photos do not tell its bend.
    """
    fixed = choice.fixed
    if choice.given is not None and not choice.is_refined:
        fixed = tuple(zip(parameter_names(choice.model), choice.given.params.tolist(), strict=True))
    found = solve(seen, choice.model, SolveOptions(free_bend=True, fixed=fixed))
    if found.target_bend is None:
        raise UndeterminedError("--free-bend: the photos do not tell how the target is bent; leave it out")
    said = found.remarks[0]
    return replace(found.target_bend.bent(seen), remarks=(*seen.remarks, said)), found.target_bend


def with_bend_error(found: RigCalibration, bend: PlaneBend | None) -> RigCalibration:
    """The rig with what the bend is unsure by among the target's errors; as it was without a bend.

    The photos tell the bend less surely than their noise says, by as much as they do their poses.
    """
    if bend is None or not np.isfinite(found.covariance).all():
        return found
    first, both, second = bend.covariance_mm2
    value, axes = np.linalg.eigh(np.array([[first, both], [both, second]]) * (1 + (found.slack or 0.0)))
    root = axes * np.sqrt(value.clip(min=0.0))
    position = found.observations.points.position_mm
    modes = np.tensordot(root.T, bend.modes_mm(position), 1)
    (moved,) = unseen_errors(found, [ShapePrior(modes, np.zeros((len(position), 3, 0)))])
    before = found.target_covariance
    return replace(found, target_covariance=moved if before is None else before + moved)
