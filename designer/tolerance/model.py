"""The errors of one way of making a target, and targets drawn from them."""

import hashlib
from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Annotated, Literal, get_args

import numpy as np

from designer.base.arrays import Array
from designer.base.errors import InputError
from designer.base.marks import Length, Told
from designer.target import TargetGeometry
from designer.tolerance.effort import Effort
from designer.tolerance.shape import MadeShape, shape_of, target_of
from designer.tolerance.source import Amount, ErrorSource, format_quantity
from designer.tolerance.sources import SOURCES, source_named

Shape = Literal["solid", "plate", "two-sided plate"]
SHAPES: tuple[Shape, ...] = get_args(Shape)

Values = Mapping[str, Array]
"""Numbers by source, (instances, components) each."""


@dataclass(frozen=True)
class PieceWords:
    """What a face is where faces are put on one by one, and what to do with one that sits badly."""

    name: Annotated[str, Length(1, 4000), Told("word for it, such as 'tile'")]
    lifted: Annotated[str, Length(1, 4000), Told("remedy where one is high, low or tilted")]
    aside: Annotated[str, Length(1, 4000), Told("remedy where one is turned or shifted in its plane")]


@dataclass(frozen=True)
class ErrorModel:
    """How large each error source is for one way of making a target.

    Raises:
        InputError: an unknown source.
        ValueError: a source given twice.
    """

    name: str
    title: str
    amounts: tuple[tuple[str, Amount], ...]  # by source name; sources that are left out do nothing
    expansion_per_kelvin: float = 0.0
    layer_height_mm: float = 0.0
    material: str = ""
    piece: PieceWords | None = None  # what a face is, where faces are put on one by one
    suits: tuple[Shape, ...] = SHAPES  # what is made so
    price: Effort | None = None  # in euros; None: not known
    hours: Effort | None = None  # of machine and hands, without delivery
    notes: tuple[tuple[str, str], ...] = ()  # where each number comes from, by source name, "expansion", "layer_height"

    def __post_init__(self) -> None:
        names = [source_named(name).name for name, _ in self.amounts]
        if len(set(names)) < len(names):
            raise ValueError("an error source is given twice")

    def suits_target(self, target: TargetGeometry) -> bool:
        """Whether such a target is made so."""
        shape: Shape = "solid" if not target.is_plate else "plate" if target.is_planar else "two-sided plate"
        return shape in self.suits

    @property
    def sources(self) -> tuple[str, ...]:
        """Names of the sources it has an amount for."""
        return tuple(name for name, _ in self.amounts)

    def amount(self, name: str) -> Amount:
        """How large a source is; a source that was left out is zero."""
        return dict(self.amounts).get(name, Amount("normal", 0.0))

    def gain(self, name: str) -> float:
        """What the numbers of a source are multiplied by: what it needs to know of the print, else 1."""
        return {"": 1.0, "layer_height": self.layer_height_mm, "expansion": self.expansion_per_kelvin}[
            SOURCES[name].needs
        ]

    def only(self, *names: str) -> "ErrorModel":
        """The same model with these sources alone."""
        return replace(self, amounts=tuple((name, amount) for name, amount in self.amounts if name in names))

    def scaled(self, factor: float) -> "ErrorModel":
        """The same model with all sources `factor` times as large."""
        return replace(self, amounts=tuple((name, amount.scaled(factor)) for name, amount in self.amounts))

    def with_amount(self, name: str, amount: Amount) -> "ErrorModel":
        """The same model with another size of one source."""
        kept = dict(self.amounts)
        kept[name] = amount
        return replace(self, amounts=tuple(kept.items()))


def draw_values(target: TargetGeometry, model: ErrorModel, rng: np.random.Generator) -> dict[str, Array]:
    """Numbers for each source of a model, from one generator.

    Each source has its own stream, seeded by the generator and its name: leaving a source out, or changing its size,
    leaves the other sources' numbers as they are. The generator moves on by the same step for every model.
    """
    entropy = rng.integers(0, 2**32, size=4).tolist()
    draws = {}
    for name, amount in model.amounts:
        key = int.from_bytes(hashlib.sha256(name.encode()).digest()[:4], "big")
        stream = np.random.default_rng(np.random.SeedSequence(entropy, spawn_key=(key,)))
        draws[name] = amount.draw(stream, (SOURCES[name].instances(target), SOURCES[name].components))
    return draws


def perturb(target: TargetGeometry, model: ErrorModel, rng: np.random.Generator) -> TargetGeometry:
    """A target as it may come out.

    Args:
        target: the nominal geometry.
        model: how it is made.
        rng: the draw.

    Raises:
        InputError: an amount so large that no target is left; the message names the source and its value.
    """
    return displaced(target, draw_values(target, model, rng), model=model)


def displaced(
    target: TargetGeometry, values: Values, *, model: ErrorModel, bed_from_target: Array | None = None
) -> TargetGeometry:
    """The target with given numbers for its sources: the deterministic half of `perturb`.

    Raises:
        InputError: an unknown source, or a number so large that no target is left.
    """
    return target_of(displaced_shape(target, values, model=model, bed_from_target=bed_from_target))


def displaced_shape(
    target: TargetGeometry, values: Values, *, model: ErrorModel, bed_from_target: Array | None = None
) -> MadeShape:
    """As `displaced`, before the target is put together: `shape.centers_mm` of it is cheap.

    Raises:
        InputError: as `displaced`.
    """
    for name in values:
        source_named(name)
    shape = shape_of(
        target, bed_from_target, expansion_per_kelvin=model.expansion_per_kelvin, layer_height_mm=model.layer_height_mm
    )
    for name, source in SOURCES.items():
        if name in values:
            shape = _applied(source, shape, np.asarray(values[name], dtype=np.float64))
    return shape


def _applied(source: ErrorSource, shape: MadeShape, values: Array) -> MadeShape:
    """One source's effect; what leaves no target is told with the number that did it."""
    expected = (source.instances(shape.nominal), source.components)
    if values.shape != expected:
        raise ValueError(f"{source.name} has values of the shape {values.shape}; it must be {expected}")
    try:
        return source.apply(shape, values)
    except ValueError as error:
        largest = values.flat[int(np.argmax(np.abs(values)))]
        size = format_quantity(float(largest), source.unit)
        raise InputError(f"{source.name} {size}: {error}; use a smaller amount") from None
