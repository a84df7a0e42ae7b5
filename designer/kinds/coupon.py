"""A small piece that shows in a photo how a printer prints: rings and lines of graded width.

Rings tell the axes (their centres do not move when ink bleeds) and how far ink bleeds all around; lines tell it along
one axis. What is black in one comb is white in the other.
"""

import math
from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, ClassVar

from designer.base.errors import InputError
from designer.kinds.board import BoardSpec
from designer.spec.kind import Kind
from designer.spec.options import Asked
from designer.spec.spec import Line, Spec, SpecValue

if TYPE_CHECKING:
    from designer.base.arrays import Array
    from designer.target import TargetGeometry

SIDE_MM, THICKNESS_MM = 60.0, 0.8
"""Four layers of 0.2 mm: the first takes more time than all others, and what is seen is its lower side."""
ACROSS = 5
PITCH_MM, DIAMETER_MM = 7.6, 5.6
WIDTHS_MM = (0.6, 0.8, 1.0, 1.25, 1.55)
"""Of the strokes, row by row from below, and of the lines. The finest is 1.3 lines of a 0.4 mm nozzle; a ring with a
wider stroke than the last has a white centre too small for the detector."""
COMB_MM = (20.2, 24.7)
"""From where to where lines run, from the middle of the coupon outwards."""
WHITE_MM, BLACK_MM, BETWEEN_MM = 1.9, 1.8, 3.0
"""White between black lines, black between white lines, and white between the two combs."""
TOLERANCE_MM = 1e-6


@dataclass(frozen=True)
class CouponSpec(BoardSpec):
    """Rings on a square lattice, a row a stroke, between lines on all four sides: the same piece for all printers."""

    kind: ClassVar[str] = "coupon"
    extent: ClassVar[tuple[str, ...]] = ()
    least_gap_mm: ClassVar[float] = WIDTHS_MM[0]
    is_graded: ClassVar[bool] = True
    flat_ink_layers: ClassVar[int] = 1  # what is seen is the first one; see `sizing.LEAST_INK_MM`

    def lay_out(self) -> "TargetGeometry":
        """The rings as a board has them, with strokes of their row's width."""
        import numpy as np  # here: reading a command line needs none

        from designer.kinds.layout import DECIMALS

        board = super().lay_out()
        row = board.ring_index[:, 1] - board.ring_index[:, 1].min()
        inner = board.radius_outer_mm - np.array(WIDTHS_MM)[row]
        return replace(board, radius_inner_mm=np.where(board.is_dot, 0.0, np.round(inner, DECIMALS)))

    @property
    def marks_mm(self) -> "Array":
        """The lines and what lies between them, counter-clockwise from the lower left.  # (K, 4, 2)"""
        import numpy as np

        low, high = COMB_MM
        bars = []
        for start, end in _comb():
            upright = np.array([[start, low], [end, low], [end, high], [start, high]])
            lying = upright[[0, 3, 2, 1]][:, ::-1]
            bars += [upright, upright - [0, low + high], lying, lying - [low + high, 0]]
        return np.array(bars)

    @property
    def words(self) -> str:
        """As in `coupon of 60 x 60 mm`."""
        return f"coupon of {self.size_mm[0]:g} x {self.size_mm[1]:g} mm"

    def facts(self) -> tuple[tuple[str, str], ...]:
        """Shape, strokes and lattice."""
        return (
            ("shape", f"coupon, {SIDE_MM:g} x {SIDE_MM:g} x {THICKNESS_MM:g} mm"),
            ("strokes and lines", f"{', '.join(f'{width:g}' for width in WIDTHS_MM)} mm"),
            ("lattice", f"{self.lattice}, {self.columns} columns, {self.rows} rows"),
        )

    def options(self) -> Mapping[str, SpecValue]:
        """None: all sizes are fixed."""
        return {}


def _comb() -> list[tuple[float, float]]:
    """From where to where black lines and the black between white lines are wide, along a side of the coupon."""
    bars, at = [], 0.0
    for width in WIDTHS_MM:
        bars.append((at, at + width))
        at += width + WHITE_MM
    at += BETWEEN_MM - WHITE_MM
    for gap in (*WIDTHS_MM, 0.0):
        bars.append((at, at + BLACK_MM))
        at += BLACK_MM + gap
    return [(round(start - at / 2, 9), round(end - at / 2, 9)) for start, end in bars]


COUPON = CouponSpec(
    size_mm=(SIDE_MM, SIDE_MM), thickness_mm=THICKNESS_MM, columns=ACROSS, rows=ACROSS, lattice="square",
    ring_diameter_mm=DIAMETER_MM, ring_ratio=round(1 - 2 * WIDTHS_MM[0] / DIAMETER_MM, 9), pitch_mm=PITCH_MM,
    border_mm=0.0, margin_mm=(SIDE_MM - (ACROSS - 1) * PITCH_MM - DIAMETER_MM) / 2, dots=True,
)  # fmt: skip
"""The one there is."""


@dataclass(frozen=True, kw_only=True)
class AskedCoupon(Asked):
    """A coupon as asked for: how it is made can be chosen, its sizes cannot."""

    def sized(self, line: Line) -> tuple[CouponSpec, str]:
        """See `Asked.sized`."""
        for name in ("ring_diameter", "pitch", "ring_ratio", "border", "margin"):
            given, own = getattr(self, name), getattr(COUPON, name if name == "ring_ratio" else f"{name}_mm")
            if given is not None and not math.isclose(given, own, abs_tol=TOLERANCE_MM):
                raise InputError(
                    f"{name} {given:g}: all coupons have {own:g}, so that they compare; leave it out, or design a board"
                )
        if line.nozzle_mm > WIDTHS_MM[0]:
            raise InputError(
                f"the coupon's finest stroke of {WIDTHS_MM[0]:g}mm is thinner than {line.process}; use --nozzle "
                f"{WIDTHS_MM[0]:g}mm or finer"
            )
        return COUPON, "sizes: those of all coupons"

    def size_name(self, spec: Spec) -> str:
        """Its side."""
        return f"{SIDE_MM:g}mm"


KIND = Kind("a coupon, whose photo tells ink bleed, scale and skew of a printer", AskedCoupon, CouponSpec)
