"""A session with several cameras: frames of a target come in, and photos of one moment are taken by all that see it.

Cameras of a machine are not taken at once to the millisecond. So a moment is only taken when the target stands still in
all cameras that see it, and their frames came within `AT_ONCE_S` of each other.
"""

import math
import os
import re
import time
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, replace
from pathlib import Path

from calib.capture.conversation import Conversation, Show, Tell, exactly_found, glanced, look_message, notes_on
from calib.capture.messages import TakenMessage
from calib.capture.photo_folder import PhotoFolder
from calib.capture.sources import Frame, Source
from calib.core.types import LEAST_POINTS, Detections
from calib.images.photo import Grey, read_image
from calib.judge.guidance import Look, TakenPhoto
from calib.judge.live_frame import Shutter
from calib.judge.rig_guide import RigGuide, moment_of
from designer.base.errors import InputError
from designer.base.files import write_files
from designer.target import TargetGeometry

AT_ONCE_S = 0.15
"""Frames that are farther apart are not of one moment."""
GONE_S = 1.0
"""A camera that is so far behind is not waited for."""

TABLE_FILE = "photos.csv"
"""Which photos count, and which were taken at once, as `calib rig --table` reads it."""
SEPARATORS = "_. -"
"""Of the parts of a file's name."""


@dataclass(frozen=True, eq=False)
class SeenFrame:
    """The last frame of a camera."""

    frame: Frame
    found: Detections
    look: Look


@dataclass(frozen=True, eq=False)
class KeptMoment:
    """Photos of one moment."""

    files: Mapping[str, Path] = field(default_factory=dict)  # by camera
    found: Mapping[str, Detections] = field(default_factory=dict)  # likewise
    is_left_out: bool = False

    def with_photo(self, camera: str, file: Path, found: Detections) -> "KeptMoment":
        """With the photo of one more camera."""
        return replace(self, files={**self.files, camera: file}, found={**self.found, camera: found})


class RigSession(Conversation):
    """One target, photographed until cameras and rig are good; the sources are the guide's cameras, in their order."""

    guide: RigGuide

    def __init__(
        self, target: TargetGeometry, guide: RigGuide, folder: PhotoFolder, sources: tuple[Source, ...], tell: Tell,
        show: Show, now_s: Callable[[], float] = time.monotonic,
    ) -> None:  # fmt: skip
        super().__init__(target, guide, folder, sources, tell, show, now_s)
        self.kept: dict[str, KeptMoment] = {}
        self._shutters = dict.fromkeys(guide.names, Shutter())
        self._last: dict[str, SeenFrame] = {}
        self._sharpest_px = dict.fromkeys(guide.names, math.inf)

    @property
    def source_names(self) -> tuple[str, ...]:
        """As `Conversation`."""
        return self.guide.names

    # ---- photos

    @property
    def counted(self) -> Mapping[str, KeptMoment]:
        """The moments that count, by name."""
        return {name: self.kept[name] for name in sorted(self.kept) if not self.kept[name].is_left_out}

    @property
    def photos(self) -> tuple[Path, ...]:
        """As `Conversation`."""
        return tuple(path for moment in self.counted.values() for path in moment.files.values())

    def photo_file(self, name: str) -> Path | None:
        """As `Conversation`; of a moment the photo of its first camera."""
        kept = self.kept.get(moment_of(name))
        return None if kept is None else next(kept.files[camera] for camera in self.guide.names if camera in kept.files)

    def resume(self) -> None:
        """As `Conversation`."""
        for path in self.folder.kept:
            camera = path.parent.name
            try:
                self._keep(camera, path, self._exact(camera, read_image(path).pixels, path.name))
            except InputError as error:
                self._notice(f"{error}; it is left out")

    def _exact(self, camera: str, pixels: Grey, name: str) -> Detections:
        return exactly_found(pixels, name, self.target, self.guide.of(camera).calibration)

    def _take(self, frames: Mapping[str, Frame], *, by_itself: bool) -> None:
        """Keep frames as they were judged: first the files, then a word, then what follows from them."""
        try:
            files = self.folder.write_moment({camera: frame.pixels for camera, frame in frames.items()})
        except InputError as error:
            self._notice(str(error))
            return
        name = next(iter(files.values())).name
        self._tell(TakenMessage(name, by_itself))
        found = {camera: self._exact(camera, frame.pixels, name) for camera, frame in frames.items()}
        for camera in frames:
            self._shutters[camera] = self._shutters[camera].fired()
            self._keep(camera, files[camera], found[camera])
        self._follow()

    def _keep(self, camera: str, file: Path, found: Detections) -> None:
        """Count a photo, unless its moment was deleted."""
        name = moment_of(found.image)
        is_left_out = name in self.folder.record.left_out
        before = self.kept.get(name, KeptMoment(is_left_out=is_left_out))
        self.kept[name] = before.with_photo(camera, file, found)
        if not is_left_out:
            self.guide = self.guide.with_photo(camera, found)

    # ---- what comes in

    def source_says(self, row: int, fault: str) -> None:
        """As `Conversation`; the others go on without a camera that is gone."""
        super().source_says(row, fault)
        if fault:
            self._last.pop(self.guide.names[row], None)

    def frame(self, frame: Frame) -> None:
        """As `Conversation`."""
        if not self.takes_photos:
            return
        self.source_says(frame.source, "")
        camera = self.guide.names[frame.source]
        self._fit_guide(camera, (frame.pixels.shape[1], frame.pixels.shape[0]))
        self._show(frame)
        if frame.file is None:
            found = glanced(frame, self.target, self.guide.guides[camera].calibration)
        else:
            found = self._exact(camera, frame.pixels, own_moment(camera, frame.file))
        notes, self._sharpest_px[camera] = notes_on(frame, found, self.target, self._sharpest_px[camera])
        look = self.guide.look(camera, found, notes)
        self._shutters[camera] = self._shutters[camera].after(frame.time_s, found, look)
        self._tell(look_message(frame, found, self.target, look, self._shutters[camera].still))
        if frame.file is not None:
            self._tell(TakenMessage(f"{camera}: {frame.file.name}", by_itself=False))
            self._keep(camera, frame.file, found)
            self._follow()
            return
        self._last[camera] = SeenFrame(frame, found, look)
        if self._is_automatic and self.phase == "taking" and (frames := self._due()):
            self._take(frames, by_itself=True)

    def _due(self) -> dict[str, Frame]:
        """What is to be taken now, by camera; {}: nothing."""
        now_s = max(one.frame.time_s for one in self._last.values())
        awaited = {camera: one for camera, one in self._last.items() if now_s - one.frame.time_s <= GONE_S}
        seeing = {camera: one for camera, one in awaited.items() if len(one.found.ring) >= LEAST_POINTS}
        is_at_once = all(now_s - one.frame.time_s <= AT_ONCE_S for one in awaited.values())
        if not is_at_once or any(self._shutters[camera].still < 1 for camera in seeing):
            return {}
        if sum(self._shutters[camera].is_due for camera in seeing) < self.guide.wanted_at_once:
            return {}
        return {camera: one.frame for camera, one in seeing.items() if not any(note.forbids for note in one.look.notes)}

    def _fit_guide(self, camera: str, image_size: tuple[int, int]) -> None:
        """The first proposal is for images of the size that come."""
        sized = self.guide.sized(camera, image_size)
        if sized is not self.guide:
            self.guide = sized
            self._tell_guidance()

    def _take_last(self, _: str) -> None:
        if not self._last:
            self._notice("there is no picture yet; start the cameras")
            return
        now_s = max(one.frame.time_s for one in self._last.values())
        self._take(
            {camera: one.frame for camera, one in self._last.items() if now_s - one.frame.time_s <= AT_ONCE_S},
            by_itself=False,
        )

    def _left_out(self) -> tuple[TakenPhoto, ...]:
        gone = (kept for kept in self.kept.values() if kept.is_left_out)
        found = [[kept.found[camera] for camera in self.guide.names if camera in kept.found] for kept in gone]
        return tuple(TakenPhoto(one[0].image, sum(len(of.ring) for of in one), False, "deleted", ()) for one in found)

    def _delete(self, name: str) -> None:
        moment = moment_of(name)
        kept = self.kept.get(moment)
        if kept is None or kept.is_left_out:
            self._notice("there is no such photo")
            return
        self.folder.leave_out(moment)
        self.kept[moment] = replace(kept, is_left_out=True)
        self.guide = self.guide.without_moment(moment)
        self._rearm()
        self._follow()

    def _restore(self, name: str) -> None:
        moment = moment_of(name)
        kept = self.kept.get(moment)
        if kept is None or not kept.is_left_out:
            self._notice("there is no such deleted photo")
            return
        self.folder.take_back(moment)
        self.kept[moment] = replace(kept, is_left_out=False)
        for camera, found in kept.found.items():
            self.guide = self.guide.with_photo(camera, found)
        self._follow()

    def _rearm(self) -> None:
        self._shutters = {camera: shutter.rearmed() for camera, shutter in self._shutters.items()}


def own_moment(camera: str, file: Path) -> str:
    """What a person's own photo is called: files of one moment are named alike, but for the camera's name in them.

    Its name is a part of the file's between separators; at the end a number is that of the photo, not of a camera.
    """
    end = "" if camera.isdecimal() else "|$"
    stem = re.sub(rf"(^|[{SEPARATORS}]+){re.escape(camera)}([{SEPARATORS}]+{end})", r"\1", file.stem, count=1)
    return f"{stem.strip(SEPARATORS) or file.stem}{file.suffix}"


def write_table(session: RigSession) -> Path:
    """Write which photos count, and which were taken at once.

    Raises:
        InputError: the folder cannot be written.
    """
    path = session.folder.folder / TABLE_FILE
    lines = [
        f"{camera},{moment},{_cell(os.path.relpath(kept.files[camera], path.parent))}"
        for moment, kept in session.counted.items()
        for camera in session.guide.names
        if camera in kept.files
    ]
    write_files({path: "\n".join(["camera,frame,file", *lines, ""]).encode()})
    return path


def _cell(text: str) -> str:
    return '"' + text.replace('"', '""') + '"' if set(text) & set(',"\n') else text
