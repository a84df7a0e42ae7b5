"""A focal length that follows the distance, or differs between sessions, is solved with what it is for each photo."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

import calib
from calib.cameras.camera import load_camera, relinear
from calib.core.types import Observations, keep_views
from calib.judge.coverage import coverage_of
from calib.judge.halves import BY_CHANCE_APART, HalvesApart, NoHalves, half_split, halves_apart
from calib.observe.calibration_file import read_calibration
from calib.solver.calibration import Calibration
from calib.solver.capture_error import with_capture_error
from calib.solver.metrics.errors import predict
from calib.solver.metrics.evaluation import evaluate_held_out, evaluate_on, held_out_px
from calib.solver.plan import plan_from_words
from calib.solver.problem import SolveOptions
from calib.solver.solve import solve
from designer.base.arrays import Array
from designer.base.errors import InputError
from tests.support import solver_scenes as scenes

TRUE = scenes.CAMERAS["opencv"]
AT_MM, B_MM = 450.0, 6.0
NOISE_PX = 0.05


def seen_with(linear: Array, poses: Array, rng: np.random.Generator) -> Observations:
    """What cameras with such fx, fy, cx, cy (V, 4) see of a board."""
    seen = scenes.observe(TRUE, scenes.board(9, 7), poses, rng)
    return scenes.noisy(
        replace(seen, center_px=relinear(seen.center_px, TRUE.params[:4], linear[seen.view])), NOISE_PX, rng
    )


def breathing(seed: int, b_mm: float = B_MM) -> Observations:
    """Photos of an autofocus, from near and far."""
    fixed = np.random.default_rng(7)
    poses = scenes.poses_around(14, fixed, half_angle_deg=40)
    poses[:, :3, 3] *= fixed.uniform(0.7, 1.9, (14, 1))
    points = scenes.board(9, 7).position_mm
    depth = (points @ poses[:, 2, :3].T + poses[:, 2, 3]).mean(axis=0)
    linear = np.tile(TRUE.params[:4], (14, 1))
    linear[:, :2] *= 1 + b_mm * (1 / depth - 1 / AT_MM)[:, None]
    return seen_with(linear, poses, np.random.default_rng(seed))


def sessions(seed: int) -> tuple[Observations, dict[str, str], Array]:
    """Photos of five sessions, which photo is of which, and their focal lengths."""
    rng, of = np.random.default_rng(seed), np.arange(20) // 4  # parts that are held out have photos of each
    focal = TRUE.params[0] + rng.normal(0, 60.0, 5)
    linear = np.tile(TRUE.params[:4], (20, 1))
    linear[:, :2] *= (focal[of] / TRUE.params[0])[:, None]
    seen = seen_with(linear, scenes.poses_around(20, np.random.default_rng(7), half_angle_deg=40), rng)
    names = {name: f"s{number}" for name, number in zip(seen.view_names, of.tolist(), strict=True)}
    return seen, names, focal


@pytest.mark.parametrize("b_mm", [B_MM, 0.0])
def test_breathing_is_told_as_surely_as_stated(b_mm: float) -> None:
    """Also if there is none; the camera is that at the distance that was asked for."""
    off, squares = [], []
    for seed in range(12):
        found = solve(breathing(seed, b_mm), "opencv", SolveOptions(breathing_mm=AT_MM))
        assert found.breathing is not None
        off.append((found.breathing.mm - b_mm) / found.breathing.sigma_mm)
        error = found.camera.params - TRUE.params
        squares.append(error @ np.linalg.solve(found.param_covariance, error) / len(error))
    assert 0.5 < np.sqrt(np.mean(np.square(off))) < 1.6
    assert 0.6 < np.mean(squares) < 1.5


def test_a_camera_at_one_distance_says_so_where_it_is_read(tmp_path: Path) -> None:
    """Of a folder or a file, by what reads it; the photos of other distances are not its own."""
    found = calib.solve(breathing(0), model="opencv", breathing_mm=AT_MM)
    found.save(tmp_path / "out")
    for place in (tmp_path / "out", tmp_path / "out" / "camera.json"):
        assert [line for line in calib.diff(place, TRUE).remarks if "at 450 mm: poses at other" in line]


def test_what_was_named_as_a_cause_is_gone_when_it_is_solved() -> None:
    """A focal length that follows the distance is found in photos, and is the option's remedy."""
    without, solved = (
        with_capture_error(solve(breathing(0), "opencv", SolveOptions(breathing_mm=at))) for at in (None, AT_MM)
    )
    assert without.capture_error is not None
    assert "changes with the distance" in without.capture_error.effects[0].name
    assert "--breathing" in without.capture_error.effects[0].remedy
    assert solved.capture_error is not None
    assert not solved.capture_error.effects
    more, stated = (
        np.sqrt(np.diagonal(one)[0]) for one in (solved.capture_error.param_covariance, solved.param_covariance)
    )
    assert more < 0.2 * stated  # is not expected once more
    assert solved.scale == pytest.approx(NOISE_PX, rel=0.1)


def test_sessions_have_their_own_focal_lengths() -> None:
    """As surely as stated, with the camera as their mean, whether it is told how much they differ or not."""
    seen, of, focal = sessions(0)
    for sigma_px in (None, 60.0):
        options = SolveOptions(vary=("focal",), vary_sigma_px=sigma_px, sessions=tuple(of.items()))
        found = solve(seen, "opencv", options)
        assert [one.name for one in found.sessions] == [f"s{number}" for number in range(5)]
        own, sigma = (np.stack([getattr(one, key)[:2] for one in found.sessions]) for key in ("linear", "sigma"))
        assert (np.abs(own - focal[:, None] * TRUE.params[:2] / TRUE.params[0]) < 3.5 * sigma).all()
        assert (sigma < 2.0).all()
        assert found.camera.params[:2] == pytest.approx(own.mean(axis=0))
        assert (scenes.sigma_of(found.param_covariance)[:2] < 0.6).all()
        assert found.scale == pytest.approx(NOISE_PX, rel=0.1)


def test_halves_have_photos_of_each_session() -> None:
    """Noise alone shows no difference between them, and sessions of one photo have no halves."""
    seen, of, _ = sessions(0)
    options = SolveOptions(vary=("focal",), sessions=tuple(of.items()))
    found = solve(seen, "opencv", options)
    apart = halves_apart(half_split(found, options), coverage_of(found))
    assert isinstance(apart, HalvesApart)
    assert apart.ratio < BY_CHANCE_APART
    of |= {seen.view_names[0]: "only"}
    alone = half_split(solve(seen, "opencv", few := replace(options, sessions=tuple(of.items()))), few)
    assert isinstance(alone, NoHalves)
    assert "session only has one photo" in alone.reason.replace("'", "")


@pytest.mark.parametrize("kind", ["breathing", "sessions"])
def test_photos_held_out_are_seen_with_their_own(kind: str) -> None:
    """They leave over what the noise is, and not what the mean camera would."""
    options, seen = SolveOptions(breathing_mm=AT_MM), breathing(0)
    if kind == "sessions":
        seen, of, _ = sessions(0)
        options = SolveOptions(vary=("focal",), sessions=tuple(of.items()))
    left_px = held_out_px(solve(seen, "opencv", options), lambda part: solve(part, "opencv", options))
    assert left_px == pytest.approx(np.sqrt(2) * NOISE_PX, rel=0.1)


def test_photos_of_other_sessions_are_left_out_and_named() -> None:
    """No camera that is known is theirs: of photos held out, and of those that another camera was solved from."""
    seen, of, _ = sessions(0)
    of |= {seen.view_names[0]: "only"}
    options = SolveOptions(vary=("focal",), sessions=tuple(of.items()))

    def again(part: Observations) -> Calibration:
        return solve(part, "opencv", options)

    every = again(seen)
    assert held_out_px(every, again) == pytest.approx(np.sqrt(2) * NOISE_PX, rel=0.1)
    held = evaluate_held_out(every, again, 5)
    assert [line for line in held.remarks if "view0.png: not evaluated" in line and "session" in line]
    is_first = np.arange(20) < 12
    on = evaluate_on(again(keep_views(seen, is_first)), keep_views(seen, np.arange(20) >= 8), "new")
    assert on.calibration.observations.view_names == seen.view_names[8:12]
    assert sum("no photo of its session" in line for line in on.remarks) == 8
    with pytest.raises(InputError, match="session that the camera was solved from"):
        evaluate_on(again(keep_views(seen, is_first)), keep_views(seen, ~is_first), "new")
    options = replace(options, sessions=tuple((name, name) for name in seen.view_names))
    with pytest.raises(InputError, match="no photo of its session"):
        held_out_px(every, again)
    with pytest.raises(InputError, match="no photo of its session"):
        evaluate_held_out(every, again, 5)


def test_a_folder_keeps_what_varies(tmp_path: Path) -> None:
    """Each session has a camera file, and what is read back predicts each photo as it was solved."""
    seen, of, _ = sessions(0)
    names = {"s0": "lens a", "s1": "lens_A", "s2": "朝", "s3": "夜"}
    of = {name: names.get(one, one) for name, one in of.items()}
    table = tmp_path / "sessions.csv"
    table.write_text("file,session\n" + "".join(f"{name},{one}\n" for name, one in of.items()), "utf-8")
    calib.solve(seen, model="opencv", vary="focal", sessions=table).save(tmp_path / "out")
    back, origin = read_calibration(tmp_path / "out" / "calibration.json")
    assert origin.options.vary == ("focal",)
    assert "Sessions, of which" in (tmp_path / "out" / "index.html").read_text()
    files = [f"camera.{word}.json" for word in ("lens_a", "lens_A_1", "_", "__3", "s4")]  # no two alike in any letters
    for one, file in zip(back.sessions, files, strict=True):
        assert load_camera(tmp_path / "out" / file).params[:4].tolist() == one.linear.tolist()
    (line,) = calib.convert(tmp_path / "out", "opencv").remarks
    assert "mean of 5 sessions" in line
    calib.solve(seen, model="opencv").save(tmp_path / "out")
    assert not list((tmp_path / "out").glob("camera.*.json"))  # those of the sessions are gone
    left_px = predict(back).predicted_px - back.observations.center_px
    assert left_px == pytest.approx(back.residual_px, abs=1e-5)


@pytest.mark.parametrize("vary", ["", "k1", "focal,fx", "focal+-0", "focal+-2mm", "focal+-1+-2", "fx,fx"])
def test_what_cannot_vary_is_refused(vary: str) -> None:
    """In one line."""
    with pytest.raises(InputError, match="--vary") as caught:
        plan_from_words("opencv", vary=vary)
    assert "\n" not in str(caught.value)


def test_what_varies_goes_with_neither_the_other_nor_space() -> None:
    """Each refusal names its own two options."""
    seen, varying = breathing(0), SolveOptions(vary=("focal",))
    for options, said in (
        (replace(varying, breathing_mm=AT_MM), "--breathing, --vary: are not solved together; leave one of them out"),
        (replace(varying, minimise="ray"), "--vary: goes with distances in the image only; leave --minimise ray out"),
    ):
        with pytest.raises(InputError) as caught:
            solve(seen, "opencv", options)
        assert str(caught.value) == said


@pytest.mark.parametrize(("vary", "name"), [("focal", "fy"), ("cx", "cx")])
def test_nothing_is_known_of_what_differs(vary: str, name: str) -> None:
    """What varies between sessions is of no one value: no prior on it, and it is not fixed."""
    seen, of, _ = sessions(0)
    with pytest.raises(InputError, match=f"fix {name}.*=1250: .*vary {vary}.*leave one"):
        calib.solve(seen, model="opencv", vary=vary, sessions=of, fix=[f"{name}=1250"])
    with pytest.raises(InputError, match=f"--prior {name}.*vary {vary}.*leave one"):
        calib.solve(seen, model="opencv", vary=vary, sessions=of, priors={name: (1250.0, 5.0)})


def test_sessions_must_be_told() -> None:
    """One session, a photo of none, and sessions between which nothing varies are refused."""
    seen, of, _ = sessions(0)
    few = dict(list(of.items())[1:])
    for told, vary, why in ((None, "focal", "all photos"), (few, "focal", "no session of"), (of, None, "vary focal")):
        with pytest.raises(InputError, match=why):
            calib.solve(seen, model="opencv", vary=vary, sessions=told)
