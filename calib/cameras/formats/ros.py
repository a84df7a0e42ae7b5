"""ROS camera_info files, as `camera_calibration` writes and drivers read them, its ost.txt, and CameraInfo messages.

K of a message is that of the full sensor; the photos of its topic are a region of it, and binned (REP 104, and
sensor_msgs/CameraInfo): `u' = (u - x_offset + 1/2) / binning_x - 1/2`, as pixel (0, 0) is the centre of the first.
"""

import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

from calib.cameras import COMMON, LINEAR
from calib.cameras.camera import MAX_SIDE_PX, Camera
from calib.cameras.formats import opencv
from calib.cameras.formats.format import CameraFormat, FileLens, ReadCamera
from calib.cameras.formats.lens_names import mentions_lens, named_lens
from calib.cameras.formats.parsing import mapping, number, parse_tree, real, required
from designer.base.errors import InputError

LENSES = (
    FileLens("plumb_bob", "opencv", "fx fy cx cy k1 k2 p1 p2 k3"),
    FileLens("rational_polynomial", "opencv8", "fx fy cx cy k1 k2 p1 p2 k3 k4 k5 k6"),
    FileLens("equidistant", "fisheye", "fx fy cx cy k1 k2 k3 k4"),
)
"""Its distortion models (sensor_msgs/distortion_models)."""
COUNTS = {COMMON: (0, 4, 5), "opencv8": (8, 12, 14)}
"""How many coefficients they may have: OpenCV's functions take them, so that a long list goes on as theirs."""

MATRIX, COEFFICIENTS = (*opencv.MATRIX, "k"), (*opencv.LENS, "d")
KEYS = (*MATRIX, *COEFFICIENTS, *opencv.SIZE, "binning_x", "binning_y", "roi")

IDENTITY = (1.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0)

_OST = re.compile(r"^\[image\]\s*$(?=(?s:.*?)^camera matrix\s*$)", re.MULTILINE)
_RECOGNISED = re.compile(
    rf"\A(?=(?s:.*?)^[\"']?distortion_model[\"']?\s*:)(?=(?s:.*?)^[\"']?(?:camera_matrix|K|k)[\"']?\s*:)|{_OST.pattern}",
    re.MULTILINE,
)


def write(camera: Camera, lens: FileLens) -> str:
    """The text for a camera of the lens's model; rectified images keep its focal lengths and centre."""
    fx, fy, cx, cy = camera.params[:4].tolist()
    return info_text(camera, lens, "camera", IDENTITY, (fx, 0, cx, 0, 0, fy, cy, 0, 0, 0, 1, 0))


def info_text(
    camera: Camera, lens: FileLens, name: str, rectification: Sequence[float], projection: Sequence[float]
) -> str:
    """The text for a camera with that name, whose rectified pictures are made with these 9 and 12 numbers."""
    fx, fy, cx, cy, *rest = lens.values(camera)
    width, height = camera.image_size
    return (
        f"image_width: {width}\nimage_height: {height}\ncamera_name: {name}\n"
        f"camera_matrix:{_matrix(3, 3, [fx, 0, cx, 0, fy, cy, 0, 0, 1])}"
        f"distortion_model: {lens.name}\n"
        f"distortion_coefficients:{_matrix(1, len(rest), rest)}"
        f"rectification_matrix:{_matrix(3, 3, rectification)}"
        f"projection_matrix:{_matrix(3, 4, projection)}"
    )


def _matrix(rows: int, columns: int, values: Sequence[float]) -> str:
    return f"\n  rows: {rows}\n  cols: {columns}\n  data: [{', '.join(map(real, values))}]\n"


def read(text: str, origin: str, _: str | None = None) -> ReadCamera:
    """The camera in a text."""
    values = ost(text, origin) if _OST.search(text) else parse_tree(text, KEYS, mentions_lens, origin)
    size = opencv.size_of(values, origin)
    named = named_lens(values, origin)
    if named is not None and named.model not in (None, LINEAR, *(lens.model for lens in LENSES)):
        hint = f"calibrate with {' or '.join(one.name for one in LENSES)}"
        raise InputError(f"{origin}: {named.said}: not supported; {hint}")
    matrix = opencv.matrix_numbers(required(values, MATRIX, origin), MATRIX[0], origin, (9,))
    linear, skew = opencv.linear_part(matrix, origin)
    window = _window(values, size, origin)
    if window is not None:
        linear, skew, size = window.of(linear), skew / window.binning[0], window.size
    lens = opencv.data_of(required(values, COEFFICIENTS, origin), COEFFICIENTS[0], origin)
    counts = COUNTS.get(named.model or "", opencv.COUNTS) if named is not None else opencv.COUNTS
    found = opencv.camera_by_name(linear, skew, lens, COEFFICIENTS[0], counts, size, named, origin)
    return found if window is None else replace(found, remarks=(window.remark, *found.remarks))


@dataclass(frozen=True)
class _Window:
    """The part of the full sensor that photos show."""

    first: tuple[int, int]
    side: tuple[int, int]  # of the full sensor's pixels
    binning: tuple[int, int]

    @property
    def size(self) -> tuple[int, int]:
        """Of the photos."""
        return self.side[0] // self.binning[0], self.side[1] // self.binning[1]

    @property
    def remark(self) -> str:
        """What was done."""
        (x, y), (width, height), (across, down) = self.first, self.side, self.binning
        return (
            f"binning {across} x {down} and the region of {width} x {height} px at {x}, {y} are applied, as K is that "
            f"of the full sensor (REP 104): the photos have {self.size[0]} x {self.size[1]} px"
        )

    def of(self, linear: Sequence[float]) -> list[float]:
        """Values fx fy cx cy of the photos."""
        fx, fy, cx, cy = linear
        (x, y), (across, down) = self.first, self.binning
        return [fx / across, fy / down, (cx - x + 0.5) / across - 0.5, (cy - y + 0.5) / down - 0.5]


def _window(values: Mapping[str, object], full: tuple[int, int], origin: str) -> _Window | None:
    """Which part of the full sensor a message is about; None: all of it."""

    def whole(given: Mapping[str, object], name: str) -> int:
        value = number(given.get(name, 0), name, origin)
        if value != int(value) or not 0 <= value <= MAX_SIDE_PX:
            raise InputError(f"{origin}: {name} {value:g}: must be a whole number of pixels, 0 or more")
        return int(value)

    binning = max(1, whole(values, "binning_x")), max(1, whole(values, "binning_y"))
    roi = mapping(values.get("roi") or {}, "roi", origin)
    first, side = (whole(roi, "x_offset"), whole(roi, "y_offset")), (whole(roi, "width"), whole(roi, "height"))
    if side == (0, 0) and first == (0, 0):
        side = full
    if (first, side, binning) == ((0, 0), full, (1, 1)):
        return None
    if 0 in side or any(begin + long > most for begin, long, most in zip(first, side, full, strict=True)):
        raise InputError(
            f"{origin}: roi of {side[0]} x {side[1]} px at {first[0]}, {first[1]} is no part of the sensor's "
            f"{full[0]} x {full[1]} px; width and height are those of the full sensor"
        )
    if any(by > long for by, long in zip(binning, side, strict=True)):
        raise InputError(f"{origin}: binning {binning[0]} x {binning[1]} leaves no pixel of {side[0]} x {side[1]}")
    return _Window(first, side, binning)


def ost(text: str, origin: str) -> Mapping[str, object]:
    """The values of an `ost.txt`: names of a line, each before its lines of numbers.

    Raises:
        InputError: it holds several cameras.
    """
    values: dict[str, list[object]] = {}
    name = ""
    for line in text.splitlines():
        words = line.split()
        if not words or words[0].startswith("#"):
            continue
        if re.match(r"[-+.0-9]", words[0]):
            values.setdefault(name, []).extend(words)
        elif (name := "_".join(words).lower()) in values:
            raise InputError(f"{origin}: holds {name} a second time, so several cameras; leave one of them")
    for side in ("width", "height"):
        if len(values.get(side, ())) != 1:
            raise InputError(f"{origin}: {side} must be one number")
    return {
        "width": values["width"][0],
        "height": values["height"][0],
        **{new: values[old] for old, new in (("camera_matrix", "K"), ("distortion", "D")) if old in values},
    }


FORMAT = CameraFormat(
    name="ros",
    title="ROS camera_info",
    file_name="camera_info.yaml",
    opens_with="in the camera driver's parameters: camera_info_url: {url}",
    recognised=_RECOGNISED,
    lenses=LENSES,
    write=write,
    read=read,
)
