"""The command `calib convert`."""

import shlex
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from calib.cameras import fitted_models
from calib.commands.camera_argument import camera_answer, refit_answer
from calib.interop import FORMATS
from designer.base.answer import Summary
from designer.base.words import printable
from designer.kinds.presets import camera_templates, one_of
from designer.page.terminal import quoted

if TYPE_CHECKING:
    from calib.cameras.camera import Camera
    from calib.cameras.refit import Refit


def convert(
    camera: Annotated[
        str,
        typer.Argument(
            help="camera file of any of these kinds, a folder with one, or a template", autocompletion=camera_templates
        ),
    ],
    *,
    to: Annotated[
        str,
        typer.Option(
            help=f"kind of file to write: {'|'.join(FORMATS)}", metavar="FORMAT", autocompletion=one_of(FORMATS)
        ),
    ],
    out: Annotated[Path, typer.Option("--out", "-o", help="file to write", metavar="FILE")],
    source: Annotated[
        str | None,
        typer.Option(
            "--from",
            help="kind of file to read (default: found out)",
            metavar="FORMAT",
            autocompletion=one_of(FORMATS),
        ),
    ] = None,
    model: Annotated[
        str | None,
        typer.Option(
            help=f"camera model to write: {'|'.join(fitted_models())} (default: what the file can hold)",
            autocompletion=one_of(fitted_models()),
        ),
    ] = None,
    without: Annotated[
        list[str] | None, typer.Option(help="lens parameter to leave out, such as k3", metavar="NAME")
    ] = None,
) -> Summary:
    """Write a camera as a file of another tool, or read one of its files.

    What a file cannot hold is fitted over the whole image by what it can, and the residual is told in pixels.
    Of a file with several cameras one is named as in chain.yaml#cam1.
    """
    from calib.api.converting import LARGE_PX
    from calib.api.converting import convert as converted

    done = converted(camera, to, source=source, model=model, without=without or (), out=out)
    done.save(out)
    opened, written, target = done.opened, done.camera, done.format
    print(f"read   {printable(camera)}: {opened.format.title}, {_described(opened.read.camera)}")
    for remark in opened.read.remarks:
        print(f"       {remark}")
    for one in done.fits:
        _say_refit(one)
    print(f"wrote  {printable(str(out))}: {target.title}, {_described(written)}")
    for loss in done.lost:
        print(f"lost   {loss}")
    if not done.fits:
        print("exact  no fit was needed")
    elif done.is_far:
        print(f"warning: the two cameras differ by more than {LARGE_PX:g} px somewhere; see where with calib diff")
    print(f"open   {target.opens_with.format(file=printable(str(out)), url=out.absolute().as_uri())}")
    return Summary(
        {
            "read": {"file": camera, "format": opened.format.name, **camera_answer(opened.read.camera)},
            "written": {"file": str(out), "format": target.name, **camera_answer(written)},
            "is_exact": not done.fits,
            "rms_px": done.rms_px,
            "max_px": done.max_px,
            "fits": [refit_answer(one) for one in done.fits],
            "lost": done.lost,
        },
        (out,),
        (f"calib diff {shlex.quote(printable(camera))} {quoted(out)}",) if done.is_far else (),
        opened.read.remarks,
    )


def _described(camera: "Camera") -> str:
    """Model, image size and the linear part."""
    fx, fy, cx, cy = camera.params[:4]
    width, height = camera.image_size
    return f"{camera.model}, {width} x {height} px, f {fx:.2f} {fy:.2f}, centre {cx:.2f} {cy:.2f} px"


def _say_refit(refit: "Refit") -> None:
    """The residual of a fit, and over how much of the image it was made."""
    import numpy as np

    known = "the whole image" if refit.known == 1 else f"the {100 * refit.known:.0f} % of the image that is known"
    print(f"fitted {refit.camera.model} over {known}: RMS {refit.rms_px:.4f} px, max {refit.max_px:.4f} px")
    if refit.turn_rad:
        print(
            f"turned its frame by {np.degrees(refit.turn_rad):.3f} deg: poses found with the old camera are not in it"
        )
