"""The error sources, one a file; here all of them by name, in the order in which they are applied."""

from collections.abc import Mapping
from types import MappingProxyType

from designer.base.errors import InputError
from designer.base.words import shown, suggestion_or_all
from designer.tolerance.source import ErrorSource
from designer.tolerance.sources.axis_scale import AXIS_SCALE
from designer.tolerance.sources.bow_twist import BOW_TWIST
from designer.tolerance.sources.face_bow import FACE_BOW
from designer.tolerance.sources.face_offset import FACE_OFFSET
from designer.tolerance.sources.face_rotation import FACE_ROTATION
from designer.tolerance.sources.face_shift import FACE_SHIFT
from designer.tolerance.sources.face_stretch import FACE_STRETCH
from designer.tolerance.sources.face_tilt import FACE_TILT
from designer.tolerance.sources.ink_bleed import INK_BLEED
from designer.tolerance.sources.ring_jitter import RING_JITTER
from designer.tolerance.sources.scale import SCALE
from designer.tolerance.sources.skew import SKEW
from designer.tolerance.sources.stair_steps import STAIR_STEPS
from designer.tolerance.sources.thermal import THERMAL
from designer.tolerance.sources.wall import WALL
from designer.tolerance.sources.warp import WARP

_IN_ORDER: tuple[ErrorSource, ...] = (
    # Within a face, in its frame.
    RING_JITTER,
    FACE_STRETCH,
    INK_BLEED,
    STAIR_STEPS,
    FACE_BOW,
    WARP,
    BOW_TWIST,
    # Faces, or pieces of a board, as rigid bodies; they turn before they shift.
    FACE_ROTATION,
    FACE_TILT,
    FACE_SHIFT,
    FACE_OFFSET,
    WALL,
    # The whole print: what the axes do, then what the material does.
    AXIS_SCALE,
    SKEW,
    SCALE,
    THERMAL,
)
SOURCES: Mapping[str, ErrorSource] = MappingProxyType({source.name: source for source in _IN_ORDER})


def source_named(name: str) -> ErrorSource:
    """The source of a name.

    Raises:
        InputError: there is none; the message suggests the nearest.
    """
    if name not in SOURCES:
        hint = suggestion_or_all(name, SOURCES)
        raise InputError(f"unknown error source {shown(name)}{hint}")
    return SOURCES[name]
