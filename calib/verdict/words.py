"""A verdict on the screen: a line with the answer, and a table with a row for each check."""

from rich.table import Table
from rich.text import Text

from calib.results.evaluation_table import figure
from calib.verdict.criteria import Criteria
from calib.verdict.verdict import Check, Grade, Verdict
from designer.command import printable

MARKS: dict[Grade, tuple[str, str]] = {
    "good": ("good", "green"),
    "usable": ("usable", "yellow"),
    "bad": ("bad", "red"),
    "unknown": ("-", "dim"),
}
"""The word of a grade, and how it is shown where there is colour; the word alone says it all."""


def headline(verdict: Verdict) -> str:
    """The answer in a line: `verdict: usable: ...`."""
    return f"verdict on {printable(verdict.model)}: {printable(verdict.sentence)}"


def checks_table(verdict: Verdict) -> Table:
    """A row a check: grade, what was checked, what was measured, the limits and what it means."""
    table = Table(box=None, padding=(0, 2, 0, 0))
    for name, justify in (("grade", "left"), ("check", "left"), ("measured", "right"), ("good", "right")):
        table.add_column(name, justify="right" if justify == "right" else "left")
    table.add_column("usable", justify="right")
    table.add_column("meaning", overflow="fold")
    for check in verdict.checks:
        word, style = MARKS[check.grade]
        table.add_row(
            Text(word, style), Text(printable(check.title)), measured(check), limit(check, check.good),
            limit(check, check.usable), Text(printable(check.sentence)),
        )  # fmt: skip
    return table


def measured(check: Check) -> str:
    """The value with its unit; "-" if it is not known."""
    return "-" if check.value is None else with_unit(check.value, check.unit)


def limit(check: Check, value: float) -> str:
    """A limit with its unit: `<= 0.1 px`; "" where there is none."""
    if not check.unit:
        return ""
    return f"{'>=' if check.is_at_least else '<='} {value:g} {check.unit}"


def with_unit(value: float, unit: str) -> str:
    """A measured number with its unit, as short as is useful."""
    digits = f"{value:.0f}" if unit == "%" and value >= 10 else figure(value, 2)
    return f"{digits} {unit}".rstrip()


def criteria_line(criteria: Criteria) -> str:
    """Which limits were applied, and how to apply others."""
    return f"limits: {printable(criteria.name)} ({printable(criteria.title)}); others with --criteria"
