"""Kalibr's camchain files: its `radtan` distortion is Brown's without k3, its `equi` that of Kannala and Brandt."""

import re
from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np

from calib.cameras.camera import Camera
from calib.cameras.formats.format import CameraFormat, FileLens, ReadCamera
from calib.cameras.formats.lens import brown, fit_foreign, invert, lens_camera, lens_named, slopes_of
from calib.cameras.formats.lens_names import model_named, require_agreement
from calib.cameras.formats.parsing import image_size, mapping, numbers, parse_yaml, pick, real, required, shown_plain
from designer.base.arrays import Array
from designer.base.errors import InputError

_RECOGNISED = re.compile(
    r"^\s*camera_model\s*:.*?^\s*intrinsics\s*:|^\s*intrinsics\s*:.*?^\s*camera_model\s*:", re.MULTILINE | re.DOTALL
)


SPHERE = FileLens("omni-none", "omni", "xi fx fy cx cy")
DISTORTED_SPHERE = FileLens("omni-radtan", "omni", "xi fx fy cx cy 0 0 0 0")
LENSES = (
    FileLens("pinhole-radtan", "opencv", "fx fy cx cy k1 k2 p1 p2"),
    FileLens("pinhole-equi", "fisheye", "fx fy cx cy k1 k2 k3 k4"),
    FileLens("ds-none", "ds", "xi alpha fx fy cx cy"),
    FileLens("eucm-none", "eucm", "alpha beta fx fy cx cy"),
    SPHERE,
    DISTORTED_SPHERE,
    FileLens("pinhole-none", "pinhole", "fx fy cx cy"),
)
"""A camera model and a distortion model, with the numbers of both (Kalibr's wiki, Supported models)."""
DISTORTED = {"radtan": 4, "equi": 4, "none": 0}
"""How many numbers a distortion model has."""
IN_FILES = {"equi": "equidistant"}
"""A distortion model that Kalibr's files call by another name than its command line does."""
OURS = {"opencv": "radtan", "fisheye": "equi"}
"""Its distortion models by the model that other names for them mean."""


def write(camera: Camera, lens: FileLens) -> str:
    """The text for a camera of the lens's model."""
    return entry("cam0", camera, lens, "cam0")


def entry(key: str, camera: Camera, lens: FileLens, name: str, overlaps: Sequence[int] = (), pose: str = "") -> str:
    """A camera's part of a chain, with its pose's lines if there are any."""
    projection, distortion = lens.name.split("-")
    values = list(map(real, lens.values(camera)))
    count = len(values) - DISTORTED[distortion]
    width, height = camera.image_size
    return (
        f"{key}:\n"
        f"{pose}"
        f"  cam_overlaps: {list(overlaps)}\n"
        f"  camera_model: {projection}\n"
        f"  distortion_coeffs: [{', '.join(values[count:])}]\n"
        f"  distortion_model: {IN_FILES.get(distortion, distortion)}\n"
        f"  intrinsics: [{', '.join(values[:count])}]\n"
        f"  resolution: [{width}, {height}]\n"
        f"  rostopic: /{name}/image_raw\n"
    )


def read(text: str, origin: str, name: str | None = None) -> ReadCamera:
    """The camera in a text, or the one of that name."""
    tree = mapping(parse_yaml(text, origin), "the file", origin)
    chain = {"cam0": tree} if "intrinsics" in tree else {key: one for key, one in tree.items() if isinstance(one, dict)}
    return read_entry(mapping(pick(chain, name, origin), "a camera", origin), origin)


def read_entry(values: Mapping[str, object], origin: str) -> ReadCamera:
    """The camera of its part of a chain."""
    models = [required(values, (key,), origin) for key in ("camera_model", "distortion_model")]
    words = [one if isinstance(one, str) else "" for one in models]
    words = [words[0], OURS.get(model_named(words[1]) or "", words[1])]
    lens = lens_named(LENSES, "-".join(words))
    if lens is None:
        known = ", ".join(one.name for one in LENSES if one.is_written)
        found = " and ".join(map(shown_plain, models))
        raise InputError(f"{origin}: camera_model and distortion_model {found}: not supported; calibrate with {known}")
    require_agreement(values, lens.model, origin, "camera_model", "distortion_model")
    size = image_size(required(values, ("resolution",), origin), origin)
    count = DISTORTED[words[1]]
    numbers_of = numbers(required(values, ("intrinsics",), origin), "intrinsics", origin, (len(lens.names) - count,))
    if count:
        coefficients = required(values, ("distortion_coeffs",), origin)
        numbers_of += numbers(coefficients, "distortion_coeffs", origin, (count,))
    if lens == DISTORTED_SPHERE and any(numbers_of[-count:]):
        return _distorted_sphere(numbers_of, size, origin)
    return lens_camera(lens, numbers_of, size, origin)


def _distorted_sphere(numbers_of: list[float], size: tuple[int, int], origin: str) -> ReadCamera:
    """The unified camera with Brown's distortion behind it, (X, Y) / (Z + xi d) in place of (X, Y) / Z."""
    sphere, coefficients = numbers_of[:5], numbers_of[5:]
    camera = lens_camera(SPHERE, sphere, size, origin).camera
    unit = replace(camera, params=np.array([1.0, 1.0, 0.0, 0.0, *camera.params[4:]]))

    def rays(pixel: Array) -> Array:
        return unit.rays(np.column_stack(invert(brown(coefficients), *slopes_of(pixel, sphere[1:]))))

    return fit_foreign(rays, sphere[1:], size, f"its {DISTORTED_SPHERE.name} lens", origin)


FORMAT = CameraFormat(
    name="kalibr",
    title="Kalibr camchain",
    file_name="camchain.yaml",
    opens_with="kalibr_calibrate_imu_camera --cams {file} ...; set rostopic in it to your camera's",
    recognised=_RECOGNISED,
    lenses=LENSES,
    write=write,
    read=read,
    holds_many=True,
)
