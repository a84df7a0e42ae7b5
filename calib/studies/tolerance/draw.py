"""One draw: noise and errors, and what a calibration with the drawing makes of them, with each source and without."""

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from calib.cameras import project
from calib.core.jit import jit
from calib.core.parallel import one_thread
from calib.studies.sample_metrics import keyed_generator
from calib.studies.tolerance.anchor import AnchoredMinimum, minimum_of
from calib.studies.tolerance.measures import NONE, TrueShape, measures, true_shape
from calib.studies.tolerance.quantities import QUANTITIES
from calib.studies.tolerance.setting import Setting
from designer.base.arrays import Array, Rows
from designer.base.errors import InputError
from designer.tolerance.model import ErrorModel, displaced_shape, draw_values
from designer.tolerance.shape import centers_mm

BARE, TOGETHER = "none", "all"
NO_ERRORS = ErrorModel("none", "", ())


def case_names(errors: ErrorModel) -> tuple[str, ...]:
    """The cases of a draw: without errors, each source alone, all together."""
    return (BARE, *errors.sources, TOGETHER)


@one_thread
def run_draws(setting: Setting, errors: ErrorModel, seed: int, numbers: range) -> Array:
    """The quantities of some draws, each a function of setting, errors, seed and number alone.  # (D, C, Q)

    The noise of a draw is the same in all its cases, and a source's errors are the same alone and together with others.
    A case without a solution, or errors that leave no target, is nan.

    Args:
        setting: what is photographed.
        errors: of the target.
        seed: of the study.
        numbers: of the draws.
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
    found: AnchoredMinimum | None


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
    setting: Setting, measured_px: Array, true: TrueShape, start: AnchoredMinimum | None
) -> tuple[Array, AnchoredMinimum | None]:
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
