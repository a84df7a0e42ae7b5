"""One choice after the other, and exchanges, of choices that are plain numbers."""

import numpy as np

from calib.judge.greedy import LITTLE_GAIN, Exchange, InformativeCandidates, best_of, one_by_one


def test_each_choice_is_by_what_is_known_with_those_before_it() -> None:
    """Information adds up, so that the direction that is known least comes next; it ends when more would do little."""
    told = np.array([[9.0, 0.0], [8.0, 0.0], [0.0, 4.0], [0.0, 1e-3]])

    def left(known: np.ndarray) -> float:
        return float(np.sqrt((1 / (1 + known)).sum()))

    def choose(known: np.ndarray) -> int | None:
        return best_of(np.array([left(known + one) for one in told]), left(known))

    steps = one_by_one(np.zeros(2), choose, lambda known, row: known + told[row], 20)
    assert [step.choice for step in steps[:2]] == [0, 2]
    assert all(left(step.after) <= LITTLE_GAIN * left(step.before) for step in steps)
    assert choose(steps[-1].after) is None
    assert len(one_by_one(np.zeros(2), choose, lambda known, row: known + told[row], 1)) == 1


def test_an_exchange_is_no_longer_and_still_reaches_the_goal() -> None:
    """What is not needed goes, the least useful first, a better one takes the place of a worse; never below fewest."""
    worth = (1, 2, 3, 4, 8)

    def total(rows: tuple[int, ...]) -> int:
        return sum(worth[row] for row in rows)

    def best_beside(rest: tuple[int, ...]) -> int | None:
        return max((row for row in range(len(worth)) if row not in rest), default=None)

    def exchange(goal: int, fewest: int) -> Exchange[int]:
        return Exchange(lambda rows: total(rows) >= goal, lambda rows: 1 / (1 + total(rows)), best_beside, fewest)

    assert sorted(exchange(8, 1).improved((0, 1, 2, 3))) == [4]
    assert sorted(exchange(8, 2).improved((0, 1, 2, 3))) == [3, 4]
    assert len(exchange(10, 4).improved((0, 1, 2, 3))) == 4


def test_candidates_that_tell_of_some_unknowns_are_weighed_as_by_the_whole_information() -> None:
    """The first leaves least of the weakest things, what is known after it is the inverse of all; none comes twice."""
    rng = np.random.default_rng(0)
    is_told = np.arange(6) // 2 != np.array([0, 1, 2, 0])[:, None]
    half = rng.normal(size=(4, 6, 5)) * is_told[:, :, None]
    information, moves = half @ half.transpose(0, 2, 1), rng.normal(size=(3, 2, 6))
    covariance = np.diag([1.0, 4.0, 0.5, 2.0, 9.0, 0.0])  # the last is fixed
    steps = InformativeCandidates.by(information, is_told).chosen(covariance, moves, 9)
    root = np.sqrt(covariance)
    after = [root @ np.linalg.inv(np.eye(6) + root @ one @ root) @ root for one in information]
    left = [np.einsum("ndi,ij,ndj->n", moves, one, moves) ** 2 for one in after]
    assert steps[0].choice == int(np.argmin([one.sum() for one in left]))
    assert np.allclose(steps[0].after.covariance, after[steps[0].choice], atol=1e-12)
    assert 2 <= len(steps) == len({step.choice for step in steps})
