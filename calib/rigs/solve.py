"""From what the cameras of a rig saw to where they stand, and how sure that is.

With a slack of each photo (`calib.rigs.slack`) a frame that was not taken at once spoils nothing but itself, and each
camera's lens comes from its own photos. Where these hardly tell it, as a small board far away, the lens is lost with
what the other cameras said of it: four webcams of others place corners 1.2 mm off with slacks, and .92 mm without. So
photos have slack where they do not fit together and each camera tells its lens by itself.
"""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from calib.cameras import parameter_names
from calib.core.parallel import one_thread_with_scipy
from calib.core.types import Observations, RigObservations
from calib.rigs.adjust import adjusted
from calib.rigs.camera_alone import camera_alone
from calib.rigs.options import CameraChoice, RigOptions
from calib.rigs.result import RigCalibration
from calib.rigs.start import Alone, solve_alone
from calib.rigs.worth import DISAGREES
from calib.solver.circles import through_circles
from calib.solver.in_space import require_planes
from calib.solver.options import SolveOptions
from calib.solver.solve import solve
from designer.base.errors import InputError

LINEAR_PART = 4
"""Parameters of any model before those of its distortion."""
SURE = 3e-3
"""Standard deviation of a focal length, as a part of it, from which on a camera's own photos tell its lens."""


@one_thread_with_scipy
def solve_rig(
    observations: RigObservations, choices: Sequence[CameraChoice], options: RigOptions | None = None
) -> RigCalibration:
    """`solve_rig(observations, [CameraChoice("opencv")] * 4).cam_from_rig`.

    Each camera is solved alone, frames that two saw join them, and Levenberg-Marquardt over all parameters, places and
    frames, these eliminated block by block, gives the most likely rig. What an observation of each camera is worth is
    estimated with it. The result does not depend on the order of frames or cameras but for rounding.

    Args:
        observations: what was seen; each view has a sighting.
        choices: how each camera is to be solved (C,).
        options: weights, losses, what carries the target.

    Raises:
        InputError: a camera cannot be solved, or not in space, no frames join some cameras to the others, frames of
            one would have to be shifted to fit, or options that do not fit.
    """
    options = options or RigOptions()
    found, said = through_circles(
        observations.sightings,
        lambda seen: _solved(replace(observations, sightings=tuple(seen)), choices, options),
        lambda rig: [camera_alone(rig, number) for number in range(len(choices))],
    )
    return replace(found, remarks=(*found.remarks, *said)) if said else found


def _solved(observations: RigObservations, choices: Sequence[CameraChoice], options: RigOptions) -> RigCalibration:
    """The rig from points as they are given."""
    _check(observations, choices, options)
    alone = _each_alone(observations, choices, options)
    if options.allows_slack is not None or options.carrier is not None:
        return _settled(observations, choices, replace(options, allows_slack=options.allows_slack is not False), alone)
    found = _settled(observations, choices, replace(options, allows_slack=False), alone)
    if found.alone_scale is None or not (found.scale > DISAGREES * found.alone_scale).any():
        return found
    if not all(_tells_its_lens(*one) for one in zip(observations.sightings, choices, alone, strict=True)):
        return found
    return adjusted(observations, replace(options, allows_slack=True), alone)


def _check(observations: RigObservations, choices: Sequence[CameraChoice], options: RigOptions) -> None:
    """Refuse what does not fit together."""
    for seen in observations.sightings:
        require_planes(options.minimise, seen.points, seen.point)
    if len(choices) != observations.camera_count:
        raise ValueError("a choice for each camera is needed")
    if not 0 <= options.reference < observations.camera_count:
        raise InputError(f"reference {options.reference}: the rig has cameras 0 to {observations.camera_count - 1}")
    carrier = options.carrier
    if carrier is not None and len(carrier.rig_from_carrier) != observations.frame_count:
        raise ValueError("a pose of the carrier for each frame is needed")
    if options.estimates_delays and observations.time_s is None:
        raise InputError("time offsets need time stamps; give each photo's, or leave the offsets out")


def _each_alone(
    observations: RigObservations, choices: Sequence[CameraChoice], options: RigOptions
) -> tuple[Alone, ...]:
    """Each camera by itself."""
    return tuple(
        solve_alone(seen, name, choice, options)
        for seen, name, choice in zip(observations.sightings, observations.camera_names, choices, strict=True)
    )


def _settled(
    observations: RigObservations, choices: Sequence[CameraChoice], options: RigOptions, alone: Sequence[Alone]
) -> RigCalibration:
    """A rig; if that ends short of a minimum, from where a rig without distortion ends.

    Cameras that hardly tell their lenses begin with wild ones, by which some points have no pixel on the way.
    """
    found = adjusted(observations, options, alone)
    if found.status != "stopped":
        return found
    try:
        plain = [_without_lens(choice) for choice in choices]
        begun = adjusted(observations, options, _each_alone(observations, plain, options))
        near = [
            replace(choice, given=camera) if choice.is_refined else choice
            for choice, camera in zip(choices, begun.cameras, strict=True)
        ]
        again = adjusted(observations, options, _each_alone(observations, near, options))
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
