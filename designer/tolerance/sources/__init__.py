"""The error sources, one a file; here all of them by name, in the order in which they are applied."""

from collections.abc import Mapping
from importlib import import_module
from types import MappingProxyType

from designer.base.errors import InputError
from designer.base.words import shown, suggestion_or_all
from designer.tolerance.source import ErrorSource

_IN_ORDER = (
    # Within a face, in its frame.
    "ring_jitter",
    "face_stretch",
    "ink_bleed",
    "stair_steps",
    "face_bow",
    "warp",
    "bow_twist",
    # Faces, or pieces of a board, as rigid bodies; they turn before they shift.
    "face_rotation",
    "face_tilt",
    "face_shift",
    "face_offset",
    "wall",
    # The whole print: what the axes do, then what the material does.
    "axis_scale",
    "skew",
    "scale",
    "thermal",
)
SOURCES: Mapping[str, ErrorSource] = MappingProxyType(
    {name: import_module(f"designer.tolerance.sources.{name}").SOURCE for name in _IN_ORDER}
)


def source_named(name: str) -> ErrorSource:
    """The source of a name.

    Raises:
        InputError: there is none; the message suggests the nearest.
    """
    if name not in SOURCES:
        hint = suggestion_or_all(name, SOURCES)
        raise InputError(f"unknown error source {shown(name)}{hint}")
    return SOURCES[name]
