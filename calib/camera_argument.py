"""A camera as commands take it: one place that knows which files are accepted."""

from typing import TYPE_CHECKING, Annotated

import typer

if TYPE_CHECKING:
    from calib.types import Camera

CameraArgument = Annotated[str, typer.Argument(help="camera file (camera.json), or a camera template")]


def read_camera(name: str) -> "Camera":
    """The camera of a file or template that a person names.

    Raises:
        InputError: neither a template nor a valid file.
    """
    from calib.camera_file import camera_or_preset

    return camera_or_preset(name)
