"""Programs in processes and process groups of their own: every test starts them here, and they run this checkout."""

import os
import subprocess
import sys
from pathlib import Path
from typing import IO

from tests.support.waiting import WITHIN_S

ROOT = Path(__file__).parents[2]
PYTHON = sys.executable


def start(
    *words: object,
    cwd: str | Path | None = None,
    stdout: int | IO[str] = subprocess.PIPE,
    stderr: int = subprocess.PIPE,
    **environment: str,
) -> subprocess.Popen[str]:
    """Start a program, as a terminal starts it; what it says is to be read, or sent elsewhere."""
    return subprocess.Popen(
        list(map(str, words)), cwd=cwd, stdin=subprocess.PIPE, stdout=stdout, stderr=stderr, text=True,
        start_new_session=True, env={**os.environ, "PYTHONPATH": str(ROOT), **environment},
    )  # fmt: skip


def run(
    *words: object, cwd: str | Path | None = None, check: bool = True, **environment: str
) -> subprocess.CompletedProcess[str]:
    """Run a program to its end, which must be a good one but without `check`."""
    return subprocess.run(
        list(map(str, words)), cwd=cwd, stdin=subprocess.DEVNULL, capture_output=True, text=True, check=check,
        timeout=WITHIN_S, start_new_session=True, env={**os.environ, "PYTHONPATH": str(ROOT), **environment},
    )  # fmt: skip


def group_is_alive(group: int) -> bool:
    """Whether any process of a group is left."""
    try:
        os.killpg(group, 0)
    except ProcessLookupError:
        return False
    return True


def modules_loaded_by(code: str) -> set[str]:
    """Names of all modules that a fresh interpreter has after this code."""
    return set(run(PYTHON, "-c", f"import sys\n{code}\nprint(); print(*sys.modules)").stdout.splitlines()[-1].split())
