"""Models whose image axes are not square to each other: an affinity of the sensor beside any lens.

`u' = u + skew y', v' = v` of the pixel (u, v) that the model without it shows, with `y' = (v - cy) / fy`: the third of
the numbers fx, skew, fy of a camera matrix (MATLAB's), B2 of Metashape, and with another fx the affinity and shear b1
and b2 of photogrammetry. Sensors have none to speak of; scanned film and pictures that were resampled have.
"""

from dataclasses import dataclass, replace

import numpy as np

from calib.cameras.camera import Camera
from calib.cameras.parameters import CompiledModel, LensParameter, Linearised
from designer.base.arrays import Array

SKEW = "skew_px"


@dataclass(frozen=True)
class SkewedModel:
    """A model (see `calib.cameras.CameraModel`), and the skew as its last parameter."""

    name: str
    upright: CompiledModel
    opencv_lens: None = None  # its functions take no skew

    @property
    def remedy(self) -> str:
        """As without skew."""
        return self.upright.remedy

    @property
    def parameters(self) -> tuple[LensParameter, ...]:
        """Those of the model, and the skew."""
        return (*self.upright.parameters, LensParameter(SKEW, "px"))

    def rays(self, camera: Camera, pixel: Array) -> Array:
        """Unit directions (..., 3) at pixels (..., 2); nan where there is none."""
        return self.upright.rays(self._upright(camera), _moved(camera, np.asarray(pixel, dtype=np.float64), -1.0))

    def project(self, camera: Camera, point: Array) -> Array:
        """Pixels (..., 2) of points (..., 3); nan where there is none."""
        return _moved(camera, self.upright.project(self._upright(camera), point), 1.0)

    def linearise(self, camera: Camera, point: Array) -> Linearised:
        """Pixels of points (3, N) with their derivatives."""
        seen = self.upright.linearise(self._upright(camera), point)
        lean = camera.params[-1] / camera.params[1]
        by_point, by_params = seen.by_point.copy(), np.zeros((2, len(camera.params), point.shape[1]))
        by_point[0] += lean * by_point[1]
        by_params[:, :-1] = seen.by_params
        by_params[0, 4:-1] += lean * seen.by_params[1, 4:]  # of fy and cy it is none: y' is of the lens alone
        by_params[0, -1] = (seen.pixel[1] - camera.params[3]) / camera.params[1]
        return Linearised.of(_moved(camera, seen.pixel.T, 1.0).T, by_point, by_params)

    def _upright(self, camera: Camera) -> Camera:
        return replace(camera, model=self.upright.name, params=camera.params[:-1])


def _moved(camera: Camera, pixel: Array, sign: float) -> Array:
    """Pixels (..., 2) along the rows by the skew, to one side or the other."""
    moved = pixel.copy()
    moved[..., 0] += sign * camera.params[-1] * (pixel[..., 1] - camera.params[3]) / camera.params[1]
    return moved
