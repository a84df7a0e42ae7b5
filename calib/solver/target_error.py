"""What a target that is not quite as its file says may have done to a camera that was solved from photos of it.

    prior = shape_prior(target, error_model("fdm-board"))
    calibration = with_target_error(calibration, prior, made="fdm-board")
    calibration.stated_covariance

A camera solved as if the target were as its file says is off by the noise, and by what the target is off. The photos
tell the target's shape in part: of the numbers s of its prior, standard normal beforehand, they leave the distribution
of the least-squares problem that has them as unknowns, with an identity as their prior. With the noise's variance v and
the normal equations N over camera and shape (poses eliminated), E = (N + v diag(0, 1))^-1 and the gradient g by s,

    camera's error given the photos:  mean E_cs g_s,  covariance v E_cc.

The solution itself stays as it is, so its mean square error is `v E_cc + (E_cs g_s)(E_cs g_s)'`; what is more than
the noise alone would do, v N_cc^-1, is the target's part. Where the photos tell the shape and it is as the file says,
little is added; where they tell that it is not, the error that they tell is added; where they do not tell it, what the
way of making lets expect. What poses take up, also the size of the whole, does nothing.
"""

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from calib.linear_algebra import symmetric_inverse
from calib.one_thread import one_thread
from calib.solver.free_shape import ShapeEquations, free_directions, shape_equations
from calib.types import Calibration, TargetError
from designer.tolerance.prior import ShapePrior

Array = NDArray[np.float64]

EXACT, MEASURED = "exact", "measured"
"""What a target is that is as its file says, and one that is so up to the accuracy that its file states."""
ROUNDING = 1e-12
"""Of the residuals: of sightings that another shape explains to the last, so much noise is left."""
ROUNDS = 20
"""Of finding the noise's variance: it changes by less than a thousandth from then on."""


@one_thread
def with_target_error(
    calibration: Calibration, prior: ShapePrior | None, *, made: str, because: str = ""
) -> Calibration:
    """The calibration with what its target's errors may have done to it; the solution stays as it is.

    Args:
        calibration: solved with the rings where the target's file has them.
        prior: where they may be; None: they are there.
        made: the way of making that the prior is of.
        because: why this one; "" if it was asked for.
    """
    size = len(calibration.camera.params)
    covariance = np.zeros((size, size))
    basis = free_directions(calibration.param_covariance)
    if prior is not None and basis.size and calibration.camera.learned is None:
        used = np.unique(calibration.observations.point[~calibration.is_outlier])
        scale = np.abs(prior.modes_mm[:, used]).max(axis=(1, 2), initial=0.0)
        equations = shape_equations(calibration, basis, prior.modes_mm[scale > 0], prior.ring_modes_mm)
        covariance = basis @ _added_covariance(equations) @ basis.T
    return replace(calibration, target_error=TargetError(made, because, covariance))


def _added_covariance(equations: ShapeEquations) -> Array:
    """The camera's mean square error by the target, in the equations' directions.  # (Q, Q)

    With the camera eliminated too, M = N_ss - N_sc N_cc^-1 N_cs has eigenvalues w along axes V, and so for any noise

        E_ss = V diag(1 / (w + v)) V',   v E_cc - v N_cc^-1 = v B E_ss B'   with B = N_cc^-1 N_cs.
    """
    camera, shape = equations.camera, slice(equations.camera.stop, None)
    alone = symmetric_inverse(equations.normal[camera, camera]).inverse
    by_shape = alone @ equations.normal[camera, shape]
    value, axis = np.linalg.eigh(equations.normal[shape, shape] - equations.normal[shape, camera] @ by_shape)
    value, by_axis = np.maximum(value, 0.0), by_shape @ axis
    # The solution is the minimum for the target as its file has it, whatever loss it was found with.
    along = axis.T @ equations.gradient[shape]
    freedom = equations.equations - camera.stop
    if freedom <= 0 or not len(value) or not equations.square > 0:
        return np.zeros_like(alone)
    variance = equations.square / freedom
    for _ in range(ROUNDS):
        step = along / (value + variance)
        left = equations.square - float((2 * along * step - value * step**2).sum())
        # What a smoother leaves over has as many degrees of freedom as it does not take up.
        told = float((value / (value + variance)).sum())
        variance = max(left, ROUNDING * equations.square) / max(freedom - told, 1.0)
    step = by_axis @ (along / (value + variance))
    added: Array = (by_axis * (variance / (value + variance))) @ by_axis.T + np.outer(step, step)
    return added
