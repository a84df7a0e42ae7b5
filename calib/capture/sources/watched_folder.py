"""A folder that another program writes photos to, as of a tethered camera: each is read when it is complete."""

import time
from collections.abc import Iterable
from dataclasses import dataclass
from pathlib import Path

from calib.capture.messages import SourceKind
from calib.capture.sources.source import Frame, ThreadSource
from calib.images.photo import read_image
from calib.observe.photos import OVERLAY_MARK, images_in
from designer.base.errors import InputError
from designer.base.words import printable

LOOK_S = 0.3
GIVEN_UP_S = 5.0
"""A file that did not change for so long and still cannot be read is named."""


@dataclass(frozen=True)
class _FileState:
    """What a file looked like."""

    size: int
    changed_ns: int
    since_s: float  # when it was first seen so


def require_apart(folders: Iterable[Path], out: Path) -> None:
    """Refuse to watch the folder that results are written to, whose pictures would be taken for photos.

    Raises:
        InputError: a folder is that one, or lies in it.
    """
    for one in folders:
        if out.resolve() in (one.resolve(), *one.resolve().parents):
            raise InputError(
                f"--watch {printable(str(one))}: results are written to {printable(str(out))}, and its pictures would "
                "be taken for photos; watch another folder, or give another -o"
            )


class WatchedFolder(ThreadSource):
    """`WatchedFolder(Path("incoming"))`; what is in it already counts, too.

    Raises:
        InputError: it is no folder.
    """

    kind: SourceKind = "folder"

    def __init__(self, folder: Path) -> None:
        if not folder.is_dir():
            raise InputError(f"--watch {folder}: no such folder; make it, or give the one that the photos come to")
        self.folder, self.name = folder, printable(folder.name or str(folder))
        super().__init__()
        self._waiting: dict[Path, _FileState] = {}  # not yet read
        self._done: dict[Path, _FileState] = {}  # read, or given up as it is
        self._broken: dict[Path, str] = {}  # given up, and why
        self._fault = ""
        self._number = 0

    def _read(self) -> None:
        while not self._is_over.is_set():
            if self.folder.is_dir():
                self._tell(self._looked())
            else:
                self._tell(f"{self.name}: the folder is gone; make it again, or finish with the photos so far")
            self._is_over.wait(LOOK_S)

    def _tell(self, fault: str) -> None:
        """A fault once, and when it is over."""
        if fault != self._fault:
            self._fault = fault
            self._say(fault)

    def _looked(self) -> str:
        """Read what is complete; what is wrong with the newest file that cannot be, and which else; "" for nothing."""
        now = time.monotonic()
        for path in images_in(self.folder):
            state = _state_of(path, now)
            if state is None or path.stem.endswith(OVERLAY_MARK) or _is_same(self._done.get(path), state):
                continue
            self._broken.pop(path, None)
            before = self._waiting.get(path)
            if before is None or not _is_same(before, state):
                self._waiting[path] = state
                continue
            if reason := self._read_photo(path):
                if now - before.since_s < GIVEN_UP_S:
                    continue
                self._broken[path] = f"{reason}; it is left out"
            self._done[path] = self._waiting.pop(path)
        broken = [path for path in reversed(self._broken) if path.exists()]
        others = ", ".join(printable(path.name) for path in broken[1:])
        return f"{self._broken[broken[0]]}{f'; so are {others}' if others else ''}" if broken else ""

    def _read_photo(self, path: Path) -> str:
        """Hand on a photo; why it cannot be read, "" if it can."""
        try:
            pixels = read_image(path).pixels
        except InputError as error:
            return str(error)
        self._put(Frame(self._row, self._number, time.monotonic() - self._begin_s, pixels, path))
        self._number += 1
        return ""


def _state_of(path: Path, now: float) -> _FileState | None:
    try:
        found = path.stat()
    except OSError:
        return None
    return _FileState(found.st_size, found.st_mtime_ns, now)


def _is_same(one: _FileState | None, other: _FileState) -> bool:
    return one is not None and (one.size, one.changed_ns) == (other.size, other.changed_ns)
