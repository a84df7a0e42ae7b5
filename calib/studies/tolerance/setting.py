"""What is photographed, from where, with what noise, and how it is calibrated: all that errors do not change."""

import math
from dataclasses import dataclass, field, replace

import numpy as np

from calib.cameras import fitted_models, linearise
from calib.cameras.camera import Camera
from calib.cameras.refit import refit
from calib.core.se3 import transform
from calib.core.types import Observations, frozen_array
from calib.solver.accuracy import accuracy_of
from calib.solver.blocks import RobustLoss, view_blocks
from calib.solver.descend import is_robust
from calib.solver.levenberg import DescentSteps, minimise
from calib.solver.problem import AS_THE_PAPER, Problem, SolveOptions, Tie, origin_poses, pack, tie_parameters
from calib.studies.tolerance.anchor import Anchor, factorise
from calib.studies.tolerance.seen import (
    CONTRAST_TO_NOISE,
    LEAST_MINOR_PX,
    LEAST_RINGS,
    ImageGrid,
    grid_of,
    views_from,
    views_of,
)
from designer.base.arrays import Array
from designer.base.errors import InputError
from designer.kinds.layout import Viewpoints
from designer.target import TargetGeometry

SINGULAR = 1e-13
MOST_STEPS = 200


@dataclass(frozen=True, eq=False)
class Setting:
    """M observations of a nominal target in V views of a known camera, and the minimum they have without errors."""

    target: TargetGeometry  # nominal
    camera: Camera  # true
    cam_from_target: Array  # (V, 4, 4) true
    observations: Observations  # noise-free pixels of the nominal target, with the covariances of the noise
    model: str  # to be solved
    options: SolveOptions
    anchor: Anchor
    noise_root: Array  # (M, 3) a, b, c of the Cholesky factors [[a, 0], [b, c]] of the covariances
    seen: Array  # (R,) how often each ring is seen
    grid: ImageGrid
    remarks: tuple[str, ...] = field(default=())

    def __post_init__(self) -> None:
        object.__setattr__(self, "cam_from_target", frozen_array(self.cam_from_target))

    @property
    def reference(self) -> Camera:
        """The camera of the solved model that fits without errors: the true one, if the model is its own."""
        return self.anchor.camera

    @property
    def view_count(self) -> int:
        """V."""
        return len(self.cam_from_target)


def make_setting(
    target: TargetGeometry,
    camera: Camera,
    *,
    views: int,
    photos: Viewpoints,
    model: str,
    seed: int,
    options: SolveOptions = AS_THE_PAPER,
) -> Setting:
    """Views on a Fibonacci grid around a target, as `calib render` takes them, rolled at random.

    Raises:
        InputError: no such views, or they do not determine the camera; the message says why.
    """
    if views < 1:
        raise InputError(f"{views} views: give one or more")
    near = photos.distance_mm[0]
    if not (math.isfinite(near) and near > 0):
        raise InputError(f"distance {near:g}mm: must be more than 0")
    poses = views_from(target, camera, photos, views, seed)
    return setting_at(target, camera, poses, model=model, options=options)


def setting_at(
    target: TargetGeometry, camera: Camera, cam_from_target: Array, *, model: str, options: SolveOptions = AS_THE_PAPER
) -> Setting:
    """What a camera sees from known poses (V, 4, 4), with the noise of `calib.studies.tolerance.seen`.

    A ring is seen if its face is turned to the camera by 75 degrees or less, its image lies in the photo, and the minor
    axis of that is 5 px or more.

    Raises:
        InputError: nothing is seen, or not enough to determine the camera.
    """
    features = target.feature_word
    kept, seen = views_of(target, camera, cam_from_target, CONTRAST_TO_NOISE)
    if not len(kept):
        raise InputError(
            f"none of {len(cam_from_target)} views sees {LEAST_RINGS} {features} of the target that are at least "
            f"{2 * LEAST_MINOR_PX:g} px across in the image; move closer or farther, or use a longer lens"
        )
    lost = len(cam_from_target) - len(kept)
    remark = f"{lost} of {len(cam_from_target)} views see fewer than {LEAST_RINGS} {features} and are left out"
    poses = np.asarray(cam_from_target)[kept]
    return _setting(target, camera, poses, seen, model, options, (remark,) if lost else ())


def setting_of_observations(setting: Setting, cam_from_target: Array, seen: Observations) -> Setting:
    """The setting with other observations.

    Args:
        setting: whose target, camera and way of solving it is.
        cam_from_target: true poses of the views that are seen (V, 4, 4).
        seen: observations with covariances; their pixels are replaced by those of the drawing.
    """
    point = transform(cam_from_target[seen.view], setting.target.center_mm[seen.point])
    pixel = linearise(setting.camera, np.ascontiguousarray(point.T)).pixel.T
    return _setting(
        setting.target, setting.camera, cam_from_target, replace(seen, center_px=pixel), setting.model,
        setting.options, setting.remarks,
    )  # fmt: skip


def _setting(
    target: TargetGeometry,
    camera: Camera,
    cam_from_target: Array,
    seen: Observations,
    model: str,
    options: SolveOptions,
    remarks: tuple[str, ...],
) -> Setting:
    """The setting of some observations, whose pixels are free of noise, with its covariances."""
    covariance = seen.cov_px2
    if covariance is None:
        raise ValueError("observations with covariances are needed")
    if is_robust(options):
        raise InputError("a tolerance study has no outliers; leave --loss and --reject out")
    if model not in fitted_models():
        raise InputError(f"model {model}: a tolerance study solves {', '.join(fitted_models())}")
    tie = tie_parameters(model, options)
    problem = pack(seen, weighted=options.weighted)
    poses = origin_poses(problem, cam_from_target)
    root = np.linalg.cholesky(covariance)
    variance = 0.5 * np.trace(covariance, axis1=1, axis2=2).mean()
    deviation = 1.0 if options.weighted else float(np.sqrt(variance))
    anchor = _anchor(problem, camera, poses, model, tie, deviation)
    return Setting(
        target, camera, cam_from_target, seen, model, options, anchor,
        np.stack([root[:, 0, 0], root[:, 1, 0], root[:, 1, 1]], axis=1),
        np.bincount(seen.point, minlength=target.ring_count).astype(np.float64),
        grid_of(camera, seen.center_px), remarks,
    )  # fmt: skip


def _anchor(problem: Problem, camera: Camera, poses: Array, model: str, tie: Tie, deviation: float) -> Anchor:
    """The minimum without errors: the truth, if the solved model can hold it."""
    start = _in_model(camera, model, tie)
    if start is not camera:
        found = minimise(problem, start, poses, tie.row, RobustLoss(), DescentSteps(MOST_STEPS))
        start, poses = found.camera, found.cam_from_target
    products = view_blocks(problem, start, poses, RobustLoss()).products
    used, views = len(problem.is_used), problem.view_count
    accuracy = accuracy_of(products, tie.row, used)
    short = 2 * used - 6 * views <= int(tie.row.max(initial=-1)) + 1
    if short or not np.isfinite(products).all() or not accuracy.weakest_eigenvalue > SINGULAR:
        raise InputError(
            f"{views} views with {used} observations do not determine the {model} camera; use more views, from more "
            "sides"
        )
    return factorise(problem, tie, start, poses, deviation)


def _in_model(camera: Camera, model: str, tie: Tie) -> Camera:
    """The true camera in the solved model, with what is fixed or shared; itself where that changes nothing."""
    fitted = camera if camera.model == model else refit(camera, model).camera
    value = np.where(np.isnan(tie.value), fitted.params, tie.value)
    for group in range(int(tie.row.max(initial=-1)) + 1):
        value[tie.row == group] = value[tie.row == group].mean()
    return fitted if np.array_equal(value, fitted.params) else replace(fitted, params=value)
