"""The command `calib triangulate`."""

from pathlib import Path
from typing import TYPE_CHECKING, Annotated, cast

import typer

from calib.commands.options import PhotoJobsOption
from designer.base.answer import Summary
from designer.base.errors import InputError
from designer.page.progress import progress_bars

if TYPE_CHECKING:
    from designer.base.answer import Value

NO_POINT = 1
PICTURES = ("format", "version", "rig", "drawn_mm", "drawn_mm2", "arrows")
"""Keys of the file that are pictures and no answer."""


def triangulate(
    rig: Annotated[Path, typer.Argument(help="the rig's file: a rig.json, or another tool's")],
    sightings: Annotated[
        Path | None,
        typer.Argument(
            help="what its cameras see: camera,frame,point,u,v and perhaps sigma_px; or of a check object with X,Y,Z, "
            "as of calib rig"
        ),
    ] = None,
    *,
    target: Annotated[
        Path | None, typer.Option(help="a check object (NAME.target.json), whose distances are compared")
    ] = None,
    photos: Annotated[
        list[str] | None,
        typer.Option(
            help="of the check object: a folder that holds one a camera, named as in the rig; or again and again, a "
            "folder each",
            metavar="FOLDER",
        ),
    ] = None,
    out: Annotated[
        Path, typer.Option("--out", "-o", help="folder for the page and points.csv; or a .csv, for the table alone")
    ] = Path("exports/points"),
    noise: Annotated[
        str | None,
        typer.Option(help="of a sighting that states none: 0.1px (default: as the rig's file has it)"),
    ] = None,
    rejects: Annotated[
        bool, typer.Option("--reject/--keep-all", help="leave out sightings that contradict the others, or none")
    ] = True,
    jobs: PhotoJobsOption = None,
) -> Summary:
    """Find where points are that several cameras of a rig see, and how surely, by noise and by the rig's own errors.

    The exit code is 1 if no point has a position.
    """
    from calib.api.triangulating import TABLE_SUFFIX, check_points_place
    from calib.api.triangulating import triangulate as find_points
    from calib.commands.folder_page import with_page
    from calib.records.triangulation_file import TRIANGULATION
    from calib.renderer.quantities import parse_pixels, parsed
    from calib.show.space.triangulated import facts_of, headline_of, is_negative, scale_words, sections_of
    from designer.page.blocks import Facts, Findings, Table
    from designer.page.terminal import say_facts, say_findings, say_headline, say_line, say_table, say_written

    check_points_place(out)
    if out in (rig, sightings):
        raise InputError(f"{out}: is a file to read; choose another name with -o")
    with progress_bars() as progress:
        found = find_points(
            rig, sightings, target=target, photos=photos or (), rejects=rejects, jobs=jobs, progress=progress,
            noise_px=None if noise is None else parsed("--noise", noise, parse_pixels),
        )  # fmt: skip
    files = found.save(out)
    record = found.record
    say_headline(headline_of(record))
    say_facts(Facts(facts_of(record)))
    for block in (block for section in sections_of(record) for block in section.blocks):
        if isinstance(block, Findings):
            say_findings(block.rows)
        elif isinstance(block, Table):
            say_table(block)
    if record.lengths is not None:
        say_line("scale", scale_words(record.lengths))
    is_table = out.suffix.lower() == TABLE_SUFFIX
    say_written(out.parent if is_table else out, files)
    answer = cast("dict[str, Value]", TRIANGULATION.document(record))
    summary = Summary(
        {name: value for name, value in answer.items() if name not in PICTURES},
        files, remarks=record.remarks, exit_code=NO_POINT if is_negative(record) else 0,
    )  # fmt: skip
    return summary if is_table else with_page(summary, out, "triangulation")
