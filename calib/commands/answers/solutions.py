"""Answers of commands that calibrate: what came of each model, its errors by every metric, and the verdict."""

from collections.abc import Callable, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, cast

if TYPE_CHECKING:
    from calib.api.run_result import RunResult
    from calib.api.solving import Solution
    from calib.metrics.evaluation import Evaluation
    from calib.verdict.verdict import Verdict
    from designer.base.answer import Value


def run_answer(run: "RunResult", place_of: Callable[[str], Path]) -> "dict[str, Value]":
    """All models, the one to go on with, the verdict, and what was found in photos."""
    from calib.commands.answers.photos import detections_answer

    found = {} if run.search is None else {"detections": detections_answer(run.search)}
    solved = solutions_answer(run.solutions, run.best, place_of)
    return {**found, **solved, "verdict": verdict_answer(run.verdict)}


def verdict_answer(verdict: "Verdict") -> "dict[str, Value]":
    """The verdict and its checks, as `verdict.json` has them."""
    from calib.verdict.verdict import Verdict
    from designer.base.codec import encode

    return cast("dict[str, Value]", encode(Verdict, verdict))


def solutions_answer(
    solutions: "Sequence[Solution]", best: "Solution | None", place_of: Callable[[str], Path]
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
