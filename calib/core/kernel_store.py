"""Where the machine code of kernels is kept: a folder of files, whole or not there, which only its user may write."""

import hashlib
import logging
import os
import stat
import sys
import tempfile
import time
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from functools import cached_property, lru_cache
from pathlib import Path

KEPT_DAYS = 60.0
"""Entries that no program has used for so long are deleted."""
SUFFIX = ".kernel"
_DAY_S = 86400.0
_DIGEST_BYTES = 32
_log = logging.getLogger("ringsolid")


class Store:
    """A folder of entries, with another in place of one that cannot be written.

    A folder that others may write is not read: an entry holds code, and a pickle.

    Args:
        wanted: the folder to use; it is made where it is missing.
    """

    def __init__(self, wanted: Path) -> None:
        self._wanted = wanted
        self._is_swept = False
        self._has_said = False

    @cached_property
    def folders(self) -> tuple[Path, ...]:
        """Where entries are looked for; new ones go to the first."""
        why = refusal(self._wanted)
        if why is None and os.access(self._wanted, os.W_OK):
            return (self._wanted,)
        for_now = Path(tempfile.gettempdir()) / f"ringsolid-kernels-{os.getuid() if hasattr(os, 'getuid') else ''}"
        if refusal(for_now) is not None or not os.access(for_now, os.W_OK):
            for_now = Path(tempfile.mkdtemp(prefix="ringsolid-kernels-"))
        self._say(f"{self._wanted} {why or 'cannot be written'}; compiled kernels are kept in {for_now} meanwhile")
        return (for_now,) if why is not None else (for_now, self._wanted)

    @property
    def folder(self) -> Path:
        """Where new entries go."""
        return self.folders[0]

    def read(self, name: str) -> bytes | None:
        """What an entry holds, or None where there is none that is whole."""
        return next((held for folder in self.folders if (held := read_entry(folder / name)) is not None), None)

    def holds(self, name: str) -> bool:
        """Whether there is an entry, whole or not."""
        return any((folder / name).exists() for folder in self.folders)

    def write(self, name: str, payload: bytes) -> None:
        """Keep an entry whole or not at all; a full disk or a folder that is gone is said once and costs no result."""
        self._sweep()
        try:
            self.folder.mkdir(mode=0o700, parents=True, exist_ok=True)
            handle, part = tempfile.mkstemp(dir=self.folder, prefix=f".{name}.")
            try:
                with open(handle, "wb") as file:
                    file.write(hashlib.sha256(payload).digest() + payload)
                os.replace(part, self.folder / name)
            except BaseException:
                os.unlink(part)
                raise
        except OSError as error:
            self._say(f"{self.folder}: {error.strerror or error}; compiled kernels are not kept")

    @contextmanager
    def locked(self) -> Iterator[None]:
        """One process at a time, where the system has such locks; they end with their process."""
        with suppress(ImportError, OSError):
            import fcntl

            with (self.folder / ".lock").open("w") as file:
                fcntl.flock(file, fcntl.LOCK_EX)
                yield
                return
        yield

    def _sweep(self) -> None:
        """Delete what no program has used for long, once a process, when there was something to compile anyway."""
        if self._is_swept:
            return
        self._is_swept = True
        with suppress(OSError):
            for path in self.folder.iterdir():
                is_part = path.name.startswith(".") and SUFFIX in path.name
                kept_s = _DAY_S if is_part else KEPT_DAYS * _DAY_S
                if (is_part or path.suffix == SUFFIX) and time.time() - path.stat().st_mtime > kept_s:
                    path.unlink(missing_ok=True)

    def _say(self, what: str) -> None:
        if not self._has_said:
            self._has_said = True
            _log.warning("%s. RINGSOLID_CACHE names another folder.", what)


def read_entry(path: Path) -> bytes | None:
    """What an entry's file holds, or None if it is not there or not whole; that it was used is marked once a day."""
    with suppress(OSError), path.open("rb") as file:
        digest, payload = file.read(_DIGEST_BYTES), file.read()
        if hashlib.sha256(payload).digest() == digest:
            if time.time() - os.fstat(file.fileno()).st_mtime > _DAY_S:
                with suppress(OSError):
                    os.utime(path)
            return payload
    return None


def refusal(folder: Path) -> str | None:
    """Why a folder of entries is not to be read, or None; one that is missing is made, for its user alone."""
    try:
        folder.mkdir(mode=0o700, parents=True, exist_ok=True)
        found = folder.stat()
    except FileExistsError:
        return "is a file"
    except OSError as error:
        return f"cannot be made ({error.strerror})"
    if not os.access(folder, os.R_OK | os.X_OK):
        return "cannot be read"
    if sys.platform != "win32":
        if found.st_uid not in {os.getuid(), 0}:
            return "is another user's"
        if found.st_mode & (stat.S_IWGRP | stat.S_IWOTH):
            return "may be written by others"
    return None


def store() -> Store:
    """The store that the environment asks for: `NUMBA_CACHE_DIR`, `RINGSOLID_CACHE`, or the user's cache folder."""
    if named := os.environ.get("NUMBA_CACHE_DIR"):
        return _store(Path(named))
    if named := os.environ.get("RINGSOLID_CACHE"):
        return _store(Path(named) / "kernels")
    return _store(_users_folder())


@lru_cache(maxsize=8)
def _store(wanted: Path) -> Store:
    return Store(wanted)


@lru_cache(maxsize=1)
def _users_folder() -> Path:
    from platformdirs import user_cache_path

    return user_cache_path("ringsolid", appauthor=False) / "kernels"
