import socket
import subprocess
import sys
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

import pytest

from calib.studies import dask_cluster, identity
from calib.studies.bootstrap import Pool
from calib.studies.runner import run_cases
from calib.studies.store import open_study
from designer.base.errors import InputError
from tests.calib.studies.test_study_runner import content, expected
from tests.support.programs import start
from tests.support.study_chunks import SEED, cases_of, slow, small_pool
from tests.support.study_chunks import identity as study_identity
from tests.support.waiting import WITHIN_S

SAMPLES = 30


@pytest.fixture(scope="module")
def pool() -> Pool:
    return small_pool()


@dataclass(frozen=True)
class Cluster:
    """A scheduler and its workers, programs of their own."""

    address: str
    scheduler: subprocess.Popen[str]
    workers: list[subprocess.Popen[str]]


def dask(what: str, *arguments: str) -> subprocess.Popen[str]:
    command = [
        sys.executable,
        "-m",
        f"distributed.cli.dask_{what}",
        *arguments,
        "--host",
        "127.0.0.1",
        "--no-dashboard",
    ]
    return start(*command, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)


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
        patch.setattr(identity, "_version", lambda name: "0.0")
        with pytest.raises(InputError, match=r"here it is 0.0; install the same there"):  # noqa: SIM117
            with dask_cluster.dask_workers(cluster.address, SEED, slow):
                pass

    told: list[int] = []

    def kill_one(done: int) -> None:
        told.append(done)
        if done > 20:
            cluster.workers[0].kill()

    with open_study(tmp_path / "s", study_identity(), resume=True) as study:
        run_cases(cases_of(pool), study, samples=SAMPLES, seed=SEED, jobs=1, dask=cluster.address, run_chunk=slow,
                  chunk=3, on_progress=kill_one)  # fmt: skip
    assert cluster.workers[0].wait(1) < 0
    assert cluster.workers[1].poll() is None
    assert told[-1] == 2 * SAMPLES
    assert content(tmp_path / "s") == expected(pool, SAMPLES)


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

    with open_study(tmp_path / "s", study_identity(), resume=True) as study:
        with pytest.raises(InputError, match=r"no workers.* of 60 samples, which are kept") as stopped:
            run_cases(cases_of(pool), study, samples=SAMPLES, seed=SEED, jobs=1, dask=cluster.address, run_chunk=slow,
                      chunk=3, on_progress=kill_all)  # fmt: skip
        kept = len(content(tmp_path / "s"))
        assert 20 < kept < 60
        assert f"after {kept} of 60" in str(stopped.value)
        with pytest.raises(InputError, match=r"has no workers; start some with `dask worker tcp:"):
            run_cases(cases_of(pool), study, samples=SAMPLES, seed=SEED, jobs=1, dask=cluster.address)


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
