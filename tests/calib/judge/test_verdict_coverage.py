"""How much of the image is covered, of a wide camera the part that light reaches, and how its places are called."""

from dataclasses import replace
from functools import cache

import cv2
import numpy as np
import pytest

from calib.cameras import project, rays
from calib.cameras.camera import Camera
from calib.cameras.refit import image_grid
from calib.core.se3 import look_at, make_pose, rotation_between, transform
from calib.draw.sigma_map import place_on_map, sigma_map
from calib.judge.candidate_views import candidates_of
from calib.judge.coverage import COLUMNS, Coverage, coverage, coverage_of, lit_part, region_words
from calib.judge.difference import Known, in_sigmas, sigma_over
from calib.judge.evidence import uncertainty_of
from calib.judge.lens_checks import OWN_ROTATION
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
from tests.support.verdict_cases import check, judged, sightings

SIZE = (800, 600)


def _grid(left: float, right: float, size: tuple[int, int] = SIZE, steps: int = 9) -> np.ndarray:
    """A grid of sightings from one part of the width to another, over the whole height."""
    width, height = size
    u, v = np.meshgrid(
        np.linspace(left * width - 0.5, right * width - 0.5, steps), np.linspace(-0.5, height - 0.5, steps)
    )
    return np.stack([u, v], axis=-1).reshape(-1, 2)


def _of(*views: np.ndarray, size: tuple[int, int] = SIZE) -> Coverage:
    view = np.repeat(np.arange(len(views)), [len(one) for one in views])
    return coverage(size, np.concatenate(views), view, np.zeros(len(view), dtype=np.int64))


@pytest.mark.parametrize("size", [(800, 600), (600, 800), (2448, 2048), (11608, 8708), (97, 61)])
@pytest.mark.parametrize("steps", [2, 15])
def test_a_full_grid_covers_all_and_half_of_it_half(size: tuple[int, int], steps: int) -> None:
    """Coverage is a share of area: it depends neither on the image's size nor on how many rings a target has."""
    assert _of(_grid(0, 1, size, steps), size=size).share == pytest.approx(1, abs=1e-9)
    assert _of(_grid(0, 0.5, size, steps), size=size).share == pytest.approx(0.5, abs=1 / COLUMNS)


def test_views_add_up() -> None:
    """The union of the hulls counts, overlaps once; how many views cover a cell is kept."""
    seen = _of(_grid(0, 0.5), _grid(0.25, 0.75))
    assert seen.share == pytest.approx(0.75, abs=1 / COLUMNS)
    assert set(np.unique(seen.views)) == {0, 1, 2}
    assert (seen.views == 2).mean() == pytest.approx(0.25, abs=2 / COLUMNS)


def test_what_lies_between_two_faces_is_not_covered() -> None:
    """Each face has its own hull: the air between two of them was not seen."""
    pixel = np.concatenate([_grid(0, 0.25), _grid(0.75, 1)])
    view, face = np.zeros(len(pixel), dtype=np.int64), np.repeat([0, 1], len(pixel) // 2)
    assert coverage(SIZE, pixel, view, face).share == pytest.approx(0.5, abs=2 / COLUMNS)
    assert coverage(SIZE, pixel, view, np.zeros_like(face)).share == pytest.approx(1)


def test_cells_are_those_whose_middles_the_hull_holds() -> None:
    """Oracle: OpenCV's point-in-polygon test, for a cloud of points."""
    rng = np.random.default_rng(3)
    pixel = rng.normal([400, 300], [150, 90], (40, 2))
    seen = _of(pixel)
    hull = cv2.convexHull(pixel.astype(np.float32))
    away = np.array([cv2.pointPolygonTest(hull, (float(u), float(v)), True) for u, v in seen.middle_px.reshape(-1, 2)])
    clear = np.abs(away) > 1e-3
    assert np.array_equal(seen.is_covered.reshape(-1)[clear], away[clear] > 0)


def test_too_few_sightings_cover_nothing() -> None:
    """One or two sightings, or those on a line, surround no area."""
    assert _of(np.array([[10.0, 10], [700, 500]])).share == 0
    assert _of(np.stack([np.linspace(0, 799, 9), np.linspace(0, 599, 9)], axis=1)).share < 2 / COLUMNS
    assert coverage(SIZE, np.zeros((0, 2)), np.zeros(0, np.int64), np.zeros(0, np.int64)).share == 0


def test_regions_tell_what_is_missing() -> None:
    """Corners, edges and the centre are named, and their areas add up to the image."""
    seen = _of(_grid(0, 0.76))
    assert sum(region.area for region in seen.regions) == pytest.approx(1)
    assert sum(region.area * region.covered for region in seen.regions) == pytest.approx(seen.share)
    missing = tuple(region.name for region in seen.not_covered)
    assert missing == ("top right corner", "right edge", "bottom right corner")
    assert region_words(missing) == "the top right corner, the bottom right corner and the right edge"
    everything = tuple(region.name for region in seen.regions)
    assert region_words(everything) == "all corners, all edges and the centre"
    assert region_words(()) == ""


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


MAP_PX = (1000, 800)
GRID = image_grid(MAP_PX, 41, 33)


@pytest.mark.parametrize(
    ("at", "lost", "words"),
    [
        ((32, 0), None, "in the bottom left corner"),
        ((30, 2), None, "in the bottom left corner"),
        ((30, 2), (slice(31, 33), slice(0, 2)), "towards the bottom left"),
        ((25, 8), None, "towards the bottom left"),
        ((16, 39), None, "at the right edge"),
        ((16, 39), (slice(None), slice(40, 41)), "towards the right"),
        ((3, 20), (slice(0, 2), slice(None)), "towards the top"),
        ((16, 20), (slice(0, 2), slice(None)), "in the middle"),
    ],
)
def test_a_corner_is_named_only_if_something_is_known_there(
    at: tuple[int, int], lost: tuple[slice, slice] | None, words: str
) -> None:
    """What lies short of a corner or an edge, or where the map ends before it, is only towards it."""
    is_known = np.ones(GRID.shape[:2], dtype=bool)
    if lost is not None:
        is_known[lost] = False
    assert place_on_map(GRID, is_known, at, MAP_PX) == words


def test_a_lens_that_breaks_down_is_known_in_one_share_of_the_image() -> None:
    """The share on the map is that of the verdict's sentence, and the worst place is short of the grey."""
    calibration = solve(sightings(views=12), "opencv")
    params = calibration.camera.params.copy()
    params[4:] = [-1.1, 0.0, 0.0, 0.0, 0.0]
    folded = Camera("opencv", params, CAMERAS["opencv"].image_size)
    found = sigma_map(replace(calibration, camera=folded))
    assert 0.3 < found.known_share < 0.95
    assert np.isnan(found.sigma_px[0, 0])
    assert found.worst_place.startswith("towards")
    assert found.known_share == pytest.approx(np.isfinite(found.sigma_px).mean(), abs=0.03)


def test_the_number_of_the_covered_area_says_which_rotation_was_removed() -> None:
    """The number of the image is that of the map; that of the covered area is said to have its own rotation removed."""
    seen = sightings(views=12)
    calibration = solve(seen, "opencv")
    said = check(judged(seen), "uncertainty")
    assert said.value == pytest.approx(sigma_map(calibration).most_px)
    covered = coverage_of(calibration)
    inside = np.percentile(sigma_over(Known(calibration.camera, calibration.param_covariance), covered), 95)
    assert f"{inside:.2g} px ({OWN_ROTATION})" in said.sentence
