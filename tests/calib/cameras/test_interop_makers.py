"""Cameras as their makers' and other programs' files have them, against equations published or in their sources."""

import json
import struct
import zlib
from contextlib import suppress
from pathlib import Path

import cv2
import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from scipy.io import loadmat, savemat

import calib
from calib.cameras.camera import Camera
from calib.cameras.formats import ACCEPTED_PX, FORMATS, READ_FORMATS, READ_RIG_FORMATS
from calib.cameras.formats.reading import open_camera, recognise, recognise_rig
from calib.cameras.formats.rig_format import RigFiles
from calib.cameras.refit import image_grid
from calib.cameras.rig import Rig
from calib.core.se3 import exp_rotation, make_pose
from designer.base.arrays import Array
from designer.base.errors import InputError
from tests.support.foreign_cameras import CAMERAS, text_of
from tests.support.foreign_rigs import rig_texts, ring, stereo

ZED = """[LEFT_CAM_HD]
fx=700.5
fy=700.1
cx=639.2
cy=361.8
k1=-0.171
k2=0.0273
p1=0.0001
p2=-0.0002
k3=0

[RIGHT_CAM_HD]
fx=701.0
fy=700.6
cx=641.5
cy=360.2
k1=-0.169
k2=0.0261
p1=0
p2=0
k3=0

[STEREO]
Baseline=119.87
TY=0.05
TZ=-0.4
CV_HD=0.0021
RX_HD=-0.0009
RZ_HD=0.0004
"""
DEPTH = [0.5122697949409485, 0.49451231956481934, 0.4921168386936188, 0.4921667277812958]
DEPTH += [3.1305770874023438, 2.324939012527466, 0.1304156482219696, 3.458651542663574, 3.350114583969116]
DEPTH += [0.6629416346549988, 0, 0, -0.0000511557373101823, 0.00008132171933539212]
COLOR = [0.4967627227306366, 0.5108628273010254, 0.470907062292099, 0.6274453997612]
COLOR += [0.7227460145950317, -2.8855903148651123, 1.6327226161956787, 0.6021990180015564, -2.7196261882781982]
COLOR += [1.565053105354309, 0, 0, -0.0001431911950930953, 0.0007828465895727277]


def kinect_camera(place: str, numbers: list[float], size: tuple[int, int], shift: list[float]) -> dict[str, object]:
    turn = exp_rotation(np.array([0.1, 0, 0]) if any(shift) else np.zeros(3))
    return {
        "Intrinsics": {"ModelParameters": numbers, "ModelType": "CALIBRATION_LensDistortionModelBrownConrady"},
        "Location": f"CALIBRATION_CameraLocation{place}",
        "Rt": {"Rotation": turn.ravel().tolist(), "Translation": shift},
        "SensorWidth": size[0],
        "SensorHeight": size[1],
    }


KINECT = json.dumps(
    {
        "CalibrationInformation": {
            "Cameras": [
                kinect_camera("D0", DEPTH, (1024, 1024), [0, 0, 0]),
                kinect_camera("PV0", COLOR, (4096, 3072), [-0.032, -0.002, 0.004]),
            ]
        }
    }
)
OCAM = """#polynomial coefficients for the DIRECT mapping function (ocam_model.ss in MATLAB). Used by cam2world

5 -2.065170e+02 0.000000e+00 2.207161e-03 -4.879622e-06 1.865656e-08

#polynomial coefficients for the inverse mapping function (ocam_model.invpol in MATLAB). These are used by world2cam

3 294.182260 152.289570 -12.191217

#center: "row" and "column", starting from 0 (C convention)

241.800066 394.552874

#affine parameters "c", "d", "e"

1.000330 0.000219 0.000257

#image size: "height" and "width"

480 752
"""
SAMPLES = {"zed": ZED, "azure_kinect": KINECT, "ocamcalib": OCAM}
"""Of the formats that are only read."""


def read(name: str, text: str, wanted: str | None = None) -> Camera:
    return READ_FORMATS[name].read(text, "f.x", wanted).camera


def rig_of(name: str, text: str) -> Rig:
    return READ_RIG_FORMATS[name].read(RigFiles({"f": text}, "f.x", READ_RIG_FORMATS[name].unit)).rig


def test_every_format_that_is_only_read_has_its_file_here() -> None:
    """So that the laws of this page hold for a further one."""
    assert set(SAMPLES) == set(READ_FORMATS) - set(FORMATS)


def test_no_file_is_claimed_by_two_formats() -> None:
    """But OpenCV's matrices, which stand in many files, and mrcal's name of a lens in PhotonVision's, come after."""
    texts = SAMPLES | {name: text_of(name, CAMERAS["barrel"]) for name in FORMATS}
    general = {"ros": {"opencv"}, "photonvision": {"mrcal"}}
    for name, text in texts.items():
        claimed = {other for other, form in READ_FORMATS.items() if form.recognised.search(text)}
        assert claimed - general.get(name, set()) == {name}
        assert recognise(text) is READ_FORMATS[name]
    rigs = {name: SAMPLES[name] for name in SAMPLES if name in READ_RIG_FORMATS}
    rigs |= {name: next(iter(rig_texts(name, stereo()).values())) for name in ("depthai", "orbslam")}
    for name, text in rigs.items():
        assert {other for other, form in READ_RIG_FORMATS.items() if form.recognised.search(text)} == {name}
        assert recognise_rig(text) is READ_RIG_FORMATS[name]


@pytest.mark.parametrize("name", SAMPLES)
@settings(max_examples=40, deadline=None, suppress_health_check=[HealthCheck.too_slow])
@given(data=st.data())
def test_damaged_files_are_read_or_refused(name: str, data: st.DataObject) -> None:
    """As those of the formats that are written; the rig in them, too."""
    text = SAMPLES[name]
    for _ in range(data.draw(st.integers(1, 4))):
        start = data.draw(st.integers(0, len(text)))
        end = data.draw(st.integers(start, min(len(text), start + 30)))
        text = text[:start] + data.draw(st.text("0.-e[]{}<>:,'\"!=#\n\t x\x00é", max_size=8)) + text[end:]
    with suppress(InputError):
        read(name, text, None)
    with suppress(InputError, KeyError):
        rig_of(name, text)


@pytest.mark.parametrize("name", [*FORMATS, *SAMPLES])
def test_a_file_of_nothing_is_one_line(name: str) -> None:
    """Empty, an empty object, lists and words where there should be numbers."""
    for text in ("", "{}", "[]", "x", '{"ppx": []}', '{"cameraData": [[0, 1]]}', "model_type: [MEI]", "[LEFT_CAM_HD]"):
        with pytest.raises(InputError, match=r"^f\.x: ") as caught:
            read(name, text)
        assert len(str(caught.value)) < 300


def test_the_docs_name_what_is_only_read() -> None:
    """A row in each table of docs/calibrate.md."""
    page = (Path(__file__).parents[3] / "docs/calibrate.md").read_text()
    for name in SAMPLES:
        count = 1 + (name in READ_RIG_FORMATS)
        assert page.count(f"| `{name}` {READ_FORMATS[name].title} |") == count


def on_plane(camera: Camera, pixel: Array) -> Array:
    """X/Z, Y/Z (N, 2) of what the camera sees."""
    ray = camera.rays(pixel)
    return np.asarray(ray[:, :2] / ray[:, 2:])


REALSENSE = {"width": 1280, "height": 720, "ppx": 643.1, "ppy": 362.2, "fx": 911.0, "fy": 910.2}
COEFFICIENTS = [-0.0548, 0.0648, -0.0009, 0.0013, -0.0208]


def modified(plane: Array) -> Array:
    """rs2_project_point_to_pixel of the models called modified and inverse: tangential parts of the bent point."""
    k1, k2, p1, p2, k3 = COEFFICIENTS
    s = (plane**2).sum(axis=1)
    x, y = (plane * (1 + k1 * s + k2 * s**2 + k3 * s**3)[:, None]).T
    return np.column_stack([x + 2 * p1 * x * y + p2 * (s + 2 * x * x), y + 2 * p2 * x * y + p1 * (s + 2 * y * y)])


@pytest.mark.parametrize(("model", "said"), [("modified_brown_conrady", "distortion."), ("inverse_brown_conrady", "")])
def test_realsense_lenses_that_are_none_of_ours_are_fitted(model: str, said: str) -> None:
    """Within what is accepted of librealsense's own projection; of the one that changed its meaning that is told."""
    found = FORMATS["realsense"].read(
        json.dumps({**REALSENSE, "model": said + model, "coeffs": COEFFICIENTS}), "f", None
    )
    pixel = image_grid((1280, 720)).reshape(-1, 2)
    back = modified(on_plane(found.camera, pixel)) * [911.0, 910.2] + [643.1, 362.2]
    assert found.refit is not None
    assert np.abs(back - pixel).max() < 1.5 * found.refit.max_px < ACCEPTED_PX
    told = [line for line in found.remarks if "earlier ones undistorted" in line]
    assert bool(told) == model.startswith("inverse")
    if told:
        plane = (pixel - [643.1, 362.2]) / [911.0, 910.2]
        k1, k2, p1, p2, k3 = COEFFICIENTS
        x, y = plane.T
        s = x * x + y * y
        f = 1 + k1 * s + k2 * s**2 + k3 * s**3
        older = np.column_stack(
            [x * f + 2 * p1 * x * y + p2 * (s + 2 * x * x), y * f + 2 * p2 * x * y + p1 * (s + 2 * y * y)]
        )
        away = np.linalg.norm(modified(older) * [911.0, 910.2] + [643.1, 362.2] - pixel, axis=1).max()
        assert f"up to {away:.2g} px" in told[0]


def test_realsense_ftheta_is_the_lens_of_devernay_and_faugeras() -> None:
    """r_d = atan(2 r tan(w/2)) / w, as rs2_project_point_to_pixel has it."""
    w = 0.92
    found = FORMATS["realsense"].read(json.dumps({**REALSENSE, "model": 3, "coeffs": [w, 0, 0, 0, 0]}), "f", None)
    pixel = image_grid((1280, 720)).reshape(-1, 2)
    plane = on_plane(found.camera, pixel)
    radius = np.linalg.norm(plane, axis=1, keepdims=True)
    back = plane * np.arctan(2 * radius * np.tan(w / 2)) / w / radius * [911.0, 910.2] + [643.1, 362.2]
    assert found.refit is not None
    assert np.abs(back - pixel).max() < 1.5 * found.refit.max_px < ACCEPTED_PX


def test_realsense_as_its_program_prints_it(tmp_path: Path) -> None:
    """Several streams, a name each; several formats of pixels of one stream are one camera."""
    stream = """ Intrinsic of "{}" / {}x720 / {{{}}}
  Width:      \t{}
  Height:     \t720
  PPX:        \t643.1
  PPY:        \t362.2
  Fx:         \t911
  Fy:         \t910.2
  Distortion: \tInverse Brown Conrady
  Coeffs:     \t0  0  0  0  0
  FOV (deg):  \t70.1 x 43.2

"""
    text = stream.format("Color", 1280, "RGB8", 1280) + stream.format("Color", 1280, "YUYV", 1280)
    (tmp_path / "rs.txt").write_text(text)
    camera = open_camera(str(tmp_path / "rs.txt")).read
    assert camera.remarks == ()
    assert (camera.camera.model, camera.camera.params.tolist()) == ("pinhole", [911.0, 910.2, 643.1, 362.2])
    (tmp_path / "rs.txt").write_text(text + stream.format("Depth", 848, "Z16", 848))
    with pytest.raises(InputError, match=r"holds 2 cameras \(Color 1280x720, Depth 848x720\)"):
        open_camera(str(tmp_path / "rs.txt"))
    assert open_camera(f"{tmp_path / 'rs.txt'}#Depth 848x720").read.camera.image_size == (848, 720)


def test_zed_sees_as_opencv_does_with_its_numbers() -> None:
    """Both eyes: cv2.projectPoints with the right camera at x2 = Rodrigues(RX CV RZ) x1 + (-Baseline TY TZ) mm."""
    rig = rig_of("zed", ZED)
    assert rig.names == ("LEFT_HD", "RIGHT_HD")
    point = np.random.default_rng(1).uniform((-500, -300, 900), (500, 300, 1500), (40, 3))
    poses = ((np.zeros(3), np.zeros(3)), (np.array([-0.0009, 0.0021, 0.0004]), np.array([-119.87, 0.05, -0.4])))
    matrices = (700.5, 700.1, 639.2, 361.8), (701.0, 700.6, 641.5, 360.2)
    lenses = (-0.171, 0.0273, 0.0001, -0.0002, 0), (-0.169, 0.0261, 0, 0, 0)
    for row, ((turn, shift), (fx, fy, cx, cy), lens) in enumerate(zip(poses, matrices, lenses, strict=True)):
        matrix = np.array([[fx, 0, cx], [0, fy, cy], [0, 0, 1]])
        pixel, _ = cv2.projectPoints(point, turn, shift, matrix, np.array(lens, dtype=float))
        seen = rig.cameras[row].project(point @ rig.cam_from_rig[row, :3, :3].T + rig.cam_from_rig[row, :3, 3])
        assert np.abs(seen - pixel[:, 0]).max() < 1e-6
    assert read("zed", ZED, "RIGHT_HD").image_size == (1280, 720)
    shared = ZED.replace("k1=-0.171\nk2=0.0273\n", "") + "[LEFT_DISTO]\nk1=-0.171\nk2=0.0273\n"
    assert np.array_equal(read("zed", shared, "LEFT_HD").params, read("zed", ZED, "LEFT_HD").params)


def test_azure_kinect_modes_are_as_its_sdk_has_them() -> None:
    """A raw calibration, and what k4a_calibration_get told of that device for two modes, published by its owner."""
    depth, color = read("azure_kinect", KINECT, "depth-nfov"), read("azure_kinect", KINECT, "color-1080p")
    np.testing.assert_allclose(depth.params[:4], [503.927643, 503.978729, 332.064270, 325.880615], rtol=2e-7)
    np.testing.assert_allclose(color.params[:4], [904.141541, 903.521362, 953.284424, 555.142456], rtol=2e-7)
    assert (depth.image_size, color.image_size) == ((640, 576), (1920, 1080))
    p1, p2 = 0.0007828465895727277, -0.0001431911950930953
    assert (color.parameters["p1"], color.parameters["p2"], color.parameters["k6"]) == (p1, p2, COLOR[9])
    rig = rig_of("azure_kinect", KINECT)
    pose = make_pose(exp_rotation(np.array([0.1, 0, 0])), np.array([-32.0, -2, 4]))
    assert np.allclose(rig.cam_from_rig[rig.row("color-720p")], pose)
    assert np.array_equal(rig.cam_from_rig[rig.row("depth")], np.eye(4))
    wide = [COLOR[0], (COLOR[1] * 3072 - 384) / 2304, COLOR[2], COLOR[3] * 3072 / 2304, *COLOR[4:]]
    old = KINECT.replace(json.dumps(COLOR), json.dumps(wide)).replace('"SensorHeight": 3072', '"SensorHeight": 2304')
    np.testing.assert_allclose(read("azure_kinect", old, "color-1080p").params, color.params, rtol=1e-12)


def cam2world(row: Array, column: Array) -> Array:
    """OCamCalib's function of that name, with the sample's numbers; x down, y right, z away from what is seen."""
    c, d, e = 1.000330, 0.000219, 0.000257
    bent = np.stack([row - 241.800066, column - 394.552874])
    x, y = np.linalg.solve([[c, d], [e, 1]], bent)
    rho = np.hypot(x, y)
    z = -2.065170e02 + 2.207161e-03 * rho**2 - 4.879622e-06 * rho**3 + 1.865656e-08 * rho**4
    ray = np.column_stack([x, y, z])
    return ray / np.linalg.norm(ray, axis=1, keepdims=True)


def test_scaramuzzas_polynomial_is_fitted() -> None:
    """As cam2world has it, rows first and z reversed; camodocal's YAML has the same camera with u first."""
    found = READ_FORMATS["ocamcalib"].read(OCAM, "f.x", None)
    assert found.refit is not None
    assert found.camera.image_size == (752, 480)
    pixel = image_grid((752, 480)).reshape(-1, 2)
    pixel = pixel[np.linalg.norm(pixel - [394.5, 241.8], axis=1) < 300]
    ray = cam2world(pixel[:, 1], pixel[:, 0])[:, [1, 0, 2]] * [1, 1, -1]
    assert np.linalg.norm(found.camera.project(ray) - pixel, axis=1).max() <= found.refit.max_px * 1.01
    # Its affine part ends in 1, so that its unit is c times as small, and the polynomial's with it.
    c, d, e = 1.000330, 0.000219, 0.000257
    terms = [
        value * c ** (1 - k) for k, value in enumerate((-2.065170e02, 0, 2.207161e-03, -4.879622e-06, 1.865656e-08))
    ]
    groups = {
        "poly": {f"p{k}": value for k, value in enumerate(terms)},
        "affine": {"ac": 1 / c, "ad": e / c, "ae": d / c, "cx": 394.552874, "cy": 241.800066},
    }
    yaml = "model_type: scaramuzza\nimage_width: 752\nimage_height: 480\n" + "".join(
        f"{name}_parameters:\n" + "".join(f"   {key}: {value!r}\n" for key, value in values.items())
        for name, values in groups.items()
    )
    also = FORMATS["vins"].read(yaml, "f.x", None).camera
    assert np.abs(also.project(ray) - found.camera.project(ray)).max() < 1e-4


def test_mei_with_distortion_is_fitted() -> None:
    """CataCamera::spaceToPlane: onto the sphere, up by xi, Brown's distortion, gamma and centre."""
    xi, k1, k2, p1, p2 = 0.9, -0.03, 0.01, 0.0003, -0.0002
    camera = Camera("omni", np.array([700.0, 701, 495, 402, xi]), (1000, 800))
    text = text_of("vins", camera)
    for key, value in (("k1", k1), ("k2", k2), ("p1", p1), ("p2", p2)):
        text = text.replace(f"   {key}: 0.0\n", f"   {key}: {value}\n")
    found = FORMATS["vins"].read(text, "f.x", None)
    assert found.refit is not None
    pixel = image_grid((1000, 800)).reshape(-1, 2)
    ray = found.camera.rays(pixel)
    x, y = (ray[:, :2] / (ray[:, 2:] + xi)).T
    s = x * x + y * y
    f = 1 + k1 * s + k2 * s * s
    bent = np.column_stack(
        [x * f + 2 * p1 * x * y + p2 * (s + 2 * x * x), y * f + 2 * p2 * x * y + p1 * (s + 2 * y * y)]
    )
    assert np.abs(bent * [700.0, 701] + [495, 402] - pixel).max() < 1.5 * found.refit.max_px < 2 * ACCEPTED_PX


def test_nerfstudio_k4_and_cameras_of_frames() -> None:
    """Its k4 is a polynomial's, not a denominator's; where frames have cameras of their own one is named."""
    values = json.loads(text_of("nerfstudio", CAMERAS["barrel"])) | {"k4": 0.02}
    found = FORMATS["nerfstudio"].read(json.dumps(values), "f.x", None)
    assert found.refit is not None
    x, y = on_plane(found.camera, pixel := image_grid((1024, 768)).reshape(-1, 2)).T
    s = x * x + y * y
    f = 1 - 0.3 * s + 0.1 * s**2 - 0.012 * s**3 + 0.02 * s**4
    p1, p2 = values["p1"], values["p2"]
    bent = np.column_stack(
        [x * f + 2 * p1 * x * y + p2 * (s + 2 * x * x), y * f + 2 * p2 * x * y + p1 * (s + 2 * y * y)]
    )
    off = bent * [values["fl_x"], values["fl_y"]] + [values["cx"] - 0.5, values["cy"] - 0.5] - pixel
    assert np.abs(off).max() < 1.5 * found.refit.max_px
    own = {key: values.pop(key) for key in ("fl_x", "fl_y", "cx", "cy")}
    frames = [{"file_path": f"{k}.png", **own, "cx": own["cx"] + (k > 1), "transform_matrix": []} for k in range(3)]
    text = json.dumps({**values, "k4": 0.0, "frames": frames})
    with pytest.raises(InputError, match=r"holds 2 cameras \(0\.png, 2\.png\)"):
        read("nerfstudio", text)
    found = FORMATS["nerfstudio"].read(text, "f.x", "2.png")
    assert found.camera.params[2] == pytest.approx(CAMERAS["barrel"].params[2] + 1)
    assert found.remarks == ("the poses of 3 frames are not read",)


def test_gyroflow_says_what_it_leaves_out() -> None:
    """A centre that Gyroflow would not use, a lens and a stretch that are not supported, and what is not used."""
    values = json.loads(text_of("gyroflow", CAMERAS["barrel"]))
    for key, wrong in (("distortion_model", "poly5"), ("input_horizontal_stretch", 1.33)):
        with pytest.raises(InputError, match=f"{key}.*not supported"):
            read("gyroflow", json.dumps({**values, key: wrong}))
    found = FORMATS["gyroflow"].read(json.dumps({**values, "asymmetrical": False, "fps": 30}), "f.x", None)
    assert "Gyroflow takes the middle" in found.remarks[0]
    assert found.remarks[1:] == ("not used: 'fps'",)
    assert found.camera.params[2] == CAMERAS["barrel"].params[2]


def test_photonvision_older_files_and_a_cameras_settings() -> None:
    """`cameraExtrinsics` are the coefficients; of several resolutions one is named."""
    values = json.loads(text_of("photonvision", CAMERAS["barrel"]))
    older = {**values, "cameraExtrinsics": values["distCoeffs"]}
    del older["distCoeffs"], older["lensmodel"]
    assert np.array_equal(read("photonvision", json.dumps(older)).params, CAMERAS["barrel"].params)
    smaller = {**values, "resolution": {"width": 640, "height": 480}, "observations": [1]}
    settings_file = json.dumps({"calibrations": [values, smaller]})
    with pytest.raises(InputError, match="holds 2 cameras"):
        read("photonvision", settings_file)
    found = FORMATS["photonvision"].read(settings_file, "f.x", "640x480")
    assert (found.camera.image_size, found.remarks) == ((640, 480), ("not used: 'observations'",))


def test_a_chain_of_oak_cameras() -> None:
    """B to C to A, as the factory links them: x_to = R x + t in cm, or t of the design where none was measured."""
    rig = ring()
    tree = json.loads(next(iter(rig_texts("depthai", rig).values())))
    cameras = dict[int, dict[str, object]](tree["cameraData"])
    turn = exp_rotation(np.array([0.02, -0.01, 0.03]))
    place = {"rotationMatrix": turn.tolist(), "lengthUnit": 1}
    zero = dict.fromkeys("xyz", 0.0)
    cameras[0]["extrinsics"]["toCameraSocket"] = -1
    cameras[1]["extrinsics"] = {**place, "toCameraSocket": 2, "translation": {"x": -7.5, "y": 0.1, "z": 0}}
    cameras[2]["extrinsics"] = {**place, "toCameraSocket": 0, "translation": zero, "specTranslation": {"x": 3.75}}
    found = rig_of("depthai", json.dumps(tree))
    assert found.names == ("CAM_A", "CAM_B", "CAM_C")
    point = np.array([10.0, 20, 500])
    in_b = found.cam_from_rig[1, :3, :3] @ point + found.cam_from_rig[1, :3, 3]
    in_c = turn @ in_b + [-75, 1, 0]
    assert np.allclose(turn @ in_c + [37.5, 0, 0], point)
    assert np.allclose(in_c, found.cam_from_rig[2, :3, :3] @ point + found.cam_from_rig[2, :3, 3])
    cameras[1]["extrinsics"]["toCameraSocket"] = -1
    with pytest.raises(InputError, match="nothing says where CAM_B stands to CAM_A; name one camera, as in FILE#CAM_B"):
        rig_of("depthai", json.dumps(tree))
    assert read("depthai", json.dumps(tree), "CAM_B").image_size == rig.cameras[1].image_size


def test_orbslam_pairs(tmp_path: Path) -> None:
    """T_c1_c2 takes points from the second camera; two kinds of lens are refused; older and rectified are read."""
    rig = stereo()
    (text,) = rig_texts("orbslam", rig).values()
    (tmp_path / "s.yaml").write_text(text)
    file = cv2.FileStorage(str(tmp_path / "s.yaml"), cv2.FILE_STORAGE_READ)
    matrix = file.getNode("Stereo.T_c1_c2").mat()
    point = np.array([100.0, -50, 900])
    in_second = rig.cam_from_rig[1, :3, :3] @ point + rig.cam_from_rig[1, :3, 3]
    assert np.allclose(matrix[:3, :3] @ in_second / 1000 + matrix[:3, 3], point / 1000)
    with pytest.raises(
        InputError, match=r"ORB-SLAM3 has one Camera\.type and one image size for both cameras, here are Pin"
    ):
        rig_texts("orbslam", ring(ring().cameras[:2]))
    lines = [line for line in text.splitlines() if line.startswith(("Camera.", "Camera1."))]
    older = "%YAML:1.0\n" + "\n".join(lines).replace("Camera1.", "Camera.")
    assert np.array_equal(read("orbslam", older).params, rig.cameras[0].params)
    rectified = older.replace("PinHole", "Rectified").replace("Camera.fx", "Camera1.fx") + "\nStereo.b: 0.12\n"
    rectified = rectified.replace("Camera.fy", "Camera1.fy").replace("Camera.c", "Camera1.c")
    assert rig_of("orbslam", rectified).cam_from_rig[1, :3, 3].tolist() == [-120.0, 0, 0]


def in_mat(folder: Path, **variables: object) -> Path:
    """A MAT file as SciPy writes them, compressed if it is of an odd number of variables."""
    savemat(folder / "c.mat", variables, do_compression=bool(len(variables) % 2))
    return folder / "c.mat"


TURNED = np.array([[600.0, 0, 0], [1.5, 601, 0], [321.5, 242.5, 1]])
MATLAB: dict[str, object] = {
    "RadialDistortion": [-0.3, 0.1],
    "TangentialDistortion": [0.001, -0.002],
    "ImageSize": [480, 640],
    "WorldUnits": "centimeters",
    "ReprojectionErrors": np.zeros((50, 2, 9)),
}


def test_matlab_structs(tmp_path: Path) -> None:
    """Compressed or not, K or its transpose, pixels from 1, skew, a struct's fields alone, and fisheyes."""
    older, newer = {**MATLAB, "IntrinsicMatrix": TURNED}, {**MATLAB, "K": TURNED.T}
    found = open_camera(str(in_mat(tmp_path, cameraParams=older))).read.camera
    expected = [600.0, 601, 320.5, 241.5, -0.3, 0.1, 0.001, -0.002, 0, 1.5]
    assert (found.model, found.image_size, found.params.tolist()) == ("opencv_skew", (640, 480), expected)
    assert np.array_equal(open_camera(str(in_mat(tmp_path, **newer))).read.camera.params, found.params)
    with pytest.raises(InputError, match=r"holds 2 cameras \(a, b\)"):
        open_camera(str(in_mat(tmp_path, a=older, b=newer)))
    assert open_camera(f"{tmp_path / 'c.mat'}#b").read.camera.model == "opencv_skew"
    fisheye = {"MappingCoefficients": [206.5170, -2.207161e-03, 4.879622e-06, -1.865656e-08], "ImageSize": [480, 752],
               "StretchMatrix": np.eye(2), "DistortionCenter": [395.552874, 242.800066]}  # fmt: skip
    with pytest.raises(InputError, match="none of ours"):
        open_camera(str(in_mat(tmp_path, fisheyeParams={"Intrinsics": fisheye})))
    wide = open_camera(str(tmp_path / "c.mat"), accept_px=3).read
    assert wide.refit is not None
    pixel = np.array([[400.0, 300], [300, 200], [500, 100]])
    m = pixel - [394.552874, 241.800066]
    rho = np.hypot(*m.T)
    z = 206.5170 - 2.207161e-03 * rho**2 + 4.879622e-06 * rho**3 - 1.865656e-08 * rho**4
    assert np.abs(wide.camera.project(np.column_stack([m, z])) - pixel).max() < wide.refit.max_px


def test_matlab_pairs(tmp_path: Path) -> None:
    """Rows: x2 = x1 RotationOfCamera2 + TranslationOfCamera2 in its unit, or PoseCamera2; ours as SciPy reads it."""
    turn, shift = exp_rotation(np.array([0.03, -0.06, 0.02])), np.array([-12.0, 0.4, 0.9])
    pair = {f"CameraParameters{k}": {**MATLAB, "K": TURNED.T} for k in (1, 2)}
    place = in_mat(tmp_path, stereoParams={**pair, "RotationOfCamera2": turn.T, "TranslationOfCamera2": shift})
    rig = calib.load_rig(place)
    assert np.allclose(rig.cam_from_rig[1], make_pose(turn, 10 * shift))
    assert open_camera(f"{place}#CameraParameters2").read.camera.image_size == (640, 480)
    pose = {"A": make_pose(turn, shift)}
    assert np.allclose(calib.load_rig(in_mat(tmp_path, s={**pair, "PoseCamera2": pose})).cam_from_rig, rig.cam_from_rig)
    ours, point = stereo(), np.array([10.0, 20, 900])
    calib.convert(ours, "matlab", unit="m", out=tmp_path / "ours.mat")
    struct_of = loadmat(tmp_path / "ours.mat")["stereoParams"][0, 0]
    second = point / 1000 @ struct_of["RotationOfCamera2"] + struct_of["TranslationOfCamera2"][0]
    assert np.allclose(1000 * second, ours.cam_from_rig[1, :3, :3] @ point + ours.cam_from_rig[1, :3, 3])
    assert np.allclose(calib.load_rig(tmp_path / "ours.mat").cam_from_rig, ours.cam_from_rig)


def test_hostile_mat_files(tmp_path: Path) -> None:
    """Cut off, damaged, another version, an object, and one that swells: a line at once, and no memory filled."""
    content = in_mat(tmp_path, cameraParams={**MATLAB, "K": TURNED.T}, other=1).read_bytes()
    rng = np.random.default_rng(5)

    def opened(changed: bytes) -> Camera:
        decode = FORMATS["matlab"].decode
        assert decode is not None
        return read("matlab", decode(changed, "f.x"))

    def refused(changed: bytes) -> str:
        with pytest.raises(InputError, match=r"^f\.x: ") as caught:
            opened(changed)
        assert len(str(caught.value).splitlines()) == 1
        return str(caught.value)

    for size in (0, 100, 127, 128, 140, 300):
        refused(content[:size])
    for _ in range(300):
        changed = bytearray(content)
        for at in rng.integers(128, 1200, 3):
            changed[at] = rng.integers(256)
        with suppress(InputError):
            opened(bytes(changed))
    assert 'save(..., "-v7")' in refused(b"MATLAB 7.3 MAT-file".ljust(200))
    swelling = zlib.compress(b"\0" * 2**26, 9)
    assert "cut off or damaged" in refused(content[:128] + struct.pack("<2I", 15, len(swelling)) + swelling)
    flags, name = struct.pack("<4I", 6, 8, 17, 0), struct.pack("<2H4s", 1, 3, b"cam")
    item = flags + name + struct.pack("<2H4s", 1, 4, b"MCOS") + struct.pack("<2I16s", 1, 16, b"cameraParameters")
    assert "cam is an object of MATLAB's" in refused(content[:128] + struct.pack("<2I", 14, len(item)) + item)
    huge = flags.replace(b"\x11", b"\x02") + struct.pack("<4I", 5, 8, 2**31 - 1, 2**31 - 1) + name
    refused(content[:128] + struct.pack("<2I", 14, len(huge)) + huge)


def test_files_are_found_out_and_used_by_every_command(tmp_path: Path) -> None:
    """By content, one camera of several by its name; a rig's two by `cameras`."""
    (tmp_path / "SN1.conf").write_text(ZED)
    (tmp_path / "k.json").write_text(KINECT)
    assert calib.load_camera(f"{tmp_path / 'SN1.conf'}#LEFT_HD").image_size == (1280, 720)
    assert calib.load_rig(tmp_path / "SN1.conf").names == ("LEFT_HD", "RIGHT_HD")
    done = calib.convert(tmp_path / "k.json", "opencv", cameras=["depth", "color-720p"])
    assert done.rig.names == ("depth", "color-720p")
