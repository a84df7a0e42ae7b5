"""Who computes samples: chunks go out, answers come back in any order; here, the processes of this machine."""

import os
import pickle
import re
import tempfile
import time
from abc import ABC, abstractmethod
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import FIRST_COMPLETED, Future, wait
from contextlib import contextmanager
from dataclasses import dataclass
from functools import lru_cache
from pathlib import Path
from typing import TYPE_CHECKING, ClassVar, Protocol

import numpy as np

from calib.core.parallel import interrupts_held, one_thread, serve
from calib.studies.samples import Case, SampleResult
from designer.base.arrays import Array
from designer.base.errors import InputError

if TYPE_CHECKING:
    from joblib.externals.loky import ProcessPoolExecutor


class SamplePool(ABC):
    """What samples are drawn from; it is pickled to be sent to workers."""

    @property
    @abstractmethod
    def view_count(self) -> int:
        """How many views there are."""

    @property
    @abstractmethod
    def model(self) -> str:
        """What its samples' values are: the name of a camera model, or of a kind of study."""

    @property
    @abstractmethod
    def value_count(self) -> int:
        """How many values a sample has beside the four errors."""

    @property
    def covariance(self) -> Array:
        """(P, P) of the values in the solution of all views; (0, 0) if there is none."""
        return np.zeros((0, 0))

    @abstractmethod
    def run(self, case: str, size: int, seed: int, numbers: range) -> list[SampleResult]:
        """The samples of some numbers, each a function of this, case, size, seed and number alone."""


@dataclass(frozen=True, eq=False)
class ValuePool(SamplePool):
    """A pool whose samples have values with names, and hang on seed and number alone."""

    kind: ClassVar[str]  # of the values
    values: ClassVar[tuple[str, ...]]

    @property
    def model(self) -> str:
        """The kind of values."""
        return self.kind

    @property
    def value_count(self) -> int:
        """How many."""
        return len(self.values)

    @one_thread
    def run(self, case: str, size: int, seed: int, numbers: range) -> list[SampleResult]:
        """The samples of some numbers."""
        del case, size
        return [self.sample(seed, number) for number in numbers]

    @abstractmethod
    def sample(self, seed: int, number: int) -> SampleResult:
        """One sample."""


RunChunk = Callable[[SamplePool, str, int, int, range], list[SampleResult]]
"""Pool, case, size, seed, numbers."""


def run_by_pool(pool: SamplePool, case: str, size: int, seed: int, numbers: range) -> list[SampleResult]:
    """As the pool does it."""
    return pool.run(case, size, seed, numbers)


ONE_THREAD = dict.fromkeys(("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS", "NUMBA_NUM_THREADS"), "1")
IDLE_S = 20.0
HAND_ON_S = 2.0
LOKY_CODES = re.compile(r"exit codes of the workers are \{(.*?)\}")


@dataclass(frozen=True, eq=False)
class CaseSpec:
    """What is sampled, what of, and how often."""

    case: Case
    pool: SamplePool
    samples: int

    def __post_init__(self) -> None:
        if self.samples < 1:
            raise InputError(f"{self.samples} samples: give 1 or more")
        if self.size < 1:
            raise InputError(f"size {self.size}: draw 1 view or more for a sample")
        if self.case.pool != self.pool.view_count:
            raise ValueError(f"{self.case.name}: of {self.case.pool} views, but the pool has {self.pool.view_count}")

    @property
    def name(self) -> str:
        """Of the case."""
        return self.case.name

    @property
    def size(self) -> int:
        """Views drawn for a sample."""
        return self.case.size


@dataclass(frozen=True, eq=False)
class Chunk:
    """Some samples of a case."""

    case: CaseSpec
    numbers: range


@dataclass(frozen=True, eq=False)
class Done:
    """The results of a chunk."""

    chunk: Chunk
    results: list[SampleResult]
    seconds: float  # that it took the worker


@dataclass(frozen=True, eq=False)
class Lost:
    """A chunk without results: its worker died or an error ended it."""

    chunk: Chunk
    reason: str  # one line
    is_crash: bool  # of the worker: with several chunks out, any of them may be the cause


Answer = Done | Lost


class WorkersGoneError(Exception):
    """There is nobody left to compute; one line that says why and what to do."""


class Workers(Protocol):
    """Somebody who computes chunks."""

    def capacity(self) -> int:
        """How many chunks keep all busy."""

    def send(self, chunk: Chunk) -> None:
        """Have a chunk computed."""

    def receive(self) -> Sequence[Answer]:
        """Answers to chunks sent, once there is at least one.

        Raises:
            WorkersGoneError: there will be none.
        """


def compute(
    run_chunk: RunChunk, pool: SamplePool, case: str, size: int, seed: int, numbers: range
) -> tuple[list[SampleResult], float]:
    """Results of a chunk, and the seconds that they took."""
    begin = time.perf_counter()
    return run_chunk(pool, case, size, seed, numbers), time.perf_counter() - begin


def in_one_line(error: BaseException) -> str:
    """What an error says, for a table."""
    return " ".join(f"{type(error).__name__}: {error}".split())[:300]


class Processes:
    """Processes of this machine, by joblib's loky; a pool is sent as a file that each of them reads once."""

    def __init__(self, jobs: int, seed: int, run_chunk: RunChunk, folder: Path) -> None:
        self._jobs, self._seed, self._run_chunk, self._folder = jobs, seed, run_chunk, folder
        self._out: dict[Future[tuple[list[SampleResult], float]], Chunk] = {}
        self._file: tuple[SamplePool, Path] | None = None
        self._files = 0

    def capacity(self) -> int:
        """One chunk more for each process than it computes, so that none waits."""
        return 2 * self._jobs

    def send(self, chunk: Chunk) -> None:
        """Have a chunk computed, by new processes if the last ones died."""
        from joblib.externals.loky.process_executor import BrokenProcessPool

        path = self._path_of(chunk.case.pool)
        with interrupts_held():
            try:
                future = self._submit(path, chunk)
            except BrokenProcessPool:  # they died between being asked for and being used
                future = self._submit(path, chunk)
            self._out[future] = chunk

    def receive(self) -> Sequence[Answer]:
        """What has come back."""
        return [self._answer(future) for future in wait(self._out, return_when=FIRST_COMPLETED).done]

    def end(self) -> None:
        """End the processes, whatever they do."""
        with interrupts_held():
            # A chunk that its thread has not handed on when it is ended would make it fail, and say so.
            last = time.monotonic() + HAND_ON_S
            while not all(future.running() or future.done() for future in self._out) and time.monotonic() < last:
                time.sleep(0.001)
            self._executor().shutdown(wait=True, kill_workers=True)

    def _executor(self) -> "ProcessPoolExecutor":
        """The processes: those of the run before, if they still live."""
        from joblib.externals.loky import get_reusable_executor

        # The fault handler is off: a crash is told in one line, not by a dump of the worker's threads.
        environment = {**ONE_THREAD, "PYTHONFAULTHANDLER": ""}
        executor: ProcessPoolExecutor = get_reusable_executor(
            self._jobs, timeout=IDLE_S, initializer=serve, initargs=(os.getpid(),), env=environment
        )
        return executor

    def _submit(self, path: Path, chunk: Chunk) -> "Future[tuple[list[SampleResult], float]]":
        case = chunk.case
        future: Future[tuple[list[SampleResult], float]] = self._executor().submit(
            _compute_from_file, self._run_chunk, path, case.name, case.size, self._seed, chunk.numbers
        )
        return future

    def _answer(self, future: "Future[tuple[list[SampleResult], float]]") -> Answer:
        from joblib.externals.loky.process_executor import BrokenProcessPool, TerminatedWorkerError

        chunk = self._out.pop(future)
        error = future.exception()
        if error is None:
            return Done(chunk, *future.result())
        if isinstance(error, TerminatedWorkerError):
            codes = LOKY_CODES.search(str(error))
            return Lost(chunk, f"its process died{f': {codes[1]}' if codes else ''}", is_crash=True)
        return Lost(chunk, in_one_line(error), is_crash=isinstance(error, BrokenProcessPool))

    def _path_of(self, pool: SamplePool) -> Path:
        """The file of a pool, written when its first chunk is sent."""
        if self._file is None or self._file[0] is not pool:
            self._files += 1
            path = self._folder / f"pool-{self._files}"
            path.write_bytes(pickle.dumps(pool, protocol=pickle.HIGHEST_PROTOCOL))
            self._file = pool, path
        return self._file[1]


@contextmanager
def processes(jobs: int, seed: int, run_chunk: RunChunk) -> Iterator[Processes]:
    """Processes that are ended at once if anything goes wrong; else they end when they have been idle for a while."""
    from joblib.externals.loky.backend import resource_tracker

    with tempfile.TemporaryDirectory(prefix="calib-study-") as folder:
        # The tracker is a process of its own: it removes the folder even if this program is killed.
        resource_tracker.register(folder, "folder")
        workers = Processes(jobs, seed, run_chunk, Path(folder))
        try:
            yield workers
        except BaseException:
            workers.end()
            raise
        finally:
            resource_tracker.unregister(folder, "folder")


@lru_cache(maxsize=1)
def _read_pool(path: Path) -> SamplePool:
    """A pool, kept for the next chunks."""
    pool: SamplePool = pickle.loads(path.read_bytes())  # noqa: S301 - our own, in a folder that nobody else may write
    return pool


def _compute_from_file(
    run_chunk: RunChunk, path: Path, case: str, size: int, seed: int, numbers: range
) -> tuple[list[SampleResult], float]:
    return compute(run_chunk, _read_pool(path), case, size, seed, numbers)
