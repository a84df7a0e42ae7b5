"""What cameras that are held together saw, packed for the kernels, and the values of all unknowns.

Poses start at the middle of the target's points, as those of `calib.solver.problem`.

What a person may choose about the solution of a rig.

Views whose pose is not quite the rig's: errors that all sightings of a photo share.

What a lens leaves over, how centres are biased, and by how much a photo of a moving target is early or late, is alike
all over a photo: that moves its pose by more than independent errors of the same size would (a design effect; Kish
1965, section 8.2), and a robot, or other cameras, would seem to be wrong. So each view may have a pose that differs
from the rig's by a slack z (6,), expected to be as large as k times its own covariance: with the view's block H and the
pose's part W of it the precision is `W / k`, where k is estimated from all views. The slack is eliminated within the
view: with h the pose's columns of H, `H - h (W + W / k)^-1 h'` is left; what no pose explains tells the noise.
"""

from collections.abc import Sequence
from dataclasses import dataclass, field, replace

import numpy as np

from calib.cameras.camera import Camera
from calib.core.linear_algebra import symmetric_inverse
from calib.core.se3 import exp_rotation, make_pose
from calib.core.types import RigObservations, freeze
from calib.rigs.motion import Motion
from calib.solver.costs import IMAGE
from calib.solver.free_bend import bend_modes_mm, bend_sigma_mm
from calib.solver.levenberg import move_poses
from calib.solver.priors import ParameterPrior
from calib.solver.problem import Loss, Problem, pack
from designer.base.arrays import Array, Rows


@dataclass(frozen=True, eq=False)
class OffsetPrior:
    """What is expected of the slacks of one camera's views."""

    weight: Array  # (V_c, 6, 6) W
    size: float  # k

    @property
    def precision(self) -> Array:
        """(V_c, 6, 6)"""
        return self.weight / self.size


@dataclass(frozen=True, eq=False)
class WithoutOffsets:
    """One camera's views without their slacks."""

    products: Array  # (V_c, P + 7, P + 7) of the views' blocks, reduced
    solved: Array  # (V_c, 6, P + 7) by how much the slacks follow parameters and pose, and the gradient; sign turned
    spread: Array  # (V_c, 6, 6) their covariance, all else known
    prior: float  # their squares, in standard deviations
    promised: float  # by how much the cost falls by them alone


def eliminated(products: Array, prior: OffsetPrior, value: Array, damping: float = 0.0) -> WithoutOffsets:
    """Blocks (V_c, P + 7, P + 7) without the slacks, which have values (V_c, 6); of a damped step with damping."""
    row = products[:, -7:-1].copy()
    pull = np.einsum("vde,ve->vd", prior.precision, value)
    row[:, :, -1] += pull
    curve = (row[:, :, -7:-1] + prior.precision) * (1 + damping * np.eye(6))
    spread = symmetric_inverse(curve).inverse  # zero along what a few points do not tell
    solved = spread @ row
    left = products - row.transpose(0, 2, 1) @ solved
    return WithoutOffsets(
        left, solved, spread, float((value * pull).sum()), float((row[:, :, -1] * solved[:, :, -1]).sum())
    )


def offset_step(view: WithoutOffsets, params_step: Array, pose_step: Array) -> Array:
    """The step of the slacks that belongs to steps of parameters (P,) and poses (V_c, 6).  # (V_c, 6)"""
    count = view.solved.shape[2] - 7
    step = view.solved[:, :, -1] + view.solved[:, :, :count] @ params_step
    return np.asarray(-(step + np.einsum("vdp,vp->vd", view.solved[:, :, count:-1], pose_step)))


def offset_evidence(prior: OffsetPrior, value: Array, covariance: Array) -> tuple[float, float]:
    """Squares of the values, and how many of them the photos tell: the size is their ratio (Foerstner 1979).

    Of one camera: values (V_c, 6) of its views, and their covariance (V_c, 6, 6) by the whole adjustment.
    """
    squares = float(np.einsum("vd,vde,ve->", value, prior.weight, value))
    return squares, float(value.size - np.einsum("vde,ved->", prior.precision, covariance))


FREE_SIZE = 0.1
"""Standard deviation of the size of a target of which nobody knows how it was made: a page that was fitted to the paper
is 3 to 6 % off."""


@dataclass(frozen=True)
class CameraChoice:
    """How one camera of a rig is to be solved."""

    model: str  # of `solved_models()`; of a given camera its own
    given: Camera | None = None  # from an earlier run; None: solved from nothing
    is_refined: bool = True  # whether its parameters are unknowns
    fixed: tuple[tuple[str, float | None], ...] = ()  # as `SolveOptions.fixed`
    priors: tuple[ParameterPrior, ...] = ()  # as `SolveOptions.priors`


@dataclass(frozen=True, eq=False)
class Mechanism:
    """What carries the target, or the cameras past it, and says how it stood in each frame.

    Camera in hand: the rig's frame is the flange's, and `rig_from_mechanism` is flange_from_base. Target in hand: the
    rig's frame is the base's, and it is base_from_flange. Turntable: the rig's frame is the table's at rest, its z
    along the axis, and it is the turn by each frame's angle.
    """

    kind: str  # see `MechanismFit`
    rig_from_mechanism: Array  # (V, 4, 4)
    is_camera_in_hand: bool = False
    is_turntable: bool = False
    has_free_angles: bool = False  # of a turntable
    sigma_rad: float | None = None  # of its own errors; None: estimated
    sigma_mm: float | None = None
    size_sigma: float = 0.0
    """Standard deviation of the target's size, as a part of it, before a robot's ways tell it; 0: it is not solved."""

    def __post_init__(self) -> None:
        freeze(self, "rig_from_mechanism")


@dataclass(frozen=True)
class RigOptions:
    """How to solve a rig; the default is least squares of all observations, one camera's noise told from another's."""

    reference: int = 0  # the camera whose frame the rig's is, if no carrier says otherwise
    weighted: bool = True
    loss: Loss = "squares"
    reject_sigma: float | None = None
    allows_offsets: bool | None = None
    """Of single photos, where they do not fit together; None: also only if each camera tells its lens by itself, or
    something carries them; see `solve_rig`."""
    estimates_delays: bool = False  # of cameras, from time stamps
    carrier: Mechanism | None = None
    max_iterations: int = 100
    minimise: str = IMAGE  # as `SolveOptions.minimise`
    free_bend: bool = False  # as `SolveOptions.free_bend`
    bend_sigma_mm: tuple[float, float, float, float, float] | None = None  # as `SolveOptions.bend_sigma_mm`


@dataclass(frozen=True, eq=False)
class SeenByOne:
    """What one camera of a rig saw, and where its unknowns stand among the shared ones."""

    problem: Problem  # its views are those frames that it saw
    frame: Rows  # (V_c,)
    params: Rows  # (P,) shared unknown of each parameter; -1: fixed
    pose: Rows  # (6,) of cam_from_rig; -1: the rig's frame is this camera's
    delay: Rows  # (1,) of the delay; -1: not estimated
    gap_s: Array  # (V_c,) time stamp from that of the frame


@dataclass(frozen=True, eq=False)
class MechanismPrior:
    """What a carrier says of the frames, and how well: see `calib.rigs.carrier`."""

    carrier: Mechanism
    column: Rows  # (6,) of carrier_from_target
    sigma: Array  # (2,) of a coordinate of its errors: rad, mm


@dataclass(frozen=True, eq=False)
class RigProblem:
    """All sightings of a rig in V frames, with G shared unknowns."""

    seen: tuple[SeenByOne, ...]  # (C,)
    frame_count: int
    shared_count: int
    loss: Loss
    scale: Array  # (C,) standard deviation of an observation: px, or in units of the stated covariance
    motion: Motion | None = None  # of the target; None: it stands still in each frame
    prior: MechanismPrior | None = None
    amount: Rows = field(default_factory=lambda: np.zeros(0, dtype=np.int64))
    """(S,) shared unknown of the target's size, then of its bend's heights; -1: as its file says."""
    amount_sigma: Array = field(default_factory=lambda: np.zeros(0))  # (S,) what is believed of these, about 1 and 0
    slack: tuple[OffsetPrior, ...] = ()  # (C,) of the views' poses; (): they are the rig's
    known: tuple[tuple[ParameterPrior, ...], ...] = ()  # (C,) of parameters that are free; (): nothing


@dataclass(frozen=True, eq=False)
class RigState:
    """Values of all unknowns."""

    cameras: tuple[Camera, ...]
    cam_from_rig: Array  # (C, 4, 4)
    rig_from_target: Array  # (V, 4, 4)
    delay_s: Array  # (C,)
    carrier_from_target: Array  # (4, 4)
    slack: tuple[Array, ...] = ()  # (C,) of (V_c, 6): by how much the views' poses are not the rig's
    amount: Array = field(default_factory=lambda: np.zeros(0))  # (S,) see `RigProblem`

    @property
    def size(self) -> float:
        """Of the target, as a part of what its file says."""
        return float(self.amount[0]) if len(self.amount) else 1.0


def pack_rig(
    observations: RigObservations, ties: Sequence[Rows], is_reference: Sequence[bool], scale: Array, options: RigOptions
) -> RigProblem:
    """The problem of all cameras, each view of which has sightings.

    Args:
        observations: what was seen.
        ties: of each camera, the free parameter that each parameter follows (P,); -1: fixed.
        is_reference: whether the rig's frame is a camera's.
        scale: see `RigProblem`.
        options: time offsets are of all cameras but the first.
    """
    carrier, loss = options.carrier, options.loss
    seen, count = [], 0
    params, poses = [], []
    for tie, fixed in zip(ties, is_reference, strict=True):
        params.append(np.where(tie >= 0, tie + count, -1))
        count += int(tie.max(initial=-1)) + 1
        poses.append(np.full(6, -1) if fixed else np.arange(6) + count)
        count += 0 if fixed else 6
    gaps = _gaps(observations)
    for number, one in enumerate(observations.sightings):
        delays = options.estimates_delays and number > 0
        seen.append(
            SeenByOne(
                pack(one, weighted=options.weighted), observations.frame[number], params[number], poses[number],
                np.full(1, count if delays else -1), gaps[number],
            )
        )  # fmt: skip
        count += int(delays)
    prior = None
    if carrier is not None:
        sigma = np.array([carrier.sigma_rad or np.nan, carrier.sigma_mm or np.nan])
        prior = MechanismPrior(carrier, np.arange(6) + count, sigma)
        count += 6
    heights = bend_sigma_mm(observations.points, options.bend_sigma_mm) if options.free_bend else np.zeros(0)
    sigma = np.concatenate([[0.0 if carrier is None else carrier.size_sigma], heights])
    if not sigma.any():
        return RigProblem(tuple(seen), observations.frame_count, count, loss, scale, prior=prior)
    for number, (part, own) in enumerate(zip(seen, observations.sightings, strict=True)):
        modes = [part.problem.position_mm[None], *([bend_modes_mm(own)] if len(heights) else [])]
        packed = replace(part.problem, modes_mm=np.concatenate(modes), amount=np.eye(1, len(sigma))[0])
        seen[number] = replace(part, problem=packed)
    column = np.where(sigma > 0, count + np.cumsum(sigma > 0) - 1, -1)
    count += int((sigma > 0).sum())
    return RigProblem(
        tuple(seen), observations.frame_count, count, loss, scale, prior=prior, amount=column, amount_sigma=sigma
    )


def without_params(problem: RigProblem) -> RigProblem:
    """The problem with all cameras' own parameters fixed."""
    kept = np.ones(problem.shared_count + 1, dtype=bool)
    for one in problem.seen:
        kept[one.params[one.params >= 0]] = False
    number = np.where(kept, np.cumsum(kept) - 1, -1)
    number[-1] = -1  # what was fixed
    seen = tuple(
        replace(one, params=np.full_like(one.params, -1), pose=number[one.pose], delay=number[one.delay])
        for one in problem.seen
    )
    prior = problem.prior and replace(problem.prior, column=number[problem.prior.column])
    return replace(problem, seen=seen, shared_count=int(kept[:-1].sum()), prior=prior, amount=number[problem.amount])


def frame_times(observations: RigObservations) -> Array:
    """Of each frame, the mean time stamp of its photos; nan where there are none.  # (V,)"""
    total, count = np.zeros(observations.frame_count), np.zeros(observations.frame_count)
    for frames, times in zip(observations.frame, observations.time_s or (), strict=False):
        total[frames] += times
        count[frames] += 1
    time: Array = np.divide(total, count, out=np.full(len(total), np.nan), where=count > 0)
    return time


def _gaps(observations: RigObservations) -> list[Array]:
    """Each camera's time stamps from those of the frames."""
    if observations.time_s is None:
        return [np.zeros(len(frames)) for frames in observations.frame]
    mean = frame_times(observations)
    return [times - mean[frames] for frames, times in zip(observations.frame, observations.time_s, strict=True)]


def seen_poses(problem: RigProblem, state: RigState, camera: int) -> tuple[Array, Array]:
    """A camera's poses `rig_from_target` at the times of its photos, and `cam_from_target`: (V_c, 4, 4) each."""
    one = problem.seen[camera]
    pose = state.rig_from_target[one.frame]
    gap = one.gap_s - state.delay_s[camera]
    if problem.motion is not None:
        way = problem.motion.way(one.frame, gap)
        pose = make_pose(exp_rotation(way[:, :3]) @ pose[:, :3, :3], pose[:, :3, 3] + way[:, 3:])
    seen = state.cam_from_rig[camera] @ pose
    if problem.slack:
        seen = move_poses(seen, state.slack[camera])
    return pose, seen


def speeds(problem: RigProblem, state: RigState, camera: int) -> Array:
    """How the target moves when a camera takes its photos.  # (V_c, 6) rad/s, mm/s"""
    one = problem.seen[camera]
    if problem.motion is None:
        return np.zeros((len(one.frame), 6))
    return problem.motion.speed(one.frame, one.gap_s - state.delay_s[camera])


def with_scale(problem: RigProblem, camera: int, amount: Array) -> Problem:
    """What a camera saw, whitened by what its observations are worth, too, of a target of some size and bend."""
    one = problem.seen[camera].problem
    return replace(one.at(amount), whitener=one.whitener / problem.scale[camera])
