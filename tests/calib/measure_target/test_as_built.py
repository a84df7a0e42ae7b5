"""A print that is measured from photos comes out as it is."""

from dataclasses import replace

import numpy as np
import pytest

from calib.cameras.camera import Camera
from calib.core.se3 import compose, invert, make_pose, transform
from calib.core.types import Observations, keep_sightings, keep_views
from calib.measure_target.lengths import CaliperLength, length_in
from calib.measure_target.result import AsBuilt
from calib.measure_target.solve import measure
from calib.measure_target.unknowns import AsBuiltOptions, TargetUnknowns
from calib.observe.observations import known_points
from calib.solver.metrics.errors import summarise
from calib.solver.metrics.evaluation import evaluate
from calib.solver.problem import AS_THE_PAPER, SolveOptions
from calib.solver.solve import solve
from designer.base.arrays import Array, Flags
from designer.target import TargetGeometry
from designer.tolerance.error_file import error_model
from designer.tolerance.model import perturb
from tests.support.as_built_scenes import (
    RIGID,
    blocks_of,
    frame_errors,
    mahalanobis,
    no_deviation,
    photos,
    plate,
    printed,
    random_shape,
    solid,
    truth_of,
)
from tests.support.solver_scenes import CAMERAS, NOISE_PX, SIZE, random_covariances

RINGS = (0.05, 0.02)
WIDE = replace(RIGID, strain_sigma=0.05, face_sigma_rad=0.1, face_sigma_mm=9.5)
"""Of a print of which nothing is expected."""
INSIDE_95 = 12.5916
"""95 % quantile of a chi-square with six degrees of freedom."""
SEEN_FACES = 0.9


def distances_mm(center_mm: Array) -> Array:
    """All distances between rings: the shape, whatever the datum.  # (R, R)"""
    distance: Array = np.linalg.norm(center_mm[:, None] - center_mm, axis=2)
    return distance


def relative_error(found: AsBuilt, print_: TargetGeometry) -> float:
    """Largest error of a distance between seen rings, in mm, once the target is as large as the print."""
    seen = found.is_ring_seen
    measured, true = distances_mm(found.target.center_mm[seen]), distances_mm(print_.center_mm[seen])
    scale = (measured * true).sum() / (measured**2).sum()
    return float(np.abs(scale * measured - true).max())


@pytest.mark.parametrize("ring_mm", [(0.0, 0.0), RINGS])
def test_exact_photos_give_the_exact_print(ring_mm: tuple[float, float]) -> None:
    """Without noise the print comes out to 1e-7 mm, with the camera and the poses."""
    rng = np.random.default_rng(1)
    print_ = printed(solid(), random_shape(solid(), rng, ring_mm=ring_mm))
    options = AsBuiltOptions(ring_sigma_mm=ring_mm if any(ring_mm) else None)
    found = measure([photos(print_, rng, noise_px=0.0)], solid(), "opencv", options)
    assert found.status == "converged"
    assert relative_error(found, print_) < 1e-7
    assert np.abs(found.cameras[0].params - CAMERAS["opencv"].params).max() < 1e-5


def test_a_warped_board_comes_out() -> None:
    """A board's warp, its strain and its rings' offsets are recovered from exact photos."""
    rng = np.random.default_rng(2)
    shape = random_shape(plate(), rng, bow_mm=0.5, ring_mm=RINGS)
    print_ = printed(plate(), shape)
    seen = photos(print_, rng, noise_px=0.0, half_angle_deg=50.0)
    found = measure([seen], plate(), "opencv")
    assert relative_error(found, print_) < 1e-7
    assert found.bow_mm[0] == pytest.approx(shape.bow[0], abs=0.03)  # but for what the offsets have of it
    rigid = measure([seen], plate(), "opencv", AsBuiltOptions(ring_sigma_mm=None))
    assert found.scale < 1e-3 * rigid.scale


def test_a_measured_target_is_better_by_every_metric() -> None:
    """With a bent board as it was measured no error is larger, and each is as many times smaller as the residuals."""
    rng = np.random.default_rng(20)
    seen = photos(printed(plate(), random_shape(plate(), rng, bow_mm=0.3)), rng, 12, half_angle_deg=50.0)
    found = measure([seen], plate(), "opencv")
    rmse = []
    for target in (plate(), found.target):
        solution = solve(replace(seen, points=known_points(target)), "opencv")
        rmse.append([summarise(errors).rmse for errors in evaluate(solution).errors])
    times = np.divide(*rmse)
    assert times[0] > 3
    assert (times > 0.8 * times[0]).all(), times


@pytest.mark.parametrize(
    ("options", "ring_mm"),
    [(RIGID, (0.0, 0.0)), (AsBuiltOptions(ring_sigma_mm=RINGS), (0.1, 0.01))],
    ids=["rigid", "rings"],
)
def test_stated_covariances_hold_the_truth(options: AsBuiltOptions, ring_mm: tuple[float, float]) -> None:
    """About 95 % of the faces lie within their 95 % regions, in place and in own motion, whatever was expected."""
    own, frames = [], []
    for trial in range(10):
        rng = np.random.default_rng([3, trial])
        shape = random_shape(solid(), rng, ring_mm=ring_mm)
        found = measure([photos(printed(solid(), shape), rng)], solid(), "opencv", options)
        true, kept = truth_of(found, shape, options), found.is_determined
        assert found.target.face_covariance is not None
        assert kept.mean() > SEEN_FACES
        own.append(mahalanobis(found.motion - true.shape.motion, blocks_of(found.motion_covariance))[kept])
        frames.append(mahalanobis(frame_errors(found.target, true.target), found.target.face_covariance)[kept])
    for squares in (np.concatenate(own), np.concatenate(frames)):
        assert (squares < INSIDE_95).mean() == pytest.approx(0.95, abs=0.04)
        assert squares.mean() == pytest.approx(6.0, rel=0.15)


def test_rings_that_may_not_move_are_rigid_faces() -> None:
    """Ring offsets with a sigma of 0 are none, and with one that is nearly 0 the same to what noise allows."""
    rng = np.random.default_rng(4)
    seen = photos(printed(solid(), random_shape(solid(), rng)), rng, 12)
    rigid = measure([seen], solid(), "opencv", RIGID)
    zero = measure([seen], solid(), "opencv", AsBuiltOptions(ring_sigma_mm=(0.0, 0.0)))
    held = measure([seen], solid(), "opencv", AsBuiltOptions(ring_sigma_mm=(1e-6, 1e-6)))
    assert np.array_equal(zero.target.center_mm, rigid.target.center_mm)
    sigma = np.sqrt(np.diagonal(rigid.motion_covariance)).reshape(-1, 6)
    assert (np.abs(held.motion - rigid.motion)[rigid.is_determined] < 1e-3 * sigma[rigid.is_determined]).all()
    assert held.motion_covariance[:6, :6] == pytest.approx(rigid.motion_covariance[:6, :6], rel=0.02)


def test_size_is_not_seen_without_a_length_and_comes_with_one() -> None:
    """A print that is only larger looks as designed, which is said; one length tells its size, with its sigma."""
    rng = np.random.default_rng(5)
    large = TargetUnknowns(np.array([0.01, 0.01, 0.01, 0, 0, 0]), *(np.zeros_like(part) for part in _rest(solid())))
    print_ = printed(solid(), large)
    seen = photos(print_, rng)
    found = measure([seen], solid(), "opencv", RIGID)
    assert not found.scale_known
    assert np.abs(found.strain).max() < 1e-4
    length = CaliperLength("face-to-face", 1.01 * length_in(solid(), "face-to-face"), 0.02)
    sized = measure([seen], solid(), "opencv", RIGID, [length])
    assert sized.scale_known
    sigma = 0.02 / length.value_mm * 1.01
    assert sized.scale_sigma == pytest.approx(sigma, rel=0.01)
    assert np.diagonal(sized.strain) == pytest.approx(0.01, abs=1e-4)
    assert np.sqrt(np.diagonal(sized.strain_covariance))[:3] == pytest.approx(sigma, rel=0.02)
    # The camera and the images stay as they were; the target is farther away by as much as it is larger.
    assert sized.cameras[0].params == pytest.approx(found.cameras[0].params, rel=1e-9)
    larger = np.trace(sized.strain + np.eye(3)) / np.trace(found.strain + np.eye(3))
    assert sized.poses[0][:, :3, 3] == pytest.approx(larger * found.poses[0][:, :3, 3], rel=1e-6)
    normal = sized.target.face_covariance[0, 5, 5] if sized.target.face_covariance is not None else 0.0
    inradius = float(solid().target_from_face[0, :3, 3] @ solid().target_from_face[0, :3, 2])
    assert np.sqrt(normal) == pytest.approx(inradius * sigma, rel=0.05)


def _rest(target: TargetGeometry) -> tuple[Array, Array, Array]:
    shape = no_deviation(target)
    return shape.motion, shape.bow, shape.offset_mm


def test_the_order_of_views_does_not_matter() -> None:
    """Views in another order give the same target, camera and poses."""
    rng = np.random.default_rng(6)
    seen = photos(printed(solid(), random_shape(solid(), rng, ring_mm=RINGS)), rng, 12)
    order = rng.permutation(seen.view_count)
    place = np.argsort(order)[seen.view]
    rows = np.argsort(place, kind="stable")
    turned = replace(keep_sightings(seen, rows), view=place[rows])
    one, other = measure([seen], solid(), "opencv"), measure([turned], solid(), "opencv")
    sigma = np.sqrt(np.diagonal(one.motion_covariance)).reshape(-1, 6)
    assert (np.abs(one.motion - other.motion) < 1e-3 * sigma).all()
    assert np.abs(one.target.center_mm - other.target.center_mm).max() < 1e-6
    assert one.poses[0][order] == pytest.approx(other.poses[0], abs=1e-5)


def test_where_the_target_stands_in_its_frame_does_not_matter() -> None:
    """With the nominal target turned and shifted in its frame, the measured one is turned and shifted with it."""
    rng = np.random.default_rng(7)
    seen = photos(printed(solid(), random_shape(solid(), rng, strain=0.0)), rng, 12)
    turn = np.linalg.qr(rng.standard_normal((3, 3)))[0]
    turn *= np.linalg.det(turn)
    change = make_pose(turn, np.array([20.0, -10.0, 5.0]))
    other = replace(
        solid(), center_mm=transform(change, solid().center_mm), target_from_face=change @ solid().target_from_face
    )
    rigid = AsBuiltOptions(ring_sigma_mm=None, affine=False)
    one, two = measure([seen], solid(), "opencv", rigid), measure([seen], other, "opencv", rigid)
    determined = one.is_determined
    expected = transform(change, one.target.center_mm)
    assert np.abs(two.target.center_mm - expected)[determined[solid().ring_face]].max() < 1e-6
    assert two.poses[0] == pytest.approx(compose(one.poses[0], invert(change)), abs=1e-4)


def test_two_cameras_measure_one_print() -> None:
    """Sets of two different cameras combine: both come out, and the print is known better than from either."""
    rng = np.random.default_rng(8)
    shape = random_shape(solid(), rng)
    print_ = printed(solid(), shape)
    small = Camera("opencv", np.array([1500.0, 1495, 800, 590, 0.05, -0.02, 1e-4, 2e-4, 0.0]), (1600, 1200))
    sets = [photos(print_, rng, 12), photos(print_, rng, 14, camera=small)]
    both = measure(sets, solid(), "opencv", RIGID)
    single = measure(sets[:1], solid(), "opencv", RIGID)
    assert (both.cameras[0].image_size, both.cameras[1].image_size) == (SIZE, (1600, 1200))
    pairs = zip(both.cameras, (CAMERAS["opencv"], small), both.param_covariance, strict=True)
    for camera, true_camera, covariance in pairs:
        off = camera.params - true_camera.params
        assert off @ np.linalg.solve(covariance, off) < 30  # nine parameters: one in 2000 beyond
    determined = single.is_determined
    sigma = [np.sqrt(np.diagonal(one.motion_covariance)).reshape(-1, 6)[determined] for one in (both, single)]
    assert np.median(sigma[0] / sigma[1]) < 0.9
    true = truth_of(both, shape, RIGID)
    squares = mahalanobis(both.motion - true.shape.motion, blocks_of(both.motion_covariance))[both.is_determined]
    assert squares.mean() == pytest.approx(6.0, rel=0.5)


def two_sides(seen: Observations, target: TargetGeometry) -> tuple[Observations, Flags]:
    """Photos of which each shows faces of one side only, and which faces are of the upper one."""
    upper = target.target_from_face[:, 2, 3] > 0
    is_upper = upper[target.ring_face][seen.point]
    above, below = (np.bincount(seen.view, side, seen.view_count) for side in (is_upper, ~is_upper))
    kept = keep_sightings(seen, is_upper == (above >= below)[seen.view])
    return keep_views(kept, np.bincount(kept.view, minlength=seen.view_count) >= 20), upper


def test_groups_of_faces_that_no_view_joins_are_not_determined() -> None:
    """Where no view shows faces of both sides, one side is said to be unknown, with a wide covariance."""
    rng = np.random.default_rng(9)
    shape = random_shape(solid(), rng)
    seen, upper = two_sides(photos(printed(solid(), shape), rng, 24), solid())
    found = measure([seen], solid(), "opencv", WIDE)
    known = found.is_determined
    assert known.any()
    assert set(upper[known].tolist()) in ({True}, {False})
    (remark,) = (line for line in found.remarks if "no view joins" in line)
    lost = np.flatnonzero((upper != upper[known][0]) & (found.face_views > 0))
    assert all(str(face) in remark for face in lost.tolist())
    shift = np.sqrt(np.einsum("fii->fi", found.target.face_covariance[:, 3:, 3:]))
    assert shift[lost].min() > 0.5  # mm
    assert shift[known].max() < 0.02
    true = truth_of(found, shape, RIGID)
    squares = mahalanobis(frame_errors(found.target, true.target), found.target.face_covariance)
    assert squares[known].mean() == pytest.approx(6.0, rel=0.6)


def test_a_face_that_no_view_shows_stays_as_designed() -> None:
    """Its covariance is what was expected of it, here by a person, and a remark names it."""
    rng = np.random.default_rng(10)
    seen = photos(printed(solid(), random_shape(solid(), rng)), rng, 14, half_angle_deg=60.0)
    found = measure([seen], solid(), "opencv", WIDE)
    hidden = np.flatnonzero(found.face_views == 0)
    assert len(hidden)
    assert not found.is_determined[hidden].any()
    assert any("kept as designed" in line and f" {hidden[0]}" in line for line in found.remarks)
    assert np.abs(found.motion[hidden]).max() < 1e-3 * 0.1  # but for the datum, which is of what was seen
    assert np.sqrt(found.target.face_covariance[hidden, 0, 0]) == pytest.approx(0.1, rel=0.01)


@pytest.mark.parametrize("preset", ["fdm-dual", "hand-stickers", "fdm-board"])
def test_prints_with_the_errors_of_the_presets_come_out(preset: str) -> None:
    """Of what making it does to a target, little more is left than noise, whichever way the axes are skewed."""
    rng = np.random.default_rng(12)
    target = plate() if preset == "fdm-board" else solid()
    print_ = perturb(target, error_model(preset), rng)
    angle = 50.0 if target is plate() else 150.0
    found = measure([photos(print_, rng, 30, half_angle_deg=angle)], target, "opencv")
    plain = relative_error(replace(found, target=target), print_)
    assert relative_error(found, print_) < min(0.06, 0.25 * plain)
    assert found.scale == pytest.approx(NOISE_PX, rel=0.05)


def test_the_spread_of_the_rings_is_found() -> None:
    """Rings that are off by more than was expected in their plane, and by less normal to it, are told."""
    rng = np.random.default_rng(13)
    print_ = printed(solid(), random_shape(solid(), rng, ring_mm=(0.12, 0.004)))
    found = measure([photos(print_, rng, 30)], solid(), "opencv", AsBuiltOptions(ring_sigma_mm=RINGS))
    assert found.ring_sigma_mm[0] == pytest.approx(0.12, rel=0.15)
    assert found.ring_sigma_mm[1] == pytest.approx(0.004, rel=0.4)


def test_outliers_are_left_out_if_asked_for() -> None:
    """Wrong observations are told, and with a limit do not move the target."""
    rng = np.random.default_rng(14)
    clean = photos(printed(solid(), random_shape(solid(), rng, turn_rad=1e-3, shift_mm=0.05)), rng, 16)
    center = np.array(clean.center_px)
    wrong = rng.choice(len(center), 12, replace=False)
    center[wrong] += rng.uniform(3, 8, (12, 2))
    dirty = replace(clean, center_px=center)
    spoilt = measure([dirty], solid(), "opencv", RIGID)
    assert any("robust standard deviations" in remark for remark in spoilt.remarks)
    options = replace(RIGID, solve=SolveOptions(reject_sigma=6.0))
    found, best = measure([dirty], solid(), "opencv", options), measure([clean], solid(), "opencv", RIGID)
    assert set(np.flatnonzero(found.is_outlier[0]).tolist()) == set(wrong.tolist())
    sigma = np.sqrt(np.diagonal(best.motion_covariance)).reshape(-1, 6)
    known = best.is_determined
    assert (np.abs(found.motion - best.motion)[known] < 1.5 * sigma[known]).all()
    assert found.scale == pytest.approx(NOISE_PX, rel=0.06)


def test_known_accuracies_count() -> None:
    """Weighted by their covariances, observations give a scale of one and the truth within its covariance."""
    rng = np.random.default_rng(15)
    shape = random_shape(solid(), rng)
    exact = photos(printed(solid(), shape), rng, 16, noise_px=0.0)
    covariance = random_covariances(len(exact.view), rng)
    noise = (np.linalg.cholesky(covariance) @ rng.standard_normal((len(exact.view), 2, 1)))[:, :, 0]
    seen = replace(exact, center_px=exact.center_px + noise, cov_px2=covariance)
    weighted = measure([seen], solid(), "opencv", replace(RIGID, solve=SolveOptions(weighted=True)))
    plain = measure([seen], solid(), "opencv", replace(RIGID, solve=AS_THE_PAPER))
    assert weighted.scale == pytest.approx(1.0, rel=0.04)
    true, known = truth_of(weighted, shape, RIGID), weighted.is_determined
    squares = mahalanobis(weighted.motion - true.shape.motion, blocks_of(weighted.motion_covariance))[known]
    assert squares.mean() == pytest.approx(6.0, rel=0.5)
    assert np.trace(weighted.motion_covariance) < 0.6 * np.trace(plain.motion_covariance)


def test_few_photos_are_refused_or_said() -> None:
    """One photo of a solid tells no face; no photos and those of another target are refused."""
    rng = np.random.default_rng(16)
    one = measure([photos(solid(), rng, 1)], solid(), "opencv", RIGID)
    assert one.status == "degenerate"
    assert not one.is_determined.any()
    with pytest.raises(ValueError, match="target's own rings"):
        measure([], solid(), "opencv")
    with pytest.raises(ValueError, match="target's own rings"):
        measure([photos(plate(), rng, 3, half_angle_deg=40.0)], solid(), "opencv")
