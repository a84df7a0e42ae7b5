"""The command `calib rig`."""

from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from calib.app.options import exports_folder
from calib.commands import options
from calib.solver.costs import IMAGE
from designer.base.answer import NegativeError, StoppedError, Summary, command_line
from designer.base.command import NOTHING_WRITTEN
from designer.base.files import named_in_files
from designer.page.progress import progress_bars, waiting

BAD = 1
"""The rig is not to be used."""

if TYPE_CHECKING:
    from calib.api.rig_result import RigResult, RigWriter


def rig(
    target: Annotated[
        Path | None,
        typer.Argument(help="the target file of what the photos show (a table of sightings needs none)"),
    ] = None,
    photos: Annotated[
        list[str] | None, typer.Argument(help="a folder a camera, or one folder that holds these", metavar="FOLDER...")
    ] = None,
    *,
    out: Annotated[Path | None, typer.Option("--out", "-o", help="folder (default: exports/NAME/rig, or rig)")] = None,
    table: Annotated[
        Path | None,
        typer.Option(
            help="instead of photos: files (camera,frame,file[,time_s]) or sightings (camera,frame,u,v,X,Y,Z)"
        ),
    ] = None,
    pattern: Annotated[
        str | None, typer.Option(help="file names of all cameras in one folder: '{camera}_{frame}.png'")
    ] = None,
    times: Annotated[
        Path | None, typer.Option(help="time stamps (camera,file,time_s), which tell what was taken at once")
    ] = None,
    tolerance: Annotated[
        str | None, typer.Option(help="of time stamps of one frame (default where they have to tell: 20ms)")
    ] = None,
    points: options.PointsOption = None,
    model: Annotated[
        list[str] | None,
        typer.Option(
            help="of all cameras, or of one: left=fisheye (default: opencv, of a wide lens what leaves least)"
        ),
    ] = None,
    camera: Annotated[
        list[str] | None,
        typer.Option(help="a camera's lens from an earlier run, which is kept: left=left/camera.json"),
    ] = None,
    refine: Annotated[
        list[str] | None, typer.Option(help="solve the lens of this camera on from the one that is given; or all")
    ] = None,
    fix: Annotated[list[str] | None, typer.Option(help="keep a parameter: k3, k3=0, of one camera left:k3=0")] = None,
    reference: Annotated[str | None, typer.Option(help="camera whose frame the rig's is (default: the first)")] = None,
    loss: options.LossOption = "squares",
    reject: options.RejectOption = None,
    weighted: options.WeightedOption = True,
    minimise: options.MinimiseOption = IMAGE,
    delays: Annotated[
        bool, typer.Option("--delays", help="estimate how late each camera is, from time stamps of a moving target")
    ] = False,
    made: options.MadeOption = None,
    criteria: options.CriteriaOption = options.DEFAULT_CRITERIA,
    page: options.PageOption = True,
    verbose: options.VerboseOption = False,
    jobs: options.PhotoJobsOption = None,
) -> Summary:
    """Solve where several cameras stand that saw one target together, their lenses, and how surely.

    The exit code is 1 if the frames do not determine the rig, or if the verdict is: do not use.
    """
    from calib.api.rig_result import RigWriter
    from calib.api.rigging import rig as solve_rig
    from calib.commands.options import points_of
    from calib.commands.rig_screen import lenses_of, models_of, refined_of, tolerance_of

    writer = RigWriter(out if out is not None else Path("rig") if target is None else exports_folder(target) / "rig")
    kind, diameter_mm = points_of(points)
    with answers("rig"), progress_bars() as progress:
        found = solve_rig(
            target, photos or (), table=table, pattern=pattern, times=times, tolerance_s=tolerance_of(tolerance),
            points=kind, diameter_mm=diameter_mm,
            model=models_of(model), cameras=lenses_of(camera), refine=refined_of(refine), fix=fix or (),
            reference=reference, loss=loss, reject_sigma=reject, weighted=weighted, minimise=minimise,
            delays=delays, made=made, criteria=criteria, jobs=jobs, progress=progress,
            settings=_settings(target, photos, table, made),
        )  # fmt: skip
    return told_rig(found, writer, page=page, verbose=verbose)


@contextmanager
def answers(sought: str) -> Iterator[None]:
    """What a person stopped, or photos do not tell, ends with an answer: there is no rig, no camera."""
    from calib.api.rig_observing import BlindCameraError
    from calib.solver.accuracy import UndeterminedError

    try:
        yield
    except KeyboardInterrupt:
        raise StoppedError(NOTHING_WRITTEN, Summary({})) from None
    except (BlindCameraError, UndeterminedError) as error:
        raise NegativeError(f"no {sought}: {error}", Summary({"verdict": None}, remarks=(str(error),))) from None


def told_rig(found: "RigResult", writer: "RigWriter", *, page: bool, verbose: bool) -> Summary:
    """Write everything, and say what came of it."""
    writer.write(found)
    try:
        with waiting("drawing the page"):
            remark = writer.write_page(found, command_line()) if page else writer.earlier_page()
    except KeyboardInterrupt:
        raise StoppedError("stopped; the rig is written, its page is not", Summary({}, tuple(writer.files))) from None
    return said_rig(found, writer, remark=remark, verbose=verbose)


def said_rig(found: "RigResult", writer: "RigWriter", *, remark: str, verbose: bool) -> Summary:
    """Say what came of a rig that is written."""
    from calib.commands.rig_screen import rig_answer, say_next, say_rig
    from designer.page.terminal import say_lines, say_written

    remarks = tuple(filter(None, [remark]))
    say_rig(found, verbose=verbose)
    say_written(writer.folder, writer.files)
    say_lines("", remarks)
    steps = say_next(found, writer.folder)
    answer = rig_answer(found, writer.folder)
    code = BAD if found.verdict.grade == "bad" else 0
    return Summary(answer, tuple(writer.files), steps, (*found.remarks, *remarks), code)


def _settings(
    target: Path | None, photos: list[str] | None, table: Path | None, made: str | None
) -> tuple[tuple[str, str], ...]:
    """What was solved from, for the record."""
    named = [("target", target), *(("photos", Path(one)) for one in photos or ()), ("table", table)]
    kept = tuple((name, named_in_files(place)) for name, place in named if place is not None)
    return kept if made is None else (*kept, ("made", made))
