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

from designer.base.arrays import Array, Flags, Rows

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


ROUNDING = 1e-12
"""Of the largest eigenvalue of what a candidate tells: what is less is nothing."""


@dataclass(frozen=True, eq=False)
class KnownAfter:
    """What is known of Q unknowns with what was chosen."""

    covariance: Array  # (Q, Q)
    chosen: tuple[int, ...] = ()


@dataclass(frozen=True, eq=False)
class InformativeCandidates:
    """What each of K candidates tells of some of Q unknowns: information G G'."""

    rows: Rows  # (K, S) of the unknowns
    root: Array  # (K, S, R) G; zero in rows that only fill up

    @staticmethod
    def by(information: Array, is_told: Flags) -> "InformativeCandidates":
        """Of information (K, Q, Q) on the unknowns (K, Q) that each tells of."""
        rows = np.argsort(~is_told, axis=1, kind="stable")[:, : int(is_told.sum(axis=1).max(initial=0))]
        fills = ~np.take_along_axis(is_told, rows, axis=1)
        some = np.take_along_axis(information, rows[:, :, None], axis=1)
        some = np.take_along_axis(some, rows[:, None, :], axis=2)
        value, axis = np.linalg.eigh(np.where(fills[:, :, None] | fills[:, None, :], 0.0, some))
        length = np.sqrt(np.where(value > ROUNDING * value[:, -1:], value, 0.0))
        return InformativeCandidates(rows, axis * length[:, None, :])

    def gained(self, moves: Array, covariance: Array) -> Array:
        """H of `J S J' - H H'`, what is known of J q with each: `J S G (1 + G' S G)^-1/2`.  # (K, M, R)

        Args:
            moves: J (M, Q).
            covariance: S, of what is known without (Q, Q).
        """
        inner = self.root.transpose(0, 2, 1) @ covariance[self.rows[:, :, None], self.rows[:, None, :]] @ self.root
        value, axis = np.linalg.eigh(np.eye(inner.shape[1]) + inner)
        half = self.root @ (axis / np.sqrt(value.clip(min=1.0))[:, None, :])
        gained: Array = (moves @ covariance)[:, self.rows].transpose(1, 0, 2) @ half
        return gained

    def chosen(self, covariance: Array, moves: Array, most: int) -> list[GreedyStep[KnownAfter, int]]:
        """Candidates one after the other, none twice: one would hide again what is wrong in it.

        Least is to be the fourth root of the mean fourth power, so that what is known worst counts most, of deviations.

        Args:
            covariance: of the unknowns as they are known (Q, Q).
            moves: how they move D numbers of N things (N, D, Q), of each of which the deviation is that of its length.
            most: candidates at most.
        """
        flat = moves.reshape(-1, moves.shape[2])

        def deviation(variance: Array) -> Array:
            each = variance.reshape(*variance.shape[:-1], *moves.shape[:2]).sum(axis=-1).clip(min=0.0)
            return np.asarray((each**2).mean(axis=-1) ** 0.25)

        def choose(known: KnownAfter) -> int | None:
            now = ((flat @ known.covariance) * flat).sum(axis=1)
            left = deviation(now - (self.gained(flat, known.covariance) ** 2).sum(axis=2))
            left[list(known.chosen)] = np.inf
            return best_of(left, float(deviation(now)))

        def add(known: KnownAfter, row: int) -> KnownAfter:
            one = InformativeCandidates(self.rows[row : row + 1], self.root[row : row + 1])
            gained = one.gained(np.eye(len(known.covariance)), known.covariance)[0]
            return KnownAfter(known.covariance - gained @ gained.T, (*known.chosen, row))

        return one_by_one(KnownAfter(covariance), choose, add, most)
