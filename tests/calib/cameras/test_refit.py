"""Fitting a camera of one model to another over the image."""

import numpy as np
import pytest
from scipy.optimize import least_squares

from calib.cameras import LINEAR, fitted_models, neutral, parameter_names, project, rays
from calib.cameras.camera import Camera, LearnedMap
from calib.cameras.formats import FORMATS
from calib.cameras.formats.holding import fit_to_format
from calib.cameras.refit import fit_rays, image_grid, refit
from calib.core.se3 import exp_rotation
from designer.base.errors import InputError
from tests.support.foreign_cameras import CAMERAS, SIZE
from tests.support.lenses import slight

WIDE = Camera("opencv", np.array([620.0, 620, 508.2, 391.7, -0.3, 0.1, 0.0006, -0.0004, -0.012]), SIZE)
TILT = exp_rotation(np.array([0.25, -0.2, 0.5]))


def tilted(camera: Camera) -> tuple[np.ndarray, np.ndarray]:
    """Pixels and the directions seen in them, in a frame that is turned against the camera's."""
    pixel = image_grid(camera.image_size).reshape(-1, 2)
    ray = rays(camera, pixel) @ TILT.T
    return pixel, ray / ray[:, 2:]


@pytest.mark.parametrize("camera", CAMERAS)
def test_the_same_model_needs_no_fit(camera: str) -> None:
    """A camera in its own model is the same to the last bit, with a residual of nought."""
    found = refit(CAMERAS[camera], CAMERAS[camera].model)
    assert found.camera.params.tolist() == CAMERAS[camera].params.tolist()
    assert (found.rms_px, found.max_px, found.turn_rad, found.is_exact) == (0, 0, 0, True)


@pytest.mark.parametrize(
    ("source", "target"),
    [("pinhole", "opencv"), ("pinhole", "luhmann"), ("opencv12", "pinhole"), ("opencv", "eucm"), ("eucm", "omni")],
)
def test_without_a_lens_all_models_are_one(source: str, target: str) -> None:
    """Between models without distortion the numbers are taken over."""
    params = neutral(source)
    params[:4] = [900.1, 880.3, 510.7, 390.9]
    camera = Camera(source, params, SIZE)
    found = refit(camera, target)
    assert found.is_exact
    assert found.camera.model == target
    assert found.camera.params.tolist() == [*params[:4], *neutral(target)[4:]]
    assert np.abs(rays(found.camera, np.array([3.0, 5.0])) - rays(camera, np.array([3.0, 5.0]))).max() < 1e-15


@pytest.mark.parametrize(
    ("smaller", "larger"), [("opencv", "opencv8"), ("opencv", "opencv12"), ("opencv8", "opencv12")]
)
def test_a_lens_of_opencv_is_held_by_one_with_more_coefficients(smaller: str, larger: str) -> None:
    """The numbers are taken over, and back where those left out are zero; where they are not, it is a fit."""
    camera = slight(smaller)
    found = refit(camera, larger)
    assert found.is_exact
    pixel = image_grid(camera.image_size).reshape(-1, 2)
    assert np.nanmax(np.abs(rays(found.camera, pixel) - rays(camera, pixel))) < 1e-12
    assert refit(found.camera, smaller).camera.params.tolist() == camera.params.tolist()
    assert not refit(slight(larger), smaller).is_exact


@pytest.mark.parametrize(
    ("source", "target"), [pair for model in fitted_models() for pair in ((model, LINEAR), (LINEAR, model))]
)
def test_a_lens_that_does_nothing_is_none_only_where_its_rays_say_so(source: str, target: str) -> None:
    """What is said to be the same camera in another model has the same rays: an equidistant fisheye is no pinhole."""
    params = neutral(source)
    params[:4] = [500.1, 501.3, 320.7, 240.9]
    camera = Camera(source, params, (640, 480))
    found = refit(camera, target)
    grid = image_grid(camera.image_size, 9)
    is_same = bool(np.abs(found.camera.rays(grid) - camera.rays(grid)).max() < 1e-12)
    assert is_same == found.is_exact


@pytest.mark.parametrize(
    ("camera", "model", "zero"),
    [
        ("barrel", "opencv", ("k3",)),
        ("backward", "opencv", ()),
        ("pincushion", "luhmann", ()),
        ("barrel", "pinhole", ()),
    ],
)
def test_the_fit_is_the_least_squares_solution(camera: str, model: str, zero: tuple[str, ...]) -> None:
    """SciPy, started at the result, finds nothing better; the stated RMS and max are those of the grid."""
    found = refit(CAMERAS[camera], model, zero=zero)
    pixel = image_grid(SIZE).reshape(-1, 2)
    ray = rays(CAMERAS[camera], pixel)
    free = np.array([name not in zero for name in parameter_names(model)])
    assert not found.camera.params[~free].any()

    def off(values: np.ndarray) -> np.ndarray:
        params = np.zeros(len(free))
        params[free] = values
        flat: np.ndarray = (project(Camera(model, params, SIZE), ray) - pixel).ravel()
        return np.where(np.isfinite(flat), flat, 1e3)

    best = least_squares(off, found.camera.params[free], x_scale="jac", xtol=1e-15, ftol=1e-15, gtol=1e-15)
    length = np.linalg.norm(off(found.camera.params[free]).reshape(-1, 2), axis=1)
    assert found.rms_px == pytest.approx(np.sqrt(np.mean(length**2)), rel=1e-9)
    assert found.max_px == pytest.approx(length.max(), rel=1e-9)
    assert found.rms_px**2 * len(pixel) <= 2 * best.cost * (1 + 1e-6)
    assert not found.is_exact


def test_a_wide_lens_is_not_stopped_by_its_fold() -> None:
    """A barrel of 56 degrees becomes a backward lens to half a pixel; fitted at once, it stops at 1.3 px."""
    found = refit(WIDE, "luhmann")
    assert found.known == 1
    assert found.rms_px < 0.5


@pytest.mark.parametrize("model", ["opencv", "luhmann"])
def test_a_frame_that_is_turned_is_found(model: str) -> None:
    """With the rotation free, a camera seen through a turned frame is recovered exactly, and so is the turn."""
    true = CAMERAS["pincushion"] if model == "opencv" else CAMERAS["backward"]
    pixel, ray = tilted(true)
    found = fit_rays(pixel, ray, SIZE, model, turn=True)
    assert found.max_px < 1e-8
    assert np.allclose(found.camera.params, true.params, rtol=1e-7, atol=1e-9)
    assert np.allclose(found.new_from_old, TILT.T, atol=1e-9)
    assert found.turn_rad == pytest.approx(np.linalg.norm([0.25, -0.2, 0.5]))


def test_a_learned_map_is_turned() -> None:
    """The sensor of a map need not be parallel to the image: without a turn it fits no other camera, with one it does.

    The map here is that of a linear camera onto a tilted plane.
    """
    linear = np.array([[900.0, 0, 510], [0, 880, 390], [0, 0, 1]])
    sensor = np.array([[800.0, 0, 300], [0, 800, 200], [0, 0, 1]])
    nothing = {"knot_px": np.array([[0.0, 0], [500, 300]]), "weight": np.zeros((2, 2)), "noise_variance": np.ones(2)}
    everywhere = LearnedMap(**nothing, trend=sensor @ TILT @ np.linalg.inv(linear), length_px=1e3, limit=2.0)
    camera = Camera("virtual", np.array([800.0, 800, 300, 200]), SIZE, everywhere)
    assert refit(camera, "opencv").max_px > 10
    held = fit_to_format(camera, FORMATS["kalibr"])
    found = held.refit
    assert found is not None
    assert found.max_px < 1e-3
    assert found.turn_rad == pytest.approx(np.linalg.norm([0.25, -0.2, 0.5]), rel=1e-6)
    assert np.allclose(held.camera.params[:4], [900, 880, 510, 390], rtol=1e-4)


def test_directions_that_are_not_known_are_left_out() -> None:
    """A masked part of the image is not fitted, and its part of the image is told."""
    pixel = image_grid(SIZE).reshape(-1, 2)
    ray = rays(CAMERAS["barrel"], pixel)
    ray[pixel[:, 0] > 700] = np.nan
    found = fit_rays(pixel, ray, SIZE, "opencv")
    assert found.max_px < 1e-8
    assert found.known == pytest.approx(np.mean(pixel[:, 0] <= 700))
    assert np.allclose(found.camera.params, CAMERAS["barrel"].params, rtol=1e-6, atol=1e-8)


def test_noise_cannot_fold_the_lens_over() -> None:
    """Few and noisy directions of a wide lens are all kept, and fitted to their noise of 3 px a coordinate."""
    pixel = image_grid(SIZE).reshape(-1, 2)
    for seed in range(12):
        rng = np.random.default_rng(seed)
        ray = rays(WIDE, pixel + rng.normal(0, 3, pixel.shape))
        ray[rng.random(len(ray)) > 0.05] = np.nan
        found = fit_rays(pixel, ray, SIZE, "opencv")
        assert 2 < found.rms_px < 6


def test_directions_that_no_camera_has() -> None:
    """Too few directions, mirrored ones and ones behind the camera are refused with the rule."""
    pixel = image_grid(SIZE).reshape(-1, 2)
    ray = rays(CAMERAS["barrel"], pixel)
    few = ray.copy()
    few[15:] = np.nan
    for wrong, rule in (
        (few, "rays at 15 of"),
        (ray * [-1, 1, 1], "do not follow its pixels"),
        (ray * [1, 1, -1], "more than a half space"),
    ):
        with pytest.raises(InputError, match=rule):
            fit_rays(pixel, wrong, SIZE, "opencv")


def test_the_grid_reaches_the_edges() -> None:
    """The grid runs from the centre of the first pixel to that of the last, with cells about square."""
    grid = image_grid((1000, 500), 50)
    assert grid.shape == (25, 50, 2)
    assert grid[0, 0].tolist() == [0, 0]
    assert grid[-1, -1].tolist() == [999, 499]
