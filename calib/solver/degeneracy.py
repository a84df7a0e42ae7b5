"""Why observations do not determine a camera, in words."""

import numpy as np
from numpy.typing import NDArray

from calib.cameras import parameter_names
from calib.core.types import Observations
from calib.solver.covariance import Accuracy
from calib.solver.levenberg import Minimum
from calib.solver.linear_pose import FLAT
from calib.solver.outliers import MEDIAN_LENGTH
from calib.solver.tie import Tie
from designer.base.errors import InputError

Array = NDArray[np.float64]

UNSURE_FOCAL = 0.05
"""Standard deviation of a focal length, as a part of it, that is no measurement."""
NO_FIT = 0.03
"""Median residual, as a part of the image's longer side, that no lens explains."""
SINGULAR = 1e-13
LITTLE_TILT_DEG = 5.0


class UndeterminedError(InputError):
    """Too few observations for any camera."""


def why_degenerate(observations: Observations, found: Minimum, sigma_px: float, accuracy: Accuracy, tie: Tie) -> str:
    """One line with the reason and the remedy; empty if the camera is determined.

    Args:
        observations: that were solved.
        found: the minimum.
        sigma_px: robust standard deviation of its residuals' coordinates.
        accuracy: what is known of the unknowns.
        tie: which parameters are free.
    """
    # First, because nonsense may also leave next to nothing that counts.
    typical = MEDIAN_LENGTH * sigma_px
    if not typical < NO_FIT * max(observations.image_size):
        return f"residuals of {typical:.3g} px: the points and the pixels do not belong together; check their names"
    if not np.isfinite(accuracy.scale):
        return "as many unknowns as equations: no accuracy can be stated; take more photos"
    sigma = np.sqrt(np.diagonal(accuracy.param_covariance)[:2])
    focal = found.camera.params[:2]
    sure = np.isfinite(sigma).all() and (sigma < UNSURE_FOCAL * focal).all()
    determined = bool(sure and accuracy.weakest_eigenvalue > SINGULAR)
    if determined and found.converged:
        return ""
    if _is_planar(observations) and (tie.row[:2] >= 0).any():
        views = observations.view_count
        seen = "the one view" if views == 1 else f"all {views} views"
        tilt = _largest_tilt_deg(observations, found.cam_from_target)
        if tilt < LITTLE_TILT_DEG:
            return (
                f"{seen} of a plane seen straight on (tilted {tilt:.1f} deg at most): focal length and distance cannot "
                f"be told apart; tilt the target by 20 to 50 deg, or fix the focal length"
            )
        if not sure:
            return (
                f"{seen} of a plane: the focal length is not determined ({_focal_text(focal, sigma)}); take more "
                f"views from different sides, photograph a 3D target, or fix parameters"
            )
    names = parameter_names(found.camera.model)
    part = np.abs(accuracy.weakest)
    weak = [name for name, share in zip(names, part.tolist(), strict=True) if share > 0.3 * max(part.max(), 1e-300)]
    if determined:
        return ""
    if not sure:
        return f"the focal length is not determined ({_focal_text(focal, sigma)}); take more views, or fix parameters"
    return f"{', '.join(weak)} cannot be told apart; take views that fill the image, or fix one of them"


def _focal_text(focal: Array, sigma: Array) -> str:
    if not np.isfinite(sigma).all():
        return "its standard deviation is without bound"
    return f"{focal[0]:.0f} px with a standard deviation of {sigma[0]:.0f} px"


def _is_planar(observations: Observations) -> bool:
    """Whether all points that were seen lie in one plane."""
    seen = observations.points.position_mm[np.unique(observations.point)]
    extent = np.linalg.svd(seen - seen.mean(axis=0), compute_uv=False)
    return bool(extent[-1] < FLAT * extent[0]) if len(extent) == 3 else True


def _largest_tilt_deg(observations: Observations, cam_from_target: Array) -> float:
    """Angle between the plane's normal and the viewing direction, of the most tilted view."""
    seen = observations.points.position_mm[np.unique(observations.point)]
    normal = np.linalg.svd(seen - seen.mean(axis=0))[2][2]
    cosine = np.abs(cam_from_target[:, 2, :3] @ normal)
    return float(np.rad2deg(np.arccos(np.minimum(cosine, 1.0))).max())
