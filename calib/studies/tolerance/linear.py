"""The table of a tolerance study at once, from the solver's Jacobians.

The square of a quantity is a sum over the errors, each independent of the others: with `e_j` its response to a unit of
the number j (`calib.studies.tolerance.response`), cost^2 = sum sigma_j^2 |e_j|^2. Numbers that a source has fixed are
no draws; their responses are added before they are squared.
"""

import numpy as np
from numpy.typing import NDArray

from calib.one_thread import one_thread
from calib.studies.statistics import HALF_WIDTH
from calib.studies.tolerance.draw import drawn_noise, solved
from calib.studies.tolerance.quantities import QUANTITIES
from calib.studies.tolerance.response import responses
from calib.studies.tolerance.result import Cost, ToleranceTable
from calib.studies.tolerance.setting import Setting
from calib.studies.tolerance.true_shape import TrueShape
from designer.tolerance.directions import directions
from designer.tolerance.model import ErrorModel

Array = NDArray[np.float64]

NOISE_DRAWS = 256
AT_ONCE = 32
NEGLIGIBLE = 1e-7
"""Of the largest response a unit can have, which differences leave where there is none."""


@one_thread
def linear_table(setting: Setting, errors: ErrorModel, seed: int = 0) -> ToleranceTable:
    """The costs of all sources where errors are small; see `calib.studies.tolerance.reach` for where they are.

    Args:
        setting: what is photographed.
        errors: of the target.
        seed: of the noise behind the baseline, that of the first draws of a study of this seed.
    """
    cost = np.zeros((len(errors.amounts), len(QUANTITIES)))
    fixed = np.zeros((setting.target.ring_count, 3, 1))
    drawn_square = np.zeros(len(QUANTITIES))
    for row, (name, amount) in enumerate(errors.amounts):
        columns = directions(setting.target, errors, name, setting.bed_from_target)
        if amount.kind == "fixed":
            columns = amount.size * columns.sum(axis=2, keepdims=True)
            fixed += columns
            cost[row] = square_of(setting, columns)
        else:
            cost[row] = square_of(setting, amount.sigma * columns)
            drawn_square += cost[row]
    together = np.sqrt(drawn_square + square_of(setting, fixed))
    cost = np.sqrt(cost)
    return ToleranceTable(
        "linear", errors, baseline(setting, seed), Cost(cost, cost, cost), Cost(together, together, together), 0, ()
    )


def square_of(setting: Setting, columns: Array) -> Array:
    """The sum of the squares of all quantities over displacements (R, 3, N).  # (Q,)"""
    columns = columns[:, :, (columns != 0).any(axis=(0, 1))]
    if not columns.shape[2]:
        return np.zeros(len(QUANTITIES))
    total: Array = responses(setting, columns).square.sum(axis=1)
    return np.where(total < _rounding(setting, columns), 0.0, total)


def _rounding(setting: Setting, columns: Array) -> Array:
    """Squares that are nothing but rounding: of a scale of the whole print, no residual is left.  # (Q,)"""
    length_mm = np.sqrt((columns**2).sum() / setting.target.ring_count)
    focal = setting.camera.params[0]
    distance = np.linalg.norm(setting.cam_from_target[:, :3, 3], axis=1).mean()
    pixel, degree = focal / distance, np.degrees(1 / distance)
    per_mm = {"px": pixel, "mm": 1.0, "deg": degree}
    return np.array([(NEGLIGIBLE * length_mm * per_mm[quantity.unit]) ** 2 for quantity in QUANTITIES])


def baseline(setting: Setting, seed: int) -> Cost:
    """What the noise costs, and a lens that the solved model does not fit.  # (Q,)"""
    still = np.zeros((setting.target.ring_count, 3, AT_ONCE))
    square = np.concatenate([
        responses(setting, still, _noise(setting, seed, first)).square
        for first in range(0, NOISE_DRAWS, AT_ONCE)
    ], axis=1)  # fmt: skip
    misfit = _misfit(setting)
    mean = square.mean(axis=1) + misfit**2
    half = HALF_WIDTH * square.std(axis=1, ddof=1) / np.sqrt(NOISE_DRAWS)
    return Cost(np.sqrt(mean), np.sqrt(np.maximum(mean - half, 0.0)), np.sqrt(mean + half))


def _noise(setting: Setting, seed: int, first: int) -> Array:
    """The noise of some draws.  # (M, 2, N)"""
    return np.stack([drawn_noise(setting, seed, number) for number in range(first, first + AT_ONCE)], axis=2)


def _misfit(setting: Setting) -> Array:
    """The quantities without noise and errors: zero where the solved model is the true one.  # (Q,)"""
    if setting.reference is setting.camera:
        return np.zeros(len(QUANTITIES))
    target = setting.target
    normal = target.target_from_face[target.ring_face, :3, 2]
    plane = np.column_stack([normal, (normal * target.center_mm).sum(axis=1)])
    true = TrueShape(target.center_mm, plane, np.eye(4))
    return np.nan_to_num(solved(setting, setting.observations.center_px, true, None)[0])
