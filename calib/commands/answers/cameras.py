"""Answers of commands that take cameras apart: their parameters, and what a fit leaves over."""

from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from calib.cameras.camera import Camera
    from calib.cameras.refit import Refit
    from designer.base.answer import Value


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
