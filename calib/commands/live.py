"""The command `calib live`."""

import webbrowser
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from calib.commands import options
from calib.commands.detect import exports_folder
from calib.commands.running import negative, said_report, solutions_answer
from designer.base.answer import StoppedError, Summary
from designer.base.command import command_line
from designer.base.words import printable
from designer.page.terminal import quoted

if TYPE_CHECKING:
    from calib.api.run_result import RunWriter


def live(
    target: options.TargetArgument,
    *,
    out: Annotated[
        Path | None, typer.Option("--out", "-o", help="folder of photos and results (default: exports/NAME/live)")
    ] = None,
    camera: Annotated[
        str | None,
        typer.Option(help="a camera's number (0), its address (rtsp://...), or a video (default: the browser's)"),
    ] = None,
    size: Annotated[str | None, typer.Option(help="that a camera of this machine is asked for: 1920x1080")] = None,
    watch: Annotated[
        Path | None, typer.Option(help="instead of a camera: the folder that another program writes photos to")
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
    from calib.api.run_result import RunWriter
    from calib.api.solving import models_of
    from calib.capture.live import live as take_photos
    from calib.commands.solve import image_size_of
    from calib.solver.accuracy import UndeterminedError

    writer = RunWriter(out if out is not None else exports_folder(target) / "live", models_of(model))

    def opened(address: str) -> None:
        _said(f"open     {address}")
        if browser:
            webbrowser.open(address)

    try:
        found = take_photos(
            target, writer, cameras=() if camera is None else (camera,), watch=watch,
            size=image_size_of(size), resume=resume, model=model, criteria=criteria,
            made=made, port=port, opened=opened, heard=_said, command=command_line(),
        )  # fmt: skip
    except KeyboardInterrupt:
        _stopped(target, writer)
    except UndeterminedError as error:
        negative(writer, error)
    return said_report(found, writer, remark="", verbose=False, more="and add them with --resume", evaluate="")


def _said(line: str) -> None:
    """A line of what happens, at once: who waits for the address may be a program."""
    print(printable(line), flush=True)


def _stopped(target: Path, writer: "RunWriter") -> None:
    """End after Ctrl-C: photos are kept.

    Raises:
        StoppedError: always.
    """
    again = f"calib live {quoted(target)} -o {quoted(writer.folder)} --resume"
    answer = solutions_answer(writer.finished, None, writer.place_of)
    raise StoppedError(f"stopped; the photos are kept: {again}", Summary(answer, tuple(writer.files))) from None
