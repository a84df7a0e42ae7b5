"""What pictures of a coupon tell of the printer: ink bleed, widths, size and shape, with standard deviations."""

import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Annotated

import numpy as np

from calib.coupon_reading.edges import Feature
from calib.coupon_reading.place import PlacedPictures
from calib.coupon_reading.reading import OPEN, EdgeFit, Reading
from calib.measure_target.deviations import (
    Compensation,
    Estimate,
    WholePrint,
    bed_axes,
    next_shrink_percent,
    next_skew_rad,
    whole_of_strain,
)
from designer.base.arrays import Array
from designer.base.marks import INLINE, Key, Number, Word
from designer.base.units import Skew
from designer.target import TargetGeometry

AXES = ("x", "y")
COLOURS: Mapping[str, tuple[Feature, ...]] = {"black": ("ring", "black line"), "white": ("white line",)}
"""What is narrow: ink between white, or white between ink."""
UNSEEN_BLURS = 0.1
"""By which all edges may lie elsewhere without a trace in their profile, in blurs: tone curves and processing beyond
the model's. A blur by software, after the pixels have sampled, moved edges by up to 0.2. An assumption."""
CUT_OFF_BLURS = 2.0
"""Likewise times the share of pixels that are cut off, with which goes what tells sharpening from a tone curve: prints
drawn in linear light and sharpened until a fifth was cut off were off by up to 0.7 blurs."""
LEAST_OFFSET_MM = 0.005
"""Less is not worth dialling in."""
STEP_MM = 0.005
"""To which an ink offset is told: no printer is repeatable to less."""


@dataclass(frozen=True)
class Width:
    """Strokes, lines or gaps of one width."""

    feature: Feature
    designed_mm: Number
    printed_mm: tuple[Estimate, Estimate]  # across x, and across y


@dataclass(frozen=True)
class PrinterFaults:
    """What was found, along the bed's axes."""

    bleed_mm: Estimate  # black into white, of both axes: what the ink offset takes back
    black_mm: Mapping[Word, Estimate]  # of ink between white, along x and y
    white_mm: Mapping[Word, Estimate]  # of white between ink
    y_beyond_x_mm: Estimate  # of ink between white; the tone curve is in neither
    white_beyond_black_mm: Estimate
    widths: tuple[Width, ...]
    whole: WholePrint


NOTHING = Compensation()


@dataclass(frozen=True)
class CouponMadeWith:
    """What a coupon was printed with."""

    ink_offset_mm: Annotated[Number, Key("made_with_ink_offset_mm")] = 0.0
    whole: Annotated[Compensation, INLINE] = NOTHING


@dataclass(frozen=True)
class NextPrint:
    """What to print the next design with."""

    ink_offset_mm: Number
    shrink_percent: Number
    skew_rad: Skew


def found_in(
    target: TargetGeometry, placement: PlacedPictures, readings: Sequence[Reading], *, size_known: bool
) -> PrinterFaults:
    """All that pictures of one print tell together.

    Args:
        target: the coupon as designed.
        placement: of all pictures.
        readings: of each picture.
        size_known: whether a length or a scan tells the size.
    """
    rows = [[*_rows(reading)] for reading in readings]

    def mean(features: Sequence[Feature]) -> Mapping[str, "_Mean"]:
        return {name: _of_all(readings, rows, features, axis) for axis, name in enumerate(AXES)}

    black, white, lines = mean(COLOURS["black"]), mean(COLOURS["white"]), mean(("black line",))
    return PrinterFaults(
        _halfway(*black.values()).estimate, {name: one.estimate for name, one in black.items()},
        {name: one.estimate for name, one in white.items()}, black["y"].beyond(black["x"]),
        _halfway(*white.values()).beyond(_halfway(*lines.values())), tuple(_widths(readings, rows)),
        whole_of(target, placement, size_known=size_known),
    )  # fmt: skip


@dataclass(frozen=True, eq=False)
class _Row:
    """How far one edge moved along one axis."""

    fit: EdgeFit
    axis: int
    value_mm: float
    variance: float  # of the pixels' noise
    by_shape: Array  # (11,)


def _rows(reading: Reading) -> Iterator[_Row]:
    """Circles tell both axes, lines one."""
    for fit in reading.fits:
        for number, axis in enumerate((0, 1) if fit.edge.axis < 0 else (fit.edge.axis,)):
            yield _Row(
                fit, axis, float(fit.moved_mm[number]), float(fit.covariance[number, number]), fit.by_shape[number]
            )


@dataclass(frozen=True, eq=False)
class _Mean:
    """Of many edges in one picture, or in several."""

    value_mm: float
    spread_mm: float  # standard deviation of the mean, from the edges' differences
    by_tone_mm: Array  # what the tone curve leaves open, by independent numbers; alike in sign for all edges
    weight: float

    @property
    def estimate(self) -> Estimate:
        """With all that is not known."""
        return Estimate(self.value_mm, math.hypot(self.spread_mm, float(np.linalg.norm(self.by_tone_mm))))

    def beyond(self, other: "_Mean") -> Estimate:
        """How much more, what both share taken off; not known where either is not."""
        if not (self.weight and other.weight):
            return Estimate(math.nan, math.inf)
        shared = float(np.linalg.norm(self.by_tone_mm - other.by_tone_mm))
        return Estimate(self.value_mm - other.value_mm, math.sqrt(self.spread_mm**2 + other.spread_mm**2 + shared**2))


def _mean(
    reading: Reading, rows: Sequence[_Row], features: Sequence[Feature], axis: int, width_mm: float | None
) -> _Mean:
    """The mean over edges of some features, each as heavy: print and model, not noise, are what differs."""
    own = [
        one for one in rows
        if one.fit.edge.feature in features and one.axis == axis
        and (width_mm is None or abs(one.fit.edge.width_mm - width_mm) < 1e-6)
    ]  # fmt: skip
    root = np.linalg.cholesky(reading.shape_covariance)
    blurs = UNSEEN_BLURS * max(reading.misfit, 1.0) + CUT_OFF_BLURS * reading.cut_off
    unseen = blurs * reading.shape.blur_px / reading.px_per_mm
    if not own:
        return _Mean(math.nan, math.inf, np.full(OPEN + 1, math.inf), 0.0)
    values = np.array([one.value_mm for one in own])
    noise = math.sqrt(sum(one.variance for one in own)) / len(own)
    spread = float(values.std(ddof=1)) / math.sqrt(len(own)) if len(own) > 1 else 0.0
    by_tone = np.append(np.mean([one.by_shape for one in own], axis=0) @ root, unseen)
    return _Mean(float(values.mean()), max(noise, spread), by_tone, 1 / float(by_tone @ by_tone + spread**2 + noise**2))


def _of_all(
    readings: Sequence[Reading],
    rows: Sequence[Sequence[_Row]],
    features: Sequence[Feature],
    axis: int,
    width_mm: float | None = None,
) -> _Mean:
    """The mean over all pictures: the print's own spread and the camera's tone stay, however many there are."""
    means = [_mean(reading, own, features, axis, width_mm) for reading, own in zip(readings, rows, strict=True)]
    weight = np.array([one.weight for one in means])
    if not weight.sum():
        return means[0]
    used = [one for one in means if one.weight]
    share = weight[weight > 0] / weight.sum()
    return _Mean(
        float(share @ [one.value_mm for one in used]), float(share @ [one.spread_mm for one in used]),
        share @ np.abs([one.by_tone_mm for one in used]) * np.where(used[0].by_tone_mm < 0, -1, 1), float(weight.sum()),
    )  # fmt: skip


def _halfway(first: _Mean, second: _Mean) -> _Mean:
    """The mean of both axes."""
    return _Mean(
        (first.value_mm + second.value_mm) / 2, math.hypot(first.spread_mm, second.spread_mm) / 2,
        (first.by_tone_mm + second.by_tone_mm) / 2, min(first.weight, second.weight),
    )  # fmt: skip


def _widths(readings: Sequence[Reading], rows: Sequence[Sequence[_Row]]) -> Iterator[Width]:
    """Strokes, lines and gaps, the narrow ones first: ink is wider by twice the bleed, white narrower."""
    kinds = {(one.fit.edge.feature, round(one.fit.edge.width_mm, 6)) for part in rows for one in part}
    for feature, designed in sorted(kinds):
        sign = -2 if feature in COLOURS["white"] else 2
        both = []
        for axis in (0, 1):
            one = _of_all(readings, rows, (feature,), axis, designed).estimate
            both.append(Estimate(designed + sign * one.value, 2 * one.sigma))
        if both[0].is_known and both[1].is_known:
            yield Width(feature, designed, (both[0], both[1]))


def whole_of(target: TargetGeometry, placement: PlacedPictures, *, size_known: bool) -> WholePrint:
    """Size, stretch and skew along the bed's axes, as `design` lays a target on the bed."""
    turn = bed_axes(target)[:2, :2]

    def in_bed(numbers: Array) -> Array:
        size, stretch, skew = numbers
        strain = turn @ np.array([[size + stretch / 2, skew / 2], [skew / 2, size - stretch / 2]]) @ turn.T
        return np.array([strain.trace() / 2, strain[0, 0] - strain[1, 1], 2 * strain[0, 1]])

    by = np.column_stack([in_bed(unit) for unit in np.eye(3)])
    size, stretch, skew = in_bed(placement.print_numbers).tolist()
    sigma = np.sqrt(np.diagonal(by @ placement.covariance @ by.T)).tolist()
    return whole_of_strain(
        size=Estimate(size, sigma[0]) if size_known else None,
        axes={"x": Estimate(stretch / 2, sigma[1] / 2), "y": Estimate(-stretch / 2, sigma[1] / 2)},
        shears={"xy": Estimate(skew, sigma[2])},
    )


def next_of(found: PrinterFaults, made_with: CouponMadeWith) -> NextPrint:
    """What takes back what was found, beyond what the coupon was printed with; what is no more than noise stays."""
    offset, bleed = made_with.ink_offset_mm, found.bleed_mm
    if bleed.is_significant and abs(bleed.value) >= LEAST_OFFSET_MM:
        offset = round((offset - bleed.value) / STEP_MM) * STEP_MM
    whole = made_with.whole
    return NextPrint(
        round(offset, 6),
        next_shrink_percent(found.whole, whole.shrink_percent),
        next_skew_rad(found.whole, whole.skew_rad),
    )
