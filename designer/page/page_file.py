"""The page of a folder: `index.html` for people, and `page.json`, its blocks, of which it is made again."""

from dataclasses import dataclass
from pathlib import Path

from designer.base.errors import InputError
from designer.base.file_kind import FileKind
from designer.base.files import write_files
from designer.base.marks import Word
from designer.base.words import printable
from designer.page.blocks import Page

PAGE_FILE, BLOCKS_FILE = "index.html", "page.json"
LARGEST_BYTES = 2**28


@dataclass(frozen=True, eq=False)
class StoredPage:
    """A page, and of what kind of folder."""

    kind: Word
    page: Page


PAGE = FileKind(
    StoredPage, "page", "a page.json", "run the command that wrote the folder again", largest_bytes=LARGEST_BYTES
)


def write_page(folder: Path, kind: str, page: Page) -> tuple[Path, Path]:
    """Write a page and its blocks, both or none; their places.

    Raises:
        InputError: the folder takes no files, or holds another `page.json`; the message names it.
    """
    from designer.page.shell import page_html

    places = folder / BLOCKS_FILE, folder / PAGE_FILE
    write_files({places[0]: PAGE.text(StoredPage(kind, page)), places[1]: page_html(page)})
    return places


def why_no_page(folder: Path, *kinds: str) -> str:
    """Why a folder's page has to stay as it is, in one line; "" if a page of these kinds may be.

    Folders of pictures are often folders of something else too. A page is replaced by one of its own kind only, or by
    one that it gives way to: what `calib run` wrote about a folder is worth more than what another command would say of
    a part of it, and an `index.html` without a `page.json` is somebody's own.
    """
    page, blocks = folder / PAGE_FILE, folder / BLOCKS_FILE
    if not blocks.exists():
        return f"{printable(str(page))}: is there already and stays as it is" if page.exists() else ""
    try:
        there = str(PAGE.keys(blocks).get("kind"))
    except InputError as error:
        return printable(str(error))
    if there in kinds:
        return ""
    return f"{printable(str(page))}: stays as it is, the page of what is in this folder otherwise ({printable(there)})"
