"""Judging the calibration in a folder, by limits of one's choice."""

import math
from pathlib import Path

from calib.files import write_files
from calib.pipeline.made import prior_of
from calib.report.run_folder import RunFolder, Solved, read_run
from calib.verdict.advice import DETECTED, Inputs
from calib.verdict.criteria import Criteria
from calib.verdict.evidence import noise_factor
from calib.verdict.halves import HalfSplit, Halves, half_split
from calib.verdict.next_views import NextView, next_views
from calib.verdict.next_views_file import NEXT_VIEWS_FILE, next_views_file
from calib.verdict.of_run import Judged, judge_run
from calib.verdict.verdict_file import VERDICT_FILE, read_verdict, verdict_to_json
from designer.errors import InputError

SAME = 1e-9
"""Two roots of mean squares of the same files differ by less, of their size."""


def judge_folder(folder: Path, criteria: Criteria) -> Judged:
    """Judge the best camera of a folder, and write `verdict.json` and `next_views.json`, both or none.

    Half solutions that an earlier verdict stored are used again.

    Raises:
        InputError: the folder holds no camera that can be read, or takes no files; the message names it.
    """
    judged, _ = judge_what_is_read(read_run(folder), criteria)
    return judged


def judge_what_is_read(run: RunFolder, criteria: Criteria) -> tuple[Judged, tuple[NextView, ...]]:
    """The same for a folder that is read already; what `judge_folder` returns, and the photos to take next."""
    folder, best = run.folder, run.best()
    halves = _stored_halves(folder, best) or half_split(best.calibration, best.provenance.options)
    proposed = next_views(
        best.calibration, goal_px=criteria.uncertainty_px.good, goal_covered=criteria.coverage_percent.good / 100,
        factor=noise_factor(best.calibration, halves), prior=prior_of(best.calibration, run.target),
    )  # fmt: skip
    calibrations = [one.calibration for one in run.solved]
    judged = judge_run(calibrations, run.solved.index(best), halves, criteria, proposed, _inputs(best))
    write_files({
        folder / VERDICT_FILE: verdict_to_json(judged), folder / NEXT_VIEWS_FILE: next_views_file(proposed)
    })  # fmt: skip
    return judged, proposed


def _inputs(best: Solved) -> Inputs:
    """What the camera was solved from, as its command was told; `calib run` detects into a file of its own."""
    named = dict(best.provenance.settings)
    return Inputs(named.get("detections", DETECTED.sightings), named.get("target", DETECTED.target))


def _stored_halves(folder: Path, best: Solved) -> HalfSplit | None:
    """The half solutions of an earlier verdict, if they are of this camera and its photos."""
    try:
        judged = read_verdict(folder)
    except InputError:
        return None
    return judged.halves if isinstance(judged.halves, Halves) and is_verdict_on(judged, best) else None


def is_verdict_on(judged: Judged, best: Solved) -> bool:
    """Whether a verdict is on this camera.

    It is of its model; its halves, if there are any, are of its photos; and as much is left over, which other
    detections of the same photos would change.
    """
    left_px = next((check.value for check in judged.verdict.checks if check.name == "residuals"), None)
    if judged.verdict.model != best.model or left_px is None:
        return False
    if not math.isclose(left_px, best.rmse_px, rel_tol=SAME):
        return False
    names, size = set(best.calibration.observations.view_names), best.calibration.camera.image_size
    for first, second in judged.halves.pairs if isinstance(judged.halves, Halves) else ():
        cameras = (first.known.camera, second.known.camera)
        if any(one.model != best.model or one.image_size != size for one in cameras):
            return False
        if {*first.view_names, *second.view_names} != names:
            return False
    return True
