"""What the parts of the calibration hand to each other. No logic, but for what keeps arrays whole."""

from dataclasses import dataclass
from typing import TYPE_CHECKING, Literal

import numpy as np
from numpy.typing import NDArray

if TYPE_CHECKING:
    from designer.tolerance.model import ErrorModel


def frozen_array(values: object, dtype: type[np.generic] = np.float64) -> NDArray[np.generic]:
    """A read-only, C-contiguous copy of `values`."""
    array = np.array(values, dtype=dtype, order="C")
    array.setflags(write=False)
    return array


@dataclass(frozen=True, eq=False)
class LearnedMap:
    """A Gaussian process that takes measured pixels to a distortion-free sensor: the data it was conditioned on.

    The sensor's point is `trend(u) + sum_n k(u, knot_n) weight_n` with the homography `trend` and the squared
    exponential kernel `k(u, v) = exp(-|u - v|^2 / (2 length_px^2))`; see `calib.cameras.learned`.
    """

    knot_px: NDArray[np.float64]  # (N, 2) where measured
    weight: NDArray[np.float64]  # (N, 2) in units of the sensor
    noise_variance: NDArray[np.float64]  # (N,) of a knot, in units of the kernel's variance
    trend: NDArray[np.float64]  # (3, 3) homography from pixels to the sensor
    length_px: float
    limit: float  # beyond this standard deviation, in units of the kernel's, the map is not known

    def __post_init__(self) -> None:
        for name in ("knot_px", "weight", "noise_variance", "trend"):
            object.__setattr__(self, name, frozen_array(getattr(self, name)))


@dataclass(frozen=True, eq=False)
class Camera:
    """A camera: a model's name (`calib.cameras.MODELS`), its parameters, and the image it belongs to."""

    model: str
    params: NDArray[np.float64]  # (P,) in the model's order and units
    image_size: tuple[int, int]  # width, height in px
    learned: LearnedMap | None = None  # of models that learn a map

    def __post_init__(self) -> None:
        object.__setattr__(self, "params", frozen_array(self.params))


LEAST_RADIUS_PX = 5.0
"""Of a ring that faces the camera, for the detector; turned away it is flatter, and the detector wants 5 px across."""

Mark = Literal["dot", "ring", "unreadable"]

TOO_FLAT = "seen too small or too flat"
OUTSIDE = "outside the image"
CUT_OFF = "cut by the image's edge"
NOT_MEASURABLE = (TOO_FLAT, OUTSIDE, CUT_OFF)
"""Why features are missing that no camera could have measured from there."""
UNMEASURABLE_WORDS = f"{TOO_FLAT}, outside the image or cut by its edge"


@dataclass(frozen=True)
class FaceRecord:
    """What was read of one face, or of a group of rings that was found but could not be named.

    Why rings are missing is counted by reason, so that a person sees what to change.
    """

    face: int | None  # None: the group could not be named, `remark` says why
    code_read: tuple[Mark, ...]  # the six candidate positions of a face code, or the three dots of a board; () without
    margin: int  # how many marks fit the name given better than the next best name
    rings_found: int  # named features, dots included
    rings_expected: int  # features of the face
    missing: tuple[tuple[str, int], ...]  # reason, how many; sums to expected - found for a named face
    remark: str = ""


@dataclass(frozen=True, eq=False)
class Detections:
    """N named features in one image."""

    image: str  # the file's name without folder
    image_size: tuple[int, int]  # width, height in px
    layout_id: str  # of the target they were named with
    geometry_id: str
    ring: NDArray[np.int64]  # (N,) rows of the target's arrays, ascending
    center_px: NDArray[np.float64]  # (N, 2) projected centres, u v
    cov_px2: NDArray[np.float64]  # (N, 2, 2)
    ellipse_px: NDArray[np.float64]  # (N, 5) outer contour: centre u v, semi-axes major minor, angle of the major (rad)
    faces: tuple[FaceRecord, ...]
    remarks: tuple[str, ...] = ()  # what a person must know of this image: why nothing was found, mirrored, ambiguous
    rejected_px: NDArray[np.float64] | None = None  # (K, 2) ring-like things that got no name

    def __post_init__(self) -> None:
        object.__setattr__(self, "ring", frozen_array(self.ring, np.int64))
        for name in ("center_px", "cov_px2", "ellipse_px"):
            object.__setattr__(self, name, frozen_array(getattr(self, name)))
        rejected = np.zeros((0, 2)) if self.rejected_px is None else self.rejected_px
        object.__setattr__(self, "rejected_px", frozen_array(rejected))


@dataclass(frozen=True, eq=False)
class KnownPoints:
    """The K points of a target whose sightings a camera is solved from, and the planes they lie in."""

    position_mm: NDArray[np.float64]  # (K, 3) in the target's frame
    face: NDArray[np.int64]  # (K,) row of `plane`; -1: on no known plane
    plane: NDArray[np.float64]  # (F, 4) unit normal n and offset d (mm) of the plane n X = d
    geometry_id: str = ""  # of the target file they come from; "" for points from elsewhere

    def __post_init__(self) -> None:
        object.__setattr__(self, "face", frozen_array(self.face, np.int64))
        for name in ("position_mm", "plane"):
            object.__setattr__(self, name, frozen_array(getattr(self, name)))


@dataclass(frozen=True, eq=False)
class Observations:
    """M sightings of known points in V views of one camera."""

    image_size: tuple[int, int]  # width, height in px
    view_names: tuple[str, ...]  # (V,)
    view: NDArray[np.int64]  # (M,) ascending
    point: NDArray[np.int64]  # (M,) rows of `points`
    center_px: NDArray[np.float64]  # (M, 2)
    cov_px2: NDArray[np.float64] | None  # (M, 2, 2); None: not known, all alike
    points: KnownPoints
    remarks: tuple[str, ...] = ()  # what was left out of them, or should be known, one line each

    def __post_init__(self) -> None:
        for name in ("view", "point"):
            object.__setattr__(self, name, frozen_array(getattr(self, name), np.int64))
        object.__setattr__(self, "center_px", frozen_array(self.center_px))
        if self.cov_px2 is not None:
            object.__setattr__(self, "cov_px2", frozen_array(self.cov_px2))

    @property
    def view_count(self) -> int:
        """How many views."""
        return len(self.view_names)


Status = Literal["converged", "stopped", "degenerate"]
"""`stopped`: the steps ran out; `degenerate`: the data do not determine the camera, and the remarks say why."""


@dataclass(frozen=True, eq=False)
class TargetError:
    """What a target that is not quite as its file says may have done to the parameters of a camera."""

    made: str  # the way of making: an error template's name, a file's, "measured" or "exact"
    because: str  # why this one, as in "its file says the build 'solid'"; "" if it was asked for
    param_covariance: NDArray[np.float64]  # (P, P) to be added to that of the noise
    errors: "ErrorModel | None" = None  # of that way of making, as they were then; None: they are not told by one

    def __post_init__(self) -> None:
        object.__setattr__(self, "param_covariance", frozen_array(self.param_covariance))


@dataclass(frozen=True, eq=False)
class ImageField:
    """Errors that are fixed in the image and that the lens model does not follow, as the residuals show them."""

    left_px: float  # root mean square that it leaves in a coordinate of the residuals
    param_covariance: NDArray[np.float64]  # (P, P) of what the parameters took of it, to be added to that of the noise

    def __post_init__(self) -> None:
        object.__setattr__(self, "param_covariance", frozen_array(self.param_covariance))


@dataclass(frozen=True, eq=False)
class Calibration:
    """A camera solved from observations, with V poses and what is known of their accuracy."""

    camera: Camera
    observations: Observations  # of the views that were solved
    cam_from_target: NDArray[np.float64]  # (V, 4, 4)
    residual_px: NDArray[np.float64]  # (M, 2) predicted - measured, of outliers too
    is_outlier: NDArray[np.bool_]  # (M,) left out of the solution
    scale: float
    """Posterior standard deviation of an observation: px, or with weights in units of the stated covariance."""
    param_covariance: NDArray[np.float64]  # (P, P) by the noise alone, zero for fixed parameters
    pose_covariance: NDArray[np.float64]  # (V, 6, 6) rotation vector (rad), translation (mm), both in the camera's axes
    fixed: tuple[str, ...]  # parameters that were not estimated
    weighted: bool  # by the covariances of the observations
    status: Status
    remarks: tuple[str, ...]  # why degenerate, what was left out and why; one line each
    iterations: int
    seconds: float
    target_error: TargetError | None = None  # None: nothing is known of how the target was made
    image_field: ImageField | None = None  # None: nothing shows that there is one

    @property
    def stated_covariance(self) -> NDArray[np.float64]:
        """The parameters' covariance as it is to be told: by noise, target and what is fixed in the image.  # (P, P)"""
        parts = [part.param_covariance for part in (self.target_error, self.image_field) if part is not None]
        stated: NDArray[np.float64] = sum(parts, start=np.asarray(self.param_covariance))
        return stated

    def __post_init__(self) -> None:
        object.__setattr__(self, "is_outlier", frozen_array(self.is_outlier, np.bool_))
        for name in ("cam_from_target", "residual_px", "param_covariance", "pose_covariance"):
            object.__setattr__(self, name, frozen_array(getattr(self, name)))
