"""Kalibr's camchain files: pinhole cameras with its `radtan` lens, which is Brown's with k1 k2 p1 p2 and no k3."""

import re

from calib.cameras import LINEAR
from calib.cameras.camera import Camera
from calib.interop.format import CameraFormat, ReadCamera
from calib.interop.lens import brown_camera
from calib.interop.parsing import (
    image_size,
    make_camera,
    mapping,
    numbers,
    parse_yaml,
    pick,
    real,
    required,
    shown_plain,
)
from designer.base.errors import InputError

_RECOGNISED = re.compile(
    r"^\s*camera_model\s*:.*?^\s*intrinsics\s*:|^\s*intrinsics\s*:.*?^\s*camera_model\s*:", re.MULTILINE | re.DOTALL
)


def write(camera: Camera) -> str:
    """The text for a camera of model `opencv` without k3, or `pinhole`."""
    lens = camera.params.tolist()[4:8] or [0.0] * 4
    width, height = camera.image_size
    return (
        "cam0:\n"
        "  cam_overlaps: []\n"
        "  camera_model: pinhole\n"
        f"  distortion_coeffs: [{', '.join(map(real, lens))}]\n"
        "  distortion_model: radtan\n"
        f"  intrinsics: [{', '.join(map(real, camera.params[:4]))}]\n"
        f"  resolution: [{width}, {height}]\n"
        "  rostopic: /cam0/image_raw\n"
    )


def read(text: str, origin: str, name: str | None = None) -> ReadCamera:
    """The camera in a text, or the one of that name."""
    tree = mapping(parse_yaml(text, origin), "the file", origin)
    chain = {"cam0": tree} if "intrinsics" in tree else {key: one for key, one in tree.items() if isinstance(one, dict)}
    values = mapping(pick(chain, name, origin), "a camera", origin)
    for key, known in (("camera_model", ("pinhole",)), ("distortion_model", ("radtan", "none"))):
        found = required(values, (key,), origin)
        if found not in known:
            raise InputError(
                f"{origin}: {key} {shown_plain(found)}: not supported; calibrate with Kalibr's pinhole-radtan"
            )
    size = image_size(required(values, ("resolution",), origin), origin)
    linear = numbers(required(values, ("intrinsics",), origin), "intrinsics", origin, (4,))
    if values["distortion_model"] == "none":
        return ReadCamera(make_camera(LINEAR, linear, size, origin))
    lens = numbers(required(values, ("distortion_coeffs",), origin), "distortion_coeffs", origin, (4,))
    return brown_camera(linear, lens, size, origin)


FORMAT = CameraFormat(
    name="kalibr",
    title="Kalibr camchain",
    file_name="camchain.yaml",
    opens_with="kalibr_calibrate_imu_camera --cams {file} ...; set rostopic in it to your camera's",
    recognised=_RECOGNISED,
    write=write,
    read=read,
    cannot_hold=("k3",),
    holds_many=True,
)
