"""The command `calib convert`."""

import shlex
from pathlib import Path
from typing import Annotated

import typer

from calib.cameras import fitted_models
from calib.commands.camera_argument import camera_answer, camera_line, refit_answer, refit_line
from calib.interop import FORMATS
from designer.base.answer import Summary
from designer.base.words import printable
from designer.kinds.presets import camera_templates, one_of
from designer.page.terminal import quoted


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
    lens: Annotated[
        str | None,
        typer.Option(
            help="lens of the file, by its own name for it, such as OPENCV (default: the closest)", metavar="LENS"
        ),
    ] = None,
    without: Annotated[
        list[str] | None, typer.Option(help="lens parameter to leave out, such as k3", metavar="NAME")
    ] = None,
) -> Summary:
    """Write a camera as a file of another tool, or read one of its files.

    Of the file's lenses the camera's own is written, or the closest one: it is fitted over the whole image, and the
    residual is told in pixels. Of a file with several cameras one is named as in chain.yaml#cam1.
    """
    from calib.api.converting import convert as converted
    from calib.interop.choosing import LARGE_PX

    done = converted(camera, to, source=source, model=model, lens=lens, without=without or (), out=out)
    done.save(out)
    opened, held, target = done.opened, done.held, done.format
    print(f"read   {printable(camera)}: {opened.format.title}, {camera_line(opened.read.camera)}")
    for remark in opened.read.remarks:
        print(f"       {remark}")
    for fitted, one in done.named_fits:
        print(refit_line(fitted, one))
    print(f"wrote  {printable(str(out))}: {target.title}, {camera_line(held.camera, held.called)}")
    if len(held.tried) > 1:
        others = ", ".join(f"{one.name} {fit.rms_px:.4f}" for one, fit in held.tried)
        print(f"chosen {held.lens.name}, the closest of (RMS in px) {others}; another with --lens")
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
            "written": {"file": str(out), "format": target.name, "lens": held.lens.name, **camera_answer(held.camera)},
            "is_exact": not done.fits,
            "rms_px": done.rms_px,
            "max_px": done.max_px,
            "fits": [refit_answer(one) for one in done.fits],
            "tried": [{"lens": one.name, **refit_answer(fit)} for one, fit in held.tried],
            "lost": done.lost,
        },
        (out,),
        (f"calib diff {shlex.quote(printable(camera))} {quoted(out)}",) if done.is_far else (),
        opened.read.remarks,
    )
