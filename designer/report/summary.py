"""What the commands of `design` say at their end, to a person and to a program."""

from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import asdict
from pathlib import Path

from designer.base.answer import Summary, Value
from designer.make.bed import printed_size_mm
from designer.make.printability import PrintCheck
from designer.page.blocks import Facts, Finding, Findings, Table, text_table
from designer.page.terminal import quoted, say_facts, say_findings, say_headline, say_lines, say_table, say_written
from designer.produce import Design, maker_of
from designer.report.costs import COSTS_TITLE, Costs, costs_summary
from designer.report.design_page import PAGE_FILE, RULES_TITLE, Written, headline
from designer.report.pictures import printed_ink
from designer.report.stands import photo_line
from designer.spec.kind import spec_to_mapping
from designer.spec.spec import Job, PrinterProfile, PrintSpec
from designer.target import TargetGeometry

VIOLATED = 1


@contextmanager
def progress() -> Iterator[Callable[[str], None]]:
    """Show the stage at work on standard error, while there is one."""
    from rich.console import Console

    with Console(stderr=True).status("designing") as status:
        yield lambda stage: status.update(f"making {stage}")


def say_design(design: Design, remarks: Sequence[str], written: Written) -> None:
    """The answer, sizes and findings of the page, what was chosen and written, and what comes next."""
    page = written.page
    if page.headline is not None:
        say_headline(page.headline)
    for section in page.sections:
        if section.title == COSTS_TITLE and isinstance(section.blocks[0], Table):
            say_table(section.blocks[0])
    for block in page.lead:
        if isinstance(block, Facts):
            say_facts(block)
    say_lines("chosen", _chosen(design, remarks))
    for section in page.sections:
        if section.title == RULES_TITLE:
            _say_rules([row for block in section.blocks if isinstance(block, Findings) for row in block.rows])
    say_findings(Finding("usable", "", line) for line in written.replaced)
    if written.left:
        text = f"{', '.join(written.left)}; maybe of another target"
        say_findings([Finding("usable", "left from an earlier run", text)])
    say_written(written.folder, [written.folder / file.name for file in written.files])
    say_lines("next", _next_steps(design, written.folder))


def _say_rules(rows: Sequence[Finding]) -> None:
    """What rules say against a print; of those that hold only which they are."""
    say_findings(row for row in rows if row.level != "good")
    if holding := [row.title for row in rows if row.level == "good"]:
        say_findings([Finding("good", "", ", ".join(holding))])


def _chosen(design: Design, remarks: Sequence[str]) -> tuple[str, ...]:
    """What was chosen for the person, a line each."""
    return (*remarks, printed_ink(design).lettering.remark)


def design_summary(
    design: Design, remarks: Sequence[str], check: PrintCheck, costs: Costs, written: Written
) -> Summary:
    """The same for a program."""
    job, geometry = design.job, design.target
    answer: dict[str, Value] = {
        "name": job.name,
        **_target_numbers(geometry),
        "spec": spec_to_mapping(job.target),
        "printing": asdict(job.printing),
        "estimates": costs_summary(costs),
        "printed_size_mm": list(printed_size_mm(geometry, job.printing)),
        **_findings(check),
        "files": [{"name": one.name, "bytes": len(one.content), "purpose": one.purpose} for one in written.files],
        "left_from_earlier": written.left,
    }
    return Summary(
        answer,
        tuple(written.folder / file.name for file in written.files),
        (_run_line(job, written.folder),),
        (*_chosen(design, remarks), *written.replaced),
        VIOLATED if check.violations else 0,
    )


def _target_numbers(target: TargetGeometry) -> dict[str, Value]:
    return {
        "target_id": target.geometry_id, "layout_id": target.layout_id, "faces": target.face_count,
        "rings": target.ring_count, "dots": int(target.is_dot.sum()),
    }  # fmt: skip


def _findings(check: PrintCheck) -> dict[str, Value]:
    return {
        "is_violated": bool(check.violations),
        "findings": [asdict(finding) for finding in check.findings],
        "rules_that_hold": check.holding,
    }


def check_summary(target: TargetGeometry, printing: PrintSpec, check: PrintCheck) -> Summary:
    """The findings of `design check` for a program."""
    answer = {**_target_numbers(target), "printing": asdict(printing), **_findings(check)}
    return Summary(answer, exit_code=VIOLATED if check.violations else 0)


def say_check(name: str, target: TargetGeometry, printing: PrintSpec, check: PrintCheck) -> None:
    """The findings of `design check`."""
    printer = printing.printer
    how = (
        f"{printing.build} on {printer.name}, nozzle {printer.nozzle_mm:g} mm, lines {printer.line_width_mm:g} mm, "
        f"layers {printer.layer_height_mm:g} mm"
    )
    say_headline(headline(printing, check))
    say_facts(Facts((("file", name), ("target id", target.geometry_id), ("made", how))))
    _say_rules(check.told().rows)


def say_templates(
    targets: Sequence[tuple[str, Job, TargetGeometry]],
    printers: Sequence[PrinterProfile],
    errors: Sequence[tuple[str, str]],
) -> None:
    """What `design make`, `--printer` and `--errors` know."""
    rows = [
        (
            name, job.target.size_words, str(target.ring_count // target.face_count), str(target.ring_count),
            f"{job.target.ring_diameter_mm:g}mm", f"{job.target.pitch_mm:g}mm", job.printing.build,
        )
        for name, job, target in targets
    ]  # fmt: skip
    heads = ("name", "size", "rings per face", "in all", "diameter", "pitch", "build")
    say_table(text_table("targets: design make NAME", heads, rows))
    machines = [
        (
            one.name,
            " x ".join(f"{length:g}" for length in one.bed_mm) + "mm",
            *(f"{width:g}mm" for width in (one.nozzle_mm, one.line_width_mm, one.layer_height_mm)),
        )
        for one in printers
    ]
    say_table(text_table("printers: --printer NAME", ("name", "bed", "nozzle", "line", "layer"), machines))
    say_table(text_table("errors: design tolerance TARGET.json --errors NAME", ("name", "of"), errors))


def templates_summary(
    targets: Sequence[tuple[str, Job, TargetGeometry]],
    printers: Sequence[PrinterProfile],
    errors: Sequence[tuple[str, str]],
) -> Summary:
    """The same for a program."""
    return Summary({
        "targets": [
            {"name": name, "build": job.printing.build, "spec": spec_to_mapping(job.target),
             **_target_numbers(target)}
            for name, job, target in targets
        ],
        "printers": [asdict(printer) for printer in printers],
        "errors": [{"name": name, "title": title} for name, title in errors],
    })  # fmt: skip


def _next_steps(design: Design, folder: Path) -> tuple[str, ...]:
    """What a maker does with the files."""
    job, when = design.job, "when there are photos of it, in the folder photos"
    if job.target.is_graded:
        when = "when there is a photo or scan of it, with readings of a caliper: see the page"
    return (
        f"open {folder / PAGE_FILE} in a browser: how to print and measure it, and its photos",
        maker_of(job.printing).next_step(design, str(folder / job.name)),
        f"{_run_line(job, folder)}   # {when}",
    )


def _run_line(job: Job, folder: Path) -> str:
    """The command that follows when the target is made and photographed."""
    if job.target.is_graded:
        return photo_line(job)
    return f"calib run {quoted(folder / f'{job.name}.target.json')} photos -o camera"
