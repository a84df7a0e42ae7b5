"""COLMAP's cameras.txt. Its pixel (0, 0) is the corner of the image, so that cx and cy are larger by half a pixel."""

import re

from calib.cameras import LINEAR
from calib.cameras.camera import Camera
from calib.interop.format import CameraFormat, ReadCamera
from calib.interop.lens import brown_camera
from calib.interop.parsing import image_size, make_camera, number, pick, real
from designer.base.errors import InputError
from designer.base.words import shown

CORNER = 0.5
"""A position counted from the image's corner, of a pixel whose centre is 0."""

MODELS = {
    "SIMPLE_PINHOLE": "f cx cy",
    "PINHOLE": "fx fy cx cy",
    "SIMPLE_RADIAL": "f cx cy k1",
    "RADIAL": "f cx cy k1 k2",
    "OPENCV": "fx fy cx cy k1 k2 p1 p2",
    "FULL_OPENCV": "fx fy cx cy k1 k2 p1 p2 k3 k4 k5 k6",
}
"""Models that can be read, and their parameters (COLMAP's sensor/models.h)."""

LENS = ("k1", "k2", "p1", "p2", "k3", "k4", "k5", "k6")

_RECOGNISED = re.compile(r"^\s*[0-9]+[ \t]+[A-Z][A-Z_0-9]*[ \t]+[0-9]+[ \t]+[0-9]+[ \t]+[-+.0-9]", re.MULTILINE)


def write(camera: Camera) -> str:
    """The text for a camera of model `opencv` or `pinhole`; the smallest of COLMAP's models that holds it."""
    fx, fy, cx, cy, *lens = camera.params.tolist()
    linear, width, height = [fx, fy, cx + CORNER, cy + CORNER], *camera.image_size
    if not any(lens):
        model, params = "PINHOLE", linear
    elif not lens[4]:
        model, params = "OPENCV", [*linear, *lens[:4]]
    else:
        model, params = "FULL_OPENCV", [*linear, *lens, 0.0, 0.0, 0.0]
    return (
        "# Camera list with one line of data per camera:\n"
        "#   CAMERA_ID, MODEL, WIDTH, HEIGHT, PARAMS[]\n"
        "# Number of cameras: 1\n"
        f"1 {model} {width} {height} {' '.join(map(real, params))}\n"
    )


def read(text: str, origin: str, name: str | None = None) -> ReadCamera:
    """The camera in a text, or the one of that id."""
    lines: dict[str, tuple[int, list[str]]] = {}
    for row, line in enumerate(text.splitlines(), start=1):
        words = line.split("#", 1)[0].split()
        if words:
            if words[0] in lines:
                raise InputError(f"{origin}: line {row}: camera {shown(words[0])} a second time; ids must differ")
            lines[words[0]] = row, words
    row, words = pick(lines, name, origin)
    return _camera(words, f"{origin}: line {row}")


def _camera(words: list[str], origin: str) -> ReadCamera:
    if len(words) < 4:
        raise InputError(f"{origin}: must be CAMERA_ID MODEL WIDTH HEIGHT PARAMS")
    model = words[1]
    if model not in MODELS:
        raise InputError(
            f"{origin}: camera model {shown(model)}: not supported; in COLMAP use one of {', '.join(MODELS)}"
        )
    names = MODELS[model].split()
    if len(words) != 4 + len(names):
        raise InputError(
            f"{origin}: {model} has {len(words) - 4} parameters; it must have {len(names)}: {MODELS[model]}"
        )
    size = image_size(words[2:4], origin)
    values = {key: number(word, key, origin) for key, word in zip(names, words[4:], strict=True)}
    fx, fy = (values[key] if key in values else values["f"] for key in ("fx", "fy"))
    linear = [fx, fy, values["cx"] - CORNER, values["cy"] - CORNER]
    if model.endswith("PINHOLE"):
        return ReadCamera(make_camera(LINEAR, linear, size, origin))
    return brown_camera(linear, [values.get(key, 0.0) for key in LENS], size, origin)


FORMAT = CameraFormat(
    name="colmap",
    title="COLMAP cameras.txt",
    file_name="cameras.txt",
    opens_with="beside images.txt and points3D.txt in a model folder; or its numbers after "
    "colmap feature_extractor --ImageReader.camera_params",
    recognised=_RECOGNISED,
    write=write,
    read=read,
    holds_many=True,
)
