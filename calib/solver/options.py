"""What a person may choose about a solution, and which parameters are free, fixed or shared by it."""

from dataclasses import dataclass
from typing import Literal

import numpy as np

from calib.cameras import MODELS, solved_models, told_parameters
from calib.solver.costs import IMAGE
from designer.base.arrays import Array, Rows
from designer.base.errors import InputError

Loss = Literal["squares", "huber", "cauchy"]


@dataclass(frozen=True)
class SolveOptions:
    """How to solve; the default is least squares of all observations, each counting by what it states of itself."""

    weighted: bool = True  # by the covariances of the observations, where they are known; False: all alike
    loss: Loss = "squares"
    reject_sigma: float | None = None  # leave out observations farther off than so many robust standard deviations
    fixed: tuple[tuple[str, float | None], ...] = ()  # parameter and value; None: the value it starts from
    shared: tuple[tuple[str, ...], ...] = ()  # groups of parameters that have one value
    focal_px: float | None = None  # first guess
    max_iterations: int = 300
    minimise: str = IMAGE  # of `calib.solver.costs.COSTS`
    free_bend: bool = False  # of a flat target, which is then an unknown


AS_THE_PAPER = SolveOptions(weighted=False)
"""Plain least squares: every observation counts the same."""


@dataclass(frozen=True, eq=False)
class Tie:
    """The free parameter that each parameter of a model follows; the control points of a surface are none of these."""

    row: Rows  # (P,) -1: fixed
    value: Array  # (P,) where a parameter is to start, nan: anywhere
    fixed: tuple[str, ...]


def tie_parameters(model: str, options: SolveOptions) -> Tie:
    """The free parameters of a model under a person's choices."""
    if model not in solved_models():
        raise InputError(
            f"model {model}: photos are simulated with it, not solved; choose one of {', '.join(solved_models())}"
        )
    parameters = told_parameters(model)
    names = tuple(parameter.name for parameter in parameters)
    value = np.full(len(names), np.nan)
    fixed: list[str] = []
    for name, number in options.fixed:
        k = _index(name, model, names)
        bounds = parameters[k]
        if number is not None and not bounds.lower < number < bounds.upper:
            raise InputError(f"{name}={number:g}: must be more than {bounds.lower:g} and less than {bounds.upper:g}")
        if name in fixed:
            raise InputError(f"{name} is fixed twice; fix it once")
        fixed.append(name)
        value[k] = np.nan if number is None else number
    row = np.full(len(names), -1)
    follows = _followers(model, names, options, fixed)
    count = 0
    for k, name in enumerate(names):
        if name in fixed:
            continue
        leader = follows.get(name, k)
        if leader < k:
            row[k] = row[leader]
        else:
            row[k], count = count, count + 1
    return Tie(row, value, tuple(fixed))


def _followers(model: str, names: tuple[str, ...], options: SolveOptions, fixed: list[str]) -> dict[str, int]:
    """The first parameter of its group, for each parameter that shares its value."""
    follows: dict[str, int] = {}
    for group in options.shared:
        if len(group) < 2:
            raise InputError(f"{','.join(group)!r}: name two or more parameters that are to share a value")
        rows = [_index(name, model, names) for name in group]
        for name in group:
            if name in fixed:
                raise InputError(f"{name} is fixed and shared; choose one")
            if name in follows or group.count(name) > 1:
                raise InputError(f"{name} is shared twice; name it once")
        if len({MODELS[model].parameters[k].unit for k in rows}) > 1:
            raise InputError(f"{','.join(group)}: parameters of different units cannot share a value")
        follows.update(dict.fromkeys(group, min(rows)))
    return follows


def _index(name: str, model: str, names: tuple[str, ...]) -> int:
    if name not in names:
        raise InputError(f"model {model} has no parameter {name!r}; it has {', '.join(names)}")
    return names.index(name)
