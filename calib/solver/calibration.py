"""A solved camera, with what is known of its accuracy.

A flat target that is bent: how, and where its points are then.

With x and y from -1 to 1 over its sides, and z along the normal of its plane, its points stand at

    z = a (1 - x^2) + b (1 - y^2) + c x y + d y (1 - x^2) + e x (1 - y^2).

But for constants and tilts, which are poses, these are five Legendre terms: P2(x), P2(y), P1(x) P1(y), P2(x) P1(y) and
P1(x) P2(y). The first two are the curvatures of mrcal's deformed calibration object, the third is a twist, and the
others are curvatures that change from one side to the other.
"""

import re
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Annotated, Literal

import numpy as np

from calib.cameras import parameter_names
from calib.cameras.camera import Camera
from calib.cameras.surface import surface_model
from calib.core.linear_algebra import least_squares
from calib.core.se3 import log_rotation
from calib.core.types import LEAST_POINTS, KnownPoints, Observations, freeze
from calib.solver.priors import ParameterPrior
from calib.solver.problem import Prior, prior_of
from designer.base.arrays import Array, Flags
from designer.base.errors import InputError
from designer.base.marks import LEFT_OUT, OR_NULL, PACKED, Above, AtLeast, AtMost, Count, Gap, Length, Shape
from designer.base.words import no_two_alike, shown
from designer.tolerance.model import ErrorModel
from designer.tolerance.source import Amount, Kind
from designer.tolerance.sources import SOURCES

FLAT, THIN = 0.05, 1e-3
"""Of the points' extent: what is off their plane by less is a flat target, bent or not; thinner points are a line."""
TERMS = 5
SURELY_BENT = 3.0
"""Standard deviations."""
LARGEST_MM = 1e7
LARGEST_SCALE = 1e9
_Length = Annotated[float, AtLeast(-LARGEST_MM), AtMost(LARGEST_MM)]


@dataclass(frozen=True, eq=False)
class PlaneBend:
    """Of a target whose points lie in a plane: `calibration.target_bend.height_mm`."""

    axes: Annotated[Array, Shape(3, 3)]  # rows: along x, along y, normal, in the target's frame
    middle_mm: tuple[_Length, _Length, _Length]
    half_mm: tuple[_Length, _Length]  # of the sides
    height_mm: Annotated[tuple[_Length, ...], Length(2, TERMS)] = (0.0,) * TERMS
    """a to e; of files of before, a and b."""
    covariance_mm2: Annotated[tuple[Gap, ...], Length(3, TERMS * (TERMS + 1) // 2)] = (0.0,) * 15
    """Of a to e: the upper triangle, row by row."""
    before_mm: Annotated[tuple[_Length, ...], Length(0, TERMS), LEFT_OUT] = ()  # standard deviations believed before

    def __post_init__(self) -> None:
        freeze(self, "axes")
        count = len(self.height_mm)
        if len(self.covariance_mm2) != count * (count + 1) // 2:
            raise ValueError(f"covariance_mm2 must be the {count * (count + 1) // 2} numbers of {count} heights")

    def modes_mm(self, position_mm: Array) -> Array:
        """What heights of 1 mm do to points (K, 3).  # (S, K, 3)"""
        x, y = (((position_mm - self.middle_mm) @ self.axes[:2].T) / self.half_mm).T
        heights = np.stack([1 - x**2, 1 - y**2, x * y, y * (1 - x**2), x * (1 - y**2)])
        modes: Array = heights[: len(self.height_mm), :, None] * self.axes[2]
        return modes

    def heights_of(self, position_mm: Array, displaced_mm: Array) -> Array:
        """The heights that displacements (N, K, 3) of points (K, 3) have, but for what poses take up.  # (N, S)"""
        place = (position_mm - self.middle_mm) @ self.axes[:2].T
        bends = self.modes_mm(position_mm) @ self.axes[2]
        columns = np.column_stack([np.ones(len(place)), place / self.half_mm, bends.T])
        heights: Array = least_squares(columns, (displaced_mm @ self.axes[2]).T)[3:].T
        return heights

    def bent(self, seen: Observations) -> Observations:
        """Sightings of the flat target as those of the bent one."""
        return _moved(seen, np.tensordot(self.height_mm, self.modes_mm(seen.points.position_mm), 1))

    def flattened(self, seen: Observations) -> Observations:
        """Sightings of the bent target as those of the flat one; the modes do not depend on z."""
        return _moved(seen, -np.tensordot(self.height_mm, self.modes_mm(seen.points.position_mm), 1))

    @property
    def covariance(self) -> Array:
        """Of the heights.  # (S, S)"""
        count = len(self.height_mm)
        matrix = np.zeros((count, count))
        matrix[np.triu_indices(count)] = self.covariance_mm2
        full: Array = matrix + np.triu(matrix, 1).T
        return full

    @property
    def sigma_mm(self) -> tuple[float, ...]:
        """Standard deviations of the heights."""
        return tuple(np.sqrt(np.maximum(np.diagonal(self.covariance), 0.0)).tolist())

    @property
    def believed_mm(self) -> tuple[float, float, float, float, float] | None:
        """As `SolveOptions.bend_sigma_mm`, to solve again as this was; None: what is usual."""
        if len(self.before_mm) < TERMS:  # files of before do not say
            return None
        a, b, c, d, e = self.before_mm
        return a, b, c, d, e

    def told(self, height_mm: Array, covariance_mm2: Array, before_mm: Array) -> "PlaneBend":
        """The same with heights (S,), their covariance (S, S), and what was believed of them (S,)."""
        upper = covariance_mm2[np.triu_indices(len(height_mm))]
        return replace(
            self, height_mm=tuple(height_mm.tolist()), covariance_mm2=tuple(upper.tolist()),
            before_mm=tuple(before_mm.tolist()),
        )  # fmt: skip

    @property
    def sentence(self) -> str:
        """How the target is bent, in a line; one that is not surely bent is flat within so much."""
        (a, b, *rest), (sigma_a, sigma_b, *rest_sigma) = self.height_mm, self.sigma_mm
        sigma_mm = np.array(self.sigma_mm)
        if not (np.abs(self.height_mm) > SURELY_BENT * sigma_mm).any():
            within_mm = float((np.abs(self.height_mm) + SURELY_BENT * sigma_mm).max())
            return (
                f"the target is flat within {within_mm:.2g} mm, as the photos show it; what they leave open is stated"
            )
        x, y, z = self.axes[2].tolist()
        others = ", ".join(f"{one:.2g} ± {sigma:.2g}" for one, sigma in zip(rest, rest_sigma, strict=True))
        return (
            f"the target is bent: its middle stands {a:.3g} ± {sigma_a:.2g} mm out against the ends of its first side "
            f"and {b:.3g} ± {sigma_b:.2g} mm against those of its second, along its normal ({x:g}, {y:g}, {z:g})"
            + (f" (twist and skew bends {others} mm)" if others else "")
            + "; its points were moved so"
        )


def _moved(seen: Observations, step_mm: Array) -> Observations:
    return replace(seen, points=replace(seen.points, position_mm=seen.points.position_mm + step_mm))


def is_flat(points: KnownPoints) -> bool:
    """Whether points lie in a plane, nearly, and not on a line."""
    position = points.position_mm
    if len(position) < LEAST_POINTS:
        return False
    longest, across, off = np.linalg.svd(position - position.mean(axis=0), compute_uv=False).tolist()
    return bool(off <= FLAT * longest and across > THIN * longest)


def plane_bend(points: KnownPoints) -> PlaneBend:
    """The bend, still zero, of points in a plane; x lies along the first of the target's axes that does not cross it.

    Raises:
        InputError: they are in no plane, or on a line.
    """
    position = points.position_mm
    if not is_flat(points):
        raise InputError(
            "--free-bend: the target's points lie in no plane; it is for boards, so leave it out "
            "(calib measure tells the shape of other targets)"
        )
    directions = np.linalg.svd(position - position.mean(axis=0), full_matrices=False)[2]
    normal = directions[2] * np.sign(directions[2][np.argmax(np.abs(directions[2]))])
    if len(points.plane) == 1 and points.plane[0, :3] @ normal < 0:
        normal = -normal
    first = np.eye(3)[int(np.argmax(np.abs(normal) < np.sqrt(0.5)))]
    along = first - (first @ normal) * normal
    along /= np.linalg.norm(along)
    axes = np.stack([along, np.cross(normal, along), normal])
    place = position @ axes.T
    low, high = place.min(axis=0), place.max(axis=0)
    x, y, z = (0.5 * (low + high) @ axes).tolist()
    return PlaneBend(axes, (x, y, z), (float(0.5 * (high - low)[0]), float(0.5 * (high - low)[1])))


Status = Literal["converged", "stopped", "degenerate"]
"""`stopped`: the steps ran out; `degenerate`: the data do not determine the camera, and the remarks say why."""


_Text = Annotated[str, Length(0, 1000)]
_Size = Annotated[float, AtLeast(-1e6), AtMost(1e6)]
"""Of an error, in mm, rad, kelvins or shares."""


SURE_CIRCLES = 4.0
"""Sigmas from which on points are said to fit as centres of circles: other faults of the photos look so, too."""


@dataclass(frozen=True)
class MadeWith:
    """What moves rings, in the sources' units: a template or a file of errors may be another one later."""

    amounts: Annotated[tuple[tuple[str, Kind, _Size], ...], Length(0, len(SOURCES))]
    expansion_per_kelvin: Annotated[_Size, AtLeast(0)]
    layer_height_mm: Annotated[_Size, AtLeast(0)]

    def __post_init__(self) -> None:
        try:
            self.model()
        except ValueError as error:
            raise ValueError(str(error)) from None

    @classmethod
    def of(cls, errors: ErrorModel) -> "MadeWith":
        """What a file keeps of a way of making."""
        amounts = tuple((name, amount.kind, amount.size) for name, amount in errors.amounts)
        return cls(amounts, errors.expansion_per_kelvin, errors.layer_height_mm)

    def model(self) -> ErrorModel:
        """The errors as they were then."""
        amounts = tuple((source, Amount(kind, size)) for source, kind, size in self.amounts)
        return ErrorModel("", "", amounts, self.expansion_per_kelvin, self.layer_height_mm)


@dataclass(frozen=True, eq=False)
class TargetError:
    """What a target that is not quite as its file says may have done to the parameters of a camera."""

    made: _Text  # the way of making: an error template's name, a file's, "measured" or "exact"
    because: _Text  # why this one, as in "its file says the build 'solid'"; "" if it was asked for
    param_covariance: Annotated[Array, Shape("P", "P"), PACKED]  # to be added to that of the noise
    errors: MadeWith | None = None  # of that way of making, as they were then; None: they are not told by one

    def __post_init__(self) -> None:
        freeze(self, "param_covariance")


@dataclass(frozen=True, eq=False)
class ImageField:
    """Errors that are fixed in the image and that the lens model does not follow, as the residuals show them."""

    left_px: Annotated[float, AtLeast(0)]  # RMS of a coordinate over the image, of what the camera does not follow
    param_covariance: Annotated[Array, Shape("P", "P"), PACKED]  # of what the parameters took of it, to be added

    def __post_init__(self) -> None:
        freeze(self, "param_covariance")


Capture = Literal["still", "handheld", "moving"]
"""How photos are taken: what may move alike in all of them, while one is taken."""


@dataclass(frozen=True)
class CaptureEffect:
    """Something that is alike in all photos and beyond chance."""

    name: _Text  # "a focal length that changes with the distance"
    amount: _Size
    sigma: Annotated[float, AtLeast(0)]
    unit: _Text  # of both, as in "px from the first row to the last"
    camera_px: Annotated[float, AtLeast(0)]  # 95 % of the image is off by at most so much by it
    explains: bool  # it leaves nothing over that is fixed in the image, and no parameter was held that does the same
    remedy: _Text  # "focus by hand, and leave it"


@dataclass(frozen=True, eq=False)
class CaptureError:
    """What moves or changes alike in all photos, and what it may have done to the parameters of a camera."""

    capture: Capture
    because: _Text  # why this one; "" if it was asked for
    effects: Annotated[tuple[CaptureEffect, ...], Length(0, 20)]  # that the photos show, the surest first
    param_covariance: Annotated[Array, Shape("P", "P"), PACKED]  # to be added

    def __post_init__(self) -> None:
        freeze(self, "param_covariance")


@dataclass(frozen=True, eq=False)
class PhotoError:
    """What the centres of a photo share, beyond chance."""

    times: Annotated[float, AtLeast(1)]  # deviations by photo, of those of independent errors: root mean square
    param_covariance: Annotated[Array, Shape("P", "P"), PACKED]  # beyond all other parts, to be added

    def __post_init__(self) -> None:
        freeze(self, "param_covariance")


LINEAR = ("fx", "fy", "cx", "cy")


@dataclass(frozen=True)
class Breathing:
    """How the focal length follows the distance Z of what is photographed: `f (1 + mm (1 / Z - 1 / at_mm))`."""

    mm: float
    sigma_mm: Annotated[float, AtLeast(0)]
    at_mm: Annotated[float, Above(0)]  # where it is the camera's

    @property
    def sentence(self) -> str:
        """What it is, and at which distance the camera holds."""
        return (
            f"the focal length follows the distance Z: f (1 + b (1/Z - 1/{self.at_mm:g} mm)) with b = "
            f"{self.mm:.3g} ± {self.sigma_mm:.2g} mm; the camera is that at {self.at_mm:g} mm"
        )


@dataclass(frozen=True, eq=False)
class PhotoSession:
    """The linear part of a group of photos, between which it varies."""

    name: _Text
    photos: tuple[str, ...]
    linear: Annotated[Array, Shape(4)]  # fx, fy, cx, cy in px
    sigma: Annotated[Array, Shape(4)]

    def __post_init__(self) -> None:
        freeze(self, "linear", "sigma")

    def of(self, camera: Camera) -> Camera:
        """The camera of these photos, of that of all."""
        return replace(camera, params=np.concatenate([self.linear, camera.params[4:]]))

    def told(self, camera: Camera) -> str:
        """What is another than in the camera of all."""
        each = zip(LINEAR, self.linear.tolist(), self.sigma.tolist(), camera.params[:4].tolist(), strict=True)
        parts = [f"{name} {value:.6g} ± {sigma:.2g} px" for name, value, sigma, mean in each if value != mean]
        return f"session {shown(self.name)}: {', '.join(parts)}"


def session_files(sessions: Sequence[PhotoSession]) -> tuple[str, ...]:
    """The file of each one's camera: by its name, in letters that any system has; no two alike."""
    words = no_two_alike(re.sub("[^A-Za-z0-9_-]+", "_", one.name)[:60] for one in sessions)
    return tuple(f"camera.{word}.json" for word in words)


@dataclass(frozen=True, eq=False)
class CircleDoubt:
    """What the camera may be off because nobody said whether its points are centres of circles."""

    diameter_mm: Annotated[float, AtLeast(0)]  # that fits best, 0 if none does
    sigmas: Annotated[float, AtLeast(-1e9), AtMost(1e9)]  # by which the square of that diameter differs from 0
    spacing_mm: Annotated[float, AtLeast(0)]  # of the points
    param_covariance: Annotated[Array, Shape("P", "P"), PACKED]  # to be added

    def __post_init__(self) -> None:
        freeze(self, "param_covariance")

    @property
    def told_mm(self) -> tuple[float, float] | None:
        """The diameter of circles that the points are surely centres of, and its standard deviation; None: not told."""
        if self.sigmas <= SURE_CIRCLES or not 0 < self.diameter_mm <= self.spacing_mm:
            return None
        return self.diameter_mm, 0.5 * self.diameter_mm / self.sigmas


@dataclass(frozen=True, eq=False, kw_only=True)
class Solved:
    """How a solution came about, of one camera or of several; also in their files."""

    status: Status
    remarks: tuple[str, ...]  # why degenerate, what was left out and why; one line each
    iterations: Count
    seconds: Annotated[float, AtLeast(0)]
    weighted: bool  # by the covariances of the observations


@dataclass(frozen=True, eq=False, kw_only=True)
class CameraSolution(Solved):
    """What a camera's file says in the words of its calibration."""

    scale: Annotated[Gap, AtLeast(0), AtMost(LARGEST_SCALE)]
    """Posterior standard deviation of an observation: px, or with weights in units of the stated covariance."""
    fixed: tuple[str, ...]  # parameters that were not estimated
    camera: Camera
    param_covariance: Annotated[Array, Shape("P", "P"), PACKED, OR_NULL]  # by the noise alone, 0 for fixed parameters
    target_error: TargetError | None = None  # None: nothing is known of how the target was made
    image_field: ImageField | None = None  # None: nothing shows that there is one
    capture_error: CaptureError | None = None  # None: not asked, or of a camera that is not told by few parameters
    photo_error: PhotoError | None = None  # None: the centres of a photo share nothing beyond chance
    circle_doubt: Annotated[CircleDoubt | None, LEFT_OUT] = None  # None: what the points are is known
    target_bend: Annotated[PlaneBend | None, LEFT_OUT] = None  # that moved the points; None: it was no unknown
    linear: Annotated[Annotated[Array, Shape("V", 4)] | None, LEFT_OUT] = None
    """Of each view fx, fy, cx, cy, where these vary; None: the camera's."""
    breathing: Annotated[Breathing | None, LEFT_OUT] = None
    sessions: Annotated[tuple[PhotoSession, ...], LEFT_OUT] = ()
    priors: Annotated[tuple[ParameterPrior, ...], LEFT_OUT] = ()
    """What was known of parameters beforehand, which is in all that is told."""

    @property
    def told_of_camera(self) -> str | None:
        """Which photos the camera alone is not that of; None: it is that of all."""
        if self.breathing is not None:
            return f"{self.breathing.sentence}: poses at other distances are off"
        if self.sessions:
            return f"the mean of {len(self.sessions)} sessions; the files camera.SESSION.json beside it are theirs"
        return None

    @property
    def errors(self) -> "dict[str, TargetError | ImageField | CaptureError | PhotoError | CircleDoubt]":
        """What may be off besides the noise of single observations, by its field's name."""
        parts = {
            "target_error": self.target_error,
            "image_field": self.image_field,
            "capture_error": self.capture_error,
            "photo_error": self.photo_error,
            "circle_doubt": self.circle_doubt,
        }
        return {name: part for name, part in parts.items() if part is not None}


@dataclass(frozen=True, eq=False, kw_only=True)
class Calibration(CameraSolution):
    """A solved camera, its V poses and how sure they are: `run.best.calibration.cam_from_target`."""

    observations: Observations  # of the views that were solved; covariances as their residuals have them
    cam_from_target: Array  # (V, 4, 4)
    residual_px: Array  # (M, 2) predicted - measured, of outliers too
    is_outlier: Flags  # (M,) left out of the solution
    pose_covariance: Array  # (V, 6, 6) rotation vector (rad), translation (mm), both in the camera's axes

    @property
    def stated_covariance(self) -> Array:
        """The parameters' covariance as it is to be told: by noise and by all of `errors`.  # (P, P)"""
        parts = [part.param_covariance for part in self.errors.values()]
        stated: Array = sum(parts, start=np.asarray(self.param_covariance))
        return stated

    @property
    def rvecs(self) -> Array:
        """The turns of `cam_from_target` as OpenCV has them: `cv2.projectPoints(x, c.rvecs[0], c.tvecs[0], ...)`."""
        return log_rotation(self.cam_from_target[:, :3, :3])

    @property
    def tvecs(self) -> Array:
        """And their shifts in mm.  # (V, 3)"""
        shift: Array = self.cam_from_target[:, :3, 3]
        return shift

    @property
    def prior(self) -> Prior:
        """What priors say of the parameters, beside its whitened residuals."""
        return prior_of(self.priors, parameter_names(self.camera.model), self.scale**2)

    @property
    def given(self) -> Observations:
        """The observations, the points where the target's file has them."""
        return self.observations if self.target_bend is None else self.target_bend.flattened(self.observations)

    def __post_init__(self) -> None:
        freeze(self, "is_outlier", dtype=np.bool_)
        freeze(self, "cam_from_target", "residual_px", "param_covariance", "pose_covariance", "linear")


def without_surface(calibration: Calibration) -> Calibration:
    """The calibration with the camera's base alone, as sure as that is; as it was of a camera without a surface."""
    model = surface_model(calibration.camera.model)
    if model is None:
        return calibration
    own, error, doubt = slice(model.first_control), calibration.target_error, calibration.circle_doubt
    return replace(
        calibration,
        camera=model.base_camera(calibration.camera),
        param_covariance=calibration.param_covariance[own, own],
        target_error=error and replace(error, param_covariance=error.param_covariance[own, own]),
        circle_doubt=doubt and replace(doubt, param_covariance=doubt.param_covariance[own, own]),
    )
