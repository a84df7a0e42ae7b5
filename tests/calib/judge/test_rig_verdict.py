"""The verdict on a rig: what makes it usable or not, what leads and is advised, its next frames and its folder."""

import json
from dataclasses import replace
from functools import cache
from pathlib import Path

import numpy as np
import pytest

from calib.app.inputs import load_rig
from calib.judge.checks import CHECKS, read_criteria
from calib.judge.coverage import Coverage
from calib.judge.evidence import JointEvidence, joint_evidence
from calib.judge.folders import RIG_FILE, write_rig
from calib.judge.halves import NoHalves, RigHalves, RigSplit
from calib.judge.judge import judge, judge_rig
from calib.judge.next_frames import next_frames
from calib.judge.verdict import Grade
from calib.observe.calibration_file import RIG_CALIBRATION_FILE, Provenance, read_calibration
from calib.rigs.relative import CarriedError, relative
from calib.rigs.result import MechanismFit, RigCalibration
from calib.rigs.rig_calibration_file import CAMERAS, folder_names, read_rig
from calib.solver.priors import ParameterPrior
from designer.base.errors import InputError
from tests.support.file_examples import same
from tests.support.rig_views import RigScene, ring, scene_of, solved_slowly, stereo_pair

STANDARD = read_criteria()
AGREE = RigHalves((RigSplit("by turns", 1.0, 60, 1.0, ()), RigSplit("in order", 1.0, 60, 1.0, ())))


@cache
def found() -> RigCalibration:
    """A good pair whose lenses were given: nothing is said of what their images cover."""
    return solved_slowly(stereo_pair(frames=12), refined=(False, False))


@cache
def covered() -> Coverage:
    """An image that is covered whole."""
    coverage = joint_evidence(solved_slowly(stereo_pair(frames=12)), AGREE).cameras[0].coverage
    assert coverage is not None
    return replace(coverage, views=np.ones_like(coverage.views), regions=())


def evidence(**changes: object) -> JointEvidence:
    """What is known of it, had its lenses been solved from images that are covered whole."""
    known = joint_evidence(found(), AGREE)
    known = replace(known, cameras=tuple(replace(one, coverage=covered()) for one in known.cameras))
    return replace(known, **changes)  # type: ignore[arg-type]


def test_a_sound_rig_is_good_and_says_how_well_it_is_known() -> None:
    """All checks within their limits are good, and the sentence has the distances and the error in space."""
    verdict = judge(evidence(), STANDARD)
    assert verdict.grade == "good", verdict.checks
    assert "the distances of the cameras are known to" in verdict.sentence
    assert verdict.advice == ()
    assert "lenses" not in {check.name for check in verdict.checks}


def test_a_prior_of_a_camera_that_its_photos_contradict_leads() -> None:
    """With the camera's name and both numbers; what agrees is good, and without priors nothing is said of them."""
    rig = solved_slowly(stereo_pair(frames=12))
    fx = float(rig.cameras[1].params[0])
    for off_px, grade in ((0.1, "good"), (40.0, "bad")):
        priors = ((), (ParameterPrior("fx_px", fx + off_px, 2.0),))
        told = judge_rig(replace(rig, priors=priors), AGREE, STANDARD).verdict
        assert {check.name: check.grade for check in told.checks}["priors"] == grade
    assert told.leads_with == "priors"
    assert told.sentence.startswith(f"{rig.observations.camera_names[1]}: fx_px: the prior says")
    assert told.advice[0].startswith("leave the prior")


def carried(degrees: float) -> MechanismFit:
    """A turntable that is off its own angles by so much."""
    return MechanismFit("turntable", np.eye(4), None, float(np.radians(degrees)), 0.1, None)


def test_poses_that_are_not_the_photos_lead_whatever_else_they_spoil() -> None:
    """A robot's noise of degrees is none: the verdict says that its poses and the photos do not belong together."""
    assert judge(evidence(carrier=carried(0.05)), STANDARD).grade == "good"
    assert judge(evidence(carrier=carried(0.5)), STANDARD).leads_with == "carrier"
    lost = judge(evidence(carrier=carried(53.0), status="stopped", status_reason="too far"), STANDARD)
    assert (lost.grade, lost.leads_with) == ("bad", "carrier")
    assert lost.sentence.startswith("the turntable's own errors are 53 deg")


def test_one_camera_on_a_robot_is_judged_by_what_its_pose_leaves_open() -> None:
    """As a share of how far away the target was: of a camera without pairs nothing else says how well it is placed."""
    for sigma_mm, grade in ((0.4, "good"), (2.0, "usable"), (7.6, "bad")):
        known = evidence(pairs=(), ties=(), middle=None, carried=CarriedError(500.0, sigma_mm), carrier=carried(0.05))
        assert judge(known, STANDARD).grade == grade
    unknown = evidence(pairs=(), ties=(), middle=None, carried=CarriedError(500.0, np.nan), carrier=carried(0.05))
    assert {check.name: check.grade for check in judge(unknown, STANDARD).checks}["space"] == "unknown"


@pytest.mark.parametrize(("rms_px", "grade"), [(0.54, "usable"), (1.1, "bad")])
def test_residuals_of_a_camera_on_a_robot_are_judged_in_mm(rms_px: float, grade: Grade) -> None:
    """What half a pixel does to a point where the target was is known, and is no reason of its own not to use it."""
    (left, _), one = evidence().cameras, CarriedError(500.0, 0.4)
    known = evidence(
        pairs=(), ties=(), middle=None, carried=one, carrier=carried(0.05), cameras=(replace(left, rms_px=rms_px),)
    )
    assert judge(known, STANDARD).grade == grade


def test_halves_of_a_camera_on_a_robot_are_judged_at_the_target() -> None:
    """A lens and a direction that make up for each other differ between halves; only the place of the target counts."""
    for ratio, grade in ((1.0, "usable"), (9.0, "bad")):
        halves = RigHalves((RigSplit("by turns", 8.0, 6, 1.0, (), ratio),))
        known = evidence(pairs=(), ties=(), middle=None, carried=CarriedError(500.0, 0.4), carrier=carried(0.05))
        verdict = judge(replace(known, halves=halves), STANDARD)
        assert (verdict.grade, verdict.leads_with) == (grade, "halves")
        assert halves.factor == 8.0
        assert halves.target_factor == ratio
    one = RigHalves((RigSplit("by turns", 8.0, 6, 1.0, (), 1.7),))
    assert one.target_factor == 1.0  # by chance


def test_a_lens_that_was_kept_makes_no_rig_good() -> None:
    """What a given lens is off by shows in no residual: a focal length .5 % off moves a camera by 60 sigmas."""
    left, right = evidence().cameras
    verdict = judge(evidence(cameras=(left, replace(right, coverage=None))), STANDARD)
    assert (verdict.grade, verdict.leads_with) == ("usable", "lenses")
    assert "the lens of right is kept" in verdict.sentence


def test_what_was_not_checked_is_not_called_good() -> None:
    """Without halves nothing tells whether the standard deviations hold: usable at best, and the reason leads."""
    verdict = judge(evidence(halves=NoHalves("5 frames cannot be halved")), STANDARD)
    assert verdict.grade == "usable"
    assert verdict.leads_with == "halves"


@pytest.mark.parametrize(("times", "grade"), [(1.0, "good"), (2.0, "usable"), (8.0, "bad")])
def test_residuals_of_the_worst_camera_decide(times: float, grade: Grade) -> None:
    """One camera that leaves over too much makes the rig no better than that, however good the other is."""
    left, right = evidence().cameras
    verdict = judge(evidence(cameras=(left, replace(right, rms_px=times * right.rms_px))), STANDARD)
    assert verdict.grade == grade
    if grade == "bad":
        assert verdict.leads_with == "residuals"
        assert "right" in verdict.sentence


def test_one_camera_that_few_frames_join_is_named() -> None:
    """The weakest link of the chain counts, not the frames of the others."""
    one, two = evidence().ties
    verdict = judge(evidence(ties=(one, replace(two, joining_frames=3))), STANDARD)
    assert (verdict.grade, verdict.leads_with) == ("bad", "frames")
    assert "right shares only" in verdict.sentence
    assert any("right" in step for step in verdict.advice)


def test_what_moved_comes_first_in_advice() -> None:
    """Frames of a rig that was pushed meanwhile are to be taken again, not more of them."""
    moved = RigHalves((RigSplit("by turns", 3.0, 60, 1.0, ()), RigSplit("in order", 4.0, 60, 0.5, ())))
    verdict = judge(evidence(halves=moved), STANDARD)
    assert verdict.grade == "usable"
    assert verdict.advice[0].startswith("fix the cameras")
    check = next(check for check in verdict.checks if check.name == "halves")
    assert "such as a camera that was pushed" in check.sentence


def test_halves_that_differ_enlarge_what_is_told() -> None:
    """The deviations of distances and of a point grow by what halves differ more than they should."""
    wide = RigHalves((RigSplit("by turns", 3.0, 60, 1.0, ()),))
    once, thrice = joint_evidence(found(), AGREE), joint_evidence(found(), wide)
    assert thrice.pairs[0].relative.baseline_sigma_mm == pytest.approx(3 * once.pairs[0].relative.baseline_sigma_mm)
    assert thrice.middle.rig_mm == pytest.approx(3 * once.middle.rig_mm)
    assert thrice.middle.noise_mm == once.middle.noise_mm


def test_coverage_makes_no_rig_unusable() -> None:
    """A ring that sees its target in the middle only is usable there; millimetres come before coverage."""
    verdict = judge(joint_evidence(solved_slowly(ring(frames=6)), AGREE), STANDARD)
    check = next(check for check in verdict.checks if check.name == "coverage")
    assert check.grade == "usable"
    assert check.value < 40
    assert "mostly without" in check.sentence
    assert verdict.leads_with == "space"
    assert verdict.sentence.endswith("sensor coverage)")


def test_a_rig_that_is_not_determined_is_not_used() -> None:
    """Its status is the reason, covariances that are not known are said so, and no frames are proposed."""
    lost = replace(
        found(), status="degenerate", remarks=("left and right move freely",),
        covariance=np.full_like(found().covariance, np.nan),
        frame_covariance=np.full_like(found().frame_covariance, np.nan),
        pose_covariance=tuple(np.full_like(one, np.nan) for one in found().pose_covariance),
    )  # fmt: skip
    judged = judge_rig(lost, NoHalves("the frames do not determine the rig"), STANDARD)
    assert (judged.verdict.grade, judged.verdict.leads_with) == ("bad", "solution")
    assert "left and right move freely" in judged.verdict.sentence
    assert judged.next_frames == ()
    told = {check.name: check.sentence for check in judged.verdict.checks if check.grade == "unknown"}
    assert told["baselines"] == told["space"] == "the covariance of the cameras' poses is not known"


def test_delays_are_judged_by_what_they_move() -> None:
    """A delay that is not known well moves sightings of a target that moves; of one at rest it does no harm."""
    for delay_px, grade in ((0.01, "good"), (0.1, "usable"), (1.0, "bad")):
        assert judge(evidence(delay_px=(0.0, delay_px)), STANDARD).grade == grade
    seen = found().observations
    times = tuple(0.1 * np.arange(one.view_count) for one in seen.sightings)
    late = replace(
        found(), observations=replace(seen, time_s=times), delay_s=np.zeros(2), delay_sigma_s=np.array([0.0, 1e-3])
    )
    first, second = joint_evidence(late, AGREE).delay_px
    assert first == 0
    assert 0.1 < second < 10  # by some hundred px from frame to frame


def test_one_file_holds_the_limits_of_cameras_and_rigs() -> None:
    """Limits of checks that both have are the same; of a verdict on a rig only those of rigs are kept."""
    kept = judge_rig(found(), AGREE, STANDARD).criteria
    assert set(kept.limits) == {name for name, kind in CHECKS.items() if kind.unit and (kind.every or kind.joint)}
    assert kept["residuals"] == STANDARD["residuals"]
    assert "uncertainty" in STANDARD.limits
    assert "uncertainty" not in kept.limits


ALONE = NoHalves("not compared")


def with_frame(scene: RigScene, rig_from_target: np.ndarray) -> RigScene:
    """The rig with one more frame."""
    held = np.concatenate([scene.rig_from_target, rig_from_target[None]])
    names, points = scene.observations.camera_names, scene.observations.points
    rng = np.random.default_rng(5)
    return scene_of(names, scene.cameras, scene.cam_from_rig, held, points, rng, scene.noise_px)


@pytest.mark.parametrize("make", [stereo_pair, ring])
def test_a_frame_gives_what_it_promises(make: object) -> None:
    """Solved with the proposed frame, the pair is known as well as was said, or a little better: photos show more.

    So it is where noise is small; with much of it lenses are known badly where nothing was seen, and it says "about".
    """
    scene = make(noise_px=0.005, frames=6)  # type: ignore[operator]
    found = solved_slowly(scene)
    frame = next_frames(found, ALONE)[0]
    names = scene.observations.camera_names
    a, b = (names.index(name) for name in frame.pair)
    assert relative(found.rig, a, b).place_sigma_mm == pytest.approx(frame.sigma_mm_before)
    again = solved_slowly(with_frame(scene, frame.rig_from_target))
    scale = again.scale[0] / found.scale[0]
    assert 0.75 < relative(again.rig, a, b).place_sigma_mm / scale / frame.sigma_mm_after < 1.1


def test_frames_help_one_after_the_other_and_name_who_sees_them() -> None:
    """Each is proposed with those before it, tells of a gain, and says between which cameras to hold the target."""
    frames = next_frames(solved_slowly(ring(frames=5)), ALONE)
    assert 1 <= len(frames) <= 3
    for frame in frames:
        assert frame.sigma_mm_after < 0.97 * frame.sigma_mm_before
        assert len(frame.cameras) >= 2
        assert f" and {frame.cameras[-1]} see it" in frame.sentence
        assert "turned as in frame0" in frame.sentence


def test_deviations_that_halves_enlarge_are_told_enlarged() -> None:
    """What the sentence says is what the table of pairs says."""
    found = solved_slowly(stereo_pair(frames=6))
    wide = RigHalves((RigSplit("by turns", 2.0, 600, 1.0, ()),))
    once, twice = next_frames(found, ALONE)[0], next_frames(found, wide)[0]
    assert twice.sigma_mm_before == pytest.approx(2 * once.sigma_mm_before)
    assert twice.sigma_mm_after == pytest.approx(2 * once.sigma_mm_after, rel=1e-6)


def test_a_board_is_held_as_it_was_whichever_way_its_normal_points() -> None:
    """Points from elsewhere say nothing of a board's front: it is the side that was seen."""
    found = solved_slowly(stereo_pair(frames=5))
    seen = found.observations
    other = replace(seen.points, plane=-seen.points.plane)
    turned = replace(seen, sightings=tuple(replace(one, points=other) for one in seen.sightings))
    one, two = (next_frames(rig, ALONE) for rig in (found, replace(found, observations=turned)))
    assert one
    assert [frame.sentence for frame in one] == [frame.sentence for frame in two]


def test_nothing_is_proposed_where_nothing_is_known() -> None:
    """A rig without covariances has no weakest pair."""
    found = solved_slowly(stereo_pair(frames=4))
    assert next_frames(replace(found, covariance=np.full_like(found.covariance, np.nan)), ALONE) == ()
    assert next_frames(replace(found, status="degenerate"), ALONE) == ()


PROVENANCE = Provenance("test 1")


def test_a_rig_is_read_as_it_was_written(tmp_path: Path) -> None:
    """Sightings, poses, covariances and noise come back to the last bit, and `rig.json` is the same rig."""
    found = solved_slowly(stereo_pair(frames=5))
    found = replace(found, capture_covariance=found.covariance / 3, photo_covariance=found.covariance / 7)
    write_rig(tmp_path, found, PROVENANCE)
    again, provenance = read_rig(tmp_path)
    assert same(again, found)
    assert same(provenance, PROVENANCE)
    assert same(load_rig(tmp_path / RIG_FILE).covariance, found.rig.covariance)
    rounded = np.array(found.covariance)
    rounded[0, 1] *= 1 + 1e-4
    write_rig(tmp_path, replace(found, covariance=rounded), PROVENANCE)
    assert load_rig(tmp_path / RIG_FILE).covariance is not None, "whatever rounding does, what is written is read"


def test_a_camera_of_a_rig_is_a_calibration(tmp_path: Path) -> None:
    """A camera's folder reads by itself: its poses are those of the frames it saw, seen from it."""
    found = solved_slowly(stereo_pair(frames=5))
    write_rig(tmp_path, found, PROVENANCE)
    alone = read_calibration(tmp_path / CAMERAS / "right" / "calibration.json")[0]
    assert np.allclose(
        alone.cam_from_target, found.cam_from_rig[1] @ found.rig_from_target[found.observations.frame[1]]
    )
    assert np.array_equal(alone.param_covariance, found.stated_covariance[15:24, 15:24])


def test_folders_stay_inside_whatever_cameras_are_called() -> None:
    """No name leads upwards or twice to one folder, also where letters of both sizes are one."""
    names = folder_names(("../up", "a/b", "Left", "left", "camera_0", "..", "con.", "x" * 90))
    assert all("/" not in name and not name.startswith(".") for name in names)
    assert len({name.lower() for name in names}) == len(names)
    assert names[2] == "Left"


def test_files_of_another_solution_are_refused(tmp_path: Path) -> None:
    """A camera that was solved again by itself no longer belongs to the rig, and a path upwards is none."""
    write_rig(tmp_path, solved_slowly(stereo_pair(frames=5)), PROVENANCE)
    write_rig(tmp_path / "b", solved_slowly(stereo_pair(frames=5, seed=1)), PROVENANCE)
    own, other = (place / CAMERAS / "left" for place in (tmp_path, tmp_path / "b"))
    for name in ("calibration.json", "observations.csv"):
        (own / name).write_bytes((other / name).read_bytes())
    with pytest.raises(InputError, match=r"does not belong to .*; solve the rig again"):
        read_rig(tmp_path)
    path = tmp_path / RIG_CALIBRATION_FILE
    document = json.loads(path.read_text())
    document["cameras"][0]["folder"] = "../b/cameras/left"
    path.write_text(json.dumps(document))
    with pytest.raises(InputError, match=r"must be a plain name"):
        read_rig(tmp_path)
