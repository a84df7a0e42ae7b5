"""What a file does not say that a camera knew."""

import numpy as np

from calib.cameras import ABILITIES, LINEAR, fitted_models, parameter_names
from calib.cameras.camera import Camera
from calib.cameras.refit import FOCAL_AND_CENTRE
from calib.interop.choosing import LARGE_PX
from calib.interop.format import CameraFormat, FileLens
from calib.interop.holding import Held


def lost_of(camera: Camera, held: Held, target: CameraFormat) -> tuple[str, ...]:
    """A line for each thing."""
    lost = []
    values = dict(zip(parameter_names(camera.model), camera.params.tolist(), strict=True))
    lens = held.lens
    gone = [name for name in lens.cannot_hold if lens.model == camera.model and values.get(name)]
    if gone and held.refit is not None:
        others = "the others make up for what they can"
        lost.append(f"{' '.join(gone)}, for which {target.title} has no place; {others}")
    fit = held.refit
    if fit is not None and fit.max_px > LARGE_PX:
        kind = " by a lens of another kind" if _is_of_another_kind(camera, lens) else ""
        lost.append(f"up to {fit.max_px:.3g} px of where the camera sees a point, RMS {fit.rms_px:.2g} px{kind}")
    is_foreign = bool(lens.numbers) or lens.approximate is not None
    if camera.field_rad is not None and is_foreign:
        lost.append(
            f"where the image circle ends, {np.degrees(camera.field_rad) / 2:.1f} degrees off the axis; "
            "the file's lens goes on, untried"
        )
    if camera.learned is not None and (is_foreign or held.camera.learned is None):
        lost.append("where the map is known; the file's lens goes on to the edges of the image, untried")
    elif held.camera.model == LINEAR and np.any(camera.params[FOCAL_AND_CENTRE:]):
        lost.append("the lens's distortion")
    return tuple(lost)


def _is_of_another_kind(camera: Camera, lens: FileLens) -> bool:
    """Whether one has a focal plane, and the other is wide."""
    if camera.model not in fitted_models() or lens.model is None:
        return False
    return lens.is_wide != ABILITIES[camera.model].is_wide
