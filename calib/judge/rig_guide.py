"""Guidance while several cameras see one target: a guide for each of them, and one for how they stand together."""

from collections.abc import Sequence
from dataclasses import replace
from functools import cached_property
from os import PathLike

import numpy as np

from calib.core.se3 import compose
from calib.core.types import Detections
from calib.judge.criteria import STANDARD, read_rig_criteria
from calib.judge.guide import Guide
from calib.judge.guide_held import are_near, ghost_lines, held_at
from calib.judge.guide_told import ALL, Bar, CameraGuidance, FrameNote, Ghost, Guidance, Look, Stage, TakenPhoto
from calib.judge.looking import LookedFor, look_at_frame
from calib.judge.rig_next_frames import NextFrame
from calib.judge.rig_standing import RigStanding, join_bars, moment_of, rig_standing_of, shared_moments
from calib.judge.telling import ghost_at
from calib.observe.rig_observations import require_names
from designer.base.arrays import Array
from designer.base.errors import InputError
from designer.base.words import figure, shown
from designer.target import TargetGeometry, load_target

TOGETHER = 2
"""So many cameras are to see the target at once for a photo that joins them."""


class RigGuide:
    """Says where to hold the target next before several cameras: `calib.RigGuide("ico.target.json", ["a", "b"])`.

    >>> guide = calib.RigGuide("ico.target.json", ["left", "right"])
    >>> guide = guide.with_photo("left", left.detect(frame, "0001.png"))
    >>> guide = guide.with_photo("right", right.detect(other, "0001.png"))
    >>> guide.told.ghost.sentence

    Photos of one moment have one name, whatever ends it. As with `Guide` each photo makes another guide, and what it
    tells is found when it is first asked for. First each camera is made known by itself, the one that is known worst
    first; every photo that shows the target to several joins them. Then the places are proposed that join them best.

    Args:
        target: what the photos show: a geometry, or its file.
        names: of the cameras.
        criteria: when cameras and rig are good: a template's name, or a file.
        model: of all cameras, as of `Guide`.
        made: how the target was made, as for `calib.run`.

    Raises:
        InputError: names that two cameras have, a file that cannot be read, or words that mean nothing.
    """

    def __init__(
        self, target: TargetGeometry | str | PathLike[str], names: Sequence[str], *, criteria: str = STANDARD,
        model: str = ALL, made: str | None = None,
    ) -> None:  # fmt: skip
        if not names:
            raise InputError("no camera; give a name for each")
        require_names(names, fewest=1)
        geometry = target if isinstance(target, TargetGeometry) else load_target(target, "rings")
        one = Guide(geometry, criteria=criteria, model=model, made=made)
        self.guides = dict.fromkeys(names, one)
        self._limits = read_rig_criteria(criteria)
        self._skipped: tuple[Array, ...] = ()  # `rig_from_target` (4, 4) that cannot be held

    @property
    def names(self) -> tuple[str, ...]:
        """Of the cameras."""
        return tuple(self.guides)

    @property
    def moments(self) -> tuple[str, ...]:
        """The moments that photos were taken in, by name."""
        return tuple(sorted({moment_of(photo.image) for one in self.guides.values() for photo in one.photos}))

    @property
    def is_good(self) -> bool:
        """Whether the photos suffice, of each camera and of all together."""
        return self.told.stage == "good"

    def of(self, name: str) -> Guide:
        """The guide of one camera.

        Raises:
            InputError: there is none of that name.
        """
        if name not in self.guides:
            raise InputError(f"{shown(name)}: no camera is called so; there are {', '.join(map(shown, self.guides))}")
        return self.guides[name]

    def with_photo(self, camera: str, found: Detections) -> "RigGuide":
        """With one more photo of a camera; errors as `Guide.with_photo`."""
        return self._with({camera: self.of(camera).with_photo(found)})

    def without_moment(self, moment: str) -> "RigGuide":
        """Without the photos of a moment, of all cameras.

        Raises:
            InputError: there is none of that name.
        """
        changed = {
            name: guide.without_photo(photo.image)
            for name, guide in self.guides.items()
            for photo in guide.photos
            if moment_of(photo.image) == moment
        }
        if not changed:
            raise InputError(f"{shown(moment)}: no moment is called so; there are {len(self.moments)}")
        return self._with(changed)

    def skipping(self) -> "RigGuide":
        """With another proposal, as this one cannot be held."""
        if self._worst is not None:
            return self._with({self._worst: self.guides[self._worst].skipping()})
        other = self._with({})
        if self._frame is not None:
            other._skipped = (*self._skipped, self._frame.rig_from_target)
        return other

    def sized(self, camera: str, image_size: tuple[int, int]) -> "RigGuide":
        """With the size of a camera's frames; that of photos goes before it."""
        sized = self.of(camera).sized(image_size)
        return self if sized is self.guides[camera] else self._with({camera: sized})

    def look(self, camera: str, found: Detections, quality_notes: Sequence[FrameNote] = ()) -> Look:
        """What a frame of a camera shows, and whether it is worth taking; errors as `of`."""
        guide = self.of(camera)
        if self.wanted_at_once == 1:
            return guide.look(found, quality_notes)
        look = look_at_frame(found, self._joining[camera], quality_notes)
        is_new = look.worth >= 1 and not any(note.forbids for note in quality_notes)
        return replace(look, is_wanted=is_new) if self._frame is None else look

    @property
    def wanted_at_once(self) -> int:
        """In how many cameras a moment must be worth taking: in two once all are known, and only joins are wanted."""
        return 1 if len(self.guides) == 1 or self._worst is not None else TOGETHER

    @cached_property
    def told(self) -> Guidance:
        """All that is to be shown between two photos."""
        parts = {name: guide.told for name, guide in self.guides.items()}
        if len(parts) == 1:
            return next(iter(parts.values()))
        cameras = tuple(
            replace(told.cameras[0], name=name, ghost_px=self._lines(name, told.cameras[0]))
            for name, told in parts.items()
        )
        worst = (_worst_bar(name, told) for name, told in parts.items())
        bars = (*worst, *join_bars(self.guides, self.standing, self._limits))
        remarks = tuple(f"{name}: {remark}" for name, told in parts.items() for remark in told.remarks)
        return Guidance(self._stage, self._headline, bars, cameras, self._ghost, self._photos, remarks)

    @property
    def _stage(self) -> Stage:
        if self._worst is not None:
            return "first" if all(one.calibration is None for one in self.guides.values()) else "guiding"
        if self.standing is not None and self.standing.is_good and all(one.is_good for one in self.guides.values()):
            return "good"
        return "guiding" if self._frame is not None or self._untied is not None else "exhausted"

    @property
    def _headline(self) -> str:
        count = f"{len(self.moments)} moment{'s' * (len(self.moments) != 1)}"
        if self._worst is not None:
            return f"{self._worst}: {self.guides[self._worst].told.headline}; {count} in all"
        if self._untied is not None:
            return f"hold the target where {self._untied[0]} and {self._untied[1]} both see it; {count}"
        if self.standing is None:
            lost = next((name for name, one in self.guides.items() if one.verdict is None), self.names[0])
            return f"{lost}: {self.guides[lost].told.headline}; {count} in all"
        said = self.standing.judged.verdict.sentence
        return f"good: {said}; {count} are enough" if self._stage == "good" else f"{said}; {count}"

    @cached_property
    def standing(self) -> RigStanding | None:
        """The rig as far as it is known; None as long as a camera is not, or they are not joined."""
        return rig_standing_of(self.guides, self._limits) if len(self.guides) > 1 else None

    @cached_property
    def _worst(self) -> str | None:
        """The camera that is known worst of those that photos would make better; None: there is none."""
        open_ = [
            (min((bar.share for bar in one.told.bars), default=0.0), name)
            for name, one in self.guides.items()
            if one.told.ghost is not None
        ]
        return min(open_)[1] if open_ else None

    @property
    def _untied(self) -> tuple[str, str] | None:
        """The two cameras that share the fewest moments, if all are known, and yet not joined."""
        if self.standing is not None or any(one.verdict is None for one in self.guides.values()):
            return None
        shared = shared_moments(self.guides)
        return min(shared, key=lambda pair: (shared[pair], pair))

    @cached_property
    def _frame(self) -> NextFrame | None:
        """What joins the cameras best, once each of them is known."""
        if self._worst is not None or self.standing is None:
            return None
        shape = next(iter(self.guides.values())).shape
        for frame in self.standing.judged.next_frames:
            pose = frame.rig_from_target[None]
            if not any(are_near(shape, skipped, pose)[0] for skipped in self._skipped):
                return frame
        return None

    def _held(self, camera: str) -> Array | None:
        """Where the target is to be for a camera; None: it need not see it.  # (4, 4)"""
        frame, standing = self._frame, self.standing
        if frame is None or standing is None or camera not in frame.cameras:
            return None
        return compose(standing.cam_from_rig[camera], frame.rig_from_target)

    def _lines(self, name: str, told: CameraGuidance) -> tuple[Array, ...]:
        held, guide = self._held(name), self.guides[name]
        if held is None or guide.calibration is None:
            return told.ghost_px if name == self._worst else ()
        return ghost_lines(guide.settings.target, guide.calibration.camera, held)

    @cached_property
    def _ghost(self) -> Ghost | None:
        if self._worst is not None:
            ghost = self.guides[self._worst].told.ghost
            return ghost and replace(
                ghost, sentence=f"{self._worst}: {ghost.sentence}", short=f"{self._worst}: {ghost.short}"
            )
        frame = self._frame
        name = None if frame is None else next(one for one in self.guides if one in frame.cameras)
        pose = None if name is None else self._held(name)
        if frame is None or name is None or pose is None:
            return None
        guide = self.guides[name]
        gain = f"{figure(frame.sigma_mm_before, 2)} -> {figure(frame.sigma_mm_after, 2)} mm"
        ghost = ghost_at(pose, guide.camera, guide.shape, frame.sentence, gain, is_rough=False)
        return replace(ghost, short=f"{name}: {ghost.short}")

    @cached_property
    def _joining(self) -> dict[str, LookedFor]:
        """What frames of each camera are compared with once only joins are wanted."""
        shared = self._together
        looked = {}
        for name, guide in self.guides.items():
            held, seen = self._held(name), guide.observations
            names = () if seen is None else seen.view_names
            rows = np.array([moment_of(view) in shared for view in names], dtype=np.bool_)
            wanted = None if held is None else held_at(guide.camera, guide.shape, held)
            last = guide.photos[-1] if guide.photos else None
            looked[name] = LookedFor(
                guide.camera, guide.settings.points, guide.shape, wanted, None, guide.taken[rows], last
            )
        return looked

    @property
    def _together(self) -> set[str]:
        """Moments in which several cameras see the target."""
        seen = [moment_of(photo.image) for one in self.guides.values() for photo in one.photos]
        return {moment for moment in seen if seen.count(moment) >= TOGETHER}

    @property
    def _photos(self) -> tuple[TakenPhoto, ...]:
        of_moment: dict[str, list[tuple[str, TakenPhoto]]] = {moment: [] for moment in self.moments}
        for name, guide in self.guides.items():
            for photo in guide.told.photos:
                of_moment[moment_of(photo.name)].append((name, photo))
        return tuple(_together_told(photos) for photos in of_moment.values())

    def _with(self, changed: dict[str, Guide]) -> "RigGuide":
        other = object.__new__(RigGuide)
        other.guides = {**self.guides, **changed}
        other._limits, other._skipped = self._limits, self._skipped
        return other


def _worst_bar(name: str, told: Guidance) -> Bar:
    """Of a camera's bars, the one that says how far it is."""
    worst = min(told.bars, key=lambda bar: bar.share)
    return replace(worst, name=f"camera {name}", title=f"{name}: {worst.title}")


def _together_told(photos: Sequence[tuple[str, TakenPhoto]]) -> TakenPhoto:
    """The photos of a moment as one."""
    remark = "; ".join(f"{name}: {photo.remark}" for name, photo in photos if photo.remark)
    rings = sum(photo.rings for _, photo in photos)
    is_counted = any(photo.is_counted for _, photo in photos)
    return replace(photos[0][1], rings=rings, is_counted=is_counted, remark=remark)
