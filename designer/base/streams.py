"""Standard output and error: for people, for programs, and for readers that leave early."""

import io
import os
import sys
from collections.abc import Iterator
from contextlib import contextmanager, redirect_stdout, suppress
from typing import TextIO

OUT, ERR = 1, 2
"""What the operating system calls them."""


class _Forgiving(io.TextIOWrapper):
    """A stream whose reader may leave, as in `calib ... | head -1`: the work goes on, and nobody hears the rest.

    So it does where the disk that the words go to is full, but that is no one's wish: `failure` says so at the end.
    """

    failure = ""

    def write(self, text: str, /) -> int:
        try:
            return super().write(text)
        except OSError as error:
            return self._unheard(len(text), error)

    def flush(self) -> None:
        try:
            super().flush()
        except OSError as error:
            self._unheard(0, error)

    def _unheard(self, count: int, error: OSError) -> int:
        """Lead nowhere from now on, what is still in the buffer included."""
        if not isinstance(error, BrokenPipeError):
            self.failure = error.strerror or str(error)
        nowhere = os.open(os.devnull, os.O_WRONLY)
        os.dup2(nowhere, self.fileno())
        os.close(nowhere)
        return count


def forgive_readers() -> None:
    """Let the readers of this program's standard output and error leave before its end."""
    if sys.stdout is sys.__stdout__ and sys.stdout is not None:
        sys.stdout = _forgiving(sys.stdout, OUT)
    if sys.stderr is sys.__stderr__ and sys.stderr is not None:
        sys.stderr = _forgiving(sys.stderr, ERR)


def not_heard() -> str:
    """Why standard output could not be written to its end; "" if it was, or nobody wished to hear it."""
    if not isinstance(sys.stdout, _Forgiving):
        return ""
    sys.stdout.flush()
    return sys.stdout.failure


def _forgiving(stream: TextIO, number: int) -> TextIO:
    stream.flush()
    return _Forgiving(
        open(number, "wb", closefd=False),  # open to the end of the program
        encoding=stream.encoding,
        errors=stream.errors,
        line_buffering=number == ERR or stream.isatty(),
    )


@contextmanager
def people_on_stderr() -> Iterator[None]:
    """Standard output is kept for a program: what is printed meanwhile goes to standard error.

    That of child processes and of compiled libraries too, which know nothing of `sys.stdout`.
    """
    if sys.stdout is not None:
        sys.stdout.flush()
    kept: int | None = None
    with suppress(OSError):  # one of them is closed
        kept = os.dup(OUT)
        os.dup2(ERR, OUT)
    try:
        with redirect_stdout(sys.stderr):
            yield
    finally:
        if kept is not None:
            os.dup2(kept, OUT)
            os.close(kept)
