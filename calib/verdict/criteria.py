"""The limits that a calibration is judged by: templates, or a person's own TOML file.

A file of one's own needs to hold only what differs from the template `standard`.
"""

import re
from collections.abc import Mapping
from dataclasses import dataclass, fields
from pathlib import Path
from typing import Annotated

from pydantic import AfterValidator, BaseModel, BeforeValidator, ConfigDict, Field, ValidationError

from designer.base.errors import InputError
from designer.base.marks import AtLeast, Line, Word
from designer.base.words import shown, suggestion
from designer.kinds.presets import preset_or_file
from designer.kinds.spec_file import RawValue, read_spec_file

STANDARD = "standard"
_NUMBER = re.compile(r"\s*(\d{1,9}\.?\d{0,9}|\.\d{1,9})\s*([A-Za-z%]{0,8})\s*")


@dataclass(frozen=True)
class Limits:
    """Within which value a check is good, and within which usable."""

    good: Annotated[float, AtLeast(0)]
    usable: Annotated[float, AtLeast(0)]
    source: Line = ""  # where the numbers come from


@dataclass(frozen=True)
class Criteria:
    """The limits of all checks."""

    name: Word  # of the template, or of the file
    title: Word
    uncertainty_px: Limits  # 95 % of the image: standard deviation of the camera
    coverage_percent: Limits  # at least so much of the image is covered by sightings
    halves_sigma: Limits  # difference of two half solutions in stated standard deviations
    residuals_px: Limits  # root mean square of what is left over
    systematic_px: Limits  # what of it is not noise
    outliers_percent: Limits  # sightings left out or far off
    target_px: Limits  # 95 % of the covered area: what a target of another shape would change
    models_px: Limits  # 95 % of the covered area: difference from another camera model


def _quantity(unit: str, largest: float, value: RawValue) -> float:
    """A number of a unit, with or without it."""
    number = value
    if isinstance(value, str):
        match = _NUMBER.fullmatch(value)
        if match is None or match[2] not in ("", unit):
            raise ValueError(f"must be a number of {unit}, such as '1{unit}'")
        number = float(match[1])
    if isinstance(number, bool) or not isinstance(number, int | float) or not 0 <= number <= largest:
        raise ValueError(f"must be from 0 to {largest:g}{unit}")
    return float(number)


Pixels = Annotated[float, BeforeValidator(lambda value: _quantity("px", 1000.0, value))]
Percent = Annotated[float, BeforeValidator(lambda value: _quantity("%", 100.0, value))]
Sigmas = Annotated[float, BeforeValidator(lambda value: _quantity("sigma", 1000.0, value))]


class _Strict(BaseModel):
    model_config = ConfigDict(extra="forbid", frozen=True)


class _PixelLimits(_Strict):
    good: Pixels
    usable: Pixels
    source: str = ""


class _PercentLimits(_Strict):
    good: Percent
    usable: Percent
    source: str = ""


class _SigmaLimits(_Strict):
    good: Sigmas
    usable: Sigmas
    source: str = ""


_AnyLimits = _PixelLimits | _PercentLimits | _SigmaLimits


def _at_most(limits: _AnyLimits) -> _AnyLimits:
    if limits.good > limits.usable:
        raise ValueError(
            f"good {limits.good:g} must not be more than usable {limits.usable:g}: the value is at most so"
        )
    return limits


def _at_least(limits: _AnyLimits) -> _AnyLimits:
    if limits.good < limits.usable:
        raise ValueError(
            f"good {limits.good:g} must not be less than usable {limits.usable:g}: the value is at least so"
        )
    return limits


class _CriteriaFile(_Strict):
    """The keys of a criteria file."""

    title: Annotated[str, Field(min_length=1, max_length=200)]
    uncertainty: Annotated[_PixelLimits, AfterValidator(_at_most)]
    coverage: Annotated[_PercentLimits, AfterValidator(_at_least)]
    halves: Annotated[_SigmaLimits, AfterValidator(_at_most)]
    residuals: Annotated[_PixelLimits, AfterValidator(_at_most)]
    systematic: Annotated[_PixelLimits, AfterValidator(_at_most)]
    outliers: Annotated[_PercentLimits, AfterValidator(_at_most)]
    target: Annotated[_PixelLimits, AfterValidator(_at_most)]
    models: Annotated[_PixelLimits, AfterValidator(_at_most)]


_KEYS = tuple(_CriteriaFile.model_fields)
_LIMIT_KEYS = tuple(_PixelLimits.model_fields)


def read_criteria(name_or_path: str = STANDARD) -> Criteria:
    """The criteria of a template, or of a person's TOML file.

    Raises:
        InputError: neither, or a key or value that breaks a rule; the message says which.
    """
    path = preset_or_file("criteria", name_or_path)
    values = read_spec_file(path)
    standard = preset_or_file("criteria", STANDARD)
    merged: Mapping[str, RawValue] = {**read_spec_file(standard), **values} if path != standard else values
    return _criteria(merged, path)


def _criteria(values: Mapping[str, RawValue], path: Path) -> Criteria:
    """Check a file's values."""
    try:
        file = _CriteriaFile.model_validate(dict(values))
    except ValidationError as error:
        raise InputError(f"{path}: {' '.join(_explain(error).split())}") from None
    limits = {
        field.name: _limits(getattr(file, field.name.rpartition("_")[0]))
        for field in fields(Criteria)
        if field.name not in ("name", "title")
    }
    return Criteria(path.stem, file.title, **limits)


def _limits(file: _AnyLimits) -> Limits:
    return Limits(file.good, file.usable, file.source)


def _explain(error: ValidationError) -> str:
    """One line on the first thing wrong; an unknown key comes first, being likely the missing one misspelt."""
    first = min(error.errors(), key=lambda wrong: wrong["type"] != "extra_forbidden")
    key = ".".join(map(str, first["loc"]))
    if first["type"] == "extra_forbidden":
        known = _KEYS if len(first["loc"]) == 1 else _LIMIT_KEYS
        last = str(first["loc"][-1])
        return f"unknown key {shown(key)}{suggestion(last, list(known)) or '; there are ' + ', '.join(known)}"
    if first["type"] == "missing":
        return f"{key} is missing; give both limits, good and usable"
    rule = first["msg"].removeprefix("Value error, ")
    if isinstance(first["input"], BaseModel):
        return f"{key}: {rule}"
    return f"{key} {shown(first['input'])}: {rule[:1].lower()}{rule[1:]}"
