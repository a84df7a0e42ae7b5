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

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from calib.core.linear_algebra import symmetric_inverse
from calib.solver.calibration import Calibration
from calib.solver.free_shape import POSE, PosedSightings, free_directions, whitened_views
from designer.base.arrays import Array

TOLD = 1e-8
"""Part of a column's square that camera and poses must leave: what they take up whole is told by nothing."""


@dataclass(frozen=True, eq=False)
class ExtraParameters:
    """K parameters that a solution did not have, to first order."""

    block: Array  # (V, K + 1, K + 1) by photo: products of columns and, last, residuals, camera and poses taken off
    square: Array  # (K,) of the columns before
    equations: int  # less the unknowns
    taken: Array  # (P, K) what the camera's parameters are off by for a unit that is left out

    @cached_property
    def information(self) -> Array:
        """Products of the columns (K, K); zero of those that the other unknowns take up."""
        whole = self.block[:, :-1, :-1].sum(axis=0)
        told = np.diagonal(whole) > TOLD * self.square
        return np.where(told[:, None] & told, whole, 0.0)

    @cached_property
    def pull(self) -> Array:
        """Products of columns and residuals (K,); zero of those that the other unknowns take up."""
        return np.where(np.diagonal(self.information) > 0, self.block[:, :-1, -1].sum(axis=0), 0.0)

    @cached_property
    def amplitude(self) -> Array:
        """Each as the only one (K,); 0 where nothing tells it."""
        told = np.diagonal(self.information)
        return self.pull / np.where(told > 0, told, 1.0)

    @cached_property
    def variance(self) -> float:
        """Of a whitened residual."""
        return float(self.block[:, -1, -1].sum()) / self.equations

    @cached_property
    def spread(self) -> Array:
        """The variance of the photos' scores, of what independent residuals give (K,); 1 at least.

        With the parameter let free they sum to nothing, and independent ones vary by `A_v - A_v^2 / A`.
        """
        own = np.diagonal(self.information)
        part = np.where(own > 0, np.diagonal(self.block, axis1=1, axis2=2)[:, :-1], 0.0)
        score = np.where(own > 0, self.block[:, :-1, -1] - part * self.amplitude, 0.0)
        expected = self.variance * (part - part**2 / np.where(own > 0, own, 1.0)).sum(axis=0)
        spread: Array = np.maximum((score**2).sum(axis=0) / np.where(expected > 0, expected, np.inf), 1.0)
        return spread

    @cached_property
    def sigma(self) -> Array:
        """Standard deviations of the amplitudes (K,); without bound where nothing tells them."""
        told = np.diagonal(self.information)
        return np.sqrt(np.where(told > 0, self.variance * self.spread / np.where(told > 0, told, 1.0), np.inf))

    @cached_property
    def photos(self) -> Array:
        """So many photos that tell an amplitude alike would tell as much as these do (K,)."""
        part = np.diagonal(self.block, axis1=1, axis2=2)[:, :-1]
        return np.where(np.isfinite(self.sigma), part.sum(axis=0) ** 2 / np.maximum((part**2).sum(axis=0), 1e-300), 0.0)

    def beside(self, known: Sequence[int]) -> "ExtraParameters":
        """The same with some of them among the unknowns, of which then nothing more is told."""
        rows = list(known)
        inverse = symmetric_inverse(self.information[np.ix_(rows, rows)]).inverse
        off = np.eye(self.block.shape[1])
        off[rows] -= inverse @ self.block.sum(axis=0)[rows]
        return replace(self, block=off.T @ self.block @ off, equations=self.equations - len(rows))


def extra_parameters(calibration: Calibration, moved_px: Array) -> ExtraParameters | None:
    """How large extra parameters are and what they did to the camera; None if there is nothing to tell it by.

    Args:
        calibration: of a camera whose parameters are few.
        moved_px: where a unit of each parameter moves the measured centres from what camera and pose show, (M, 2, K)
            of all M observations.
    """
    basis = free_directions(calibration.param_covariance)
    views = whitened_views(calibration, basis)
    return extra_of(((view, view.weight @ moved_px[view.row]) for view in views), basis, moved_px.shape[2])


def extra_of(posed: Iterable[tuple[PosedSightings, Array]], basis: Array, count: int) -> ExtraParameters | None:
    """The same of what each pose moves, with where a unit of each of `count` parameters moves it, whitened, (M, 2, K).

    Args:
        posed: pose by pose, by directions of all other unknowns.
        basis: these directions (P, Q).
        count: of parameters, K.
    """
    inner, blocks, square, equations = basis.shape[1], [], np.zeros(count), -basis.shape[1]
    for view, moved in posed:
        if 2 * len(view.point) <= POSE:
            continue
        flat = np.concatenate([view.by_camera, moved, -view.residual], axis=2).reshape(2 * len(view.point), -1)
        across = view.poses_taken().reshape(-1, POSE)
        left = flat - across @ (across.T @ flat)
        blocks.append(left.T @ left)
        square += (moved**2).sum(axis=(0, 1))
        equations += 2 * len(view.point) - POSE
    if not blocks:
        return None
    block = np.stack(blocks)  # (V, Q + K + 1, Q + K + 1)
    whole = block.sum(axis=0)
    if not (equations > 0 and inner and whole[-1, -1] > 0):
        return None
    by_camera = symmetric_inverse(whole[:inner, :inner]).inverse @ whole[:inner, inner:]
    off = np.concatenate([-by_camera, np.eye(count + 1)])
    return ExtraParameters(off.T @ block @ off, square, equations, basis @ by_camera[:, :-1])
