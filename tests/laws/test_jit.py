"""Kernels whose machine code is kept on disk."""

import importlib
import sys
from pathlib import Path
from types import ModuleType

import pytest


@pytest.fixture(autouse=True)
def _own_cache(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """A cache and modules of a test's own; no file of the same second is taken for the same."""
    monkeypatch.setenv("RINGSOLID_CACHE", str(tmp_path / "cache"))
    monkeypatch.syspath_prepend(tmp_path)
    monkeypatch.setattr(sys, "dont_write_bytecode", True)


CALLEE = "from calib.core.jit import jit\nLIMIT = {limit}\n\n\n@jit\ndef inner(x):\n    return x + {added}\n"
KERNEL = (
    "from calib.core.jit import jit\nfrom kernels_inner import LIMIT, inner\n\n\n@jit\ndef outer(x):\n"
    "    return inner(x) + LIMIT\n"
)


def imported(*names: str) -> ModuleType:
    """The last of some modules, as a program finds them that starts with such files."""
    for name in names:
        sys.modules.pop(name, None)
    importlib.invalidate_caches()
    return importlib.import_module(names[-1])


def outer_of(folder: Path, added: int, limit: int) -> tuple[int, int]:
    """What the kernel returns in a program that starts with such files, and how often it found its code on disk."""
    (folder / "kernels_inner.py").write_text(CALLEE.format(added=added, limit=limit))
    kernel = imported("kernels_inner", "kernels_outer").outer
    return kernel(1), sum(kernel.stats.cache_hits.values())


def test_code_is_kept_until_anything_in_it_changes(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """A kernel of an unchanged file is compiled again if a kernel that it calls, or a constant, changes elsewhere."""
    (tmp_path / "kernels_outer.py").write_text(KERNEL)
    assert outer_of(tmp_path, 10, 200) == (211, 0)
    (tmp_path / "kernels_inner.py").touch()
    assert outer_of(tmp_path, 30, 200) == (231, 0)
    assert outer_of(tmp_path, 30, 400) == (431, 0)
    state = (tmp_path / "kernels_inner.py").stat()
    monkeypatch.setattr(Path, "write_text", lambda *_: 0)  # nothing changes
    assert outer_of(tmp_path, 30, 400) == (431, 1)
    assert (tmp_path / "kernels_inner.py").stat().st_mtime_ns == state.st_mtime_ns


def test_options_and_what_modules_hold_are_part_of_the_code(tmp_path: Path) -> None:
    """Code is made anew if the way of compiling changes, or a constant or a kernel that is reached through a module."""
    kernel = "import kernels_callee\nfrom calib.core.jit import {way} as jit\n\n\n@jit\ndef through(x):\n"
    kernel += "    return kernels_callee.inner(x) + kernels_callee.LIMIT\n"

    def through(added: int, limit: int, way: str) -> tuple[int, int]:
        (tmp_path / "kernels_callee.py").write_text(CALLEE.format(added=added, limit=limit))
        (tmp_path / "kernels_through.py").write_text(kernel.format(way=way))
        compiled = imported("kernels_callee", "kernels_through").through
        return compiled(1), sum(compiled.stats.cache_hits.values())

    assert through(10, 200, "jit") == (211, 0)
    assert through(30, 200, "jit") == (231, 0)
    assert through(30, 400, "jit") == (431, 0)
    assert through(30, 400, "jit") == (431, 1)
    assert through(30, 400, "jit_sums") == (431, 0)


def test_code_for_a_class_of_another_name_is_made_anew(tmp_path: Path) -> None:
    """Code on disk of an earlier version, whose arguments had classes that are gone, is not even looked at."""
    for name in ("Pair", "Couple"):
        (tmp_path / "kernels_pair.py").write_text(
            "from typing import NamedTuple\nfrom calib.core.jit import jit\n\n\n"
            f"class {name}(NamedTuple):\n    x: int\n\n\n"
            f"@jit\ndef double(pair):\n    return 2 * pair.x\n\n\nPAIR = {name}(4)\n"
        )
        module = imported("kernels_pair")
        assert module.double(module.PAIR) == 8
