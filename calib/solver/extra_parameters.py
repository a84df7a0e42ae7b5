"""Parameters that a solution did not have: how large its residuals say they are, and what leaving them out did.

    found = extra_parameters(calibration, moved_px)  # (M, 2, K): where one unit of each of K moves every measured point
    found.amplitude, found.sigma                     # (K,) each as the only one beside camera and poses
    found.taken @ found.amplitude[k]                 # what the camera's parameters are off by, having left it out

Nothing is solved again. With the whitened residuals r = measured - predicted, the derivatives X by camera and poses and
the columns g, what the other unknowns take up is projected off, `g_perp = g - X (X'X)^-1 X'g`. The score test of a
parameter that is zero is then `g_perp'r` against its variance (Rao 1948, Large sample tests of statistical hypotheses
concerning several parameters, Proc. Cambridge Phil. Soc. 44), and one step of Gauss and Newton is its estimate. Errors
that centres of a photo share make the scores of photos vary by more than independent ones do: that enlarges the
deviation, as a covariance that is clustered by photo does (Liang and Zeger 1986, Biometrika 73).
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from calib.core.linear_algebra import symmetric_inverse
from calib.solver.calibration import Calibration
from calib.solver.free_shape import POSE, free_directions, whitened_views

Array = NDArray[np.float64]

TOLD = 1e-8
"""Part of a column's square that camera and poses must leave: what they take up whole is told by nothing."""


@dataclass(frozen=True, eq=False)
class ExtraParameters:
    """K parameters, each of which no solution had, to first order."""

    information: Array  # (K, K) g_perp'g_perp; zero where the other unknowns take up all
    pull: Array  # (K,) g_perp'r
    variance: float  # of a whitened residual
    spread: Array  # (K,) variance of the photos' scores, of what independent residuals give; 1 at least
    photos: Array  # (K,) so many that tell alike would tell as much
    taken: Array  # (P, K) what the camera's parameters are off by for a unit that is left out

    @property
    def amplitude(self) -> Array:
        """Each as the only one (K,); 0 where nothing tells it."""
        told = np.diagonal(self.information)
        return np.where(told > 0, self.pull / np.where(told > 0, told, 1.0), 0.0)

    @property
    def sigma(self) -> Array:
        """Their standard deviations (K,); without bound where nothing tells them."""
        told = np.diagonal(self.information)
        return np.sqrt(np.where(told > 0, self.variance * self.spread / np.where(told > 0, told, 1.0), np.inf))

    @property
    def precision(self) -> Array:
        """The inverse covariance of all together (K, K), with the photos' spread in it."""
        root = np.sqrt(self.spread)
        return self.information / self.variance / root[:, None] / root


def extra_parameters(calibration: Calibration, moved_px: Array) -> ExtraParameters | None:
    """How large extra parameters are and what they did to the camera; None if there is nothing to tell it by.

    Args:
        calibration: of a camera whose parameters are few.
        moved_px: where a unit of each parameter moves the measured centres from what camera and pose show, (M, 2, K)
            of all M observations.
    """
    basis = free_directions(calibration.param_covariance)
    inner, count = basis.shape[1], moved_px.shape[2]
    blocks, raw, equations = [np.zeros((0, inner + count + 1, inner + count + 1))], np.zeros(count), -inner
    for view in whitened_views(calibration, basis):
        if 2 * len(view.row) <= POSE:
            continue
        moved = view.weight @ moved_px[view.row]
        flat = np.concatenate([view.by_camera, moved, -view.residual], axis=2).reshape(2 * len(view.row), -1)
        across = view.poses_taken().reshape(-1, POSE)
        left = flat - across @ (across.T @ flat)
        blocks.append((left.T @ left)[None])
        raw += (moved**2).sum(axis=(0, 1))
        equations += 2 * len(view.row) - POSE
    block = np.concatenate(blocks)  # (V, Q + K + 1, Q + K + 1)
    whole = block.sum(axis=0)
    if not (equations > 0 and len(block) > 1 and inner):
        return None
    by_camera = symmetric_inverse(whole[:inner, :inner]).inverse @ whole[:inner, inner:]
    off = np.concatenate([-by_camera, np.eye(count + 1)])
    left = off.T @ block @ off  # (V, K + 1, K + 1) the camera eliminated
    each, pulls, total = left[:, :-1, :-1], left[:, :-1, -1], left.sum(axis=0)
    told = np.diagonal(total)[:-1] > TOLD * raw
    information = np.where(told[:, None] & told, total[:-1, :-1], 0.0)
    own = np.where(told, np.diagonal(total)[:-1], 1.0)
    pull = np.where(told, total[:-1, -1], 0.0)
    variance = float(total[-1, -1]) / equations
    if not variance > 0:
        return None
    # Scores with the parameter let free sum to nothing; independent ones would vary by A_v - A_v^2 / A.
    parts = np.diagonal(each, axis1=1, axis2=2)  # (V, K)
    score = pulls - parts * (pull / own)
    expected = variance * (parts - parts**2 / own).sum(axis=0)
    spread = np.where(told & (expected > 0), (score**2).sum(axis=0) / np.where(expected > 0, expected, 1.0), 1.0)
    photos = own**2 / np.maximum((parts**2).sum(axis=0), 1e-300)
    return ExtraParameters(
        information, pull, variance, np.maximum(spread, 1.0), np.where(told, photos, 0.0),
        basis @ by_camera[:, :-1],
    )  # fmt: skip
