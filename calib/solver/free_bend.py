"""A flat target whose bend is an unknown of the adjustment, beside the camera and the poses.

Its five heights stand before the camera's parameters in the equations of every view, and what is believed of them is
one more view's (`calib.solver.problem.Prior`): what photos hardly tell stays small, and is stated as open as it is.
"""

from collections.abc import Sequence
from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np

from calib.core.types import KnownPoints, Observations
from calib.solver.accuracy import Accuracy
from calib.solver.calibration import TERMS, plane_bend
from calib.solver.costs import IMAGE
from calib.solver.problem import Prior, Problem, SolveOptions
from designer.base.arrays import Array
from designer.base.errors import InputError

if TYPE_CHECKING:
    from designer.tolerance.made import Made

LEAST_MM = 1e-3
"""A board that is made no worse is flat."""
USUAL, SKEWED = 0.01, 0.25
"""Standard deviation of curvatures and of the twist of a board of which nobody knows how it was made, as a part of half
its longer side: boards of others are bent by .2 to 1 %. And that of the bends that change across it, as a part of
these: a board that lies or leans is bent evenly."""


NOT_TOLD = "the photos do not tell how the target is bent; it is taken to be flat"
"""Of a solution that was to have the bend among its unknowns."""


def require_bendable(points: KnownPoints, minimise: str) -> None:
    """Refuse distances in space, and targets that are not flat.

    Raises:
        InputError: so it is.
    """
    if minimise != IMAGE:
        raise InputError(f"--free-bend: goes with distances in the image only; leave --minimise {minimise} out")
    plane_bend(points)


def made_bend_mm(made: "Made | None", points: KnownPoints) -> tuple[float, float, float, float, float] | None:
    """Standard deviations of the heights by how a flat target was made; None: nobody knows, or it is not bent."""
    position = points.position_mm
    if made is None or made.prior is None or made.prior.modes_mm.shape[1] != len(position):
        return None
    heights = plane_bend(points).heights_of(position, made.prior.modes_mm)
    sigma = np.sqrt((heights**2).sum(axis=0))
    a, b, c, d, e = np.maximum(sigma, SKEWED * sigma.max()).tolist()
    return (a, b, c, d, e) if a > LEAST_MM else None


def bend_sigma_mm(points: KnownPoints, told: Sequence[float] | None) -> Array:
    """What is believed of the heights, about zero, if it is told.  # (S,)"""
    return np.array(told or USUAL * max(plane_bend(points).half_mm) * np.array([1, 1, 1, SKEWED, SKEWED]))


def bend_modes_mm(seen: Observations) -> Array:
    """What heights of 1 mm do to each sighting's point.  # (S, 3, M)"""
    modes = plane_bend(seen.points).modes_mm(seen.points.position_mm)
    return np.ascontiguousarray(modes[:, seen.point].transpose(0, 2, 1))


def with_bend(problem: Problem, seen: Observations, options: SolveOptions, parameters: int) -> Problem:
    """The problem with the heights among its unknowns, before so many parameters of a camera."""
    sigma_mm = bend_sigma_mm(seen.points, options.bend_sigma_mm)
    known = problem.prior or Prior(np.zeros(parameters), np.zeros((parameters, parameters)))
    precision = np.pad(known.precision, ((TERMS, 0), (TERMS, 0)))
    precision[:TERMS, :TERMS] = np.diag(sigma_mm**-2)
    prior = Prior(np.concatenate([np.zeros(TERMS), known.mean]), precision)
    return replace(problem, modes_mm=bend_modes_mm(seen), amount=np.zeros(TERMS), prior=prior)


def of_parameters(accuracy: Accuracy, first: int) -> Accuracy:
    """That of the parameters alone, which stand behind so many other unknowns."""
    return replace(
        accuracy, param_covariance=accuracy.param_covariance[first:, first:], weakest=accuracy.weakest[first:]
    )
