"""Sets of photos of printed targets, each set calibrated with the drawing and measured as the paper did.

And how large a single error would have to be to give the paper's intersection error all alone: the square of an error
metric grows as `m0^2 + f^2 c^2` with the multiple f of a source's numbers, so the multiple is found by a few solutions,
each correcting the last; large errors included.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import ClassVar

import numpy as np

from calib.cameras import COMMON, rays
from calib.cameras.refit import image_grid
from calib.core.types import Observations, keep_sightings, keep_views, without_empty_views
from calib.solver.calibrate import ALL_VIEWS, calibrate
from calib.solver.calibration import Calibration
from calib.solver.metrics import errors
from calib.solver.metrics.evaluation import errors_of
from calib.solver.problem import AS_THE_PAPER
from calib.solver.start import solve_poses
from calib.studies.compare.scene import VIRTUAL, ComparedScene, ScenePool, stream, take_photos
from calib.studies.samples import SampleErrors, SampleResult, failed_sample
from designer.base.arrays import Array
from designer.base.errors import InputError
from designer.tolerance.model import ErrorModel, displaced_shape, draw_values
from designer.tolerance.shape import centers_mm

VALUES = ("held_reprojection_px", "held_intersection_mm", "held_reconstruction_mm", "held_share", "image_share")
"""What a sample has beside the errors: the same of photos that were not solved, what share of their sightings the
camera has rays for, and for what share of the image."""
ALL_PHOTOS = "virtual, all photos"
"""The virtual camera whose map is learned from all photos of a board, not from one."""
HELD_SHARE = 3
"""As many photos are held out as a set has, by this."""
LEAST_SIGHTINGS = 4
ALONE_VALUES = ("multiple",)
"""How large the source's numbers are, root mean square, over its amount; the errors are those at it."""
NOISE = "noise"
"""The detector's, as a source of errors; what is made is as drawn."""
TOGETHER = "all together"
"""All sources of a model, scaled alike."""
STEPS = 6
CLOSE = 0.005
LEAST_PART, LEAST_EFFECT = 0.05, 1e-6
"""Of the square of what noise gives, and of the wanted error: a source that adds less has no effect."""
NO_EFFECT = "has no effect: poses or contours take it up"
MOST_MULTIPLE = 1e6


@dataclass(frozen=True, eq=False)
class SetsOfPhotos(ScenePool):
    """Sets of photos of prints of one target, for one camera model. Sample n is set n % sets of print n // sets."""

    kind: ClassVar[str] = "compare"
    values: ClassVar[tuple[str, ...]] = VALUES
    errors: ErrorModel | None  # of the prints; None: as drawn
    camera_model: str  # that is solved, or `ALL_PHOTOS`
    sets: int  # of each print

    def sample(self, seed: int, number: int) -> SampleResult:
        """The set of a number; photos hang on scene, seed, print and set alone, so all models see the same."""
        copy, photos = divmod(number, self.sets)
        scene = self.scene
        try:
            made = made_mm(scene, self.errors, seed, copy)
            seen = take_photos(scene, made, stream(seed, scene.name, copy, photos), scene.views)
            solved = calibrate_with(seen, self.camera_model)
        except InputError as error:
            return failed_sample(number, 0, self.value_count, str(error))
        held = take_photos(scene, made, stream(seed, scene.name, copy, photos, "held"), -(-scene.views // HELD_SHARE))
        row, pixel = metrics_of(solved), image_grid(solved.camera.image_size).reshape(-1, 2)
        image_share = float(errors.is_known(rays(solved.camera, pixel)).mean())
        values = (*_held_out(solved, held), image_share)
        message = "" if solved.status == "converged" else " ".join(solved.remarks[:1])
        return SampleResult(number, solved.status, seen.view_count, values, solved.iterations, message, row)


def made_mm(scene: ComparedScene, model: ErrorModel | None, seed: int, number: int) -> Array:
    """Where the rings of a print are.  # (R, 3)"""
    if model is None:
        return np.asarray(scene.target.center_mm)
    values = draw_values(scene.target, model, stream(seed, scene.name, number, "print"))
    return centers_mm(displaced_shape(scene.target, values, model=model))


def calibrate_with(seen: Observations, camera_model: str) -> Calibration:
    """The camera by plain least squares, as the paper has it."""
    if camera_model == ALL_PHOTOS:
        return calibrate(seen, VIRTUAL, AS_THE_PAPER, ALL_VIEWS)
    return calibrate(seen, camera_model, AS_THE_PAPER)


def metrics_of(solved: Calibration) -> SampleErrors:
    """The paper's three errors against the drawing."""
    found = {one.metric: errors.summarise(one).rmse for one in errors_of(solved, None)}
    return SampleErrors(found["reprojection"], found["intersection"], found["reconstruction"])


def _held_out(solved: Calibration, held: Observations) -> tuple[float, float, float, float]:
    """The errors in photos that were not solved, and the share of their sightings that has rays and poses.

    Each photo's pose comes from its own rings, with the camera as it is; as in `calib.solver.metrics.evaluation`.
    """
    has_ray = errors.is_known(rays(solved.camera, held.center_px))
    enough = np.bincount(held.view[has_ray], minlength=held.view_count) >= LEAST_SIGHTINGS
    kept = has_ray & enough[held.view]
    if not kept.any():
        return (math.nan,) * 3 + (0.0,)
    shown = without_empty_views(keep_sightings(held, kept))
    poses = solve_poses(solved.camera, shown, weighted=AS_THE_PAPER.weighted).cam_from_target
    found = np.isfinite(poses.sum(axis=(1, 2)))
    if not found.any():
        return (math.nan,) * 3 + (0.0,)
    share = float(kept.mean()) * float(found[shown.view].mean())
    shown, poses = keep_views(shown, found), poses[found]
    one = replace(
        solved, observations=shown, cam_from_target=poses, residual_px=np.full((len(shown.view), 2), np.nan),
        is_outlier=np.zeros(len(shown.view), dtype=bool), pose_covariance=np.full((len(poses), 6, 6), np.nan),
    )  # fmt: skip
    return (*metrics_of(one)[:3], share)


def grouped(values: Array, numbers: Sequence[int], sets: int) -> Array:
    """Samples (N,) by print and set; nan where one is missing.  # (prints, sets)"""
    prints = max((number // sets for number in numbers), default=-1) + 1
    table = np.full((prints, sets), np.nan)
    for value, number in zip(values.tolist(), numbers, strict=True):
        table[divmod(number, sets)] = value
    return table


@dataclass(frozen=True, eq=False)
class OneSource(ScenePool):
    """Prints with one source of errors, scaled until a set of photos has the intersection error that is wanted."""

    kind: ClassVar[str] = "compare alone"
    values: ClassVar[tuple[str, ...]] = ALONE_VALUES
    errors: ErrorModel
    source: str  # of the model, `NOISE` or `TOGETHER`
    wanted_mm: float

    def sample(self, seed: int, number: int) -> SampleResult:
        """The print of a number."""
        try:
            multiple, row = self._search(seed, number)
        except InputError as error:
            return failed_sample(number, 0, self.value_count, str(error))
        size = multiple * self._drawn_size(seed, number)
        is_met = abs(row.intersection_mm / self.wanted_mm - 1) < 4 * CLOSE
        message = "" if is_met else "no multiple gives the error that is wanted"
        return SampleResult(
            number, "converged" if is_met else "stopped", self.scene.views, (size,), message=message, errors=row
        )

    def _search(self, seed: int, number: int) -> tuple[float, SampleErrors]:
        """The multiple and the errors at it."""
        rest = self._errors(seed, number, 0.0).intersection_mm ** 2
        multiple = 1.0
        for _ in range(STEPS):
            row = self._errors(seed, number, multiple)
            extra = row.intersection_mm**2 - rest
            if not extra > max(LEAST_PART * rest, (LEAST_EFFECT * self.wanted_mm) ** 2):
                raise InputError(f"{self.source} {NO_EFFECT}")
            step = math.sqrt((self.wanted_mm**2 - rest) / extra)
            if abs(step - 1) < CLOSE:
                break
            multiple = min(multiple * step, MOST_MULTIPLE)
        return multiple, row

    def _errors(self, seed: int, number: int, multiple: float) -> SampleErrors:
        scene, noise = self.scene, multiple if self.source == NOISE else 1.0
        photos = stream(seed, scene.name, number, 0)
        return metrics_of(
            calibrate_with(take_photos(scene, self._made(seed, number, multiple), photos, scene.views, noise), COMMON)
        )

    def _drawn_size(self, seed: int, number: int) -> float:
        """Root mean square of the numbers that were drawn, over their standard deviation: few of them scatter."""
        if self.source in (NOISE, TOGETHER):
            return 1.0
        sigma = self.errors.amount(self.source).sigma
        return float(np.sqrt((self._values(seed, number)[self.source] ** 2).mean()) / sigma)

    def _values(self, seed: int, number: int) -> dict[str, Array]:
        chosen = self.errors if self.source == TOGETHER else self.errors.only(self.source)
        return draw_values(self.scene.target, chosen, stream(seed, self.scene.name, number, "print"))

    def _made(self, seed: int, number: int, multiple: float) -> Array:
        nominal = self.scene.target
        if self.source == NOISE or multiple == 0:
            return np.asarray(nominal.center_mm)
        values = {name: multiple * drawn for name, drawn in self._values(seed, number).items()}
        return centers_mm(displaced_shape(nominal, values, model=self.errors))
