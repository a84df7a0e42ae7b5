"""Metashape's XML: a saved camera calibration, or the sensors in exported cameras.

Metashape's frame camera takes x = X/Z, y = Y/Z with r^2 = x^2 + y^2 to
`x' = x (1 + K1 r^2 + K2 r^4 + K3 r^6 + K4 r^8) + (P1 (r^2 + 2x^2) + 2 P2 xy) (1 + P3 r^2 + P4 r^4)`,
`y' = y (1 + K1 r^2 + K2 r^4 + K3 r^6 + K4 r^8) + (P2 (r^2 + 2y^2) + 2 P1 xy) (1 + P3 r^2 + P4 r^4)`,
`u = w/2 + cx + x' f + x' B1 + y' B2`, `v = h/2 + cy + y' f` (its manual, appendix on camera models), counted from the
image's corner. So P1 and P2 are OpenCV's p2 and p1, and u and v are larger by half a pixel. Its fisheye cameras do the
same with x and y that are as far apart as the angle theta off the axis, r = theta, or r = 2 sin(theta / 2) of the
equisolid ones.
"""

import re
from collections.abc import Mapping
from xml.etree.ElementTree import Element

import numpy as np

from calib.cameras.camera import Camera
from calib.cameras.formats.format import CameraFormat, FileLens, ReadCamera
from calib.cameras.formats.lens import Complex, Distort, fit_foreign, fit_lens, inverse_of, lens_camera, slopes_of
from calib.cameras.formats.parsing import image_size, number, parse_xml, pick, real
from designer.base.arrays import Array
from designer.base.errors import InputError
from designer.base.words import shown

CORNER = 0.5
"""A position counted from the image's corner, of a pixel whose centre is 0."""

MAX_FILE_BYTES = 2**24
"""Exported cameras come with the poses of all photos."""

FOREIGN = ("p3", "p4")
"""What no model of ours has."""
SWAPPED = {"p1": "p2", "p2": "p1", "skew": "b2"}
NUMBERS = ("f", "cx", "cy", "b1", "b2", "k1", "k2", "k3", "k4", "p1", "p2", "p3", "p4")
_RECOGNISED = re.compile(r"\A\s*(?=<)(?s:.*?)<calibration\b")


LENSES = (
    FileLens("frame", "opencv", "fx fy cx cy k1 k2 k3 p2 p1"),
    FileLens("fisheye", "thin_prism_fisheye", "fx fy cx cy k1 k2 k3 k4 p2 p1"),
    FileLens("frame_b2", "opencv_skew", "fx fy cx cy skew k1 k2 k3 p2 p1"),
)
"""Its camera types, with the numbers of ours in its order."""
EQUIDISTANT = ("fisheye", "equidistant_fisheye")
EQUISOLID = "equisolid_fisheye"


def write(camera: Camera, lens: FileLens) -> str:
    """The text of a calibration for a camera of the lens's model."""
    known = dict(zip(lens.names, lens.values(camera), strict=True))
    fx, fy, skew = known["fx"], known["fy"], known.pop("skew", 0.0)
    width, height = camera.image_size
    *radial, p1, p2 = list(known.values())[4:]
    cx, cy = known["cx"] + CORNER - width / 2, known["cy"] + CORNER - height / 2
    values = {"f": fy, "cx": cx, "cy": cy, "b1": fx - fy, "b2": skew}
    values |= {f"k{k}": value for k, value in enumerate(radial, start=1)} | {"p1": p1, "p2": p2}
    lines = "".join(f"  <{name}>{real(value)}</{name}>\n" for name, value in values.items())
    kind = lens.name.removesuffix("_b2")
    return (
        f'<?xml version="1.0" encoding="UTF-8"?>\n<calibration>\n  <projection>{kind}</projection>\n'
        f"  <width>{width}</width>\n  <height>{height}</height>\n{lines}</calibration>\n"
    )


def read(text: str, origin: str, name: str | None = None) -> ReadCamera:
    """The camera in a text, or of exported cameras the sensor of that label."""
    root = parse_xml(text, origin)
    if root.tag == "calibration":
        if name is not None:
            raise InputError(f"{origin}: holds one camera without a name; leave out #{name}")
        return _camera(root, origin)
    return _camera(pick(_sensors(root), name, origin), origin)


def _sensors(root: Element) -> Mapping[str, Element]:
    """The adjusted calibration of each sensor, else its first, by the sensor's label."""
    found: dict[str, Element] = {}
    for sensor in root.iter("sensor"):
        calibrations = sensor.findall("calibration")
        adjusted = [one for one in calibrations if one.get("class") == "adjusted"]
        label = sensor.get("label") or sensor.get("id") or "sensor"
        if calibrations:
            found[label if label not in found else f"{label} {sensor.get('id')}"] = (adjusted or calibrations)[0]
    return found


def _camera(calibration: Element, origin: str) -> ReadCamera:
    kind = (calibration.findtext("projection") or calibration.get("type") or "frame").strip()
    if kind not in ("frame", *EQUIDISTANT, EQUISOLID):
        known = ", ".join(("frame", *EQUIDISTANT, EQUISOLID))
        raise InputError(f"{origin}: {shown(kind)} camera: not supported; of Metashape's cameras {known} are")
    if calibration.find("fx") is not None:
        raise InputError(f"{origin}: a calibration of an old PhotoScan; save it again with Metashape")
    size = _image_size(calibration, origin)
    values = {name: number(calibration.findtext(name, "0"), name, origin) for name in NUMBERS}
    f, b1 = values["f"], values["b1"]
    linear = [f + b1, f, size[0] / 2 + values["cx"] - CORNER, size[1] / 2 + values["cy"] - CORNER]
    wide = kind != "frame"
    foreign = [name for name in (*FOREIGN, "b2" if wide else "k4") if values[name]]
    if kind != EQUISOLID and not foreign:
        lens = LENSES[1 if wide else 2 if values["b2"] else 0]
        return lens_camera(lens, [*linear, *(values[SWAPPED.get(name, name)] for name in lens.names[4:])], size, origin)
    what = f"its {kind} lens" + (f" with {' '.join(foreign)}" if foreign else "")
    distort = _distortion(values, values["b2"] / linear[0] if linear[0] else 0.0)
    if not wide:
        return fit_lens(distort, linear, size, what, origin)

    def rays(pixel: Array) -> Array:
        x, y = inverse_of(distort, *slopes_of(pixel, linear))
        radius = np.hypot(x, y)
        theta = radius if kind != EQUISOLID else 2 * np.arcsin(radius / 2)
        aside = np.sinc(theta / np.pi) if kind != EQUISOLID else np.cos(theta / 2)  # sin(theta) / r
        return np.where((theta < np.pi)[:, None], np.column_stack([aside * x, aside * y, np.cos(theta)]), np.nan)

    return fit_foreign(rays, linear, size, what, origin)


def _distortion(values: Mapping[str, float], skew: float) -> Distort:
    k1, k2, k3, k4, p1, p2, p3, p4 = (values[name] for name in ("k1", "k2", "k3", "k4", "p1", "p2", "p3", "p4"))

    def distort(x: Complex, y: Complex) -> tuple[Complex, Complex]:
        s = x * x + y * y
        radial, outer = 1 + s * (k1 + s * (k2 + s * (k3 + s * k4))), 1 + s * (p3 + s * p4)
        a = x * radial + (p1 * (s + 2 * x * x) + 2 * p2 * x * y) * outer
        b = y * radial + (p2 * (s + 2 * y * y) + 2 * p1 * x * y) * outer
        return a + skew * b, b

    return distort


def _image_size(calibration: Element, origin: str) -> tuple[int, int]:
    resolution = calibration.find("resolution")
    values = {
        side: calibration.findtext(side) if resolution is None else resolution.get(side) for side in ("width", "height")
    }
    for side, value in values.items():
        if value is None:
            raise InputError(f"{origin}: {side} of the image is missing")
    return image_size(list(values.values()), origin)


FORMAT = CameraFormat(
    name="metashape",
    title="Metashape XML",
    file_name="calibration.xml",
    opens_with="in Metashape: Tools, Camera Calibration, Initial, the folder symbol; then fix the calibration",
    recognised=_RECOGNISED,
    lenses=LENSES,
    write=write,
    read=read,
    holds_many=True,
    max_bytes=MAX_FILE_BYTES,
)
