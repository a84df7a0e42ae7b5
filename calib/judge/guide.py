"""Guidance while photos are taken, as a value: photo after photo, and frame after frame."""

import math
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from os import PathLike

import numpy as np

from calib.cameras.camera import Camera
from calib.core.parallel import one_thread
from calib.core.types import Detections, Observations
from calib.judge.candidate_views import first_pose, guessed_camera
from calib.judge.checks import STANDARD
from calib.judge.guidance import (
    CameraGuidance,
    FrameNote,
    Ghost,
    Guidance,
    Look,
    Stage,
    bars_of,
    ghost_at,
    headline_of,
    map_of,
    photos_of,
)
from calib.judge.guide_state import ALL, GuideSettings, Insight, insight_of, judged, settings_of
from calib.judge.live_frame import LookedFor, frame_pose, look_at_frame
from calib.judge.next_views import NextView, gains_of, next_view_search, proposed_views
from calib.judge.target_hints import Line, are_near, ghost_lines, held_at
from calib.judge.verdict import Criteria, Verdict
from calib.judge.view_search import ViewGoal
from calib.judge.views import TargetShape
from calib.solver.calibration import Calibration
from designer.base.arrays import Array, Flags
from designer.base.errors import InputError
from designer.base.words import figure, shown
from designer.target import TargetGeometry, load_target

USUAL_SIZE = (1280, 720)
"""Of images, as long as nobody says theirs."""
NAME = "camera"


ENOUGH_PHOTOS = 12
"""With so many, checks that fail although the camera is known as well as wanted fail for another reason than chance."""
LITTLE_BY_TARGET = 0.3
"""Of the uncertainty: a smaller part by the target enlarges it by less than a twentieth."""
LITTLE_OF_NOISE = 0.995
"""A photo that leaves more than this of the deviation is not worth taking, where noise is most of it: several do."""


@dataclass(frozen=True, eq=False)
class Proposal:
    """A view to take next."""

    cam_from_target: Array  # (4, 4)
    view: NextView | None  # what it gives; None: no camera is known
    is_for_accuracy: bool = True  # the camera is better known by it; else a part of the image is shown first


@one_thread
def proposal_of(
    calibration: Calibration, known: Insight, settings: GuideSettings, avoided: Sequence[Array]
) -> Proposal | None:
    """The view that tells most of those that are not avoided; None if none tells anything.

    Args:
        calibration: that is known, whole or in part.
        known: all of it.
        settings: what is asked.
        avoided: poses of what cannot be done (4, 4).
    """
    if known.is_enough:
        return None
    uncertain = None if known.standing is None else known.standing.evidence.uncertainty
    # To follow what photos tell of the target's shape takes a while, and is worth it where that is a part of the error.
    is_targets = uncertain is not None and uncertain.target_px > LITTLE_BY_TARGET * (uncertain.image_px or 0.0)

    def is_avoided(poses: Array) -> Flags:
        near = np.zeros(len(poses), dtype=np.bool_)
        for pose in avoided:
            near |= are_near(settings.shape, pose, poses)
        return near

    search = next_view_search(
        calibration, factor=1.0 if uncertain is None else uncertain.factor, opened=known.opened if is_targets else None,
        is_avoided=is_avoided if avoided else None, shape=settings.shape,
    )  # fmt: skip
    if search is None:
        return None
    for goal in _goals(known, settings):
        for view in proposed_views(search, goal, 1):
            tells = view.sigma_px_before > goal.sigma_px
            tells &= view.sigma_px_after <= goal.little_gain * view.sigma_px_before
            return Proposal(view.cam_from_target, view, tells)
    return None


def _goals(known: Insight, settings: GuideSettings) -> list[ViewGoal]:
    """What views are sought for, one after the other: the deviation, what is covered, and which gain is little.

    As long as some of the image is not covered, a view that hardly makes the camera better known gives way to one that
    shows more. What is as good as wanted, and yet not good in the verdict, is to be better than wanted.
    """
    wanted_px, wanted_share = settings.criteria["uncertainty"].good, settings.criteria["coverage"].good / 100
    wanted, closely = ViewGoal(wanted_px, wanted_share), ViewGoal(wanted_px, wanted_share, LITTLE_OF_NOISE)
    beyond = [ViewGoal(0.0, 1.0, LITTLE_OF_NOISE)] if known.photos < ENOUGH_PHOTOS else []
    if known.standing is None:
        return [wanted, *beyond]
    uncertain = known.standing.evidence.uncertainty
    is_sure = uncertain.image_px is not None and uncertain.image_px <= wanted_px
    if is_sure and known.covered >= wanted_share:
        return beyond
    if not is_sure and (uncertain.by_target or uncertain.by_field):
        # More photos than are reckoned with here also tell the target's shape: some are always taken.
        return [wanted, *beyond]
    return [*([wanted] if known.covered < wanted_share else []), closely, *beyond]


def ghost_of(proposal: Proposal, camera: Camera, shape: TargetShape, *, is_rough: bool) -> Ghost:
    """A proposed view in words."""
    view, sentence, gain = proposal.view, "", ""
    if view is not None:
        sentence, gain = view.sentence, f"{100 * view.covered_before:.0f} -> {100 * view.covered_after:.0f} % covered"
        if proposal.is_for_accuracy:
            before = f"{figure(view.sigma_px_before, 2)} -> " if math.isfinite(view.sigma_px_before) else ""
            gain = f"{before}{figure(view.sigma_px_after, 2)} px"
    return ghost_at(proposal.cam_from_target, camera, shape, sentence, gain, is_rough=is_rough)


class Guide:
    """Says where to hold the target next, and when a camera is good: `calib.Guide("ico.target.json")`.

    >>> guide = calib.Guide("ico.target.json", image_size=(1280, 720))
    >>> guide.told.ghost.sentence
    >>> look = guide.look(detector.glance(frame))
    >>> guide = guide.with_photo(detector.detect(frame, "0001.png"))

    It never changes: a photo makes another one, solved again from all photos. What it tells is found when it is first
    asked for, in a quarter of a second.

    Args:
        target: what the photos show: a geometry, or its file.
        criteria: when a camera is good: a template's name, a file, or criteria.
        model: of the camera; `all`: an ordinary lens, or a wide one if the photos show that it is.
        made: how the target was made, as for `calib.run`.
        camera: a first guess; the photos tell better soon.
        image_size: width and height of the photos in px, for the first proposal; else the first photo says it.

    Raises:
        InputError: a file that cannot be read, or words that mean nothing.
    """

    def __init__(
        self, target: TargetGeometry | str | PathLike[str], *, criteria: Criteria | str = STANDARD, model: str = ALL,
        made: str | None = None, camera: Camera | None = None, image_size: tuple[int, int] | None = None,
    ) -> None:  # fmt: skip
        geometry = target if isinstance(target, TargetGeometry) else load_target(target, "rings")
        self.settings = settings_of(geometry, criteria, model, made, camera)
        self._image_size = image_size or (USUAL_SIZE if camera is None else camera.image_size)
        self._photos: tuple[Detections, ...] = ()
        self._skipped: tuple[Array, ...] = ()  # poses (4, 4) that cannot be held

    @property
    def photos(self) -> tuple[Detections, ...]:
        """What was found in the photos, in the order they were taken."""
        return self._photos

    @property
    def observations(self) -> Observations | None:
        """What the photos show that count; None: none does."""
        return self._insight.observations

    @property
    def calibration(self) -> Calibration | None:
        """The camera as far as it is known; None if not even its focal length is."""
        return self._insight.calibration

    @property
    def verdict(self) -> Verdict | None:
        """On the camera; None as long as the photos do not determine all of it."""
        return None if self._insight.standing is None else self._insight.standing.verdict

    @property
    def is_good(self) -> bool:
        """Whether the photos suffice."""
        return self.told.stage == "good"

    def with_photo(self, found: Detections) -> "Guide":
        """With one more photo, or another one of the same name.

        Raises:
            InputError: it is no detection, or has no name.
        """
        if not isinstance(found, Detections) or not found.image:
            raise InputError(f"{shown(str(found))}: give what was detected in a photo, with a name")
        others = tuple(one for one in self._photos if one.image != found.image)
        return self._with((*others, found), self._skipped)

    def without_photo(self, name: str) -> "Guide":
        """Without a photo.

        Raises:
            InputError: there is none of that name.
        """
        others = tuple(one for one in self._photos if one.image != name)
        if len(others) == len(self._photos):
            raise InputError(f"{shown(name)}: no photo is called so; there are {len(self._photos)}")
        return self._with(others, self._skipped)

    def skipping(self) -> "Guide":
        """With another proposal, as this one cannot be held."""
        if self._proposal is None:
            return self
        other = self._with(self._photos, (*self._skipped, self._proposal.cam_from_target))
        other.__dict__.update(_insight=self._insight)  # what the photos tell is the same
        return other

    def sized(self, image_size: tuple[int, int]) -> "Guide":
        """With the size of the frames; that of photos goes before it."""
        if image_size == self._image_size or self._insight.photos:
            return self
        other = self._with(self._photos, self._skipped)
        other._image_size = image_size
        return other

    def look(self, found: Detections, quality_notes: Sequence[FrameNote] = ()) -> Look:
        """What a frame shows, and whether it is worth taking.

        Args:
            found: in the frame, by a quick look.
            quality_notes: what is wrong with it.
        """
        return look_at_frame(found, self._looked_for, quality_notes)

    @cached_property
    def told(self) -> Guidance:
        """All that is to be shown between two photos."""
        known, settings, proposal = self._insight, self.settings, self._proposal
        ghost: Ghost | None = None
        ghost_px: tuple[Line, ...] = ()
        if proposal is not None:
            ghost = ghost_of(proposal, self.camera, settings.shape, is_rough=known.standing is None)
            ghost_px = ghost_lines(settings.target, self.camera, proposal.cam_from_target)
        if self.calibration is None:
            stage: Stage = "first"
        elif known.is_good and (known.is_enough or proposal is None):
            stage = "good"
        else:
            stage = "exhausted" if proposal is None else "guiding"
        map_ = map_of(known, settings.criteria["uncertainty"].good)
        return Guidance(
            stage, headline_of(stage, known, settings), bars_of(known, settings),
            (CameraGuidance(NAME, self.camera.image_size, map_, ghost_px),), ghost,
            photos_of(self._photos, known, settings.points.face),
            () if self.calibration is None else self.calibration.remarks,
        )  # fmt: skip

    @cached_property
    def _insight(self) -> Insight:
        return judged(insight_of(self._photos, self.settings), self.settings)

    @cached_property
    def camera(self) -> Camera:
        """As it is known, or a usual one."""
        if self.calibration is not None:
            return self.calibration.camera
        seen = self._insight.observations
        return guessed_camera(self._image_size if seen is None else seen.image_size, self.settings.camera)

    @cached_property
    def taken(self) -> Array:
        """Where the target was in the photos that count, by the camera as it is known.  # (V, 4, 4)"""
        if self.calibration is not None:
            return self.calibration.cam_from_target
        poses = [frame_pose(one, self.camera, self.settings.points) for one in self._photos]
        return np.array([pose for pose in poses if pose is not None]).reshape(-1, 4, 4)

    @cached_property
    def _proposal(self) -> Proposal | None:
        if self.calibration is None:
            taken = np.concatenate([self.taken, np.array(self._skipped).reshape(-1, 4, 4)])
            return Proposal(first_pose(self.camera, self.settings.shape, taken), None)
        asked = (self.calibration, self._insight, self.settings)
        # The last photo once more is no progress, but of a small target held near all others are like it.
        return proposal_of(*asked, (*self._skipped, self.taken[-1])) or proposal_of(*asked, self._skipped)

    @cached_property
    def _looked_for(self) -> LookedFor:
        proposal, shape, covered = self._proposal, self.settings.shape, self._insight.coverage
        wanted = None if proposal is None else held_at(self.camera, shape, proposal.cam_from_target)
        gains = None
        if self.calibration is not None and covered is not None and proposal is not None and proposal.view is not None:
            is_for_accuracy = proposal.is_for_accuracy
            gains = gains_of(self.calibration, shape, covered, proposal.view, is_for_accuracy=is_for_accuracy)
        last = self._photos[-1] if self._photos else None
        return LookedFor(self.camera, self.settings.points, shape, wanted, gains, self.taken, last)

    def _with(self, photos: tuple[Detections, ...], skipped: tuple[Array, ...]) -> "Guide":
        other = object.__new__(Guide)
        other.settings, other._image_size = self.settings, self._image_size
        other._photos, other._skipped = photos, skipped
        return other
