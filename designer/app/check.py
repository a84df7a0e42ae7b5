"""Hold a spec or a target file to the rules of a printer: `design check ico.target.json --printer prusa-mk4`."""

from dataclasses import asdict, dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

from designer.app.make import Given, check_numbers, rule_rows, target_numbers, with_options
from designer.base.options import argument
from designer.page.result import Result
from designer.spec.options import AskedPrinting

if TYPE_CHECKING:
    from designer.base.answer import Value
    from designer.make.printability import PrintCheck
    from designer.page.blocks import Page
    from designer.spec.spec import PrintSpec
    from designer.target import TargetGeometry


@dataclass(frozen=True, eq=False)
class CheckedDesign(Result, kind="check", title="Design check", doing="checking", is_written=False):
    """What the design rules say of a target, made in some way."""

    file: str
    target: "TargetGeometry"
    printing: "PrintSpec"
    found: "PrintCheck"
    remarks: tuple[str, ...] = ()

    @property
    def is_negative(self) -> bool:
        """Whether a rule is violated."""
        return bool(self.found.violations)

    def page(self) -> "Page":
        """The verdict, what was checked, and what the rules say against it."""
        from designer.app.design_page import headline
        from designer.page.blocks import Facts, Findings, Page, Section

        printer = self.printing.printer
        how = (
            f"{self.printing.build} on {printer.name}, nozzle {printer.nozzle_mm:g} mm, lines "
            f"{printer.line_width_mm:g} mm, layers {printer.layer_height_mm:g} mm"
        )
        facts = Facts((("file", self.file), ("target id", self.target.geometry_id), ("made", how)))
        rules = Section("", (Findings(tuple(rule_rows(self.found))),))
        return Page("", "", headline(self.printing, self.found), (rules,), lead=(facts,))

    def answer(self) -> "dict[str, Value]":
        """Ids, what it was held to, and the findings."""
        return {**target_numbers(self.target), "printing": asdict(self.printing), **check_numbers(self.found)}


def _check(
    file: Annotated[Path, argument("a spec (TOML) or a target file (NAME.target.json)")], **options: Given
) -> CheckedDesign:
    """Check a design against a printer's rules.

    The exit code is 1 if a rule is violated.
    """
    from designer.base.files import read_spec_file
    from designer.builds.design import Design, maker_of
    from designer.kinds.layout import lay_out
    from designer.kinds.presets import preset_or_file
    from designer.kinds.sizing import size_job, size_printing
    from designer.kinds.spec_file import parse_printing, parse_spec, replaced
    from designer.make.printability import check_printability
    from designer.spec.build import builds_of
    from designer.target import load_target

    given = {name: value for name, value in options.items() if value is not None}
    if file.suffix.lower() == ".json":
        target = load_target(file, "marks")
        if "build" not in given and target.build in builds_of(target.form):
            given = {"build": target.build, **({"lip": True} if target.has_lip else {}), **given}  # as it was designed
        printing = size_printing(parse_printing(given), target)
    else:
        path = preset_or_file("targets", str(file))
        job = size_job(parse_spec(replaced(read_spec_file(path), given), str(file))).job
        target, printing = lay_out(job.target), job.printing
        if printing.way.is_in_parts:
            maker_of(printing).remarks(Design(job))  # parts that cannot be made or laid on a bed are refused
    return CheckedDesign(str(file), target, printing, check_printability(target, printing))


check = with_options(_check, AskedPrinting)
