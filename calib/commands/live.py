"""The command `calib live`."""

import webbrowser
from pathlib import Path
from typing import Annotated

import typer

from calib.app.options import exports_folder
from calib.commands import options
from designer.base.answer import Summary


def live(
    target: options.TargetArgument,
    *,
    out: Annotated[
        Path | None, typer.Option("--out", "-o", help="folder of photos and results (default: exports/NAME/live)")
    ] = None,
    camera: Annotated[
        list[str] | None,
        typer.Option(
            help="a camera's number (0), its address (rtsp://...), or a video; again for each of a rig "
            "(default: the browser's)"
        ),
    ] = None,
    size: Annotated[str | None, typer.Option(help="that a camera of this machine is asked for: 1920x1080")] = None,
    watch: Annotated[
        list[Path] | None,
        typer.Option(help="instead: the folder that another program writes photos to; again for each of a rig"),
    ] = None,
    resume: Annotated[bool, typer.Option("--resume", help="go on with the session in the folder")] = False,
    model: options.ModelOption = "all",
    made: options.MadeOption = None,
    criteria: options.CriteriaOption = options.DEFAULT_CRITERIA,
    port: Annotated[int, typer.Option(min=0, max=65535, help="of the page, on this machine (0: any)")] = 0,
    browser: Annotated[bool, typer.Option("--open/--no-open", help="open the page in the browser")] = True,
) -> Summary:
    """Take photos under guidance: a page shows where to hold the target next, until the camera is good.

    Nothing leaves this machine. Photos are written as they are taken; at the end the folder is as after calib run.
    """
    from calib.app.calibration import Run
    from calib.capture.live import live as take_photos
    from calib.commands.live_rigs import take_rig_photos
    from calib.commands.live_said import line_to_go_on, line_to_show, said, stopped_live
    from calib.commands.options import image_size_of
    from calib.solver.accuracy import UndeterminedError
    from designer.page.capability import no_answer, told
    from designer.page.output import Output

    cameras, folders, wide = camera or [], watch or [], image_size_of(size, "--size")
    folder = out if out is not None else exports_folder(target) / "live"

    def opened(address: str) -> None:
        said(f"open     {address}")
        if browser:
            webbrowser.open(address)

    if len(cameras) + len(folders) > 1:
        return take_rig_photos(
            target, folder, cameras=cameras, watch=folders, size=wide, resume=resume, model=model, criteria=criteria,
            made=made, port=port, opened=opened,
        )  # fmt: skip
    writer = Output(folder, folder)
    try:
        found = take_photos(
            target, writer, cameras=cameras, watch=folders[0] if folders else None, size=wide, resume=resume,
            model=model, criteria=criteria, made=made, port=port, opened=opened, heard=said, command=line_to_show(),
        )  # fmt: skip
    except KeyboardInterrupt:
        stopped_live(Summary(writer.answer, tuple(writer.files)))
    except UndeterminedError as error:
        raise no_answer(Run, writer, str(error)) from None
    return told(found, writer, line_to_go_on(), verbose=False, has_page=False)
