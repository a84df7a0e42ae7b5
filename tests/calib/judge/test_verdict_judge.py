"""The verdict: what a careful person would say of runs with known faults."""

from dataclasses import replace
from functools import cache

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from calib.core.types import Observations
from calib.judge.checks import read_criteria
from calib.judge.evidence import LensEvidence, lens_evidence, uncertainty_of
from calib.judge.halves import NoHalves, half_split
from calib.judge.judge import WORSE
from calib.judge.target_shape import ShapeEffect
from calib.judge.verdict import Check, Criteria, Grade, Limits, measured_text
from calib.solver.calibration import ImageField, TargetError
from calib.solver.solve import solve
from tests.support.solver_scenes import observe, pose_from, poses_around
from tests.support.verdict_cases import (
    BOARD,
    ICOSAHEDRON,
    OPTIONS,
    TRUE,
    believed,
    bent,
    check,
    halves_apart_by,
    judge_run,
    judged,
    sightings,
    solved,
    verdict_on,
)


def _rank(grade: Grade) -> int:
    return WORSE.index(grade)


def test_a_good_run_is_good() -> None:
    """Sharp photos of a true board all over the image: every check is good, and the sentence says so with numbers."""
    run = judged(sightings(views=20), models=("opencv", "luhmann"))
    assert {one.grade for one in run.verdict.checks} == {"good"}
    assert run.verdict.grade == "good"
    assert run.verdict.sentence.startswith("the camera is uncertain by at most 0.0")
    assert run.verdict.model == "opencv"


def test_more_noise_never_improves_the_grade() -> None:
    """The grade is monotone in the noise, from good to not to be used."""
    grades = [_rank(judged(sightings(views=20, noise_px=noise)).verdict.grade) for noise in (0.02, 0.06, 0.2, 0.6)]
    assert grades == sorted(grades)
    assert (grades[0], grades[-1]) == (_rank("good"), _rank("bad"))


def test_a_bent_board_is_not_good() -> None:
    """A board that bends by a tenth of a millimetre makes errors of 2 px in an otherwise perfect run: do not use."""
    run = judged(believed(sightings(bent(BOARD, 0.1), views=20), BOARD), models=("opencv", "luhmann"))
    assert check(run, "residuals").grade == "good"
    assert check(run, "models").grade == "good"
    assert check(run, "target").grade == "bad"
    assert run.verdict.sentence.startswith("the target is not quite as given")


def test_a_target_of_another_size_is_harmless() -> None:
    """The size of a target goes with its distance and leaves the camera alone."""
    large = replace(BOARD, position_mm=1.01 * BOARD.position_mm)
    assert judged(believed(sightings(large, views=20), BOARD)).verdict.grade == "good"


def test_three_photos_are_usable_at_best() -> None:
    """Without halves nothing independent was checked: no praise, and the reason is said."""
    seen, whole = sightings(views=20), read_criteria()
    evidence = lens_evidence(solved(seen), 0, NoHalves("3 photos cannot be halved; take 4 or more"))
    verdict = verdict_on(evidence, whole)
    assert {one.grade for one in verdict.checks} == {"good", "unknown"}
    assert verdict.grade == "usable"
    assert "3 photos cannot be halved" in verdict.sentence
    few = judged(sightings(views=3))
    assert check(few, "halves").grade == "unknown"
    assert few.verdict.grade == "bad"


def test_one_photo_or_photos_straight_on_are_not_to_be_used() -> None:
    """A board's one photo does not determine the camera, which comes before all else; a solid's covers little.

    Without tilt the focal length is hardly determined, however sharp the photos are.
    """
    run = judged(sightings(views=1, noise_px=0.05))
    assert run.verdict.grade == "bad"
    assert run.verdict.checks[0].name == "solution"
    assert run.verdict.sentence.startswith("the photos do not determine the camera: the one view of a plane")
    rng = np.random.default_rng(0)
    run = judged(observe(TRUE, ICOSAHEDRON, pose_from((0, 0, 330.0)), rng, noise_px=0.02))
    assert (check(run, "halves").grade, check(run, "coverage").grade) == ("unknown", "bad")
    assert run.verdict.grade == "bad"
    seen = observe(TRUE, BOARD, poses_around(12, rng, half_angle_deg=1.0, distance_mm=350), rng, noise_px=0.05)
    assert judged(seen).verdict.grade == "bad"


def test_a_target_in_the_centre_only_is_good_there_only() -> None:
    """The camera is known where the target was seen, and not to be used elsewhere; both are said."""
    rng = np.random.default_rng(0)
    run = judged(observe(TRUE, BOARD, poses_around(20, rng, distance_mm=600), rng, noise_px=0.02))
    assert run.verdict.grade == "bad"
    assert {one.name for one in run.verdict.checks if one.grade == "bad"} == {"uncertainty", "coverage"}
    assert run.verdict.sentence.startswith("the observations surround only ")
    assert "nothing was seen to check it" in run.verdict.sentence


@given(value=st.floats(0, 120), limit=st.sampled_from([0.05, 0.3, 1.0, 5.0, 40.0, 70.0]), near=st.floats(-0.02, 0.02))
def test_a_value_is_told_on_its_side_of_the_limits(value: float, limit: float, near: float) -> None:
    """Rounding lifts nothing to a limit that it does not reach: grade and numbers agree for whoever compares them."""
    for number in (value, limit * (1 + round(near, 5))):
        for unit in ("%", "px"):
            told = float(measured_text(number, unit, (limit,)))
            assert (told > limit, told < limit) == (number > limit, number < limit) or abs(
                number - limit
            ) < 1e-7 * limit
    assert measured_text(69.96, "%", (70.0, 40.0)) == "69.96"
    assert measured_text(71.2, "%", (70.0, 40.0)) == "71"


def _with_outliers(seen: Observations, share: float) -> Observations:
    rng = np.random.default_rng(5)
    rows = rng.random(len(seen.view)) < share
    pixel = seen.center_px.copy()
    pixel[rows] += rng.normal(0, 3, (int(rows.sum()), 2))
    return replace(seen, center_px=pixel)


def test_outliers_are_counted() -> None:
    """Far-off sightings are seen through the errors they cause; left out, they are not good but do no harm."""
    seen = _with_outliers(sightings(views=20), 0.1)
    kept = judged(seen)
    assert check(kept, "outliers").grade == "bad"
    assert kept.verdict.grade == "bad"
    rejecting = replace(OPTIONS, reject_sigma=4.0)
    one = solve(seen, "opencv", rejecting)
    clean = judge_run([one], 0, half_split(one, rejecting), read_criteria())
    assert check(clean, "outliers").grade == "usable"
    assert check(clean, "outliers").value <= check(clean, "outliers").usable
    assert check(clean, "outliers").value == pytest.approx(10, abs=2)
    assert clean.verdict.grade == "usable"


def test_a_model_that_does_not_fit_is_found() -> None:
    """A pinhole for a lens with distortion: residuals are systematic, and the other model differs."""
    run = judged(sightings(views=12), models=("pinhole", "opencv"))
    assert check(run, "systematic").grade == "bad"
    assert check(run, "models").grade == "bad"
    assert run.verdict.grade == "bad"


def test_two_images_twice_as_fine_are_judged_alike() -> None:
    """Twice the pixels double what is told in pixels, and leave ratios and shares as they are."""
    one = sightings(views=8)
    other = replace(one, image_size=(2 * one.image_size[0], 2 * one.image_size[1]), center_px=2 * one.center_px + 0.5)
    coarse, fine = judged(one), judged(other)
    for here, there in zip(coarse.verdict.checks, fine.verdict.checks, strict=True):
        # The systematic part is a small difference of large numbers.
        if here.value is not None and there.value is not None and here.name != "systematic":
            times = 2 if here.unit == "px" else 1
            assert there.value == pytest.approx(times * here.value, rel=0.05, abs=1e-3), here.name


def _every(criteria: Criteria, good: float, usable: float) -> Criteria:
    limits = Limits(good, usable)
    names = ("uncertainty", "residuals", "systematic", "outliers", "target", "models")
    return replace(criteria, limits={**criteria.limits, **dict.fromkeys(names, limits)})


def test_stricter_limits_never_improve_the_grade() -> None:
    """From limits that all pass to limits that none passes the grade falls, of the same evidence."""
    seen = _with_outliers(sightings(views=12), 0.002)
    calibrations = solved(seen, ("opencv", "luhmann"))
    halves = half_split(calibrations[0], OPTIONS)
    steps = [(100.0, 200.0), (0.3, 1.0), (0.02, 0.1), (1e-9, 1e-8)]
    grades = [_rank(judge_run(calibrations, 0, halves, _every(read_criteria(), *step)).verdict.grade) for step in steps]
    assert grades == sorted(grades)
    assert grades[-1] == _rank("bad")


def test_a_camera_of_which_nothing_was_estimated_is_not_praised() -> None:
    """With every parameter fixed there is no uncertainty to state: not good."""
    names = ("fx_px", "fy_px", "cx_px", "cy_px", "k1", "k2", "p1", "p2", "k3")
    fixed = tuple(zip(names, TRUE.params.tolist(), strict=True))
    options = replace(OPTIONS, fixed=fixed)
    one = solve(sightings(views=20), "opencv", options)
    run = judge_run([one], 0, half_split(one, options), read_criteria())
    assert check(run, "uncertainty").grade == "unknown"
    assert run.verdict.grade == "usable"


@cache
def _plain(views: int) -> LensEvidence:
    """Of a good run that was not halved."""
    return lens_evidence(solved(sightings(views=views)), 0, NoHalves("not asked for"))


def _check(name: str, **changes: object) -> Check:
    """A check, where some of the evidence is another."""
    found = verdict_on(replace(_plain(6), **changes), read_criteria())  # type: ignore[arg-type]
    return next(one for one in found.checks if one.name == name)


def _shape(ratio: float, percentile_95_px: float, sigma_px: float) -> Check:
    """For some effect of the target's shape."""
    return _check("target", shape=ShapeEffect(percentile_95_px, ratio, sigma_px, 0.1))


@pytest.mark.parametrize(
    ("effect", "grade", "said"),
    [
        ((1.5, 0.4, 0.05), "good", ""),
        ((1.5, 0.4, 0.5), "unknown", ""),
        ((2.5, 0.4, 0.2), "usable", "may not be"),
        ((2.9, 0.33, 0.1), "usable", "more than 0.3 px, but below 3 sigma a suspicion"),
        ((2.9, 0.29, 0.1), "usable", ""),
        ((5.0, 0.4, 0.1), "bad", ""),
        ((5.0, 0.05, 0.01), "good", ""),
    ],
)
def test_only_what_is_sure_of_the_target_makes_a_camera_unusable(
    effect: tuple[float, float, float], grade: Grade, said: str
) -> None:
    """By chance nothing is said against a target; a suspicion is a warning; beyond 3 sigma the pixels count.

    A grade that is better than the limits says why.
    """
    found = _shape(*effect)
    assert found.grade == grade
    assert said in found.sentence
    assert ("suspicion" in found.sentence) == (grade == "usable" and effect[1] > 0.3)


def _halves(ratio: float, percentile_95_px: float, stated_px: float | None = None) -> Check:
    stated = percentile_95_px / ratio if stated_px is None else stated_px
    return _check("halves", halves=halves_apart_by(ratio, percentile_95_px, stated, percentile_95_px))


@pytest.mark.parametrize(
    ("ratio", "percentile_95_px", "stated_px", "grade", "said"),
    [
        (1.9, 0.5, None, "good", ""),
        (3.0, 0.25, None, "usable", ""),
        (3.0, 0.4, None, "bad", ""),
        (9.0, 0.08, None, "usable", ""),
        (9.0, 0.25, None, "bad", ""),
        (2.1, 0.002, None, "good", "take the standard deviations so many times as large"),
        (0.4, 0.37, 0.93, "unknown", "0.93 px between them is expected, more than 0.3 px"),
        (1.0, 0.29, 0.29, "good", ""),
        (3.0, 2.8, 0.93, "bad", ""),
    ],
)
def test_halves_are_judged_by_what_they_differ_in_px_and_in_sigmas(
    ratio: float, percentile_95_px: float, stated_px: float | None, grade: Grade, said: str
) -> None:
    """Wrong standard deviations alone make no camera unusable; halves that are pixels apart do.

    A few thousandths of a pixel condemn nothing, however small their deviation. Halves expected to be a pixel apart
    show nothing by agreeing; that they are farther apart than that is told all the same.
    """
    found = _halves(ratio, percentile_95_px, stated_px)
    assert found.grade == grade
    assert said in found.sentence


def test_a_shape_that_the_photos_do_not_tell_leaves_no_praise_unless_its_making_is_known() -> None:
    """Where another shape would move the camera, nothing is good without a word on how the target was made.

    What it may be off then stands in the uncertainty; a check that could not be made hides nothing.
    """
    evidence = replace(
        _plain(20), halves=halves_apart_by(1.0, 0.01, 0.01, 0.01), shape=ShapeEffect(0.5, 1.0, 22.0, 0.1)
    )
    assert verdict_on(evidence, read_criteria()).grade == "usable"
    assert "--made" in verdict_on(evidence, read_criteria()).sentence
    none = np.zeros((9, 9))
    for by_target, grade in ((0.0, "good"), (0.2, "usable"), (2.0, "bad")):
        known = replace(
            evidence.uncertainty, target_error=TargetError("a test", "", none + by_target), target_px=by_target,
            image_px=float(np.hypot(0.01, by_target)),
        )  # fmt: skip
        assert verdict_on(replace(evidence, uncertainty=known), read_criteria()).grade == grade


def test_halves_without_power_leave_no_praise() -> None:
    """A verdict that rests on halves that cannot tell is usable at best, and says why."""
    verdict = verdict_on(replace(_plain(20), halves=halves_apart_by(0.4, 0.37, 0.93, 0.4)), read_criteria())
    assert verdict.grade == "usable"
    assert "not everything could be checked: halves of the photos are so uncertain" in verdict.sentence


def _of_leftover(name: str, ratio: float = 1.0, **changes: float) -> Check:
    return _check(name, **changes, shape=ShapeEffect(0.2, ratio, 0.01, 0.1))


def test_words_are_no_stronger_than_what_is_found() -> None:
    """Within a limit there is a hint, and a target is only called wrong where the check of its shape is sure."""
    assert "may not be quite as given" in _of_leftover("systematic", 2.5, target_px=0.04, rms_px=0.06).sentence
    assert "may not be quite as given" in _of_leftover("systematic", 2.5, target_px=0.1).sentence
    assert "is not quite as given" in _of_leftover("systematic", 5.0, target_px=0.1).sentence
    within = _of_leftover("residuals", rms_px=0.06, times_stated=9.0)
    assert within.grade == "good"
    assert "within the limit, though 9.0 times the noise" in within.sentence
    beyond = _of_leftover("residuals", rms_px=0.3, times_stated=42.0)
    assert "most of it is not noise" in beyond.sentence


def test_what_is_far_off_is_told_by_the_noise_where_covariances_are_weights() -> None:
    """Sightings of very different noise are no outliers, in a solution whose covariances stand for weights neither."""
    rng = np.random.default_rng(4)
    seen = sightings(views=8, noise_px=0.0)
    sigma = np.where(rng.random(len(seen.view)) < 0.05, 0.4, 0.02)
    noise = sigma[:, None, None] ** 2 * np.eye(2)
    shifted = replace(seen, center_px=seen.center_px + sigma[:, None] * rng.standard_normal((len(sigma), 2)))
    alike = replace(shifted, cov_px2=np.tile(np.eye(2), (len(sigma), 1, 1)))
    weighted = replace(OPTIONS, weighted=True)
    assert any("are off by more than 6" in remark for remark in solve(alike, "opencv", weighted).remarks)
    told = solve(alike, "opencv", weighted, noise_px2=noise)
    assert told.remarks == ()
    known = judged(replace(shifted, cov_px2=noise))
    assert check(known, "outliers").grade == "good"
    assert "of the stated noise" in check(known, "outliers").sentence


def test_a_model_that_fits_worse_cannot_blame_the_camera() -> None:
    """A lens with distortion solved as such is good, however far off a pinhole is that leaves over much more."""
    run = judged(sightings(views=20), models=("opencv", "pinhole"))
    assert check(run, "models").grade == "unknown"
    assert "pinhole does not fit the lens" in check(run, "models").sentence
    assert run.verdict.grade == "good"


@pytest.mark.parametrize(("ratio", "factor"), [(0.5, 1.0), (1.3, 1.0), (1.6, 1.6), (4.0, 4.0)])
def test_halves_that_differ_beyond_chance_enlarge_the_uncertainty(ratio: float, factor: float) -> None:
    """Stated deviations are multiplied by the ratio of the halves where chance does not explain it, and only there.

    What the target may be off is the same in both halves, and added as it is.
    """
    halves = halves_apart_by(ratio, 0.01, 0.01 / ratio, 0.02)
    assert halves.factor == factor
    run, evidence = solved(sightings(views=6)), _plain(6)
    stated = evidence.uncertainty.image_px
    uncertain = uncertainty_of(run[0], evidence.coverage, halves.factor)
    enlarged = replace(evidence, halves=halves, uncertainty=uncertain)
    found = next(one for one in verdict_on(enlarged, read_criteria()).checks if one.name == "uncertainty")
    assert found.value == pytest.approx(factor * stated)
    error = TargetError("a test", "", 3 * run[0].param_covariance)
    both = uncertainty_of(replace(run[0], target_error=error), evidence.coverage, halves.factor)
    assert both.image_px == pytest.approx(np.sqrt(factor**2 + 3) * stated)
    assert both.target_px == pytest.approx(np.sqrt(3) * stated)
    field = ImageField(0.02, 5 * run[0].param_covariance)
    all_three = uncertainty_of(replace(run[0], target_error=error, image_field=field), evidence.coverage, halves.factor)
    assert all_three.image_px == pytest.approx(np.hypot(np.sqrt(factor**2 + 8) * stated, 0.02))
    told = verdict_on(replace(evidence, halves=halves, uncertainty=all_three), read_criteria()).checks
    sentence = next(one for one in told if one.name == "uncertainty").sentence
    assert ("fixed in the image and the lens model does not follow, 0.020 px RMS" in sentence) == (factor < 2)
    assert ("times what the solution states" in found.sentence) == (factor > 1)
