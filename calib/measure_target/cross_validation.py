"""Cross-validation: what a measured target gains on photos that it was not measured from."""

import math
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Annotated, TypeAlias

import numpy as np

from calib.core.se3 import make_pose, transform
from calib.core.types import (
    LEAST_POINTS,
    Observations,
    RigObservations,
    keep_frames,
    keep_sightings,
    keep_views,
    sightings_per_view,
)
from calib.measure_target.accuracy import faces_words
from calib.measure_target.datum import best_motion
from calib.measure_target.lengths import scaled
from calib.measure_target.result import AsBuilt
from calib.measure_target.solve import measure, measure_rig, with_known_weights
from calib.measure_target.unknowns import AsBuiltOptions
from calib.observe.observations import known_points
from calib.rigs.problem import RigOptions
from calib.rigs.result import RigCalibration
from calib.rigs.solve import solve_rig
from calib.solver.calibration import Calibration
from calib.solver.metrics import METRICS
from calib.solver.metrics.errors import Errors
from calib.solver.metrics.evaluation import errors_of
from calib.solver.solve import solve
from calib.solver.start import solve_poses
from designer.base.arrays import Array, Flags, Rows
from designer.base.errors import InputError
from designer.base.marks import Count, FewLines, Length, Number, Word
from designer.target import TargetGeometry

_Key: TypeAlias = tuple[str, str, bool]
"""Metric, unit, and whether the errors are against the true rings."""
_ErrorSum: TypeAlias = list[float]
"""Squares of errors and how many there are, of one photo; of errors that are of no single photo, of one part."""
_Pair: TypeAlias = tuple[float, ...]
"""These with the nominal, then with the measured target."""

JUDGED_BY = ("intersection", "reprojection")
"""The metrics that tell whether a measured target is better, the first that has a bound."""
SURE = 0.975
"""Probability with which the gain is at least what is stated."""


@dataclass(frozen=True)
class Gain:
    """Root mean square errors of one metric, with the nominal and with the measured target."""

    metric: Word
    unit: Word
    count: Count
    nominal: Number
    measured: Number
    least_factor: Number | None = None
    """What the factor is at least, by how it differs from photo to photo; None: one photo does not tell."""

    @property
    def factor(self) -> float:
        """How many times smaller the error is with the measured target; 1 if there is none with either."""
        if self.measured > 0:
            return self.nominal / self.measured
        return math.inf if self.nominal > 0 else 1.0

    @property
    def is_better(self) -> bool | None:
        """Whether the measured target is better beyond the chance of these photos; None: too few to tell."""
        is_exact = self.nominal == 0 or self.measured == 0  # then there is no spread to bound the factor by
        least = self.factor if is_exact else self.least_factor
        return None if least is None else least > 1


@dataclass(frozen=True)
class CrossValidation:
    """Errors of views that neither camera nor target were solved from."""

    parts: Count  # 0: there were too few views
    gains: Annotated[tuple[Gain, ...], Length(0, 20)]  # each target judged by its own rings
    against_truth: Annotated[tuple[Gain, ...], Length(0, 20)]  # both by the true rings, laid over by a similarity
    remarks: FewLines
    is_better: bool | None = None  # by the gain that says most

    @property
    def judged_by(self) -> Gain | None:
        """The gain that says most; None if there is none by which a target is judged, or too few photos to tell."""
        can_judge = [gain for gain in self.gains if gain.is_better is not None]
        return next((gain for metric in JUDGED_BY for gain in can_judge if gain.metric == metric), None)


def cross_validate(
    found: AsBuilt,
    model: str,
    options: AsBuiltOptions,
    parts: int,
    *,
    rig: RigCalibration | None = None,
    truth: TargetGeometry | None = None,
    done: Callable[[float], None] = lambda part: None,
) -> CrossValidation:
    """Hold every `parts`-th view out in turn, measure from the others, and judge the views held out.

    Of a held-out view only its own pose is solved. Observations that the measurement left out stay out, and so do those
    of faces that at most one of the other views shows: they are not measured then. The size of the target takes no
    part: as lengths are not in photos, there is nothing to hold out.

    Args:
        found: of all views.
        model: of the cameras.
        options: as it was measured.
        parts: how many.
        rig: that it was measured from, of which frames are held out; None: photos of cameras by themselves.
        truth: the geometry that rendered photos show.
        done: told how many parts are finished.

    Returns:
        The gains; none if no part can be judged, and the remarks say why.
    """
    options = with_known_weights(options, found.observations)
    options = replace(options, solve=replace(options.solve, reject_sigma=None))
    seen = [_usable(one, out) for one, out in zip(found.observations, found.is_outlier, strict=True)]
    pairs: dict[_Key, list[_Pair]] = {}
    remarks: list[str] = []
    unmeasured, unjudged = np.zeros(found.nominal.face_count, dtype=bool), 0
    together = None if rig is None else _used_frames(rig, found)
    for part in range(parts):
        number = [np.arange(one.view_count) for one in seen] if together is None else together.frame
        held = [rows % parts == part for rows in number]
        try:
            if rig is None or together is None:
                others = [keep_views(one, ~out) for one, out in zip(seen, held, strict=True)]
                measured = measure(others, found.nominal, model, options)
                solved = [solve(one, model, options.solve) for one in others]
            else:
                measured, solved = _measured_from_frames(rig, together, (part, parts), found.nominal, options)
        except InputError as error:
            remarks.append(f"part {part + 1} of {parts}: {error}")
            continue
        for one, out, by_nominal, camera in zip(seen, held, solved, measured.cameras, strict=True):
            whole = keep_views(one, out)
            is_judged = _is_measured(measured)[found.nominal.ring_face[whole.point]]
            unmeasured[found.nominal.ring_face[whole.point[~is_judged]]] = True
            unjudged += int((~is_judged).sum())
            shown = _usable(whole, ~is_judged)
            with_nominal = _errors(by_nominal, shown, found.nominal, truth)
            with_measured = _errors(replace(by_nominal, camera=camera), shown, measured.target, truth)
            for key in with_nominal.keys() & with_measured.keys():
                both = with_nominal[key].keys() & with_measured[key].keys()  # so that both are judged alike
                names = [name for name in with_nominal[key] if name in both]
                pairs.setdefault(key, []).extend(
                    (*with_nominal[key][name], *with_measured[key][name]) for name in names
                )
        done(part + 1)
    if unjudged:
        remarks.append(
            f"{unjudged} observations of {faces_words(unmeasured)} are not judged: photos that are not held out hardly "
            "show these"
        )
    gains, true = (tuple(_gains(pairs, is_true=is_true)) for is_true in (False, True))
    validated = CrossValidation(parts, gains, true, tuple(remarks))
    judged = validated.judged_by
    return replace(validated, is_better=None if judged is None else judged.is_better)


def _used_frames(rig: RigCalibration, found: AsBuilt) -> RigObservations:
    """What of a rig's sightings was used, as `_usable` has it; all frames keep their numbers."""
    seen, frames = [], []
    for one, out, rows in zip(found.observations, found.is_outlier, rig.observations.frame, strict=True):
        seen.append(_usable(one, out))
        frames.append(rows[sightings_per_view(keep_sightings(one, ~out)) >= LEAST_POINTS])
    return replace(rig.observations, sightings=tuple(seen), frame=tuple(frames), time_s=None)


def _measured_from_frames(
    rig: RigCalibration, used: RigObservations, part: tuple[int, int], nominal: TargetGeometry, options: AsBuiltOptions
) -> tuple[AsBuilt, list[Calibration]]:
    """The print as the frames of other parts show it, and their cameras as these are with the target as designed."""
    number = np.arange(used.frame_count)
    others = keep_frames(used, np.isin(number, np.concatenate(used.frame)) & (number % part[1] != part[0]))
    choices = [replace(one, given=None) if one.is_refined else one for one in rig.choices]
    weighted, allows_offsets = options.solve.weighted, rig.slack is not None
    solved = solve_rig(others, choices, RigOptions(max(rig.reference, 0), weighted, allows_offsets=allows_offsets))
    return measure_rig(solved, nominal, options), list(solved.alone)


def _is_measured(found: AsBuilt) -> Flags:
    """The faces that are determined, and of several not by one view alone.  # (F,)"""
    measured: Flags = found.is_determined & ((found.face_views > 1) | (found.nominal.is_planar))
    return measured


def _usable(seen: Observations, is_outlier: Flags) -> Observations:
    """The observations that were used, of views that still have enough of them."""
    used = keep_sightings(seen, ~is_outlier)
    return keep_views(used, sightings_per_view(used) >= LEAST_POINTS)


def _errors(
    solved: Calibration, shown: Observations, target: TargetGeometry, truth: TargetGeometry | None
) -> dict[_Key, dict[str, _ErrorSum]]:
    """The errors of views by their names, against the target that their poses are solved with, and the truth."""
    if not shown.view_count:
        return {}
    shown = replace(shown, points=known_points(target))
    poses = solve_poses(solved.camera, shown, weighted=solved.weighted).cam_from_target
    has_pose = np.isfinite(poses.sum(axis=(1, 2)))
    if not has_pose.any():
        return {}
    shown, poses = keep_views(shown, has_pose), poses[has_pose]
    judged = replace(
        solved, observations=shown, cam_from_target=poses, residual_px=np.full((len(shown.view), 2), np.nan),
        is_outlier=np.zeros(len(shown.view), dtype=bool), pose_covariance=np.full((len(poses), 6, 6), np.nan),
    )  # fmt: skip
    found = [(False, one) for one in errors_of(judged, None)]
    if truth is not None:
        laid = replace(shown, points=known_points(laid_over(truth, target, np.unique(shown.point))))
        errors = errors_of(replace(judged, observations=laid), None)
        found += [(True, one) for one in errors if one.metric != "reprojection"]
    return {(one.metric, one.unit, is_true): _sums(one, shown.view_names) for is_true, one in found}


def _sums(errors: Errors, names: Sequence[str]) -> dict[str, _ErrorSum]:
    """Squares and counts by photo; of errors that are of no single photo all together."""
    if errors.view is None:
        names = ("",)
    group = np.zeros(len(errors.reason), dtype=np.int64) if errors.view is None else errors.view
    counted = errors.is_counted
    square = np.bincount(group[counted], errors.size[counted] ** 2, len(names)).tolist()
    count = np.bincount(group[counted], minlength=len(names)).tolist()
    return {name: both for name, *both in zip(names, square, count, strict=True) if both[1]}


def laid_over(truth: TargetGeometry, target: TargetGeometry, rings: Rows) -> TargetGeometry:
    """The true geometry, laid over another by the similarity that brings these rings nearest."""
    scale, rotation, shift = best_motion(truth.center_mm[rings], target.center_mm[rings], with_scale=True)
    change, sized = make_pose(rotation, shift), scaled(truth, scale)
    return replace(
        sized, center_mm=transform(change, sized.center_mm), target_from_face=change @ sized.target_from_face
    )


def _gains(pairs: Mapping[_Key, Sequence[_Pair]], *, is_true: bool) -> Iterator[Gain]:
    """Root mean squares over all parts, by metric."""
    for wanted in METRICS:
        for (metric, unit, is_of_truth), both in pairs.items():
            if metric == wanted and is_of_truth == is_true and both:
                rows = np.array(both, dtype=np.float64)
                total = rows.sum(axis=0)
                nominal, measured = math.sqrt(total[0] / total[1]), math.sqrt(total[2] / total[3])
                yield Gain(metric, unit, int(total[3]), nominal, measured, _least_factor(rows))


def _least_factor(rows: Array) -> float | None:
    """What the factor is at least: its logarithm less the quantile of its jackknife deviation (Tukey 1958).

    Args:
        rows: of each photo the squares and the count of its errors with the nominal, then with the measured target.
    """
    from scipy.stats import t as student

    count = len(rows)
    with np.errstate(divide="ignore", invalid="ignore"):
        total, without = rows.sum(axis=0), rows.sum(axis=0) - rows
        logs = 0.5 * np.log(without[:, 0] / without[:, 1] / (without[:, 2] / without[:, 3]))
        whole = 0.5 * math.log(total[0] / total[1] / (total[2] / total[3])) if total[[0, 2]].all() else math.inf
    if count < 2 or not np.isfinite(logs).all() or not math.isfinite(whole):
        return None
    sigma = math.sqrt((count - 1) / count * float(((logs - logs.mean()) ** 2).sum()))
    return math.exp(whole - float(student.ppf(SURE, count - 1)) * sigma)
