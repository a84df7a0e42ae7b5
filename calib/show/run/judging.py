"""Judging the cameras of a run, by limits of one's choice."""

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

from calib.core.files import write_files
from calib.pipeline.solving import prior_of
from calib.records.run_folder import Solved, read_run
from calib.solver.calibration import Calibration
from calib.solver.options import SolveOptions
from calib.verdict.advice import DETECTED, Inputs
from calib.verdict.criteria import Criteria
from calib.verdict.evidence import noise_factor
from calib.verdict.halves import HalfSplit, Halves, half_split
from calib.verdict.judge import VERDICT, VERDICT_FILE, Judged, judge_run
from calib.verdict.next_views import NEXT_VIEWS, NEXT_VIEWS_FILE, NextView, NextViews, next_views
from designer.base.errors import InputError
from designer.target import TargetGeometry


def judge_folder(folder: Path, criteria: Criteria) -> Judged:
    """Judge the best camera of a folder, and write `verdict.json` and `next_views.json`, both or none.

    Half solutions that an earlier verdict stored are used again.

    Raises:
        InputError: the folder holds no camera that can be read, or takes no files; the message names it.
    """
    run = read_run(folder)
    best = run.best()
    calibrations = [one.calibration for one in run.solved]
    judged, proposed = judge_cameras(
        calibrations, run.solved.index(best), best.provenance.options, criteria, run.target,
        inputs=inputs_of(best.provenance.settings), halves=_stored_halves(folder, best),
    )  # fmt: skip
    judged = replace(judged, observations_sha256=best.provenance.observations_sha256)
    write_files({
        folder / VERDICT_FILE: VERDICT.text(judged), folder / NEXT_VIEWS_FILE: NEXT_VIEWS.text(NextViews(proposed))
    })  # fmt: skip
    return judged


def judge_cameras(
    calibrations: Sequence[Calibration],
    best: int,
    options: SolveOptions,
    criteria: Criteria,
    target: TargetGeometry | None,
    *,
    inputs: Inputs = DETECTED,
    halves: HalfSplit | None = None,
) -> tuple[Judged, tuple[NextView, ...]]:
    """The verdict on a camera, and the photos that would make it better.

    Args:
        calibrations: of the same photos by different models.
        best: row of the one that is judged.
        options: that it was solved with.
        criteria: the limits.
        target: that the photos show; None: points from elsewhere.
        inputs: the files it was solved from, which the advice names.
        halves: cameras of halves of the photos; None: they are solved now.
    """
    judged = calibrations[best]
    found = half_split(judged, options) if halves is None else halves
    proposed = next_views(
        judged, goal_px=criteria.uncertainty_px.good, goal_covered=criteria.coverage_percent.good / 100,
        factor=noise_factor(judged, found), prior=prior_of(judged, target),
    )  # fmt: skip
    return judge_run(calibrations, best, found, criteria, proposed, inputs), proposed


def inputs_of(settings: Sequence[tuple[str, str]]) -> Inputs:
    """What a camera was solved from, as its command was told; `calib run` detects into a file of its own."""
    named = dict(settings)
    return Inputs(named.get("detections", DETECTED.sightings), named.get("target", DETECTED.target))


def _stored_halves(folder: Path, best: Solved) -> HalfSplit | None:
    """The half solutions of an earlier verdict, if that is on this camera."""
    try:
        judged = VERDICT.read(folder / VERDICT_FILE)
    except InputError:
        return None
    return judged.halves if isinstance(judged.halves, Halves) and is_verdict_on(judged, best) else None


def is_verdict_on(judged: Judged, best: Solved) -> bool:
    """Whether a verdict is on this camera."""
    return judged.observations_sha256 == best.provenance.observations_sha256
