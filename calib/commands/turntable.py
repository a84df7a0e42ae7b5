"""The command `calib turntable`."""

import math
from pathlib import Path
from typing import Annotated

import typer

from calib.commands import options
from calib.commands.hand_eye import (
    CameraOption,
    PhotosArgument,
    RefineOption,
    TableOption,
    TargetArgument,
    kept_settings,
)
from calib.commands.rig import answers, told_rig
from calib.solver.costs import IMAGE
from designer.base.answer import Summary
from designer.page.progress import progress_bars


def turntable(
    target: TargetArgument = None,
    photos: PhotosArgument = None,
    *,
    step: Annotated[
        str | None, typer.Option(help="the table's turn from photo to photo: 10deg (default: all angles are unknown)")
    ] = None,
    table: TableOption = None,
    points: options.PointsOption = None,
    camera: CameraOption = None,
    refine: RefineOption = False,
    model: options.ModelOption = "all",
    fix: options.FixOption = None,
    minimise: options.MinimiseOption = IMAGE,
    made: options.MadeOption = None,
    criteria: options.CriteriaOption = options.DEFAULT_CRITERIA,
    page: options.PageOption = True,
    jobs: options.PhotoJobsOption = None,
    verbose: options.VerboseOption = False,
    out: Annotated[Path, typer.Option("--out", "-o", help="folder for the results")],
) -> Summary:
    """Solve where a camera stands beside a turntable, its axis and its angles.

    The exit code is 1 if the photos do not determine it, or if the verdict is: do not use.
    """
    from calib.api.hand_eye import turntable as solve
    from calib.api.rig_result import RigWriter
    from calib.commands.options import points_of
    from calib.renderer.quantities import parsed
    from designer.base.units import parse_angle_rad

    writer = RigWriter(out)
    kind, diameter_mm = points_of(points)
    angle_rad = None if step is None else parsed("--step", step, parse_angle_rad)
    with answers("camera"), progress_bars() as progress:
        found = solve(
            target, photos or (), step_deg=None if angle_rad is None else math.degrees(angle_rad),
            table=table, points=kind, diameter_mm=diameter_mm,
            camera=camera, refine=refine, model=model, fix=fix or (), minimise=minimise, made=made,
            criteria=str(criteria), jobs=jobs, progress=progress, settings=kept_settings(target, table, None),
        )  # fmt: skip
    return told_rig(found, writer, page=page, verbose=verbose)
