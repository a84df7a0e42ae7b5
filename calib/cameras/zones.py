"""How far apart two cameras see the same light, by parts of the image."""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Annotated

import numpy as np

from calib.cameras.refit import CameraDifference
from designer.base.arrays import Array
from designer.base.marks import NOT_IN_FILE, Gap

WHOLE = "whole image"


@dataclass(frozen=True)
class ZoneDifference:
    """Over a part of the image; nan where nothing is known."""

    share: Annotated[float, NOT_IN_FILE]  # of it, in which both cameras know what they see
    rms_px: Gap
    median_px: Gap
    percentile_95_px: Gap
    max_px: Gap
    rms_rad: Gap  # of the angles between the directions that both see in one pixel


def zones_of(difference: CameraDifference) -> Mapping[str, ZoneDifference]:
    """The whole image, and from its centre to its corners."""
    part = difference.off_centre_px / (np.hypot(*difference.image_size) / 2)
    inside = {
        WHOLE: part >= 0, "centre": part < 1 / 3, "between": (part >= 1 / 3) & (part < 2 / 3), "corners": part >= 2 / 3,
    }  # fmt: skip
    length, angle = difference.length_px, difference.angle_rad
    return {name: _zone(length[zone], angle[zone]) for name, zone in inside.items()}


def _zone(length_px: Array, angle_rad: Array) -> ZoneDifference:
    """Of lengths and angles that may not be known."""
    known, angle = length_px[np.isfinite(length_px)], angle_rad[np.isfinite(angle_rad)]
    if not len(known):
        return ZoneDifference(0.0, *[np.nan] * 5)
    rms, (median, most) = np.sqrt(np.mean(known**2)), np.percentile(known, [50, 95])
    rms_rad = float(np.sqrt(np.mean(angle**2))) if len(angle) else np.nan
    return ZoneDifference(
        len(known) / length_px.size, float(rms), float(median), float(most), float(known.max()), rms_rad
    )
