"""Lengths that a caliper measured: the only thing that tells how large a target is.

On the command line a length is `face-to-face:151.20mm+-0.02mm`.
"""

import math
import re
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass, replace

import numpy as np

from designer.base.arrays import Array, Flags
from designer.base.errors import InputError
from designer.base.marks import Number, Word
from designer.base.units import format_mm, parse_length_mm
from designer.base.words import several, shown, suggestion
from designer.target import TargetGeometry
from designer.tolerance.model import ErrorModel, perturb

PARALLEL = 0.9
"""Cosine of the angle between the normals of faces that a caliper goes over, with the sign turned."""
SAME_CORNER = 0.05
"""Corners closer than this part of an edge are one."""
CONTRADICTION = 1e-3
"""Probability of lengths that differ as much by chance."""
FAR = 0.1
"""A scale farther from 1 is a mistake, not a print."""
NAMES = '"face-to-face", "edge", "face 0 to face 15" or "ring 3 to ring 17"'
CALIPER_SIGMA_MM = 0.02
"""What most makers of calipers state for 150 mm; an assumption where no sigma is given."""
EXAMPLE = "face-to-face:151.20mm+-0.02mm"
SAME_MM = 0.005
"""A length nearer to the design's is likely copied from it: calipers tell hundredths."""
DOUBTED = 4.0
"""Standard deviations of prints from which on a length is asked about."""
PRINTS = 100
"""That are simulated for them, which tells them to 7 %."""
MAX_TEXT = 120
_BETWEEN = re.compile(r"(ring|face)\s+(\d+)\s+to\s+\1\s+(\d+)")
_EITHER = re.compile(r"±|\+/-|\+-")
_UNIT = re.compile(r"[^\d.\s]*\s*$")


@dataclass(frozen=True)
class CaliperLength:
    """A measured length: "face-to-face" (between opposite faces), "edge", "face A to face B", "ring I to ring J"."""

    name: str
    value_mm: float
    sigma_mm: float
    is_usual_sigma: bool = False  # nobody gave it

    @property
    def text(self) -> str:
        """As it is typed."""
        return f"{self.name}:{format_mm(float(self.value_mm))}+-{format_mm(float(self.sigma_mm))}"


@dataclass(frozen=True)
class FittedLength:
    """A length that told the size, and its residual: measured - as measured by all lengths together."""

    name: Word
    value_mm: Number
    sigma_mm: Number
    residual_sigma: Number  # in its standard deviations


@dataclass(frozen=True)
class Scale:
    """How much larger than a target the print is, from lengths."""

    value: float
    sigma: float
    lengths: tuple[FittedLength, ...]  # that told it


def length_in(target: TargetGeometry, name: str, known: Flags | None = None) -> float:
    """The length of a name in a target, in mm.

    Args:
        target: where.
        name: which; see `CaliperLength`.
        known: the faces that may be used (F,); None: all.

    Raises:
        InputError: the target has no such length.
    """
    known = np.ones(target.face_count, dtype=bool) if known is None else known
    words = name.strip().lower()
    if words == "face-to-face":
        pairs = _opposite_faces(target, known)
        if not pairs:
            raise InputError(f"length {name!r}: the target has no two opposite faces that were seen; give {NAMES}")
        return float(np.mean([_between_faces(target, *pair) for pair in pairs]))
    if words == "edge":
        return _mean_edge(target, known, name)
    found = _BETWEEN.fullmatch(words)
    if found is None:
        # Numbers are taken out: they are no part of what may be misspelt.
        known_words = ["face-to-face", "edge", "ring N to ring N", "face N to face N"]
        hint = suggestion(re.sub(r"\d+", "N", words), known_words) or f"; give {NAMES}"
        raise InputError(f"length {name!r} is none that a target has{hint}")
    first, second = int(found[2]), int(found[3])
    count = target.ring_count if found[1] == "ring" else target.face_count
    if max(first, second) >= count or first == second:
        raise InputError(f"length {name!r}: give two different {found[1]}s from 0 to {count - 1}")
    if found[1] == "ring":
        if not known[target.ring_face[[first, second]]].all():
            raise InputError(f"length {name!r}: the photos do not join the faces of the two rings; measure others")
        return float(np.linalg.norm(target.center_mm[first] - target.center_mm[second]))
    if not known[[first, second]].all():
        raise InputError(f"length {name!r}: the photos do not join the two faces; measure others")
    if -_normals(target)[first] @ _normals(target)[second] < PARALLEL:
        raise InputError(f"length {name!r}: the faces are not opposite each other; give two that are")
    return _between_faces(target, first, second)


def _normals(target: TargetGeometry) -> Array:
    return target.target_from_face[:, :3, 2]


def _opposite_faces(target: TargetGeometry, known: Flags) -> list[tuple[int, int]]:
    """Pairs of known faces that a caliper can go over."""
    cosine = -_normals(target) @ _normals(target).T
    pairs = np.argwhere(np.triu((cosine > PARALLEL) & known & known[:, None], 1))
    return [(int(a), int(b)) for a, b in pairs]


def _between_faces(target: TargetGeometry, first: int, second: int) -> float:
    """Distance of two faces along the mean of their normals, through the middles of their outlines."""
    frame = target.target_from_face
    along = frame[first, :3, 2] - frame[second, :3, 2]
    middle = [frame[f, :3, :2] @ target.outline_mm[f].mean(axis=0) + frame[f, :3, 3] for f in (first, second)]
    return float(along @ (middle[0] - middle[1]) / np.linalg.norm(along))


def _mean_edge(target: TargetGeometry, known: Flags, name: str) -> float:
    """Mean length of the edges at which faces meet, between corners that are the means of their faces' corners."""
    frame = target.target_from_face
    corner = np.einsum("fij,fkj->fki", frame[:, :3, :2], target.outline_mm) + frame[:, None, :3, 3]
    side = np.linalg.norm(np.roll(corner, -1, axis=1) - corner, axis=2)
    known_corner = corner[known].reshape(-1, 3)
    apart = np.linalg.norm(corner[:, :, None] - known_corner, axis=3)
    near = apart < SAME_CORNER * side.mean()
    if not known.any() or target.is_planar:
        raise InputError(f"length {name!r}: the target has no edges at which faces meet; give a length between rings")
    shared = np.einsum("fkn,ni->fki", near, known_corner) / np.maximum(near.sum(axis=2), 1)[:, :, None]
    lengths = np.linalg.norm(np.roll(shared, -1, axis=1) - shared, axis=2)[known]
    return float(lengths.mean())


def _design_mm(target: TargetGeometry, length: CaliperLength, known: Flags | None = None) -> float:
    """What a length is in a target, if it may be one of a print of it.

    Raises:
        InputError: the target has no such length, or it is no number, or far off.
    """
    if not (0 < length.value_mm < np.inf and 0 < length.sigma_mm < np.inf):
        raise InputError(
            f"length {length.name} of {length.value_mm:g} mm ± {length.sigma_mm:g} mm: both must be numbers of more "
            "than 0; give what the caliper showed"
        )
    inside = length_in(target, length.name, known)
    if abs(length.value_mm / inside - 1) > FAR:
        raise InputError(
            f"length {length.name} of {length.value_mm:g} mm: the target has {inside:.2f} mm there, and no print is "
            f"off by more than {100 * FAR:g} %; check what was measured, and the unit"
        )
    return inside


def scale_from(target: TargetGeometry, lengths: Sequence[CaliperLength], known: Flags | None = None) -> Scale:
    """The weighted mean of what lengths say of the scale of a target.

    Raises:
        InputError: a length that the target does not have, that is far off, or that contradicts the others.
    """
    inside = np.array([_design_mm(target, one, known) for one in lengths])
    measured = np.array([one.value_mm for one in lengths])
    sigma = np.array([one.sigma_mm for one in lengths])
    ratio = measured / inside
    weight = (inside / sigma) ** 2
    value = float((weight * ratio).sum() / weight.sum())
    residual = (measured - value * inside) / sigma
    _require_agreement(lengths, inside, residual)
    fitted = (
        FittedLength(one.name, one.value_mm, one.sigma_mm, left)
        for one, left in zip(lengths, residual.tolist(), strict=True)
    )
    return Scale(value, float(weight.sum() ** -0.5), tuple(fitted))


def _require_agreement(lengths: Sequence[CaliperLength], inside: Array, residual: Array) -> None:
    """Refuse lengths that differ by more than their standard deviations allow (chi-square test).

    Raises:
        InputError: they do; the message names the worst, and what the others say it should be.
    """
    from scipy.special import chdtrc

    square = float((residual**2).sum())
    if len(lengths) < 2 or chdtrc(len(lengths) - 1, square) > CONTRADICTION:
        return
    worst = int(np.argmax(np.abs(residual)))
    others = np.arange(len(lengths)) != worst
    weight = np.array([(length / one.sigma_mm) ** 2 for length, one in zip(inside, lengths, strict=True)])[others]
    ratio = np.array([one.value_mm for one in lengths])[others] / inside[others]
    expected = float((weight * ratio).sum() / weight.sum() * inside[worst])
    one = lengths[worst]
    raise InputError(
        f"length {one.name} of {one.value_mm:.3f} mm contradicts the others, which make it {expected:.3f} mm "
        f"(chi-square {square:.1f} of {len(lengths) - 1}); measure again, or give larger uncertainties"
    )


def scaled(target: TargetGeometry, scale: float, about_mm: Array | None = None) -> TargetGeometry:
    """A target made larger about a point (3,), or its origin, as a measured one; its covariances grow with it."""
    about = np.zeros(3) if about_mm is None else about_mm
    frame = np.array(target.target_from_face)
    frame[:, :3, 3] = about + scale * (frame[:, :3, 3] - about)
    covariance = target.face_covariance
    if covariance is not None:
        unit = np.array([1.0, 1.0, 1.0, scale, scale, scale])
        covariance = covariance * unit[:, None] * unit
    return replace(
        target,
        source="measured",
        center_mm=about + scale * (target.center_mm - about),
        radius_outer_mm=scale * target.radius_outer_mm,
        radius_inner_mm=scale * target.radius_inner_mm,
        target_from_face=frame,
        outline_mm=scale * target.outline_mm,
        window_mm=scale * target.window_mm,
        lattice_mm=scale * target.lattice_mm,
        face_covariance=covariance,
    )


def rescaled(target: TargetGeometry, length: CaliperLength) -> TargetGeometry:
    """The target with the scale that one length says, without photos.

    Raises:
        InputError: the target has no such length, or another one by far.
    """
    return scaled(target, scale_from(target, [length]).value)


def asked_lengths(
    lengths: str | CaliperLength | Iterable[str | CaliperLength], target: TargetGeometry
) -> list[CaliperLength]:
    """What --length was given: one length of a print of a target, or any number of them.

    Raises:
        InputError: one is none, as `asked_length` says.
    """
    given = (lengths,) if isinstance(lengths, CaliperLength) else several("--length", lengths)
    return [asked_length("--length", one, target) for one in given]


def usual_sigmas(lengths: Iterable[CaliperLength]) -> Iterator[str]:
    """What is assumed of lengths, a line each."""
    for one in lengths:
        if one.is_usual_sigma:
            yield f"length {one.text}: the sigma is the usual of a caliper; another with NAME:VALUE+-SIGMA"


def asked_length(option: str, length: str | CaliperLength, target: TargetGeometry) -> CaliperLength:
    """A length of a print of a target, as it is or in the words of an option.

    Args:
        option: what messages begin with.
        length: in words `NAME:VALUE`, `NAME:VALUE+-SIGMA`; a unit at one of the two holds for the other, without one
            it is mm.
        target: must have such a length.

    Raises:
        InputError: another form, an unknown name or unit, a value or sigma that is no number of more than 0, or a
            length that the target does not have.
    """
    if not isinstance(length, str | CaliperLength):
        raise InputError(f"{option} {shown(length)}: give text as in {EXAMPLE!r}, or a CaliperLength")
    asked = _parsed(option, length) if isinstance(length, str) else length
    try:
        _design_mm(target, asked)
    except InputError as error:
        raise InputError(f"{option}: {error}") from None
    return asked


def _parsed(option: str, text: str) -> CaliperLength:
    """A length in words."""
    place = f"{option} {shown(text[:MAX_TEXT])}"
    name, colon, quantity = text.partition(":")
    if not colon or len(text) > MAX_TEXT:
        raise InputError(f"{place}: write NAME:VALUE+-SIGMA, as in {EXAMPLE}; NAME is {NAMES}")
    parts = _EITHER.split(quantity)
    if len(parts) > 2:
        raise InputError(f"{place}: more than one sigma; write it as in {EXAMPLE}")
    units = [match[0].strip() if (match := _UNIT.search(part.strip())) else "" for part in parts]
    common = next(filter(None, reversed(units)), "")
    numbers = []
    for what, part, unit in zip(("the length", "its sigma"), parts, units, strict=False):
        try:
            numbers.append(parse_length_mm(part.strip() if unit else f"{part.strip()}{common}"))
        except ValueError as error:
            is_word = part.strip() and not any(character.isdigit() for character in part)
            remedy = f"; put your reading in place of {shown(part.strip())}" if is_word else ""
            raise InputError(f"{place}: {what}: {error}{remedy}") from None
    value_mm, sigma_mm = (*numbers, CALIPER_SIGMA_MM)[:2]
    return CaliperLength(" ".join(name.lower().split()), value_mm, sigma_mm, is_usual_sigma=len(parts) == 1)


def doubt_about(length: CaliperLength, target: TargetGeometry, errors: ErrorModel | None) -> str:
    """Why a length hardly is what a caliper showed on a print of a target, in a line; "" if it may well be.

    Args:
        length: of the print.
        target: as designed.
        errors: how it was made, which tells how far prints are off; None: not known.
    """
    inside = length_in(target, length.name)
    if abs(length.value_mm - inside) <= SAME_MM:
        return f"length {length.text} is the design's value to {SAME_MM:g} mm: is it a reading?"
    if errors is None:
        return ""
    rng = np.random.default_rng(0)
    prints = [length_in(perturb(target, errors, rng), length.name) for _ in range(PRINTS)]
    usual_mm, sigma_mm = float(np.mean(prints)), math.hypot(float(np.std(prints)), length.sigma_mm)
    if abs(length.value_mm - usual_mm) <= DOUBTED * sigma_mm:
        return ""
    return (
        f"length {length.text} is {length.value_mm - inside:+.2f} mm from the design's {inside:.2f} mm; prints made as "
        f"'{errors.name}' are within {DOUBTED * sigma_mm:.2f} mm: check the reading, the scale it was printed at, or "
        "say with --made how it was made"
    )
