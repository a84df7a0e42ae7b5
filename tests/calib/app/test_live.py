"""Whole sessions: from the first frame to the folder that is left, however they end."""

import json
import re
import signal
import threading
from collections.abc import Callable
from contextlib import ExitStack
from pathlib import Path

import cv2
import numpy as np
import pytest
from websockets.exceptions import ConnectionClosed
from websockets.sync.client import ClientConnection, connect

import calib
from calib.app.calibration import Run
from calib.app.calibration_folder import RunFolder
from calib.capture.messages import FrameHeader, PageCommand, with_header
from calib.capture.photo_folder import SESSION, PhotoFolder
from calib.capture.serving import Serving, Worker
from calib.capture.sources import Frame
from calib.judge.folders import JudgedRun
from calib.judge.guide import Guide
from designer.base.errors import InputError, NotWrittenError
from designer.page.output import Output
from designer.target import target_to_json
from tests.support.command_line import calib as command
from tests.support.live_frames import SIZE, held, image_at, target
from tests.support.programs import PYTHON, start
from tests.support.waiting import WITHIN_S, wait_until

ROOT = Path(__file__).parents[3]
LIMITS = str(ROOT / "tests/support/lenient.toml")
SOLVED = {"model": "pinhole", "made": "exact", "criteria": LIMITS}


@pytest.fixture(scope="module")
def photos(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Five photos as a guided person takes them."""
    folder, rng = tmp_path_factory.mktemp("guided"), np.random.default_rng(3)
    guide = Guide(target(), made="exact", image_size=SIZE, model="pinhole")
    for number in range(5):
        image = image_at(held(guide, rng), number)
        cv2.imwrite(str(folder / f"{number}.png"), image)
        guide = guide.with_photo(calib.detect(image, target(), name=f"{number}.png"))
    return folder


def page_of(address: str) -> ClientConnection:
    """A page's socket, at the address that is printed."""
    where = address.removeprefix("http://").split("/")[0]
    return connect(f"ws{address[4:]}socket", origin=f"http://{where}", open_timeout=WITHIN_S, max_size=None)


def until(page: ClientConnection, is_it: Callable[[dict[str, object]], bool]) -> dict[str, object]:
    """The first message of a kind."""
    while True:
        data = page.recv(timeout=WITHIN_S)
        if isinstance(data, str) and is_it(message := json.loads(data)):
            return message


def opening(
    play: Callable[[ClientConnection], None], again: Callable[[ClientConnection], None] | None = None
) -> Callable[[str], None]:
    """What is done with the address: a page plays a part, in a thread of its own, and maybe one that is loaded next."""

    def be_page(address: str) -> None:
        for part in (play, again):
            if part is not None:
                with page_of(address) as page:
                    part(page)

    return lambda address: threading.Thread(target=be_page, args=(address,), daemon=True).start()


def is_at_the_end(message: dict[str, object]) -> bool:
    """Whether a message tells how it ended."""
    return message.get("phase") in ("done", "failed")


def frame(image: np.ndarray, number: int) -> bytes:
    return with_header(FrameHeader(0, number, 0.1 * number, image.shape[1], image.shape[0]), image.tobytes())


def test_the_end_of_a_session_is_that_of_a_run(photos: Path, tmp_path: Path) -> None:
    """The same files as `calib.run` of the same photos writes, the same camera, and the page is given the report.

    So is a page that is reloaded at that very moment.
    """
    seen: list[dict[str, object]] = []

    def play(page: ClientConnection) -> None:
        for _ in range(5):
            seen.append(until(page, lambda one: one["kind"] == "taken"))
        page.send('{"kind": "finish"}')
        seen.append(until(page, is_at_the_end))
        page.send('{"kind": "bye"}')

    def reloaded(page: ClientConnection) -> None:
        seen.append(until(page, is_at_the_end))
        page.send('{"kind": "bye"}')

    before = {path: path.read_bytes() for path in photos.iterdir()}
    file = tmp_path / "a.target.json"
    file.write_text(target_to_json(target()))
    live = calib.live(file, tmp_path / "live", watch=photos, opened=opening(play, reloaded), **SOLVED)
    run = calib.run(file, photos, **SOLVED)
    run.save(tmp_path / "run")
    assert [one.get("phase") for one in seen[-2:]] == ["done", "done"]
    written = {path.relative_to(tmp_path / "live") for path in (tmp_path / "live").rglob("*")} - {Path("session.json")}
    assert written == {path.relative_to(tmp_path / "run") for path in (tmp_path / "run").rglob("*")}
    np.testing.assert_array_equal(live.best.camera.params, run.best.camera.params)
    assert live.verdict == run.verdict
    assert dict(live.task.settings)["target"] == dict(run.task.settings)["target"]
    assert {path: path.read_bytes() for path in photos.iterdir()} == before


def test_a_session_that_is_killed_or_stopped_loses_no_photo(photos: Path, tmp_path: Path) -> None:
    """Killed after a photo was told it is there, and is resumed; Ctrl-C ends with 130 and a line that goes on."""
    (tmp_path / "a.target.json").write_text(target_to_json(target()))
    image = cv2.imread(str(photos / "0.png"), cv2.IMREAD_GRAYSCALE)
    for words, ends_by, name in (((), signal.SIGKILL, "0001.png"), (("--resume",), signal.SIGINT, "0002.png")):
        command = (PYTHON, "-m", "calib.cli", "live", "a.target.json", "-o", "out", "--no-open", *words)
        with start(*command, cwd=tmp_path) as session, ExitStack() as ends:
            ends.callback(session.kill)
            assert session.stdout is not None
            assert session.stderr is not None
            address = re.search(r"http://\S+", session.stdout.readline())
            assert address, session.stderr.read()
            with page_of(address[0]) as page:
                page.send(frame(image, 0))
                until(page, lambda one: one["kind"] == "look")
                page.send('{"kind": "take"}')
                assert until(page, lambda one: one["kind"] == "taken")["name"] == name
                session.send_signal(ends_by)
                with pytest.raises(ConnectionClosed):
                    until(page, lambda one: False)
            said = session.stderr.read()
            assert session.wait(WITHIN_S) == (130 if ends_by is signal.SIGINT else -signal.SIGKILL)
    assert "calib live a.target.json -o out --no-open --resume" in said
    begun_with = SESSION.read(tmp_path / "out/session.json").sources
    kept = PhotoFolder(tmp_path / "out", target(), begun_with, resume=True).kept
    with pytest.raises(InputError, match="give the cameras that it was begun with"):
        PhotoFolder(tmp_path / "out", target(), ("another",), resume=True)
    assert [path.name for _, path in kept] == ["0001.png", "0002.png"]
    np.testing.assert_array_equal(cv2.imread(str(kept[1][1]), cv2.IMREAD_GRAYSCALE), image)


def test_ctrl_c_reaches_whatever_takes_long(photos: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """The whole run, and the reading of an earlier session's photos, are work of the thread that began the session."""
    mine, who = threading.get_ident(), list[int]()

    def stopped(*_: object, **__: object) -> None:
        who.append(threading.get_ident())
        raise KeyboardInterrupt

    def play(page: ClientConnection) -> None:
        until(page, lambda one: one["kind"] == "taken")
        page.send('{"kind": "finish"}')
        with pytest.raises(ConnectionClosed):
            until(page, lambda one: False)

    monkeypatch.setattr("calib.app.run.run", stopped)
    monkeypatch.setattr("calib.capture.session.Session.resume", lambda self: who.append(threading.get_ident()))
    with pytest.raises(KeyboardInterrupt):
        calib.live(target(), tmp_path / "out", watch=photos, opened=opening(play), **SOLVED)
    assert who == [mine, mine]


def test_a_run_that_is_made_again_counts_alone(photos: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """After a full disk the page can have all computed again; nothing of the first attempt is told twice."""
    out, phases, write = Output(tmp_path / "out"), list[object](), RunFolder.write_verdict

    def full_once(self: RunFolder, run: JudgedRun) -> None:
        monkeypatch.setattr(RunFolder, "write_verdict", write)
        raise NotWrittenError("verdict.json: cannot be written: No space left on device")

    def play(page: ClientConnection) -> None:
        until(page, lambda one: one["kind"] == "guidance" and len(one["guidance"]["photos"]) == 5)
        for _ in range(2):
            page.send('{"kind": "finish"}')
            phases.append(until(page, is_at_the_end)["phase"])
        page.send('{"kind": "bye"}')

    monkeypatch.setattr(RunFolder, "write_verdict", full_once)
    calib.live(target(), out, watch=photos, opened=opening(play), **SOLVED)
    assert phases == ["failed", "done"]
    assert len(out.finished) == len(set(out.finished))
    assert len(set(out.files)) == len(out.files)


@pytest.mark.parametrize("name", ["index.html", "detections.csv"])
def test_a_folder_that_takes_no_result_is_refused_at_once(photos: Path, tmp_path: Path, name: str) -> None:
    """Somebody's own file under the name of a result is named before a photo is taken, not when all are."""
    (tmp_path / name).write_text("mine")
    begun = list[str]()
    with pytest.raises(InputError, match=f"{name}: is there already"):
        calib.live(target(), tmp_path, watch=photos, opened=begun.append, **SOLVED)
    if name == "index.html":
        with pytest.raises(InputError, match=f"{name}: is there already"):
            calib.live_rig(target(), tmp_path, watch=(photos, photos.parent), opened=begun.append, **SOLVED)
    assert begun == []
    assert [(path.name, path.read_text()) for path in tmp_path.iterdir()] == [(name, "mine")]


def test_a_session_without_a_usable_photo_says_so(tmp_path: Path) -> None:
    """Photos that show nothing determine no camera: the page is told why, and so is who called."""
    folder = tmp_path / "empty"
    folder.mkdir()
    cv2.imwrite(str(folder / "a.png"), np.full((360, 480), 90, np.uint8))
    seen: list[dict[str, object]] = []

    def play(page: ClientConnection) -> None:
        until(page, lambda one: one["kind"] == "taken")
        page.send('{"kind": "finish"}')
        seen.append(until(page, is_at_the_end))
        page.send('{"kind": "bye"}')

    with pytest.raises(InputError) as refused:
        calib.live(target(), tmp_path / "out", watch=folder, opened=opening(play), **SOLVED)
    assert seen[-1]["phase"] == "failed"
    assert seen[-1]["said"] == str(refused.value)


def test_photos_that_come_while_nothing_is_taken_wait(tmp_path: Path) -> None:
    """A person's own photos are read when photos are taken again, few at a time; a camera's frames are not kept."""
    looked: list[Frame] = []

    class Quiet:
        takes_photos = False

        def frame(self, one: Frame) -> None:
            looked.append(one)

        def tick(self) -> bool:
            return False

    session = Quiet()
    worker = Worker(session, lambda: None, lambda error: None)  # type: ignore[arg-type]  # as much of one as it asks for
    worker.start()
    own = [Frame(0, number, 0.0, np.zeros((2, 2), np.uint8), tmp_path / f"{number}.png") for number in range(12)]
    putting = threading.Thread(target=lambda: [worker.put(one) for one in own], daemon=True)
    putting.start()
    putting.join(0.6)
    assert putting.is_alive()  # more are not read than there is room for
    assert not looked
    session.takes_photos = True
    putting.join(WITHIN_S)
    wait_until(lambda: len(looked) == len(own))
    worker.stop()
    assert [one.number for one in looked] == list(range(12))


def test_a_key_that_is_pressed_again_before_its_work_is_done_does_it_once() -> None:
    """Whatever a page sends in a row; what was done in between is done again."""
    done: list[str] = []

    class Quiet:
        takes_photos = True

        def command(self, command: PageCommand) -> None:
            done.append(command.kind)

        def tick(self) -> bool:
            return False

    worker = Worker(Quiet(), lambda: None, lambda error: None)  # type: ignore[arg-type]  # as much of one as it asks for
    for kind in ("skip", "skip", "by_hand", "automatic", "by_hand", "take", "take"):
        worker.do(PageCommand(kind))
    worker.start()
    wait_until(lambda: len(done) == 5)
    worker.stop()
    assert done == ["skip", "by_hand", "automatic", "by_hand", "take"]


def test_the_line_that_goes_on_is_the_one_that_began(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """With all its options, once with --resume, and without passwords; whoever ends the process, it is as Ctrl-C."""

    def stopped(*_: object) -> None:
        signal.raise_signal(signal.SIGTERM)

    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(Serving, "until_done", stopped)
    Path("a.target.json").write_text(target_to_json(target()))
    words = ("live", "a.target.json", "--camera", "rtsp://me:secret@10.0.0.7/live", "--made", "exact", "-o", "out")
    goes_on = "calib live a.target.json --camera rtsp://USER:PASSWORD@10.0.0.7/live --made exact -o out --resume"
    for answer in (command(*words), command(*words, "--resume")):
        assert answer.code == 130
        assert answer.err.endswith(f"stopped; finished and kept: out/session.json; go on with {goes_on}\n")


def test_a_camera_that_is_given_again_makes_a_rig(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """One is a camera's, two are a rig's, of videos and of folders alike; Python is told which function to call."""
    begun = list[int]()

    def begin(self: Serving[Run], *_: object) -> None:
        begun.append(len(self._session.sources))
        raise KeyboardInterrupt

    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(Serving, "until_done", begin)
    Path("a.target.json").write_text(target_to_json(target()))
    Path("left").mkdir()
    Path("right").mkdir()
    for number, more in enumerate(
        (["--camera", "1"], [], ["--watch", "left"], ["--watch", "left", "--watch", "right"])
    ):
        one = () if "--watch" in more else ("--camera", "0")
        command("live", "a.target.json", *one, *more, "-o", f"out{number}")
    assert begun == [2, 1, 1, 2]
    with pytest.raises(InputError, match="live_rig takes photos with several"):
        calib.live("a.target.json", "out", watch=["left", "right"])
