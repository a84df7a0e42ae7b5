"""The command `calib coupon`."""

from pathlib import Path
from typing import TYPE_CHECKING, Annotated, cast

import typer

from calib.commands.options import PhotosArgument
from designer.base.answer import Summary
from designer.base.command import command_line
from designer.base.errors import InputError
from designer.kinds.presets import printer_templates
from designer.page.progress import progress_bars

if TYPE_CHECKING:
    from designer.base.answer import Value


def coupon(
    photos: PhotosArgument,
    *,
    out: Annotated[Path, typer.Option("--out", "-o", help="folder for the page and coupon.json")] = Path(
        "exports/coupon"
    ),
    target: Annotated[
        Path | None, typer.Option(help="the coupon's target file (default: that of design coupon, all are alike)")
    ] = None,
    length: Annotated[
        list[str] | None,
        typer.Option(help="a caliper's length between rings, which tells the size: 'ring 0 to ring 4:30.38mm+-0.03mm'"),
    ] = None,
    dpi: Annotated[
        str | None, typer.Option(help="the pictures are a flatbed's scans: 600, or file for what their files state")
    ] = None,
    ink_offset: Annotated[
        str, typer.Option(help="that this coupon was printed with, to tell that of the next")
    ] = "0mm",
    shrink_compensation: Annotated[str, typer.Option(help="likewise")] = "0%",
    skew_compensation: Annotated[str, typer.Option(help="likewise: 'xy 0.02deg'")] = "0",
    save: Annotated[
        Path | None,
        typer.Option(help="printer file to write, for design --printer: with what was found", metavar="FILE.toml"),
    ] = None,
    printer: Annotated[
        str | None,
        typer.Option(
            help="whose other lines --save takes over (default: that of design)", autocompletion=printer_templates
        ),
    ] = None,
) -> Summary:
    """Tell ink bleed, scale and skew of a printer from photos or scans of its coupon (design coupon).

    Take the photo squarely from above, sharp, the coupon filling the picture; one is enough, more are surer.
    """
    from calib.api.coupon import FILE, require_printer_file
    from calib.api.coupon import coupon as look_at
    from calib.records.coupon import COUPON
    from calib.renderer.quantities import parsed
    from calib.show.coupon.words import bleed_table, facts_of, findings_of, headline_of, next_steps, shape_table
    from calib.show.folder import write_folder_page
    from designer.base.units import parse_length_mm, parse_percent, parse_skew_rad
    from designer.page.blocks import Command
    from designer.page.terminal import quoted, say_facts, say_findings, say_headline, say_lines, say_table, say_written

    if save is not None:
        require_printer_file(save, printer)
    elif printer is not None:
        raise InputError("--printer: is whose other lines --save takes over; give --save FILE.toml, or leave it out")
    with progress_bars() as progress:
        told = look_at(
            photos, target=target, lengths=length or (), dpi=dpi if dpi in (None, FILE) else _dpi(dpi),
            ink_offset_mm=parsed("--ink-offset", ink_offset, parse_length_mm),
            shrink_compensation_percent=parsed("--shrink-compensation", shrink_compensation, parse_percent),
            skew_compensation_rad=parsed("--skew-compensation", skew_compensation, parse_skew_rad), progress=progress,
        )  # fmt: skip
    record = told.record
    files = (*told.save(out), *(() if save is None else (told.save_printer(save, printer),)))
    page, remark = write_folder_page(out, told.kind, command_line())
    say_headline(headline_of(record))
    say_facts(facts_of(record))
    say_findings(findings_of(record).rows)
    say_table(bleed_table(record))
    say_table(shape_table(record))
    say_written(out, (*files, *page))
    say_lines("note", [remark] if remark else [])
    kept = f"design ... --printer {quoted(save)}" if save is not None else ""
    steps = [f"{one.line}   # {one.purpose}" if isinstance(one, Command) else one.text for one in next_steps(record)]
    say_lines("next", (*([f"{kept}   # with all that was found"] if kept else []), *steps))
    commands = tuple(one.line for one in next_steps(record) if isinstance(one, Command))
    answer = cast("dict[str, Value]", COUPON.document(record))
    return Summary(
        answer, (*files, *page), (kept,) if kept else commands, (*record.remarks, *([remark] if remark else []))
    )


def _dpi(text: str) -> float:
    """A number of dots per inch."""
    try:
        return float(text.lower().removesuffix("dpi"))
    except ValueError:
        raise InputError(f"--dpi {text!r}: give a number such as 600, or file") from None
