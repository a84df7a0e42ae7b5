"""Sets of photos of printed targets, each set calibrated with the drawing and measured as the paper did."""

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import ClassVar, NamedTuple

import numpy as np
from numpy.typing import NDArray

from calib.cameras import rays
from calib.cameras.refit import image_grid
from calib.core.types import Observations, keep_sightings, keep_views, without_empty_views
from calib.metrics import errors
from calib.metrics.evaluation import errors_of
from calib.pipeline.solving import ALL_VIEWS, calibrate
from calib.solver.calibration import Calibration
from calib.solver.options import AS_THE_PAPER
from calib.solver.start import solve_poses
from calib.studies.compare.objects import VIRTUAL
from calib.studies.compare.scene import ComparedScene, ScenePool, stream, take_photos
from calib.studies.sample import SampleResult, failed_sample
from designer.base.errors import InputError
from designer.tolerance.model import ErrorModel, displaced_shape, draw_values
from designer.tolerance.shape import centers_mm

Array = NDArray[np.float64]

KIND = "compare"
VALUES = ("held_reprojection_px", "held_intersection_mm", "held_reconstruction_mm", "held_share", "image_share")
"""What a sample has beside the errors: the same of photos that were not solved, what share of their sightings the
camera has rays for, and for what share of the image."""
ALL_PHOTOS = "virtual, all photos"
"""The virtual camera whose map is learned from all photos of a board, not from one."""
HELD_SHARE = 3
"""As many photos are held out as a set has, by this."""
LEAST_SIGHTINGS = 4


class MetricRow(NamedTuple):
    """Root mean squares by the paper's metrics."""

    reprojection_px: float
    intersection_mm: float
    reconstruction_mm: float


@dataclass(frozen=True, eq=False)
class SetsOfPhotos(ScenePool):
    """Sets of photos of prints of one target, for one camera model. Sample n is set n % sets of print n // sets."""

    kind: ClassVar[str] = KIND
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
        row = metrics_of(solved)
        values = (*_held_out(solved, held), _image_share(solved))
        return SampleResult(
            number, solved.status, seen.view_count, *row, math.nan, values, solved.iterations,
            "" if solved.status == "converged" else " ".join(solved.remarks[:1]),
        )  # fmt: skip


def made_mm(scene: ComparedScene, model: ErrorModel | None, seed: int, number: int) -> Array:
    """Where the rings of a print are.  # (R, 3)

    Raises:
        InputError: errors so large that no target is left.
    """
    if model is None:
        return np.asarray(scene.target.center_mm)
    values = draw_values(scene.target, model, stream(seed, scene.name, number, "print"))
    return centers_mm(displaced_shape(scene.target, values, model=model))


def calibrate_with(seen: Observations, camera_model: str) -> Calibration:
    """The camera by plain least squares, as the paper has it.

    Raises:
        InputError: the photos do not determine it.
    """
    if camera_model == ALL_PHOTOS:
        return calibrate(seen, VIRTUAL, AS_THE_PAPER, ALL_VIEWS)
    return calibrate(seen, camera_model, AS_THE_PAPER)


def metrics_of(solved: Calibration) -> MetricRow:
    """The paper's three errors against the drawing."""
    found = {one.metric: errors.summarise(one).rmse for one in errors_of(solved, None)}
    return MetricRow(found["reprojection"], found["intersection"], found["reconstruction"])


def _held_out(solved: Calibration, held: Observations) -> tuple[float, float, float, float]:
    """The errors in photos that were not solved, and the share of their sightings that has rays and poses.

    Each photo's pose comes from its own rings, with the camera as it is; as in `calib.metrics.evaluation`.
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
    return (*metrics_of(one), share)


def _image_share(solved: Calibration) -> float:
    """For what share of the image the camera has rays."""
    pixel = image_grid(solved.camera.image_size).reshape(-1, 2)
    return float(errors.is_known(rays(solved.camera, pixel)).mean())


def grouped(values: Array, numbers: Sequence[int], sets: int) -> Array:
    """Samples (N,) by print and set; nan where one is missing.  # (prints, sets)"""
    prints = max((number // sets for number in numbers), default=-1) + 1
    table = np.full((prints, sets), np.nan)
    for value, number in zip(values.tolist(), numbers, strict=True):
        table[divmod(number, sets)] = value
    return table
