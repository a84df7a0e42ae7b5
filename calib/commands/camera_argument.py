"""A camera as commands take it: one place that knows which files are accepted."""

from typing import TYPE_CHECKING, Annotated

import typer

if TYPE_CHECKING:
    from calib.types import Camera

CameraArgument = Annotated[str, typer.Argument(help="camera file of ours or of another tool, or a camera template")]


def read_camera(name: str) -> "Camera":
    """The camera of a file or template that a person names.

    Raises:
        InputError: neither a template nor a valid file.
    """
    from calib.interop.reading import open_camera

    return open_camera(name).read.camera
