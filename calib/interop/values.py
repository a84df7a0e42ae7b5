"""Numbers and cameras from the trees that parsers give, held to the rules of a camera."""

import math
import re
from collections.abc import Iterable, Mapping, Sequence
from typing import TypeVar

from calib.cameras import parameter_names
from calib.cameras.camera import CAMERA, Camera, camera_from_mapping
from designer.base.errors import InputError
from designer.base.words import shown

Item = TypeVar("Item")

_NUMBER = re.compile(r"[-+]?(?:[0-9]{1,40}\.?[0-9]{0,40}|\.[0-9]{1,40})(?:[eE][-+]?[0-9]{1,4})?")


def number(value: object, name: str, origin: str) -> float:
    """A finite number, given as such or as text.

    Raises:
        InputError: it is none.
    """
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
    """A list of finite numbers, as many as one of `counts` says.

    Raises:
        InputError: it is none.
    """
    if not isinstance(value, list | tuple):
        raise InputError(f"{origin}: {name} must be a list of numbers")
    if len(value) not in counts:
        wanted = " or ".join(map(str, counts))
        raise InputError(f"{origin}: {name} has {len(value)} numbers; it must have {wanted}")
    return [number(one, f"{name}[{index}]", origin) for index, one in enumerate(value)]


def mapping(value: object, name: str, origin: str) -> Mapping[str, object]:
    """A mapping whose keys are text.

    Raises:
        InputError: it is none.
    """
    if not isinstance(value, dict) or not all(isinstance(key, str) for key in value):
        raise InputError(f"{origin}: {name} must hold names with values")
    return value


def required(values: Mapping[str, object], names: Iterable[str], origin: str, hint: str = "") -> object:
    """The value under the first of several names for one thing.

    Raises:
        InputError: there is none.
    """
    names = tuple(names)
    for name in names:
        if name in values:
            return values[name]
    raise InputError(f"{origin}: {names[0]} is missing{hint}")


def image_size(given: object, origin: str) -> tuple[int, int]:
    """Width and height in whole pixels.

    Raises:
        InputError: they are no whole numbers.
    """
    sides = numbers(given, "image size", origin, (2,))
    for side, name in zip(sides, ("width", "height"), strict=True):
        if side != int(side) or side < 1:
            raise InputError(f"{origin}: image {name} {side:g}: must be a whole number of pixels, 1 or more")
    return int(sides[0]), int(sides[1])


def make_camera(model: str, params: Sequence[float], size: tuple[int, int], origin: str) -> Camera:
    """A camera, held to the same rules as one from `camera.json`.

    Raises:
        InputError: a value breaks a rule.
    """
    values = dict(zip(parameter_names(model), params, strict=True))
    document = {
        "format": CAMERA.format,
        "version": CAMERA.version,
        "model": model,
        "image_size": list(size),
        "parameters": values,
    }
    return camera_from_mapping(document, origin)


def pick(cameras: Mapping[str, Item], wanted: str | None, origin: str) -> Item:
    """The one camera of a file, or the one of several that is asked for by name.

    Raises:
        InputError: there is none, several and none is named, or none of that name.
    """
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
