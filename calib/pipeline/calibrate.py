"""One way to solve every camera model."""

from calib.core.types import Observations
from calib.solver.calibration import Calibration
from calib.solver.options import SolveOptions
from calib.solver.solve import solve
from calib.virtual.reference_photo import on_plane_mm
from calib.virtual.solve_virtual import Reference, solve_virtual
from designer.base.errors import InputError

ALL_VIEWS = "all"
"""As the reference: the map is learned from all views."""

MODELS_TO_SOLVE = ("luhmann", "opencv", "virtual")
"""What `--model all` means: the three models of the paper."""


def calibrate(
    observations: Observations, model: str, options: SolveOptions, reference: Reference | None = None
) -> Calibration:
    """Solve a camera of any model.

    Args:
        observations: what was seen.
        model: its name.
        options: weights, losses, fixed and shared parameters.
        reference: the photo that a learned map is of, or `ALL_VIEWS`; only `virtual` heeds it.

    Raises:
        InputError: the observations or the options do not do.
    """
    if model != "virtual":
        return solve(observations, model, options)
    if reference == ALL_VIEWS:
        return solve_virtual(observations, options, all_views=True)
    if options.fixed and (reference is not None or on_plane_mm(observations.points, observations.point) is not None):
        raise InputError(
            f"{options.fixed[0][0]} cannot be fixed: the sensor of a map learned from a photo has a focal length and a "
            "centre of its own; learn the map from all views, with --reference all"
        )
    return solve_virtual(observations, options, reference)
