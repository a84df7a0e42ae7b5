"""How a print differs from its design, each number with its standard deviation."""

import math
from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Annotated, Literal

import numpy as np

from calib.core.linear_algebra import symmetric_inverse
from calib.core.se3 import exp_rotation
from calib.measure_target.datum import few_views
from calib.measure_target.result import AsBuilt, face_shift_mm
from calib.measure_target.unknowns import STRAIN_INDEX, bow_basis, strain_matrix, strain_numbers
from designer.base.arrays import Array
from designer.base.errors import InputError
from designer.base.marks import Gap, Key, NullIs, OneOf
from designer.base.units import MOST_SKEW_DEG, NO_SKEW, SKEW_NAMES, Skew, skew_matrix
from designer.kinds.layout import face_down, is_turned
from designer.target import TargetGeometry

Axis = Annotated[str, OneOf(("x", "y", "z"))]
Angle = Annotated[str, OneOf(SKEW_NAMES)]

SIGNIFICANT = 3.0
"""Standard deviations from which on a single number is called more than noise."""
CHANCE = 1e-3
"""Probability below which a face that lies as designed does not look as it does."""
FREE_PARAMETERS = ("shift x", "shift y", "shift z", "tilt x", "tilt y", "turn z")
"""Of a face, in its own axes: z is its outward normal."""
ORDER = [3, 4, 5, 0, 1, 2]
"""Of these in the motions of faces, which have rotations first."""

LARGEST_STRAIN = 0.5
"""A size, stretch or angle (rad) beyond this is no print's: nothing can be dialled in against it."""
LEAST_COMPENSATION_PERCENT = 0.005
"""Less is not worth dialling in: 5 um on 100 mm."""
MOST_SHRINK_PERCENT = 50.0
ROUNDS = 8
"""From angles back to a strain: each leaves a part as large as the strain itself."""
_PAIRS = ((0, 1), (0, 2), (1, 2))
"""Of `SKEW_NAMES`."""
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
    axes: Mapping[Axis, Estimate]  # stretch of each axis beyond the mean
    skews_rad: Mapping[Angle, Estimate]  # how far the second axis leans towards the first

    @property
    def known_size(self) -> Estimate | None:
        """The size, if it is a number."""
        return self.size if self.size is not None and self.size.is_known else None

    @property
    def is_in_shape(self) -> bool:
        """Whether no axis and no angle is off by more than noise."""
        return not any(one.is_significant for one in (*self.axes.values(), *self.skews_rad.values()))

    @property
    def can_be_corrected(self) -> bool:
        """Whether size and shape are numbers that a printer could make."""
        known = [one for one in (self.size, *self.axes.values(), *self.skews_rad.values()) if one and one.is_known]
        return all(math.isfinite(one.sigma) and abs(one.value) < LARGEST_STRAIN for one in known)


@dataclass(frozen=True)
class Compensation:
    """What a print was made with, to tell what to make the next one with.

    Raises:
        InputError: more than `design` takes, or no number.
    """

    shrink_percent: Annotated[float, Key("made_with_shrink_compensation_percent")] = 0.0
    skew_rad: Annotated[Skew, Key("made_with_skew_compensation_rad")] = NO_SKEW  # xy, xz, yz

    def __post_init__(self) -> None:
        if not abs(self.shrink_percent) < MOST_SHRINK_PERCENT:
            most = f"{MOST_SHRINK_PERCENT:g}%"
            raise InputError(
                f"--shrink-compensation {self.shrink_percent:g}%: must lie between -{most} and {most}; give what this "
                "print was made with"
            )
        skew_deg = [math.degrees(angle) for angle in self.skew_rad]
        if not all(abs(angle) <= MOST_SKEW_DEG * (1 + 1e-9) for angle in skew_deg):
            raise InputError(
                f"--skew-compensation {', '.join(f'{angle:g}deg' for angle in skew_deg)}: each of xy, xz, yz must lie "
                f"between -{MOST_SKEW_DEG:g}deg and {MOST_SKEW_DEG:g}deg; give what this print was made with"
            )


def bed_axes(target: TargetGeometry, turn_rad: float = 0.0) -> Array:
    """The axes that a print's stretch is told in: those of the bed, as `design` lays the target on it.  # (3, 3)

    On its last face, the longer of its two horizontal extents along x (see `designer.make.bed`; of a bed that is deeper
    than wide it is y).

    `turn_rad` is by how much a person turned it further, about the bed's normal.
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
    flat = found.nominal.is_plate
    axes = (0, 1) if flat else (0, 1, 2)
    mean = np.zeros(6)
    mean[list(axes)] = 1 / len(axes)

    def estimate(row: Array) -> Estimate:
        return Estimate(float(row @ numbers), math.sqrt(max(float(row @ covariance @ row), 0.0)))

    unit = np.eye(6)
    skews = [(k, "xyz"[i] + "xyz"[j]) for k, (i, j) in enumerate(STRAIN_INDEX) if i != j and j in axes]
    return whole_of_strain(
        size=estimate(mean) if found.scale_known else None,
        axes={"xyz"[axis]: estimate(unit[axis] - mean) for axis in axes},
        shears={name: estimate(2 * unit[k]) for k, name in sorted(skews, key=lambda pair: pair[1])},
    )


def whole_of_strain(
    size: Estimate | None, axes: Mapping[Axis, Estimate], shears: Mapping[Angle, Estimate]
) -> WholePrint:
    """A print by its strain in the bed's axes, a shear being 2 e_ij; what is told are the angles by which axes lean."""
    half = [shears[name].value / 2 if name in shears else 0.0 for name in SKEW_NAMES]
    leans = dict(zip(SKEW_NAMES, _leans_rad(_stretch(size, axes, np.array(half))).tolist(), strict=True))
    return WholePrint(size, axes, {name: replace(one, value=leans[name]) for name, one in shears.items()})


def _stretch(size: Estimate | None, axes: Mapping[Axis, Estimate], half_shear: Array) -> Array:
    """The symmetric stretch (3, 3) of a print, from e_xy, e_xz and e_yz."""
    stretch = np.eye(3) * (1.0 if size is None else 1 + size.value)
    for name, one in axes.items():
        stretch["xyz".index(name), "xyz".index(name)] += one.value
    for value, (i, j) in zip(half_shear, _PAIRS, strict=True):
        stretch[i, j] = stretch[j, i] = value
    return stretch


def _leans_rad(matrix: Array) -> Array:
    """How far axes lean: a rotation aside, columns of the triangular factor over their diagonal.  # (3,) xy, xz, yz"""
    upper = np.linalg.qr(matrix, mode="r")
    upper *= np.sign(np.diagonal(upper))[:, None]
    leans: Array = np.arctan([upper[i, j] / upper[j, j] for i, j in _PAIRS])
    return leans


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
    its diagonal, are those of the next K; the diagonal is size and scale of axes. Of a print without compensation they
    are the angles that are told. An angle that is no more than noise stays as it was. The axes are those of the bed as
    the print lay, with and without compensation.

    Args:
        whole: what was measured, with skews in the bed's axes.
        made_with_rad: c, the compensation of the measured print.
    """
    leans = whole.skews_rad
    told = np.array([leans[name].value if name in leans else 0.0 for name in SKEW_NAMES])
    half = told / 2
    for _ in range(ROUNDS):
        half = half + (told - _leans_rad(_stretch(whole.size, whole.axes, half))) / 2
    lean_rad = _leans_rad(_stretch(whole.size, whole.axes, half) @ skew_matrix(made_with_rad)).tolist()
    xy, xz, yz = (
        lean if name in leans and leans[name].is_significant else before
        for name, lean, before in zip(SKEW_NAMES, lean_rad, made_with_rad, strict=True)
    )
    return xy, xz, yz


def next_shrink_percent(whole: WholePrint, made_with_percent: float = 0.0) -> float:
    """The shrinkage compensation of the next print; that of this one, if no other is worth it."""
    size = whole.known_size
    if size is None or not size.is_significant:
        return made_with_percent
    percent = compensation_percent(size.value, made_with_percent)
    return made_with_percent if abs(percent - made_with_percent) < LEAST_COMPENSATION_PERCENT else percent


def face_verdicts(found: AsBuilt) -> tuple[Verdict, ...]:
    """Whether each face moved; nothing for a single one, of which that is the pose.

    A face moved if its motion is neither chance nor so small that its rings' residuals hardly show it.
    """
    from scipy.stats import chi2

    count = found.nominal.face_count
    if count == 1:
        return ()
    block = found.motion_covariance.reshape(count, 6, count, 6)[np.arange(count), :, np.arange(count)]
    square = np.einsum("fi,fij,fj->f", found.motion, symmetric_inverse(block).inverse, found.motion)
    shift_mm = face_shift_mm(found.nominal, found.motion[:, :, None] * found.motion[:, None])
    has_moved = (chi2.sf(square, 6) < CHANCE) & (shift_mm > NOTICED * found.centre_noise_mm)
    few = few_views(found.face_views)
    return tuple(map(_verdict, found.is_determined.tolist(), few.tolist(), has_moved.tolist()))


def _verdict(is_determined: bool, has_few_views: bool, has_moved: bool) -> Verdict:
    if not is_determined:
        return "not known"
    if has_few_views:
        return "few photos"
    return "moved" if has_moved else "as designed"


def bent_mm(target: TargetGeometry, offset_mm: Array, bow_mm: Array) -> Array:
    """Offsets of rings on their faces with what bends the face, in the faces' axes.  # (R, 3)"""
    bent = np.array(offset_mm)
    bent[:, 2] += (bow_basis(target) * bow_mm[target.ring_face]).sum(axis=1)
    return bent
