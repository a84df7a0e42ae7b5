"""The one thread that does a session's work: what a person does comes first, then the newest frames of all sources."""

import threading
from collections import deque
from collections.abc import Callable
from typing import Generic

from calib.capture.conversation import Conversation, G
from calib.capture.messages import PageCommand
from calib.capture.sources.source import Frame

TICK_S = 0.2
STOP_S = 10.0
MOST_WAITING = 8
"""Of a person's own photos: more are not read before there is room, as each may take tens of megabytes."""


class Worker(Generic[G]):
    """Runs a session: `worker.do(command)` and `worker.put(frame)` of a camera return at once.

    Args:
        session: whose work it does.
        finish: has the whole run of the photos made, at the end.
        failed: takes an error that nobody foresaw, which ends the session.
    """

    def __init__(
        self, session: Conversation[G], finish: Callable[[], None], failed: Callable[[BaseException], None]
    ) -> None:
        self._session, self._finish, self._failed = session, finish, failed
        self._work = threading.Condition()
        self._frames: dict[int, Frame] = {}  # the newest of each source
        self._photos: deque[Frame] = deque()  # a person's own, none of which may be lost
        self._todo: deque[Callable[[], None]] = deque()
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
            self._thread.join(STOP_S)

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
        """What a person does."""
        self.call(self._finish if command.kind == "finish" else lambda: self._session.command(command))

    def call(self, work: Callable[[], None]) -> None:
        """Something to be done by the session's thread, in turn."""
        with self._work:
            self._todo.append(work)
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
                return self._todo.popleft()
            if takes and self._photos:
                frames = [self._photos.popleft()]
            else:  # those of all sources together, so that they are of one moment
                frames = list(self._frames.values())
                self._frames.clear()
        return lambda: self._look(frames)

    def _look(self, frames: list[Frame]) -> None:
        for frame in frames:
            self._session.frame(frame)
