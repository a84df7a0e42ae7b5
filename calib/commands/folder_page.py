"""The page of a folder of pictures, which a command leaves beside what it was asked for."""

from collections.abc import Callable, Collection
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING

from calib.show.screen import shown, waiting
from designer.base.answer import Summary
from designer.base.command import command_line
from designer.base.errors import InputError, NotWrittenError
from designer.base.words import printable

if TYPE_CHECKING:
    from calib.show.parts.origin import Origin
    from designer.page.blocks import Page


def folder_page(
    folder: Path, kind: str, keep: Callable[[], tuple[Path, ...]], build: "Callable[[Origin], Page] | None" = None
) -> tuple[tuple[Path, ...], tuple[str, ...]]:
    """Write what a folder's page is built from, and the page; the files, or a remark that says why there is none.

    The pictures are there already and are what was asked for: nothing here ends the command but a full disk.

    Args:
        folder: of the pictures.
        kind: a key of `calib.show.registry.KINDS`.
        keep: writes what the page is built from, and returns it.
        build: makes the page of a folder that is read already.
    """
    from calib.show.claim import why_no_page
    from calib.show.parts.origin import ORIGIN_FILE
    from calib.show.write import write_report

    try:
        remark = why_no_page(folder, kind)
        if not remark:
            kept = keep()
            page = write_report(folder, kind, command_line(), build)
            print(f"wrote {shown(page)}: all of it on one page; open it in a browser")
            return (*kept, folder / ORIGIN_FILE, page), ()
    except NotWrittenError:
        raise
    except InputError as error:
        remark = f"no page: {printable(str(error))}"
    print(remark)
    return (), (remark,)


def with_page(summary: Summary, folder: Path, kind: str) -> Summary:
    """What came of a command whose results lie in a folder, with the folder's page.

    Args:
        summary: of the results, all written.
        folder: where they lie.
        kind: a key of `calib.show.registry.KINDS`.
    """
    with waiting("drawing the page"):
        files, remarks = folder_page(folder, kind, tuple)
    return replace(summary, wrote=(*summary.wrote, *files), remarks=(*summary.remarks, *remarks))


def say_next(summary: Summary, folder: Path) -> Summary:
    """Say below all that was written what a person does next; the summary as it is.

    Args:
        summary: with the page among its files, if there is one, else with pictures.
        folder: of the page.
    """
    from calib.show.write import PAGE_FILE

    pictures = [path for path in summary.wrote if path.suffix in (".png", ".jpg")]
    look = [f"look at {shown(pictures[0])}"] if pictures else []
    if folder / PAGE_FILE in summary.wrote:
        look = [f"open {shown(folder / PAGE_FILE)} in a browser"]
    for number, step in enumerate((*look, *summary.next_steps)):
        print(f"{'' if number else 'next'}".ljust(6) + step)
    return summary


def with_page_again(summary: Summary, folder: Path, kinds: Collection[str]) -> Summary:
    """The same where results were drawn again: the page keeps what it says of their origin.

    Args:
        summary: of the results, all written.
        folder: where they lie.
        kinds: of pages that show such results; another's, and somebody's own, stays as it is.
    """
    from calib.show.claim import why_no_page
    from calib.show.guess import origin_in
    from calib.show.write import build_page, write_page

    try:
        origin = origin_in(folder)
        kind = origin.kind if origin.kind in kinds else next(iter(kinds))
        remark = why_no_page(folder, kind)
        if not remark:
            with waiting("drawing the page"):
                page = write_page(folder, origin, build_page(folder, origin))
    except NotWrittenError:
        raise
    except InputError as error:
        remark = f"no page: {printable(str(error))}"
    if remark:
        print(remark)
        return replace(summary, remarks=(*summary.remarks, remark))
    print(f"wrote {shown(page)}: all of it on one page; open it in a browser")
    return replace(summary, wrote=(*summary.wrote, page))
