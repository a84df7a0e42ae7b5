"""What a target that is not quite as its file says may have done to a camera that was solved from photos of it.

    calibration = with_target_error(calibration, how_made(target, "fdm-board"))
    calibration.stated_covariance

A camera solved as if the target were as its file says is off by the noise, and by what the target is off. The photos
tell the target's shape in part: of the numbers s of its prior, standard normal beforehand, they leave the distribution
of the least-squares problem that has them as unknowns, with an identity as their prior. With the noise's variance v and
the normal equations N over camera and shape (poses eliminated), E = (N + v diag(0, 1))^-1 and the gradient g by s,

    camera's error given the photos:  mean E_cs g_s,  covariance v E_cc.

The solution itself stays as it is, so its mean square error is `v E_cc + (E_cs g_s)(E_cs g_s)'`; what is more than
the noise alone would do, v N_cc^-1, is the target's part. Where the photos tell the shape and it is as the file says,
little is added; where they tell that it is not, the error that they tell is added; where they do not tell it, what the
way of making lets expect. What poses take up, also the size of the whole, does nothing; nor a bend solved for.
"""

from dataclasses import dataclass, replace

import numpy as np

from calib.core.linear_algebra import pseudo_inverse, symmetric_inverse
from calib.core.parallel import one_thread
from calib.core.types import KnownPoints
from calib.solver.calibration import Calibration, MadeWith, PlaneBend, TargetError
from calib.solver.free_shape import ShapeEquations, camera_directions, shape_equations
from designer.base.arrays import Array
from designer.target import TargetGeometry
from designer.tolerance.made import Made, prior_of
from designer.tolerance.prior import ShapePrior

ROUNDING = 1e-12
"""Of the residuals: of sightings that another shape explains to the last, so much noise is left."""
ROUNDS, SETTLED = 20, 1e-3
"""Of finding the noise's variance: until it changes by less than a thousandth."""


@one_thread
def with_target_error(calibration: Calibration, made: Made | None) -> Calibration:
    """The calibration with what its target's errors may have done to it; as it was if nobody knows how that was made.

    It was solved with the rings where the target's file has them; the prior of the way of making says where they may
    be. Without one, they are there.
    """
    return target_told(calibration, made)[0]


@one_thread
def target_told(calibration: Calibration, made: Made | None) -> "tuple[Calibration, LeftOpen | None]":
    """The same, and what is open of the target's shape: the same equations tell both."""
    if made is None:
        return calibration, None
    found = _equations(calibration, made.prior)
    settled = None if found is None else _settled(found[0])
    size = len(calibration.camera.params)
    covariance, opened = np.zeros((size, size)), None
    if found is not None and settled is not None:
        equations, modes_mm = found
        covariance, opened = _added(equations, settled), _opened(calibration, equations, modes_mm, settled)
    errors = None if made.errors is None else MadeWith.of(made.errors)
    return replace(calibration, target_error=TargetError(made.name, made.because, covariance, errors)), opened


def stated_prior(calibration: Calibration, target: TargetGeometry | None) -> ShapePrior | None:
    """The prior that a calibration was given for its target; None if it was given none, or does not tell it."""
    error = calibration.target_error
    if target is None or error is None or not error.param_covariance.any():
        return None
    return prior_of(target, error.made, None if error.errors is None else error.errors.model())


@dataclass(frozen=True, eq=False)
class LeftOpen:
    """What photos leave open of a camera and of the shape of its target together."""

    basis: Array  # (P, Q) of the camera's parameters
    modes_mm: Array  # (S, K, 3) displacements of the K points by the shape's shared numbers
    mean_square: Array  # (Q + S, Q + S) of the camera's error in the basis' directions and of these numbers


@one_thread
def left_open(calibration: Calibration, prior: ShapePrior | None) -> LeftOpen | None:
    """The same as a distribution: what further photos are to be weighed against; None where nothing is open."""
    found = _equations(calibration, prior)
    settled = None if found is None else _settled(found[0])
    if found is None or settled is None:
        return None
    return _opened(calibration, *found, settled)


def _opened(
    calibration: Calibration, equations: ShapeEquations, modes_mm: Array, settled: "tuple[Extended, float]"
) -> LeftOpen:
    solved, variance = settled
    square = variance * solved.covariance + np.outer(solved.mean, solved.mean)
    if calibration.target_bend is not None:  # of which the equations do not know
        camera, to_basis = equations.camera, pseudo_inverse(equations.basis)
        alone = variance * (solved.camera_inverse - solved.more)
        square[camera, camera] += to_basis @ calibration.param_covariance @ to_basis.T - alone
    return LeftOpen(equations.basis, modes_mm, square)


def _equations(calibration: Calibration, prior: ShapePrior | None) -> tuple[ShapeEquations, Array] | None:
    """The normal equations with a prior's numbers, and those of its modes that move a point that was seen."""
    basis = camera_directions(calibration)
    if prior is None or not basis.size or calibration.camera.learned is not None:
        return None
    prior = unbent(prior, calibration.target_bend, calibration.observations.points)
    used = np.unique(calibration.observations.point[~calibration.is_outlier])
    modes_mm = prior.modes_mm[np.abs(prior.modes_mm[:, used]).max(axis=(1, 2), initial=0.0) > 0]
    return shape_equations(calibration, basis, modes_mm, prior.ring_modes_mm), modes_mm


def unbent(prior: ShapePrior, bend: PlaneBend | None, points: KnownPoints) -> ShapePrior:
    """A prior without what a solution has among its unknowns, and states as such."""
    if bend is None:
        return prior
    heights, modes = bend.heights_of(points.position_mm, prior.modes_mm), bend.modes_mm(points.position_mm)
    return replace(prior, modes_mm=prior.modes_mm - np.tensordot(heights, modes, 1))


def added_covariance(equations: ShapeEquations) -> Array:
    """The parameters' mean square error by the target.  # (P, P)"""
    settled = _settled(equations)
    return np.zeros((len(equations.basis),) * 2) if settled is None else _added(equations, settled)


def _added(equations: ShapeEquations, settled: "tuple[Extended, float]") -> Array:
    basis, (found, variance) = equations.basis, settled
    step = found.mean[equations.camera]
    added: Array = basis @ (variance * found.more + np.outer(step, step)) @ basis.T
    return added


def _settled(equations: ShapeEquations) -> "tuple[Extended, float] | None":
    """The extended problem with the noise's variance that it leaves over; None if there is nothing to tell it by."""
    shared = equations.basis.shape[1]
    freedom = equations.equations - shared
    if freedom <= 0 or not equations.square > 0 or len(equations.normal) + len(equations.own.gradient) == shared:
        return None
    variance = equations.square / freedom
    found = extended(equations, variance)
    for _ in range(ROUNDS):
        # What a smoother leaves over has as many degrees of freedom as it does not take up.
        left = max(found.left, ROUNDING * equations.square) / max(freedom - found.told, 1.0)
        if abs(left - variance) <= SETTLED * variance:
            break
        variance = left
        found = extended(equations, variance)
    return found, variance


@dataclass(frozen=True, eq=False)
class Extended:
    """The least-squares problem with the target's shape among the unknowns, for one variance of the noise."""

    camera_inverse: Array  # (Q, Q) E_cc
    more: Array  # (Q, Q) E_cc - N_cc^-1: what the camera is less sure by, with the shape unknown
    covariance: Array  # (N, N) E of the camera and the shared numbers
    mean: Array  # (N,) of the same
    left: float  # sum of squares of the residuals
    told: float  # how many of the shape's numbers the photos tell


def extended(equations: ShapeEquations, variance: float) -> Extended:
    """Eliminate the points' own numbers, then the shared ones.

    With G = (D + v)^-1, which is one small block a point, (D + v - F' F)^-1 is G + G F' (1 - F G F')^-1 F G (Woodbury).
    """
    own, camera = equations.own, equations.camera
    shared, count = slice(camera.stop, None), equations.own.block.shape[1]
    each = symmetric_inverse(own.block + variance * np.eye(count)).inverse  # G (U, C, C)

    def g_times(columns: Array) -> Array:
        return (each @ columns.reshape(len(each), count, columns.shape[1])).reshape(columns.shape)

    by_poses = g_times(own.by_poses.T)  # G F'
    inner = symmetric_inverse(np.eye(len(own.by_poses)) - own.by_poses @ by_poses).inverse
    right = np.column_stack([own.cross.T, own.gradient])
    solved = g_times(right) + by_poses @ (inner @ (by_poses.T @ right))
    # The solution is the minimum for the target as its file has it, whatever loss it was found with.
    gradient = np.where(np.arange(len(equations.gradient)) < camera.stop, 0.0, equations.gradient)
    taken, normal = own.cross @ solved[:, :-1], equations.normal
    prior = np.diag(np.where(np.arange(len(normal)) < camera.stop, 0.0, variance))
    reduced, pull = normal + prior - 0.5 * (taken + taken.T), gradient - own.cross @ solved[:, -1]
    modes = symmetric_inverse(reduced[shared, shared]).inverse
    lost = normal[camera, camera] - reduced[camera, camera] + reduced[camera, shared] @ modes @ reduced[shared, camera]
    inverse = symmetric_inverse(normal[camera, camera] - lost).inverse
    by_camera = modes @ reduced[shared, camera]
    whole = np.block(
        [[inverse, -inverse @ by_camera.T], [-by_camera @ inverse, modes + by_camera @ inverse @ by_camera.T]]
    )
    step = -inverse @ (pull[camera] - by_camera.T @ pull[shared])
    all_shared = np.concatenate([step, -modes @ (pull[shared] + reduced[shared, camera] @ step)])
    alone = -solved[:, -1] - solved[:, :-1] @ all_shared
    trace = float(
        np.trace(whole[shared, shared]) + np.trace(each, axis1=1, axis2=2).sum()
        + (by_poses * (by_poses @ inner)).sum() + (solved[:, :-1] * (solved[:, :-1] @ whole)).sum()
    )  # fmt: skip
    numbers = np.concatenate([all_shared[shared], alone])
    least = equations.square + float(gradient @ all_shared + own.gradient @ alone)
    # (N - T)^-1 - N^-1 = N^-1 (T + T (N - T)^-1 T) N^-1 is positive semidefinite as it stands.
    plain = symmetric_inverse(normal[camera, camera]).inverse
    more = plain @ (lost + lost @ inverse @ lost) @ plain
    left, told = least - variance * float(numbers @ numbers), len(numbers) - variance * trace
    return Extended(inverse, more, whole, all_shared, left, told)
