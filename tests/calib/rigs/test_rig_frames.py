"""Halves of a rig's frames tell what moved from noise; frames that are shifted, or hardly tell their lenses."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from calib.cameras import parameter_names, project
from calib.core.se3 import transform
from calib.core.types import Observations, RigObservations, keep_frames, keep_views
from calib.judge.folders import write_rig
from calib.judge.halves import NoHalves, RigHalves
from calib.judge.joint_halves import half_solver, rig_halves, ways_to_halve, without_outliers
from calib.observe.calibration_file import Provenance
from calib.rigs.problem import CameraChoice, RigOptions
from calib.rigs.result import RigCalibration
from calib.rigs.rig_calibration_file import read_rig
from calib.rigs.shared_errors import with_shared_errors
from calib.rigs.solve import solve_rig
from calib.solver.calibration import Calibration
from calib.solver.problem import SolveOptions
from calib.solver.solve import solve
from designer.base.arrays import Flags
from designer.base.errors import InputError
from tests.benchmarks.bench_rig_real import FOLDER, length_errors, observed, read_corners, shuffled
from tests.support import rig_views
from tests.support.rig_views import RigScene, solved_slowly, stereo_pair


def solved(scene: RigScene) -> tuple[RigCalibration, RigHalves | NoHalves]:
    """A rig and its halves."""
    choices = [CameraChoice(one.model) for one in scene.cameras]
    found = solve_rig(scene.observations, choices)
    return found, rig_halves(found, half_solver(found, choices, RigOptions()))


def pushed(scene: RigScene, shift_mm: float, is_pushed: Flags) -> RigScene:
    """The rig with its second camera pushed sideways in some frames (V,)."""
    seen, frames = scene.observations.sightings[1], scene.observations.frame[1]
    place = transform(
        (scene.cam_from_rig[1] @ scene.rig_from_target)[frames[seen.view]], seen.points.position_mm[seen.point]
    )
    step = project(scene.cameras[1], place + np.array([shift_mm, 0, 0])) - project(scene.cameras[1], place)
    other = replace(seen, center_px=seen.center_px + np.where(is_pushed[frames[seen.view]][:, None], step, 0.0))
    return replace(scene, observations=replace(scene.observations, sightings=(scene.observations.sightings[0], other)))


def test_halves_of_honest_frames_differ_as_their_covariances_say() -> None:
    """Over some rigs the mean square of the ratios is one, both for alike halves and in order, and none has moved."""
    found = [solved(stereo_pair(frames=10, seed=seed))[1] for seed in range(8)]
    for kind in ("by turns", "in order"):
        ratios = [one.ratio_of(kind) for one in found if isinstance(one, RigHalves)]
        assert len(ratios) == 8
        assert np.mean(np.square(ratios)) == pytest.approx(1, abs=0.45)
    assert not any(one.has_moved for one in found if isinstance(one, RigHalves))


def test_a_camera_that_was_pushed_meanwhile_is_told_from_other_misfits() -> None:
    """Pushed half-way, the first frames give another rig than the last; pushed now and then, they do not."""
    scene = stereo_pair(frames=16)
    _, halves = solved(pushed(scene, 0.5, np.arange(16) >= 8))
    assert halves.has_moved
    assert halves.noise_of("in order") < 0.8 * halves.noise_of("by turns")
    assert halves.factor == halves.ratio > halves.by_chance
    _, mixed = solved(pushed(scene, 0.5, np.isin(np.arange(16) % 4, (0, 3))))
    assert not mixed.has_moved


def test_a_push_is_told_where_what_photos_share_is_stated() -> None:
    """Its errors are stated as those that photos share, by which halves may differ; that it was one is still told."""
    scene = pushed(stereo_pair(frames=24), 0.35, np.arange(24) >= 12)
    choices = [CameraChoice("opencv")] * 2
    found = with_shared_errors(solve_rig(scene.observations, choices))
    halves = rig_halves(found, half_solver(found, choices, RigOptions()))
    assert found.photo_covariance is not None
    assert halves.has_moved
    assert all(one.by_noise is not None and one.by_noise > one.ratio for one in halves.splits)


def test_alike_halves_do_not_depend_on_the_order_of_frames() -> None:
    """Frames that are given the other way round are halved into the same halves by turns."""
    found = solved_slowly(stereo_pair(frames=12), steps=0)
    reverse = replace(found, rig_from_target=found.rig_from_target[::-1])
    for (kind, one), (_, other) in zip(ways_to_halve(found), ways_to_halve(reverse), strict=True):
        if kind == "by turns":
            assert np.array_equal(one, other[::-1]) or np.array_equal(one, ~other[::-1])


def test_what_was_left_out_of_all_frames_is_left_out_of_halves() -> None:
    """Outliers are in no half; a view of nothing else goes, too, and its frame's number stays with the others."""
    found = solved_slowly(stereo_pair(frames=4), steps=0)
    seen = found.observations.sightings[0]
    found = replace(found, is_outlier=(seen.view == 1, found.is_outlier[1]))
    kept = without_outliers(found)
    assert kept.frame[0].tolist() == [0, 2, 3]
    assert kept.sightings[0].view_names == tuple(np.array(seen.view_names)[[0, 2, 3]])
    assert keep_frames(kept, np.array([False, True, True, True])).frame[0].tolist() == [1, 2]


def test_why_there_are_no_halves_is_said() -> None:
    """Few frames, and a rig that is not determined, have no halves."""
    few = solved_slowly(stereo_pair(frames=5), steps=0)
    solve = half_solver(few, [CameraChoice("opencv")] * 2, RigOptions())
    assert rig_halves(few, solve) == NoHalves("5 frames cannot be halved; take 6 or more")
    lost = rig_halves(replace(few, status="degenerate"), solve)
    assert isinstance(lost, NoHalves)
    assert "do not determine the rig" in lost.reason


def _shifted(observations: RigObservations, camera: int, by: int) -> RigObservations:
    """One camera's photos in other frames than they were taken in."""
    frame = observations.frame[camera]
    kept = (frame - by >= 0) & (frame - by < observations.frame_count)
    sightings, frames = list(observations.sightings), list(observations.frame)
    sightings[camera], frames[camera] = keep_views(sightings[camera], kept), frame[kept] - by
    return replace(observations, sightings=tuple(sightings), frame=tuple(frames))


@pytest.mark.parametrize(("scene", "camera", "by"), [(rig_views.stereo_pair(), 1, 3), (rig_views.ring(), 0, -2)])
def test_frames_that_are_shifted_are_named_with_the_shift(scene: rig_views.RigScene, camera: int, by: int) -> None:
    """A list that lacks its first three photos is told by what fits; of many cameras the odd one, be it the first."""
    known = [CameraChoice(one.model, given=one, is_refined=False) for one in scene.cameras]
    name, frame = scene.observations.camera_names[camera], max(-by, 0)
    pair = f"in frame{frame:03d} the others show in frame{frame + by:03d}"
    with pytest.raises(InputError, match=f"camera {name}: its frames fit if shifted by {by}: .* {pair}"):
        solve_rig(_shifted(scene.observations, camera, by), known)


@pytest.mark.skipif(not FOLDER.is_dir(), reason="the measurements are not beside the project, in ../shared/real")
def test_corners_of_other_frames_are_placed_in_any_order() -> None:
    """Distances between them are off by .95 mm at most (others: 1.217 and .991); no slack is left to single photos."""
    corners = read_corners(FOLDER / "xy.csv")
    is_first = np.isin(corners.frame, np.unique(corners.frame)[::2])
    seen = replace(observed(corners.of(is_first)), time_s=None)
    choices = [CameraChoice("opencv")] * seen.camera_count
    found = solve_rig(seen, choices)
    assert found.slack is None
    assert length_errors(found.rig, corners.of(~is_first))[0] <= 0.95
    for seed in range(6):  # in some orders a camera alone ends in a lens from which the rig has no way to the minimum
        rng = np.random.default_rng(seed)
        mixed = shuffled(seen, rng)
        rounded = [
            replace(one, center_px=one.center_px + rng.normal(0, 1e-9, one.center_px.shape)) for one in mixed.sightings
        ]
        again = solve_rig(
            replace(mixed, sightings=tuple(rounded)), choices, RigOptions(reference=mixed.camera_names.index("cam0"))
        )
        assert again.status == "converged"
        rows = [again.rig.row(name) for name in found.rig.names]
        np.testing.assert_allclose(again.rig.center_mm[rows], found.rig.center_mm, atol=0.05)


def test_photos_that_tell_their_lens_may_have_slack_and_others_none(monkeypatch: pytest.MonkeyPatch) -> None:
    """Of frames of a moving target that two good cameras took one after the other; of frames that fit, none.

    Each camera is solved alone once, however often the rig is.
    """
    solved: list[str] = []

    def counted(seen: Observations, model: str, options: SolveOptions) -> Calibration:
        solved.append(model)
        return solve(seen, model, options)

    for module in ("start", "solve"):
        monkeypatch.setattr(f"calib.rigs.{module}.solve", counted)
    pair = stereo_pair(frames=10).observations
    choices = [CameraChoice("opencv")] * 2
    assert solve_rig(pair, choices).slack is None
    right = pair.sightings[1]
    shift_px = np.random.default_rng(0).normal(0, 3.0, (right.view_count, 2))
    late = replace(right, center_px=right.center_px + shift_px[right.view])
    solved.clear()
    assert solve_rig(replace(pair, sightings=(pair.sightings[0], late)), choices).slack is not None
    assert len(solved) == 2


def test_parameters_that_were_fixed_are_told_and_stay_so(tmp_path: Path) -> None:
    """Of each camera by name, also in its folder, whoever solves or measures with it again; a kept lens has all."""
    scene = stereo_pair(frames=6)
    left = CameraChoice("opencv", fixed=(("k3", 0.0), ("cx_px", None)))
    right = CameraChoice("opencv", scene.cameras[1], is_refined=False)
    found = solve_rig(scene.observations, (left, right))
    assert [one.fixed for one in found.alone] == [("k3", "cx_px"), parameter_names("opencv")]
    assert found.is_refined == (True, False)
    assert found.choices[0].fixed == (("k3", 0.0), ("cx_px", found.cameras[0].parameters["cx_px"]))
    assert found.choices[1] == right
    write_rig(tmp_path, found, Provenance("test 1"))
    again, _ = read_rig(tmp_path)
    assert (again.fixed, again.is_refined) == (found.fixed, found.is_refined)
