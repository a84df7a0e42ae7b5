"""What a synthetic photo is to look like, and what is asked of sets of them."""

from dataclasses import dataclass
from typing import Annotated, Literal

from designer.base.errors import InputError
from designer.base.options import option

Sampling = Literal["area", "binary"]
Bits = Literal[8, 16, 32]
FileFormat = Literal["png", "tiff", "jpeg"]
Region = Literal["hemisphere", "sphere", "cap"]

TRUTH_FILE, RIG_FILE, PHOTO_TABLE = "truth.json", "rig.json", "photos.csv"
"""Beside photos: what is known of them; of a rig's, the rig too, and which photo is of which frame."""


@dataclass(frozen=True)
class RenderOptions:
    """How photos are lit, seen and stored: `RenderOptions(blur_px=0.7, contrast_to_noise=50)`.

    Light is linear, 0 to 1 = full scale. What is zero, or 1 for `gamma`, is off.
    """

    sampling: Annotated[Sampling, option("area: anti-aliased; binary: one ray a pixel, black or white")] = "area"
    black: Annotated[float, option("light of the ink", 0, 1, unit="share")] = 0.1
    white: Annotated[float, option("light of the white", 0, 1, unit="share")] = 0.8
    background: Annotated[float, option("light of the background", 0, 1, unit="share")] = 0.4
    blur_px: Annotated[float, option("Gaussian blur: its standard deviation", 0, 50)] = 0.0
    aperture_mm: Annotated[float, option("opening of the lens: defocus of what is nearer or farther", 0, 500)] = 0.0
    focus_mm: Annotated[float | None, option("distance of best focus (default: the target's origin)", 1, 10_000)] = None
    contrast_to_noise: Annotated[float, option("even noise: white - black over its sigma; 0: none", 0, 1e6)] = 0.0
    read_noise: Annotated[float, option("standard deviation of even noise, of full scale", 0, 1, unit="share")] = 0.0
    full_well: Annotated[float, option("shot noise: electrons at full scale, such as 10000; 0: none", 0, 1e9)] = 0.0
    vignetting: Annotated[float, option("light lost in the corners", 0, 0.95, unit="share")] = 0.0
    light_gradient: Annotated[
        float, option("change of the light across the target, over its mean", 0, 1.9, unit="share")
    ] = 0.0
    shading: Annotated[
        float, option("share of the light that depends on how a face is turned (Lambert)", 0, 1, unit="share"),
    ] = 0.0  # fmt: skip
    glare: Annotated[float, option("peak light of a lamp mirrored by a glossy target", 0, 10, unit="share")] = 0.0
    clutter: Annotated[int, option("shapes behind the target, rings among them", 0, 10_000)] = 0
    occlusion: Annotated[
        float, option("share of the target's silhouette that things in front hide", 0, 0.9, unit="share")
    ] = 0.0
    gamma: Annotated[
        float, option("exponent of the tone curve: 2.2 for everyday images; the file holds light ** (1 / gamma)",
                      0.2, 5),
    ] = 1.0  # fmt: skip
    bits: Annotated[Bits, option("8 or 16; 32: float32, without rounding and clipping, in Python only")] = 8

    @property
    def noise_sigma(self) -> float:
        """Standard deviation of the even noise, in full scales."""
        ratio = self.contrast_to_noise
        even = (self.white - self.black) / ratio if ratio else 0.0
        sigma: float = (even**2 + self.read_noise**2) ** 0.5
        return sigma

    def require_sense(self) -> None:
        """Refuse values that do not go together.

        Raises:
            InputError: so they are.
        """
        if self.white <= self.black:
            raise InputError(
                f"--white {100 * self.white:g}% is not lighter than --black {100 * self.black:g}%; the target would "
                "not show"
            )
        if self.focus_mm is not None and not self.aperture_mm:
            raise InputError("--focus says nothing without --aperture; add an --aperture such as 5mm")
