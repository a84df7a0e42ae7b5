"""A camera made to fit a format: its model, and what the format has no place for."""

from collections.abc import Collection

from calib.cameras import LINEAR, fitted_models
from calib.cameras.camera import Camera
from calib.cameras.refit import Refit, refit
from calib.interop import OWN
from calib.interop.format import CameraFormat
from designer.base.errors import InputError
from designer.base.words import shown, suggestion


def fit_to_format(
    camera: Camera, target: CameraFormat, model: str | None = None, zero: Collection[str] = ()
) -> tuple[Camera, Refit | None]:
    """The camera as the format can hold it, and the fit that took, if any.

    Args:
        camera: of any model.
        target: the format to be written.
        model: the model to convert to; the camera's own where the format holds it, if not given.
        zero: lens parameters to leave out besides those the format cannot hold.

    Raises:
        InputError: a model that the format cannot hold.
    """
    model = model or _own_or_nearest(camera, target)
    if target.model is None and model == camera.model and not zero:
        return camera, None  # of a learned map too, which cannot be fitted
    if model not in fitted_models():
        hint = suggestion(model, list(fitted_models())) or f"; there are {', '.join(fitted_models())}"
        raise InputError(f"model {shown(model)} cannot be fitted to a camera{hint}")
    if target.model is not None and model not in (target.model, LINEAR):
        holds = f"{target.title} holds model {target.model} or {LINEAR}"
        raise InputError(f"{holds}, not {shown(model)}; leave out --model, or use --to {OWN}")
    result = refit(camera, model, zero=(*zero, *target.cannot_hold), turn=camera.learned is not None)
    return result.camera, None if result.is_exact else result


def _own_or_nearest(camera: Camera, target: CameraFormat) -> str:
    """The camera's model where the format holds it, else the one it holds."""
    if target.model is None or camera.model in (target.model, LINEAR):
        return camera.model
    return target.model
