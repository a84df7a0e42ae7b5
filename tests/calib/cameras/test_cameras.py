"""Camera models and camera files."""

import json
from pathlib import Path

import cv2
import numpy as np
import pytest

from calib.cameras import MODELS, linearise, parameter_names, project, rays
from calib.cameras.camera import Camera
from calib.cameras.camera_file import camera_from_mapping, camera_or_preset, camera_to_json, load_camera
from designer.base.errors import InputError
from designer.kinds.presets import preset_names

SIZE = (1000, 800)
LENSES = {
    "linear": Camera("pinhole", np.array([900.0, 880, 510, 390]), SIZE),
    "pinhole": Camera("opencv", np.array([900.0, 880, 510, 390, 0, 0, 0, 0, 0]), SIZE),
    "barrel": Camera("opencv", np.array([600.0, 620, 480, 405, -0.3, 0.1, 0.002, -0.001, -0.012]), SIZE),
    "pincushion": Camera("opencv", np.array([700.0, 700, 500, 400, 0.2, 0.05, -0.001, 0.003, 0.01]), SIZE),
    "backward barrel": Camera("luhmann", np.array([600.0, 610, 490, 400, -0.2, 0.05, -0.01, 0.002, -0.001]), SIZE),
    "backward pincushion": Camera("luhmann", np.array([900.0, 910, 490, 400, 0.1, 0.03, 0.01, -0.002, 0.001]), SIZE),
}


def pixels(seed: int = 0) -> np.ndarray:
    """Pixels all over the image and a little beyond."""
    return np.random.default_rng(seed).uniform([-2, -2], [SIZE[0] + 2, SIZE[1] + 2], (5000, 2))


@pytest.mark.parametrize("lens", LENSES)
def test_projecting_rays_gives_the_pixels(lens: str) -> None:
    """project(rays(u)) is u to machine precision, at any distance, and every pixel has a ray."""
    camera, pixel = LENSES[lens], pixels()
    ray = rays(camera, pixel)
    assert np.array_equal(ray[:, 2], np.ones(len(ray)))
    scale = np.random.default_rng(1).uniform(0.1, 1e4, (len(ray), 1))
    assert np.abs(project(camera, scale * ray) - pixel).max() < 1e-11


@pytest.mark.parametrize("lens", LENSES)
def test_rays_of_projected_points_are_parallel(lens: str) -> None:
    """rays(project(x)) is parallel to x."""
    camera = LENSES[lens]
    ray = rays(camera, pixels(3))
    point = 357 * ray
    assert np.abs(rays(camera, project(camera, point)) - ray).max() < 1e-13


@pytest.mark.parametrize("lens", LENSES)
def test_derivatives_agree_with_differences(lens: str) -> None:
    """`linearise` gives the pixels of `project`, and derivatives that agree with central differences."""
    camera = LENSES[lens]
    point = np.random.default_rng(4).uniform(50, 500, (2000, 1)) * rays(camera, pixels()[:2000])
    found = linearise(camera, np.ascontiguousarray(point.T))
    assert np.abs(found.pixel.T - project(camera, point)).max() < 1e-10
    for axis in range(3):
        step = 1e-4 * np.eye(3)[axis]
        difference = (project(camera, point + step) - project(camera, point - step)) / 2e-4
        assert np.abs(found.by_point[:, axis].T - difference).max() < 1e-6
    for k, value in enumerate(camera.params):
        step = np.where(np.arange(len(camera.params)) == k, 1e-6 * max(abs(value), 1), 0)
        up, down = (Camera(camera.model, camera.params + sign * step, SIZE) for sign in (1, -1))
        difference = (project(up, point) - project(down, point)) / (2 * step[k])
        assert np.abs(found.by_params[:, k].T - difference).max() < 2e-6 * max(1, np.abs(difference).max())


@pytest.mark.parametrize("lens", LENSES)
def test_points_without_image_have_no_derivatives(lens: str) -> None:
    """Where `project` is nan, so is the linearised pixel: behind the camera and beyond the fold."""
    camera = LENSES[lens]
    point = np.array([[0.1, 0.2, -1.0], [50.0, 3.0, 1.0], [0.01, 0.02, 1.0], [0.1, 0.1, 0.0]])
    found = linearise(camera, np.ascontiguousarray(point.T))
    assert np.array_equal(np.isnan(found.pixel.T), np.isnan(project(camera, point)))


@pytest.mark.parametrize("lens", ["pinhole", "barrel", "pincushion"])
def test_opencv_model_is_opencv(lens: str) -> None:
    """Model `opencv` projects as cv2.projectPoints does."""
    camera = LENSES[lens]
    point = rays(camera, pixels()) * 250
    fx, fy, cx, cy, *distortion = camera.params.tolist()
    matrix = np.array([[fx, 0, cx], [0, fy, cy], [0, 0, 1]])
    expected, _ = cv2.projectPoints(point, np.zeros(3), np.zeros(3), matrix, np.array(distortion))
    assert np.abs(project(camera, point) - expected[:, 0]).max() < 1e-10


def test_luhmann_model_is_the_published_formula() -> None:
    """Model `luhmann` subtracts the published offset at the measured point, with y up and the scene at negative z."""
    camera = LENSES["backward barrel"]
    fx, fy, cx, cy, k1, k2, k3, p1, p2 = camera.params.tolist()
    u, v = pixels().T
    x, y = (u - cx) / fx, (-v + cy) / fy
    r2 = x**2 + y**2
    radial = k1 * r2 + k2 * r2**2 + k3 * r2**3
    x_bar = x - (radial * x + p1 * (r2 + 2 * x**2) + 2 * p2 * x * y)
    y_bar = y - (radial * y + p2 * (r2 + 2 * y**2) + 2 * p1 * x * y)
    paper_frame = np.column_stack([x_bar, y_bar, -np.ones_like(x)])
    assert np.abs(rays(camera, pixels()) - paper_frame @ np.diag([1, -1, -1])).max() < 1e-14


def test_nothing_is_seen_behind_the_camera_or_beyond_the_fold() -> None:
    """Points behind the camera project to nan, as do points beyond the radius where the lens folds over."""
    camera = Camera("opencv", np.array([600.0, 600, 500, 400, -0.3, 0, 0, 0, 0]), SIZE)
    fold = 1 / np.sqrt(0.9)  # d/dr (r - 0.3 r^3) = 0
    points = np.array([[0.1, 0, -1], [0.1, 0, 0], [0.99 * fold, 0, 1], [1.01 * fold, 0, 1]])
    assert np.isfinite(project(camera, points)).all(axis=1).tolist() == [False, False, True, False]
    edge = 600 * (fold - 0.3 * fold**3)
    seen = rays(camera, np.array([[500 + 0.999 * edge, 400], [500 + 1.001 * edge, 400]]))
    assert np.isfinite(seen).all(axis=1).tolist() == [True, False]


@pytest.mark.parametrize("lens", LENSES)
def test_models_keep_leading_axes(lens: str) -> None:
    """Batches of any shape, also single points, give the same numbers."""
    camera, pixel = LENSES[lens], pixels()[:24]
    batch = rays(camera, pixel.reshape(2, 3, 4, 2))
    assert batch.shape == (2, 3, 4, 3)
    assert np.array_equal(batch.reshape(-1, 3), rays(camera, pixel))
    assert np.array_equal(project(camera, batch[1, 2, 3]), project(camera, batch)[1, 2, 3])


@pytest.mark.parametrize("lens", LENSES)
def test_camera_file_round_trip(lens: str, tmp_path: Path) -> None:
    """camera.json reads back bit for bit."""
    path = tmp_path / "camera.json"
    path.write_text(camera_to_json(LENSES[lens]), encoding="utf-8")
    camera = load_camera(path)
    assert (camera.model, camera.image_size) == (LENSES[lens].model, SIZE)
    assert np.array_equal(camera.params, LENSES[lens].params)


@pytest.mark.parametrize("name", preset_names("cameras"))
def test_every_template_sees_with_every_pixel(name: str) -> None:
    """All camera templates load, and every pixel has a ray that projects back."""
    camera = camera_or_preset(name)
    width, height = camera.image_size
    u, v = np.meshgrid(np.linspace(-0.5, width - 0.5, 50), np.linspace(-0.5, height - 0.5, 50))
    pixel = np.stack([u, v], axis=-1)
    assert np.abs(project(camera, rays(camera, pixel)) - pixel).max() < 1e-9


def test_templates_are_the_stated_cameras() -> None:
    """machine-vision is 2448 x 2048 with f 2500 px, phase-one-ixg 11608 x 8708 with f 15650 px."""
    assert camera_or_preset("machine-vision").image_size == (2448, 2048)
    assert camera_or_preset("machine-vision").params[:2].tolist() == [2500, 2500]
    assert camera_or_preset("phase-one-ixg").image_size == (11608, 8708)
    assert camera_or_preset("phase-one-ixg").params[:2].tolist() == [15650, 15650]


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"format": "other"}, "not a camera file"),
        ({"version": 2}, "version 2; this program reads version 1"),
        ({"version": True}, "version True"),
        ({"model": "opencw"}, "unknown camera model 'opencw'; did you mean 'opencv'?"),
        ({"image_size": [0, 5]}, "image_size.0 0: must be 1 or more"),
        ({"image_size": [100001, 5]}, "must be 100000 or less"),
        ({"image_size": [10.5, 5]}, "image_size"),
        ({"image_sizes": [1, 5]}, "unknown key 'image_sizes'; did you mean 'image_size'?"),
        ({"parameters": {"fx_px": 1.0, "fy_px": 1.0, "cx_px": 0.0}}, "parameter cy_px is missing"),
        ({"parameters": {"fx_px": 1.0, "fy_px": 1.0, "cx_px": 0.0, "cy_px": 0.0}}, "parameter k1 is missing"),
        (
            {"model": "pinhole", "parameters": {"fx_px": 0.0, "fy_px": 1.0, "cx_px": 0.0, "cy_px": 0.0}},
            "fx_px 0: a focal",
        ),
        ({"parameters": {"fx_px": float("nan")}}, "parameters.fx_px nan"),
        ({"parameters": {"fx_px": "1"}}, "parameters.fx_px '1'"),
        ({"parameters": {"fx_px": True}}, "parameters.fx_px True"),
        ({"parameters": {"cxpx": 1.0}}, "unknown parameter 'cxpx' of model 'opencv'; did you mean 'cx_px'?"),
        ({"parameters": 7}, "parameters 7"),
    ],
)
def test_bad_camera_files_end_in_one_line(change: dict[str, object], message: str) -> None:
    """What is wrong with a camera file is said in one line that names file, value and rule."""
    document = {**json.loads(camera_to_json(LENSES["barrel"])), **change}
    with pytest.raises(InputError, match=r"^cam\.json: .") as caught:
        camera_from_mapping(document, "cam.json")
    assert message in str(caught.value)
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize("text", ["", "[", "[1]", "null", '{"format": 1', "\x00", "[" * 100_000])
def test_unreadable_camera_files(text: str, tmp_path: Path) -> None:
    """A file that is no JSON, or JSON of something else, is refused with its name."""
    path = tmp_path / "camera.json"
    path.write_text(text)
    with pytest.raises(InputError, match=r"camera\.json"):
        load_camera(path)


def test_misspelt_template_is_corrected() -> None:
    """A misspelt template's name gets a suggestion, a missing file its path."""
    with pytest.raises(InputError, match="did you mean 'machine-vision'"):
        camera_or_preset("machine-visoin")
    with pytest.raises(InputError, match=r"no-such-camera\.json: cannot be read"):
        camera_or_preset("no-such-camera.json")


def test_registry_names_are_the_models_own() -> None:
    """Each model is registered under its name, and its parameters begin with those every model has."""
    for name, model in MODELS.items():
        assert model.name == name
        assert parameter_names(name)[:4] == ("fx_px", "fy_px", "cx_px", "cy_px")
