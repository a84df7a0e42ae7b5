"""The command `calib convert`."""

import shlex
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from calib.commands.answers.cameras import camera_answer, refit_answer
from calib.show.screen import quoted
from designer.answer import Summary
from designer.command import printable
from designer.completion import camera_templates, one_of
from designer.errors import InputError

if TYPE_CHECKING:
    from calib.cameras.camera import Camera
    from calib.cameras.refit import Refit
    from calib.interop import CameraFormat
    from calib.interop.reading import OpenedCamera

LARGE_PX = 0.05
"""A larger residual is worth a warning: calibrations are good to some hundredths of a pixel."""

FORMAT_NAMES = ("opencv", "ros", "kalibr", "colmap", "mrcal", "metashape", "json")
"""Those of `calib.interop.FORMATS`, which are slow to import."""
_FORMATS = "|".join(FORMAT_NAMES)


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
        typer.Option(help=f"kind of file to write: {_FORMATS}", metavar="FORMAT", autocompletion=one_of(FORMAT_NAMES)),
    ],
    out: Annotated[Path, typer.Option("--out", "-o", help="file to write", metavar="FILE")],
    source: Annotated[
        str | None,
        typer.Option(
            "--from",
            help="kind of file to read (default: found out)",
            metavar="FORMAT",
            autocompletion=one_of(FORMAT_NAMES),
        ),
    ] = None,
    model: Annotated[
        str | None,
        typer.Option(
            help="camera model to write: opencv|luhmann|pinhole (default: what the file can hold)",
            autocompletion=one_of(("opencv", "luhmann", "pinhole")),
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
    from calib.core.files import write_files
    from calib.interop.converting import fit_to_format
    from calib.interop.reading import find_format, open_camera
    from designer.own_files import signed

    target = find_format(to)
    opened = open_camera(camera, source)
    _check_output(out, target, opened)
    zero = _lens_parameters(without)
    try:
        written, refit = fit_to_format(opened.read.camera, target, model, zero)
    except InputError as error:
        raise InputError(f"{camera}: {error}") from None
    # Signed as a file of the kind is, whatever its name.
    write_files({out: signed(target.file_name, target.write(written).encode(), target.name)})
    print(f"read   {printable(camera)}: {opened.format.title}, {_described(opened.read.camera)}")
    for remark in opened.read.remarks:
        print(f"       {remark}")
    residuals = [one for one in (opened.read.refit, refit) if one is not None]
    for one in residuals:
        _say_refit(one)
    print(f"wrote  {printable(str(out))}: {target.title}, {_described(written)}")
    lost = _lost(opened.read.camera, written, target)
    for loss in lost:
        print(f"lost   {loss}")
    is_far = any(one.max_px > LARGE_PX for one in residuals)
    if not residuals:
        print("exact  no fit was needed")
    elif is_far:
        print(f"warning: the two cameras differ by more than {LARGE_PX:g} px somewhere; see where with calib diff")
    print(f"open   {target.opens_with.format(file=printable(str(out)), url=out.absolute().as_uri())}")
    return Summary(
        {
            "read": {"file": camera, "format": opened.format.name, **camera_answer(opened.read.camera)},
            "written": {"file": str(out), "format": target.name, **camera_answer(written)},
            "is_exact": not residuals,
            "rms_px": max((one.rms_px for one in residuals), default=0.0),
            "max_px": max((one.max_px for one in residuals), default=0.0),
            "fits": [refit_answer(one) for one in residuals],
            "lost": lost,
        },
        (out,),
        (f"calib diff {shlex.quote(printable(camera))} {quoted(out)}",) if is_far else (),
        opened.read.remarks,
    )


def _lens_parameters(names: list[str] | None) -> tuple[str, ...]:
    """Names of lens parameters, checked."""
    from calib.cameras import parameter_names
    from calib.cameras.refit import FAMILIES, FOCAL_AND_CENTRE
    from designer.spec_file import shown

    known = sorted({name for model in FAMILIES for name in parameter_names(model)[FOCAL_AND_CENTRE:]})
    for name in names or ():
        if name not in known:
            raise InputError(f"--without {shown(name)}: no lens parameter; there are {', '.join(known)}")
    return tuple(names or ())


def _check_output(out: Path, target: "CameraFormat", source: "OpenedCamera") -> None:
    """Refuse a place that is a folder, the input, or somebody else's, before any work is done."""
    from designer.own_files import require_ours

    if out.is_dir():
        raise InputError(f"{out}: is a folder; name the file with -o, such as {out / target.file_name}")
    if source.is_file(out):
        raise InputError(f"{out}: is the file to read; choose another name with -o")
    require_ours(out)


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


def _lost(camera: "Camera", written: "Camera", target: "CameraFormat") -> list[str]:
    """What the file does not say that the camera knew."""
    import numpy as np

    from calib.cameras import parameter_names
    from calib.cameras.refit import FOCAL_AND_CENTRE

    values = dict(zip(parameter_names(camera.model), camera.params.tolist(), strict=True))
    lost = []
    gone = [name for name in target.cannot_hold if values.get(name)]
    if gone:
        lost.append(f"{' '.join(gone)}, for which {target.title} has no place; the others make up for what they can")
    if camera.learned is not None and written.learned is None:
        lost.append("where the map is known; the file's lens goes on to the edges of the image, untried")
    elif written.model == "pinhole" and np.any(camera.params[FOCAL_AND_CENTRE:]):
        lost.append("the lens's distortion")
    return lost
