"""Run the samples of a study that are not there yet, whoever computes them and however often it is interrupted."""

import math
import time
from collections import deque
from collections.abc import Callable, Iterable, Iterator, Sequence
from contextlib import AbstractContextManager
from dataclasses import dataclass
from itertools import groupby
from pathlib import Path

import numpy as np

from calib.studies.identity import StudyIdentity
from calib.studies.samples import SampleResult, Samples, StoredCase, draw_counts, failed_sample
from calib.studies.store import Study, check_place, open_study, read_study
from calib.studies.workers import (
    CaseSpec,
    Chunk,
    Done,
    Lost,
    RunChunk,
    Workers,
    WorkersGoneError,
    processes,
    run_by_pool,
)
from designer.base.answer import StoppedError, Summary
from designer.base.errors import InputError
from designer.page.progress import Progress

STUDY_FILE = "study.sqlite"
CHUNK_S = 0.4
"""What a chunk is to take: little is lost with one, and sending it costs nothing beside."""
FIRST_CHUNK, LAST_CHUNK, MAX_CHUNK = 4, 4, 1000
HOPELESS = 3
"""So many samples one after the other that end their worker, and none that comes out: it is not the samples."""
Tell = Callable[[float], None]
"""Told how many are done."""


def after(before: float, tell: Tell) -> Tell:
    """Tells of the progress of a part, what came before it included."""
    return lambda done: tell(before + done)


class StudyStoppedError(StoppedError):
    """A person ended the run before its samples; what there is, is kept. One line that says how to go on."""

    def __init__(self, done: int, total: int) -> None:
        super().__init__(_kept("stopped", done, total), Summary({"samples": done, "asked": total}))


def _kept(reason: str, done: int, total: int) -> str:
    return f"{reason} after {done} of {total} samples, which are kept; go on with --resume"


def ask_cluster(dask: str | None, progress: Progress) -> None:
    """Refuse a cluster that cannot be used, by the address of its scheduler; None: there is none to ask."""
    if dask is not None:
        from calib.studies.dask_cluster import check_cluster

        progress("asking the cluster", 0, 0)
        check_cluster(dask)


@dataclass(frozen=True)
class DrawCount:
    """How many samples were computed, and how long that took."""

    new: int = 0
    before: int = 0  # that the folder had
    seconds: float = 0.0


@dataclass(frozen=True, eq=False)
class Sampling:
    """Where the samples of studies are kept, and who computes them."""

    folder: Path
    jobs: int  # processes on this machine
    dask: str | None  # address of a cluster's scheduler, which computes the samples instead
    resume: bool
    progress: Progress

    @property
    def path(self) -> Path:
        """Of the study's file."""
        return self.folder / STUDY_FILE

    def check(self, identity: StudyIdentity) -> None:
        """Refuse a place or a cluster that cannot be used, before there is much work behind us."""
        check_place(self.path, identity, resume=self.resume)
        ask_cluster(self.dask, self.progress)

    def run(
        self,
        identity: StudyIdentity,
        cases: Sequence[CaseSpec],
        *,
        file: str = STUDY_FILE,
        tell: Tell | None = None,
        chunk: int | None = None,
    ) -> DrawCount:
        """Compute the samples of cases that are missing.

        Args:
            identity: what makes it this study.
            cases: whose samples are wanted.
            file: of the study, below the folder.
            tell: told how many are done; None: the progress of the sampling.
            chunk: samples that are computed at a time; None: as many as take a moment.

        Raises:
            InputError: the file is there and `resume` is not asked for, or is of another study.
            StudyStoppedError: interrupted, or no workers are left; what there is, is kept.
        """
        total, start, there = sum(one.samples for one in cases), time.perf_counter(), list[int]()

        def told(done: int) -> None:
            there.append(done)  # the first time as many as the file had
            (self.progress("sampling", done, total) if tell is None else tell(done))

        path = self.folder / file
        path.parent.mkdir(parents=True, exist_ok=True)
        with open_study(path, identity, resume=self.resume) as study:
            run_cases(cases, study, jobs=self.jobs, dask=self.dask, on_progress=told, chunk=chunk)
        return DrawCount(there[-1] - there[0], there[0], time.perf_counter() - start)

    def run_one(
        self, identity: StudyIdentity, case: CaseSpec, *, file: str = STUDY_FILE, tell: Tell | None = None,
        chunk: int | None = None,
    ) -> tuple[Samples, DrawCount]:  # fmt: skip
        """As `run`, with all samples that there are of the one case then."""
        count = self.run(identity, [case], file=file, tell=tell, chunk=chunk)
        with read_study(self.folder / file) as study:
            return study.load(case.name), count


def run_cases(
    cases: Sequence[CaseSpec],
    study: Study,
    *,
    jobs: int,
    dask: str | None = None,
    on_progress: Callable[[int], None] = lambda done: None,
    run_chunk: RunChunk = run_by_pool,
    chunk: int | None = None,
) -> None:
    """Compute and keep the samples of each case that the study does not have.

    What a sample is depends on (seed, case, number) only, so the study's content does not depend on the rest.

    Args:
        cases: what is sampled; their names differ.
        study: where samples are kept.
        jobs: processes on this machine.
        dask: address of the scheduler of a cluster that is to do it instead.
        on_progress: told how many samples of all cases are done, those from before included.
        run_chunk: what computes samples; importable by workers.
        chunk: samples of a chunk; else as many as take a moment.

    Raises:
        InputError: numbers that make no sense, a file that cannot be written, a cluster that cannot be used, or no
            workers are left; what there is, is kept.
        StudyStoppedError: interrupted.
    """
    if jobs < 1:
        raise InputError(f"{jobs} jobs: give 1 or more")
    if len({case.name for case in cases}) < len(cases):
        raise ValueError("two cases have the same name")
    for case in cases:
        study.declare(StoredCase(case.case, case.pool.model, case.pool.value_count, case.pool.covariance))
    todo = _Todo(cases, [sorted(set(range(case.samples)) - study.done(case.name)) for case in cases], chunk)
    run = _Run(study, todo, total=sum(case.samples for case in cases), on_progress=on_progress)
    on_progress(run.done)
    if run.done == run.total:
        return
    try:
        with _workers(jobs, dask, study.identity.seed, run_chunk) as workers:
            run.to_the_end(workers)
    except KeyboardInterrupt:
        raise StudyStoppedError(run.done, run.total) from None
    except WorkersGoneError as error:
        raise InputError(_kept(f"{error}: stopped", run.done, run.total)) from None


def _workers(jobs: int, dask: str | None, seed: int, run_chunk: RunChunk) -> AbstractContextManager[Workers]:
    if dask is None:
        return processes(jobs, seed, run_chunk)
    from calib.studies.dask_cluster import dask_workers

    return dask_workers(dask, seed, run_chunk)


class _Todo:
    """The samples that are to be computed, cut into chunks as they are asked for."""

    def __init__(self, cases: Sequence[CaseSpec], missing: Sequence[Sequence[int]], chunk: int | None) -> None:
        self.count = sum(map(len, missing))  # not sent yet
        self._left = deque(
            Chunk(case, numbers) for case, some in zip(cases, missing, strict=True) for numbers in _ranges(some)
        )
        self._fixed = chunk
        self._sample_s: dict[str, float] = {}

    def next(self, capacity: int) -> Chunk | None:
        """The next chunk for one of so many who may ask; None if there is no more."""
        if not self._left:
            return None
        left = self._left.popleft()
        cut = self._size(left.case, capacity)
        if len(left.numbers) > cut:
            self._left.appendleft(Chunk(left.case, left.numbers[cut:]))
        chunk = Chunk(left.case, left.numbers[:cut])
        self.count -= len(chunk.numbers)
        return chunk

    def learn(self, done: Done) -> None:
        """Note how long a chunk took."""
        self._sample_s[done.chunk.case.name] = done.seconds / len(done.chunk.numbers)

    def _size(self, case: CaseSpec, capacity: int) -> int:
        """How many samples take a moment; fewer towards the end, so that all come to it together."""
        if self._fixed is not None:
            return self._fixed
        sample_s = self._sample_s.get(case.name)
        if sample_s is None:
            return FIRST_CHUNK
        fair = max(math.ceil(self.count / capacity), LAST_CHUNK)
        return max(1, min(int(CHUNK_S / max(sample_s, 1e-9)), fair, MAX_CHUNK))


def _ranges(numbers: Iterable[int]) -> Iterator[range]:
    """Ascending numbers as ranges without gaps."""
    for _, run in groupby(enumerate(numbers), lambda pair: pair[1] - pair[0]):
        found = [number for _, number in run]
        yield range(found[0], found[-1] + 1)


class _Run:
    """One run: what is out, what is suspected of killing workers, and what has been kept."""

    def __init__(self, study: Study, todo: _Todo, *, total: int, on_progress: Callable[[int], None]) -> None:
        self._study, self._todo, self._on_progress = study, todo, on_progress
        self.total = total
        self.done = total - todo.count
        self._out = 0
        self._suspects: deque[Chunk] = deque()
        self._failures: list[tuple[CaseSpec, SampleResult]] = []  # samples that ended their workers
        self._alone: Chunk | None = None  # the suspect that is computed while nothing else is
        self._any_good = False

    def to_the_end(self, workers: Workers) -> None:
        """Send, receive and keep until nothing is left.

        When a worker dies, each of the chunks that were out may have done it. They are computed again one by one, and
        one that does it then sample by sample: so no sample is blamed for another.
        """
        while True:
            self._send(workers)
            if not self._out:
                break
            for answer in workers.receive():
                self._out -= 1
                if isinstance(answer, Done):
                    self._keep(answer)
                else:
                    self._consider(answer)
            if not self._out:
                self._alone = None
        self._keep_failures()

    def _send(self, workers: Workers) -> None:
        if self._suspects or self._alone:
            if not self._out:
                self._alone = self._suspects.popleft()
                workers.send(self._alone)
                self._out += 1
            return
        while self._out < (capacity := workers.capacity()):
            chunk = self._todo.next(capacity)
            if chunk is None:
                return
            workers.send(chunk)
            self._out += 1

    def _keep(self, answer: Done) -> None:
        self._todo.learn(answer)
        self._any_good = True
        self._add(answer.chunk.case, answer.results)
        self._keep_failures()

    def _consider(self, lost: Lost) -> None:
        """Try again, unless it is one sample that is to blame for certain."""
        case, numbers = lost.chunk.case, lost.chunk.numbers
        if lost.is_crash and lost.chunk is not self._alone:
            self._suspects.append(lost.chunk)
        elif len(numbers) > 1:
            self._suspects.extend(Chunk(case, range(number, number + 1)) for number in numbers)
        else:
            self._fail(case, numbers[0], lost.reason)

    def _fail(self, case: CaseSpec, number: int, reason: str) -> None:
        counts = draw_counts(self._study.identity.seed, case.name, number, case.size, case.pool.view_count)
        distinct = int(np.count_nonzero(counts))
        self._failures.append((case, failed_sample(number, distinct, case.pool.value_count, reason)))
        if self._any_good:
            self._keep_failures()
        elif len(self._failures) == HOPELESS:
            # Keeping these would spoil the study for a fault of the machine.
            raise WorkersGoneError(f"every sample fails ({reason})")

    def _keep_failures(self) -> None:
        for case, result in self._failures:
            self._add(case, [result])
        self._failures.clear()

    def _add(self, case: CaseSpec, results: list[SampleResult]) -> None:
        self._study.add(case.name, results)
        self.done += len(results)
        self._on_progress(self.done)
