"""Where compiled kernels are kept: found again by content, never read where others may write, and never in the way."""

import errno
import importlib
import logging
import os
import shutil
import sys
from pathlib import Path
from types import ModuleType

import pytest

from calib.core import compile_ahead, kernel_cache, kernel_store
from calib.core.compile_ahead import ALONE, FEWEST_KERNELS, Listed, Teller, kernel_list, parse_line, part_of, warm_up
from calib.core.kernel_code import label, parsed_types, types_text
from calib.core.kernel_store import SUFFIX, Store, read_entry, refusal
from tests.support.kernel_parts import PARTS
from tests.support.programs import PYTHON, run, start

ROOT = Path(__file__).parents[2]
MODULE = "kernels_of_law"
SOURCE = "from calib.core.jit import jit\n\n\n@jit\ndef inner(x):\n    return 2 * x\n\n\n@jit\ndef outer(x):\n"
SOURCE += "    return inner(x) + 1\n"
EVERY = [(part, line) for part, lines in kernel_list().items() for line in lines]


@pytest.fixture
def cache(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """An empty cache folder, and a kernel's module on the path."""
    monkeypatch.delenv("NUMBA_CACHE_DIR", raising=False)
    monkeypatch.setenv("RINGSOLID_CACHE", str(tmp_path / "cache"))
    monkeypatch.setattr(sys, "dont_write_bytecode", True)
    (tmp_path / f"{MODULE}.py").write_text(SOURCE)
    monkeypatch.syspath_prepend(tmp_path)
    return tmp_path / "cache/kernels"


def fresh() -> ModuleType:
    """The module, as a program that starts sees it."""
    sys.modules.pop(MODULE, None)
    importlib.invalidate_caches()
    return importlib.import_module(MODULE)


def entries(folder: Path) -> list[Path]:
    """What is kept in a folder."""
    return sorted(folder.glob(f"*{SUFFIX}"))


def hits(module: ModuleType) -> int:
    """How often the kernel's code was found."""
    return sum(module.outer.stats.cache_hits.values())


def test_a_copy_of_the_sources_with_new_times_compiles_nothing(tmp_path: Path) -> None:
    """What one clone has compiled serves another: entries are found by content, wherever and however old files are."""
    code = "import numpy; from calib.core.small_solve import cholesky_factor; cholesky_factor(numpy.eye(2))"
    environment = {"RINGSOLID_CACHE": str(tmp_path / "cache"), ALONE: "alone"}
    kept = []
    for name in ("one", "two"):
        for package in ("calib", "designer"):
            shutil.copytree(
                ROOT / package, tmp_path / name / package, ignore=shutil.ignore_patterns("__pycache__"),
                copy_function=shutil.copyfile,
            )  # fmt: skip
        place = {"PYTHONPATH": str(tmp_path / name), "PYTHONDONTWRITEBYTECODE": "1"}
        run(PYTHON, "-c", code, cwd=tmp_path, **environment, **place)
        kept.append({path: path.stat().st_mtime_ns for path in entries(tmp_path / "cache/kernels")})
    assert kept[0] == kept[1] != {}


def test_a_damaged_entry_is_none(cache: Path) -> None:
    """Whatever happened to an entry's file, the kernel is compiled again and the entry mended."""
    assert fresh().outer(1) == 3
    (path,) = (path for path in entries(cache) if path.name.startswith("outer"))
    whole = path.read_bytes()
    flipped = bytes([*whole[:-9], whole[-9] ^ 1, *whole[-8:]])
    for damaged in (b"", whole[:40], whole[: len(whole) // 2], flipped, b"x" * 200):
        path.write_bytes(damaged)
        assert read_entry(path) is None
        module = fresh()
        assert (module.outer(1), hits(module)) == (3, 0)
        assert path.read_bytes()[:32] != damaged[:32]
        assert read_entry(path) is not None
    module = fresh()
    assert (module.outer(1), hits(module)) == (3, 1)


def test_a_kept_kernel_serves_one_that_is_new(cache: Path) -> None:
    """A kernel that is compiled takes in one that is kept, as its code is read when somebody asks for it."""
    assert fresh().outer(1) == 3
    [outer] = [path for path in entries(cache) if path.name.startswith("outer")]
    outer.unlink()
    again = fresh()
    assert again.outer(2) == 5
    assert not hits(again)
    assert sum(again.inner.stats.cache_hits.values()) == 1


@pytest.mark.parametrize("why", ["is a file", "may be written by others"])
def test_a_folder_that_cannot_be_trusted_is_left_alone(
    cache: Path, why: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, caplog: pytest.LogCaptureFixture
) -> None:
    """A cache folder that is a file, or that others may write, is neither read nor written; that is said once."""
    monkeypatch.setattr("tempfile.tempdir", str(tmp_path))
    if why == "is a file":
        cache.parent.mkdir()
        cache.write_text("mine")
    else:
        assert fresh().outer(1) == 3
        cache.chmod(0o777)
    before = cache.stat().st_mtime_ns
    kernel_store._store.cache_clear()
    with caplog.at_level(logging.WARNING, "ringsolid"):
        module = fresh()
        assert (module.outer(1), hits(module)) == (3, 0)
        assert fresh().outer(1.5) == 4.0
    assert [record.message.count(why) for record in caplog.records] == [1]
    assert "RINGSOLID_CACHE names another folder" in caplog.text
    assert cache.stat().st_mtime_ns == before
    (elsewhere,) = tmp_path.glob("ringsolid-kernels-*")
    assert entries(elsewhere)
    assert elsewhere.stat().st_mode & 0o077 == 0


def test_a_new_folder_is_its_users_alone(cache: Path) -> None:
    """The folder is made with no rights for others, and is then trusted."""
    assert refusal(cache) is None
    assert cache.stat().st_mode & 0o077 == 0


def test_a_full_disk_costs_no_result(
    cache: Path, monkeypatch: pytest.MonkeyPatch, caplog: pytest.LogCaptureFixture
) -> None:
    """Where nothing can be kept, kernels run, it is said once, and no part of an entry is left."""

    def full(*_: object) -> None:
        raise OSError(errno.ENOSPC, "No space left on device")

    kernel_store._store.cache_clear()
    monkeypatch.setattr("os.replace", full)
    with caplog.at_level(logging.WARNING, "ringsolid"):
        assert fresh().outer(1) == 3
    assert [record.message.count("No space left on device") for record in caplog.records] == [1]
    assert list(cache.iterdir()) == []


def test_a_folder_that_is_gone_is_made_again(cache: Path) -> None:
    """Removed while a program runs, the folder is there again with the next kernel."""
    assert fresh().outer(1) == 3
    shutil.rmtree(cache)
    assert fresh().outer(1.5) == 4.0
    assert entries(cache)


def test_what_no_program_used_for_long_goes(tmp_path: Path) -> None:
    """Entries of long ago, and parts of a day ago, are deleted when another is written; files of others are not."""
    store = Store(tmp_path)
    names = [f"old{SUFFIX}", f"new{SUFFIX}", f".part{SUFFIX}.x", "notes.txt"]
    for name in names:
        (tmp_path / name).write_text("")
    long_ago = 1e9
    for name in (names[0], names[2], names[3]):
        os.utime(tmp_path / name, (long_ago, long_ago))
    store.write(f"next{SUFFIX}", b"held")
    assert {path.name for path in tmp_path.iterdir()} == {names[1], names[3], f"next{SUFFIX}"}
    assert store.read(f"next{SUFFIX}") == b"held"


@pytest.mark.parametrize(
    ("name", "value"), [("NUMBA_CACHE_DIR", "named"), ("NUMBA_DISABLE_JIT", "1")], ids=lambda value: value
)
def test_what_a_user_tells_numba_is_obeyed(cache: Path, name: str, value: str, tmp_path: Path) -> None:
    """`NUMBA_CACHE_DIR` is where entries go; with `NUMBA_DISABLE_JIT` kernels are plain functions and none are kept."""
    code = f"import {MODULE}; print({MODULE}.outer(1))"
    environment = {name: value, "PYTHONPATH": f"{tmp_path}{os.pathsep}{ROOT}"}
    done = run(PYTHON, "-c", code, cwd=tmp_path, **environment)
    assert (done.stdout, done.stderr) == ("3\n", "")
    assert bool(entries(tmp_path / "named")) == (name == "NUMBA_CACHE_DIR")
    assert not entries(cache)


def test_what_a_wheel_carries_is_used(cache: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Entries for the baseline that lie in the package serve any processor that has its features, and no other."""
    from llvmlite.binding import get_host_cpu_features

    has_all = all(get_host_cpu_features().get(feature, False) for feature in kernel_cache.BASELINE_FEATURES)
    made_for = {"NUMBA_CPU_NAME": kernel_cache.BASELINE, "NUMBA_CPU_FEATURES": kernel_cache.baseline_features()}
    environment = {**made_for, "PYTHONPATH": f"{tmp_path}{os.pathsep}{ROOT}"}
    code = f"import {MODULE}; {MODULE}.outer(1)"
    run(PYTHON, "-c", code, cwd=tmp_path, **environment)
    monkeypatch.setattr(kernel_cache, "CARRIED", cache.rename(tmp_path / "carried"))
    kernel_store._store.cache_clear()
    for is_able in sorted({False, has_all}):
        monkeypatch.setattr(kernel_cache, "_may_use_carried", lambda is_able=is_able: is_able)
        module = fresh()
        assert (module.outer(1), hits(module), len(entries(cache))) == (3, int(is_able), 0 if is_able else 2)
        shutil.rmtree(cache, ignore_errors=True)


# The list ----------------------------------------------------------------------------------------


@pytest.mark.parametrize("part", kernel_list())
def test_each_line_of_the_list_names_a_kernel(part: str) -> None:
    """A kernel of the list is there, and the text of its arguments' types is read as what it says."""
    for line in kernel_list()[part]:
        assert label(line.kernel.py_func) == line.name
        assert types_text(line.arguments) == line.types_text
        assert parse_line(line.line) == line
    assert len(kernel_list()[part]) == len(set(kernel_list()[part]))


def test_a_kernel_belongs_to_the_first_part_that_lists_it() -> None:
    """What several parts need is compiled with the first of them, and no line stands twice."""
    lines = [line for _, line in EVERY]
    assert len(lines) == len(set(lines))
    assert part_of(kernel_list()["detect"][0].name) == "detect"
    assert part_of("calib.core.se3:no_such") is None


def test_types_that_have_no_text_are_not_read() -> None:
    """A line that is none is refused, not evaluated."""
    for text in ("__import__('os')", "array(float64, 2", "<other>", "no_such_type", "named('os:path', (), int64)"):
        with pytest.raises((ValueError, SyntaxError, LookupError, AttributeError)):
            parsed_types(text)


def test_the_list_has_a_part_for_each_example() -> None:
    """The list was written by running the parts that there are, in their order."""
    assert list(kernel_list()) == list(PARTS)


# Ahead -------------------------------------------------------------------------------------------


def test_kernels_are_compiled_ahead_by_processes(
    cache: Path, monkeypatch: pytest.MonkeyPatch, capfd: pytest.CaptureFixture[str]
) -> None:
    """What is missing is compiled by other processes and counted; then nothing is, and the kernel finds its code."""
    lines = (Listed(f"{MODULE}:outer", "int64"), Listed(f"{MODULE}:inner", "int64"), Listed("gone:away", "int64"))
    monkeypatch.setattr("calib.core.compile_ahead.kernel_list", lambda: {"law": lines})
    fresh()
    heard: list[tuple[int, int]] = []
    assert warm_up(told=lambda done, count, left_s: heard.append((done, count))) == 2
    assert heard == [(0, 2), (1, 2), (2, 2)]
    assert warm_up(told=Teller()) == 0
    module = fresh()
    assert (module.outer(1), hits(module)) == (3, 1)
    assert capfd.readouterr() == ("", "")


def test_a_process_that_ends_holds_nobody_up(cache: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Where one of two processes is gone, the other does not wait for what that one was to compile."""
    lines = tuple(Listed(f"{MODULE}:{name}", kind) for name in ("outer", "inner") for kind in ("int64", "float64"))
    monkeypatch.setattr("calib.core.compile_ahead.kernel_list", lambda: {"law": lines})
    monkeypatch.setattr("os.sched_getaffinity", lambda _: {0, 1}, raising=False)
    gone = start(PYTHON, "-c", "")
    gone.wait()
    processes = [gone, compile_ahead._start()]
    monkeypatch.setattr("calib.core.compile_ahead._start", lambda: processes.pop(0))
    assert warm_up() == len(lines)
    assert entries(cache)
    assert fresh().outer(1) == 3


def test_progress_is_said_in_lines(capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch) -> None:
    """Off a terminal: a line at the beginning and every few seconds, with how many of how many, and how long yet."""
    now = [0.0]
    monkeypatch.setattr("time.monotonic", lambda: now[0])
    tell = Teller()
    for now[0], done in ((0.0, 0), (1.0, 20), (4.5, 31), (5.0, 88)):
        tell(done, 88, 19.6)
    said = "preparing kernels, once on this machine: "
    assert capsys.readouterr().err == f"{said}0 of 88\n{said}31 of 88, about 20 s left\n"
    assert len(kernel_list()["detect"]) > FEWEST_KERNELS
