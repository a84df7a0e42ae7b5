"""The command `calib budget`."""

from pathlib import Path
from typing import TYPE_CHECKING, Annotated, cast

import typer

from calib.show.screen import waiting
from designer.base.answer import Summary
from designer.base.errors import InputError
from designer.base.words import shown

if TYPE_CHECKING:
    from designer.base.answer import Value

PICTURES = ("format", "version", "rig", "slices", "drawn_mm", "drawn_mm2")
"""Keys of the file that are pictures and no answer."""


def budget(
    rig: Annotated[Path, typer.Argument(help="the rig's file: a rig.json with its covariance, or another tool's")],
    *,
    out: Annotated[Path, typer.Option("--out", "-o", help="folder for the page, budget.json and grid.csv")] = Path(
        "exports/budget"
    ),
    distance: Annotated[
        str | None,
        typer.Option(
            help="what the cameras see from here to there: 0.5m..4m (default: around where the optical axes meet, or 5 "
            "to 25 baselines)"
        ),
    ] = None,
    volume: Annotated[
        str | None,
        typer.Option(help="or a box in the rig's frame: x, y, z as '-20..20,-10..10,80..150cm'"),
    ] = None,
    noise: Annotated[
        str | None, typer.Option(help="of a coordinate in the image: 0.1px (default: as the rig's file has it)")
    ] = None,
    seen_by: Annotated[int, typer.Option(help="cameras that have to see a point", metavar="N")] = 2,
    length: Annotated[str, typer.Option(help="whose error is told, too")] = "100mm",
) -> Summary:
    """Tell how large errors in space are to be expected, in mm: by pixel noise and by the calibration of the rig.

    Also what they come from, and what more frames, another baseline or another camera would buy.
    """
    from calib.api.budgeting import LENGTHS_MM, check_budget_folder
    from calib.api.budgeting import budget as expect
    from calib.commands.folder_page import with_page
    from calib.records.budget_file import BUDGET
    from calib.renderer import quantities
    from calib.show.space.budgeted import facts_of, headline_of, sections_of
    from designer.page.blocks import Facts, Findings, Table
    from designer.page.terminal import say_facts, say_findings, say_headline, say_table, say_written

    check_budget_folder(out)
    with waiting("working out the errors"):
        found = expect(
            rig, volume=None if volume is None else _box(volume),
            distance_mm=None if distance is None else _distances(distance),
            noise_px=None if noise is None else quantities.parsed("--noise", noise, quantities.parse_pixels),
            seen_by=seen_by, length_mm=quantities.length("--length", length, *LENGTHS_MM),
        )  # fmt: skip
        files = found.save(out)
    record = found.record
    say_headline(headline_of(record))
    say_facts(Facts(facts_of(record)))
    for section in sections_of(record):
        for block in section.blocks:
            if isinstance(block, Findings):
                say_findings(block.rows)
            elif isinstance(block, Table):
                say_table(block)
            elif isinstance(block, Facts):
                say_facts(block)
    say_written(out, files)
    answer = cast("dict[str, Value]", BUDGET.document(record))
    summary = Summary(
        {name: value for name, value in answer.items() if name not in PICTURES}, files, remarks=record.remarks
    )
    return with_page(summary, out, "budget")


def _distances(text: str) -> tuple[float, float]:
    """The nearest and the farthest, which may be far."""
    from calib.api.budgeting import DISTANCES_MM
    from calib.renderer.quantities import length_range, parse_distance_mm

    if ".." not in text:
        raise InputError(f"--distance {shown(text)}: give the nearest and the farthest, such as 0.5m..4m")
    return length_range("--distance", text, *DISTANCES_MM, parse_distance_mm)


def _box(text: str) -> tuple[tuple[float, ...], tuple[float, ...]]:
    """The corners of a box: three ranges of lengths, whose last unit is that of all that have none."""
    import re

    from calib.api.budgeting import DISTANCES_MM
    from calib.renderer.quantities import length_range, parse_distance_mm

    parts = text.split(",")
    if len(parts) != 3 or any(".." not in part for part in parts):
        raise InputError(f"--volume {shown(text)}: give three ranges x, y, z such as -20..20,-10..10,80..150cm")
    found = re.search(r"[a-zA-Z]+\s*\Z", text)
    unit = found[0] if found else ""
    largest = DISTANCES_MM[1]
    ranges = [
        length_range(
            "--volume",
            part if re.search(r"[a-zA-Z]\s*\Z", part) else f"{part}{unit}",
            -largest,
            largest,
            parse_distance_mm,
        )
        for part in parts
    ]
    return tuple(low for low, _ in ranges), tuple(high for _, high in ranges)
