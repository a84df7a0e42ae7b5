"""Whose a file is, told by its content: nothing that this program did not write is ever replaced by it.

Each kind of file says somewhere near its beginning or end who wrote it, and what it is: JSON by `"format"`, tables and
texts by a comment, pages by their generator, pictures by a note that viewers do not show. A table without one is known
by its first columns; the later ones depend on what was asked for.
"""

import os
import re
import struct
import zlib
from pathlib import Path

from designer.base.errors import InputError
from designer.base.words import NAME

_HEAD, _TAIL = 2**16, 2**12
_FIRST_COLUMNS = 2
_BARE = ""
"""The kind of what says only whose it is: pictures and packages, and texts of earlier versions."""
_MARKS: tuple[tuple[re.Pattern[bytes], str | None], ...] = tuple(
    (re.compile(mark.replace("OURS", NAME).encode(), re.DOTALL), kind)
    for mark, kind in (
        (r'\A(?:\xef\xbb\xbf)?\s*\{\s*"format"\s*:\s*"OURS\.([a-z_-]+)"', None),
        (r"\A(?:\xef\xbb\xbf)?# OURS ([a-z-]+)(?: [a-z]+)?, version \d", None),
        (r"\AOURS binary (STL)\b", None),
        (r"\AOURS (lut) \d", None),
        (r"\AMATLAB 5\.0 MAT-file, OURS ([a-z]+) ", None),
        (r'\AglTF.{16}[^\0]*?"generator": ?"OURS"', "model"),
        (r'\A\s*<!doctype html>.*?<meta name="generator" content="OURS[ ,"]', "page"),
        (r"\A%PDF-.*?/Creator \(OURS\)", "sheet"),
        (r"\A\x89PNG.*?tEXtTitle\0OURS camera difference", "difference"),
        (r"\A\x89PNG.*?tEXtSoftware\0OURS(?![A-Za-z0-9])", _BARE),
        (r"\A\xff\xd8\xff\xfe\0\x0bOURS", _BARE),
        (r"PK\x05\x06.{18}OURS\Z", _BARE),
        (r'"format"\s*:\s*"OURS\.([a-z]+-json)"\s*\}\s*\]?\s*\Z', None),
        (r"\n(?:# |% |<!-- |/\* )OURS\.([a-z]+-[a-z]+)(?: -->| \*/)?\s*\Z", None),
        (r"\n(?:# |% |<!-- |/\* )OURS(?: -->| \*/)?\s*\Z", _BARE),
    )
)
"""Where files of ours say so, and what they are then; None: what stands there."""
_NOTES = {
    ".md": "<!-- {} -->", ".svg": "<!-- {} -->", ".xml": "<!-- {} -->", ".pdf": "% {}", ".step": "/* {} */",
    ".urdf": "<!-- {} -->", ".toml": "# {}", ".yaml": "# {}", ".yml": "# {}", ".txt": "# {}", ".cameramodel": "# {}",
}  # fmt: skip
"""The last line of files of a kind, which its readers skip."""
_PNG, _JPEG, _TIFF, _ZIP_END = b"\x89PNG\r\n\x1a\n", b"\xff\xd8", (b"II*\0", b"MM\0*"), b"PK\x05\x06"
_IHDR_END, _ZIP_END_BYTES = 33, 22


def signed(name: str, content: bytes, sort: str = "result") -> bytes:
    """A file's content with a note that this program made it; as it is where it says so, or has no place for it.

    Args:
        name: of the file; its suffix tells how a note is written, and is part of the kind.
        content: of the file.
        sort: of thing that a text holds, in small letters: a camera is never written over a design.
    """
    if not content or _is_of_program(kind_of(content)):
        return content
    suffix = Path(name).suffix.lower()
    mine, note = NAME.encode(), _NOTES.get(suffix)
    if note is not None:
        return content.rstrip(b"\n") + b"\n" + note.format(f"{NAME}.{sort}-{suffix[1:]}").encode() + b"\n"
    if content.startswith(_PNG):
        text = b"tEXtSoftware\0" + mine
        chunk = struct.pack(">I", len(text) - 4) + text + struct.pack(">I", zlib.crc32(text))
        return content[:_IHDR_END] + chunk + content[_IHDR_END:]
    if content.startswith(_JPEG):
        return content[:2] + b"\xff\xfe" + struct.pack(">H", 2 + len(mine)) + mine + content[2:]
    if content.startswith(_TIFF):  # all in it is found by its offset, so nothing ends at the end
        return content + b"\n# " + mine + b"\n"
    if content[-_ZIP_END_BYTES:].startswith(_ZIP_END):
        return content[:-2] + struct.pack("<H", len(mine)) + mine
    return content


def kind_of(content: bytes) -> bytes:
    """What a file of this program says that it is, as in "NAME.camera"; a table's first columns; "" of any other."""
    for mark, kind in _MARKS:
        found = mark.search(content[-_TAIL:]) if mark.pattern.endswith(rb"\Z") else mark.match(content[:_HEAD])
        if found is not None:
            return f"{NAME}.".encode() + (found[1] if kind is None else kind.encode())
    first = content[:_HEAD].split(b"\n", 1)[0]
    columns = first.split(b",")
    is_table = len(columns) > _FIRST_COLUMNS and not first.startswith((b"{", b"["))
    return b",".join(columns[:_FIRST_COLUMNS]) if is_table else b""


def _is_of_program(kind: bytes) -> bool:
    return kind.startswith(f"{NAME}.".encode())


def is_ours(path: Path, kind: str) -> bool:
    """Whether nothing is there, or a file of a kind that a later one may replace."""
    try:
        require_ours(path, kind=kind)
    except InputError:
        return False
    return True


def require_ours(path: Path, new: bytes | None = None, *, kind: str = "") -> None:
    """Refuse to write over anything but an earlier file of the same kind, an empty one, or the same again.

    The one answer to whether a file may be replaced: of commands before their work, and of all that writes.

    Args:
        path: to be written.
        new: what it is to hold; None before that is known.
        kind: what it will be, where that is known beforehand, as in "NAME.camera"; "": any file of ours will do.

    Raises:
        InputError: it is there and is no file, or somebody else's, or cannot be read.
    """
    try:
        if not os.path.lexists(path):  # a link to nowhere, or to itself, is somebody's
            return
        if path.is_dir():
            raise InputError(
                f"{path}: cannot be written: a folder has the name of a file to write; choose another place"
            )
        if not path.is_file():
            raise InputError(f"{path}: is not a file; choose another name with -o")
        with path.open("rb") as stream:
            there = stream.read(_HEAD)
            stream.seek(max(_HEAD, path.stat().st_size - _TAIL))
            there += stream.read(_TAIL)
        is_same = new is not None and path.stat().st_size == len(new) and path.read_bytes() == new
    except OSError as error:
        raise InputError(f"{path}: cannot be used: {error.strerror}; choose another place with -o") from None
    if not there or is_same:
        return
    found, wanted = kind_of(there), kind.encode() if new is None else kind_of(new)
    is_of_program = _is_of_program(found)
    if is_of_program if new is None and not kind else found and found == wanted:
        return
    if found == f"{NAME}.".encode() and wanted.endswith(f"-{path.suffix.lower()[1:]}".encode()):
        return  # a text of an earlier version, which told no more, under the name of such a file
    what = f"a file of {NAME}'s of another kind" if is_of_program else f"not of {NAME}'s making"
    raise InputError(f"{path}: is there already, and {what}; move it, or choose another place")
