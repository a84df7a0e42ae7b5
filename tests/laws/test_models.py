"""The laws of camera models, over the whole registry; and that a new one is a file and a line."""

import ast
import re
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

import calib
import calib.cameras
from calib.cameras import (
    ABILITIES,
    COMMON,
    DEFAULT,
    LINEAR,
    MODELS,
    fitted_models,
    learned_models,
    linearise,
    models_of_all,
    project,
    rays,
)
from calib.cameras.camera import Camera, load_camera
from calib.cameras.formats import FORMATS
from calib.cameras.refit import refit
from calib.solver.solve import solve
from designer.base.errors import InputError
from tests.support.lenses import LENSES, pixels, slight
from tests.support.solver_scenes import board, observe, poses_around

ROOT = Path(__file__).parents[2]
each_lens = pytest.mark.parametrize("camera", LENSES, indirect=True)


@pytest.fixture
def camera(request: pytest.FixtureRequest) -> Camera:
    """The camera of this name."""
    return LENSES[request.param]()


@each_lens
def test_projecting_rays_gives_the_pixels(camera: Camera) -> None:
    """project(rays(u)) is u at any distance, and rays are of length one; what has no ray has no image either."""
    pixel = pixels(camera)
    ray = rays(camera, pixel)
    has_ray = np.isfinite(ray).all(axis=1)
    assert has_ray.mean() > 0.1
    assert np.isnan(ray[~has_ray][:, :2]).all()
    assert np.abs(np.linalg.norm(ray[has_ray], axis=1) - 1).max() < 1e-15
    point = np.random.default_rng(1).uniform(0.1, 1e4, (len(ray), 1)) * ray
    back = project(camera, point)
    assert np.abs(back - pixel)[has_ray].max() < 1e-9
    assert np.isnan(back[~has_ray]).all()
    assert np.abs(rays(camera, back[has_ray]) - ray[has_ray]).max() < 1e-12


@each_lens
def test_derivatives_agree_with_differences(camera: Camera) -> None:
    """`linearise` has the pixels of `project`, and derivatives that central differences give."""
    inside = np.random.default_rng(4).uniform(0.35, 0.65, (200, 2)) * camera.image_size
    point = np.random.default_rng(5).uniform(200, 500, (200, 1)) * rays(camera, inside)
    found = linearise(camera, np.ascontiguousarray(point.T))
    assert np.abs(found.pixel.T - project(camera, point)).max() < 1e-10
    for axis in range(3):
        step = 1e-3 * np.eye(3)[axis]
        slope = (project(camera, point + step) - project(camera, point - step)) / 2e-3
        assert np.abs(found.by_point[:, axis].T - slope).max() < 1e-6
    for k, parameter in enumerate(MODELS[camera.model].parameters):
        size = 1e-3 if parameter.unit == "px" else 1e-6
        step = np.where(np.arange(len(camera.params)) == k, size, 0)
        up, down = (replace(camera, params=camera.params + sign * step) for sign in (1, -1))
        slope = (project(up, point) - project(down, point)) / (2 * size)
        assert np.abs(found.by_params[:, k].T - slope).max() < 2e-6 * max(1, np.abs(slope).max())


@each_lens
def test_nothing_is_seen_behind_the_camera(camera: Camera) -> None:
    """Points that are not finite have no image, nor those at or behind 90 degrees but of wide lenses.

    Where there is none is no derivative.
    """
    point = np.array([[np.nan, 0, 1], [0.1, 0.2, -1.0], [0.1, 0.1, 0.0], [50.0, 3.0, 1.0], [0.01, 0.02, 1.0]])
    assert np.isnan(project(camera, point[: 1 if ABILITIES[camera.model].is_wide else 3])).any(axis=1).all()
    found = linearise(camera, np.ascontiguousarray(point.T))
    assert np.array_equal(np.isnan(found.pixel.T), np.isnan(project(camera, point)))


@each_lens
def test_leading_axes_are_kept(camera: Camera) -> None:
    """Batches of any shape, also single points and none, give the same numbers."""
    pixel = (np.random.default_rng(5).uniform(0.4, 0.6, (24, 2)) * camera.image_size).reshape(2, 3, 4, 2)
    ray = rays(camera, pixel)
    assert ray.shape == (2, 3, 4, 3)
    assert np.array_equal(ray.reshape(-1, 3), rays(camera, pixel.reshape(-1, 2)))
    assert np.array_equal(rays(camera, pixel[1, 2, 3]), ray[1, 2, 3])
    assert np.array_equal(project(camera, ray[1, 2, 3]), project(camera, ray)[1, 2, 3])
    assert rays(camera, np.zeros((0, 2))).shape == (0, 3)
    assert project(camera, np.zeros((0, 3))).shape == (0, 2)


@each_lens
def test_a_file_reads_back_bit_for_bit(camera: Camera, tmp_path: Path) -> None:
    """What `save` wrote is the same camera again, with its learned map."""
    back = load_camera(camera.save(tmp_path / "camera.json"))
    assert (back.model, back.image_size) == (camera.model, camera.image_size)
    assert np.array_equal(back.params, camera.params)
    pixel = pixels(camera, 100)
    assert np.array_equal(rays(back, pixel), rays(camera, pixel), equal_nan=True)


@pytest.mark.parametrize("model", MODELS)
def test_a_model_says_what_it_can_do(model: str) -> None:
    """A file of its name, its own name, the linear parameters first, and a lens that OpenCV takes or a refusal."""
    entry = MODELS[model]
    assert entry.name == model
    assert (ROOT / f"calib/cameras/{model}.py").is_file()
    assert [one.name for one in entry.parameters[:4]] == ["fx_px", "fy_px", "cx_px", "cy_px"]
    assert len({one.name for one in entry.parameters}) == len(entry.parameters)
    assert entry.remedy
    camera = slight(model)
    if entry.opencv_lens is None:
        with pytest.raises(InputError, match="fit one with"):
            _ = camera.distortion
    else:
        assert set(entry.opencv_lens) <= set(camera.parameters)
        assert camera.distortion.shape == (len(entry.opencv_lens or range(5)),)
        assert len(camera.distortion) in ((4,) if ABILITIES[model].is_wide else (5, 8, 12, 14))


def test_defaults_and_choices_are_models() -> None:
    """What is solved if nobody says is offered, and can be fitted to another camera; learned models cannot."""
    assert {DEFAULT, COMMON, LINEAR} <= set(fitted_models()) <= set(MODELS)
    assert not set(learned_models()) & set(fitted_models())
    assert models_of_all()


PLACES = ("calib/cameras/", "calib/cameras/formats/")
OF_THE_PAPER = {
    "calib/studies/compare/scene.py": {"luhmann", "opencv", "virtual"},  # what the paper compares
    "calib/studies/compare/cases.py": {"spline"},  # a part of the comparison
    "calib/studies/paper_study.py": {"luhmann"},  # the model of the paper's table
    "designer/formats/point_lists.py": {"colmap", "kalibr", "metashape", "opencv"},  # whose files of points it writes
    "calib/observe/marker_files.py": {"colmap", "metashape"},
    # Whose frames the coordinates of a board may be in:
    "designer/marks/face_marks.py": {"kalibr", "opencv"},
    "calib/app/target_of_marks.py": {"kalibr", "opencv"},
    "calib/app/target_contents.py": {"kalibr", "opencv"},
    "calib/app/inputs.py": {"ros"},  # whose messages a bag holds
}


def test_no_model_or_format_is_named_outside_its_place() -> None:
    """Defaults, choices and what depends on a model's abilities come from the registries."""
    named = {}
    for path in (path for package in ("designer", "calib") for path in (ROOT / package).rglob("*.py")):
        place = path.relative_to(ROOT).as_posix()
        source = path.read_text()
        if not place.startswith(PLACES) and any(f'"{name}"' in source for name in (*MODELS, *FORMATS)):
            texts = {node.value for node in ast.walk(ast.parse(source)) if isinstance(node, ast.Constant)}
            if found := (texts & {*MODELS, *FORMATS}) - OF_THE_PAPER.get(place, set()):
                named[place] = found
    assert not named


@pytest.fixture
def fov(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> str:
    """The example of docs/extend.md as a file beside the others, and its line."""
    page = (ROOT / "docs/extend.md").read_text()
    (code,) = (text for text in re.findall(r"^```python\n(.*?)^```", page, re.M | re.S) if "RadialModel(" in text)
    (tmp_path / "models").mkdir()
    (tmp_path / "models/fov.py").write_text(code)
    monkeypatch.setattr(calib.cameras, "__path__", [*calib.cameras.__path__, str(tmp_path / "models")])
    monkeypatch.setitem(ABILITIES, "fov", calib.cameras.Abilities(is_wide=True))
    return "fov"


def test_a_new_model_is_a_file_and_a_line(fov: str, tmp_path: Path) -> None:
    """It keeps the laws, is solved within 5 sigma, judged, kept in files, and written for other tools."""
    truth = Camera(fov, np.array([1400.0, 1390.0, 640.2, 481.7, 0.7]), (1280, 960))
    for camera in (truth, slight(fov)):
        test_projecting_rays_gives_the_pixels(camera)
        test_derivatives_agree_with_differences(camera)
        test_nothing_is_seen_behind_the_camera(camera)
        test_leading_axes_are_kept(camera)
    rng = np.random.default_rng(3)
    seen = observe(truth, board(10, 8, 25.0), poses_around(8, rng), rng, noise_px=0.01)
    found = solve(seen, fov)
    assert found.status == "converged"
    assert (abs(found.camera.params - truth.params) < 5 * np.sqrt(np.diagonal(found.param_covariance))).all()
    run = calib.solve(seen, model=fov, free_bend=False)
    assert run.best.model == fov
    run.save(tmp_path / "camera")
    judged = calib.evaluate(tmp_path / "camera", held_out=4)
    assert judged.held_out is not None
    again = calib.load_camera(tmp_path / "camera")
    assert np.array_equal(again.params, found.camera.params)
    assert refit(again, COMMON).max_px < 0.05
    assert "camera_matrix" in calib.convert(again, "opencv").text
