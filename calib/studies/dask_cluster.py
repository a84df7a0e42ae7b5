"""Samples computed on a Dask cluster: the same work, sent to other machines."""

import asyncio
import logging
import time
import warnings
from collections.abc import Iterator, Sequence
from concurrent.futures import CancelledError
from contextlib import contextmanager
from typing import TYPE_CHECKING

from calib.studies.identity import Pairs, program_versions
from calib.studies.samples import SampleResult
from calib.studies.workers import (
    Answer,
    Chunk,
    Done,
    Lost,
    RunChunk,
    SamplePool,
    WorkersGoneError,
    compute,
    in_one_line,
)
from designer.base.errors import InputError
from designer.base.words import shown

if TYPE_CHECKING:
    from distributed import Client, Future

CONNECT_S = 8.0
ANSWER_S = 20.0
"""A cluster that says nothing on a plain question for so long is not well."""
LOOK_S = 1.0
PATIENCE_S = 60.0
"""Workers that were lost may come back within."""


class DaskWorkers:
    """The workers of a cluster; a pool is sent once to each of them."""

    def __init__(self, client: "Client", seed: int, run_chunk: RunChunk) -> None:
        self._client, self._seed, self._run_chunk = client, seed, run_chunk
        self._out: dict[Future, Chunk] = {}
        self._pool: tuple[SamplePool, Future] | None = None
        self._threads, self._looked = 0, float("-inf")
        self._last_seen = time.monotonic()

    def capacity(self) -> int:
        """One chunk more for each thread of the cluster than it computes."""
        return max(2 * self._thread_count(), 1)

    def send(self, chunk: Chunk) -> None:
        """Have a chunk computed."""
        case = chunk.case
        future = self._client.submit(
            _compute_on_one_thread, self._run_chunk, self._future_of(case.pool), case.name, case.size, self._seed,
            chunk.numbers, pure=False,
        )  # fmt: skip
        self._out[future] = chunk

    def receive(self) -> Sequence[Answer]:
        """What has come back.

        Raises:
            WorkersGoneError: the scheduler is lost, or has had no workers for a while.
        """
        from distributed import wait

        while True:
            self._require_cluster()
            try:
                found = wait(list(self._out), timeout=LOOK_S, return_when="FIRST_COMPLETED")
                # One at a time: an answer in hand must not be lost when the next one is waited for in vain.
                return [self._answer(next(iter(found.done)))]
            except TimeoutError:
                continue
            except CancelledError:
                raise WorkersGoneError("the scheduler has lost the work; see that it runs well") from None

    def _answer(self, future: "Future") -> Answer:
        from distributed import KilledWorker

        chunk = self._out[future]
        error = future.exception(timeout=ANSWER_S) if future.status == "error" else None
        if error is None:
            # If the worker dies before it has sent the results, they are computed again, and waited for again.
            results, seconds = future.result(timeout=ANSWER_S)
            answer: Answer = Done(chunk, results, seconds)
        elif isinstance(error, KilledWorker):
            answer = Lost(chunk, "its worker died, again and again", is_crash=True)
        else:
            answer = Lost(chunk, in_one_line(error), is_crash=False)
        del self._out[future]
        return answer

    def _require_cluster(self) -> None:
        """Stop if there is no scheduler, or nobody who works for it."""
        if self._client.status != "running":
            raise WorkersGoneError("the connection to the scheduler is lost; see that it runs")
        if self._thread_count():
            self._last_seen = time.monotonic()
        elif time.monotonic() - self._last_seen > PATIENCE_S:
            raise WorkersGoneError("the cluster has no workers any more; start some with dask worker")

    def _thread_count(self) -> int:
        """Threads of all workers, asked for now and then."""
        if time.monotonic() - self._looked > LOOK_S:
            try:
                self._threads = sum(self._client.nthreads().values())
            except (OSError, TimeoutError, RuntimeError):  # a connection that ends is seen by its status
                self._threads = 0
            self._looked = time.monotonic()
        return self._threads

    def _future_of(self, pool: SamplePool) -> "Future":
        """A pool on the cluster.

        It is part of the work rather than data: so the scheduler has it, and can send it again when all workers that
        held it are lost.
        """
        if self._pool is None or self._pool[0] is not pool:
            with warnings.catch_warnings():
                warnings.filterwarnings("ignore", message="Sending large graph")
                self._pool = pool, self._client.submit(_same, pool, pure=False)
        return self._pool[1]


@contextmanager
def dask_workers(address: str, seed: int, run_chunk: RunChunk) -> Iterator[DaskWorkers]:
    """The workers of the cluster with a scheduler at this address.

    Raises:
        InputError: Dask is not installed, the scheduler cannot be reached or has no workers, or these have other
            versions of the programs.
    """
    with _connected(address) as client:
        yield DaskWorkers(client, seed, run_chunk)


def check_cluster(address: str) -> None:
    """Refuse a cluster that could not be used, by the address of its scheduler."""
    with _connected(address):
        pass


@contextmanager
def _connected(address: str) -> "Iterator[Client]":
    """A cluster that can be used. Work that is still out ends with the connection that asked for it."""
    client = _connect(address)
    try:
        _require_same_programs(client, address)
        yield client
    finally:
        client.close(timeout=2)


def _connect(address: str) -> "Client":
    try:
        from distributed import Client
    except ImportError:
        raise InputError('--dask needs Dask, which is not installed; pip install "ringsolid[cluster]"') from None

    # What it has to say of lost connections and workers, we say in one line.
    logging.getLogger("distributed").setLevel(logging.CRITICAL + 1)
    try:
        # Asked first whether it is one: a client waits forever for a server that is none and says nothing.
        asyncio.run(asyncio.wait_for(_greet(address), CONNECT_S))
        return Client(address, timeout=CONNECT_S)
    except (OSError, TimeoutError, ValueError, RuntimeError, TypeError, ImportError) as error:
        reason = next(iter(str(error).splitlines()), "") or f"no answer within {CONNECT_S:g} s"
        raise InputError(
            f"no Dask scheduler at {shown(address)}: {reason[:200]}; start one with `dask scheduler`, and give its "
            "address, such as tcp://host:8786"
        ) from None


async def _greet(address: str) -> None:
    """Ask whoever is at an address whether it is a scheduler."""
    from distributed import Security
    from distributed.comm import connect

    comm = await connect(address, timeout=CONNECT_S, **Security().get_connection_args("client"))
    try:
        await comm.write({"op": "identity", "reply": True})
        answer = await comm.read()
    finally:
        comm.abort()
    if not isinstance(answer, dict) or answer.get("type") != "Scheduler":
        raise ValueError("something else is there")


def _require_same_programs(client: "Client", address: str) -> None:
    """Refuse a cluster whose results could differ in the last digits, or that has none to give."""
    try:
        found = client.run(program_versions, on_error="return")
    except (OSError, TimeoutError, RuntimeError) as error:
        raise InputError(f"the cluster at {address} does not answer: {in_one_line(error)}; see that it runs") from None
    if not found:
        raise InputError(f"the scheduler at {address} has no workers; start some with `dask worker {address}`")
    here: Pairs = program_versions()
    for worker, versions in found.items():
        if isinstance(versions, BaseException):
            raise InputError(
                f"worker {worker} cannot do this work: {in_one_line(versions)}; install ringsolid[cluster] there"
            )
        for (name, ours), (_, theirs) in zip(here, versions, strict=True):
            if ours != theirs:
                raise InputError(f"worker {worker} has {name} {theirs}, and here it is {ours}; install the same there")


def _same(pool: SamplePool) -> SamplePool:
    """The pool; computing this is what brings it to a worker."""
    return pool


def _compute_on_one_thread(
    run_chunk: RunChunk, pool: SamplePool, case: str, size: int, seed: int, numbers: range
) -> tuple[list[SampleResult], float]:
    """Results of a chunk, all linear algebra of the worker's process on one thread for good.

    A worker may compute several chunks at once: a limit that each sets and lifts would be lifted under the others.
    """
    from threadpoolctl import threadpool_limits

    threadpool_limits(1)
    return compute(run_chunk, pool, case, size, seed, numbers)
