"""Where the rings of a target may really be, relative to its file: what is known of a way of making, to first order.

The displacement of ring r is

    d_r = sum_s modes[s, r] x_s  +  sum_c ring_modes[r, :, c] y_rc

with x and y independent standard normal numbers: x of what rings share (the print's axes, a face that was tilted), y of
each ring alone. So the covariance of all rings is one of low rank plus one of (3, 3) blocks, and a least-squares
problem takes the target's shape in as unknowns with an identity as their prior.
"""

from dataclasses import dataclass

import numpy as np

from designer.base.arrays import Array, Rows
from designer.target import TargetGeometry
from designer.tolerance.model import ErrorModel, displaced_shape
from designer.tolerance.shape import centers_mm, piece_of_ring
from designer.tolerance.source import Unit
from designer.tolerance.sources import SOURCES

STEP: dict[Unit, float] = {"mm": 1e-3, "rad": 1e-4, "1": 1e-3, "K": 1.0}
"""Of the central differences."""


def displacements(target: TargetGeometry, errors: ErrorModel, name: str) -> tuple[Array, Rows]:
    """Displacement of each ring by a unit of each number of the instance it belongs to, (R, 3, components), and that.

    Without other errors a face, piece or ring moves on its own, so one difference serves all instances at once.

    Args:
        target: the nominal geometry.
        errors: what else the source needs to know of the way of making; amounts do not matter.
        name: of the source.

    Returns:
        The displacements, and each ring's instance (R,).
    """
    source = SOURCES[name]
    size, step_length = (source.instances(target), source.components), STEP[source.unit]
    change = np.empty((target.ring_count, 3, source.components))
    for component in range(source.components):
        step = np.zeros(size)
        step[:, component] = step_length
        ahead, behind = (centers_mm(displaced_shape(target, {name: one}, model=errors)) for one in (step, -step))
        change[:, :, component] = (ahead - behind) / (2 * step_length)
    instance = {
        "print": np.zeros(target.ring_count, dtype=np.int64),
        "face": target.ring_face,
        "piece": piece_of_ring(target),
        "ring": np.arange(target.ring_count),
    }[source.scope]
    return change, instance


def directions(target: TargetGeometry, errors: ErrorModel, name: str) -> Array:
    """Displacements of the rings by a unit of each number of a source, (R, 3, instances x components)."""
    change, instance = displacements(target, errors, name)
    source, rings = SOURCES[name], np.arange(target.ring_count)
    result = np.zeros((target.ring_count, 3, source.instances(target), source.components))
    result[rings, :, instance] = change
    return result.reshape(target.ring_count, 3, -1)


@dataclass(frozen=True, eq=False)
class ShapePrior:
    """The displacements of R rings by standard normal numbers, in the target's frame."""

    modes_mm: Array  # (S, R, 3) by each number that rings share
    ring_modes_mm: Array  # (R, 3, C) by each ring's own numbers

    @property
    def sigma_mm(self) -> Array:
        """Standard deviations of each ring's place, all in all.  # (R, 3)"""
        variance = (self.modes_mm**2).sum(axis=0) + (self.ring_modes_mm**2).sum(axis=2)
        sigma: Array = np.sqrt(variance)
        return sigma

    def size_sigma(self, position_mm: Array) -> float:
        """Standard deviation of the size of a target of rings at places (R, 3), as a part of it."""
        lever = position_mm - position_mm.mean(axis=0)
        lever = lever / max(float((lever**2).sum()), np.finfo(float).tiny)
        shared, own = np.einsum("ri,sri->s", lever, self.modes_mm), np.einsum("ri,ric->rc", lever, self.ring_modes_mm)
        return float(np.sqrt((shared**2).sum() + (own**2).sum()))


def shape_prior(target: TargetGeometry, errors: ErrorModel) -> ShapePrior:
    """The prior of a way of making: every source that moves centres, with its standard deviation.

    A source of a fixed size is one number: what it is, is not known better than how large.

    Args:
        target: the nominal geometry.
        errors: of the way of making.
    """
    modes, own = [np.zeros((0, target.ring_count, 3))], [np.zeros((target.ring_count, 3, 0))]
    for name, amount in errors.amounts:
        if SOURCES[name].scope == "ring" and amount.kind != "fixed":
            change, _ = displacements(target, errors, name)
            own.append(amount.sigma * change[:, :, (change != 0).any(axis=(0, 1))])
            continue
        columns = amount.sigma * directions(target, errors, name)
        if amount.kind == "fixed":
            columns = columns.sum(axis=2, keepdims=True)
        modes.append(columns[:, :, (columns != 0).any(axis=(0, 1))].transpose(2, 0, 1))
    return ShapePrior(np.concatenate(modes), np.concatenate(own, axis=2))


def measured_prior(target: TargetGeometry) -> ShapePrior | None:
    """The prior of a measured target: as uncertain as its file states; None if it states nothing."""
    if target.face_covariance is None:
        return None
    shared = np.zeros((0, target.ring_count, 3)) if target.mode_mm is None else target.mode_mm
    face = target.ring_face
    rotation = target.target_from_face[:, :3, :3]
    x, y, z = target.center_in_face_mm.T
    none = np.zeros_like(x)
    by_turn = np.stack([none, z, -y, -z, none, x, y, -x, none], axis=1).reshape(-1, 3, 3)  # w x p = [-p] w
    by_motion = rotation[face] @ np.concatenate([by_turn, np.tile(np.eye(3), (len(x), 1, 1))], axis=2)  # (R, 3, 6)
    value, vector = np.linalg.eigh(target.face_covariance)
    root = vector * np.sqrt(np.maximum(value, 0.0))[:, None, :]  # (F, 6, 6)
    modes = np.zeros((target.face_count, 6, target.ring_count, 3))
    modes[face, :, np.arange(target.ring_count)] = (by_motion @ root[face]).transpose(0, 2, 1)
    flat = modes.reshape(-1, target.ring_count, 3)
    every: Array = np.concatenate([flat[(flat != 0).any(axis=(1, 2))], shared])
    return ShapePrior(every, np.zeros((target.ring_count, 3, 0)))
