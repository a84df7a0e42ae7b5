"""A verdict on the screen: a table with a row for each check."""

from rich.table import Table
from rich.text import Text

from calib.verdict.criteria import Criteria
from calib.verdict.verdict import Check, Grade, Verdict, measured_text
from designer.base.words import printable

MARKS: dict[Grade, tuple[str, str]] = {
    "good": ("good", "green"),
    "usable": ("usable", "yellow"),
    "bad": ("bad", "red"),
    "unknown": ("-", "dim"),
}
"""The word of a grade, and how it is shown where there is colour; the word alone says it all."""


def checks_table(verdict: Verdict) -> Table:
    """A row a check: grade, what was checked, what was measured, and the limits; it fits 80 columns."""
    table = Table(box=None, padding=(0, 2, 0, 0))
    table.add_column("grade")
    table.add_column("check", overflow="fold")
    for name in ("measured", "good", "usable"):
        table.add_column(name, justify="right")
    for check in verdict.checks:
        word, style = MARKS[check.grade]
        table.add_row(
            Text(word, style), Text(printable(check.title)), measured(check), limit(check, check.good),
            limit(check, check.usable),
        )  # fmt: skip
    return table


def measured(check: Check) -> str:
    """The value with its unit; "-" if it is not known."""
    if check.value is None:
        return "-"
    return f"{measured_text(check.value, check.unit, (check.good, check.usable))} {check.unit}".rstrip()


def limit(check: Check, value: float) -> str:
    """A limit with its unit: `<= 0.1 px`; "" where there is none."""
    if not check.unit:
        return ""
    return f"{'>=' if check.is_at_least else '<='} {value:.4g} {check.unit}"


def criteria_line(criteria: Criteria) -> str:
    """Which limits were applied, and how to apply others."""
    return f"limits: {printable(criteria.name)} ({printable(criteria.title)}); others with --criteria"
