"""A session without threads and sockets: what comes in, what is written, and what the page is told."""

from dataclasses import dataclass, field
from pathlib import Path

import cv2
import numpy as np
import pytest

from calib.capture.messages import GuidanceMessage, LookMessage, Message, NoticeMessage, PageCommand, TakenMessage
from calib.capture.photo_folder import SESSION_FILE, PhotoFolder
from calib.capture.session import ENDS_IN_S, Session
from calib.capture.sources import BrowserCamera, Frame
from calib.judge.rig_guide import RigGuide
from calib.renderer.scene import scene_from_target
from designer.base.errors import InputError, NotWrittenError
from designer.marks.chessboard import Chessboard
from designer.target import target_of_marks
from tests.support import ring_views
from tests.support.live_frames import SIZE, frames_of, held, image_at, target

LIMITS = str(Path(__file__).parents[2] / "support/lenient.toml")


@dataclass
class Told:
    """A session, what it told, and its clock."""

    folder: Path
    criteria: str = "standard"
    messages: list[Message] = field(default_factory=list)
    now_s: float = 0.0
    frames: int = 0

    def begin(self, *, resume: bool = False) -> Session:
        """Begin a session in the folder."""
        folder = PhotoFolder(self.folder, target(), ("camera",), resume=resume)
        folder.begin()
        guide = RigGuide(target(), ("camera",), made="exact", model="pinhole", criteria=self.criteria)
        return Session(
            guide.sized("camera", SIZE), folder, (BrowserCamera(),), self.messages.append, lambda frame: None,
            lambda: self.now_s,
        )  # fmt: skip

    def hold(self, session: Session, seed: int) -> None:
        """Hold the board where the ghost is, until a photo is taken or some tenths of a second went by."""
        image, before = image_at(held(session.guide.of("camera"), np.random.default_rng(seed)), seed), len(session.kept)
        self.frames += 20
        for frame in frames_of(image, self.frames, 8):
            session.frame(frame)
            if len(session.kept) > before:
                return

    def kinds(self) -> list[type[Message]]:
        """What was told since the last time this was asked."""
        found = [type(one) for one in self.messages]
        self.messages.clear()
        return found


@pytest.fixture
def told(tmp_path: Path) -> Told:
    return Told(tmp_path / "out")


def names(session: Session) -> list[str]:
    return [path.name for path in session.photos]


def test_who_holds_still_at_the_ghost_is_photographed(told: Told) -> None:
    """Not the first frame, but after it stood still; the file holds the very frame, and is there before it is told."""
    session = told.begin()
    image = image_at(held(session.guide.of("camera"), np.random.default_rng(1)))
    first, *others = frames_of(image, 0, 8)
    session.frame(first)
    assert told.kinds() == [LookMessage]
    assert not session.kept
    for frame in others:
        session.frame(frame)
    kinds = told.kinds()
    assert kinds.count(TakenMessage) == 1
    assert GuidanceMessage in kinds[kinds.index(TakenMessage) :]
    assert names(session) == ["0001.png"]
    np.testing.assert_array_equal(cv2.imread(str(told.folder / "photos/0001.png"), cv2.IMREAD_GRAYSCALE), image)


def test_a_chessboard_is_photographed_likewise(told: Told, monkeypatch: pytest.MonkeyPatch) -> None:
    """Another maker's board is found in frames, guided and taken as ours is, and named on the page."""
    board = target_of_marks([Chessboard((9, 6), 12.0)], np.eye(4)[None], 6.0)
    scene = scene_from_target(board)
    monkeypatch.setattr(f"{__name__}.target", lambda: board)
    monkeypatch.setattr("tests.support.live_frames._scene", lambda: scene)
    session = told.begin()
    for seed in (1, 2):
        told.hold(session, seed)
    assert len(session.kept) == 2
    looks = [one for one in told.messages if isinstance(one, LookMessage)]
    assert all(len(one.rings_px[0]) == 40 for one in looks)


def test_nothing_is_taken_by_itself_when_asked_so_or_while_it_moves(told: Told) -> None:
    """A key turns it off; a board on the move is not taken, however wanted."""
    session = told.begin()
    session.command(PageCommand("by_hand"))
    told.hold(session, 1)
    assert not session.kept
    session.command(PageCommand("automatic"))
    pose = held(session.guide.of("camera"), np.random.default_rng(1))
    for number in range(8):
        moved = pose.copy()
        moved[0, 3] += 4.0 * number
        session.frame(Frame(0, number, 10 + 0.1 * number, image_at(moved)))
    assert not session.kept


def test_a_deleted_photo_counts_no_more_and_may_come_back(told: Told) -> None:
    """Its file stays all the while; names that no photo has change nothing."""
    session = told.begin()
    for seed in (1, 2):
        told.hold(session, seed)
    both = names(session)
    assert len(both) == 2
    session.command(PageCommand("delete", both[0]))
    assert names(session) == both[1:]
    assert [one.image for one in session.guide.of("camera").photos] == both[1:]
    assert (told.folder / "photos" / both[0]).exists()
    told.kinds()
    for name in ("../session.json", "0009.png", both[0]):
        session.command(PageCommand("delete", name))
    assert told.kinds() == [NoticeMessage] * 3
    session.command(PageCommand("restore", both[0]))
    assert sorted(names(session)) == both


def test_a_session_goes_on_where_it_stopped(told: Told) -> None:
    """Photos are read again, deleted ones can still be restored, and numbers go on: nothing is written over."""
    session = told.begin()
    for seed in (1, 2, 3):
        told.hold(session, seed)
    session.command(PageCommand("delete", "0002.png"))
    again = told.begin(resume=True)
    again.resume()
    assert names(again) == ["0001.png", "0003.png"]
    again.greet()
    greeting = told.messages[-1]
    assert isinstance(greeting, GuidanceMessage)
    assert [one.name for one in greeting.left_out] == ["0002.png"]
    assert again.guide.told.headline == session.guide.told.headline
    again.frame(Frame(0, 0, 0.0, image_at(held(again.guide.of("camera"), np.random.default_rng(9)))))
    again.command(PageCommand("take"))
    assert names(again)[-1] == "0004.png"
    told.kinds()
    again.command(PageCommand("take"))  # of the same frame once more
    assert told.kinds() == [NoticeMessage]


def test_a_full_disk_loses_nothing_and_ends_nothing(told: Told, monkeypatch: pytest.MonkeyPatch) -> None:
    """It is said, no half of a file is left, and the session goes on when there is room."""
    session = told.begin()

    def full(files: object) -> None:
        raise NotWrittenError("photos: cannot be written: No space left on device")

    with monkeypatch.context() as patch:
        patch.setattr("calib.capture.photo_folder.write_files", full)
        told.hold(session, 1)
    assert NoticeMessage in told.kinds()
    assert not session.kept
    assert not list((told.folder / "photos").glob("*")) if (told.folder / "photos").exists() else True
    told.hold(session, 1)
    assert names(session) == ["0001.png"]


def test_whose_session_a_folder_holds_is_heeded(told: Told, tmp_path: Path) -> None:
    """One is not begun over another, nor resumed where there is none, nor with another target."""
    with pytest.raises(InputError, match="no session"):
        told.begin(resume=True)
    told.hold(told.begin(), 1)
    with pytest.raises(InputError, match="holds a session with 1 photo; go on by --resume"):
        told.begin()
    with pytest.raises(InputError, match="its session is of a target of layout"):
        PhotoFolder(told.folder, ring_views.board(columns=9, rows=6), ("camera",), resume=True)
    mine = tmp_path / "mine" / SESSION_FILE
    mine.parent.mkdir()
    mine.write_text("{}")
    with pytest.raises(InputError, match=r"session\.json"):
        PhotoFolder(mine.parent, target(), ("camera",), resume=False)


def test_it_ends_by_itself_and_waits_for_who_goes_on(tmp_path: Path) -> None:
    """When it is good a countdown runs, which more photos stop; taking more does not begin it again."""
    told = Told(tmp_path / "out", LIMITS)
    session = told.begin()
    for seed in range(1, 9):
        told.hold(session, seed)
        if session.phase == "ending":
            break
    assert session.phase == "ending"
    assert session.state.ends_in_s == ENDS_IN_S
    assert not session.tick()
    told.now_s += ENDS_IN_S
    assert session.tick()
    session.command(PageCommand("more"))
    assert session.phase == "taking"
    assert not session.tick()


def test_what_a_camera_lacks_is_told_until_it_works(told: Told) -> None:
    """The reason that the page gives stands in the state, on one line of limited length; a frame ends it."""
    session = told.begin()
    session.command(PageCommand("source", "the camera was unplugged " * 100))
    assert session.state.sources[0].fault.startswith("the camera was unplugged")
    assert len(session.state.sources[0].fault) <= 300
    session.frame(Frame(0, 0, 0.0, np.full((360, 480), 90, np.uint8)))
    assert session.state.sources[0].fault == ""


def test_another_target_in_view_is_said_at_once(told: Told) -> None:
    """Rings that are not this target's are taken for no photo, and the first frame says so."""
    session = told.begin()
    other = ring_views.view_of(ring_views.board(columns=11, rows=9), 3).image
    for frame in frames_of(np.asarray(other, dtype=np.uint8), 0):
        session.frame(frame)
    looks = [one for one in told.messages if isinstance(one, LookMessage)]
    assert [note.name for note in looks[0].look.notes] == ["target"]
    assert not session.kept
