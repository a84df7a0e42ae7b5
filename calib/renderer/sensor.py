"""What a sensor makes of light: noise, a tone curve, whole numbers."""

import numpy as np
from numpy.typing import NDArray

from calib.renderer.options import RenderOptions

Image = NDArray[np.float32]
Levels = NDArray[np.uint8] | NDArray[np.uint16] | NDArray[np.float32]


def add_noise(light: Image, even_sigma: float, full_well: float, rng: np.random.Generator) -> None:
    """Add even noise, and shot noise in its normal limit: its variance is the light over the full well's electrons."""
    noise = rng.standard_normal(light.shape, dtype=np.float32)
    if full_well:
        noise *= np.sqrt(np.maximum(light, 0) / np.float32(full_well) + np.float32(even_sigma**2))
    else:
        noise *= np.float32(even_sigma)
    light += noise


def quantised(light: Image, options: RenderOptions) -> Levels:
    """Light as the file's numbers: clipped, through the tone curve, rounded; unchanged for 32 bits."""
    if options.bits == 32:
        return light
    shown = np.clip(light, 0, 1)
    if options.gamma != 1:
        shown **= np.float32(1 / options.gamma)
    shown *= 2**options.bits - 1
    np.rint(shown, out=shown)
    return shown.astype(np.uint8) if options.bits == 8 else shown.astype(np.uint16)
