"""What a source of frames is, and what it is told; the camera of the browser that shows the page."""

import threading
import time
from abc import ABC, abstractmethod
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Protocol

from calib.capture.messages import SourceKind
from calib.images.photo import Grey

STOP_S = 5.0


@dataclass(frozen=True, eq=False)
class Frame:
    """One picture, grey, as it came."""

    source: int  # row of the sources
    number: int  # of the frames of that source, from 0
    time_s: float  # since any moment, the same for all cameras of this machine, and for all videos
    pixels: Grey  # (H, W)
    file: Path | None = None  # a person's own photo, which is taken whatever it shows; None: of a video


Put = Callable[[Frame], None]
"""Takes a frame; those that come too fast are passed over for newer ones, but for a person's own photos."""
Say = Callable[[str], None]
"""Takes why nothing comes from a source, in one line; "": it works (again)."""


class Source(Protocol):
    """A camera or a folder, read by a thread of its own."""

    kind: SourceKind
    name: str  # "camera 0"

    def start(self, row: int, put: Put, say: Say) -> None:
        """Begin to read.

        Args:
            row: of the source.
            put: takes each frame.
            say: takes what is wrong.
        """

    def stop(self) -> None:
        """End, and give the camera back."""


class ThreadSource(ABC):
    """A source that a thread of its own reads: `start` and `stop` as of `Source`."""

    def __init__(self) -> None:
        self._is_over, self._thread = threading.Event(), threading.Thread(target=self._read, daemon=True)
        self._row, self._begin_s = 0, 0.0
        self._put: Put = lambda frame: None
        self._say: Say = lambda fault: None

    def start(self, row: int, put: Put, say: Say) -> None:
        """As `Source`."""
        self._row, self._put, self._say = row, put, say
        self._begin_s = time.monotonic()
        self._thread.start()

    def stop(self) -> None:
        """As `Source`."""
        self._is_over.set()
        if self._thread.is_alive():
            self._thread.join(STOP_S)

    @abstractmethod
    def _read(self) -> None:
        """Hand on frames until it is over."""


class BrowserCamera:
    """Whatever camera the person chooses on the page, with whose messages its frames come; its faults the page says."""

    kind: SourceKind = "browser"
    name = "the browser's camera"

    def start(self, row: int, put: Put, say: Say) -> None:
        """As `Source`; there is nothing to begin."""

    def stop(self) -> None:
        """As `Source`."""
