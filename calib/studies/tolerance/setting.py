"""What is photographed, from where, with what noise, and how it is calibrated: all that errors do not change."""

import math
from dataclasses import dataclass, field, replace

import numpy as np
from numpy.typing import NDArray

from calib.cameras import fitted_models, linearise
from calib.cameras.camera import Camera
from calib.cameras.refit import refit
from calib.core.se3 import transform
from calib.core.types import Observations, frozen_array
from calib.observe.observations import known_points
from calib.renderer.poses import PoseGrid, Region, grid_poses
from calib.solver.accuracy import accuracy_of
from calib.solver.blocks import RobustLoss, view_blocks
from calib.solver.descend import is_robust
from calib.solver.levenberg import minimise
from calib.solver.options import AS_THE_PAPER, SolveOptions, Tie, tie_parameters
from calib.solver.problem import Problem, pack
from calib.studies.tolerance.anchor import Anchor, factorise
from calib.studies.tolerance.map_error import ImageGrid, grid_of
from calib.studies.tolerance.noise import CONTRAST_TO_NOISE, centre_covariances
from designer.base.errors import InputError
from designer.target import TargetGeometry

Array = NDArray[np.float64]

MAX_INCIDENCE_RAD = math.radians(75)
LEAST_MINOR_PX = 2.5
"""Half the minor axis of 5 px from which the detector measures rings well."""
LEAST_RINGS = 6
"""Of a view that counts."""
MARGIN_PX = 2.0
CAP_RAD = math.radians(60)
SINGULAR = 1e-13
MOST_STEPS = 200


@dataclass(frozen=True, eq=False)
class Setting:
    """M sightings of a nominal target in V views of a known camera, and the minimum they have without errors."""

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
    bed_from_target: Array | None = None  # (4, 4) how the target lay on the printer's bed
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
    distance_mm: float,
    model: str,
    seed: int,
    region: Region | None = None,
    cap_rad: float = CAP_RAD,
    contrast_to_noise: float = CONTRAST_TO_NOISE,
    options: SolveOptions | None = None,
    bed_from_target: Array | None = None,
) -> Setting:
    """Views on a Fibonacci grid around a target, as `calib render` takes them, rolled at random.

    Args:
        target: nominal.
        camera: that takes the photos.
        views: how many.
        distance_mm: of the cameras from the target's origin.
        model: to be solved.
        seed: of the rolls.
        region: of the grid; without it a cap for boards, else the sphere.
        cap_rad: half angle of a cap.
        contrast_to_noise: of the photos.
        options: of the solution.
        bed_from_target: how the target lay on the printer's bed.

    Raises:
        InputError: no such views, or they do not determine the camera; the message says why.
    """
    if views < 1:
        raise InputError(f"{views} views: give one or more")
    if not (math.isfinite(distance_mm) and distance_mm > 0):
        raise InputError(f"distance {distance_mm:g}mm: must be more than 0")
    where = region or ("cap" if target.is_planar else "sphere")
    half_angle = {"hemisphere": math.pi / 2, "sphere": math.pi, "cap": cap_rad}[where]
    grid = PoseGrid(views, half_angle, (distance_mm, distance_mm), random_roll=True, aim_offset_mm=0.0)
    poses = grid_poses(grid, np.random.default_rng(seed))
    return setting_at(
        target, camera, poses, model=model, contrast_to_noise=contrast_to_noise, options=options,
        bed_from_target=bed_from_target,
    )  # fmt: skip


def setting_at(
    target: TargetGeometry,
    camera: Camera,
    cam_from_target: Array,
    *,
    model: str,
    contrast_to_noise: float = CONTRAST_TO_NOISE,
    options: SolveOptions | None = None,
    bed_from_target: Array | None = None,
) -> Setting:
    """What a camera sees from known poses (V, 4, 4), with the noise of `calib.studies.tolerance.noise`.

    A ring is seen if its face is turned to the camera by 75 degrees or less, its image lies in the photo, and the minor
    axis of that is 5 px or more.

    Raises:
        InputError: nothing is seen, or not enough to determine the camera.
    """
    sightings = [seen_in(target, camera, pose, contrast_to_noise) for pose in cam_from_target]
    enough = [len(ring) >= LEAST_RINGS for ring, _, _ in sightings]
    remarks: tuple[str, ...] = ()
    if lost := enough.count(False):
        remarks = (f"{lost} of {len(enough)} views see fewer than {LEAST_RINGS} rings and are left out",)
    kept = [one for one, ok in zip(sightings, enough, strict=True) if ok]
    if not kept:
        raise InputError(
            f"none of {len(enough)} views sees {LEAST_RINGS} rings of the target that are at least "
            f"{2 * LEAST_MINOR_PX:g} px across in the image; move closer or farther, or use a longer lens"
        )
    names = tuple(f"view {number}" for number, ok in enumerate(enough) if ok)
    ring, pixel, covariance = (np.concatenate([one[k] for one in kept]) for k in range(3))
    view = np.repeat(np.arange(len(kept)), [len(one[0]) for one in kept])
    seen = Observations(camera.image_size, names, view, ring, pixel, covariance, known_points(target))
    poses = np.asarray(cam_from_target)[np.array(enough)]
    return _setting(target, camera, poses, seen, covariance, model, options, bed_from_target, remarks)


def setting_of_sightings(setting: Setting, cam_from_target: Array, seen: Observations) -> Setting:
    """The setting with other sightings.

    Args:
        setting: whose target, camera and way of solving it is.
        cam_from_target: true poses of the views that are seen (V, 4, 4).
        seen: sightings with covariances; their pixels are replaced by those of the drawing.

    Raises:
        InputError: they do not determine the camera.
    """
    covariance = seen.cov_px2
    if covariance is None:
        raise ValueError("sightings with covariances are needed")
    pixel = _projected(setting.camera, seen, setting.target, cam_from_target)
    return _setting(
        setting.target, setting.camera, cam_from_target, replace(seen, center_px=pixel), covariance, setting.model,
        setting.options, setting.bed_from_target, setting.remarks,
    )  # fmt: skip


def _projected(camera: Camera, seen: Observations, target: TargetGeometry, poses: Array) -> Array:
    point = transform(poses[seen.view], target.center_mm[seen.point])
    return linearise(camera, np.ascontiguousarray(point.T)).pixel.T


def seen_in(
    target: TargetGeometry, camera: Camera, cam_from_target: Array, contrast_to_noise: float
) -> tuple[NDArray[np.int64], Array, Array]:
    """Rings that a view sees (N,), their pixels (N, 2) and the covariances of these (N, 2, 2)."""
    center = transform(cam_from_target, target.center_mm)
    frame = cam_from_target[:3, :3] @ target.target_from_face[target.ring_face, :3, :3]
    cosine = -(frame[:, :, 2] * center).sum(axis=1) / np.linalg.norm(center, axis=1)
    front = np.flatnonzero((cosine >= math.cos(MAX_INCIDENCE_RAD)) & (center[:, 2] > 0))
    linear = linearise(camera, np.ascontiguousarray(center[front].T))
    on_face = linear.by_point.transpose(2, 0, 1) @ frame[front, :, :2]  # (N, 2, 2) px per mm
    circle = on_face * target.radius_outer_mm[front, None, None]
    pixel = linear.pixel.T
    reach = np.linalg.norm(circle, axis=2) + MARGIN_PX  # half of the box around the ellipse (N, 2)
    last = np.array(camera.image_size, dtype=np.float64) - 1
    with np.errstate(invalid="ignore"):
        inside = ((pixel - reach >= 0) & (pixel + reach <= last)).all(axis=1)
    good = np.flatnonzero(inside)
    minor = np.linalg.svd(circle[good], compute_uv=False)[:, 1]
    good = good[minor >= LEAST_MINOR_PX]
    ring = front[good]
    ratio = target.radius_inner_mm[ring] / target.radius_outer_mm[ring]
    return ring, pixel[good], centre_covariances(circle[good], ratio, contrast_to_noise)


def _setting(
    target: TargetGeometry,
    camera: Camera,
    cam_from_target: Array,
    seen: Observations,
    covariance: Array,
    model: str,
    options: SolveOptions | None,
    bed_from_target: Array | None,
    remarks: tuple[str, ...],
) -> Setting:
    """The setting of some sightings, whose pixels are free of noise."""
    options = options or AS_THE_PAPER
    if is_robust(options):
        raise InputError("a tolerance study has no outliers; leave --loss and --reject out")
    if model not in fitted_models():
        raise InputError(f"model {model}: a tolerance study solves {', '.join(fitted_models())}")
    tie = tie_parameters(model, options)
    problem = pack(seen, weighted=options.weighted)
    poses = np.array(cam_from_target)
    poses[:, :3, 3] += poses[:, :3, :3] @ problem.origin_mm
    root = np.linalg.cholesky(covariance)
    variance = 0.5 * np.trace(covariance, axis1=1, axis2=2).mean()
    deviation = 1.0 if options.weighted else float(np.sqrt(variance))
    anchor = _anchor(problem, camera, poses, model, tie, deviation)
    return Setting(
        target, camera, cam_from_target, seen, model, options, anchor,
        np.stack([root[:, 0, 0], root[:, 1, 0], root[:, 1, 1]], axis=1),
        np.bincount(seen.point, minlength=target.ring_count).astype(np.float64),
        grid_of(camera, seen.center_px), bed_from_target, remarks,
    )  # fmt: skip


def _anchor(problem: Problem, camera: Camera, poses: Array, model: str, tie: Tie, deviation: float) -> Anchor:
    """The minimum without errors: the truth, if the solved model can hold it.

    Raises:
        InputError: the views do not determine the camera.
    """
    start = _in_model(camera, model, tie)
    if start is not camera:
        found = minimise(problem, start, poses, tie.row, RobustLoss(), max_iterations=MOST_STEPS)
        start, poses = found.camera, found.cam_from_target
    products = view_blocks(problem, start, poses, RobustLoss()).products
    used, views = len(problem.is_used), problem.view_count
    accuracy = accuracy_of(products, tie.row, used)
    short = 2 * used - 6 * views <= _free_count(tie)
    if short or not np.isfinite(products).all() or not accuracy.weakest_eigenvalue > SINGULAR:
        raise InputError(
            f"{views} views with {used} sightings do not determine the {model} camera; use more views, from more sides"
        )
    return factorise(problem, tie, start, poses, deviation)


def _free_count(tie: Tie) -> int:
    return int(tie.row.max(initial=-1)) + 1


def _in_model(camera: Camera, model: str, tie: Tie) -> Camera:
    """The true camera in the solved model, with what is fixed or shared; itself where that changes nothing."""
    fitted = camera if camera.model == model else refit(camera, model).camera
    value = np.where(np.isnan(tie.value), fitted.params, tie.value)
    for group in range(_free_count(tie)):
        value[tie.row == group] = value[tie.row == group].mean()
    return fitted if np.array_equal(value, fitted.params) else replace(fitted, params=value)
