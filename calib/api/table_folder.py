"""The folder of a study that is one table: whether it takes the table, and the table in it."""

from pathlib import Path
from typing import TypeVar

from calib.app.inputs import Place, folder_of
from designer.base.file_kind import FileKind
from designer.base.files import check_folder, write_files
from designer.base.own_files import require_ours

TABLE_FILE = "table.json"
Study = TypeVar("Study")


def check_table_folder(folder: Path, kind: FileKind[Study]) -> None:
    """Refuse a folder that takes no such table, before any work is done.

    Raises:
        InputError: the message names it.
    """
    check_folder(folder)
    require_ours(folder / TABLE_FILE, kind=kind.format)


def write_table(folder: Place, kind: FileKind[Study], study: Study) -> tuple[Path, ...]:
    """Write `table.json`; return the files.

    Raises:
        InputError: the folder takes no files, or holds somebody else's.
    """
    place = folder_of(folder)
    check_table_folder(place, kind)
    files = {place / TABLE_FILE: kind.text(study)}
    write_files(files)
    return tuple(files)
