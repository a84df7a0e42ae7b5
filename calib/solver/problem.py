"""Observations packed for the kernels: coordinate by coordinate, view after view.

What a person may choose about a solution, and which parameters are free, fixed or shared by it.
"""

from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import Annotated, Literal

import numpy as np

from calib.cameras import MODELS, solved_models, told_parameters
from calib.cameras.camera import Camera
from calib.core.jit import jit
from calib.core.se3 import skew
from calib.core.types import Observations
from calib.solver.costs import IMAGE
from calib.solver.distance import InSpace
from calib.solver.priors import ParameterPrior, require_priors
from designer.base.arrays import Array, Flags, Rows
from designer.base.errors import InputError
from designer.base.marks import LEFT_OUT

GOLDEN = 0.6180339887498949
MANY = 2**62
ENOUGH = 800
FEWEST = 24
"""Of a view: six times what a homography needs."""


@dataclass(frozen=True, eq=False)
class Prior:
    """What is believed beforehand of an adjustment's S amounts of displacements and P parameters of the camera."""

    mean: Array  # (S + P,)
    precision: Array  # (S + P, S + P) the inverse of their covariance, 0 of what nothing is known of
    variance: float = 1.0  # of a whitened residual, as the sum of squares weighs the belief against these

    def block(self, value: Array) -> Array:
        """Its normal equations at values (S + P,), as a view's: of a pose that nothing hangs on.  # (S + P + 7,) * 2"""
        off, weight = value - self.mean, self.variance * self.precision
        block = np.diag(np.repeat([0.0, 1.0, 0.0], [len(off), 6, 1]))
        block[: len(off), : len(off)], pull = weight, weight @ off
        block[: len(off), -1] = block[-1, : len(off)] = pull
        block[-1, -1] = off @ pull
        return block


def prior_of(priors: Sequence[ParameterPrior], names: Sequence[str], variance: float) -> Prior:
    """What priors say of parameters of these names, beside whitened residuals of such a variance."""
    mean, precision = np.zeros(len(names)), np.zeros(len(names))
    for one in priors:
        mean[names.index(one.name)], precision[names.index(one.name)] = one.value, one.sigma**-2
    return Prior(mean, np.diag(precision), variance)


@dataclass(frozen=True, eq=False)
class Problem:
    """M observations in V views; the observations of view v are those from `view_start[v]` to `view_start[v + 1]`."""

    image_size: tuple[int, int]
    view_start: Rows  # (V + 1,)
    position_mm: Array  # (3, M) in the target's axes, from `origin_mm`
    measured_px: Array  # (2, M)
    whitener: Array  # (3, M) a, b, c of [[a, 0], [b, c]], which makes the covariance of an observation unity
    is_used: Flags  # (M,)
    origin_mm: Array = field(default_factory=lambda: np.zeros(3))  # (3,) the points' middle: a far one costs digits
    space: InSpace | None = None  # distances in space are minimised; None: those in the image
    modes_mm: Array = field(default_factory=lambda: np.zeros((0, 3, 0)))
    """(S, 3, M) displacements of the points by a unit of each of S more unknowns, before the camera's parameters."""
    amount: Array = field(default_factory=lambda: np.zeros(0))  # (S,) of these, by which `position_mm` is displaced
    shifts: Array = field(default_factory=lambda: np.zeros((0, 0, 4)))
    """(S, V, 4) of fx, fy, cx, cy in each view by a unit of each amount; of none where there are none at all."""
    prior: Prior | None = None

    def at(self, amount: Array) -> "Problem":
        """With the points displaced by other amounts (S,)."""
        if not len(amount):
            return self
        moved = np.tensordot(amount - self.amount, self.modes_mm, 1)
        return replace(self, position_mm=self.position_mm + moved, amount=amount)

    def linear(self, camera: Camera) -> Array | None:
        """Values of fx, fy, cx, cy in each view (V, 4), where these vary."""
        return camera.params[:4] + np.tensordot(self.amount, self.shifts, 1) if len(self.shifts) else None

    def with_shifts(self, shifts: Array, sigma: Array, parameters: int) -> "Problem":
        """With K more amounts behind those there are, which shift views (K, V, 4), of deviations (K,) about zero."""
        before, count = len(self.amount), len(self.amount) + len(shifts)
        own = self.shifts if len(self.shifts) else np.zeros((before, *shifts.shape[1:]))
        modes = np.zeros((count, *self.position_mm.shape))
        modes[:before] = self.modes_mm if before else 0.0
        kept = np.r_[0:before, count : count + parameters]
        mean, precision = np.zeros(count + parameters), np.zeros((count + parameters,) * 2)
        if self.prior is not None:
            mean[kept], precision[np.ix_(kept, kept)] = self.prior.mean, self.prior.precision
        precision[range(before, count), range(before, count)] = sigma**-2
        return replace(
            self, modes_mm=modes, amount=np.concatenate([self.amount, np.zeros(len(shifts))]),
            shifts=np.concatenate([own, shifts]),
            prior=Prior(mean, precision, 1.0 if self.prior is None else self.prior.variance),
        )  # fmt: skip

    @property
    def without_amounts(self) -> "Problem":
        """With the points displaced as they are, for good."""
        count, prior = len(self.amount), self.prior
        if prior is not None:
            prior = replace(prior, mean=prior.mean[count:], precision=prior.precision[count:, count:])
        return replace(self, modes_mm=self.modes_mm[:0], amount=self.amount[:0], shifts=self.shifts[:0], prior=prior)

    def rows(self, tie: Rows) -> Rows:
        """The free unknown of each amount and each parameter (S + P,), of those of the parameters alone (P,)."""
        count = len(self.amount)
        return np.concatenate([np.arange(count), np.where(tie >= 0, tie + count, -1)])

    @property
    def view_count(self) -> int:
        """V."""
        return len(self.view_start) - 1

    @property
    def view(self) -> Rows:
        """The view of each observation.  # (M,)"""
        return np.repeat(np.arange(self.view_count), np.diff(self.view_start))

    @cached_property
    def few(self) -> "Problem":
        """All views, with a few observations of each: enough for a rough solution."""
        return select(self, np.arange(self.view_count), few_per_view(self.view_count))


def pack(observations: Observations, *, weighted: bool) -> Problem:
    """The problem of all views, each of which has observations, weighted by their covariances if these are known."""
    count = len(observations.view)
    start = np.searchsorted(observations.view, np.arange(observations.view_count + 1))
    if (np.diff(start) == 0).any():
        raise ValueError("a view without observations; leave it out")
    whitener = np.repeat(np.array([[1.0], [0.0], [1.0]]), count, axis=1)
    if weighted and observations.cov_px2 is not None:
        whitener = whiteners(observations.cov_px2)
        if not np.isfinite(whitener).all():
            raise ValueError("a covariance that is not positive definite")
    position = observations.points.position_mm
    origin = observations.points.middle_mm
    moved = np.ascontiguousarray((position - origin).T)
    return Problem(
        observations.image_size,
        start,
        moved.take(observations.point, axis=1),
        np.ascontiguousarray(observations.center_px.T),
        whitener,
        np.ones(count, dtype=bool),
        origin,
    )


def target_poses(problem: Problem, poses: Array) -> Array:
    """Poses `cam_from_target` (V, 4, 4) of those that the problem has from its own origin."""
    moved = np.array(poses)
    moved[:, :3, 3] -= moved[:, :3, :3] @ problem.origin_mm
    return moved


def origin_poses(problem: Problem, cam_from_target: Array) -> Array:
    """The poses (V, 4, 4) from the problem's own origin, of those of the target."""
    moved = np.array(cam_from_target)
    moved[:, :3, 3] += moved[:, :3, :3] @ problem.origin_mm
    return moved


def target_covariance(problem: Problem, poses: Array, covariance: Array) -> Array:
    """Covariances (V, 6, 6) of `target_poses`, of the poses' own.

    A turn by w about the problem's origin o moves the target's by `w x (-R o) = (R o) x w`.
    """
    jacobian = np.zeros((len(poses), 6, 6)) + np.eye(6)
    jacobian[:, 3:, :3] = skew(poses[:, :3, :3] @ problem.origin_mm)
    moved: Array = jacobian @ covariance @ jacobian.transpose(0, 2, 1)
    return moved


def whiteners(cov_px2: Array) -> Array:
    """The inverses of the Cholesky factors of covariances (M, 2, 2): a, b, c of [[a, 0], [b, c]].  # (3, M)

    Not finite where a covariance is not positive definite.
    """
    with np.errstate(divide="ignore", invalid="ignore"):
        a = np.sqrt(cov_px2[:, 0, 0])
        b = cov_px2[:, 1, 0] / a
        c = np.sqrt(cov_px2[:, 1, 1] - b**2)
        return np.stack([1 / a, -b / (a * c), 1 / c])


def few_per_view(view_count: int) -> int:
    """How many observations of each view are enough for a rough solution: few where there are many views."""
    return max(ENOUGH // max(view_count, 1), FEWEST)


def select(problem: Problem, views: Rows, per_view: int) -> Problem:
    """Some views, with at most so many used observations of each, evenly spread over their order."""
    if len(views) == problem.view_count and per_view >= len(problem.is_used) and problem.is_used.all():
        return problem
    start, rows = select_rows(problem, views, per_view)
    return Problem(
        problem.image_size, start, problem.position_mm.take(rows, axis=1), problem.measured_px.take(rows, axis=1),
        problem.whitener.take(rows, axis=1), np.ones(len(rows), dtype=bool), problem.origin_mm,
        None if problem.space is None else problem.space.take(rows),
        problem.modes_mm[:, :, rows] if len(problem.amount) else problem.modes_mm, problem.amount,
        problem.shifts[:, views] if len(problem.shifts) else problem.shifts, problem.prior,
    )  # fmt: skip


def select_rows(problem: Problem, views: Rows, per_view: int) -> tuple[Rows, Rows]:
    """Where each view's begin among the observations of `select`, and which these are."""
    start = np.zeros(len(views) + 1, dtype=np.int64)
    rows = np.empty(min(len(problem.is_used), per_view * len(views)), dtype=np.int64)
    _spread_rows(problem.view_start, problem.is_used, views, per_view, start, rows)
    return start, rows[: start[-1]]


@jit
def _spread_rows(view_start: Rows, is_used: Flags, views: Rows, per_view: int, start: Rows, rows: Rows) -> None:
    """Of each view's used observations at most so many: where each view's begin among the rows, and the rows."""
    longest = 0
    for view in views:
        longest = max(longest, view_start[view + 1] - view_start[view])
    used = np.empty(longest, dtype=np.int64)
    for slot, view in enumerate(views):
        count = 0
        for m in range(view_start[view], view_start[view + 1]):
            if is_used[m]:
                used[count] = m
                count += 1
        taken = min(count, per_view)
        step = count / max(taken, 1)
        for place in range(taken):
            # Not in even steps: those would follow a column of a grid whose rows are as long.
            cell = np.int64(place * step)
            width = np.int64((place + 1) * step) - cell
            rows[start[slot] + place] = used[cell + np.int64((GOLDEN * place) % 1.0 * width)]
        start[slot + 1] = start[slot] + taken


Loss = Literal["squares", "huber", "cauchy"]


@dataclass(frozen=True)
class SolveOptions:
    """How to solve; the default is least squares of all observations, each counting by what it states of itself."""

    weighted: bool = True  # by the covariances of the observations, where they are known; False: all alike
    loss: Loss = "squares"
    reject_sigma: float | None = None  # leave out observations farther off than so many robust standard deviations
    fixed: tuple[tuple[str, float | None], ...] = ()  # parameter and value; None: the value it starts from
    shared: tuple[tuple[str, ...], ...] = ()  # groups of parameters that have one value
    focal_px: float | None = None  # first guess
    max_iterations: int = 300
    minimise: str = IMAGE  # of `calib.solver.costs.COSTS`
    free_bend: bool | None = None  # of a flat target, as an unknown; None: if it is likely, see `SolvePlan.for_target`
    bend_sigma_mm: tuple[float, float, float, float, float] | None = None
    """What is believed of its heights, about zero (`PlaneBend`); None: what is usual of boards."""
    priors: Annotated[tuple[ParameterPrior, ...], LEFT_OUT] = ()  # what is known of parameters
    breathing_mm: Annotated[float | None, LEFT_OUT] = None
    """The focal length follows the distance, and the camera is that at this one; see `calib.solver.varying`."""
    vary: Annotated[tuple[str, ...], LEFT_OUT] = ()  # what differs from session to session
    vary_sigma_px: Annotated[float | None, LEFT_OUT] = None  # by so much; None: estimated
    sessions: Annotated[tuple[tuple[str, str], ...], LEFT_OUT] = ()  # of views, by their names


AS_THE_PAPER = SolveOptions(weighted=False)
"""Plain least squares: every observation counts the same."""


@dataclass(frozen=True, eq=False)
class Tie:
    """The free parameter that each parameter of a model follows; the control points of a surface are none of these."""

    row: Rows  # (P,) -1: fixed
    value: Array  # (P,) where a parameter is to start, nan: anywhere
    fixed: tuple[str, ...]


def tie_parameters(model: str, options: SolveOptions) -> Tie:
    """The free parameters of a model under a person's choices."""
    if model not in solved_models():
        raise InputError(
            f"model {model}: photos are simulated with it, not solved; choose one of {', '.join(solved_models())}"
        )
    parameters = told_parameters(model)
    names = tuple(parameter.name for parameter in parameters)
    value = np.full(len(names), np.nan)
    fixed: list[str] = []
    for name, number in options.fixed:
        k = _index(name, model, names)
        bounds = parameters[k]
        if number is not None and not bounds.lower < number < bounds.upper:
            raise InputError(f"{name}={number:g}: must be more than {bounds.lower:g} and less than {bounds.upper:g}")
        if name in fixed:
            raise InputError(f"{name} is fixed twice; fix it once")
        fixed.append(name)
        value[k] = np.nan if number is None else number
    require_priors(options.priors, model, parameters, fixed)
    row = np.full(len(names), -1)
    follows = _followers(model, names, options, fixed)
    count = 0
    for k, name in enumerate(names):
        if name in fixed:
            continue
        leader = follows.get(name, k)
        if leader < k:
            row[k] = row[leader]
        else:
            row[k], count = count, count + 1
    return Tie(row, value, tuple(fixed))


def _followers(model: str, names: tuple[str, ...], options: SolveOptions, fixed: list[str]) -> dict[str, int]:
    """The first parameter of its group, for each parameter that shares its value."""
    follows: dict[str, int] = {}
    for group in options.shared:
        if len(group) < 2:
            raise InputError(f"{','.join(group)!r}: name two or more parameters that are to share a value")
        rows = [_index(name, model, names) for name in group]
        for name in group:
            if name in fixed:
                raise InputError(f"{name} is fixed and shared; choose one")
            if name in follows or group.count(name) > 1:
                raise InputError(f"{name} is shared twice; name it once")
        if len({MODELS[model].parameters[k].unit for k in rows}) > 1:
            raise InputError(f"{','.join(group)}: parameters of different units cannot share a value")
        follows.update(dict.fromkeys(group, min(rows)))
    return follows


def _index(name: str, model: str, names: tuple[str, ...]) -> int:
    if name not in names:
        raise InputError(f"model {model} has no parameter {name!r}; it has {', '.join(names)}")
    return names.index(name)
