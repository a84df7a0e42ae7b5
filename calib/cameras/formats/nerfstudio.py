"""nerfstudio's transforms.json: one camera for all frames, or one a frame; poses of the frames are not read.

Pixels are counted from the corner of the image (its rays go through x + 0.5). Its OPENCV lens is Brown's with a k4 for
r^8 (`get_distortion_params`), its OPENCV_FISHEYE that of Kannala and Brandt. Numbers that are not there are zero.
"""

import re
from collections.abc import Mapping

from calib.cameras.camera import Camera
from calib.cameras.formats.format import CameraFormat, FileLens, ReadCamera, left_over, told
from calib.cameras.formats.lens import brown, fit_lens, lens_camera, lens_named
from calib.cameras.formats.metashape import CORNER
from calib.cameras.formats.parsing import image_size, json_object, mapping, number, pick, required, shown_plain
from designer.base.errors import InputError
from designer.base.file_kind import laid_out
from designer.base.files import JsonValue
from designer.base.words import NAME

LENSES = (
    FileLens("PINHOLE", "pinhole", "fx fy cx cy"),
    FileLens("OPENCV", "opencv", "fx fy cx cy k1 k2 k3 0 p1 p2"),
    FileLens("OPENCV_FISHEYE", "fisheye", "fx fy cx cy k1 k2 k3 k4 0 0"),
)
LINEAR = ("fl_x", "fl_y", "cx", "cy")
DISTORTION = ("k1", "k2", "k3", "k4", "p1", "p2")
ALSO = {"SIMPLE_PINHOLE": "PINHOLE", "SIMPLE_RADIAL": "OPENCV", "RADIAL": "OPENCV", "PERSPECTIVE": "OPENCV"}
"""Other names in such files, whose numbers are a part."""
USED = (*LINEAR, *DISTORTION, "w", "h", "camera_model", "frames", "camera_angle_x", "camera_angle_y")
MAX_FILE_BYTES = 2**26


def write(camera: Camera, lens: FileLens) -> str:
    """The text for a camera of the lens's model, without frames."""
    fx, fy, cx, cy, *rest = lens.values(camera)
    width, height = camera.image_size
    document: dict[str, JsonValue] = {
        "camera_model": lens.name,
        "w": width,
        "h": height,
        **dict(zip(LINEAR, (fx, fy, cx + CORNER, cy + CORNER), strict=True)),
        **dict(zip(DISTORTION, rest or [0.0] * len(DISTORTION), strict=True)),
        "frames": [],
        "format": f"{NAME}.nerfstudio-json",  # ours; nerfstudio skips it
    }
    return laid_out(document) + "\n"


def read(text: str, origin: str, name: str | None = None) -> ReadCamera:
    """The camera in a text; where frames have cameras of their own, that of the frame of that path."""
    tree = json_object(text, origin)
    given = tree.get("frames", [])
    frames = [mapping(one, "frames", origin) for one in given] if isinstance(given, list) else []
    cameras: dict[str, Mapping[str, object]] = {"camera": tree} if LINEAR[0] in tree else {}
    if not cameras:
        known = dict[tuple[str, ...], str]()  # frames of one camera say the same
        for frame in frames:
            one = {**tree, **{key: value for key, value in frame.items() if key in USED}}
            path = known.setdefault(tuple(str(one.get(key)) for key in USED[:-3]), str(frame.get("file_path")))
            cameras.setdefault(path, one)
    found = _camera(pick(cameras, name, origin), origin)
    return left_over(told(found, f"the poses of {len(frames)} frames are not read") if frames else found, tree, *USED)


def _camera(values: Mapping[str, object], origin: str) -> ReadCamera:
    said = values.get("camera_model") or "OPENCV"
    name = ALSO.get(said, said) if isinstance(said, str) else said
    lens = lens_named(LENSES, name, f"camera_model {shown_plain(said)}", origin)
    size = image_size([required(values, (side,), origin) for side in "wh"], origin)
    also = {**values, "fl_y": values.get("fl_y", values.get("fl_x"))}
    fx, fy, cx, cy = (number(required(also, (key,), origin), key, origin) for key in LINEAR)
    linear = [fx, fy, cx - CORNER, cy - CORNER]
    rest = [number(values.get(key, 0.0), key, origin) for key in DISTORTION]
    k1, k2, k3, k4, p1, p2 = rest
    if lens.is_plain:
        if any(rest):
            raise InputError(f"{origin}: camera_model {said}, but k1 ... p2 are not zero; leave the one that is right")
        return lens_camera(lens, linear, size, origin)
    if lens.is_wide or not k4:
        return lens_camera(lens, [*linear, *rest], size, origin)
    return fit_lens(brown([k1, k2, k3, k4], p1, p2), linear, size, "its OPENCV lens with k4", origin)


FORMAT = CameraFormat(
    name="nerfstudio",
    title="nerfstudio transforms",
    file_name="transforms.json",
    opens_with="ns-train nerfacto --data FOLDER; first copy these keys into the transforms.json with your frames",
    recognised=re.compile(rf'"{LINEAR[0]}"\s*:'),
    lenses=LENSES,
    write=write,
    read=read,
    holds_many=True,
    max_bytes=MAX_FILE_BYTES,
)
