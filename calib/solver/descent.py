"""Levenberg-Marquardt, apart from what is solved by it: one loop for cameras, rigs and printed targets.

A step x of `(H + damping diag H) x = -g` is taken if the cost falls; the damping then follows how much of what the
step promised came true (after Nielsen 1999, bolder), else it grows.
"""

from dataclasses import dataclass
from typing import Generic, Protocol, TypeVar

FIRST_DAMPING = 1e-4
LARGEST_DAMPING = 1e12
SMALLEST_DAMPING = 1e-14
SMALL_DECREASE = 1e-15
"""Of the cost: with 100,000 observations the unknowns are then within 1e-5 standard deviations of the minimum."""
ROUNDING = 1e-13
"""Of the cost: a step that promises less and does not deliver is lost in rounding."""
PERFECT_PX = 1e-11
"""Root mean square of residuals that are nothing but rounding."""
FIRST_GROWTH = 2.0
FULL_GAIN = 0.9


class Promising(Protocol):
    """A step, of which is known by how much the cost falls if the equations are right."""

    @property
    def predicted(self) -> float:
        """By the undamped quadratic model."""


State = TypeVar("State")
Equations = TypeVar("Equations")
StepT = TypeVar("StepT", bound=Promising)


class Solvable(Protocol[State, Equations, StepT]):
    """What the loop asks of a problem; states and equations are its own affair."""

    @property
    def perfect(self) -> float:
        """A cost that is nothing but rounding."""

    def equations(self, state: State) -> Equations:
        """The normal equations at a state."""

    def cost(self, equations: Equations) -> float:
        """Of the state; nan where it has none."""

    def step(self, state: State, equations: Equations, damping: float) -> StepT | None:
        """The damped step; None if there is none."""

    def trial(self, state: State, equations: Equations, step: StepT) -> tuple[State, Equations] | None:
        """The state after a step and the equations there; None if it is not allowed."""

    def gives_up(self, there: Equations) -> bool:
        """Told of each trial without a cost: whether to go on is in vain."""


@dataclass(frozen=True, eq=False)
class Descent(Generic[State, Equations]):
    """Where a descent ended."""

    state: State
    equations: Equations  # there
    iterations: int
    converged: bool


def levenberg_marquardt(
    problem: Solvable[State, Equations, StepT],
    state: State,
    *,
    max_iterations: int,
    small_decrease: float = SMALL_DECREASE,
    damping: float = FIRST_DAMPING,
) -> Descent[State, Equations]:
    """Descend to the nearest minimum of the cost.

    Args:
        problem: what is minimised.
        state: where to start.
        max_iterations: of trial steps.
        small_decrease: ends the descent when a step promises less, as a part of the cost.
        damping: to begin with; little where the start is near the minimum.
    """
    equations = problem.equations(state)
    cost, growth = problem.cost(equations), FIRST_GROWTH
    if not abs(cost) < float("inf"):
        problem.gives_up(equations)
        return Descent(state, equations, 0, converged=False)
    for iteration in range(1, max_iterations + 1):
        step = problem.step(state, equations, damping)
        if step is not None and step.predicted <= small_decrease * cost + problem.perfect:
            return Descent(state, equations, iteration, converged=True)
        trial = None if step is None else problem.trial(state, equations, step)
        if step is not None and trial is not None:
            there = trial[1]
            trial_cost = problem.cost(there)
            if trial_cost < cost:
                gain = (cost - trial_cost) / step.predicted
                damping = max(damping * _shrinkage(gain, growth), SMALLEST_DAMPING)
                (state, equations), cost, growth = trial, trial_cost, FIRST_GROWTH
                continue
            if not abs(trial_cost) < float("inf"):
                if problem.gives_up(there):
                    return Descent(state, equations, iteration, converged=False)
            elif step.predicted <= ROUNDING * cost:
                return Descent(state, equations, iteration, converged=True)
        damping, growth = damping * growth, growth * 2
        if damping > LARGEST_DAMPING:
            return Descent(state, equations, iteration, converged=False)
    return Descent(state, equations, max_iterations, converged=False)


def _shrinkage(gain: float, growth: float) -> float:
    """Factor of the damping after a step that gained this part of what it promised."""
    if gain > FULL_GAIN:
        return 1e-3 if growth == FIRST_GROWTH else 0.2  # not at once where bolder steps have just failed
    return max(1 / 3, 1 - (2 * gain - 1) ** 3)
