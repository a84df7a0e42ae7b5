"""What a measured target gains on photos that it was not measured from."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from calib.as_built.datum import best_motion
from calib.as_built.lengths import scaled
from calib.as_built.options import AsBuiltOptions
from calib.as_built.result import AsBuilt
from calib.as_built.solve import measure
from calib.inputs.observations import known_points
from calib.metrics.errors import Errors
from calib.metrics.evaluation import evaluate
from calib.se3 import make_pose, transform
from calib.sightings import keep_sightings, keep_views, sightings_per_view
from calib.solver.pose import solve_poses
from calib.solver.solve import solve
from calib.types import Calibration, Camera, KnownPoints, Observations
from designer.errors import InputError
from designer.target import TargetGeometry

Array = NDArray[np.float64]
Flags = NDArray[np.bool_]

LEAST_FOLDS = 2
LEAST_POINTS = 4
"""Of a view that it needs for a pose."""


@dataclass(frozen=True)
class Gain:
    """Root mean square errors of one metric, with the nominal and with the measured target."""

    metric: str
    unit: str
    count: int
    nominal: float
    measured: float

    @property
    def factor(self) -> float:
        """How many times smaller the error is with the measured target."""
        return self.nominal / self.measured if self.measured > 0 else float("inf")


@dataclass(frozen=True)
class HeldOut:
    """Errors of views that neither camera nor target were solved from."""

    folds: int
    gains: tuple[Gain, ...]  # each target judged by its own rings
    against_truth: tuple[Gain, ...]  # both judged by the true rings, laid over them by a similarity; may be empty
    remarks: tuple[str, ...]


@dataclass(frozen=True)
class _Sum:
    square: float
    count: int


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

    Of a held-out view only its own pose is solved. Sightings that the measurement left out stay out. The size of the
    target takes no part: as lengths are not in photos, there is nothing to hold out.

    Args:
        found: of all views.
        model: of the cameras.
        options: as it was measured.
        folds: how many parts.
        truth: the geometry that rendered photos show.
        done: told how many parts are finished.

    Raises:
        InputError: no part can be judged.
    """
    options = replace(options, solve=replace(options.solve, reject_sigma=None))
    seen = [_usable(one, out) for one, out in zip(found.observations, found.is_outlier, strict=True)]
    sums: dict[tuple[str, str, str, bool], list[_Sum]] = {}
    remarks: list[str] = []
    for fold in range(folds):
        held = [np.arange(one.view_count) % folds == fold for one in seen]
        others = [keep_views(one, ~out) for one, out in zip(seen, held, strict=True)]
        try:
            measured = measure(others, found.nominal, model, options)
            nominal = [solve(one, model, options.solve).camera for one in others]
        except InputError as error:
            remarks.append(f"part {fold + 1} of {folds}: {error}")
            continue
        shown = [keep_views(one, out) for one, out in zip(seen, held, strict=True)]
        for name, target, cameras in (
            ("nominal", found.nominal, nominal),
            ("measured", measured.target, measured.cameras),
        ):
            for one, camera in zip(shown, cameras, strict=True):
                for is_true, errors in _errors(camera, one, target, truth, weighted=options.solve.weighted):
                    key = (errors.metric, errors.unit, name, is_true)
                    sums.setdefault(key, []).append(_sum(errors))
        done(fold + 1)
    if not sums:
        raise InputError(f"no part of the photos can be held out ({remarks[0]}); take more, or give --held-out 0")
    return HeldOut(folds, _gains(sums, is_true=False), _gains(sums, is_true=True), tuple(remarks))


def _usable(seen: Observations, is_outlier: Flags) -> Observations:
    """The observations that were used, of views that still have enough of them."""
    used = keep_sightings(seen, ~is_outlier)
    return keep_views(used, sightings_per_view(used) >= LEAST_POINTS)


def _errors(
    camera: Camera, shown: Observations, target: TargetGeometry, truth: TargetGeometry | None, *, weighted: bool
) -> list[tuple[bool, Errors]]:
    """The errors of views against the target that their poses are solved with, and against the truth."""
    if not shown.view_count:
        return []
    shown = replace(shown, points=known_points(target))
    poses = solve_poses(camera, shown, weighted=weighted).cam_from_target
    has_pose = np.isfinite(poses.sum(axis=(1, 2)))
    if not has_pose.any():
        return []
    shown, poses = keep_views(shown, has_pose), poses[has_pose]
    found = [(False, one) for one in evaluate(_judged(camera, shown, poses, known_points(target), weighted)).errors]
    if truth is not None:
        laid = known_points(laid_over(truth, target, np.unique(shown.point)))
        errors = evaluate(_judged(camera, shown, poses, laid, weighted)).errors
        found += [(True, one) for one in errors if one.metric != "reprojection"]
    return found


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


def _sum(errors: Errors) -> _Sum:
    size = errors.size[errors.is_counted]
    return _Sum(float((size**2).sum()), len(size))


def _gains(sums: dict[tuple[str, str, str, bool], list[_Sum]], *, is_true: bool) -> tuple[Gain, ...]:
    """Root mean squares over all parts, by metric."""
    metrics = dict.fromkeys((metric, unit) for metric, unit, _, true in sums if true == is_true)
    found = []
    for metric, unit in metrics:
        both = [_rms(sums.get((metric, unit, name, is_true), [])) for name in ("nominal", "measured")]
        count = sum(one.count for one in sums.get((metric, unit, "measured", is_true), []))
        if count and all(np.isfinite(both)):
            found.append(Gain(metric, unit, count, *both))
    return tuple(found)


def _rms(parts: Sequence[_Sum]) -> float:
    count = sum(part.count for part in parts)
    return float(np.sqrt(sum(part.square for part in parts) / count)) if count else float("nan")
