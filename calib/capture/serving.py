"""A session with all that runs beside it: its worker, its sources, and the server of its page."""

import math
import secrets
import socket
import threading
import time
from collections import deque
from collections.abc import Callable
from functools import partial
from pathlib import Path
from typing import Generic, TypeVar

import cv2

from calib.capture.messages import FrameHeader, Message, NoticeMessage, PageCommand, TakenMessage, with_header
from calib.capture.server import LOOPBACK, MOST_BYTES, Pages, application
from calib.capture.session import Session, Show, Tell
from calib.capture.sources import Frame
from designer.base.errors import InputError
from designer.page.page_file import PAGE_FILE

TICK_S = 0.2
WORKER_STOP_S = 10.0
MOST_WAITING = 8
"""Of a person's own photos: more are not read before there is room, as each may take tens of megabytes."""


class Worker:
    """Runs a session: `worker.do(command)` and `worker.put(frame)` of a camera return at once.

    Args:
        session: whose work it does.
        finish: has the whole run of the photos made, at the end.
        failed: takes an error that nobody foresaw, which ends the session.
    """

    def __init__(self, session: Session, finish: Callable[[], None], failed: Callable[[BaseException], None]) -> None:
        self._session, self._finish, self._failed = session, finish, failed
        self._work = threading.Condition()
        self._frames: dict[int, Frame] = {}  # the newest of each source
        self._photos: deque[Frame] = deque()  # a person's own, none of which may be lost
        self._todo: deque[tuple[object, Callable[[], None]]] = deque()
        self._is_over = False
        self._thread = threading.Thread(target=self._run, daemon=True)

    def start(self) -> None:
        """Begin."""
        self._thread.start()

    def stop(self) -> None:
        """End after what is being done."""
        with self._work:
            self._is_over = True
            self._work.notify_all()
        if self._thread.is_alive() and threading.current_thread() is not self._thread:
            self._thread.join(WORKER_STOP_S)

    def put(self, frame: Frame) -> None:
        """A frame, instead of an older one of its source that nobody has looked at; a person's own photo in turn."""
        with self._work:
            if frame.file is None:
                self._frames[frame.source] = frame
            else:
                while len(self._photos) >= MOST_WAITING and not self._is_over:
                    self._work.wait(TICK_S)
                self._photos.append(frame)
            self._work.notify_all()

    def do(self, command: PageCommand) -> None:
        """What a person does; once, if it is said again before it is done."""
        self.call(self._finish if command.kind == "finish" else lambda: self._session.command(command), command)

    def call(self, work: Callable[[], None], name: object = None) -> None:
        """Something to be done by the session's thread, in turn; not twice in a row if it has a name."""
        with self._work:
            if name is None or not self._todo or self._todo[-1][0] != name:
                self._todo.append((name, work))
            self._work.notify_all()

    def _run(self) -> None:
        try:
            while (work := self._next()) is not None:
                work()
                if self._session.tick():
                    self._finish()
        except BaseException as error:  # it ends the session, and is raised where the session was begun
            self._failed(error)

    def _next(self) -> Callable[[], None] | None:
        """What to do next; None: it is over."""
        with self._work:
            takes = self._session.takes_photos
            if not (self._todo or (takes and self._photos) or self._frames or self._is_over):
                self._work.wait(TICK_S)
            if self._is_over:
                return None
            if self._todo:
                return self._todo.popleft()[1]
            if takes and self._photos:
                frames = [self._photos.popleft()]
            else:  # those of all sources together, so that they are of one moment
                frames = list(self._frames.values())
                self._frames.clear()
        return lambda: self._look(frames)

    def _look(self, frames: list[Frame]) -> None:
        for frame in frames:
            self._session.frame(frame)


PREVIEW_PX, PREVIEW_QUALITY = 1280, 70
PAGE_LEAVES_S = 60.0
"""So long a page has to fetch the report, and to say so."""
PAGE_COMES_BACK_S = 5.0
"""So long a page that is being reloaded is away."""
RELOADED_S = 1.0
"""So long after a page has the report one that is being reloaded at that moment may ask for it again."""
STEP_S = 0.1
Heard = Callable[[str], None]
R = TypeVar("R")


class Serving(Generic[R]):
    """`Serving(begin, solve, heard).until_done(bound, opened)`.

    Args:
        begin: makes the session, from what it tells the page, and shows it.
        solve: makes the whole run of a session's photos, and reports that it is done.
        heard: is told a line of each photo, and of what goes wrong.
    """

    def __init__(self, begin: Callable[[Tell, Show], Session], solve: Callable[[Session], R], heard: Heard) -> None:
        self._solve, self._heard = solve, heard
        self._session = begin(self._tell, self._show)
        self._worker = Worker(self._session, self._finish, self._fail)
        self._pages = Pages(self._greet, self._worker.put, self._do)
        self._is_over, self._is_asked = threading.Event(), threading.Event()
        self._until_s = math.inf  # a page has time to fetch the report
        self._result: R | None = None
        self._error: BaseException | None = None

    def until_done(self, bound: socket.socket, opened: Heard) -> R:
        """Serve until the run is made, or cannot be.

        What may take long is done by the thread that calls, which Ctrl-C stops at once: photos of an earlier session
        are read, and the whole run is made.

        Args:
            bound: to the address of the page.
            opened: is told it.

        Raises:
            InputError: the photos determine no camera.
            KeyboardInterrupt: a person stopped it; the photos are there.
        """
        import uvicorn

        token, port = secrets.token_urlsafe(24), int(bound.getsockname()[1])
        app = application(token, port, self._pages, self._session.photo_file, self._report_file)
        settings = uvicorn.Config(
            app, log_level="critical", access_log=False, ws="websockets-sansio", ws_max_size=MOST_BYTES,
            timeout_graceful_shutdown=1, server_header=False,
        )  # fmt: skip
        server = uvicorn.Server(settings)
        thread = threading.Thread(target=server.run, kwargs={"sockets": [bound]}, daemon=True)
        try:
            thread.start()
            for row, source in enumerate(self._session.sources):
                source.start(row, self._worker.put, partial(self._source_says, row))
            opened(f"http://{LOOPBACK}:{port}/{token}/")
            self._session.resume()
            self._worker.start()
            self._wait()
        finally:
            self._worker.stop()  # first: a source may wait for it to take a photo
            for source in self._session.sources:
                source.stop()
            server.should_exit = True
            thread.join(STEP_S * 50)
        if self._error is not None:
            raise self._error
        if self._result is None:
            raise InputError("the session ended without a photo; begin it again")
        return self._result

    def _wait(self) -> None:
        """Until a page has the report, or there is none that could fetch it."""
        page_s = time.monotonic()
        while not self._is_over.wait(STEP_S):
            if self._is_asked.is_set():
                self._run()
            now = time.monotonic()
            page_s = now if self._pages.has_one else page_s
            is_done = self._session.phase in ("done", "failed")
            if is_done and now > min(self._until_s, page_s + PAGE_COMES_BACK_S):
                return

    def _run(self) -> None:
        self._is_asked.clear()
        self._until_s = math.inf
        try:
            self._result, self._error = self._solve(self._session), None
            self._until_s = min(self._until_s, time.monotonic() + PAGE_LEAVES_S)
        except InputError as error:
            self._error = error
            self._session.report("failed", str(error))

    # ---- what the session and the page ask for

    def _greet(self) -> None:
        if self._session.phase == "done":
            self._until_s = time.monotonic() + PAGE_LEAVES_S
        self._worker.call(self._session.greet)

    def _tell(self, message: Message) -> None:
        self._pages.tell(message)
        if isinstance(message, TakenMessage):
            self._heard(f"took {message.name}{'' if message.by_itself else ' by hand'}")
        elif isinstance(message, NoticeMessage):
            self._heard(message.said)

    def _show(self, frame: Frame) -> None:
        """A picture of what another source than the page's own camera sees."""
        if self._pages.has_one:
            self._pages.send(preview_of(frame))

    def _source_says(self, row: int, fault: str) -> None:
        if fault:
            self._heard(fault)
        self._worker.call(lambda: self._session.source_says(row, fault))

    def _do(self, command: PageCommand) -> None:
        if command.kind != "bye":
            self._worker.do(command)
        elif self._session.phase in ("done", "failed"):
            self._until_s = time.monotonic() + RELOADED_S

    def _finish(self) -> None:
        """Have the whole run of the photos made; meanwhile the session's thread changes none of them."""
        if self._session.begin_to_solve():
            self._is_asked.set()

    def _fail(self, error: BaseException) -> None:
        self._error = error
        self._is_over.set()

    def _report_file(self) -> Path | None:
        return self._session.folder.folder / PAGE_FILE if self._session.phase == "done" else None


def preview_of(frame: Frame) -> bytes:
    """A frame's picture for the page, small enough to be sent often."""
    height, width = frame.pixels.shape
    small, scale = frame.pixels, PREVIEW_PX / max(width, height)
    if scale < 1:
        small = cv2.resize(small, None, fx=scale, fy=scale, interpolation=cv2.INTER_AREA)  # type: ignore[assignment]  # its depth stays
    if small.dtype != "uint8":
        small = (small >> 8).astype("uint8")
    packed = cv2.imencode(".jpg", small, (cv2.IMWRITE_JPEG_QUALITY, PREVIEW_QUALITY))[1]
    return with_header(FrameHeader(frame.source, frame.number, frame.time_s, width, height), packed.tobytes())
