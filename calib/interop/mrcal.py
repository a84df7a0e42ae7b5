"""mrcal's .cameramodel files: a Python dict of literals."""

import ast
import re

from calib.cameras import LINEAR
from calib.cameras.camera import Camera
from calib.interop.format import CameraFormat, ReadCamera
from calib.interop.lens import brown_camera
from calib.interop.parsing import image_size, make_camera, mapping, numbers, real, required, shown_plain
from designer.base.errors import InputError
from designer.base.words import shown

MODELS = {
    "LENSMODEL_PINHOLE": 0,
    "LENSMODEL_OPENCV4": 4,
    "LENSMODEL_OPENCV5": 5,
    "LENSMODEL_OPENCV8": 8,
    "LENSMODEL_OPENCV12": 12,
}
"""Models that can be read, and how many coefficients follow fx fy cx cy."""

MAX_FILE_BYTES = 2**26
"""A model may hold all observations it was made from."""

MAX_TOKENS = 100_000

_TOKEN = re.compile(
    r"""(?P<skip>\#[^\n]*|\s+)
    |(?P<mark>[\[\](){},:])
    |(?P<plain>b?'(?:[^'\\\n]++|\\.)*+'|b?"(?:[^"\\\n]++|\\.)*+"
      |[-+]?(?:[0-9]{1,40}\.?[0-9]{0,40}|\.[0-9]{1,40})(?:[eE][-+]?[0-9]{1,4})?|True|False|None)""",
    re.VERBOSE,
)
_RECOGNISED = re.compile(r"""["'](?:lensmodel|lens_model|distortion_model)["']\s*:""")


def write(camera: Camera) -> str:
    """The text for a camera of model `opencv` or `pinhole`, at the origin."""
    model = "LENSMODEL_PINHOLE" if camera.model == LINEAR else "LENSMODEL_OPENCV5"
    width, height = camera.image_size
    return (
        "{\n"
        f"    'lensmodel':  '{model}',\n\n"
        "    # intrinsics are fx,fy,cx,cy,distortion0,distortion1,....\n"
        f"    'intrinsics': [ {', '.join(map(real, camera.params))} ],\n\n"
        "    # extrinsics are rt_fromref\n"
        "    'extrinsics': [ 0., 0., 0., 0., 0., 0. ],\n\n"
        f"    'imagersize': [ {width}, {height} ]\n"
        "}\n"
    )


def read(text: str, origin: str, _: str | None = None) -> ReadCamera:
    """The camera in a text."""
    values = mapping(_literal(text, origin), "the file", origin)
    model = required(values, ("lensmodel", "lens_model", "distortion_model"), origin)
    name = model.replace("DISTORTION_", "LENSMODEL_") if isinstance(model, str) else ""
    if name not in MODELS:
        hint = "first run mrcal-convert-lensmodel LENSMODEL_OPENCV5"
        raise InputError(f"{origin}: lens model {shown_plain(model)}: not supported; {hint}")
    size = image_size(required(values, ("imagersize",), origin), origin)
    params = numbers(required(values, ("intrinsics",), origin), "intrinsics", origin, (4 + MODELS[name],))
    if not MODELS[name]:
        return ReadCamera(make_camera(LINEAR, params, size, origin))
    return brown_camera(params[:4], params[4:], size, origin)


def _literal(text: str, origin: str) -> object:
    """The value of a Python literal, read only after its tokens are known to be few and plain."""
    _check_tokens(text, origin)
    try:
        value: object = ast.literal_eval(text.strip())
    except (ValueError, SyntaxError, TypeError, MemoryError, RecursionError):
        raise InputError(f"{origin}: not a mrcal camera model: it must be one Python dict of plain values") from None
    return value


def _check_tokens(text: str, origin: str) -> None:
    position = count = 0
    while position < len(text):
        token = _TOKEN.match(text, position)
        if token is None:
            line = text.count("\n", 0, position) + 1
            raise InputError(
                f"{origin}: line {line}: {shown(text[position : position + 20])}; not a mrcal camera model"
            )
        position, count = token.end(), count + 1
        if count > MAX_TOKENS:
            raise InputError(f"{origin}: more than {MAX_TOKENS} values and marks; a mrcal camera model has fewer")


FORMAT = CameraFormat(
    name="mrcal",
    title="mrcal camera model",
    file_name="camera.cameramodel",
    opens_with='mrcal-show-projection-diff {file} OTHER.cameramodel; in Python: mrcal.cameramodel("{file}")',
    recognised=_RECOGNISED,
    write=write,
    read=read,
    max_bytes=MAX_FILE_BYTES,
)
