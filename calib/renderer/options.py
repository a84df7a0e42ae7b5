"""What a synthetic photo is to look like."""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Literal

Sampling = Literal["area", "binary"]
Bits = Literal[8, 16, 32]
LIMITS: Mapping[str, tuple[float, float]] = {
    "black": (0, 1), "white": (0, 1), "background": (0, 1), "light_gradient": (0, 1.9), "shading": (0, 1),
    "glare": (0, 10), "clutter": (0, 10_000), "occlusion": (0, 0.9), "blur_px": (0, 50), "aperture_mm": (0, 500),
    "focus_mm": (1, 10_000), "vignetting": (0, 0.95), "contrast_to_noise": (0, 1e6), "read_noise": (0, 1),
    "full_well": (0, 1e9), "gamma": (0.2, 5),
}  # fmt: skip
"""Of each number in `RenderOptions`."""


@dataclass(frozen=True)
class RenderOptions:
    """How photos are lit, seen and stored: `RenderOptions(blur_px=0.7, contrast_to_noise=50)`.

    Light is linear, 0 to 1 = full scale. What is zero, or 1 for `gamma`, is off.
    """

    sampling: Sampling = "area"  # binary: one ray a pixel, black or white
    black: float = 0.1  # light of the ink
    white: float = 0.8  # light of the white
    background: float = 0.4
    blur_px: float = 0.0  # standard deviation of the Gaussian point-spread function
    aperture_mm: float = 0.0  # diameter of the lens's opening: what is out of focus is spread
    focus_mm: float | None = None  # distance of best focus; None: the target's origin
    contrast_to_noise: float = 0.0  # (white - black) over the standard deviation of even noise
    read_noise: float = 0.0  # standard deviation of even noise, in full scales
    full_well: float = 0.0  # electrons at full scale, whose number has shot noise
    vignetting: float = 0.0  # share of the light that is lost in the corners
    light_gradient: float = 0.0  # change of the light across the target, over its mean
    shading: float = 0.0  # share of the light that depends on the angle between face and lamp (Lambert)
    glare: float = 0.0  # peak light of the lamp's mirror image on a glossy target
    clutter: int = 0  # shapes behind the target, rings among them
    occlusion: float = 0.0  # share of the target's silhouette that things in front hide
    gamma: float = 1.0  # the file holds light ** (1 / gamma)
    bits: Bits = 8  # 32: float32, without rounding and clipping

    @property
    def noise_sigma(self) -> float:
        """Standard deviation of the even noise, in full scales."""
        ratio = self.contrast_to_noise
        even = (self.white - self.black) / ratio if ratio else 0.0
        sigma: float = (even**2 + self.read_noise**2) ** 0.5
        return sigma
