"""Error models that people write, in TOML: amounts with units, each with the source of its number.

`parse_amount("uniform 0.1deg", SOURCES["face_tilt"])` reads one such amount.
"""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, TypeVar, cast

from designer.base.codec import BadValueError, decode
from designer.base.errors import InputError
from designer.base.files import read_spec_file
from designer.base.marks import Length, Reads, Told
from designer.base.units import parse_angle_rad, parse_length_mm, parse_percent, parse_quantity
from designer.base.words import several, shown, suggestion
from designer.kinds.presets import preset_or_file
from designer.tolerance.effort import parse_effort
from designer.tolerance.model import SHAPES, ErrorModel, PieceWords, Shape
from designer.tolerance.source import KINDS, Amount, ErrorSource, Unit
from designer.tolerance.sources import SOURCES, source_named

if TYPE_CHECKING:
    from designer.base.files import JsonValue

T = TypeVar("T")
Text = Annotated[str, Length(1, 4000)]
MAX_KELVIN = 1000.0
_KELVIN_PER_UNIT = {"": 1.0, "K": 1.0, "°C": 1.0, "degC": 1.0}
_PER_KELVIN_PER_UNIT = {"": 1.0, "/K": 1.0, "ppm/K": 1e-6, "um/m/K": 1e-6}


def _as_text(value: object) -> str:
    """A quantity as text; a bare number stands for itself."""
    if isinstance(value, bool) or not isinstance(value, (str, int, float)):
        raise ValueError("must be a quantity such as 'normal 0.1mm'")
    return value if isinstance(value, str) else repr(value)


Quantity = Annotated[str, Reads(_as_text)]


@dataclass(frozen=True)
class Sourced:
    """A number and where it comes from."""

    amount: Annotated[Quantity, Told("size with its unit, such as 'normal 0.1deg'")]
    source: Annotated[Text, Told("publication the number comes from, or 'assumption: ' and the reason")]


@dataclass(frozen=True)
class ErrorFile:
    """An error model: how a way of making misses the drawing."""

    title: Annotated[Text, Told("way of making, in a few words")]
    material: Annotated[Text, Told("material")]
    errors: Annotated[dict[str, Sourced], Told("tables, one for each error source")]
    expansion: Sourced | None = None  # linear, of the material, such as 68e-6/K
    layer_height: Sourced | None = None
    piece: PieceWords | None = None  # what a face is, where faces are put on one by one
    suits: tuple[Shape, ...] = SHAPES  # what is made so
    price: Sourced | None = None  # such as 12EUR + 3EUR/dm2
    hours: Sourced | None = None  # such as 1h + 0.1h/face


def error_model(name_or_path: str, overrides: Sequence[str] = ()) -> ErrorModel:
    """An error model from a template or a file, with single amounts replaced.

    Args:
        name_or_path: a template's name (`templates/errors`), or a TOML file.
        overrides: `SOURCE=AMOUNT`, such as `face_tilt=0.1deg` or `face_tilt=uniform 0.1deg`.

    Raises:
        InputError: no such template or file, or a key, a source or an amount that breaks a rule.
    """
    path = preset_or_file("errors", name_or_path)
    model = _read(path)
    for override in several("--set", overrides):
        model = _overridden(model, override)
    return _checked(model, path)


def _read(path: Path) -> ErrorModel:
    """The model in a file."""
    try:
        values = read_spec_file(path)
        if misplaced := [key for key in values if key in SOURCES]:
            raise BadValueError(f"unknown key {shown(misplaced[0])}; write it as a table [errors.{misplaced[0]}]")
        file = decode(ErrorFile, cast("JsonValue", values))
    except BadValueError as error:
        raise InputError(" ".join(f"{path}: {error}".split())) from None
    entries = {
        "expansion": file.expansion, "layer_height": file.layer_height, "price": file.price, "hours": file.hours,
        **file.errors,
    }  # fmt: skip
    try:
        return ErrorModel(
            name=path.stem,
            title=file.title,
            amounts=tuple(
                (name, parse_amount(entry.amount, source_named(name))) for name, entry in file.errors.items()
            ),
            expansion_per_kelvin=_told("expansion", file.expansion, parse_expansion) or 0.0,
            layer_height_mm=_told("layer_height", file.layer_height, parse_length_mm) or 0.0,
            material=file.material,
            suits=file.suits,
            price=_told("price", file.price, partial(parse_effort, unit="EUR")),
            hours=_told("hours", file.hours, partial(parse_effort, unit="h")),
            piece=file.piece,
            notes=tuple((name, entry.source) for name, entry in entries.items() if entry is not None),
        )
    except InputError as error:
        raise InputError(f"{path}: {error}") from None


def _told(name: str, entry: Sourced | None, parse: Callable[[str], T]) -> T | None:
    """A number, or what making takes, above zero; None where the file does not tell it."""
    try:
        value = None if entry is None else parse(entry.amount)
        if isinstance(value, float) and value <= 0:
            raise ValueError("must be more than zero")
    except ValueError as error:
        raise InputError(f"{name} {shown(entry.amount if entry else '')}: {error}") from None
    return value


def _overridden(model: ErrorModel, override: str) -> ErrorModel:
    """The model with one amount from the command line."""
    name, sign, text = override.partition("=")
    if not sign:
        raise InputError(f"{shown(override)}: write SOURCE=AMOUNT, such as face_tilt=0.1deg")
    source = source_named(name.strip())
    notes = {**dict(model.notes), source.name: "given by hand"}
    return replace(model.with_amount(source.name, parse_amount(text, source)), notes=tuple(notes.items()))


def _checked(model: ErrorModel, path: Path) -> ErrorModel:
    """The model, if it says what its sources need to have an effect."""
    for name, amount in model.amounts:
        if amount != Amount("normal", 0.0) and not model.gain(name):
            needed = SOURCES[name].needs
            raise InputError(
                f"{path}: {name} needs the {needed}; add a table [{needed}] to the file, or to a copy of it"
            )
    return model


def parse_expansion(text: str) -> float:
    """A coefficient of linear expansion per kelvin.

    Raises:
        ValueError: no such quantity, or more than 0.001/K.
    """
    return parse_quantity(text, _PER_KELVIN_PER_UNIT, "an expansion such as 68e-6/K or 68ppm/K", 1e-3)


_PARSERS: Mapping[Unit, Callable[[str], float]] = {
    "mm": parse_length_mm,
    "rad": parse_angle_rad,
    "1": lambda text: parse_percent(text) / 100,
    "K": lambda text: parse_quantity(text, _KELVIN_PER_UNIT, "a difference of temperature such as 5K", MAX_KELVIN),
}


def parse_amount(text: str, source: ErrorSource) -> Amount:
    """The amount of a source: a quantity, and before it `normal` (or nothing), `uniform` or `fixed`.

    Raises:
        InputError: an unknown distribution, a unit of another dimension, not finite, or a spread below zero.
    """
    word, _, rest = text.strip().partition(" ")
    has_kind = bool(rest) and word.isalpha() and word.lower() not in ("nan", "inf", "infinity")
    kind, quantity = (word.lower(), rest) if has_kind else ("normal", text)
    for known in KINDS:
        if kind == known:
            try:
                return Amount(known, _PARSERS[source.unit](quantity))
            except ValueError as error:
                raise InputError(f"{source.name} {shown(text)}: {error}") from None
    hint = suggestion(kind, list(KINDS)) or f"; use {', '.join(KINDS)}"
    raise InputError(f"{source.name} {shown(text)}: unknown distribution {shown(word)}{hint}")
