"""Where a camera sits on a robot, of pairs of poses alone: the robot's, and the camera's of a target.

    found = solve_pose_pairs(cam_from_target, flange_from_base, in_hand="camera")
    found.cam_from_rig, found.covariance

The camera saw the target at `A_v`, the robot was at `L_v`; sought are X = `cam_from_rig` and Z = `carrier_from_target`
of `A_v = X L_v Z`, which holds for a camera in the hand (L = flange_from_base) and beside the robot (L =
base_from_flange), and is what others write `A X = X B` and `A X = Y B`. Both poses err: the camera's along and across
its axis differently, by turns and by shifts, the robot's at its flange. How much is not known beforehand and is
estimated with the poses: the residuals e (6,) in the camera's axes have

    cov(e_v) = sum_i theta_i G_iv,   theta_i <- theta_i (s_i + n_0 theta_0i / theta_i) / (k_i + n_0)

with a component's share s_i of the weighed squares and its redundancy k_i (restricted maximum likelihood by Helmert's
and Foerstner's iteration: Foerstner 1979; Searle, Casella and McCulloch 1992, section 8.3), held weakly to what is
usual, theta_0, by n_0 observations' worth. Their distribution is a Student t where that is likelier (Lange, Little and
Taylor 1989): poses far off count little, and are named.

Of one camera that moves, such as by visual odometry, errors add up from pose to pose: then the differences of
neighbours have `G` with neighbours' blocks besides, and Z, which the first pose defines, is no better than that pose.
"""

from collections.abc import Callable
from dataclasses import dataclass, replace
from math import lgamma
from typing import Literal, TypeAlias

import numpy as np

from calib.core.linear_algebra import least_squares, symmetric_inverse
from calib.core.parallel import one_thread
from calib.core.se3 import inverse_slope, invert, log_rotation, skew
from calib.core.types import freeze
from calib.rigs.hand_eye import HandEyeStart, equations, first_turns, moved_by, start_hand_eye
from calib.rigs.motion import Trajectory
from designer.base.arrays import Array, Flags
from designer.base.errors import InputError

InHand = Literal["camera", "target"]
COMPONENTS = (
    "camera_turn_across_rad", "camera_turn_axial_rad", "camera_shift_across_mm", "camera_shift_axial_mm",
    "robot_turn_rad", "robot_shift_mm",
)  # fmt: skip
USUAL = np.array([1e-3, 1e-3, 0.5, 1.0, 3e-4, 0.2]) ** 2
"""Variances of them, of which the photos of a board and an industrial robot are."""
WORTH = 1.0
"""Observations that this assumption counts as."""
TAILS = (4.0, 1e6)
"""Degrees of freedom of Student's distribution that are tried; so many are the normal one's."""
ROUNDS, SETTLED = 80, 3e-3
FEWEST = 3
FAR = 45.0
"""Weighed square of a pose's six residuals beyond which it is no part of the distribution: by chance one in 10^7."""
MOST_OFF = 0.45
"""Of the poses: where more are far off, nobody knows which."""
STEADY = 0.5
"""Squares of neighbours' differences over those of residuals, 2 of independent ones: below, errors add up."""
WEAK = np.tile(np.repeat([1e-2, 1e-8], 3), 2)
"""Keeps the equations solvable along what nothing tells: a turn of 10 rad, a shift of 10 m."""
LONGEST_TURN_RAD = 0.3
"""Of a step."""
OFFSET_STEP_S = 2e-3
"""For derivatives."""
GRID, OFFSETS_S = 401, 0.6
"""Clock offsets that are tried first, up to that many seconds."""


@dataclass(frozen=True, eq=False)
class PosePairs:
    """What a camera and a robot said; V pairs of poses, in the order of time."""

    cam_from_target: Array  # (V, 4, 4)
    rig_from_mechanism: Array  # (V, 4, 4) camera in hand: flange_from_base, target in hand: base_from_flange
    in_hand: InHand = "camera"
    covariance: Array | None = None  # (V, 6, 6) of the camera's, rad and mm, in its axes, turns from the left

    def __post_init__(self) -> None:
        freeze(self, "cam_from_target", "rig_from_mechanism")


@dataclass(frozen=True, eq=False)
class PairsSolution:
    """Where the camera sits, of V pairs of poses: `found.cam_from_rig`."""

    cam_from_rig: Array  # (4, 4)
    carrier_from_target: Array  # (4, 4)
    covariance: Array  # (12, 12) of both: turns (rad) from the left, shifts (mm)
    scale: float  # mm of the camera's poses in a mm of the robot's; 1 unless it was sought
    scale_sigma: float
    offset_s: float  # by which the camera's clock is ahead of the robot's; 0 unless it was sought
    offset_sigma_s: float
    sigma: tuple[float, ...]  # of `COMPONENTS`; with covariances given: factor on them, and the robot's two
    error: Array  # (V, 6) of each pose: turn (rad), shift (mm), in the camera's axes; of differences if errors add up
    off: Array  # (V,) weighed lengths of them, about 2.4 by chance
    is_off: Flags  # (V,) poses that are no part of the others' distribution, and do not count
    adds_up: bool  # errors add up from pose to pose, as visual odometry's do
    undetermined: tuple[str, ...]  # what the motions do not tell

    def __post_init__(self) -> None:
        freeze(self, "cam_from_rig", "carrier_from_target", "covariance", "error", "off")


@dataclass(frozen=True, eq=False)
class _PairsState:
    """What is sought."""

    x: Array
    z: Array
    log_scale: float = 0.0
    offset_s: float = 0.0


_Pairs: TypeAlias = tuple[Array, Array, Array]


@dataclass(frozen=True, eq=False)
class _Problem:
    """Equations of pairs of poses; told(offset) is rig_from_mechanism (V, 4, 4) of each."""

    seen: Array
    told: Callable[[float], Array]
    in_hand: InHand
    given: Array | None = None
    adds_up: bool = False
    has_scale: bool = False
    has_offset: bool = False

    def pairs(self, state: _PairsState) -> _Pairs:
        """What was seen, and told, in the robot's millimetres, and Z."""
        seen, told = self.seen.copy(), self.told(state.offset_s)
        seen[:, :3, 3] *= np.exp(-state.log_scale)
        if not self.adds_up:
            return seen, told, state.z
        return seen[1:] @ invert(seen[:-1]), told[1:] @ invert(told[:-1]), invert(state.x)

    def equations(self, state: _PairsState, pairs: _Pairs) -> tuple[Array, Array]:
        """Residuals (V, 6) and how the prediction moves with X, Z, scale and offset (V, 6, P)."""
        seen, told, z = pairs
        error, design = equations(seen, told, state.x, z)
        columns = [design]
        if self.adds_up:
            columns = [design[:, :, :6] + design[:, :, 6:] @ inverse_slope(state.x)]
        if self.has_scale:
            to_scale = np.concatenate([np.zeros((len(seen), 3)), seen[:, :3, 3] - error[:, 3:]], axis=1)
            columns.append(to_scale[:, :, None])
        if self.has_offset:
            ahead, behind = (replace(state, offset_s=state.offset_s + step) for step in (OFFSET_STEP_S, -OFFSET_STEP_S))
            there = [equations(*self.pairs(one)[:2], one.x, z)[0] for one in (ahead, behind)]
            columns.append((there[1] - there[0])[:, :, None] / (2 * OFFSET_STEP_S))
        return error, np.concatenate(columns, axis=2)

    def components(self, state: _PairsState, pairs: _Pairs) -> Array:
        """Covariances (K, V, 6, 6) that a unit of each component gives."""
        seen, told, z = pairs
        turned = state.x[:3, :3] @ told[:, :3, :3]
        at_carrier = turned @ z[:3, 3]
        at_rig = at_carrier + told[:, :3, 3] @ state.x[:3, :3].T
        levers = [at_rig, at_carrier] if self.adds_up else [at_rig if self.in_hand == "camera" else at_carrier]
        parts = [
            np.broadcast_to(np.diag(part).astype(np.float64), (len(seen), 6, 6))
            for part in ([1, 1, 0, 0, 0, 0], [0, 0, 1, 0, 0, 0], [0, 0, 0, 1, 1, 0], [0, 0, 0, 0, 0, 1])
        ]
        if self.given is not None:
            parts = [self.given[1:] + self.given[:-1] if self.adds_up else self.given]
        moved = [np.concatenate([np.broadcast_to(np.eye(3), (len(seen), 3, 3)), -skew(one)], axis=1) for one in levers]
        parts.append(np.sum([one @ one.transpose(0, 2, 1) for one in moved], axis=0))
        parts.append(np.broadcast_to(np.diag([0.0, 0, 0, 1, 1, 1]) * len(levers), (len(seen), 6, 6)))
        return np.stack(parts)

    def usual(self) -> Array:
        """Variances (K,) to begin with."""
        return USUAL if self.given is None else np.concatenate([[1.0], USUAL[4:]])

    def moved(self, state: _PairsState, step: Array) -> _PairsState:
        """The state after a step (P,)."""
        turns = [0, 1, 2] if self.adds_up else [0, 1, 2, 6, 7, 8]
        step = step / max(1.0, float(np.linalg.norm(step[turns])) / LONGEST_TURN_RAD)
        poses, rest = (6 if self.adds_up else 12), list(step)
        z = state.z if self.adds_up else moved_by(state.z, step[6:12])
        offset = state.offset_s + (rest.pop() if self.has_offset else 0.0)
        return _PairsState(
            moved_by(state.x, step[:6]), z, state.log_scale + (rest[poses] if self.has_scale else 0.0), offset
        )


@dataclass(frozen=True, eq=False)
class _Fit:
    state: _PairsState
    variance: Array  # (K,)
    unlikely: float  # minus the log of the restricted likelihood
    information: Array  # (P, P)
    error: Array
    square: Array  # (V,)


def solve_pose_pairs(pairs: PosePairs, *, has_scale: bool = False, adds_up: bool | None = None) -> PairsSolution:
    """`solve_pose_pairs(PosePairs(cam_from_target, flange_from_base)).cam_from_rig` is cam_from_flange.

    Args:
        pairs: the poses.
        has_scale: the camera's lengths are in a unit of their own, which is solved.
        adds_up: errors of the camera's poses add up from pose to pose; None: as the poses say.

    Raises:
        InputError: there are fewer than three.
    """
    problem = _Problem(
        pairs.cam_from_target, lambda _: pairs.rig_from_mechanism, pairs.in_hand, pairs.covariance, has_scale=has_scale
    )
    return _solved(problem, 0.0, adds_up)


def solve_pose_streams(
    cam_time_s: Array, cam_from_target: Array, robot_time_s: Array, rig_from_mechanism: Array,
    in_hand: InHand = "camera", covariance: Array | None = None, *, has_scale: bool = False,
    adds_up: bool | None = None, offset_s: float | None = None,
) -> PairsSolution:  # fmt: skip
    """The same of two streams of poses with times, by clocks of which one is ahead: `found.offset_s`.

    The robot's poses are interpolated on the group by splines. The offset begins where the angles that camera and
    robot turn between the camera's poses agree best, which no place of the camera changes.

    Args:
        cam_time_s: of the camera's poses (V,), ascending.
        cam_from_target: (V, 4, 4)
        robot_time_s: of the robot's poses (N,), ascending.
        rig_from_mechanism: (N, 4, 4)
        in_hand: what the robot carries.
        covariance: (V, 6, 6) of the camera's poses, if known.
        has_scale: the camera's lengths are in a unit of their own.
        adds_up: errors of the camera's poses add up.
        offset_s: by which the camera's clock is ahead, if that is known.

    Raises:
        InputError: there are fewer than three poses, or their times have next to nothing in common.
    """
    way = Trajectory(robot_time_s, rig_from_mechanism)
    begin = _likely_offset(cam_time_s, cam_from_target, way) if offset_s is None else offset_s
    there_s = cam_time_s - begin
    first = way.at(there_s)
    # Between the robot's poses only: what lies beyond them would be taken for poses that do not follow.
    known = np.isfinite(first[:, 0, 0]) & (there_s >= way.time_s[0]) & (there_s <= way.time_s[-1])
    if known.sum() < FEWEST:
        raise InputError(
            f"{known.sum()} of the camera's poses lie within the robot's times; give both of the same time"
        )
    time_s, first = cam_time_s[known], first[known]

    def told(offset: float) -> Array:
        there = way.at(time_s - offset)
        return np.where(np.isfinite(there[:, :1, :1]), there, first)

    given = None if covariance is None else covariance[known]
    has_offset = offset_s is None
    problem = _Problem(cam_from_target[known], told, in_hand, given, has_scale=has_scale, has_offset=has_offset)
    found = _solved(problem, begin, adds_up)
    return found if known.all() else _at_all(found, known)


def _likely_offset(time_s: Array, cam_from_target: Array, way: Trajectory) -> float:
    """Where the angles turned from pose to pose differ least."""
    turned = np.linalg.norm(log_rotation((cam_from_target[1:] @ invert(cam_from_target[:-1]))[:, :3, :3]), axis=1)

    def differs(offset_s: float) -> float:
        there = way.at(time_s - offset_s)
        apart = np.linalg.norm(log_rotation((there[1:] @ invert(there[:-1]))[:, :3, :3]), axis=1) - turned
        apart = apart[np.isfinite(apart)]
        return float(np.median(np.abs(apart))) if len(apart) >= max(FEWEST, len(turned) // 2) else np.inf

    tried = np.linspace(-OFFSETS_S, OFFSETS_S, GRID)
    away = [differs(float(one)) for one in tried]
    if not np.isfinite(away).any():
        raise InputError(
            f"camera and robot poses have next to no time in common; their clocks may differ by {OFFSETS_S:g} s at most"
        )
    return float(tried[int(np.argmin(away))])


def _at_all(found: PairsSolution, known: Flags) -> PairsSolution:
    """With rows for poses outside the robot's times, which do not count."""
    rows = np.flatnonzero(known)
    error, off, is_off = np.full((len(known), 6), np.nan), np.full(len(known), np.nan), np.ones(len(known), np.bool_)
    error[rows], off[rows], is_off[rows] = found.error, found.off, found.is_off
    return replace(found, error=error, off=off, is_off=is_off)


@one_thread
def _solved(problem: _Problem, offset_s: float, adds_up: bool | None) -> PairsSolution:
    count = len(problem.seen)
    if count < FEWEST:
        raise InputError(f"{count} pairs of poses; three or more with turns about two axes tell where a camera sits")
    state, start = _begun(problem, offset_s)
    fit, counts = _without_far_off(problem, state, ~start.is_far_off)
    if adds_up or (adds_up is None and not problem.adds_up and _steadiness(fit, counts) < STEADY):
        problem = replace(problem, adds_up=True)
        fit, counts = _without_far_off(problem, fit.state, counts[1:] & counts[:-1])
    covariance = _widened(int(counts.sum())) * symmetric_inverse(fit.information).covariance
    more, poses = np.sqrt(np.diagonal(covariance)[6 if problem.adds_up else 12 :]), np.full((12, 12), np.nan)
    poses[:6, :6] = covariance[:6, :6]
    z = fit.state.z
    if problem.adds_up:  # Z is what the first pose says, which errs as the others do not tell
        seen, told, _ = replace(problem, adds_up=False).pairs(fit.state)
        z = invert(fit.state.x @ told[0]) @ seen[0]
    else:
        poses = covariance[:12, :12]
    scale = float(np.exp(fit.state.log_scale))
    first = [np.zeros((1, 6))] if problem.adds_up else []
    off = np.sqrt(fit.square)
    return PairsSolution(
        fit.state.x, z, poses, scale, scale * float(more[0]) if problem.has_scale else 0.0,
        fit.state.offset_s, float(more[-1]) if problem.has_offset else 0.0, tuple(np.sqrt(fit.variance).tolist()),
        np.concatenate([*first, fit.error]), np.concatenate([[0.0], off]) if problem.adds_up else off,
        ~(np.concatenate([[True], counts]) if problem.adds_up else counts), problem.adds_up, start.undetermined,
    )  # fmt: skip


def _widened(count: int) -> float:
    """By how much variances estimated from so many poses widen an ellipsoid of six (Hotelling's T squared)."""
    from scipy.stats import chi2, f

    freedom = 3 * count - 6  # of turns, and as many of shifts
    return float(6 * f.ppf(0.95, 6, freedom) / chi2.ppf(0.95, 6))


def _begun(problem: _Problem, offset_s: float) -> tuple[_PairsState, HandEyeStart]:
    """A closed form to begin with; the scale by shifts, which are linear where turns are known."""
    told, seen, log_scale = problem.told(offset_s), problem.seen, 0.0
    if problem.has_scale:
        rows = []
        for turn in first_turns(seen, told):
            arms = turn @ told[:, :3, :3]
            design = np.concatenate(
                [(told[:, :3, 3] @ turn.T)[:, :, None], arms, np.broadcast_to(np.eye(3), arms.shape)], axis=2
            ).reshape(-1, 7)
            value = seen[:, :3, 3].ravel()
            found = least_squares(design, value)
            rows.append((float(((design @ found - value) ** 2).sum()), float(found[0])))
        scale = min(rows)[1]
        if not scale > 0:
            raise InputError("the shifts of camera and robot do not tell a scale; move farther, or give lengths in mm")
        log_scale = float(np.log(scale))
        seen = seen.copy()
        seen[:, :3, 3] /= scale
    start = start_hand_eye(seen, told)
    return _PairsState(start.cam_from_rig, start.carrier_from_target, log_scale, offset_s), start


def _without_far_off(problem: _Problem, state: _PairsState, counts: Flags) -> tuple[_Fit, Flags]:
    """The likeliest fit of the poses that belong to one distribution, and which do."""
    fit = _likeliest(problem, state, counts)
    for _ in range(4):
        near = fit.square < FAR
        if (near == counts).all() or near.mean() < 1 - MOST_OFF:
            break
        counts = near
        fit = _likeliest(problem, fit.state, counts)
    return fit, counts


def _likeliest(problem: _Problem, state: _PairsState, counts: Flags) -> _Fit:
    """By the distribution that is likelier."""
    return min((_fitted(problem, state, counts, tails) for tails in TAILS), key=lambda fit: fit.unlikely)


def _steadiness(fit: _Fit, counts: Flags) -> float:
    """Squares of neighbours' differences over those of residuals (von Neumann 1941): 2 of independent ones."""
    error = fit.error[counts] / np.sqrt((fit.error[counts] ** 2).mean(axis=0) + np.finfo(float).tiny)
    return float((np.diff(error, axis=0) ** 2).sum() / max((error**2).sum(), np.finfo(float).tiny))


def _fitted(problem: _Problem, state: _PairsState, counts: Flags, tails: float) -> _Fit:
    """Poses and variances in turn, with Student's distribution of so many degrees of freedom."""
    usual = problem.usual()
    pairs = problem.pairs(state)
    error, design = problem.equations(state, pairs)
    variance = usual.copy()
    if problem.given is None:  # from above, as a part that is far too small hardly grows
        turn, shift = np.median(error[counts, :3] ** 2), np.median(error[counts, 3:] ** 2)
        variance[:4] = np.maximum(variance[:4] * 0.1, 2 * np.repeat([turn, shift], 2))
    for _ in range(ROUNDS):
        part = problem.components(state, pairs)
        weight = np.linalg.inv(np.einsum("k,kvij->vij", variance, part))
        share = counts * _share(error, weight, tails)
        pulled = weight @ design
        information = np.einsum("vij,vik,v->jk", design, pulled, share)
        covariance = np.linalg.inv(information + np.diag(_weak(problem)))
        state = problem.moved(state, covariance @ np.einsum("vij,vi,v->j", pulled, error, share))
        pairs = problem.pairs(state)
        error, design = problem.equations(state, pairs)
        share = counts * _share(error, weight, tails)
        pull = np.einsum("vij,vj->vi", weight, error)
        # Traces of products with each part: of the squares' outer products, of the weights, of what the unknowns take.
        outer = pull[:, :, None] * pull[:, None] * share[:, None, None]
        taken = pulled @ covariance @ pulled.transpose(0, 2, 1) * share[:, None, None]
        squares = variance * np.einsum("vij,kvij->k", outer, part)
        redundancy = variance * np.einsum("vij,kvij->k", weight * counts[:, None, None] - taken, part)
        grown = (squares + WORTH * usual / variance) / (np.maximum(redundancy, 0.0) + WORTH)
        variance = variance * grown
        if np.abs(np.log(grown)).max() < SETTLED:
            break
    square = np.einsum("vi,vij,vj->v", error, weight, error)
    each = -0.5 * np.linalg.slogdet(weight)[1] + 0.5 * (tails + 6) * np.log1p(square / tails)
    each = each - lgamma((tails + 6) / 2) + lgamma(tails / 2) + 3 * np.log(tails)
    unlikely = float(each[counts].sum() + 0.5 * np.linalg.slogdet(information + np.diag(_weak(problem)))[1])
    return _Fit(state, variance, unlikely, information * (tails + 6) / (tails + 8), error, square)


def _share(error: Array, weight: Array, tails: float) -> Array:
    """What a pose counts (V,), the less the farther it is off."""
    share: Array = (tails + 6) / (tails + np.einsum("vi,vij,vj->v", error, weight, error))
    return share


def _weak(problem: _Problem) -> Array:
    """Information (P,) that is next to none."""
    poses = WEAK[:6] if problem.adds_up else WEAK
    return np.concatenate([poses, np.full(problem.has_scale + problem.has_offset, 1e-6)])
