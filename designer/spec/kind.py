"""The kinds of targets: a file of `designer/kinds/` and a line here for each."""

from collections.abc import Mapping
from dataclasses import dataclass
from functools import cache
from importlib import import_module
from typing import cast

from designer.base.codec import decode, encode
from designer.base.files import JsonValue
from designer.spec.options import Asked
from designer.spec.spec import Spec

KINDS = ("ico", "board", "cube", "octahedron", "tetrahedron", "dodecahedron", "dome", "corner", "solid", "coupon")
"""Names of the kinds, and of their modules, each of which holds a `KIND`. A module is loaded when it is asked for."""


@dataclass(frozen=True)
class Kind:
    """A kind of target: what can be asked for, and what comes of it."""

    title: str  # such as "an icosahedron with rings on its 20 faces"
    asked: type[Asked]
    spec: type[Spec]
    marked: type[Spec] | None = None  # with other makers' marks, which it names as `marks`

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


def spec_to_mapping(spec: Spec) -> Mapping[str, JsonValue]:
    """The spec as JSON values, its `kind` first."""
    return {"kind": spec.kind, **cast("dict[str, JsonValue]", encode(type(spec), spec))}


def spec_from_mapping(values: Mapping[str, object]) -> Spec:
    """The inverse of `spec_to_mapping`.

    Raises:
        ValueError: unknown kind, or a field that is missing, unknown or of the wrong type.
    """
    kind = values.get("kind")
    if not isinstance(kind, str) or kind not in KINDS:
        raise ValueError(f"spec kind {kind!r} is unknown; it must be one of {', '.join(KINDS)}")
    own = cast("dict[str, JsonValue]", {key: value for key, value in values.items() if key != "kind"})
    made = kind_named(kind)
    return decode(made.marked if made.marked is not None and "marks" in own else made.spec, own, "spec")
