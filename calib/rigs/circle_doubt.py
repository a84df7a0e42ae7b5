"""Points of a table of which nobody said whether they are centres of circles: what a rig may be off by that."""

from dataclasses import replace

import numpy as np

from calib.rigs.camera_alone import camera_alone
from calib.rigs.result import RigCalibration
from calib.rigs.target_error import posed_unknowns
from calib.solver.circles import circle_shift_px, doubt_of, unsaid_mm
from calib.solver.extra_parameters import extra_of


def with_circle_doubt(found: RigCalibration) -> RigCalibration:
    """The rig with the doubt, as `calib.solver.circles` has it for one camera; as it was where all is said."""
    units = [unsaid_mm(seen) for seen in found.observations.sightings]
    known = [float(one.max()) for one in units if one is not None]
    if not known or not np.isfinite(found.covariance).all():
        return found
    unit_mm = float(np.median(known))
    shift = [
        np.zeros_like(seen.center_px) if own is None
        else circle_shift_px(camera_alone(found, row), np.where(own > 0, unit_mm, 0.0))
        for row, (seen, own) in enumerate(zip(found.observations.sightings, units, strict=True))
    ]  # fmt: skip
    off = tuple(left + by for left, by in zip(found.residual_px, shift, strict=True))
    frames = np.arange(found.observations.frame_count)
    (basis, plain), (_, moved) = (posed_unknowns(one, frames) for one in (found, replace(found, residual_px=off)))
    pairs = ((one, other.residual - one.residual) for one, other in zip(plain, moved, strict=True))
    told = extra_of(pairs, basis, 1)
    if told is None:
        return found
    return replace(found, circle_doubt=doubt_of(told, unit_mm, len(found.covariance)))
