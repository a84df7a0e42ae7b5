"""What a session and its page say to each other, whoever takes the photos: a camera, or several at once.

It knows neither threads nor sockets: one worker calls it, and it calls `tell` with each message at once.
"""

import time
from abc import ABC, abstractmethod
from collections.abc import Callable
from pathlib import Path
from typing import Protocol, Self, TypeAlias, TypeVar

import numpy as np

from calib.capture.messages import (
    GuidanceMessage,
    LookMessage,
    Message,
    NoticeMessage,
    PageCommand,
    Phase,
    SourceState,
    StateMessage,
)
from calib.capture.photo_folder import PhotoFolder
from calib.capture.sources import Frame, Source
from calib.core.types import Detections
from calib.detector.frame_quality import frame_quality
from calib.detector.glance import glance
from calib.detector.lens import CameraLens
from calib.detector.plan import plan_for
from calib.images.photo import Grey
from calib.judge.guidance import FrameNote, Guidance, Look, TakenPhoto
from calib.judge.live_frame import notes_of
from calib.observe.photos import PhotoFile
from calib.observe.search import look_for
from calib.solver.calibration import Calibration
from designer.base.errors import NotWrittenError
from designer.page.scene import scene_json
from designer.target import TargetGeometry
from designer.target_scene import target_scene

ENDS_IN_S = 10.0
"""Between "it is good" and the end: time enough to read it, and to say that one goes on."""
BODY, INK = "#f4f4f2", "#2b2b2b"
MANY_RINGS = 15
"""So many ring-like things without a name are more than chance."""
Tell = Callable[[Message], None]
Show = Callable[[Frame], None]


class Guiding(Protocol):
    """A guide, of a camera or of a rig."""

    @property
    def told(self) -> Guidance:
        """All that is to be shown between two photos."""

    def skipping(self) -> Self:
        """With another proposal."""


class Conversation(ABC):
    """One target, photographed until it is good.

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
        self, target: TargetGeometry, guide: Guiding, folder: PhotoFolder, sources: tuple[Source, ...], tell: Tell,
        show: Show, now_s: Callable[[], float] = time.monotonic,
    ) -> None:  # fmt: skip
        self.target, self.guide, self.folder, self.sources = target, guide, folder, sources
        self.phase: Phase = "taking"
        self._tell, self._show, self._now_s = tell, show, now_s
        self._faults = [""] * len(sources)
        self._is_automatic, self._goes_on = True, False
        self._ends_s: float | None = None
        self._said = ""

    # ---- photos

    @property
    @abstractmethod
    def photos(self) -> tuple[Path, ...]:
        """The photos that count."""

    @abstractmethod
    def photo_file(self, name: str) -> Path | None:
        """What the page shows by a photo's name; None: there is no such photo."""

    @abstractmethod
    def resume(self) -> None:
        """Read the photos of an earlier session again."""

    @abstractmethod
    def frame(self, frame: Frame) -> None:
        """A frame of a source."""

    @abstractmethod
    def _take_last(self, name: str) -> None: ...

    @abstractmethod
    def _delete(self, name: str) -> None: ...

    @abstractmethod
    def _restore(self, name: str) -> None: ...

    @abstractmethod
    def _rearm(self) -> None:
        """Another view was proposed: what stands still may be taken again."""

    @property
    def takes_photos(self) -> bool:
        """Whether a photo may be taken now."""
        return self.phase in ("taking", "ending")

    @property
    def source_names(self) -> tuple[str, ...]:
        """What the sources are called on the page."""
        return tuple(one.name for one in self.sources)

    # ---- what the page is told

    @property
    def state(self) -> StateMessage:
        """Where the session is."""
        states = tuple(
            SourceState(one.kind, name, fault)
            for one, name, fault in zip(self.sources, self.source_names, self._faults, strict=True)
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
        self._tell(GuidanceMessage(self.guide.told, scene_json(scene), self._left_out()))

    @abstractmethod
    def _left_out(self) -> tuple[TakenPhoto, ...]:
        """Deleted photos, as the page lists them."""

    def _tell_guidance(self) -> None:
        self._tell(GuidanceMessage(self.guide.told, "", self._left_out()))

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
            mends = command.kind == "more" and self.phase == "failed"  # more photos for a run that failed
            if command.kind in does and (self.takes_photos or mends):
                does[command.kind](command.name)
        except NotWrittenError as error:
            self._notice(str(error))

    def _skip(self, _: str) -> None:
        self.guide = self.guide.skipping()
        self._rearm()
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


def exactly_found(pixels: Grey, name: str, target: TargetGeometry, calibration: Calibration | None) -> Detections:
    """What a photo shows, by its camera as far as that is known."""
    camera = None if calibration is None else calibration.camera
    if camera is not None and camera.image_size != (pixels.shape[1], pixels.shape[0]):
        camera = None
    return look_for(target, camera)(PhotoFile(Path(name), name), pixels)


def glanced(frame: Frame, target: TargetGeometry, calibration: Calibration | None) -> Detections:
    """What a frame shows about; what the photos tell of the lens so far saves guessing it."""
    likely = None if calibration is None else calibration.camera
    is_same_size = likely is not None and likely.image_size == (frame.pixels.shape[1], frame.pixels.shape[0])
    lens = CameraLens(likely) if likely is not None and is_same_size else None
    return glance(frame.pixels, plan_for(target), f"frame {frame.number}", None, lens)


def notes_on(
    frame: Frame, found: Detections, target: TargetGeometry, sharpest_px: float
) -> tuple[tuple[FrameNote, ...], float]:
    """What is wrong with a frame, and the blur of the sharpest one so far, which tells what the lens can do."""
    strange = 0 if found.rejected_px is None else len(found.rejected_px)
    if not len(found.ring) and strange >= MANY_RINGS and found.remarks:
        return (FrameNote("target", f"rings, but not this target's: {found.remarks[-1]}", forbids=True),), sharpest_px
    quality = frame_quality(frame.pixels, found, target)
    notes = notes_of(quality, sharpest_px)
    if quality is not None and quality.blur_px > 0 and not notes:
        sharpest_px = min(sharpest_px, quality.blur_px)
    return notes, sharpest_px


def look_message(frame: Frame, found: Detections, target: TargetGeometry, look: Look, still: float) -> LookMessage:
    """What the page is told of a frame."""
    circles = np.column_stack([found.center_px, found.ellipse_px[:, 2]])
    return LookMessage(frame.source, frame.number, (circles,), labels_of(found, target), look, still)


def labels_of(found: Detections, target: TargetGeometry) -> tuple[tuple[float, float, str], ...]:
    """Where the faces of a solid are in an image, and what they are called; none of a board."""
    if target.face_count < 2 or not len(found.ring):
        return ()
    face = target.ring_face[found.ring]
    return tuple(
        (*np.round(found.center_px[face == number].mean(axis=0), 1).tolist(), str(number))
        for number in np.unique(face).tolist()
    )


S = TypeVar("S", bound=Conversation)
Begin: TypeAlias = Callable[[Tell, Show], S]
"""Makes a session, from what it tells the page, and shows it."""
