"""What is alike in all photos in the verdict: its size and its remedy, and no cause that explains too little."""

from dataclasses import replace

import numpy as np

from calib.core.types import Observations
from calib.judge.criteria import read_criteria
from calib.judge.halves import NoHalves
from calib.judge.judge import Judged
from calib.solver.calibration import Calibration
from calib.solver.capture_error import with_capture_error
from calib.solver.problem import SolveOptions
from calib.solver.solve import solve
from tests.support.verdict_cases import OPTIONS, TRUE, check, judge_run, sightings


def _judged(seen: Observations) -> tuple[Judged, Calibration]:
    one = with_capture_error(solve(seen, "opencv", OPTIONS))
    return judge_run([one], 0, NoHalves("not solved"), read_criteria()), one


def _moving(amount_px: float) -> Observations:
    """A target that moves across while the rows are read; in photos of many distances, so that no lens does it."""
    seen = sightings(views=16)
    late = seen.center_px[:, 1:] / TRUE.image_size[1] - 0.5
    return replace(seen, center_px=seen.center_px + amount_px * late * [1.0, 0.0])


def test_motion_is_named_with_its_effect_and_what_to_do() -> None:
    """The check says what moved and by how much; the camera is worse for it, and the advice says to let it rest."""
    run, one = _judged(_moving(0.8))
    found = check(run, "capture")
    assert found.grade != "good"
    assert found.sentence.startswith("the photos show a target that moves along the camera's x")
    assert "let target and camera rest" in " ".join(run.verdict.advice)
    off = one.camera.params - TRUE.params
    assert abs(off[1]) < 4 * np.sqrt(one.stated_covariance[1, 1])


def test_at_rest_it_says_what_was_assumed() -> None:
    """A good camera stays good, and is told what nobody could see."""
    run, one = _judged(sightings(views=16))
    plain = judge_run([replace(one, capture_error=None)], 0, NoHalves("not solved"), read_criteria())
    found = check(run, "capture")
    assert found.grade == "good"
    assert "assumed; --capture tells otherwise" in found.sentence
    stated, by_noise = check(run, "uncertainty"), check(plain, "uncertainty")
    assert stated.grade == by_noise.grade
    assert (by_noise.value or 0.0) <= (stated.value or 0.0) < 1.3 * (by_noise.value or 0.0)


def test_what_does_not_explain_what_is_left_over_is_no_cause() -> None:
    """Beside a field fixed in the image, a fault only looks like one, and nothing is advised against it."""
    seen = _moving(0.8)
    apart = (seen.center_px - np.array(TRUE.image_size) * [0.6, 0.45]) / (0.1 * TRUE.image_size[0])
    bump = 0.3 * np.exp(-0.5 * (apart**2).sum(axis=1))[:, None] * [1.0, 0.5]
    run, _ = _judged(replace(seen, center_px=seen.center_px + bump))
    assert check(run, "capture").sentence.startswith("something looks like")
    assert "let target and camera rest" not in " ".join(run.verdict.advice)


def test_a_parameter_that_is_held_may_be_the_cause_as_well() -> None:
    """One focal length for both axes of a camera with two scales the rows as a target that moves does."""
    one = with_capture_error(solve(sightings(views=16), "opencv", SolveOptions(shared=(("fx_px", "fy_px"),))))
    run = judge_run([one], 0, NoHalves("not solved"), read_criteria())
    assert check(run, "capture").sentence.startswith("something looks like")
    assert "fixed or shared" in check(run, "capture").sentence
