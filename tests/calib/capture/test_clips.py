"""Photos from clips: which frames are taken, and what of a broken clip is said."""

import subprocess
import sys
import wave
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import numpy as np
import pytest

import calib
from calib.app.inputs import photos_of
from calib.capture import clips
from calib.capture.clips import clips_of_rig, photos_of_clip
from calib.core.se3 import exp_rotation, make_pose
from calib.images.video import Clip, frames_of, open_clip
from calib.judge.information import image_goal, knowledge_of
from calib.observe.rig_search import rig_input
from calib.observe.search import PhotoSearch
from designer.base.arrays import Array
from designer.base.errors import InputError
from designer.page.progress import unheard
from tests.support.calibrations import board, camera, poses_around
from tests.support.clips import RATE_HZ, moved, write_clip

BOARD = board(6, 5, "14mm")
CAMERA = camera("opencv", (480, 360), 520.0)
POSES = moved(poses_around(8, np.random.default_rng(1), half_angle_rad=0.5, distance_mm=170.0))


@pytest.fixture(scope="module")
def clip(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A board that stands at eight views, and is moved between them."""
    path = tmp_path_factory.mktemp("clips") / "clip.avi"
    write_clip(path, BOARD, CAMERA, POSES)
    return path


def stand_of(number: int) -> int:
    """Which time the target stands still in a frame; -1: it moves."""
    is_moving = (np.diff(POSES, axis=0) != 0).any(axis=(1, 2))
    if is_moving[max(number - 1, 0) : number + 1].any():
        return -1
    return int(is_moving[:number].sum())


def test_frames_are_taken_where_the_target_stands_still_one_a_view(clip: Path) -> None:
    """Each with its number as its name and its time, read when it is searched, and all of them show the target."""
    found = photos_of_clip(clip, BOARD, unheard)
    numbers = [int(one.path.name.removeprefix("clip-")) for one in found.photos]
    assert len(numbers) == 8
    assert len({stand_of(number) for number in numbers} - {-1}) == 8
    np.testing.assert_allclose([one.time_s for one in found.photos], np.array(numbers) / RATE_HZ, atol=1e-6)
    assert found.remarks[0].startswith(f"{clip}: 8 frames of {len(POSES)} compared: sharp and still")
    seen = PhotoSearch(BOARD, found).once().with_target
    assert len(seen) == 8
    assert all(one.remarks[0].startswith("frames of a clip are compressed") for one in seen)


def test_a_run_of_a_clip_keeps_its_frames_and_is_the_same_of_them(clip: Path, tmp_path: Path) -> None:
    """The folder of frames gives the camera again, without the clip; the records have the times."""
    first = calib.run(BOARD, clip, model="opencv", made="exact", out=tmp_path / "run")
    again = calib.run(BOARD, tmp_path / "run" / "frames", model="opencv", made="exact")
    np.testing.assert_allclose(again.best.camera.params, first.best.camera.params, rtol=1e-9)
    times = [one.photo.time_s for one in first.search.results]
    assert None not in times
    assert times == sorted(times)


def test_of_many_views_those_are_taken_that_tell_most(clip: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Fewer are taken than there are, and the camera is surer by them than by as many others."""
    monkeypatch.setattr(clips, "MOST_TAKEN", 4)
    monkeypatch.setattr(clips, "FEWEST_TAKEN", 4)
    taken = photos_of_clip(clip, BOARD, unheard)
    monkeypatch.undo()
    every = photos_of_clip(clip, BOARD, unheard)
    others = tuple(one for one in every.photos if one.path not in taken.paths)
    assert len(taken.photos) == len(others) == 4

    def sigma_px(photos: object) -> float:
        seen = PhotoSearch(BOARD, photos).once().with_target
        known = knowledge_of(calib.solve(seen, BOARD, model="opencv", made="exact").best.calibration)
        return image_goal(known).within_px(np.eye(known.basis.shape[1]))

    assert sigma_px(taken) < sigma_px(type(taken)(others))


def test_what_a_clip_that_is_cut_off_has_left_is_used_and_the_loss_is_named(clip: Path, tmp_path: Path) -> None:
    """Half of the file: the views of that half."""
    cut = tmp_path / "cut.avi"
    cut.write_bytes(clip.read_bytes()[: clip.stat().st_size // 2])
    found = photos_of_clip(cut, BOARD, unheard)
    assert 3 <= len(found.photos) <= 5
    assert f"of {len(POSES)} frames: the file is cut off or damaged" in found.remarks[0]


def test_what_is_no_clip_is_refused_in_a_line(clip: Path, tmp_path: Path) -> None:
    """Text, sound alone, a playlist of other files, a header without frames: no decoder's word on the screen."""
    with wave.open(str(tmp_path / "sound.avi"), "wb") as sound:
        sound.setparams((1, 2, 8000, 0, "NONE", ""))
        sound.writeframes(bytes(8000))
    (tmp_path / "list.mp4").write_text(f"#EXTM3U\n#EXTINF:1,\n{clip}\n#EXT-X-ENDLIST\n")
    (tmp_path / "head.mp4").write_bytes(b"\0\0\0\x18ftypisom\0\0\2\0isomiso2" + bytes(2000))
    (tmp_path / "short.avi").write_bytes(clip.read_bytes()[:900])
    names = ("sound.avi", "list.mp4", "head.mp4", "short.avi", "none.mp4")
    opened = "import sys\nfrom pathlib import Path\nfrom calib.images.video import frames_of, open_clip\n"
    opened += "for one in sys.argv[1:]:\n try: list(frames_of(open_clip(Path(one)), lambda *_: True))\n"
    opened += " except ValueError as error: print(error)\n"
    done = subprocess.run(  # a process that has not decoded anything before
        [sys.executable, "-c", opened, *names], cwd=tmp_path, capture_output=True, text=True, check=True
    )
    assert done.stderr == ""
    lines = done.stdout.splitlines()
    assert len(lines) == len(names)
    for name, line in zip(names, lines, strict=True):
        assert line.startswith(f"{name}: "), line
        assert "video" in line or "no frame" in line
    found = photos_of([clip, tmp_path / "list.mp4"], target=BOARD)
    assert (len(found.failures), len(found.photos)) == (1, 8)


def test_times_that_go_back_are_counted_instead(monkeypatch: pytest.MonkeyPatch) -> None:
    """And said; those of a varying rate are taken as they are."""

    class Video:
        def __init__(self, times_ms: list[float]) -> None:
            self.times_ms = iter(times_ms)

        def grab(self) -> bool:
            self.now = next(self.times_ms, None)
            return self.now is not None

        def get(self, _: int) -> float:
            return float(self.now)

        def retrieve(self) -> tuple[bool, Array]:
            return True, np.zeros((4, 6), np.uint8)

    for times_ms, seen_s, lines in (
        ([0, 20, 90, 100], [0, 0.02, 0.09, 0.1], 0), ([0, 100, 50, 60], [0, 0.1, 0.2, 0.3], 1),
    ):  # fmt: skip

        @contextmanager
        def capture(_: Path, times_ms: list[float] = times_ms) -> Iterator[Video]:
            yield Video(times_ms)

        monkeypatch.setattr("calib.images.video._capture", capture)
        told: list[str] = []
        frames = list(frames_of(Clip(Path("c.mp4"), (6, 4), 10.0, 4, 0), lambda *_: True, told))
        np.testing.assert_allclose([one.time_s for one in frames], seen_s)
        assert len(told) == lines


def test_clips_of_two_cameras_are_set_to_one_clock(clip: Path, tmp_path: Path) -> None:
    """By when things move in both, or as a table says; each frame is of one moment, in which the target stands."""
    left_from_right = make_pose(exp_rotation(np.array([0.0, 0.2, 0.0])), np.array([40.0, 0.0, 5.0]))
    write_clip(tmp_path / "right.avi", BOARD, CAMERA, left_from_right @ POSES[9:])
    (tmp_path / "left.avi").symlink_to(clip)
    files = [tmp_path / "left.avi", tmp_path / "right.avi"]
    for start_s, said in ((None, "right begins 0.9"), (100.9, "left.avi: "), (100.8997, "left.avi: ")):
        times = None if start_s is None else tmp_path / "times.csv"
        if times:
            times.write_text(f"camera,file,time_s\nleft,left.avi,100\nright,right.avi,{start_s}\n")
        found = clips_of_rig(rig_input(files, times=times), BOARD, unheard)
        assert found is not None
        assert said in found.remarks[0]
        both = [one for one in found.frame_names if sum(photo.frame == one for photo in found.photos) == 2]
        assert len(both) >= 6
        for frame in both:
            left, right = (int(one.path.name[-5:]) for one in found.photos if one.frame == frame)
            assert left == right + 9
            assert stand_of(left) >= 0
    with pytest.raises(InputError, match="one clip; give a clip a camera"):
        clips_of_rig(rig_input(files[:1]), BOARD, unheard)


def test_a_clip_states_its_size_and_rate(clip: Path) -> None:
    """As it was written."""
    found = open_clip(clip)
    assert (found.image_size, found.rate_hz, found.stated_frames) == ((480, 360), RATE_HZ, len(POSES))
