"""What the programs that a format is of, or their published formulas, see with the numbers of our files."""

import json
from collections.abc import Callable, Mapping
from pathlib import Path
from xml.etree import ElementTree

import cv2
import numpy as np
import pycolmap
import yaml
from scipy.io import loadmat

from calib.cameras.formats import FORMATS
from designer.base.arrays import Array
from tests.support.foreign_cameras import lens_camera

Values = Mapping[str, float]


def kannala_brandt(ray: np.ndarray, values: Values) -> np.ndarray:
    """Kannala and Brandt 2006, equation 6: odd powers of the angle off the axis, along the direction about it."""
    angle, about = np.arccos(ray[:, 2]), np.arctan2(ray[:, 1], ray[:, 0])
    radius = angle + sum(values[f"k{k}"] * angle ** (2 * k + 1) for k in range(1, 5))
    return radius[:, None] * np.column_stack([np.cos(about), np.sin(about)])


def unified(ray: np.ndarray, values: Values) -> np.ndarray:
    """Mei and Rives 2007, equations 1 to 4: onto the sphere, and from a point xi above its middle."""
    return ray[:, :2] / (ray[:, 2:] + values["xi"])


def extended_unified(ray: np.ndarray, values: Values) -> np.ndarray:
    """Khomutenko, Garcia and Martinet 2016, equation 7."""
    x, y, z = ray.T
    rho = np.sqrt(values["beta"] * (x**2 + y**2) + z**2)
    return np.column_stack([x, y]) / (values["alpha"] * rho + (1 - values["alpha"]) * z)[:, None]


def double_sphere(ray: np.ndarray, values: Values) -> np.ndarray:
    """Usenko, Demmel and Cremers 2018, equations 40 to 42, of rays of length one."""
    on_second = ray + np.array([0, 0, values["xi"]])
    distance = np.linalg.norm(on_second, axis=1)
    return ray[:, :2] / (values["alpha"] * distance + (1 - values["alpha"]) * on_second[:, 2])[:, None]


PUBLISHED: Mapping[str, Callable[[np.ndarray, Values], np.ndarray]] = {
    "pinhole": lambda ray, _: ray[:, :2] / ray[:, 2:],
    "fisheye": kannala_brandt,
    "omni": unified,
    "eucm": extended_unified,
    "ds": double_sphere,
}


def published(model: str, ray: np.ndarray, values: Values) -> np.ndarray:
    """Pixels (N, 2) of rays (N, 3) of length one, with fx fy cx cy."""
    return PUBLISHED[model](ray, values) * [values["fx"], values["fy"]] + [values["cx"], values["cy"]]


def opencv_projection(ray: Array, matrix: Array, lens: Array) -> Array:
    """Pixels (N, 2) that OpenCV sees directions (N, 3) in."""
    pixel, _ = cv2.projectPoints(ray[:, None], np.zeros(3), np.zeros(3), matrix, lens)
    return np.asarray(pixel[:, 0])


def fisheye_projection(ray: Array, matrix: Array, lens: Array) -> Array:
    """Pixels (N, 2) that OpenCV's fisheye sees directions (N, 3) in."""
    pixel, _ = cv2.fisheye.projectPoints(ray[:, None], np.zeros(3), np.zeros(3), matrix, lens)
    return np.asarray(pixel[:, 0])


def in_opencv(text: str, ray: Array, lens: str, size: tuple[int, int], folder: Path) -> Array:
    """`cv2.FileStorage` reads the file; its lens is that of `cv2.projectPoints` or, where it says so, `cv2.fisheye`."""
    (folder / "c.yaml").write_text(text)
    storage = cv2.FileStorage(str(folder / "c.yaml"), cv2.FILE_STORAGE_READ)
    matrix, distortion = (storage.getNode(key).mat() for key in ("camera_matrix", "distortion_coefficients"))
    assert size == tuple(int(storage.getNode(f"image_{side}").real()) for side in ("width", "height"))
    is_fisheye = storage.getNode("fisheye_model").real() == 1
    assert is_fisheye == (lens == "fisheye")
    return (fisheye_projection if is_fisheye else opencv_projection)(ray, matrix, distortion)


def in_ros(text: str, ray: Array, lens: str, size: tuple[int, int], _: Path) -> Array:
    """ROS' camera_calibration_parsers (parse_yml.cpp) takes matrix and coefficients, image_geometry is OpenCV's."""
    tree = yaml.safe_load(text)
    assert (tree["image_width"], tree["image_height"]) == size
    for name, rows, columns in (("rectification_matrix", 3, 3), ("projection_matrix", 3, 4)):
        assert (tree[name]["rows"], tree[name]["cols"], len(tree[name]["data"])) == (rows, columns, rows * columns)
    matrix = np.reshape(tree["camera_matrix"]["data"], (3, 3))
    assert np.array_equal(np.reshape(tree["projection_matrix"]["data"], (3, 4))[:, :3], matrix)
    assert not lens or tree["distortion_model"] == lens
    projection = fisheye_projection if lens == "equidistant" else opencv_projection
    return projection(ray, matrix, np.array(tree["distortion_coefficients"]["data"]))


def in_kalibr(text: str, ray: Array, lens: str, size: tuple[int, int], _: Path) -> Array:
    """Kalibr's projections (aslam_cameras) with the file's numbers in its order; it refuses whole numbers there."""
    tree = yaml.safe_load(text)["cam0"]
    assert tree["resolution"] == list(size)
    assert all(isinstance(value, float) for value in tree["intrinsics"])
    assert isinstance(tree["rostopic"], str)
    projection, distortion = (lens or "pinhole-radtan").split("-")
    in_files = {"equi": "equidistant"}.get(distortion, distortion)  # as its own reader of chains asks for
    assert (tree["camera_model"], tree["distortion_model"]) == (projection, in_files)
    if (projection, distortion) == ("pinhole", "radtan"):  # DistortedPinholeProjection and RadialTangentialDistortion
        (fu, fv, pu, pv), (k1, k2, p1, p2) = tree["intrinsics"], tree["distortion_coeffs"]
        y0, y1 = ray[:, 0] / ray[:, 2], ray[:, 1] / ray[:, 2]
        mx2, my2, mxy = y0 * y0, y1 * y1, y0 * y1
        rho2 = mx2 + my2
        radial = k1 * rho2 + k2 * rho2 * rho2
        x = y0 + y0 * radial + 2.0 * p1 * mxy + p2 * (rho2 + 2.0 * mx2)
        y = y1 + y1 * radial + 2.0 * p2 * mxy + p1 * (rho2 + 2.0 * my2)
        return np.column_stack([fu * x + pu, fv * y + pv])
    assert distortion == "equi" or not any(tree["distortion_coeffs"])
    before = {"omni": ("xi",), "ds": ("xi", "alpha"), "eucm": ("alpha", "beta")}.get(projection, ())
    values = dict(zip((*before, "fx", "fy", "cx", "cy"), tree["intrinsics"], strict=True))
    values |= {f"k{k}": value for k, value in enumerate(tree["distortion_coeffs"], start=1)}
    return published(lens_camera("kalibr", lens).model, ray, values)


def in_basalt(text: str, ray: Array, lens: str, size: tuple[int, int], _: Path) -> Array:
    """Basalt's formulas by its names for their numbers; OpenCV's rational lens is its, too."""
    tree = json.loads(text)["value0"]
    (one,) = tree["intrinsics"]
    assert one["camera_type"] == lens
    assert tree["resolution"] == [list(size)]
    assert {len(tree[key]) for key in ("T_imu_cam", "resolution", "intrinsics")} == {1}
    values = {**one["intrinsics"], **({"beta": 1.0} if lens == "ucm" else {})}
    if lens != "pinhole-radtan8":
        return published(lens_camera("basalt", lens).model, ray, values)
    matrix = np.array([[values["fx"], 0, values["cx"]], [0, values["fy"], values["cy"]], [0, 0, 1]])
    return opencv_projection(
        ray, matrix, np.array([values[k] for k in ("k1", "k2", "p1", "p2", "k3", "k4", "k5", "k6")])
    )


def in_colmap(text: str, ray: Array, lens: str, size: tuple[int, int], folder: Path) -> Array:
    """The one camera that COLMAP finds, which counts half a pixel farther right and down, from the image's corner."""
    (folder / "cameras.txt").write_text(text)
    for name in ("images.txt", "points3D.txt"):
        (folder / name).write_text("")
    model = pycolmap.Reconstruction()
    model.read_text(str(folder))
    (camera,) = model.cameras.values()
    assert (camera.width, camera.height) == size
    assert not lens or camera.model_name == lens
    return np.asarray(camera.img_from_cam(ray)) - 0.5


def in_metashape(text: str, ray: Array, lens: str, size: tuple[int, int], _: Path) -> Array:
    """The frame camera of Metashape's manual, appendix D, which counts as COLMAP does.

    A fisheye's x and y are the angle off the axis, along the direction about it; an equisolid one's 2 sin(theta / 2).
    """
    root = ElementTree.fromstring(text)
    assert root.findtext("projection") == (lens.removesuffix("_b2") or "frame")

    def value(name: str) -> float:
        return float(root.findtext(name) or 0)

    w, h, f = value("width"), value("height"), value("f")
    assert (w, h) == size
    x, y = ray[:, 0] / ray[:, 2], ray[:, 1] / ray[:, 2]
    if lens.endswith("fisheye"):
        angle, about = np.arccos(ray[:, 2]), np.arctan2(ray[:, 1], ray[:, 0])
        radius = angle if lens == "fisheye" else 2 * np.sin(angle / 2)
        x, y = radius * np.cos(about), radius * np.sin(about)
    r = np.hypot(x, y)
    radial = 1 + value("k1") * r**2 + value("k2") * r**4 + value("k3") * r**6 + value("k4") * r**8
    outer = 1 + value("p3") * r**2 + value("p4") * r**4
    xd = x * radial + (value("p1") * (r**2 + 2 * x**2) + 2 * value("p2") * x * y) * outer
    yd = y * radial + (value("p2") * (r**2 + 2 * y**2) + 2 * value("p1") * x * y) * outer
    u = w * 0.5 + value("cx") + xd * f + xd * value("b1") + yd * value("b2")
    return np.column_stack([u, h * 0.5 + value("cy") + yd * f]) - 0.5


def by_opencv(ray: Array, rows: object, lens: object, *, is_fisheye: bool) -> Array:
    """Pixels of OpenCV's functions, which several programs call with the numbers of their files."""
    project = fisheye_projection if is_fisheye else opencv_projection
    return project(ray, np.reshape(np.array(rows, dtype=float), (3, 3)), np.array(lens, dtype=float))


def in_photonvision(text: str, ray: Array, lens: str, size: tuple[int, int], _: Path) -> Array:
    """JsonMatOfDouble makes an OpenCV matrix of `rows`, `cols` and `data` of type CV_64F."""
    tree = json.loads(text)
    assert (tree["resolution"]["width"], tree["resolution"]["height"]) == size
    matrix, coefficients = tree["cameraIntrinsics"], tree["distCoeffs"]
    assert (matrix["rows"], matrix["cols"], matrix["type"], coefficients["rows"]) == (3, 3, cv2.CV_64F, 1)
    assert (len(coefficients["data"]), tree["lensmodel"]) == (coefficients["cols"], "LENSMODEL_OPENCV")
    return by_opencv(ray, matrix["data"], coefficients["data"], is_fisheye=False)


def in_gyroflow(text: str, ray: Array, lens: str, size: tuple[int, int], _: Path) -> Array:
    """Gyroflow takes the middle for the centre of a profile that is not asymmetrical; its lenses are OpenCV's."""
    tree = json.loads(text)
    assert (tree["calib_dimension"]["w"], tree["calib_dimension"]["h"]) == size
    assert tree["calibrator_version"]
    assert tree["asymmetrical"]
    assert not lens or tree["distortion_model"] == lens
    numbers, is_fisheye = tree["fisheye_params"], tree["distortion_model"] == "opencv_fisheye"
    return by_opencv(ray, numbers["camera_matrix"], numbers["distortion_coeffs"], is_fisheye=is_fisheye)


def in_depthai(text: str, ray: Array, lens: str, size: tuple[int, int], _: Path) -> Array:
    """DepthAI reads 14 coefficients for OpenCV, of camera type 1, a fisheye, the first four."""
    ((socket, one),) = json.loads(text)["cameraData"]
    assert (socket, one["width"], one["height"], len(one["distortionCoeff"])) == (0, *size, 14)
    is_fisheye = one["cameraType"] == 1
    assert not lens or is_fisheye == (lens == "Fisheye")
    return by_opencv(
        ray, one["intrinsicMatrix"], one["distortionCoeff"][: 4 if is_fisheye else 14], is_fisheye=is_fisheye
    )


def brown_polynomial(ray: Array, radial: list[float], p1: float, p2: float) -> Array:
    """Brown's lens with as many radial terms as there are."""
    x, y = (ray[:, :2] / ray[:, 2:]).T
    s = x * x + y * y
    factor = 1 + sum(k * s**power for power, k in enumerate(radial, start=1))
    a = x * factor + 2 * p1 * x * y + p2 * (s + 2 * x * x)
    return np.column_stack([a, y * factor + p1 * (s + 2 * y * y) + 2 * p2 * x * y])


def in_nerfstudio(text: str, ray: Array, lens: str, size: tuple[int, int], _: Path) -> Array:
    """Nerfstudio's cameras.py: rays through the middle of a pixel, 0.5 from its corner; polynomials up to r^8."""
    tree = json.loads(text)
    assert (tree["w"], tree["h"]) == size
    assert not lens or tree["camera_model"] == lens
    radial = [tree[f"k{k}"] for k in range(1, 5)]
    if tree["camera_model"] == "OPENCV_FISHEYE":
        plane = kannala_brandt(ray, tree)
    else:
        plane = brown_polynomial(ray, radial, tree["p1"], tree["p2"])
    return plane * [tree["fl_x"], tree["fl_y"]] + [tree["cx"], tree["cy"]] - 0.5


def in_realsense(text: str, ray: Array, lens: str, size: tuple[int, int], _: Path) -> Array:
    """rs2_project_point_to_pixel of librealsense's rsutil.h."""
    tree = json.loads(text)
    assert (tree["width"], tree["height"], len(tree["coeffs"])) == (*size, 5)
    assert not lens or tree["model"] == lens
    k1, k2, p1, p2, k3 = tree["coeffs"]
    if tree["model"] == "kannala_brandt4":
        plane = kannala_brandt(ray, {f"k{k}": value for k, value in enumerate(tree["coeffs"][:4], start=1)})
    else:
        assert tree["model"] == "brown_conrady" or not any(tree["coeffs"])
        plane = brown_polynomial(ray, [k1, k2, k3], p1, p2)
    return plane * [tree["fx"], tree["fy"]] + [tree["ppx"], tree["ppy"]]


def in_orbslam(text: str, ray: Array, lens: str, size: tuple[int, int], folder: Path) -> Array:
    """Settings.cc reads by OpenCV; PinHole's pictures are undistorted by OpenCV, KannalaBrandt8.cpp has its paper's."""
    (folder / "s.yaml").write_text(text)
    file = cv2.FileStorage(str(folder / "s.yaml"), cv2.FILE_STORAGE_READ)
    kind = file.getNode("Camera.type").string()
    assert not lens or kind == lens
    assert all(file.getNode(f"Camera.{side}").isInt() for side in ("width", "height"))
    assert size == tuple(int(file.getNode(f"Camera.{side}").real()) for side in ("width", "height"))

    def value(name: str) -> float:
        assert file.getNode(f"Camera1.{name}").isReal()
        return float(file.getNode(f"Camera1.{name}").real())

    radial = [value(f"k{k}") for k in range(1, 4)]
    if kind == "KannalaBrandt8":
        plane = kannala_brandt(ray, {f"k{k}": value(f"k{k}") for k in range(1, 5)})
    else:
        plane = brown_polynomial(ray, radial, value("p1"), value("p2"))
    return plane * [value("fx"), value("fy")] + [value("cx"), value("cy")]


def in_vins(text: str, ray: Array, lens: str, size: tuple[int, int], folder: Path) -> Array:
    """Camodocal's PinholeCamera, PinholeFullCamera, EquidistantCamera and CataCamera, read by OpenCV."""
    (folder / "c.yaml").write_text(text)
    file = cv2.FileStorage(str(folder / "c.yaml"), cv2.FILE_STORAGE_READ)
    kind = file.getNode("model_type").string()
    assert not lens or kind == lens
    assert size == tuple(int(file.getNode(f"image_{side}").real()) for side in ("width", "height"))
    groups = [file.getNode(f"{name}_parameters") for name in ("projection", "distortion", "mirror")]
    linear, bent, mirror = (
        {key: one.getNode(key).real() for key in ([] if one.empty() else one.keys())} for one in groups
    )
    if kind == "KANNALA_BRANDT":
        plane = kannala_brandt(ray, {f"k{k}": linear[f"k{k + 1}"] for k in range(1, 5)})
        return plane * [linear["mu"], linear["mv"]] + [linear["u0"], linear["v0"]]
    if kind == "MEI":
        assert not any(bent.values())
        plane = unified(ray, mirror)
        return plane * [linear["gamma1"], linear["gamma2"]] + [linear["u0"], linear["v0"]]
    order = ("k1", "k2", "p1", "p2", *(("k3", "k4", "k5", "k6") if kind == "PINHOLE_FULL" else ()))
    matrix = [linear["fx"], 0, linear["cx"], 0, linear["fy"], linear["cy"], 0, 0, 1]
    return by_opencv(ray, matrix, [bent[key] for key in order], is_fisheye=False)


def in_matlab(text: str, ray: Array, lens: str, size: tuple[int, int], folder: Path) -> Array:
    """SciPy reads the file; MATLAB's documentation: pixels from 1, rows times IntrinsicMatrix, ImageSize rows first."""
    (folder / "c.mat").write_bytes(FORMATS["matlab"].encode(text))
    one = loadmat(folder / "c.mat")["cameraParams"][0, 0]
    assert one["ImageSize"][0].tolist() == [*size[::-1]]
    (p1, p2), radial = one["TangentialDistortion"][0], one["RadialDistortion"][0].tolist()
    plane = brown_polynomial(ray, radial, p1, p2)
    for matrix in (one["IntrinsicMatrix"], one["K"].T):
        pixel = np.column_stack([plane, np.ones(len(plane))]) @ matrix
        assert np.array_equal(matrix[2, :2], one["PrincipalPoint"][0])
        assert np.array_equal(np.diag(matrix)[:2], one["FocalLength"][0])
    return np.asarray(pixel[:, :2] - 1)


SEEN_IN: Mapping[str, Callable[[str, Array, str, tuple[int, int], Path], Array]] = {
    "opencv": in_opencv, "ros": in_ros, "kalibr": in_kalibr, "basalt": in_basalt, "colmap": in_colmap,
    "metashape": in_metashape, "photonvision": in_photonvision, "gyroflow": in_gyroflow, "nerfstudio": in_nerfstudio,
    "matlab": in_matlab, "depthai": in_depthai, "realsense": in_realsense, "orbslam": in_orbslam, "vins": in_vins,
}  # fmt: skip
"""By a format: pixels in which directions are seen with a file, through a lens of a name ("": what the file says), of
an image size; in a folder for programs that read one. mrcal is asked for all cameras at once, in its own tests."""
