"""Distances of a check object that a rig measures, against the known ones and what the covariances say."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

import calib
from calib.core.types import keep_frames
from calib.rigs.problem import CameraChoice
from calib.rigs.result import RigCalibration
from calib.rigs.solve import solve_rig
from calib.space.known_lengths import check_lengths
from calib.space.triangulate import triangulate_points
from designer.base.errors import InputError
from tests.support.rig_views import RigScene, stereo_pair
from tests.support.space_scenes import points_before, row_of_cameras, sighted, without_errors


@pytest.fixture(scope="module")
def pair() -> tuple[RigScene, RigCalibration]:
    """A stereo pair, solved from every second frame."""
    scene = stereo_pair(frames=16)
    even = np.arange(16) % 2 == 0
    return scene, solve_rig(keep_frames(scene.observations, even), [CameraChoice("opencv")] * 2)


def test_distances_of_other_frames_lie_within_what_is_stated(pair: tuple[RigScene, RigCalibration]) -> None:
    """Errors of all pairs are as large as their standard deviations, which hold 95 % of them; so is the scale."""
    scene, found = pair
    told = calib.triangulate(found.rig, keep_frames(scene.observations, np.arange(16) % 2 == 1)).lengths
    assert told is not None
    assert told.frames == 8
    assert told.ratio == pytest.approx(1, abs=0.12)
    assert told.within_95 == pytest.approx(0.95, abs=0.03)
    assert abs(told.scale) < 3 * told.scale_sigma < 1e-3
    assert sum(one.pairs for one in told.bins) == told.pairs


def test_an_object_that_is_larger_than_its_file_shows_in_the_scale() -> None:
    """By exactly as much; its sigma is that of the scatter over simulated photos."""
    rng = np.random.default_rng(2)
    rig = without_errors(row_of_cameras(2))
    points = points_before(rig, 30, rng)
    found = triangulate_points(rig, sighted(rig, 1.01 * points))
    told = check_lengths(found, points, "a thing")
    assert told is not None
    assert told.scale == pytest.approx(0.01, rel=1e-4)
    scales = []
    for _ in range(40):
        seen = sighted(rig, points, rng)
        again = check_lengths(triangulate_points(rig, seen), points, "a thing")
        assert again is not None
        scales.append(again.scale)
    assert np.std(scales) == pytest.approx(told.scale_sigma, rel=0.3)


def test_centres_that_scatter_more_than_they_state_are_taken_as_they_are(pair: tuple[RigScene, RigCalibration]) -> None:
    """A detector that is too sure of itself does not make lengths look surer than they are; it is said."""
    scene, found = pair
    seen = keep_frames(scene.observations, np.arange(16) % 2 == 1)
    sure = tuple(replace(one, cov_px2=None if one.cov_px2 is None else one.cov_px2 / 9) for one in seen.sightings)
    told = calib.triangulate(found.rig, replace(seen, sightings=sure))
    assert told.lengths is not None
    assert told.lengths.ratio == pytest.approx(1, abs=0.15)
    assert "times as much as they state" in told.remarks[-1]


def test_a_table_of_known_points_is_a_check_object(pair: tuple[RigScene, RigCalibration], tmp_path: Path) -> None:
    """As `calib rig` takes it, with X, Y, Z."""
    scene, found = pair
    seen = scene.observations
    lines = [f"# camera {name} 1280 x 960" for name in seen.camera_names] + ["camera,frame,u,v,X,Y,Z"]
    for name, one in zip(seen.camera_names, seen.sightings, strict=True):
        rows = np.column_stack([one.center_px, one.points.position_mm[one.point]])[one.view < 2]
        lines += [
            f"{name},f{view},{','.join(map(repr, row))}"
            for view, row in zip(one.view.tolist(), rows.tolist(), strict=False)
        ]
    (tmp_path / "board.csv").write_text("\n".join(lines) + "\n")
    told = calib.triangulate(found.rig, tmp_path / "board.csv").lengths
    assert told is not None
    assert (told.frames, told.ratio < 2) == (2, True)


def test_the_rigs_own_target_is_said_to_check_no_size(pair: tuple[RigScene, RigCalibration]) -> None:
    """Its size is in the rig, too, so the scale fits whatever it is; of another target nothing is said."""
    scene, found = pair
    one = keep_frames(scene.observations, np.arange(16) == 1)
    rigs = found.rig, replace(found.rig, geometry_id="another"), replace(found.rig, geometry_id="")
    told = [calib.triangulate(rig, one).remarks for rig in rigs]
    assert ["this very target" in " ".join(remarks) for remarks in told] == [True, False, False]


@pytest.mark.parametrize(
    ("given", "said"),
    [
        ({}, "give a table of sightings; or photos"),
        ({"photos": ["a", "b"]}, "name the target file"),
        ({"target": "x.target.json", "sightings": "p.csv"}, "target: is of photos"),
        ({"photos": "none", "target": "x.target.json"}, "no such folder"),
    ],
)
def test_what_does_not_go_together_is_refused(
    given: dict[str, object], said: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Points or a check object, and all of it."""
    monkeypatch.chdir(tmp_path)
    Path("p.csv").write_text("camera,frame,point,u,v\na,f,p,600,400\nb,f,p,500,400\n")
    with pytest.raises(InputError, match=said):
        calib.triangulate(row_of_cameras(2), **given)  # type: ignore[arg-type]


def test_a_camera_of_another_rig_is_named(pair: tuple[RigScene, RigCalibration]) -> None:
    """Or photos of another size."""
    scene, _ = pair
    with pytest.raises(InputError, match="camera 'left': not in the rig"):
        calib.triangulate(row_of_cameras(2), scene.observations)
