"""What is advised: true of the photos, concrete, and nothing where nothing is to do."""

from dataclasses import replace
from functools import cache

import numpy as np
import pytest

from calib.judge.advice import advice_of
from calib.judge.checks import read_criteria
from calib.judge.coverage import Region
from calib.judge.evidence import LensEvidence, lens_evidence
from calib.judge.halves import half_split
from calib.judge.next_views import NextView, next_views
from calib.judge.verdict import Criteria, px
from calib.judge.views import view_facts
from calib.solver.calibration import Calibration
from calib.solver.free_bend import NOT_TOLD
from calib.solver.problem import SolveOptions
from calib.solver.solve import solve
from designer.base.arrays import Array
from tests.support.solver_scenes import CAMERAS, NOISE_PX, board, icosahedron, noisy, observe, pose_from, poses_around
from tests.support.verdict_cases import halves_apart_by, shown_at, verdict_on

BOARD = board(12, 10, 14.0)


ALL_OVER = [(u, v) for u in (650.0, 1224.0, 1800.0) for v in (600.0, 1024.0, 1450.0)] * 3


def solved(poses: Array, noise_px: float = NOISE_PX) -> Calibration:
    """A camera solved from photos of the board."""
    rng = np.random.default_rng(3)
    return solve(observe(CAMERAS["opencv"], BOARD, poses, rng, noise_px=noise_px), "opencv")


@cache
def good() -> Calibration:
    """Photos without a fault: all over the image, tilted, at three distances."""
    return solved(shown_at(ALL_OVER, (330.0, 400.0, 500.0), (35.0, 10.0, 45.0, 25.0)))


@cache
def criteria() -> Criteria:
    """The standard limits."""
    return read_criteria()


def evidence(calibration: Calibration) -> LensEvidence:
    """What is measured of a calibration."""
    return lens_evidence([calibration], 0, half_split(calibration, SolveOptions()))


def advice(calibration: Calibration) -> tuple[str, ...]:
    """The advice on a calibration, with its next views."""
    return advice_of(calibration, evidence(calibration), criteria(), proposed(calibration))


def proposed(calibration: Calibration) -> tuple[NextView, ...]:
    """The photos to take next for the limits."""
    return next_views(
        calibration, goal_px=criteria()["uncertainty"].good, goal_covered=criteria()["coverage"].good / 100
    )


def test_good_photos_get_no_advice() -> None:
    """Nothing is said of photos that leave nothing to ask for."""
    assert advice(solved(shown_at(3 * ALL_OVER, (330.0, 400.0, 500.0), (35.0, 10.0, 45.0, 25.0)))) == ()


def test_a_board_on_the_left_is_asked_for_on_the_right() -> None:
    """Parts of the image that were not covered are named, and the share is that of the evidence."""
    left = [(u, v) for u in (480.0, 620.0, 750.0) for v in (500.0, 1024.0, 1500.0)] * 2
    calibration = solved(shown_at(left, (420.0, 500.0), (35.0, 10.0, 45.0)))
    found = evidence(calibration)
    without = advice_of(calibration, found, criteria())
    missing = next(sentence for sentence in without if sentence.startswith("show the target in"))
    assert "the right edge" in missing
    assert "left" not in missing
    assert f"{100 * found.coverage.share:.0f} % of the image" in missing
    views = proposed(calibration)
    at_side = replace(found, coverage=replace(found.coverage, bands=(Region("60-75", 0.2, 0.1),)))
    said, aside = (advice_of(calibration, one, criteria(), views) for one in (found, at_side))
    first = next(sentence for sentence in said if sentence.startswith("next photo"))
    assert "right" in first.split(",")[0]
    assert f"coverage {100 * found.coverage.share:.0f} -> " in first
    assert not any(sentence.startswith("show the target in") for sentence in said)
    assert not any("solid target" in sentence for sentence in said)
    assert any("60° to 75° off the axis" in sentence and "a solid target" in sentence for sentence in aside)


def test_photos_without_tilt_are_to_be_tilted() -> None:
    """Small tilts are named with the largest of them; large ones are not mentioned."""
    calibration = solved(shown_at(ALL_OVER, (330.0, 400.0, 500.0), (4.0, 9.0, 12.0)))
    said = next(sentence for sentence in advice(calibration) if sentence.startswith("tilt the board"))
    assert "more than 12 deg" in said
    assert not any(sentence.startswith("tilt") for sentence in advice(good()))


def test_photos_that_do_not_determine_the_camera_say_how_to_mend_it() -> None:
    """Of a board seen straight on only, the solver's reason comes first, and a tilted photo next."""
    calibration = solved(shown_at(ALL_OVER, (400.0,), (0.0,)))
    assert calibration.status == "degenerate"
    said = advice(calibration)
    assert "straight on" in said[0]
    assert said[1].startswith("next photo 1 of ")
    assert "hold the board" in said[1]
    assert "tilted" in said[1]
    assert "not determined ->" in said[1]


def test_a_camera_that_is_not_known_well_gets_the_next_photo_and_what_more_of_the_same_would_do() -> None:
    """The next photo's sentence is there; the number of photos alike follows sigma ~ 1/sqrt(N)."""
    calibration = solved(shown_at(ALL_OVER[:8], (600.0, 700.0), (30.0, 40.0, 20.0)), 0.05)
    found = evidence(calibration)
    sigma = found.uncertainty.image_px
    views = proposed(calibration)
    said = advice(calibration)
    first = next(row for row, sentence in enumerate(said) if sentence.startswith("next photo"))
    for row, view in enumerate(views):
        assert view.sentence in said[first + row]
    wanted = criteria()["uncertainty"].good
    assert f"(wanted: {px(wanted)}" in said[first]
    alike = next(sentence for sentence in said if "photos like the 8 so far" in sentence)
    needed = 8 * (sigma / wanted) ** 2
    assert needed > 40
    stated = int(alike.split("about ")[-1].split(" would")[0])
    assert needed <= stated <= 1.11 * needed
    without = advice_of(calibration, found, criteria())
    assert any(sentence.startswith("take photos that fill the image") for sentence in without)
    none = advice_of(calibration, found, criteria(), ())
    assert any(sentence.startswith("no next photo can be proposed: none of the places") for sentence in none)


def test_what_would_change_the_verdict_comes_first() -> None:
    """Of two faults that which the verdict names first is mended first, with its command; the rest comes last."""
    calibration, found = good(), evidence(good())
    wrong = replace(found, image_px=0.3, target_px=0.01)
    faults = {"lens": wrong, "halves": replace(found, halves=halves_apart_by(4.2, 0.1, 0.02, 0.2))}
    assert "--model splined" in advice_of(calibration, faults["lens"], criteria())[0]
    both = replace(faults["lens"], halves=halves_apart_by(4.2, 0.1, 0.02, 0.2))
    said = advice_of(calibration, both, criteria())
    assert verdict_on(both, criteria()).sentence.startswith("the mean residual of a place")
    assert ["--model splined" in said[0], "two halves" in said[1]] == [True, True]
    worse = replace(wrong, image_px=0.1, halves=halves_apart_by(6.0, 0.6, 0.1, 0.9))
    assert verdict_on(worse, criteria()).sentence.startswith("cameras solved from halves")
    said = advice_of(calibration, worse, criteria())
    assert ["two halves" in said[0], "--model splined" in said[1]] == [True, True]


def test_few_photos_and_one_distance_are_named() -> None:
    """Four photos are few; photos from one distance are said to be so, with the distance."""
    calibration = solved(shown_at(ALL_OVER[:4], (400.0,), (35.0, 20.0)))
    said = advice(calibration)
    assert any(sentence.startswith("take 10 photos or more") and "with 4" in sentence for sentence in said)
    assert any("0.42 m" in sentence or "0.41 m" in sentence for sentence in said if "nearer" in sentence)
    assert not any("nearer" in sentence for sentence in advice(good()))


def test_a_photo_that_stands_out_is_named() -> None:
    """One photo with ten times the noise is named, no other one; noise alone names none."""
    calibration = good()
    rough = replace(
        calibration,
        residual_px=calibration.residual_px * np.where(calibration.observations.view == 5, 10.0, 1.0)[:, None],
    )
    said = next(sentence for sentence in advice(rough) if "residuals are up to" in sentence)
    assert said.startswith("look at view5.png: its")
    assert not any("residuals are up to" in sentence for sentence in advice(good()))


def test_sightings_left_out_are_counted_where_they_are() -> None:
    """Three in a hundred left out are said to be so, with the photos that have most of them."""
    calibration = good()
    in_two = np.isin(calibration.observations.view, (3, 8))
    out = in_two & (np.random.default_rng(0).random(len(in_two)) < 0.4)
    said = next(s for s in advice(replace(calibration, is_outlier=out)) if s.startswith("look at the photos"))
    count, total = (int(word) for word in said.split(": ")[1].split(" observations")[0].split(" of "))
    assert 0 <= count - out.sum() <= 3  # of those that count, chance has one or two
    assert total == len(out)
    names = said.split(" in ")[-1].split(", ")
    assert set(names[:2]) == {"view3.png", "view8.png"}


def test_what_was_left_out_of_photos_that_a_motion_blurred_is_not_blamed_on_glare() -> None:
    """Where most of what is far off lies in smeared photos these are to be taken again; elsewhere it is as before."""
    seen = good().observations
    out = np.isin(seen.view, (3, 8)) & (np.random.default_rng(0).random(len(seen.view)) < 0.4)
    for smeared, is_motion in ((("view3.png", "view8.png"), True), (("view4.png",), False)):
        calibration = replace(good(), is_outlier=out, observations=replace(seen, smeared=smeared))
        said = " ".join(advice(calibration))
        assert ("motion blurred" in said and "view3.png" in said and "--reject" not in said) == is_motion
        assert ("glare" in said) != is_motion


def test_a_bent_board_is_to_be_measured_before_anything_else() -> None:
    """A board bent by 1 mm over 150 mm makes `calib measure` the first advice; halves that differ do so, too.

    Of one that looks the same turned, which is not measured, it is another board.
    """
    bent = replace(BOARD, position_mm=BOARD.position_mm + np.array([0, 0, 1e-4]) * BOARD.position_mm[:, :1] ** 2)
    poses = shown_at(ALL_OVER, (330.0, 400.0, 500.0), (35.0, 10.0, 45.0, 25.0))
    seen = observe(CAMERAS["opencv"], bent, poses, np.random.default_rng(3), noise_px=NOISE_PX)
    flat = solve(replace(seen, points=BOARD), "opencv")
    said = advice(flat)
    assert "--free-bend" in said[0]
    assert "--free-bend" not in advice(replace(flat, remarks=(NOT_TOLD,)))[0]
    assert "`calib measure NAME.target.json detections.csv --photos FOLDER -o measured/NAME.target.json`" in said[0]
    alike = replace(BOARD, turned=np.stack([np.arange(120), np.arange(120)[::-1]]))
    said = advice(replace(flat, observations=replace(flat.observations, points=alike)))
    assert "looks the same turned" in said[0]
    assert "`calib measure NAME" not in said[0]
    found = replace(evidence(good()), halves=halves_apart_by(4.2, 0.1, 0.02, 0.2))
    said = advice_of(good(), found, criteria())
    assert "4.2 times" in said[0]


def test_a_small_target_with_few_rings_is_named() -> None:
    """A target of a quarter of the image and twelve rings is small and has few rings."""
    small = board(4, 3, 10.0)
    poses = shown_at(ALL_OVER[:9], (300.0, 400.0), (35.0, 20.0, 45.0))
    calibration = solve(observe(CAMERAS["opencv"], small, poses, np.random.default_rng(1), noise_px=0.02), "opencv")
    said = advice(calibration)
    assert any(sentence.startswith("come closer") for sentence in said)
    assert any("shows 12" in sentence for sentence in said)


def test_a_learned_map_is_good_only_where_it_is_known() -> None:
    """The part of the image where a map is known is named; of photos to come nothing is said of its sigma."""
    found = evidence(good())
    learned = replace(
        found, uncertainty=replace(found.uncertainty, image_px=None, known=0.6, is_map_exact=True), model="virtual"
    )
    said = advice_of(good(), learned, criteria())
    assert any("60 % of the image" in sentence for sentence in said)
    assert not any(sentence.startswith(("next photo", "take photos")) for sentence in said)


def test_hostile_file_names_stay_one_line_of_text() -> None:
    """A name with line ends and control characters does not reach a screen as it is."""
    calibration = good()
    names = tuple(f"a\n\x1b[31m{'x' * 100}{n}.png" for n in range(len(calibration.observations.view_names)))
    rough = replace(
        calibration,
        observations=replace(calibration.observations, view_names=names),
        residual_px=calibration.residual_px * np.where(calibration.observations.view == 5, 10.0, 1.0)[:, None],
    )
    said = next(sentence for sentence in advice_of(rough, evidence(good()), criteria()) if "residuals" in sentence)
    assert said.isprintable()
    assert len(said) < 400


@pytest.mark.parametrize("tilt_deg", [0.0, 12.5, 40.0])
def test_facts_of_a_board_are_those_it_was_shown_with(tilt_deg: float) -> None:
    """Tilt, distance, place and size are those of the pose, whichever way the board's plane is written."""
    poses = shown_at([(900.0, 800.0), (1500.0, 1100.0)] * 3, (400.0,), (tilt_deg,))
    calibration = replace(solved(shown_at(ALL_OVER[:6], (400.0,), (30.0,))), cam_from_target=poses)
    points = replace(BOARD, plane=-BOARD.plane)
    seen = replace(observe(CAMERAS["opencv"], BOARD, poses, np.random.default_rng(0)), points=points)
    calibration = replace(
        calibration, observations=seen, residual_px=np.full((len(seen.view), 2), 0.3),
        is_outlier=np.zeros(len(seen.view), dtype=bool),
    )  # fmt: skip
    facts = view_facts(calibration)
    np.testing.assert_allclose(facts.tilt_deg, tilt_deg, atol=1e-5)
    np.testing.assert_allclose(facts.distance_mm, np.linalg.norm(poses[:, :3, 3], axis=1))
    np.testing.assert_allclose(facts.rms_px, 0.3 * np.sqrt(2))
    assert facts.is_flat
    assert np.abs(facts.place_px[0] - [900, 800]).max() < 60
    extent = np.ptp(seen.center_px[seen.view == 0], axis=0) / seen.image_size
    assert facts.size[0] == pytest.approx(extent.max())


def test_facts_of_a_solid_are_of_the_faces_that_were_seen() -> None:
    """The least tilt is of the face that looks at the camera most, the largest within the limit of what was seen."""
    points = icosahedron(60.0, 5)
    rng = np.random.default_rng(2)
    poses = np.concatenate([pose_from((0.0, 0.0, 300.0)), poses_around(5, rng, distance_mm=300.0)])
    seen = noisy(observe(CAMERAS["opencv"], points, poses, rng, incidence_deg=70.0), NOISE_PX, rng)
    facts = view_facts(solve(seen, "opencv"))
    assert not facts.is_flat
    assert (facts.tilt_deg[:, 0] <= facts.tilt_deg[:, 1]).all()
    assert (facts.tilt_deg[:, 1] <= facts.tilt_deg[:, 2]).all()
    assert facts.tilt_deg[:, 2].max() < 85
    assert facts.tilt_deg[:, 0].min() < 40


@pytest.mark.parametrize("weighted", [True, False])
def test_what_is_left_over_is_held_against_what_is_stated(weighted: bool) -> None:
    """Sigmas that are half as large as the noise are told so, whether or not they weigh."""
    stated = np.tile((NOISE_PX / 2) ** 2 * np.eye(2), (len(good().observations.view), 1, 1))
    seen = replace(good().observations, cov_px2=stated)
    assert evidence(solve(seen, "opencv", SolveOptions(weighted=weighted))).times_stated == pytest.approx(2, rel=0.1)
