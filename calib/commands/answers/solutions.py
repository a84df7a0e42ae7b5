"""Answers of commands that calibrate: what came of each model, its errors by every metric, and the verdict."""

from collections.abc import Callable, Sequence
from dataclasses import asdict
from pathlib import Path
from typing import TYPE_CHECKING, cast

if TYPE_CHECKING:
    from calib.api.run_result import RunResult
    from calib.metrics.errors import Errors
    from calib.metrics.evaluation import Evaluation
    from calib.pipeline.solving import Solution
    from calib.solver.calibration import Calibration
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
    """A calibration and its errors."""
    calibration = evaluation.calibration
    seen = calibration.observations
    metrics = {errors.metric: _metric(errors) for errors in evaluation.errors}
    reprojection = metrics.get("reprojection", {})
    return {
        "model": calibration.camera.model,
        "status": calibration.status,
        "image_size_px": calibration.camera.image_size,
        "photos": seen.view_count,
        "sightings": len(seen.view),
        "outliers": int(calibration.is_outlier.sum()),
        "held_out_parts": evaluation.folds,
        "rms_px": reprojection.get("rms_px"),
        "sigma_px": None if calibration.weighted else calibration.scale,
        "sigma_of_stated": calibration.scale if calibration.weighted else None,
        "iterations": calibration.iterations,
        "seconds": calibration.seconds,
        "parameters": _parameters(calibration),
        "metrics": metrics,
        "remarks": [*calibration.remarks, *evaluation.remarks],
    }


def _parameters(calibration: "Calibration") -> "dict[str, Value]":
    """Value and standard deviation; a fixed parameter has none, nor one that the photos do not determine."""
    import numpy as np

    from calib.cameras import MODELS

    sigmas = np.sqrt(np.diagonal(calibration.stated_covariance)).tolist()
    rows = zip(MODELS[calibration.camera.model].parameters, calibration.camera.params.tolist(), sigmas, strict=True)
    return {
        one.name: {
            "value": value,
            "sigma": None if one.name in calibration.fixed else sigma,
            "unit": one.unit,
            "is_fixed": one.name in calibration.fixed,
        }
        for one, value, sigma in rows
    }


def _metric(errors: "Errors") -> "dict[str, Value]":
    """Root mean square, mean, median and more of the errors' lengths."""
    from calib.metrics.errors import summarise

    numbers = asdict(summarise(errors))
    count = numbers.pop("count")
    numbers = {"rms": numbers.pop("rmse"), **numbers}
    named = {f"{name}_{errors.unit}": value for name, value in numbers.items()}
    return {"count": count, **named, "left_out": dict(errors.left_out)}
