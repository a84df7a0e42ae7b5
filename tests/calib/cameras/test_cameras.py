"""Camera models and their templates."""

import numpy as np
import pytest

from calib.cameras import project, rays
from calib.cameras.camera import Camera, camera_or_preset, focal_px
from calib.cameras.parameters import slopes
from designer.base.errors import InputError
from designer.kinds.presets import preset_names
from tests.support.lenses import SIZE, conventional, pixels


def test_luhmann_model_is_the_published_formula() -> None:
    """Model `luhmann` subtracts the published offset at the measured point, with y up and the scene at negative z."""
    camera = conventional("backward barrel")
    fx, fy, cx, cy, k1, k2, k3, p1, p2 = camera.params.tolist()
    u, v = pixels(camera).T
    x, y = (u - cx) / fx, (-v + cy) / fy
    r2 = x**2 + y**2
    radial = k1 * r2 + k2 * r2**2 + k3 * r2**3
    x_bar = x - (radial * x + p1 * (r2 + 2 * x**2) + 2 * p2 * x * y)
    y_bar = y - (radial * y + p2 * (r2 + 2 * y**2) + 2 * p1 * x * y)
    paper_frame = np.column_stack([x_bar, y_bar, -np.ones_like(x)])
    assert np.abs(slopes(rays(camera, pixels(camera))) - paper_frame[:, :2] * [1, -1]).max() < 1e-14


def test_nothing_is_seen_behind_the_camera_or_beyond_the_fold() -> None:
    """Points behind the camera project to nan, as do points beyond the radius where the lens folds over."""
    camera = Camera("opencv", np.array([600.0, 600, 500, 400, -0.3, 0, 0, 0, 0]), SIZE)
    fold = 1 / np.sqrt(0.9)  # d/dr (r - 0.3 r^3) = 0
    points = np.array([[0.1, 0, -1], [0.1, 0, 0], [0.99 * fold, 0, 1], [1.01 * fold, 0, 1]])
    assert np.isfinite(project(camera, points)).all(axis=1).tolist() == [False, False, True, False]
    edge = 600 * (fold - 0.3 * fold**3)
    seen = rays(camera, np.array([[500 + 0.999 * edge, 400], [500 + 1.001 * edge, 400]]))
    assert np.isfinite(seen).all(axis=1).tolist() == [True, False]


@pytest.mark.parametrize("name", preset_names("cameras"))
def test_every_template_sees_with_every_pixel(name: str) -> None:
    """All camera templates load, and every pixel that light reaches has a ray that projects back."""
    camera = camera_or_preset(name)
    width, height = camera.image_size
    u, v = np.meshgrid(np.linspace(-0.5, width - 0.5, 50), np.linspace(-0.5, height - 0.5, 50))
    pixel = np.stack([u, v], axis=-1)
    ray = rays(camera, pixel)
    is_lit = np.isfinite(ray).all(axis=-1)
    assert is_lit.all() if camera.field_rad is None else is_lit.mean() > 0.4
    assert np.abs(project(camera, ray[is_lit]) - pixel[is_lit]).max() < 1e-9


def test_misspelt_template_is_corrected() -> None:
    """A misspelt template's name gets a suggestion, a missing file its path."""
    with pytest.raises(InputError, match="did you mean 'machine-vision'"):
        camera_or_preset("machine-visoin")
    with pytest.raises(InputError, match=r"no-such-camera\.json: cannot be read"):
        camera_or_preset("no-such-camera.json")


def test_the_focal_length_is_that_of_the_middle_of_the_image() -> None:
    """`fx / (1 + xi)` of a sphere, with the standard deviation that both give it; `fx` of other models."""
    params, covariance = np.array([900.0, 890.0, 500.0, 400.0, 1.4]), np.diag([4.0, 4.0, 1.0, 1.0, 1e-4])
    covariance[0, 4] = covariance[4, 0] = 0.015
    found, sigma = focal_px(Camera("omni", params, (1000, 800)), covariance)
    assert found == pytest.approx(900 / 2.4, rel=1e-12)
    slope = np.array([1 / 2.4, -900 / 2.4**2])
    assert sigma == pytest.approx(np.sqrt(slope @ covariance[np.ix_([0, 4], [0, 4])] @ slope), rel=1e-6)
    plain = Camera("opencv", np.array([900.0, 890.0, 500.0, 400.0, -0.2, 0.1, 0.0, 0.0, 0.0]), (1000, 800))
    assert focal_px(plain, np.diag([4.0, *[0.0] * 8])) == (900.0, 2.0)
    assert np.isnan(focal_px(plain, np.zeros((9, 9)))[1])
