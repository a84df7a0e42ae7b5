"""A bootstrap sample: the views that are drawn for it, by seed, case and number alone, and what is kept of it."""

import hashlib
from dataclasses import dataclass
from typing import Literal

import numpy as np
from numpy.typing import NDArray

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


def failed_sample(number: int, distinct_views: int, values: int, reason: str) -> SampleResult:
    """A sample without a camera, of which so many values are not known."""
    nan = float("nan")
    return SampleResult(number, "failed", distinct_views, nan, nan, nan, nan, (nan,) * values, 0, reason)


def keyed_generator(name: str) -> np.random.Generator:
    """The random numbers of what has this name: the same in whatever order, process or part of a run they are drawn.

    They come from Philox (Salmon et al. 2011), a generator whose streams are told apart by a key: a digest of the name.
    """
    key = np.frombuffer(hashlib.sha256(name.encode()).digest()[:16], dtype="<u8")
    return np.random.Generator(np.random.Philox(key=key))


def draw_counts(seed: int, case: str, number: int, size: int, pool: int) -> NDArray[np.int64]:
    """How often each view is drawn, of `size` draws with replacement (Efron 1979).  # (V,)

    Args:
        seed: of the study.
        case: the name of what is sampled.
        number: of the sample.
        size: how many views to draw.
        pool: how many views there are.
    """
    drawn = keyed_generator(f"{seed}\n{number}\n{case}").integers(pool, size=size)
    return np.bincount(drawn, minlength=pool).astype(np.int64, copy=False)
