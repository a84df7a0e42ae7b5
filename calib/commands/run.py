"""The command `calib run`."""

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from calib.app.options import exports_folder
from calib.commands import options
from calib.commands.running import negative, report_of, solutions_answer, stopped
from calib.commands.solve import focal_of, made_settings, reference_of, reference_settings
from calib.solver.costs import IMAGE
from designer.base.answer import Summary
from designer.base.command import command_line
from designer.page.progress import progress_bars
from designer.page.terminal import quoted

if TYPE_CHECKING:
    from calib.api.run_result import RunResult, RunWriter
    from calib.api.running import NothingFoundError


def run(
    target: options.TargetArgument,
    photos: options.PhotosArgument,
    *,
    out: Annotated[Path | None, typer.Option("--out", "-o", help="folder (default: exports/NAME/calibration)")] = None,
    model: options.ModelOption = "all",
    fix: options.FixOption = None,
    share: options.ShareOption = None,
    focal: options.FocalOption = None,
    loss: options.LossOption = "squares",
    reject: options.RejectOption = None,
    weighted: options.WeightedOption = True,
    minimise: options.MinimiseOption = IMAGE,
    free_bend: options.FreeBendOption = False,
    reference: options.ReferenceOption = None,
    reference_target: options.ReferenceTargetOption = None,
    made: options.MadeOption = None,
    capture: options.CaptureOption = None,
    truth: Annotated[
        Path | None, typer.Option(help="of rendered photos (default: the truth.json beside them, if there is one)")
    ] = None,
    criteria: options.CriteriaOption = options.DEFAULT_CRITERIA,
    page: options.PageOption = True,
    verbose: options.VerboseOption = False,
    jobs: options.PhotoJobsOption = None,
) -> Summary:
    """From photos to a calibrated camera: detect, solve, detect again with the lens known, solve all models, judge.

    The exit code is 1 if nothing was found, or if the verdict is: do not use.
    """
    from calib.api.run_result import RunWriter
    from calib.api.running import NothingFoundError
    from calib.api.running import run as run_all
    from calib.observe.photos import find_photos
    from calib.observe.search import truth_beside
    from calib.solver.accuracy import UndeterminedError
    from calib.solver.plan import models_of

    writer = RunWriter(out if out is not None else exports_folder(target) / "calibration", models_of(model))
    try:
        with progress_bars() as progress:
            found = run_all(
                target, photos, model=model, fix=fix or (), share=share or (), focal_px=focal_of(focal), loss=loss,
                reject_sigma=reject, weighted=weighted, minimise=minimise, free_bend=free_bend,
                reference=reference_of(reference, reference_target), made=made, capture=capture,
                truth=truth, criteria=criteria, jobs=jobs, progress=progress, out=writer,
                settings=(*made_settings(made, capture), *reference_settings(reference, reference_target)),
            )  # fmt: skip
    except KeyboardInterrupt:
        stopped(writer)
    except NothingFoundError as error:
        return _nothing_found(error, target, writer, page=page)
    except UndeterminedError as error:
        negative(writer, error)
    known = truth or truth_beside(find_photos(photos).paths)
    return report_of(
        found, writer, page=page, verbose=verbose, more="and add them to the photos",
        evaluate=_evaluation(found, writer, known if found.task.truth is not None else None),
    )  # fmt: skip


def _evaluation(found: "RunResult", writer: "RunWriter", truth: Path | None) -> str:
    """What to type to evaluate the best camera on photos that it was not solved from; "" if that says little."""
    from calib.commands.run_screen import LEAST_VIEWS_HELD_OUT

    best = found.best
    if best.calibration.observations.view_count < LEAST_VIEWS_HELD_OUT or best.camera.learned is not None:
        return ""
    known = "" if truth is None else f" --truth {quoted(truth)}"
    place = quoted(writer.place_of(best.model))
    return f"calib evaluate {place} --held-out 5{known}   # on photos that it was not solved from"


def _nothing_found(error: "NothingFoundError", target: Path, writer: "RunWriter", *, page: bool) -> Summary:
    """Write the page that shows why, of the run's folder, or of its overlays if an earlier camera has the folder."""
    from calib.api.run_result import OVERLAYS
    from calib.app.detect import DETECTIONS_FILE, DetectedPhotos, detections_answer
    from calib.records.run_folder import is_run_folder
    from designer.page.capability import told
    from designer.page.output import Output

    folder, overlays = writer.folder, writer.folder / OVERLAYS
    output = Output(folder, overlays if is_run_folder(folder) else folder, writer.files)
    none = solutions_answer((), None, writer.place_of)
    output.answer = {"detections": detections_answer(error.search), **none, "verdict": None}
    found = DetectedPhotos(error.search, str(target), folder / DETECTIONS_FILE, overlays, error.search.remarks)
    return told(found, output, command_line(), verbose=False, has_page=page)
