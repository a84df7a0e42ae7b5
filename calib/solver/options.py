"""What a person may choose about a solution."""

from dataclasses import dataclass
from typing import Literal

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
    max_iterations: int = 100


AS_THE_PAPER = SolveOptions(weighted=False)
"""Plain least squares: every observation counts the same."""
