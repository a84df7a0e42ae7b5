"""Rig files against the programs that they are for: OpenCV, COLMAP and mrcal; Kalibr and ROS by their equations."""

import xml.etree.ElementTree as ET
from dataclasses import replace
from pathlib import Path

import cv2
import numpy as np
import pycolmap
import pytest
import yaml
from scipy.spatial.transform import Rotation

from calib.cameras.camera import Camera
from calib.cameras.formats.reading import open_rig
from calib.cameras.rig import rectified_pair
from calib.core.se3 import exp_rotation, invert, make_pose, transform
from designer.base.arrays import Array
from designer.base.errors import InputError
from tests.support.foreign_cameras import ask_mrcal
from tests.support.foreign_rigs import (
    BROWN,
    FISHEYE,
    held_by,
    points_before,
    read_texts,
    rig_texts,
    ring,
    seen_by,
    stereo,
    write_texts,
)

CLOSE_PX = 1e-6
PINHOLE = Camera("pinhole", np.array([900.0, 880, 510, 390]), (1024, 768))


def cv_nodes(text: str, folder: Path) -> cv2.FileStorage:
    """A text as OpenCV reads it."""
    (folder / "stereo.yaml").write_text(text)
    return cv2.FileStorage(str(folder / "stereo.yaml"), cv2.FILE_STORAGE_READ)


def cv_pixels(
    points: np.ndarray, pose: tuple[np.ndarray, np.ndarray], k: np.ndarray, d: np.ndarray, wide: bool
) -> np.ndarray:
    """Where OpenCV's own projection sees points."""
    project = cv2.fisheye.projectPoints if wide else cv2.projectPoints
    return project(points[:, None], cv2.Rodrigues(pose[0])[0], pose[1], k, d)[0][:, 0]


@pytest.mark.parametrize("camera", [BROWN, FISHEYE])
@pytest.mark.parametrize(("unit", "unit_mm"), [("mm", 1.0), ("m", 1000.0)])
def test_opencv_sees_a_point_where_the_pair_does(camera: Camera, unit: str, unit_mm: float, tmp_path: Path) -> None:
    """K1 D1 K2 D2 R T, read by OpenCV and projected by it, in millimetres and in metres."""
    rig = stereo(camera)
    file = cv_nodes(*rig_texts("opencv", rig, unit).values(), tmp_path)
    wide = bool(file.getNode("fisheye_model").real())
    assert wide == (camera is FISHEYE)
    assert file.getNode("length_unit").string() == unit
    read = {name: file.getNode(name).mat() for name in ("K1", "D1", "K2", "D2", "R", "T")}
    point = points_before(rig)
    poses = ((np.eye(3), np.zeros(3)), (read["R"], read["T"]))
    for row, (pose, pixel) in enumerate(zip(poses, seen_by(rig, point), strict=True), start=1):
        found = cv_pixels(point / unit_mm, pose, read[f"K{row}"], read[f"D{row}"], wide)
        assert np.abs(found - pixel).max() < CLOSE_PX


def test_opencv_points_lie_on_their_epipolar_lines(tmp_path: Path) -> None:
    """`x2^T F x1 = 0` of pixels without a lens, and `x2^T E x1 = 0` of directions; F ends in 1, as OpenCV has it."""
    rig = stereo(PINHOLE)
    file = cv_nodes(*rig_texts("opencv", rig).values(), tmp_path)
    essential, fundamental = file.getNode("E").mat(), file.getNode("F").mat()
    first, second = (np.column_stack([pixel, np.ones(len(pixel))]) for pixel in seen_by(rig, points_before(rig)))
    line = first @ fundamental.T
    assert np.abs((second * line).sum(axis=1) / np.linalg.norm(line[:, :2], axis=1)).max() < CLOSE_PX
    assert fundamental[2, 2] == 1
    point = points_before(rig)
    directions = [transform(pose, point) for pose in rig.cam_from_rig]
    assert np.abs(np.einsum("ni,ij,nj->n", directions[1], essential, directions[0])).max() < 1e-6


@pytest.mark.parametrize("shift_mm", [(-120, 4, 9), (120, 4, -9), (5, -120, 3), (-3, 120, 3)])
def test_a_pair_is_rectified_as_opencv_does(shift_mm: tuple[float, float, float]) -> None:
    """R1 R2 P1 P2 Q of cameras without a lens are those of cv2.stereoRectify, to each side and one above another."""
    rig = stereo(PINHOLE, shift_mm=shift_mm)
    pose = rig.cam_from_rig[1]
    flat = rectified_pair(rig.cameras, pose)
    assert flat is not None
    none = np.zeros(5)
    theirs = cv2.stereoRectify(
        rig.cameras[0].matrix,
        none,
        rig.cameras[1].matrix,
        none,
        PINHOLE.image_size,
        pose[:3, :3],
        pose[:3, 3:],
        alpha=-1,
    )
    for mine, their in zip((*flat.rect_from_cam, *flat.projection, flat.point_from_disparity), theirs, strict=False):
        np.testing.assert_allclose(mine, their, atol=2e-4)  # its corners are of single precision
    np.testing.assert_allclose(flat.rect_from_cam, theirs[:2], atol=1e-12)


@pytest.mark.parametrize("camera", [BROWN, FISHEYE])
def test_rectified_points_share_a_row_and_their_disparity_tells_where_they_are(camera: Camera, tmp_path: Path) -> None:
    """OpenCV undistorts pixels by R1 P1, R2 P2: rows agree, and Q takes column, row and disparity back to the point."""
    rig = stereo(camera)
    file = cv_nodes(*rig_texts("opencv", rig).values(), tmp_path)
    mat = {name: file.getNode(name).mat() for name in ("K1", "D1", "R1", "P1", "K2", "D2", "R2", "P2", "Q")}
    point = points_before(rig)
    pixels = []
    for row, pixel in enumerate(seen_by(rig, point), start=1):
        k, d, r, p = (mat[f"{name}{row}"] for name in "KDRP")
        exact = (cv2.TERM_CRITERIA_COUNT + cv2.TERM_CRITERIA_EPS, 100, 1e-14)
        flat = (
            cv2.fisheye.undistortPoints(pixel[:, None], k, d, R=r, P=p, criteria=exact)
            if camera is FISHEYE
            else cv2.undistortPointsIter(pixel[:, None], k, d, r, p, exact)
            if hasattr(cv2, "undistortPointsIter")
            else cv2.undistortPoints(pixel[:, None], k, d, None, r, p, criteria=exact)
        )
        pixels.append(flat[:, 0])
    assert np.abs(pixels[0][:, 1] - pixels[1][:, 1]).max() < CLOSE_PX
    disparity = np.column_stack([pixels[0], pixels[0][:, 0] - pixels[1][:, 0], np.ones(len(point))]) @ mat["Q"].T
    back = disparity[:, :3] / disparity[:, 3:] @ mat["R1"]
    assert np.abs(back - point).max() < 1e-4


def test_cameras_that_face_each_other_are_not_rectified(tmp_path: Path) -> None:
    """Their pictures have nothing in common, so the file is without R1, and its other parts stay."""
    apart = stereo(BROWN)
    rig = replace(
        apart,
        cam_from_rig=np.stack([np.eye(4), make_pose(exp_rotation(np.array([0, 3.1, 0])), np.array([0, 0, 900.0]))]),
    )
    file = cv_nodes(*rig_texts("opencv", rig).values(), tmp_path)
    assert file.getNode("R1").empty()
    assert file.getNode("R").mat().shape == (3, 3)


@pytest.mark.parametrize("rig", [ring(), stereo(FISHEYE)])
def test_colmap_sees_a_point_where_the_rig_does(rig: object, tmp_path: Path) -> None:
    """rig_config.json and rigs.txt, read by pycolmap, with COLMAP's own projection and its corner of the image."""
    rig, _ = held_by("colmap", rig)  # type: ignore[arg-type]
    folder = write_texts(rig_texts("colmap", rig, "mm"), tmp_path)
    (config,) = pycolmap.read_rig_config(folder / "rig_config.json")
    for name in ("images.txt", "points3D.txt", "frames.txt"):
        (folder / name).write_text("")
    model = pycolmap.Reconstruction()
    model.read_text(str(folder))
    (sensors,) = model.rigs.values()
    in_first = transform(rig.cam_from_rig[0], points_before(rig))
    for row, (camera, pixel) in enumerate(zip(config.cameras, seen_by(rig, points_before(rig)), strict=True)):
        assert camera.ref_sensor == (row == 0)
        sensor = pycolmap.sensor_t(pycolmap.SensorType.CAMERA, row + 1)
        poses = [] if row == 0 else [camera.cam_from_rig, sensors.sensor_from_rig(sensor)]
        for pose in poses or [pycolmap.Rigid3d()]:
            found = model.cameras[row + 1].img_from_cam(pose * in_first)
            assert np.abs(found - 0.5 - pixel).max() < CLOSE_PX
        np.testing.assert_allclose(camera.camera.params, model.cameras[row + 1].params, rtol=0, atol=0)


def test_what_colmap_writes_is_a_rig(tmp_path: Path) -> None:
    """A model's own rigs.txt, with a camera whose pose is not known; names are its cameras' ids."""
    model, rig = pycolmap.Reconstruction(), pycolmap.Rig(rig_id=1)
    for number in (1, 2, 7):
        lens = [500, 500, 320, 240, 0.01 * number, 0, 0, 0]
        model.add_camera(pycolmap.Camera(model="OPENCV", width=640, height=480, params=lens, camera_id=number))
    sensors = {number: pycolmap.sensor_t(pycolmap.SensorType.CAMERA, number) for number in (1, 2, 7)}
    turn = cv2.Rodrigues(np.array([0.1, -0.2, 0.3]))[0]
    rig.add_ref_sensor(sensors[1])
    rig.add_sensor(sensors[7], pycolmap.Rigid3d(pycolmap.Rotation3d(turn), np.array([-0.1, 0.02, 0.03])))
    rig.add_sensor(sensors[2], None)
    model.add_rig(rig)
    model.write_text(str(tmp_path))
    opened = open_rig(tmp_path / "rigs.txt")
    assert opened.read.rig.names == ("1", "7")
    assert "camera 2 has no pose, so it is left out" in opened.read.remarks
    np.testing.assert_allclose(opened.read.rig.cam_from_rig[1], make_pose(turn, np.array([-100, 20, 30])), atol=1e-9)
    assert opened.read.rig.cameras[1].parameters["k1"] == 0.07
    assert open_rig(tmp_path, unit="mm").read.rig.center_mm[1] == pytest.approx(opened.read.rig.center_mm[1] / 1000)


SEE_AND_WRITE = """
path, poses, see = question
for row, pose in enumerate(poses):
    model = mrcal.cameramodel(intrinsics=("LENSMODEL_PINHOLE", np.array([900., 880, 510, 390])), imagersize=(1024, 768),
                              extrinsics_rt_fromref=np.array(pose))
    model.write(f"{path}/{row}.cameramodel")
answer = []
for path, point in see:
    model = mrcal.cameramodel(path)
    there = mrcal.transform_point_rt(model.extrinsics_rt_fromref(), np.array(point))
    answer.append(mrcal.project(there, *model.intrinsics()).tolist())
"""


def test_mrcal_sees_a_point_where_the_rig_does_and_its_files_are_read(tmp_path: Path) -> None:
    """Models are read and projected by mrcal, in metres; those that it wrote are read with poses of ten digits."""
    rig, _ = held_by("mrcal", ring())
    folder, point = write_texts(rig_texts("mrcal", rig), tmp_path), points_before(rig)
    see = [[str(path), (point / 1000).tolist()] for path in sorted(folder.glob("*.cameramodel"))]
    poses = [[0.0, 0, 0, 0, 0, 0], [0.1, -0.2, 0.3, 1.5, -0.25, 0.125]]
    (tmp_path / "theirs").mkdir()
    answer = ask_mrcal(SEE_AND_WRITE, [str(tmp_path / "theirs"), poses, see], tmp_path)
    np.testing.assert_allclose(np.array(answer), seen_by(rig, point), atol=CLOSE_PX)
    theirs = read_texts("mrcal", {path.name: path.read_text() for path in sorted((tmp_path / "theirs").iterdir())})
    assert theirs.names == ("0", "1")
    assert theirs.rig_frame == "0"
    expected = make_pose(cv2.Rodrigues(np.array(poses[1][:3]))[0], 1000 * np.array(poses[1][3:]))
    np.testing.assert_allclose(theirs.cam_from_rig[1], expected, atol=1e-6)


def test_kalibr_goes_from_camera_to_camera_in_metres() -> None:
    """By its wiki: T_cn_cnm1 takes points from the camera before into camera n; the fisheye is OpenCV's."""
    rig, _ = held_by("kalibr", ring())
    (text,) = rig_texts("kalibr", rig).values()
    chain = yaml.safe_load(text)
    assert list(chain) == ["cam0", "cam1", "cam2"]
    assert "T_cn_cnm1" not in chain["cam0"]
    there = transform(rig.cam_from_rig[0], points_before(rig)) / 1000
    for row in (1, 2):
        there = transform(np.array(chain[f"cam{row}"]["T_cn_cnm1"]), there)
        expected = transform(rig.cam_from_rig[row], points_before(rig)) / 1000
        assert np.abs(there - expected).max() < 1e-12
    fisheye = chain["cam1"]
    assert fisheye["distortion_model"] == "equidistant"  # as its reader asks for, not `equi`
    k, d = fisheye["intrinsics"], np.array(fisheye["distortion_coeffs"])
    matrix = np.array([[k[0], 0, k[2]], [0, k[1], k[3]], [0, 0, 1]])
    first = transform(rig.cam_from_rig[1], points_before(rig))
    seen = cv_pixels(first, (np.eye(3), np.zeros(3)), matrix, d, True)
    assert np.abs(seen - seen_by(rig, points_before(rig))[1]).max() < CLOSE_PX


KALIBR = """
cam0:
  cam_overlaps: [1]
  camera_model: pinhole
  distortion_coeffs: [-0.1, 0.02, 0.001, -0.002]
  distortion_model: radtan
  intrinsics: [461.6, 460.3, 362.7, 248.1]
  resolution: [752, 480]
  rostopic: /cam0/image_raw
  T_cam_imu:
  - [0.0, 1.0, 0.0, 0.01]
  - [-1.0, 0.0, 0.0, 0.02]
  - [0.0, 0.0, 1.0, 0.03]
  - [0.0, 0.0, 0.0, 1.0]
cam1:
  T_cn_cnm1:
  - [0.99998854, 0.00216014, 0.00427195, -0.11003785]
  - [-0.00221074, 0.99992702, 0.01187697, 0.00045792]
  - [-0.00424598, -0.01188628, 0.99992034, -0.00064487]
  - [0.0, 0.0, 0.0, 1.0]
  cam_overlaps: [0]
  camera_model: pinhole
  distortion_coeffs: [-0.01, 0.05, -0.05, 0.01]
  distortion_model: equidistant
  intrinsics: [458.7, 457.3, 367.2, 248.4]
  resolution: [752, 480]
  rostopic: /cam1/image_raw
  T_cam_imu:
  - [0.0, 1.0, 0.0, -0.10]
  - [-1.0, 0.0, 0.0, 0.02]
  - [0.0, 0.0, 1.0, 0.03]
  - [0.0, 0.0, 0.0, 1.0]
"""


def test_a_chain_of_kalibr_is_read() -> None:
    """Eight digits of a rotation do, lengths become mm; where only the IMU's pose is known the frame is the IMU's."""
    rig = read_texts("kalibr", {"camchain.yaml": KALIBR})
    assert rig.names == rig_names(KALIBR) == ("cam0", "cam1")
    assert rig.rig_frame == "cam0"
    assert [camera.model for camera in rig.cameras] == ["opencv", "fisheye"]
    np.testing.assert_allclose(rig.cam_from_rig[1, :3, 3], [-110.03785, 0.45792, -0.64487])
    np.testing.assert_allclose(rig.cam_from_rig[1, :3, :3] @ rig.cam_from_rig[1, :3, :3].T, np.eye(3), atol=1e-14)
    by_imu = KALIBR.replace("T_cn_cnm1", "T_other")
    rig = read_texts("kalibr", {"camchain.yaml": by_imu})
    assert rig.rig_frame == "imu"
    np.testing.assert_allclose(rig.cam_from_rig[:, 0, 3], [10, -100])


def rig_names(text: str) -> tuple[str, ...]:
    """The topics' names."""
    return tuple(one["rostopic"].split("/")[1] for one in yaml.safe_load(text).values())


def test_ros_has_the_same_transforms_in_both_files() -> None:
    """By REP 103 and tf2: parent_from_child, x y z w, metres, the body's frame between; rpy turns about fixed axes."""
    rig, _ = held_by("ros", ring())
    texts = rig_texts("ros", rig)
    assert {"cam_a.yaml", "cam_b.yaml", "cam_c.yaml"} < set(texts)
    nodes = [one["node"] for one in yaml.safe_load(texts["static_transforms.launch.yaml"])["launch"]]
    joints = ET.fromstring(texts["rig.urdf"]).findall("joint")
    stands: dict[str, Array] = {"world": np.eye(4)}
    for node, joint in zip(nodes, joints, strict=True):
        words = node["args"].split()
        given = dict(zip(words[::2], words[1::2], strict=True))
        parent, child = given["--frame-id"], given["--child-frame-id"]
        assert joint.find("parent").get("link") == parent  # type: ignore[union-attr]
        assert joint.find("child").get("link") == child  # type: ignore[union-attr]
        step = np.eye(4)
        step[:3, 3] = [float(given[f"--{name}"]) for name in "xyz"]
        step[:3, :3] = Rotation.from_quat([float(given[f"--q{name}"]) for name in "xyzw"]).as_matrix()
        stands[child] = stands[parent] @ step
        origin = joint.find("origin")
        assert origin is not None
        rpy = [float(one) for one in str(origin.get("rpy")).split()]
        np.testing.assert_allclose(Rotation.from_euler("xyz", rpy).as_matrix(), step[:3, :3], atol=1e-12)
        np.testing.assert_allclose([float(one) for one in str(origin.get("xyz")).split()], step[:3, 3])
    for name, pose in zip(("cam_a", "cam_b", "cam_c"), invert(rig.cam_from_rig), strict=True):
        np.testing.assert_allclose(stands[f"{name}_optical_frame"][:3, 3], pose[:3, 3] / 1000, atol=1e-12)
        np.testing.assert_allclose(stands[f"{name}_optical_frame"][:3, :3], pose[:3, :3], atol=1e-12)
        right, down, forward = pose[:3, :3].T
        np.testing.assert_allclose(stands[f"{name}_link"][:3, :3].T, [forward, -right, -down], atol=1e-12)


def test_transforms_of_ros_are_read_through_any_number_of_frames() -> None:
    """With the body's frame between, without it as once, and not if a frame hangs on itself."""
    rig, _ = held_by("ros", ring())
    texts = rig_texts("ros", rig)
    tree = yaml.safe_load(texts["static_transforms.launch.yaml"])
    back = read_texts("ros", texts)
    np.testing.assert_allclose(back.cam_from_rig, rig.cam_from_rig, atol=1e-9)
    for node, pose in zip(tree["launch"][1::2], invert(rig.cam_from_rig), strict=True):
        x, y, z, w = Rotation.from_matrix(pose[:3, :3]).as_quat()
        given = dict(zip(("x", "y", "z"), pose[:3, 3] / 1000, strict=True)) | {"qx": x, "qy": y, "qz": z, "qw": w}
        child = node["node"]["args"].rpartition(" ")[2]
        told = " ".join(f"--{name} {value!r}" for name, value in ((name, float(one)) for name, one in given.items()))
        node["node"]["args"] = f"{told} --frame-id world --child-frame-id {child}"
    plain = texts | {"static_transforms.launch.yaml": yaml.safe_dump({"launch": tree["launch"][1::2]})}
    np.testing.assert_allclose(read_texts("ros", plain).cam_from_rig, rig.cam_from_rig, atol=1e-9)
    looped = texts["static_transforms.launch.yaml"].replace("--frame-id world", "--frame-id cam_a_link", 1)
    with pytest.raises(InputError, match="frame 'cam_a_link' hangs on itself"):
        read_texts("ros", texts | {"static_transforms.launch.yaml": looped})


def test_a_pair_in_ros_tells_its_baseline() -> None:
    """By sensor_msgs/CameraInfo: -P[0, 3] / P[0, 0] of the right camera is the baseline in metres, of the left zero."""
    infos = [yaml.safe_load(rig_texts("ros", stereo())[f"{side}.yaml"]) for side in ("left", "right")]
    left, right = (np.reshape(one["projection_matrix"]["data"], (3, 4)) for one in infos)
    assert left[0, 3] == 0
    assert -right[0, 3] / right[0, 0] == pytest.approx(np.linalg.norm([-120, 4, 9]) / 1000, rel=1e-12)
    assert (left[:, :3] == right[:, :3]).all()
    turn = np.reshape(infos[0]["rectification_matrix"]["data"], (3, 3))
    np.testing.assert_allclose(turn @ turn.T, np.eye(3), atol=1e-12)


def test_a_pair_of_ros_is_read_by_its_rectification() -> None:
    """As `camera_calibration` leaves it: R and P alone tell how the second camera stands."""
    rig = stereo()
    texts = {name: text for name, text in rig_texts("ros", rig).items() if name in ("left.yaml", "right.yaml")}
    back = read_texts("ros", texts)
    assert back.names == ("left", "right")
    np.testing.assert_allclose(back.cam_from_rig, rig.cam_from_rig, atol=1e-9)
    alone = {name: text.replace("rectification_matrix", "other") for name, text in texts.items()}
    with pytest.raises(InputError, match="rectification_matrix is missing"):
        read_texts("ros", alone)
    with pytest.raises(InputError, match="the projection matrices tell no baseline"):
        read_texts("ros", {"left.yaml": texts["left.yaml"], "right.yaml": texts["left.yaml"]})
    with pytest.raises(InputError, match="holds 1 cameras without static_transforms"):
        read_texts("ros", {"left.yaml": texts["left.yaml"]})


def test_toml_files_are_what_opencv_projects() -> None:
    """By aniposelib and Caliscope: rotation vector, translation, matrix and distortions go to OpenCV's projection."""
    import tomllib

    rig, _ = held_by("anipose", ring())
    point = points_before(rig)
    for name, unit_mm in (("anipose", 1.0), ("caliscope", 1000.0)):
        tables = tomllib.loads(next(iter(rig_texts(name, rig).values())))
        cameras = tables["cameras"].values() if name == "caliscope" else [tables[f"cam_{row}"] for row in range(3)]
        for one, pixel, camera in zip(cameras, seen_by(rig, point), rig.cameras, strict=True):
            turn = cv2.Rodrigues(np.array(one["rotation"]))[0]
            seen = cv_pixels(
                point / unit_mm,
                (turn, np.array(one["translation"])),
                np.array(one["matrix"]),
                np.array(one["distortions"]),
                one["fisheye"],
            )
            assert np.abs(seen - pixel).max() < CLOSE_PX
            assert tuple(one["size"]) == camera.image_size


REAL = Path(__file__).parents[4] / "shared/real/rig-4-cameras/reference_camera_array.toml"


@pytest.mark.skipif(not REAL.exists(), reason="the real rig of four webcams is not beside the project")
def test_a_real_camera_array_is_read() -> None:
    """Caliscope's own file of four webcams: matrices of rotations, metres, and cameras by their numbers."""
    rig = read_texts("caliscope", {"camera_array.toml": REAL.read_text()})
    assert rig.names == ("0", "1", "2", "3")
    assert rig.rig_frame == "world"
    distance = np.linalg.norm(rig.center_mm[:, None] - rig.center_mm, axis=2)
    assert 500 < distance[0, 1] < 3000
    np.testing.assert_allclose(rig.cam_from_rig[0, :3, 3], [171.260, -32.345, 1208.386], atol=1e-3)
