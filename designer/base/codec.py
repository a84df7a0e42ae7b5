"""Values as JSON, and back bit for bit, by the types of a dataclass' fields: `decode(Judged, encode(Judged, judged))`.

Numbers are finite and of their own type: `float` takes whole numbers, `int` no 1.0, and neither takes `true`.
`Annotated` says more, see `designer.base.marks`. What ties fields together stands in the class' `__post_init__`, which
raises ValueError. A class with methods `to_json` and `from_json` has a form of its own. Keys that nobody knows are
refused; so is what is missing and has no default.
"""

import base64
import binascii
import dataclasses
import math
import types
from collections.abc import Callable, Mapping, Sequence
from functools import cache, partial
from importlib import import_module
from typing import (
    Annotated,
    ForwardRef,
    Literal,
    Protocol,
    TypeVar,
    Union,
    cast,
    get_args,
    get_origin,
    get_type_hints,
    runtime_checkable,
)

from designer.base.errors import InputError
from designer.base.files import JsonValue
from designer.base.marks import (
    HEX,
    INLINE,
    LEFT_OUT,
    NOT_IN_FILE,
    ONE_LINE,
    OR_NULL,
    PACKED,
    Bound,
    From,
    Key,
    Mark,
    NullIs,
    Reads,
    Shape,
    Tagged,
    Told,
)
from designer.base.words import printable, shown, suggestion

T = TypeVar("T")
LARGEST_INT = 2**63


class BadValueError(ValueError):
    """A value of a file breaks a rule: its place and the rule; the file's kind adds the remedy."""


@runtime_checkable
class OwnForm(Protocol):
    """A class with a form of its own in files."""

    def to_json(self) -> JsonValue:
        """The form."""

    @classmethod
    def from_json(cls, value: JsonValue, place: str) -> "OwnForm":
        """What a form holds; InputError or BadValueError, which name the place, if it is none."""


def encode(kind: type[T], value: T) -> JsonValue:
    """A dataclass as JSON values; of a subclass, of which a file would not hold all, TypeError."""
    return _encode(kind, value)


def decode(kind: type[T], value: JsonValue, place: str = "") -> T:
    """A dataclass from JSON values.

    Args:
        kind: the class.
        value: what a file holds.
        place: where it stands in the file, for messages.

    Raises:
        BadValueError: a value breaks a rule; the message, one line, names its place.
        InputError: so says a class that has a form of its own.
    """
    return cast(T, _decode(kind, value, place, {}))


def encode_written(value: object) -> dict[str, JsonValue]:
    """A dataclass that is written and never read, as JSON values.

    Its module need not have loaded the types of its fields: where these are names alone, values say how.
    """
    return _encode_fields(type(value), value)


@cache
def _split(hint: object) -> tuple[object, tuple[object, ...]]:
    """A type and its marks; one that is named only is loaded from where a mark says."""
    if get_origin(hint) is not Annotated:
        return hint, ()
    base, *marks = get_args(hint)
    home = _find(marks, From)
    return base if home is None else getattr(import_module(home.module), base.__forward_arg__), tuple(marks)


@cache
def _own_form(kind: type) -> type[OwnForm] | None:
    return kind if issubclass(kind, OwnForm) else None


def _find(marks: Sequence[object], kind: type[T]) -> T | None:
    return next((mark for mark in marks if isinstance(mark, kind)), None)


def _encode(hint: object, value: object) -> JsonValue:
    base, marks = _split(hint)
    if value is None:
        return None
    if isinstance(base, str | ForwardRef):
        return encode_by_value(value)
    origin, inner = get_origin(base), get_args(base)
    if origin in (Union, types.UnionType):
        members = _members(inner)
        if len(members) == 1:
            return _encode(members[0], value)
        encoded = _encode(type(value), value)
        is_tagged = isinstance(value, Tagged)
        return {"is": type(value).__name__, **cast("dict[str, JsonValue]", encoded)} if is_tagged else encoded
    if base is bytes:
        return base64.b64encode(cast(bytes, value)).decode()
    if origin is Literal or base in (str, bool):
        return cast("str | bool", value)
    if base is int:
        return int(cast(int, value))
    if base is float:
        number = float(cast(float, value))
        return None if _find(marks, NullIs) is not None and not math.isfinite(number) else number
    if origin is tuple:
        items = tuple(cast("Sequence[object]", value))
        kinds = inner[:1] * len(items) if inner[1:] == (...,) else inner
        return [_encode(kind, item) for kind, item in zip(kinds, items, strict=True)]
    if origin is not None and isinstance(value, Mapping):
        return {key: _encode(inner[1], item) for key, item in value.items()}
    if isinstance(base, type) and dataclasses.is_dataclass(base):
        return _encode_fields(base, value) if _own_form(base) is None else cast(OwnForm, value).to_json()
    return _encode_packed(value) if PACKED in marks else _encode_array(value, has_gaps=OR_NULL in marks)


def _members(inner: tuple[object, ...]) -> list[object]:
    """Of a union, null aside; those of a union in it too, which stands there with its marks."""
    members: list[object] = []
    for one in inner:
        base = _split(one)[0]
        is_union = get_origin(base) in (Union, types.UnionType)
        members += _members(get_args(base)) if is_union else [one] * (one is not types.NoneType)
    return members


def encode_by_value(value: object) -> JsonValue:
    """As JSON, where the type is not loaded, or is none of files; a number that is not finite is not known."""
    if isinstance(value, float):
        return value if math.isfinite(value) else None
    if isinstance(value, tuple | list):
        return [encode_by_value(item) for item in value]
    if isinstance(value, Mapping):
        return {str(key): encode_by_value(item) for key, item in value.items()}
    if value is None or isinstance(value, str | bool | int):
        return value
    return _encode(type(value), value) if dataclasses.is_dataclass(value) else _encode_array(value, has_gaps=True)


def _encode_fields(kind: type, value: object) -> dict[str, JsonValue]:
    document, fields = dict[str, JsonValue](), _fields(kind)
    if type(value) is not kind:
        raise TypeError(f"a {type(value).__name__} where files hold a {kind.__name__}")
    for name, key, hint in fields:
        marks = _split(hint)[1]
        if NOT_IN_FILE in marks:
            continue
        encoded = _encode(hint, getattr(value, name))
        if LEFT_OUT in marks and encoded in (None, "", []):
            continue
        document |= cast("dict[str, JsonValue]", encoded) if INLINE in marks else {key: encoded}
    return document


def _encode_array(value: object, *, has_gaps: bool) -> JsonValue:
    import numpy as np

    array = np.asarray(value)
    if has_gaps:
        array = np.where(np.isfinite(array), array.astype(object), np.array(None))
    return cast("JsonValue", array.tolist())


def _encode_packed(value: object) -> JsonValue:
    import numpy as np

    from designer.base.packed import LARGE, pack_covariance

    matrix = np.asarray(value, dtype=np.float64)
    return pack_covariance(matrix) if len(matrix) > LARGE else _encode_array(matrix, has_gaps=True)


@cache
def _fields(kind: type) -> tuple[tuple[str, str, object], ...]:
    """Name, key and type of each field; of a class whose types are not all loaded, the names of these."""
    try:
        hints = get_type_hints(kind, include_extras=True)
    except NameError:
        hints = {one.name: one.type for one in dataclasses.fields(kind)}
    named = [(one.name, hints[one.name]) for one in dataclasses.fields(kind) if one.init]
    keys = (_find(_split(hint)[1], Key) for _, hint in named)
    return tuple((name, name if key is None else key.name, hint) for (name, hint), key in zip(named, keys, strict=True))


@cache
def _keys(kind: type) -> tuple[str, ...]:
    """All keys that an object may have."""
    found: list[str] = []
    for _, key, hint in _fields(kind):
        base, marks = _split(hint)
        found += _keys(cast(type, base)) if INLINE in marks else (key,)
    return tuple(found)


@cache
def _needed(kind: type) -> frozenset[str]:
    """Names of the fields without a default."""
    none = dataclasses.MISSING
    return frozenset(
        one.name for one in dataclasses.fields(kind) if one.default is none and one.default_factory is none
    )


def _refuse(place: str, value: JsonValue, rule: str) -> BadValueError:
    """One line on a value; of a long one only where it stands."""
    told = place if isinstance(value, list | dict) else f"{place} {shown(value)}:"
    return BadValueError(f"{told} {rule}".strip())


def _decode(hint: object, value: JsonValue, place: str, sizes: dict[str, int]) -> object:
    """A value of a type; `sizes`: of the named axes of the object it belongs to."""
    base, marks = _split(hint)
    null, reads = _find(marks, NullIs), _find(marks, Reads)
    origin, inner = get_origin(base), get_args(base)
    decoded: object
    if reads is not None:
        return _read(reads, value, place)
    if value is None and null is not None and base is float:
        return null.value
    if origin in (Union, types.UnionType):
        return _decode_union(inner, value, place, sizes)
    if origin is Literal:
        if not any(type(value) is type(one) and value == one for one in inner):
            raise _refuse(place, value, f"must be {' or '.join(map(repr, inner))}")
        decoded = value
    elif base in _SCALARS:
        decoded = _SCALARS[base](value, place)
    elif origin is tuple:
        decoded = _decode_tuple(inner, value, place, _find(marks, Shape), sizes)
    elif isinstance(base, type) and dataclasses.is_dataclass(base):
        own = _own_form(base)
        decoded = _decode_object(base, value, place) if own is None else own.from_json(value, place)
    elif origin is not None and issubclass(origin, Mapping):
        decoded = _decode_mapping(inner, value, place)
    else:
        decoded = _decode_array(base, marks, value, place, sizes)
    return _within(marks, decoded, value, place)


def _within(marks: tuple[object, ...], decoded: object, value: JsonValue, place: str) -> object:
    """A value as its marks will have it; BadValueError: it breaks the rule of one."""
    if ONE_LINE in marks:
        decoded = printable(cast(str, decoded))
    if HEX in marks:
        decoded = cast(str, decoded).lower()
    for mark in marks:
        if isinstance(mark, Mark) and (fault := mark.fault(decoded)):
            raise _refuse(place, value, fault)
    return decoded


def _read(reads: Reads, value: JsonValue, place: str) -> object:
    """What a person wrote."""
    try:
        return reads.read(value)
    except InputError:
        raise
    except ValueError as error:
        rule = str(error)
        raise BadValueError(f"{place} {shown(value)}: {rule[:1].lower()}{rule[1:]}") from None


def decode_written(hint: object, value: object, place: str) -> object:
    """A value of any type, as people write it in TOML or on a command line.

    Raises:
        BadValueError: it breaks a rule; the message names the place.
    """
    return _decode(hint, cast("JsonValue", value), place, {})


def _decode_union(inner: tuple[object, ...], value: JsonValue, place: str, sizes: dict[str, int]) -> object:
    """Null, or the member whose keys an object has."""
    members = _members(inner)
    if value is None and types.NoneType in inner:
        return None
    if len(members) == 1:
        return _decode(members[0], value, place, sizes)
    kinds = cast("list[type]", members)
    if all(isinstance(kind, type) and issubclass(kind, Tagged) for kind in kinds):
        body = dict(value) if isinstance(value, dict) else {}
        tag = body.pop("is", None)
        wanted = next((kind for kind in kinds if kind.__name__ == tag), None)
        if wanted is None:
            raise _refuse(place, value, f'must be one of {", ".join(kind.__name__ for kind in kinds)}, told by "is"')
        return _decode(wanted, body, place, sizes)
    given = set(value) if isinstance(value, dict) else set()
    for kind in kinds:
        needed = {key for name, key, _ in _fields(kind) if name in _needed(kind)}
        if needed <= given <= set(_keys(kind)):
            return _decode(kind, value, place, sizes)
    raise _refuse(place, value, f"must be one of {', '.join(kind.__name__ for kind in kinds)}")


def _decode_scalar(kind: type, words: str, value: JsonValue, place: str) -> object:
    if type(value) is not kind:
        raise _refuse(place, value, f"must be {words}")
    return value


def _decode_int(value: JsonValue, place: str) -> object:
    if type(value) is not int or abs(value) >= LARGEST_INT:
        raise _refuse(place, value, "must be a whole number")
    return value


def _decode_float(value: JsonValue, place: str) -> object:
    if type(value) is int and abs(value) < LARGEST_INT:
        return float(value)
    if type(value) is not float or not math.isfinite(value):
        raise _refuse(place, value, "must be a finite number")
    return value


def _decode_bytes(value: JsonValue, place: str) -> object:
    try:
        return base64.b64decode(cast(str, value), validate=True)
    except (TypeError, ValueError, binascii.Error):
        raise BadValueError(f"{place} must be base64") from None


_SCALARS: Mapping[object, Callable[[JsonValue, str], object]] = {
    bytes: _decode_bytes,
    str: partial(_decode_scalar, str, "text"),
    bool: partial(_decode_scalar, bool, "true or false"),
    int: _decode_int,
    float: _decode_float,
}


def _decode_tuple(
    inner: tuple[object, ...], value: JsonValue, place: str, shape: Shape | None, sizes: dict[str, int]
) -> object:
    if not isinstance(value, list | tuple):  # the latter from Python
        raise _refuse(place, value, "must be a list")
    kinds = inner[:1] * len(value) if inner[1:] == (...,) else inner
    if len(value) != len(kinds):
        raise BadValueError(f"{place} has {len(value)} items; it must be {len(kinds)}")
    if shape is not None:
        _bind(shape.sizes[0], len(value), place, sizes)
    return tuple(
        _decode(kind, item, _at(place, number), {})
        for number, (kind, item) in enumerate(zip(kinds, value, strict=True))
    )


def _decode_mapping(inner: tuple[object, ...], value: JsonValue, place: str) -> object:
    if not isinstance(value, dict):
        raise _refuse(place, value, "must be an object with keys")
    return {
        cast(str, _decode(inner[0], key, place, {})): _decode(inner[1], item, _at(place, printable(key)[:60]), {})
        for key, item in value.items()
    }


def _decode_object(kind: type, value: JsonValue, place: str) -> object:
    if not isinstance(value, dict):
        raise _refuse(place, value, "must be an object with keys")
    known = _keys(kind)
    for key in value:
        if key not in known:
            remedy = suggestion(key, list(known)) or f"; use {', '.join(known)}"
            raise BadValueError(f"unknown key {shown(_at(place, key))}{remedy}")
    sizes: dict[str, int] = {}
    arguments: dict[str, object] = {}
    for name, key, hint in _fields(kind):
        base, marks = _split(hint)
        if INLINE in marks:
            own = _keys(cast(type, base))
            arguments[name] = _decode_object(cast(type, base), {k: v for k, v in value.items() if k in own}, place)
        elif key in value:
            arguments[name] = _decode(hint, value[key], _at(place, key), sizes)
        elif name in _needed(kind):
            told = _find(_split(hint)[1], Told)
            raise BadValueError(f"{_at(place, key)} is missing{'' if told is None else f'; give the {told.words}'}")
    try:
        return kind(**arguments)
    except InputError:
        raise
    except ValueError as error:
        raise BadValueError(f"{place}: {error}" if place else str(error)) from None


def _at(place: str, inner: object) -> str:
    return f"{place}.{inner}" if place else str(inner)


def _bind(wanted: int | str | None, count: int, place: str, sizes: dict[str, int]) -> None:
    """Hold an axis to its size; a name is bound where it stands first."""
    size = sizes.setdefault(wanted, count) if isinstance(wanted, str) else wanted
    if size is not None and size != count:
        raise BadValueError(f"{place} has {count} items where it must have {size}")


def _decode_array(
    base: object, marks: tuple[object, ...], value: JsonValue, place: str, sizes: dict[str, int]
) -> object:
    """An array, from lists of its shape and of numbers of its type; null is nan where gaps are allowed."""
    import numpy as np

    dtype = get_args(get_args(base)[1])[0]
    shape, has_gaps = _find(marks, Shape), OR_NULL in marks
    if shape is None:
        raise TypeError(f"{place}: an array without a shape")
    if PACKED in marks and isinstance(value, dict):
        return _decode_packed(shape, value, place, sizes)
    flat, counts = _flattened(value, shape, place, sizes)
    words, allowed = _LEAVES[np.dtype(dtype).kind]
    is_fine = [
        (type(one) in allowed and (type(one) is bool or abs(cast(float, one)) < math.inf)) or (one is None and has_gaps)
        for one in flat
    ]
    if not all(is_fine):
        first = is_fine.index(False)
        raise _refuse(_leaf(place, counts, first), flat[first], f"must be {words}")
    try:
        numbers = np.array([math.nan if one is None else one for one in flat], dtype=dtype)
    except OverflowError:
        raise BadValueError(f"{place}: a number is too long") from None
    for mark in marks:
        if isinstance(mark, Bound) and mark.fault(numbers):
            first, fault = next((n, why) for n, one in enumerate(numbers.tolist()) if (why := mark.fault(one)))
            raise _refuse(_leaf(place, counts, first), flat[first], fault)
    for wanted, count in zip(shape.sizes, counts, strict=True):
        _bind(wanted, count, place, sizes)
    return numbers.reshape(counts)


def _decode_packed(shape: Shape, value: dict[str, JsonValue], place: str, sizes: dict[str, int]) -> object:
    """The covariance of a short form."""
    from designer.base.packed import unpack_covariance

    try:
        matrix = unpack_covariance(value)
    except ValueError as error:
        raise BadValueError(f"{place} {error}") from None
    for wanted, count in zip(shape.sizes, matrix.shape, strict=True):
        _bind(wanted, count, place, sizes)
    return matrix


_LEAVES: Mapping[str, tuple[str, tuple[type, ...]]] = {
    "b": ("true or false", (bool,)), "i": ("a whole number", (int,)), "f": ("a finite number", (int, float)),
}  # fmt: skip
"""What arrays of a kind of number may hold, in words and as types."""


def _flattened(
    value: JsonValue, shape: Shape, place: str, sizes: dict[str, int]
) -> tuple[list[JsonValue], tuple[int, ...]]:
    """The numbers of nested lists, and how many there are along each axis."""
    level: list[JsonValue] = [value]
    counts: list[int] = []
    for wanted in shape.sizes:
        lists = [one for one in level if isinstance(one, list)]
        lengths = {len(one) for one in lists}
        if len(lists) < len(level) or len(lengths) > 1 or (isinstance(wanted, int) and lengths - {wanted}):
            *outer, last = ("" if isinstance(one, str | None) else str(one) for one in shape.sizes)
            words = " rows of ".join([*(one or "some" for one in outer), last or "equally many"])
            raise _refuse(place, value, f"must be {words} numbers")
        declared = sizes.get(wanted, 0) if isinstance(wanted, str) else wanted or 0
        counts.append(lengths.pop() if lengths else declared)
        level = [item for one in lists for item in one]
    return level, tuple(counts)


def _leaf(place: str, counts: tuple[int, ...], number: int) -> str:
    """The place of one number of an array."""
    import numpy as np

    return ".".join([place, *map(str, np.unravel_index(number, counts))])
