"""From the rig that minimises distances in the image to the one that minimises distances in space; how sure it is.

As a single camera does, see `calib.solver.in_space`: by the same residuals, and with the same statement of accuracy.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from calib.core.se3 import invert, steps_between
from calib.core.types import RigObservations
from calib.rigs.accuracy import Found, RigAccuracy
from calib.rigs.descend import descend_rig, rig_equations
from calib.rigs.problem import RigOptions, RigProblem, RigState
from calib.rigs.start import Alone
from calib.rigs.worth import camera_scales, scales_left, settled
from calib.solver.accuracy import UNSURE_FOCAL, UndeterminedError
from calib.solver.costs import COSTS
from calib.solver.in_space import camera_change, in_space
from designer.base.arrays import Array


@dataclass(frozen=True, eq=False)
class RigInSpace:
    """What came of it, told in the image."""

    found: Found  # the equations are those of the image there
    scale: Array  # (C,) standard deviation of an observation


def rig_in_space(
    problem: RigProblem, image: Found, observations: RigObservations, alone: Sequence[Alone], options: RigOptions
) -> RigInSpace:
    """From the minimum in the image to that in space, without what the first left out.

    What distances of each camera, a carrier and single photos are worth is judged anew: noise is in mm there.

    Raises:
        UndeterminedError: what is least in space is nowhere near.
    """
    seen = tuple(
        replace(one, problem=in_space(one.problem, options.minimise, observations.points, own.point))
        for one, own in zip(problem.seen, observations.sightings, strict=True)
    )
    spaced = replace(problem, seen=seen)
    spaced = replace(spaced, scale=scales_left(spaced, image.state))
    found = descend_rig(spaced, image.state, max_iterations=options.max_iterations)
    as_it_is = replace(options, reject_sigma=None, allows_slack=bool(problem.slack))
    found, _ = settled(spaced, found, observations, alone, as_it_is)
    _require_near(image.state, found.state, observations.camera_names, options.minimise)
    told = replace(
        found,
        equations=rig_equations(problem, found.state, problem.loss),
        iterations=image.iterations + found.iterations,
    )
    return RigInSpace(told, camera_scales(problem, told, options.loss))


def _require_near(before: RigState, after: RigState, names: Sequence[str], minimise: str) -> None:
    """Refuse focal lengths that run away: where photos hardly tell them, many distances are shorter for wild ones."""
    for name, old, new in zip(names, before.cameras, after.cameras, strict=True):
        (was, _), (now, _) = old.params[:2], new.params[:2]
        if not abs(now - was) <= UNSURE_FOCAL * was:
            raise UndeterminedError(
                f"--minimise {minimise}: takes the focal length of {name} from {was:.0f} px in the image to {now:.4g} "
                "px, so the photos do not tell it; take more photos, keep the lens of an earlier run, or minimise image"
            )


def with_step(accuracy: RigAccuracy, before: RigState, after: RigState) -> RigAccuracy:
    """The accuracy in the image, with the step from there to another estimate in it (`V + D D'`)."""
    params = [new.params - old.params for old, new in zip(before.cameras, after.cameras, strict=True)]
    places = steps_between(before.cam_from_rig, after.cam_from_rig)
    step = np.concatenate([part for pair in zip(params, places, strict=True) for part in pair])
    frames = steps_between(before.rig_from_target, after.rig_from_target)
    carried = steps_between(before.carrier_from_target, after.carrier_from_target)
    carrier = accuracy.carrier_covariance
    return replace(
        accuracy,
        covariance=accuracy.covariance + np.outer(step, step),
        frame_covariance=accuracy.frame_covariance + frames[:, :, None] * frames[:, None, :],
        delay_sigma_s=np.hypot(accuracy.delay_sigma_s, after.delay_s - before.delay_s),
        carrier_covariance=None if carrier is None else carrier + np.outer(carried, carried),
        size_sigma=float(np.hypot(accuracy.size_sigma, after.size - before.size)),
    )


def space_remark(minimise: str, problem: RigProblem, before: RigState, after: RigState, accuracy: RigAccuracy) -> str:
    """By how much the rig is another one than that of the image, whose accuracy is given."""
    changes, row = [], 0
    for one, old, new in zip(problem.seen, before.cameras, after.cameras, strict=True):
        own = slice(row, row + len(old.params))
        row = own.stop + len(one.pose)
        pixel = one.problem.measured_px.T[one.problem.is_used]
        changes.append(camera_change(old, new.params - old.params, accuracy.covariance[own, own], pixel))
    off_px, sigma_px = max(changes)
    said = f"minimised: {COSTS[minimise].title}"
    if off_px > 0:
        said += (
            f"; where points were seen, 95 % are within {off_px:.2g} px of the camera that the distances in the image "
            f"give, itself sure to {sigma_px:.2g} px there"
        )
    turn_rad = np.linalg.norm(steps_between(before.cam_from_rig, after.cam_from_rig)[:, :3], axis=1).max()
    way = invert(after.cam_from_rig)[:, :3, 3] - invert(before.cam_from_rig)[:, :3, 3]
    way_mm = np.linalg.norm(way, axis=1).max()
    if way_mm > 0:
        said += f"; cameras stand up to {way_mm:.2g} mm and {np.rad2deg(turn_rad):.2g} deg from where those put them"
    return f"{said}; what is stated has the difference in it"
