"""Camera models behind one protocol: everything downstream uses `rays` and `project` only."""

from collections.abc import Mapping
from types import MappingProxyType
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from calib.cameras.camera import Camera
from calib.cameras.luhmann import Luhmann
from calib.cameras.opencv import OpenCv
from calib.cameras.parameters import Linearised, Parameter
from calib.cameras.pinhole import Pinhole
from calib.cameras.spline import Spline
from calib.cameras.virtual import Virtual

__all__ = [
    "MODELS",
    "SIMULATED",
    "CameraModel",
    "Linearised",
    "Parameter",
    "linearise",
    "parameter_names",
    "project",
    "rays",
]


class CameraModel(Protocol):
    """One model. All functions are pure."""

    @property
    def name(self) -> str:
        """The model's name in files."""
        ...

    @property
    def remedy(self) -> str:
        """What to do about light that the model cannot show, because it comes from too far off the axis."""
        ...

    @property
    def parameters(self) -> tuple[Parameter, ...]:
        """What `Camera.params` holds, in its order; the first four are fx, fy, cx, cy in px."""
        ...

    @property
    def opencv_lens(self) -> tuple[str, ...] | None:
        """The parameters that OpenCV's functions take as k1 k2 p1 p2 k3; () without a lens; None: another lens."""
        ...

    def rays(self, camera: Camera, pixel: NDArray[np.float64]) -> NDArray[np.float64]:
        """Directions (..., 3), scaled to z = 1, of the light that reaches pixels (..., 2); nan where there is none."""
        ...

    def project(self, camera: Camera, point: NDArray[np.float64]) -> NDArray[np.float64]:
        """Pixels (..., 2) of points (..., 3) in the camera frame; nan behind the camera or outside the model."""
        ...

    def linearise(self, camera: Camera, point: NDArray[np.float64]) -> Linearised:
        """Pixels of points (3, N), coordinate by coordinate, with their derivatives; nan where `project` has it."""
        ...


MODELS: Mapping[str, CameraModel] = MappingProxyType(
    {model.name: model for model in (OpenCv(), Luhmann(), Pinhole(), Virtual(), Spline())}
)
SIMULATED: frozenset[str] = frozenset({"spline"})
"""Models that photos can be simulated with, but that are not solved: they have more parameters than photos tell."""


def parameter_names(model: str) -> tuple[str, ...]:
    """The parameters of a model in the order of `Camera.params`."""
    return tuple(parameter.name for parameter in MODELS[model].parameters)


def rays(camera: Camera, pixel: NDArray[np.float64]) -> NDArray[np.float64]:
    """Directions (..., 3), scaled to z = 1, of the light that reaches pixels (..., 2); nan where there is none."""
    return MODELS[camera.model].rays(camera, pixel)


def project(camera: Camera, point: NDArray[np.float64]) -> NDArray[np.float64]:
    """Pixels (..., 2) of points (..., 3) in the camera frame; nan behind the camera or outside the model."""
    return MODELS[camera.model].project(camera, point)


def linearise(camera: Camera, point: NDArray[np.float64]) -> Linearised:
    """Pixels of points (3, N) in the camera frame, with their derivatives; nan where `project` has it."""
    return MODELS[camera.model].linearise(camera, point)
