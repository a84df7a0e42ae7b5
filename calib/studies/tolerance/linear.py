"""The table of a tolerance study at once, from the solver's Jacobians.

The square of a quantity is a sum over the errors, each independent of the others: with `e_j` its response to a unit of
the number j (`calib.studies.tolerance.response`), cost^2 = sum sigma_j^2 |e_j|^2. Numbers that a source has fixed are
no draws; their responses are added before they are squared. What noise costs is known without draws, too
(`calib.studies.tolerance.noise_response`).
"""

import numpy as np
from numpy.typing import NDArray

from calib.core.threads import one_thread
from calib.studies.tolerance.draw import solved
from calib.studies.tolerance.first_order import FirstOrder, first_order
from calib.studies.tolerance.noise_response import noise_squares
from calib.studies.tolerance.quantities import QUANTITIES
from calib.studies.tolerance.response import responses
from calib.studies.tolerance.result import Cost, ToleranceTable
from calib.studies.tolerance.setting import Setting
from calib.studies.tolerance.true_shape import TrueShape
from designer.tolerance.model import ErrorModel
from designer.tolerance.prior import directions

Array = NDArray[np.float64]

NEGLIGIBLE = 1e-6
"""Of the largest response a unit can have, which differences and sums leave where there is none."""


@one_thread
def linear_table(setting: Setting, errors: ErrorModel) -> ToleranceTable:
    """The costs of all sources where errors are small; see `calib.studies.tolerance.reach` for where they are.

    Args:
        setting: what is photographed.
        errors: of the target.
    """
    first = first_order(setting)
    square = np.zeros((len(errors.amounts), len(QUANTITIES)))
    fixed = np.zeros((setting.target.ring_count, 3, 1))
    drawn_square = np.zeros(len(QUANTITIES))
    for row, (name, amount) in enumerate(errors.amounts):
        columns = directions(setting.target, errors, name, setting.bed_from_target)
        if amount.kind == "fixed":
            columns = amount.size * columns.sum(axis=2, keepdims=True)
            fixed += columns
            square[row] = square_of(first, columns)
        else:
            square[row] = amount.sigma**2 * square_of(first, columns)
            drawn_square += square[row]
    together = np.sqrt(drawn_square + square_of(first, fixed))
    cost, base = np.sqrt(square), baseline(first)
    return ToleranceTable(
        "linear", errors, Cost(base, base, base), Cost(cost, cost, cost), Cost(together, together, together), 0, ()
    )


def square_of(first: FirstOrder, columns: Array) -> Array:
    """The sum of the squares of all quantities over displacements (R, 3, N).  # (Q,)"""
    total: Array = responses(first, columns).square.sum(axis=1)
    return np.where(total < _rounding(first.setting, columns), 0.0, total)


def _rounding(setting: Setting, columns: Array) -> Array:
    """Squares that are nothing but rounding: of a scale of the whole print, no residual is left.  # (Q,)"""
    length_mm = np.sqrt((columns**2).sum() / setting.target.ring_count)
    focal = setting.camera.params[0]
    distance = np.linalg.norm(setting.cam_from_target[:, :3, 3], axis=1).mean()
    pixel, degree = focal / distance, np.degrees(1 / distance)
    per_mm = {"px": pixel, "mm": 1.0, "deg": degree}
    return np.array([(NEGLIGIBLE * length_mm * per_mm[quantity.unit]) ** 2 for quantity in QUANTITIES])


def baseline(first: FirstOrder) -> Array:
    """What the noise costs, and a lens that the solved model does not fit.  # (Q,)"""
    base: Array = np.sqrt(noise_squares(first) + _misfit(first.setting) ** 2)
    return base


def _misfit(setting: Setting) -> Array:
    """The quantities without noise and errors: zero where the solved model is the true one.  # (Q,)"""
    if setting.reference is setting.camera:
        return np.zeros(len(QUANTITIES))
    target = setting.target
    normal = target.target_from_face[target.ring_face, :3, 2]
    plane = np.column_stack([normal, (normal * target.center_mm).sum(axis=1)])
    true = TrueShape(target.center_mm, plane, np.eye(4))
    return np.nan_to_num(solved(setting, setting.observations.center_px, true, None)[0])
