"""Who may talk to the server of the live page, and what nonsense does to it."""

import http.client
import threading
from collections.abc import Iterator
from dataclasses import dataclass, field

import numpy as np
import pytest
import uvicorn
from websockets.exceptions import ConnectionClosed, InvalidStatus
from websockets.sync.client import connect

from calib.capture.messages import FrameHeader, PageCommand, StateMessage, with_header
from calib.capture.server import LOOPBACK, NOT_OURS, TAKEN_OVER, Pages, application, bound_socket
from calib.capture.sources import Frame
from designer.base.errors import InputError
from tests.support.waiting import WITHIN_S, wait_until

TOKEN = "any-word"  # noqa: S105  # of this test alone
STATE = StateMessage("taking", "a board", "out", (), True, True, None, "")


@dataclass
class Running:
    """A server, and what it handed on."""

    port: int
    pages: Pages
    frames: list[Frame] = field(default_factory=list)
    commands: list[PageCommand] = field(default_factory=list)

    def get(self, path: str, host: str | None = None) -> tuple[int, bytes, dict[str, str]]:
        """Ask for a path, as a host."""
        line = http.client.HTTPConnection(LOOPBACK, self.port, timeout=WITHIN_S)
        line.putrequest("GET", path, skip_host=True)
        line.putheader("Host", host or f"{LOOPBACK}:{self.port}")
        line.endheaders()
        answer = line.getresponse()
        return answer.status, answer.read(), {name.lower(): value for name, value in answer.getheaders()}

    def socket(self, path: str = f"/{TOKEN}/socket", origin: str | None = None):  # type: ignore[no-untyped-def]  # noqa: ANN201
        """A page's socket."""
        where = f"{LOOPBACK}:{self.port}"
        return connect(f"ws://{where}{path}", origin=origin or f"http://{where}", open_timeout=WITHIN_S, max_size=None)


@pytest.fixture(scope="module")
def running(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Running]:
    """A server for all tests here."""
    photo = tmp_path_factory.mktemp("photos") / "0001.png"
    photo.write_bytes(b"\x89PNG")
    bound = bound_socket(0)
    frames: list[Frame] = []
    commands: list[PageCommand] = []
    pages = Pages(lambda: pages.tell(STATE), frames.append, commands.append)
    port = int(bound.getsockname()[1])
    app = application(TOKEN, port, pages, lambda name: photo if name == "0001.png" else None, lambda: None)
    server = uvicorn.Server(uvicorn.Config(app, log_level="critical", ws="websockets-sansio"))
    thread = threading.Thread(target=server.run, kwargs={"sockets": [bound]}, daemon=True)
    thread.start()
    wait_until(lambda: server.started)
    yield Running(port, pages, frames, commands)
    server.should_exit = True
    thread.join(10)


def wait_for(found: list[object] | list[Frame] | list[PageCommand], count: int) -> None:
    wait_until(lambda: len(found) >= count)
    assert len(found) == count


@pytest.mark.parametrize("path", ["/", "/wrong/", "/wrong/live.js", f"/{TOKEN}", f"/{TOKEN}/../{TOKEN}/x", "//"])
def test_without_the_token_there_is_nothing(running: Running, path: str) -> None:
    """Whatever is asked for without the word in the address is refused alike, in one plain line."""
    status, body, _ = running.get(path)
    assert status == 403
    assert body.count(b"\n") == 1


def test_a_page_of_another_name_is_refused(running: Running) -> None:
    """A name that was bound to this machine by somebody else's name server is not this machine's own."""
    for host in ("evil.example", f"evil.example:{running.port}", f"{LOOPBACK}:1"):
        assert running.get(f"/{TOKEN}/", host)[0] == 403
    assert running.get(f"/{TOKEN}/", f"localhost:{running.port}")[0] == 200


@pytest.mark.parametrize(
    ("path", "origin"),
    [(f"/{TOKEN}/socket", "http://evil.example"), (f"/{TOKEN}/socket", "null"), ("/wrong/socket", None)],
)
def test_a_socket_of_another_page_is_refused(running: Running, path: str, origin: str | None) -> None:
    """Neither with the wrong origin nor with the wrong word does a WebSocket open."""
    with pytest.raises((ConnectionClosed, InvalidStatus)) as refused, running.socket(path, origin) as page:
        page.recv(timeout=WITHIN_S)
    if isinstance(refused.value, ConnectionClosed):
        assert refused.value.rcvd is not None
        assert refused.value.rcvd.code == NOT_OURS


def test_the_page_and_its_parts_come_with_their_rules(running: Running) -> None:
    """Nothing is kept, framed, or told to others; only files of the page are handed out, and photos of the session."""
    status, _, headers = running.get(f"/{TOKEN}/")
    assert status == 200
    assert headers["content-security-policy"].startswith("default-src 'none'")
    assert headers["cache-control"] == "no-store"
    assert headers["referrer-policy"] == "no-referrer"
    assert running.get(f"/{TOKEN}/live.js")[0] == 200
    assert running.get(f"/{TOKEN}/photos/0001.png")[1] == b"\x89PNG"
    for path in ("server.py", "photos/0002.png", "photos/..%2f..%2fetc%2fpasswd", "report"):
        assert running.get(f"/{TOKEN}/{path}")[0] == 403


def test_nonsense_is_passed_over(running: Running) -> None:
    """Messages that are none change nothing, and the next good one is heeded."""
    image = np.arange(12, dtype=np.uint8).reshape(3, 4)
    good = with_header(FrameHeader(0, 7, 1.5, 4, 3), image.tobytes())
    bad: list[str | bytes] = [
        "", "{", "[]", '{"kind": "shutdown"}', '{"kind": "take", "name": 5}', "[" * 100_000, b"", b"\xff" * 4,
        b"\xff\xff\xff\x7f{}", good[:-1], good + b"0", with_header(FrameHeader(3, 0, 0.0, 4, 3), image.tobytes()),
        with_header(FrameHeader(0, 0, 0.0, 10**9, 10**9), b""), with_header(FrameHeader(0, 0, 0.0, -4, -3), b"x" * 12),
    ]  # fmt: skip
    with running.socket() as page:
        for one in bad:
            page.send(one)
        page.send('{"kind": "skip"}')
        page.send(good)
        wait_for(running.frames, 1)
    assert [one.kind for one in running.commands] == ["skip"]
    np.testing.assert_array_equal(running.frames[0].pixels, image)
    assert (running.frames[0].number, running.frames[0].time_s) == (7, 1.5)


def test_the_newest_page_has_the_session(running: Running) -> None:
    """An older one is told so and its socket closed; what it says meanwhile is not heeded."""
    with running.socket() as first:
        assert '"is_here": true' in str(first.recv(timeout=WITHIN_S))
        with running.socket() as second:
            assert '"is_here": true' in str(second.recv(timeout=WITHIN_S))
            assert '"is_here": false' in str(first.recv(timeout=WITHIN_S))
            with pytest.raises(ConnectionClosed) as closed:
                first.recv(timeout=WITHIN_S)
            assert closed.value.rcvd is not None
            assert closed.value.rcvd.code == TAKEN_OVER
            running.pages.tell(STATE)
            assert '"phase": "taking"' in str(second.recv(timeout=WITHIN_S))


def test_a_port_that_is_taken_is_named(running: Running) -> None:
    """One line says which, and what to do."""
    with pytest.raises(InputError, match=f"--port {running.port}: cannot be used: .*; give another"):
        bound_socket(running.port)


def test_the_server_listens_on_this_machine_alone() -> None:
    """No other address of the machine answers."""
    with bound_socket(0) as bound:
        assert bound.getsockname()[0] == "127.0.0.1"
