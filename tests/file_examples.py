"""A small value of each kind of file that is read back."""

import math
from collections.abc import Callable, Mapping

import numpy as np

from calib.cameras.camera import Camera, LearnedMap
from calib.cameras.camera_file import CameraDocument
from calib.verdict.apart import Known
from calib.verdict.criteria import Criteria, Limits
from calib.verdict.halves import Half
from calib.verdict.next_views import NextView, NextViews
from calib.verdict.of_run import Judged
from calib.verdict.verdict import Check, Verdict

PINHOLE = Camera("pinhole", np.array([900.0, 901.5, 500.25, 380.0]), (1000, 800))
POSE = np.array([[0.0, -1, 0, 1.5], [1, 0, 0, -2], [0, 0, 1, 1e3 / 3], [0, 0, 0, 1]])


def _camera() -> CameraDocument:
    learned = LearnedMap(np.array([[1.0, 2], [3, 4]]), np.eye(2) / 3, np.array([1e-6, 1e-5]), np.eye(3), 40.0, 0.05)
    return CameraDocument("virtual", (1000, 800), dict(PINHOLE.parameters), learned)


def _verdict() -> Judged:
    limits = Limits(0.1, 0.2, "a book")
    check = Check("coverage", "Coverage", "unknown", None, "%", 70.0, 40.0, True, "not checked")
    half = Half(Known(PINHOLE, np.diag([1.0, 2, 3, 4]) / 7), ("a.png", "b.png"))
    return Judged(
        Verdict("usable", "pinhole", "nothing was checked", (check,), ("take more photos",)),
        Criteria("standard", "Standard", *[limits] * 8), ((half, half),), None, "abc",
    )  # fmt: skip


def _next_views() -> NextViews:
    outline = (np.array([[0.25, 1.5], [10, 20], [0.25, 1.5]]),)
    return NextViews((NextView(POSE, "hold it closer", math.inf, 0.2, 0.1, 0.3, outline),))


EXAMPLES: Mapping[str, Callable[[], object]] = {
    "ringsolid.camera": _camera,
    "ringsolid.verdict": _verdict,
    "ringsolid.next_views": _next_views,
}
