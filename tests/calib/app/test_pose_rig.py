"""`calib pose --rig`: from folders of photos to poses in the rig's frame, their files, pictures and page."""

import json
from collections.abc import Iterator
from dataclasses import replace
from functools import cache
from pathlib import Path

import cv2
import numpy as np
import pytest

import calib
from calib.core.types import Detections
from calib.observe.observations import known_points
from calib.rigs.target_poses import RIG_POSES
from designer.target import target_to_json
from tests.support.calibrations import board
from tests.support.command_line import calib as command
from tests.support.command_line import detections_of, detector_of, files_in, rows_of_csv, summary_of
from tests.support.rig_views import SIZE, RigScene, solved_slowly, stereo_pair

BOARD = board()
FRAMES = 3
POSE = ("pose", "--rig", "rig.json", "board.target.json")


@cache
def scene() -> RigScene:
    """Two cameras and a board."""
    return stereo_pair(known_points(BOARD), frames=FRAMES, noise_px=0.05)


@cache
def known_rig() -> calib.Rig:
    """The rig that these show."""
    return solved_slowly(scene(), steps=1).rig


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Path]:
    """Blank photos, a folder a camera, and a detector that knows by their names what they show.

    The left camera misses the first frame, and no camera sees the target in the last.
    """
    place = tmp_path_factory.mktemp("posed")
    known: dict[str, Detections] = {}
    for name, seen in zip(scene().observations.camera_names, scene().observations.sightings, strict=True):
        (place / name).mkdir()
        named = replace(seen, view_names=tuple(f"{name}_{view}.png" for view in range(seen.view_count)))
        for one in detections_of(named, BOARD):
            known[one.image] = one if one.image != "left_0.png" else one.keep(slice(0))
            cv2.imwrite(str(place / name / one.image), np.full(SIZE[::-1], 90, np.uint8))
        cv2.imwrite(str(place / name / f"{name}_99.png"), np.full(SIZE[::-1], 90, np.uint8))

    (place / "board.target.json").write_text(target_to_json(BOARD))
    known_rig().save(place / "rig.json")
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr("calib.detector.pipeline.detect", detector_of(known, "no grid of rings was found"))
        patch.chdir(place)
        yield place


def test_the_target_is_found_in_the_rigs_frame(folder: Path) -> None:
    """Within what is stated, also where one camera misses it; the file, the answer and Python tell the same."""
    answer = summary_of(command(*POSE, "left", "right", "-o", "poses.json", "--json"))["answer"]
    found = calib.pose(BOARD, photos=["left", "right"], rig=known_rig())
    stored = RIG_POSES.read(folder / "poses.json")
    assert [one.frame for one in stored.frames] == [str(number) for number in range(FRAMES)]
    assert [one.frame for one in stored.failed] == ["99"]
    assert stored.failed[0].reason.startswith("no camera shows the target; left: no ")
    assert [len(one.cameras) for one in stored.frames] == [1, 2, 2]
    for one, mine, told, true in zip(stored.frames, found.poses, answer["poses"], scene().rig_from_target, strict=True):
        np.testing.assert_array_equal(one.rig_from_target, mine.rig_from_target)
        assert told["rig_from_target"] == one.rig_from_target.tolist()
        off = one.target_mm - true[:3, 3]
        assert off @ np.linalg.solve(one.covariance[3:, 3:], off) < 30
        assert (np.linalg.eigvalsh(one.covariance - one.noise_covariance) > -1e-12).all()
        left_over = [camera.rms_px for camera in one.cameras]
        assert one.rms_px == pytest.approx(np.sqrt(np.mean(np.square(left_over))), rel=0.1)


def test_the_table_and_the_pictures_tell_the_same(folder: Path) -> None:
    """A line a frame, with each camera's residuals; a picture a photo that shows the target, and their page."""
    answer = command(*POSE, ".", "-o", "poses.csv", "--overlay", "seen")
    assert answer.code == 0, answer.err
    rows = rows_of_csv(Path("poses.csv"))
    found = calib.pose(BOARD, photos=folder, rig="rig.json")
    assert [float(row["x_mm"]) for row in rows] == [one.target_mm[0] for one in found.poses]
    assert (rows[0]["rings_left"], rows[0]["rms_px_left"]) == ("0", "")
    assert float(rows[1]["rms_px_left"]) == found.poses[1].cameras[0].rms_px
    pictures = {f"{name}/{name}_{frame}.pose.overlay.jpg" for name in ("left", "right") for frame in range(FRAMES)}
    assert files_in(folder / "seen") - {"index.html", "page.json"} == pictures - {"left/left_0.pose.overlay.jpg"}
    assert "placed to" in (folder / "seen" / "index.html").read_text()
    assert json.loads((folder / "seen" / "page.json").read_text())["kind"] == "poses"


@pytest.mark.parametrize(
    ("words", "said"),
    [
        ((*POSE, "other/lefty", "right"), "camera 'lefty': not in the rig; did you mean 'left'?"),
        ((*POSE, "left"), "one folder of images; give a folder a camera, named as in the rig (one camera alone"),
        ((*POSE, "left", "right", "-o", "rig.json"), "is there already, and a file of ringsolid's of another kind"),
        ((*POSE, "left", "right", "-o", "poses.txt"), "poses are a .json or a .csv file"),
        (("pose", "board.target.json", "rig.json#left"), "no photos; give images, folders of images, or patterns"),
    ],
)
def test_what_cannot_be_is_refused_in_a_line(folder: Path, words: tuple[str, ...], said: str) -> None:
    """With the value, the rule and what to do; nothing is written."""
    (folder / "other" / "lefty").mkdir(parents=True, exist_ok=True)
    cv2.imwrite(str(folder / "other" / "lefty" / "lefty_1.png"), np.full(SIZE[::-1], 90, np.uint8))
    before = files_in(folder)
    answer = command(*words)
    assert answer.code == 2
    assert said in answer.err
    assert answer.err.count("\n") == 1
    assert files_in(folder) == before


def test_without_a_pose_the_answer_is_negative(folder: Path) -> None:
    """Photos that show nothing: the frame and the reason are told, and the exit code is 1."""
    for name in ("left", "right"):
        (folder / "blank" / name).mkdir(parents=True)
        cv2.imwrite(str(folder / "blank" / name / "x_99.png"), np.full(SIZE[::-1], 90, np.uint8))
    answer = command(*POSE, "blank")
    assert answer.code == 1
    assert "99: no camera shows the target" in answer.out
    assert "keeps the poses" not in answer.out
    assert "residuals in the usual frame" not in answer.out


def test_a_camera_and_a_rig_are_not_both_given() -> None:
    """A rig has its own cameras."""
    with pytest.raises(calib.InputError, match="give one of them"):
        calib.pose(BOARD, known_rig().cameras[0], "left", rig=known_rig())  # type: ignore[call-overload]
