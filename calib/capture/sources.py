"""Where frames come from: the browser's camera, one that OpenCV reads, or a folder that is written to."""

import re
import threading
import time
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass
from pathlib import Path

import cv2
import numpy as np
from numpy.typing import NDArray

from calib.capture.messages import SourceKind
from calib.images.photo import Grey, grey_of, read_image
from calib.observe.photos import OVERLAY_MARK, images_in
from calib.observe.rig_photos import camera_names_of
from designer.base.errors import InputError
from designer.base.words import printable, shown

STOP_S = 5.0
ALONE = "camera"
"""The name of a camera that is the only one: the page calls it by where its frames come from."""


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


class Source:
    """A camera or a folder, read by a thread of its own."""

    kind: SourceKind
    name: str  # "camera 0"

    def __init__(self) -> None:
        self._is_over, self._thread = threading.Event(), threading.Thread(target=self._read, daemon=True)
        self._row, self._begin_s = 0, 0.0
        self._put: Put = lambda frame: None
        self._say: Say = lambda fault: None

    def start(self, row: int, put: Put, say: Say) -> None:
        """Begin to read, as this row of the sources; `put` takes each frame, and `say` what is wrong."""
        self._row, self._put, self._say = row, put, say
        self._begin_s = time.monotonic()
        self._thread.start()

    def stop(self) -> None:
        """End, and give the camera back."""
        self._is_over.set()
        if self._thread.is_alive():
            self._thread.join(STOP_S)

    def _read(self) -> None:
        """Hand on frames until it is over."""


class BrowserCamera(Source):
    """Whatever camera the person chooses on the page, with whose messages its frames come; its faults the page says."""

    kind: SourceKind = "browser"
    name = "the browser's camera"


AGAIN_S = 2.0
"""Between two attempts to open a camera that does not answer."""
MOST_MISSED = 10
"""Frames in a row that cannot be read: the camera was unplugged, or the video is at its end."""
USUAL_FPS, MOST_FPS = 30.0, 240.0


class OpenCVCamera(Source):
    """`OpenCVCamera("0")`, `OpenCVCamera("rtsp://10.0.0.7/live")`, `OpenCVCamera("walk.mp4")`.

    Raises:
        InputError: a file that is not there.
    """

    kind: SourceKind = "camera"

    def __init__(self, place: str, size: tuple[int, int] | None = None) -> None:
        self._place, self._size = place, size
        self._is_file = is_video(place)
        if self._is_file and not Path(place).is_file():
            raise InputError(
                f"--camera {shown(place)}: no such file; give a number (0), an address (rtsp://...) or a video"
            )
        self.name = f"camera {place}" if place.isdecimal() else _without_secrets(place)
        super().__init__()

    def _read(self) -> None:
        """Frame after frame; open the camera again when it is gone, as long as somebody listens."""
        number = 0
        while not self._is_over.is_set():
            camera = self._opened()
            if camera is None:
                self._say(f"{self.name}: cannot be opened; check that it is plugged in and no other program uses it")
                self._is_over.wait(AGAIN_S)
                continue
            self._say("")
            number = self._frames(camera, number)
            camera.release()
            if self._is_over.is_set():
                return
            if self._is_file:
                self._say(f"{self.name}: the video has ended; finish, or give a longer one")
                return
            self._say(f"{self.name}: sends nothing any more; plug it in again")
            self._is_over.wait(AGAIN_S)

    def _opened(self) -> cv2.VideoCapture | None:
        camera = cv2.VideoCapture(int(self._place) if self._place.isdecimal() else self._place)
        if not camera.isOpened():
            camera.release()
            return None
        if self._size is not None and self._place.isdecimal():
            camera.set(cv2.CAP_PROP_FRAME_WIDTH, self._size[0])
            camera.set(cv2.CAP_PROP_FRAME_HEIGHT, self._size[1])
        return camera

    def _frames(self, camera: cv2.VideoCapture, number: int) -> int:
        """Hand on frames until none come; the number of the next one. A file is played at its own speed.

        Videos that begin together keep together, however long each takes to be opened.
        """
        rate = camera.get(cv2.CAP_PROP_FPS) if self._is_file else 0.0
        step_s = 1 / (rate if 1 <= rate <= MOST_FPS else USUAL_FPS) if self._is_file else 0.0
        missed = 0
        while not self._is_over.is_set() and missed < MOST_MISSED:
            is_read, image = camera.read()
            if not is_read:
                missed += 1
                continue
            missed = 0
            pixels: NDArray[np.uint8] = grey_of(np.asarray(image, dtype=np.uint8)).astype(np.uint8, copy=False)
            now = number * step_s if self._is_file else time.monotonic()
            self._put(Frame(self._row, number, now, pixels))
            number += 1
            if self._is_file:
                self._is_over.wait(max(0.0, self._begin_s + number * step_s - time.monotonic()))
        return number


def is_video(place: str) -> bool:
    """Whether a place is a video file: neither a camera of this machine nor one of the network."""
    return not place.isdecimal() and "://" not in place


def _without_secrets(place: str) -> str:
    """An address without the password in it; of a file its name."""
    if "://" not in place:
        return printable(Path(place).name)
    scheme, _, rest = place.partition("://")
    return printable(f"{scheme}://{rest.rpartition('@')[2]}")


LOOK_S = 0.3
GIVEN_UP_S = 5.0
"""A file that did not change for so long and still cannot be read is named."""


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


SEPARATORS = "_. -"
"""Of the parts of a file's name."""
FileState = tuple[int, int, int, int]
"""What a file looks like: its size and when it changed; and which it is, whatever it is called."""


class WatchedFolder(Source):
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
        self._waiting: dict[Path, tuple[FileState, float]] = {}  # not yet read, and since when it is so
        self._done: dict[Path, FileState] = {}  # read, or given up as it is
        self._broken: dict[Path, str] = {}  # given up, and why
        self._fault = ""
        self._number = 0

    def _read(self) -> None:
        while not self._is_over.is_set():
            if self.folder.is_dir():
                fault = self._looked()
            else:
                fault = f"{self.name}: the folder is gone; make it again, or finish with the photos so far"
            if fault != self._fault:  # once, and when it is over
                self._fault = fault
                self._say(fault)
            self._is_over.wait(LOOK_S)

    def _looked(self) -> str:
        """Read what is complete; what is wrong with the newest file that cannot be, and which else; "" for nothing."""
        now = time.monotonic()
        for path in images_in(self.folder):
            state = _state_of(path)
            if state is None or path.stem.endswith(OVERLAY_MARK) or state == self._done.get(path):
                continue
            self._broken.pop(path, None)
            before, since_s = self._waiting.get(path, (None, now))
            if before != state:
                self._waiting[path] = (state, now)
                continue
            if reason := self._once_more(path, state) or self._read_photo(path, now - since_s):
                self._broken[path] = f"{reason}; it is left out"
            elif reason is None:
                continue
            self._done[path] = self._waiting.pop(path)[0]
        broken = [path for path in reversed(self._broken) if path.exists()]
        others = ", ".join(printable(path.name) for path in broken[1:])
        return f"{self._broken[broken[0]]}{f'; so are {others}' if others else ''}" if broken else ""

    def _once_more(self, path: Path, state: FileState) -> str:
        """Which photo a link leads to, if it counts already."""
        same = (one for one, before in self._done.items() if before[2:] == state[2:] and one != path and one.exists())
        other = next(same, None)
        return "" if other is None else f"{printable(path.name)}: is {printable(other.name)} once more"

    def _read_photo(self, path: Path, waited_s: float) -> str | None:
        """Hand on a photo; why it cannot be read, "" if it can, None if it may be soon."""
        try:
            pixels = read_image(path).pixels
        except InputError as error:
            return None if waited_s < GIVEN_UP_S else str(error)
        self._put(Frame(self._row, self._number, time.monotonic() - self._begin_s, pixels, path))
        self._number += 1
        return ""


def _state_of(path: Path) -> FileState | None:
    try:
        found = path.stat()
    except OSError:
        return None
    return found.st_size, found.st_mtime_ns, found.st_dev, found.st_ino


def own_moment(camera: str, file: Path) -> str:
    """What a person's own photo is called: files of one moment are named alike, but for the camera's name in them.

    Its name is a part of the file's between separators; at the end a number is that of the photo, not of a camera.
    """
    end = "" if camera.isdecimal() else "|$"
    stem = re.sub(rf"(^|[{SEPARATORS}]+){re.escape(camera)}([{SEPARATORS}]+{end})", r"\1", file.stem, count=1)
    return f"{stem.strip(SEPARATORS) or file.stem}{file.suffix}"


def sources_of(
    cameras: Sequence[str | int], folders: Sequence[Path], size: tuple[int, int] | None
) -> dict[str, Source]:
    """Where frames come from, by the names of the cameras; of a single one it is not used.

    Raises:
        InputError: what is not there, given twice, or cannot be together; or a size that nobody can be asked for.
    """
    if folders and cameras:
        raise InputError("--watch and --camera: photos come from folders, or from cameras; give one of them")
    places = [str(one) for one in cameras]
    if size is not None and not any(one.isdecimal() for one in places):
        raise InputError("--size: is what a camera of this machine is asked for; give its number with --camera, too")
    every: list[Source] = [*map(WatchedFolder, folders), *(OpenCVCamera(one, size) for one in places)]
    every = every or [BrowserCamera()]
    if len(every) == 1:
        return {ALONE: every[0]}
    return dict(zip(camera_names_of(folders) if folders else _camera_names(places), every, strict=True))


def _camera_names(places: Sequence[str]) -> Sequence[str]:
    again = next((one for one in places if places.count(one) > 1), None)
    if again is not None:
        raise InputError(f"--camera {shown(again)}: is given twice; give each camera once")
    films = [Path(one) for one in places if is_video(one)]
    if films and len(films) < len(places):
        raise InputError(
            f"--camera {shown(str(films[0]))}: a video goes with no camera that shows what is now; give videos alone"
        )
    if films:
        return camera_names_of([one.with_suffix("") for one in films])
    return [f"camera-{one}" if one.isdecimal() else f"network-{row}" for row, one in enumerate(places)]
