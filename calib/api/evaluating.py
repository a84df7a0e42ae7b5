"""How large a camera's errors are, on the photos it was solved from or on others."""

from dataclasses import dataclass
from numbers import Integral
from os import PathLike
from pathlib import Path

from calib.api.run_result import RunResult
from calib.app.inputs import Observed, Place, folder_of, load_observations, observations_of, truth_from
from calib.core.types import Observations
from calib.metrics.evaluation import LEAST_FOLDS, Evaluation, evaluate_held_out, evaluate_on
from calib.metrics.evaluation import evaluate as evaluate_all
from calib.observe.corners_vnl import PointGrid
from calib.records.calibration_file import CALIBRATION_FILE, read_calibration
from calib.records.evaluation_files import METRICS, METRICS_FILE, evaluation_files
from calib.renderer.truth import Truth
from calib.solver.calibration import Calibration
from calib.solver.options import SolveOptions
from calib.virtual.calibrate import calibrate
from designer.base.errors import InputError
from designer.base.files import check_folder, write_files
from designer.base.own_files import require_ours
from designer.base.small_file import place_of
from designer.target import TargetGeometry

REFERENCE = "reference"
"""The setting that names the photo a map is learned from."""


@dataclass(frozen=True, eq=False)
class EvaluationResult:
    """The errors of a camera by all metrics that apply: `found.of("reprojection")`, `found.save("camera")`."""

    solved_from: Evaluation  # on the photos that the camera was solved from
    held_out: Evaluation | None  # on each photo with a camera solved from others; None: that was not asked for
    on: Evaluation | None = None  # on sightings that the camera was not solved from; likewise

    @property
    def asked(self) -> Evaluation:
        """The errors that were asked for: on other photos, on photos held out, or else on those it was solved from."""
        return self.on or self.held_out or self.solved_from

    @property
    def calibration(self) -> Calibration:
        """What was evaluated."""
        return self.solved_from.calibration

    def save(self, folder: Place, *, figures: bool = True) -> tuple[Path, ...]:
        """Write `metrics.json`, its tables and the picture of the camera; return the files.

        Raises:
            InputError: the folder takes no files, or holds somebody else's.
        """
        place = folder_of(folder)
        check_metrics_folder(place)
        files = evaluation_files(self.asked, place)
        if figures:
            from calib.draw import calibration_figures

            files |= calibration_figures(self.solved_from, place)
        write_files(files)
        return tuple(files)


def check_metrics_folder(folder: Path) -> None:
    """Refuse a folder that takes no files or holds somebody else's.

    Raises:
        InputError: the message names it.
    """
    check_folder(folder)
    require_ours(folder / METRICS_FILE, kind=METRICS.format)


def evaluate(
    calibration: RunResult | Place,
    *,
    truth: Truth | Place | None = None,
    held_out: int = 0,
    on: Observed | None = None,
    target: TargetGeometry | Place | None = None,
    image_size: tuple[int, int] | None = None,
    grid: PointGrid | None = None,
) -> EvaluationResult:
    """Measure a camera's reprojection, intersection, reconstruction and pose errors: `evaluate("camera", held_out=5)`.

    >>> evaluate("camera", on="test.csv").on  # poses only: the camera stays as it was solved from other photos

    Args:
        calibration: a run, whose best camera is meant, a `calibration.json`, or the folder it lies in.
        truth: of rendered photos, which adds the errors of poses; None: what a run knows.
        held_out: hold every N-th photo out in turn, solve from the others, and evaluate those; 0: do not.
        on: find the poses of these sightings, which the camera was not solved from, and evaluate them; None: do not.
        target: that detections in `on` show.
        image_size: width and height in px of a file `on` that does not say it.
        grid: of a corners.vnl in `on`.

    Raises:
        InputError: a file that cannot be read, a truth of other photos, photos too few to hold some out, or sightings
            of another camera.
    """
    told = {"--target": target, "--image-size": image_size, "--grid": grid}
    _check(held_out, on, truth, [name for name, value in told.items() if value is not None])
    known = truth_from(truth)
    if isinstance(calibration, RunResult):
        best = calibration.best
        solved, options = best.calibration, calibration.task.plan.options_of(best.model)
        has_reference, known = calibration.task.reference is not None, known or calibration.task.truth
    else:
        solved, provenance = read_calibration(
            calibration_in(place_of(calibration, "a run, a calibration.json, or its folder"))
        )
        options, has_reference = provenance.options, bool(dict(provenance.settings).get(REFERENCE))
    every = evaluate_all(solved, known)
    held = _held_out(solved, options, held_out, known, has_reference=has_reference) if held_out else None
    if on is None:
        return EvaluationResult(every, held)
    if isinstance(on, str | PathLike):
        seen, name = load_observations(on, target, image_size=image_size, grid=grid), Path(on).name
    else:
        seen, name = observations_of(on, target), "other photos"
    return EvaluationResult(every, held, evaluate_on(solved, seen, name))


def _check(held_out: int, on: Observed | None, truth: Truth | Place | None, of_on: list[str]) -> None:
    """Refuse what does not go together."""
    if on is None:
        if of_on:
            raise InputError(f"{of_on[0]}: is of the sightings that --on names; give both, or leave it out")
        return
    if held_out:
        raise InputError(
            f"--held-out {held_out}: holds out photos that the camera was solved from, --on names others; choose one"
        )
    if truth is not None:
        raise InputError("--truth: is of the photos that the camera was solved from; leave it out with --on")


def calibration_in(place: Path) -> Path:
    """The calibration's file, of itself or of its folder.

    Raises:
        InputError: the folder holds those of several models, one of which is to be named.
    """
    if not place.is_dir():
        return place
    inside = [] if (place / CALIBRATION_FILE).exists() else sorted(place.glob(f"*/{CALIBRATION_FILE}"))
    if inside:
        models = ", ".join(str(path.parent) for path in inside)
        raise InputError(f"{place}: holds a calibration in a folder of each model; name the folder of one: {models}")
    return place / CALIBRATION_FILE


def _held_out(
    calibration: Calibration, options: SolveOptions, folds: int, truth: Truth | None, *, has_reference: bool
) -> Evaluation:
    views = calibration.observations.view_count
    if not isinstance(folds, Integral) or not LEAST_FOLDS <= folds <= views:
        raise InputError(
            f"--held-out {folds}: {views} photos fall into {LEAST_FOLDS} to {views} parts; give one of these"
        )
    if has_reference:
        raise InputError(
            "--held-out: the map was learned from a photo of your choice, which the parts would need too; "
            "leave --held-out away, or solve without a reference"
        )

    def solve_again(seen: Observations) -> Calibration:
        return calibrate(seen, calibration.camera.model, options)

    return evaluate_held_out(calibration, solve_again, folds, truth)
