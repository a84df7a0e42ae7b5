"""A camera: a model's name, its parameters, and the image it belongs to; and the files that hold one.

These are `camera.json`, and templates or a person's own TOML with the same keys.

What a camera is in the middle of its image: the pinhole with the same scale there, and how sure that is.
"""

import math
from collections.abc import Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from types import MappingProxyType
from typing import Annotated, cast

import numpy as np

from calib.cameras import ABILITIES, LINEAR, MODELS, CameraModel, linearise, parameter_names, project, rays
from calib.core.types import freeze
from designer.base.arrays import Array
from designer.base.errors import InputError
from designer.base.file_kind import FileKind, laid_out
from designer.base.files import JsonValue, parse_json, place_of, read_small_text, read_spec_file, write_files
from designer.base.marks import LEFT_OUT, Above, AtLeast, AtMost, Length, Line, Shape
from designer.base.words import shown, suggestion, suggestion_or_all
from designer.kinds.presets import preset_or_file

MAX_KNOTS = 1000
WHOLE_TURN_RAD = 2 * math.pi
MAX_LENGTHS = 40.0
"""A side of the image has at most so many lengths of the kernel, so that tables stay small."""
LARGEST = 1e15
LEAST_NOISE = 1e-12
"""Less leaves the equations of the process singular in floating point."""
_Bounded = Annotated[Array, AtLeast(-LARGEST), AtMost(LARGEST)]


@dataclass(frozen=True, eq=False)
class LearnedMap:
    """A Gaussian process that takes measured pixels to a distortion-free sensor: the data it was conditioned on.

    The sensor's point is `trend(u) + sum_n k(u, knot_n) weight_n` with the homography `trend` and the squared
    exponential kernel `k(u, v) = exp(-|u - v|^2 / (2 length_px^2))`; see `calib.cameras.learned`.
    """

    knot_px: Annotated[_Bounded, Shape("N", 2), Length(1, MAX_KNOTS)]  # where measured
    weight: Annotated[_Bounded, Shape("N", 2)]  # in units of the sensor
    noise_variance: Annotated[_Bounded, Shape("N"), AtLeast(LEAST_NOISE)]  # of a knot, in units of the kernel's
    trend: Annotated[_Bounded, Shape(3, 3)]  # homography from pixels to the sensor
    length_px: Annotated[float, Above(0), AtMost(LARGEST)]
    limit: Annotated[float, Above(0), AtMost(1)]  # beyond this standard deviation, in the kernel's, nothing is known

    def __post_init__(self) -> None:
        freeze(self, "knot_px", "weight", "noise_variance", "trend")


@dataclass(frozen=True, eq=False)
class Camera:
    """A model, its parameters, and the image they belong to: `camera.project(x_cam)`, `camera.rays(u_px)`."""

    model: str
    params: Array  # (P,) in the model's order and units
    image_size: tuple[int, int]  # width, height in px
    learned: LearnedMap | None = None  # of models that learn a map
    field_rad: float | None = None  # angle across the image circle; None: light as far as the model has an image

    def __post_init__(self) -> None:
        freeze(self, "params")
        if self.model not in MODELS:
            raise InputError(f"unknown camera model {shown(self.model)}; there are {', '.join(MODELS)}")
        names = parameter_names(self.model)
        if self.params.shape != (len(names),):
            raise InputError(
                f"{self.params.size} parameters: model {self.model} takes {len(names)}: {', '.join(names)}"
            )

    @property
    def parameters(self) -> Mapping[str, float]:
        """The parameters by name."""
        return MappingProxyType(dict(zip(parameter_names(self.model), self.params.tolist(), strict=True)))

    @property
    def has_dark_corners(self) -> bool:
        """Whether light may reach a part of the image only."""
        return ABILITIES[self.model].is_wide or self.field_rad is not None

    @property
    def matrix(self) -> Array:
        """The linear part: `[[fx, skew, cx], [0, fy, cy], [0, 0, 1]]` in px; most models have no skew.  # (3, 3)"""
        fx, fy, cx, cy = self.params[:4]
        return np.array([[fx, self.parameters.get("skew_px", 0.0), cx], [0.0, fy, cy], [0.0, 0.0, 1.0]])

    @property
    def distortion(self) -> Array:
        """The lens as OpenCV's functions take it: k1 k2 p1 p2 k3, of rational lenses k4 k5 k6 (s1 s2 s3 s4), too.

        There are 5, 8 or 12 numbers; of model fisheye the 4 that the functions of `cv2.fisheye` take, k1 k2 k3 k4.

        Raises:
            InputError: another model's lens; `calib.convert` fits OpenCV's to it, and says how well.
        """
        names = MODELS[self.model].opencv_lens
        if names is None:
            raise InputError(
                f"model {self.model}: its lens is none that OpenCV's functions take; fit one with calib.convert"
            )
        return np.array([self.parameters[name] for name in names] or [0.0] * 5)

    def project(self, point: Array) -> Array:
        """Pixels (..., 2) of points (..., 3) in the camera's frame; nan where it does not see: `camera.project(x)`."""
        return project(self, _rows_of(point, 3, "points"))

    def rays(self, pixel: Array) -> Array:
        """Unit directions (..., 3) of the light that reaches pixels (..., 2); nan where none does: `camera.rays(u)`."""
        return rays(self, _rows_of(pixel, 2, "pixels"))

    def to_json(self, remark: str | None = None) -> JsonValue:
        """The content of `camera.json`, which also stands in other files."""
        file = CameraDocument(self.model, self.image_size, self.parameters, self.learned, self.field_rad, remark)
        return CAMERA.document(file)

    @classmethod
    def from_json(cls, value: JsonValue, place: str) -> "Camera":
        """The camera in a document."""
        return camera_from_mapping(value, place)

    def save(self, path: str | Path) -> Path:
        """Write `camera.json`, which reads back bit for bit: `camera.save("camera.json")`; return its place.

        Raises:
            InputError: the place takes no file, or holds somebody else's.
        """
        place = place_of(path, "a file to write, such as camera.json")
        write_files({place: camera_to_json(self).encode()})
        return place


def relinear(pixel: Array, old: Array, new: Array) -> Array:
    """Where pixels (N, 2) of cameras with some fx, fy, cx, cy (N, 4) or (4,) are in those with others."""
    moved: Array = (pixel - old[..., 2:4]) / old[..., :2] * new[..., :2] + new[..., 2:4]
    return moved


def _rows_of(value: object, columns: int, what: str) -> Array:
    """An array (..., columns) of numbers.

    Raises:
        InputError: it is none.
    """
    try:
        rows = np.asarray(value, dtype=np.float64)
    except (TypeError, ValueError):
        raise InputError(f"{shown(value)}: {what} are numbers; give an array (..., {columns})") from None
    if rows.shape[-1:] != (columns,):
        raise InputError(f"{what} of shape {rows.shape}: give an array (..., {columns})")
    return rows


MAX_SIDE_PX = 100_000
REQUIRED = ("fx_px", "fy_px", "cx_px", "cy_px")
"""What every model has; in a TOML file a lens's parameters may be left out if they do nothing, no control points."""
FOCAL_RANGE_PX = (1e-3, 1e9)
LARGEST_BY_UNIT = {"px": 1e9, "rad": 1e30, "1": 1e30}
"""By unit, what a parameter may be at most; what is larger overflows further on, and is no lens."""

GRID, LEAST_SEEN, LEAST_FORWARD = 41, 0.01, 1e-3
"""Of pixels that are tried, the least share with a ray less than 89.9 degrees off the axis."""

Field = Annotated[float, Above(0), AtMost(WHOLE_TURN_RAD)]
Side = Annotated[int, AtLeast(1), AtMost(MAX_SIDE_PX)]


@dataclass(frozen=True)
class CameraDocument:
    """The keys of a camera file; the parameters' names depend on the model."""

    model: str
    image_size: tuple[Side, Side]
    parameters: Mapping[str, float]
    learned_map: Annotated[LearnedMap | None, LEFT_OUT] = None
    field_rad: Annotated[Field | None, LEFT_OUT] = None
    remark: Annotated[Line | None, LEFT_OUT] = None  # which photos it is not the camera of


CAMERA = FileKind(CameraDocument, "camera", "a camera file", "check the file", largest_bytes=2**20)


def camera_to_json(camera: Camera, remark: str | None = None) -> str:
    """The text of `camera.json`; it reads back bit for bit."""
    return laid_out(camera.to_json(remark)) + "\n"


def camera_from_mapping(values: object, origin: str, *, is_written_by_hand: bool = False) -> Camera:
    """The camera in a parsed file, whose name is `origin`.

    Written by hand, what the lens is not said to have, it has not; else all parameters must be there.

    Raises:
        InputError: another format or version, an unknown or missing key, or a value that breaks a rule.
    """
    return camera_of(CAMERA.of(cast(JsonValue, values), origin), origin, is_written_by_hand=is_written_by_hand)


def camera_of(file: CameraDocument, origin: str, *, is_written_by_hand: bool = False) -> Camera:
    """The camera of what a file says, likewise."""
    model = MODELS.get(file.model)
    if model is None:
        hint = suggestion_or_all(file.model, MODELS)
        raise InputError(f"{origin}: unknown camera model {shown(file.model)}{hint}")
    learned = _learned_map(file, origin)
    control = tuple(one.name for one in model.parameters if one.is_control)
    required = (*REQUIRED, *control) if is_written_by_hand else parameter_names(model.name)
    params = _parameters(file, model, origin, required)
    camera = Camera(model.name, params, file.image_size, learned, file.field_rad)
    _require_plausible(camera, origin)
    return camera


def _require_plausible(camera: Camera, origin: str) -> None:
    """Refuse what no camera is, whatever file it came from: one that sees hardly a part of its own image."""
    width, height = camera.image_size
    u, v = np.meshgrid(np.linspace(0, width - 1, GRID), np.linspace(0, height - 1, GRID))
    with np.errstate(all="ignore"):
        ray = rays(camera, np.stack([u, v], axis=-1))
        is_wide = ABILITIES[camera.model].is_wide
        is_seen = np.isfinite(ray[..., 2]) if is_wide else ray[..., 2] >= LEAST_FORWARD  # false where there is none
    if is_seen.mean() < LEAST_SEEN:
        what = "anything" if is_wide else "what is in front of the camera"
        raise InputError(
            f"{origin}: by these numbers {100 * is_seen.mean():.1f} % of the image see {what}; "
            "check the parameters, their order and units"
        )


def _parameters(file: CameraDocument, model: CameraModel, origin: str, required: tuple[str, ...]) -> Array:
    """The parameters in the model's order, each within its bounds."""
    given = file.parameters
    names = parameter_names(model.name)
    for name in given.keys() - set(names):
        hint = suggestion(name, list(names))
        raise InputError(f"{origin}: unknown parameter {shown(name)} of model {model.name!r}{hint}")
    missing = [name for name in required if name not in given]
    if missing:
        more = f", and {len(missing) - 1} more of the {len(names)} of model {model.name}" if missing[1:] else ""
        unit = " in pixels" if missing[0] in REQUIRED else ""
        raise InputError(f"{origin}: parameter {missing[0]} is missing{more}; give it{unit}")
    for name in ("fx_px", "fy_px"):
        if not given[name] > 0:
            raise InputError(f"{origin}: {name} {given[name]:g}: a focal length must be more than zero pixels")
        if not FOCAL_RANGE_PX[0] <= given[name] <= FOCAL_RANGE_PX[1]:
            span = f"{FOCAL_RANGE_PX[0]:g} to {FOCAL_RANGE_PX[1]:g} pixels"
            raise InputError(f"{origin}: {name} {given[name]:g}: a focal length is from {span}; check the file")
    for parameter in model.parameters:
        value = given.get(parameter.name, parameter.neutral)
        if not parameter.lower < value < parameter.upper:
            bounds = f"more than {parameter.lower:g} and less than {parameter.upper:g}"
            raise InputError(f"{origin}: {parameter.name} {value:g}: must be {bounds}")
        if not abs(value) <= LARGEST_BY_UNIT[parameter.unit]:
            raise InputError(
                f"{origin}: {parameter.name} {value:g}: is more than {LARGEST_BY_UNIT[parameter.unit]:g}, "
                "which no lens has; check the file"
            )
    return np.array([given.get(parameter.name, parameter.neutral) for parameter in model.parameters])


def _learned_map(file: CameraDocument, origin: str) -> LearnedMap | None:
    """The learned map of a model that needs one."""
    learned = file.learned_map
    if (learned is not None) != ABILITIES[file.model].is_learned:
        if learned is None:
            raise InputError(
                f"{origin}: model {file.model!r} needs a learned_map, and there is none; solve the camera again"
            )
        raise InputError(f"{origin}: model {file.model!r} has no learned_map; leave it out")
    if learned is not None and learned.length_px < (least := max(file.image_size) / MAX_LENGTHS):
        raise InputError(
            f"{origin}: learned_map.length_px {learned.length_px:g}: must be at least {least:g} in this image"
        )
    if learned is not None and not abs(np.linalg.det(learned.trend)) > 0:
        raise InputError(f"{origin}: learned_map.trend must be a homography, which is invertible")
    return learned


def load_camera(path: Path) -> Camera:
    """Read a camera file, JSON or TOML.

    Raises:
        InputError: the file cannot be read or is no valid camera file; the message names it.
    """
    if path.suffix.lower() == ".toml":
        return camera_from_mapping(read_spec_file(path), str(path), is_written_by_hand=True)
    document = parse_json(read_small_text(path, CAMERA.largest_bytes, CAMERA.what), path, CAMERA.what)
    return camera_from_mapping(document, str(path))


def camera_or_preset(name: str) -> Camera:
    """The camera of a template, or of a person's .json or .toml file."""
    if Path(name).suffix.lower() == ".json":
        return load_camera(Path(name))
    return load_camera(preset_or_file("cameras", name))


AXIS = np.array([[0.0], [0.0], [1.0]])
RELATIVE_STEP = 1e-6


def linear_part(camera: Camera) -> Camera:
    """The pinhole that shows the middle of the photos in their size: `linear_part(camera).params[0]`.

    The focal parameter of a wide model need not tell it: where a lens has a `xi`, light off the axis moves by less.
    """
    params = camera.params[:4].copy()
    if ABILITIES[camera.model].is_wide:
        scale = np.diagonal(linearise(camera, AXIS).by_point[:, :2, 0])
        params[:2] = np.where(scale > 0, scale, params[:2])
    return Camera(LINEAR, params, camera.image_size)


def focal_px(camera: Camera, param_covariance: Array) -> tuple[float, float]:
    """The focal length along u in the middle of the image and its standard deviation, nan if that is not known.

    Args:
        camera: of any model.
        param_covariance: of its parameters.  # (P, P)
    """
    value, count = float(linear_part(camera).params[0]), len(camera.params)
    if value == camera.params[0]:
        variance = float(param_covariance[0, 0])
    else:
        step = RELATIVE_STEP * np.maximum(np.abs(camera.params), 1.0)
        ends = camera.params + np.stack([np.diag(step), -np.diag(step)])  # (2, P, P)
        up, down = ([float(linear_part(replace(camera, params=end)).params[0]) for end in side] for side in ends)
        slope = (np.array(up) - np.array(down)) / (2 * step)
        covariance = param_covariance[:count, :count]
        variance = float(slope @ covariance @ slope)
    return value, float(np.sqrt(variance)) if variance > 0 else np.nan
