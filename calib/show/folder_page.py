"""A folder's page beside what a command was asked for: nothing here ends the command but a full disk."""

from collections.abc import Callable
from pathlib import Path

from calib.show.claim import why_no_page
from calib.show.parts.origin import ORIGIN_FILE, Origin
from calib.show.write import write_report
from designer.base.errors import InputError, NotWrittenError
from designer.base.words import printable
from designer.page.blocks import Page


def write_folder_page(
    folder: Path, kind: str, command: str, build: Callable[[Origin], Page] | None = None
) -> tuple[tuple[Path, ...], str]:
    """Write a folder's page; its files, or why there is none, in a line.

    Args:
        folder: with all that the page is built from.
        kind: a key of `calib.show.registry.KINDS`.
        command: that made the results; "" if it is not known.
        build: makes the page of a folder that is read already.

    Raises:
        NotWrittenError: the disk is full.
    """
    try:
        if remark := why_no_page(folder, kind):
            return (), remark
        page = write_report(folder, kind, command, build)
    except NotWrittenError:
        raise
    except InputError as error:
        return (), f"no page: {printable(str(error))}"
    return (folder / ORIGIN_FILE, page), ""
