"""RealSense intrinsics: librealsense's rs2_intrinsics as JSON, or as `rs-enumerate-devices -c` prints them.

Equations are those of its rsutil.h, with x, y = X/Z, Y/Z, s = x^2 + y^2, f = 1 + c0 s + c1 s^2 + c4 s^3: brown_conrady
is OpenCV's lens, kannala_brandt4 its fisheye's. modified_brown_conrady takes the tangential part of (f x, f y), with s
of (x, y); inverse_brown_conrady is the same since 2021, while earlier releases undistorted by Brown's polynomial.
ftheta is the FOV lens of Devernay and Faugeras.
"""

import re
from collections.abc import Callable, Mapping

import numpy as np

from calib.cameras.camera import Camera
from calib.cameras.formats.format import CameraFormat, FileLens, ReadCamera, left_over, told
from calib.cameras.formats.lens import Complex, brown, fit_foreign, fit_lens, lens_camera, slopes_of
from calib.cameras.formats.parsing import image_size, json_object, mapping, number, numbers, pick, required, shown_plain
from calib.cameras.refit import image_grid
from designer.base.arrays import Array
from designer.base.errors import InputError
from designer.base.file_kind import laid_out
from designer.base.files import JsonValue
from designer.base.words import NAME

LENSES = (
    FileLens("none", "pinhole", "fx fy cx cy"),
    FileLens("brown_conrady", "opencv", "fx fy cx cy k1 k2 p1 p2 k3"),
    FileLens("kannala_brandt4", "fisheye", "fx fy cx cy k1 k2 k3 k4 0"),
)
MODELS = ("none", "modified_brown_conrady", "inverse_brown_conrady", "ftheta", "brown_conrady", "kannala_brandt4")
"""By their numbers in rs2_distortion."""
LINEAR = ("fx", "fy", "ppx", "ppy")
USED = (*LINEAR, "width", "height", "model", "coeffs")
COEFFICIENTS = 5
_STREAM = re.compile(r'^[ \t]*Intrinsic of "([^"\n]{1,60})"\s*/\s*(\d+x\d+)', re.MULTILINE)
_LINE = re.compile(r"^[ \t]*(Width|Height|PPX|PPY|Fx|Fy|Distortion|Coeffs):[ \t]*(\S[^\n]{0,200})", re.MULTILINE)


def write(camera: Camera, lens: FileLens) -> str:
    """The text for a camera of the lens's model."""
    fx, fy, cx, cy, *rest = lens.values(camera)
    width, height = camera.image_size
    document: dict[str, JsonValue] = {
        "width": width,
        "height": height,
        **dict(zip(LINEAR, (fx, fy, cx, cy), strict=True)),
        "model": lens.name,
        "coeffs": list(rest or [0.0] * COEFFICIENTS),
        "format": f"{NAME}.realsense-json",
    }
    return laid_out(document) + "\n"


def read(text: str, origin: str, name: str | None = None) -> ReadCamera:
    """The camera in a text, or the one of that stream."""
    streams = _streams(json_object(text, origin), "camera", 0) if text.lstrip()[:1] == "{" else _printed(text)
    return _camera(pick(streams, name, origin), origin)


def _streams(tree: Mapping[str, object], name: str, depth: int) -> dict[str, Mapping[str, object]]:
    """What has a principal point, a few levels deep, by its key."""
    if "ppx" in tree:
        return {name: tree}
    inner = [(key, one) for key, one in tree.items() if isinstance(one, dict) and depth < len(LINEAR)]
    each = [_streams(one, name if key == "intrinsics" and depth else key, depth + 1) for key, one in inner]
    return {key: one for found in each for key, one in found.items()}


def _printed(text: str) -> dict[str, Mapping[str, object]]:
    """Each stream's first intrinsics by its name and size: several kinds of pixels have the same."""
    found = dict[str, Mapping[str, object]]()
    heads = list(_STREAM.finditer(text))
    for head, end in zip(heads, [*(one.start() for one in heads), len(text)][1:], strict=True):
        lines = {key.lower(): value.strip() for key, value in _LINE.findall(text[head.end() : end])}
        values: dict[str, object] = {
            **lines,
            "model": lines.get("distortion"),
            "coeffs": lines.get("coeffs", "").split(),
        }
        values.pop("distortion", None)
        found.setdefault(f"{head[1]} {head[2]}", values)
    return found


def _model(said: object, origin: str) -> str:
    word = re.sub(r"[^a-z0-9]", "", str(said).lower()[:60].replace("rs2_distortion_", "").removeprefix("distortion."))
    if word.isdigit() and int(word) < len(MODELS):
        return MODELS[int(word)]
    found = next((one for one in MODELS if one.replace("_", "") == word), None)
    if found is None:
        raise InputError(f"{origin}: model {shown_plain(said)}: not supported; there are {', '.join(MODELS)}")
    return found


def _camera(given: Mapping[str, object], origin: str) -> ReadCamera:
    values = mapping(given, "intrinsics", origin)
    size = image_size([number(values.get(side), side, origin) for side in ("width", "height")], origin)
    linear = [number(values.get(key), key, origin) for key in LINEAR]
    model = _model(required(values, ("model",), origin), origin)
    lens = numbers(values.get("coeffs", [0.0] * COEFFICIENTS), "coeffs", origin, range(COEFFICIENTS + 1))
    lens = (lens + [0.0] * COEFFICIENTS)[:COEFFICIENTS]
    if model == "none" and any(lens):
        raise InputError(f"{origin}: model none, but coeffs are not zero; leave the one that is right")
    return left_over(_of_model(model, linear, lens, size, origin), values, *USED)


def _of_model(model: str, linear: list[float], lens: list[float], size: tuple[int, int], origin: str) -> ReadCamera:
    written = next((one for one in LENSES if one.name == model), LENSES[0] if not any(lens) else None)
    if written is not None:
        return lens_camera(written, [*linear, *lens][: len(written.names)], size, origin)
    if model == "ftheta":
        return _fov(linear, lens[0], size, origin)
    found = fit_lens(_modified(lens), linear, size, f"its {model} lens", origin)
    if not model.startswith("inverse"):
        return found
    pixel = image_grid(size).reshape(-1, 2)
    with np.errstate(all="ignore"):
        off = np.linalg.norm(found.camera.project(_undistorted(lens, pixel, linear)) - pixel, axis=1)
    most = np.nanmax(off, initial=0.0)
    line = (
        f"taken as librealsense does since 2021; earlier ones undistorted with these numbers, up to {most:.2g} px away"
    )
    return told(found, line)


def _modified(lens: list[float]) -> Callable[[Complex, Complex], tuple[Complex, Complex]]:
    k1, k2, p1, p2, k3 = lens

    def distort(x: Complex, y: Complex) -> tuple[Complex, Complex]:
        s = x * x + y * y
        radial = 1 + s * (k1 + s * (k2 + s * k3))
        a, b = x * radial, y * radial
        return a + 2 * p1 * a * b + p2 * (s + 2 * a * a), b + 2 * p2 * a * b + p1 * (s + 2 * b * b)

    return distort


def _undistorted(lens: list[float], pixel: Array, linear: list[float]) -> Array:
    """Directions (N, 3) by Brown's polynomial of the measured point."""
    k1, k2, p1, p2, k3 = lens
    a, b = brown([k1, k2, k3], p1, p2)(*(one.astype(np.complex128) for one in slopes_of(pixel, linear)))
    return np.column_stack([a.real, b.real, np.ones(len(pixel))])


def _fov(linear: list[float], w: float, size: tuple[int, int], origin: str) -> ReadCamera:
    """r_d = atan(2 r tan(w / 2)) / w."""

    def rays(pixel: Array) -> Array:
        x, y = slopes_of(pixel, linear)
        radius = np.hypot(x, y)
        known = np.abs(w * radius) < np.pi / 2
        aside = np.where(known, np.tan(w * radius) / (2 * np.tan(w / 2)), np.nan)
        part = np.where(radius > 0, aside / radius, w / (2 * np.tan(w / 2)))
        return np.column_stack([part * x, part * y, np.ones_like(x)])

    return fit_foreign(rays, linear, size, "its ftheta lens", origin)


FORMAT = CameraFormat(
    name="realsense",
    title="RealSense intrinsics",
    file_name="intrinsics.json",
    opens_with='in Python: values = json.load(open("{file}")); pyrealsense2.intrinsics() takes them, a field each',
    recognised=re.compile(r'"ppx"\s*:|^[ \t]*PPX:', re.MULTILINE),
    lenses=LENSES,
    write=write,
    read=read,
    holds_many=True,
)
