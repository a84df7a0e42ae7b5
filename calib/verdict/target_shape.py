"""Whether the camera depends on the target being as its file says.

Two halves of the photos share their target, so they agree on what a bent one does to the camera. But if the faces may
bend, stretch and move a little (`calib.verdict.deformation`), a bent one shows: another shape explains the sightings
better, and with it goes another camera. The least-squares solution is extended by those unknowns
(`calib.solver.target_error.extended`); one linear step from the solution gives the change of the camera. The extended
camera is right with either target, the plain one is the more accurate if the target is as its file says, and then the
difference of the two has the covariance of the first less that of the second, which tells chance from fault (Hausman
1978, Specification tests in econometrics, Econometrica 46).
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from calib.core.one_thread import one_thread
from calib.solver.calibration import Calibration
from calib.solver.free_shape import free_directions, shape_equations
from calib.solver.target_error import extended
from calib.verdict.apart import in_sigmas, moved_over
from calib.verdict.coverage import Coverage
from calib.verdict.deformation import deformation_of

Array = NDArray[np.float64]

QUANTILE = 95


@dataclass(frozen=True)
class ShapeEffect:
    """What a target that may have another shape does to the camera, over the covered area."""

    percentile_95_px: float  # change of the camera's pixels, less their best turn
    ratio: float  # the same in its standard deviations, 1 on average if the target is as its file says
    sigma_px: float  # of the change, along its worse axis, 95 % of the area
    bow_mm: float  # of the most bent face, from its middle to its farthest ring
    explained: float = 1.0  # of the residuals' variance, 0 to 1: how much less another shape leaves over


@one_thread
def shape_effect(calibration: Calibration, coverage: Coverage) -> ShapeEffect | None:
    """The effect; None if it cannot be told: a learned map, points on no known face, or too few sightings."""
    seen = calibration.observations
    used = np.unique(seen.point[~calibration.is_outlier])
    basis = free_directions(calibration.param_covariance)
    if calibration.camera.learned is not None or not basis.size or not len(used) or (seen.points.face[used] < 0).any():
        return None
    deformation = deformation_of(seen.points, used)
    none = np.zeros((len(seen.points.face), 3, 0))
    found = shape_equations(calibration, basis, deformation.modes_mm, none)
    freedom = found.equations - len(found.normal)
    if freedom <= 0:
        return None
    # A prior of one unit keeps at zero what the photos leave open: the target's pose and size, faces seen once.
    noise = found.square / (found.equations - basis.shape[1])
    free = extended(found, noise)
    variance = max(free.left, 0.0) / freedom
    field, covariance = moved_over(
        calibration.camera, basis @ free.mean[found.camera], variance * basis @ free.more @ basis.T, coverage
    )
    if not len(field):
        return None
    worst = np.sqrt(np.maximum(np.linalg.eigvalsh(covariance)[:, 1], 0.0))
    return ShapeEffect(
        float(np.percentile(np.linalg.norm(field, axis=1), QUANTILE)),
        in_sigmas(field, covariance),
        float(np.percentile(worst, QUANTILE)),
        deformation.bow_mm(free.mean[found.camera.stop :]),
        min(max(1 - variance / noise, 0.0), 1.0) if noise > 0 else 0.0,
    )
