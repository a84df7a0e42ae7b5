"""Cameras that OpenCV reads, and folders that photos come to."""

import time
from collections.abc import Callable
from pathlib import Path

import cv2
import numpy as np
import pytest

from calib.app.live import live, live_rig
from calib.capture import sources
from calib.capture.sources import Frame, OpenCVCamera, WatchedFolder
from designer.base.errors import InputError
from tests.support import ring_views
from tests.support.waiting import wait_until


class Heard:
    """What a source handed on and said."""

    def __init__(self) -> None:
        self.frames: list[Frame] = []
        self.said: list[str] = []

    def wait(self, is_so: Callable[[], bool]) -> None:
        """Wait until something is so."""
        wait_until(is_so)


@pytest.fixture(autouse=True)
def quick(monkeypatch: pytest.MonkeyPatch) -> None:
    """Folders are looked at often, and given up soon."""
    monkeypatch.setattr(sources, "LOOK_S", 0.02)
    monkeypatch.setattr(sources, "GIVEN_UP_S", 0.3)


def test_a_video_is_played_and_its_end_is_said(tmp_path: Path) -> None:
    """Its frames come in order, with the times of its own speed; there is a word at the end."""
    path = tmp_path / "walk.avi"
    video = cv2.VideoWriter(str(path), cv2.VideoWriter_fourcc(*"MJPG"), 50.0, (64, 48))
    for level in range(0, 250, 25):
        video.write(np.full((48, 64, 3), level, np.uint8))
    video.release()
    heard, source = Heard(), OpenCVCamera(str(path))
    source.start(0, heard.frames.append, heard.said.append)
    heard.wait(lambda: len(heard.said) == 2)
    source.stop()
    assert [round(float(frame.pixels.mean()) / 25) for frame in heard.frames] == list(range(10))
    assert [frame.time_s for frame in heard.frames] == pytest.approx([0.02 * number for number in range(10)])
    assert heard.said == ["", "walk.avi: the video has ended; finish, or give a longer one"]


def test_a_camera_that_is_not_there_is_named() -> None:
    """One line says what to check; a file that is not there is refused before anything begins."""
    heard, source = Heard(), OpenCVCamera("97")
    source.start(0, heard.frames.append, heard.said.append)
    heard.wait(lambda: bool(heard.said))
    source.stop()
    assert heard.said[0].startswith("camera 97: cannot be opened; check that it is plugged in")
    with pytest.raises(InputError, match="no such file; give a number"):
        OpenCVCamera("none.mp4")


def test_nobody_reads_the_password_of_a_camera() -> None:
    """What a network camera is called on pages and in files holds no secret."""
    assert OpenCVCamera("rtsp://me:secret@10.0.0.7/live").name == "rtsp://10.0.0.7/live"


def test_a_photo_is_read_once_and_when_it_is_whole(tmp_path: Path) -> None:
    """Half of a file waits; the whole one is read, once, and stays as it is."""
    packed = cv2.imencode(".png", np.random.default_rng(1).integers(0, 255, (60, 80)).astype(np.uint8))[1].tobytes()
    heard, source = Heard(), WatchedFolder(tmp_path)
    (tmp_path / "notes.txt").write_text("no photo")
    path = tmp_path / "a 1.png"
    path.write_bytes(packed[:700])
    source.start(0, heard.frames.append, heard.said.append)
    time.sleep(0.15)
    assert not heard.frames
    path.write_bytes(packed)
    heard.wait(lambda: len(heard.frames) == 1)
    (tmp_path / "b.png").write_bytes(packed)
    heard.wait(lambda: len(heard.frames) == 2)
    time.sleep(0.1)
    source.stop()
    assert [frame.file for frame in heard.frames] == [path, tmp_path / "b.png"]
    assert path.read_bytes() == packed


def test_a_link_to_a_photo_is_not_another_photo(tmp_path: Path) -> None:
    """Whatever its name, symbolic or hard: it is named, and left out; a copy is a file of its own."""
    packed = cv2.imencode(".png", np.zeros((60, 80), np.uint8))[1].tobytes()
    heard, source = Heard(), WatchedFolder(tmp_path)
    (tmp_path / "a.png").write_bytes(packed)
    (tmp_path / "b.png").symlink_to("a.png")
    (tmp_path / "c.png").hardlink_to(tmp_path / "a.png")
    (tmp_path / "d.png").write_bytes(packed)
    source.start(0, heard.frames.append, heard.said.append)
    heard.wait(lambda: len(heard.frames) == 2 and len(heard.said) == 1)
    source.stop()
    assert [frame.file.name for frame in heard.frames] == ["a.png", "d.png"]
    assert heard.said == ["c.png: is a.png once more; it is left out; so are b.png"]


def test_a_file_that_stays_broken_is_named(tmp_path: Path) -> None:
    """After a while one line says which, all of them; when one is mended it is read, and the line taken back."""
    packed = cv2.imencode(".png", np.zeros((60, 80), np.uint8))[1].tobytes()
    heard, source = Heard(), WatchedFolder(tmp_path)
    path = tmp_path / "a.png"
    path.write_bytes(packed[:60])
    source.start(0, heard.frames.append, heard.said.append)
    heard.wait(lambda: bool(heard.said))
    assert "a.png" in heard.said[0]
    assert heard.said[0].endswith("it is left out")
    (tmp_path / "b.png").write_bytes(b"")
    heard.wait(lambda: "b.png" in heard.said[-1])
    assert heard.said[-1].endswith("it is left out; so are a.png")
    for number in range(8):
        (tmp_path / f"c{number}.png").write_bytes(b"")
    heard.wait(lambda: all(path.name in heard.said[-1] for path in tmp_path.iterdir()))
    for path_there in tmp_path.glob("[bc]*.png"):
        path_there.unlink()
    heard.wait(lambda: heard.said[-1].endswith("it is left out"))
    assert "a.png" in heard.said[-1]
    path.write_bytes(packed)
    heard.wait(lambda: len(heard.frames) == 1 and heard.said[-1] == "")
    source.stop()


def test_a_folder_that_goes_and_comes_back(tmp_path: Path) -> None:
    """That it is gone is said once; what comes to it later is read."""
    folder = tmp_path / "incoming"
    folder.mkdir()
    heard, source = Heard(), WatchedFolder(folder)
    source.start(0, heard.frames.append, heard.said.append)
    folder.rmdir()
    heard.wait(lambda: heard.said == ["incoming: the folder is gone; make it again, or finish with the photos so far"])
    folder.mkdir()
    (folder / "a.png").write_bytes(cv2.imencode(".png", np.zeros((60, 80), np.uint8))[1].tobytes())
    heard.wait(lambda: len(heard.frames) == 1 and heard.said[-1] == "")
    source.stop()
    with pytest.raises(InputError, match="no such folder"):
        WatchedFolder(tmp_path / "none")


@pytest.mark.parametrize("watched", ["camera", "camera/photos", "link"])
def test_folders_of_results_are_not_watched(watched: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Its pictures would be taken for photos: refused before anything is written, for one camera and for a rig."""
    monkeypatch.chdir(tmp_path)
    Path("camera/photos").mkdir(parents=True)
    Path("link").symlink_to("camera")
    Path("other").mkdir()
    with pytest.raises(InputError, match=f"--watch {watched}: results are written to camera"):
        live(ring_views.board(), "camera", watch=watched)
    with pytest.raises(InputError, match=f"--watch {watched}: results are written to camera"):
        live_rig(ring_views.board(), "camera", watch=["other", watched])
    assert not list(Path().rglob("*.json"))
