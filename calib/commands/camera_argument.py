"""A camera as commands take it: one place that knows which files are accepted."""

from typing import TYPE_CHECKING, Annotated

import typer

from designer.command import printable

if TYPE_CHECKING:
    from calib.types import Camera

CameraArgument = Annotated[str, typer.Argument(help="camera file of ours or of another tool, or a camera template")]


def read_camera(name: str) -> "Camera":
    """The camera of a file or template that a person names.

    Raises:
        InputError: neither a template nor a valid file.
    """
    from calib.interop.reading import open_camera

    read = open_camera(name).read
    if read.refit is not None:
        print(f"{printable(name)}: its lens is fitted, RMS {read.refit.rms_px:.4f} px, max {read.refit.max_px:.4f} px")
    for remark in read.remarks:
        print(f"{printable(name)}: {printable(remark)}")
    return read.camera
