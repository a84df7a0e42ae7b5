"""An error source, and how large it is."""

import math
from collections.abc import Callable
from dataclasses import dataclass
from typing import Literal, get_args

import numpy as np

from designer.base.arrays import Array
from designer.target import TargetGeometry
from designer.tolerance.shape import MadeShape, piece_count

Scope = Literal["print", "face", "piece", "ring"]
"""A piece is a face of a solid, or a piece of a board: see `designer.tolerance.shape`."""
Unit = Literal["mm", "rad", "1", "K"]
Kind = Literal["normal", "uniform", "fixed"]
Need = Literal["", "layer_height", "expansion"]
"""What a way of making must tell of itself for a source to have an effect, which is in proportion to it."""
KINDS: tuple[Kind, ...] = get_args(Kind)


@dataclass(frozen=True)
class Amount:
    """The distribution of a source's numbers, in the source's unit; all of them are drawn alike, around zero.

    Raises:
        ValueError: an unknown kind, a size that is not finite, or a spread below zero.
    """

    kind: Kind
    size: float  # normal: standard deviation; uniform: half width; fixed: the value itself

    def __post_init__(self) -> None:
        if self.kind not in KINDS:
            raise ValueError(f"{self.kind!r} is no distribution; use {', '.join(KINDS)}")
        if not math.isfinite(self.size):
            raise ValueError("not a finite number")
        if self.kind != "fixed" and self.size < 0:
            raise ValueError("a spread must not be negative; leave the sign out, or write 'fixed' for a known value")

    @property
    def sigma(self) -> float:
        """Root mean square around zero, in the source's unit."""
        return {"normal": self.size, "uniform": self.size / math.sqrt(3), "fixed": abs(self.size)}[self.kind]

    def draw(self, rng: np.random.Generator, shape: tuple[int, ...]) -> Array:
        """Numbers of a shape. From the same generator state they are in proportion to the size."""
        if self.kind == "normal":
            return self.size * rng.standard_normal(shape)
        if self.kind == "uniform":
            return self.size * rng.uniform(-1.0, 1.0, shape)
        return np.full(shape, self.size)

    def scaled(self, factor: float) -> "Amount":
        """The same distribution, `factor` times as wide."""
        return Amount(self.kind, factor * self.size)


@dataclass(frozen=True)
class ErrorSource:
    """One way in which a made target differs from its drawing, and what it does to a shape.

    `apply` takes the source's numbers (n, components), one row an instance, and raises ValueError where they
    leave no possible target.
    """

    name: str
    title: str  # for tables and plots
    unit: Unit  # "1": a share, such as 0.3 %
    scope: Scope  # has one instance a print, a face, a piece or a ring
    components: int  # numbers of an instance
    apply: Callable[[MadeShape, Array], MadeShape]
    needs: Need = ""

    def instances(self, target: TargetGeometry) -> int:
        """How many instances a target has."""
        if self.scope == "piece":
            return piece_count(target)
        return {"print": 1, "face": target.face_count, "ring": target.ring_count}[self.scope]


def format_quantity(value: float, unit: Unit) -> str:
    """A number of a source as a person reads it: `0.1deg` for 0.001745 rad."""
    if unit == "rad":
        return f"{math.degrees(value):.6g}deg"
    if unit == "1":
        return f"{100 * value:.6g}%"
    return f"{value:.6g}{unit}"
