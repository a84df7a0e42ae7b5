"""How a target was made, as somebody says or as it is assumed: what its rings may be off."""

from dataclasses import dataclass

from calib.solver.target_error import EXACT, MEASURED, with_target_error
from calib.types import Calibration
from designer.errors import InputError
from designer.target import TargetGeometry
from designer.tolerance.assumed import error_model_for
from designer.tolerance.error_file import error_model
from designer.tolerance.prior import ShapePrior, measured_prior, shape_prior


@dataclass(frozen=True, eq=False)
class Made:
    """A way of making."""

    name: str  # an error template's or file's, "measured" or "exact"
    because: str  # why this one; "" if somebody said it
    prior: ShapePrior | None  # None: the rings are where the file has them

    @property
    def sentence(self) -> str:
        """What is taken for granted, and how to say otherwise."""
        taken = self.name if self.prior is None or self.name == MEASURED else f"made as '{self.name}'"
        why = f", as {self.because}; --made tells otherwise" if self.because else ""
        return f"the target is taken to be {taken}{why}"


def how_made(target: TargetGeometry | None, asked: str | None = None, *, rendered_id: str = "") -> Made | None:
    """The way a target was made; None if nobody knows.

    Args:
        target: as its file has it; None: points from elsewhere.
        asked: an error template, a TOML file of errors, or `exact`; None: assumed from the target.
        rendered_id: of the geometry that photos were rendered of; "": real photos.

    Raises:
        InputError: no such template or file, or one for points without a target.
    """
    if asked == EXACT:
        return Made(EXACT, "", None)
    if target is None:
        if asked is None:
            return None
        raise InputError(f"--made {asked}: points without a target file have no faces that errors could be of; "
                         f"give --made {EXACT}, or leave it out")  # fmt: skip
    if asked is not None:
        return Made(asked, "", shape_prior(target, error_model(asked)))
    if rendered_id == target.geometry_id:
        return Made(EXACT, "the photos were rendered of it", None)
    if target.source == "measured":
        return Made(MEASURED, "its file says so", measured_prior(target))
    assumed = error_model_for(target)
    if assumed is None:
        return Made(EXACT, "its file is of a simulated part", None)
    return Made(assumed.errors.name, assumed.because, shape_prior(target, assumed.errors))


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
