"""Clips: the frames of a video file, in grey, as its sensor saw them, with their time stamps.

    for frame in frames_of(clip, lambda time_s: True): frame.number, frame.time_s, frame.pixels

What a file is its first bytes say: a playlist that names other files, or addresses in a network, is no clip.
"""

import os
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, cast

from calib.images.headers import DamagedError
from calib.images.photo import MAX_PIXELS, Grey, grey_of
from designer.base.errors import InputError

if TYPE_CHECKING:
    from cv2 import VideoCapture

SUFFIXES = (
    ".mp4", ".mov", ".m4v", ".avi", ".mkv", ".webm", ".mts", ".m2ts", ".ts", ".mpg", ".mpeg", ".wmv", ".3gp", ".ogv",
)  # fmt: skip
MOST_FRAMES = 36_000
"""That are decoded: 20 minutes at 30 a second."""
USUAL_RATE = 30.0
"""Frames a second where a file does not say."""
LOST = 0.98
"""Of the frames that a header states: with fewer the clip is cut off. Some headers state a length in seconds."""
_HEAD = 4096
_BOXES = (b"ftyp", b"moov", b"mdat", b"wide", b"free", b"skip", b"pnot")
_PHOTO_BRANDS = (b"hei", b"hev", b"mif1", b"msf1", b"avi", b"crx")
"""Of ISO media files that hold photos."""
_STARTS = (b"\x1aE\xdf\xa3", b"\0\0\1\xba", b"\0\0\1\xb3", b"0&\xb2u\x8ef\xcf\x11", b"OggS", b"FLV\1")
_QUIET = ("OPENCV_FFMPEG_LOGLEVEL", "-8")


@dataclass(frozen=True)
class Clip:
    """A video file, by its header."""

    path: Path
    image_size: tuple[int, int]  # width, height of the frames as they are stored
    rate_hz: float
    stated_frames: int  # 0: not stated
    turned_deg: int  # that players turn it by

    @property
    def remarks(self) -> tuple[str, ...]:
        """On all of its frames."""
        if not self.turned_deg:
            return ()
        return (f"read as the sensor saw it: players show it turned by {self.turned_deg} degrees",)


@dataclass(frozen=True, eq=False)
class ClipFrame:
    """A frame of a clip."""

    number: int  # the first is 0
    time_s: float
    pixels: Grey  # (H, W)


def is_clip(path: Path) -> bool:
    """Whether a file is a video by its first bytes."""
    try:
        if not path.is_file():  # a pipe may never end
            return False
        with path.open("rb") as file:
            head = file.read(_HEAD)
    except (OSError, ValueError):
        return False
    if head[4:8] in _BOXES:
        return not (head[4:8] == b"ftyp" and head[8:].startswith(_PHOTO_BRANDS))
    is_riff, is_stream = head[:4] == b"RIFF" and head[8:12] == b"AVI ", head[:1] == b"G" and head[188:189] == b"G"
    is_disc = head[4:5] == b"G" and head[196:197] == b"G"
    return head.startswith(_STARTS) or is_riff or is_stream or is_disc


def calls_itself_clip(path: Path) -> bool:
    """Whether a file is a video, or is named as one and will be refused as such."""
    return is_clip(path) or (path.suffix.lower() in SUFFIXES and os.path.isfile(path))


def open_clip(path: Path) -> Clip:
    """What a clip says of itself.

    Raises:
        InputError: no frame of it can be read, or its frames are too large; it names the file.
    """
    import cv2

    try:
        with _capture(path) as video:
            width, height, count, turned = (
                int(video.get(one)) for one in (cv2.CAP_PROP_FRAME_WIDTH, cv2.CAP_PROP_FRAME_HEIGHT,
                                                cv2.CAP_PROP_FRAME_COUNT, cv2.CAP_PROP_ORIENTATION_META)
            )  # fmt: skip
            rate_hz = float(video.get(cv2.CAP_PROP_FPS))
    except DamagedError as error:
        raise InputError(f"{path}: {error}") from None
    if not 0 < width * height <= MAX_PIXELS:
        most = f"1 to {MAX_PIXELS // 1_000_000} million are read"
        raise InputError(f"{path}: its frames have {width} x {height} px; {most}: convert it")
    is_rate = 0.01 < rate_hz < 1e5
    return Clip(path, (width, height), rate_hz if is_rate else USUAL_RATE, max(count, 0), turned % 360)


def frames_of(
    clip: Clip, is_wanted: Callable[[int, float], bool], told: list[str] | None = None
) -> Iterator[ClipFrame]:
    """Frames in their order; the others are decoded and left out.

    Args:
        clip: that is read.
        is_wanted: of a frame's number and time.
        told: is given a line if frames are missing, or not looked at, at the end.

    Raises:
        InputError: there is not one frame.
    """
    import cv2

    number, last_s, has_times = 0, -1.0, True
    with _capture(clip.path) as video:
        while number < MOST_FRAMES and video.grab():
            time_s = 1e-3 * float(video.get(cv2.CAP_PROP_POS_MSEC))
            has_times &= last_s < time_s < 1e9
            time_s = last_s = time_s if has_times else max(number / clip.rate_hz, last_s + 0.5 / clip.rate_hz)
            if is_wanted(number, time_s):
                is_read, image = video.retrieve()
                if is_read and image.shape[1::-1] == clip.image_size:
                    yield ClipFrame(number, time_s, grey_of(cast("Grey", image)))
            number += 1
    if not number:
        raise InputError(f"{clip.path}: holds no frame that can be read; copy it again")
    if told is None:
        return
    if number < LOST * min(clip.stated_frames, MOST_FRAMES):
        told.append(f"{clip.path}: ends after {number} of {clip.stated_frames} frames: the file is cut off or damaged")
    elif number == MOST_FRAMES:
        told.append(
            f"{clip.path}: only its first {number} frames were looked at; cut the part out that shows the target"
        )
    if not has_times:
        told.append(
            f"{clip.path}: its time stamps do not ascend: times are counted by {clip.rate_hz:g} frames a second"
        )


@contextmanager
def _capture(path: Path) -> "Iterator[VideoCapture]":
    """The decoder, without a word of its own on the screen, as the sensor saw; DamagedError: it takes no such file."""
    if not is_clip(path):
        raise DamagedError("is no video in a known format; give MP4, MOV, AVI, MKV or WebM, or photos")
    os.environ.setdefault(*_QUIET)
    import cv2

    cv2.utils.logging.setLogLevel(cv2.utils.logging.LOG_LEVEL_SILENT)
    video = cv2.VideoCapture(os.path.abspath(path), cv2.CAP_FFMPEG)
    try:
        if not video.isOpened():
            raise DamagedError(
                "holds no video that can be decoded: it is cut off, damaged, or sound alone; copy it again"
            )
        video.set(cv2.CAP_PROP_ORIENTATION_AUTO, 0)
        yield video
    finally:
        video.release()
