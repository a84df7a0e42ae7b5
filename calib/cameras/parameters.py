"""What a camera model says of its parameters, and of its derivatives."""

from dataclasses import dataclass
from math import inf

import numpy as np
from numpy.typing import NDArray


@dataclass(frozen=True)
class Parameter:
    """One number of a camera model."""

    name: str
    unit: str  # "px", or "1" for a plain number
    lower: float = -inf  # not allowed below, nor at a lower bound of 0
    upper: float = inf


FOCAL_AND_CENTRE = (
    Parameter("fx_px", "px", lower=0.0),
    Parameter("fy_px", "px", lower=0.0),
    Parameter("cx_px", "px"),
    Parameter("cy_px", "px"),
)
"""What every model begins with."""


@dataclass(frozen=True, eq=False)
class Linearised:
    """Pixels and their derivatives, stored coordinate by coordinate so that a processor takes many points at once."""

    pixel: NDArray[np.float64]  # (2, N)
    by_point: NDArray[np.float64]  # (2, 3, N) derivative by the point in the camera frame
    by_params: NDArray[np.float64]  # (2, P, N)
