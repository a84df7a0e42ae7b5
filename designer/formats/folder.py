"""The folder of a design: its files, what is left of an earlier run, and which target is replaced."""

from collections.abc import Iterable
from dataclasses import dataclass
from pathlib import Path

from designer.base.errors import InputError
from designer.base.files import write_files
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

    Raises:
        InputError: the folder cannot be made or written, the disk is full, or a file is somebody else's.
    """
    if folder.exists() and not folder.is_dir():
        raise InputError(f"{folder}: is a file, not a folder; choose another with -o")
    write_files({folder / file.name: file.content for file in files}, "design")
