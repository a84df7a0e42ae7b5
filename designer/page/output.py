"""Where a capability writes, and what it has written so far: whatever ends the work, what is finished stays.

    out = Output(Path("camera"))
    run("ico.target.json", "photos", out=out)  # Ctrl-C: `out.files`, `out.finished`

In Python a capability takes a path for it, and nobody is told; a command hands an `Output` over, and tells it.
"""

from collections.abc import Mapping
from dataclasses import dataclass, field
from os import PathLike
from pathlib import Path
from typing import TYPE_CHECKING

from designer.base.files import place_of, write_files

if TYPE_CHECKING:
    from designer.base.answer import Value


@dataclass
class Output:
    """One place to write to, and what is there of this work."""

    place: Path  # a folder, or a file
    page: Path | None = None  # folder of the page; None: there is none
    files: list[Path] = field(default_factory=list)  # all that is written
    finished: list[Path] = field(default_factory=list)  # files and folders that are of use though the rest is missing
    is_asked: bool = True  # False: nobody said where, and the place itself is not written to
    again: str = ""  # how to go on if a person stops it, beside what is finished
    answer: "Mapping[str, Value]" = field(default_factory=dict)  # as far as it is known, if the work does not end well

    @property
    def folder(self) -> Path:
        """That is written to."""
        return self.place if self.place.is_dir() else self.place.parent

    def write(self, files: Mapping[Path, bytes]) -> None:
        """Write files, all or none.

        Raises:
            InputError: they cannot be written, or are somebody else's.
        """
        write_files(files)
        self.files += files


def output_of(out: Output | str | PathLike[str]) -> Output:
    """Where to write, as a command or a caller in Python gives it.

    Raises:
        InputError: no path.
    """
    if isinstance(out, Output):
        return out
    place = place_of(out, "a folder, such as '.'")
    return Output(place, place)


def asked_output(out: Output | str | PathLike[str] | None) -> Output | None:
    """Where somebody asked for a file; None: nobody did."""
    output = None if out is None else output_of(out)
    return output if output is not None and output.is_asked else None
