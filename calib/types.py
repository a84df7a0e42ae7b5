"""What the parts of the calibration hand to each other. No logic, but for what keeps arrays whole."""

from dataclasses import dataclass
from typing import Literal

import numpy as np
from numpy.typing import NDArray


def frozen_array(values: object, dtype: type[np.generic] = np.float64) -> NDArray[np.generic]:
    """A read-only, C-contiguous copy of `values`."""
    array = np.array(values, dtype=dtype, order="C")
    array.setflags(write=False)
    return array


@dataclass(frozen=True, eq=False)
class Camera:
    """A camera: a model's name (`calib.cameras.MODELS`), its parameters, and the image it belongs to."""

    model: str
    params: NDArray[np.float64]  # (P,) in the model's order and units
    image_size: tuple[int, int]  # width, height in px

    def __post_init__(self) -> None:
        object.__setattr__(self, "params", frozen_array(self.params))


Mark = Literal["dot", "ring", "unreadable"]

TOO_FLAT = "seen too small or too flat"
"""Why a feature is missing that no camera could have measured from there."""


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
