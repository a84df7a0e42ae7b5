"""`calib render --rig`, and photos of rigs on disk."""

import csv
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from calib.app.inputs import load_rig
from calib.app.render import render_rig
from calib.cameras.camera import Camera
from calib.cameras.rig import Rig
from calib.cli import app
from calib.core.se3 import make_pose
from calib.renderer.truth import RIG_TRUTH, TRUTH
from designer.base.errors import InputError
from designer.kinds.layout import lay_out
from designer.target import target_to_json
from tests.support.command_line import instead
from tests.support.designs import small_board

SMALL = Camera("pinhole", np.array([150.0, 150, 79.5, 59.5]), (160, 120))
PAIR = Rig(("left", "right"), (SMALL, SMALL), make_pose(np.eye(3), np.array([[0.0, 0, 0], [-50, 0, 0]])))


@pytest.fixture
def folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A board's file and a rig's, where commands work."""
    monkeypatch.chdir(tmp_path)
    Path("board.target.json").write_text(target_to_json(lay_out(small_board().job.target)), encoding="utf-8")
    PAIR.save("pair.json")
    return tmp_path


def render(*words: str) -> None:
    """`calib render` of three frames into `out`."""
    usual = ["render", "board.target.json", "-o", "out", "--frames", "3", "--jobs", "1"]
    app()(list(map(str, instead(usual, words))), standalone_mode=False)


def test_each_camera_has_a_folder_and_the_truth_joins_them(folder: Path) -> None:
    """Where a camera stood in a photo is where it stands in the rig, and how the target was held in that frame."""
    render("--rig", "pair.json", "--distance", "120..200mm")
    rig, truth = load_rig("out/rig.json"), RIG_TRUTH.read(Path("out/truth.json"))
    assert np.array_equal(rig.cam_from_rig, PAIR.cam_from_rig)
    assert rig.delay_s is None
    for name, cam_from_rig in zip(rig.names, rig.cam_from_rig, strict=True):
        photos = TRUTH.read(Path("out", name, "truth.json"))
        assert sorted(path.name for path in Path("out", name).glob("view*")) == [f"view_000{n}.png" for n in range(3)]
        for view, frame in zip(photos.views, truth.frames, strict=True):
            assert Path(view.file).stem == frame.name
            assert np.allclose(view.cam_from_target, cam_from_rig @ frame.rig_from_target, atol=1e-9)
    with Path("out/photos.csv").open() as stream:
        rows = list(csv.DictReader(stream))
    assert [(row["camera"], row["frame"]) for row in rows][3:5] == [("right", "view_0000"), ("right", "view_0001")]
    assert all(Path("out", row["file"]).is_file() and "time_s" not in row for row in rows)


def test_cameras_that_are_not_synchronous_see_the_target_at_their_own_times(folder: Path) -> None:
    """A photo that is stamped t shows the target at t - delay; the first camera's clock is the rig's."""
    photos = render_rig(
        "board.target.json", replace(PAIR, delay_s=None), frames=40, unsynchronised_s=0.05, distance_mm=200
    )
    delay_s = photos.rig.delay_s
    assert delay_s is not None
    assert photos.held.stamp_s is not None
    assert photos.held.time_s is not None
    assert delay_s[0] == 0
    assert 0 < abs(delay_s[1]) <= 0.05
    assert 0 < np.abs(photos.held.stamp_s - photos.held.time_s).max() <= 0.005
    cam_from_target = np.array([one.cam_from_target for one in photos.of.values()])
    rig_from_target = np.linalg.inv(photos.rig.cam_from_rig)[:, None] @ cam_from_target
    velocity = np.gradient(photos.rig_from_target[:, :3, 3], photos.held.time_s, axis=0)
    late_s = photos.held.time_s - (photos.held.stamp_s - delay_s[:, None])
    expected = photos.rig_from_target[:, :3, 3] - late_s[..., None] * velocity
    assert np.linalg.norm(rig_from_target[..., :3, 3] - expected, axis=-1)[:, 1:-1].max() < 0.25
    assert np.linalg.norm(velocity, axis=1).max() * 0.05 > 1  # mm: what is to be seen of a delay


def test_a_broken_run_goes_on_and_another_set_is_not_touched(folder: Path) -> None:
    """What is there is kept; photos of another rig are refused before anything is written."""
    words = ["--rig", "pair.json", "--distance", "150mm"]
    render(*words)
    whole = {path: path.read_bytes() for path in Path("out").rglob("view*")}
    Path("out/right/view_0001.png").unlink()
    Path("out/left/view_0002.png").write_bytes(b"kept")
    render(*words)
    assert Path("out/right/view_0001.png").read_bytes() == whole[Path("out/right/view_0001.png")]
    assert Path("out/left/view_0002.png").read_bytes() == b"kept"
    before = {path: path.read_bytes() for path in Path("out").rglob("*") if path.is_file()}
    with pytest.raises(InputError, match="another set of photos"):
        render(*words, "--seed", "5")
    replace(PAIR, names=("left", "middle")).save("other.json")
    with pytest.raises(InputError, match="'right' is none of this rig's"):
        render("--rig", "other.json", "--distance", "150mm", "--overwrite")
    assert before == {path: path.read_bytes() for path in Path("out").rglob("*") if path.is_file()}


@pytest.mark.parametrize(
    ("words", "message"),
    [
        (["--rig", "pair.json"], "add --distance"),
        (["--rig", "stereo-pair", "--views", "3"], "--views: does not go with --rig"),
        (["--rig", "stereo-pair", "--aim-offset", "3mm"], "--aim-offset: does not go with --rig"),
        (["--rig", "stereo-pair", "--unsynchronised", "30"], "must be from 0s to 1s"),
        (["--rig", "stereo-pair", "--unsynchronised", "-30ms"], "must be from 0s to 1s"),
        (["--unsynchronised", "30ms"], "--frames: goes with --rig only"),
        (["--rig", "stereo-pair", "--frames", "0"], "--frames 0"),
        (["--rig", "stereo-pair", "--distance", "20mm"], "hold it farther away"),
    ],
)
def test_bad_values_are_refused(words: list[str], message: str, folder: Path) -> None:
    """In one line, before anything is written."""
    with pytest.raises(InputError) as caught:
        render(*words)
    assert message in str(caught.value)
    assert "\n" not in str(caught.value)
    assert not Path("out").exists()
