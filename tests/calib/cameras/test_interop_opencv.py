"""OpenCV, ROS and Kalibr files, all in OpenCV's conventions, against OpenCV's own reader and projection."""

import json
from collections.abc import Callable
from pathlib import Path

import cv2
import numpy as np
import pytest
import yaml

from calib.cameras import MODELS, project
from calib.cameras.camera import Camera
from calib.cameras.formats import FORMATS
from calib.cameras.formats.holding import fit_to_format, lost_of
from calib.cameras.formats.reading import open_camera
from designer.base.errors import InputError
from tests.support.foreign_cameras import CAMERAS, SIZE, lens_camera, text_of, whole_image, written
from tests.support.foreign_projections import opencv_projection, published

CALIBRATION_OUTPUT = """%YAML:1.0
---
calibration_time: "Mon 01 Jan 2024 12:00:00 PM UTC"
nr_of_frames: 1
image_width: 640
image_height: 480
board_width: 2
flags: 4
fisheye_model: 0
camera_matrix: !!opencv-matrix
   rows: 3
   cols: 3
   dt: d
   data: [ 6.5746697810243404e+02, 0., 3.1950000000000000e+02, 0.,
       6.5746697810243404e+02, 2.3950000000000000e+02, 0., 0., 1. ]
distortion_coefficients: !!opencv-matrix
   rows: 5
   cols: 1
   dt: d
   data: [ -4.1802327018241026e-01, 5.0715243805833121e-01, 0., 0.,
       -5.7843596847939704e-01 ]
avg_reprojection_error: 3.3910190567986270e-01
image_points: !!opencv-matrix
   rows: 1
   cols: 100000
   dt: "2f"
   data: [ POINTS ]
"""


@pytest.mark.parametrize("shape", [(1, 5), (5, 1), (1, 4), (1, 8), (1, 12), (1, 14)])
def test_what_opencv_writes_is_read(shape: tuple[int, int], tmp_path: Path) -> None:
    """A file of `cv2.FileStorage` is read exactly, whatever the shape of its coefficients, zeros at the end."""
    matrix = np.array([[620.0, 0, 508.2], [0, 600, 391.7], [0, 0, 1]])
    lens = np.zeros(shape)
    lens.flat[:4] = [-0.3, 0.1, 0.002, -1e-5]
    storage = cv2.FileStorage(str(tmp_path / "c.yaml"), cv2.FILE_STORAGE_WRITE)
    storage.write("image_width", 1024)
    storage.write("image_height", 768)
    storage.write("camera_matrix", matrix)
    storage.write("distortion_coefficients", lens)
    storage.release()
    found = FORMATS["opencv"].read((tmp_path / "c.yaml").read_text(), "c", None)
    assert found.refit is None
    assert found.camera.params.tolist() == [620, 600, 508.2, 391.7, -0.3, 0.1, 0.002, -1e-5, 0]


def test_a_calibration_with_its_image_points_is_read_quickly() -> None:
    """OpenCV's sample program stores all image points; they are passed over, not parsed."""
    points = ",\n       ".join(["1.0e+02, 2.0e+02, 3.0e+02, 4.0e+02"] * 25_000)
    camera = FORMATS["opencv"].read(CALIBRATION_OUTPUT.replace("POINTS", points), "out_camera_data.yml", None).camera
    assert camera.image_size == (640, 480)
    assert camera.params[:4].tolist() == [657.46697810243404, 657.46697810243404, 319.5, 239.5]
    assert camera.params[8] == -0.57843596847939704


def test_lenses_that_opencv_has_and_this_program_has_not() -> None:
    """A fisheye lens of five numbers and fewer numbers than are said to be there are refused."""
    text = CALIBRATION_OUTPUT.replace("POINTS", "1.")
    for changed, rule in (
        (text.replace("fisheye_model: 0", "fisheye_model: 1"), "those of a fisheye lens are k1 k2 k3 k4"),
        (text.replace(",\n       -5.7843596847939704e-01", ""), "has 4 numbers; by its rows and cols it must have 5"),
        (text.replace("image_width", "width_of_image"), "add image_width"),
        (text.replace("camera_matrix", "matrix"), "camera_matrix is missing"),
    ):
        with pytest.raises(InputError, match=rule):
            FORMATS["opencv"].read(changed, "c.yaml", None)


MESSAGE = """header:
  seq: 1
height: 480
width: 640
distortion_model: MODEL
D:
- -0.25
- 0.0625
- 0.001
- -0.002
- 0.5
K:
- 500.0
- 0.0
- 320.5
- 0.0
- 501.0
- 240.25
- 0.0
- 0.0
- 1.0
R: [1.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0]
roi:
  height: 0
---
"""


def test_a_printed_camera_info_message_is_read() -> None:
    """What `rostopic echo -n1 camera_info` prints is read too, its last line included."""
    expected = [500, 501, 320.5, 240.25, -0.25, 0.0625, 0.001, -0.002, 0.5]
    for text in (MESSAGE.replace("MODEL", "plumb_bob"), MESSAGE.replace("MODEL", "plumb_bob").replace("D:", "d:")):
        camera = FORMATS["ros"].read(text, "info.yaml", None).camera
        assert camera.params.tolist() == expected
        assert camera.image_size == (640, 480)
    with pytest.raises(
        InputError, match="'fov': not supported; calibrate with plumb_bob or rational_polynomial or equid"
    ):
        FORMATS["ros"].read(MESSAGE.replace("MODEL", "fov"), "info.yaml", None)
    with pytest.raises(InputError, match="distortion_coefficients has 5 numbers; it must have 4"):
        FORMATS["ros"].read(MESSAGE.replace("MODEL", "equidistant"), "info.yaml", None)


def test_a_unified_camera_of_kalibr_with_distortion_is_fitted() -> None:
    """Kalibr's omni-radtan is no model of ours: the residual that is told is the one of its formula."""
    found = FORMATS["kalibr"].read(CHAIN, "chain.yaml", "cam2")
    assert found.refit is not None
    assert "omni-radtan" in found.remarks[0]
    pixel, ray = whole_image(found.camera)
    on_unit = published("omni", ray, {"fx": 1, "fy": 1, "cx": 0, "cy": 0, "xi": 0.8})
    lens = np.array([-0.3, 0.1, 0, 0])
    seen = opencv_projection(np.column_stack([on_unit, np.ones(len(ray))]), np.eye(3), lens)
    off = np.linalg.norm(seen * [833, 830] + [373.5, 253.5] - pixel, axis=1)
    assert off.max() == pytest.approx(found.refit.max_px, rel=0.1)  # taken at our rays, not at its


def test_basalts_rational_lens_reaches_over_the_image() -> None:
    """Its rpmax is as far off the axis as the image shows."""
    camera = lens_camera("basalt", "pinhole-radtan8")
    values = json.loads(text_of("basalt", camera, "pinhole-radtan8"))["value0"]["intrinsics"][0]["intrinsics"]
    _, ray = whole_image(camera)
    assert values["rpmax"] == pytest.approx(np.hypot(ray[:, 0], ray[:, 1]).max() / ray[:, 2].min(), rel=0.05)


def test_one_of_basalts_cameras() -> None:
    """A camera is named by its number; lists that do not match and types that are none are refused."""
    text = text_of("basalt", lens_camera("basalt", "ds"), "ds")
    tree = json.loads(text)
    values = tree["value0"]
    values["intrinsics"].append(values["intrinsics"][0])
    with pytest.raises(InputError, match="two lists, with an entry for each"):
        FORMATS["basalt"].read(json.dumps(tree), "b", None)
    values["resolution"].append([900, 700])
    assert FORMATS["basalt"].read(json.dumps(tree), "b", "1").camera.image_size == (900, 700)
    with pytest.raises(InputError, match="camera_type 'fov': not supported; in Basalt use one of pinhole"):
        FORMATS["basalt"].read(text.replace('"ds"', '"fov"'), "b", None)
    with pytest.raises(InputError, match="b: alpha is missing"):
        FORMATS["basalt"].read(text.replace('"alpha"', '"other"'), "b", None)


def test_kalibr_has_no_k3() -> None:
    """k3 is fitted away, not cut off: the file's camera is nearer to ours than ours with k3 at zero."""
    camera = CAMERAS["barrel"]
    held, _ = written("kalibr", "barrel")
    assert held.params[8] == 0
    cut = Camera("opencv", np.array([*camera.params[:8], 0.0]), SIZE)
    pixel, ray = whole_image(camera)
    fitted_rms, cut_rms = (np.sqrt(np.mean((project(one, ray) - pixel) ** 2)) for one in (held, cut))
    assert fitted_rms < 0.5 * cut_rms


CHAIN = """cam0:
  camera_model: pinhole
  intrinsics: [461.629, 460.152, 362.680, 246.049]
  distortion_model: radtan
  distortion_coeffs: [-0.27695497, 0.06712482, 0.00087538, 0.00011556]
  T_cam_imu:
  - [0.01779318, 0.99967549,-0.01822936, 0.07008565]
  - [0.0, 0.0, 0.0, 1.0]
  rostopic: /cam0/image_raw
  resolution: [752, 480]
cam1:
  camera_model: pinhole
  intrinsics: [833.0, 830.0, 373.5, 253.5]
  distortion_model: none
  distortion_coeffs: []
  rostopic: /cam1/image_raw
  resolution: [752, 480]
cam2:
  camera_model: omni
  intrinsics: [0.8, 833.0, 830.0, 373.5, 253.5]
  distortion_model: radtan
  distortion_coeffs: [-0.3, 0.1, 0.0, 0.0]
  resolution: [752, 480]
"""


TWO_BY_TWO = {"image_width": 640, "image_height": 480}
MATRIX = [[600.0, 0.0, 320.5], [0.0, 601.0, 241.5], [0.0, 0.0, 1.0]]
BROWN, KANNALA = [-0.11, 0.08, -0.001, 0.002, 0.0], [0.1, -0.02, 0.001, 0.0002]
RATIONAL = [-0.11, 0.08, -0.001, 0.002, 0.01, 0.02, 0.01, 0.001]


@pytest.mark.parametrize("dump", [json.dumps, yaml.safe_dump, lambda tree: json.dumps(tree, indent=2)])
@pytest.mark.parametrize(
    "keys", [("camera_matrix", "dist_coeffs"), ("mtx", "dist"), ("K", "D"), ("cameraMatrix", "distCoeffs")]
)
@pytest.mark.parametrize("shape", [(5,), (1, 5), (5, 1)])
def test_what_python_programs_dump_of_matrices_is_read(
    dump: Callable[[object], str], keys: tuple[str, str], shape: tuple[int, ...], tmp_path: Path
) -> None:
    """`yaml.dump(K.tolist())` and JSON: rows of a matrix in lists, coefficients in a row or a column."""
    tree = {**TWO_BY_TWO, keys[0]: MATRIX, keys[1]: np.reshape(BROWN, shape).tolist(), "rms": 0.3}
    (tmp_path / "c").write_text(dump(tree))
    opened = open_camera(str(tmp_path / "c"))
    assert opened.format.name == "opencv"
    assert opened.read.remarks == ()
    assert opened.read.camera.params.tolist() == [600, 601, 320.5, 241.5, *BROWN]
    with pytest.raises(InputError, match="camera_matrix has 8 numbers; it must have 9"):
        FORMATS["opencv"].read(dump({**tree, keys[0]: [*MATRIX[:2], MATRIX[2][:2]]}), "c", None)


def test_opencvs_own_json_is_read(tmp_path: Path) -> None:
    """What `cv2.FileStorage` writes as JSON is known by its content, and read exactly."""
    storage = cv2.FileStorage(str(tmp_path / "c.json"), cv2.FILE_STORAGE_WRITE)
    for name, value in TWO_BY_TWO.items():
        storage.write(name, value)
    storage.write("camera_matrix", np.array(MATRIX))
    storage.write("distortion_coefficients", np.array(BROWN))
    storage.release()
    opened = open_camera(str(tmp_path / "c.json"))
    assert opened.format.name == "opencv"
    assert opened.read.camera.params.tolist() == [600, 601, 320.5, 241.5, *BROWN]


@pytest.mark.parametrize(
    "tree",
    [
        {
            "lens_model": "",
            "camera_model": "Y",
            "use_opencv_fisheye": True,
            "fisheye_params": {"camera_matrix": MATRIX},
        },
        {"camera_type": "rgb", "distortion_model": "none"},
        {"calibration": {"K": MATRIX, "D": BROWN}},
        {"cam0": {"camera_model": "pinhole", "intrinsics": [1, 2, 3, 4]}},
    ],
)
def test_other_json_is_no_other_formats_broken_file(tree: object, tmp_path: Path) -> None:
    """What no format knows is said to be of no known kind, whatever words stand in it; broken JSON, to be broken."""
    (tmp_path / "c.json").write_text(json.dumps(tree))
    with pytest.raises(InputError, match="not a camera file of a known kind"):
        open_camera(str(tmp_path / "c.json"))
    (tmp_path / "c.json").write_text(json.dumps(tree)[:-2])
    with pytest.raises(InputError, match="not valid JSON"):
        open_camera(str(tmp_path / "c.json"))


OST = """# oST version 5.0 parameters


[image]

width
640

height
480

[narrow_stereo]

camera matrix
600.000000 0.000000 320.500000
0.000000 601.000000 241.500000
0.000000 0.000000 1.000000

distortion
-0.110000 0.080000 -0.001000 0.002000 0.000000

rectification
1.000000 0.000000 0.000000
0.000000 1.000000 0.000000
0.000000 0.000000 1.000000

projection
600.000000 0.000000 320.500000 0.000000
0.000000 601.000000 241.500000 0.000000
0.000000 0.000000 1.000000 0.000000

"""


def test_what_camera_calibration_prints_is_read(tmp_path: Path) -> None:
    """Its ost.txt; of two cameras in one it says so."""
    (tmp_path / "ost.txt").write_text(OST)
    opened = open_camera(str(tmp_path / "ost.txt"))
    assert opened.format.name == "ros"
    assert opened.read.camera.params.tolist() == [600, 601, 320.5, 241.5, *BROWN]
    assert opened.read.camera.image_size == (640, 480)
    for text, rule in (
        (OST + OST, "several cameras"),
        (OST.replace("601.0", "-1"), "focal length"),
        (OST[: OST.index("distortion")], "distortion_coefficients is missing"),
        (OST.replace("width\n640", "width"), "width must be one number"),
    ):
        with pytest.raises(InputError, match=rule):
            FORMATS["ros"].read(text, "ost.txt", None)


@pytest.mark.parametrize(
    ("binning", "roi"), [((4, 2), None), ((0, 1), (512, 256, 1024, 800)), ((2, 2), (512, 256, 1024, 801))]
)
def test_a_message_of_a_part_of_the_sensor_shows_that_part(
    binning: tuple[int, int], roi: tuple[int, int, int, int] | None
) -> None:
    """K of CameraInfo is the full sensor's: a pixel of the photos is the mean of those of the sensor that it covers."""
    x, y, width, height = roi or (0, 0, 0, 0)
    message = {
        "width": 2064, "height": 1544, "distortion_model": "plumb_bob", "D": BROWN,
        "K": [2400.0, 0, 1030, 0, 2402, 770, 0, 0, 1], "binning_x": binning[0], "binning_y": binning[1],
        "roi": {"x_offset": x, "y_offset": y, "width": width, "height": height, "do_rectify": False},
    }  # fmt: skip
    found = FORMATS["ros"].read(json.dumps(message), "info.json", None)
    across, down = (max(1, by) for by in binning)
    assert found.camera.image_size == ((width or 2064) // across, (height or 1544) // down)
    assert "are applied" in found.remarks[0]
    full = FORMATS["ros"].read(json.dumps({**message, "binning_x": 0, "binning_y": 1, "roi": {}}), "c", None)
    assert full.remarks == ()
    column, row = 7, 11
    covered = np.array([[x + column * across + i, y + row * down + j] for i in range(across) for j in range(down)])
    ray = full.camera.rays(covered.mean(axis=0))
    assert found.camera.project(ray) == pytest.approx([column, row], abs=1e-9)


@pytest.mark.parametrize(
    ("change", "rule"),
    [
        ({"roi": {"x_offset": 600, "width": 100, "height": 100}}, "is no part of the sensor's 640 x 480 px"),
        ({"roi": {"x_offset": 6}}, "is no part"),
        ({"binning_x": 641}, "leaves no pixel"),
        ({"binning_x": -1}, "whole number"),
        ({"binning_y": 1.5}, "whole number"),
        ({"roi": [1, 2]}, "roi must hold names"),
    ],
)
def test_a_part_that_is_none_is_refused(change: dict[str, object], rule: str) -> None:
    """A region beyond the sensor, an offset without a size, a binning that is none."""
    message = {**TWO_BY_TWO, "K": MATRIX, "D": BROWN, "distortion_model": "plumb_bob", **change}
    with pytest.raises(InputError, match=rule):
        FORMATS["ros"].read(json.dumps(message), "c", None)


def test_skew_is_held() -> None:
    """A camera matrix with skew beside Brown's lens is a model of its own: the matrix of what OpenCV's lens shows."""
    message = {**TWO_BY_TWO, "K": [[600.0, 1.5, 320.5], *MATRIX[1:]], "D": BROWN, "distortion_model": "plumb_bob"}
    found = FORMATS["ros"].read(json.dumps(message), "c", None)
    assert (found.camera.model, found.refit) == ("opencv_skew", None)
    assert found.camera.matrix.tolist() == [[600.0, 1.5, 320.5], *MATRIX[1:]]
    pixel, ray = whole_image(found.camera)
    lens = cv2.projectPoints(ray / ray[:, 2:], np.zeros(3), np.zeros(3), np.eye(3), np.array(BROWN))[0][:, 0]
    assert np.column_stack([lens, np.ones(len(lens))]) @ found.camera.matrix[:2].T == pytest.approx(pixel, abs=1e-8)
    assert lost_of(found.camera, fit_to_format(found.camera, FORMATS["opencv"]), FORMATS["opencv"])  # OpenCV takes none


@pytest.mark.parametrize(("model", "lens"), [("rational_polynomial", RATIONAL), ("equidistant", KANNALA)])
def test_skew_beside_other_lenses_is_fitted(model: str, lens: list[float]) -> None:
    """A camera matrix with skew: the closest camera without, and how far it is from OpenCV's projection."""
    message = {**TWO_BY_TWO, "K": MATRIX, "D": lens, "distortion_model": model}
    skewed = {**message, "K": [[600.0, 1.5, 320.5], *MATRIX[1:]]}
    found, straight = (FORMATS["ros"].read(json.dumps(one), "c", None) for one in (skewed, message))
    assert found.refit is not None
    assert straight.refit is None
    assert "skew 1.5 px" in found.remarks[0]
    pixel, ray = whole_image(straight.camera)
    shown = pixel + np.column_stack([1.5 * (pixel[:, 1] - 241.5) / 601, np.zeros(len(pixel))])
    inside = (shown[:, 0] >= 0) & (shown[:, 0] <= 639)
    off = np.linalg.norm(found.camera.project(ray[inside]) - shown[inside], axis=1)
    assert off.max() == pytest.approx(found.refit.max_px, rel=0.1)
    assert off.max() < 0.65  # the skew moves a corner by 0.6
    rounding = {**message, "K": [[600.0, 1e-11, 320.5], *MATRIX[1:]]}
    assert FORMATS["ros"].read(json.dumps(rounding), "c", None).refit is None


@pytest.mark.parametrize(
    ("model", "lens", "count"),
    [
        ("plumb_bob", [*BROWN[:4], *[0.0] * 4], 5),
        ("rational_polynomial", [0.3, 0.05, 0.001, -0.0005, 0.01, 0.5, 0.06, 0.004, *[0.0] * 6], 8),
        ("rational_polynomial", [0.3, 0.05, 0.001, -0.0005, 0.01, 0.5, 0.06, 0.004, 1e-3, 0, 0, 0, 0, 0], 12),
        ("equidistant", [*KANNALA, 0.0], 4),
    ],
)
def test_zeros_at_the_end_are_no_coefficients(model: str, lens: list[float], count: int) -> None:
    """As drivers pad D, such as those of OAK cameras to 14; a number there that is not zero counts."""
    message = {**TWO_BY_TWO, "K": MATRIX, "D": lens, "distortion_model": model}
    found = FORMATS["ros"].read(json.dumps(message), "c", None).camera
    assert len(found.distortion) == count
    assert found.distortion.tolist() == [*lens, 0.0][:count]
    other = json.dumps({**message, "D": [*lens[:-1], 0.1]})
    if len(lens) == len(MODELS["opencv14"].opencv_lens or ()):
        assert FORMATS["ros"].read(other, "c", None).camera.model == "opencv14"
    else:
        with pytest.raises(InputError, match=f"has {len(lens)} numbers; it must have"):
            FORMATS["ros"].read(other, "c", None)


def test_one_camera_of_a_chain() -> None:
    """Of several cameras one is named; which there are is said if none or another is."""
    read = FORMATS["kalibr"].read
    camera = read(CHAIN, "chain.yaml", "cam0").camera
    assert camera.params.tolist() == [
        461.629,
        460.152,
        362.68,
        246.049,
        -0.27695497,
        0.06712482,
        0.00087538,
        0.00011556,
        0,
    ]
    assert read(CHAIN, "chain.yaml", "cam1").camera.model == "pinhole"
    windows = CHAIN.replace("rostopic: /cam0/image_raw", 'rostopic: "C:\\Users\\new"')
    assert windows != CHAIN
    assert read(windows, "chain.yaml", "cam0").camera.params.tolist() == camera.params.tolist()
    with pytest.raises(InputError, match=r"holds 3 cameras \(cam0, cam1, cam2\); name one, as in FILE#cam0"):
        read(CHAIN, "chain.yaml", None)
    with pytest.raises(InputError, match="holds no camera 'cam7'; there is cam0, cam1, cam2"):
        read(CHAIN, "chain.yaml", "cam7")
    with pytest.raises(
        InputError, match="distortion_model 'ds' and 'radtan': not supported; calibrate with pinhole-rad"
    ):
        read(CHAIN.replace("omni", "ds"), "chain.yaml", "cam2")
