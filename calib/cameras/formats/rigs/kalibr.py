"""Kalibr's camchain of several cameras: each pose is from the camera before it, in metres (its wiki, Yaml formats).

Its cameras have no names; a topic `/NAME/image_raw` says one.
"""

import re
from collections.abc import Mapping
from itertools import pairwise

import numpy as np

from calib.cameras.formats import FORMATS
from calib.cameras.formats.kalibr import entry, read_entry
from calib.cameras.formats.parsing import mapping, parse_yaml, real
from calib.cameras.formats.rigs.format import ReadRig, RigFiles, RigFormat, WrittenRig, assembled
from calib.cameras.formats.rigs.poses import matrix_pose
from calib.core.se3 import compose, invert
from designer.base.arrays import Array
from designer.base.errors import InputError

FROM_BEFORE, FROM_IMU = "T_cn_cnm1", "T_cam_imu"
_TOPIC = re.compile(r"/?([^/]+(?:/[^/]+)*)/[^/]+")


def write(written: WrittenRig) -> Mapping[str, str]:
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
    return {FORMAT.file_name: text}


def _rows(pose: Array) -> str:
    """The lines of a pose."""
    rows = "".join(f"  - [{', '.join(map(real, row))}]\n" for row in pose.tolist())
    return f"  {FROM_BEFORE}:\n{rows}"


def read(files: RigFiles) -> ReadRig:
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


FORMAT = RigFormat(
    name="kalibr",
    title="Kalibr camchain",
    file_name="camchain.yaml",
    opens_with="kalibr_calibrate_imu_camera --cams {file} ...; set each rostopic in it to that camera's",
    cameras=FORMATS["kalibr"],
    unit="m",
    write=write,
    read=read,
    recognised=re.compile(
        rf"^\s*{FROM_BEFORE}\s*:|\A(?=(?s:.*?)^cam1\s*:)(?=(?s:.*?)^\s*{FROM_IMU}\s*:)", re.MULTILINE
    ),
    keeps_frame=False,
    has_own_unit=True,
)
