"""A rig in 3D: its cameras with their views and names, where the target was, and how surely each camera stands."""

import numpy as np

from calib.core.se3 import compose, make_pose, transform
from calib.core.types import KnownPoints
from calib.draw.camera_scene import first_look, points_layers
from calib.draw.rig_scene import CAMERA, rig_layer, seen_from_both_sides
from calib.draw.rig_tables import frame_name
from calib.draw.style import nice
from calib.judge.folders import RigRun
from calib.judge.next_robot_poses import rig_from_target_at
from calib.rigs.relative import center_covariance
from calib.rigs.result import RigCalibration
from designer.base.arrays import Array
from designer.base.words import counted, printable, span
from designer.base.words import figure as digits
from designer.page.blocks import View3d
from designer.page.scene import Labels, Layer, Scene, Segments
from designer.target_scene import AXES, CAMERA_SHARE

ERROR, NEXT, HELD = "#D55E00", "#009E73", "#8a9099"
"""Okabe and Ito's vermilion and green, and a grey: seen on light and dark."""
MOST_FRAMES = 1000
"""Whose targets are drawn; of more every second, third, ..."""
ELLIPSE_STEPS = 40
LARGEST_OF_CAMERA = 1.2
"""Semi-axis of the largest ellipsoid, of a camera's pyramid."""
CROWDED, NO_BASELINE = 0.6, 0.02
"""A body's depth, of the distance of two cameras; cameras that stand nearer, of the target's, share a place."""
HELD_SHARE = 0.35
"""Length of the axes that stand for a held target, of its radius."""


def rig_view(run: RigRun) -> View3d:
    """The scene and what it shows in words."""
    found = run.stated
    middle: Array = np.median(found.rig_from_target[:, :3, 3], axis=0)  # of all held targets
    away_mm = float(np.median(np.linalg.norm(found.rig.center_mm - middle, axis=1)))
    size_mm = _size_mm(found, away_mm)
    proposed = () if run.judged is None else (
        *(frame.rig_from_target for frame in run.judged.next_frames),
        *(rig_from_target_at(found, pose.base_from_flange) for pose in run.judged.next_poses),
    )  # fmt: skip
    ellipsoids, times = _ellipsoids(found, size_mm)
    axes = np.stack([np.zeros((3, 3)), 1.5 * size_mm * np.eye(3)], axis=1)
    layers = (
        *points_layers(_held_points(found, middle)),
        rig_layer(found.rig, size_mm),
        Layer("names", (_names(found, size_mm),)),
        Layer("where the target was", (_held(found, found.rig_from_target, HELD),)),
        *((Layer("next frames", (_held(found, np.stack(proposed), NEXT),)),) if proposed else ()),
        *((Layer("uncertainty of the cameras", (ellipsoids,)),) if ellipsoids is not None else ()),
        Layer("axes of the rig", (Segments(axes, tuple(colour for _, colour in AXES)),), is_shown=False),
    )
    around = compose(found.cam_from_rig, make_pose(np.eye(3), middle))
    up, from_direction = first_look(around, found.rig.center_mm - middle, is_flat=False)
    legend: tuple[tuple[str, str], ...] = ((CAMERA, "camera"), (HELD, "target in a frame"))
    legend += ((NEXT, "next frame"),) if proposed else ()
    legend += ((ERROR, f"standard deviations x {digits(times, 3)}"),) if ellipsoids is not None else ()
    return View3d("The rig", Scene(layers, up, from_direction, legend), rig_words(found), _caption(found, times))


def rig_words(found: RigCalibration) -> str:
    """What stands where, as a sentence."""
    count, frames = len(found.cameras), len(found.rig_from_target)
    cameras = counted(count, "camera")
    distance = np.linalg.norm(found.rig_from_target[:, None, :3, 3] - found.rig.center_mm[None], axis=2)
    away = span(distance.ravel().tolist(), 3)
    return f"{cameras}, and the target in {counted(frames, 'frame')}, {away} mm from them."


def _caption(found: RigCalibration, times: float) -> str:
    """What is drawn."""
    own = printable(frame_name(found))
    said = "Each body is a camera, each small cross a place of the target, which is drawn in one of them."
    if times:
        said += (
            f" Ellipses: standard deviations of the cameras' places against {own}, whose frame the rig's is, "
            f"{digits(times, 3)} times enlarged."
        )
    return f"{said} Point at a camera for its name."


def _size_mm(found: RigCalibration, away_mm: float) -> float:
    """Of a camera's body: no two touch each other where they stand apart."""
    apart = np.linalg.norm(found.rig.center_mm[:, None] - found.rig.center_mm[None], axis=2)
    least = float(np.min(apart, initial=np.inf, where=apart > NO_BASELINE * away_mm))
    return max(min(2 * CAMERA_SHARE * away_mm, CROWDED * least), 1e-3)


def _held_points(found: RigCalibration, middle: Array) -> KnownPoints:
    """The target as it was held nearest to the middle, in the rig's frame."""
    points, place = found.observations.points, found.rig_from_target[:, :3, 3]
    pose = found.rig_from_target[int(np.argmin(np.linalg.norm(place - middle, axis=1)))]
    normal = points.plane[:, :3] @ pose[:3, :3].T
    plane = np.column_stack([normal, points.plane[:, 3] + normal @ pose[:3, 3]])
    return KnownPoints(transform(pose, points.position_mm), points.face, plane, points.geometry_id)


def _names(found: RigCalibration, size_mm: float) -> Labels:
    """Beside the cameras' centres, from both sides."""
    back = -found.rig.rig_from_cam[:, :3, 2]
    names = tuple(map(printable, found.observations.camera_names))
    return seen_from_both_sides(found.rig.center_mm + 0.3 * size_mm * back, back, names, 0.13 * size_mm)


def _held(found: RigCalibration, rig_from_target: Array, colour: str) -> Segments:
    """Small axes wherever the target was, or is to be."""
    points = found.observations.points.position_mm
    length = HELD_SHARE * float(np.linalg.norm(points - points.mean(axis=0), axis=1).max())
    poses = rig_from_target[:: -(-len(rig_from_target) // MOST_FRAMES)]
    middle = transform(poses, points.mean(axis=0))
    ends = middle[:, None, None] + 0.5 * length * np.stack([-poses[:, :3, :3], poses[:, :3, :3]]).transpose(1, 3, 0, 2)
    return Segments(ends.reshape(-1, 2, 3), (colour,))


def _ellipsoids(found: RigCalibration, size_mm: float) -> tuple[Segments | None, float]:
    """Three ellipses a camera, and how many times they are enlarged; None where nothing is known, or nothing unsure."""
    rig = found.rig
    axes = []
    for row, pose in enumerate(found.cam_from_rig):
        rows = rig.pose_rows(row)
        covariance = center_covariance(pose, found.stated_covariance[rows, rows])
        if not np.isfinite(covariance).all() or not np.trace(covariance) > 0:
            continue
        value, vector = np.linalg.eigh(pose[:3, :3].T @ covariance @ pose[:3, :3])
        axes.append((rig.center_mm[row], vector * np.sqrt(np.maximum(value, 0.0))))
    if not axes:
        return None, 0.0
    largest = max(float(np.linalg.norm(axis, axis=0).max()) for _, axis in axes)
    times = nice(LARGEST_OF_CAMERA * size_mm / largest, is_down=True)
    turn = np.linspace(0, 2 * np.pi, ELLIPSE_STEPS + 1)
    lines = []
    for centre, axis in axes:
        for a, b in ((0, 1), (1, 2), (2, 0)):
            line = centre + times * (np.cos(turn)[:, None] * axis[:, a] + np.sin(turn)[:, None] * axis[:, b])
            lines.append(np.stack([line[:-1], line[1:]], axis=1))
    return Segments(np.concatenate(lines), (ERROR,)), times
