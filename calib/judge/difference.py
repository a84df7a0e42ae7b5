"""How far two solutions of one camera lie apart over a part of the image, and how far their covariances allow.

As in `calib.cameras.refit` and `calib.solver.accuracy`, a common rotation does not count; here the
rotation is the best one of the pixels looked at, so that corners where nothing was seen do not turn the rest.
"""

from dataclasses import dataclass
from typing import Annotated

import numpy as np

from calib.cameras import linearise, project, rays
from calib.cameras.camera import Camera
from calib.cameras.refit import camera_difference
from calib.core.linear_algebra import least_squares, moved_covariance, worse_sigma
from calib.core.types import freeze
from calib.judge.coverage import Coverage
from calib.solver.accuracy import SHARE_PERCENT
from designer.base.arrays import Array, Flags
from designer.base.errors import InputError
from designer.base.marks import PACKED, Shape

EVERY = 2
"""Of the cells of the coverage, along both axes."""
LEAST_PIXELS = 20
LEAST_PART = 1e-10
"""A variance that is this part of the largest is none."""


@dataclass(frozen=True, eq=False)
class Known:
    """A camera with the covariance of its parameters."""

    camera: Camera
    param_covariance: Annotated[Array, Shape("P", "P"), PACKED]

    def __post_init__(self) -> None:
        freeze(self, "param_covariance")

    @staticmethod
    def exactly(camera: Camera) -> "Known":
        """A camera that is taken as it is."""
        return Known(camera, np.zeros((len(camera.params),) * 2))


@dataclass(frozen=True, eq=False)
class Apart:
    """The difference of camera B from camera A on a grid of A's pixels, nan where nothing was seen or known."""

    pixel: Array  # (R, C, 2)
    difference_px: Array  # (R, C, 2)
    covariance_px2: Array  # (R, C, 2, 2) of the difference, as the solutions state it
    is_covered: Flags  # (R, C) where something was seen

    def __post_init__(self) -> None:
        freeze(self, "pixel", "difference_px", "covariance_px2")
        freeze(self, "is_covered", dtype=np.bool_)

    @property
    def length_px(self) -> Array:
        """Lengths (R, C)."""
        return np.asarray(np.linalg.norm(self.difference_px, axis=-1))

    @property
    def is_known(self) -> Flags:
        """Where both cameras are known.  # (R, C)"""
        return np.asarray(np.isfinite(self.length_px))

    @property
    def percentile_95_px(self) -> float:
        """What 95 % of the area differ by at most."""
        return float(np.percentile(self.length_px[self.is_known], SHARE_PERCENT))

    @property
    def ratio(self) -> float:
        """The difference in stated standard deviations, 1 on average if they are honest."""
        return in_sigmas(self.difference_px[self.is_known], self.covariance_px2[self.is_known])

    @property
    def stated_px(self) -> float:
        """Root mean square length that the covariances let expect."""
        trace = np.trace(self.covariance_px2[self.is_known], axis1=1, axis2=2)
        return float(np.sqrt(max(float(trace.mean()), 0.0)))

    @property
    def rms_px(self) -> float:
        """Root mean square length."""
        return float(np.sqrt((self.length_px[self.is_known] ** 2).mean()))


def apart(a: Known, b: Known, coverage: Coverage) -> Apart | None:
    """How far two solutions lie apart where the image is covered; None if they share too few pixels there."""
    pixel, covered = coverage.middle_px[::EVERY, ::EVERY], coverage.is_covered[::EVERY, ::EVERY]
    try:
        turn = camera_difference(a.camera, b.camera).b_from_a
    except InputError:  # cameras of other image sizes, or that share no pixel
        return None
    flat = pixel.reshape(-1, 2)
    row = np.flatnonzero(covered)
    ray = rays(a.camera, flat[row])
    off = project(b.camera, ray @ turn.T) - flat[row]
    # b's rays are asked for too: its covariance is stated where it sees the same light.
    known = np.isfinite(off).all(axis=1) & np.isfinite(rays(b.camera, np.nan_to_num(flat[row] + off))).all(axis=1)
    row, ray, off = row[known], ray[known], off[known]
    if len(row) < LEAST_PIXELS:
        return None
    difference = np.full((len(flat), 2), np.nan)
    covariance = np.full((len(flat), 2, 2), np.nan)
    changes, difference[row] = _less_turn(b.camera, ray @ turn.T, off)
    own, _ = _less_turn(a.camera, ray, off)
    covariance[row] = moved_covariance(own, a.param_covariance) + moved_covariance(changes, b.param_covariance)
    shape = pixel.shape[:2]
    return Apart(pixel, difference.reshape(*shape, 2), covariance.reshape(*shape, 2, 2), covered)


def _less_turn(camera: Camera, ray: Array, off: Array) -> tuple[Array, Array]:
    """Derivatives (N, 2, P) by the parameters where rays (N, 3) are seen, and offsets (N, 2), less their best turn."""
    seen = linearise(camera, np.ascontiguousarray(ray.T))
    by_params = seen.by_params.transpose(2, 0, 1)
    by_turn = np.cross(ray[:, None, :], seen.by_point.transpose(2, 0, 1))
    fields = np.concatenate([by_params, off[:, :, None]], axis=2)
    turn = least_squares(by_turn.reshape(-1, 3), fields.reshape(-1, fields.shape[2]))
    rest = fields - by_turn @ turn
    return rest[:, :, :-1], rest[:, :, -1]


def sigma_over(known: Known, coverage: Coverage) -> Array:
    """Standard deviations (N,) along their worse axes over the covered cells, less the best turn of these."""
    none = np.zeros(len(known.camera.params))
    _, covariance = moved_over(known.camera, none, known.param_covariance, coverage)
    return worse_sigma(covariance)


def moved_over(camera: Camera, step: Array, covariance: Array, coverage: Coverage) -> tuple[Array, Array]:
    """How far a step (P,) of the parameters moves pixels (N, 2), and its covariances (N, 2, 2), over covered cells."""
    flat = coverage.middle_px[::EVERY, ::EVERY].reshape(-1, 2)[coverage.is_covered[::EVERY, ::EVERY].reshape(-1)]
    ray = rays(camera, flat)
    ray = ray[np.isfinite(ray).all(axis=1)]
    if len(ray) < LEAST_PIXELS:
        return np.zeros((0, 2)), np.zeros((0, 2, 2))
    by_params, _ = _less_turn(camera, ray, np.zeros((len(ray), 2)))
    return by_params @ step, moved_covariance(by_params, covariance)


def in_sigmas(field_px: Array, covariance_px2: Array) -> float:
    """The size of a field in its standard deviations: `sqrt(mean(d' C^-1 d) / 2)`, 1 on average if these are right.

    Where a covariance has a direction without variance, as with fixed parameters, nothing can be off in it.

    Args:
        field_px: d, differences in pixels (N, 2).
        covariance_px2: C, their covariances (N, 2, 2).
    """
    value, axis = np.linalg.eigh(covariance_px2)
    along = np.einsum("nij,ni->nj", axis, field_px)
    able = value > LEAST_PART * value.max(initial=0.0)
    square = np.where(able, along**2 / np.where(able, value, 1.0), 0.0)
    return float(np.sqrt(square.sum() / max(int(able.sum()), 1)))
