"""The photos to take next, held against the solver and against what is right by construction."""

import math
import re
from dataclasses import replace
from functools import cache

import numpy as np
import pytest

from calib.cameras import project
from calib.cameras.camera import Camera
from calib.cameras.refit import image_grid
from calib.core.se3 import look_at, transform
from calib.core.types import Observations, without_empty_views
from calib.judge.candidate_views import TILTS_DEG, candidates_of, faces_seen, shown_in
from calib.judge.coverage import coverage, coverage_of
from calib.judge.information import eliminated, knowledge_of, view_information
from calib.judge.next_view_words import ViewGain, gain_words, place_of, place_words, short, tilt_words
from calib.judge.next_views import next_views, photos_needed, why_no_next_views
from calib.judge.views import habits_of, shape_of
from calib.solver.accuracy import projected_sigma_px, share_px
from calib.solver.calibration import Calibration
from calib.solver.solve import solve
from designer.base.arrays import Array
from tests.support.solver_scenes import CAMERAS, NOISE_PX, board, icosahedron, observe, poses_around
from tests.support.verdict_cases import shown_at

BOARD = board(10, 7, 12.0)
SOLID = icosahedron(60.0, 5)
AIM_MM = 25.0
"""How far off the middle the photos of `base` are."""


def middle_sigma_px(calibration: Calibration) -> float:
    """What 95 % of the image stays within, as the solver's own map has it."""
    pixel = image_grid(calibration.camera.image_size).reshape(-1, 2)
    return share_px(projected_sigma_px(calibration.camera, calibration.param_covariance, pixel))


@cache
def base(target: str, model: str) -> Calibration:
    """A camera solved from twelve photos with the target around the middle."""
    rng = np.random.default_rng(1)
    points = BOARD if target == "board" else SOLID
    poses = poses_around(12, rng, half_angle_deg=35.0, distance_mm=300.0, aim_mm=AIM_MM)
    return solve(observe(CAMERAS[model], points, poses, rng, noise_px=NOISE_PX, incidence_deg=70.0), model)


def with_views(calibration: Calibration, poses: Array, rng: np.random.Generator) -> Observations:
    """The observations with what the true camera would see from other poses, with noise of the same size."""
    seen = calibration.observations
    shape = shape_of(calibration)
    habits = habits_of(calibration, shape)
    camera = CAMERAS[calibration.camera.model]
    shown = shown_in(camera, shape, habits, poses, np.arange(len(shape.face)))
    view, point = np.nonzero(shown.is_read)
    pixel = shown.pixel[view, point] + NOISE_PX * rng.standard_normal((len(view), 2))
    more = replace(
        seen,
        view_names=(*seen.view_names, *(f"next{n}.png" for n in range(len(poses)))),
        view=np.concatenate([seen.view, view + seen.view_count]),
        point=np.concatenate([seen.point, point]),
        center_px=np.concatenate([seen.center_px, pixel]),
    )
    return without_empty_views(more)


@pytest.mark.parametrize("target", ["board", "solid"])
@pytest.mark.parametrize("model", ["opencv", "luhmann", "pinhole"])
def test_information_of_the_views_is_that_of_the_solver(target: str, model: str) -> None:
    """What the used views tell, added up, is the inverse of the covariance that the solver states."""
    calibration = base(target, model)
    seen = calibration.observations
    weight = np.zeros((seen.view_count, len(seen.points.position_mm)))
    weight[seen.view, seen.point] = 1.0
    known = knowledge_of(calibration)
    each = view_information(known, calibration.cam_from_target, seen.points.position_mm, weight)
    np.testing.assert_allclose(each.sum(axis=0), np.eye(known.basis.shape[1]), atol=2e-3)
    np.testing.assert_allclose(known.basis @ known.basis.T, calibration.param_covariance, rtol=1e-6, atol=1e-30)


@pytest.mark.parametrize("apart", [1e-2, 1e-4, 1e-6, 0.0])
def test_no_photo_tells_more_than_its_pose_leaves(apart: float) -> None:
    """However near two motions look alike, what is told is at most what is orthogonal to all motions."""
    rng = np.random.default_rng(0)
    columns, pose = rng.normal(size=(20, 3)), rng.normal(size=(20, 6))
    pose[:, 5] = pose[:, 4] + apart * pose[:, 5]
    motions = np.linalg.svd(pose, full_matrices=False)[0][:, : 6 if apart else 5]
    left = columns - motions @ (motions.T @ columns)
    both = np.hstack([columns, pose])
    told = eliminated((both.T @ both)[None])[0]
    assert np.linalg.eigvalsh(left.T @ left - told)[0] > -1e-6
    assert (np.linalg.eigvalsh(told)[0] > 0.1) == (apart > 1e-5)


@pytest.mark.parametrize(("target", "model"), [("board", "opencv"), ("board", "luhmann"), ("solid", "luhmann")])
def test_predicted_deviation_is_that_of_a_solution_with_the_photos(target: str, model: str) -> None:
    """Solved with the proposed photos, the camera is as well known as was said, within 10 %, after each of them."""
    calibration = base(target, model)
    views = next_views(calibration, most=3)
    assert len(views) >= 2
    assert views[0].sigma_px_before == pytest.approx(middle_sigma_px(calibration), rel=1e-6)
    for count in range(1, len(views) + 1):
        poses = np.stack([view.cam_from_target for view in views[:count]])
        solved = solve(with_views(calibration, poses, np.random.default_rng(count)), model)
        noise_alike = middle_sigma_px(solved) * calibration.scale / solved.scale
        assert noise_alike == pytest.approx(views[count - 1].sigma_px_after, rel=0.1)


@pytest.mark.parametrize(("target", "model"), [("board", "opencv"), ("solid", "luhmann")])
def test_the_proposed_photos_are_better_than_more_of_the_same(target: str, model: str) -> None:
    """Two proposed photos leave less than a third of the deviation that two more photos like the first leave."""
    calibration = base(target, model)
    views = next_views(calibration, most=2)
    others = []
    for seed in range(5):
        rng = np.random.default_rng(100 + seed)
        poses = poses_around(2, rng, half_angle_deg=35.0, distance_mm=300.0, aim_mm=AIM_MM)
        others.append(middle_sigma_px(solve(with_views(calibration, poses, rng), model)))
    assert views[-1].sigma_px_after < np.median(others) / 3


@pytest.mark.parametrize("side", [(1, 0), (-1, 0), (0, 1), (0, -1), (1, 1), (-1, 1), (1, -1), (-1, -1)])
def test_the_side_that_is_named_is_the_farther_one(side: tuple[int, int]) -> None:
    """Tilted with its right side away, what is seen to the right is farther away; so with all sides and corners."""
    calibration = base("board", "opencv")
    shape = shape_of(calibration)
    found = candidates_of(calibration, shape, habits_of(calibration, shape))
    rows = np.flatnonzero((found.away == side).all(axis=1))
    assert len(rows) > 20
    words = {
        (1, 0): "right side", (-1, 0): "left side", (0, 1): "bottom side", (0, -1): "top side",
        (1, 1): "bottom right corner", (-1, 1): "bottom left corner", (1, -1): "top right corner",
        (-1, -1): "top left corner",
    }  # fmt: skip
    for row in rows.tolist():
        at = transform(found.cam_from_target[row], shape.position_mm)
        pixel = project(CAMERAS["pinhole"], at)
        towards = (pixel - pixel.mean(axis=0)) @ np.array(side)
        far, near = at[np.argmax(towards), 2], at[np.argmin(towards), 2]
        assert far > near
        plane = np.linalg.svd(at - at.mean(axis=0))[2][2]
        assert np.degrees(np.arccos(abs(plane[2]))) == pytest.approx(found.tilt_deg[row], abs=1e-6)
        assert words[side] in tilt_words(found.tilt_deg[row], (float(side[0]), float(side[1])))


@pytest.mark.parametrize("target", ["board", "solid"])
def test_the_place_that_is_named_is_where_the_target_is_seen(target: str) -> None:
    """A target in the top left corner has more of the image to its right and below it than on the other sides."""
    calibration = base(target, "opencv")
    shape = shape_of(calibration)
    found = candidates_of(calibration, shape, habits_of(calibration, shape))
    width, height = calibration.camera.image_size
    corners = np.concatenate(shape.corner)
    for row in range(0, len(found.place), 5):
        looks = faces_seen(shape, found.cam_from_target[row][None])[0][0][shape.face[corners]]
        pixel = project(calibration.camera, transform(found.cam_from_target[row], shape.position_mm[corners[looks]]))
        left, top = pixel.min(axis=0)
        right, bottom = np.array([width, height]) - 1 - pixel.max(axis=0)
        for place, before, after in ((found.place[row, 0], left, right), (found.place[row, 1], top, bottom)):
            if place == 0:
                assert before == pytest.approx(after, abs=0.02 * width)
            else:
                assert (before > after) == (place > 0)


def box(left: float, top: float, right: float, bottom: float) -> tuple[Array, ...]:
    """An outline in parts of an image of 1000 x 800."""
    part = np.array([[left, top], [right, top], [right, bottom], [left, bottom], [left, top]])
    return (part * [1000, 800] - 0.5,)


@pytest.mark.parametrize(
    ("outline", "words"),
    [
        (box(0.02, 0.65, 0.3, 0.97), "in the bottom left corner of the image"),
        (box(0.02, 0.2, 0.3, 0.5), "at the left edge of the image, towards the top"),
        (box(0.3, 0.02, 0.7, 0.4), "at the top edge of the image"),
        (box(0.02, 0.03, 0.98, 0.98), "in the middle of the image"),
        (box(0.15, 0.15, 0.75, 0.95), "in the middle of the image, a little to the bottom left"),
        (box(0.05, 0.3, 0.45, 0.6), "at the left edge of the image"),
        (box(0.5, 0.2, 0.8, 0.45), "half way to the top right corner of the image"),
        (box(0.2, 0.2, 1.1, 1.2), "in the bottom right corner of the image"),
    ],
)
def test_words_of_places_follow_the_outline(outline: tuple[Array, ...], words: str) -> None:
    """A place is named by what is left free around the outline, in all its parts, whatever its size."""
    assert place_words(place_of(outline, (1000, 800))) == words
    both = (outline[0][:3], outline[0][2:])
    assert place_words(place_of(both, (1000, 800))) == words


@pytest.mark.parametrize(("target", "model"), [("board", "opencv"), ("solid", "luhmann")])
def test_the_sentence_says_where_the_sketch_has_it(target: str, model: str) -> None:
    """The words of each proposed photo are those of its own outline, not of the place that was tried for."""
    calibration = base(target, model)
    for view in next_views(calibration, goal_covered=0.9):
        words = place_words(place_of(view.outline_px, calibration.camera.image_size))
        assert words in view.sentence
        points = np.concatenate(view.outline_px)
        middle = 0.5 * (points.min(axis=0) + points.max(axis=0)) / calibration.camera.image_size
        for name, axis, is_low in (("left", 0, True), ("right", 0, False), ("top", 1, True), ("bottom", 1, False)):
            if name in words:
                assert (middle[axis] < 0.5) == is_low


def test_words_of_photos() -> None:
    """A sentence says all that a person must do, and what it gives: no deviation where that is not the point."""
    assert tilt_words(0.0, (0.0, 0.0)) == "facing the camera straight on"
    assert tilt_words(40.0, (1.0, 0.0)) == "tilted 40 deg with its right side away from the camera"
    hold = (
        r"hold the board (in|at|half way to) the .* of the image(, .*)?, its long side (level|upright), "
        r"(tilted|facing) .*camera(, .*)?, at about [0-9.]+ (m|mm): 95 % sigma [0-9.]+ -> [0-9.]+ px"
    )
    assert re.fullmatch(hold, next_views(base("board", "opencv"), most=1)[0].sentence)
    solid = next_views(base("solid", "opencv"), most=1)[0].sentence
    assert re.search(r", (any side to the camera|turned as in [^,]+), at about ", solid)
    assert gain_words(ViewGain(0.21, 0.13, 0.4, 0.5)) == "95 % sigma 0.21 -> 0.13 px"
    assert gain_words(ViewGain(0.21, 0.13, 0.181, 0.312, tells_area=True)).endswith("0.13 px, coverage 18 -> 31 %")
    assert gain_words(ViewGain(0.21, 0.21, 0.18, 0.31, tells_sigma=False, tells_area=True)) == "coverage 18 -> 31 %"
    assert gain_words(ViewGain(math.inf, 0.13, 0.1, 0.2)) == "95 % sigma not determined -> 0.13 px"
    assert "\n" not in short("a\nb.png")


def test_a_board_seen_on_the_left_only_is_wanted_on_the_right() -> None:
    """After photos with the board in the left half, the first photo asked for shows it in the right half."""
    rng = np.random.default_rng(1)
    places = [(500 + 200 * (n % 3), 500 + 300 * (n % 4)) for n in range(10)]
    poses = shown_at(places, (420.0,), (10.0, 30.0, 40.0))
    seen = observe(CAMERAS["opencv"], BOARD, poses, rng, noise_px=NOISE_PX)
    assert seen.center_px[:, 0].max() < 1230
    views = next_views(solve(seen, "opencv"))
    middle = np.concatenate(views[0].outline_px)[:, 0]
    assert 0.5 * (middle.min() + middle.max()) > 1224
    assert "right" in views[0].sentence.split(",")[0]


def test_a_board_seen_straight_on_only_is_wanted_tilted() -> None:
    """Where focal length and distance cannot be told apart, the first photo asked for is tilted, and it helps."""
    rng = np.random.default_rng(2)
    places = [(600 + 400 * (n % 4), 600 + 400 * (n % 3)) for n in range(8)]
    seen = observe(CAMERAS["opencv"], BOARD, shown_at(places, (420.0,), (0.0,)), rng, noise_px=NOISE_PX)
    calibration = solve(seen, "opencv")
    assert calibration.status == "degenerate"
    views = next_views(calibration)
    assert math.isinf(views[0].sigma_px_before)
    assert any(f"tilted {tilt:.0f} deg" in views[0].sentence for tilt in TILTS_DEG)
    assert "not determined ->" in views[0].sentence
    assert "times the usual distance" in views[0].sentence
    poses = np.stack([view.cam_from_target for view in views])
    poses[:, 2, 3] *= 2500 / calibration.camera.params[0]  # held so that it looks as in the sketch
    solved = solve(with_views(calibration, poses, rng), "opencv")
    assert solved.status == "converged"
    assert solved.camera.params[0] == pytest.approx(2500, rel=0.01)


@pytest.mark.parametrize("target", ["board", "solid"])
def test_what_is_asked_for_can_be_done(target: str) -> None:
    """Read faces lie in the image and look at the camera; distances stay near those used; outlines are closed."""
    calibration = base(target, "opencv")
    shape = shape_of(calibration)
    habits = habits_of(calibration, shape)
    for view in next_views(calibration):
        pose = view.cam_from_target
        shown = shown_in(calibration.camera, shape, habits, pose[None], np.arange(len(shape.face)))
        pixel = shown.pixel[0][shown.is_read[0]]
        assert len(pixel) >= 12
        assert pixel.min() > 0
        assert (pixel < np.array(calibration.camera.image_size) - 1).all()
        distance = np.linalg.norm(transform(pose, shape.center_mm))
        assert 0.69 * habits.distance_mm[0] < distance < 1.41 * habits.distance_mm[1]
        assert view.outline_px
        for line in view.outline_px:
            assert (line[0] == line[-1]).all()
        if target == "board":
            inside = shown.pixel[0]
            low, high = view.outline_px[0].min(axis=0), view.outline_px[0].max(axis=0)
            assert (inside > low - 2).all()
            assert (inside < high + 2).all()


def test_planes_that_look_the_other_way_change_nothing() -> None:
    """A plane from elsewhere may have its normal on the wrong side; the photos tell which side carries the rings."""
    calibration = base("solid", "opencv")
    points = calibration.observations.points
    turned = replace(points, plane=-points.plane)
    other = replace(calibration, observations=replace(calibration.observations, points=turned))
    assert [v.sentence for v in next_views(other, most=2)] == [v.sentence for v in next_views(calibration, most=2)]


def test_what_cannot_be_proposed_says_why() -> None:
    """A learned map, a solution without accuracy and points on no plane give no views, but a reason."""
    calibration = base("board", "opencv")
    points = calibration.observations.points
    nowhere = replace(points, face=np.full(len(points.face), -1))
    camera = calibration.camera
    for odd, word in (
        (replace(calibration, camera=Camera("virtual", camera.params[:4], camera.image_size)), "map"),
        (replace(calibration, scale=math.nan), "accuracy"),
        (replace(calibration, observations=replace(calibration.observations, points=nowhere)), "plane"),
    ):
        assert word in why_no_next_views(odd)
        assert next_views(odd) == ()
    assert why_no_next_views(calibration) == ""


def test_no_photo_is_asked_for_beyond_the_goals() -> None:
    """None if all is known and covered as wanted, one if the first reaches it, more where parts of the image miss."""
    calibration = base("board", "opencv")
    every = next_views(calibration)
    assert len(next_views(calibration, goal_px=1.01 * every[0].sigma_px_after)) == 1 < len(every)
    known = 1.01 * every[0].sigma_px_before
    assert next_views(calibration, goal_px=known) == ()
    covered = coverage_of(calibration)
    assert covered.share < 0.6
    assert next_views(calibration, goal_px=known, goal_covered=covered.share - 0.01) == ()
    more = next_views(calibration, goal_px=known, goal_covered=0.8)
    grown = with_views(calibration, np.stack([v.cam_from_target for v in more]), np.random.default_rng(0))
    share = coverage(grown.image_size, grown.center_px, grown.view, grown.points.face[grown.point]).share
    assert share > 0.79
    assert share == pytest.approx(more[-1].covered_after, abs=0.02)
    assert more[-2].covered_after < 0.8
    for view in more:
        assert "sigma" not in view.sentence
        assert f"coverage {100 * view.covered_before:.0f} -> {100 * view.covered_after:.0f} %" in view.sentence


@pytest.mark.parametrize("scale", [1e-16, 1e-3])
def test_one_straight_view_asks_for_a_tilted_one(scale: float) -> None:
    """However exact the photo was: what it leaves open is asked for, and no number is made of rounding."""
    pose = look_at(np.array([[0.0, 0.0, 300.0]]), np.zeros((1, 3)), np.zeros(1))
    seen = observe(CAMERAS["pinhole"], BOARD, pose, np.random.default_rng(2), noise_px=0.0, incidence_deg=70.0)
    solved = solve(seen, "pinhole")
    assert solved.status == "degenerate"
    first, *_ = next_views(replace(solved, scale=scale), most=2)
    assert first.sigma_px_before == math.inf
    assert 0 < first.sigma_px_after < math.inf
    assert abs(first.cam_from_target[2, 2]) < math.cos(math.radians(15))


def test_fixed_parameters_stay_known() -> None:
    """What is fixed is no unknown: the basis does not move it, and views are proposed all the same."""
    from calib.solver.problem import SolveOptions

    calibration = solve(base("board", "opencv").observations, "opencv", SolveOptions(fixed=(("k3", 0.01),)))
    known = knowledge_of(calibration)
    assert known.basis.shape == (9, 8)
    assert np.abs(known.basis[8]).max() == 0
    assert len(next_views(calibration, most=1)) == 1


@pytest.mark.parametrize(
    ("sigma", "limit", "wanted"), [(0.1, 0.1, 10), (0.2, 0.1, 40), (0.05, 0.1, 10), (0.11, 0.1, 13)]
)
def test_photos_needed_follows_the_square_root(sigma: float, limit: float, wanted: int) -> None:
    """Four times as many photos halve the deviation; photos that do already need no more."""
    assert photos_needed(10, sigma, limit) == wanted


def test_a_figure_of_the_views_is_drawn() -> None:
    """Each view has its outlines and its number, and no two numbers stand on each other."""
    from matplotlib.figure import Figure

    from calib.draw.run_figures import draw_next_views

    calibration = base("board", "opencv")
    views = next_views(calibration)
    for shown in (views, (views[0], views[0]), ()):
        axes = Figure().subplots()
        draw_next_views(axes, calibration.camera.image_size, shown, calibration.observations.center_px)
        numbers = [text for text in axes.texts if text.get_text().isdigit()]
        assert [text.get_text() for text in numbers] == [str(n + 1) for n in range(len(shown))]
        places = [text.xy for text in numbers]
        apart = [math.dist(a, b) for n, a in enumerate(places) for b in places[:n]]
        assert min(apart, default=1e9) > 50
