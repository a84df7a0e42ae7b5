"""Samples of the study: simulated sets of photos, real photos of which some are held out, and bad starts.

What a camera that was solved by some cost is worth: against the truth, and in photos that it was not solved from.
"""

import math
from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from typing import ClassVar, Literal

import numpy as np

from calib.cameras import neutral, project, rays
from calib.cameras.camera import Camera
from calib.core.linear_algebra import rms_length
from calib.core.parallel import one_thread
from calib.core.se3 import exp_rotation, transform
from calib.core.types import Observations, keep_sightings, keep_views, sightings_per_view
from calib.solver.blocks import RobustLoss
from calib.solver.calibration import Calibration
from calib.solver.costs import COSTS, IMAGE
from calib.solver.in_space import in_space, minimise_in_space
from calib.solver.levenberg import DescentSteps, Minimum, minimise, minimise_poses
from calib.solver.metrics.errors import centers_mm, is_known
from calib.solver.problem import Loss, Problem, SolveOptions, Tie, origin_poses, pack, target_poses, tie_parameters
from calib.solver.solve import solve
from calib.solver.start import solve_poses
from calib.studies.compare.prints import made_mm
from calib.studies.compare.scene import ComparedScene, ScenePool, photograph, stream
from calib.studies.samples import SampleResult, SampleStatus, failed_sample
from calib.studies.tolerance.seen import grid_of, map_error_px
from calib.studies.workers import ValuePool
from designer.base.arrays import Array
from designer.base.errors import InputError
from designer.tolerance.model import ErrorModel

MOST_POSE_STEPS = 50
LEAST_SIGHTINGS = 12
"""Of a photo held out: a pose is found from half of them."""


@dataclass(frozen=True)
class Estimator:
    """A way to solve."""

    name: str
    minimise: str
    weighted: bool = False  # by the covariances of observations


WEIGHTED = "image, weighted"
ESTIMATORS: tuple[Estimator, ...] = (
    Estimator(IMAGE, IMAGE),
    Estimator(WEIGHTED, IMAGE, weighted=True),
    *(Estimator(name, name) for name in COSTS if name != IMAGE),
)
"""Each cost, all observations alike, as mm know nothing of covariances; and what those bring to the image's."""

Pair = tuple[float, float]
NOTHING: Pair = (math.nan, math.nan)


def held_out(camera: Camera, estimator: Estimator, held: Observations) -> Pair:
    """Root mean square errors in photos held out: px in the image, and mm between rays and rings.

    The pose of a photo minimises the same distances over every second ring; the errors are those of the others.
    """
    shown = keep_sightings(held, is_known(rays(camera, held.center_px)))
    shown = keep_views(shown, sightings_per_view(shown) >= LEAST_SIGHTINGS)
    if not len(shown.view):
        return NOTHING
    is_for_pose = np.arange(len(shown.view)) % 2 == 0
    poses = _poses(camera, estimator, keep_sightings(shown, is_for_pose))
    rest = keep_sightings(shown, ~is_for_pose)
    place = transform(poses[rest.view], rest.points.position_mm[rest.point])
    ray = rays(camera, rest.center_px)
    off_px = project(camera, place) - rest.center_px
    off_mm = place - (ray * place).sum(axis=1, keepdims=True) * ray
    return rms_length(off_px), rms_length(off_mm)


def _poses(camera: Camera, estimator: Estimator, seen: Observations) -> Array:
    """Of photos whose camera is known (V, 4, 4)."""
    poses = solve_poses(camera, seen, weighted=estimator.weighted).cam_from_target
    if estimator.minimise == IMAGE or not np.isfinite(poses).all():
        return poses
    problem = pack(seen, weighted=estimator.weighted)
    space = in_space(problem, estimator.minimise, seen.points, seen.point)
    found = minimise_poses(space, camera, origin_poses(problem, poses), RobustLoss(), max_iterations=MOST_POSE_STEPS)
    return target_poses(problem, found.cam_from_target)


def pose_error_mm(found: Array, true: Array) -> float:
    """Root mean square distance of the cameras from where they stood, of poses (V, 4, 4)."""
    if len(found) != len(true):
        raise InputError("not all photos have a pose")
    return rms_length(centers_mm(found) - centers_mm(true))


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


def _measured(
    number: int, seen: Observations, model: str, loss: Loss, measure: Callable[[SolvedBy], Row]
) -> SampleResult:
    """A sample of which some estimators may have failed."""
    rows, steps, why = dict.fromkeys(ESTIMATORS, UNKNOWN), 0, list[str]()
    for found in solved_by_all(seen, model, loss, why):
        rows[found.estimator] = measure(found)
        steps += found.iterations
    values = tuple(value for row in rows.values() for value in row)
    status: SampleStatus = "converged" if not why else "stopped" if any(map(math.isfinite, values)) else "failed"
    return SampleResult(number, status, seen.view_count, values, steps, "; ".join(dict.fromkeys(why))[:300])


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

        def measure(found: SolvedBy) -> Row:
            true = poses[np.isin(seen.view_names, found.view_names)]
            pose_mm = pose_error_mm(found.cam_from_target, true)
            return map_error_px(grid, found.camera), pose_mm, *held_out(found.camera, found.estimator, held)

        return _measured(number, seen, scene.camera.model, self.loss, measure)


def _with_outliers(seen: Observations, rng: np.random.Generator) -> Observations:
    """The same with some centres far off."""
    is_off = rng.random(len(seen.view)) < OUTLIER_SHARE
    pixel = np.array(seen.center_px)
    pixel[is_off] += OUTLIER_PX * rng.standard_normal((int(is_off.sum()), 2))
    return replace(seen, center_px=pixel)


@dataclass(frozen=True, eq=False)
class RealPool(ValuePool):
    """Real photos, dealt out to parts: a sample is what the others' camera says of one part."""

    observations: Observations
    camera_model: str
    parts: int

    kind: ClassVar[str] = "cost"
    values: ClassVar[tuple[str, ...]] = VALUES

    @property
    def view_count(self) -> int:
        """Photos."""
        return self.observations.view_count

    def sample(self, seed: int, number: int) -> SampleResult:
        """What the photos of a part say of the camera of the others."""
        del seed
        is_held = np.arange(self.view_count) % self.parts == number
        others, held = keep_views(self.observations, ~is_held), keep_views(self.observations, is_held)

        def measure(found: SolvedBy) -> Row:
            return math.nan, math.nan, *held_out(found.camera, found.estimator, held)

        return _measured(number, others, self.camera_model, "squares", measure)


@dataclass(frozen=True, eq=False)
class StartPool(ScenePool):
    """One set of photos of a scene; a sample is a bad start, from which each cost is minimised without more ado."""

    kind: ClassVar[str] = "cost starts"
    values: ClassVar[tuple[str, ...]] = START_VALUES

    @one_thread
    def run(self, case: str, size: int, seed: int, numbers: range) -> list[SampleResult]:
        """The samples of some numbers; the photos and their minima are found once."""
        del case, size
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
        return self.run("", 0, seed, range(number, number + 1))[0]

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
        total, values = sum(one.iterations for one in found.values()), (*map(float, reached.values()), *steps)
        return SampleResult(number, "converged", len(poses), values, total)


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
    return minimise(problem, camera, poses, tie.row, RobustLoss(), DescentSteps(MOST_STEPS))


def _least(problem: Problem, camera: Camera, poses: Array, tie: Tie) -> float:
    return float(_descent(problem, camera, poses, tie).blocks.cost.sum())
