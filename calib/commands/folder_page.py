"""The page of a folder, which a command leaves beside what it was asked for."""

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

from designer.base.answer import Summary, command_line
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


def _with(summary: Summary, files: tuple[Path, ...], remark: str) -> Summary:
    """The summary with the files of a page, or with a remark that says why there is none."""
    if remark:
        print(remark)
        return replace(summary, remarks=(*summary.remarks, remark))
    print(f"wrote {shown(files[-1])}: all of it on one page; open it in a browser")
    return replace(summary, wrote=(*summary.wrote, *files))
