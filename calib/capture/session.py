"""A session with one camera: its frames come in, and photos are taken."""

import math
import time
from collections.abc import Callable
from dataclasses import dataclass, replace
from pathlib import Path

from calib.capture.conversation import Conversation, Show, Tell, exactly_found, glanced, look_message, notes_on
from calib.capture.messages import TakenMessage
from calib.capture.photo_folder import PhotoFolder
from calib.capture.sources import Frame, Source
from calib.core.types import Detections
from calib.images.photo import Grey, read_image
from calib.judge.guidance import TakenPhoto
from calib.judge.guide import Guide
from calib.judge.live_frame import Shutter
from designer.base.errors import InputError
from designer.target import TargetGeometry


@dataclass(frozen=True, eq=False)
class Kept:
    """A photo of the session."""

    name: str
    path: Path
    found: Detections
    is_left_out: bool = False


class Session(Conversation):
    """One target, photographed until its camera is good; arguments as of `Conversation`."""

    guide: Guide

    def __init__(
        self, target: TargetGeometry, guide: Guide, folder: PhotoFolder, sources: tuple[Source, ...], tell: Tell,
        show: Show, now_s: Callable[[], float] = time.monotonic,
    ) -> None:  # fmt: skip
        super().__init__(target, guide, folder, sources, tell, show, now_s)
        self.kept: dict[str, Kept] = {}
        self._shutter = Shutter()
        self._last: Frame | None = None  # that was looked at
        self._sharpest_px = math.inf

    def _left_out(self) -> tuple[TakenPhoto, ...]:
        gone = (one for one in self.kept.values() if one.is_left_out)
        return tuple(TakenPhoto(one.name, len(one.found.ring), False, "deleted", ()) for one in gone)

    # ---- photos

    @property
    def photos(self) -> tuple[Path, ...]:
        """As `Conversation`."""
        return tuple(one.path for one in self.kept.values() if not one.is_left_out)

    def photo_file(self, name: str) -> Path | None:
        """As `Conversation`."""
        photo = self.kept.get(name)
        return None if photo is None else photo.path

    def resume(self) -> None:
        """As `Conversation`."""
        for path in self.folder.kept:
            try:
                self._keep(path, self._exact(read_image(path).pixels, path.name))
            except InputError as error:
                self._notice(f"{error}; it is left out")

    def _exact(self, pixels: Grey, name: str) -> Detections:
        return exactly_found(pixels, name, self.target, self.guide.calibration)

    def _take(self, frame: Frame, *, by_itself: bool) -> None:
        """Keep a frame as it was judged: first the file, then a word, then what follows from it."""
        try:
            path = self.folder.write(frame.pixels)
        except InputError as error:
            self._notice(str(error))
            return
        self._tell(TakenMessage(path.name, by_itself))
        self._shutter = self._shutter.fired()
        self._keep(path, self._exact(frame.pixels, path.name))
        self._follow()

    def _keep(self, path: Path, found: Detections) -> None:
        """Count a photo, unless it was deleted."""
        is_left_out = path.name in self.folder.record.left_out
        self.kept[path.name] = Kept(path.name, path, found, is_left_out)
        if not is_left_out:
            self.guide = self.guide.with_photo(found)

    # ---- what comes in

    def frame(self, frame: Frame) -> None:
        """As `Conversation`."""
        if not self.takes_photos:
            return
        self.source_says(frame.source, "")
        self._fit_guide((frame.pixels.shape[1], frame.pixels.shape[0]))
        if self.sources[frame.source].kind != "browser":
            self._show(frame)
        if frame.file is None:
            found = glanced(frame, self.target, self.guide.calibration)
        else:
            found = self._exact(frame.pixels, frame.file.name)
        notes, self._sharpest_px = notes_on(frame, found, self.target, self._sharpest_px)
        look = self.guide.look(found, notes)
        self._shutter = self._shutter.after(frame.time_s, found, look)
        self._tell(look_message(frame, found, self.target, look, self._shutter.still))
        if frame.file is not None:
            self._tell(TakenMessage(frame.file.name, by_itself=False))
            self._keep(frame.file, found)
            self._follow()
            return
        self._last = frame
        if self._shutter.is_due and self._is_automatic and self.phase == "taking":
            self._take(frame, by_itself=True)

    def _fit_guide(self, image_size: tuple[int, int]) -> None:
        """The first proposal is for images of the size that come."""
        sized = self.guide.sized(image_size)
        if not self.kept and sized is not self.guide:
            self.guide = sized
            self._tell_guidance()

    def _take_last(self, _: str) -> None:
        if self._last is None:
            self._notice("there is no picture yet; start the camera")
            return
        self._take(self._last, by_itself=False)

    def _delete(self, name: str) -> None:
        photo = self.kept.get(name)
        if photo is None or photo.is_left_out:
            self._notice("there is no such photo")
            return
        self.folder.leave_out(name)
        self.kept[name] = replace(photo, is_left_out=True)
        self.guide = self.guide.without_photo(name)
        self._rearm()
        self._follow()

    def _restore(self, name: str) -> None:
        photo = self.kept.get(name)
        if photo is None or not photo.is_left_out:
            self._notice("there is no such deleted photo")
            return
        self.folder.take_back(name)
        self.kept[name] = replace(photo, is_left_out=False)
        self.guide = self.guide.with_photo(photo.found)
        self._follow()

    def _rearm(self) -> None:
        self._shutter = self._shutter.rearmed()
