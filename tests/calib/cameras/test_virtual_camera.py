"""The virtual camera model: rays, images and derivatives through a learned map."""

from dataclasses import replace

import numpy as np
import pytest

from calib.cameras import project, rays
from calib.cameras.camera import Camera
from calib.cameras.learned import known_at
from calib.cameras.parameters import slopes
from tests.support.solver_scenes import SIZE
from tests.support.virtual_scenes import CENTRE_PX, FOCAL_PX, fisheye_map, straight, virtual_camera, wavy_map


@pytest.fixture(scope="module", params=["waves", "fisheye", "part of the image"])
def camera(request: pytest.FixtureRequest) -> Camera:
    """Virtual cameras behind different lenses."""
    if request.param == "waves":
        return virtual_camera(wavy_map(0.02))
    if request.param == "part of the image":
        return virtual_camera(wavy_map(0.02, span=(0.3, 0.7)))
    return virtual_camera(fisheye_map())


def test_rays_of_projected_points_are_parallel(camera: Camera) -> None:
    """rays(project(x)) is parallel to x; a point has an image exactly if a known pixel's ray meets it."""
    direction = np.column_stack([np.random.default_rng(2).uniform(-1.5, 1.5, (20000, 2)), np.ones(20000)])
    direction /= np.linalg.norm(direction, axis=1, keepdims=True)
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
    off = FOCAL_PX * slopes(rays(camera, pixel)) + CENTRE_PX - straight(pixel)
    assert np.sqrt((off**2).mean()) < 0.01


def test_a_map_is_needed() -> None:
    """A virtual camera without a map is a mistake of the program, and said so."""
    with pytest.raises(ValueError, match="needs a learned map"):
        rays(Camera("virtual", np.array([1.0, 1, 0, 0]), SIZE), np.zeros((1, 2)))
