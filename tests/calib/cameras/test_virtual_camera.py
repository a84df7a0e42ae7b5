"""The virtual camera model: rays, images and derivatives through a learned map."""

from dataclasses import replace

import numpy as np
import pytest

from calib.cameras import linearise, project, rays
from calib.cameras.camera import Camera
from calib.cameras.learned import known_at
from tests.support.solver_scenes import SIZE
from tests.support.virtual_scenes import (
    CENTRE_PX,
    FOCAL_PX,
    fisheye_map,
    straight,
    virtual_camera,
    wavy_map,
)


@pytest.fixture(scope="module", params=["waves", "fisheye", "part of the image"])
def camera(request: pytest.FixtureRequest) -> Camera:
    """Virtual cameras behind different lenses."""
    if request.param == "waves":
        return virtual_camera(wavy_map(0.02))
    if request.param == "part of the image":
        return virtual_camera(wavy_map(0.02, span=(0.3, 0.7)))
    return virtual_camera(fisheye_map())


def pixels(count: int = 2000, seed: int = 0) -> np.ndarray:
    """Pixels all over the image and a little beyond."""
    return np.random.default_rng(seed).uniform([-3, -3], np.array(SIZE) + 2.0, (count, 2))


def test_projecting_rays_gives_the_pixels(camera: Camera) -> None:
    """project(rays(u)) is u at any distance, if u has a ray; where the map is not known both are nan."""
    pixel = pixels()
    ray = rays(camera, pixel)
    known = np.isfinite(ray).all(axis=1)
    assert 0.1 < known.mean() < 1
    assert np.isnan(ray[~known]).all()
    assert (ray[known, 2] == 1).all()
    scale = np.random.default_rng(1).uniform(0.1, 1e4, (len(ray), 1))
    back = project(camera, scale * ray)
    assert np.abs(back - pixel)[known].max() < 1e-10
    assert np.isnan(back[~known]).all()


def test_rays_of_projected_points_are_parallel(camera: Camera) -> None:
    """rays(project(x)) is parallel to x; a point has an image exactly if a known pixel's ray meets it."""
    direction = np.column_stack([np.random.default_rng(2).uniform(-1.5, 1.5, (20000, 2)), np.ones(20000)])
    pixel = project(camera, 357 * direction)
    seen = np.isfinite(pixel).all(axis=1)
    assert seen.sum() > 100
    assert np.abs(rays(camera, pixel[seen]) - direction[seen]).max() < 1e-12
    assert camera.learned is not None
    assert known_at(camera.learned, SIZE, pixel[seen]).all()


def test_rays_are_those_of_the_lens() -> None:
    """The rays behind a wavy lens are those of the pinhole that saw the plane, to what the noise allows."""
    camera = replace(virtual_camera(wavy_map(0.02)), params=np.array([FOCAL_PX, FOCAL_PX, *CENTRE_PX]))
    pixel = np.random.default_rng(3).uniform(100, np.array(SIZE) - 100, (2000, 2))
    off = FOCAL_PX * rays(camera, pixel)[:, :2] + CENTRE_PX - straight(pixel)
    assert np.sqrt((off**2).mean()) < 0.01


def test_derivatives_are_those_of_project(camera: Camera) -> None:
    """`linearise` has the pixels of `project`, and its derivatives are difference quotients of them."""
    rng = np.random.default_rng(4)
    inside = rng.uniform(0.35, 0.65, (500, 2)) * SIZE
    point = rays(camera, inside) * rng.uniform(200, 500, (500, 1))
    there = linearise(camera, point.T.copy())
    assert np.abs(there.pixel.T - project(camera, point)).max() < 1e-10
    step = 1e-3
    for axis in range(3):
        move = step * np.eye(3)[axis]
        slope = (project(camera, point + move) - project(camera, point - move)) / (2 * step)
        assert np.abs(there.by_point[:, axis].T - slope).max() < 1e-7
    for k in range(4):
        move = step * np.eye(4)[k]
        more, less = (replace(camera, params=camera.params + sign * move) for sign in (1, -1))
        slope = (project(more, point) - project(less, point)) / (2 * step)
        assert np.abs(there.by_params[:, k].T - slope).max() < 1e-7


def test_nothing_is_seen_behind_the_camera(camera: Camera) -> None:
    """Points behind the camera, in its plane, or not finite have no image, and no derivatives."""
    point = np.array([[0.01, 0.01, -1], [0.01, 0.01, 0], [np.nan, 0, 1], [np.inf, 0, 1]])
    assert np.isnan(project(camera, point)).all()
    there = linearise(camera, point.T.copy())
    assert np.isnan(there.pixel).all()
    assert np.isnan(there.by_point).all()
    assert np.isnan(there.by_params).all()


def test_leading_axes_are_kept(camera: Camera) -> None:
    """Batches of any shape, also single points and none, give the same numbers."""
    pixel = (np.random.default_rng(5).uniform(0.4, 0.6, (24, 2)) * SIZE).reshape(2, 3, 4, 2)
    ray = rays(camera, pixel)
    assert ray.shape == (2, 3, 4, 3)
    assert np.array_equal(ray.reshape(-1, 3), rays(camera, pixel.reshape(-1, 2)))
    assert np.array_equal(rays(camera, pixel[1, 2, 3]), ray[1, 2, 3])
    assert np.array_equal(project(camera, ray[1, 2, 3]), project(camera, ray)[1, 2, 3])
    assert rays(camera, np.zeros((0, 2))).shape == (0, 3)
    assert project(camera, np.zeros((0, 3))).shape == (0, 2)


def test_a_map_is_needed() -> None:
    """A virtual camera without a map is a mistake of the program, and said so."""
    with pytest.raises(ValueError, match="needs a learned map"):
        rays(Camera("virtual", np.array([1.0, 1, 0, 0]), SIZE), np.zeros((1, 2)))
