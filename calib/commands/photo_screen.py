"""Photos on a terminal, from the blocks of their page: the answer first, then what to know of them, and all of them."""

from dataclasses import replace
from pathlib import Path

from calib.commands.folder_page import with_page
from calib.show.photos.photos_file import ToldPhotos, told_table, write_photos
from designer.base.answer import Summary
from designer.base.words import printable
from designer.page.blocks import Table
from designer.page.terminal import say_findings, say_headline, say_table
from designer.target import TargetGeometry

MAX_ROWS = 60
"""Photos in the table; of a larger set only those are shown that need a look."""


def say_photos(told: ToldPhotos, *, has_table: bool = True) -> None:
    """What is told of photos."""
    say_headline(told.headline)
    say_findings(told.notes)
    if told.columns and has_table:
        say_table(few_rows(told_table(told)))
    if told.lead:
        print(printable(told.lead))


def few_rows(table: Table) -> Table:
    """A table that fits a screen: of very many photos those that need a look."""
    if len(table.rows) <= MAX_ROWS:
        return replace(table, title="", note="")
    rows = [row for row in table.rows if row[0].level is not None][:MAX_ROWS]
    return replace(table, title="", rows=tuple(rows), note=f"{len(table.rows) - len(rows)} more photos are like most")


def with_photos_page(summary: Summary, folder: Path, told: ToldPhotos, target: TargetGeometry | None = None) -> Summary:
    """What came of a command that leaves pictures, with their page.

    Args:
        summary: of the pictures, all written.
        folder: where they lie.
        told: what is told of them.
        target: that they show, which the page draws; None: nothing is drawn.
    """
    from calib.show.parts.kept_target import keep_target
    from calib.show.parts.origin import is_of_kind

    again = is_of_kind(folder, told.kind)

    def keep() -> tuple[Path, ...]:
        kept = () if target is None else keep_target(folder, target, is_again=again)
        return (*kept, write_photos(folder, told))

    return with_page(summary, folder, told.kind, keep)
