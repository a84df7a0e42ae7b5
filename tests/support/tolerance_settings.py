"""Settings for the tests of tolerance studies, small enough for hundreds of draws, and a study of them."""

from functools import cache
from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np
import pytest

from calib.app.tolerance import Tolerance
from calib.solver.problem import SolveOptions
from calib.studies.runner import DrawCount, Sampling
from calib.studies.tolerance.explore import PhotographedTarget, TolerancePlan, compared, explore
from calib.studies.tolerance.predict import ToleranceTable
from calib.studies.tolerance.quantities import parse_requirements
from calib.studies.tolerance.record import PhotographedSetting, ToleranceStudy
from calib.studies.tolerance.seen import aimed_at
from calib.studies.tolerance.setting import Setting, make_setting
from calib.studies.tolerance.sizes import what_if_table
from calib.studies.tolerance.what_if import WhatIfTable
from designer.base.arrays import Array
from designer.page.progress import unheard
from designer.tolerance.error_file import error_model
from designer.tolerance.model import ErrorModel
from designer.tolerance.source import Amount
from tests.support.perturbed_targets import board, ico
from tests.support.solver_scenes import CAMERAS

VIEWS, DISTANCE_MM = 24, 260.0


@cache
def ico_setting(model: str = "opencv", *, weighted: bool = False) -> Setting:
    """An icosahedron of 60 mm, through a lens with distortion."""
    return make_setting(
        ico(), CAMERAS["opencv"], views=VIEWS, photos=aimed_at(ico(), DISTANCE_MM), model=model, seed=1,
        options=SolveOptions(weighted=weighted),
    )  # fmt: skip


@cache
def board_setting() -> Setting:
    """A board of 90 x 60 mm."""
    photos = aimed_at(board(), DISTANCE_MM)
    return make_setting(board(), CAMERAS["opencv"], views=VIEWS, photos=photos, model="opencv", seed=1)


@cache
def errors(name: str = "fdm-dual-calibrated") -> ErrorModel:
    return error_model(name)


def still(setting: Setting) -> Array:
    """No noise.  # (M, 2)"""
    return np.zeros_like(setting.observations.center_px)


DRAWS = 12


@cache
def few_errors() -> ErrorModel:
    """Five kinds of sources: of faces, of rings, of the print, one that does nothing, and one for boards."""
    few = error_model("fdm-dual").only("face_tilt", "ring_jitter", "scale", "ink_bleed")
    return few.with_amount("warp", Amount("uniform", 0.2))


def told(study: ToleranceStudy, *, formats: tuple[str, ...] = (), made_by: str = "") -> Tolerance:
    """The result of a study."""
    return Tolerance(study, DrawCount(), 1, None, f"{study.target}.target.json", (), formats, made_by)


@cache
def tolerance_study(*, linear: bool = False) -> ToleranceStudy:
    """An icosahedron by a few draws, with a limit that is missed and one that is kept, and against a board."""
    return _explored(linear=linear)[0]


@cache
def tolerance_table() -> ToleranceTable:
    """The table of that study."""
    return _explored(linear=False)[1]


@cache
def what_ifs() -> WhatIfTable:
    """An icosahedron that is printed in two filaments, or made in other ways."""
    ways = {name: error_model(name) for name in ("fdm-dual", "resin", "machined")}
    return what_if_table(ico_setting(), ways["fdm-dual"], "fdm-dual", ways, seed=1)


@cache
def _explored(*, linear: bool) -> tuple[ToleranceStudy, ToleranceTable]:
    with TemporaryDirectory() as place, pytest.MonkeyPatch.context() as patch:
        patch.setattr("calib.studies.tolerance.sizes.DRAWS", 1)  # the page's law is held to exact ones elsewhere
        plan = TolerancePlan(
            DRAWS, 1, parse_requirements(["intersection=0.01mm", "reprojection=50px"]), "intersection", full=False,
            linear=linear, sampling=Sampling(Path(place), 1, None, resume=False, progress=unheard),
        )  # fmt: skip
        words = PhotographedSetting("20 faces, 300 rings; 24 views", "fdm-dual: two filaments", (), ("it is near",))
        scene = PhotographedTarget("ico", "0" * 64, ico_setting(), few_errors(), words)
        study, table, _ = explore(scene, plan)
        words = PhotographedSetting("1 face", "fdm-board: two filaments")
        other = PhotographedTarget("board", "1" * 64, board_setting(), error_model("fdm-board"), words)
        return compared(study, table, other, plan, None), table
