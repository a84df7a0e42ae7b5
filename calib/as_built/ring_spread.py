"""How far rings are off, as the photos tell: the sigma of their prior (a variance component)."""

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from calib.as_built.blocks import Normal
from calib.as_built.datum import SeenParts
from calib.as_built.unknowns import TargetUnknowns, Unknowns

Array = NDArray[np.float64]

ENOUGH = 20
"""Offsets, those left out that a motion of the face takes up, of which a spread can be told."""
LITTLE_TOLD = 0.01
"""Share of the offsets that photos must tell at the least; else they are what was expected."""
LEAST_PART = 0.1
"""Least spread, in units of how well an offset is seen: less cannot be told from none."""


def with_seen_spread(unknowns: Unknowns, seen: SeenParts, shape: TargetUnknowns, normal: Normal) -> Unknowns:
    """The unknowns with the rings' sigmas, in their plane and normal to it, that their offsets have.

    With the share k of an offset that the photos tell and the prior's sigma s, offsets have the mean square
    `k^2 (s^2 (1 - k) / k + true spread^2)`. Where that is a fixed point it is the one of Foerstner (1979): squares over
    redundancy.
    """
    sigma = unknowns.ring_sigma_mm
    if sigma is None:
        return unknowns
    told = 1 - np.einsum("rii->ri", np.linalg.inv(normal.ring)) / sigma**2
    faces = int(seen.face.sum())
    lost_normal = faces * (6 if unknowns.has_bow else 3)
    found = np.array(sigma)
    for axes, lost in (((0, 1), 3 * faces + unknowns.first_motion), ((2,), lost_normal)):
        columns = list(axes)
        count = len(columns) * int(seen.ring.sum()) - lost
        share = float(told[seen.ring][:, columns].mean()) if seen.ring.any() else 0.0
        if count < ENOUGH or share < LITTLE_TOLD:
            continue
        square = float((shape.offset_mm[seen.ring][:, columns] ** 2).sum()) / count
        noise = sigma[columns[0]] ** 2 * (1 - share) / share
        found[columns] = np.sqrt(max(square / share**2 - noise, LEAST_PART**2 * noise))
    return replace(unknowns, ring_sigma_mm=np.maximum(found, 1e-3 * sigma))


def is_same_spread(one: Unknowns, other: Unknowns, tolerance: float) -> bool:
    """Whether what is expected of the rings, and of what they share, agrees."""
    ratios = [one.sigma / other.sigma]
    if one.ring_sigma_mm is not None and other.ring_sigma_mm is not None:
        ratios.append(one.ring_sigma_mm / other.ring_sigma_mm)
    return bool(np.abs(np.concatenate(ratios) - 1).max(initial=0.0) < tolerance)
