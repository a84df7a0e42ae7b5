"""The kinds of targets: a file of `designer/kinds/` and a line here for each."""

import math
from collections.abc import Mapping
from dataclasses import dataclass, fields
from functools import cache
from importlib import import_module

from designer.spec.options import Asked
from designer.spec.spec import Lattice, Spec, SpecValue

KINDS = (
    "ico",
    "board",
    "cube",
)
"""Names of the kinds, and of their modules, each of which holds a `KIND`. A module is loaded when it is asked for."""


@dataclass(frozen=True)
class Kind:
    """A kind of target: what can be asked for, and what comes of it."""

    title: str  # such as "an icosahedron with rings on its 20 faces"
    asked: type[Asked]
    spec: type[Spec]

    @property
    def name(self) -> str:
        """In files and commands."""
        return self.spec.kind


@cache
def kind_named(name: str) -> Kind:
    """The kind of a name in `KINDS`."""
    kind = import_module(f"designer.kinds.{name}").KIND
    assert isinstance(kind, Kind)  # noqa: S101 - what a module of `designer.kinds` is for
    return kind


def kinds() -> tuple[Kind, ...]:
    """All of them."""
    return tuple(map(kind_named, KINDS))


def spec_to_mapping(spec: Spec) -> dict[str, SpecValue]:
    """The spec as JSON values, with its `kind`. Whole numbers in fields of type float become floats."""
    values: dict[str, SpecValue] = {"kind": spec.kind}
    for field in fields(spec):  # type: ignore[arg-type]  # every kind's spec is a dataclass, which no type can say
        value = getattr(spec, field.name)
        if isinstance(value, tuple):
            values[field.name] = [float(v) for v in value]
        else:
            values[field.name] = float(value) if field.type is float else value
    return values


def spec_from_mapping(values: Mapping[str, SpecValue]) -> Spec:
    """The inverse of `spec_to_mapping`.

    Raises:
        ValueError: unknown kind, or a field that is missing, unknown or of the wrong type.
    """
    kind = values.get("kind")
    if not isinstance(kind, str) or kind not in KINDS:
        raise ValueError(f"spec kind {kind!r} is unknown; it must be one of {', '.join(KINDS)}")
    spec_type = kind_named(kind).spec
    expected = {field.name: field.type for field in fields(spec_type)}  # type: ignore[arg-type]  # a dataclass, as above
    given = {key: value for key, value in values.items() if key != "kind"}
    if given.keys() != expected.keys():
        odd = ", ".join(sorted(map(repr, given.keys() ^ expected.keys())))
        raise ValueError(f"spec of kind {kind!r} has missing or unknown fields: {odd}")
    return spec_type(**{key: _as_type(key, given[key], expected[key]) for key in expected})


def _as_type(key: str, value: SpecValue, expected: object) -> object:
    """`value` as the field type `expected`, for the few types that specs use."""
    number = float(value) if isinstance(value, (int, float)) and not isinstance(value, bool) else math.nan
    if expected is float and math.isfinite(number):
        return number
    if expected is int and number.is_integer():
        return int(number)
    if expected is bool and isinstance(value, bool):
        return value
    if expected == Lattice and value in ("square", "triangular"):
        return value
    if expected == tuple[float, float] and isinstance(value, list) and len(value) == 2:
        return tuple(_as_type(key, part, float) for part in value)
    raise ValueError(f"spec field {key!r} has the value {value!r}, which it cannot have")
