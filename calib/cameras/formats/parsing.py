"""Files of other tools, read without trust: numbers, YAML and XML, and the cameras and poses that they say.

All scalars stay text, tags and merge keys mean nothing, and an alias is a reference, not a copy; so a small file
cannot make large or foreign objects. Poses are matrices, rotation vectors or quaternions in a unit, held to be rigid.
"""

import math
import re
from collections.abc import Callable, Collection, Iterable, Mapping, Sequence
from pathlib import Path
from typing import TypeVar
from xml.etree.ElementTree import Element, TreeBuilder
from xml.parsers import expat

import numpy as np
import yaml

from calib.cameras import parameter_names
from calib.cameras.camera import CAMERA, Camera, camera_from_mapping
from calib.core.se3 import MAX_DISTANCE_MM, exp_rotation, make_pose, rotation_of_quaternion
from designer.base.arrays import Array
from designer.base.errors import InputError
from designer.base.files import parse_json
from designer.base.words import shown, suggestion_or_all

Item = TypeVar("Item")

MAX_FILE_BYTES = 2**17
"""A camera file of a few numbers is never larger."""

_NUMBER = re.compile(r"[-+]?(?:[0-9]{1,40}\.?[0-9]{0,40}|\.[0-9]{1,40})(?:[eE][-+]?[0-9]{1,4})?")
_DIRECTIVE = re.compile(r"\A\s*%YAML[^\n]*\n")
"""OpenCV's first line, `%YAML:1.0`, is not YAML."""
_WINDOWS_PATH = re.compile(r'"[A-Za-z]:\\[^"\n]*"')
"""Between such quotes YAML takes what follows a backslash for an escape; no path tells anything of a camera."""
MOST_NODES, DEEPEST = 10_000, 30
"""Values of a document, and how deep they may be nested: parsing takes time in proportion to their product."""
MAX_DEPTH = 40


def number(value: object, name: str, origin: str) -> float:
    """A finite number, given as such or as text."""
    if isinstance(value, str) and _NUMBER.fullmatch(value.strip()):
        value = float(value)
    if isinstance(value, bool) or not isinstance(value, int | float):
        raise InputError(f"{origin}: {name} {shown_plain(value)}: must be a number")
    try:
        result = float(value)
    except OverflowError:
        result = math.inf
    if not math.isfinite(result):
        raise InputError(f"{origin}: {name} must be a finite number")
    return result


def numbers(value: object, name: str, origin: str, counts: Sequence[int]) -> list[float]:
    """A list of finite numbers, as many as one of `counts` says."""
    if not isinstance(value, list | tuple):
        raise InputError(f"{origin}: {name} must be a list of numbers")
    if len(value) not in counts:
        wanted = " or ".join(map(str, counts))
        raise InputError(f"{origin}: {name} has {len(value)} numbers; it must have {wanted}")
    return [number(one, f"{name}[{index}]", origin) for index, one in enumerate(value)]


def mapping(value: object, name: str, origin: str) -> Mapping[str, object]:
    """A mapping whose keys are text."""
    if not isinstance(value, dict) or not all(isinstance(key, str) for key in value):
        raise InputError(f"{origin}: {name} must hold names with values")
    return value


def required(values: Mapping[str, object], names: Iterable[str], origin: str, hint: str = "") -> object:
    """The value under the first of several names for one thing."""
    names = tuple(names)
    for name in names:
        if name in values:
            return values[name]
    raise InputError(f"{origin}: {names[0]} is missing{hint}")


def image_size(given: object, origin: str) -> tuple[int, int]:
    """Width and height in whole pixels."""
    sides = numbers(given, "image size", origin, (2,))
    for side, name in zip(sides, ("width", "height"), strict=True):
        if side != int(side) or side < 1:
            raise InputError(f"{origin}: image {name} {side:g}: must be a whole number of pixels, 1 or more")
    return int(sides[0]), int(sides[1])


def make_camera(model: str, params: Sequence[float], size: tuple[int, int], origin: str) -> Camera:
    """A camera, held to the same rules as one from `camera.json`."""
    values = dict(zip(parameter_names(model), params, strict=True))
    document = {
        "format": CAMERA.format,
        "version": CAMERA.version,
        "model": model,
        "image_size": list(size),
        "parameters": values,
    }
    return camera_from_mapping(document, origin)


def json_object(text: str, origin: str) -> Mapping[str, object]:
    """What a JSON text holds, which must be names with values."""
    return mapping(parse_json(text, Path(origin), "a camera file"), "the file", origin)


def pick(cameras: Mapping[str, Item], wanted: str | None, origin: str) -> Item:
    """The one camera of a file, or the one of several that is asked for by name."""
    if not cameras:
        raise InputError(f"{origin}: holds no camera")
    names = ", ".join(list(cameras)[:8]) + (", ..." if len(cameras) > 8 else "")
    if wanted is not None:
        if wanted not in cameras:
            raise InputError(f"{origin}: holds no camera {shown(wanted)}; there is {names}")
        return cameras[wanted]
    if len(cameras) > 1:
        raise InputError(
            f"{origin}: holds {len(cameras)} cameras ({names}); name one, as in FILE#{next(iter(cameras))}"
        )
    return next(iter(cameras.values()))


def real(value: float) -> str:
    """A number that reads back bit for bit, and that YAML 1.1 takes for a number: `1e-05` would be text there."""
    text = repr(float(value))
    mantissa, exponent, power = text.partition("e")
    return text if not exponent or "." in mantissa else f"{mantissa}.0e{power}"


def shown_plain(value: object) -> str:
    """A plain value as a message shows it; of a tree only its kind: YAML's aliases make huge ones."""
    return shown(value) if isinstance(value, str | int | float | None) else f"({type(value).__name__})"


class _BoundedLoader(yaml.BaseLoader):
    """A loader that stops where a document becomes larger or deeper than any camera is."""

    def __init__(self, text: str) -> None:
        super().__init__(text)
        self.nodes = self.depth = 0

    def compose_node(self, parent: yaml.Node | None, index: int) -> yaml.Node | None:
        """A value and all in it."""
        self.nodes, self.depth = self.nodes + 1, self.depth + 1
        if self.depth > DEEPEST:
            raise RecursionError
        if self.nodes > MOST_NODES:
            raise yaml.YAMLError(f"more than {MOST_NODES} values, where a camera file has fewer")
        node = super().compose_node(parent, index)
        self.depth -= 1
        return node


def only_keys(text: str, names: Collection[str], is_needed: Callable[[str], bool]) -> str:
    """A YAML text with nothing at its top but the entries of those names, and those with a line that is needed.

    Lines keep their numbers. OpenCV's files may hold all image points of a calibration, which are long to parse.
    """
    entries: list[list[str]] = [[]]
    for line in text.splitlines():
        if line[:1].strip(" \t-#]}"):  # neither within an entry nor a comment
            entries.append([])
        entries[-1].append(line)
    kept: list[str] = []
    for lines in entries:
        is_wanted = lines[:1] and lines[0].partition(":")[0].strip(" \t\"'") in names
        kept += lines if is_wanted or any(map(is_needed, lines)) else [""] * len(lines)
    return "\n".join(kept)


def parse_tree(
    text: str, names: Collection[str], is_needed: Callable[[str], bool], origin: str
) -> Mapping[str, object]:
    """The entries of those names in a JSON or YAML text, and those with a line that is needed; of JSON all."""
    if text.lstrip()[:1] == "{":
        tree: object = parse_json(text, Path(origin), "a camera file")
    else:
        tree = parse_yaml(only_keys(text, names, is_needed), origin)
    return mapping({} if tree is None else tree, "the file", origin)


def outline(text: str) -> str:
    """The names at the top of a JSON text, a line each, as they would be in YAML; of other texts nothing."""
    if text.lstrip()[:1] != "{":
        return ""
    try:
        tree = parse_json(text, Path(), "a file")
    except InputError:
        return ""
    return "".join(f"{key}:\n" for key in tree) if isinstance(tree, dict) else ""


def parse_yaml(text: str, origin: str) -> object:
    """The first document in a YAML text: a tree of dict, list and str."""
    if len(text) - text.count("\n") > MAX_FILE_BYTES:
        raise InputError(f"{origin}: more than {MAX_FILE_BYTES} characters; a YAML camera file is smaller")
    try:
        # The first only: printed messages end with a mark that begins another.
        plain = _WINDOWS_PATH.sub(lambda path: path[0].replace("\\", "/"), _DIRECTIVE.sub("", text))
        document: object = next(iter(yaml.load_all(plain, _BoundedLoader)), None)
        return document
    except yaml.MarkedYAMLError as error:
        mark = error.problem_mark or error.context_mark
        place = "" if mark is None else f"line {mark.line + 1}, column {mark.column + 1}: "
        raise InputError(f"{origin}: {place}{error.problem or 'not valid YAML'}; not valid YAML") from None
    except yaml.YAMLError as error:
        raise InputError(f"{origin}: {' '.join(str(error).split())[:120]}; not valid YAML") from None
    except RecursionError:
        raise InputError(f"{origin}: nested too deep for a camera file") from None
    except (ValueError, OverflowError):  # an escape such as "\UFFFFFFFF" that is no character
        raise InputError(f"{origin}: not valid YAML") from None


def parse_xml(text: str, origin: str) -> Element:
    """The root of an XML text."""
    builder, depth = TreeBuilder(), 0

    def start(name: str, attributes: dict[str, str]) -> None:
        nonlocal depth
        depth += 1
        if depth > MAX_DEPTH:
            raise InputError(f"{origin}: nested too deep for a camera file")
        builder.start(name, attributes)

    def end(name: str) -> None:
        nonlocal depth
        depth -= 1
        builder.end(name)

    def refuse(*_: object) -> None:
        raise InputError(f"{origin}: XML with a document type is refused, as no camera file has one; delete <!DOCTYPE>")

    parser = expat.ParserCreate()
    parser.StartElementHandler, parser.EndElementHandler = start, end
    parser.CharacterDataHandler = builder.data
    parser.StartDoctypeDeclHandler = refuse
    try:
        parser.Parse(text, True)
        return builder.close()
    except expat.ExpatError as error:
        what = expat.errors.messages.get(error.code, "not well formed")
        raise InputError(f"{origin}: line {error.lineno}: {what}; not valid XML") from None
    except UnicodeEncodeError:
        raise InputError(f"{origin}: not text; not valid XML") from None


UNIT_MM = {"m": 1000.0, "cm": 10.0, "mm": 1.0}
"""Units of length that files may have."""
UNIT_WORDS = {"m": "metres", "cm": "centimetres", "mm": "millimetres"}
MOST_RAD = 100.0
"""Longer rotation vectors are degrees, or no rotations."""
FAR_FROM_RIGID = 1e-3
"""Rotations typed with a few digits are made whole; what is farther off than this is none."""


def unit_mm(unit: str) -> float:
    """The unit in millimetres.

    Raises:
        InputError: it is none.
    """
    if unit not in UNIT_MM:
        hint = suggestion_or_all(unit, UNIT_MM)
        raise InputError(f"unit {shown(unit)}{hint}")
    return UNIT_MM[unit]


def unit_said(value: object, origin: str) -> str | None:
    """The unit that a file says; None: it says none.

    Raises:
        InputError: it is none.
    """
    if value is None:
        return None
    if not isinstance(value, str) or value not in UNIT_MM:
        raise InputError(f"{origin}: length_unit {shown_plain(value)}: must be one of {', '.join(UNIT_MM)}")
    return value


def in_unit(pose: Array, unit: str) -> Array:
    """Poses (..., 4, 4) in mm with their shifts in a unit."""
    result = pose.copy()
    result[..., :3, 3] /= unit_mm(unit)
    return result


def pose_of(rotation: Array, shift: Sequence[float], unit: str, origin: str) -> Array:
    """A pose in mm (4, 4) from a nearly whole rotation (3, 3) and a shift (3,) in a unit."""
    return make_pose(nearest_rotation(rotation, origin), shift_mm(shift, unit, origin))


def shift_mm(shift: Sequence[float], unit: str, origin: str) -> Array:
    """A shift in a unit in mm (3,), where one can be.

    Raises:
        InputError: it is absurdly long.
    """
    far = MAX_DISTANCE_MM / unit_mm(unit)
    if max(map(abs, shift)) > far:
        raise InputError(f"{origin}: is {max(map(abs, shift)):g} {unit} away: must be at most {far:g} {unit}")
    return np.array(shift) * unit_mm(unit)


def matrix_pose(value: object, name: str, unit: str, origin: str) -> Array:
    """A pose in mm (4, 4) from a file's four rows, or the first three of them."""
    if not isinstance(value, list) or len(value) not in (3, 4):
        raise InputError(f"{origin}: {name} must be a 4 x 4 matrix, row by row")
    rows = np.array([numbers(row, f"{name}[{index}]", origin, (4,)) for index, row in enumerate(value)])
    if len(rows) == 4 and rows[3].tolist() != [0, 0, 0, 1]:
        raise InputError(f"{origin}: {name} must end with the row 0 0 0 1")
    return pose_of(rows[:3, :3], rows[:3, 3].tolist(), unit, f"{origin}: {name}")


def vector_pose(rotation: Sequence[float], shift: Sequence[float], unit: str, origin: str) -> Array:
    """A pose in mm (4, 4) from a rotation vector (rad) and a shift in a unit."""
    if max(map(abs, rotation)) > MOST_RAD:
        raise InputError(f"{origin}: a rotation vector of {max(map(abs, rotation)):g}: must be radians")
    return make_pose(exp_rotation(np.array(rotation)), shift_mm(shift, unit, origin))


def quaternion_pose(wxyz: Sequence[float], shift: Sequence[float], unit: str, origin: str) -> Array:
    """A pose in mm (4, 4) from a quaternion, scalar first, and a shift in a unit."""
    quaternion = np.array(wxyz)
    length = float(np.linalg.norm(np.clip(quaternion, -2, 2)))
    if not abs(length - 1) < FAR_FROM_RIGID:
        raise InputError(f"{origin}: a quaternion of length {length:.6g}: must be 1; scalar first: w x y z")
    return make_pose(rotation_of_quaternion(quaternion), shift_mm(shift, unit, origin))


def nearest_rotation(matrix: Array, origin: str) -> Array:
    """The rotation (3, 3) nearest to a matrix that is one to some digits.

    Raises:
        InputError: it is none.
    """
    if not np.abs(matrix).max() < 2:
        raise InputError(f"{origin}: has no rotation in it; check its rows")
    left, _, right = np.linalg.svd(matrix)
    rotation: Array = left @ right
    if np.linalg.det(rotation) < 0:
        raise InputError(f"{origin}: mirrors; its determinant is -1, that of a rotation is 1")
    if np.abs(rotation - matrix).max() > FAR_FROM_RIGID:
        raise InputError(f"{origin}: has no rotation in it; check its rows")
    return rotation


def roll_pitch_yaw_rad(rotation: Array) -> tuple[float, float, float]:
    """URDF's angles about the fixed axes x, y, z of a rotation (3, 3) = Rz(yaw) Ry(pitch) Rx(roll)."""
    pitch = float(np.arctan2(-rotation[2, 0], np.hypot(rotation[0, 0], rotation[1, 0])))
    if np.hypot(rotation[0, 0], rotation[1, 0]) < 1e-9:  # roll and yaw turn about one axis: all of it is yaw's
        return 0.0, pitch, float(np.arctan2(-rotation[0, 1], rotation[1, 1]))
    return float(np.arctan2(rotation[2, 1], rotation[2, 2])), pitch, float(np.arctan2(rotation[1, 0], rotation[0, 0]))
