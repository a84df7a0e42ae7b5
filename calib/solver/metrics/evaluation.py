"""All metrics of a calibration, summarised over everything, by view, by point and by face; of views held out, too."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np

from calib.cameras import rays
from calib.core.types import LEAST_POINTS, Observations, keep_sightings, keep_views
from calib.solver.accuracy import NO_FIT
from calib.solver.calibration import Calibration
from calib.solver.circles import with_circles
from calib.solver.metrics import METRICS, OF_TRUTH
from calib.solver.metrics.errors import Errors, ErrorSummary, is_known, predict, summarise, summarise_groups
from calib.solver.varying import has_session, posed_photos
from designer.base.arrays import Flags, Rows
from designer.base.errors import InputError

if TYPE_CHECKING:
    from calib.renderer.truth import Truth

LEAST_FOLDS = 2
USUAL_FOLDS = 5
Solve = Callable[[Observations], Calibration]
NO_POSE = "no pose shows its points where they were seen"
NO_SESSION = "the camera was solved from no photo of its session"


@dataclass(frozen=True, eq=False)
class Evaluation:
    """The errors of a calibration by all metrics that apply."""

    calibration: Calibration
    errors: tuple[Errors, ...]
    truth: "Truth | None" = None
    folds: int = 0
    """In how many parts the views were held out of the solution in turn; 0: they are those it was solved from."""
    remarks: tuple[str, ...] = ()  # what to know of the errors, one line each
    on: str = ""  # what the sightings are called if they are others than those it was solved from

    def of(self, metric: str) -> Errors | None:
        """The errors of one metric; None if it does not apply."""
        return next((errors for errors in self.errors if errors.metric == metric), None)

    @property
    def preference(self) -> tuple[bool, bool, float]:
        """The order in which cameras of the same photos are recommended, the best first.

        It is determined, of a model that other programs know, and then with the least left over: what a learned map
        leaves over is small because it bends to the very photos it is judged by.
        """
        calibration, errors = self.calibration, self.of("reprojection")
        left_px = np.inf if errors is None else summarise(errors).rmse
        return calibration.status != "converged", calibration.camera.learned is not None, left_px

    @property
    def without_truth(self) -> "Evaluation":
        """The same without what only a truth tells."""
        return Evaluation(
            self.calibration, tuple(one for one in self.errors if one.metric not in OF_TRUTH), folds=self.folds
        )


def evaluate(calibration: Calibration, truth: "Truth | None" = None) -> Evaluation:
    """Apply all metrics to the views that a calibration was solved from; some need the truth of rendered photos.

    Raises:
        InputError: the truth knows none of the views.
    """
    remarks = () if truth is None else truth_remarks(calibration, truth)
    return Evaluation(calibration, errors_of(calibration, truth), truth, remarks=remarks)


def errors_of(calibration: Calibration, truth: "Truth | None") -> tuple[Errors, ...]:
    """The errors of all metrics that apply."""
    poses = None if truth is None else truth.poses_of(calibration.observations.view_names)
    prediction = predict(calibration, poses)
    return tuple(found for metric in METRICS.values() if (found := metric.errors_of(prediction)) is not None)


def truth_remarks(calibration: Calibration, truth: "Truth") -> tuple[str, ...]:
    """What to know of a truth that does not quite fit."""
    names = calibration.observations.view_names
    known = len(set(names) & set(truth.files))
    if not known:
        raise InputError(
            f"the truth is of {truth.files[0]!r} and {len(truth.files) - 1} more, none of which was calibrated with "
            f"(such as {names[0]!r}); give the truth.json beside the photos"
        )
    remarks = []
    if known < len(names):
        remarks.append(f"the truth knows {known} of {len(names)} views")
    if truth.camera.image_size != calibration.camera.image_size:
        width, height = truth.camera.image_size
        remarks.append(f"the truth is of photos of {width} x {height} px, the calibration is not")
    if calibration.observations.points.geometry_id not in ("", truth.geometry_id):
        remarks.append(
            "the photos were rendered of another geometry than the calibration was solved with: "
            "pose errors contain the difference"
        )
    return tuple(remarks)


def by_view(evaluation: Evaluation, errors: Errors) -> tuple[ErrorSummary, ...] | None:
    """A summary of each view; None if an error is of no single view."""
    if errors.view is None:
        return None
    return summarise_groups(errors, errors.view, evaluation.calibration.observations.view_count)


def by_point(evaluation: Evaluation, errors: Errors) -> tuple[ErrorSummary, ...] | None:
    """A summary of each point of the target; None if an error is of no single point."""
    if errors.point is None:
        return None
    return summarise_groups(errors, errors.point, len(evaluation.calibration.observations.points.face))


def by_face(evaluation: Evaluation, errors: Errors) -> tuple[ErrorSummary, ...] | None:
    """A summary of each plane of the target; None if an error is of no single point."""
    if errors.point is None:
        return None
    points = evaluation.calibration.observations.points
    return summarise_groups(errors, points.face[errors.point], len(points.plane))


def joined(calibration: Calibration, parts: Sequence[Errors], views: Sequence[Rows]) -> Errors:
    """The errors of one metric in several sets of a calibration's views, as one.

    `views` are the numbers in the whole of each set's views, ascending.
    """
    first = parts[0]
    rows = [np.flatnonzero(np.isin(calibration.observations.view, some)) for some in views]
    return Errors(
        first.metric, first.subject, first.unit, first.axes,
        np.concatenate([part.vector for part in parts]),
        np.concatenate([part.reason for part in parts]),
        first.reasons,
        view=_in_whole([part.view for part in parts], views),
        point=_in_whole([part.point for part in parts], None),
        sighting=_in_whole([part.sighting for part in parts], rows),
    )  # fmt: skip


def _in_whole(numbers: Sequence[Rows | None], place: Sequence[Rows] | None) -> Rows | None:
    """Numbers within each part as numbers within the whole, given their places there; None if there are none."""
    given = [one for one in numbers if one is not None]
    if len(given) < len(numbers):
        return None
    return np.concatenate(given if place is None else [there[one] for one, there in zip(given, place, strict=True)])


def evaluate_held_out(calibration: Calibration, solve: Solve, folds: int, truth: "Truth | None" = None) -> Evaluation:
    """Leave every `folds`-th view out in turn, solve a camera from the others, and apply all metrics to those left out.

    A view's own pose has to be found from its own points, with the camera as it is; only the camera is held out.
    Observations that the calibration left out as outliers stay out of all this.

    Args:
        calibration: of all views.
        solve: solves a camera again as it was solved.
        folds: how many parts the views fall into.
        truth: of the photos, if they were rendered.

    Raises:
        InputError: fewer views than parts, or the others do not determine a camera.
    """
    views = calibration.observations.view_count
    if not LEAST_FOLDS <= folds <= views:
        raise InputError(f"{folds} parts of {views} views; give {LEAST_FOLDS} to {views}")
    remarks = [] if truth is None else list(truth_remarks(calibration, truth))
    kept, parts = [], []
    for fold in range(folds):
        held = np.arange(views) % folds == fold
        one, found, said = _fold(calibration, held, solve)
        remarks.extend(f"part {fold + 1} of {folds}: {line}" for line in said)
        if found.any():
            kept.append(np.flatnonzero(found))
            parts.append(errors_of(one, truth))
    if not parts:
        raise InputError(f"no view that was held out can be evaluated: {remarks[-1]}")
    errors = tuple(joined(calibration, same, kept) for same in zip(*parts, strict=True))
    return Evaluation(calibration, errors, truth, folds, tuple(remarks))


def evaluate_on(calibration: Calibration, observations: Observations, name: str) -> Evaluation:
    """Find the poses of sightings that a camera was not solved from, and apply all metrics; the camera stays as it is.

    Raises:
        InputError: images of another size, or no view has a pose that shows its points.
    """
    if observations.image_size != calibration.camera.image_size:
        sizes = [f"{width} x {height}" for width, height in (observations.image_size, calibration.camera.image_size)]
        raise InputError(
            f"{name}: photos of {sizes[0]} px, but the camera's have {sizes[1]}; give photos of the camera"
        )
    is_outlier = np.zeros(len(observations.view), dtype=bool)
    one = with_circles(observations, lambda seen: _posed(calibration, seen, is_outlier)[0])
    has_pose = np.isin(observations.view_names, one.observations.view_names)
    is_familiar = has_session(calibration, observations.view_names)
    if not is_familiar.any():
        raise InputError(
            f"{name}: no photo is, by its name, of a session that the camera was solved from; solve with them, too"
        )
    if not has_pose.any():
        raise InputError(f"{name}: no photo has a pose that shows its points; check that they are of this camera")
    remarks = [
        f"{observations.view_names[view]}: not evaluated: {NO_POSE if is_familiar[view] else NO_SESSION}"
        for view in np.flatnonzero(~has_pose).tolist()
    ]
    if calibration.sessions:
        remarks.append("of which session a photo is, is told by its name: that of a photo the camera was solved from")
    found = Evaluation(one, errors_of(one, None), on=name)
    remarks = [*observations.remarks, *remarks, *_far_off(found), *_again(calibration, one)]
    return replace(found, remarks=tuple(remarks))


def _far_off(found: Evaluation) -> list[str]:
    """A word on views whose points and pixels do not belong together."""
    seen, errors = found.calibration.observations, found.of("reprojection")
    told = None if errors is None else by_view(found, errors)
    return [
        f"{name}: its points are off by {one.median:.3g} px (median): they and the pixels do not belong together; "
        "check their names"
        for name, one in zip(seen.view_names, told or (), strict=False)
        if one.median > NO_FIT * max(seen.image_size)
    ]


def _again(calibration: Calibration, other: Calibration) -> tuple[str, ...]:
    """A word on sightings that the camera was solved from after all: to the six digits that files write."""
    known, these = (
        {
            (seen.view_names[view], *(round(x, 6) for x in pixel))
            for view, pixel in zip(seen.view.tolist(), seen.center_px.tolist(), strict=True)
        }
        for seen in (calibration.observations, other.observations)
    )
    again = len(known & these)
    return (f"the camera was solved from {again} of these {len(these)} observations",) if again else ()


def _posed(calibration: Calibration, observations: Observations, is_outlier: Flags) -> tuple[Calibration, Flags]:
    """The calibration's camera with the poses of other views, and which of these have one (V,).

    Outliers (M,) take no part in the poses, nor what the camera has no ray for, as outside of a learned map: it says
    nothing of the pose.
    """
    if calibration.target_bend is not None:
        observations = calibration.target_bend.bent(observations)
    rows = ~is_outlier & is_known(rays(calibration.camera, observations.center_px))
    is_told = np.bincount(observations.view[rows], minlength=observations.view_count) >= LEAST_POINTS
    is_told &= has_session(calibration, observations.view_names)
    poses, linear = np.full((observations.view_count, 4, 4), np.nan), None
    if is_told.any():
        shown = keep_views(keep_sightings(observations, rows), is_told)
        found, own = posed_photos(calibration, shown)
        poses[is_told] = found.cam_from_target
        if own is not None:
            linear = np.full((observations.view_count, 4), np.nan)
            linear[is_told] = own
    has_pose: Flags = np.isfinite(poses.sum(axis=(1, 2)))
    kept = has_pose[observations.view]
    one = replace(
        calibration,
        observations=keep_views(observations, has_pose),
        cam_from_target=poses[has_pose],
        linear=None if linear is None else linear[has_pose],
        residual_px=np.full((int(kept.sum()), 2), np.nan),
        is_outlier=is_outlier[kept],
        pose_covariance=np.full((int(has_pose.sum()), 6, 6), np.nan),
        remarks=() if calibration.status == "converged" else calibration.remarks,
    )
    return one, has_pose


def held_out_px(calibration: Calibration, solve: Solve) -> float:
    """Root mean square distance in views held out, as `evaluate_held_out` does it: the one figure, without metrics.

    Infinite where a view that was held out has no pose. Without views of sessions that the others have none of.

    Raises:
        InputError: fewer views than parts, the others do not determine a camera, or have no session of any.
    """
    used, views = keep_sightings(calibration.given, ~calibration.is_outlier), calibration.observations.view_count
    if views < LEAST_FOLDS:
        raise InputError(f"{views} views: give {LEAST_FOLDS} or more to hold some out")
    square = []
    for fold in range(folds := min(USUAL_FOLDS, views)):
        held = np.arange(views) % folds == fold
        others = solve(keep_views(used, ~held))
        shown = keep_views(used, held & has_session(others, used.view_names))
        if not shown.view_count:
            continue
        shown = shown if others.target_bend is None else others.target_bend.bent(shown)
        residual = posed_photos(others, shown)[0].residual_px
        square.append((residual**2).sum(axis=1))
    if not square:
        raise InputError(f"no view can be held out: {NO_SESSION}")
    left_px = float(np.sqrt(np.concatenate(square).mean()))
    return left_px if np.isfinite(left_px) else np.inf


def _fold(calibration: Calibration, held: Flags, solve: Solve) -> tuple[Calibration, Flags, list[str]]:
    """The camera of the other views with the poses of those held out, which of all views have one, and remarks."""
    seen = calibration.given  # of a bend counts what the others tell
    others = solve(keep_views(keep_sightings(seen, ~calibration.is_outlier), ~held))
    one, has_pose = _posed(others, keep_views(seen, held), calibration.is_outlier[held[seen.view]])
    found = held.copy()
    found[held] = has_pose
    remarks = list(others.remarks) if others.status != "converged" else []
    is_strange = held & ~has_session(others, seen.view_names)
    remarks += [f"{seen.view_names[view]}: not evaluated: {NO_SESSION}" for view in np.flatnonzero(is_strange).tolist()]
    if lost := int((held & ~found & ~is_strange).sum()):
        remarks.append(f"{lost} views have no pose that shows their points")
    return one, found, remarks
