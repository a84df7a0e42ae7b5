"""A camera as commands take it, and as they tell programs of it."""

from dataclasses import dataclass
from typing import TYPE_CHECKING

from designer.base.words import printable

if TYPE_CHECKING:
    from calib.cameras.camera import Camera
    from calib.cameras.refit import Refit
    from designer.base.answer import Value


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
    from calib.interop.reading import open_camera

    read = open_camera(name).read
    remarks = list(read.remarks)
    if read.refit is not None:
        remarks.insert(0, f"its lens is fitted, RMS {read.refit.rms_px:.4f} px, max {read.refit.max_px:.4f} px")
    lines = tuple(f"{printable(name)}: {printable(remark)}" for remark in remarks)
    for line in lines:
        print(line)
    return NamedCamera(read.camera, lines)


def camera_answer(camera: "Camera") -> "dict[str, Value]":
    """A camera's model, image and parameters."""
    from calib.cameras import parameter_names

    return {
        "model": camera.model,
        "image_size_px": camera.image_size,
        "parameters": dict(zip(parameter_names(camera.model), camera.params.tolist(), strict=True)),
    }


def refit_answer(refit: "Refit") -> "dict[str, Value]":
    """What a fit leaves over, and over how much of the image it was made."""
    return {
        "model": refit.camera.model,
        "rms_px": refit.rms_px,
        "max_px": refit.max_px,
        "image_share": refit.known,
        "turn_rad": refit.turn_rad,
    }


def camera_line(camera: "Camera", lens: str | None = None) -> str:
    """The lens, the model if none is given, the image size and the linear part."""
    fx, fy, cx, cy = camera.params[:4]
    width, height = camera.image_size
    return f"{lens or camera.model}, {width} x {height} px, f {fx:.2f} {fy:.2f}, centre {cx:.2f} {cy:.2f} px"


def refit_line(fitted: str, refit: "Refit") -> str:
    """The residual of a fit, over how much of the image it was made, and that poses are not those of before."""
    import numpy as np

    known = "the whole image" if refit.known == 1 else f"the {100 * refit.known:.0f} % of the image that is known"
    line = f"fitted {fitted} over {known}: RMS {refit.rms_px:.4f} px, max {refit.max_px:.4f} px"
    if not refit.turn_rad:
        return line
    turn = f"turned its frame by {np.degrees(refit.turn_rad):.3f} deg"
    return f"{line}\n{turn}: poses found with the old camera are not in it"
