"""Two rigs of the same cameras compared."""

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from calib.cameras.rig import Rig
from calib.core.se3 import exp_rotation, make_pose
from calib.rigs.compared import compare_rigs
from designer.base.errors import InputError
from tests.support.command_line import calib
from tests.support.foreign_rigs import ring, stereo


def placed_anew(rig: Rig, scale: float = 1.0) -> Rig:
    """The rig in another frame, all its lengths scaled."""
    poses = rig.cam_from_rig @ make_pose(exp_rotation(np.array([0.3, -1.0, 2.0])), np.array([500.0, -20, 90]))
    poses[:, :3, 3] *= scale
    return replace(rig, cam_from_rig=poses)


def test_whose_frame_a_rig_has_makes_no_difference() -> None:
    """The same rig in another frame differs by nothing, and order of the cameras does not matter."""
    rig = ring()
    other = placed_anew(rig)
    other = replace(other, names=other.names[::-1], cameras=other.cameras[::-1], cam_from_rig=other.cam_from_rig[::-1])
    found = compare_rigs(rig, other)
    assert found.cameras == rig.names
    assert max(one.place_mm + one.turn_rad for one in found.pairs) < 1e-9
    assert found.placed is not None
    assert found.placed.max_mm < 1e-6
    assert all(one.max_px < 1e-6 for one in found.placed.cameras)


def test_a_scale_is_told_as_such() -> None:
    """Of a rig whose target was 1 % too long: baselines, and the points that both place, are 1 % apart."""
    rig = stereo()
    found = compare_rigs(rig, placed_anew(rig, 1.01))
    assert found.placed is not None
    assert found.placed.scale == pytest.approx(0.01, rel=1e-6)
    (pair,) = found.pairs
    assert pair.baseline_mm[1] / pair.baseline_mm[0] == pytest.approx(1.01)
    assert pair.turn_rad < 1e-12


def test_a_turned_camera_is_told_in_its_pair_and_in_pixels() -> None:
    """A camera turned by .1 degrees: the pairs with it turn, the others do not, and pixels are apart."""
    rig = ring()
    turned = rig.cam_from_rig.copy()
    turned[2] = make_pose(exp_rotation(np.array([0.0, np.radians(0.1), 0])), np.zeros(3)) @ turned[2]
    found = compare_rigs(rig, replace(rig, cam_from_rig=turned))
    turns = {(one.a, one.b): np.degrees(one.turn_rad) for one in found.pairs}
    assert turns == pytest.approx({("cam a", "cam b"): 0, ("cam a", "cam c"): 0.1, ("cam b", "cam c"): 0.1})
    assert found.placed is not None
    assert 0.2 < max(one.rms_px for one in found.placed.cameras) < 900 * np.radians(0.1)


def test_sigmas_are_those_of_both() -> None:
    """Of independent rigs the variances of a baseline add; of one that does not know, nothing is told."""
    rig = stereo()
    known = replace(rig, covariance=np.diag([*[1e-12] * 9, *[0] * 6, *[1e-12] * 9, *[0] * 3, 0.09, 0.09, 0.09]))
    assert compare_rigs(known, known).pairs[0].baseline_sigma_mm == pytest.approx(0.3 * np.sqrt(2))
    assert np.isnan(compare_rigs(known, rig).pairs[0].baseline_sigma_mm)


def test_cameras_of_other_names_and_sizes_are_refused() -> None:
    """Which they are is said; those of one rig alone are named."""
    rig = ring()
    found = compare_rigs(rig, replace(rig, names=("cam a", "cam b", "other")))
    assert found.only == (("cam c",), ("other",))
    with pytest.raises(InputError, match="of cameras left, right and cam a, cam b, cam c not two have the same names"):
        compare_rigs(stereo(), rig)
    smaller = tuple(replace(one, image_size=(640, 480)) for one in stereo().cameras)
    with pytest.raises(InputError, match="camera left: has images of 1024 x 768 px and 640 x 480 px"):
        compare_rigs(stereo(), replace(stereo(), cameras=smaller))


def test_cameras_that_see_nothing_together_are_compared_by_their_places() -> None:
    """Back to back: pairs are told, and nothing in space."""
    pair = stereo()
    apart = replace(
        pair, cam_from_rig=np.stack([np.eye(4), make_pose(exp_rotation(np.array([0, np.pi, 0])), np.zeros(3))])
    )
    found = compare_rigs(apart, apart)
    assert found.placed is None
    assert found.pairs[0].place_mm == 0


def test_the_command_tells_rigs_from_cameras(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Two rigs are compared, whatever files they come from; a rig and a camera, or options of cameras, are refused."""
    monkeypatch.chdir(tmp_path)
    stereo().save("a.json")
    stereo().cameras[0].save("camera.json")
    assert calib("convert", "a.json", "--to", "kalibr", "-o", "b.yaml").code == 0
    answer = calib("diff", "a.json", "b.yaml", "--json")
    told = json.loads(answer.out)["answer"]
    assert told["placed"]["rms_mm"] < 1e-6
    assert told["pairs"][0]["baseline_sigma_mm"] is None
    assert "left - right" in calib("diff", "a.json", "b.yaml").out
    for words, rule in (
        (("a.json", "camera.json"), "a.json: is a rig, camera.json none; name one of its cameras, as in a.json#left"),
        (("a.json", "b.yaml", "--radius", "9"), "--radius and --picture are of two cameras"),
    ):
        answer = calib("diff", *words)
        assert answer.code == 2
        assert rule in answer.err
    assert calib("diff", "a.json#left", "camera.json").code == 0
