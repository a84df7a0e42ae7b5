"""The photo that does not go with the others: damaged, or of a target that moved, or taken with another zoom."""

import numpy as np

from calib.solver.blocks import RobustLoss, view_blocks
from calib.solver.calibration import Calibration
from calib.solver.options import SolveOptions, tie_parameters
from calib.solver.outliers import shift_of_photo
from calib.solver.problem import pack

CONTRADICTS, LEAST_FAR_PX = 5.0, 0.3
"""Times the others' residuals that a photo leaves, and pixels, if something is wrong with it."""
FEWEST_OTHERS = 3
"""Photos that must agree before another one is said to contradict them."""


def odd_photo(found: Calibration) -> tuple[str, str] | None:
    """Its name, and what is wrong with it; None if there is none."""
    if found.observations.view_count <= FEWEST_OTHERS:
        return None
    return _far_off(found) or _shifted(found)


def _far_off(found: Calibration) -> tuple[str, str] | None:
    """The photo whose residuals are far beyond those of all others."""
    seen = found.observations
    count = np.bincount(seen.view, minlength=seen.view_count)
    square = np.bincount(seen.view, (found.residual_px**2).sum(axis=1), seen.view_count) / np.maximum(count, 1)
    worst = int(square.argmax())
    usual = float(np.median(np.delete(square, worst)))
    if not square[worst] > max(CONTRADICTS**2 * usual, LEAST_FAR_PX**2):
        return None
    return seen.view_names[worst], "contradicts the other photos: damaged, or the target moved or bent"


def _shifted(found: Calibration) -> tuple[str, str] | None:
    """The photo whose picture is shifted against the others'."""
    if found.status != "converged":
        return None
    problem, pose = pack(found.observations, weighted=found.weighted), np.array(found.cam_from_target)
    pose[:, :3, 3] += pose[:, :3, :3] @ problem.origin_mm
    products = view_blocks(problem, found.camera, pose, RobustLoss()).products
    shift = shift_of_photo(products, tie_parameters(found.camera.model, SolveOptions()))
    if shift is None:
        return None
    why = f"is shifted by about {np.hypot(shift.right_px, shift.down_px):.2g} px: another zoom, focus or stabiliser"
    return found.observations.view_names[shift.view], why
