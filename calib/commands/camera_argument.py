"""A camera as commands take it."""

from dataclasses import dataclass
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from calib.cameras.camera import Camera


@dataclass(frozen=True, eq=False)
class NamedCamera:
    """A camera, and what to know of the file it comes from, a line each."""

    camera: "Camera"
    remarks: tuple[str, ...]


def read_camera(name: str) -> NamedCamera:
    """The camera of a file or template that a person names, who is told the remarks.

    Raises:
        InputError: neither a template nor a valid file.
    """
    from calib.app.cameras_told import remarks_on
    from calib.cameras.formats.reading import open_camera

    read = open_camera(name).read
    lines = remarks_on(name, read)
    for line in lines:
        print(line)
    return NamedCamera(read.camera, lines)
