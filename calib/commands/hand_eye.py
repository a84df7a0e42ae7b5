"""The command `calib hand-eye`."""

from pathlib import Path
from typing import Annotated

import typer

from calib.commands import options
from calib.commands.rig import answers, told_rig
from calib.solver.costs import IMAGE
from designer.base.answer import Summary
from designer.base.errors import InputError
from designer.base.files import named_in_files
from designer.page.progress import progress_bars

TargetArgument = Annotated[
    Path | None, typer.Argument(help="the target file of what the photos show (a table needs none)")
]
PhotosArgument = Annotated[list[str] | None, typer.Argument(help="photos: files, folders or patterns")]
TableOption = Annotated[
    Path | None, typer.Option(help="instead of photos: detections.csv, or a CSV with image,u,v,X,Y,Z")
]
CameraOption = Annotated[Path | None, typer.Option(help="the lens from an earlier run, which is kept")]
RefineOption = Annotated[bool, typer.Option("--refine", help="solve that lens on")]


def hand_eye(
    target: TargetArgument = None,
    photos: PhotosArgument = None,
    *,
    robot: Annotated[Path, typer.Option(help="base_from_flange of each photo: .csv, .yaml or .json")],
    table: TableOption = None,
    points: options.PointsOption = None,
    target_in_hand: Annotated[
        bool, typer.Option("--target-in-hand", help="the robot holds the target; the camera stands beside it")
    ] = False,
    inverted: Annotated[bool, typer.Option("--inverted", help="the robot's file holds flange_from_base")] = False,
    unit: Annotated[str | None, typer.Option(help="of columns that do not name it: mm, m, deg, rad, or m,deg")] = None,
    euler: Annotated[str | None, typer.Option(help="convention of Euler angles: xyz-extrinsic, kuka, fanuc")] = None,
    camera: CameraOption = None,
    refine: RefineOption = False,
    model: options.ModelOption = "all",
    fix: options.FixOption = None,
    minimise: options.MinimiseOption = IMAGE,
    target_size: Annotated[
        bool | None,
        typer.Option(
            "--target-size/--no-target-size",
            help="solve the target's size by the robot's ways alone, or keep it (default: as sure as it was made so)",
            show_default=False,
        ),
    ] = None,
    free_bend: options.FreeBendOption = False,
    robot_noise: Annotated[
        str | None, typer.Option(help="the robot's own errors, if they are known: 0.1mm,0.02deg")
    ] = None,
    made: options.MadeOption = None,
    criteria: options.CriteriaOption = options.DEFAULT_CRITERIA,
    page: options.PageOption = True,
    jobs: options.PhotoJobsOption = None,
    verbose: options.VerboseOption = False,
    out: Annotated[Path, typer.Option("--out", "-o", help="folder for the results")],
) -> Summary:
    """Solve where a camera sits on a robot, or beside it: camera, robot's noise and target's size in one adjustment.

    The exit code is 1 if the poses do not determine it, or if the verdict is: do not use.
    """
    from calib.api.hand_eye import hand_eye as solve
    from calib.api.rig_result import RigWriter
    from calib.commands.options import points_of

    writer = RigWriter(out)
    kind, diameter_mm = points_of(points)
    with answers("camera"), progress_bars() as progress:
        found = solve(
            target, photos or (), robot=robot, table=table, points=kind, diameter_mm=diameter_mm,
            target_in_hand=target_in_hand, inverted=inverted,
            unit=unit, euler=euler, camera=camera, refine=refine, model=model, fix=fix or (),
            minimise=minimise, target_size=target_size, free_bend=free_bend, robot_noise=_noise_of(robot_noise),
            made=made, criteria=str(criteria), jobs=jobs, progress=progress,
            settings=kept_settings(target, table, robot),
        )  # fmt: skip
    return told_rig(found, writer, page=page, verbose=verbose)


def _noise_of(text: str | None) -> tuple[float, float] | None:
    """The robot's noise: rad, mm."""
    from calib.renderer.quantities import parsed
    from designer.base.units import parse_angle_rad, parse_length_mm

    if text is None:
        return None
    parts = [part.strip() for part in text.split(",")]
    if len(parts) != 2:
        raise InputError(f"--robot-noise {text!r}: give a length and an angle, such as 0.1mm,0.02deg")
    length_mm = parsed("--robot-noise", parts[0], parse_length_mm)
    angle_rad = parsed("--robot-noise", parts[1], parse_angle_rad)
    if not (length_mm > 0 and angle_rad > 0):
        raise InputError(f"--robot-noise {text!r}: both must be more than 0; leave it out to have it estimated")
    return angle_rad, length_mm


def kept_settings(target: Path | None, table: Path | None, robot: Path | None) -> tuple[tuple[str, str], ...]:
    """What was solved from, for the record."""
    named = (("target", target), ("table", table), ("robot", robot))
    return tuple((name, named_in_files(place)) for name, place in named if place is not None)
