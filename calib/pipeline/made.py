"""What a target's way of making lets it be off, beside a camera that was solved from photos of it."""

from calib.solver.target_error import with_target_error
from calib.types import Calibration
from designer.errors import InputError
from designer.target import TargetGeometry
from designer.tolerance.error_file import error_model
from designer.tolerance.made import MEASURED, Made
from designer.tolerance.prior import ShapePrior, measured_prior, shape_prior


def prior_of(calibration: Calibration, target: TargetGeometry | None) -> ShapePrior | None:
    """The prior of what a stored calibration says of its target; None if there is none, or it cannot be found."""
    error = calibration.target_error
    if target is None or error is None or not error.param_covariance.any():
        return None
    if error.made == MEASURED:
        return measured_prior(target)
    try:
        return shape_prior(target, error_model(error.made))
    except InputError:  # a file of errors that is no longer there
        return None


def with_made(calibration: Calibration, made: Made | None) -> Calibration:
    """The calibration with what its target may be off; as it was if nobody knows how that was made."""
    if made is None:
        return calibration
    return with_target_error(calibration, made.prior, made=made.name, because=made.because)
