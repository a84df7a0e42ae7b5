"""What cameras will be known to, foretold without a photo, against cameras that are solved."""

import math
from dataclasses import replace

import numpy as np
import pytest

from calib.rigs.problem import CameraChoice, RigOptions
from calib.rigs.result import RigCalibration
from calib.rigs.solve import solve_rig
from calib.solver.accuracy import sigma_over_image_px
from calib.studies.tolerance.forecast import Forecast, Stage, Wish, forecast, simulated, stage_of
from designer.kinds.sizing import size_job
from designer.kinds.spec_file import parse_spec
from designer.target import TargetGeometry
from designer.tolerance.error_file import error_model
from designer.tolerance.model import perturb

WISH = Wish(1, math.radians(70), (400.0, 400.0, 200.0), (1280, 800), None, 1)
PHOTOS, DRAWS = 12, 30
MADE = {"ico": ({"edge": "150mm"}, "fdm-dual"), "board": ({"size": "250x180mm", "pitch": "20mm"}, "fdm-board")}


def target_of(kind: str, values: dict[str, str]) -> TargetGeometry:
    """A target as `design` sizes it."""
    return size_job(parse_spec({"kind": kind, **values}, "")).job.target.lay_out()


def solved(stage: Stage, target: TargetGeometry, told: Forecast, row: int, *, is_made: bool) -> RigCalibration:
    """Other photos of another print, with noise, solved as `calib run` does."""
    rng, bend = np.random.default_rng([3, row]), told.ways[0].bend_sigma_mm if is_made else ()
    frames = simulated(replace(stage, frames=PHOTOS // (1 + target.is_plate), seed=100 + row), target)
    assert frames is not None
    made = perturb(target, error_model(MADE[target.spec.kind][1]), rng) if is_made and target.spec else target
    options = RigOptions(free_bend=bool(bend), bend_sigma_mm=bend or None)  # type: ignore[arg-type]
    choices = [CameraChoice(one.model, one) for one in frames.rig.cameras]
    return solve_rig(frames.seen(made, rng), choices, options)


@pytest.mark.parametrize("kind", MADE)
def test_what_is_foretold_is_what_solved_cameras_are_off_by(kind: str) -> None:
    """Over the image and in focal length, of targets as drawn and, where few prints say little, as printed."""
    values, errors = MADE[kind]
    stage, target = stage_of(WISH), target_of(kind, values)
    told = forecast(stage, [(target, error_model(errors))])
    assert told is not None
    for is_made, known in ((False, told.optics(PHOTOS)), (True, told.made(PHOTOS, 0))):
        found = [solved(stage, target, told, row, is_made=is_made).cameras[0] for row in range(DRAWS)]
        off, most = np.array([one.params - stage.camera.params for one in found]), 1.6 if is_made else 1.35
        image_px = sigma_over_image_px(stage.camera, off.T @ off / DRAWS)
        assert 1 / most < known.image_px / image_px < most
        assert 1 / most < known.focal_px / math.sqrt((off[:, 0] ** 2).mean()) < most


def test_two_cameras_are_foretold_with_the_distance_between_them() -> None:
    """By noise the covariance is that which a solution of as many frames states."""
    stage, target = stage_of(replace(WISH, cameras=2)), target_of("ico", MADE["ico"][0])
    told = forecast(stage, [(target, error_model("fdm-dual"))])
    assert told is not None
    stated = solved(stage, target, told, 0, is_made=False)
    sigma = np.sqrt(np.diagonal(stated.covariance))
    assert told.optics(PHOTOS).focal_px == pytest.approx(sigma[[0, 1, 15, 16]].max(), rel=0.35)
    made = told.made(PHOTOS, 0)
    # Of a target that is too large by a part all lengths of the rig are, too.
    scale = error_model("fdm-dual").amount("scale").sigma
    apart_mm = float(np.linalg.norm(stage.rig.center_mm[1] - stage.rig.center_mm[0]))
    assert made.baseline_mm > scale * apart_mm
    assert made.point_mm > told.optics(PHOTOS).point_mm


def test_more_photos_leave_less_and_the_making_leaves_something() -> None:
    """Noise falls with the root of their number, the error of a print does not."""
    told = forecast(stage_of(WISH), [(target_of("ico", MADE["ico"][0]), error_model("fdm-dual"))])
    assert told is not None
    few, many = told.optics(25), told.optics(100)
    assert few.image_px / many.image_px == pytest.approx(2, rel=1e-6)
    assert 1 < told.made(25, 0).image_px / told.made(100, 0).image_px < 2


def test_cameras_see_all_of_the_front_of_the_volume() -> None:
    """At the least distance: its corner farthest off lies on the image's border."""
    for field_deg in (40.0, 110.0, 150.0):
        stage = stage_of(replace(WISH, field_rad=math.radians(field_deg)))
        near = stage.distance_mm[0]
        sides = stage.camera.project(np.array([[200.0, 0.0, near], [0.0, 200.0, near]]))
        assert np.isclose(sides, np.array(WISH.image_size) - 0.5).any(), field_deg
