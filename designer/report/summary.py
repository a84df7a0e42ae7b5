"""What the commands of `design` say at their end, to a person and to a program."""

import shlex
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import asdict
from pathlib import Path

from rich.console import Console
from rich.table import Table

from designer.base.answer import Summary, Value
from designer.base.units import NO_SKEW, format_skew
from designer.formats.folder import Written
from designer.make.bed import printed_size_mm
from designer.make.printability import PrintCheck
from designer.produce import Design
from designer.spec.kind import spec_to_mapping
from designer.spec.spec import Job, PrinterProfile, PrintSpec
from designer.target import TargetGeometry

VIOLATED = 1

_MARK = {"violation": "[bold red]VIOLATED[/]", "warning": "[yellow]warning[/]", "note": "[dim]note[/]"}


def _console() -> Console:
    return Console(highlight=False, soft_wrap=True)


@contextmanager
def progress() -> Iterator[Callable[[str], None]]:
    """Show the stage at work on standard error, while there is one."""
    console = Console(stderr=True)
    with console.status("designing") as status:
        yield lambda stage: status.update(f"making {stage}")


def print_design(design: Design, remarks: Sequence[str], check: PrintCheck, written: Written) -> None:
    """Sizes, files, findings and the next command after a target was made."""
    job, target, console = design.job, design.target, _console()
    console.print(f"[bold]{job.name}[/]  target id {target.geometry_id}")
    pattern = design.printed_pattern if job.printing.is_two_filament else design.artwork
    facts = [*_facts(job, target), ("chosen", "\n".join([*remarks, pattern.lettering.remark]))]
    console.print(_two_columns(facts))
    _print_rules(console, check)
    console.print(f"\nwrote {len(written.files)} files to [bold]{_escaped(str(written.folder))}[/]")
    table = Table.grid(padding=(0, 2))
    table.add_column(overflow="fold")
    for file in written.files:
        table.add_row(f"  {file.name}", _bytes(len(file.content)), f"[dim]{file.purpose}[/]")
    console.print(table)
    for line in written.replaced:
        console.print(f"[yellow]{_escaped(line)}[/]")
    if written.left:
        console.print(
            f"[yellow]left from an earlier run, maybe of another target:[/] {_escaped(', '.join(written.left))}"
        )
    console.print(f"\n[bold]next[/]  {_next_step(job, written.folder)}")


def design_summary(design: Design, remarks: Sequence[str], check: PrintCheck, written: Written) -> Summary:
    """The same for a program."""
    job, target = design.job, design.target
    pattern = design.printed_pattern if job.printing.is_two_filament else design.artwork
    answer: dict[str, Value] = {
        "name": job.name,
        **_target_numbers(target),
        "spec": spec_to_mapping(job.target),
        "printing": asdict(job.printing),
        "printed_size_mm": list(printed_size_mm(target, job.printing)),
        **_findings(check),
        "files": [{"name": one.name, "bytes": len(one.content), "purpose": one.purpose} for one in written.files],
        "left_from_earlier": written.left,
    }
    return Summary(
        answer,
        tuple(written.folder / file.name for file in written.files),
        (_run_line(job, written.folder),),
        (*remarks, pattern.lettering.remark, *written.replaced),
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


def print_check(name: str, target: TargetGeometry, printing: PrintSpec, check: PrintCheck) -> None:
    """The findings of `design check`."""
    console, printer = _console(), printing.printer
    console.print(
        f"[bold]{_escaped(name)}[/]  target id {target.geometry_id}, {printing.build} on {_escaped(printer.name)}, "
        f"nozzle {printer.nozzle_mm:g}mm, lines {printer.line_width_mm:g}mm, layers {printer.layer_height_mm:g}mm"
    )
    _print_rules(console, check)


def print_templates(
    targets: Sequence[tuple[str, Job, TargetGeometry]],
    printers: Sequence[PrinterProfile],
    errors: Sequence[tuple[str, str]],
) -> None:
    """What `design make`, `--printer` and `--errors` know."""
    console = _console()
    table = Table(title="targets: design make NAME", title_justify="left", box=None, padding=(0, 2, 0, 0))
    for heading in ("name", "size", "rings per face", "in all", "diameter", "pitch", "build"):
        table.add_column(heading)
    for name, job, target in targets:
        spec = job.target
        table.add_row(
            name, spec.size_words, str(target.ring_count // target.face_count), str(target.ring_count),
            f"{spec.ring_diameter_mm:g}mm", f"{spec.pitch_mm:g}mm", job.printing.build,
        )  # fmt: skip
    console.print(table)
    table = Table(title="\nprinters: --printer NAME", title_justify="left", box=None, padding=(0, 2, 0, 0))
    for heading in ("name", "bed", "nozzle", "line", "layer"):
        table.add_column(heading)
    for printer in printers:
        bed = " x ".join(f"{length:g}" for length in printer.bed_mm)
        widths = (printer.nozzle_mm, printer.line_width_mm, printer.layer_height_mm)
        table.add_row(printer.name, f"{bed}mm", *(f"{width:g}mm" for width in widths))
    console.print(table)
    table = Table("name", "of", title="\nerrors: design tolerance TARGET.json --errors NAME", title_justify="left",
                  box=None, padding=(0, 2, 0, 0))  # fmt: skip
    for row in errors:
        table.add_row(*row)
    console.print(table)


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


def _facts(job: Job, target: TargetGeometry) -> list[tuple[str, str]]:
    """Sizes of a target and its print."""
    spec, printing = job.target, job.printing
    dots = int(target.is_dot.sum())
    per_face = target.ring_count // target.face_count
    faces = f"{target.ring_count}" if target.is_planar else f"{per_face} per face, {target.ring_count} in all"
    printed = " x ".join(f"{length:.1f}" for length in printed_size_mm(target, printing))
    printer = printing.printer
    facts = [
        ("target", f"{spec.facts()[0][1]}; {spec.facts()[-1][1]}; {printing.build}"),
        ("rings", f"{faces}, of which {dots} are dots"),
        ("", f"diameter {spec.ring_diameter_mm:g}mm, pitch {spec.pitch_mm:g}mm, border {spec.border_mm:g}mm"),
        ("printed size", f"{printed} mm"),
        ("printer", f"{_escaped(printer.name)}, nozzle {printer.nozzle_mm:g}mm, layers {printer.layer_height_mm:g}mm"),
    ]
    if printing.is_two_filament:
        facts.append(("ink", f"{printing.inlay_mm:g}mm deep, offset {printing.ink_offset_mm:g}mm"))
    if printing.shrink_compensation_percent:
        facts.append(("shrinkage", f"printed {printing.shrink_compensation_percent:g} % larger"))
    if printing.skew_compensation_rad != NO_SKEW:
        skew = format_skew(printing.skew_compensation_rad)
        facts.append(("skew", f"sheared against {skew}; print it as it lies in the files, do not turn it"))
    return facts


def _print_rules(console: Console, check: PrintCheck) -> None:
    rows = [(_MARK[finding.level], f"{finding.rule}: {_escaped(finding.text)}") for finding in check.findings]
    if check.holding:
        rows.insert(0, ("[green]hold[/]", ", ".join(check.holding)))
    console.print("\n[bold]design rules[/]")
    console.print(_two_columns(rows))


def _next_step(job: Job, folder: Path) -> str:
    """What a maker does with the files."""
    name = folder / job.name
    if job.printing.is_two_filament:
        slicers = f"{name}.bambu.3mf in Bambu Studio or OrcaSlicer, or {name}.prusa.3mf in PrusaSlicer"
        what = f"open {slicers}; filament 1 is the body, 2 the ink"
    elif job.printing.build == "stickers":
        what = (
            f"print {name}.pdf at 100 % and {name}.body.stl in one filament, then glue the stickers on by their numbers"
        )
    else:
        what = f"have {name}.pdf printed at 100 % and measure its scale bar"
    page = f"open {_escaped(str(folder / 'index.html'))} in a browser: how to print and measure it, and its photos"
    run = f"{_escaped(_run_line(job, folder))}   [dim]# when there are photos of it, in the folder photos[/]"
    return f"{page}\n      {_escaped(what)}\n      {run}"


def _run_line(job: Job, folder: Path) -> str:
    """The command that follows when the target is made and photographed."""
    return f"calib run {shlex.quote(str(folder / f'{job.name}.target.json'))} photos -o camera"


def _two_columns(rows: Sequence[tuple[str, str]]) -> Table:
    table = Table.grid(padding=(0, 2))
    for left, right in rows:
        table.add_row(f"  {left}", right)
    return table


def _bytes(count: int) -> str:
    return f"{count / 1e6:.1f} MB" if count >= 1e6 else f"{count / 1e3:.1f} kB"


def _escaped(text: str) -> str:
    """Text that rich prints as it is."""
    return text.replace("[", r"\[")
