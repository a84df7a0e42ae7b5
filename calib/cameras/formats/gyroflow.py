"""Gyroflow's lens profiles: JSON with the matrix and the coefficients of OpenCV's fisheye or of its other lens.

The keys are those of its struct LensProfile. It takes the numbers for pictures of `calib_dimension`, and the middle of
these for the centre, unless the profile says `asymmetrical`.
"""

import re

from calib.cameras.camera import Camera
from calib.cameras.formats.format import CameraFormat, FileLens, ReadCamera, left_over, told
from calib.cameras.formats.lens import lens_named
from calib.cameras.formats.lens_names import NamedLens
from calib.cameras.formats.opencv import camera_of
from calib.cameras.formats.parsing import image_size, json_object, mapping, number, required, shown_plain
from designer.base.errors import InputError
from designer.base.file_kind import laid_out
from designer.base.files import JsonValue
from designer.base.words import NAME

LENSES = (
    FileLens("opencv_fisheye", "fisheye", "fx fy cx cy k1 k2 k3 k4"),
    FileLens("opencv_standard", "opencv12", "fx fy cx cy k1 k2 p1 p2 k3 k4 k5 k6 s1 s2 s3 s4"),
)
USED = (
    *("calib_dimension", "fisheye_params", "distortion_model", "asymmetrical", "use_opencv_fisheye", "calib_params"),
    *("use_opencv_standard", "name", "calibrator_version", "input_horizontal_stretch", "input_vertical_stretch"),
    *("orig_dimension", "output_dimension"),
)


def write(camera: Camera, lens: FileLens) -> str:
    """The text for a camera of the lens's model."""
    fx, fy, cx, cy, *rest = lens.values(camera)
    width, height = camera.image_size
    size: JsonValue = {"w": width, "h": height}
    document: dict[str, JsonValue] = {
        "name": f"{NAME} {width}x{height}",
        **dict.fromkeys(("note", "calibrated_by", "camera_brand", "camera_model", "lens_model", "camera_setting"), ""),
        **dict.fromkeys(("calib_dimension", "orig_dimension", "output_dimension"), size),
        **dict.fromkeys(("frame_readout_time", "gyro_lpf"), None),
        **dict.fromkeys(("input_horizontal_stretch", "input_vertical_stretch"), 1.0),
        "num_images": 0,
        "fps": 0.0,
        "official": False,
        "asymmetrical": True,
        "fisheye_params": {
            "RMS_error": 0.0,
            "camera_matrix": [[fx, 0.0, cx], [0.0, fy, cy], [0.0, 0.0, 1.0]],
            "distortion_coeffs": list(rest),
            "radial_distortion_limit": None,
        },
        "distortion_model": lens.name,
        "identifier": "",
        "calibrator_version": NAME,  # a profile without one is refused
        "date": "",
        "compatible_settings": [],
        "format": f"{NAME}.gyroflow-json",  # ours; Gyroflow skips it
    }
    return laid_out(document) + "\n"


def read(text: str, origin: str, _: str | None = None) -> ReadCamera:
    """The camera in a text."""
    values = json_object(text, origin)
    said = values.get("distortion_model") or LENSES[0].name
    lens = lens_named(LENSES, said, f"distortion_model {shown_plain(said)}", origin)
    for key in ("input_horizontal_stretch", "input_vertical_stretch"):
        if number(values.get(key) or 1.0, key, origin) != 1:
            raise InputError(f"{origin}: {key} is {shown_plain(values[key])}: a stretched picture is not supported")
    both = mapping(required(values, ("calib_dimension",), origin), "calib_dimension", origin)
    size = image_size([number(both.get(side), side, origin) for side in "wh"], origin)
    numbers = mapping(required(values, ("fisheye_params",), origin), "fisheye_params", origin)
    named = NamedLens(f"distortion_model is {said}", lens.model)
    found = camera_of(numbers, ("camera_matrix",), ("distortion_coeffs",), size, named, origin)
    if not values.get("asymmetrical"):
        where = "the centre is read as it stands there; Gyroflow takes the middle, as asymmetrical is not set"
        found = told(found, where)
    return left_over(found, values, *USED)


FORMAT = CameraFormat(
    name="gyroflow",
    title="Gyroflow lens profile",
    file_name="lens-profile.json",
    opens_with="in Gyroflow: Lens profile, Open file",
    recognised=re.compile(r'"calib_dimension"\s*:'),
    lenses=LENSES,
    write=write,
    read=read,
)
