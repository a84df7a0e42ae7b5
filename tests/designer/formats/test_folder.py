"""Writing a folder: all files or none."""

import errno
import os
from collections.abc import Callable
from pathlib import Path

import pytest

from designer.base.errors import InputError
from designer.formats.folder import OutputFile, write_folder

FILES = (
    OutputFile("a.stl", b"ringsolid binary STL: new a", "a"),
    OutputFile("b.3mf", b"ringsolid binary STL: new b" * 100_000, "b"),
    OutputFile("c.png", b"", "nothing"),
)


def contents(folder: Path) -> dict[str, bytes | None]:
    """Everything in a folder, hidden files too; None for a folder."""
    return {path.name: path.read_bytes() if path.is_file() else None for path in folder.iterdir()}


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    """A folder with files of an earlier run and one of somebody else's."""
    folder = tmp_path / "out"
    folder.mkdir()
    for name in ("a.stl", "b.3mf", "notes.txt"):
        (folder / name).write_bytes(f"ringsolid binary STL: old {name}".encode())
    return folder


def test_files_are_written_and_others_left(folder: Path) -> None:
    """New files come in place of old ones; what is not among them stays, and nothing else is left behind."""
    write_folder(folder, FILES)
    assert contents(folder) == {
        **{file.name: file.content for file in FILES},
        "notes.txt": b"ringsolid binary STL: old notes.txt",
    }


def fails_with(code: int) -> Callable[..., None]:
    def fail(*_: object, **__: object) -> None:
        raise OSError(code, os.strerror(code))

    return fail


def assert_refused_and_intact(folder: Path, message: str, files: tuple[OutputFile, ...] = FILES) -> None:
    before = contents(folder)
    with pytest.raises(InputError, match=message) as raised:
        write_folder(folder, files)
    assert len(str(raised.value).splitlines()) == 1
    assert "None" not in str(raised.value)
    assert contents(folder) == before


def test_full_disk_leaves_the_earlier_files(folder: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """When the disk is full at the second file, no file has changed and no temporary file is left."""
    opened = Path.open
    written = []

    def open_until_full(path: Path, mode: str = "r", *args: object) -> object:
        if "x" in mode:
            written.append(path)
            if len(written) == 2:
                fails_with(errno.ENOSPC)()
        return opened(path, mode, *args)

    monkeypatch.setattr(Path, "open", open_until_full)
    assert_refused_and_intact(folder, "cannot be written: No space left on device; .*make room")
    assert len(written) == 2


def test_a_disk_that_is_full_in_the_end_leaves_the_earlier_files(folder: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """A disk that is full only when the data is flushed to it."""
    monkeypatch.setattr(os, "fsync", fails_with(errno.ENOSPC))
    assert_refused_and_intact(folder, "No space left on device")


@pytest.mark.parametrize("error", [OSError(errno.EPERM, "no"), KeyboardInterrupt()])
def test_failing_rename_leaves_the_earlier_files(
    folder: Path, monkeypatch: pytest.MonkeyPatch, error: BaseException
) -> None:
    """When a file cannot be put in its place, whichever it is, or at Ctrl-C, those already in place are taken back."""
    replace = Path.replace
    before = contents(folder)
    for failing in range(1, 20):
        calls = []

        def replace_but_once(path: Path, target: Path, calls: list[Path] = calls, failing: int = failing) -> Path:
            calls.append(target)
            if len(calls) == failing:
                raise error
            return replace(path, target)

        monkeypatch.setattr(Path, "replace", replace_but_once)
        try:
            write_folder(folder, FILES)
        except (InputError, KeyboardInterrupt):
            assert contents(folder) == before
        else:
            break
    assert failing > len(FILES)
    assert contents(folder)["b.3mf"] == FILES[1].content


def test_folder_in_the_way_of_a_file_is_named(folder: Path) -> None:
    """A folder with the name of a file to write is named, and nothing is changed."""
    (folder / "c.png").mkdir()
    assert_refused_and_intact(folder, r"c\.png: cannot be written: a folder has the name")


def test_file_in_the_way_of_the_folder_is_named(tmp_path: Path) -> None:
    """A file where the folder should be, or above it, is refused and kept."""
    (tmp_path / "out").write_text("mine")
    for folder in (tmp_path / "out", tmp_path / "out" / "deeper"):
        with pytest.raises(InputError, match=r"out.*: (is a file|cannot be written)"):
            write_folder(folder, FILES)
    assert (tmp_path / "out").read_text() == "mine"


def test_interruption_leaves_the_earlier_files(folder: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Ctrl-C while writing changes nothing and leaves no temporary file."""

    def interrupt(_: int) -> None:
        raise KeyboardInterrupt

    before = contents(folder)
    monkeypatch.setattr(os, "fsync", interrupt)
    with pytest.raises(KeyboardInterrupt):
        write_folder(folder, FILES)
    assert contents(folder) == before
