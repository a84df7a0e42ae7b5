"""A board that is not flat."""

from designer.tolerance.shape import MadeShape
from designer.tolerance.source import Array, ErrorSource
from designer.tolerance.sources.face_bow import bent


def _apply(shape: MadeShape, values: Array) -> MadeShape:
    """The board bends as `face_bow` bends a face; a body of several faces is stiff and stays as it is."""
    return bent(shape, values) if shape.nominal.is_planar else shape


WARP = ErrorSource("warp", "warp of a board", "mm", "print", 3, _apply)
