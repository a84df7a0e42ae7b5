"""How well cameras that saw one target together are known against each other."""

import math
from collections.abc import Mapping
from dataclasses import dataclass
from itertools import combinations
from pathlib import PurePath
from typing import Literal

from calib.cameras.rig import Rig
from calib.core.parallel import one_thread_with_scipy
from calib.judge.guide import Guide
from calib.judge.guide_told import Bar
from calib.judge.rig_judge import JudgedRig, judge_rig
from calib.judge.telling import bar_of
from calib.judge.verdict import Criteria, Grade, Limits, at_most, measured_text
from calib.observe.rig_observations import RigSightings, rig_observations
from calib.rigs.halves import enlarged, half_solver, rig_halves
from calib.rigs.problem import CameraChoice, RigOptions
from calib.rigs.relative import relative
from calib.rigs.result import RigCalibration
from calib.rigs.solve import solve_rig
from calib.rigs.target_error import with_target_error
from designer.base.arrays import Array
from designer.base.errors import InputError
from designer.base.words import figure

MOST_PAIRS = 8
"""That are listed, of a rig with many cameras those that are known worst."""
ALWAYS = ("frames", "halves", "space")
"""Checks of a rig that have a bar besides those of its pairs."""


@dataclass(frozen=True, eq=False)
class RigStanding:
    """A rig that is solved, and what is to be said of it."""

    calibration: RigCalibration
    judged: JudgedRig

    @property
    def is_good(self) -> bool:
        """Whether the cameras are known well enough against each other."""
        return self.judged.verdict.grade == "good"

    @property
    def cam_from_rig(self) -> Mapping[str, Array]:
        """Where each camera stands.  # (4, 4)"""
        return dict(zip(self.calibration.observations.camera_names, self.calibration.cam_from_rig, strict=True))


def moment_of(image: str) -> str:
    """What a photo's moment is called: photos of one moment are named alike."""
    return PurePath(image).stem


@one_thread_with_scipy
def rig_standing_of(guides: Mapping[str, Guide], limits: Criteria) -> RigStanding | None:
    """Solve and judge the rig of cameras that are each known whole; None as long as they do not make one."""
    cameras, choices = [], []
    for name, guide in guides.items():
        seen, known = guide.observations, guide.calibration
        if seen is None or known is None or guide.verdict is None:
            return None
        cameras.append(RigSightings(name, seen, {view: moment_of(view) for view in seen.view_names}))
        choices.append(CameraChoice(known.camera.model, known.camera))
    moments = sorted({moment for one in cameras for moment in one.frame.values()})
    try:
        observations, options = rig_observations(cameras, moments), RigOptions()
        solved = solve_rig(observations, choices, options)
    except InputError:  # no frames tie some of them to the others yet
        return None
    found = with_target_error(solved, next(iter(guides.values())).settings.made)
    return RigStanding(found, judge_rig(found, rig_halves(found, half_solver(found, choices, options)), limits))


def shared_moments(guides: Mapping[str, Guide]) -> Mapping[tuple[str, str], int]:
    """In how many moments each two cameras see the target."""
    moments = {
        name: set() if one.observations is None else {moment_of(view) for view in one.observations.view_names}
        for name, one in guides.items()
    }
    return {(a, b): len(moments[a] & moments[b]) for a, b in combinations(guides, 2)}


def join_bars(guides: Mapping[str, Guide], standing: RigStanding | None, limits: Criteria) -> tuple[Bar, ...]:
    """How well the cameras of each pair are known against each other, and what else the rig's verdict asks."""
    if standing is None:
        seen = sorted(shared_moments(guides).items(), key=lambda one: one[1])[:MOST_PAIRS]
        return tuple(_bar(pair, f"seen together {count} time{'s' * (count != 1)}", 0.0) for pair, count in seen)
    rig = enlarged(standing.calibration, standing.judged.compared).rig
    pairs = [_pair_bar(rig, *pair, limits["baselines"]) for pair in combinations(range(len(rig.names)), 2)]
    checks = [one for one in standing.judged.verdict.checks if one.name in ALWAYS or one.grade != "good"]
    worst = sorted(pairs, key=lambda bar: bar.share)[:MOST_PAIRS]
    return (*worst, *(bar_of(one) for one in checks if one.name != "baselines"))


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
