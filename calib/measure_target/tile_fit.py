"""How the faces of a target sit that was put together from pieces: tiles on a core, stickers on a body."""

import math
from dataclasses import dataclass
from typing import Literal

import numpy as np

from calib.core.linear_algebra import least_squares, symmetric_inverse
from calib.core.se3 import skew
from calib.measure_target.accuracy import motions_of_whole
from calib.measure_target.datum import NO_STRAIN, SHAPE, few_views
from calib.measure_target.deviations import Estimate
from calib.measure_target.result import AsBuilt
from calib.measure_target.unknowns import strain_matrix
from designer.base.arrays import Array, Flags
from designer.base.marks import Gap
from designer.target import TargetGeometry
from designer.tolerance.model import ErrorModel
from designer.tolerance.shape import face_middle_mm
from designer.tolerance.source import Amount

Fault = Literal["lifted", "tilted", "turned", "shifted"]
SeatVerdict = Literal["sits badly", "as usual", "few photos", "not known"]

CHANCE = 0.01
"""Of an assembly as the way of making has it, with all its pieces: that one of them is said to sit badly."""
SOURCE_OF: dict[Fault, str] = {
    "lifted": "face_offset", "tilted": "face_tilt", "turned": "face_rotation", "shifted": "face_shift"
}  # fmt: skip
PARTS: dict[Fault, tuple[int, ...]] = {"lifted": (5,), "tilted": (0, 1), "turned": (2,), "shifted": (3, 4)}
"""Of a motion: rotation vector, shift."""
ANY_MM, ANY_RAD = 10.0, 0.1
"""Standard deviations of how far all may be moved, or stand out, alike."""
ROUNDS = 5
"""Of leaving out what sits badly, and judging again."""
LEAST_MM, LEAST_RAD = 0.01, math.radians(0.01)
"""Limits are no less: nobody puts a piece down as well as that."""
LEAST_PIECES = 3
"""Fewer pieces have nothing in common."""
SURE = 3.0
"""Standard deviations that a common height is off zero, of the measurement and of the pieces' scatter."""
SEEN_APART = 0.05
"""Share of a common height that no motion of the whole looks like: with less it is not known."""


@dataclass(frozen=True)
class Seat:
    """One piece, in its face's axes about the middle of its face, z outwards."""

    face: int
    verdict: SeatVerdict
    height_mm: Estimate  # beyond the common one, if there is one
    shift_x_mm: Estimate
    shift_y_mm: Estimate
    shift_mm: Estimate  # length of (x, y)
    turn_rad: Estimate  # about the normal
    tilt_rad: Estimate  # of the normal
    tilt_x_rad: Estimate
    tilt_y_rad: Estimate
    faults: tuple[Fault, ...]  # what is beyond the limits, the worst first
    worst: Gap  # the largest of the four over its limit

    def of(self, fault: Fault) -> Estimate:
        """Its number."""
        return {"lifted": self.height_mm, "tilted": self.tilt_rad, "turned": self.turn_rad, "shifted": self.shift_mm}[
            fault
        ]

    def share(self, fault: Fault, limits: "SeatLimits") -> float:
        """Its size over the limit."""
        return abs(self.of(fault).value) / limits.of(fault)


@dataclass(frozen=True)
class SeatLimits:
    """What the way of making explains: one piece of so many is beyond it once in 100 assemblies, or never."""

    lifted: float  # mm
    tilted: float  # rad
    turned: float  # rad
    shifted: float  # mm

    def of(self, fault: Fault) -> float:
        """Its limit."""
        limit: float = getattr(self, fault)
        return limit


@dataclass(frozen=True)
class Seats:
    """All pieces, and what they have in common."""

    piece: str  # "tile"
    lifted_remedy: str
    aside_remedy: str
    made: str  # the way of making that the limits are of
    limits: SeatLimits
    common_height_mm: Estimate | None  # of all alike: no piece's fault; None: none that can be told from scatter
    seats: tuple[Seat, ...]

    @property
    def bad(self) -> tuple[Seat, ...]:
        """Those that sit badly, the worst first."""
        bad = (one for one in self.seats if one.verdict == "sits badly")
        return tuple(sorted(bad, key=lambda one: -one.worst))

    @property
    def judged(self) -> int:
        """How many are judged."""
        return sum(one.verdict in ("sits badly", "as usual") for one in self.seats)


@dataclass(frozen=True, eq=False)
class _Motions:
    """Motions of pieces about the middles of their faces: rotation vector (rad), shift (mm)."""

    value: Array  # (F, 6)
    covariance: Array  # (F, 6, F, 6)
    counts: Flags  # (F,) those that tell what all have in common


def seats_of(found: AsBuilt, made: ErrorModel | None) -> Seats | None:
    """How each piece sits; None of a target that is one print, or of one face.

    >>> seats = seats_of(found, error_model("fdm-tiles"))
    >>> seats.bad[0].face, seats.bad[0].height_mm

    Motions are told against the pieces that sit well, so that a piece's fault is not told of its neighbours. That all
    stand out alike is told once, and taken off the heights; what the axes of the body's printer do to all is no piece's
    fault either.
    """
    count = found.nominal.face_count
    if made is None or made.piece is None or count < LEAST_PIECES or not found.motion_covariance.any():
        return None
    limits = limits_of(made, count)
    judged = found.is_determined & ~few_views(found.face_views)
    counts = judged & ~found.is_outlying
    for _ in range(ROUNDS):
        motions = _about_middles(found, made, counts)
        common = _common_height(found.nominal, motions)
        seats = tuple(_seat(face, motions, common, limits, found) for face in range(count))
        well = judged & [one.verdict != "sits badly" for one in seats]
        if 2 * well.sum() < judged.sum() or (well == counts).all():
            break
        counts = well
    return Seats(made.piece.name, made.piece.lifted, made.piece.aside, made.name, limits, common, seats)


def _about_middles(found: AsBuilt, made: ErrorModel, counts: Flags) -> _Motions:
    """The faces' motions about the middles of their outlines, against those of the faces that count.

    Taken off is what the body's own stretch does to all, and a motion of the whole.
    """
    target = found.nominal
    count = target.face_count
    change = np.tile(np.eye(6), (count, 1, 1))
    change[:, 3:, :3] = -skew(np.pad(face_middle_mm(target), ((0, 0), (0, 1))))
    value = np.einsum("fij,fj->fi", change, found.motion)
    covariance = found.motion_covariance.reshape(count, 6, count, 6)
    covariance = np.einsum("fij,fjgk,glk->figl", change, covariance, change)
    rest = _without_body(target, made, counts, change @ motions_of_whole(target))
    spread = np.einsum("ij,jgl->igl", rest, covariance.reshape(6 * count, count, 6)).reshape(6 * count, 6 * count)
    return _Motions((rest @ value.ravel()).reshape(count, 6), (spread @ rest.T).reshape(count, 6, count, 6), counts)


def _without_body(target: TargetGeometry, made: ErrorModel, counts: Flags, by_whole: Array) -> Array:
    """What takes from motions (6 F,) the part that unequal or leaning axes of the body have in them.  # (6 F, 6 F)

    Its most likely stretch, the pieces' own errors and the axes' being as large as the way of making says.
    """
    count = target.face_count
    taken = np.concatenate([_by_stretch(target), by_whole], axis=2).reshape(6 * count, -1)
    lift = np.tile([0.0, 0.0, 0.0, 0.0, 0.0, 1.0], count)[:, None]
    sizes = {fault: max(made.amount(name).sigma, LEAST_RAD * LEAST_MM) for fault, name in SOURCE_OF.items()}
    own = np.empty(6)
    for fault, part in PARTS.items():
        own[list(part)] = sizes[fault]
    weight = np.repeat(counts, 6) / np.tile(own, count) ** 2
    axes, leans = made.amount("axis_scale").sigma, made.amount("skew").sigma / 2
    prior = np.maximum([axes, axes, leans, leans, leans, *(ANY_RAD,) * 3, *(ANY_MM,) * 4], NO_STRAIN)
    design = np.concatenate([taken, lift], axis=1)
    normal = symmetric_inverse(design.T @ (weight[:, None] * design) + np.diag(prior**-2)).inverse
    fitted = normal @ (design.T * weight)
    rest: Array = np.eye(6 * count) - taken @ fitted[: taken.shape[1]]
    return rest


def _by_stretch(target: TargetGeometry) -> Array:
    """Motions of faces, about their middles, by the five numbers of a stretch that has no size.  # (F, 6, 5)"""
    turn = target.target_from_face[:, :3, :3]
    middle = np.einsum("fij,fj->fi", turn[:, :, :2], face_middle_mm(target)) + target.target_from_face[:, :3, 3]
    motion = np.zeros((target.face_count, 6, len(SHAPE)))
    for number, row in enumerate(SHAPE / np.linalg.norm(SHAPE, axis=1, keepdims=True)):
        inner = turn.transpose(0, 2, 1) @ strain_matrix(row)
        slope = inner @ turn  # of a symmetric matrix: in the plane it turns nothing
        motion[:, 0, number], motion[:, 1, number] = slope[:, 2, 1], -slope[:, 2, 0]
        motion[:, 3:, number] = np.einsum("fij,fj->fi", inner, middle)
    return motion


def _common_height(target: TargetGeometry, motions: _Motions) -> Estimate | None:
    """How far all pieces stand out alike, if that is more than their scatter.

    Of pieces that look one way, or three faces of a cube, it is a motion of the whole, which nobody can tell.
    """
    which = np.flatnonzero(motions.counts)
    if len(which) < LEAST_PIECES:
        return None
    lift = np.tile([0.0, 0.0, 0.0, 0.0, 0.0, 1.0], (len(which), 1))[:, 3:].ravel()
    moved = motions_of_whole(target)[which][:, 3:].reshape(-1, 6)
    left = lift - moved @ least_squares(moved, lift)
    if left @ left < SEEN_APART * (lift @ lift):
        return None
    height = motions.value[which, 5]
    variance = float(motions.covariance[which, 5][:, which, 5].sum()) / len(which) ** 2
    one = Estimate(float(height.mean()), math.sqrt(max(variance, 0.0)))
    scatter = float(height.var(ddof=1)) / len(which)
    return one if abs(one.value) > SURE * math.sqrt(one.sigma**2 + scatter) else None


def limits_of(made: ErrorModel, count: int) -> SeatLimits:
    """What one of so many pieces is beyond by chance, of the sizes that the way of making has."""
    chance = CHANCE / (len(PARTS) * count)
    limit = {fault: _limit(made.amount(name), len(PARTS[fault]), chance) for fault, name in SOURCE_OF.items()}
    least = {fault: LEAST_MM if fault in ("lifted", "shifted") else LEAST_RAD for fault in limit}
    return SeatLimits(**{fault: max(limit[fault], least[fault]) for fault in limit})


def _limit(amount: Amount, components: int, chance: float) -> float:
    """The length that so many numbers of a distribution exceed with a chance; of a bounded one, its farthest corner."""
    from scipy.stats import chi

    if amount.kind == "normal":
        return amount.size * float(chi.isf(chance, components))
    return abs(amount.size) * math.sqrt(components)


def _seat(face: int, motions: _Motions, common: Estimate | None, limits: SeatLimits, found: AsBuilt) -> Seat:
    """One piece against the limits."""
    value, covariance = motions.value[face], motions.covariance[face, :, face]
    value = value - np.array([0.0, 0.0, 0.0, 0.0, 0.0, 0.0 if common is None else common.value])
    sigma = np.sqrt(np.maximum(np.diagonal(covariance), 0.0))
    lengths = {fault: _length(value[list(part)], covariance[np.ix_(part, part)]) for fault, part in PARTS.items()}
    over = {fault: one.value / limits.of(fault) for fault, one in lengths.items()}
    verdict: SeatVerdict = "as usual"
    if not found.is_determined[face] or few_views(found.face_views)[face]:
        verdict = "few photos" if found.is_determined[face] else "not known"
    faults: tuple[Fault, ...] = ()
    if verdict == "as usual":
        beyond = [fault for fault in lengths if over[fault] > 1 and lengths[fault].is_significant]
        faults = tuple(sorted(beyond, key=lambda fault: -over[fault]))
    return Seat(
        face,
        "sits badly" if faults else verdict,
        height_mm=Estimate(float(value[5]), float(sigma[5])),
        shift_x_mm=Estimate(float(value[3]), float(sigma[3])),
        shift_y_mm=Estimate(float(value[4]), float(sigma[4])),
        shift_mm=lengths["shifted"],
        turn_rad=Estimate(float(value[2]), float(sigma[2])),
        tilt_rad=lengths["tilted"],
        tilt_x_rad=Estimate(float(value[0]), float(sigma[0])),
        tilt_y_rad=Estimate(float(value[1]), float(sigma[1])),
        faults=faults,
        worst=max(over.values()),
    )


def _length(vector: Array, covariance: Array) -> Estimate:
    """The length of a vector, with its standard deviation along it."""
    length = float(np.linalg.norm(vector))
    along = vector / length if length else np.full(len(vector), 1 / math.sqrt(len(vector)))
    return Estimate(length, math.sqrt(max(float(along @ covariance @ along), 0.0)))
