"""How good a camera is after the photos so far, and which view would make it better."""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from calib.core.parallel import one_thread
from calib.judge.evidence import CameraEvidence, evidence_of, uncertainty_of
from calib.judge.guide_held import are_near
from calib.judge.guide_told import GuideSettings
from calib.judge.halves import half_split
from calib.judge.insight import Insight
from calib.judge.judge import judge
from calib.judge.next_views import LITTLE_GAIN, NextView, next_views
from calib.judge.verdict import Verdict
from calib.judge.views import TargetShape
from calib.solver.calibration import Calibration
from calib.solver.capture_error import with_capture_error
from calib.solver.problem import SolveOptions
from calib.solver.target_error import LeftOpen
from designer.base.arrays import Array, Flags

ENOUGH_PHOTOS = 12
"""With so many, checks that fail although the camera is known as well as wanted fail for another reason than chance."""
FEWEST_PHOTOS = 6
"""Halves of four photos agree by chance too often for their word to be taken: the true error of cameras that were good
after so few was beyond twice the stated one in 2 of 9 (`bench_guidance`)."""
LITTLE_BY_TARGET = 0.3
"""Of the uncertainty: a smaller part by the target enlarges it by less than a twentieth."""
LITTLE_OF_NOISE = 0.995
"""A photo that leaves more than this of the deviation is not worth taking, where noise is most of it: several do."""


@dataclass(frozen=True, eq=False)
class Standing:
    """What is to be said of a camera that the photos determine whole."""

    calibration: Calibration
    evidence: CameraEvidence
    verdict: Verdict

    @property
    def is_good(self) -> bool:
        """Whether nothing is left to be wished for but more photos."""
        return self.verdict.grade == "good"

    @property
    def is_enough(self) -> bool:
        """Whether so few photos as there are may be trusted to be good."""
        return self.is_good and self.calibration.observations.view_count >= FEWEST_PHOTOS


@one_thread
def standing_of(insight: Insight, settings: GuideSettings) -> Standing | None:
    """The verdict on a camera; None as long as the photos do not determine all of it."""
    found = insight.whole
    if found is None:
        return None
    halves = half_split(found, SolveOptions())
    standing = Standing(found, evidence := evidence_of([found], 0, halves), judge(evidence, settings.criteria))
    if not standing.is_good:
        return standing
    # What is alike in all photos or fixed in the image takes as long as the rest, and may only make worse what is good.
    found = with_capture_error(found)
    known = uncertainty_of(found, evidence.coverage, evidence.uncertainty.factor)
    evidence = replace(evidence, uncertainty=known)
    return Standing(found, evidence, judge(evidence, settings.criteria))


@dataclass(frozen=True, eq=False)
class Proposal:
    """A view to take next."""

    cam_from_target: Array  # (4, 4)
    view: NextView | None  # what it gives; None: no camera is known
    is_for_accuracy: bool = True  # the camera is better known by it; else a part of the image is shown first


@one_thread
def proposal_of(
    calibration: Calibration,
    standing: Standing | None,
    settings: GuideSettings,
    shape: TargetShape,
    avoided: Sequence[Array],
    opened: LeftOpen | None = None,
) -> Proposal | None:
    """The view that tells most of those that are not avoided; None if none tells anything.

    Args:
        calibration: what is known, whole or in part.
        standing: of the whole; None: in part.
        settings: what is asked.
        shape: of the target.
        avoided: poses of what cannot be done (4, 4).
        opened: what is open of the target's shape; None: nothing.
    """
    if standing is not None and standing.is_enough:
        return None
    uncertain = None if standing is None else standing.evidence.uncertainty
    # To follow what photos tell of the target's shape takes a while, and is worth it where that is a part of the error.
    is_targets = uncertain is not None and uncertain.target_px > LITTLE_BY_TARGET * (uncertain.image_px or 0.0)
    weighed = opened if is_targets else None

    def is_avoided(poses: Array) -> Flags:
        near = np.zeros(len(poses), dtype=np.bool_)
        for pose in avoided:
            near |= are_near(shape, pose, poses)
        return near

    for goal_px, goal_covered, little_gain in _goals(standing, settings, calibration.observations.view_count):
        views = next_views(
            calibration, most=1, goal_px=goal_px, goal_covered=goal_covered, opened=weighed, little_gain=little_gain,
            factor=1.0 if uncertain is None else uncertain.factor, is_avoided=is_avoided if avoided else None,
            shape=shape,
        )  # fmt: skip
        if views:
            view = views[0]
            tells = view.sigma_px_before > goal_px and view.sigma_px_after <= little_gain * view.sigma_px_before
            return Proposal(view.cam_from_target, view, tells)
    return None


def _goals(standing: Standing | None, settings: GuideSettings, photos: int) -> list[tuple[float, float, float]]:
    """What views are sought for, one after the other: the deviation, what is covered, and which gain is little.

    As long as some of the image is not covered, a view that hardly makes the camera better known gives way to one that
    shows more. What is as good as wanted, and yet not good in the verdict, is to be better than wanted.
    """
    wanted_px, wanted_share = settings.criteria["uncertainty"].good, settings.criteria["coverage"].good / 100
    beyond = [(0.0, 1.0, LITTLE_OF_NOISE)] if photos < ENOUGH_PHOTOS else []
    if standing is None:
        return [(wanted_px, wanted_share, LITTLE_GAIN), *beyond]
    uncertain, covered = standing.evidence.uncertainty, standing.evidence.coverage.share
    is_sure = uncertain.image_px is not None and uncertain.image_px <= wanted_px
    if is_sure and covered >= wanted_share:
        return beyond
    if not is_sure and (uncertain.by_target or uncertain.by_field):
        # More photos than are reckoned with here also tell the target's shape: some are always taken.
        return [(wanted_px, wanted_share, LITTLE_GAIN), *beyond]
    some = [(wanted_px, wanted_share, LITTLE_GAIN)] if covered < wanted_share else []
    return [*some, (wanted_px, wanted_share, LITTLE_OF_NOISE), *beyond]
