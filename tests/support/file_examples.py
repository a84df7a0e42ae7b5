"""A small value of each kind of file that is read back."""

import dataclasses
import math
from collections.abc import Callable, Mapping
from dataclasses import replace

import numpy as np

from calib.cameras.camera import Camera, CameraDocument, LearnedMap
from calib.cameras.rig import Rig
from calib.capture.photo_folder import SessionRecord
from calib.core.types import FaceRecord
from calib.judge.difference import Known
from calib.judge.halves import Half, PairApart, RigSplit
from calib.judge.judge import Judged
from calib.judge.next_views import NextView, NextViews
from calib.judge.verdict import Check, Criteria, Limits, NextFrame, NextPose, Verdict
from calib.observe.calibration_file import CalibrationRecord, Provenance, SolvedView
from calib.observe.dataset import ImageRecord, Records
from calib.observe.target_poses import PhotoWithoutPose, PosesDocument, TargetPose
from calib.renderer.options import RenderOptions
from calib.renderer.truth import FileOptions, RigTruth, TrueFrame, TrueView, Truth
from calib.rigs.result import MechanismFit
from calib.rigs.rig_calibration_file import HeldCamera, RigRecord, SolvedFrame
from calib.rigs.target_poses import CameraResidual, FrameWithoutPose, RigPosesDocument, RigTargetPose
from calib.solver.calibration import ImageField, MadeWith, PlaneBend, TargetError
from calib.solver.metrics.errors import ErrorSummary
from calib.solver.metrics.evaluation_files import FoundParameter, Metrics, MetricSummary
from calib.solver.problem import SolveOptions
from designer.page.page_file import StoredPage
from tests.support.pages import whole_page

PINHOLE = Camera("pinhole", np.array([900.0, 901.5, 500.25, 380.0]), (1000, 800))
POSE = np.array([[0.0, -1, 0, 1.5], [1, 0, 0, -2], [0, 0, 1, 1e3 / 3], [0, 0, 0, 1]])


def _camera() -> CameraDocument:
    learned = LearnedMap(np.array([[1.0, 2], [3, 4]]), np.eye(2) / 3, np.array([1e-6, 1e-5]), np.eye(3), 40.0, 0.05)
    return CameraDocument("virtual", (1000, 800), dict(PINHOLE.parameters), learned, remark="of no photo")


def _verdict() -> Judged:
    limits = Limits(0.1, 0.2, "a book")
    check = Check("coverage", "Coverage", "unknown", None, "%", 70.0, 40.0, True, "not checked")
    half = Half(Known(PINHOLE, np.diag([1.0, 2, 3, 4]) / 7), ("a.png", "b.png"))
    split = RigSplit("in order", 1 / 3, 6, 1 / 7, (PairApart(("a b", "c"), -0.1, 0.2),), 2 / 3)
    frame = NextFrame(POSE, ("a b", "c"), "hold it there", ("a b", "c"), 0.3, 1 / 7)
    pose = NextPose(POSE, "move it there", math.nan, 1e-3, 1 / 3, 1 / 7)
    return Judged(
        Verdict("usable", "pinhole", "nothing was checked", (check,), ("take more photos",)),
        Criteria("standard", "Standard", {"residuals": limits}), ((half, half),), None, "abc", (split,),
        (frame,), (pose,),
    )  # fmt: skip


def _next_views() -> NextViews:
    outline = (np.array([[0.25, 1.5], [10, 20], [0.25, 1.5]]),)
    return NextViews((NextView(POSE, "hold it closer", math.inf, 0.2, 0.1, 0.3, outline),))


def _session() -> SessionRecord:
    return SessionRecord("l1", "g1", ("camera 0", "the browser's camera"), ("0002.png",))


def _records() -> Records:
    faces = (FaceRecord(None, (), 0, 3, 5, (("outside the image", 2),), "no name fits"),)
    photo = ImageRecord("a b.png", (1000, 800), 3, 1, faces, ("mirrored",))
    return Records("test 1", "l1", "g1", (photo, replace(photo, image_size=None, faces=(), failure="no image")), "g2")


def _truth() -> Truth:
    views = (TrueView("view_0000.png", POSE), TrueView("view_0001.png", np.eye(4)))
    return Truth("g1", PINHOLE, views, 7, "l1", RenderOptions(blur_px=0.7), FileOptions("png", 95))


def _rig_truth() -> RigTruth:
    """One frame in motion, one that stands still."""
    return RigTruth("g1", "l1", ("left", "right"), (TrueFrame("view_0000", POSE, 1 / 3), TrueFrame("b", POSE)), 7)


def _metrics() -> Metrics:
    parameters = {"fx_px": FoundParameter(900.0, 0.1, "px", False, 901.0), "k1": FoundParameter(0.0, 0.0, "1", True)}
    summaries = {
        "pose": MetricSummary("mm", ErrorSummary(3, 1.0, 1 / 3, 0.5, 2.0, 1e-300), {"no pose": 2}),
        "rotation": MetricSummary("mrad", ErrorSummary(0, *[math.nan] * 5)),
    }
    return Metrics("opencv", "converged", 3, 100, 2, "the views", 0, ("a remark",), parameters, summaries)


def _calibration() -> CalibrationRecord:
    gaps = np.diag([1.0, math.nan, 3.0, 1 / 3])
    made = MadeWith((("scale", "normal", 0.1),), 1e-5, 0.2)
    plane = np.array([[0.0, 0, 1, 2.5]])
    return CalibrationRecord(
        provenance=Provenance("ringsolid 1.0", "l1", "g1", 3, SolveOptions(fixed=(("k1", None),)), (("model", "all"),)),
        status="converged", remarks=("a remark",), iterations=5, seconds=0.1, scale=math.nan, weighted=True,
        fixed=("cx_px",), camera=PINHOLE, param_covariance=gaps,
        target_error=TargetError("pla", "", np.eye(4), made), image_field=ImageField(0.1, np.eye(4) / 3),
        target_bend=PlaneBend(np.eye(3), (0.1, 1 / 3, -0.0), (1.0, 2.0), (-0.1, 1e-9), (math.nan, 0.0, 1 / 3)),
        geometry_id="g1", observations_sha256="abc", planes=plane, points=((0.1, 1e-300, -0.0, 0), (1.0, 2.0, 3.0, -1)),
        views=(SolvedView("a b.png", POSE, np.full((6, 6), math.nan)),),
    )  # fmt: skip


def _rig() -> Rig:
    covariance = np.diag(np.arange(20.0)) / 7
    return Rig(("a b", "c/d"), (PINHOLE, PINHOLE), np.stack([np.eye(4), POSE]), covariance, np.array([0.1, 1 / 3]))


def _rig_calibration() -> RigRecord:
    """Two cameras on a turntable, one of them late; some of it is not determined."""
    rows, gaps = np.array([0, 2]), np.full((6, 6), math.nan)
    held = HeldCamera("left", "left", POSE, True, "abc", rows, np.array([0.0, 1 / 3]), 1e-3, 1e-5)
    frames = (
        SolvedFrame("f 0", POSE, np.eye(6) / 3),
        SolvedFrame("f1", np.eye(4), gaps),
        SolvedFrame("f2", POSE, gaps),
    )
    carrier = MechanismFit(
        "turntable", POSE, gaps, math.nan, 0.1, np.full((3, 6), math.nan), np.arange(3) / 3, ("tilt",)
    )
    return RigRecord(
        provenance=Provenance("test 1"), status="stopped", remarks=("a remark",), observed=("another",), iterations=5,
        seconds=0.1, weighted=True, reference=-1, rig_frame="table",
        cameras=(held, replace(held, name="a/b", folder="camera_1", is_refined=False, delay_s=-0.0)),
        frames=frames, covariance=np.diag([1.0, math.nan, 1 / 3]), target_covariance=np.eye(3) / 7, carrier=carrier,
    )  # fmt: skip


def _poses() -> PosesDocument:
    pose = TargetPose("a b.png", 3, 0.1, np.arange(3) / 3, np.ones(3) / 7, 1.0, 0.2, 1e-300, POSE, np.eye(6) / 3)
    return PosesDocument("g1", PINHOLE, (pose,), (PhotoWithoutPose("c.png", "too few"),))


def _rig_poses() -> RigPosesDocument:
    cameras = (CameraResidual("left", "a b.png", 3, 0.1), CameraResidual("right", "a b.png", 0, math.nan))
    place = np.arange(3) / 3
    pose = RigTargetPose("a b", cameras, 3, 0.1, place, np.ones(3) / 7, 1e-300, POSE, np.eye(6) / 3, np.eye(6) / 7, 1.0)
    failed = (FrameWithoutPose("c", "too few"),)
    return RigPosesDocument("g1", ("left", "right"), "left", True, (pose,), failed)


def _page() -> StoredPage:
    return StoredPage("budget", whole_page(has_scene=True))


def _hand_eye() -> object:
    from calib.judge.hand_eye_file import HandEye

    pose = np.eye(4)
    pose[:3, 3] = 1 / 3, 20.0, -7.5
    return HandEye(
        "robot, camera in hand",
        "flange",
        pose,
        np.array([0.0, 0.0, 0.0, 1.0]),
        np.eye(6) / 7,
        pose,
        1e-4,
        0.1,
        0.98,
        0.001,
        (NextPose(pose, "move it there", math.nan, 1e-3, 1 / 3, 1 / 7),),
    )


def same(one: object, other: object) -> bool:
    """Whether two values are of one type and equal to the last bit, nan being nan."""
    if type(one) is not type(other):
        return False
    if dataclasses.is_dataclass(one):
        return all(same(getattr(one, f.name), getattr(other, f.name)) for f in dataclasses.fields(one))
    if isinstance(one, np.ndarray):
        return one.dtype == other.dtype and one.tobytes() == other.tobytes()
    if isinstance(one, tuple | list):
        return len(one) == len(other) and all(map(same, one, other))
    if isinstance(one, dict):
        return list(one) == list(other) and all(map(same, one.values(), other.values()))
    return repr(one) == repr(other)


EXAMPLES: Mapping[str, Callable[[], object]] = {
    "ringsolid.camera": _camera,
    "ringsolid.page": _page,
    "ringsolid.rig_poses": _rig_poses,
    "ringsolid.verdict": _verdict,
    "ringsolid.next_views": _next_views,
    "ringsolid.session": _session,
    "ringsolid.records": _records,
    "ringsolid.truth": _truth,
    "ringsolid.rig_truth": _rig_truth,
    "ringsolid.metrics": _metrics,
    "ringsolid.calibration": _calibration,
    "ringsolid.rig": _rig,
    "ringsolid.rig_calibration": _rig_calibration,
    "ringsolid.hand_eye": _hand_eye,
    "ringsolid.poses": _poses,
}
