"""Camera calibration with the targets that `designer` makes.

>>> run = calib.run("ico.target.json", "photos/*.jpg")
>>> run.verdict.grade, run.best.camera.matrix

Names are loaded when they are used, so that the import costs nothing.
"""

from importlib import import_module

TYPE_CHECKING = False  # `typing` takes long to load, and Ctrl-C in the meantime leaves a traceback
if TYPE_CHECKING:
    from calib.app.budget import Budget, budget
    from calib.app.calibration import Run
    from calib.app.check import CameraCheck, check
    from calib.app.choose import TargetChoice, choose
    from calib.app.convert import Conversion, convert
    from calib.app.coupon import CouponReading, coupon
    from calib.app.detect import DetectedPhotos, Detector, detect, detect_photos
    from calib.app.diff import Difference, diff
    from calib.app.evaluate import CameraErrors, evaluate
    from calib.app.hand_eye import hand_eye
    from calib.app.hand_eye_poses import HandEyeOfPoses, hand_eye_poses
    from calib.app.inputs import load_camera, load_observations, load_rig, load_rig_observations
    from calib.app.live import live, live_rig
    from calib.app.markers import MarkersInPhotos, markers
    from calib.app.measure import measure, rescale
    from calib.app.measured_print import MeasuredPrint, RescaledTarget
    from calib.app.plan import PhotoPlan, plan
    from calib.app.pose import TargetPoses, pose
    from calib.app.render import render, render_rig
    from calib.app.rendered_photos import RenderedPhotos, RenderedRig
    from calib.app.rig import rig
    from calib.app.run import NothingFoundError, run
    from calib.app.solve import solve
    from calib.app.solved_rig import SolvedRig
    from calib.app.study_bootstrap import Bootstrap, RigBootstrap, bootstrap, rig_bootstrap
    from calib.app.study_cost import CostStudy, study_cost
    from calib.app.tolerance import RigTolerance, Tolerance, rig_tolerance, tolerance
    from calib.app.triangulate import Triangulation, triangulate
    from calib.app.turntable import turntable
    from calib.app.undistort import UndistortedPhotos, Undistorter, undistort, undistort_photos
    from calib.app.ways import Ways, ways
    from calib.cameras.camera import Camera
    from calib.cameras.rig import Rig
    from calib.cameras.undistortion import Undistorted
    from calib.core.compile_ahead import warm_up
    from calib.core.types import Detections, Observations, RigObservations
    from calib.judge.guide import Guide
    from calib.judge.hand_eye_file import HandEye
    from calib.judge.rig_guide import RigGuide
    from calib.observe.arrays import observations
    from calib.renderer.options import RenderOptions
    from calib.solver.calibration import Calibration
    from calib.space.propagate import PointSightings
    from designer.base.errors import InputError

__all__ = [
    "Bootstrap",
    "Budget",
    "Calibration",
    "Camera",
    "CameraCheck",
    "CameraErrors",
    "Conversion",
    "CostStudy",
    "CouponReading",
    "DetectedPhotos",
    "Detections",
    "Detector",
    "Difference",
    "Guide",
    "HandEye",
    "HandEyeOfPoses",
    "InputError",
    "MarkersInPhotos",
    "MeasuredPrint",
    "NothingFoundError",
    "Observations",
    "PhotoPlan",
    "PointSightings",
    "RenderOptions",
    "RenderedPhotos",
    "RenderedRig",
    "RescaledTarget",
    "Rig",
    "RigBootstrap",
    "RigGuide",
    "RigObservations",
    "RigTolerance",
    "Run",
    "SolvedRig",
    "TargetChoice",
    "TargetPoses",
    "Tolerance",
    "Triangulation",
    "Undistorted",
    "UndistortedPhotos",
    "Undistorter",
    "Ways",
    "bootstrap",
    "budget",
    "check",
    "choose",
    "convert",
    "coupon",
    "detect",
    "detect_photos",
    "diff",
    "evaluate",
    "hand_eye",
    "hand_eye_poses",
    "live",
    "live_rig",
    "load_camera",
    "load_observations",
    "load_rig",
    "load_rig_observations",
    "markers",
    "measure",
    "observations",
    "plan",
    "pose",
    "render",
    "render_rig",
    "rescale",
    "rig",
    "rig_bootstrap",
    "rig_tolerance",
    "run",
    "solve",
    "study_cost",
    "tolerance",
    "triangulate",
    "turntable",
    "undistort",
    "undistort_photos",
    "warm_up",
    "ways",
]

_HOMES = {
    "calib.app.budget": ("Budget", "budget"),
    "calib.app.check": ("CameraCheck", "check"),
    "calib.app.choose": ("TargetChoice", "choose"),
    "calib.app.convert": ("Conversion", "convert"),
    "calib.app.diff": ("Difference", "diff"),
    "calib.app.study_bootstrap": ("Bootstrap", "RigBootstrap", "bootstrap", "rig_bootstrap"),
    "calib.app.study_cost": ("CostStudy", "study_cost"),
    "calib.app.coupon": ("CouponReading", "coupon"),
    "calib.app.calibration": ("Run",),
    "calib.app.detect": ("DetectedPhotos", "Detector", "detect", "detect_photos"),
    "calib.app.evaluate": ("CameraErrors", "evaluate"),
    "calib.app.hand_eye": ("hand_eye",),
    "calib.app.hand_eye_poses": ("HandEyeOfPoses", "hand_eye_poses"),
    "calib.app.inputs": ("load_camera", "load_observations", "load_rig", "load_rig_observations"),
    "calib.app.live": ("live", "live_rig"),
    "calib.app.markers": ("MarkersInPhotos", "markers"),
    "calib.app.measure": ("measure", "rescale"),
    "calib.app.measured_print": ("MeasuredPrint", "RescaledTarget"),
    "calib.app.render": ("render", "render_rig"),
    "calib.app.rendered_photos": ("RenderedPhotos", "RenderedRig"),
    "calib.app.tolerance": ("RigTolerance", "Tolerance", "rig_tolerance", "tolerance"),
    "calib.app.ways": ("Ways", "ways"),
    "calib.app.run": ("NothingFoundError", "run"),
    "calib.app.solve": ("solve",),
    "calib.app.plan": ("PhotoPlan", "plan"),
    "calib.app.pose": ("TargetPoses", "pose"),
    "calib.app.rig": ("rig",),
    "calib.app.solved_rig": ("SolvedRig",),
    "calib.app.triangulate": ("Triangulation", "triangulate"),
    "calib.app.turntable": ("turntable",),
    "calib.app.undistort": ("UndistortedPhotos", "Undistorter", "undistort", "undistort_photos"),
    "calib.cameras.camera": ("Camera",),
    "calib.cameras.rig": ("Rig",),
    "calib.cameras.undistortion": ("Undistorted",),
    "calib.core.compile_ahead": ("warm_up",),
    "calib.core.types": ("Detections", "Observations", "RigObservations"),
    "calib.judge.guide": ("Guide",),
    "calib.judge.rig_guide": ("RigGuide",),
    "calib.judge.hand_eye_file": ("HandEye",),
    "calib.observe.arrays": ("observations",),
    "calib.renderer.options": ("RenderOptions",),
    "calib.solver.calibration": ("Calibration",),
    "calib.space.propagate": ("PointSightings",),
    "designer.base.errors": ("InputError",),
}


def __getattr__(name: str) -> object:
    from designer.base.errors import offered

    for home, names in _HOMES.items():
        if name in names:
            globals()[name] = found = offered(getattr(import_module(home), name), __name__)
            return found
    raise AttributeError(f"module {__name__!r} has no attribute {name!r}")


def __dir__() -> list[str]:
    return sorted({*globals(), *__all__})
