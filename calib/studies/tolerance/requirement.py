"""Limits as people write them: `intersection=0.05mm`."""

from collections.abc import Callable, Mapping, Sequence

from calib.renderer.quantities import parse_degrees, parse_pixels
from calib.studies.tolerance.budget import checked_quantity
from calib.studies.tolerance.report import Requirement, of_name
from designer.base.errors import InputError
from designer.base.units import parse_length_mm
from designer.base.words import shown

_PARSERS: Mapping[str, Callable[[str], float]] = {"px": parse_pixels, "mm": parse_length_mm, "deg": parse_degrees}


def parse_requirements(texts: Sequence[str]) -> tuple[Requirement, ...]:
    """Limits, each of another quantity.

    Raises:
        InputError: no '=', an unknown quantity, a unit of another dimension, not above 0, or a quantity twice.
    """
    found = [_parse(text) for text in texts]
    names = [one.quantity for one in found]
    for name in names:
        if names.count(name) > 1:
            raise InputError(f"--require {name} is given twice; give one limit for each quantity")
    return tuple(found)


def _parse(text: str) -> Requirement:
    name, sign, value = text.partition("=")
    if not sign:
        raise InputError(f"--require {shown(text)}: write QUANTITY=LIMIT, such as intersection=0.05mm")
    try:
        quantity = checked_quantity(name.strip())
        limit = _PARSERS[of_name(quantity).unit](value)
    except ValueError as error:
        raise InputError(f"--require {shown(text)}: {error}") from None
    if not limit > 0:
        raise InputError(f"--require {shown(text)}: must be more than 0; give the largest error you can accept")
    return Requirement(quantity, limit)
