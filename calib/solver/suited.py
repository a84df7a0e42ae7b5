"""Whether photos are of an ordinary lens or of a wide one, by quick solutions of both kinds."""

from dataclasses import dataclass, replace

import numpy as np

from calib.cameras import ABILITIES, COMMON, DEFAULT, WIDE, rays, wide_models
from calib.cameras.camera import Camera
from calib.core.se3 import angles_between
from calib.core.types import Observations, keep_sightings
from calib.solver.calibration import Calibration
from calib.solver.outliers import deviations
from calib.solver.problem import SolveOptions, pack, select_rows
from calib.solver.solve import solve
from designer.base.errors import InputError

PER_VIEW = 64
"""Observations of a view that are enough to tell the kinds apart."""
KEPT_SHARE = 0.98
"""Of the observations, those with the least residuals: a few wrong ones say nothing of the lens."""
CLEARLY = 1.3
"""Times that residuals are larger where a kind of model does not fit."""
FINE_PX = 1e-3
"""Residuals of perfect data are nothing but rounding."""
LOST_SHARE = 0.005
"""Of the observations, more of which a model that suits does not leave out."""
FORWARD_RAD = np.radians(80.0)
"""Off the axis, to which models of what is in front may reach: the tangent is 5.7 there, and grows without bounds."""
SUSPECT_PX = 1.0
"""Root mean square distance with which a model may squeeze into its field of view what is seen from the side."""
FAR_OFF = 6.0
"""Robust standard deviations: farther off is not what it is taken for."""


@dataclass(frozen=True, eq=False)
class LensKind:
    """What a quick look says of a lens."""

    is_wide: bool  # only models for wide lenses show what was seen
    off_axis_rad: float  # of the outermost observations, by a wide model; nan: none was found
    lost_share: float  # of the observations, that this model leaves out
    wide: Camera | None  # a rough one, of a part of the observations

    @property
    def sentence(self) -> str:
        """Of a wide lens, how wide it is."""
        return f"the lens is a wide one: points are seen up to {np.degrees(self.off_axis_rad):.0f} degrees off its axis"

    def may_show(self, model: str) -> bool:
        """Whether a model reaches so far that it is worth a trial."""
        return ABILITIES[model].is_wide or self.off_axis_rad < FORWARD_RAD


def lens_kind(observations: Observations, options: SolveOptions | None = None) -> LensKind:
    """Whether a lens is a wide one: `lens_kind(observations).is_wide`.

    It is if a wide model determines a camera that shows the points, and each ordinary model leaves points out that
    this one shows, finds none, or leaves residuals that are clearly larger.

    Args:
        observations: of any lens.
        options: weights and losses; which parameters are fixed or shared is of no account.
    """
    options = replace(options or SolveOptions(), fixed=(), shared=(), focal_px=None)
    problem = pack(observations, weighted=False)
    rows = select_rows(problem, np.arange(problem.view_count), PER_VIEW)[1]
    is_kept = np.zeros(len(observations.view), dtype=bool)
    is_kept[rows] = True
    few = keep_sightings(observations, is_kept)
    wide = _solved(few, WIDE, options)
    if wide is None or wide.status != "converged":
        return LensKind(False, np.nan, np.nan, None)
    ordinary = (_solved(few, model, options) for model in (DEFAULT, COMMON))
    is_wide = not any(one is not None and _suits(one, wide, few) for one in ordinary)
    is_near = (deviations(wide.residual_px.T, None) <= FAR_OFF) & ~wide.is_outlier
    off_axis = angles_between(rays(wide.camera, wide.observations.center_px[is_near]), np.array([0.0, 0.0, 1.0]))
    return LensKind(is_wide, float(np.nanmax(off_axis)), _lost_share(wide, few), wide.camera)


def ruled_out(model: str, solved: Calibration | None, observations: Observations, options: SolveOptions) -> str:
    """Why the field of view rules a model out and what to take instead, in a line; "" if it does not.

    Args:
        model: any.
        solved: what came of it; None: nothing.
        observations: that it was solved from.
        options: weights and losses.
    """
    if ABILITIES[model].is_wide:
        return ""
    if solved is not None and _lost_share(solved, observations) <= LOST_SHARE and _left_px(solved) <= SUSPECT_PX:
        return ""
    kind = lens_kind(observations, options)
    if kind.wide is None or not kind.is_wide:
        return ""
    keeps_all = solved is not None and _lost_share(solved, observations) - kind.lost_share <= LOST_SHARE
    if keeps_all and kind.off_axis_rad < 0.5 * np.pi:
        return ""
    return f"model {model} cannot show all that was seen: {kind.sentence}; give --model {' or '.join(wide_models())}"


def _lost_share(solved: Calibration, observations: Observations) -> float:
    """Of the observations, what was left out."""
    return 1 - float((~solved.is_outlier).sum()) / len(observations.view)


def _solved(observations: Observations, model: str, options: SolveOptions) -> Calibration | None:
    try:
        return solve(observations, model, options)
    except InputError:
        return None


def _suits(ordinary: Calibration, wide: Calibration, few: Observations) -> bool:
    """Whether an ordinary model does as well as a wide one: also where photos determine the wide one alone.

    Photos from one side may do so, by what the formula of the wide one supposes, which says nothing of the lens.
    """
    more = _lost_share(ordinary, few) - _lost_share(wide, few)
    return more <= LOST_SHARE and _left_px(ordinary) <= CLEARLY * _left_px(wide) + FINE_PX


def _left_px(calibration: Calibration) -> float:
    """Root mean square distance of most of the observations that count."""
    square = np.sort((calibration.residual_px[~calibration.is_outlier] ** 2).sum(axis=1))
    return float(np.sqrt(square[: max(int(KEPT_SHARE * len(square)), 1)].mean()))
