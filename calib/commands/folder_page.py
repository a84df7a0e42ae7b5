"""The page of a folder of pictures, which a command leaves beside what it was asked for."""

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

from calib.commands.screen import shown, waiting
from designer.answer import Summary
from designer.command import command_line, printable
from designer.errors import InputError


def folder_page(
    folder: Path, kind: str, keep: Callable[[], tuple[Path, ...]]
) -> tuple[tuple[Path, ...], tuple[str, ...]]:
    """Write what a folder's page is built from, and the page; the files, or a remark that says why there is none.

    The pictures are there already and are what was asked for: nothing here ends the command.

    Args:
        folder: of the pictures.
        kind: a key of `calib.report.registry.KINDS`.
        keep: writes what the page is built from, and returns it.
    """
    from calib.report.claim import why_no_page
    from calib.report.origin import ORIGIN_FILE
    from calib.report.write import write_report

    try:
        remark = why_no_page(folder, kind)
        if not remark:
            kept = keep()
            page = write_report(folder, kind, command_line())
            print(f"wrote {shown(page)}: all of it on one page; open it in a browser")
            return (*kept, folder / ORIGIN_FILE, page), ()
    except InputError as error:
        remark = f"no page: {printable(str(error))}"
    print(remark)
    return (), (remark,)


def with_page(summary: Summary, folder: Path, kind: str) -> Summary:
    """What came of a command whose results lie in a folder, with the folder's page.

    Args:
        summary: of the results, all written.
        folder: where they lie.
        kind: a key of `calib.report.registry.KINDS`.
    """
    with waiting("drawing the page"):
        files, remarks = folder_page(folder, kind, tuple)
    return replace(summary, wrote=(*summary.wrote, *files), remarks=(*summary.remarks, *remarks))


def with_page_again(summary: Summary, folder: Path) -> Summary:
    """The same where results were drawn again: the page keeps what it says of their origin."""
    from calib.report.guess import origin_in
    from calib.report.write import build_page, write_page

    try:
        with waiting("drawing the page"):
            origin = origin_in(folder)
            page = write_page(folder, origin, build_page(folder, origin))
    except InputError as error:
        remark = f"no page: {printable(str(error))}"
        print(remark)
        return replace(summary, remarks=(*summary.remarks, remark))
    print(f"wrote {shown(page)}: all of it on one page; open it in a browser")
    return replace(summary, wrote=(*summary.wrote, page))
