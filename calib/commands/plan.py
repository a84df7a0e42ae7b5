"""The command `calib plan`."""

import math
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, cast

import typer

from calib.commands import options
from calib.commands.detect import exports_folder
from designer.base.answer import Summary
from designer.page.progress import progress_bars

if TYPE_CHECKING:
    from designer.base.answer import Value

NOT_REACHED = 1
LEFT_OUT = ("format", "version", "camera")
"""Keys of the file that are no part of the answer."""
PICTURE = "outline_px"
"""Likewise of a photo."""


def plan(
    target: options.TargetArgument,
    *,
    camera: Annotated[str, typer.Option(help="about as it is: its file, or a template such as webcam")],
    out: Annotated[
        Path | None,
        typer.Option("--out", "-o", help="folder for the page, plan.csv and plan.json (default: exports/NAME/plan)"),
    ] = None,
    within: Annotated[
        str | None, typer.Option(help="what 95 % of the image is to stay within: 0.05px (default: as the criteria say)")
    ] = None,
    criteria: options.CriteriaOption = options.DEFAULT_CRITERIA,
    noise: Annotated[str, typer.Option(help="of a coordinate of a large ring's centre")] = "0.05px",
    distance: Annotated[
        str | None, typer.Option(help="where the target may be: 0.3m..0.8m (default: where it fills 30 to 90 %)")
    ] = None,
    most: Annotated[int, typer.Option(help="photos at most", metavar="N")] = 40,
    made: options.MadeOption = None,
    hand_eye: Annotated[
        Path | None,
        typer.Option(help="what calib hand-eye or calib turntable wrote: poses are the robot's, or the table's angles"),
    ] = None,
) -> Summary:
    """Plan the fewest photos that make a camera known as well as wanted, without a camera at hand.

    The exit code is 1 if they do not reach it.
    """
    from calib.api.planning import check_plan_folder
    from calib.api.planning import plan as work_out
    from calib.commands.folder_page import say_next, with_page
    from calib.records.plan_file import PLAN
    from calib.renderer import quantities
    from calib.show.plan.words import facts_of, findings_of, headline_of, sentences_of, steps_of
    from designer.page.blocks import Facts
    from designer.page.terminal import say_facts, say_findings, say_headline, say_lines, say_written

    folder = exports_folder(target) / "plan" if out is None else out
    check_plan_folder(folder)
    with progress_bars() as progress:
        found = work_out(
            target, camera, within_px=None if within is None else _pixels("--within", within), criteria=str(criteria),
            noise_px=_pixels("--noise", noise),
            distance_mm=None if distance is None else quantities.length_range("--distance", distance, 1.0, 1e4),
            most=most, made=made, hand_eye=hand_eye, progress=progress,
        )  # fmt: skip
    files, record = found.save(folder), found.record
    say_headline(headline_of(record))
    say_facts(Facts(facts_of(record)))
    say_lines("photos", [f"{number:2d}. {text}" for number, text in enumerate(sentences_of(record), start=1)])
    say_findings(findings_of(record).rows)
    say_written(folder, files)
    answer = cast("dict[str, Value]", PLAN.document(record))
    photos = cast("list[dict[str, Value]]", answer["photos"])
    answer["photos"] = [{name: value for name, value in one.items() if name != PICTURE} for one in photos]
    told = {name: value for name, value in answer.items() if name not in LEFT_OUT}
    worst_px = record.worst_px if math.isfinite(record.worst_px) else None
    summary = Summary(
        {**told, "is_reached": record.is_reached, "worst_px": worst_px, "covered": record.covered}, files,
        remarks=record.remarks,
        next_steps=steps_of(record, target),
        exit_code=0 if record.is_reached else NOT_REACHED,
    )  # fmt: skip
    return say_next(with_page(summary, folder, found.kind), folder)


def _pixels(option: str, text: str) -> float:
    from calib.renderer import quantities

    return quantities.parsed(option, text, quantities.parse_pixels)
