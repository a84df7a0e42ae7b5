"""Writing a folder's page: `index.html`, and `report.json` to build it again from."""

from collections.abc import Callable
from pathlib import Path

from calib.core.files import write_files
from calib.show.parts.origin import ORIGIN, ORIGIN_FILE, Origin, origin_of
from calib.show.registry import KINDS
from designer.base.answer import program
from designer.base.errors import InputError
from designer.page.blocks import Page

PAGE_FILE = "index.html"


def write_report(folder: Path, kind: str, command: str, build: Callable[[Origin], Page] | None = None) -> Path:
    """Write `report.json` and `index.html`, both or none; return the page's place.

    Args:
        folder: with the results, all written; the page is built from them alone.
        kind: a key of `calib.show.registry.KINDS`.
        command: the command line that made the results; "" if it is not known.
        build: makes the page of a folder that is read already, the same as if it were read again.

    Raises:
        InputError: the folder lacks what its page is built from, or takes no files; the message names it.
    """
    origin = origin_of(kind, command, program())
    return write_page(folder, origin, build_page(folder, origin) if build is None else build(origin))


def build_page(folder: Path, origin: Origin) -> Page:
    """The page of what a folder stores; the same files make the same page.

    Raises:
        InputError: the kind is not known, or the folder lacks what its page is built from; the message names it.
    """
    build = KINDS.get(origin.kind)
    if build is None:
        raise InputError(f"{folder / ORIGIN_FILE}: kind {origin.kind!r:.50}; there are {', '.join(KINDS)}")
    return build(folder, origin)


def write_page(folder: Path, origin: Origin, page: Page) -> Path:
    """Write a page that was built, and its origin, both or none; return the page's place.

    Raises:
        InputError: the folder takes no files, or holds another `report.json`; the message names it.
    """
    from designer.page.shell import page_html

    place = folder / PAGE_FILE
    write_files({folder / ORIGIN_FILE: ORIGIN.text(origin), place: page_html(page)})
    return place
