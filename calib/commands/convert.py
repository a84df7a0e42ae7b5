"""The command `calib convert`."""

from pathlib import Path
from typing import Annotated

import typer

from calib.cameras import fitted_models
from calib.commands.converted_camera import tell_camera
from calib.interop import FORMATS
from calib.interop.rigs import RIG_FORMATS
from designer.base.answer import Summary
from designer.kinds.presets import camera_templates, one_of

ALL_FORMATS = tuple(dict.fromkeys([*FORMATS, *RIG_FORMATS]))


def convert(
    camera: Annotated[
        str,
        typer.Argument(
            help="file of a camera or a rig, of any of these kinds, a folder with one, or a camera template",
            autocompletion=camera_templates,
        ),
    ],
    *,
    to: Annotated[
        str,
        typer.Option(
            help=f"kind of file to write: {'|'.join(FORMATS)}; of a rig {'|'.join(RIG_FORMATS)}",
            metavar="FORMAT",
            autocompletion=one_of(ALL_FORMATS),
        ),
    ],
    out: Annotated[Path, typer.Option("--out", "-o", help="file to write, or folder of several", metavar="FILE")],
    source: Annotated[
        str | None,
        typer.Option(
            "--from",
            help="kind of file to read (default: found out)",
            metavar="FORMAT",
            autocompletion=one_of(ALL_FORMATS),
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
    accept: Annotated[
        str | None,
        typer.Option(
            help="how far the file's lens may be off anywhere in the image (default: 0.1px, or what --model, --lens or "
            "--without cost)",
            metavar="PIXELS",
        ),
    ] = None,
    cameras: Annotated[
        list[str] | None, typer.Option(help="of a rig, a camera to write, in this order (default: all)", metavar="NAME")
    ] = None,
    unit: Annotated[
        str | None,
        typer.Option(help="of lengths in a rig's files: mm or m (default: as their tool has it)", metavar="UNIT"),
    ] = None,
    from_unit: Annotated[
        str | None, typer.Option(help="likewise of a rig's files to read (default: as they say)", metavar="UNIT")
    ] = None,
) -> Summary:
    """Write a camera or a rig as files of another tool, or read its files.

    Of the file's lenses the camera's own is written, or the closest one of its family, with a focal plane or wide: it
    is fitted over the whole image, the residual is told in pixels, and refused above 0.1 px unless it is accepted. Of a
    file with several cameras one is named as in chain.yaml#cam1; without a name they are a rig, if the file says where
    they stand.
    """
    from calib.api.converting import Conversion
    from calib.api.converting import convert as converted
    from calib.renderer.quantities import parse_pixels, parsed

    done = converted(
        camera, to, source=source, model=model, lens=lens, without=without or (), cameras=cameras or (), unit=unit,
        source_unit=from_unit, accept_px=None if accept is None else parsed("--accept", accept, parse_pixels), out=out,
    )  # fmt: skip
    done.save(out)
    if isinstance(done, Conversion):
        return tell_camera(done, camera, out)
    from calib.commands.converted_rig import tell_rig

    return tell_rig(done, camera, out)
