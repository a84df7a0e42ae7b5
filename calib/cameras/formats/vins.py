"""Camera files of VINS-Mono, VINS-Fusion and camodocal: YAML with `model_type` and a mapping for each group of numbers.

PINHOLE is OpenCV's lens without k3, PINHOLE_FULL its rational one, KANNALA_BRANDT its fisheye, whose k2 ... k5 are our
k1 ... k4. MEI is the unified camera with Brown's distortion on the plane, SCARAMUZZA the polynomial one of OCamCalib
with u before v (camodocal, camera_models).
"""

import re
from collections.abc import Mapping

from calib.cameras.camera import Camera
from calib.cameras.formats.format import CameraFormat, FileLens, ReadCamera, left_over
from calib.cameras.formats.kalibr import distorted_sphere
from calib.cameras.formats.lens import lens_camera
from calib.cameras.formats.ocamcalib import polynomial_camera
from calib.cameras.formats.parsing import image_size, mapping, number, parse_yaml, real, required, shown_plain
from designer.base.errors import InputError

LENSES = (
    FileLens("PINHOLE", "opencv", "fx fy cx cy k1 k2 p1 p2"),
    FileLens("PINHOLE_FULL", "opencv8", "fx fy cx cy k1 k2 k3 k4 k5 k6 p1 p2"),
    FileLens("KANNALA_BRANDT", "fisheye", "fx fy cx cy k1 k2 k3 k4"),
    FileLens("MEI", "omni", "xi fx fy cx cy 0 0 0 0"),
)
LINEAR, MIRROR, DISTORTION = "projection_parameters", "mirror_parameters", "distortion_parameters"
PINHOLE = {LINEAR: "fx fy cx cy", DISTORTION: "k1 k2 p1 p2"}
KEYS: Mapping[str, Mapping[str, str]] = {
    "PINHOLE": PINHOLE,
    "PINHOLE_FULL": {**PINHOLE, DISTORTION: "k1 k2 k3 k4 k5 k6 p1 p2"},
    "KANNALA_BRANDT": {LINEAR: "mu mv u0 v0 k2 k3 k4 k5"},
    "MEI": {MIRROR: "xi", LINEAR: "gamma1 gamma2 u0 v0", DISTORTION: "k1 k2 p1 p2"},
}
"""What each lens's numbers are called, in the lens's order."""
SCARAMUZZA, POLYNOMIAL, INVERSE, AFFINE = "SCARAMUZZA", "poly_parameters", "inv_poly_parameters", "affine_parameters"
USED = ("model_type", "camera_name", "image_width", "image_height", *KEYS["MEI"], POLYNOMIAL, INVERSE, AFFINE)


def write(camera: Camera, lens: FileLens) -> str:
    """The text for a camera of the lens's model."""
    width, height = camera.image_size
    values = iter(lens.values(camera))
    groups = "".join(
        f"{group}:\n" + "".join(f"   {key}: {real(next(values))}\n" for key in keys.split())
        for group, keys in KEYS[lens.name].items()
    )
    return (
        f"%YAML:1.0\n---\nmodel_type: {lens.name}\ncamera_name: camera\nimage_width: {width}\nimage_height: {height}\n"
        f"{groups}"
    )


def read(text: str, origin: str, _: str | None = None) -> ReadCamera:
    """The camera in a text."""
    values = mapping(parse_yaml(text, origin), "the file", origin)
    said = required(values, ("model_type",), origin)
    kind = said.upper() if isinstance(said, str) else ""
    size = image_size([required(values, (f"image_{side}",), origin) for side in ("width", "height")], origin)
    if kind == SCARAMUZZA:
        return left_over(_polynomial(values, size, origin), values, *USED)
    lens = next((one for one in LENSES if one.name == kind), None)
    if lens is None:
        known = ", ".join((*KEYS, SCARAMUZZA))
        raise InputError(f"{origin}: model_type {shown_plain(said)}: not supported; there are {known}")
    found = [one for group, keys in KEYS[kind].items() for one in _group(values, group, keys, origin)]
    if kind == "MEI" and any(found[5:]):
        return left_over(distorted_sphere(found, lens.name, size, origin), values, *USED)
    return left_over(lens_camera(lens, found, size, origin), values, *USED)


def _group(values: Mapping[str, object], group: str, keys: str, origin: str) -> list[float]:
    given = mapping(required(values, (group,), origin), group, origin)
    return [number(required(given, (key,), origin), f"{group}.{key}", origin) for key in keys.split()]


def _polynomial(values: Mapping[str, object], size: tuple[int, int], origin: str) -> ReadCamera:
    terms = _group(values, POLYNOMIAL, "p0 p1 p2 p3 p4", origin)
    c, d, e, u, v = _group(values, AFFINE, "ac ad ae cx cy", origin)
    return polynomial_camera(terms, (c, d, e), (u, v), size, origin)


FORMAT = CameraFormat(
    name="vins",
    title="VINS camera",
    file_name="cam0.yaml",
    opens_with="in the settings of VINS-Fusion: cam0_calib: {file}, beside these; of VINS-Mono put the lines into them",
    recognised=re.compile(rf"^(?:{LINEAR}|{POLYNOMIAL})\s*:", re.MULTILINE),
    lenses=LENSES,
    write=write,
    read=read,
)
