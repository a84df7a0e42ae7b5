"""A camera: a model's name, its parameters, and the image it belongs to."""

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from types import MappingProxyType
from typing import Annotated

import numpy as np
from numpy.typing import NDArray

from calib.core.types import frozen_array
from designer.base.errors import InputError
from designer.base.marks import Above, AtLeast, AtMost, Length, Shape
from designer.base.small_file import JsonValue

MAX_KNOTS = 1000
LARGEST = 1e15
LEAST_NOISE = 1e-12
"""Less leaves the equations of the process singular in floating point."""
_Bounded = Annotated[NDArray[np.float64], AtLeast(-LARGEST), AtMost(LARGEST)]


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
        for name in ("knot_px", "weight", "noise_variance", "trend"):
            object.__setattr__(self, name, frozen_array(getattr(self, name)))


@dataclass(frozen=True, eq=False)
class Camera:
    """A model, its parameters, and the image they belong to: `camera.project(x_cam)`, `camera.rays(u_px)`."""

    model: str
    params: NDArray[np.float64]  # (P,) in the model's order and units
    image_size: tuple[int, int]  # width, height in px
    learned: LearnedMap | None = None  # of models that learn a map

    def __post_init__(self) -> None:
        object.__setattr__(self, "params", frozen_array(self.params))

    @property
    def parameters(self) -> Mapping[str, float]:
        """The parameters by name."""
        return MappingProxyType(dict(zip(_names(self.model), self.params.tolist(), strict=True)))

    @property
    def matrix(self) -> NDArray[np.float64]:
        """The linear part as OpenCV has it: `[[fx, 0, cx], [0, fy, cy], [0, 0, 1]]` in px.  # (3, 3)"""
        fx, fy, cx, cy = self.params[:4]
        return np.array([[fx, 0.0, cx], [0.0, fy, cy], [0.0, 0.0, 1.0]])

    @property
    def distortion(self) -> NDArray[np.float64]:
        """The lens as OpenCV's functions take it: k1 k2 p1 p2 k3.  # (5,)

        Raises:
            InputError: another model's lens; `calib.convert` fits OpenCV's to it, and says how well.
        """
        from calib.cameras import MODELS

        names = MODELS[self.model].opencv_lens
        if names is None:
            raise InputError(
                f"model {self.model}: its lens is none that OpenCV's functions take; fit one with calib.convert"
            )
        return np.array([self.parameters[name] for name in names] or [0.0] * 5)

    def project(self, point: NDArray[np.float64]) -> NDArray[np.float64]:
        """Pixels (..., 2) of points (..., 3) in the camera's frame; nan where it does not see: `camera.project(x)`."""
        from calib.cameras import project

        return project(self, np.asarray(point, dtype=np.float64))

    def rays(self, pixel: NDArray[np.float64]) -> NDArray[np.float64]:
        """Unit directions (..., 3) of the light that reaches pixels (..., 2); nan where none does: `camera.rays(u)`."""
        from calib.cameras import rays

        ray = rays(self, np.asarray(pixel, dtype=np.float64))
        unit: NDArray[np.float64] = ray / np.linalg.norm(ray, axis=-1, keepdims=True)
        return unit

    def to_json(self) -> JsonValue:
        """The content of `camera.json`, which also stands in other files."""
        from calib.cameras.camera_file import camera_document

        return camera_document(self)

    @classmethod
    def from_json(cls, value: JsonValue, place: str) -> "Camera":
        """The camera in a document.

        Raises:
            InputError: it is none, or a value breaks a rule.
        """
        from calib.cameras.camera_file import camera_from_mapping

        return camera_from_mapping(value, place)

    def save(self, path: str | Path) -> Path:
        """Write `camera.json`, which reads back bit for bit: `camera.save("camera.json")`; return its place.

        Raises:
            InputError: the place takes no file, or holds somebody else's.
        """
        from calib.cameras.camera_file import camera_to_json
        from calib.core.files import write_files

        place = Path(path)
        write_files({place: camera_to_json(self).encode()})
        return place


def _names(model: str) -> tuple[str, ...]:
    from calib.cameras import parameter_names

    return parameter_names(model)
