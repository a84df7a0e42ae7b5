"""How sure a rig is: the joint covariance of all unknowns, and what the observations of each camera are worth.

Points of a table of which nobody said whether they are centres of circles: what a rig may be off by that.

What a rig's unknowns are off by because frames tell the target's motion between them only so well.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from calib.core.linear_algebra import symmetric_inverse
from calib.rigs.carrier import error_derivatives, mechanism_errors
from calib.rigs.descend import RigEquations, chain_of, params_of
from calib.rigs.problem import RigProblem, RigState, offset_evidence, seen_poses
from calib.rigs.result import RigCalibration
from calib.rigs.target_error import posed_unknowns
from calib.solver.blocks import RobustLoss
from calib.solver.circles import circle_shift_px, doubt_of, unsaid_mm
from calib.solver.eliminate import Chain, Normal, through_camera
from calib.solver.free_shape import extra_of
from calib.solver.levenberg import Descent
from calib.solver.outliers import robust_covariance_factor, whitened
from designer.base.arrays import Array, Flags


def motion_covariance(
    problem: RigProblem, found: Descent[RigState, RigEquations], shared: Array, coupling: Array
) -> Array:
    """Of the shared unknowns, by the errors of the target's speed.  # (G, G)

    A photo that was taken g from the frame's time, of a target e faster than thought, shows it g e away; the normal
    equations tell what follows. Errors e are those of the process, and as far as frames leave speeds open, all speeds
    together by as large a part of themselves: what the process itself is, is a guess there.

    `shared` is their inverse normal matrix (G, G), `coupling` what frames take from them (V, 6, G).
    """
    count, state, motion = problem.shared_count, found.state, problem.motion
    total = np.zeros((count, count))
    if motion is None:
        return total
    slope = np.zeros((problem.frame_count, count, 6))  # of the gradient by the speeds
    for number, (one, chain) in enumerate(zip(problem.seen, found.equations.chains, strict=True)):
        blocks = (found.equations.slack if problem.slack else found.equations.blocks)[number].products
        turned, _ = through_camera(state.cam_from_rig[number], seen_poses(problem, state, number)[0])
        gap_s = one.gap_s - state.delay_s[number]
        by_speed = blocks[:, :-1, -7:-1] @ turned * gap_s[:, None, None]  # (V_c, P + 6, 6)
        columns = np.concatenate([params_of(problem, number), chain.column])
        own = np.concatenate([by_speed[:, :-6], chain.by_shared.transpose(0, 2, 1) @ by_speed[:, -6:]], axis=1)
        part = np.zeros((len(own), count + 1, 6))  # what is fixed takes the last
        for place, column in enumerate(columns.tolist()):  # parameters that share a value add up
            part[:, column] += own[:, place]
        by_frame = chain.by_frame.transpose(0, 2, 1) @ by_speed[:, -6:]
        slope[one.frame] += part[:, :-1] - coupling[one.frame].transpose(0, 2, 1) @ by_frame
    follows = shared @ slope
    unknown, speed = np.zeros(6), motion.derivative[0]
    for rows, covariance in motion.speed_covariance():
        total += np.einsum("vga,avw,wha->gh", follows[rows], covariance, follows[rows], optimize=True)
        unknown += np.trace(covariance, axis1=1, axis2=2)
    known = (speed**2).sum(axis=0)
    share = np.divide(unknown, known, out=np.zeros(6), where=known > 0)
    alike = np.einsum("vga,a,va->g", follows, share, speed)
    total += alike[:, None] * alike
    return total


Found = Descent[RigState, RigEquations]

SINGULAR = 1e-13
LEAST_TOLD = 1e-3
LOST = 1e-3
"""Part of an unknown, of length one, that is not determined, from which on it is not stated."""
TOLD = 0.3
"""Part of the least determined direction, its largest part one, from which on an unknown is named."""


@dataclass(frozen=True, eq=False)
class RigAccuracy:
    """Covariances at the minimum; nan where the data do not determine the rig."""

    covariance: Array  # (N, N) rows as those of `calib.cameras.rig.Rig`
    frame_covariance: Array  # (V, 6, 6) from the problem's own origin
    pose_covariance: tuple[Array, ...]  # (C,) of (V_c, 6, 6) of each camera's views, likewise
    delay_sigma_s: Array  # (C,)
    mechanism_covariance: Array | None  # (6, 6) from the problem's own origin
    amount_covariance: Array  # (S, S) of the target's size and bend, 0 of what was no unknown
    weakest: str  # why the data do not determine the rig; "" if they do


@dataclass(frozen=True, eq=False)
class SharedInverse:
    """The inverse normal matrix of the shared unknowns, the frames eliminated, and what frames take from it."""

    shared: Array  # (G, G)
    frame: Array  # (V, 6, 6) covariances of the frames
    coupling: Array  # (V, 6, G) C^-1 B' of each frame: a frame's part that follows the shared unknowns, sign turned
    weakest: Array  # (G,) the least determined direction, each unknown in units of its conditional deviation
    is_lost: Flags  # (G,) unknowns with a part in what is not determined; the inverse is without it

    def covariance_of(self, chain: Chain) -> Array:
        """Covariances of what hangs on frames and shared unknowns.  # (B, K, K)"""
        free = np.flatnonzero(chain.column >= 0)
        by_frame, by_shared, column = chain.by_frame, chain.by_shared[:, :, free], chain.column[free]
        cross = -(self.coupling[chain.frame] @ self.shared)[:, :, column]
        both = by_frame @ cross @ by_shared.transpose(0, 2, 1)
        own = by_frame @ self.frame[chain.frame] @ by_frame.transpose(0, 2, 1)
        shared: Array = by_shared @ self.shared[column[:, None], column] @ by_shared.transpose(0, 2, 1)
        return own + both + both.transpose(0, 2, 1) + shared


def shared_inverse(normal: Normal) -> SharedInverse:
    """Normal equations inverted by blocks: of `[C B'; B A]`, frames first, `S = A - B C^-1 B'` is left."""
    count = normal.other.shape[0]
    try:
        block = np.asarray(np.linalg.inv(normal.pose), dtype=np.float64)
    except np.linalg.LinAlgError:
        return _nothing(normal)
    coupling = block @ normal.pose_row[:, :, :count]
    reduced = normal.other[:, :count] - np.einsum("vig,vih->gh", normal.pose_row[:, :, :count], coupling)
    if not count:
        return SharedInverse(np.zeros((0, 0)), block, coupling, np.zeros(0), np.zeros(0, dtype=bool))
    before, after = np.diagonal(normal.other[:, :count]), np.diagonal(reduced)
    if not (np.isfinite(reduced).all() and (before > 0).all() and (after > 0).all()):
        return _nothing(normal)
    root = np.sqrt(after)
    value, vector = np.linalg.eigh(reduced / (root[:, None] * root))
    rounding = np.finfo(np.float64).eps * float((before / after).max()) * count
    determined = value > max(SINGULAR, rounding)  # what the frames took up whole is lost in rounding
    inverse = (vector * np.where(determined, 1 / np.where(determined, value, 1.0), 0.0)) @ vector.T
    inverse = inverse / (root[:, None] * root)
    frame = block + coupling @ inverse @ coupling.transpose(0, 2, 1)
    is_lost = np.sqrt((vector[:, ~determined] ** 2).sum(axis=1)) > LOST
    return SharedInverse(inverse, frame, coupling, vector[:, 0], is_lost)


def _nothing(normal: Normal) -> SharedInverse:
    count = normal.other.shape[0]
    lost = (~(np.diagonal(normal.other[:, :count]) > 0)).astype(np.float64)
    return SharedInverse(
        np.full((count, count), np.nan), np.full_like(normal.pose, np.nan), np.zeros((len(normal.pose), 6, count)),
        lost, np.ones(count, dtype=bool),
    )  # fmt: skip


def camera_redundancy(problem: RigProblem, found: Found) -> Array:
    """Of each camera's coordinates, how many more there are than the unknowns that they determine.  # (C,)

    A frame's six are shared out among the cameras by how much each tells of them.
    """
    inverse = symmetric_inverse(found.equations.normal.pose).inverse
    redundancy = np.zeros(len(problem.seen))
    for number, (one, blocks, chain) in enumerate(
        zip(problem.seen, found.equations.blocks, found.equations.chains, strict=True)
    ):
        own = (found.equations.slack[number].products if problem.slack else blocks.products)[:, -7:-1, -7:-1]
        told = chain.by_frame.transpose(0, 2, 1) @ own @ chain.by_frame
        free = len(np.unique(one.params[one.params >= 0])) + int((chain.column >= 0).sum())
        taken = float(np.einsum("vij,vji->", inverse[chain.frame], told))
        redundancy[number] = 2 * int(one.problem.is_used.sum()) - free - taken
        if problem.slack:
            view = found.equations.slack[number]
            redundancy[number] -= view.spread[:, :, 0].size - float(
                np.einsum("vde,ved->", problem.slack[number].precision, view.spread)
            )
    return redundancy


def offset_size(problem: RigProblem, found: Found) -> float:
    """How large the views' own unknowns are, by what they themselves show."""
    inverse = shared_inverse(found.equations.normal)
    squares = told = 0.0
    for number, (prior, chain, view) in enumerate(
        zip(problem.slack, found.equations.chains, found.equations.slack, strict=True)
    ):
        columns = np.concatenate([params_of(problem, number), chain.column])
        count = len(columns) - len(chain.column)
        to_pose = view.solved[:, :, count:-1]
        by_shared = np.concatenate([view.solved[:, :, :count], to_pose @ chain.by_shared], axis=2)
        follows = inverse.covariance_of(Chain(chain.frame, to_pose @ chain.by_frame, by_shared, columns))
        evidence = offset_evidence(prior, found.state.slack[number], view.spread + follows)
        squares, told = squares + evidence[0], told + evidence[1]
    size = problem.slack[0].size
    return squares / told if told > LEAST_TOLD else size


def mechanism_sigmas(problem: RigProblem, found: Found) -> Array:
    """The sizes of a carrier's errors that they themselves show, their redundancy regarded: rad, mm.  # (2,)

    The squares of the errors over their redundancy (Foerstner 1979): what of them was free to follow the photos is
    not counted.
    """
    prior, state = problem.prior, found.state
    if prior is None:
        raise ValueError("a rig without a carrier")
    error = mechanism_errors(prior, state.rig_from_target, state.carrier_from_target)
    by_frame, by_target = error_derivatives(prior, state.rig_from_target, state.carrier_from_target)
    chain = Chain(np.arange(len(error)), by_frame, by_target, prior.column)
    variance = np.einsum("vii->vi", shared_inverse(found.equations.normal).covariance_of(chain))
    counts = np.ones((len(error), 6), dtype=bool)
    if prior.carrier.has_free_angles:
        counts[:, 2] = False
    sigma = prior.sigma.copy()
    for kind in range(2):
        own = np.zeros(6, dtype=bool)
        own[3 * kind : 3 * kind + 3] = True
        used = counts & own
        left = float(used.sum() - variance[used].sum() / prior.sigma[kind] ** 2)
        square = float((error[used] ** 2).sum())
        sigma[kind] = np.sqrt(square / left) if left > 1e-3 * used.sum() else sigma[kind]
    return sigma


def accuracy_of_rig(problem: RigProblem, found: Found, labels: Sequence[str], knee: float) -> RigAccuracy:
    """The covariances at the minimum.

    `labels` are what the shared unknowns are called (G,); the loss bends at `knee` standard deviations, if
    that is finite.
    """
    inverse = shared_inverse(found.equations.normal)
    factor = _robust_factor(problem, found) if np.isfinite(knee) else 1.0
    place = np.concatenate([np.concatenate([one.params, one.pose]) for one in problem.seen])
    rows = np.flatnonzero(place >= 0)
    moved = motion_covariance(problem, found, inverse.shared, inverse.coupling)
    shared = np.where(inverse.is_lost | inverse.is_lost[:, None], np.nan, factor * inverse.shared + moved)
    covariance = np.zeros((len(place), len(place)))
    covariance[np.ix_(rows, rows)] = shared[np.ix_(place[rows], place[rows])]
    delay = np.array(
        [float(np.sqrt(shared[one.delay[0], one.delay[0]])) if one.delay[0] >= 0 else 0.0 for one in problem.seen]
    )
    column = None if problem.prior is None else problem.prior.column
    carrier = None if column is None else shared[column[:, None], column]
    is_free, of_amounts = problem.amount >= 0, np.ix_(problem.amount, problem.amount)
    amount = np.where(is_free[:, None] & is_free, shared[of_amounts], 0.0) if len(is_free) else np.zeros((0, 0))
    frame = factor * inverse.frame + inverse.coupling @ moved @ inverse.coupling.transpose(0, 2, 1)
    frame = np.full_like(frame, np.nan) if inverse.is_lost.any() else frame
    stated, rigid = replace(inverse, shared=shared, frame=frame), replace(problem, motion=None, slack=())
    views = [
        chain_of(rigid, found.state, k, found.state.rig_from_target[one.frame]) for k, one in enumerate(rigid.seen)
    ]
    weakest = _why_undetermined(inverse, labels) if inverse.is_lost.any() else ""
    poses = tuple(stated.covariance_of(one) for one in views)
    return RigAccuracy(covariance, frame, poses, delay, carrier, amount, weakest)


def _why_undetermined(inverse: SharedInverse, labels: Sequence[str]) -> str:
    """A line with what cannot be told apart, and the remedy."""
    part = np.abs(inverse.weakest)
    told = [label for label, share in zip(labels, part.tolist(), strict=True) if share > TOLD * part.max(initial=0.0)]
    return (
        f"the frames do not determine {', '.join(dict.fromkeys(told)) or 'the rig'}: take frames with the target "
        "turned about other axes, nearer and farther, or give what is known"
    )


def _robust_factor(problem: RigProblem, found: Found) -> float:
    """What the inverse of the weighted normal matrix is to be multiplied with for a covariance."""
    lengths = []
    for one, blocks, scale in zip(problem.seen, found.equations.blocks, problem.scale, strict=True):
        standard = whitened(one.problem.whitener, blocks.residual_px) / scale
        length = np.hypot(*standard)[one.problem.is_used]
        lengths.append(length[np.isfinite(length)])
    return robust_covariance_factor(np.concatenate(lengths), RobustLoss(problem.loss))


def with_circle_doubt(found: RigCalibration) -> RigCalibration:
    """The rig with the doubt, as `calib.solver.circles` has it for one camera; as it was where all is said."""
    units = [unsaid_mm(seen) for seen in found.observations.sightings]
    known = [float(one.max()) for one in units if one is not None]
    if not known or not np.isfinite(found.covariance).all():
        return found
    unit_mm = float(np.median(known))
    shift = [
        np.zeros_like(seen.center_px)
        if own is None
        else circle_shift_px(found.alone[row], np.where(own > 0, unit_mm, 0.0))
        for row, (seen, own) in enumerate(zip(found.observations.sightings, units, strict=True))
    ]
    off = tuple(left + by for left, by in zip(found.residual_px, shift, strict=True))
    frames = np.arange(found.observations.frame_count)
    (basis, plain), (_, moved) = (posed_unknowns(one, frames) for one in (found, replace(found, residual_px=off)))
    pairs = ((one, other.residual - one.residual) for one, other in zip(plain, moved, strict=True))
    told = extra_of(pairs, basis, 1)
    if told is None:
        return found
    return replace(found, circle_doubt=doubt_of(told, unit_mm, len(found.covariance)))
