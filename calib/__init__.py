"""Camera calibration with the targets that `designer` makes.

>>> run = calib.run("ico.target.json", "photos/*.jpg")
>>> run.verdict.grade, run.best.camera.matrix

Names are loaded when they are used, so that the import costs nothing.
"""

from importlib import import_module
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from calib.api.bootstrapping import BootstrapResult, bootstrap
    from calib.api.converting import Conversion, convert
    from calib.api.costing import CostResult, study_cost
    from calib.api.coupon import CouponResult, coupon
    from calib.api.detecting import Detector, detect
    from calib.api.evaluating import EvaluationResult, evaluate
    from calib.api.loading import load_camera, load_observations
    from calib.api.measuring import MeasureResult, RescaledTarget, measure, rescale
    from calib.api.posing import pose
    from calib.api.rendering import RenderedPhotos, render
    from calib.api.run_result import RunResult
    from calib.api.running import NothingFoundError, run, solve
    from calib.api.tolerancing import ToleranceResult, tolerance, ways
    from calib.api.undistorting import Undistorter, undistort
    from calib.cameras.camera import Camera
    from calib.cameras.undistortion import Undistorted
    from calib.core.types import Detections, Observations
    from calib.observe.target_poses import PoseResult
    from calib.renderer.options import RenderOptions
    from calib.show.photos.undistorted_photos import UndistortedFiles
    from calib.solver.calibration import Calibration
    from designer.base.errors import InputError

__all__ = [
    "BootstrapResult",
    "Calibration",
    "Camera",
    "Conversion",
    "CostResult",
    "CouponResult",
    "Detections",
    "Detector",
    "EvaluationResult",
    "InputError",
    "MeasureResult",
    "NothingFoundError",
    "Observations",
    "PoseResult",
    "RenderOptions",
    "RenderedPhotos",
    "RescaledTarget",
    "RunResult",
    "ToleranceResult",
    "Undistorted",
    "UndistortedFiles",
    "Undistorter",
    "bootstrap",
    "convert",
    "coupon",
    "detect",
    "evaluate",
    "load_camera",
    "load_observations",
    "measure",
    "pose",
    "render",
    "rescale",
    "run",
    "solve",
    "study_cost",
    "tolerance",
    "undistort",
    "ways",
]

_HOMES = {
    "calib.api.bootstrapping": (
        "BootstrapResult",
        "bootstrap",
    ),
    "calib.api.converting": (
        "Conversion",
        "convert",
    ),
    "calib.api.costing": (
        "CostResult",
        "study_cost",
    ),
    "calib.api.coupon": (
        "CouponResult",
        "coupon",
    ),
    "calib.api.detecting": (
        "Detector",
        "detect",
    ),
    "calib.api.evaluating": (
        "EvaluationResult",
        "evaluate",
    ),
    "calib.api.loading": (
        "load_camera",
        "load_observations",
    ),
    "calib.api.measuring": (
        "MeasureResult",
        "RescaledTarget",
        "measure",
        "rescale",
    ),
    "calib.api.posing": ("pose",),
    "calib.api.rendering": (
        "RenderedPhotos",
        "render",
    ),
    "calib.api.run_result": ("RunResult",),
    "calib.api.running": (
        "NothingFoundError",
        "run",
        "solve",
    ),
    "calib.api.tolerancing": (
        "ToleranceResult",
        "tolerance",
        "ways",
    ),
    "calib.api.undistorting": (
        "Undistorter",
        "undistort",
    ),
    "calib.cameras.camera": ("Camera",),
    "calib.cameras.undistortion": ("Undistorted",),
    "calib.core.types": (
        "Detections",
        "Observations",
    ),
    "calib.observe.target_poses": ("PoseResult",),
    "calib.renderer.options": ("RenderOptions",),
    "calib.show.photos.undistorted_photos": ("UndistortedFiles",),
    "calib.solver.calibration": ("Calibration",),
    "designer.base.errors": ("InputError",),
}


def __getattr__(name: str) -> object:
    for home, names in _HOMES.items():
        if name in names:
            globals()[name] = found = getattr(import_module(home), name)
            return found
    raise AttributeError(f"module {__name__!r} has no attribute {name!r}")


def __dir__() -> list[str]:
    return sorted({*globals(), *__all__})
