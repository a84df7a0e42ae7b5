"""What is kept of one bootstrap sample."""

from dataclasses import dataclass
from typing import Literal

from calib.solver.calibration import Status

SampleStatus = Status | Literal["failed"]
"""`failed`: no camera came out at all, and the message says why."""


@dataclass(frozen=True)
class SampleResult:
    """The camera of one sample and its errors: root mean squares over the sample's views, each as often as drawn."""

    number: int
    status: SampleStatus
    distinct_views: int
    reprojection_px: float  # nan, as the others, where it is not defined
    intersection_mm: float
    reconstruction_mm: float
    pose_mm: float
    params: tuple[float, ...]  # (P,) nan if there is no camera
    iterations: int
    message: str = ""  # why the camera is not to be trusted
