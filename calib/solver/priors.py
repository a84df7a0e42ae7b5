"""What is known of a camera's parameters beforehand: `--prior fx=1250+-10px`.

A prior is one more observation, of the parameter itself, with a stated standard deviation S. Beside residuals, whose
noise s nobody states, it counts by `s^2 / S^2`. What s is the photos say without the prior, if they determine a camera
so; else both are found in turns. The covariance is `s^2 (N + W)^-1`, with the normal matrix N of the photos and the
weights W of the priors.
"""

import re
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from calib.cameras.parameters import LensParameter
from designer.base.errors import InputError
from designer.base.units import RAD_PER_UNIT, parse_percent, parse_quantity
from designer.base.words import figure, several, shown, suggestion_or_all

UNITS: Mapping[str, Mapping[str, float]] = {
    "px": {"": 1.0, "px": 1.0}, "1": {"": 1.0}, "rad": RAD_PER_UNIT | {"": 1.0},
}  # fmt: skip
"""Of a parameter's values, by its own, which is that of a bare number."""
LARGEST = 1e9
BETWEEN = re.compile(r"\+-|\+/-|±")
AGAINST = 4.0
"""Standard deviations of their difference, from which on photos and a prior are said to contradict each other."""


@dataclass(frozen=True)
class ParameterPrior:
    """What is known of a parameter, in its own unit."""

    name: str
    value: float
    sigma: float

    @property
    def text(self) -> str:
        """As it is typed."""
        return f"{self.name}={self.value!r}+-{self.sigma!r}"


def texts_of(priors: Mapping[str, tuple[float, float]] | Iterable[str] | str) -> tuple[str, ...]:
    """Priors as they are typed: numbers of Python by the parameters' names are values and standard deviations."""
    if not isinstance(priors, Mapping):
        return tuple(map(str, several("--prior", priors)))
    return tuple(f"{name}={value!r}+-{sigma!r}" for name, (value, sigma) in priors.items())


def is_prior(text: str) -> bool:
    """Whether a text gives a standard deviation."""
    return BETWEEN.search(text) is not None


def full_name(name: str, known: Iterable[str]) -> str:
    """A parameter's name, of which the unit may be left out: `fx` is `fx_px`."""
    return f"{name}_px" if f"{name}_px" in known and name not in known else name


def prior_from(text: str, known: Mapping[str, LensParameter]) -> ParameterPrior:
    """`fx=1250+-10px`, `k1=-.1+-.02`, `fy=1250px+-1%`, `tau_x=0+-2deg`.

    Raises:
        InputError: no such parameter of those known, or no value with a standard deviation.
    """
    name, equals, rest = text.partition("=")
    parts = BETWEEN.split(rest)
    if not equals or len(parts) != 2:
        raise InputError(f"--prior {shown(text)}: give a value and its standard deviation, as in fx=1250+-10px")
    name = full_name(name.strip(), known)
    if name not in known:
        hint = suggestion_or_all(name, sorted(known))
        raise InputError(f"--prior {shown(name)}: no such parameter{hint}")
    units, (first, last) = UNITS[known[name].unit], (part.strip() for part in parts)
    unit = re.search(r"[^\s\d.+-]+\Z", last.removesuffix("%"))
    if unit is not None and re.fullmatch(r"[-+\d.eE\s]+", first):
        first += unit[0]
    expected = "pixels, as in fx=1250+-10px" if "px" in units else f"a number, as in {name}=.1+-.02"
    try:
        value = parse_quantity(first, units, expected, LARGEST)
        is_share = last.endswith("%")
        sigma = abs(value) * parse_percent(last) / 100 if is_share else parse_quantity(last, units, expected, LARGEST)
    except ValueError as error:
        raise InputError(f"--prior {shown(text)}: {error}") from None
    return ParameterPrior(name, value, sigma)


def require_priors(
    priors: Sequence[ParameterPrior], model: str, parameters: Sequence[LensParameter], fixed: Sequence[str]
) -> None:
    """Refuse what cannot be.

    Raises:
        InputError: no such parameter, one that is fixed, twice the same, or numbers that make no sense.
    """
    known = {one.name: one for one in parameters}
    names = [one.name for one in priors]
    for one in priors:
        if one.name not in known:
            raise InputError(f"model {model} has no parameter {one.name!r}; it has {', '.join(known)}")
        bounds = known[one.name]
        if not bounds.lower < one.value < bounds.upper:
            raise InputError(f"--prior {one.text}: must be more than {bounds.lower:g} and less than {bounds.upper:g}")
        if not 0 < one.sigma < np.inf:
            raise InputError(
                f"--prior {one.text}: its standard deviation must be more than 0; what is surely so is fixed: "
                f"--fix {one.name}={one.value:g}"
            )
        if one.name in fixed:
            raise InputError(f"{one.name} is fixed and has a prior; choose one")
        if names.count(one.name) > 1:
            raise InputError(f"--prior {one.name}: is given twice; give it once")


def contradictions(
    priors: Sequence[ParameterPrior], values: Mapping[str, float], sigma: Mapping[str, float]
) -> list[str]:
    """A word on each prior that the photos contradict, from what both give together.

    Of these V is the variance, and that of the prior alone S^2: the rest, photos and other priors, has the precision
    `1/V - 1/S^2`, and `S^2 - V` is the variance of the prior's own residual (Baarda 1968).
    """
    said = []
    for one in priors:
        variance = sigma[one.name] ** 2
        off, spread = values[one.name] - one.value, one.sigma**2 - variance
        if not (spread > 0 and variance > 0 and abs(off) > AGAINST * np.sqrt(spread)):
            continue
        alone = 1 / (1 / variance - 1 / one.sigma**2)
        rest = alone * (values[one.name] / variance - one.value / one.sigma**2)
        said.append(
            f"{one.name}: the prior says {figure(one.value, 6)} ± {one.sigma:.2g}, the photos without it "
            f"{figure(rest, 6)} ± {np.sqrt(alone):.2g}, {abs(off) / np.sqrt(spread):.1f} standard deviations of their "
            "difference apart: one of the two is wrong; look where the prior comes from, or leave it out"
        )
    return said
