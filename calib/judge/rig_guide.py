"""Guidance while several cameras see one target: of each of them, and how well they are known against each other."""

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from itertools import combinations
from os import PathLike
from pathlib import PurePath
from typing import Literal

import numpy as np

from calib.cameras.rig import Rig
from calib.core.parallel import one_thread_with_scipy
from calib.core.se3 import compose
from calib.core.types import Detections
from calib.judge.checks import STANDARD
from calib.judge.guidance import Bar, FrameNote, Ghost, Guidance, Look, Stage, TakenPhoto, bar_of, ghost_at
from calib.judge.guide import Guide
from calib.judge.guide_state import ALL
from calib.judge.joint_halves import enlarged, half_solver, rig_halves
from calib.judge.judge import Judged, judge_rig
from calib.judge.live_frame import LookedFor, look_at_frame
from calib.judge.target_hints import Line, are_near, ghost_lines, held_at
from calib.judge.verdict import Grade, Limits, NextFrame, at_most, measured_text
from calib.observe.rig_observations import RigSightings, require_names, rig_observations
from calib.rigs.problem import CameraChoice, RigOptions
from calib.rigs.relative import relative
from calib.rigs.result import RigCalibration
from calib.rigs.solve import solve_rig
from calib.rigs.target_error import with_target_error
from designer.base.arrays import Array
from designer.base.errors import InputError
from designer.base.words import figure, shown
from designer.target import TargetGeometry

MOST_PAIRS = 8
"""That are listed, of a rig with many cameras those that are known worst."""
ALWAYS = ("frames", "halves", "space")
"""Checks of a rig that have a bar besides those of its pairs."""
TOGETHER = 2
"""So many cameras are to see the target at once for a photo that joins them."""


@dataclass(frozen=True, eq=False)
class RigStanding:
    """A rig that is solved, and what is to be said of it."""

    calibration: RigCalibration
    judged: Judged


def moment_of(image: str) -> str:
    """What a photo's moment is called: photos of one moment are named alike."""
    return PurePath(image).stem


class RigGuide:
    """Says where to hold the target next before several cameras: `calib.RigGuide("ico.target.json", ["a", "b"])`.

    >>> guide = calib.RigGuide("ico.target.json", ["left", "right"])
    >>> guide = guide.with_photo("left", left.detect(frame, "0001.png"))
    >>> guide = guide.with_photo("right", right.detect(other, "0001.png"))
    >>> guide.told.ghost.sentence

    Photos of one moment have one name, whatever ends it. As with `Guide` each photo makes another guide, and what it
    tells is found when it is first asked for. First each camera is made known by itself, the one that is known worst
    first; every photo that shows the target to several joins them. Then the places are proposed that join them best.
    Before one camera it tells what `Guide` does.

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
        one = Guide(target, criteria=criteria, model=model, made=made)
        self.settings, self.guides = one.settings, dict.fromkeys(names, one)
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
        """Without the photos of a moment, of all cameras; it is also called as a photo of it.

        Raises:
            InputError: there is none of that name.
        """
        changed: dict[str, Guide] = {}
        for name, guide in self.guides.items():
            for photo in guide.photos:
                if moment in (photo.image, moment_of(photo.image)):
                    changed[name] = changed.get(name, guide).without_photo(photo.image)
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
            replace(told.cameras[0], name=name, ghost_px=self._lines(name, told)) for name, told in parts.items()
        )
        # Of a camera's bars, the one that says how far it is.
        worst = ((name, min(told.bars, key=lambda bar: bar.share)) for name, told in parts.items())
        own = (replace(bar, name=f"camera {name}", title=f"{name}: {bar.title}") for name, bar in worst)
        remarks = tuple(f"{name}: {remark}" for name, told in parts.items() for remark in told.remarks)
        return Guidance(
            self._stage, self._headline, (*own, *self._bars), cameras, self._ghost, self._photos, remarks
        )  # fmt: skip

    # ---- how well the cameras are known against each other

    @cached_property
    @one_thread_with_scipy
    def standing(self) -> RigStanding | None:
        """The rig, solved and judged; None as long as a camera is not known whole, or they are not joined."""
        if len(self.guides) == 1:
            return None
        cameras, choices = [], []
        for name, guide in self.guides.items():
            seen, known = guide.observations, guide.calibration
            if seen is None or known is None or guide.verdict is None:
                return None
            cameras.append(RigSightings(name, seen, {view: moment_of(view) for view in seen.view_names}))
            choices.append(CameraChoice(known.camera.model, known.camera))
        moments = sorted({moment for one in cameras for moment in one.frame.values()})
        try:
            observations, bend = rig_observations(cameras, moments), self.settings.plan.options_of(self.settings.model)
            options = RigOptions(free_bend=bool(bend.free_bend), bend_sigma_mm=bend.bend_sigma_mm)
            solved = solve_rig(observations, choices, options)
        except InputError:  # no frames tie some of them to the others yet
            return None
        found = with_target_error(solved, self.settings.made)
        halves = rig_halves(found, half_solver(found, choices, options))
        return RigStanding(found, judge_rig(found, halves, self.settings.criteria))

    @cached_property
    def _shared(self) -> dict[tuple[str, str], int]:
        """In how many moments each two cameras see the target."""
        moments = {
            name: set() if one.observations is None else set(map(moment_of, one.observations.view_names))
            for name, one in self.guides.items()
        }
        return {(a, b): len(moments[a] & moments[b]) for a, b in combinations(self.guides, 2)}

    @property
    def _bars(self) -> tuple[Bar, ...]:
        """How well the cameras of each pair are known against each other, and what else the rig's verdict asks."""
        if self.standing is None:
            fewest = sorted(self._shared.items(), key=lambda one: one[1])[:MOST_PAIRS]
            return tuple(_bar(pair, f"seen together {count} time{'s' * (count != 1)}", 0.0) for pair, count in fewest)
        judged = self.standing.judged
        rig = enlarged(self.standing.calibration, judged.rig_halves).rig
        pairs = (_pair_bar(rig, *pair, judged.criteria["baselines"]) for pair in combinations(range(len(rig.names)), 2))
        worst = sorted(pairs, key=lambda bar: bar.share)[:MOST_PAIRS]
        checks = (one for one in judged.verdict.checks if one.name in ALWAYS or one.grade != "good")
        return (*worst, *(bar_of(one) for one in checks if one.name != "baselines"))

    @property
    def _stage(self) -> Stage:
        if self._worst is not None:
            return "first" if all(one.calibration is None for one in self.guides.values()) else "guiding"
        is_joined = self.standing is not None and self.standing.judged.verdict.grade == "good"
        if is_joined and all(one.is_good for one in self.guides.values()):
            return "good"
        return "guiding" if self._frame is not None or self._untied is not None else "exhausted"

    @property
    def _headline(self) -> str:
        count = f"{len(self.moments)} moment{'s' * (len(self.moments) != 1)}"
        if self._worst is None and self._untied is not None:
            return f"hold the target where {self._untied[0]} and {self._untied[1]} both see it; {count}"
        if self._worst is not None or self.standing is None:
            unknown = (name for name, one in self.guides.items() if one.verdict is None)
            name = self._worst or next(unknown, self.names[0])
            return f"{name}: {self.guides[name].told.headline}; {count} in all"
        said = self.standing.judged.verdict.sentence
        return f"good: {said}; {count} are enough" if self._stage == "good" else f"{said}; {count}"

    # ---- what is proposed

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
        return min(self._shared, key=lambda pair: (self._shared[pair], pair), default=None)

    @cached_property
    def _frame(self) -> NextFrame | None:
        """What joins the cameras best, once each of them is known."""
        if self._worst is not None or self.standing is None:
            return None
        for frame in self.standing.judged.next_frames:
            pose = frame.rig_from_target[None]
            if not any(are_near(self.settings.shape, skipped, pose)[0] for skipped in self._skipped):
                return frame
        return None

    @cached_property
    def _held(self) -> dict[str, Array]:
        """Where the target is to be to join the cameras, for those that are to see it.  # each (4, 4)"""
        if self._frame is None or self.standing is None:
            return {}
        found, frame = self.standing.calibration, self._frame
        rows = {name: found.observations.camera_names.index(name) for name in self.guides if name in frame.cameras}
        return {name: compose(found.cam_from_rig[row], frame.rig_from_target) for name, row in rows.items()}

    def _lines(self, name: str, told: Guidance) -> tuple[Line, ...]:
        """The ghost in a camera that is to see it."""
        if name in self._held:
            return ghost_lines(self.settings.target, self.guides[name].camera, self._held[name])
        return told.cameras[0].ghost_px if name == self._worst else ()

    @cached_property
    def _ghost(self) -> Ghost | None:
        if self._worst is not None:
            name, ghost = self._worst, self.guides[self._worst].told.ghost
            return ghost and replace(ghost, sentence=f"{name}: {ghost.sentence}", short=f"{name}: {ghost.short}")
        if self._frame is None:
            return None
        name, pose = next(iter(self._held.items()))
        gain = f"{figure(self._frame.sigma_mm_before, 2)} -> {figure(self._frame.sigma_mm_after, 2)} mm"
        ghost = ghost_at(
            pose, self.guides[name].camera, self.settings.shape, self._frame.sentence, gain, is_rough=False
        )  # fmt: skip
        return replace(ghost, short=f"{name}: {ghost.short}")

    @cached_property
    def _joining(self) -> dict[str, LookedFor]:
        """What frames of each camera are compared with once only joins are wanted."""
        seen_in = [moment_of(photo.image) for one in self.guides.values() for photo in one.photos]
        shape, looked = self.settings.shape, {}
        for name, guide in self.guides.items():
            names = () if guide.observations is None else guide.observations.view_names
            rows = np.array([seen_in.count(moment_of(view)) >= TOGETHER for view in names], dtype=np.bool_)
            wanted = held_at(guide.camera, shape, self._held[name]) if name in self._held else None
            last = guide.photos[-1] if guide.photos else None
            looked[name] = LookedFor(
                guide.camera, self.settings.points, shape, wanted, None, guide.taken[rows], last
            )  # fmt: skip
        return looked

    @property
    def _photos(self) -> tuple[TakenPhoto, ...]:
        """The photos of each moment as one."""
        photos = []
        for moment in self.moments:
            parts = [
                (name, photo)
                for name, guide in self.guides.items()
                for photo in guide.told.photos
                if moment_of(photo.name) == moment
            ]
            rings, is_counted = sum(one.rings for _, one in parts), any(one.is_counted for _, one in parts)
            remark = "; ".join(f"{name}: {one.remark}" for name, one in parts if one.remark)
            photos.append(replace(parts[0][1], rings=rings, is_counted=is_counted, remark=remark))
        return tuple(photos)

    def _with(self, changed: dict[str, Guide]) -> "RigGuide":
        other = object.__new__(RigGuide)
        other.settings, other.guides, other._skipped = self.settings, {**self.guides, **changed}, self._skipped
        return other


def _pair_bar(rig: Rig, a: int, b: int, limit: Limits) -> Bar:
    """The distance of two cameras."""
    pair, names = relative(rig, a, b), (rig.names[a], rig.names[b])
    percent = 100 * pair.baseline_sigma_mm / max(pair.baseline_mm, 1e-9)
    if not math.isfinite(percent):
        return _bar(names, "not to be told yet", 0.0)
    measured = measured_text(percent, "%", (limit.good, limit.usable))
    known = f"{figure(pair.baseline_sigma_mm, 2)} mm of {figure(pair.baseline_mm, 3)} mm"
    share = min(limit.good / percent, 1.0) if percent > 0 else 1.0
    return _bar(names, f"{known}, {measured} %, {limit.good:g} % wanted", share, at_most(percent, limit))


def _bar(names: tuple[str, str], text: str, share: float, grade: Grade | Literal["unknown"] = "unknown") -> Bar:
    return Bar(f"pair {names[0]} {names[1]}", f"{names[0]} and {names[1]}", text, share, grade)
