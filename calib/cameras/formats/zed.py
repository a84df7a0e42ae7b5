"""Stereolabs' factory calibration of a ZED, SNxxxx.conf: an INI with each camera at each resolution; only read.

As zed-opencv-native reads it: OpenCV's lens; the right camera is turned by the rotation vector RX CV RZ, and stands
`Baseline` to the right, TY and TZ aside, in millimetres. Their C++ and Python samples differ in Baseline's sign: to the
right it is negative in OpenCV's x2 = R x1 + T.
"""

import configparser
import re
from collections.abc import Mapping

import numpy as np

from calib.cameras.formats.format import CameraFormat, ReadCamera, left_over
from calib.cameras.formats.lens import brown_camera
from calib.cameras.formats.parsing import number, pick, required, vector_pose
from calib.cameras.formats.rig_format import ReadRig, RigFiles, RigFormat, assembled
from designer.base.arrays import Array
from designer.base.errors import InputError

SIZES = {
    "2K": (2208, 1242),
    "FHD": (1920, 1080),
    "HD": (1280, 720),
    "VGA": (672, 376),
    "FHD1200": (1920, 1200),
    "SVGA": (960, 600),
}
COEFFICIENTS = ("k1", "k2", "p1", "p2", "k3", "k4", "k5", "k6")
SIDES = ("LEFT", "RIGHT")


def _sections(text: str, origin: str) -> Mapping[str, Mapping[str, str]]:
    """Entries by section, in capitals; keys in small letters."""
    parser = configparser.RawConfigParser(strict=False, delimiters=("=",), inline_comment_prefixes=(";", "#"))
    try:
        parser.read_string(text)
    except configparser.Error as error:
        raise InputError(f"{origin}: {' '.join(error.message.split())[:120]}; not valid INI") from None
    return {name.upper(): dict(parser.items(name)) for name in parser.sections()}


def _cameras(text: str, origin: str) -> dict[str, ReadCamera]:
    """Each camera, such as LEFT_HD; coefficients may stand in a section of their own for all resolutions."""
    sections, found = _sections(text, origin), dict[str, ReadCamera]()
    for kind, size in SIZES.items():
        for side in SIDES:
            own = sections.get(f"{side}_CAM_{kind}")
            if own is not None:
                values = {**sections.get(f"{side}_DISTO", {}), **own}
                linear = [number(required(values, (key,), origin), key, origin) for key in ("fx", "fy", "cx", "cy")]
                lens = [number(values.get(key, 0.0), key, origin) for key in COEFFICIENTS]
                found[f"{side}_{kind}"] = brown_camera(linear, lens, size, f"{origin}: {side}_CAM_{kind}")
    if not found:
        raise InputError(f"{origin}: holds no camera; a section is called LEFT_CAM_HD, of {', '.join(SIZES)}")
    return found


def read(text: str, origin: str, name: str | None = None) -> ReadCamera:
    """The camera of that side and resolution, such as LEFT_HD."""
    found, known = pick(_cameras(text, origin), name, origin), ("STEREO", *(f"{side}_DISTO" for side in SIDES))
    cameras = tuple(f"{side}_CAM_{kind}" for side in SIDES for kind in SIZES)
    return left_over(found, _sections(text, origin), *known, *cameras)


FORMAT = CameraFormat(
    name="zed",
    title="ZED calibration",
    file_name="SN1234.conf",
    recognised=re.compile(r"^[ \t]*\[(?:LEFT|RIGHT)_CAM_[0-9A-Z]{1,10}\]", re.MULTILINE | re.IGNORECASE),
    read=read,
    holds_many=True,
)


def read_rig(files: RigFiles) -> ReadRig:
    """The cameras of all resolutions, those of the left eye in one place; `--cameras` takes two of them."""
    (text,), origin = files.texts.values(), files.origin
    found, stereo = _cameras(text, origin), _sections(text, origin).get("STEREO", {})
    poses = [
        np.eye(4) if name.startswith(SIDES[0]) else _right_from_left(stereo, name.partition("_")[2], origin)
        for name in found
    ]
    return assembled(files, list(found), list(found.values()), poses, "mm")


def _right_from_left(stereo: Mapping[str, str], kind: str, origin: str) -> Array:
    """In mm (4, 4); what a resolution does not say for itself stands without its name."""

    def value(key: str) -> float:
        own = f"{key}_{kind.lower()}"
        return number(stereo.get(own, stereo.get(key, 0.0)), own, origin)

    baseline = number(required(stereo, ("baseline",), origin), "baseline", origin)
    turn = [value(key) for key in ("rx", "cv", "rz")]
    return vector_pose(turn, [-baseline, value("ty"), value("tz")], "mm", origin)


RIG_FORMAT = RigFormat(
    cameras=FORMAT,
    unit="mm",
    read=read_rig,
    recognised=re.compile(r"^[ \t]*\[STEREO\]\s*$(?s:.*?)^[ \t]*Baseline\s*=", re.MULTILINE | re.IGNORECASE),
)
