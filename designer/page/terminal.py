"""Blocks as lines of a terminal: the answer first, then what matters, what was written, and what to do next."""

import shlex
import sys
from collections.abc import Iterable, Sequence
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING

from designer.base.words import printable

if TYPE_CHECKING:
    from rich.console import Console

    from designer.page.blocks import Finding, Level, Page, Table

WIDE = 240
"""Columns where there is no terminal: nobody's window is narrow, so a row is a line."""

MARKS: "dict[Level, tuple[str, str]]" = {
    "good": ("good", "green"), "usable": ("usable", "yellow"), "bad": ("bad", "red"), "note": ("note", "dim"),
}  # fmt: skip
"""The word of a level, and its colour where there is colour; the word alone says it all."""
LABEL = 9
"""Columns of what stands before a line."""
MOST_FILES = 6
"""That are named of a folder; the others are counted."""
MOST_STEPS = 3
"""Of what would help, the most useful first."""
MOST_ROWS = 60
"""Of a table on a screen: of a longer one, those that stand out."""


def shown(path: Path) -> str:
    """A path as a line of the screen has it."""
    return printable(str(path))


def quoted(path: Path) -> str:
    """A path as it is typed in a shell."""
    return shlex.quote(shown(path))


def table_console() -> "Console":
    """Where tables go."""
    from rich.console import Console

    return Console(highlight=False, soft_wrap=True, width=None if sys.stdout.isatty() else WIDE)


def say_findings(findings: "Iterable[Finding]") -> None:
    """What was checked or noticed, a line each."""
    from rich.text import Text

    for one in findings:
        word, style = MARKS[one.level]
        title = f"{printable(one.title)}: " if one.title else ""
        table_console().print(Text(word.ljust(LABEL), style).append(f"{title}{printable(one.text)}", "default"))


def say_lines(name: str, lines: Sequence[str]) -> None:
    """Lines under one name, which stands before the first."""
    for number, line in enumerate(lines):
        say_line("" if number else name, line)


def say_line(name: str, line: str) -> None:
    """A line with its name before it."""
    print(f"{name.ljust(LABEL - 1)} {printable(line)}")


def say_written(folder: Path, files: Sequence[Path]) -> None:
    """What was written below a folder: some names, and how many there are; nothing if that is none."""
    inside = [path for path in files if folder in path.parents]
    if not inside:
        return
    direct = [path.name for path in inside if path.parent == folder]
    below: dict[str, int] = {}
    for path in inside:
        if path.parent != folder:
            name = path.relative_to(folder).parts[0]
            below[name] = below.get(name, 0) + 1
    named = ", ".join(direct[:MOST_FILES])
    more = f" and {len(direct) - MOST_FILES} more" if len(direct) > MOST_FILES else ""
    folders = "".join(f", {name}/ ({count} files)" for name, count in below.items())
    say_line("wrote", f"{shown(folder)}: {named}{more}{folders}")


def say_table(table: "Table") -> None:
    """A table as the page has it, without columns that are empty; of very many rows those that need a look."""
    from rich.table import Table as Grid
    from rich.text import Text

    if len(table.rows) > MOST_ROWS:
        rows = [row for row in table.rows if row[0].level is not None][:MOST_ROWS]
        table = replace(table, rows=tuple(rows), note=f"{len(table.rows) - len(rows)} more are like most")
    title = Text(printable(table.title)) if table.title else None
    grid = Grid(title=title, title_justify="left", box=None, padding=(0, 2, 0, 0))
    filled = [at for at in range(len(table.columns)) if any(row[at].text for row in table.rows)]
    for column in (table.columns[at] for at in filled):
        title = Text(printable(column.title))
        grid.add_column(title, justify="right" if column.is_number else "left", overflow="fold")
    for row in table.rows:
        cells = (row[at] for at in filled)
        grid.add_row(*(Text(printable(cell.text), MARKS[cell.level][1] if cell.level else "") for cell in cells))
    table_console().print(grid)
    if table.note:
        print(printable(table.note))
    print()


def say_page(page: "Page", *, verbose: bool) -> None:
    """What a person is told before a page is opened: the answer, the facts, what to know of them, and what would help.

    Args:
        page: all of it.
        verbose: with the tables, and with what was checked and found good.
    """
    from rich.text import Text

    from designer.page.blocks import Facts, Findings, Fold, Gallery, Steps, Table

    if (answer := page.headline) is not None:
        word = Text(f"{printable(answer.word)}: ", f"bold {MARKS[answer.level][1]}")
        table_console().print(word.append(printable(answer.sentence), "default not bold"))
    inside = [block for section in page.sections for block in section.blocks]
    blocks = [
        leaf for block in (*page.lead, *inside) for leaf in (block.blocks if isinstance(block, Fold) else (block,))
    ]
    for block in blocks:
        if isinstance(block, Facts) and block in page.lead:
            width = max((len(name) for name, _ in block.rows), default=0)
            for name, value in block.rows:
                say_line(name.ljust(width), value)
    for block in blocks:
        if isinstance(block, Findings):
            say_findings(one for one in block.rows if verbose or (one.level != "good" and one.text))
        elif isinstance(block, Steps):
            say_lines("better", block.items[:MOST_STEPS])
        elif isinstance(block, Gallery) and block.said_as:
            say_lines(block.said_as, [f"{number:2d}. {one.caption}" for number, one in enumerate(block.pictures, 1)])
        elif isinstance(block, Table) and verbose:
            say_table(block)
