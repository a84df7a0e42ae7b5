"""A session: frames of a target come from one camera or several, and photos are taken until it is good.

It knows neither threads nor sockets: one worker calls it, and it calls `tell` with each message at once.

Cameras of a machine are not taken at once to the millisecond. So a moment is only taken when the target stands still in
all cameras that see it, and their frames came within `AT_ONCE_S` of each other.
"""

import math
import time
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, replace
from pathlib import Path

import numpy as np

from calib.cameras.camera import Camera
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
from calib.capture.sources import Frame, Source, own_moment
from calib.core.types import LEAST_POINTS, Detections
from calib.detector.frame_quality import frame_quality
from calib.detector.glance import look_quickly
from calib.detector.lens import CameraLens
from calib.images.photo import Grey, read_image
from calib.judge.guidance import FrameNote, Look, TakenPhoto
from calib.judge.live_frame import Shutter, notes_of
from calib.judge.rig_guide import RigGuide, moment_of
from calib.observe.photos import PhotoFile, in_order
from calib.observe.search import look_for
from designer.base.errors import InputError, NotWrittenError
from designer.page.scene import scene_json
from designer.target import TargetGeometry
from designer.target_scene import target_scene

ENDS_IN_S = 10.0
"""Between "it is good" and the end: time enough to read it, and to say that one goes on."""
AT_ONCE_S = 0.15
"""Frames that are farther apart are not of one moment."""
GONE_S = 1.0
"""A camera that is so far behind is not waited for."""
BODY, INK = "#f4f4f2", "#2b2b2b"
MANY_RINGS = 15
"""So many ring-like things without a name are more than chance."""
AROUND_CORNERS = 0.3
"""Radius of what is drawn around a corner that was found, of the reach of its edges."""
LONGEST_FAULT = 300
Tell = Callable[[Message], None]
Show = Callable[[Frame], None]


@dataclass(frozen=True, eq=False)
class SeenFrame:
    """The last frame of a camera."""

    frame: Frame
    found: Detections
    look: Look
    is_taken: bool = False


@dataclass(frozen=True, eq=False)
class KeptMoment:
    """Photos of one moment; of a single camera one."""

    files: Mapping[str, Path] = field(default_factory=dict)  # by camera
    found: Mapping[str, Detections] = field(default_factory=dict)  # likewise
    is_left_out: bool = False

    def with_photo(self, camera: str, file: Path, found: Detections) -> "KeptMoment":
        """With the photo of one more camera."""
        return replace(self, files={**self.files, camera: file}, found={**self.found, camera: found})


class Session:
    """One target, photographed until its cameras are good, each by itself and all together.

    Args:
        guide: before the cameras, without photos.
        folder: that photos are written to; its record has what the page calls the cameras.
        sources: that frames come from, in the order of the guide's cameras.
        tell: takes each message, at once.
        show: takes each frame that is looked at and that the page does not have itself.
        now_s: the clock.
    """

    def __init__(
        self, guide: RigGuide, folder: PhotoFolder, sources: tuple[Source, ...], tell: Tell, show: Show,
        now_s: Callable[[], float] = time.monotonic,
    ) -> None:  # fmt: skip
        self.guide, self.folder, self.sources, self.target = guide, folder, sources, guide.settings.target
        points = f"{len(self.target.center_mm)} {self.target.feature_word}"
        of = self.target.spec or (self.target.marks or (None,))[0]
        self._words = points if of is None else f"{of.words}, {points}"
        self.phase: Phase = "taking"
        self.kept: dict[str, KeptMoment] = {}  # by the moments' names
        self._tell, self._show, self._now_s = tell, show, now_s
        self._faults = [""] * len(sources)
        self._shutters = dict.fromkeys(guide.names, Shutter())
        self._last: dict[str, SeenFrame] = {}
        self._sharpest_px = dict.fromkeys(guide.names, math.inf)
        self._is_automatic, self._goes_on = True, False
        self._ends_s: float | None = None
        self._said = ""

    # ---- photos

    @property
    def counted(self) -> Mapping[str, KeptMoment]:
        """The moments that count, by name."""
        names = sorted(self.kept, key=lambda name: in_order(Path(name)))
        return {name: self.kept[name] for name in names if not self.kept[name].is_left_out}

    @property
    def photos(self) -> tuple[Path, ...]:
        """The photos that count."""
        return tuple(path for moment in self.counted.values() for path in moment.files.values())

    @property
    def takes_photos(self) -> bool:
        """Whether a photo may be taken now."""
        return self.phase in ("taking", "ending")

    def _moment(self, name: str) -> str:
        """What a photo's moment is called; of a single camera each photo is one."""
        return name if len(self.sources) == 1 else moment_of(name)

    def photo_file(self, name: str) -> Path | None:
        """What the page shows by a photo's name: that of the moment's first camera; None: there is none."""
        kept = self.kept.get(self._moment(name))
        return None if kept is None else next(kept.files[camera] for camera in self.guide.names if camera in kept.files)

    def resume(self) -> None:
        """Read the photos of an earlier session again."""
        for camera, path in self.folder.kept:
            try:
                self._keep(camera, path, self._exact(camera, read_image(path).pixels, path.name))
            except InputError as error:
                self._notice(f"{error}; it is left out")

    def _exact(self, camera: str, pixels: Grey, name: str) -> Detections:
        """What a photo shows, by its camera as far as that is known."""
        return look_for(self.target, self._likely(camera, pixels))(PhotoFile(Path(name), name), pixels)

    def _likely(self, camera: str, pixels: Grey) -> Camera | None:
        """What the photos tell of a camera so far, which saves guessing its lens; None: nothing, or of another size."""
        known = self.guide.of(camera).calibration
        return None if known is None or known.camera.image_size != pixels.shape[::-1] else known.camera

    def _take(self, frames: Mapping[str, Frame], *, by_itself: bool) -> None:
        """Keep frames as they were judged: first the files, then a word, then what follows from them."""
        try:
            files = self.folder.write({camera: frame.pixels for camera, frame in frames.items()})
        except InputError as error:
            self._notice(str(error))
            return
        name = next(iter(files.values())).name
        self._tell(TakenMessage(name, by_itself))
        found = {camera: self._exact(camera, frame.pixels, name) for camera, frame in frames.items()}
        for camera in frames:
            self._shutters[camera] = self._shutters[camera].fired()
            self._last[camera] = replace(self._last[camera], is_taken=True)
            self._keep(camera, files[camera], found[camera])
        self._follow()

    def _keep(self, camera: str, file: Path, found: Detections) -> None:
        """Count a photo, unless its moment was deleted."""
        name = self._moment(found.image)
        is_left_out = name in self.folder.record.left_out
        before = self.kept.get(name, KeptMoment(is_left_out=is_left_out))
        self.kept[name] = before.with_photo(camera, file, found)
        if not is_left_out:
            self.guide = self.guide.with_photo(camera, found)

    # ---- what the page is told

    @property
    def state(self) -> StateMessage:
        """Where the session is."""
        told = zip(self.sources, self.folder.record.sources, self._faults, strict=True)
        states = tuple(SourceState(source.kind, name, fault) for source, name, fault in told)
        left_s = None if self._ends_s is None else max(0.0, self._ends_s - self._now_s())
        return StateMessage(
            self.phase, self._words, self.folder.folder.name, states, self._is_automatic, True, left_s,
            self._said,
        )  # fmt: skip

    def greet(self) -> None:
        """Tell a page all that it is to show."""
        self._tell(self.state)
        scene = target_scene(self.target, body_colour=BODY, ink_colour=INK)
        self._tell_guidance(scene_json(scene))

    def _tell_guidance(self, scene: str = "") -> None:
        gone = (kept for kept in self.kept.values() if kept.is_left_out)
        found = [[kept.found[camera] for camera in self.guide.names if camera in kept.found] for kept in gone]
        left_out = (TakenPhoto(one[0].image, sum(len(of.ring) for of in one), False, "deleted", ()) for one in found)
        self._tell(GuidanceMessage(self.guide.told, scene, tuple(left_out)))

    def _notice(self, said: str) -> None:
        self._tell(NoticeMessage(said, is_fault=True))

    def report(self, phase: Phase, said: str = "") -> None:
        """Go to another phase, with a word on it; a countdown ends with its own."""
        self.phase, self._said = phase, said
        self._ends_s = self._now_s() + ENDS_IN_S if phase == "ending" else None
        self._tell(self.state)

    def begin_to_solve(self) -> bool:
        """Go on to the whole run of the photos, if there are any, and none is made."""
        if self.phase in ("solving", "done"):
            return False
        if not self.photos:
            self._notice("there is no photo yet; take some first")
            return False
        self.report("solving")
        return True

    def source_says(self, row: int, fault: str) -> None:
        """A source stopped, for a reason, or works again (""); others go on without a camera that is gone."""
        if fault:
            self._last.pop(self.guide.names[row], None)
        if self._faults[row] != fault:
            self._faults[row] = fault
            self._tell(self.state)

    def _follow(self) -> None:
        """After the photos changed."""
        self._tell_guidance()
        is_enough = self.guide.told.stage in ("good", "exhausted")
        if self.phase == "taking" and is_enough and not self._goes_on:
            self.report("ending", self.guide.told.headline)
        elif self.phase == "ending" and not is_enough:
            self.report("taking")

    # ---- what comes in

    def tick(self) -> bool:
        """Whether time has come to end."""
        return self._ends_s is not None and self._now_s() >= self._ends_s

    def command(self, command: PageCommand) -> None:
        """What a person does; `finish` and `bye` are for whoever calls."""
        try:
            if self.takes_photos or (command.kind == "more" and self.phase == "failed"):
                self._do(command)
        except NotWrittenError as error:
            self._notice(str(error))

    def _do(self, command: PageCommand) -> None:
        match command.kind:
            case "take":
                self._take_last()
            case "delete" | "restore":
                self._leave_out(self._moment(command.name), is_left_out=command.kind == "delete")
            case "skip":
                self.guide = self.guide.skipping()
                self._rearm()
                self._tell_guidance()
            case "more":
                self._goes_on = True
                if self.phase != "taking":
                    self.report("taking")
            case "automatic" | "by_hand":
                self._is_automatic = command.kind == "automatic"
                self._tell(self.state)
            case "source":
                rows = [row for row, source in enumerate(self.sources) if source.kind == "browser"]
                if rows:
                    self.source_says(rows[0], command.name[:LONGEST_FAULT])

    def _leave_out(self, moment: str, *, is_left_out: bool) -> None:
        """Delete the photos of a moment, or restore them; their files stay."""
        kept = self.kept.get(moment)
        if kept is None or kept.is_left_out == is_left_out:
            self._notice(f"there is no such {'' if is_left_out else 'deleted '}photo")
            return
        self.folder.leave_out(moment, is_left_out=is_left_out)
        self.kept[moment] = replace(kept, is_left_out=is_left_out)
        if is_left_out:
            self.guide = self.guide.without_moment(moment)
            self._rearm()
        else:
            for camera, found in kept.found.items():
                self.guide = self.guide.with_photo(camera, found)
        self._follow()

    def _rearm(self) -> None:
        """Another view was proposed: what stands still may be taken again."""
        self._shutters = {camera: shutter.rearmed() for camera, shutter in self._shutters.items()}

    def _take_last(self) -> None:
        now_s = max((one.frame.time_s for one in self._last.values()), default=0.0)
        frames = {
            camera: one.frame
            for camera, one in self._last.items()
            if not one.is_taken and now_s - one.frame.time_s <= AT_ONCE_S
        }
        if frames:
            self._take(frames, by_itself=False)
        elif self._last:
            self._notice("this picture is taken already; the next one comes in a moment")
        else:
            self._notice(f"there is no picture yet; start the camera{'s' * (len(self.sources) > 1)}")

    def frame(self, frame: Frame) -> None:
        """A frame of a source."""
        if not self.takes_photos:
            return
        self.source_says(frame.source, "")
        camera, pixels, target = self.guide.names[frame.source], frame.pixels, self.target
        sized = self.guide.sized(camera, (pixels.shape[1], pixels.shape[0]))
        if sized is not self.guide:  # the first proposal is for images of the size that come
            self.guide = sized
            self._tell_guidance()
        if self.sources[frame.source].kind != "browser":
            self._show(frame)
        if frame.file is None:
            likely = self._likely(camera, pixels)
            lens = None if likely is None else CameraLens(likely)
            found = look_quickly(pixels, target, f"frame {frame.number}", None, lens)
        else:
            own = frame.file.name if len(self.sources) == 1 else own_moment(camera, frame.file)
            found = self._exact(camera, pixels, own)
        look = self.guide.look(camera, found, self._notes(camera, frame, found))
        shutter = self._shutters[camera] = self._shutters[camera].after(frame.time_s, found, look)
        size = np.where(target.radius_outer_mm[found.ring] > 0, 1.0, AROUND_CORNERS)
        circles = np.column_stack([found.center_px, size * found.ellipse_px[:, 2]])
        labels = labels_of(found, target)
        self._tell(LookMessage(frame.source, frame.number, (circles,), labels, look, shutter.still))
        if frame.file is not None:
            whose = "" if len(self.sources) == 1 else f"{camera}: "
            self._tell(TakenMessage(f"{whose}{frame.file.name}", by_itself=False))
            self._keep(camera, frame.file, found)
            self._follow()
            return
        self._last[camera] = SeenFrame(frame, found, look)
        if self._is_automatic and self.phase == "taking" and (frames := self._due()):
            self._take(frames, by_itself=True)

    def _notes(self, camera: str, frame: Frame, found: Detections) -> tuple[FrameNote, ...]:
        """What is wrong with a frame, by the blur of the sharpest one so far, which tells what the lens can do."""
        strange = 0 if found.rejected_px is None else len(found.rejected_px)
        if not len(found.ring) and strange >= MANY_RINGS and found.remarks:
            return (FrameNote("target", f"rings, but not this target's: {found.remarks[-1]}", forbids=True),)
        quality = frame_quality(frame.pixels, found, self.target)
        notes = notes_of(quality, self._sharpest_px[camera])
        if quality is not None and quality.blur_px > 0 and not notes:
            self._sharpest_px[camera] = min(self._sharpest_px[camera], quality.blur_px)
        return notes

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


def labels_of(found: Detections, target: TargetGeometry) -> tuple[tuple[float, float, str], ...]:
    """Where the faces of a solid are in an image, and what they are called; none of a board."""
    if target.face_count < 2 or not len(found.ring):
        return ()
    face = target.ring_face[found.ring]
    return tuple(
        (*np.round(found.center_px[face == number].mean(axis=0), 1).tolist(), str(number))
        for number in np.unique(face).tolist()
    )
