"""Runs for the tests of verdicts: observations with faults of every kind, solved and judged."""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from calib.core.se3 import exp_rotation, look_at, make_pose
from calib.core.types import KnownPoints, Observations
from calib.judge.candidate_views import tilt_rotation
from calib.judge.checks import read_criteria
from calib.judge.evidence import Evidence, LensEvidence, lens_evidence
from calib.judge.halves import HalfSplit, HalvesApart, half_split
from calib.judge.judge import Judged, judge, judged_by
from calib.judge.next_views import NextView
from calib.judge.verdict import Check, Criteria, Verdict
from calib.renderer.poses import fibonacci_cap
from calib.solver.calibration import Calibration
from calib.solver.problem import SolveOptions
from calib.solver.solve import solve
from designer.base.arrays import Array
from tests.support.solver_scenes import CAMERAS, board, icosahedron, noisy, observe

TRUE = CAMERAS["opencv"]
BOARD, ICOSAHEDRON = board(), icosahedron()
OPTIONS = SolveOptions()
HALF_WIDTH_MM = 110.0


def all_over(
    views: int, rng: np.random.Generator, *, distance_mm: float = 450.0, half_angle_deg: float = 45.0
) -> Array:
    """Cameras around the target that see it all over the image.  # (V, 4, 4)"""
    eye = distance_mm * rng.uniform(1.0, 1.3, (views, 1)) * fibonacci_cap(views, np.radians(half_angle_deg))
    pose = look_at(eye, np.zeros((views, 3)), rng.uniform(-np.pi, np.pi, views))
    turn = np.tile(np.eye(4), (views, 1, 1))
    for one, (right, down) in zip(turn, rng.uniform(-1, 1, (views, 2)) * [0.42, 0.34], strict=True):
        one[:3, :3] = exp_rotation(np.array([down, right, 0.0]))
    seen: Array = turn @ pose
    return seen


def shown_at(
    places_px: Sequence[tuple[float, float]], distances_mm: Sequence[float], tilts_deg: Sequence[float]
) -> Array:
    """A board at places of the image, at distances and with tilts by turns, to all sides.  # (V, 4, 4)"""
    poses = []
    for n, place in enumerate(places_px):
        side = np.array([np.cos(2.4 * n), np.sin(2.4 * n)])
        ray = np.append((np.array(place) - TRUE.params[2:4]) / TRUE.params[:2], 1.0)
        turn = tilt_rotation(np.radians(tilts_deg[n % len(tilts_deg)]), side) @ np.diag([1.0, -1.0, -1.0])
        poses.append(make_pose(turn, distances_mm[n % len(distances_mm)] * ray))
    return np.stack(poses)


def sightings(
    points: KnownPoints = BOARD,
    *,
    views: int = 12,
    seed: int = 0,
    noise_px: float = 0.02,
    distance_mm: float = 450.0,
    half_angle_deg: float = 45.0,
) -> Observations:
    """What the true camera sees of a target from all over."""
    rng = np.random.default_rng(seed)
    poses = all_over(views, rng, distance_mm=distance_mm, half_angle_deg=half_angle_deg)
    return noisy(observe(TRUE, points, poses, rng), noise_px, np.random.default_rng([seed, 1]))


def bent(points: KnownPoints, bow_mm: float) -> KnownPoints:
    """The points of a board whose left and right ends stand so far out of its plane."""
    place = points.position_mm.copy()
    place[:, 2] += bow_mm * (place[:, 0] / HALF_WIDTH_MM) ** 2
    return replace(points, position_mm=place)


def believed(seen: Observations, points: KnownPoints) -> Observations:
    """Sightings of one target, taken to be of another."""
    return replace(seen, points=points)


def solved(seen: Observations, models: Sequence[str] = ("opencv",)) -> list[Calibration]:
    """The solutions of some models."""
    return [solve(seen, model, OPTIONS) for model in models]


def judge_run(
    calibrations: Sequence[Calibration],
    best: int,
    halves: HalfSplit,
    criteria: Criteria,
    views: Sequence[NextView] | None = None,
) -> Judged:
    """The verdict on one of some cameras, without a search for photos to take next."""
    return judged_by(calibrations[best], lens_evidence(calibrations, best, halves), halves, criteria, views)


def verdict_on(lens: LensEvidence, criteria: Criteria | None = None) -> Verdict:
    """The verdict by what was measured of a camera that was solved."""
    evidence = Evidence(status="converged", status_reason="", frames=lens.frames, cameras=(lens,))
    return judge(evidence, criteria or read_criteria())


def judged(seen: Observations, *, models: Sequence[str] = ("opencv",), criteria: Criteria | None = None) -> Judged:
    """The verdict on the first of some models."""
    calibrations = solved(seen, models)
    return judge_run(calibrations, 0, half_split(calibrations[0], OPTIONS), criteria or read_criteria())


def check(run: Judged, name: str) -> Check:
    """One check of a verdict."""
    return next(one for one in run.verdict.checks if one.name == name)


def halves_apart_by(ratio: float, rms_px: float, stated_px: float, percentile_95_px: float) -> HalvesApart:
    """Cameras of halves that differ by so much."""
    return HalvesApart(ratio, rms_px, stated_px, percentile_95_px, np.zeros((1, 1, 2)), np.full((1, 1), rms_px))
