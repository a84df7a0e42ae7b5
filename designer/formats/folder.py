"""Writing a set of files so that a failure leaves the earlier ones as they were."""

import os
import shutil
import tempfile
from collections.abc import Iterable
from dataclasses import dataclass, replace
from pathlib import Path

from designer.base.errors import InputError, NotWrittenError
from designer.base.own_files import require_ours, signed
from designer.target import TargetGeometry, load_target


@dataclass(frozen=True)
class OutputFile:
    """A file to write: its bare name and content."""

    name: str
    content: bytes
    purpose: str  # one phrase for the person


def replaced_target(folder: Path, name: str, target: TargetGeometry) -> tuple[str, ...]:
    """What to say of an earlier target of this name that is about to be replaced by another one.

    Args:
        folder: to be written into.
        name: of the design.
        target: the new one.
    """
    try:
        earlier = load_target(folder / f"{name}.target.json").geometry_id
    except InputError:  # there is none, or nobody can use it
        return ()
    if earlier == target.geometry_id:
        return ()
    return (
        f"replaces target {earlier} by {target.geometry_id} in {folder}: prints and photos of the earlier one need its "
        "target file",
    )


def files_left(folder: Path, name: str, files: Iterable[OutputFile]) -> tuple[str, ...]:
    """Files of the same base name that are not among `files`: they may show another target."""
    mine = {file.name for file in files}
    return tuple(sorted(path.name for path in folder.glob(f"{name}.*") if path.name not in mine))


def write_folder(folder: Path, files: Iterable[OutputFile]) -> None:
    """Write all files into the folder, or none of them.

    Everything is written under temporary names on the same disk first, then renamed.

    Raises:
        InputError: the folder cannot be made or written, the disk is full, or a file is somebody else's.
    """
    if folder.exists() and not folder.is_dir():
        raise InputError(f"{folder}: is a file, not a folder; choose another with -o")
    ours = [replace(file, content=signed(file.name, file.content, "design")) for file in files]
    for file in ours:
        require_ours(folder / file.name, file.content)
    staging: Path | None = None
    try:
        folder.mkdir(parents=True, exist_ok=True)
        staging = Path(tempfile.mkdtemp(prefix=".unfinished-", dir=folder))
        staged = []
        for file in ours:
            place = staging / file.name
            with place.open("wb") as stream:
                stream.write(file.content)
                stream.flush()
                os.fsync(stream.fileno())
            staged.append(place)
        _replace_all(folder, staged)
    except OSError as error:
        where = error.filename if isinstance(error, IsADirectoryError) else folder
        raise NotWrittenError(
            f"{where}: cannot be written: {error.strerror}; choose another folder with -o, or make room"
        ) from error
    finally:
        if staging is not None:
            shutil.rmtree(staging, ignore_errors=True)


def _replace_all(folder: Path, staged: list[Path]) -> None:
    """Move staged files over those in the folder; if one cannot be moved, bring back the earlier ones.

    Every file is whole at any moment: earlier ones stay as links beside the new ones until all are in place.
    """
    for place in staged:
        if (folder / place.name).is_dir():
            raise IsADirectoryError(None, "a folder has the name of a file to write", str(folder / place.name))
    earlier: list[tuple[Path, Path | None]] = []
    try:
        for place in staged:
            final, kept = folder / place.name, place.with_name(f"{place.name}.earlier")
            if final.exists():
                _link(final, kept)
            earlier.append((final, kept if final.exists() else None))
            place.replace(final)
    except OSError:
        for final, backup in earlier:
            if backup is None:
                final.unlink(missing_ok=True)
            else:
                backup.replace(final)
        raise


def _link(final: Path, kept: Path) -> None:
    """A second name for a file, or a copy where the disk knows no links."""
    try:
        os.link(final, kept)
    except OSError:
        shutil.copy2(final, kept)
