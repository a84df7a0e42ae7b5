"""A camera solved from halves of its views: whether the stated standard deviations can be believed.

If what is left over is noise, two halves differ by what their covariances say. If it is not (a target that is not as
its file says, a model that does not fit the lens, a focus that moved), each half takes up another part of it and they
lie farther apart. What all views have in common no halves show. One split is a single throw of dice, so several are
made.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Annotated, Literal

import numpy as np

from calib.cameras.surface import surface_model
from calib.core.linear_algebra import sums_by
from calib.core.parallel import one_thread
from calib.core.types import Observations, keep_sightings, keep_views
from calib.judge.coverage import Coverage
from calib.judge.difference import Known, apart
from calib.solver.accuracy import SHARE_PERCENT
from calib.solver.calibrate import calibrate
from calib.solver.calibration import Calibration
from calib.solver.problem import SolveOptions
from designer.base.arrays import Array, Flags, Rows
from designer.base.errors import InputError
from designer.base.marks import INLINE, LEFT_OUT, AtLeast, AtMost, Key, Length, Line, Word
from designer.base.words import shown

LEAST_VIEWS = 4
BY_CHANCE_APART = 1.35
"""A ratio of halves that honest standard deviations exceed in 1 of 20 runs with 6 to 20 photos (simulated)."""
MOST_VIEWS = 100_000
LARGEST_COVARIANCE = 1e100
"""Squares of what is larger overflow further on."""
ASYMMETRY = 1e-6
FileName = Annotated[str, Length(0, 4000)]


@dataclass(frozen=True, eq=False)
class Half:
    """What one half of the views gives."""

    known: Annotated[Known, INLINE]
    view_names: Annotated[tuple[FileName, ...], Length(0, MOST_VIEWS), Key("views")]

    def __post_init__(self) -> None:
        covariance, largest = self.known.param_covariance, float(np.abs(self.known.param_covariance).max())
        if len(covariance) != len(self.known.camera.params):
            raise ValueError(f"param_covariance must be of {len(self.known.camera.params)} parameters")
        if not largest <= LARGEST_COVARIANCE or (np.diagonal(covariance) < 0).any():
            rule = f"variances of 0 or more, and no number beyond {LARGEST_COVARIANCE:g}"
            raise ValueError(f"param_covariance must have {rule}")
        if np.abs(covariance - covariance.T).max() > ASYMMETRY * largest:
            raise ValueError("param_covariance must be symmetric")


@dataclass(frozen=True, eq=False)
class Halves:
    """Pairs of solutions of the same model and options, each of two halves of the views."""

    pairs: tuple[tuple[Half, Half], ...]  # one or more

    def __post_init__(self) -> None:
        cameras = [half.known.camera for pair in self.pairs for half in pair]
        if len({(camera.image_size, camera.model) for camera in cameras}) != 1:
            raise ValueError("halves must have cameras of one model and image size")


@dataclass(frozen=True)
class NoHalves:
    """Why there are none."""

    reason: Line  # "3 photos cannot be halved; take 4 or more"

    @property
    def factor(self) -> float:
        """What standard deviations are to be multiplied with that nothing checked: they stay as they are stated."""
        return 1.0


HalfSplit = Halves | NoHalves
NOT_COMPARED = NoHalves("halves of the frames were not compared")


@dataclass(frozen=True, eq=False)
class HalvesApart:
    """How far halves of the views lie apart over the covered image, as root mean squares over all splits."""

    ratio: float  # in stated standard deviations, 1 on average if they are honest
    rms_px: float
    stated_px: float  # the root mean square that the standard deviations let expect
    percentile_95_px: float  # what 95 % of the covered area differ by at most
    pixel: Array  # (R, C, 2) a grid
    length_px: Array  # (R, C) differences, nan where none is known

    @property
    def factor(self) -> float:
        """What stated standard deviations are to be multiplied with: the ratio, where chance does not explain it.

        Data that scatter more than their standard deviations say have these enlarged by as much (Birge 1932, The
        calculation of errors by the method of least squares, Phys. Rev. 40; the scale factor of the Particle Data
        Group).
        """
        return self.ratio if self.ratio > BY_CHANCE_APART else 1.0


SplitKind = Literal["by turns", "in order"]
KINDS: tuple[SplitKind, ...] = ("by turns", "in order")
PLACE = 3
"""Coordinates of a place."""
RARE = 1.96
"""Normal quantile of what chance exceeds in 1 of 40 honest rigs."""
STEADIER = 0.85
"""What halves in order leave over, of what alike halves do, if something moved between them."""
_Size = Annotated[float, AtLeast(0), AtMost(1e9)]


@dataclass(frozen=True)
class PairApart:
    """How far two halves of the frames put a pair of cameras apart."""

    names: tuple[Word, Word]
    baseline_mm: Annotated[float, AtLeast(-1e9), AtMost(1e9)]  # of the second half, less that of the first
    sigma_mm: _Size  # that the halves state of this difference


@dataclass(frozen=True)
class RigSplit:
    """One way of halving the frames."""

    kind: SplitKind
    ratio: _Size  # of the cameras' poses: in stated standard deviations, 1 on average if these are honest
    unknowns: Annotated[int, AtLeast(1)]  # that it is the root mean square of
    noise: _Size  # what the halves leave over, in what all frames together leave over
    pairs: Annotated[tuple[PairApart, ...], Length(0, 100_000)]
    target_ratio: Annotated[_Size | None, LEFT_OUT] = None  # as `ratio`, of where the target's middle is on its carrier
    by_noise: Annotated[_Size | None, LEFT_OUT] = None  # the ratio by noise alone; None: nothing else was stated


@dataclass(frozen=True)
class RigHalves:
    """What came of all ways."""

    splits: Annotated[tuple[RigSplit, ...], Length(1, 10)]

    def ratio_of(self, kind: SplitKind) -> float:
        """Root mean square over the ways of a kind; nan if there is none."""
        return _root_mean_square([one.ratio for one in self.splits if one.kind == kind])

    @property
    def ratio(self) -> float:
        """The larger of both kinds."""
        return max(one for kind in KINDS if math.isfinite(one := self.ratio_of(kind)))

    @property
    def by_chance(self) -> float:
        """What honest standard deviations stay within, but for 1 of 20 rigs: two kinds, each but for 1 of 40."""
        return _by_chance(min(one.unknowns for one in self.splits))

    @property
    def factor(self) -> float:
        """What stated standard deviations are to be multiplied with, as in `calib.judge.halves`."""
        return self.ratio if self.ratio > self.by_chance else 1.0

    @property
    def target_factor(self) -> float:
        """Likewise those of where a carried target is placed; if nothing carried it, those of all else.

        Halves may differ in lens and direction of a camera, and place the target alike.
        """
        kinds = ([one.target_ratio for one in self.splits if one.kind == kind] for kind in KINDS)
        ratios = [_root_mean_square([one for one in kind if one is not None]) for kind in kinds]
        known = [one for one in ratios if math.isfinite(one)]
        if not known:
            return self.factor
        return max(known) if max(known) > _by_chance(PLACE) else 1.0

    def noise_of(self, kind: SplitKind) -> float:
        """What the halves of a kind leave over, in what all frames together do; nan if there are none."""
        found = [one.noise for one in self.splits if one.kind == kind]
        return sum(found) / len(found) if found else math.nan

    @property
    def has_moved(self) -> bool:
        """Whether the first frames fit each other, and so do the last, but not all together.

        Something that moved once spoils alike halves, too; what they leave over is then as much as that of all frames.
        """
        steadier = self.noise_of("in order") < STEADIER * self.noise_of("by turns")
        worst = max([self.ratio, *(one.by_noise for one in self.splits if one.by_noise is not None)])
        return steadier and worst > self.by_chance


def _root_mean_square(values: Sequence[float]) -> float:
    return math.sqrt(sum(one**2 for one in values) / len(values)) if values else math.nan


def _by_chance(unknowns: int) -> float:
    """What the root mean square of so many standard normal numbers stays within, but for 1 of 40.

    The cube root of chi square over its degrees of freedom is about normal (Wilson and Hilferty 1931).
    """
    part = 2 / (9 * unknowns)
    return math.pow(1 - part + RARE * math.sqrt(part), 1.5)


@one_thread
def half_split(calibration: Calibration, options: SolveOptions) -> HalfSplit:
    """Solve the model of a calibration from halves of its views, with the options it was solved with.

    Sightings that the calibration left out as outliers stay out. Halves that do not determine the camera are skipped.
    """
    seen, views = calibration.observations, calibration.observations.view_count
    if calibration.status == "degenerate":
        return NoHalves("the photos do not determine the camera, so neither does half of them")
    if calibration.camera.learned is not None:
        return NoHalves("a learned map states no standard deviation that a difference could be compared with")
    if views < LEAST_VIEWS:
        return NoHalves(f"{views} photo{'s' if views > 1 else ''} cannot be halved; take {LEAST_VIEWS} or more")
    alone = np.bincount(_session(calibration)) == 1
    if alone.any():
        name = calibration.sessions[int(np.argmax(alone))].name
        return NoHalves(f"session {shown(name)} has one photo only, and halves must have each; take 2 or more of it")
    if not np.bincount(seen.view[~calibration.is_outlier], minlength=views).all():
        return NoHalves("a photo has no sighting that counts; leave it out and solve again")
    used = keep_sightings(calibration.given, ~calibration.is_outlier)
    pairs, reasons = [], []
    for is_first in splits(calibration):
        halves = [_solved(keep_views(used, rows), calibration.camera.model, options) for rows in (is_first, ~is_first)]
        first, second = halves
        if isinstance(first, Half) and isinstance(second, Half):
            pairs.append((first, second))
        else:
            reasons += [half.reason for half in halves if isinstance(half, NoHalves)]
    return Halves(tuple(pairs)) if pairs else NoHalves(reasons[0])


def _solved(half: Observations, model: str, options: SolveOptions) -> Half | NoHalves:
    """The camera of one half."""
    try:
        solved = calibrate(half, model, options)
    except InputError as error:
        return NoHalves(f"half of the photos do not do: {error}")
    if solved.status != "converged":
        why = solved.remarks[0] if solved.remarks else solved.status
        return NoHalves(f"half of the photos do not determine the camera: {why}")
    return Half(Known(solved.camera, solved.param_covariance), solved.observations.view_names)


def halves_apart(halves: HalfSplit, coverage: Coverage) -> HalvesApart | NoHalves:
    """How far halves lie apart where the image is covered, or why that is not known."""
    if isinstance(halves, NoHalves):
        return halves
    found = [one for first, second in halves.pairs if (one := apart(first.known, second.known, coverage)) is not None]
    if not found:
        return NoHalves("the cameras of the two halves share no part of the covered image")
    length = np.sqrt((np.stack([one.length_px for one in found]) ** 2).mean(axis=0))
    ratio, rms, stated = (
        float(np.sqrt(np.mean([getattr(one, name) ** 2 for one in found]))) for name in ("ratio", "rms_px", "stated_px")
    )
    known = length[np.isfinite(length)]
    within = float(np.percentile(known, SHARE_PERCENT)) if len(known) else rms
    return HalvesApart(ratio, rms, stated, within, found[0].pixel, length)


MOST_SPLITS = 4
PER_RIGHT_ANGLE = 0.35
"""A turn of the target by a right angle counts as much as a shift by about half of the image."""


def splits(calibration: Calibration) -> tuple[Flags, ...]:
    """Up to four ways, one of a camera with a surface: which views (V,) belong to the first half.

    Each orders the views along another direction in which they differ (where in the image, how large, from which side,
    how rolled; the principal axes of these) and takes them in turns: first, second, second, first. So the halves are
    alike in that direction, and in the others not on purpose: halves with the same poses would make the same errors.
    The order in which the views are given does not matter but for ties. Each session is halved by itself: a camera is
    the mean of its sessions, and so that of others in halves that lack some.
    """
    # Of hundreds of parameters a split takes megabytes to keep, and tells much by itself.
    most = MOST_SPLITS if surface_model(calibration.camera.model) is None else 1
    # A half and its complement are the same split.
    found: dict[bytes, Flags] = {}
    for is_first in by_turns(_features(calibration), most, _session(calibration)):
        found.setdefault((is_first == is_first[0]).tobytes(), is_first)
    return tuple(found.values())


def _session(calibration: Calibration) -> Rows:
    """The session of each view; all are of one where nothing varies between them.  # (V,)"""
    of = {photo: number for number, one in enumerate(calibration.sessions) for photo in one.photos}
    return np.array([of.get(name, 0) for name in calibration.observations.view_names])


def by_turns(feature: Array, most: int, group: Rows | None = None) -> list[Flags]:
    """Halves (V,) of views or frames, which differ in their features (V, K), that are alike along the principal axes.

    They are ordered along an axis and taken first, second, second, first: those of each group (V,), the other way
    round in every other.
    """
    group = np.zeros(len(feature), dtype=np.int64) if group is None else group
    feature = feature - feature.mean(axis=0)
    axes = np.linalg.svd(feature, full_matrices=False)[2]
    # An axis may point either way; which one must not depend on the order of the views.
    axes *= np.sign(np.take_along_axis(axes, np.abs(axes).argmax(axis=1)[:, None], axis=1))
    before = np.searchsorted(np.sort(group), group)
    ranks = (np.argsort(np.lexsort((feature @ axis, group))) - before for axis in axes[:most])
    return [np.isin(rank % 4, (0, 3)) ^ (group % 2 == 1) for rank in ranks]


def _features(calibration: Calibration) -> Array:
    """Where each view sees the target in the image and how large, from which side, and how rolled.  # (V, 8)"""
    seen = calibration.observations
    count = np.maximum(np.bincount(seen.view, minlength=seen.view_count), 1)[:, None]
    place = seen.center_px / max(seen.image_size) - 0.5
    middle = sums_by(seen.view, place, seen.view_count) / count
    square = sums_by(seen.view, place**2, seen.view_count) / count
    size = np.sqrt(np.maximum(square - middle**2, 0.0)).mean(axis=1, keepdims=True)
    rotation = calibration.cam_from_target[:, :3, :3]
    # The viewing direction in the target's frame, and the direction of its x axis in the image.
    turn = np.concatenate([rotation[:, 2], rotation[:, :2, 0]], axis=1)
    return np.concatenate([middle, size, PER_RIGHT_ANGLE * turn], axis=1)
