"""How well the parts of a measured target are known, in the datum of `calib.measure_target.datum`.

Faces that lie unlike all others: they are told as such, and take no part in saying where the target is.

A datum in least squares shares one face's displacement out among all, as if each had moved a little. So the motion of
the whole, and how far all faces stand out alike, is fitted with the least sum of distances, not of squares (the
iterative weighted similarity transformation of deformation analysis, Chen 1983), and what then stands out is left out.

What photos do not tell of a print, in words.
"""

from dataclasses import dataclass

import numpy as np

from calib.core.linear_algebra import least_squares
from calib.core.se3 import skew
from calib.measure_target.datum import (
    FEW_VIEWS,
    SeenParts,
    by_shared_dense,
    datum_rings,
    few_views,
    fit_rings,
    rigid_design,
    rigid_fit,
    scale_fit,
)
from calib.measure_target.problem import Joint
from calib.measure_target.unknowns import RingPlaces, TargetUnknowns, Unknowns, place_rings, strain_matrix
from calib.solver.eliminate import Factor, Normal, covariance_factor
from designer.base.arrays import Array, Flags, Rows
from designer.target import TargetGeometry

FAR = 3.0
"""Times the median distance. Of six normal numbers that are alike, one in 10^8 faces is so far off."""
LEAST_FACES = 5
"""Fewer do not tell which of them is the odd one."""
ROUNDS = 30
CLOSE = 1e-3
"""Least distance to weigh by, in expected deviations."""


def motions_of_whole(target: TargetGeometry) -> Array:
    """Motions of faces (rotation vector, shift, in their frames) by a small one of the whole target.  # (F, 6, 6)"""
    frame = target.target_from_face
    turn = frame[:, :3, :3].transpose(0, 2, 1)
    motion = np.zeros((len(frame), 6, 6))
    motion[:, :3, :3] = turn
    motion[:, 3:, 3:] = turn
    motion[:, 3:, :3] = -turn @ skew(frame[:, :3, 3])
    return motion


def outlying_faces(unknowns: Unknowns, seen: SeenParts, shape: TargetUnknowns) -> Flags:
    """The faces of the datum that lie far off while the others agree.  # (F,)"""
    outlying = np.zeros(unknowns.target.face_count, dtype=bool)
    which = np.flatnonzero(seen.datum)
    if not unknowns.has_motion or len(which) < LEAST_FACES:
        return outlying
    sigma = unknowns.sigma[unknowns.column[which, 6:12]]  # (N, 6)
    lift = np.tile([[0.0], [0.0], [0.0], [0.0], [0.0], [1.0]], (len(which), 1, 1))
    design = np.concatenate([motions_of_whole(unknowns.target)[which], lift], axis=2) / sigma[:, :, None]
    value = shape.motion[which] / sigma
    distance = np.ones(len(which))
    for _ in range(ROUNDS):
        root = np.sqrt(1 / np.maximum(distance, CLOSE))
        common = least_squares((root[:, None, None] * design).reshape(-1, 7), (root[:, None] * value).ravel())
        distance = np.linalg.norm(value - design @ common, axis=1)
    outlying[which] = distance > FAR * max(float(np.median(distance)), CLOSE)
    return outlying


ISOTROPIC = np.array([1.0, 1.0, 1.0, 0.0, 0.0, 0.0])


@dataclass(frozen=True, eq=False)
class TargetAccuracy:
    """Covariances in the datum; of the scale nothing is in them."""

    params: Array  # (P, P) of all cameras' free parameters
    strain: Array  # (6, 6)
    motion: Array  # (6 F, 6 F) of the faces' own motions
    face: Array  # (F, 6, 6) of where the faces are, in their frames, what the strain does to them included
    bow: Array  # (F, 3, 3)
    offset_sigma_mm: Array  # (R, 3)
    effective: float  # how many unknowns the observations had to determine, the poses left out
    face_by_scale: Array  # (F, 6) what a scale of the whole target does to the faces


@dataclass(frozen=True, eq=False)
class _Wide:
    """Rows of functions of the unknowns times the covariance's factor: what is common, and what is a ring's own."""

    common: Array  # (N, K)
    own: Array  # (N, 3 R)

    def covariance(self) -> Array:
        """(N, N)."""
        matrix: Array = self.common @ self.common.T + self.own @ self.own.T
        return matrix

    def minus(self, weights: Array, other: "_Wide") -> "_Wide":
        """These rows without weighted ones of others (N, M)."""
        return _Wide(self.common - weights @ other.common, self.own - weights @ other.own)


def accuracy_of(joint: Joint, shape: TargetUnknowns, seen: SeenParts, normal: Normal) -> TargetAccuracy | None:
    """The covariances at the minimum; None if the photos and the priors do not determine it."""
    factor = covariance_factor(normal)
    if factor is None:
        return None
    unknowns, target = joint.unknowns, joint.unknowns.target
    rings, shared = place_rings(unknowns, shape), factor.other[joint.param_count :]
    params = factor.other[: joint.param_count]
    count, free = target.ring_count, len(factor.ring)
    width = factor.other.shape[1]
    own = factor.ring_own if free else np.zeros((count, 3, 3))
    offset = factor.ring if free else np.zeros((count, 3, width))
    by_shared = by_shared_dense(unknowns, rings)
    moves = (by_shared.reshape(-1, unknowns.count) @ shared).reshape(count, 3, width) + rings.by_offset @ offset
    strained = by_shared[:, :, : unknowns.first_motion].reshape(3 * count, -1) @ shared[: unknowns.first_motion]
    inverse = np.linalg.inv(np.eye(3) + strain_matrix(shape.strain))
    unstrained = inverse @ (moves - strained.reshape(count, 3, width))
    moves_own = rings.by_offset @ own
    which = np.flatnonzero(datum_rings(unknowns, seen))
    rigid = _through(rigid_fit(rings.unstrained_mm[which]), which, unstrained, inverse @ moves_own)
    scale = _Wide(np.zeros((1, width)), np.zeros((1, 3 * count)))
    if unknowns.has_strain:
        scale = _through(scale_fit(rings.position_mm[which])[None], which, moves, moves_own)
    first, second = unknowns.first_motion, unknowns.first_bow
    design = _face_designs(unknowns, seen)
    strain, motion = np.zeros((6, 6)), np.zeros((6 * target.face_count,) * 2)
    if unknowns.has_strain:
        rows = _Wide(np.zeros((6, width)), np.zeros((6, 3 * count)))
        rows.common[unknowns.strain] = shared[:first]
        strain = rows.minus(ISOTROPIC[:, None], scale).covariance()
    adjoint = motions_of_whole(unknowns.target)
    own_rows = [_through(inverse, which, offset, own) for which, inverse in design]
    folds = _Wide(np.concatenate([one.common for one in own_rows]), np.concatenate([one.own for one in own_rows]))
    if unknowns.has_motion:
        folds = _Wide(folds.common + shared[first:second], folds.own)
        motion = folds.minus(adjoint.reshape(-1, 6), rigid).covariance()
    face, by_scale = _faces(unknowns, shape, rings, design, (moves, moves_own), (rigid, scale))
    bow = np.zeros((target.face_count, 3, 3))
    if unknowns.has_bow:
        bent = shared[second:].reshape(-1, 3, width)
        bow = bent @ bent.transpose(0, 2, 1)
    sigma, effective = _rings(joint, factor, design, offset, own)
    return TargetAccuracy(params @ params.T, strain, motion, face, bow, sigma, joint.param_count + effective, by_scale)


def _through(inverse: Array, which: Rows, common: Array, own: Array) -> _Wide:
    """Functions (N, 3 n) of some rings' displacements, times the factors (R, 3, K) and (R, 3, 3) of all rings'."""
    spread = np.zeros((len(inverse), len(own), 3))
    blocks = inverse.reshape(len(inverse), -1, 3)
    spread[:, which] = np.einsum("nri,rij->nrj", blocks, own[which])
    return _Wide(inverse @ common[which].reshape(-1, common.shape[2]), spread.reshape(len(inverse), -1))


def _face_designs(unknowns: Unknowns, seen: SeenParts) -> list[tuple[Rows, Array]]:
    """Of each face the rings that tell where it is, and what turns their displacements into its motion (6, 3 n)."""
    center = unknowns.target.center_in_face_mm
    found = []
    for rows in fit_rings(unknowns, seen):
        found.append((rows, rigid_fit(center[rows]) if len(rows) else np.zeros((6, 0))))
    return found


def _faces(
    unknowns: Unknowns,
    shape: TargetUnknowns,
    rings: RingPlaces,
    design: list[tuple[Rows, Array]],
    moves: tuple[Array, Array],
    datum: tuple[_Wide, _Wide],
) -> tuple[Array, Array]:
    """Covariances (F, 6, 6) of where the faces are, in their frames, and what a scale does to them (F, 6)."""
    target, (rigid, scale) = unknowns.target, datum
    whole = (np.eye(3) + strain_matrix(shape.strain)) @ rigid_design(rings.unstrained_mm)
    covariance, by_scale = np.zeros((target.face_count, 6, 6)), np.zeros((target.face_count, 6))
    for face, (rows, inverse) in enumerate(design):
        turn = target.target_from_face[face, :3, :3].T
        inner = (inverse.reshape(6, -1, 3) @ turn).reshape(6, -1)
        by_scale[face] = inner @ rings.position_mm[rows].ravel()
        known = _through(inner, rows, *moves).minus(inner @ whole[rows].reshape(-1, 6), rigid)
        covariance[face] = known.minus(by_scale[face][:, None], scale).covariance()
    return covariance, by_scale


def _rings(
    joint: Joint, factor: Factor, design: list[tuple[Rows, Array]], offset: Array, own: Array
) -> tuple[Array, float]:
    """Deviations of the offsets without their faces' motion (R, 3), and effective unknowns."""
    unknowns = joint.unknowns
    target = unknowns.target
    shared = factor.other[joint.param_count :]
    effective = unknowns.count - float(((shared**2).sum(axis=1) / unknowns.sigma**2).sum())
    effective -= len(joint.gauge)
    sigma = np.zeros((target.ring_count, 3))
    if unknowns.ring_sigma_mm is None:
        return sigma, effective
    variance = (offset**2).sum(axis=2) + (own**2).sum(axis=2)
    effective += float((1 - variance / unknowns.ring_sigma_mm**2).sum())
    center = target.center_in_face_mm
    for face, (rows, inverse) in enumerate(design):
        mine = np.flatnonzero(target.ring_face == face)
        if not len(mine):
            continue
        moved = rigid_design(center[mine]).reshape(-1, 6)
        common = offset[mine].reshape(3 * len(mine), -1) - moved @ (inverse @ offset[rows].reshape(3 * len(rows), -1))
        square = (common**2).sum(axis=1).reshape(-1, 3)
        spread = moved @ inverse  # (3 mine, 3 rows)
        single = np.zeros((len(mine), 3, len(mine), 3))
        single[np.arange(len(mine)), :, np.arange(len(mine)), :] = own[mine]
        place = np.searchsorted(mine, rows)
        single[:, :, place] -= np.einsum("airj,rjk->airk", spread.reshape(len(mine), 3, len(rows), 3), own[rows])
        sigma[mine] = np.sqrt(square + (single**2).sum(axis=(2, 3)))
    return sigma, effective


def remarks_of(seen: SeenParts, is_determined: Flags, target: TargetGeometry) -> tuple[str, ...]:
    """One line on each thing that the photos do not tell."""
    said = []
    unseen = ~seen.face
    if unseen.any():
        said.append(f"no view shows {faces_words(unseen)}: kept as designed")
    apart = seen.face & ~seen.main
    if apart.any():
        said.append(
            f"no view joins {faces_words(apart)} with the others: where they are is not known; take photos that show "
            "faces of both"
        )
    unsure = ~is_determined & seen.main
    if unsure.any():
        said.append(f"too few views of {faces_words(unsure)} to tell where they are; take more")
    few = is_determined & few_views(seen.views)
    if few.any():
        said.append(
            f"fewer than {FEW_VIEWS} views show {faces_words(few)}: a mistake in one of them would not be seen, so "
            "whether they moved is not judged"
        )
    rings = ~seen.ring & is_determined[target.ring_face]
    if rings.any():
        said.append(
            f"{int(rings.sum())} points of measured faces were never seen: kept where they were designed on them"
        )
    return tuple(said)


def faces_words(which: Flags) -> str:
    """The numbers of faces, in words."""
    numbers = np.flatnonzero(which).tolist()
    return f"face{'s' if len(numbers) > 1 else ''} {', '.join(map(str, numbers))}"
