"""Straightening lenses: exact inverses, true local forms, and an estimate that neither misses nor invents a lens."""

from collections.abc import Callable

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from calib.cameras import project
from calib.cameras.camera import camera_or_preset
from calib.core import homography
from calib.detector.lens import CameraLens, Lens, NoLens, RadialLens, local_form, radial_lens, usable_groups
from designer.base.arrays import Array
from tests.support.ring_images import Ring

SIZE = (1000, 800)
MIDDLE = (499.5, 399.5)
HALF_DIAGONAL = 0.5 * float(np.hypot(*SIZE))


def lens_of(groups: list[tuple[Array, Array]], image_size: tuple[int, int]) -> Lens:
    """The radial lens of planes' grids."""
    return radial_lens(usable_groups(groups), image_size)[0]


def lens(k1: float, k2: float) -> RadialLens:
    """A lens for images of SIZE."""
    return RadialLens(k1, k2, MIDDLE, HALF_DIAGONAL)


def wide_webcam() -> CameraLens:
    """The lens of a preset."""
    return CameraLens(camera_or_preset("wide-webcam"))


def pixels(count: int, seed: int = 1) -> Array:
    """Places all over the image."""
    return np.random.default_rng(seed).uniform((0, 0), np.array(SIZE) - 1, (count, 2))


@settings(max_examples=40, deadline=None, derandomize=True)
@given(k1=st.floats(-0.25, 0.6), k2=st.floats(-0.02, 0.3))
def test_distort_is_the_inverse_of_straighten(k1: float, k2: float) -> None:
    """There and back is the same pixel wherever the radius grows, the middle included."""
    one = lens(k1, k2)
    place = np.vstack([pixels(50), [MIDDLE]])
    assert one.distort(one.straighten(place)) == pytest.approx(place, abs=1e-6)
    # Only radii move, and by the polynomial.
    radius = np.linalg.norm(place - MIDDLE, axis=1) / HALF_DIAGONAL
    moved = np.linalg.norm(one.straighten(place) - MIDDLE, axis=1) / HALF_DIAGONAL
    assert moved == pytest.approx(radius * (1 + k1 * radius**2 + k2 * radius**4), abs=1e-9)


def test_camera_lens_straightens_to_the_rays() -> None:
    """A known camera's pixels go to its rays times one scale, and back; the scale is 1 in the image's middle."""
    camera = camera_or_preset("wide-webcam")
    one = CameraLens(camera)
    place = np.random.default_rng(2).uniform((5, 5), (1018, 762), (60, 2))
    straight = one.straighten(place)
    assert one.distort(straight) == pytest.approx(place, abs=1e-5)
    middle = np.array([[512.0, 384.0], [513.0, 384.0], [512.0, 385.0]])
    assert np.linalg.norm(np.diff(one.straighten(middle[:2]), axis=0)) == pytest.approx(1, rel=0.01)
    point = np.array([[0.3, -0.2, 1.0], [0.1, 0.3, 1.0], [-0.5, 0.35, 1.0]])
    line = point[0] + np.linspace(0, 1, 7)[:, None] * (point[1] - point[0])
    bent = one.straighten(project(camera, line))
    direction = bent[-1] - bent[0]
    across = np.array([-direction[1], direction[0]]) / np.linalg.norm(direction)
    assert (bent - bent[0]) @ across == pytest.approx(np.zeros(7), abs=1e-4)


@pytest.mark.parametrize("made", [lambda: lens(0.4, 0.1), lambda: lens(-0.15, 0.02), wide_webcam])
def test_local_form_is_the_second_order_series(made: Callable[[], Lens]) -> None:
    """straight(u + v) = straight(u) + J (v + q(v)): what is left over is of third order."""
    one = made()
    place = np.random.default_rng(3).uniform((60, 60), (940, 740), (20, 2))
    jacobian, bend = local_form(one, place)
    worst = []
    for size in (10.0, 20.0):
        left = []
        for angle in np.arange(0, 6.28, 0.6):
            v = size * np.array([np.cos(angle), np.sin(angle)])
            square = np.array([v[0] ** 2, v[0] * v[1], v[1] ** 2])
            series = v + np.stack([bend[:, :3] @ square, bend[:, 3:] @ square], axis=1)
            exact = one.straighten(place + v) - one.straighten(place)
            left.append(np.abs(exact - np.einsum("nij,nj->ni", jacobian, series)).max())
        worst.append(max(left))
    assert worst[1] < 0.1
    assert worst[0] < worst[1] / 5


def test_no_lens_is_no_lens() -> None:
    """Without a lens nothing moves, J is 1 and q is 0."""
    place = pixels(5)
    jacobian, bend = local_form(NoLens(), place)
    assert np.array_equal(NoLens().straighten(place), place)
    assert np.array_equal(NoLens().distort(place), place)
    assert np.array_equal(jacobian, np.tile(np.eye(2), (5, 1, 1)))
    assert not bend.any()


@pytest.mark.filterwarnings("error")
def test_where_a_lens_runs_away_there_is_no_local_form() -> None:
    """Far outside the image, where the map overflows or is flat, nothing is raised, and other places keep theirs."""
    one = lens(-0.2, 0.05)
    place = np.array([[300.0, 200.0], [1e180, 3.0], [np.nan, 1.0], [np.inf, 2.0]])
    jacobian, bend = local_form(one, place)
    alone = local_form(one, place[:1])
    assert np.array_equal(jacobian[0], alone[0][0])
    assert np.array_equal(bend[0], alone[1][0])
    assert not np.isfinite(jacobian[1:]).all(axis=(1, 2)).any()


def grids(one: Lens, noise_px: float, rng: np.random.Generator, planes: int = 1) -> list[tuple[Array, Array]]:
    """Grids of 11 x 9 points on tilted planes that fill the image, seen through a lens."""
    out = []
    for _ in range(planes):
        plane = np.stack(np.meshgrid(np.arange(-5.0, 6), np.arange(-4.0, 5)), axis=-1).reshape(-1, 2)
        ring = Ring(radius_px=75.0, tilt_rad=rng.uniform(0.2, 0.5), axis_rad=rng.uniform(0, 6.28), focal_px=1200.0)
        move = np.array([[1, 0, MIDDLE[0]], [0, 1, MIDDLE[1]], [0, 0, 1.0]])
        straight = homography.apply(move @ np.linalg.inv(_to(ring)) @ ring.plane(), plane)
        out.append((25.0 * plane, one.distort(straight) + rng.normal(0, noise_px, straight.shape)))
    return out


def _to(ring: Ring) -> Array:
    """The move of the picture's middle."""
    middle = ring.side_px // 2
    return np.array([[1, 0, middle], [0, 1, middle], [0, 0, 1.0]])


@pytest.mark.parametrize(("k1", "k2"), [(0.3, 0.1), (0.12, -0.03), (-0.08, 0.0)])
@pytest.mark.parametrize("planes", [1, 3])
def test_estimate_finds_the_lens(k1: float, k2: float, planes: int) -> None:
    """From grids with some noise the lens comes out: straightened pixels are right to a fraction of the noise."""
    rng = np.random.default_rng(4)
    true = lens(k1, k2)
    exact = lens_of(grids(true, 0.0, rng, planes), SIZE)
    assert isinstance(exact, RadialLens)
    assert (exact.k1, exact.k2) == pytest.approx((k1, k2), abs=1e-4)
    assert exact.middle_px == pytest.approx(MIDDLE)
    noisy = grids(true, 0.05, rng, planes)
    found = lens_of(noisy, SIZE)
    # Compared through the points: straight images may differ by a homography.
    for plane, pixel in noisy:
        _, _, residual = homography.fit(plane, found.straighten(pixel), np.ones(len(plane)))
        assert np.sqrt((residual**2).mean()) < 0.05 * 1.4


def test_estimate_survives_wrong_points() -> None:
    """A few points far off do not spoil the lens."""
    rng = np.random.default_rng(5)
    true = lens(0.3, 0.1)
    (plane, pixel), *_ = grids(true, 0.02, rng)
    pixel = pixel.copy()
    pixel[[7, 40, 77]] += (9.0, -7.0)
    found = lens_of([(plane, pixel)], SIZE)
    place = pixels(30)
    assert isinstance(found, RadialLens)
    assert np.abs(found.straighten(place) - true.straighten(place)).max() < 3


@pytest.mark.parametrize("noise_px", [0.01, 0.1, 1.0])
def test_no_lens_is_invented_from_noise(noise_px: float) -> None:
    """Pinhole images keep their lines: in 20 noisy grids no lens is believed."""
    rng = np.random.default_rng(6)
    for _ in range(20):
        assert isinstance(lens_of(grids(NoLens(), noise_px, rng), SIZE), NoLens)


def test_too_few_points_give_no_lens() -> None:
    """Below twenty points nothing is estimated, whatever they show; nor from nothing."""
    plane, pixel = grids(lens(0.3, 0.1), 0.0, np.random.default_rng(7))[0]
    assert isinstance(lens_of([(plane[:19], pixel[:19])], SIZE), NoLens)
    assert isinstance(lens_of([], SIZE), NoLens)
    assert isinstance(lens_of([(plane[:4], pixel[:4])] * 10, SIZE), NoLens)


def test_a_row_of_points_changes_no_lens() -> None:
    """A group on one line has no homography to bend: the lens is that of the other groups."""
    groups = grids(lens(0.3, 0.1), 0.05, np.random.default_rng(7))
    row = np.column_stack([np.arange(8.0), np.zeros(8)])
    found = lens_of(groups, SIZE)
    assert not isinstance(found, NoLens)
    assert lens_of([*groups, (row, pixels(8))], SIZE) == found


def test_a_lens_that_folds_is_not_believed() -> None:
    """Points on a bent sheet can ask for a lens that turns back inside the image: it is refused."""
    rng = np.random.default_rng(8)
    plane, pixel = grids(NoLens(), 0.02, rng)[0]
    offset = (pixel - MIDDLE) / HALF_DIAGONAL
    r2 = (offset**2).sum(axis=1, keepdims=True)
    # Pixels pushed outward as no lens with a growing radius could: straight radius = r - 0.6 r^3 folds at 0.75.
    bent = np.array(MIDDLE) + HALF_DIAGONAL * offset * (1 + 0.6 * r2 + 1.5 * r2**2)
    found = lens_of([(plane, bent)], SIZE)
    radius = np.linspace(0, 1, 50)[:, None] * HALF_DIAGONAL * np.array([SIZE]) / np.hypot(*SIZE)
    straight = np.linalg.norm(found.straighten(radius + MIDDLE) - MIDDLE, axis=1)
    assert (np.diff(straight) > 0).all()
