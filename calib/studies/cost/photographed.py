"""Samples of the study: simulated sets of photos, real photos of which some are held out, and bad starts."""

import math
from collections.abc import Iterator
from dataclasses import dataclass, replace
from typing import ClassVar, Literal

import numpy as np

from calib.cameras import neutral
from calib.cameras.camera import Camera
from calib.core.parallel import one_thread
from calib.core.se3 import exp_rotation
from calib.core.types import Observations, keep_views
from calib.solver.blocks import RobustLoss
from calib.solver.calibration import Calibration
from calib.solver.costs import COSTS, IMAGE
from calib.solver.in_space import in_space, minimise_in_space
from calib.solver.levenberg import Minimum, minimise
from calib.solver.problem import Loss, Problem, SolveOptions, Tie, origin_poses, pack, target_poses, tie_parameters
from calib.solver.solve import solve
from calib.studies.compare.photographed import made_mm
from calib.studies.compare.scene import ComparedScene, ScenePool, photograph, stream
from calib.studies.cost.errors import ESTIMATORS, Estimator, held_out, pose_error_mm
from calib.studies.sample_metrics import SampleResult, failed_sample
from calib.studies.tolerance.map_error import grid_of, map_error_px
from designer.base.arrays import Array
from designer.base.errors import InputError
from designer.tolerance.model import ErrorModel

Condition = Literal["as drawn", "as made", "outliers", "outliers, Huber"]
CONDITIONS: tuple[Condition, ...] = ("as drawn", "as made", "outliers", "outliers, Huber")
OUTLIER_SHARE, OUTLIER_PX = 0.02, 2.0
"""Of the sightings, and the standard deviation of what is added to a coordinate: names stay right, centres do not."""
HELD_VIEWS = 8
MEASURES = ("camera_px", "pose_mm", "held_out_px", "held_out_mm")
VALUES = tuple(f"{one.name}: {measure}" for one in ESTIMATORS for measure in MEASURES)

WIDEST_FOCAL, WIDEST_POSE_RAD = 3.0, math.radians(60)
"""Of bad starts: factor of the focal length either way, turn of each pose about any axis."""
START_VALUES = (*(f"{name}: reached" for name in COSTS), *(f"{name}: steps" for name in COSTS))
MOST_STEPS = 200
REACHED = 1e-3
"""Of a cost's least value: what is no more above it is the same minimum."""

Row = tuple[float, float, float, float]
UNKNOWN: Row = (math.nan,) * 4


def _result(number: int, views: int, rows: list[Row], iterations: int, why: list[str]) -> SampleResult:
    """A sample of which some estimators may have failed."""
    values = tuple(value for row in rows for value in row)
    nan, known = math.nan, sum(map(math.isfinite, values))
    return SampleResult(
        number, "converged" if not why else "stopped" if known else "failed", views, nan, nan, nan, nan, values,
        iterations, "; ".join(dict.fromkeys(why))[:300],
    )  # fmt: skip


@dataclass(frozen=True, eq=False)
class SolvedBy:
    """The camera that an estimator gives, and the poses of the views that it was solved from."""

    estimator: Estimator
    camera: Camera
    cam_from_target: Array  # (V, 4, 4)
    view_names: tuple[str, ...]
    iterations: int


def solved_by_all(seen: Observations, model: str, loss: Loss, why: list[str]) -> Iterator[SolvedBy]:
    """The camera by each estimator that finds one, sure of it or not; those in space from that of the image.

    As `calib.solver.solve.solve` does it, without the accuracy, and the image's solution once for all.
    """
    images: dict[bool, Calibration] = {}
    for one in ESTIMATORS:
        options = SolveOptions(weighted=one.weighted, loss=loss, minimise=one.minimise)
        try:
            if one.weighted not in images:
                images[one.weighted] = solve(seen, model, replace(options, minimise=IMAGE))
        except InputError as error:
            why.append(f"{one.name}: {error}")
            continue
        image = images[one.weighted]
        found = _in_image(one, image) if one.minimise == IMAGE else _in_space(one, image, options, why)
        if image.status != "converged":
            why.append(f"{one.name}: {image.status}")
        yield found


def _in_image(one: Estimator, image: Calibration) -> SolvedBy:
    names = image.observations.view_names
    return SolvedBy(one, image.camera, image.cam_from_target, names, image.iterations)


def _in_space(one: Estimator, image: Calibration, options: SolveOptions, why: list[str]) -> SolvedBy:
    seen, tie = image.observations, tie_parameters(image.camera.model, options)
    problem = replace(pack(seen, weighted=one.weighted), is_used=~image.is_outlier)
    space = in_space(problem, one.minimise, seen.points, seen.point)
    poses = origin_poses(problem, image.cam_from_target)
    found = minimise_in_space(space, image.camera, poses, tie, options).minimum
    if not found.converged:
        why.append(f"{one.name}: stopped")
    return SolvedBy(one, found.camera, target_poses(problem, found.cam_from_target), seen.view_names, found.iterations)


@dataclass(frozen=True, eq=False)
class CostPool(ScenePool):
    """Sets of photos of one scene, each solved by all estimators; each set is of a print of its own."""

    kind: ClassVar[str] = "cost"
    values: ClassVar[tuple[str, ...]] = VALUES
    errors: ErrorModel | None  # of prints; None: as drawn
    has_outliers: bool
    loss: Loss

    def sample(self, seed: int, number: int) -> SampleResult:
        """The set of a number; what is random does not depend on the loss."""
        scene = self.scene
        try:
            made = made_mm(scene, self.errors, seed, number)
        except InputError as error:
            return failed_sample(number, 0, self.value_count, str(error))
        seen, poses = photograph(scene, made, stream(seed, scene.name, number, "photos"), scene.views)
        held, _ = photograph(scene, made, stream(seed, scene.name, number, "held"), HELD_VIEWS)
        if self.has_outliers:
            seen = _with_outliers(seen, stream(seed, scene.name, number, "outliers"))
        grid = grid_of(scene.camera, seen.center_px)
        rows, steps = dict.fromkeys(ESTIMATORS, UNKNOWN), 0
        why: list[str] = []
        for found in solved_by_all(seen, scene.camera.model, self.loss, why):
            true = poses[np.isin(seen.view_names, found.view_names)]
            rows[found.estimator] = (
                map_error_px(grid, found.camera),
                pose_error_mm(found.cam_from_target, true),
                *held_out(found.camera, found.estimator, held),
            )
            steps += found.iterations
        return _result(number, seen.view_count, list(rows.values()), steps, why)


def _with_outliers(seen: Observations, rng: np.random.Generator) -> Observations:
    """The same with some centres far off."""
    is_off = rng.random(len(seen.view)) < OUTLIER_SHARE
    pixel = np.array(seen.center_px)
    pixel[is_off] += OUTLIER_PX * rng.standard_normal((int(is_off.sum()), 2))
    return replace(seen, center_px=pixel)


@dataclass(frozen=True, eq=False)
class RealPool:
    """Real photos, dealt out to parts: a sample is what the others' camera says of one part."""

    observations: Observations
    camera_model: str
    parts: int

    model: ClassVar[str] = "cost"
    value_count: ClassVar[int] = len(VALUES)

    @property
    def view_count(self) -> int:
        """Photos."""
        return self.observations.view_count

    @property
    def covariance(self) -> Array:
        """They have none."""
        return np.zeros((0, 0))

    @one_thread
    def run(self, case: str, size: int, seed: int, numbers: range) -> list[SampleResult]:
        """The samples of some parts."""
        del case, size, seed
        return [self._sample(number) for number in numbers]

    def _sample(self, number: int) -> SampleResult:
        is_held = np.arange(self.view_count) % self.parts == number
        others, held = keep_views(self.observations, ~is_held), keep_views(self.observations, is_held)
        rows, steps = dict.fromkeys(ESTIMATORS, UNKNOWN), 0
        why: list[str] = []
        for found in solved_by_all(others, self.camera_model, "squares", why):
            rows[found.estimator] = (math.nan, math.nan, *held_out(found.camera, found.estimator, held))
            steps += found.iterations
        return _result(number, others.view_count, list(rows.values()), steps, why)


@dataclass(frozen=True, eq=False)
class StartPool(ScenePool):
    """One set of photos of a scene; a sample is a bad start, from which each cost is minimised without more ado."""

    kind: ClassVar[str] = "cost starts"
    values: ClassVar[tuple[str, ...]] = START_VALUES

    def run(self, case: str, size: int, seed: int, numbers: range) -> list[SampleResult]:
        """The samples of some numbers; the photos and their minima are found once."""
        del case, size
        return self._run(seed, numbers)

    @one_thread
    def _run(self, seed: int, numbers: range) -> list[SampleResult]:
        scene = self.scene
        seen, true = photograph(scene, scene.target.center_mm, stream(seed, scene.name, "starts"), scene.views)
        problem = pack(seen, weighted=False)
        poses = origin_poses(problem, true)
        tie = tie_parameters(scene.camera.model, SolveOptions())
        problems = {
            name: problem if name == IMAGE else in_space(problem, name, seen.points, seen.point) for name in COSTS
        }
        least = {name: _least(one, scene.camera, poses, tie) for name, one in problems.items()}
        return [self._start(seed, number, problems, least, poses, tie) for number in numbers]

    def sample(self, seed: int, number: int) -> SampleResult:
        """One start."""
        return self._run(seed, range(number, number + 1))[0]

    def _start(
        self, seed: int, number: int, problems: dict[str, Problem], least: dict[str, float], poses: Array, tie: Tie
    ) -> SampleResult:
        camera, start = bad_start(self.scene, poses, stream(seed, self.scene.name, number, "start"))
        found = {name: _descent(one, camera, start, tie) for name, one in problems.items()}
        reached = {
            name: bool(one.blocks.cost.sum() <= (1 + REACHED) * least[name])  # false of nan
            for name, one in found.items()
        }
        steps = [float(one.iterations) if reached[name] else math.nan for name, one in found.items()]
        nan, total = math.nan, sum(one.iterations for one in found.values())
        values = (*map(float, reached.values()), *steps)
        return SampleResult(number, "converged", len(poses), nan, nan, nan, nan, values, total)


def bad_start(scene: ComparedScene, poses: Array, rng: np.random.Generator) -> tuple[Camera, Array]:
    """A camera without a lens, its focal length off, and poses turned, as far away as suits it (V, 4, 4)."""
    params = neutral(scene.camera.model)
    factor = math.exp(rng.uniform(-1, 1) * math.log(WIDEST_FOCAL))
    width, height = scene.camera.image_size
    params[:4] = *(factor * scene.camera.params[:2]), 0.5 * (width - 1), 0.5 * (height - 1)
    axis = rng.standard_normal((len(poses), 3))
    axis /= np.linalg.norm(axis, axis=1, keepdims=True)
    start = np.array(poses)
    start[:, :3, :3] = exp_rotation(axis * rng.uniform(0, WIDEST_POSE_RAD, (len(poses), 1))) @ poses[:, :3, :3]
    start[:, :3, 3] *= factor
    return Camera(scene.camera.model, params, scene.camera.image_size), start


def _descent(problem: Problem, camera: Camera, poses: Array, tie: Tie) -> Minimum:
    return minimise(problem, camera, poses, tie.row, RobustLoss(), max_iterations=MOST_STEPS)


def _least(problem: Problem, camera: Camera, poses: Array, tie: Tie) -> float:
    return float(_descent(problem, camera, poses, tie).blocks.cost.sum())
