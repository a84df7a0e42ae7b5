"""How the commands that solve cameras end: well, stopped, or without a camera; what they tell programs."""

from collections.abc import Callable, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, NoReturn, cast

from designer.base.answer import NegativeError, StoppedError, Summary
from designer.base.command import NOTHING_WRITTEN, command_line
from designer.page.progress import waiting
from designer.page.terminal import shown

if TYPE_CHECKING:
    from calib.api.run_result import RunResult, RunWriter
    from calib.metrics.evaluation import Evaluation
    from calib.verdict.solutions import Solution
    from calib.verdict.verdict import Verdict
    from designer.base.answer import Value

BAD = 1
"""The camera is not to be used."""


def report_of(run: "RunResult", writer: "RunWriter", *, page: bool, verbose: bool, more: str, evaluate: str) -> Summary:
    """Write the page, and say what came of a run.

    Args:
        run: solved, judged and written but for its page.
        writer: that wrote it.
        page: whether to write it; `calib report` does so later.
        verbose: say all tables.
        more: what to do with more photos, as in "and add them to the photos".
        evaluate: what to type to evaluate the best camera; "" for nothing.
    """
    try:
        with waiting("drawing the page"):
            remark = writer.write_page(run, command_line()) if page else writer.earlier_page()
    except KeyboardInterrupt:
        stopped(writer)
    return said_report(run, writer, remark, verbose=verbose, more=more, evaluate=evaluate)


def said_report(
    run: "RunResult",
    writer: "RunWriter",
    remark: str,
    *,
    verbose: bool,
    more: str,
    evaluate: str,
    again: str = "",
) -> Summary:
    """Say what came of a run whose page is written, or not for a reason that is remarked; the rest as `report_of`."""
    from calib.commands.run_screen import next_steps, say_files, say_next, say_run

    remarks = tuple(filter(None, [remark]))
    say_run(run, writer.told(run), verbose=verbose)
    say_files(writer.folder, writer.files, remarks)
    steps = next_steps(run, writer.folder, writer.files, more=more, evaluate=evaluate, again=again)
    say_next(steps)
    of_search = () if run.search is None else run.search.remarks
    return Summary(
        run_answer(run, writer.place_of), tuple(writer.files), steps.commands,
        (*of_search, *run.observations.remarks, *remarks), BAD if run.verdict.grade == "bad" else 0,
    )  # fmt: skip


def stopped(writer: "RunWriter") -> NoReturn:
    """End after Ctrl-C, with a word on what is finished and stays.

    Raises:
        StoppedError: always.
    """
    tables = [path for path in writer.files if path.suffix == ".csv" and path.parent == writer.folder][:1]
    places = dict.fromkeys((*tables, *(writer.place_of(one.model) for one in writer.finished)))
    said = f"stopped; finished and kept: {', '.join(map(shown, places))}" if places else NOTHING_WRITTEN
    answer = solutions_answer(writer.finished, None, writer.place_of)
    raise StoppedError(said, Summary(answer, tuple(writer.files))) from None


def negative(writer: "RunWriter", error: Exception) -> NoReturn:
    """End where the photos determine no camera.

    Raises:
        NegativeError: always.
    """
    answer = {**solutions_answer(writer.solutions, None, writer.place_of), "verdict": None}
    said = str(error)
    raise NegativeError(f"no camera is determined: {said}", Summary(answer, tuple(writer.files), remarks=(said,)))


def run_answer(run: "RunResult", place_of: Callable[[str], Path]) -> "dict[str, Value]":
    """All models, the one to go on with, the verdict, and what was found in photos."""
    from calib.app.detect import detections_answer

    found = {} if run.search is None else {"detections": detections_answer(run.search)}
    solved = solutions_answer(run.solutions, run.best, place_of)
    return {**found, **solved, "verdict": verdict_answer(run.verdict)}


def verdict_answer(verdict: "Verdict") -> "dict[str, Value]":
    """The verdict and its checks, as `verdict.json` has them."""
    from calib.verdict.verdict import Verdict
    from designer.base.codec import encode

    return cast("dict[str, Value]", encode(Verdict, verdict))


def solutions_answer(
    solutions: Sequence["Solution"], best: "Solution | None", place_of: Callable[[str], Path]
) -> "dict[str, Value]":
    """All models, and the one to go on with.

    Args:
        solutions: what came of each.
        best: None: none.
        place_of: where a model's files are.
    """
    models = [_solution(one, place_of(one.model)) for one in solutions]
    return {"best": None if best is None else best.model, "models": models}


def _solution(solution: "Solution", folder: Path) -> "dict[str, Value]":
    from calib.records.calibration_file import CALIBRATION_FILE, CAMERA_FILE

    if solution.evaluation is None:
        return {"model": solution.model, "status": "failed", "failure": solution.failure}
    return {
        **evaluation_answer(solution.evaluation),
        "failure": None,
        "camera_file": str(folder / CAMERA_FILE),
        "calibration_file": str(folder / CALIBRATION_FILE),
    }


def evaluation_answer(evaluation: "Evaluation") -> "dict[str, Value]":
    """A calibration and its errors, as `metrics.json` has them, and how it was solved."""
    from calib.records.evaluation_files import Metrics, metrics_of
    from designer.base.codec import encode

    calibration, metrics = evaluation.calibration, metrics_of(evaluation)
    reprojection = metrics.metrics.get("reprojection")
    return {
        **cast("dict[str, Value]", encode(Metrics, metrics)),
        "image_size_px": calibration.camera.image_size,
        "rms_px": None if reprojection is None else reprojection.errors.rmse,
        "sigma_px": None if calibration.weighted else calibration.scale,
        "sigma_of_stated": calibration.scale if calibration.weighted else None,
        "iterations": calibration.iterations,
        "seconds": calibration.seconds,
    }
