"""How answers and screens tell of cameras, and of what a lens of another kind leaves over."""

from dataclasses import dataclass
from typing import TYPE_CHECKING

from designer.base.words import printable

if TYPE_CHECKING:
    from calib.cameras.camera import Camera
    from calib.cameras.formats.format import ReadCamera
    from calib.cameras.refit import Refit


@dataclass(frozen=True)
class CameraNumbers:
    """A camera's model, image and parameters."""

    model: str
    image_size_px: tuple[int, int]
    parameters: dict[str, float]


@dataclass(frozen=True)
class RefitNumbers:
    """What a fit leaves over, and over how much of the image it was made."""

    model: str
    rms_px: float
    max_px: float
    image_share: float
    turn_rad: float


def numbers_of(camera: "Camera") -> CameraNumbers:
    """Those of a camera."""
    from calib.cameras import parameter_names

    named = zip(parameter_names(camera.model), camera.params.tolist(), strict=True)
    return CameraNumbers(camera.model, camera.image_size, dict(named))


def refit_numbers(fit: "Refit") -> RefitNumbers:
    """Those of a fit."""
    return RefitNumbers(fit.camera.model, fit.rms_px, fit.max_px, fit.known, fit.turn_rad)


def remarks_on(name: str, read: "ReadCamera") -> tuple[str, ...]:
    """What to know of the file that a camera comes from, a line each."""
    fit = read.refit
    fitted = () if fit is None else (f"its lens is fitted, RMS {fit.rms_px:.4f} px, max {fit.max_px:.4f} px",)
    return tuple(f"{printable(name)}: {printable(remark)}" for remark in (*fitted, *read.remarks))


def camera_words(camera: "Camera", lens: str | None = None) -> str:
    """The lens, the model if none is given, the image size and the linear part."""
    fx, fy, cx, cy = camera.params[:4]
    width, height = camera.image_size
    return f"{lens or camera.model}, {width} x {height} px, f {fx:.2f} {fy:.2f}, centre {cx:.2f} {cy:.2f} px"


def refit_words(fitted: str, fit: "Refit") -> str:
    """The residual of a fit, over how much of the image it was made, and that poses are not those of before."""
    import numpy as np

    known = "the whole image" if fit.known == 1 else f"the {100 * fit.known:.0f} % of the image that is known"
    line = f"fitted {fitted} over {known}: RMS {fit.rms_px:.4f} px, max {fit.max_px:.4f} px"
    if not fit.turn_rad:
        return line
    turn = f"turned its frame by {np.degrees(fit.turn_rad):.3f} deg"
    return f"{line}; {turn}: poses found with the old camera are not in it"
