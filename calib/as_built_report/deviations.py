"""How a print differs from its design, each number with its standard deviation."""

import math
from dataclasses import dataclass
from typing import Annotated, Literal

import numpy as np
from numpy.typing import NDArray

from calib.as_built.datum import few_views
from calib.as_built.result import AsBuilt, face_shift_mm
from calib.as_built.unknowns import STRAIN_INDEX, strain_matrix, strain_numbers
from calib.core.linear_algebra import symmetric_inverse
from calib.core.se3 import exp_rotation
from designer.base.marks import Gap, NullIs
from designer.base.units import NO_SKEW, SKEW_NAMES, Skew, skew_matrix
from designer.kinds.layout import face_down, is_turned
from designer.target import TargetGeometry

Array = NDArray[np.float64]

SIGNIFICANT = 3.0
"""Standard deviations from which on a single number is called more than noise."""
CHANCE = 1e-3
"""Probability below which a face that lies as designed does not look as it does."""
FREE_PARAMETERS = ("shift x", "shift y", "shift z", "tilt x", "tilt y", "turn z")
"""Of a face, in its own axes: z is its outward normal."""
ORDER = [3, 4, 5, 0, 1, 2]
"""Of these in the motions of faces, which have rotations first."""

NOTICED = 1 / 3
"""Of a centre's noise: a motion that shifts a face's rings by less leaves their residuals as they are to 5 %."""

Verdict = Literal["moved", "as designed", "few photos", "not known"]
JUDGED: tuple[Verdict, ...] = ("moved", "as designed")


@dataclass(frozen=True)
class Estimate:
    """A number with its standard deviation."""

    value: Gap
    sigma: Annotated[float, NullIs(math.inf)]

    @property
    def is_known(self) -> bool:
        """Whether there is a number."""
        return math.isfinite(self.value)

    @property
    def significance(self) -> float:
        """How many standard deviations it is from zero."""
        return abs(self.value) / self.sigma if self.sigma > 0 else math.inf if self.value else 0.0

    @property
    def is_significant(self) -> bool:
        """Whether it is more than noise."""
        return self.significance > SIGNIFICANT


@dataclass(frozen=True)
class WholePrint:
    """Size and shape of the whole print, along the axes of a bed on which it lay on its last face."""

    size: Estimate | None  # mean stretch; 0.01: 1 % too large; None: no length tells it
    axes: tuple[tuple[str, Estimate], ...]  # stretch of each axis beyond the mean
    skews: tuple[tuple[str, Estimate], ...]  # rad, how far the second axis leans towards the first

    @property
    def is_in_shape(self) -> bool:
        """Whether no axis and no angle is off by more than noise."""
        return not any(one.is_significant for _, one in (*self.axes, *self.skews))


def bed_axes(target: TargetGeometry, turn_rad: float = 0.0) -> Array:
    """The axes that a print's stretch is told in: those of the bed, as `design` lays the target on it.  # (3, 3)

    On its last face, the longer of its two horizontal extents along x (see `designer.make.bed`; of a bed that is deeper
    than wide it is y).

    Args:
        target: what was printed.
        turn_rad: by which a person turned it further, about the bed's normal.
    """
    quarter = math.pi / 2 if is_turned(target) else 0.0
    turned: Array = exp_rotation(np.array([0.0, 0.0, quarter + turn_rad])) @ face_down(target)
    return turned


def whole_print(found: AsBuilt, bed_turn_rad: float = 0.0) -> WholePrint:
    """Size, stretch and skew of the print.

    With `I + e` the print's symmetric stretch, the mean is tr(e) / 3, an axis' own is e_ii - tr(e) / 3, and an axis
    that leans towards another by the angle a has e_ij = a / 2; the other half of the shear is a rotation. Of a board
    only what is in its plane can be told.
    """
    turn = bed_axes(found.nominal, bed_turn_rad)
    change = np.column_stack([strain_numbers(turn @ strain_matrix(unit) @ turn.T) for unit in np.eye(6)])
    numbers = change @ strain_numbers(found.strain)
    covariance = change @ found.strain_covariance @ change.T
    flat = found.nominal.is_planar
    axes = (0, 1) if flat else (0, 1, 2)
    mean = np.zeros(6)
    mean[list(axes)] = 1 / len(axes)

    def estimate(row: Array) -> Estimate:
        return Estimate(float(row @ numbers), math.sqrt(max(float(row @ covariance @ row), 0.0)))

    unit = np.eye(6)
    skews = [(k, "xyz"[i] + "xyz"[j]) for k, (i, j) in enumerate(STRAIN_INDEX) if i != j and j in axes]
    return WholePrint(
        size=estimate(mean) if found.scale_known else None,
        axes=tuple(("xyz"[axis], estimate(unit[axis] - mean)) for axis in axes),
        skews=tuple((name, estimate(2 * unit[k])) for k, name in sorted(skews, key=lambda pair: pair[1])),
    )


def compensation_percent(size: float, made_with_percent: float = 0.0) -> float:
    """What to dial into `design --shrink-compensation`, so that the next print comes out as designed.

    The printer makes of a length l (1 + c) l (1 + m), with the compensation c the print was made with. It came out as
    l (1 + s), so m is known, and the next compensation is (1 + c) / (1 + s) - 1.

    Args:
        size: s, how much larger than designed the print is.
        made_with_percent: 100 c.
    """
    return 100 * ((1 + made_with_percent / 100) / (1 + size) - 1)


def next_skew_rad(whole: WholePrint, made_with_rad: Skew = NO_SKEW) -> Skew:
    """What to dial into `design --skew-compensation`, so that the next print comes out as designed.

    The printer M made of a file sheared by K(c)^-1 (`designer.make.bed`) what is, a rotation aside, the stretch S that
    was measured. So M = Q S K(c) with a rotation Q, and of its triangular factor U (M = Q' U) the columns, each over
    its diagonal, are those of the next K; the diagonal is size and scale of axes. An angle that is no more than noise
    stays as it was. The axes are those of the bed as the print lay, with and without compensation.

    Args:
        whole: what was measured, with skews in the bed's axes.
        made_with_rad: c, the compensation of the measured print.
    """
    leans = dict(whole.skews)
    stretch = np.eye(3) * (1.0 if whole.size is None else 1 + whole.size.value)
    for name, one in whole.axes:
        stretch["xyz".index(name), "xyz".index(name)] += one.value
    for name, one in whole.skews:
        i, j = ("xyz".index(axis) for axis in name)
        stretch[i, j] = stretch[j, i] = one.value / 2
    upper = np.linalg.qr(stretch @ skew_matrix(made_with_rad), mode="r")
    upper *= np.sign(np.diagonal(upper))[:, None]
    upper /= np.diagonal(upper)
    lean_rad = np.arctan(upper[[0, 0, 1], [1, 2, 2]]).tolist()
    xy, xz, yz = (
        lean if name in leans and leans[name].is_significant else before
        for name, lean, before in zip(SKEW_NAMES, lean_rad, made_with_rad, strict=True)
    )
    return xy, xz, yz


@dataclass(frozen=True, eq=False)
class FaceDeviations:
    """How each face of F lies against the design, what the whole print's stretch does to it taken off."""

    value: Array  # (F, 6) as `FREE_PARAMETERS`: mm, mm, mm, rad, rad, rad
    sigma: Array  # (F, 6)
    chance: Array  # (F,) probability of as much if the face lay as designed
    verdict: tuple[Verdict, ...]  # (F,)


def face_deviations(found: AsBuilt) -> FaceDeviations | None:
    """How the faces lie; None for a single one, of which that is the pose."""
    from scipy.stats import chi2

    count = found.nominal.face_count
    if count == 1:
        return None
    block = found.motion_covariance.reshape(count, 6, count, 6)[np.arange(count), :, np.arange(count)]
    sigma = np.sqrt(np.maximum(np.diagonal(block, axis1=1, axis2=2), 0.0))
    square = np.einsum("fi,fij,fj->f", found.motion, symmetric_inverse(block).inverse, found.motion)
    chance = np.asarray(chi2.sf(square, 6), dtype=np.float64)
    is_noticed = face_shift_mm(found.nominal, found.motion[:, :, None] * found.motion[:, None]) > (
        NOTICED * found.centre_noise_mm
    )
    few = few_views(found.face_views)
    verdict = tuple(
        map(_verdict, found.is_determined.tolist(), few.tolist(), ((chance < CHANCE) & is_noticed).tolist())
    )
    return FaceDeviations(found.motion[:, ORDER], sigma[:, ORDER], chance, verdict)


def _verdict(is_determined: bool, has_few_views: bool, has_moved: bool) -> Verdict:
    if not is_determined:
        return "not known"
    if has_few_views:
        return "few photos"
    return "moved" if has_moved else "as designed"


@dataclass(frozen=True, eq=False)
class RingDeviations:
    """How the rings lie on their faces, in the faces' axes: their own offsets, with what bends the face."""

    seen: NDArray[np.int64]  # (N,) rings
    offset_mm: Array  # (N, 3)
    sigma_mm: Array  # (N, 3) of the own offsets


def ring_deviations(found: AsBuilt) -> RingDeviations | None:
    """How the seen rings lie; None if they were held on flat faces."""
    from calib.as_built.unknowns import bow_basis

    has_bow = bool(np.any(found.bow_mm))
    if found.ring_sigma_mm is None and not has_bow:
        return None
    offset = np.array(found.offset_mm)
    offset[:, 2] += (bow_basis(found.nominal) * found.bow_mm[found.nominal.ring_face]).sum(axis=1)
    seen = np.flatnonzero(found.is_ring_seen & found.is_determined[found.nominal.ring_face])
    return RingDeviations(seen, offset[seen], found.offset_sigma_mm[seen])
