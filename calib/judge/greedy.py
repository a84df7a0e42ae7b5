"""What to take next: of candidates one after the other, each by what is known with all before it, and exchanges.

The next one is the one after which what is asked for is known best (greedy optimal design; as guidance for photos in
Richardson et al. 2013, "AprilCal"). A list that reaches its goal is then made shorter, and its members are exchanged
for better ones as long as that helps (Fedorov 1972).

What there is to take (photos, frames of a rig, poses of a robot), what each would tell, and what is to be known are
their own: a choice is any value, and so is what is known with it.
"""

from collections.abc import Callable
from dataclasses import dataclass
from typing import Generic, TypeVar

import numpy as np

from designer.base.arrays import Array

State = TypeVar("State")
Choice = TypeVar("Choice")

LITTLE_GAIN = 0.97
"""What leaves more than this of the deviation is not worth taking."""
WORTH_A_SWAP = 0.98
ROUNDS = 3
"""Of exchanges, through all that was chosen."""


@dataclass(frozen=True, eq=False)
class GreedyStep(Generic[State, Choice]):
    """What is known before and after a choice."""

    before: State
    choice: Choice
    after: State


def one_by_one(
    start: State, choose: Callable[[State], Choice | None], add: Callable[[State, Choice], State], most: int
) -> list[GreedyStep[State, Choice]]:
    """So many choices at most, until there is none that is worth it."""
    steps: list[GreedyStep[State, Choice]] = []
    known = start
    while len(steps) < most and (choice := choose(known)) is not None:
        steps.append(GreedyStep(known, choice, add(known, choice)))
        known = steps[-1].after
    return steps


def best_of(left: Array, now: float) -> int | None:
    """The row of what leaves least of a deviation, of those (C,) that candidates leave; None if that is little less."""
    best = int(np.argmin(left))
    return best if left[best] <= LITTLE_GAIN * now else None


@dataclass(frozen=True, eq=False)
class Exchange(Generic[Choice]):
    """How a list of choices that reaches a goal is made a shorter and better one that does."""

    is_met: Callable[[tuple[Choice, ...]], bool]
    left: Callable[[tuple[Choice, ...]], float]  # the deviation
    another: Callable[[tuple[Choice, ...]], Choice | None]  # the best one beside others
    fewest: int

    def improved(self, chosen: tuple[Choice, ...]) -> tuple[Choice, ...]:
        """Choices left out, and others put in their place."""
        chosen = self._without_spare(chosen)
        for _ in range(ROUNDS):
            before = chosen
            for number in range(len(chosen)):
                if (best := self.another((*chosen[:number], *chosen[number + 1 :]))) is not None:
                    swapped = (*chosen[:number], best, *chosen[number + 1 :])
                    is_better = self.left(swapped) < WORTH_A_SWAP * self.left(chosen)
                    chosen = swapped if is_better and self.is_met(swapped) else chosen
            chosen = self._without_spare(chosen)
            if chosen == before:
                break
        return chosen

    def _without_spare(self, chosen: tuple[Choice, ...]) -> tuple[Choice, ...]:
        """Without those that are not needed, the least useful first."""
        while len(chosen) > self.fewest:
            fewer = [(*chosen[:number], *chosen[number + 1 :]) for number in range(len(chosen))]
            met = [some for some in fewer if self.is_met(some)]
            if not met:
                break
            chosen = min(met, key=self.left)
        return chosen
