"""A rig whose photos do not fit together: how much of that is left to single photos depends on what each camera tells.

With a slack of each photo (`calib.rigs.slack`) a frame that was not taken at once spoils nothing but itself, and each
camera's lens comes from its own photos. Where these hardly tell it, as a small board far away, the lens is lost with
what the other cameras said of it: four webcams of others place corners 1.2 mm off with slacks, and .92 mm without.
"""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from calib.cameras import parameter_names
from calib.core.parallel import one_thread_with_scipy
from calib.core.types import Observations, RigObservations
from calib.rigs.options import CameraChoice, RigOptions
from calib.rigs.result import RigCalibration
from calib.rigs.solve import cameras_alone, solve_rig
from calib.rigs.start import Alone
from calib.rigs.worth import DISAGREES
from calib.solver.options import SolveOptions
from calib.solver.solve import solve
from designer.base.errors import InputError

LINEAR_PART = 4
"""Parameters of any model before those of its distortion."""
SURE = 3e-3
"""Standard deviation of a focal length, as a part of it, from which on a camera's own photos tell its lens."""


@one_thread_with_scipy
def solve_as_told(
    observations: RigObservations, choices: Sequence[CameraChoice], options: RigOptions
) -> tuple[RigCalibration, RigOptions]:
    """A rig without slacks, or with them where photos do not fit together and each camera tells its lens by itself.

    Returns:
        The rig, and the options that it was solved with.

    Raises:
        InputError: as `solve_rig`.
    """
    rigid = replace(options, allows_slack=options.carrier is not None)
    alone = cameras_alone(observations, choices, rigid)
    found = _settled(observations, choices, rigid, alone)
    if rigid.allows_slack or found.alone_scale is None or not (found.scale > DISAGREES * found.alone_scale).any():
        return found, rigid
    if not all(_tells_its_lens(*one) for one in zip(observations.sightings, choices, alone, strict=True)):
        return found, rigid
    return solve_rig(observations, choices, options, alone), options


def _settled(
    observations: RigObservations, choices: Sequence[CameraChoice], options: RigOptions, alone: Sequence[Alone]
) -> RigCalibration:
    """A rig; if that ends short of a minimum, from where a rig without distortion ends.

    Cameras that hardly tell their lenses begin with wild ones, by which some points have no pixel on the way.
    """
    found = solve_rig(observations, choices, options, alone)
    if found.status != "stopped":
        return found
    try:
        plain = solve_rig(observations, [_without_lens(choice) for choice in choices], options)
        near = [
            replace(choice, given=camera) if choice.is_refined else choice
            for choice, camera in zip(choices, plain.cameras, strict=True)
        ]
        again = solve_rig(observations, near, options)
    except InputError:
        return found
    return again if again.status == "converged" else found


def _without_lens(choice: CameraChoice) -> CameraChoice:
    """The same with all but focal lengths and centre as they begin."""
    kept = {name for name, _ in choice.fixed}
    more = tuple((name, None) for name in parameter_names(choice.model)[LINEAR_PART:] if name not in kept)
    return replace(choice, fixed=(*choice.fixed, *more))


def _tells_its_lens(seen: Observations, choice: CameraChoice, one: Alone) -> bool:
    """Whether a camera's own photos do."""
    if choice.given is not None and not choice.is_refined:
        return True
    try:
        alone = one.solved or solve(seen, choice.model, SolveOptions(fixed=choice.fixed))
    except InputError:
        return False
    sigma, focal = np.sqrt(np.diagonal(alone.param_covariance)[:2]), alone.camera.params[:2]
    return alone.status == "converged" and bool((sigma <= SURE * np.abs(focal)).all())
