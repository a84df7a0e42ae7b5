"""Photos on a command line, of every command that takes them: what is left out is named, what is there is used."""

import os
import re
from pathlib import Path

import cv2
import numpy as np
import pytest

from tests.laws.test_exit_codes import LENIENT, folder
from tests.support.command_line import calib, summary_of
from tests.support.command_scene import PHOTOS

__all__ = ["folder"]  # the scene that the commands work in
COMMANDS = {
    "detect": ("detect", "board.target.json", "-o", "out/d.csv", "--overlay", "photos"),
    "run": ("run", "board.target.json", "--model", "opencv", "-o", "photos", *LENIENT),
    "pose": ("pose", "board.target.json", "camera.json", "-o", "poses.json", "--overlay", "photos"),
    "undistort": ("undistort", "camera.json", "-o", "photos"),
}
WITH_A_CAMERA = ("pose", "undistort")
each_command = pytest.mark.parametrize("name", COMMANDS)
IN_THE_FOLDER = {
    "photos/cut.png": "is cut off", "photos/text.jpg": "is not an image", "photos/pipe.png": "is a pipe"
}  # fmt: skip
NAMED = {"missing.png": "cannot be read", "none-*.png": "no file matches", "empty": "no images"}


@each_command
@pytest.mark.parametrize("bad", [IN_THE_FOLDER, NAMED], ids=["in the folder", "named"])
def test_photos_that_cannot_be_used_are_named_and_the_others_are(name: str, bad: dict[str, str]) -> None:
    """Cut off, no image, gone, a pipe, another camera's, a pattern or a folder of nothing: each in one line, once."""
    said, named = dict(bad), [path for path in bad if not path.startswith("photos/") or "pipe" in path]
    if bad is IN_THE_FOLDER:
        Path("photos/cut.png").write_bytes(Path("photos/view_0000.png").read_bytes()[:60])
        Path("photos/text.jpg").write_text("hello")
        os.mkfifo("photos/pipe.png")
    else:
        if name in WITH_A_CAMERA:
            cv2.imwrite("photos/large.png", np.zeros((640, 480), np.uint8))
            said["photos/large.png"] = "has 480 x 640 px, but the camera is of one with 320 x 240 px"
        Path("broken.mp4").write_bytes(b"#EXTM3U\nframe.ts\n")
        said["broken.mp4"], named = "is (a|no) video", [*named, "broken.mp4"]
    Path("empty").mkdir()
    answer = calib(*COMMANDS[name], "photos", *named)
    assert answer.code == 0, answer
    for path, why in said.items():
        lines = re.findall(rf"^\w+ +[A-Z][a-z ]+: {re.escape(path)}: {why}", answer.out, re.MULTILINE)
        assert len(lines) == 1, (path, answer.out)
    assert not list(Path().rglob(".unfinished*"))


@each_command
def test_nothing_to_read_is_bad_input(name: str) -> None:
    """The first is named with how many more, and nothing is written: no folder, no overlay."""
    before = sorted(Path().rglob("*"))
    answer = calib(*COMMANDS[name], "missing.png", "other.png")
    assert (answer.code, answer.out, answer.err.count("\n")) == (2, "", 1), answer
    assert "missing.png: cannot be read" in answer.err
    assert "and 1 more" in answer.err
    assert sorted(Path().rglob("*")) == before


@each_command
@pytest.mark.parametrize("again", ["photos", "photos/*.*g"])
def test_what_is_drawn_beside_photos_is_never_taken_for_one(name: str, again: str) -> None:
    """A second run over a folder of photos and of what the first left there takes the photos alone."""
    first, second = (summary_of(calib(*COMMANDS[name], photos, "--json")) for photos in ("photos", again))
    assert second["wrote"] == first["wrote"]
    assert second["answer"].get("without_pose") == first["answer"].get("without_pose")
    assert sum("view_" in path for path in second["wrote"]) == len(PHOTOS)


@pytest.mark.parametrize(("name", "patched"), [
    ("detect", "calib.detector.overlay.draw_overlay"), ("pose", "calib.draw.pose_overlay.draw_pose"),
    ("run", "calib.detector.overlay.draw_overlay"),
])  # fmt: skip
def test_one_broken_picture_does_not_stop_the_others(name: str, patched: str, monkeypatch: pytest.MonkeyPatch) -> None:
    """Whatever breaks in drawing, what was found is written, and the other photos have their overlays."""
    calls: list[int] = []

    def draw(pixels: np.ndarray, *_: object) -> np.ndarray:
        calls.append(1)
        if len(calls) == 1:
            raise ZeroDivisionError("flat")
        return np.zeros((4, 4, 3), np.uint8)

    monkeypatch.setattr(patched, draw)
    answer = calib(*COMMANDS[name], "photos")
    assert (answer.code, answer.err) == (0, "")
    assert sum("no overlay for view_" in line for line in answer.out.splitlines()) == 1
    assert "ZeroDivisionError: flat" in answer.out
    assert len(list(Path("photos").rglob("*.overlay.jpg"))) == len(PHOTOS) - 1
