"""The page of a folder, which a command leaves beside what it was asked for."""

from collections.abc import Callable, Collection
from dataclasses import replace
from pathlib import Path

from designer.base.answer import Summary, command_line
from designer.base.errors import InputError, NotWrittenError
from designer.base.words import printable
from designer.page.progress import waiting
from designer.page.terminal import shown


def with_page(summary: Summary, folder: Path, kind: str, keep: Callable[[], tuple[Path, ...]] = tuple) -> Summary:
    """What came of a command whose results lie in a folder, with the folder's page.

    Args:
        summary: of the results, all written.
        folder: where they lie.
        kind: a key of `calib.show.folder.KINDS`.
        keep: writes what else the page is built from, and returns it.
    """
    from calib.show.folder import write_folder_page

    with waiting("drawing the page"):
        files, remark = write_folder_page(folder, kind, command_line(), keep=keep)
    return _with(summary, files, remark)


def with_page_again(summary: Summary, folder: Path, kinds: Collection[str]) -> Summary:
    """The same where results were drawn again: the page keeps what it says of their origin.

    Args:
        summary: of the results, all written.
        folder: where they lie.
        kinds: of pages that show such results; another's, and somebody's own, stays as it is.
    """
    from calib.app.report import report

    try:
        with waiting("drawing the page"):
            done = report(folder, kinds=kinds)
    except NotWrittenError:
        raise
    except InputError as error:
        return _with(summary, (), f"no page: {printable(str(error))}")
    return _with(summary, (done.place,), "")


def _with(summary: Summary, files: tuple[Path, ...], remark: str) -> Summary:
    """The summary with the files of a page, or with a remark that says why there is none."""
    if remark:
        print(remark)
        return replace(summary, remarks=(*summary.remarks, remark))
    print(f"wrote {shown(files[-1])}: all of it on one page; open it in a browser")
    return replace(summary, wrote=(*summary.wrote, *files))


def say_next(summary: Summary, folder: Path) -> Summary:
    """Say below all that was written what a person does next; the summary as it is.

    Args:
        summary: with the page among its files, if there is one, else with pictures.
        folder: of the page.
    """
    from calib.show.folder import PAGE_FILE

    pictures = [path for path in summary.wrote if path.suffix in (".png", ".jpg")]
    look = [f"look at {shown(pictures[0])}"] if pictures else []
    if folder / PAGE_FILE in summary.wrote:
        look = [f"open {shown(folder / PAGE_FILE)} in a browser"]
    for number, step in enumerate((*look, *summary.next_steps)):
        print(f"{'' if number else 'next'}".ljust(6) + step)
    return summary
