"""Kalibr's camchain files: its `radtan` distortion is Brown's without k3, its `equi` that of Kannala and Brandt.

Of several cameras each pose is from the camera before it, in metres (its wiki, Yaml formats). Its cameras have no
names; a topic `/NAME/image_raw` says one.
"""

import re
from collections.abc import Mapping, Sequence
from dataclasses import replace
from itertools import pairwise

import numpy as np

from calib.cameras.camera import Camera
from calib.cameras.formats.format import CameraFormat, FileLens, ReadCamera
from calib.cameras.formats.lens import brown, fit_foreign, inverse_of, lens_camera, lens_named, slopes_of
from calib.cameras.formats.lens_names import model_named, require_agreement
from calib.cameras.formats.parsing import (
    image_size,
    mapping,
    matrix_pose,
    numbers,
    parse_yaml,
    pick,
    real,
    required,
    shown_plain,
)
from calib.cameras.formats.rig_format import ReadRig, RigFiles, RigFormat, WrittenRig, assembled
from calib.core.se3 import compose, invert
from designer.base.arrays import Array
from designer.base.errors import InputError

_RECOGNISED = re.compile(r"\A(?=(?s:.*?)^[ \t]*camera_model\s*:)(?=(?s:.*?)^[ \t]*intrinsics\s*:)", re.MULTILINE)


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
    said = f"camera_model and distortion_model {' and '.join(map(shown_plain, models))}"
    lens = lens_named(LENSES, "-".join(words), said, origin, "calibrate with")
    require_agreement(values, lens.model, origin, "camera_model", "distortion_model")
    size = image_size(required(values, ("resolution",), origin), origin)
    count = DISTORTED[words[1]]
    numbers_of = numbers(required(values, ("intrinsics",), origin), "intrinsics", origin, (len(lens.names) - count,))
    if count:
        coefficients = required(values, ("distortion_coeffs",), origin)
        numbers_of += numbers(coefficients, "distortion_coeffs", origin, (count,))
    if lens == DISTORTED_SPHERE and any(numbers_of[-count:]):
        return distorted_sphere(numbers_of, lens.name, size, origin)
    return lens_camera(lens, numbers_of, size, origin)


def distorted_sphere(numbers_of: list[float], name: str, size: tuple[int, int], origin: str) -> ReadCamera:
    """The unified camera xi fx fy cx cy k1 k2 p1 p2, with Brown's distortion of (X, Y) / (Z + xi d)."""
    sphere, coefficients = numbers_of[:5], numbers_of[5:]
    camera = lens_camera(SPHERE, sphere, size, origin).camera
    unit = replace(camera, params=np.array([1.0, 1.0, 0.0, 0.0, *camera.params[4:]]))

    def rays(pixel: Array) -> Array:
        return unit.rays(
            np.column_stack(inverse_of(brown(coefficients[:2], *coefficients[2:]), *slopes_of(pixel, sphere[1:])))
        )

    return fit_foreign(rays, sphere[1:], size, f"its {name} lens", origin)


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


FROM_BEFORE, FROM_IMU = "T_cn_cnm1", "T_cam_imu"
_TOPIC = re.compile(r"/?([^/]+(?:/[^/]+)*)/[^/]+")


def write_rig(written: WrittenRig) -> Mapping[str, str]:
    """The text for a chain of cameras."""
    poses = written.cam_from_rig
    chain = [np.eye(4), *(compose(here, invert(before)) for before, here in pairwise(poses))]
    count = len(poses)
    text = "".join(
        entry(
            f"cam{row}", camera, lens, written.words[row], [one for one in range(count) if one != row],
            _rows(chain[row]) if row else "",
        )
        for row, (camera, lens) in enumerate(zip(written.rig.cameras, written.lenses, strict=True))
    )  # fmt: skip
    return {RIG_FORMAT.file_name: text}


def _rows(pose: Array) -> str:
    """The lines of a pose."""
    rows = "".join(f"  - [{', '.join(map(real, row))}]\n" for row in pose.tolist())
    return f"  {FROM_BEFORE}:\n{rows}"


def read_rig(files: RigFiles) -> ReadRig:
    """The rig of a chain; its frame is that of cam0, or the IMU's where nothing says how cameras follow each other."""
    (text,), origin = files.texts.values(), files.origin
    tree = mapping(parse_yaml(text, origin), "the file", origin)
    keys = [key for key in tree if re.fullmatch(r"cam[0-9]{1,3}", key)]
    keys.sort(key=lambda key: int(key[3:]))
    if keys != [f"cam{row}" for row in range(len(keys))] or not keys:
        raise InputError(f"{origin}: must hold cam0, cam1, ... without a gap")
    entries = [mapping(tree[key], key, origin) for key in keys]
    found = [read_entry(values, f"{origin}: {key}") for key, values in zip(keys, entries, strict=True)]
    poses, frame = _poses(entries, keys, files)
    return assembled(files, _names(entries, keys), found, poses, "m", frame)


def _poses(entries: list[Mapping[str, object]], keys: list[str], files: RigFiles) -> tuple[list[Array], str | None]:
    """Poses (4, 4) of the cameras, and in whose frame if it is none of theirs."""

    def pose(row: int, name: str) -> Array:
        return matrix_pose(entries[row][name], name, files.unit, f"{files.origin}: {keys[row]}")

    if all(FROM_BEFORE in one for one in entries[1:]):
        poses = [np.eye(4)]
        for row in range(1, len(entries)):
            poses.append(compose(pose(row, FROM_BEFORE), poses[-1]))
        return poses, None
    if all(FROM_IMU in one for one in entries):
        return [pose(row, FROM_IMU) for row in range(len(entries))], "imu"
    without = next(key for key, one in zip(keys[1:], entries[1:], strict=True) if FROM_BEFORE not in one)
    raise InputError(
        f"{files.origin}: {without} has no {FROM_BEFORE}, so where it stands is not known; "
        f"calibrate the cameras together, or name one, as in FILE#{without}"
    )


def _names(entries: list[Mapping[str, object]], keys: list[str]) -> tuple[str, ...]:
    """The topics' names, where each camera has another; else cam0, cam1, ..."""
    topics = [one.get("rostopic") for one in entries]
    found = [_TOPIC.fullmatch(one) if isinstance(one, str) and len(one) <= 100 else None for one in topics]
    names = [one[1] for one in found if one is not None]
    return tuple(names if len(set(names)) == len(keys) else keys)


RIG_FORMAT = RigFormat(
    opens_with="kalibr_calibrate_imu_camera --cams {file} ...; set each rostopic in it to that camera's",
    cameras=FORMAT,
    unit="m",
    write=write_rig,
    read=read_rig,
    recognised=re.compile(
        rf"^[ \t]*{FROM_BEFORE}\s*:|\A(?=(?s:.*?)^cam1\s*:)(?=(?s:.*?)^[ \t]*{FROM_IMU}\s*:)", re.MULTILINE
    ),
    keeps_frame=False,
)
