"""What a parameter says of itself, once: `length_mm: Annotated[float, option("whose error is told", 1, 1e6)] = 100.0`.

The command line's option, its help, how its text is read and what is refused all come from this, and Python is refused
the same. A name's ending is its unit: `length_mm` is `--length 100mm` in a shell, and a number in Python.

A parameter whose type is a dataclass of such fields is an option for each: `options: RenderOptions | None = None`.
"""

import builtins
import inspect
import math
import re
from collections.abc import Callable, Collection, Iterable, Mapping
from dataclasses import dataclass, is_dataclass, replace
from functools import cache, partial, wraps
from numbers import Integral, Real
from os import PathLike
from pathlib import Path
from types import NoneType, UnionType
from typing import Annotated, Literal, ParamSpec, TypeVar, Union, cast, get_args, get_origin, get_type_hints

from designer.base.errors import InputError
from designer.base.units import MM_PER_UNIT, RAD_PER_UNIT, parse_percent, parse_quantity
from designer.base.words import shown, suggestion

P = ParamSpec("P")
R = TypeVar("R")
Text = Callable[[str], object]
FARTHEST_MM = 1e7


@dataclass(frozen=True, repr=False)
class CommandOption:
    """What is said of a parameter beyond its name, type and default."""

    help: str
    least: float = -math.inf
    most: float = math.inf
    metavar: str = ""
    flag: str = ""  # of a shell, where it is not the name: "--reject"
    unit: str = ""  # of its number, where the name's ending does not tell: "share"
    short: str = ""  # a letter's flag: "-v"
    parse: Text | None = None  # of a shell's text, where the name's ending does not tell; ValueError: no such thing
    names: Callable[[], tuple[str, ...]] | None = None  # the words that it takes
    complete: Callable[..., object] | None = None  # words that a shell offers, of many more that it takes
    group: str = "Options"
    off: str = ""  # of a switch that is on: the flag that turns it off, as in "--keep-all"
    is_argument: bool = False
    is_needed: bool = False  # a shell has to give it, though Python need not
    is_many: bool = False

    def __repr__(self) -> str:
        """As it is written: what `help(function)` and references show."""
        limits = "".join(f", {one:g}" for one in (self.least, self.most) if math.isfinite(one))
        return f"{'argument' if self.is_argument else 'option'}({self.help!r}{limits})"


option = CommandOption
"""`Annotated[float | None, option("of a coordinate in the image", 0, 100)] = None`."""
argument = partial(CommandOption, is_argument=True)
"""`Annotated["Rig | Place", argument("the rig's file")]`."""


@dataclass(frozen=True)
class Unit:
    """How a number with a unit is read."""

    name: str
    parse: Callable[[str], float]
    scale: float = 1.0  # of Python's number over that which limits and help show


def _with_unit(text: str, units: Mapping[str, float], expected: str) -> float:
    return parse_quantity(text, units, expected, math.inf)


UNITS: Mapping[str, Unit] = {
    "mm": Unit("mm", partial(_with_unit, units=MM_PER_UNIT, expected="a length such as 20mm, 2.5m or 0.8in")),
    "px": Unit("px", partial(_with_unit, units={"": 1.0, "px": 1.0}, expected="pixels such as 0.7px")),
    "deg": Unit("deg", partial(_with_unit, units={"": 1.0, "deg": 1.0, "°": 1.0}, expected="an angle such as 60deg")),
    "rad": Unit(
        "deg", partial(_with_unit, units=RAD_PER_UNIT, expected="an angle such as 60deg or 2mrad"), math.pi / 180
    ),
    "s": Unit("s", partial(_with_unit, units={"": 1.0, "s": 1.0, "ms": 1e-3}, expected="a time such as 2s or 5ms")),
    "sigma": Unit(
        "sigma", partial(_with_unit, units={"": 1.0, "sigma": 1.0}, expected="standard deviations such as 4")
    ),
    "share": Unit("%", lambda text: parse_percent(text) / 100, 0.01),
    "percent": Unit("%", parse_percent),
}
"""By the ending of a parameter's name. A share of one is written in percent."""
PLAIN = Unit("", partial(_with_unit, units={"": 1.0}, expected="a number"))


@dataclass(frozen=True)
class Parameter:
    """One of a function's, as it is given in a shell and in Python."""

    name: str
    option: CommandOption
    kind: object  # the type, None aside; a text where it is not loaded
    default: object  # `inspect.Parameter.empty`: it has to be given
    others: tuple[object, ...] = ()  # types that Python may give as well
    within: tuple[str, type] | None = None  # the function's parameter, and its type, of which it is a field

    @property
    def unit(self) -> Unit:
        """Of its number."""
        return UNITS.get(self.option.unit or self.name.rpartition("_")[2], PLAIN)

    @property
    def known(self) -> tuple[object, ...]:
        """All that it can be; (): that is not told."""
        if get_origin(self.kind) is Literal:
            return get_args(self.kind)
        return () if self.option.names is None else self.option.names()

    @property
    def flag(self) -> str:
        """Its name in a shell, without the unit."""
        if self.option.flag:
            return self.option.flag
        stem, _, ending = self.name.rpartition("_")
        return f"--{(stem if ending in UNITS and stem else self.name).replace('_', '-')}"

    @property
    def label(self) -> str:
        """How messages call it."""
        return self.flag[2:].upper() if self.option.is_argument else self.flag

    def text_of(self, value: object) -> str:
        """A value as it is typed."""
        if isinstance(value, tuple) and self._is_number:
            return "..".join(self.text_of(one) for one in value)
        if isinstance(value, bool) or not isinstance(value, int | float) or self.kind is int:
            return str(value)
        return f"{value / self.unit.scale:g}{self.unit.name}"

    @property
    def _is_number(self) -> bool:
        return self.kind in (int, float) or (get_origin(self.kind) is tuple and get_args(self.kind)[0] is float)

    def read(self, text: str) -> object:
        """What a text means that was given for it.

        Raises:
            InputError: nothing, or what is beyond a limit.
        """
        try:
            value = self._meant(text)
        except ValueError as error:
            raise InputError(f"{self.label} {shown(text)}: {error}") from None
        self.check(value, text.strip() if self._is_number else shown(text))
        return value

    def _meant(self, text: str) -> object:
        if self.option.parse is not None:
            return self.option.parse(text)
        if get_origin(self.kind) is Literal:
            return next((one for one in self.known if str(one) == text), text)
        if self.kind is int:
            return whole_number(text)
        if self.kind is float:
            return self.unit.parse(text)
        if get_origin(self.kind) is tuple and get_args(self.kind)[0] is float:
            return read_range(text, self.unit.parse, self.unit.name)
        return text

    def check(self, value: object, told: str = "") -> None:
        """Refuse a value that is beyond the limits, or none of the words, whoever gives it.

        Args:
            value: that was given.
            told: as it was written; "": as Python shows it.
        """
        if value is None:
            return
        if (self.option.names is not None and isinstance(value, str)) or get_origin(self.kind) is Literal:
            if value not in self.known:
                words = [one for one in self.known if isinstance(one, str)]
                hint = suggestion(str(value), words) or f"; use {', '.join(map(str, self.known))}"
                raise InputError(f"{self.label} {shown(value)} is unknown{hint}")
        elif self._is_number and not (isinstance(value, str) and self._takes_word(value)):
            several = value if isinstance(value, tuple | list) else (value,)
            wanted = () if float in self.others and several == (value,) else get_args(self.kind)
            if wanted and ... not in wanted and len(several) != len(wanted):
                raise InputError(f"{self.label} {told or shown(value)}: must be {len(wanted)} numbers")
            for one in several:
                self._check_number(one, told or shown(value))
            if len(wanted) == 2 and several[0] > several[1]:
                raise InputError(f"{self.label} {told or shown(value)}: the smaller comes first")

    def _takes_word(self, value: str) -> bool:
        """Whether a text may stand for the number: any, or one of those that the annotation names."""
        return any(one in (str, Path) or value in get_args(one) for one in self.others)

    def _check_number(self, value: object, told: str) -> None:
        kind, what = (Integral, "a whole number") if self.kind is int else (Real, "a number")
        if isinstance(value, bool) or not isinstance(value, kind):
            raise InputError(f"{self.label} {told}: must be {what}{self._limits(' from')}")
        if not self.option.least <= float(cast("float", value)) <= self.option.most:
            raise InputError(f"{self.label} {told}: must be{self._limits(' from') or ' a number'}")

    def _limits(self, word: str) -> str:
        least, most = (self.text_of(one) for one in (self.option.least, self.option.most))
        if math.isinf(self.option.most):
            return "" if math.isinf(self.option.least) else f" {least} or more"
        return f" {most} or less" if math.isinf(self.option.least) else f"{word} {least} to {most}"


def whole_number(text: str) -> int:
    """A whole number; ValueError: it is none."""
    if not re.fullmatch(r"\s*[-+]?[0-9]{1,18}\s*", text):
        raise ValueError("must be a whole number")
    return int(text)


def read_range(text: str, parse: Callable[[str], float], unit: str) -> tuple[float, float]:
    """`400mm`, or `250mm..800mm` in order; the last unit is that of a first number that has none.

    Raises:
        ValueError: no such range.
    """
    parts = text.split("..")
    if len(parts) > 2:
        raise ValueError(f"give one, or two such as 250{unit}..800{unit}")
    ending = re.search(r"[^\s\d.+-]+\s*\Z", parts[-1])
    is_bare = len(parts) == 2 and re.fullmatch(r"[-+\s\d.eE]+", parts[0])
    first = f"{parts[0]}{ending[0]}" if ending and is_bare else parts[0]
    low, high = parse(first), parse(parts[-1])
    if low > high:
        raise ValueError("the smaller comes first")
    return low, high


def parameters_of(function: Callable[..., object]) -> dict[str, Parameter]:
    """Those of a function that say what they are, by their names; for one that is made of options, its fields."""
    found = {}
    for name, one in inspect.signature(function).parameters.items():
        kind = _kinds(one.annotation)[0]
        if get_origin(one.annotation) is Annotated:
            kind, *marks = get_args(one.annotation)
            said = next((mark for mark in marks if isinstance(mark, CommandOption)), None)
            if said is not None:
                first, *others = _kinds(kind)
                found[name] = Parameter(name, said, first, one.default, tuple(others))
        elif isinstance(kind, type) and is_dataclass(kind):
            found |= {field: replace(each, within=(name, kind)) for field, each in parameters_of(kind).items()}
    return found


def packed(parameters: Mapping[str, Parameter], values: Mapping[str, object]) -> dict[str, object]:
    """Values by the names of a function's own parameters: those of fields together, as what they are fields of."""
    own, fields = dict[str, object](), dict[tuple[str, type], dict[str, object]]()
    for name, value in values.items():
        within = parameters[name].within if name in parameters else None
        (own if within is None else fields.setdefault(within, {}))[name] = value
    return own | {name: kind(**given) for (name, kind), given in fields.items()}


def _kinds(kind: object) -> tuple[object, ...]:
    """The types of a union, None aside; a path for what is not loaded."""
    if get_origin(kind) in (Union, UnionType):
        return tuple(one for one in get_args(kind) if one is not NoneType)
    return (kind if isinstance(kind, type) or get_origin(kind) is not None else Path,)


class _Names(dict[str, object]):
    """What annotations are made of: a class that is not loaded is known by its name alone."""

    def __missing__(self, name: str) -> object:
        if hasattr(builtins, name):
            raise KeyError(name)
        return type(name, (), {})


KNOWN = _Names(
    Callable=Callable, Heard=Callable, Iterable=Iterable, Collection=Collection, Sequence=Collection, Mapping=Mapping,
    Place=str | PathLike, Array=type("ndarray", (), {}), Pixels=type("ndarray", (), {}),
)  # fmt: skip
"""Of the names that are loaded for type checkers only, those that are no class's."""


@cache
def _types_of(function: Callable[..., object]) -> dict[str, object]:
    """What Python may give for each parameter of a function."""
    return get_type_hints(function, localns=KNOWN)


def _fits(value: object, kind: object) -> bool:
    """Whether a value is of a type, and so are the values in it."""
    origin, args = get_origin(kind) or kind, get_args(kind)
    if origin in (Union, UnionType):
        return any(_fits(value, one) for one in args)
    if origin is Literal:
        return any(type(value) is type(one) and value == one for one in args)
    if origin in (int, float):
        return isinstance(value, Integral if origin is int else Real) and not isinstance(value, bool)
    if isinstance(value, str | bytes | bytearray):  # which are collections, too
        return isinstance(value, str) and (origin in (str, Path) or str in args)
    if origin is tuple:
        several = tuple(value) if isinstance(value, Collection) else ()
        return len(several) == len(args) and all(map(_fits, several, args))
    if not isinstance(origin, type):
        return True
    if args and issubclass(origin, Iterable) and isinstance(value, origin if origin is Mapping else Iterable):
        inner = value.values() if isinstance(value, Mapping) else value if isinstance(value, Collection) else ()
        return all(_fits(one, args[-1]) for one in inner)
    return isinstance(value, PathLike if origin is Path else origin) or origin.__name__ in {
        one.__name__ for one in type(value).__mro__
    }


WORDS = {
    "int": "a whole number", "float": "a number", "str": "a text", "bool": "True or False", "Path": "a path",
    "PathLike": "a path", "Callable": "a function",
}  # fmt: skip


def _told(kind: object) -> str:
    """A type as a message says it."""
    origin, args = get_origin(kind) or kind, get_args(kind)
    if origin in (Union, UnionType):
        paths = [one for one in args if get_origin(one) is PathLike or one is PathLike]
        words = [_told(one) for one in args if one is not NoneType and not (paths and one is str)]
        return " or ".join(dict.fromkeys(words))
    if origin is Literal:
        return " or ".join(map(repr, args))
    if origin is tuple:
        return f"({', '.join(map(_told, args))})"
    if isinstance(origin, type) and issubclass(origin, Iterable) and args:
        return f"{'a mapping' if origin is Mapping else 'several'}, each {_told(args[-1])}"
    if isinstance(origin, type):
        return WORDS.get(origin.__name__, origin.__name__)
    return str(origin)


def _check_types(function: Callable[..., object], given: Mapping[str, object]) -> None:
    """Refuse a value of a type that its parameter does not take."""
    for name, kind in _types_of(function).items():
        if name in given and not _fits(given[name], kind):
            raise InputError(f"{name} {shown(given[name])}: must be {_told(kind)}")


def checked(function: Callable[P, R]) -> Callable[P, R]:
    """Decorate a function so that Python, too, is refused what is beyond the limits that its parameters state."""
    parameters, signature = parameters_of(function), inspect.signature(function)

    @wraps(function)
    def within_limits(*values: P.args, **options: P.kwargs) -> R:
        given = signature.bind(*values, **options).arguments
        for name, parameter in parameters.items():
            group, kind = parameter.within or ("", object)
            if not group:
                parameter.check(given.get(name))
            elif isinstance(given.get(group), kind):
                parameter.check(getattr(given[group], name))
        _check_types(function, given)
        return function(*values, **options)

    return within_limits
