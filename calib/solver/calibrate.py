"""A camera of any model from observations: with parameters alone, or with a map that is learned, loaded only then."""

from typing import TYPE_CHECKING

from calib.cameras import learned_models
from calib.core.types import Observations
from calib.solver.calibration import Calibration
from calib.solver.circles import with_circles
from calib.solver.problem import SolveOptions
from calib.solver.solve import solve
from designer.base.errors import InputError

if TYPE_CHECKING:
    from calib.solver.solve_virtual import Reference

ALL_VIEWS = "all"
"""As the reference: the map is learned from all views."""


def calibrate(
    observations: Observations, model: str, options: SolveOptions, reference: "Reference | None" = None
) -> Calibration:
    """Solve a camera of any model.

    Args:
        observations: what was seen.
        model: its name.
        options: weights, losses, fixed and shared parameters.
        reference: the photo that a learned map is of, or `ALL_VIEWS`; only models with one heed it.

    Raises:
        InputError: the observations or the options do not do.
    """
    if model not in learned_models():
        return solve(observations, model, options)
    from calib.solver.solve_virtual import on_plane_mm, solve_virtual

    if options.breathing_mm is not None or options.vary:
        raise InputError(f"--breathing, --vary: model {model} is learned of one focal length; solve another with it")
    if options.free_bend:
        raise InputError(f"--free-bend: model {model} is learned from a target as it is given; solve another with it")
    if reference == ALL_VIEWS:
        return with_circles(observations, lambda seen: solve_virtual(seen, options, all_views=True))
    held = [
        *(f"{name} cannot be fixed" for name, _ in options.fixed),
        *(f"--prior {one.text}" for one in options.priors),
    ]
    if held and (reference is not None or on_plane_mm(observations.points, observations.point) is not None):
        raise InputError(
            f"{held[0]}: the sensor of a map learned from a photo has a focal length and a "
            "centre of its own; learn the map from all views, with --reference all"
        )
    return with_circles(observations, lambda seen: solve_virtual(seen, options, reference))
