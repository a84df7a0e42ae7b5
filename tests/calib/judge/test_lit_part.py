"""What is asked of a wide camera: the part of the image that light reaches, and nothing beyond."""

from dataclasses import replace
from functools import cache

import numpy as np
import pytest

from calib.cameras import project, rays
from calib.cameras.camera import Camera
from calib.core.se3 import look_at, make_pose, rotation_between, transform
from calib.judge.apart import in_sigmas
from calib.judge.candidate_views import candidates_of
from calib.judge.coverage import coverage_of, lit_part
from calib.judge.evidence import uncertainty_of
from calib.judge.views import habits_of, px_per_mm, shape_of
from calib.observe.observations import known_points
from calib.observe.search import with_image_circle
from calib.solver.calibration import Calibration
from calib.solver.solve import solve
from designer.kinds.layout import lay_out
from designer.kinds.sizing import size_job
from tests.benchmarks.bench_wide_sigmas import errors_of
from tests.support.designs import asked_for
from tests.support.solver_scenes import CAMERAS, board, icosahedron, observe, poses_around

FISHEYE = Camera("fisheye", np.array([150.0, 150.0, 401.0, 298.0, 0.01, -0.004, 0.0004, 0.0]), (800, 600))


@cache
def seen_up_to(angle_deg: float) -> Calibration:
    """A fisheye solved from photos of an icosahedron that stands so far off the axis at most."""
    rng, count = np.random.default_rng(3), 24
    angle = np.radians(angle_deg) * np.sqrt(np.linspace(0, 1, count))
    azimuth = 2.4 * np.arange(count)
    side = np.stack([np.sin(angle) * np.cos(azimuth), np.sin(angle) * np.sin(azimuth), np.cos(angle)], axis=1)
    eye = 200 * rng.standard_normal((count, 3))
    poses = look_at(200 * eye / np.linalg.norm(eye, axis=1)[:, None], np.zeros((count, 3)), 6 * rng.random(count))
    turned = make_pose(rotation_between(np.array([0.0, 0.0, 1.0]), side), np.zeros(3)) @ poses
    camera = replace(FISHEYE, field_rad=np.radians(190))
    return solve(observe(camera, icosahedron(), turned, rng, noise_px=0.05), "fisheye")


def with_field(calibration: Calibration, field_deg: float) -> Calibration:
    """With the end of its light known."""
    return replace(calibration, camera=replace(calibration.camera, field_rad=np.radians(field_deg)))


def test_sigmas_hold_to_the_rim() -> None:
    """Errors of solved fisheyes are about as large as stated, on the axis and at 95 degrees off it."""
    target = lay_out(size_job(asked_for("ico", {"edge": "120mm"})).job.target)
    camera = replace(FISHEYE, field_rad=np.radians(190))
    parts = [errors_of(target, known_points(target), camera, seed, 16) for seed in range(4)]
    angle, error, covariance = (np.concatenate(part) for part in zip(*parts, strict=True))
    assert angle.max() > 93
    for low, high in ((0, 40), (40, 80), (80, 96)):
        here = (angle >= low) & (angle < high)
        assert 0.5 < in_sigmas(error[here], covariance[here]) < 1.5


def test_all_of_the_image_is_asked_of_other_lenses() -> None:
    """A lens that fills its image is judged over all of it."""
    points = board()
    seen = observe(CAMERAS["pinhole"], points, poses_around(6, np.random.default_rng(0)), np.random.default_rng(1))
    found = lit_part(solve(seen, "pinhole"))
    assert (found.off_axis_rad, found.name, found.remark) == (None, "image", "")
    assert found.is_lit(np.array([[0.0, 0.0], [2447.0, 2047.0]])).all()


def test_nothing_is_asked_of_the_dark() -> None:
    """Cells beyond the image circle count neither as covered nor as missing, and regions are called its rim."""
    calibration = with_field(seen_up_to(85), 190)
    found, lit = coverage_of(calibration), lit_part(calibration)
    ray = rays(calibration.camera, found.middle_px)
    assert np.array_equal(found.is_lit, np.isfinite(ray[..., 0]))
    assert not found.is_lit.all()
    assert found.share == pytest.approx(found.views[found.is_lit].astype(bool).mean())
    assert not any(region.name.endswith(("corner", "edge")) for region in found.regions)
    assert sum(band.area for band in found.bands) == pytest.approx(1)
    assert (found.area, lit.is_measured) == ("image circle", True)


def test_without_photos_the_farthest_observation_ends_it() -> None:
    """Where the light ends is then said to be unknown, and the uncertainty is that of what was reached."""
    calibration = seen_up_to(60)
    seen = calibration.observations
    point = transform(calibration.cam_from_target[seen.view], seen.points.position_mm[seen.point])
    farthest = np.arccos(point[:, 2] / np.linalg.norm(point, axis=1)).max()
    lit = lit_part(calibration)
    assert lit.off_axis_rad == pytest.approx(farthest)
    assert not lit.is_measured
    assert "only photos tell" in lit.remark
    found = uncertainty_of(calibration, coverage_of(calibration), 1.0)
    wider = uncertainty_of(with_field(calibration, 190), coverage_of(with_field(calibration, 190)), 1.0)
    assert found.known == wider.known == 1
    assert found.image_px is not None
    assert wider.image_px is not None
    assert found.image_px < 0.5 * wider.image_px  # what was never seen is uncertain, and asked for where light arrives


def test_angles_that_were_not_seen_are_told() -> None:
    """A target that was never held at the side: the verdict says at which angles."""
    found = coverage_of(with_field(seen_up_to(30), 190))
    assert "all of the rim" in found.missing_words
    assert found.missing_words.endswith("° to 95° off the axis")
    assert found.share < 0.5


def test_photos_to_take_reach_the_rim_and_stay_in_the_light() -> None:
    """Places that are tried lie up to far off the axis, none of them in the dark."""
    calibration = with_field(seen_up_to(60), 190)
    shape = shape_of(calibration)
    assert shape is not None
    found = candidates_of(calibration, shape, habits_of(calibration, shape))
    middle = transform(found.cam_from_target, shape.center_mm)
    angle = np.degrees(np.arccos(middle[:, 2] / np.linalg.norm(middle, axis=1)))
    assert np.isfinite(project(calibration.camera, middle)).all()
    assert angle.max() > 75


def test_a_millimetre_of_a_pinhole_is_shown_alike_off_the_axis() -> None:
    """f/z anywhere, as its image of a plane across the axis is a scaled one."""
    place = np.random.default_rng(0).uniform([-300, -300, 200], [300, 300, 500], (50, 3))
    camera = Camera("pinhole", np.array([900.0, 900.0, 500.0, 400.0]), (1000, 800))
    assert px_per_mm(camera, place) == pytest.approx(900 / place[:, 2])


@pytest.mark.parametrize("field_deg", [120, 170, 190])
def test_photos_tell_where_the_light_ends(field_deg: float) -> None:
    """From the brightest of each cell, vignetted and with a black level, to a degree."""
    rows, columns = 180, 240
    u, v = np.meshgrid((np.arange(columns) + 0.5) * 800 / columns - 0.5, (np.arange(rows) + 0.5) * 600 / rows - 0.5)
    angle = np.arccos(rays(FISHEYE, np.stack([u, v], axis=-1))[..., 2])
    light = np.random.default_rng(0).uniform(0.5, 0.9, angle.shape) * np.cos(angle / 2.2) ** 2
    light = np.where(angle <= np.radians(field_deg) / 2, light, 0.0) + 0.03
    found = with_image_circle(FISHEYE, light)
    assert found.camera.field_rad is not None
    assert np.degrees(found.camera.field_rad) == pytest.approx(field_deg, abs=2)


def test_light_all_over_the_image() -> None:
    """Without a dark part all of the image is asked for; light where a model has no ray is told."""
    bright = np.full((180, 240), 0.6)
    camera = with_image_circle(FISHEYE, bright).camera
    u, v = np.meshgrid([0.0, 799.0], [0.0, 599.0])
    assert np.isfinite(rays(camera, np.stack([u, v], axis=-1))).all()
    assert with_image_circle(CAMERAS["opencv"], bright).camera is CAMERAS["opencv"]
    short = replace(FISHEYE, params=np.array([150.0, 150.0, 401.0, 298.0, -0.1, 0.0, 0.0, 0.0]))
    found = with_image_circle(short, bright)
    assert found.camera.field_rad is None
    assert "has no ray" in found.remark
