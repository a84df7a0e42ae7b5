"""What `design tolerance` shows of what it found."""

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING

from calib.show.screen import shown, table_console
from designer.base.words import printable

if TYPE_CHECKING:
    from calib.studies.tolerance.report import ToleranceReport


def say_report(report: "ToleranceReport") -> None:
    """The tables and what they say, on the screen."""
    from calib.studies.tolerance.notes import budget_notes, crossover_notes, notes
    from calib.studies.tolerance.tables import budget_table, cost_table, crossover_table, screen_table

    console = table_console()
    print()
    console.print(screen_table(cost_table(report)))
    print()
    _print_notes(notes(report))
    for checked in report.budgets:
        if checked.budget.is_met_without:
            print()
            console.print(screen_table(budget_table(report, checked)))
        print()
        _print_notes(budget_notes(report, checked))
    if report.against is not None:
        print()
        for line in report.against.lines:
            print(printable(line))
        print()
        console.print(screen_table(crossover_table(report, report.against)))
        print()
        _print_notes(crossover_notes(report, report.against))


def _print_notes(lines: tuple[str, ...]) -> None:
    for line in lines:
        print(f"- {printable(line)}")


def say_files(report: "ToleranceReport", folder: Path, files: Sequence[Path]) -> None:
    """What was written."""
    from calib.studies.outputs import FIGURES_FOLDER
    from calib.studies.table_files import CSV_FILE, JSON_FILE, MARKDOWN_FILE
    from calib.studies.tolerance.explore import STUDY_FILE

    pictures = [path for path in files if path.suffix == ".png"]
    print(f"\nwrote {shown(folder / MARKDOWN_FILE)}, {CSV_FILE}, {JSON_FILE}: the tables")
    if pictures:
        others = sorted({path.suffix[1:].upper() for path in files if path.suffix in (".pdf", ".svg")})
        also = f", as {' and '.join(others)} too" if others else ""
        print(f"      {shown(folder / FIGURES_FOLDER)}: {', '.join(path.name for path in pictures)}{also}")
    if report.table.draws:
        print(f"      {shown(folder / STUDY_FILE)}: every draw")
