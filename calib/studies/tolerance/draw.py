"""One draw: noise and errors, and what a calibration with the drawing makes of them, with each source and without.

The quantities of one solution, against the drawing and against the target's true shape.

A calibration puts the made target where the drawing fits it best, so a rigid motion of the whole target changes
nothing but the frame. The true shape is therefore moved onto the drawing by least squares of the rings' distances,
each ring counting as often as it is seen (Kabsch 1976), and true poses are re-expressed in that frame.
"""

import math
from collections.abc import Mapping
from dataclasses import dataclass, replace

import numpy as np

from calib.cameras import project
from calib.core.jit import jit
from calib.core.parallel import one_thread
from calib.core.se3 import invert, make_pose, nearest_rotation, transform
from calib.core.types import KnownPoints
from calib.solver.metrics.errors import centers_mm as camera_centers_mm
from calib.solver.metrics.rotation import turns_of_views
from calib.studies.gradients import CameraFit
from calib.studies.sample_metrics import Sample, sample_errors
from calib.studies.samples import keyed_generator
from calib.studies.tolerance.anchor import minimum_of
from calib.studies.tolerance.quantities import QUANTITIES
from calib.studies.tolerance.seen import map_error_px
from calib.studies.tolerance.setting import Setting
from designer.base.arrays import Array, Rows
from designer.base.errors import InputError
from designer.tolerance.model import ErrorModel, displaced_shape, draw_values
from designer.tolerance.shape import MadeShape, centers_mm


@dataclass(frozen=True, eq=False)
class TrueShape:
    """R rings of a made target, moved onto the drawing."""

    center_mm: Array  # (R, 3)
    plane: Array  # (R, 4) unit normal n and offset d (mm) of the plane n X = d through each ring, parallel to its face
    moved_from_made: Array  # (4, 4) the motion


def true_shape(shape: MadeShape, weight: Array) -> TrueShape:
    """The true shape."""
    return moved_onto(centers_mm(shape), _normals(shape), shape.nominal.center_mm, weight)


def moved_onto(center_mm: Array, normal: Array, onto_mm: Array, weight: Array) -> TrueShape:
    """Rings (R, 3) with the normals of their faces (R, 3), moved onto others by least squares with weights (R,)."""
    share = weight[:, None] / weight.sum()
    middle, aim = (share * center_mm).sum(axis=0), (share * onto_mm).sum(axis=0)
    rotation = nearest_rotation((share * (onto_mm - aim)).T @ (center_mm - middle))
    motion = make_pose(rotation, aim - rotation @ middle)
    center, turned = transform(motion, center_mm), normal @ rotation.T
    return TrueShape(center, np.column_stack([turned, (turned * center).sum(axis=1)]), motion)


def _normals(shape: MadeShape) -> Array:
    """Outward normals of the rings' faces after all errors; bow and warp do not turn them.  # (R, 3)"""
    frame = shape.nominal.target_from_face[:, :3, :3] @ shape.nominal_from_moved[:, :3, :3]
    stretch = shape.bed_axes.T @ shape.bed_affine @ shape.bed_axes
    axes = stretch @ frame[:, :, :2]
    normal = np.cross(axes[:, :, 0], axes[:, :, 1])
    unit: Array = (normal / np.linalg.norm(normal, axis=1, keepdims=True))[shape.nominal.ring_face]
    return unit


def measures(setting: Setting, found: CameraFit, measured_px: Array, true: TrueShape) -> Array:
    """All quantities (Q,), in the order of `QUANTITIES`; nan where one is not defined.

    Args:
        setting: what is photographed.
        found: the camera and poses that the drawing gave.
        measured_px: what was seen of the made target (2, M).
        true: its shape.
    """
    problem = replace(setting.anchor.problem, measured_px=measured_px)
    views = np.arange(problem.view_count)
    plain = Sample(setting.observations, problem, views, np.ones_like(views), found.camera, found.cam_from_target)
    drawn = sample_errors(plain, None, None if setting.options.weighted else found.cost)
    true_pose = setting.cam_from_target @ invert(true.moved_from_made)
    points = KnownPoints(true.center_mm, np.arange(len(true.plane)), true.plane)  # each on a plane of its own
    position = (true.center_mm - problem.origin_mm)[setting.observations.point].T
    against_true = replace(
        plain, observations=replace(setting.observations, points=points),
        problem=replace(problem, position_mm=np.ascontiguousarray(position)),
    )  # fmt: skip
    made = sample_errors(against_true, camera_centers_mm(true_pose), 0.0)
    dfx, dfy, dcx, dcy = (found.camera.params[:4] - setting.reference.params[:4]).tolist()
    return np.array([
        drawn.reprojection_px, drawn.intersection_mm, drawn.reconstruction_mm, made.intersection_mm,
        made.reconstruction_mm, made.pose_mm, _turn_deg(found.cam_from_target, true_pose),
        math.sqrt(0.5 * (dfx * dfx + dfy * dfy)), math.hypot(dcx, dcy),
        map_error_px(setting.grid, found.camera),
    ])  # fmt: skip


NONE: Array = np.full(len(QUANTITIES), np.nan)
"""Of a case without a solution."""


def _turn_deg(cam_from_target: Array, true: Array) -> float:
    """Root mean square turn of the views after the turn they share."""
    if len(true) < 2:
        return math.nan
    angle = turns_of_views(cam_from_target[:, :3, :3], true[:, :3, :3])
    return math.degrees(math.sqrt(float((angle**2).sum(axis=1).mean())))


BARE, TOGETHER = "none", "all"
NO_ERRORS = ErrorModel("none", "", ())


def case_names(errors: ErrorModel) -> tuple[str, ...]:
    """The cases of a draw: without errors, each source alone, all together."""
    return (BARE, *errors.sources, TOGETHER)


def error_settings(errors: ErrorModel) -> dict[str, str]:
    """What of errors tells a study from another."""
    return {
        "errors": ", ".join(f"{name}={amount.kind} {amount.size!r}" for name, amount in errors.amounts),
        "expansion": repr(errors.expansion_per_kelvin),
        "layer height": repr(errors.layer_height_mm),
    }


@one_thread
def run_draws(setting: Setting, errors: ErrorModel, seed: int, numbers: range) -> Array:
    """The quantities of some draws, each a function of setting, errors, seed and number alone.  # (D, C, Q)

    The noise of a draw is the same in all its cases, and a source's errors are the same alone and together with others.
    A case without a solution, or errors that leave no target, is nan.
    """
    result = np.empty((len(numbers), len(errors.amounts) + 2, len(QUANTITIES)))
    for place, number in enumerate(numbers):
        values = drawn_values(setting, errors, seed, number)
        result[place] = run_cases(setting, errors, values, drawn_noise(setting, seed, number))
    return result


@dataclass(frozen=True, eq=False)
class BareDraw:
    """A draw without errors, from which those with errors go on."""

    noise_px: Array  # (M, 2)
    quantities: Array  # (Q,)
    found: CameraFit | None


def bare_draw(setting: Setting, noise_px: Array) -> BareDraw:
    """What the noise of a draw (M, 2) alone makes of the camera."""
    shape = displaced_shape(setting.target, {}, model=NO_ERRORS)
    measured = seen_px(setting, centers_mm(shape)) + noise_px
    return BareDraw(noise_px, *solved(setting, measured, true_shape(shape, setting.seen), None))


def with_errors(setting: Setting, errors: ErrorModel, values: Mapping[str, Array], bare: BareDraw) -> Array:
    """The quantities of a draw with given numbers of the sources; where no ring moves, its own, bit for bit.  # (Q,)"""
    try:
        shape = displaced_shape(setting.target, values, model=errors)
    except InputError:
        return NONE
    made = centers_mm(shape)
    if np.array_equal(made, setting.target.center_mm):
        return bare.quantities
    measured = seen_px(setting, made) + bare.noise_px
    return solved(setting, measured, true_shape(shape, setting.seen), bare.found)[0]


def drawn_values(setting: Setting, errors: ErrorModel, seed: int, number: int) -> dict[str, Array]:
    """The numbers of all sources in a draw; each has its own stream, and they are in proportion to its size."""
    return draw_values(setting.target, errors, stream(seed, number, "errors"))


def run_cases(setting: Setting, errors: ErrorModel, values: Mapping[str, Array], noise_px: Array) -> Array:
    """All cases of given numbers of the sources and given noise (M, 2).  # (C, Q)"""
    bare = bare_draw(setting, noise_px)
    rows = [bare.quantities]
    for name in errors.sources:
        rows.append(with_errors(setting, errors, {name: values[name]}, bare))
    together = rows[1] if len(values) == 1 else with_errors(setting, errors, values, bare)
    return np.stack([*rows, together])


def drawn_noise(setting: Setting, seed: int, number: int) -> Array:
    """Errors of the detected centres in a draw, by their covariances.  # (M, 2)"""
    a, b, c = setting.noise_root.T
    first, second = stream(seed, number, "noise").standard_normal((2, len(a)))
    return np.stack([a * first, b * first + c * second], axis=1)


def stream(seed: int, number: int, purpose: str) -> np.random.Generator:
    """Random numbers of a draw for one purpose."""
    return keyed_generator(f"{seed}\n{number}\ntolerance {purpose}")


def solved(
    setting: Setting, measured_px: Array, true: TrueShape, start: CameraFit | None
) -> tuple[Array, CameraFit | None]:
    """Quantities (Q,) of the calibration with the drawing from pixels (M, 2), and that calibration."""
    pixel = np.ascontiguousarray(measured_px.T)
    if not np.isfinite(pixel).all():
        return NONE, None
    found = minimum_of(setting.anchor, pixel, start)
    if found is None:
        return NONE, None
    return measures(setting, found, pixel, true), found


def seen_px(setting: Setting, center_mm: Array) -> Array:
    """Where the true camera sees rings that are at (R, 3), in all observations.  # (M, 2)"""
    seen = setting.observations
    point = np.empty((len(seen.view), 3))
    _to_camera(seen.view, seen.point, setting.cam_from_target, center_mm, point)
    return project(setting.camera, point)


@jit
def _to_camera(view: Rows, ring: Rows, pose: Array, center: Array, point: Array) -> None:
    for m in range(len(view)):
        r = pose[view[m]]
        x, y, z = center[ring[m], 0], center[ring[m], 1], center[ring[m], 2]
        for axis in range(3):
            point[m, axis] = r[axis, 0] * x + r[axis, 1] * y + r[axis, 2] * z + r[axis, 3]
