"""What a target's way of making lets it be off, beside a camera that was solved from photos of it."""

from calib.solver.calibration import Calibration
from calib.solver.target_error import with_target_error
from designer.target import TargetGeometry
from designer.tolerance.made import MEASURED, Made
from designer.tolerance.prior import ShapePrior, measured_prior, shape_prior


def prior_of(calibration: Calibration, target: TargetGeometry | None) -> ShapePrior | None:
    """The prior that a calibration was given for its target; None if it was given none, or does not tell it."""
    error = calibration.target_error
    if target is None or error is None or not error.param_covariance.any():
        return None
    if error.made == MEASURED:
        return measured_prior(target)
    return None if error.errors is None else shape_prior(target, error.errors)


def with_made(calibration: Calibration, made: Made | None) -> Calibration:
    """The calibration with what its target may be off; as it was if nobody knows how that was made."""
    if made is None:
        return calibration
    return with_target_error(calibration, made.prior, made=made.name, because=made.because, errors=made.errors)
