"""Why nothing was found in a photo, as far as the things in it that look like rings tell it."""

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from calib.core.types import LEAST_RADIUS_PX, Detections
from calib.detector.borders import reduced, reduction, thresholds
from calib.detector.candidates import Candidates, find_candidates
from calib.detector.plan import plan_for
from designer.target import TargetGeometry

FEWEST = 12
"""Things of one size that are no chance any more."""
ALIKE = 1.3
"""Radii up to so many times smaller or larger than the usual one are of one size."""


def explained(seen: Detections, pixels: NDArray[np.generic], target: TargetGeometry) -> Detections:
    """Detections with a remark on why there are none; those with features as they are.

    Args:
        seen: of the photo.
        pixels: of the photo.  # (H, W)
        target: what was looked for.
    """
    if len(seen.ring) or pixels.ndim != 2 or min(pixels.shape) < FEWEST:
        return seen
    why = why_nothing(pixels, target)
    return replace(seen, remarks=(*seen.remarks, why)) if why else seen


def why_nothing(pixels: NDArray[np.generic], target: TargetGeometry) -> str:
    """What is in a photo instead of the target, and what to change, in a line; "" if that is not known.

    Rings whose white centre is no longer resolved are dark spots all of one size: then the target is there, and too
    small in the photo.
    """
    from calib.detector.looks_like import looks_like

    factor = reduction((pixels.shape[0], pixels.shape[1]))
    grey, ratio = reduced(pixels, factor), plan_for(target).ratio
    spots, rings = 0, 0
    spot_px = ring_px = 0.0
    shown = ""
    for threshold in thresholds(grey):
        found = find_candidates(grey, threshold, factor, 0, ratio)
        count, radius_px = _of_one_size(found, is_ring=False)
        if count > spots:
            spots, spot_px = count, radius_px
        count, radius_px = _of_one_size(found, is_ring=True)
        if count > rings:
            rings, ring_px = count, radius_px
            shown = looks_like(found)
    if max(spots, rings) < FEWEST:
        return ""
    what, count, radius_px = ("rings", rings, ring_px) if rings >= spots else ("dark spots", spots, spot_px)
    told = f"{count} {what} of about {radius_px:.1f} px radius were seen"
    if shown:  # rings whose order is seen are large and sharp enough to be read
        told = f"{rings} rings of about {ring_px:.1f} px radius were seen, in no order that fits this target"
        return f"{told}: is this the right target file? it looks like {shown}"
    if radius_px < LEAST_RADIUS_PX:
        return f"{told}; rings need about {LEAST_RADIUS_PX:g} px: come nearer, or use a longer lens or more pixels"
    if what == "rings":
        return (
            f"{told}, in no order that fits this target: is this the right target file, is it sharp, and not cut off?"
        )
    return f"{told}, without the white centre of a ring: is it the target of this file, and sharp?"


def _of_one_size(found: Candidates, *, is_ring: bool) -> tuple[int, float]:
    """How many candidates with a white centre, or without one, have about the usual radius, and that radius in px."""
    radius_px = found.radius_px[(found.ratio > 0) == is_ring]
    if not len(radius_px):
        return 0, 0.0
    usual = float(np.median(radius_px))
    alike = radius_px[(radius_px > usual / ALIKE) & (radius_px < usual * ALIKE)]
    return len(alike), float(np.median(alike)) if len(alike) else 0.0  # the middle of two sizes is neither
