"""Camera models behind one protocol: everything downstream uses `rays` and `project` only."""

from collections.abc import Mapping
from types import MappingProxyType
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from calib.cameras.luhmann import Luhmann
from calib.cameras.opencv import OpenCv
from calib.types import Camera


class CameraModel(Protocol):
    """One model. All functions are batched over leading axes and pure."""

    @property
    def name(self) -> str:
        """The model's name in files."""
        ...

    @property
    def parameter_names(self) -> tuple[str, ...]:
        """The parameters in the order of `Camera.params`, with their units."""
        ...

    def rays(self, params: NDArray[np.float64], pixel: NDArray[np.float64]) -> NDArray[np.float64]:
        """Directions (..., 3), scaled to z = 1, of the light that reaches pixels (..., 2); nan where there is none."""
        ...

    def project(self, params: NDArray[np.float64], point: NDArray[np.float64]) -> NDArray[np.float64]:
        """Pixels (..., 2) of points (..., 3) in the camera frame; nan behind the camera or outside the model."""
        ...


MODELS: Mapping[str, CameraModel] = MappingProxyType({model.name: model for model in (OpenCv(), Luhmann())})


def rays(camera: Camera, pixel: NDArray[np.float64]) -> NDArray[np.float64]:
    """Directions (..., 3), scaled to z = 1, of the light that reaches pixels (..., 2); nan where there is none."""
    return MODELS[camera.model].rays(camera.params, pixel)


def project(camera: Camera, point: NDArray[np.float64]) -> NDArray[np.float64]:
    """Pixels (..., 2) of points (..., 3) in the camera frame; nan behind the camera or outside the model."""
    return MODELS[camera.model].project(camera.params, point)
