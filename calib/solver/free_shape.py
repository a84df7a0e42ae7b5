"""The normal equations of a camera and the shape of its target, the poses eliminated.

Of a solution, the sightings are taken to first order in the parameters of the camera, in numbers x that displace the
target's points together, and in numbers y that displace each point alone:

    r + G c + P p + T (sum_s modes_s x_s + own y) = noise

with the derivatives G by the camera, P by the view's pose and T by a point's place on the target. The pose is taken out
of each view by an orthonormal basis Q of P's columns: `A' A - (Q' A)' (Q' A)`, A being all other columns.

Parameters that a solution did not have: how large its residuals say they are, and what leaving them out did.

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

from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from calib.cameras import linearise
from calib.cameras.surface import surface_model
from calib.core.linear_algebra import symmetric_inverse
from calib.core.types import Observations
from calib.solver.calibration import Calibration
from calib.solver.problem import Prior, whiteners
from designer.base.arrays import Array, Flags, Rows

SINGULAR = 1e-13
"""Of the eigenvalues of the parameters' correlations; those of fixed and shared parameters are less."""
POSE = 6


@dataclass(frozen=True, eq=False)
class OwnEquations:
    """The part of the U points' own numbers, C each, poses not yet eliminated: that would couple all with all.

    With the block diagonal D of their normal matrix and the poses' part F, it is `D - F' F`.
    """

    block: Array  # (U, C, C) D
    by_poses: Array  # (K, U C) F, K at most six times the views
    cross: Array  # (N, U C) with the unknowns of `ShapeEquations`, poses eliminated
    gradient: Array  # (U C,) poses eliminated


@dataclass(frozen=True, eq=False)
class ShapeEquations:
    """Normal equations of Q directions of the camera's parameters and N - Q numbers that the target's points share."""

    basis: Array  # (P, Q) the directions in which the parameters were estimated
    normal: Array  # (N, N) poses eliminated
    gradient: Array  # (N,)
    square: float  # sum of the squares of the residuals
    equations: int  # less those that the poses take
    own: OwnEquations

    @property
    def camera(self) -> slice:
        """The unknowns of the camera."""
        return slice(self.basis.shape[1])


@dataclass(frozen=True, eq=False)
class PosedSightings:
    """The M sightings that count of what one pose moves, to first order, times their weights."""

    point: Rows  # (M,)
    by_camera: Array  # (M, 2, Q)
    residual: Array  # (M, 2, 1)
    by_pose: Array  # (M, 2, 6)
    by_place: Array  # (M, 2, 3) in the target's frame

    def between(self, first: int, last: int) -> "PosedSightings":
        """Those from one on, up to another."""
        part = slice(first, last)
        return PosedSightings(
            self.point[part], self.by_camera[part], self.residual[part], self.by_pose[part], self.by_place[part]
        )

    @staticmethod
    def joined(parts: "Sequence[PosedSightings]") -> "PosedSightings":
        """All of several."""
        return PosedSightings(
            np.concatenate([one.point for one in parts]),
            np.concatenate([one.by_camera for one in parts]),
            np.concatenate([one.residual for one in parts]),
            np.concatenate([one.by_pose for one in parts]),
            np.concatenate([one.by_place for one in parts]),
        )

    def poses_taken(self) -> Array:
        """An orthonormal basis of what the pose takes up (M, 2, 6), from columns whose lengths are made alike."""
        flat = self.by_pose.reshape(-1, POSE)
        basis: Array = np.linalg.qr(flat / np.maximum(np.linalg.norm(flat, axis=0), 1e-300))[0]
        return basis.reshape(self.by_pose.shape)


@dataclass(frozen=True, eq=False)
class WhitenedView(PosedSightings):
    """Those of a view."""

    row: Rows  # (M,) of the observations
    weight: Array  # (M, 2, 2) whitener of each, unity if the solution is not weighted


def free_directions(param_covariance: Array) -> Array:
    """Independent directions (P, Q) in which parameters were estimated, each a standard deviation long."""
    sigma = np.sqrt(np.maximum(np.diagonal(param_covariance), 0.0))
    if not np.isfinite(param_covariance).all() or not (sigma > 0).any():
        return np.zeros((len(sigma), 0))
    unit = np.where(sigma > 0, sigma, 1.0)
    value, axis = np.linalg.eigh(param_covariance / unit[:, None] / unit)
    able = value > SINGULAR * value.max()
    free: Array = sigma[:, None] * axis[:, able] * np.sqrt(value[able])
    return free


def camera_directions(calibration: Calibration) -> Array:
    """The directions (P, Q) in which a camera was estimated; of one with a surface those of its base.

    What a target's errors do to hundreds of control points is taken to be what they do to the few numbers of the base.
    """
    surface, covariance = surface_model(calibration.camera.model), calibration.param_covariance
    if surface is None:
        return free_directions(covariance)
    base = surface.first_control
    directions = free_directions(covariance[:base, :base])
    return np.concatenate([directions, np.zeros((len(covariance) - base, directions.shape[1]))])


def shape_equations(calibration: Calibration, basis: Array, modes_mm: Array, own_mm: Array) -> ShapeEquations:
    """The normal equations at a solution, for `free_directions` of the camera; see `equations_of`."""
    used = np.unique(calibration.observations.point[~calibration.is_outlier])
    return equations_of(whitened_views(calibration, basis), used, basis, modes_mm, own_mm)


def equations_of(
    posed: Iterable[PosedSightings], used: Rows, basis: Array, modes_mm: Array, own_mm: Array
) -> ShapeEquations:
    """The normal equations of sightings, pose by pose.

    The K points are displaced by numbers that they share, `modes_mm` (S, K, 3), and each by its own, `own_mm` (K, 3,
    C); points that are not used, since they count in no view, have no unknowns.
    """
    each = own_mm.shape[2]
    dense, count = basis.shape[1] + len(modes_mm), each * len(used)
    slot = np.zeros(len(own_mm), dtype=np.int64)
    slot[used] = np.arange(len(used))
    # The residuals stand behind the other columns.
    products, block = np.zeros((dense + 1,) * 2), np.zeros((len(used), each, each))
    cross = np.zeros((len(used), each, dense + 1))
    taken, taken_own, equations = [np.zeros((0, dense + 1))], [np.zeros((0, count))], 0
    by_point = np.ascontiguousarray(modes_mm.transpose(1, 2, 0))
    is_moved: Flags = np.asarray((by_point != 0).any(axis=1))
    for view in posed:
        point, by_place = view.point, view.by_place
        if 2 * len(point) <= POSE:
            continue
        # A photo shows few faces of a solid: the modes of the others move nothing in it.
        mode = np.flatnonzero(is_moved[point].any(axis=0))
        column = np.concatenate([np.arange(basis.shape[1]), basis.shape[1] + mode, [dense]])
        by_modes = by_place @ by_point[point[:, None, None], np.arange(3)[:, None], mode]
        common = np.concatenate([view.by_camera, by_modes, view.residual], axis=2)
        own, row = by_place @ own_mm[point], slot[point]
        flat = common.reshape(-1, len(column))
        products[column[:, None], column] += flat.T @ flat
        _add_to(block, row, own.transpose(0, 2, 1) @ own)
        with_own = np.zeros((len(point), each, dense + 1))
        with_own[:, :, column] = own.transpose(0, 2, 1) @ common
        _add_to(cross, row, with_own)
        across = view.poses_taken()
        part = np.zeros((len(used), POSE, each))
        _add_to(part, row, across.transpose(0, 2, 1) @ own)
        taken.append(np.zeros((POSE, dense + 1)))
        taken[-1][:, column] = across.reshape(-1, POSE).T @ flat
        taken_own.append(part.transpose(1, 0, 2).reshape(POSE, count))
        equations += 2 * len(point) - POSE
    by_poses, own_by_poses = np.concatenate(taken), np.concatenate(taken_own)
    products -= by_poses.T @ by_poses
    of_own = cross.reshape(count, dense + 1) - own_by_poses.T @ by_poses
    if len(own_by_poses) > count:  # of many photos only the product counts
        own_by_poses = np.asarray(np.linalg.qr(own_by_poses, mode="r"))
    alone = OwnEquations(block, own_by_poses, np.ascontiguousarray(of_own[:, :-1].T), of_own[:, -1])
    return ShapeEquations(basis, products[:-1, :-1], products[:-1, -1], float(products[-1, -1]), equations, alone)


def _add_to(total: Array, row: Rows, part: Array) -> None:
    """Add parts (M, ...) to rows of a sum; rows come twice only where several cameras of a pose see a point."""
    if len(np.unique(row)) == len(row):
        total[row] += part
    else:
        np.add.at(total, row, part)


def whitened_views(calibration: Calibration, basis: Array) -> Iterator[WhitenedView]:
    """The observations of each view that count, to first order; `basis` are directions of the parameters (P, Q)."""
    seen, columns = calibration.observations, np.cumsum([basis.shape[1], 1, POSE])
    for view, pose in enumerate(calibration.cam_from_target):
        row = np.flatnonzero((seen.view == view) & ~calibration.is_outlier)
        rotation, residual = pose[:3, :3], calibration.residual_px[row].T[:, None]
        place = rotation @ seen.points.position_mm[seen.point[row]].T + pose[:3, 3:]  # (3, M)
        linear = linearise(calibration.camera, place)
        by_place, after, before = linear.by_point, [1, 2, 0], [2, 0, 1]
        # A turn by w about the camera's axes moves a place p by w x p.
        by_turn = place[after] * by_place[:, before] - place[before] * by_place[:, after]
        weight = weights(seen, row, weighted=calibration.weighted)
        whole = weight @ np.concatenate(
            [basis.T @ linear.by_params, residual, by_turn, by_place, rotation.T @ by_place], axis=1
        ).transpose(2, 0, 1)
        by_camera, residual, by_pose, by_place = np.split(whole, columns, axis=2)
        yield WhitenedView(seen.point[row], by_camera, residual, by_pose, by_place, row, weight)
    if calibration.priors and basis.shape[1]:
        yield _as_view(calibration, basis)


def _as_view(calibration: Calibration, basis: Array) -> WhitenedView:
    """What is known of parameters as a view of its own."""
    row = int(np.argmin(calibration.is_outlier))  # any that counts
    one = posed_prior(calibration.prior, calibration.camera.params, basis, int(calibration.observations.point[row]))
    count = len(one.point)
    return WhitenedView(
        one.point, one.by_camera, one.residual, one.by_pose, one.by_place, np.full(count, row), np.zeros((count, 2, 2))
    )


def posed_prior(prior: Prior, params: Array, basis: Array, point: int) -> PosedSightings:
    """What is known of parameters (P,) as sightings of any point; a pose takes up rows that say nothing.

    By directions of them (P, Q).
    """
    weight = prior.variance * np.diagonal(prior.precision)
    known = np.flatnonzero(weight)
    count = POSE + len(known) + len(known) % 2
    rows, root = slice(POSE, POSE + len(known)), np.sqrt(weight[known])
    by_camera, residual = np.zeros((count, basis.shape[1])), np.zeros(count)
    by_camera[rows] = root[:, None] * basis[known]
    residual[rows] = root * (params - prior.mean)[known]
    return PosedSightings(
        np.full(count // 2, point), by_camera.reshape(-1, 2, basis.shape[1]), residual.reshape(-1, 2, 1),
        np.eye(count, POSE).reshape(-1, 2, POSE), np.zeros((count // 2, 2, 3)),
    )  # fmt: skip


def weights(seen: Observations, row: Rows, *, weighted: bool) -> Array:
    """The whiteners of some observations (M, 2, 2), unity if they are not weighted."""
    if not weighted or seen.cov_px2 is None or not len(row):
        return np.tile(np.eye(2), (len(row), 1, 1))
    a, b, c = whiteners(seen.cov_px2[row])
    return np.stack([a, np.zeros_like(a), b, c], axis=1).reshape(-1, 2, 2)


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

    By directions (P, Q) of all other unknowns, pose by pose.
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
