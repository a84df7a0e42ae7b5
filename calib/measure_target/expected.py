"""How large the deviations of a print are expected to be: the prior of its way of making, told in our unknowns.

The prior is given as displacements of rings (`designer.tolerance.prior`). Each of its modes is fitted with the strain
of the whole print, then with the motions and bows of the faces; the squares add up. What the photos cannot tell, the
size and the place of the whole target, is left out. A print may be worse than assumed, so these are where the
measurement starts from: where the photos show more, `with_seen_deviations` and `with_seen_spread` take that (variance
components).
"""

from dataclasses import replace

import numpy as np

from calib.core.linear_algebra import pseudo_inverse
from calib.measure_target.datum import SeenParts, by_shared_dense, rigid_design
from calib.measure_target.unknowns import (
    AsBuiltOptions,
    TargetUnknowns,
    Unknowns,
    nominal_shape,
    place_rings,
    shared_values,
)
from calib.solver.eliminate import Normal
from designer.base.arrays import Array
from designer.target import bounding_radius_mm
from designer.tolerance.made import how_made
from designer.tolerance.prior import ShapePrior

LEAST_MM = 1e-3
"""At the rim of the target: nothing is made better than this, and what is wrongly thought right can still be found."""
ENOUGH = 20
"""Offsets, those left out that a motion of the face takes up, of which a spread can be told."""
LITTLE_TOLD = 0.01
"""Share of the offsets that photos must tell at the least; else they are what was expected."""
LEAST_PART = 0.1
"""Least spread, in units of how well an offset is seen: less cannot be told from none."""


def with_expected_deviations(unknowns: Unknowns, options: AsBuiltOptions) -> Unknowns:
    """The unknowns with the standard deviations that the way of making gives; those of the options stay."""
    made = options.made or how_made(unknowns.target)
    if made is None or made.prior is None:
        return unknowns
    expected = _expected(unknowns, made.prior)
    return replace(unknowns, sigma=np.where(unknowns.is_given, unknowns.sigma, expected))


def with_seen_deviations(unknowns: Unknowns, seen: SeenParts, shape: TargetUnknowns) -> Unknowns:
    """The unknowns with larger standard deviations where the deviations are larger than was expected.

    Those of one kind, such as the tilts of all faces, share their factor: the root mean square of the values in their
    expected deviations, which is the most likely one where the photos tell them (a variance component).
    """
    square = (shared_values(unknowns, shape) / unknowns.sigma) ** 2
    kind, counts = unknowns.kind, np.ones(unknowns.count, dtype=bool)
    by_face = unknowns.column[:, 6:]
    hidden = by_face[~(seen.face & seen.main)].ravel()
    counts[hidden[hidden >= 0]] = False
    mean = np.bincount(kind, square * counts) / np.maximum(np.bincount(kind, counts), 1)
    factor = np.where(unknowns.is_given, 1.0, np.sqrt(np.maximum(mean, 1.0))[kind])
    return replace(unknowns, sigma=factor * unknowns.sigma)


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


def _expected(unknowns: Unknowns, prior: ShapePrior) -> Array:
    """The root mean squares of the unknowns over the modes of a prior.  # (count,)"""
    target, first = unknowns.target, unknowns.first_motion
    place = place_rings(unknowns, nominal_shape(target))
    size, rings = bounding_radius_mm(target), target.ring_count
    modes = prior.modes_mm.reshape(-1, 3 * rings).T  # (3 R, S)
    by_shared = by_shared_dense(unknowns, place).reshape(3 * rings, -1)
    rigid = rigid_design(place.position_mm).reshape(3 * rings, 6)
    is_stretch = unknowns.strain < 3  # the diagonal, whose mean is the size
    strained = by_shared[:, :first]
    if unknowns.is_assembled and unknowns.has_strain:
        strained = np.tile(strained[:, is_stretch].mean(axis=1, keepdims=True), (1, first)) * is_stretch
    whole = np.column_stack([strained, rigid])
    fitted = pseudo_inverse(whole) @ modes
    value = np.zeros((unknowns.count, modes.shape[1]))
    value[:first] = fitted[:first]
    if not unknowns.is_assembled:  # else its size beside the faces' heights is told: that of the pieces
        value[:first][is_stretch] -= fitted[:first][is_stretch].sum(axis=0) / max(int(is_stretch.sum()), 1)
    left = (modes - whole @ fitted).reshape(rings, 3, -1)
    for face in range(target.face_count):
        columns = unknowns.column[face, 6:]
        columns, rows = columns[columns >= 0], np.flatnonzero(target.ring_face == face)
        if len(columns) and len(rows):
            design = by_shared.reshape(rings, 3, -1)[rows][:, :, columns].reshape(3 * len(rows), -1)
            value[columns] = pseudo_inverse(design) @ left[rows].reshape(3 * len(rows), -1)
    least = np.where(unknowns.is_length, LEAST_MM, LEAST_MM / size)
    expected: Array = np.maximum(np.sqrt((value**2).sum(axis=1)), least)
    return expected
