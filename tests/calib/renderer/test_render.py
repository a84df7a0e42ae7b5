"""Synthetic photos: light, truth and effects of one view."""

from dataclasses import replace

import numpy as np
import pytest

from calib.cameras import project
from calib.cameras.camera import Camera
from calib.core.se3 import compose, look_at, transform
from calib.renderer import RenderOptions, View, render_view
from calib.renderer.light import psf_weights
from designer.base.arrays import Array
from designer.marks.chessboard import Chessboard
from designer.target import TargetGeometry, target_of_marks
from tests.support.render_oracle import SILHOUETTE, board, ico, render_slowly

FLAT = RenderOptions(bits=32)


def camera(focal_px: float, side_px: int, model: str = "opencv", *lens: float) -> Camera:
    """A square camera whose principal point is not in the middle."""
    middle = [side_px / 2 + 0.21, side_px / 2 - 0.34]
    return Camera(model, np.array([focal_px, focal_px, *middle, *(lens or (0.0,) * 5)]), (side_px, side_px))


def pose(x_mm: float, y_mm: float, z_mm: float, roll_rad: float = 0.4) -> Array:
    """A camera that looks at the target's origin."""
    return look_at(np.array([x_mm, y_mm, z_mm]), np.zeros(3), roll_rad)


def render(target: TargetGeometry, cam: Camera, where: Array, options: RenderOptions = FLAT, seed: int = 0) -> View:
    """A view from a seed."""
    return render_view(target, cam, where, options, np.random.default_rng(seed))


def supersampled(target: TargetGeometry, cam: Camera, where: Array, levels: RenderOptions, samples: int) -> Array:
    """The mean of a regular grid of rays a pixel, each one black or white, from the one-ray renderer."""
    params = cam.params.copy()
    params[:2] *= samples
    params[2:4] = samples * (params[2:4] + 0.5) - 0.5
    width, height = cam.image_size
    fine = Camera(cam.model, params, (width * samples, height * samples))
    binary = replace(levels, sampling="binary", background=0.0)
    image = render(target, fine, where, binary).image
    return image.reshape(height, samples, width, samples).mean(axis=(1, 3), dtype=np.float64)


CHESSBOARD = target_of_marks([Chessboard((5, 4), 7.0)], np.eye(4)[None], 2.0)
CASES = {
    "tilted small rings, inner radius 2 px and less": (board(3), camera(165.0, 44), pose(0, 66, 40)),
    "steep": (board(3), camera(205.0, 44), pose(8, 88, 24)),
    "barrel": (board(3), camera(70.0, 44, "opencv", -0.3, 0.1, 0.001, -0.001, -0.01), pose(14, 12, 42)),
    "backward distortion": (board(3), camera(70.0, 44, "luhmann", -0.2, 0.05, 0.01, 0.001, -0.002), pose(14, 12, 42)),
}

CORNER_CASES = {
    "tilted": (camera(165.0, 44), pose(0, 66, 40)),
    "small squares": (camera(30.0, 44), pose(10, 6, 40)),
    "steep": (camera(205.0, 44), pose(8, 88, 24)),
    "barrel": (camera(70.0, 44, "opencv", -0.3, 0.1, 0.001, -0.001, -0.01), pose(14, 12, 42)),
}


@pytest.mark.parametrize("case", CORNER_CASES)
def test_area_sampling_of_polygons_is_exact(case: str) -> None:
    """Against 110 x 110 rays a pixel, which a plain renderer confirms: light within 0.003 of the contrast."""
    cam, where = CORNER_CASES[case]
    levels = replace(FLAT, black=0.0, white=1.0, background=0.0)
    error = render(CHESSBOARD, cam, where, levels).image - supersampled(CHESSBOARD, cam, where, levels, 110)
    assert np.abs(error).max() < 0.003


@pytest.mark.parametrize("case", CASES)
def test_area_sampling_is_exact(case: str) -> None:
    """Against 110 x 110 rays a pixel: light within 0.002 of the contrast, ring centres within 0.001 px."""
    target, cam, where = CASES[case]
    levels = replace(FLAT, black=0.0, white=1.0, background=0.0)
    view, truth = render(target, cam, where, levels), supersampled(target, cam, where, levels, 110)
    error = view.image - truth
    assert np.abs(error).max() < 0.002
    v, u = np.mgrid[: cam.image_size[1], : cam.image_size[0]]
    distance = np.hypot(u - view.center_px[:, 0, None, None], v - view.center_px[:, 1, None, None])
    rows = np.flatnonzero(view.clean)
    assert len(rows) >= 3
    for row in rows:
        own = (np.argmin(distance, axis=0) == row) & (distance[row] < 4 * view.minor_radius_px[row] + 2)
        ink = (1 - truth)[own].sum()
        for place in (u, v):
            assert abs((error[own] * (place[own] - view.center_px[row][0 if place is u else 1])).sum()) < 0.001 * ink


@pytest.mark.parametrize("target", [board(3), CHESSBOARD])
def test_binary_sampling_is_one_ray_through_each_centre(target: TargetGeometry) -> None:
    """Binary photos are black or white as the plain NumPy renderer is at pixel centres."""
    cam, where = camera(110.0, 40), pose(20, 25, 45)

    class Centres(np.random.Generator):
        def uniform(self, *args: object, size: tuple[int, ...]) -> Array:  # type: ignore[override]
            return np.full(size, 0.5)

    centre_rays = Centres(np.random.PCG64(0))
    expected = render_slowly(target, cam, where, (0.0, 1.0, 0.0), 1, centre_rays)
    image = render(target, cam, where, RenderOptions(sampling="binary")).image
    assert np.array_equal(image, 255 * expected)


def test_truth_is_where_the_rings_are() -> None:
    """Each clean ring's darkness, weighed by its place, has the foreshortened circle's centroid near the truth."""
    target, cam = board(4), camera(900.0, 400)
    where = pose(0, 0, 100, 0.3)
    view = render(target, cam, where, replace(FLAT, black=0.0, white=1.0))
    assert view.clean.all()
    v, u = np.mgrid[:400, :400]
    for row in range(target.ring_count):
        own = np.hypot(u - view.center_px[row, 0], v - view.center_px[row, 1]) < 40
        ink = 1 - view.image[own]
        assert abs((ink * u[own]).sum() / ink.sum() - view.center_px[row, 0]) < 1e-3
        assert abs((ink * v[own]).sum() / ink.sum() - view.center_px[row, 1]) < 1e-3
    radius = 900 * 3.5 / 100
    assert np.allclose(view.minor_radius_px, radius, rtol=1e-6)


def test_incidence_and_foreshortening() -> None:
    """Seen from afar at 60 degrees, incidence is 60 degrees and the minor radius half the major one."""
    target, cam = board(3), camera(9000.0, 400)
    where = pose(0, 1000 * np.sin(np.pi / 3), 1000 * np.cos(np.pi / 3))
    view = render(target, cam, where)
    assert np.allclose(np.degrees(view.incidence_rad), 60, atol=1.5)
    assert np.allclose(view.minor_radius_px, 9 * 3.5 / 2, rtol=0.04)


def test_the_rings_in_use_are_the_targets_own() -> None:
    """A ring that was moved, shrunk or raised in the target file is drawn there: the image follows its projection."""
    nominal, cam, where = board(4), camera(900.0, 400), pose(30, 60, 70)
    center = nominal.center_mm.copy()
    center[5] += [0.4, -0.3, 0.0]
    center[6] += [0.0, 0.0, 0.8]
    moved = replace(nominal, source="perturbed", center_mm=center)
    view, before = render(moved, cam, where), render(nominal, cam, where)
    v, u = np.mgrid[:400, :400]
    for row, step in ((5, [0.4, -0.3, 0.0]), (6, [0.0, 0.0, 0.8])):
        shift = project(cam, transform(where, center[row])) - project(cam, transform(where, nominal.center_mm[row]))
        assert np.hypot(*shift) > 2, step
        own = np.hypot(u - before.center_px[row, 0], v - before.center_px[row, 1]) < 38
        seen = []
        for image in (before.image, view.image):
            ink = (image[own] < 0.45) * (0.8 - image[own])
            seen.append([(ink * u[own]).sum() / ink.sum(), (ink * v[own]).sum() / ink.sum()])
        assert np.allclose(np.subtract(seen[1], seen[0]), shift, atol=0.15)


def test_a_board_is_plain_from_behind() -> None:
    """From behind, a board is an even white plate, and no ring is visible."""
    view = render(board(3), camera(300.0, 120), pose(10, 20, -80))
    assert not view.visible.any()
    assert np.allclose(view.image[55:65, 55:65], 0.8)
    assert view.image.min() > 0.39


def test_faces_of_an_icosahedron_close() -> None:
    """No background shows through the edges between faces, and back faces stay hidden."""
    target, cam = ico(), camera(500.0, 300)
    view = render(target, cam, pose(200, 250, 250), SILHOUETTE)
    share = view.image[100:200, 100:200]
    assert share.min() > 0.8999
    assert len(np.unique(target.ring_face[view.visible])) < 11


def test_rotating_target_and_camera_together_changes_nothing() -> None:
    """Only the pose of the target in the camera frame counts."""
    target, cam = board(3), camera(300.0, 120)
    turn = pose(0, 0, 0.001, 0.0)
    turn[:3, 3] = [5, -3, 20]
    frames = compose(turn, target.target_from_face)
    turned = replace(target, source="perturbed", target_from_face=frames, center_mm=transform(turn, target.center_mm))
    where = pose(20, 30, 90)
    back = compose(where, np.linalg.inv(turn))
    assert np.abs(render(target, cam, where).image - render(turned, cam, back).image).max() < 1e-5


@pytest.mark.parametrize("sigma", [0.1, 0.3, 0.5, 0.7, 1.0, 2.5])
def test_point_spread_has_its_variance(sigma: float) -> None:
    """The blur kernel sums to one, is symmetric, and its standard deviation is the one asked for."""
    weights = psf_weights(sigma)
    offset = np.arange(len(weights)) - len(weights) // 2
    assert abs(weights.sum() - 1) < 1e-12
    assert np.array_equal(weights, weights[::-1])
    assert abs(np.sqrt(weights @ offset**2) - sigma) < 1e-6


def test_blur_moves_no_centre() -> None:
    """Blur leaves the centroid of every ring where it was."""
    target, cam, where = board(3), camera(700.0, 300), pose(0, 0, 100)
    sharp, soft = (render(target, cam, where, replace(FLAT, blur_px=sigma)) for sigma in (0.0, 1.5))
    v, u = np.mgrid[:300, :300]
    for center in sharp.center_px:
        own = np.hypot(u - center[0], v - center[1]) < 31
        places = [((0.8 - i[own]) * u[own]).sum() / (0.8 - i[own]).sum() for i in (sharp.image, soft.image)]
        assert abs(places[1] - places[0]) < 1e-3


def test_defocus_grows_away_from_the_focus() -> None:
    """What lies at the focus stays sharp, what lies farther away is blurred more, as the thin lens says."""
    target, cam, where = board(6), camera(700.0, 400), pose(0, 80, 60, 0.0)
    depth = transform(where, target.center_mm)[:, 2]
    near = int(np.argmin(depth))
    sharp = render(target, cam, where)
    soft = render(target, cam, where, replace(FLAT, aperture_mm=6.0, focus_mm=float(depth[near])))
    v, u = np.mgrid[:400, :400]
    loss = []
    for center in sharp.center_px:
        own = np.hypot(u - center[0], v - center[1]) < 8
        loss.append(np.abs(soft.image - sharp.image)[own].mean())
    assert loss[near] < 0.02
    assert np.corrcoef(loss, depth - depth[near])[0, 1] > 0.8


def test_noise_has_its_size() -> None:
    """Contrast-to-noise and full well set the standard deviation: even, and growing with the root of the light."""
    target, cam, where = board(3), camera(300.0, 300), pose(0, 0, 300)
    clean = render(target, cam, where).image
    even = render(target, cam, where, replace(FLAT, contrast_to_noise=35.0)).image - clean
    assert abs(even.std() / (0.7 / 35) - 1) < 0.01
    shot = render(target, cam, where, replace(FLAT, full_well=900.0)).image - clean
    for light in (0.4, 0.8):
        assert abs(shot[np.abs(clean - light) < 1e-6].std() / np.sqrt(light / 900) - 1) < 0.05


def test_levels_bits_and_gamma() -> None:
    """8 and 16 bits round the same light, and the tone curve bends it."""
    target, cam, where = board(3), camera(300.0, 200), pose(10, 10, 100)
    light = render(target, cam, where).image
    for bits, top in ((8, 255), (16, 65535)):
        image = render(target, cam, where, replace(FLAT, bits=bits)).image
        assert np.array_equal(image, np.rint(light * top))
    curved = render(target, cam, where, replace(FLAT, bits=16, gamma=2.2)).image
    assert np.abs(curved / 65535 - light ** (1 / 2.2)).max() < 1e-4


def test_light_gradient_spans_the_target() -> None:
    """A gradient of 40 % takes the white from 20 % above to 20 % below its mean across the target, and no farther."""
    target, cam = board(4, border="0mm"), camera(800.0, 400)
    even = render(target, cam, pose(0, 0, 100)).image
    ratio = render(target, cam, pose(0, 0, 100), replace(FLAT, light_gradient=0.4)).image / even
    assert 0.8 - 1e-6 <= ratio.min() < 0.83
    assert 1.17 < ratio.max() <= 1.2 + 1e-6


def test_vignetting_darkens_the_corners() -> None:
    """The corner pixel loses the share asked for, the middle nothing."""
    target, cam = board(3), camera(300.0, 201)
    even, dark = (render(target, cam, pose(0, 0, 300), replace(FLAT, vignetting=x)).image for x in (0.0, 0.5))
    ratio = dark / even
    assert abs(ratio[0, 0] - 0.5) < 1e-5
    assert abs(ratio[100, 100] - 1) < 1e-5


def test_shading_depends_on_the_face() -> None:
    """With shading, each face keeps one factor for ink and white, faces differ, and none is lighter than before."""
    target, cam, where = ico(), camera(700.0, 400), pose(200, 250, 250)
    even, view = render(target, cam, where).image, render(target, cam, where, replace(FLAT, shading=0.8))
    ratio = view.image / even
    factors = []
    for face in np.unique(target.ring_face[view.visible & (view.incidence_rad < 1.2)]):
        centers = view.center_px[view.visible & (target.ring_face == face)]
        u, v = np.rint(centers).astype(int).T
        assert np.ptp(ratio[v, u]) < 1e-5
        factors.append(ratio[v, u].mean())
    assert max(factors) <= 1 + 1e-6
    assert np.ptp(factors) > 0.1


def test_glare_washes_rings_out_and_the_truth_says_so() -> None:
    """Some visible rings are saturated by glare and not clean; clean ones keep their contrast."""
    target, cam, where = ico(), camera(700.0, 400), pose(200, 250, 250)
    even = render(target, cam, where)
    for seed in range(2):
        view = render(target, cam, where, replace(FLAT, glare=1.0), seed)
        hit = even.clean & ~view.clean
        assert hit.any()
        assert view.clean.sum() > 100
        u, v = np.rint(view.center_px).astype(int).T
        assert (view.image[v[view.clean], u[view.clean]] <= 1.001).all()
        assert (view.image >= even.image - 1e-6).all()


def test_clutter_stays_behind_the_target() -> None:
    """Clutter changes the background and not one pixel of the target."""
    target, cam, where = ico(), camera(500.0, 400), pose(200, 250, 250)
    even, view = render(target, cam, where), render(target, cam, where, replace(FLAT, clutter=60))
    covered = render(target, cam, where, SILHOUETTE).image > 0.8999
    changed = np.abs(even.image - view.image) > 0.01
    assert not changed[covered].any()
    assert changed[~covered].mean() > 0.1
    assert np.array_equal(view.clean, even.clean)


@pytest.mark.parametrize("hidden", [0.1, 0.3])
def test_occluders_hide_their_share(hidden: float) -> None:
    """The share of the silhouette that is hidden is the one asked for; clean rings are untouched, others are not."""
    target, cam, where = ico(), camera(700.0, 500), pose(200, 250, 250)
    even = render(target, cam, where)
    covered = render(target, cam, where, SILHOUETTE).image > 0.5
    v, u = np.mgrid[:500, :500]
    for seed in range(2):
        view = render(target, cam, where, replace(FLAT, occlusion=hidden), seed)
        changed = np.abs(view.image - even.image) > 1e-6
        share = changed[covered].mean()
        assert hidden - 0.07 < share < hidden + 0.03  # a shape may be as light as what it hides
        for row in np.flatnonzero(view.clean & (view.incidence_rad < 0.5)):
            own = np.hypot(u - view.center_px[row, 0], v - view.center_px[row, 1]) < 0.8 * view.minor_radius_px[row]
            assert not changed[own].any()
        assert (even.clean & ~view.clean).any()


def test_clean_rings_lie_inside_the_image() -> None:
    """Rings cut by the image's edge are visible while their centre is inside, and never clean."""
    target, cam = board(10), camera(900.0, 300)
    view = render(target, cam, pose(0, 0, 100))
    assert view.visible.sum() > view.clean.sum() > 0
    radius = 900 * 3.5 / 100
    clean = view.center_px[view.clean]
    assert (clean > radius + 1.9).all()
    assert (clean < 299 - radius - 1.9).all()


def test_the_seed_decides_all() -> None:
    """The same seed gives the same bytes, another one does not, and one effect's draw does not change another's."""
    target, cam, where = board(3), camera(300.0, 200), pose(10, 10, 100)
    busy = RenderOptions(clutter=20, occlusion=0.2, contrast_to_noise=30, glare=0.5, light_gradient=0.3)
    first, again, other = (render(target, cam, where, busy, seed).image for seed in (1, 1, 2))
    assert np.array_equal(first, again)
    assert not np.array_equal(first, other)
    quiet = replace(FLAT, occlusion=0.2)
    with_clutter = render(target, cam, where, replace(quiet, clutter=20), 1)
    assert np.array_equal(with_clutter.clean, render(target, cam, where, quiet, 1).clean)
