"""Camera files: the learned map, the parameters' bounds, and what is no camera."""

import json
import re
from pathlib import Path

import numpy as np
import pytest

from calib.cameras.camera import Camera, camera_from_mapping, camera_to_json, load_camera
from designer.base.errors import InputError
from tests.support.virtual_scenes import virtual_camera, wavy_map

LENS = Camera("opencv", np.array([900.0, 900, 500, 380, -0.1, 0.02, 0, 0, 0]), (1000, 800))


@pytest.fixture(scope="module")
def camera() -> Camera:
    """A virtual camera."""
    return virtual_camera(wavy_map(0.05))


def test_largest_map_fits_a_file(camera: Camera, tmp_path: Path) -> None:
    """A map of as many knots as are allowed is small enough to be read."""
    document = json.loads(camera_to_json(camera))
    field = document["learned_map"]
    rng = np.random.default_rng(0)
    field["knot_px"], field["weight"] = rng.normal(0, 1e3, (2, 1000, 2)).tolist()
    field["noise_variance"] = rng.uniform(1e-9, 1e-8, 1000).tolist()
    path = tmp_path / "camera.json"
    path.write_text(json.dumps(document), encoding="utf-8")
    assert load_camera(path).learned is not None


def shortened(values: list[object]) -> list[object]:
    """All but the last."""
    return values[:-1]


@pytest.mark.parametrize(
    ("field", "value", "message"),
    [
        ("knot_px", shortened, "learned_map.weight has 441 items where it must have 440"),
        ("noise_variance", shortened, "learned_map.noise_variance has 440 items where it must have 441"),
        ("knot_px", [[0.0, 0.0]] * 1001, "learned_map.knot_px"),
        ("weight", [[0.0, 0.0]] * 1001, "learned_map.weight"),
        ("noise_variance", [1.0] * 1001, "learned_map.noise_variance"),
        ("knot_px", [], "learned_map.knot_px"),
        ("weight", [[1e300, 0.0]], "learned_map.weight.0.0"),
        ("noise_variance", [0.0], "learned_map.noise_variance.0 0.0"),
        ("noise_variance", [-1.0], "learned_map.noise_variance.0 -1.0"),
        ("trend", [[1.0, 0.0, 0.0], [0.0, 1.0, 0.0]], "learned_map.trend"),
        ("trend", [[0.0] * 3] * 3, "learned_map.trend must be a homography, which is invertible"),
        ("length_px", 0.0, "learned_map.length_px 0.0"),
        ("length_px", 61.0, "learned_map.length_px 61: must be at least 61.2 in this image"),
        ("length_px", float("inf"), "learned_map.length_px inf"),
        ("limit", 0.0, "learned_map.limit 0.0"),
        ("limit", 1.5, "learned_map.limit 1.5"),
    ],
)
def test_hostile_maps_end_in_one_line(camera: Camera, field: str, value: object, message: str) -> None:
    """A map of wrong shapes, not finite, too large, or without meaning is refused in one line that names the value."""
    document = json.loads(camera_to_json(camera))
    held = document["learned_map"]
    held[field] = value(held[field]) if callable(value) else value
    with pytest.raises(InputError, match=r"^cam\.json: .") as caught:
        camera_from_mapping(document, "cam.json")
    assert message in str(caught.value)
    assert "\n" not in str(caught.value)
    assert len(str(caught.value)) < 250


def test_map_and_model_belong_together(camera: Camera) -> None:
    """A virtual camera without a map is refused, and a map of another model; a missing field is named."""
    document = json.loads(camera_to_json(camera))
    with pytest.raises(InputError, match="model 'virtual' needs a learned_map"):
        camera_from_mapping({key: value for key, value in document.items() if key != "learned_map"}, "cam.json")
    with pytest.raises(InputError, match="model 'opencv' has no learned_map"):
        camera_from_mapping({**document, "model": "opencv"}, "cam.json")
    del document["learned_map"]["trend"]
    with pytest.raises(InputError, match=r"learned_map\.trend is missing"):
        camera_from_mapping(document, "cam.json")


@pytest.mark.parametrize(
    ("name", "value", "rule"),
    [
        ("fy_px", 0.0, "a focal length must be more than zero pixels"),
        ("fy_px", -5.0, "a focal length must be more than zero pixels"),
        ("fx_px", 1e300, "a focal length is from 0.001 to 1e+09 pixels"),
        ("fy_px", 1e-300, "a focal length is from 0.001 to 1e+09 pixels"),
        ("cx_px", -1e300, "is more than 1e+09, which no lens has"),
        ("k1", 1e300, "is more than 1e+30, which no lens has"),
    ],
)
def test_absurd_parameters_are_refused(name: str, value: float, rule: str) -> None:
    """Numbers that overflow in the first product are no camera's; the line is short."""
    document = json.loads(camera_to_json(LENS))
    document["parameters"][name] = value
    with pytest.raises(InputError, match=re.escape(f"cam.json: {name} {value:g}: {rule}")) as caught:
        camera_from_mapping(document, "cam.json")
    assert len(str(caught.value)) < 120


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"model": "opencw"}, "unknown camera model 'opencw'; did you mean 'opencv'?"),
        ({"image_size": [100001, 5]}, "must be 100000 or less"),
        ({"parameters": {"fx_px": 1.0, "fy_px": 1.0, "cx_px": 0.0}}, "parameter cy_px is missing"),
        ({"parameters": {"fx_px": 1.0, "fy_px": 1.0, "cx_px": 0.0, "cy_px": 0.0}}, "parameter k1 is missing"),
        (
            {"model": "pinhole", "parameters": {"fx_px": 0.0, "fy_px": 1.0, "cx_px": 0.0, "cy_px": 0.0}},
            "fx_px 0: a focal",
        ),
        ({"parameters": {"cxpx": 1.0}}, "unknown parameter 'cxpx' of model 'opencv'; did you mean 'cx_px'?"),
    ],
)
def test_bad_camera_files_end_in_one_line(change: dict[str, object], message: str) -> None:
    """What is wrong with a camera file is said in one line that names file, value and rule."""
    document = {**json.loads(camera_to_json(LENS)), **change}
    with pytest.raises(InputError, match=r"^cam\.json: .") as caught:
        camera_from_mapping(document, "cam.json")
    assert message in str(caught.value)
    assert "\n" not in str(caught.value)
