"""The page of a folder of results: `index.html`, and `report.json` to build it again from.

>>> files, remark = write_folder_page(folder, "calibration", "calib run ...")

A page is built from what its folder stores, so that the same files make the same page, here or elsewhere.
"""

from collections.abc import Callable, Mapping
from importlib import import_module
from pathlib import Path
from typing import TypeAlias, cast

from calib.show.parts.origin import ORIGIN, ORIGIN_FILE, Origin, origin_of, read_origin
from designer.base.answer import program
from designer.base.errors import InputError, NotWrittenError
from designer.base.files import write_files
from designer.base.words import printable
from designer.page.blocks import Page
from designer.page.page_file import BLOCKS_FILE

Builder: TypeAlias = Callable[[Path, Origin], Page]

PAGE_FILE = "index.html"
KINDS: Mapping[str, str] = {"photos": "photos.photos_page.photos_page"}
"""What builds the page of each kind of folder: a function below `calib.show`, loaded when it is needed."""


def build_page(folder: Path, origin: Origin) -> Page:
    """The page of what a folder stores.

    Raises:
        InputError: the kind is not known, or the folder lacks what its page is built from; the message names it.
    """
    if origin.kind not in KINDS:
        raise InputError(f"{folder / ORIGIN_FILE}: kind {origin.kind!r:.50}; there are {', '.join(KINDS)}")
    module, _, name = KINDS[origin.kind].rpartition(".")
    build = cast(Builder, getattr(import_module(f"calib.show.{module}"), name))
    return build(folder, origin)


def write_page(folder: Path, origin: Origin, page: Page) -> tuple[Path, Path]:
    """Write a page that was built, and its origin, both or none; their places.

    Raises:
        InputError: the folder takes no files, or holds another `report.json`; the message names it.
    """
    from designer.page.shell import page_html

    places = folder / ORIGIN_FILE, folder / PAGE_FILE
    write_files({places[0]: ORIGIN.text(origin), places[1]: page_html(page)})
    return places


def write_folder_page(
    folder: Path, kind: str, command: str, *, keep: Callable[[], tuple[Path, ...]] = tuple
) -> tuple[tuple[Path, ...], str]:
    """Write a folder's page beside what was asked for; its files, or why there is none, in a line.

    Nothing here ends a command but a full disk: its results are there already.

    Args:
        folder: with all that the page is built from.
        kind: a key of `KINDS`.
        command: that made the results; "" if it is not known.
        keep: writes what else the page is built from, and returns it.

    Raises:
        NotWrittenError: the disk is full.
    """
    try:
        if remark := why_no_page(folder, kind):
            return (), remark
        kept, origin = keep(), origin_of(kind, command, program())
        return (*kept, *write_page(folder, origin, build_page(folder, origin))), ""
    except NotWrittenError:
        raise
    except InputError as error:
        return (), f"no page: {printable(str(error))}"


def why_no_page(folder: Path, kind: str) -> str:
    """Why a folder's page has to stay as it is, in one line; "" if a page of this kind may be written.

    Folders of pictures are often folders of something else too. A page is replaced by one of its own kind only: what
    `calib run` wrote about a folder is worth more than what another command would say of a part of it, and an
    `index.html` without a `report.json` is somebody's own.
    """
    page, origin = folder / PAGE_FILE, folder / ORIGIN_FILE
    if not origin.exists():
        return f"{printable(str(page))}: is there already and stays as it is" if page.exists() else ""
    try:
        there = read_origin(folder).kind
    except InputError as error:
        return printable(str(error))
    if there == kind:
        return ""
    return f"{printable(str(page))}: stays as it is, the page of what is in this folder otherwise ({printable(there)})"


def origin_in(folder: Path) -> Origin:
    """The origin that a folder states, or that its files tell; then the command that made it is not known.

    Raises:
        InputError: no folder, or one that holds nothing to report, or a damaged `report.json`; the message says what
            to do.
    """
    from calib.draw.gallery import OVERLAYS

    if not folder.is_dir():
        what = "is a file, not a folder" if folder.exists() else "no such folder"
        raise InputError(
            f"{folder}: {what}; give a folder that calib run, calib measure, calib study or design tolerance wrote"
        )
    if (folder / ORIGIN_FILE).exists():
        return read_origin(folder)
    if kind := _kind_in(folder):
        return origin_of(kind, "", program())
    if any(folder.glob("*.target.json")):
        name = next((path.name for path in sorted(folder.glob("*.toml"))), "NAME.toml")
        raise InputError(f"{folder}: is a design's folder: design make {name} -o {folder} writes its page")
    if (folder / "truth.json").is_file():
        raise InputError(f"{folder}: not all its photos are rendered: the same calib render again writes its page")
    if (folder / OVERLAYS / BLOCKS_FILE).is_file():
        raise InputError(
            f"{folder}: holds no camera, only what was found in photos: calib report {folder / OVERLAYS} writes "
            "its page"
        )
    raise InputError(
        f"{folder}: holds nothing to report; give a folder that calib run, calib measure, calib study or "
        "design tolerance wrote"
    )


def _kind_in(folder: Path) -> str:
    """The kind of a folder's results, by the files in it; "" if there are none."""
    from calib.show.photos.photos_file import PHOTOS_FILE, read_photos

    return read_photos(folder).kind if (folder / PHOTOS_FILE).is_file() else ""
