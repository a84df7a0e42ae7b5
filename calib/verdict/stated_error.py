"""What a camera is off by as the verdict states it, and what further photos make of that.

In the directions q of `calib.verdict.information`, in which the solution's noise is the identity, a camera's error e is
the noise, enlarged by what halves of the photos show, and what the target is off. Photos with the information X on q,
and Y between q and the numbers s of the target's shape, move the solution; its error is then

    e' = (1 + X)^-1 (e - Y s + noise of the photos).

What of the target's error the photos share with those before stays, however many they are, and what the camera took of
a field that is fixed in the image stays whole.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from calib.core.linear_algebra import covariance_with_prior, pseudo_inverse
from calib.solver.calibration import Calibration
from calib.solver.target_error import left_open
from calib.verdict.information import Knowledge
from designer.tolerance.prior import ShapePrior

Array = NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class StatedError:
    """The mean squares of e and s, the noise's part of e as a factor of its own."""

    noise: float  # of the variance: what halves of the photos enlarge it by
    by_target: Array  # (Q, Q) of e, by the target
    modes_mm: Array | None  # (S, K, 3) of the target's shape; None: not known, so no photo takes anything from its part
    mixed: Array  # (Q, S) of e with s
    shape: Array  # (S, S) of s
    by_field: Array  # (Q, Q) of e, by what is fixed in the image

    def after(self, told: Array) -> Array:
        """Mean squares (Q, Q) of e after photos with the information (Q + S, Q + S) on q and s."""
        size = len(self.by_target)
        inverse, by_shape = covariance_with_prior(told[:size, :size]), told[:size, size:]
        if self.modes_mm is None:
            return self.noise * inverse + self.by_target + self.by_field
        across = self.mixed @ by_shape.T
        target = self.by_target - across - across.T + by_shape @ self.shape @ by_shape.T
        found: Array = self.noise * inverse + inverse @ target @ inverse + self.by_field
        return found


def stated_error(known: Knowledge, calibration: Calibration, factor: float, prior: ShapePrior | None) -> StatedError:
    """The error of a calibration as the verdict states it.

    Args:
        known: of the calibration.
        calibration: with what its target may be off, if that is known.
        factor: that halves of the photos enlarge the standard deviations of the noise by.
        prior: of how the target was made; None: not known, or no matter.
    """
    size, error = known.basis.shape[1], calibration.target_error
    none, to_q = np.zeros((size, 0)), pseudo_inverse(known.basis)
    by_field = np.zeros((size, size))
    if known.is_determined and calibration.image_field is not None:
        by_field = to_q @ calibration.image_field.param_covariance @ to_q.T
    if error is None or not known.is_determined or not error.param_covariance.any():
        return StatedError(factor**2, np.zeros((size, size)), None, none, none.T @ none, by_field)
    by_target = to_q @ error.param_covariance @ to_q.T
    found = left_open(calibration, prior)
    if found is None:
        return StatedError(factor**2, by_target, None, none, none.T @ none, by_field)
    camera = found.basis.shape[1]
    mixed, shape = found.mean_square[:camera, camera:], found.mean_square[camera:, camera:]
    return StatedError(factor**2, by_target, found.modes_mm, to_q @ found.basis @ mixed, shape, by_field)
