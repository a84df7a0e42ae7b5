"""Kernels compiled ahead, side by side on all cores, in processes that fill the folder where they are kept.

>>> warm_up()  # all that the commands need; does nothing the second time

The kernels that the commands need, with the types of their arguments, by the part of the work that needs them first.

`kernels.txt` beside this file was written by running each part on a small example: a part's name, then a line a kernel,
after those that it calls. A kernel that is not in it is compiled when it is called, as any other.
"""

import os
import subprocess
import sys
import threading
import time
from collections.abc import Callable, Iterable, Mapping
from concurrent.futures import ThreadPoolExecutor
from contextlib import suppress
from dataclasses import dataclass
from functools import lru_cache
from pathlib import Path
from typing import cast

from numba.core import types
from numba.core.registry import cpu_target

from calib.core.kernel_cache import entry_name
from calib.core.kernel_code import Kernel, called_kernels, label, labelled, parsed_types
from calib.core.kernel_store import store

LIST = Path(__file__).with_name("kernels.txt")


@dataclass(frozen=True)
class Listed:
    """A kernel for some types of arguments: a line of the list."""

    name: str
    """`module:function`."""
    types_text: str

    @property
    def line(self) -> str:
        """As it stands in the list, and in an entry's first line."""
        return f"{self.name}({self.types_text})"

    @property
    def kernel(self) -> Kernel:
        """The kernel itself; its module is loaded.

        Raises:
            LookupError, ImportError, AttributeError, ValueError: the list is older than the sources.
        """
        return cast("Kernel", labelled(self.name))

    @property
    def arguments(self) -> tuple[types.Type, ...]:
        """The types of its arguments; raises as `kernel`."""
        return parsed_types(self.types_text)

    def is_kept(self) -> bool:
        """Whether its machine code, for this processor, is there; raises as `kernel`."""
        made_for = cpu_target.target_context.codegen().magic_tuple()
        return store().holds(entry_name(self.kernel, self.arguments, made_for))

    def compile(self) -> None:
        """Make and keep its machine code; raises as `kernel`."""
        self.kernel.compile(self.arguments)


def parse_line(line: str) -> Listed:
    """A line of the list."""
    name, _, rest = line.partition("(")
    return Listed(name, rest.removesuffix(")"))


def parse_list(text: str) -> Mapping[str, tuple[Listed, ...]]:
    """The lines of a list by part."""
    parts: dict[str, list[Listed]] = {}
    for line in filter(None, map(str.strip, text.splitlines())):
        if line.startswith("["):
            parts[line.strip("[]")] = []
        else:
            parts[next(reversed(parts))].append(parse_line(line))
    return {part: tuple(lines) for part, lines in parts.items()}


@lru_cache(maxsize=1)
def kernel_list() -> Mapping[str, tuple[Listed, ...]]:
    """The list that came with the sources, by part; empty if it is not there."""
    with suppress(OSError):
        return parse_list(LIST.read_text(encoding="utf-8"))
    return {}


def part_of(name: str) -> str | None:
    """The first part that needs a kernel."""
    parts = kernel_list().items()
    return next((part for part, lines in parts if any(line.name == name for line in lines)), None)


def missing(lines: Iterable[Listed]) -> tuple[Listed, ...]:
    """Those whose machine code is not kept; what the sources do not have any more is left out."""
    left = []
    for line in lines:
        with suppress(LookupError, ImportError, AttributeError, ValueError):
            if not line.is_kept():
                left.append(line)
    return tuple(left)


Told = Callable[[int, int, float], None]
"""Is called with how many kernels are ready, of how many, and about how many seconds the others take."""
ALONE = "RINGSOLID_COMPILE"
"""Set to `alone`, a process compiles each kernel itself, when it is called."""
MOST_PROCESSES, FEWEST_KERNELS = 8, 6
"""Fewer kernels are compiled before processes have started."""
SAID_EVERY_S = 4.0


def warm_up(parts: Iterable[str] | None = None, told: Told | None = None) -> int:
    """Compile the kernels that are not kept yet, on all cores: `calib.warm_up()`.

    Args:
        parts: of `kernels.txt`: detect, solve, ...; all by default.
        told: hears of the progress.

    Returns:
        how many kernels were missing.
    """
    wanted = kernel_list()
    lines = [line for part in (wanted if parts is None else parts) for line in wanted[part]]
    with store().locked():  # what another process compiles now need not be compiled twice
        left = missing(lines)
        if left:
            _Work(left, told or (lambda done, count, left_s: None)).run()
    return len(left)


def on_first_miss(kernel: Kernel, _: tuple[types.Type, ...]) -> bool:
    """A kernel is not kept: compile, on all cores, what the part of the work that it belongs to lacks.

    Returns:
        whether it may be kept now.
    """
    part = part_of(label(kernel.py_func))
    is_alone = os.environ.get(ALONE) == "alone" or getattr(sys, "frozen", False)
    return part is not None and not is_alone and _prepare(part)


@lru_cache(maxsize=64)
def _prepare(part: str) -> bool:
    """Compile a part, once a process: what is missing afterwards is compiled when it is called."""
    return len(missing(kernel_list()[part])) >= FEWEST_KERNELS and warm_up((part,), Teller()) > 0


class Teller:
    """Progress on standard error: a line that is written again on a terminal, elsewhere a line every few seconds."""

    def __init__(self) -> None:
        self._said_s = -SAID_EVERY_S
        self._is_terminal = sys.stderr is sys.__stderr__ and sys.stderr is not None and sys.stderr.isatty()

    def __call__(self, done: int, count: int, left_s: float) -> None:
        """Say how far it is."""
        now_s = time.monotonic()
        is_end = done == count
        if sys.stderr is None or (not self._is_terminal and (is_end or now_s - self._said_s < SAID_EVERY_S)):
            return
        self._said_s = now_s
        left = f", about {left_s:.0f} s left" if done and not is_end else ""
        line = f"preparing kernels, once on this machine: {done} of {count}{left}"
        end = "\n" if is_end or not self._is_terminal else ""
        start = "\r\033[K" if self._is_terminal else ""
        print(f"{start}{line}", end=end, file=sys.stderr, flush=True)


class _Work:
    """Kernels that are compiled by several processes, each after those that it calls."""

    def __init__(self, lines: tuple[Listed, ...], told: Told) -> None:
        self._told = told
        self._count = len(lines)
        self._waits_for = _waits_for(lines)
        self._begun: set[Listed] = set()
        self._done: set[Listed] = set()
        self._changed = threading.Condition()
        self._processes: list[subprocess.Popen[str]] = []
        self._start_s = time.monotonic()

    def run(self) -> None:
        """Compile all; if it is stopped, the processes end."""
        self._told(0, self._count, 0.0)
        cores = len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1
        try:
            for _ in range(max(1, min(cores, MOST_PROCESSES, self._count))):
                self._processes.append(_start())
            with ThreadPoolExecutor(len(self._processes)) as pool:
                try:
                    for served in [pool.submit(self._serve, process) for process in self._processes]:
                        served.result()
                except BaseException:
                    self._end()
                    raise
        except OSError:
            return  # no processes here: each kernel is compiled when it is called
        finally:
            self._end()

    def _end(self) -> None:
        for process in self._processes:
            process.kill()
            process.wait()

    def _serve(self, process: "subprocess.Popen[str]") -> None:
        """Give a process kernel after kernel, until none is left or the process is gone."""
        is_there = True
        while is_there and (line := self._next()) is not None:
            is_there = _compiles(process, line)
            with self._changed:
                self._done.add(line)  # or it failed, and fails again where it is called
                done = len(self._done)
                self._changed.notify_all()
                self._told(done, self._count, (time.monotonic() - self._start_s) * (self._count - done) / done)

    def _next(self) -> Listed | None:
        """A kernel whose callees are compiled; waits for one, and is None when all are begun."""
        with self._changed:
            while len(self._begun) < self._count:
                for line, callees in self._waits_for.items():
                    if line not in self._begun and callees <= self._done:
                        self._begun.add(line)
                        return line
                if self._begun == self._done:
                    return None  # kernels that call each other
                self._changed.wait()
            return None


def _compiles(process: "subprocess.Popen[str]", line: Listed) -> bool:
    """Have a process compile a kernel; whether it is still there afterwards."""
    if process.stdin is None or process.stdout is None:
        return False
    with suppress(OSError, ValueError):
        process.stdin.write(f"{line.line}\n")
        process.stdin.flush()
        return bool(process.stdout.readline())
    return False


def _waits_for(lines: tuple[Listed, ...]) -> Mapping[Listed, frozenset[Listed]]:
    """For each kernel those of the others that it calls."""
    by_name: dict[str, list[Listed]] = {}
    for line in lines:
        by_name.setdefault(line.name, []).append(line)
    return {
        line: frozenset(
            callee
            for called in called_kernels(line.kernel)
            for callee in by_name.get(label(called.py_func), ())
            if callee.name != line.name
        )
        for line in lines
    }


def _start() -> "subprocess.Popen[str]":
    """A process that compiles what it is told; Ctrl-C is not for it, and it ends with its standard input."""
    code = (
        f"import sys; sys.path[:] = {sys.path!r}; from calib.core.compile_ahead import compile_lines; compile_lines()"
    )
    return subprocess.Popen(  # noqa: S603  # this Python itself
        [sys.executable, "-c", code],
        stdin=subprocess.PIPE,
        stdout=subprocess.PIPE,
        stderr=subprocess.DEVNULL,
        text=True,
        env={**os.environ, ALONE: "alone"},
        start_new_session=True,
    )


def compile_lines() -> None:
    """Compile the kernels that standard input names, and say so, line by line."""
    for line in sys.stdin:
        with suppress(Exception):  # it is raised again where the kernel is called
            parse_line(line.strip()).compile()
        print("done", flush=True)
