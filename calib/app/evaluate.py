"""How large a camera's errors are: `calib evaluate`, `calib.evaluate("camera", held_out=5)`."""

from collections.abc import Iterable
from dataclasses import dataclass
from os import PathLike
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, cast

from calib.app import options
from calib.app.calibration import LEAST_VIEWS_HELD_OUT, Run
from designer.base.errors import InputError
from designer.base.files import check_folder, place_of, write_files
from designer.base.options import argument, option
from designer.base.own_files import require_ours
from designer.base.words import NAME, figure, printable
from designer.page.capability import capability
from designer.page.result import Result
from designer.page.terminal import quoted

if TYPE_CHECKING:
    from calib.app.inputs import Observed, Place
    from calib.core.types import Detections, Observations
    from calib.renderer.truth import Truth
    from calib.solver.calibration import Calibration
    from calib.solver.metrics.evaluation import Evaluation
    from calib.solver.problem import SolveOptions
    from designer.base.answer import Value
    from designer.page.blocks import Headline, Page
    from designer.target import TargetGeometry

REFERENCE = "reference"
"""The setting that names the photo a map is learned from."""


@dataclass(frozen=True, eq=False)
class CameraErrors(
    Result, kind="metrics", title="Errors of a camera", doing="evaluating",
    files={"metrics_*.csv": "errors by photo, point, face and observation"},
):  # fmt: skip
    """The errors of a camera by all metrics that apply: `found.of("reprojection")`, `found.save("camera")`."""

    solved_from: "Evaluation"  # on the photos that the camera was solved from
    held_out: "Evaluation | None"  # on each photo with a camera solved from others; None: that was not asked for
    on: "Evaluation | None" = None  # on sightings that the camera was not solved from; likewise
    calibration_file: Path | None = None  # None: of a run in memory
    has_figures: bool = True
    remarks: tuple[str, ...] = ()  # on which calibration of a folder was taken

    @property
    def asked(self) -> "Evaluation":
        """The errors that were asked for: on other photos, on photos held out, or else on those it was solved from."""
        return self.on or self.held_out or self.solved_from

    @property
    def calibration(self) -> "Calibration":
        """What was evaluated."""
        return self.solved_from.calibration

    @property
    def is_negative(self) -> bool:
        """The photos do not determine the camera."""
        return self.calibration.status == "degenerate"

    def page(self) -> "Page":
        """The errors, what was left out of them, and tables."""
        from calib.draw.run_photos import photo_rows, views_table
        from calib.draw.run_tables import errors_table, faces_table, parameters_table
        from calib.solver.metrics.evaluation_files import metrics_of
        from designer.page.blocks import Command, Facts, Finding, Findings, Page, Section

        asked, calibration = self.asked, self.asked.calibration
        seen, metrics = calibration.observations, metrics_of(asked)
        width, height = seen.image_size
        is_flat = len(seen.points.plane) == 1
        model = f"model {calibration.camera.model}, {width} x {height} px, {calibration.status}"
        facts = Facts((
            ("camera", model if self.calibration_file is None else f"{self.calibration_file}: {model}"),
            ("photos", f"{seen.view_count} photos, {len(seen.view)} observations"),
        ))  # fmt: skip
        left_out = (f"{errors.metric}: {count} left out: {reason}" for errors in asked.errors
                    for reason, count in errors.left_out)  # fmt: skip
        remarks = dict.fromkeys((*self.remarks, *calibration.remarks, *asked.remarks, *left_out, _sample(asked)))
        notes = tuple(Finding("note", "", printable(remark)) for remark in remarks)
        tables = (
            errors_table(metrics), parameters_table(metrics), views_table(photo_rows(asked, None), is_flat=is_flat),
            *(() if is_flat else (faces_table(asked, None),)),
        )  # fmt: skip
        return Page(
            "", "", _errors_headline(asked), (Section("Errors", (Findings(notes), *tables)),), lead=(facts,),
            next_steps=tuple(Command(line, purpose) for line, purpose in self._next()),
        )  # fmt: skip

    def _next(self) -> tuple[tuple[str, str], ...]:
        """To photos that the camera was not solved from, and from there to other programs."""
        if self.is_negative or self.calibration_file is None:
            return ()
        asked = self.asked
        if not (asked.folds or asked.on) and asked.calibration.observations.view_count >= LEAST_VIEWS_HELD_OUT:
            line = f"calib evaluate {quoted(self.calibration_file)} --held-out 5"
            return ((line, "on photos that it was not solved from"),)
        camera = quoted(self.calibration_file.parent / "camera.json")
        return ((f"calib convert {camera} --to colmap -o cameras.txt", "or opencv, ros, kalibr, ..."),)

    def answer(self) -> "dict[str, Value]":
        """The calibration and its errors."""
        from calib.app.calibration_folder import evaluation_answer

        return {"calibration_file": str(self.calibration_file or ""), **evaluation_answer(self.asked)}

    @classmethod
    def check(cls, folder: Path) -> None:
        """Refuse a folder that takes no files or holds somebody else's.

        Raises:
            InputError: the message names it.
        """
        check_folder(folder)
        require_ours(folder / "metrics.json", kind=f"{NAME}.metrics")

    def save(self, folder: str | PathLike[str], *, command: str = "", has_page: bool = True) -> tuple[Path, ...]:
        """Write `metrics.json`, its tables and the picture of the camera; return the files.

        Raises:
            InputError: the folder takes no files, or holds somebody else's.
        """
        from calib.solver.metrics.evaluation_files import evaluation_files

        place = place_of(folder, "a folder, such as '.'")
        self.check(place)
        files = evaluation_files(self.asked, place)
        if self.has_figures:
            from calib.draw import calibration_figures

            files |= calibration_figures(self.solved_from, place)
        write_files(files)
        return tuple(files)

    def draw_page(self, folder: Path, command: str = "") -> "tuple[Page | None, tuple[Path, ...], str]":
        """Draw the page of the run again, whose tables they are; it keeps what it says of its origin."""
        from calib.app.report import report
        from designer.page.page_file import BLOCKS_FILE, PAGE, PAGE_FILE

        for place in (folder, folder.parent):
            if (place / BLOCKS_FILE).is_file() and PAGE.read(place / BLOCKS_FILE).kind == Run.kind:
                try:
                    report(place)
                except InputError as error:
                    return None, (), f"no page: {error}"
                return None, (place / BLOCKS_FILE, place / PAGE_FILE), ""
        return None, (), ""


def _errors_headline(evaluation: "Evaluation") -> "Headline":
    """The root mean square of each error, and of which photos."""
    from calib.solver.metrics.evaluation_files import metrics_of
    from designer.page.blocks import Headline

    if evaluation.calibration.status == "degenerate":
        return Headline("bad", "do not use", "The photos do not determine the camera.")
    found = metrics_of(evaluation).metrics.items()
    rms = (f"{name} {figure(one.errors.rmse)} {one.unit}" for name, one in found if one.errors.count)
    photos = "held out" if evaluation.folds else "that the camera was solved from"
    if evaluation.on:
        photos = "that the camera was not solved from"
    return Headline("note", "evaluated", f"Root mean square errors of photos {photos}: {', '.join(rms)}.")


def _sample(evaluation: "Evaluation") -> str:
    """What the errors are worth."""
    if evaluation.on:
        return f"poses were found from {evaluation.on} itself, the camera from other photos"
    if not evaluation.folds:
        return "errors of the photos that the camera was solved from; those of other photos are larger as a rule"
    return "a photo's own pose is found from itself, the camera from others; reconstruction uses the photos of one part"


def _calibration_in(place: Path) -> tuple[Path, tuple[str, ...]]:
    """The calibration's file, of itself or of its folder, and what is said of the choice."""
    if not place.is_dir():
        return place, ()
    from calib.cameras.formats.reading import solved_in
    from calib.observe.calibration_file import CALIBRATION_FILE

    return solved_in(place, CALIBRATION_FILE)


@capability(folder=lambda given: _calibration_in(cast(Path, given["calibration"]))[0].parent)
def evaluate(
    calibration: Annotated["Run | Place", argument("a calibration.json, or the folder it lies in")],
    *,
    truth: Annotated["Truth | Place | None", option("truth.json of rendered photos: adds the errors of poses")] = None,
    held_out: Annotated[
        int, option("hold every N-th photo out in turn and evaluate those; 0: do not", 0, metavar="N")
    ] = 0,
    on: Annotated[
        "Observations | Place | Iterable[Detections] | None",
        option("sightings that it was not solved from, in a file that calib solve takes: poses only"),
    ] = None,
    target: Annotated["TargetGeometry | Place | None", option("the target file of --on detections.csv")] = None,
    image_size: options.ImageSize = None,
    grid: options.Grid = None,
    pitch_mm: options.Pitch = None,
    figures: Annotated[bool, option("draw residuals, coverage and uncertainty")] = True,
) -> CameraErrors:
    """Measure a calibration: reprojection, intersection, reconstruction and pose error: `evaluate("camera")`.

    The exit code is 1 if the photos do not determine the camera.

    >>> evaluate("camera", on="test.csv").on  # poses only: the camera stays as it was solved from other photos

    Args:
        calibration: a run, whose best camera is meant, a `calibration.json`, or the folder it lies in.

    Raises:
        InputError: a file that cannot be read, a truth of other photos, photos too few to hold some out, or sightings
            of another camera.
    """
    from calib.app.inputs import file_or_observations, truth_from
    from calib.observe.calibration_file import read_calibration
    from calib.solver.metrics.evaluation import evaluate as evaluate_all
    from calib.solver.metrics.evaluation import evaluate_on

    told = {"--target": target, "--image-size": image_size, "--grid": grid, "--pitch": pitch_mm}
    _check(held_out, on, truth, [name for name, value in told.items() if value is not None])
    known, file = truth_from(truth), None
    said: tuple[str, ...] = ()
    if isinstance(calibration, Run):
        solved, origin = calibration.best.calibration, calibration.best.provenance
        known = known or (None if calibration.task is None else calibration.task.truth)
    else:
        file, said = _calibration_in(place_of(calibration, "a run, a calibration.json, or its folder"))
        solved, origin = read_calibration(file)
    every, has_reference = evaluate_all(solved, known), bool(dict(origin.settings).get(REFERENCE))
    held = _held_out(solved, origin.options, held_out, known, has_reference=has_reference) if held_out else None
    if on is None:
        return CameraErrors(every, held, None, file, figures, said)
    name = Path(on).name if isinstance(on, str | PathLike) else "other photos"
    others = evaluate_on(solved, file_or_observations(on, target, image_size, grid, pitch_mm), name)
    return CameraErrors(every, held, others, file, figures, said)


def _check(held_out: int, on: "Observed | None", truth: "Truth | Place | None", of_on: list[str]) -> None:
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


def _held_out(
    calibration: "Calibration", options: "SolveOptions", folds: int, truth: "Truth | None", *, has_reference: bool
) -> "Evaluation":
    from calib.solver.calibrate import calibrate
    from calib.solver.metrics.evaluation import LEAST_FOLDS, evaluate_held_out

    views = calibration.observations.view_count
    if not LEAST_FOLDS <= folds <= views:
        raise InputError(
            f"--held-out {folds}: {views} photos fall into {LEAST_FOLDS} to {views} parts; give one of these"
        )
    if has_reference:
        raise InputError(
            "--held-out: the map was learned from a photo of your choice, which the parts would need too; "
            "leave --held-out away, or solve without a reference"
        )

    model = calibration.camera.model
    return evaluate_held_out(calibration, lambda seen: calibrate(seen, model, options), folds, truth)
