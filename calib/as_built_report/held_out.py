"""What a measured target gains on photos that it was not measured from."""

import math
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from calib.as_built.datum import best_motion
from calib.as_built.lengths import scaled
from calib.as_built.options import AsBuiltOptions
from calib.as_built.remarks import faces_words
from calib.as_built.result import AsBuilt
from calib.as_built.solve import measure, with_known_weights
from calib.cameras.camera import Camera
from calib.core.se3 import make_pose, transform
from calib.core.selection import keep_sightings, keep_views, sightings_per_view
from calib.core.types import KnownPoints, Observations
from calib.metrics import METRICS
from calib.metrics.errors import Errors
from calib.metrics.evaluation import evaluate
from calib.observe.observations import known_points
from calib.solver.calibration import Calibration
from calib.solver.poses import solve_poses
from calib.solver.solve import solve
from designer.base.errors import InputError
from designer.base.marks import Count, Number, Word
from designer.target import TargetGeometry

Array = NDArray[np.float64]
Flags = NDArray[np.bool_]

LEAST_FOLDS = 2
JUDGED_BY = ("intersection", "reprojection")
"""The metrics that tell whether a measured target is better, the first that has a bound."""
LEAST_POINTS = 4
"""Of a view that it needs for a pose."""
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
class HeldOut:
    """Errors of views that neither camera nor target were solved from."""

    folds: int
    gains: tuple[Gain, ...]  # each target judged by its own rings
    against_truth: tuple[Gain, ...]  # both judged by the true rings, laid over them by a similarity; may be empty
    remarks: tuple[str, ...]

    @property
    def judged_by(self) -> Gain | None:
        """The gain that says most; None if too few photos were held out."""
        return judged_by(self.gains)


def judged_by(gains: Sequence[Gain]) -> Gain | None:
    """The gain that says most; None if there is none by which a target is judged, or too few photos to tell."""
    can_judge = [gain for gain in gains if gain.is_better is not None]
    return next((gain for metric in JUDGED_BY for gain in can_judge if gain.metric == metric), None)


@dataclass(frozen=True)
class _ErrorSum:
    square: float
    count: int


@dataclass(frozen=True)
class _Key:
    metric: str
    unit: str
    is_true: bool  # against the true rings


@dataclass(frozen=True)
class _Pair:
    """One photo's errors with either target; of errors that are of no single photo, one part's."""

    nominal: _ErrorSum
    measured: _ErrorSum


def gain_on_held_out(
    found: AsBuilt,
    model: str,
    options: AsBuiltOptions,
    folds: int,
    *,
    truth: TargetGeometry | None = None,
    done: Callable[[float], None] = lambda part: None,
) -> HeldOut:
    """Hold every `folds`-th view out in turn, measure from the others, and judge the views held out.

    Of a held-out view only its own pose is solved. Sightings that the measurement left out stay out, and so do those of
    faces that at most one of the other views shows: they are not measured then. The size of the target takes no part:
    as lengths are not in photos, there is nothing to hold out.

    Args:
        found: of all views.
        model: of the cameras.
        options: as it was measured.
        folds: how many parts.
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
    for fold in range(folds):
        held = [np.arange(one.view_count) % folds == fold for one in seen]
        others = [keep_views(one, ~out) for one, out in zip(seen, held, strict=True)]
        try:
            measured = measure(others, found.nominal, model, options)
            nominal = [solve(one, model, options.solve).camera for one in others]
        except InputError as error:
            remarks.append(f"part {fold + 1} of {folds}: {error}")
            continue
        for one, out, *cameras in zip(seen, held, nominal, measured.cameras, strict=True):
            whole = keep_views(one, out)
            is_judged = _is_measured(measured)[found.nominal.ring_face[whole.point]]
            unmeasured[found.nominal.ring_face[whole.point[~is_judged]]] = True
            unjudged += int((~is_judged).sum())
            shown = _usable(whole, ~is_judged)
            both = [
                _errors(camera, shown, target, truth, weighted=options.solve.weighted)
                for camera, target in zip(cameras, (found.nominal, measured.target), strict=True)
            ]
            for key in both[0].keys() & both[1].keys():
                pairs.setdefault(key, []).extend(_pairs(both[0][key], both[1][key]))
        done(fold + 1)
    if unjudged:
        remarks.append(
            f"{unjudged} sightings of {faces_words(unmeasured)} are not judged: photos that are not held out hardly "
            "show these"
        )
    true, own = (tuple(_gains(pairs, is_true=is_true)) for is_true in (True, False))
    return HeldOut(folds, own, true, tuple(remarks))


def _is_measured(found: AsBuilt) -> Flags:
    """The faces that are determined, and of several not by one view alone.  # (F,)"""
    measured: Flags = found.is_determined & ((found.face_views > 1) | (found.nominal.is_planar))
    return measured


def _usable(seen: Observations, is_outlier: Flags) -> Observations:
    """The observations that were used, of views that still have enough of them."""
    used = keep_sightings(seen, ~is_outlier)
    return keep_views(used, sightings_per_view(used) >= LEAST_POINTS)


def _errors(
    camera: Camera, shown: Observations, target: TargetGeometry, truth: TargetGeometry | None, *, weighted: bool
) -> dict[_Key, dict[str, _ErrorSum]]:
    """The errors of views by their names, against the target that their poses are solved with, and the truth."""
    if not shown.view_count:
        return {}
    shown = replace(shown, points=known_points(target))
    poses = solve_poses(camera, shown, weighted=weighted).cam_from_target
    has_pose = np.isfinite(poses.sum(axis=(1, 2)))
    if not has_pose.any():
        return {}
    shown, poses = keep_views(shown, has_pose), poses[has_pose]
    found = [(False, one) for one in evaluate(_judged(camera, shown, poses, known_points(target), weighted)).errors]
    if truth is not None:
        laid = known_points(laid_over(truth, target, np.unique(shown.point)))
        errors = evaluate(_judged(camera, shown, poses, laid, weighted)).errors
        found += [(True, one) for one in errors if one.metric != "reprojection"]
    return {_Key(one.metric, one.unit, is_true): _sums(one, shown.view_names) for is_true, one in found}


def _sums(errors: Errors, names: Sequence[str]) -> dict[str, _ErrorSum]:
    """Squares and counts by photo; of errors that are of no single photo all together."""
    if errors.view is None:
        names = ("",)
    group = np.zeros(len(errors.reason), dtype=np.int64) if errors.view is None else errors.view
    counted = errors.is_counted
    square = np.bincount(group[counted], errors.size[counted] ** 2, len(names)).tolist()
    count = np.bincount(group[counted], minlength=len(names)).tolist()
    return {name: _ErrorSum(*both) for name, *both in zip(names, square, count, strict=True) if both[1]}


def _pairs(nominal: dict[str, _ErrorSum], measured: dict[str, _ErrorSum]) -> Iterator[_Pair]:
    """What was found with both targets, so that both are judged alike."""
    for name, one in nominal.items():
        if name in measured:
            yield _Pair(one, measured[name])


def _judged(camera: Camera, shown: Observations, poses: Array, points: KnownPoints, weighted: bool) -> Calibration:
    """A calibration of views that it was not solved from: nothing is known of its accuracy."""
    count, params = len(shown.view), len(camera.params)
    return Calibration(
        camera=camera, observations=replace(shown, points=points), cam_from_target=poses,
        residual_px=np.full((count, 2), np.nan), is_outlier=np.zeros(count, dtype=bool), scale=float("nan"),
        param_covariance=np.full((params, params), np.nan), pose_covariance=np.full((len(poses), 6, 6), np.nan),
        fixed=(), weighted=weighted, status="converged", remarks=(), iterations=0, seconds=0.0,
    )  # fmt: skip


def laid_over(truth: TargetGeometry, target: TargetGeometry, rings: NDArray[np.int64]) -> TargetGeometry:
    """The true geometry, laid over another by the similarity that brings these rings nearest."""
    scale, rotation, shift = best_motion(truth.center_mm[rings], target.center_mm[rings], with_scale=True)
    change, sized = make_pose(rotation, shift), scaled(truth, scale)
    return replace(
        sized, center_mm=transform(change, sized.center_mm), target_from_face=change @ sized.target_from_face
    )


def _gains(pairs: dict[_Key, list[_Pair]], *, is_true: bool) -> Iterator[Gain]:
    """Root mean squares over all parts, by metric."""
    for metric in METRICS:
        for key, both in pairs.items():
            if key.metric != metric or key.is_true != is_true or not both:
                continue
            rows = np.array(
                [(a.square, a.count, b.square, b.count) for a, b in ((p.nominal, p.measured) for p in both)]
            )
            total = rows.sum(axis=0)
            nominal, measured = math.sqrt(total[0] / total[1]), math.sqrt(total[2] / total[3])
            yield Gain(metric, key.unit, int(total[3]), nominal, measured, _least_factor(rows))


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
    if count < LEAST_FOLDS or not np.isfinite(logs).all() or not math.isfinite(whole):
        return None
    sigma = math.sqrt((count - 1) / count * float(((logs - logs.mean()) ** 2).sum()))
    return math.exp(whole - float(student.ppf(SURE, count - 1)) * sigma)
