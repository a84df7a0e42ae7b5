"""Settings for the tests of tolerance studies: small enough for hundreds of draws."""

from functools import cache

import numpy as np
from numpy.typing import NDArray

from calib.solver.options import SolveOptions
from calib.studies.tolerance.setting import Setting, make_setting
from designer.tolerance.error_file import error_model
from designer.tolerance.model import ErrorModel
from tests.support.perturbed_targets import board, ico
from tests.support.solver_scenes import CAMERAS

Array = NDArray[np.float64]
VIEWS, DISTANCE_MM = 24, 260.0


@cache
def ico_setting(model: str = "opencv", *, weighted: bool = False) -> Setting:
    """An icosahedron of 60 mm, through a lens with distortion."""
    return make_setting(
        ico(), CAMERAS["opencv"], views=VIEWS, distance_mm=DISTANCE_MM, model=model, seed=1,
        options=SolveOptions(weighted=weighted),
    )  # fmt: skip


@cache
def board_setting() -> Setting:
    """A board of 90 x 60 mm."""
    return make_setting(board(), CAMERAS["opencv"], views=VIEWS, distance_mm=DISTANCE_MM, model="opencv", seed=1)


@cache
def errors(name: str = "fdm-dual-calibrated") -> ErrorModel:
    return error_model(name)


def still(setting: Setting) -> Array:
    """No noise.  # (M, 2)"""
    return np.zeros_like(setting.observations.center_px)
