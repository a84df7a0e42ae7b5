"""Stand-ins for the computation of bootstrap samples, quick or troublesome, and a study in a program of its own."""

import os
import signal
import sys
import time
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from calib.solver.problem import SolveOptions
from calib.studies.bootstrap import Pool, make_pool
from calib.studies.samples import Case, SampleErrors, SampleResult, draw_counts
from calib.studies.workers import CaseSpec

# What workers do not need is imported where it is used: tests start many of them.
if TYPE_CHECKING:
    from calib.studies.identity import StudyIdentity

SEED = 5
SAMPLES = 60
FIRST = Case("board", 8, 10).name


def identity() -> "StudyIdentity":
    """Of all studies here."""
    from calib.studies.identity import StudyIdentity

    return StudyIdentity(SEED, (("model", "pinhole"),), (("detections", "0" * 64),))


def small_pool() -> Pool:
    """Ten views of a small board."""
    from tests.support.solver_scenes import CAMERAS, board, observe, poses_around

    rng = np.random.default_rng(1)
    camera, points = CAMERAS["pinhole"], board(6, 5, 30.0)
    return make_pool(
        observe(camera, points, poses_around(10, rng), rng, noise_px=0.05), "pinhole", SolveOptions(), None
    )


def cases_of(pool: Pool, samples: int = SAMPLES) -> tuple[CaseSpec, ...]:
    """Two cases of a pool."""
    return tuple(CaseSpec(Case("board", size, pool.view_count), pool, samples) for size in (8, 20))


def made_up(pool: Pool, case: str, size: int, seed: int, number: int, message: str = "") -> SampleResult:
    """A sample with numbers that depend on what they must depend on."""
    counts = draw_counts(seed, case, number, size, pool.view_count)
    numbers = np.abs(np.random.default_rng([number, size, *counts.tolist()]).normal(size=8)).tolist()
    distinct = int(np.count_nonzero(counts))
    return SampleResult(number, "converged", distinct, tuple(numbers[4:]), 3, message, SampleErrors(*numbers[:3]))


def quick(pool: Pool, case: str, size: int, seed: int, numbers: range) -> list[SampleResult]:
    """At once."""
    return [made_up(pool, case, size, seed, number) for number in numbers]


def slow(pool: Pool, case: str, size: int, seed: int, numbers: range) -> list[SampleResult]:
    """As `quick`, in time to be disturbed."""
    time.sleep(0.02 * len(numbers))
    return quick(pool, case, size, seed, numbers)


def revealing(pool: Pool, case: str, size: int, seed: int, numbers: range) -> list[SampleResult]:
    """Says which process has worked, on which copy of the pool, with how many threads at most."""
    from threadpoolctl import threadpool_info

    threads = max(library["num_threads"] for library in threadpool_info())
    time.sleep(0.005)
    return [made_up(pool, case, size, seed, number, f"{os.getpid()} {id(pool)} {threads}") for number in numbers]


def deadly(deaths: frozenset[int], pool: Pool, case: str, size: int, seed: int, numbers: range) -> list[SampleResult]:
    """Some samples of the first case kill the process that computes them."""
    if case == FIRST and deaths & set(numbers):
        os.kill(os.getpid(), signal.SIGKILL)
    return quick(pool, case, size, seed, numbers)


def deadly_once(mark: Path, pool: Pool, case: str, size: int, seed: int, numbers: range) -> list[SampleResult]:
    """The first process that comes to sample 30 dies."""
    if 30 in numbers and not mark.exists():
        mark.touch()
        os.kill(os.getpid(), signal.SIGKILL)
    return quick(pool, case, size, seed, numbers)


def faulty(faults: frozenset[int], pool: Pool, case: str, size: int, seed: int, numbers: range) -> list[SampleResult]:
    """Some samples raise an error."""
    if faults & set(numbers):
        raise ArithmeticError("no\nsuch number")
    return quick(pool, case, size, seed, numbers)


def slow_or_revealing(reveal: bool, *arguments: object) -> list[SampleResult]:
    """One after the other."""
    slow(*arguments)  # type: ignore[arg-type]
    return (revealing if reveal else quick)(*arguments)  # type: ignore[arg-type]


def main() -> int:
    """Run the study in the file named first, as a command would."""
    from calib.studies.runner import StudyStoppedError, run_cases
    from calib.studies.store import open_study

    with open_study(Path(sys.argv[1]), identity(), resume=True) as study:
        try:
            run_cases(
                cases_of(small_pool()), study, jobs=2, chunk=3,
                run_chunk=partial(slow_or_revealing, len(sys.argv) > 2),
                on_progress=lambda done: print(done, flush=True),
            )  # fmt: skip
        except StudyStoppedError as error:
            print(error, file=sys.stderr)
            return 130
    return 0


if __name__ == "__main__":
    sys.exit(main())
