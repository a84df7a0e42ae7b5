"""Studies that run in many processes, here or on a cluster: what is kept whatever happens to them."""

import os
import signal
import socket
import sqlite3
import subprocess
import sys
from collections import defaultdict
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from functools import partial
from pathlib import Path

import numpy as np
import pytest

from calib.studies import dask_cluster
from calib.studies import identity as identities
from calib.studies.bootstrap import Pool
from calib.studies.runner import run_cases
from calib.studies.samples import draw_counts, row_of
from calib.studies.store import open_study, read_study
from calib.studies.workers import RunChunk, run_by_pool
from designer.base.errors import InputError
from tests.support.programs import PYTHON, group_is_alive, start
from tests.support.study_chunks import (
    FIRST,
    SAMPLES,
    SEED,
    cases_of,
    deadly,
    deadly_once,
    faulty,
    identity,
    quick,
    revealing,
    slow,
    small_pool,
)
from tests.support.waiting import WITHIN_S, wait_until


@pytest.fixture(scope="module")
def pool() -> Pool:
    return small_pool()


def content(path: Path) -> list[tuple[object, ...]]:
    """All rows of all samples."""
    connection = sqlite3.connect(path)
    rows = connection.execute('SELECT * FROM sample ORDER BY "case", number').fetchall()
    connection.close()
    return rows


def expected(pool: Pool, samples: int, run: RunChunk = quick) -> list[tuple[object, ...]]:
    """The rows of a study that nothing disturbed, computed in this process."""
    return sorted(
        (case.name, *row_of(result, 4))
        for case in cases_of(pool)
        for result in run(pool, case.name, case.size, SEED, range(samples))
    )


def run_in(path: Path, pool: Pool, run: RunChunk, *, samples: int = SAMPLES, jobs: int = 2, chunk: int | None = 3,
           on_progress: Callable[[int], None] = lambda done: None) -> list[tuple[object, ...]]:  # fmt: skip
    """Run or go on with a study; its content then."""
    with open_study(path, identity(), resume=True) as study:
        run_cases(cases_of(pool, samples), study, jobs=jobs, run_chunk=run, chunk=chunk,
                  on_progress=on_progress)  # fmt: skip
    return content(path)


def test_real_samples_do_not_depend_on_jobs_and_chunks(pool: Pool, tmp_path: Path) -> None:
    """Bootstrap samples are the same to the last bit for any number of processes and any size of chunk."""
    plain = expected(pool, 30, run_by_pool)
    assert run_in(tmp_path / "a", pool, run_by_pool, samples=30, jobs=1, chunk=7) == plain
    assert run_in(tmp_path / "b", pool, run_by_pool, samples=30, jobs=2, chunk=1) == plain
    assert run_in(tmp_path / "c", pool, run_by_pool, samples=30, jobs=2, chunk=None) == plain


def test_more_samples_are_added(pool: Pool, tmp_path: Path) -> None:
    """A study that is given more samples computes those that it lacks, and says how far it is from the start."""
    told: list[int] = []
    run_in(tmp_path / "s", pool, quick, samples=10)
    with open_study(tmp_path / "s", identity(), resume=True) as study:
        study.connection.execute("DELETE FROM sample WHERE number IN (3, 4, 8)")
    assert run_in(tmp_path / "s", pool, quick, samples=25, on_progress=told.append) == expected(pool, 25)
    assert told[0] == 14
    assert told[-1] == 50
    assert told == sorted(told)


def test_a_finished_study_is_not_computed_again(pool: Pool, tmp_path: Path) -> None:
    """With all samples there, no worker is asked."""
    run_in(tmp_path / "s", pool, quick, samples=5)
    assert run_in(tmp_path / "s", pool, partial(deadly, frozenset(range(5))), samples=5) == expected(pool, 5)


def test_all_come_to_the_end_together(pool: Pool, tmp_path: Path) -> None:
    """Chunks are as long as a moment lasts, but no process is left with the last long one while others wait."""
    told: list[int] = []
    run_in(tmp_path / "s", pool, quick, samples=200, chunk=None, on_progress=told.append)
    length = np.diff(told)
    assert length.sum() == 400
    assert length.max() > 50
    assert length[-3:].min() < 10  # a process that was held up may be the last with its long one


def test_one_pool_and_one_thread_for_each_process(pool: Pool, tmp_path: Path) -> None:
    """However many chunks, each process reads the pool once; its linear algebra has one thread."""
    rows = run_in(tmp_path / "s", pool, revealing, chunk=1)
    pools: dict[str, set[str]] = defaultdict(set)
    for row in rows:
        process, copy, threads = str(row[-1]).split()
        pools[process].add(copy)
        assert threads == "1"
    assert len(pools) == 2
    assert str(os.getpid()) not in pools
    assert [len(copies) for copies in pools.values()] == [1, 1]


def test_deadly_samples_are_recorded_and_nobody_else(pool: Pool, tmp_path: Path) -> None:
    """A sample that kills its process every time is kept as failed, with the reason; all others come out."""
    deaths = frozenset((11, 12))
    rows = run_in(tmp_path / "s", pool, partial(deadly, deaths), samples=20, jobs=1)  # two chunks are out
    blamed = [(FIRST, number) for number in sorted(deaths)]
    assert [row[:2] for row in rows if row[2] == "failed"] == blamed
    assert [row for row in rows if row[:2] not in blamed] == [
        row for row in expected(pool, 20) if row[:2] not in blamed
    ]
    with read_study(tmp_path / "s") as study:
        samples = study.load(FIRST)
        assert "SIGKILL" in samples.message[11]
        assert np.isnan(samples.metrics[11]).all()
        assert np.isnan(samples.params[11]).all()
        assert samples.distinct_views[11] == np.count_nonzero(draw_counts(SEED, FIRST, 11, 8, 10))


def test_a_process_that_dies_by_chance_costs_nothing(pool: Pool, tmp_path: Path) -> None:
    """The chunks of a process that dies once are computed by another."""
    rows = run_in(tmp_path / "s", pool, partial(deadly_once, tmp_path / "mark"))
    assert (tmp_path / "mark").exists()
    assert rows == expected(pool, SAMPLES)


def test_a_sample_with_an_error_is_recorded(pool: Pool, tmp_path: Path) -> None:
    """An error in a sample is kept as that sample's message, in one line."""
    rows = run_in(tmp_path / "s", pool, partial(faulty, frozenset((4,))), samples=20)
    assert [row[-1] for row in rows if row[1] == 4] == ["ArithmeticError: no such number"] * 2
    assert [row for row in rows if row[1] != 4] == [row for row in expected(pool, 20) if row[1] != 4]


def test_a_machine_that_fails_every_sample_spoils_nothing(pool: Pool, tmp_path: Path) -> None:
    """If no sample comes out at all, the run ends with the reason, and none is kept as failed."""
    with pytest.raises(InputError, match=r"every sample fails \(Arithm.* after 0 of 40 samples"):
        run_in(tmp_path / "s", pool, partial(faulty, frozenset(range(20))), samples=20)
    assert content(tmp_path / "s") == []


@pytest.mark.parametrize(
    ("numbers", "message"), [({"samples": 0}, "0 samples"), ({"jobs": 0}, "0 jobs"), ({"jobs": -1}, "-1 jobs")]
)
def test_numbers_without_sense_are_refused(pool: Pool, tmp_path: Path, numbers: dict[str, int], message: str) -> None:
    """No samples and no processes: one line."""
    with pytest.raises(InputError, match=message):
        run_in(tmp_path / "s", pool, quick, **numbers)


def started(path: Path, *more: str) -> subprocess.Popen[str]:
    """The study as a program, in a group of its own, its progress on standard output."""
    return start(PYTHON, "-m", "tests.support.study_chunks", path, *more)


def wait_for(program: subprocess.Popen[str], done: int) -> None:
    """Read the progress up to some samples."""
    for line in program.stdout:
        if int(line) >= done:
            return
    raise AssertionError(program.communicate())


def is_alive(process: int) -> bool:
    """Whether a process runs; one that has ended and was not asked how does not."""
    try:
        return Path(f"/proc/{process}/stat").read_text().rsplit(")", 1)[1].split()[0] != "Z"
    except (FileNotFoundError, ProcessLookupError):
        return False


def test_killed_again_and_again(pool: Pool, tmp_path: Path) -> None:
    """SIGKILL at any moment, any number of times, and the study's content in the end is that of an undisturbed run.

    The processes it started leave soon after it.
    """
    path = tmp_path / "s"
    workers: set[int] = set()
    for share in (0.1, 0.5):
        program = started(path, "reveal")
        wait_for(program, int(share * 2 * SAMPLES))
        program.kill()
        program.communicate()
        with read_study(path) as study:
            workers |= {int(text.split()[0]) for case in study.cases() for text in study.load(case.case.name).message}
    assert 0 < len(content(path)) < 2 * SAMPLES
    wait_until(lambda: not any(map(is_alive, workers)))
    assert [row[:-1] for row in run_in(path, pool, quick)] == [row[:-1] for row in expected(pool, SAMPLES)]


def test_interrupted(pool: Pool, tmp_path: Path) -> None:
    """Ctrl-C ends the program and its processes with one line that says how to go on, and what is done is kept."""
    program = started(tmp_path / "s")
    wait_for(program, 30)
    os.killpg(program.pid, signal.SIGINT)
    _, errors = program.communicate(timeout=WITHIN_S)
    assert program.returncode == 130
    kept = len(content(tmp_path / "s"))
    assert errors == f"stopped after {kept} of 120 samples, which are kept; go on with --resume\n"
    assert 30 <= kept < 120
    wait_until(lambda: not group_is_alive(program.pid))
    assert run_in(tmp_path / "s", pool, quick) == expected(pool, SAMPLES)


FEW = 30


@dataclass(frozen=True)
class Cluster:
    """A scheduler and its workers, programs of their own."""

    address: str
    scheduler: subprocess.Popen[str]
    workers: list[subprocess.Popen[str]]


def dask(what: str, *arguments: str) -> subprocess.Popen[str]:
    words = ("-m", f"distributed.cli.dask_{what}", *arguments, "--host", "127.0.0.1", "--no-dashboard")
    return start(PYTHON, *words, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)


def free_port() -> int:
    with socket.socket() as taken:
        taken.bind(("127.0.0.1", 0))
        return int(taken.getsockname()[1])


@pytest.fixture(scope="module")
def scheduler() -> Iterator[Cluster]:
    """A scheduler over loopback, and the workers that `cluster` gives it."""
    pytest.importorskip("distributed", reason="Dask is not installed: ringsolid[cluster]")
    port = free_port()
    running = Cluster(f"tcp://127.0.0.1:{port}", dask("scheduler", "--port", str(port)), [])
    try:
        yield running
    finally:
        for program in (*running.workers, running.scheduler):
            program.kill()
            program.wait()


@pytest.fixture
def cluster(scheduler: Cluster) -> Cluster:
    """The scheduler with two workers."""
    distributed = pytest.importorskip("distributed", reason="Dask is not installed: ringsolid[cluster]")
    scheduler.workers[:] = [worker for worker in scheduler.workers if worker.poll() is None]
    while len(scheduler.workers) < 2:
        scheduler.workers.append(dask("worker", scheduler.address, "--nthreads", "1", "--no-nanny"))
    with distributed.Client(scheduler.address, timeout=WITHIN_S) as client:
        client.wait_for_workers(2, timeout=WITHIN_S)
    return scheduler


def test_a_worker_is_killed(cluster: Cluster, pool: Pool, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Two workers, one of them killed amid the run: the study's content is that of a run on this machine.

    If their programs are other versions than here, so that last digits may differ, they are refused.
    """
    with monkeypatch.context() as patch:
        patch.setattr(identities, "_version", lambda name: "0.0")
        with pytest.raises(InputError, match=r"here it is 0.0; install the same there"):  # noqa: SIM117
            with dask_cluster.dask_workers(cluster.address, SEED, slow):
                pass

    told: list[int] = []

    def kill_one(done: int) -> None:
        told.append(done)
        if done > 20:
            cluster.workers[0].kill()

    with open_study(tmp_path / "s", identity(), resume=True) as study:
        run_cases(cases_of(pool, FEW), study, jobs=1, dask=cluster.address, run_chunk=slow,
                  chunk=3, on_progress=kill_one)  # fmt: skip
    assert cluster.workers[0].wait(1) < 0
    assert cluster.workers[1].poll() is None
    assert told[-1] == 2 * FEW
    assert content(tmp_path / "s") == expected(pool, FEW)


def test_a_cluster_that_goes_away(
    cluster: Cluster, pool: Pool, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Without workers, a run waits for new ones for a while; it ends in one line, and what is done is kept."""
    monkeypatch.setattr(dask_cluster, "PATIENCE_S", 0.5)
    monkeypatch.setattr(dask_cluster, "LOOK_S", 0.2)

    def kill_all(done: int) -> None:
        if done > 20:
            for worker in cluster.workers:
                worker.kill()

    with open_study(tmp_path / "s", identity(), resume=True) as study:
        with pytest.raises(InputError, match=r"no workers.* of 60 samples, which are kept") as stopped:
            run_cases(cases_of(pool, FEW), study, jobs=1, dask=cluster.address, run_chunk=slow,
                      chunk=3, on_progress=kill_all)  # fmt: skip
        kept = len(content(tmp_path / "s"))
        assert 20 < kept < 60
        assert f"after {kept} of 60" in str(stopped.value)
        with pytest.raises(InputError, match=r"has no workers; start some with `dask worker tcp:"):
            run_cases(cases_of(pool, FEW), study, jobs=1, dask=cluster.address)


@pytest.mark.parametrize("address", ["closed", "mute", "nonsense", "", "tcp://", "http://a:1", "tcp://a b:\n1"])
def test_no_scheduler_there(address: str, monkeypatch: pytest.MonkeyPatch) -> None:
    """An address without a scheduler, or with a server that never answers, is refused in one line."""
    pytest.importorskip("distributed", reason="Dask is not installed: ringsolid[cluster]")
    assert dask_cluster.CONNECT_S <= 10
    monkeypatch.setattr(dask_cluster, "CONNECT_S", 0.3)
    with socket.socket() as mute:
        mute.bind(("127.0.0.1", 0))
        mute.listen()
        place = {"closed": f"tcp://127.0.0.1:{free_port()}", "mute": f"tcp://127.0.0.1:{mute.getsockname()[1]}"}
        with pytest.raises(InputError, match=r"^no Dask scheduler at .*; start one with `dask scheduler`"):  # noqa: SIM117
            with dask_cluster.dask_workers(place.get(address, address), SEED, slow):
                pass


def test_without_dask(monkeypatch: pytest.MonkeyPatch) -> None:
    """Where Dask is not installed, one line says what to install."""
    monkeypatch.setitem(sys.modules, "distributed", None)
    with pytest.raises(InputError, match=r'pip install "ringsolid\[cluster\]"'):  # noqa: SIM117
        with dask_cluster.dask_workers("tcp://127.0.0.1:1", SEED, slow):
            pass
