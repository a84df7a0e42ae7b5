"""Guidance while photos are taken, as a value: photo after photo, and frame after frame."""

import math
from collections.abc import Sequence
from functools import cached_property
from os import PathLike

import numpy as np

from calib.cameras.camera import Camera
from calib.core.types import Detections, Observations
from calib.judge.candidate_views import first_pose, guessed_camera
from calib.judge.checks import STANDARD
from calib.judge.coverage import Coverage, coverage, coverage_of
from calib.judge.guidance import (
    ALL,
    CameraGuidance,
    FrameNote,
    Ghost,
    Guidance,
    Line,
    Look,
    SensorMap,
    Stage,
    settings_of,
)
from calib.judge.guidance_words import bars_of, ghost_of, headline_of, map_of, photos_of, told_sigma_px
from calib.judge.guide_state import Insight, Proposal, Standing, insight_of, proposal_of, standing_of
from calib.judge.live_frame import LookedFor, frame_pose, look_at_frame
from calib.judge.next_views import ViewGains, gains_of
from calib.judge.target_hints import ghost_lines, held_at
from calib.judge.verdict import Criteria, Verdict
from calib.judge.views import TargetShape
from calib.solver.calibration import Calibration
from designer.base.arrays import Array
from designer.base.errors import InputError
from designer.base.words import shown
from designer.target import TargetGeometry, load_target

USUAL_SIZE = (1280, 720)
"""Of images, as long as nobody says theirs."""
NAME = "camera"


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
        return self._insight.calibration if self._standing is None else self._standing.calibration

    @property
    def verdict(self) -> Verdict | None:
        """On the camera; None as long as the photos do not determine all of it."""
        return None if self._standing is None else self._standing.verdict

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
        other.__dict__.update(_insight=self._insight, _standing=self._standing)  # what the photos tell is the same
        return other

    def sized(self, image_size: tuple[int, int]) -> "Guide":
        """With the size of the frames; that of photos goes before it."""
        if image_size == self._image_size or self._counted:
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
        calibration, standing, covered = self.calibration, self._standing, self._covered
        sigma_px = math.inf if calibration is None else told_sigma_px(calibration, standing)
        share = 0.0 if covered is None else covered.share
        map_: SensorMap | None = None
        ghost: Ghost | None = None
        ghost_px: tuple[Line, ...] = ()
        if calibration is not None and covered is not None:
            map_ = map_of(calibration, standing, covered, self.settings.criteria["uncertainty"].good)
        if self._proposal is not None:
            ghost = ghost_of(self._proposal, self.camera, self.shape, is_rough=standing is None)
            ghost_px = ghost_lines(self.settings.target, self.camera, self._proposal.cam_from_target)
        return Guidance(
            self._stage, headline_of(self._stage, sigma_px, share, standing, self.settings, self._counted),
            bars_of(share, sigma_px, standing, self.settings),
            (CameraGuidance(NAME, self.camera.image_size, map_, ghost_px),), ghost,
            photos_of(self._photos, self._insight, self.settings.points.face),
            () if calibration is None else calibration.remarks,
        )  # fmt: skip

    @property
    def _stage(self) -> Stage:
        if self.calibration is None:
            return "first"
        if self._standing is not None and self._standing.is_good and (self._standing.is_enough or not self._proposal):
            return "good"
        return "exhausted" if self._proposal is None else "guiding"

    @property
    def _counted(self) -> int:
        """How many photos count."""
        return 0 if self._insight.observations is None else self._insight.observations.view_count

    @cached_property
    def _insight(self) -> Insight:
        return insight_of(self._photos, self.settings)

    @cached_property
    def _standing(self) -> Standing | None:
        return standing_of(self._insight, self.settings)

    @cached_property
    def _covered(self) -> Coverage | None:
        """What the sightings surround; None without any."""
        if self._standing is not None:
            return self._standing.evidence.coverage
        if self._insight.calibration is not None:
            return coverage_of(self._insight.calibration)
        seen = self._insight.observations
        return (
            None if seen is None else coverage(seen.image_size, seen.center_px, seen.view, seen.points.face[seen.point])
        )

    @property
    def shape(self) -> TargetShape:
        """Of the target."""
        return self.settings.shape

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
            return Proposal(first_pose(self.camera, self.shape, taken), None)
        # The last photo once more is no progress, but of a small target held near all others are like it.
        asked = (self.calibration, self._standing, self.settings, self.shape)
        opened = self._insight.opened
        return proposal_of(*asked, (*self._skipped, self.taken[-1]), opened) or proposal_of(
            *asked, self._skipped, opened
        )

    @cached_property
    def _gains(self) -> ViewGains | None:
        proposal, covered = self._proposal, self._covered
        if self.calibration is None or covered is None or proposal is None or proposal.view is None:
            return None
        return gains_of(self.calibration, self.shape, covered, proposal.view, is_for_accuracy=proposal.is_for_accuracy)

    @cached_property
    def _looked_for(self) -> LookedFor:
        wanted = None
        if self._proposal is not None:
            wanted = held_at(self.camera, self.shape, self._proposal.cam_from_target)
        last = self._photos[-1] if self._photos else None
        return LookedFor(self.camera, self.settings.points, self.shape, wanted, self._gains, self.taken, last)

    def _with(self, photos: tuple[Detections, ...], skipped: tuple[Array, ...]) -> "Guide":
        other = object.__new__(Guide)
        other.settings, other._image_size = self.settings, self._image_size
        other._photos, other._skipped = photos, skipped
        return other
