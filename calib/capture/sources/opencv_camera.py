"""A camera that OpenCV reads: one of this machine by its number, one of the network by its address, or a video file."""

import time
from pathlib import Path

import cv2
import numpy as np
from numpy.typing import NDArray

from calib.capture.messages import SourceKind
from calib.capture.sources.source import Frame, ThreadSource
from calib.images.photo import grey_of
from designer.base.errors import InputError
from designer.base.words import printable, shown

AGAIN_S = 2.0
"""Between two attempts to open a camera that does not answer."""
MOST_MISSED = 10
"""Frames in a row that cannot be read: the camera was unplugged, or the video is at its end."""
USUAL_FPS, MOST_FPS = 30.0, 240.0


class OpenCVCamera(ThreadSource):
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
