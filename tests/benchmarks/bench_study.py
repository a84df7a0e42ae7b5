"""How fast a study's samples are kept: `run_cases` into a study's file, with one job and with two in turn.

Run from the repository's root: `python -m tests.benchmarks.bench_study [--samples N] [--rounds N] [--model NAME]`. The
scenes are those of `bench_bootstrap`. Every run starts its processes anew. The time of 3 x 10,000 samples is the time
until the first are kept plus that of the others, extrapolated. What two processes can be faster than one is measured
beside: two that compute chunks and nothing else, at the same moment, against one. The processor's time for a sample,
and what share of a core each process had, tell slower work (memory, caches) from waiting or a machine that is shared.
OpenCV solves 30 of the same samples in a plain loop, on one thread; of a target that is no plane it makes no first
guess, and is given the solution of all views.
"""

import argparse
import os
import resource
import time
from collections.abc import Iterator
from dataclasses import dataclass
from multiprocessing import get_context
from multiprocessing.queues import SimpleQueue
from multiprocessing.synchronize import Barrier
from pathlib import Path
from tempfile import TemporaryDirectory

from tests.benchmarks.bench_bootstrap import (  # sets one thread for all, before NumPy is loaded
    GOAL_RATIO,
    GOAL_S,
    MANY,
    OPENCV_SAMPLES,
    SIZES,
    TARGETS,
    Target,
    make,
    opencv_seconds,
)

import cv2  # isort: skip
from joblib.externals.loky import get_reusable_executor  # isort: skip

from calib.studies.bootstrap import Pool
from calib.studies.identity import StudyIdentity
from calib.studies.runner import run_cases
from calib.studies.samples import Case
from calib.studies.store import open_study
from calib.studies.workers import CaseSpec
from tests.benchmarks.synthetic import row

SEED = 0
JOBS = 2
GOAL_JOBS, GOAL_BYTES = 1.8, 1e9


@dataclass(frozen=True)
class Run:
    """One study from nothing to its end."""

    ready_s: float  # until the first samples were kept
    rate: float  # samples in a second, from then on
    processor_s: float  # of all its processes, for a sample, their start included
    share: float  # of a core, that each process had
    worker_bytes: int  # the most memory that one process of it has had

    @property
    def many_s(self) -> float:
        """Of 3 x 10,000 samples."""
        return self.ready_s + len(SIZES) * MANY / self.rate


@dataclass(frozen=True)
class Worker:
    """What a process has used until now."""

    processor_s: float
    peak_bytes: int


def cases_of(target: Target, pool: Pool, samples: int) -> tuple[CaseSpec, ...]:
    return tuple(CaseSpec(Case(target.name, size, pool.view_count), pool, samples) for size in SIZES)


def study(target: Target, pool: Pool, samples: int, jobs: int) -> Run:
    """Run a study in a folder that is thrown away, with processes of its own."""
    told: list[tuple[float, int]] = []
    identity = StudyIdentity(SEED, (), ())
    with TemporaryDirectory() as folder, open_study(Path(folder) / "study.sqlite", identity, resume=False) as kept:
        run_cases(
            cases_of(target, pool, samples), kept, jobs=jobs,
            on_progress=lambda done: told.append((time.perf_counter(), done)),
        )  # fmt: skip
    used = list(workers())
    get_reusable_executor().shutdown(wait=True, kill_workers=True)
    (begin, _), (first, some), (end, done) = told[0], told[1], told[-1]
    processor_s = sum(one.processor_s for one in used)
    return Run(
        first - begin, (done - some) / (end - first), processor_s / done, processor_s / (end - begin) / jobs,
        max(one.peak_bytes for one in used),
    )  # fmt: skip


def workers() -> Iterator[Worker]:
    """The processes of a study that this one has started."""
    for path in Path("/proc").glob("[0-9]*"):
        try:
            status = dict(line.split(":", 1) for line in (path / "status").read_text().splitlines())
            if int(status["PPid"]) == os.getpid() and b"popen_loky" in (path / "cmdline").read_bytes():
                user, system = (path / "stat").read_text().rsplit(")", 1)[1].split()[11:13]
                ticks = os.sysconf("SC_CLK_TCK")
                yield Worker((int(user) + int(system)) / ticks, 1024 * int(status["VmHWM"].split()[0]))
        except (OSError, KeyError):
            continue


@dataclass(frozen=True)
class Bare:
    """Processes that compute the samples and nothing else."""

    seconds: float  # of the slowest
    share: float  # of a core, that each had


def bare(target: Target, pool: Pool, samples: int, processes: int) -> Bare:
    """Some processes, each computes all samples."""
    context = get_context("spawn")
    barrier, answers = context.Barrier(processes), context.SimpleQueue()
    programs = [
        context.Process(target=compute, args=(target, pool, samples, barrier, answers)) for _ in range(processes)
    ]
    for program in programs:
        program.start()
    found: list[Bare] = [answers.get() for _ in programs]
    for program in programs:
        program.join()
    return Bare(max(one.seconds for one in found), mean(one.share for one in found))


def compute(target: Target, pool: Pool, samples: int, barrier: Barrier, answers: "SimpleQueue[Bare]") -> None:
    """Compute samples of all sizes when all others are ready to."""
    cases = cases_of(target, pool)
    for case in cases:
        pool.run(case.name, case.size, SEED, range(samples, samples + 2))
    barrier.wait()
    begin, used = time.perf_counter(), time.process_time()
    for case in cases:
        pool.run(case.name, case.size, SEED, range(samples))
    seconds = time.perf_counter() - begin
    answers.put(Bare(seconds, (time.process_time() - used) / seconds))


def report(target: Target, model: str, samples: int, rounds: int) -> None:
    """The rows of a target and a model."""
    title = f"{target.name}, {model}"
    pool, pool_s = make(target, model)
    row(f"{title}: pool", "", f"{pool_s:.2f} s", f"{len(pool.observations.view)} observations")
    runs: dict[int, list[Run]] = {1: [], JOBS: []}
    bares: dict[int, list[Bare]] = {1: [], JOBS: []}
    for _ in range(rounds):
        for jobs in (1, JOBS):
            bares[jobs].append(bare(target, pool, samples, jobs))
            runs[jobs].append(study(target, pool, samples, jobs))
    for jobs, some in runs.items():
        rates = ", ".join(f"{run.rate:.0f}" for run in some)
        row(f"{title}: jobs {jobs}", "", f"{mean(run.rate for run in some):.0f} /s", f"{rates} samples/s")
        ready = mean(run.ready_s for run in some)
        row("  until the first samples are kept", "", f"{ready:.2f} s")
        processor = mean(1e3 * run.processor_s for run in some)
        share = mean(100 * run.share for run in some)
        row("  processor's time for a sample", "", f"{processor:.2f} ms", f"each process had {share:.0f} % of a core")
        memory = max(run.worker_bytes for run in some)
        row("  peak memory of a process", f"<= {GOAL_BYTES / 1e6:.0f} MB", f"{memory / 1e6:.0f} MB")
    many = {jobs: mean(run.many_s for run in some) for jobs, some in runs.items()}
    least = {jobs: mean(one.seconds for one in some) for jobs, some in bares.items()}
    had = {jobs: mean(100 * one.share for one in some) for jobs, some in bares.items()}
    rate = {jobs: mean(run.rate for run in some) for jobs, some in runs.items()}
    row(f"{title}: {JOBS} jobs against 1, {len(SIZES)} x {MANY}", f">= x {GOAL_JOBS}", f"x {many[1] / many[JOBS]:.2f}",
        f"x {rate[JOBS] / rate[1]:.2f} once they run")  # fmt: skip
    row(f"  {JOBS} processes that only compute, against one", "", f"x {JOBS * least[1] / least[JOBS]:.2f}",
        f"each had {had[JOBS]:.0f} % of a core, one had {had[1]:.0f} %")  # fmt: skip
    for jobs in runs:
        share = rate[jobs] * least[jobs] / (jobs * samples * len(SIZES))
        row(f"  jobs {jobs} against {jobs} that only compute", "", f"{100 * share:.1f} %")
    row(f"{title}: {len(SIZES)} x {MANY} with {JOBS} jobs", f"<= {GOAL_S:.0f} s", f"{many[JOBS]:.0f} s",
        f"{many[1]:.0f} s with 1")  # fmt: skip
    each = OPENCV_SAMPLES // len(SIZES)
    loop = MANY * sum(opencv_seconds(pool, case.name, case.size, each) for case in cases_of(target, pool))
    row(f"{title}: against a loop over OpenCV", f">= x {GOAL_RATIO:.0f}", f"x {loop / many[JOBS]:.0f}",
        f"loop {loop:.0f} s; x {loop / many[1]:.0f} with 1")  # fmt: skip


def mean(values: Iterator[float] | list[float]) -> float:
    numbers = list(values)
    return sum(numbers) / len(numbers)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--samples", type=int, default=500, help="of each size (default 500)")
    parser.add_argument("--rounds", type=int, default=2, help="of one job and two (default 2)")
    parser.add_argument("--model", default="luhmann", choices=("luhmann", "opencv"))
    parser.add_argument("--target", choices=[target.name for target in TARGETS], help="only this one")
    options = parser.parse_args()
    cv2.setNumThreads(1)
    for target in TARGETS:
        if options.target in (None, target.name):
            report(target, options.model, options.samples, options.rounds)
    print(f"peak memory of the program {resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024:.0f} MB")


if __name__ == "__main__":
    main()
