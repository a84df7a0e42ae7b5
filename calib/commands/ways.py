"""The command `design ways`: in which way a target is best made."""

from pathlib import Path
from typing import Annotated

import typer

from calib.cameras import DEFAULT, fitted_models
from calib.commands import options
from calib.commands.camera_argument import read_camera
from calib.commands.folder_page import say_next, with_page
from designer.base.answer import Summary, Value
from designer.kinds.presets import one_of
from designer.page.blocks import Finding
from designer.page.progress import progress_bars, waiting
from designer.page.terminal import quoted


def ways(
    target: Annotated[Path, typer.Argument(help="a target file (NAME.target.json)")],
    *,
    by: Annotated[
        str, typer.Option(help="what they are ranked by: distortion_map, focal_length, intersection, pose, ...")
    ] = "distortion_map",
    views: Annotated[int, typer.Option(help="how many photos")] = 90,
    distance: Annotated[
        str | None,
        typer.Option(
            help="of the cameras from the target's origin: 400mm, or 250mm..500mm (default: as the page of a design "
            "advises)"
        ),
    ] = None,
    aim_offset: options.AimOffsetOption = None,
    camera: options.CameraTemplateOption = "machine-vision",
    model: Annotated[
        str,
        typer.Option(
            help=f"camera model that is solved: {', '.join(fitted_models())}", autocompletion=one_of(fitted_models())
        ),
    ] = DEFAULT,
    weighted: options.WeightedOption = False,
    seed: options.SeedOption = 1,
    out: Annotated[Path, typer.Option("--out", "-o", help="folder for tables, figures and the page")],
) -> Summary:
    """How is it best made? All ways of making that suit a target, by the camera's error, price and hours.

    Predicted from error templates; what each of their errors costs is on the page.
    """
    from calib.api.tolerancing import ways as find_ways
    from calib.app.inputs import DISTANCES_MM
    from calib.renderer.quantities import length, length_range
    from calib.show.studies.ways_tables import ways_headline, ways_table
    from designer.page.terminal import say_findings, say_headline, say_table, say_written

    read_camera(camera)
    with progress_bars() as progress:
        found = find_ways(
            target, by=by, views=views,
            distance_mm=None if distance is None else length_range("--distance", distance, *DISTANCES_MM),
            aim_offset_mm=None if aim_offset is None else length("--aim-offset", aim_offset, 0, DISTANCES_MM[1]),
            camera=camera, model=model, weighted=weighted, seed=seed, progress=progress,
        )  # fmt: skip
    with waiting("drawing figures"):
        files = found.save(out)
    study, warnings = found.study, found.study.setting.warnings
    say_headline(ways_headline(study, by))
    say_findings([Finding("usable", "", line) for line in warnings])
    print()
    say_table(ways_table(study, by))
    say_written(out, files)
    best = study.ways(by)[0].way.name
    step = f"design tolerance {quoted(target)} --errors {best} -o tolerance   # draws, which check the prediction"
    rows: list[Value] = [
        {
            "way": one.way.name, "title": one.way.title, "totals": dict(one.asked.totals), "beyond": one.asked.beyond,
            "worst": one.worst, "price_eur": one.way.price_eur, "hours": one.way.hours,
        }
        for one in study.ways(by)
    ]  # fmt: skip
    summary = Summary({"ranked_by": by, "ways": rows}, files, (step,), warnings)
    return say_next(with_page(summary, out, "ways"), out)
