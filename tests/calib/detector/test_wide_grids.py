"""Wide lenses: guessed from the grids of one photo, straight in whatever direction the target stands, and detected."""

import math
from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest

from calib.cameras import project
from calib.cameras.camera import Camera, camera_or_preset
from calib.core import homography
from calib.core.se3 import exp_rotation, make_pose, rotation_between, transform
from calib.detector import wide_guess
from calib.detector.lens import CameraLens, NoLens, RadialLens, local_form, radial_lens
from calib.detector.pipeline import detect
from calib.detector.wide_guess import guess_lens
from calib.renderer import RenderOptions, render_view
from designer.base.arrays import Array
from designer.target import TargetGeometry
from tests.support.lenses import LENSES
from tests.support.ring_views import board, ico, misplaced

FISHEYE = Camera("fisheye", np.array([240.0, 240.5, 404.0, 395.0, 0.012, -0.006, 0.0008, -0.0001]), (800, 800))
"""The image circle of 190 degrees has a radius of 397 px."""
WIDE = ("half space", "beyond the half space", "wide ellipsoid", "wide sphere", "wide division")


def at_side(off_deg: float, distance_mm: float, turn: tuple[float, float, float] = (0.3, -0.2, 0.5)) -> Array:
    """A target so far off the axis, its face towards the camera and turned from there."""
    off, around = math.radians(off_deg), 0.7
    away = np.array([math.sin(off) * math.cos(around), math.sin(off) * math.sin(around), math.cos(off)])
    to_camera = rotation_between(np.array([0.0, 0.0, 1.0]), -away)
    return make_pose(to_camera @ exp_rotation(np.array(turn)), distance_mm * away)


def seen_grid(camera: Camera, pose: Array, noise_px: float, seed: int = 0) -> tuple[Array, Array]:
    """A board's centres and their noisy pixels."""
    point = board().center_mm
    pixel = project(camera, transform(pose, point))
    shown = np.isfinite(pixel).all(axis=1)
    noise = noise_px * np.random.default_rng(seed).standard_normal(pixel.shape)
    return board().center_in_face_mm[shown, :2], (pixel + noise)[shown]


@pytest.mark.parametrize("name", WIDE)
def test_straight_lines_stay_straight_in_any_direction(name: str) -> None:
    """The image turned to a target at 75 degrees shows its rows straight, and goes back to the same pixels."""
    camera = LENSES[name]()
    lens = CameraLens(camera)
    plane, pixel = seen_grid(camera, at_side(75, 150.0), 0.0)
    facing = lens.facing(pixel)
    assert facing.is_turned
    straight = facing.straighten(pixel)
    assert facing.distort(straight) == pytest.approx(pixel, abs=1e-6)
    assert np.abs(homography.fit(plane, straight, np.ones(len(plane)))[2]).max() < 1e-6
    assert np.linalg.det(local_form(facing, pixel)[0]).min() > 0  # no mirror
    assert not facing.facing(pixel - pixel.mean(axis=0) + camera.params[2:4]).is_turned


@pytest.mark.parametrize("off_deg", [0.0, 45.0, 70.0])
@pytest.mark.parametrize("name", WIDE)
def test_one_grid_tells_a_wide_lens(name: str, off_deg: float) -> None:
    """From one photo of a plane, near the axis or at the side, with noise: its grid is straight to about the noise."""
    camera, noise_px = LENSES[name](), 0.05
    plane, pixel = seen_grid(camera, at_side(off_deg, 90.0), noise_px)
    assert len(plane) > 60
    radial, left_px = radial_lens([(plane, pixel)], camera.image_size)
    found = guess_lens([(plane, pixel)], camera.image_size)
    if left_px <= 0.15:
        assert found == radial
        return
    facing = found.facing(pixel)
    straight = facing.straighten(pixel)
    scale = np.sqrt(np.linalg.det(local_form(facing, pixel)[0]))
    residual = homography.fit(plane, straight, 1 / scale**2)[2] / scale[:, None]
    assert isinstance(found, CameraLens)
    assert np.sqrt((residual**2).mean()) < 0.13  # the focal lengths of some differ, which is not asked


@pytest.mark.parametrize("noise_px", [0.1, 0.4, 2.0])
def test_no_wide_lens_is_invented_from_noise(noise_px: float) -> None:
    """Photos without distortion, with noise above what is looked into, are not taken for a wide lens's."""
    camera = Camera("pinhole", np.array([900.0, 900.0, 399.5, 399.5]), (800, 800))
    for seed in range(12):
        groups = [seen_grid(camera, at_side(turn, 250.0), noise_px, seed) for turn in (0.0, 8.0)]
        assert isinstance(guess_lens(groups, camera.image_size), NoLens | RadialLens)


def test_a_descent_that_runs_away_leaves_the_radial_lens(monkeypatch: pytest.MonkeyPatch) -> None:
    """What ends at a camera without rays, as from the side of a bent grid, costs no photo."""
    plane, pixel = seen_grid(FISHEYE, at_side(45.0, 90.0), 0.05)
    end = SimpleNamespace(camera=replace(FISHEYE, params=FISHEYE.params * 1e-12))
    monkeypatch.setattr(wide_guess, "_descended", lambda planes, start: end)
    assert isinstance(guess_lens([(plane, pixel)], FISHEYE.image_size), NoLens | RadialLens)


def test_a_wrong_point_makes_no_wide_lens() -> None:
    """One stranger among the rings of a straight photo leaves much, but not evenly."""
    camera = Camera("pinhole", np.array([900.0, 900.0, 399.5, 399.5]), (800, 800))
    plane, pixel = seen_grid(camera, at_side(0.0, 250.0), 0.02)
    pixel[40] += (4.0, -3.0)
    assert guess_lens([(plane, pixel)], camera.image_size) == NoLens()


@pytest.mark.parametrize(
    ("target", "distance_mm", "off_deg"), [(board(), 80.0, 82.0), (ico(), 160.0, 80.0)], ids=["board", "ico"]
)
def test_rings_are_found_to_the_edge_of_a_fisheye(target: TargetGeometry, distance_mm: float, off_deg: float) -> None:
    """Of 190 degrees, with the camera unknown or known: nearly all rings, each by its name and within its sigma."""
    options = RenderOptions(black=0.1, white=0.7, background=0.35, blur_px=0.7, contrast_to_noise=50)
    view = render_view(target, FISHEYE, at_side(off_deg, distance_mm), options, np.random.default_rng(2))
    due = view.clean & (view.incidence_rad < math.radians(60)) & (view.minor_radius_px > 4)
    assert due.sum() > 20
    for camera in (None, FISHEYE):
        found = detect(view.image, target, name="wide", camera=camera)
        assert misplaced(found, view).max() < 1.5  # no wrong name; false of nan
        assert np.isin(np.flatnonzero(due), found.ring).mean() > 0.97
        mine = due[found.ring]
        error = (found.center_px - view.center_px[found.ring])[mine]
        chi_square = np.einsum("ni,nij,nj->n", error, np.linalg.inv(found.cov_px2[mine]), error)
        assert chi_square.max() < 30
        assert camera is None or chi_square.mean() / 2 < 1.7  # a face's lines err together, of a guessed lens more so


def test_templates_of_wide_cameras_are_looked_through() -> None:
    """Each wide template's straight image is as large as the photo in its middle."""
    for name in ("fisheye-190", "action-camera", "phone-ultra-wide"):
        camera = camera_or_preset(name)
        middle = 0.5 * np.array([camera.image_size]) + ((0.0, 0.0), (1.0, 0.0))
        assert np.linalg.norm(np.diff(CameraLens(camera).straighten(middle), axis=0)) == pytest.approx(1, rel=0.02)
