"""A session with two cameras, without threads and sockets."""

from dataclasses import dataclass, field
from pathlib import Path

import cv2
import numpy as np
import pytest
from numpy.typing import NDArray

from calib.app.live import live_rig
from calib.capture.messages import LookMessage, Message, NoticeMessage, PageCommand, TakenMessage
from calib.capture.photo_folder import PhotoFolder
from calib.capture.session import Session
from calib.capture.sources import BrowserCamera, Frame, own_moment, sources_of
from calib.core.se3 import look_at, make_pose
from calib.images.photo import read_image
from calib.judge.rig_guide import RigGuide
from designer.base.errors import InputError
from tests.support.live_frames import image_at, target

LIMITS = str(Path(__file__).parents[2] / "support/lenient.toml")
NAMES = ("left", "right")
EYES = look_at(np.array([[-60.0, 0, 0], [60.0, 0, 0]]), np.tile([0.0, 300.0, 0.0], (2, 1)))
Images = tuple[NDArray[np.uint8], NDArray[np.uint8]]


@pytest.fixture(scope="module")
def held() -> list[Images]:
    """What both cameras see of a board that is held in some places."""
    images = []
    for seed, tilt in enumerate([(0.6, 0.4), (-0.6, -0.3), (0.2, 0.7)]):
        middle = np.array([10.0 * seed, 220.0, 10.0 * seed])
        turn = cv2.Rodrigues(np.array([np.pi / 2 + tilt[0], 0, 0]))[0] @ cv2.Rodrigues(np.array([0, tilt[1], 0]))[0]
        poses = EYES @ make_pose(turn, middle)
        images.append((image_at(poses[0], seed), image_at(poses[1], seed + 50)))
    return images


@dataclass
class Talk:
    """A session, and what it told."""

    folder: Path
    messages: list[Message] = field(default_factory=list)
    time_s: float = 0.0
    number: int = 0

    def begin(self, *, resume: bool = False, names: tuple[str, ...] = NAMES) -> Session:
        """Begin a session in the folder."""
        folder = PhotoFolder(self.folder, target(), names, resume=resume)
        folder.begin()
        guide = RigGuide(target(), names, made="exact", model="pinhole", criteria=LIMITS)
        sources = tuple(BrowserCamera() for _ in names)
        session = Session(guide, folder, sources, self.messages.append, lambda frame: None)
        session.resume()
        return session

    def show(self, session: Session, images: Images, times: int = 6, late_s: float = 0.01) -> None:
        """Both cameras see something for some tenths of a second, the second a little later than the first."""
        self.time_s += 3.0
        for _ in range(times):
            self.time_s += 0.1
            self.number += 1
            session.frame(Frame(0, self.number, self.time_s, images[0]))
            session.frame(Frame(1, self.number, self.time_s + late_s, images[1]))

    def take(self, session: Session, images: Images) -> None:
        """Show both cameras something, and take it by hand."""
        session.command(PageCommand("by_hand"))
        self.show(session, images, 1)
        session.command(PageCommand("take"))

    def told(self, kind: type[Message]) -> int:
        """How many messages of a kind."""
        return sum(isinstance(one, kind) for one in self.messages)


@pytest.fixture
def talk(tmp_path: Path) -> Talk:
    return Talk(tmp_path / "out")


def test_a_moment_is_a_photo_of_each_camera_under_one_name(talk: Talk, held: list[Images]) -> None:
    """In a folder a camera, pixel by pixel as they came, in one moment; nothing is taken twice."""
    session = talk.begin()
    talk.show(session, held[0], 12)
    assert talk.told(TakenMessage) == 1
    for name, image in zip(NAMES, held[0], strict=True):
        np.testing.assert_array_equal(read_image(talk.folder / "photos" / name / "0001.png").pixels, image)
    assert session.guide.moments == ("0001",)
    assert all(len(session.guide.of(name).photos) == 1 for name in NAMES)


def test_it_stands_still_in_all_cameras_that_see_it_or_nothing_is_taken(talk: Talk, held: list[Images]) -> None:
    """What still moves before one camera, as that one is behind, is no moment."""
    session = talk.begin()
    for step in range(6):
        talk.time_s += 0.1
        session.frame(Frame(0, step, talk.time_s, held[0][0]))
        session.frame(Frame(1, step, talk.time_s, np.roll(held[0][1], 9 * step, axis=1)))
    assert talk.told(TakenMessage) == 0


def test_frames_far_apart_in_time_are_no_moment(talk: Talk, held: list[Images]) -> None:
    """More than 150 ms: who is so late may have seen another place."""
    session = talk.begin()
    talk.show(session, held[0], late_s=0.4)
    assert talk.told(TakenMessage) == 0


def test_who_dies_is_not_waited_for(talk: Talk, held: list[Images]) -> None:
    """One camera is named as gone; photos of the other go on."""
    session = talk.begin()
    session.frame(Frame(1, 0, 0.0, held[0][1]))
    session.source_says(1, "right: sends nothing any more; plug it in again")
    for step in range(6):
        session.frame(Frame(0, step, 0.1 + 0.1 * step, held[0][0]))
    assert [state.fault != "" for state in session.state.sources] == [False, True]
    assert [path.parent.name for path in session.photos] == ["left"]


def test_a_deleted_moment_is_left_out_of_all_cameras_and_comes_back(talk: Talk, held: list[Images]) -> None:
    """Files stay; the guide and the table of photos are without it until it is restored."""
    session = talk.begin()
    for images in held[:2]:
        talk.take(session, images)
    assert len(session.photos) == 4
    before = session.guide.told.headline
    session.command(PageCommand("delete", "0001.png"))
    assert session.guide.moments == ("0002",)
    table = session.folder.write_table({name: kept.files for name, kept in session.counted.items()})
    assert table.read_text().splitlines()[1:3] == ["left,0002,photos/left/0002.png", "right,0002,photos/right/0002.png"]
    assert (talk.folder / "photos/left/0001.png").exists()
    session.command(PageCommand("restore", "0001.png"))
    assert session.guide.told.headline == before


def test_a_session_is_resumed_as_it_was(talk: Talk, held: list[Images]) -> None:
    """The same moments and words, deleted ones stay deleted, and numbers go on."""
    session = talk.begin()
    for images in held:
        talk.take(session, images)
    session.command(PageCommand("delete", "0002.png"))
    again = talk.begin(resume=True)
    assert again.guide.moments == ("0001", "0003")
    assert again.guide.told.headline == session.guide.told.headline
    talk.take(again, held[1])
    assert (talk.folder / "photos/right/0004.png").exists()
    with pytest.raises(InputError, match="its session is of 'left', 'right', not of 'left'"):
        talk.begin(resume=True, names=("left", "top"))


def test_own_photos_are_joined_by_their_names(talk: Talk, held: list[Images], tmp_path: Path) -> None:
    """Of watched folders: alike, or but for the camera's name; a camera may lack some."""
    session = talk.begin()
    for row, name in enumerate(NAMES):
        for number in range(2 - row):
            file = tmp_path / f"{name}_{number}.png"
            cv2.imwrite(str(file), held[number][row])
            session.frame(Frame(row, number, 0.0, held[number][row], file))
    assert session.guide.moments == ("0", "1")
    assert [sorted(one.files) for one in session.counted.values()] == [["left", "right"], ["left"]]
    assert talk.told(LookMessage) == 3
    assert own_moment("left", Path("left.png")) == "left.png"
    assert own_moment("left", Path("img_left_0001.png")) == own_moment("right", Path("img_right_0001.png"))
    assert own_moment("1", Path("1_0011.png")) == own_moment("2", Path("2-0011.png")) == "0011.png"
    for name in ("img_0011.png", "img_1.png", "leftover_2.png"):
        assert own_moment("1", Path(name)) == own_moment("left", Path(name)) == name


def test_without_a_picture_nothing_can_be_taken(talk: Talk) -> None:
    """It is said."""
    talk.begin().command(PageCommand("take"))
    assert talk.told(NoticeMessage) == 1


def test_cameras_are_named_by_where_they_are(tmp_path: Path) -> None:
    """Numbers, folders, and files by what differs in their paths."""
    for place in ("a/cam.avi", "b/cam.avi"):
        (tmp_path / place).parent.mkdir()
        (tmp_path / place).write_bytes(b"")
    assert list(sources_of(("0", 2, "rtsp://10.0.0.7/live"), (), None)) == ["camera-0", "camera-2", "network-2"]
    films = [str(tmp_path / place) for place in ("a/cam.avi", "b/cam.avi")]
    assert list(sources_of(films, (), None)) == ["a", "b"]
    assert list(sources_of((), (tmp_path / "a", tmp_path / "b"), None)) == ["a", "b"]


@pytest.mark.parametrize(
    ("cameras", "watch", "said"),
    [
        (("0", "0"), (), "is given twice"),
        (("0", "a.avi"), (), "a video goes with no camera"),
        (("0",), ("x",), "give one of them"),
        ((), ("x", "x"), "is given twice"),
        (("0",), (), "give two or more"),
    ],
)
def test_sources_that_make_no_rig_are_refused(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, cameras: tuple[str, ...], watch: tuple[str, ...], said: str
) -> None:
    """In one line, and nothing is written."""
    monkeypatch.chdir(tmp_path)
    (tmp_path / "x").mkdir()
    (tmp_path / "a.avi").write_bytes(b"")
    with pytest.raises(InputError, match=said):
        live_rig(target(), "out", cameras=cameras, watch=watch)
    assert not (tmp_path / "out").exists()
