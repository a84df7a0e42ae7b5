"""A session: frames and what a person does come in, photos are taken, and the page is told.

It knows neither threads nor sockets: one worker calls it, and it calls `tell` with each message at once.
"""

import math
import time
from collections.abc import Callable
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from calib.api.detecting import Detector
from calib.capture.messages import (
    GuidanceMessage,
    LookMessage,
    Message,
    NoticeMessage,
    PageCommand,
    Phase,
    SourceState,
    StateMessage,
    TakenMessage,
)
from calib.capture.photo_folder import PhotoFolder
from calib.capture.sources.source import Frame, Source
from calib.core.types import Detections
from calib.detector.frame_quality import frame_quality
from calib.guide.frame_notes import notes_of
from calib.guide.guide import Guide
from calib.guide.shutter import Shutter
from calib.guide.told import FrameNote
from calib.observe.images import Grey, read_image
from designer.base.errors import InputError, NotWrittenError
from designer.page.scene import scene_json
from designer.target import TargetGeometry
from designer.target_scene import target_scene

ENDS_IN_S = 10.0
"""Between "it is good" and the end: time enough to read it, and to say that one goes on."""
MANY_RINGS = 15
"""So many ring-like things without a name are more than chance."""
BODY, INK = "#f4f4f2", "#2b2b2b"
Tell = Callable[[Message], None]
Show = Callable[[Frame], None]


@dataclass(frozen=True, eq=False)
class Kept:
    """A photo of the session."""

    name: str
    path: Path
    found: Detections
    is_left_out: bool = False


class Session:
    """One target, photographed until its camera is good.

    Args:
        target: that is photographed.
        guide: of it, without photos.
        folder: that photos are written to.
        sources: that frames come from.
        tell: takes each message, at once.
        show: takes each frame that is looked at and that the page does not have itself.
        now_s: the clock.
    """

    def __init__(
        self, target: TargetGeometry, guide: Guide, folder: PhotoFolder, sources: tuple[Source, ...], tell: Tell,
        show: Show, now_s: Callable[[], float] = time.monotonic,
    ) -> None:  # fmt: skip
        self.target, self.guide, self.folder, self.sources = target, guide, folder, sources
        self.phase: Phase = "taking"
        self.kept: dict[str, Kept] = {}
        self._tell, self._show, self._now_s = tell, show, now_s
        self._faults = [""] * len(sources)
        self._is_automatic, self._goes_on = True, False
        self._ends_s: float | None = None
        self._said = ""
        self._shutter = Shutter()
        self._last: Frame | None = None  # that was looked at
        self._detector = Detector(target)
        self._sharpest_px = math.inf

    # ---- what the page is told

    @property
    def state(self) -> StateMessage:
        """Where the session is."""
        states = tuple(
            SourceState(one.kind, one.name, fault) for one, fault in zip(self.sources, self._faults, strict=True)
        )
        left_s = None if self._ends_s is None else max(0.0, self._ends_s - self._now_s())
        return StateMessage(
            self.phase, described(self.target), self.folder.folder.name, states, self._is_automatic, True, left_s,
            self._said,
        )  # fmt: skip

    def greet(self) -> None:
        """Tell a page all that it is to show."""
        self._tell(self.state)
        scene = target_scene(self.target, body_colour=BODY, ink_colour=INK)
        self._tell(GuidanceMessage(self.guide.told, scene_json(scene)))

    def _tell_guidance(self) -> None:
        self._tell(GuidanceMessage(self.guide.told, ""))

    def _notice(self, said: str) -> None:
        self._tell(NoticeMessage(said, is_fault=True))

    def report(self, phase: Phase, said: str) -> None:
        """Go to another phase, with a word on it."""
        self.phase, self._said = phase, said
        self._tell(self.state)

    def begin_to_solve(self) -> bool:
        """Go on to the whole run of the photos, if there are any."""
        if not self.photos:
            self._notice("there is no photo yet; take some first")
            return False
        self._ends_s = None
        self.report("solving", "")
        return True

    def source_says(self, row: int, fault: str) -> None:
        """A source stopped, for a reason, or works again ("")."""
        if 0 <= row < len(self._faults) and self._faults[row] != fault:
            self._faults[row] = fault
            self._tell(self.state)

    # ---- photos

    @property
    def photos(self) -> tuple[Path, ...]:
        """The photos that count."""
        return tuple(one.path for one in self.kept.values() if not one.is_left_out)

    def resume(self) -> None:
        """Read the photos of an earlier session again."""
        left_out = set(self.folder.record.left_out)
        for path in self.folder.kept:
            self._reread(path, is_left_out=path.name in left_out)

    def _reread(self, path: Path, *, is_left_out: bool) -> None:
        try:
            found = self._exact(read_image(path).pixels, path.name)
        except InputError as error:
            self._notice(f"{error}; it is left out")
            return
        self.kept[path.name] = Kept(path.name, path, found, is_left_out)
        if not is_left_out:
            self.guide = self.guide.with_photo(found)

    def _exact(self, pixels: Grey, name: str) -> Detections:
        calibration = self.guide.calibration
        camera = None if calibration is None else calibration.camera
        if camera is not None and camera.image_size != (pixels.shape[1], pixels.shape[0]):
            camera = None
        return Detector(self.target, camera).detect(pixels, name)

    def _take(self, frame: Frame, *, by_itself: bool) -> None:
        """Keep a frame as it was judged: first the file, then a word, then what follows from it."""
        try:
            path = self.folder.write(frame.pixels)
        except InputError as error:
            self._notice(str(error))
            return
        self._tell(TakenMessage(path.name, by_itself))
        self._shutter = self._shutter.fired()
        self._count(path, self._exact(frame.pixels, path.name))

    def _count(self, path: Path, found: Detections) -> None:
        is_left_out = path.name in self.folder.record.left_out
        self.kept[path.name] = Kept(path.name, path, found, is_left_out)
        if not is_left_out:
            self.guide = self.guide.with_photo(found)
        self._follow()

    def _follow(self) -> None:
        """After the photos changed."""
        self._tell_guidance()
        is_enough = self.guide.told.stage in ("good", "exhausted")
        if self.phase == "taking" and is_enough and not self._goes_on:
            self._ends_s = self._now_s() + ENDS_IN_S
            self.report("ending", self.guide.told.headline)
        elif self.phase == "ending" and not is_enough:
            self._go_on()

    def _go_on(self) -> None:
        self._ends_s = None
        self.report("taking", "")

    # ---- what comes in

    def frame(self, frame: Frame) -> None:
        """A frame of a source."""
        if self.phase not in ("taking", "ending"):
            return
        self.source_says(frame.source, "")
        begin = time.perf_counter()
        self._fit_guide((frame.pixels.shape[1], frame.pixels.shape[0]))
        if self.sources[frame.source].kind != "browser":
            self._show(frame)
        if frame.file is None:
            found = self._detector.glance(frame.pixels, f"frame {frame.number}")
        else:
            found = self._exact(frame.pixels, frame.file.name)
        look = self.guide.look(found, self._notes(frame, found))
        self._shutter = self._shutter.after(frame.time_s, found, look)
        circles = np.column_stack([found.center_px, found.ellipse_px[:, 2]])
        took_ms = 1000 * (time.perf_counter() - begin)
        self._tell(LookMessage(
            frame.source, frame.number, (circles,), labels_of(found, self.target), look, self._shutter.still, took_ms
        ))  # fmt: skip
        if frame.file is not None:
            self._tell(TakenMessage(frame.file.name, by_itself=False))
            self._count(frame.file, found)
            return
        self._last = frame
        if self._shutter.is_due and self._is_automatic and self.phase == "taking":
            self._take(frame, by_itself=True)

    def _notes(self, frame: Frame, found: Detections) -> tuple[FrameNote, ...]:
        """What is wrong with a frame; the sharpest one so far tells what the lens can do."""
        strange = 0 if found.rejected_px is None else len(found.rejected_px)
        if not len(found.ring) and strange >= MANY_RINGS and found.remarks:
            return (FrameNote("target", f"rings, but not this target's: {found.remarks[-1]}", forbids=True),)
        quality = frame_quality(frame.pixels, found, self.target)
        notes = notes_of(quality, self._sharpest_px)
        if quality is not None and quality.blur_px > 0 and not notes:
            self._sharpest_px = min(self._sharpest_px, quality.blur_px)
        return notes

    def _fit_guide(self, image_size: tuple[int, int]) -> None:
        """The first proposal is for images of the size that come."""
        sized = self.guide.sized(image_size)
        if not self.kept and sized is not self.guide:
            self.guide = sized
            self._tell_guidance()

    def tick(self) -> bool:
        """Whether time has come to end."""
        return self._ends_s is not None and self._now_s() >= self._ends_s

    def command(self, command: PageCommand) -> None:
        """What a person does; `finish` and `bye` are for whoever calls."""
        does = {
            "take": self._take_last, "delete": self._delete, "restore": self._restore, "skip": self._skip,
            "more": self._more, "automatic": self._automatic, "by_hand": self._by_hand, "source": self._source,
        }  # fmt: skip
        try:
            if command.kind in does and (self.phase in ("taking", "ending") or self._may_go_on(command)):
                does[command.kind](command.name)
        except NotWrittenError as error:
            self._notice(str(error))

    def _may_go_on(self, command: PageCommand) -> bool:
        """Whether more photos are to mend a run that failed."""
        return command.kind == "more" and self.phase == "failed"

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
        self._shutter = self._shutter.rearmed()
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

    def _skip(self, _: str) -> None:
        self.guide = self.guide.skipping()
        self._shutter = self._shutter.rearmed()
        self._tell_guidance()

    def _more(self, _: str) -> None:
        self._goes_on = True
        if self.phase != "taking":
            self._go_on()

    def _automatic(self, _: str) -> None:
        self._is_automatic = True
        self._tell(self.state)

    def _by_hand(self, _: str) -> None:
        self._is_automatic = False
        self._tell(self.state)

    def _source(self, fault: str) -> None:
        rows = [row for row, one in enumerate(self.sources) if one.kind == "browser"]
        if rows:
            self.source_says(rows[0], fault[:300])


def described(target: TargetGeometry) -> str:
    """A target in a few words: "icosahedron, edge 60 mm, 420 rings"."""
    rings = f"{len(target.center_mm)} rings"
    return rings if target.spec is None else f"{target.spec.words}, {rings}"


def labels_of(found: Detections, target: TargetGeometry) -> tuple[tuple[float, float, str], ...]:
    """Where the faces of a solid are in an image, and what they are called; none of a board."""
    if target.face_count < 2 or not len(found.ring):
        return ()
    face = target.ring_face[found.ring]
    return tuple(
        (*np.round(found.center_px[face == number].mean(axis=0), 1).tolist(), str(number))
        for number in np.unique(face).tolist()
    )
